//! The points of a surface by where they lie, for many searches near it.

use glam::{DVec3, Vec3};

use super::boundary::{SemiBoundary, surface_point};
use super::distance::Nearest;

/// The surface points of the boundary voxels that face somewhere, in rows along x of cells as large as voxels. A point
/// is in the row that it lies in, which need not be that of its voxel: a search looks at few of them.
#[derive(Debug, Clone)]
pub struct PointIndex {
    spacing: DVec3,
    offset_step: f64,
    /// Cell y and z of the first row.
    first: [isize; 2],
    /// Rows along y and z.
    size: [usize; 2],
    /// Where each row begins in `points`, y fastest; one more than there are rows.
    rows: Vec<u32>,
    points: Vec<Point>,
    /// More than any rounding of a position, mm.
    room: f64,
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
    surface.voxels.iter().map(|voxel| voxel.normal()).collect()
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
        let voxels = surface.iter().zip(normals);
        let facing = voxels.filter(|((_, voxel, ..), _)| !voxel.code().is_cut());
        let placed = facing.map(|((_, voxel, y, z), &normal)| {
            let index = [voxel.x(), y, z];
            let point = surface.point_of(index, voxel.offset, normal.as_dvec3()).0;
            let placed = Point {
                x: point.x as f32,
                normal,
                // A grid has at most 32767 voxels along an axis.
                index: index.map(|at| at as u16),
                offset: voxel.offset,
            };
            (cell(point, spacing), placed)
        });
        let placed: Vec<([isize; 2], Point)> = placed.collect();
        let ends = placed.iter().fold(None, |ends, &(cell, _)| {
            let (first, last) = ends.unwrap_or((cell, cell));
            let each = |ends: [isize; 2], of: fn(isize, isize) -> isize| {
                [of(ends[0], cell[0]), of(ends[1], cell[1])]
            };
            Some((each(first, Ord::min), each(last, Ord::max)))
        });
        let (first, last) = ends.unwrap_or(([0; 2], [-1; 2]));
        let size = [0, 1].map(|axis| (last[axis] - first[axis] + 1).unsigned_abs());
        let row = |[y, z]: [isize; 2]| z.abs_diff(first[1]) * size[0] + y.abs_diff(first[0]);
        // Counted, then each put into its row.
        let mut rows = vec![0_u32; size[0] * size[1] + 1];
        for (cell, _) in &placed {
            rows[row(*cell)] += 1;
        }
        let mut begin = 0;
        for row in &mut rows {
            begin += std::mem::replace(row, begin);
        }
        let mut points = vec![Point::default(); placed.len()];
        let mut next = rows.clone();
        for (cell, point) in placed {
            let next = &mut next[row(cell)];
            points[*next as usize] = point;
            *next += 1;
        }
        for ends in rows.windows(2) {
            let row = &mut points[ends[0] as usize..ends[1] as usize];
            row.sort_by(|one, other| one.x.total_cmp(&other.x));
        }
        let extent = spacing * (surface.grid().last_index() + 4.0);
        Self {
            spacing,
            offset_step: surface.offset_step(),
            first,
            size,
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
        let centre = cell(from, self.spacing);
        let rings = (0..2).map(|axis| {
            let last = self.first[axis].saturating_add_unsigned(self.size[axis]);
            (centre[axis].abs_diff(self.first[axis])).max(centre[axis].abs_diff(last))
        });
        for ring in 0..=rings.max().unwrap_or_default() as isize {
            if search.beyond(centre, ring) > search.limit {
                break;
            }
            for dz in -ring..=ring {
                let gap_z = search.gap(centre, dz, 1);
                if gap_z > search.limit {
                    continue;
                }
                let step = match dz.abs() == ring {
                    true => 1,
                    false => 2 * ring.max(1),
                };
                let mut dy = -ring;
                while dy <= ring {
                    let gap_y = search.gap(centre, dy, 0);
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

    fn row(&self, [y, z]: [isize; 2]) -> &[Point] {
        let (y, z) = (y - self.first[0], z - self.first[1]);
        let (Ok(y), Ok(z)) = (usize::try_from(y), usize::try_from(z)) else {
            return &[];
        };
        if y >= self.size[0] || z >= self.size[1] {
            return &[];
        }
        let row = z * self.size[0] + y;
        match self.rows.get(row..row + 2) {
            Some(&[begin, end]) => self
                .points
                .get(begin as usize..end as usize)
                .unwrap_or_default(),
            _ => &[],
        }
    }
}

/// The cell y and z of a point.
fn cell(point: DVec3, spacing: DVec3) -> [isize; 2] {
    // Rounded down, half a cell further on.
    [point.y / spacing.y, point.z / spacing.z].map(|at| (at + 0.5).floor() as isize)
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
    /// How far cells are at least that are `ring` away from `centre`, mm.
    fn beyond(&self, centre: [isize; 2], ring: isize) -> f64 {
        if ring == 0 {
            return 0.0;
        }
        [-ring, ring]
            .map(|away| self.gap(centre, away, 0).min(self.gap(centre, away, 1)))
            .into_iter()
            .fold(f64::INFINITY, f64::min)
    }

    /// How far cells are that are `away` from `centre` along y (0) or z (1), mm.
    #[inline]
    fn gap(&self, centre: [isize; 2], away: isize, axis: usize) -> f64 {
        let (from, spacing) = match axis {
            0 => (self.from.y, self.on.spacing.y),
            _ => (self.from.z, self.on.spacing.z),
        };
        let middle = (centre[axis] + away) as f64 * spacing;
        ((middle - from).abs() - 0.5 * spacing).max(0.0)
    }

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
