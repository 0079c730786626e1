//! The points of a surface by where they lie, for many searches near it.

use glam::{DVec3, Vec3};

use super::boundary::{BoundaryVoxel, SemiBoundary, surface_point};
use super::distance::Nearest;

/// The surface points of the boundary voxels that face somewhere, in rows along x of cells as large as voxels. A point
/// is in the row that it lies in, which need not be that of its voxel: a search looks at few of them.
#[derive(Debug, Clone)]
pub struct PointIndex {
    spacing: DVec3,
    offset_step: f64,
    cells: Cells,
    /// Where each row begins in `points`, y fastest; one more than there are rows.
    rows: Vec<u32>,
    points: Vec<Point>,
    /// More than any rounding of a position, mm.
    room: f64,
}

/// The cells across x, those of the voxels of a surface: y and z of the first and the last. What lies beyond these is
/// in the outermost.
#[derive(Debug, Clone, Copy)]
struct Cells {
    spacing: [f64; 2],
    first: [isize; 2],
    last: [isize; 2],
}

impl Cells {
    fn rows(&self) -> usize {
        let size = |axis: usize| self.last[axis].abs_diff(self.first[axis]) + 1;
        size(0) * size(1)
    }

    /// The number of a cell.
    #[inline]
    fn row(&self, [y, z]: [isize; 2]) -> usize {
        let along_y = self.last[0].abs_diff(self.first[0]) + 1;
        z.abs_diff(self.first[1]) * along_y + y.abs_diff(self.first[0])
    }

    /// The cell of a point.
    #[inline]
    fn at(&self, point: DVec3) -> [isize; 2] {
        let each = |axis: usize, mm: f64| {
            let after = mm / self.spacing[axis] - self.first[axis] as f64;
            // Not below 0, so that this rounds to the nearest.
            let after = (after + 0.5).max(0.0) as isize;
            self.first[axis].saturating_add(after).min(self.last[axis])
        };
        [each(0, point.y), each(1, point.z)]
    }

    /// How far points of cells that are `ring` away from `centre`, the cell of `from`, are at least from that, mm.
    fn beyond(&self, centre: [isize; 2], ring: isize, from: DVec3) -> f64 {
        let side = |axis: usize, away: isize, at: f64| {
            let cell = centre[axis] + away;
            match (self.first[axis]..=self.last[axis]).contains(&cell) {
                true => self.gap(centre[axis], away, axis, at),
                false => f64::INFINITY,
            }
        };
        let y = side(0, -ring, from.y).min(side(0, ring, from.y));
        y.min(side(1, -ring, from.z)).min(side(1, ring, from.z))
    }

    /// How far the points of a cell that is `away` from the cell at `centre` are at least from a point of that, along
    /// y (0) or z (1), mm. `at` is where the point is along that axis.
    #[inline]
    fn gap(&self, centre: isize, away: isize, axis: usize, at: f64) -> f64 {
        let spacing = self.spacing[axis];
        let middle = (centre + away) as f64 * spacing;
        match away {
            0 => 0.0,
            1.. => middle - 0.5 * spacing - at,
            _ => at - (middle + 0.5 * spacing),
        }
    }
}

/// A surface point, as where it is along x and what it is made of.
#[derive(Debug, Clone, Copy, Default)]
struct Point {
    /// In mm.
    x: f32,
    normal: Vec3,
    /// Of its voxel.
    index: [u16; 3],
    offset: i8,
}

const _: () = assert!(size_of::<Point>() == 24);

/// The normals of the boundary voxels of a surface, unpacked once for many uses.
pub(super) fn normals(surface: &SemiBoundary) -> Vec<Vec3> {
    let (eights, rest) = surface.voxels.as_chunks::<8>();
    let mut normals = Vec::with_capacity(surface.len());
    for voxels in eights {
        let [x, y, z] = BoundaryVoxel::normals(voxels);
        for lane in 0..8 {
            normals.push(Vec3::new(x[lane], y[lane], z[lane]));
        }
    }
    normals.extend(rest.iter().map(|voxel| voxel.normal()));
    normals
}

/// Every surface point that faces somewhere, in the order of its voxels.
#[inline]
fn for_each_facing(surface: &SemiBoundary, normals: &[Vec3], mut each: impl FnMut(DVec3, Point)) {
    let (spacing, step) = (surface.grid().spacing(), surface.offset_step());
    for [y, z] in surface.rows_with_voxels() {
        let normals = normals.get(surface.row_range(y, z)).unwrap_or_default();
        for (voxel, &normal) in surface.row(y, z).iter().zip(normals) {
            if voxel.code().is_cut() {
                continue;
            }
            let index = [voxel.x(), y, z];
            let at = surface_point(index, voxel.offset, normal.as_dvec3(), spacing, step);
            let point = Point {
                x: at.x as f32,
                normal,
                // A grid has at most 32767 voxels along an axis.
                index: index.map(|at| at as u16),
                offset: voxel.offset,
            };
            each(at, point);
        }
    }
}

/// What a search found.
pub(super) enum Found {
    /// One point is nearer than all others, or there is none.
    One(Option<Nearest>),
    /// Several are equally near.
    Several,
}

impl PointIndex {
    /// Of all points of `surface` that face somewhere: what the end of the scan lays open does not. `normals` are
    /// those of its voxels.
    pub(super) fn new(surface: &SemiBoundary, normals: &[Vec3]) -> Self {
        let spacing = surface.grid().spacing();
        let mut ends = None;
        for [y, z] in surface.rows_with_voxels() {
            let (first, last) = ends.unwrap_or(([y, z], [y, z]));
            let first = [first[0].min(y), first[1].min(z)];
            ends = Some((first, [last[0].max(y), last[1].max(z)]));
        }
        // None where there are no voxels: nothing is asked of them then.
        let (first, last) = ends.unwrap_or_default();
        let cells = Cells {
            spacing: [spacing.y, spacing.z],
            first: first.map(|at| at as isize),
            last: last.map(|at| at as isize),
        };
        // Counted, then each put into its row.
        let mut rows = vec![0_u32; cells.rows() + 1];
        let mut row_of = Vec::with_capacity(surface.len());
        for_each_facing(surface, normals, |point, _| {
            let row = cells.row(cells.at(point));
            rows[row] += 1;
            // Fits: there are no more rows than in the grid, of at most 32767 voxels along an axis.
            row_of.push(row as u32);
        });
        let mut begin = 0;
        for row in &mut rows {
            begin += std::mem::replace(row, begin);
        }
        let mut points = vec![Point::default(); row_of.len()];
        let mut next = rows.clone();
        let mut row_of = row_of.iter();
        for_each_facing(surface, normals, |_, point| {
            if let Some(&row) = row_of.next() {
                let next = &mut next[row as usize];
                points[*next as usize] = point;
                *next += 1;
            }
        });
        for ends in rows.windows(2) {
            let row = &mut points[ends[0] as usize..ends[1] as usize];
            row.sort_by(|one, other| one.x.total_cmp(&other.x));
        }
        let extent = spacing * (surface.grid().last_index() + 4.0);
        Self {
            spacing,
            offset_step: surface.offset_step(),
            cells,
            rows,
            points,
            // An f32 has 24 bits.
            room: extent.max_element() / f64::from(1 << 20),
        }
    }

    /// The point nearest to `from`, no further than `limit` mm, among those that face less than 90° away from
    /// `facing`. `guess` is one of them, known to be near.
    pub(super) fn nearest(
        &self,
        from: DVec3,
        facing: DVec3,
        limit: f64,
        guess: Option<Nearest>,
    ) -> Found {
        let mut search = Search {
            on: self,
            from,
            facing,
            best: guess,
            tied: false,
            limit: guess.map_or(limit, |guess| guess.squared.sqrt()) + self.room,
        };
        let cells = self.cells;
        let centre = cells.at(from);
        let furthest = (0..2)
            .map(|axis| (centre[axis] - cells.first[axis]).max(cells.last[axis] - centre[axis]));
        for ring in 0..=furthest.max().unwrap_or_default() {
            if cells.beyond(centre, ring, from) > search.limit {
                break;
            }
            for dz in -ring..=ring {
                let gap_z = cells.gap(centre[1], dz, 1, from.z);
                if gap_z > search.limit {
                    continue;
                }
                let step = match dz.abs() == ring {
                    true => 1,
                    false => 2 * ring.max(1),
                };
                let mut dy = -ring;
                while dy <= ring {
                    let gap_y = cells.gap(centre[0], dy, 0, from.y);
                    let across = gap_y * gap_y + gap_z * gap_z;
                    search.row([centre[0] + dy, centre[1] + dz], across);
                    dy += step;
                }
            }
        }
        match search.tied {
            true => Found::Several,
            false => Found::One(search.best.filter(|best| best.squared <= limit * limit)),
        }
    }

    fn row(&self, cell: [isize; 2]) -> &[Point] {
        let Cells { first, last, .. } = self.cells;
        if (0..2).any(|axis| cell[axis] < first[axis] || cell[axis] > last[axis]) {
            return &[];
        }
        let row = self.cells.row(cell);
        match self.rows.get(row..row + 2) {
            Some(&[begin, end]) => {
                let row = self.points.get(begin as usize..end as usize);
                row.unwrap_or_default()
            }
            _ => &[],
        }
    }
}

struct Search<'a> {
    on: &'a PointIndex,
    from: DVec3,
    facing: DVec3,
    best: Option<Nearest>,
    /// Whether another point is as near as the best.
    tied: bool,
    /// How far the best is, or the furthest that is looked for; a little more than that, mm.
    limit: f64,
}

impl Search<'_> {
    #[inline]
    fn row(&mut self, cell: [isize; 2], across: f64) {
        if across > self.limit * self.limit {
            return;
        }
        let row = self.on.row(cell);
        let begin = row.partition_point(|point| f64::from(point.x) < self.from.x);
        let (left, right) = row.split_at(begin);
        for point in left.iter().rev() {
            if !self.point(point, across) {
                break;
            }
        }
        for point in right {
            if !self.point(point, across) {
                break;
            }
        }
    }

    /// Looks at a point; whether one beyond it can still be as near as the best.
    #[inline]
    fn point(&mut self, point: &Point, across: f64) -> bool {
        let dx = f64::from(point.x) - self.from.x;
        if dx * dx + across > self.limit * self.limit {
            return false;
        }
        let index = point.index.map(usize::from);
        let normal = point.normal.as_dvec3();
        let (spacing, step) = (self.on.spacing, self.on.offset_step);
        let at = surface_point(index, point.offset, normal, spacing, step);
        let found = Nearest::of(at, normal, self.from);
        let least = self.best.map_or(f64::INFINITY, |best| best.squared);
        if found.squared > least || found.normal.dot(self.facing) <= 0.0 {
            return true;
        }
        if found.squared < least {
            self.best = Some(found);
            self.tied = false;
            self.limit = found.squared.sqrt() + self.on.room;
        } else {
            // The guess is met again as itself.
            let is_best = |best: Nearest| best.point == found.point && best.normal == found.normal;
            self.tied |= !self.best.is_some_and(is_best);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::SurfaceDistance;
    use crate::surface::difference::tests::skin;

    /// Evenly spread, from -1 to 1.
    fn spread(state: &mut u32) -> f64 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(*state) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    /// A ball, symmetric about voxels, in which many places are equally far from several points; and a wavy face.
    fn surfaces() -> [SemiBoundary; 2] {
        let middle = DVec3::new(12.0, 16.0, 16.5);
        let ball = skin(|at| 9.0 - (at - middle).length()).0;
        let wavy = skin(|at| {
            let wave = libm::sin(at.x * 0.9) + libm::cos(at.z * 0.7);
            (at.y - 14.0 - 2.0 * wave).min(1.7 * (24.0 - at.y))
        });
        [ball, wavy.0]
    }

    #[test]
    fn as_near_as_any_point_that_faces_the_same_way() {
        let mut state = 5;
        for surface in surfaces() {
            let index = PointIndex::new(&surface, &normals(&surface));
            let (mut found_none, mut far) = (0, 0);
            for number in 0..400 {
                let mut next = || spread(&mut state);
                // Also outside the grid, where the outermost cells are.
                let from = DVec3::new(12.0, 16.0, 16.5) + DVec3::new(next(), next(), next()) * 30.0;
                let facing = DVec3::new(next(), next(), next()).normalize();
                let limit = if number % 2 == 0 { 100.0 } else { 6.0 };
                let squared = surface.iter().filter_map(|(_, voxel, y, z)| {
                    let faces = voxel.normal().as_dvec3().dot(facing) > 0.0;
                    let point = surface.surface_point(voxel, y, z).0;
                    let counts = faces && !voxel.code().is_cut();
                    counts.then(|| (point - from).length_squared())
                });
                let least = squared.fold(f64::INFINITY, f64::min);
                let least = Some(least).filter(|least| *least <= limit * limit);
                match index.nearest(from, facing, limit, None) {
                    Found::One(found) => assert_eq!(found.map(|found| found.squared), least),
                    Found::Several => panic!("these are in no order"),
                }
                found_none += usize::from(least.is_none());
                far += usize::from(least.is_some_and(|least| least > 100.0));
            }
            assert!(found_none > 50 && far > 50, "{found_none}, {far}");
        }
    }

    #[test]
    fn in_order_it_is_what_a_plain_search_finds() {
        let mut state = 9;
        for (number, surface) in surfaces().iter().enumerate() {
            let index = PointIndex::new(surface, &normals(surface));
            let distance = SurfaceDistance::new(surface, 20.0);
            let mut facing = distance.facing_in_order(&index);
            let mut last: Option<Nearest> = None;
            let (mut ties, mut none) = (0, 0);
            // Along rows of voxels, as skins are compared, all through the grid.
            for place in 0..4000_usize {
                let [x, y, z] = [place % 48, place / 48 % 40, 3 + place / 1920 * 12];
                let from = DVec3::new(x as f64, y as f64, z as f64) * surface.grid().spacing();
                let normal = match place / 48 % 3 {
                    0 => DVec3::NEG_Y,
                    1 => DVec3::new(0.0, -0.6, 0.8),
                    _ => DVec3::new(spread(&mut state), -0.5, spread(&mut state)),
                };
                let before = last.map(|last| Nearest::of(last.point, last.normal, from));
                let before = before.filter(|last| last.normal.dot(normal) > 0.0);
                last = distance.nearest(from, Some(normal), before);
                let expected = last.map(|nearest| distance.sign(from, &nearest).to_bits());
                // Sometimes any voxel of the surface is given, too.
                let near = surface.iter().nth(place * 7 % surface.len());
                let near = near.filter(|(_, voxel, ..)| place % 5 < 2 && !voxel.code().is_cut());
                let near = near.map(|(_, voxel, y, z)| {
                    let point = surface.surface_point(voxel, y, z).0;
                    (point, voxel.normal().as_dvec3())
                });
                let found = facing(from, normal, near);
                assert_eq!(found.map(f64::to_bits), expected, "{from} {normal}");
                let found = index.nearest(from, normal, 20.0, None);
                ties += usize::from(matches!(found, Found::Several));
                none += usize::from(expected.is_none());
            }
            // What is symmetric has ties.
            assert!(number > 0 || ties > 5, "{ties} ties");
            assert!(none < 1000, "{none}");
        }
    }

    #[test]
    fn of_no_points_none_is_nearest() {
        let (empty, _) = skin(|_| -1.0);
        let index = PointIndex::new(&empty, &normals(&empty));
        let found = index.nearest(DVec3::splat(5.0), DVec3::X, 60.0, None);
        assert!(matches!(found, Found::One(None)));
    }
}
