//! How far two skins are apart, as one number a pair: mean, 95th percentile, largest.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::boundary::{BoundaryVoxel, SemiBoundary};
use super::build::Region;
use super::distance::SurfaceDistance;
use super::points::{PointIndex, normals};
use super::sight::seen;
use crate::volume::Mask;

/// How far another skin is looked for, mm.
const REACH_MM: f64 = 60.0;

/// Skin that moved by no more than this is as it was, mm: a quarter of the paper's voxel. The map fades out, and
/// without such an end micrometres at the rim would make up most of the area.
pub const MOVED_MM: f64 = 0.1;

/// Rows that are looked at in one piece of work.
const ROWS_AT_ONCE: usize = 512;

/// A skin, and which of its voxels are looked at.
#[derive(Debug, Clone)]
pub struct SeenSkin {
    pub(super) surface: SemiBoundary,
    /// Where it is compared.
    pub(super) region: Region,
    /// For each boundary voxel, whether it lies in that region and is seen from outside.
    pub(super) seen: Vec<bool>,
    /// Whether it is more than [`MOVED_MM`] from the skin before.
    pub(super) moved: Vec<bool>,
}

/// The distance between two skins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkinDifference {
    /// Mean over the area, mm.
    pub mean_mm: f64,
    /// 95 % of the area are no further apart, mm.
    pub p95_mm: f64,
    /// The largest, mm.
    pub max_mm: f64,
    /// The area that was compared, mm²: the mean of the two skins'.
    pub area_mm2: f64,
}

/// The skin that others are made of: what they are held against to tell what moved.
#[derive(Debug, Clone)]
pub struct SkinBefore {
    surface: SemiBoundary,
    normals: Vec<Vec3>,
    points: PointIndex,
}

impl SkinBefore {
    /// That of `surface`.
    pub fn new(surface: SemiBoundary) -> Self {
        let normals = normals(&surface);
        Self {
            points: PointIndex::new(&surface, &normals),
            normals,
            surface,
        }
    }

    fn searched(&self) -> Searched<'_> {
        Searched {
            surface: &self.surface,
            normals: &self.normals,
            points: &self.points,
        }
    }
}

/// A skin with what every comparison of it with another one needs.
#[derive(Debug, Clone)]
pub struct ComparedSkin<'a> {
    skin: &'a SeenSkin,
    normals: Vec<Vec3>,
    points: PointIndex,
    rows: Vec<SeenRow>,
}

/// A surface that the points of another one are held against.
#[derive(Debug, Clone, Copy)]
struct Searched<'a> {
    surface: &'a SemiBoundary,
    /// Of its voxels.
    normals: &'a [Vec3],
    points: &'a PointIndex,
}

/// A row along x in which at least one voxel is seen.
#[derive(Debug, Clone, Copy)]
struct SeenRow {
    y: usize,
    z: usize,
    /// Whether one of them moved.
    moved: bool,
}

impl<'a> ComparedSkin<'a> {
    /// Of `skin`.
    pub fn new(skin: &'a SeenSkin) -> Self {
        let normals = normals(&skin.surface);
        Self {
            skin,
            points: PointIndex::new(&skin.surface, &normals),
            normals,
            rows: skin.seen_rows(),
        }
    }

    fn searched(&self) -> Searched<'_> {
        Searched {
            surface: &self.skin.surface,
            normals: &self.normals,
            points: &self.points,
        }
    }
}

impl SeenSkin {
    /// The skin `surface` of the object `mask`, of which the voxels in `region` are compared that at least one of
    /// six views from outside sees: the walls of the airways are no skin that a surgeon looks at. `before` is the
    /// skin that it was made of, on the same grid.
    pub fn new(surface: SemiBoundary, mask: &Mask, region: Region, before: &SkinBefore) -> Self {
        let normals = normals(&surface);
        let seen = seen(&surface, &normals, mask, region);
        let mut skin = Self {
            moved: vec![false; surface.len()],
            surface,
            region,
            seen,
        };
        // As long as nothing is known to have moved, that is all that did.
        let rows = skin.seen_rows();
        for (place, _, _) in skin.distances(&rows, &normals, before.searched(), region) {
            if let Some(moved) = skin.moved.get_mut(place) {
                *moved = true;
            }
        }
        skin
    }

    fn seen_rows(&self) -> Vec<SeenRow> {
        let rows = self.surface.rows_with_voxels().filter_map(|[y, z]| {
            let places = self.surface.row_range(y, z);
            let seen = self.seen.get(places.clone())?.iter();
            let mut row = None;
            for (_, &moved) in seen.zip(self.moved.get(places)?).filter(|(seen, _)| **seen) {
                let row: &mut SeenRow = row.get_or_insert(SeenRow { y, z, moved });
                row.moved |= moved;
            }
            row
        });
        rows.collect()
    }

    /// Of every voxel that is compared within `region` its place, the distance to `to`, mm, and its area, mm²; all that
    /// moved, or are not where `to` is. `rows` are those in which voxels are seen, `normals` those of all voxels.
    fn distances(
        &self,
        rows: &[SeenRow],
        normals: &[Vec3],
        to: Searched<'_>,
        region: Region,
    ) -> Vec<(usize, f64, f64)> {
        let some = rows.par_chunks(ROWS_AT_ONCE).map(|rows| {
            let mut found = Vec::new();
            for row in rows {
                self.distances_of_row(row, normals, to, region, &mut found);
            }
            found
        });
        some.collect::<Vec<_>>().concat()
    }

    fn distances_of_row(
        &self,
        &SeenRow { y, z, moved }: &SeenRow,
        normals: &[Vec3],
        to: Searched<'_>,
        region: Region,
        found: &mut Vec<(usize, f64, f64)>,
    ) {
        let (here, there) = (self.surface.row(y, z), to.surface.row(y, z));
        if !region.contains([region.first[0], y, z]) || (!moved && here == there) {
            return;
        }
        let spacing = self.surface.grid().spacing();
        let distance = SurfaceDistance::new(to.surface, REACH_MM);
        let mut facing = distance.facing_in_order(to.points);
        // Both rows are in order of x.
        let mut twins = to.surface.row_range(y, z).zip(there).peekable();
        for (place, &voxel) in self.surface.row_range(y, z).zip(here) {
            if !is_set(&self.seen, place) || !region.contains([voxel.x(), y, z]) {
                continue;
            }
            while twins.next_if(|(_, twin)| twin.x() < voxel.x()).is_some() {}
            let twin = twins.peek().filter(|(_, twin)| twin.x() == voxel.x());
            let moved = is_set(&self.moved, place);
            let mm = if twin.is_some_and(|(_, twin)| **twin == voxel) {
                if !moved {
                    continue;
                }
                0.0
            } else {
                let Some(normal) = normals.get(place).map(|normal| normal.as_dvec3()) else {
                    continue;
                };
                let index = [voxel.x(), y, z];
                let point = self.surface.point_of(index, voxel.offset, normal).0;
                // The same voxel of the other skin bounds the distance: it is most of what does not count.
                let twin = twin.filter(|(_, twin)| !twin.code().is_cut());
                let twin = twin.and_then(|&(place, twin)| {
                    let normal = to.normals.get(place)?.as_dvec3();
                    let point = to.surface.point_of(index, twin.offset, normal).0;
                    Some((point, normal))
                });
                let is_near = |(at, facing): (DVec3, DVec3)| {
                    facing.dot(normal) > 0.0 && at.distance(point) <= MOVED_MM
                };
                if !moved && twin.is_some_and(is_near) {
                    continue;
                }
                match facing(point, normal, twin) {
                    Some(mm) => mm.abs(),
                    None => continue,
                }
            };
            if moved || mm > MOVED_MM {
                found.push((place, mm, area(voxel, spacing)));
            }
        }
    }
}

fn is_set(flags: &[bool], place: usize) -> bool {
    flags.get(place).copied().unwrap_or_default()
}

/// How far two skins of one grid are apart where at least one of them moved by more than [`MOVED_MM`], in both
/// directions.
///
/// The distance of a point of one skin is that to the nearest point of the other that faces the same way, so
/// that neither the far side of a thin wall nor an airway behind it is taken for the skin. Where both
/// skins are as before nothing is compared: no mean is made small by a face that does not change. Skins that were found
/// in different regions are compared where the regions overlap.
pub fn skin_difference(one: &ComparedSkin<'_>, other: &ComparedSkin<'_>) -> SkinDifference {
    let region = one.skin.region.and(&other.skin.region);
    let distances = |from: &ComparedSkin<'_>, to: &ComparedSkin<'_>| {
        from.skin
            .distances(&from.rows, &from.normals, to.searched(), region)
    };
    let (there, back) = rayon::join(|| distances(one, other), || distances(other, one));
    let mut all: Vec<(f64, f64)> = Vec::with_capacity(there.len() + back.len());
    all.extend(there.iter().chain(&back).map(|&(_, mm, area)| (mm, area)));
    // Stable: what is equally far apart stays in the order of the voxels, for any number of threads.
    all.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let total: f64 = all.iter().map(|(_, area)| area).sum();
    let weighted: f64 = all.iter().map(|(mm, area)| mm * area).sum();
    let mut reached = 0.0;
    let p95 = all.iter().find(|(_, area)| {
        reached += area;
        reached >= 0.95 * total
    });
    let max_mm = all.last().map_or(0.0, |(mm, _)| *mm);
    SkinDifference {
        mean_mm: if total > 0.0 { weighted / total } else { 0.0 },
        p95_mm: p95.map_or(max_mm, |(mm, _)| *mm),
        max_mm,
        area_mm2: total / 2.0,
    }
}

/// The area of the surface that a boundary voxel stands for, mm². A plane has one boundary voxel for each
/// column of voxels along the axis that it crosses in the fewest voxels.
fn area(voxel: BoundaryVoxel, spacing: DVec3) -> f64 {
    let normal = voxel.normal().as_dvec3().abs();
    spacing.element_product() / (normal * spacing).max_element()
}

#[cfg(test)]
pub(super) mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::segment::segment;
    use crate::space::Grid;
    use crate::surface::distance::Nearest;
    use crate::surface::semi_boundary;
    use crate::volume::{Rescale, Volume};

    const DIMS: [usize; 3] = [48, 40, 30];
    const SPACING: [f64; 3] = [0.5, 0.8, 1.1];

    /// A volume whose HU fall evenly through 0 at the surface `depth(point) = 0`, positive inside, mm.
    pub(in crate::surface) fn skin(depth: impl Fn(DVec3) -> f64) -> (SemiBoundary, Mask) {
        let grid = Grid::axis_aligned(DIMS, SPACING).unwrap();
        let [nx, ny, nz] = DIMS;
        let samples = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| {
            let point = DVec3::new(x as f64, y as f64, z as f64) * DVec3::from(SPACING);
            (100.0 * depth(point)).clamp(-1000.0, 1000.0) as f32
        });
        let volume = Volume::new(grid.clone(), Rescale::NONE, samples).unwrap();
        let mask = segment(&volume, 0.0, true).unwrap();
        let surface = semi_boundary(&volume, &mask, 0.0, Region::whole(&grid)).unwrap();
        (surface, mask)
    }

    pub(in crate::surface) fn seen(
        (surface, mask): &(SemiBoundary, Mask),
        before: &(SemiBoundary, Mask),
    ) -> SeenSkin {
        let (whole, before) = (
            Region::whole(surface.grid()),
            SkinBefore::new(before.0.clone()),
        );
        SeenSkin::new(surface.clone(), mask, whole, &before)
    }

    pub(in crate::surface) fn between(one: &SeenSkin, other: &SeenSkin) -> SkinDifference {
        skin_difference(&ComparedSkin::new(one), &ComparedSkin::new(other))
    }

    fn difference(
        one: &(SemiBoundary, Mask),
        other: &(SemiBoundary, Mask),
        before: &(SemiBoundary, Mask),
    ) -> SkinDifference {
        between(&seen(one, before), &seen(other, before))
    }

    #[test]
    fn skins_of_different_regions_are_compared_where_both_are() {
        let ball = |radius: f64| skin(|at| radius - (at - DVec3::new(12.0, 16.0, 16.0)).length());
        let (before, one, other) = (ball(9.0), ball(10.0), ball(10.5));
        let in_region = |(surface, mask): &(SemiBoundary, Mask), first, last| {
            SeenSkin::new(
                surface.clone(),
                mask,
                Region { first, last },
                &SkinBefore::new(before.0.clone()),
            )
        };
        let found = between(
            &in_region(&one, [0, 0, 10], [30, 39, 29]),
            &in_region(&other, [20, 0, 0], [47, 39, 25]),
        );
        let both = ([20, 0, 10], [30, 39, 25]);
        let expected = between(
            &in_region(&one, both.0, both.1),
            &in_region(&other, both.0, both.1),
        );
        assert!(expected.area_mm2 > 10.0, "{expected:?}");
        assert_eq!(found, expected);
        let whole = between(&seen(&one, &before), &seen(&other, &before));
        assert!(whole.area_mm2 > 2.0 * found.area_mm2, "{whole:?}");
        let apart = between(
            &in_region(&one, [0; 3], [10, 39, 29]),
            &in_region(&other, [11, 0, 0], [47, 39, 29]),
        );
        assert_eq!((apart.area_mm2, apart.max_mm), (0.0, 0.0));
    }

    /// A face across y, at `y` mm.
    fn face(y: f64) -> (SemiBoundary, Mask) {
        skin(|point| point.y - y)
    }

    #[test]
    fn two_faces_are_apart_by_what_lies_between_them() {
        let [before, one, other] = [20.0, 17.3, 15.1].map(face);
        let found = difference(&one, &other, &before);
        for mm in [found.mean_mm, found.p95_mm, found.max_mm] {
            assert!((mm - 2.2).abs() < 0.02, "{found:?}");
        }
        // All of the face but the rim, where the surface is that of the scan's end.
        let whole = 48.0 * 0.5 * 30.0 * 1.1;
        let ratio = found.area_mm2 / whole;
        assert!(ratio > 0.85 && ratio < 1.02, "{ratio}");
        assert_eq!(found, difference(&other, &one, &before));
    }

    #[test]
    fn where_both_are_as_before_nothing_is_compared() {
        let before = face(20.0);
        let bump = |height: f64| {
            skin(move |point| {
                let aside = DVec3::new(point.x - 12.0, 0.0, point.z - 16.0).length();
                point.y - 20.0 + height * (1.0 - aside / 6.0).max(0.0)
            })
        };
        let (same, low, high) = (face(20.0), bump(2.0), bump(5.0));
        let nothing = difference(&same, &before, &before);
        assert_eq!((nothing.mean_mm, nothing.area_mm2), (0.0, 0.0));
        let found = difference(&low, &high, &before);
        assert!(found.max_mm > 1.8 && found.max_mm <= 3.0, "{found:?}");
        assert!(found.mean_mm > 0.4 && found.mean_mm < 1.6, "{found:?}");
        assert!(found.mean_mm < found.p95_mm && found.p95_mm < found.max_mm);
        // A cone of 6 mm: the rest of the face does not count.
        assert!(found.area_mm2 < 200.0, "{found:?}");
        // Two that moved alike differ from the start and not from each other.
        let alike = difference(&bump(5.0), &high, &before);
        assert_eq!((alike.max_mm, alike.mean_mm), (0.0, 0.0));
        assert!(alike.area_mm2 > 50.0);
    }

    #[test]
    fn an_inclined_plane_has_its_area_whatever_the_voxels() {
        for normal in [
            DVec3::new(0.0, -1.0, 0.0),
            DVec3::new(0.3, -0.8, 0.4),
            DVec3::new(-0.5, -0.5, 0.5),
        ] {
            let normal = normal.normalize();
            let middle = DVec3::from(SPACING) * DVec3::new(23.5, 19.5, 14.5);
            let plane = |shift: f64| skin(move |point| -normal.dot(point - middle) - shift);
            let (one, other) = (plane(0.0), plane(0.4));
            let within = |skin: &(SemiBoundary, Mask)| -> f64 {
                let spacing = DVec3::from(SPACING);
                let near = skin.0.iter().filter(|(_, voxel, y, z)| {
                    let point = skin.0.surface_point(*voxel, *y, *z).0;
                    (point - middle).length() < 6.0
                });
                near.map(|(_, voxel, _, _)| area(voxel, spacing)).sum()
            };
            let disc = std::f64::consts::PI * 36.0;
            assert!(
                (within(&one) / disc - 1.0).abs() < 0.05,
                "{normal}: {}",
                within(&one)
            );
            let found = difference(&one, &other, &face(1.0));
            assert!((found.mean_mm - 0.4).abs() < 0.05, "{normal}: {found:?}");
        }
    }

    #[test]
    fn the_wall_of_an_airway_is_not_the_skin() {
        // A face 2 mm thick with a closed cavity behind it, whose wall is nearer to the other face than its skin.
        let hollow = |y: f64| {
            skin(move |point| {
                let middle = DVec3::new(11.5, (y + 2.0 + 29.0) / 2.0, 16.0);
                let half = DVec3::new(9.0, (29.0 - y - 2.0) / 2.0, 12.0);
                let outside_cavity = ((point - middle).abs() - half).max_element();
                (point.y - y).min(outside_cavity)
            })
        };
        let (before, one, other) = (face(25.0), hollow(12.0), hollow(15.0));
        let open = |skin: &SeenSkin| {
            skin.surface
                .iter()
                .filter(|(place, ..)| skin.seen[*place])
                .count()
        };
        assert!(open(&seen(&one, &before)) < one.0.len() * 2 / 3);
        let found = difference(&one, &other, &before);
        assert!((found.mean_mm - 3.0).abs() < 0.1, "{found:?}");
    }

    /// As [`SeenSkin::distances`] of all voxels, each looked at for itself by a plain search.
    fn plain_distances(
        from: &SeenSkin,
        to: &SemiBoundary,
        region: Region,
    ) -> Vec<(usize, f64, f64)> {
        let distance = SurfaceDistance::new(to, REACH_MM);
        let mut found = Vec::new();
        let (mut last, mut last_row) = (None::<Nearest>, [0; 2]);
        for (place, voxel, y, z) in from.surface.iter() {
            if last_row != [y, z] {
                (last, last_row) = (None, [y, z]);
            }
            if !from.seen[place] || !region.contains([voxel.x(), y, z]) {
                continue;
            }
            let twin = to.row(y, z).iter().find(|twin| twin.x() == voxel.x());
            let point = from.surface.surface_point(voxel, y, z).0;
            let normal = voxel.normal().as_dvec3();
            let faces = |normal_there: DVec3| normal_there.dot(normal) > 0.0;
            let is_near = twin.is_some_and(|&twin| {
                let there = to.surface_point(twin, y, z).0;
                let looks_alike = !twin.code().is_cut() && faces(twin.normal().as_dvec3());
                looks_alike && there.distance(point) <= MOVED_MM
            });
            let mm = if twin == Some(&voxel) {
                0.0
            } else if is_near && !from.moved[place] {
                continue;
            } else {
                let guess = last.filter(|last| faces(last.normal));
                let guess = guess.map(|last| Nearest::of(last.point, last.normal, point));
                last = distance.nearest(point, Some(normal), guess);
                match &last {
                    Some(nearest) => distance.sign(point, nearest).abs(),
                    None => continue,
                }
            };
            if from.moved[place] || mm > MOVED_MM {
                found.push((place, mm, area(voxel, from.surface.grid().spacing())));
            }
        }
        found
    }

    #[test]
    fn distances_are_those_of_a_plain_search() {
        let bumpy = |height: f64, at: f64| {
            skin(move |point| {
                let aside = DVec3::new(point.x - at, 0.0, point.z - 16.0).length();
                let hole = (point - DVec3::new(12.0, 24.0, 12.0)).length() - 4.0;
                let bump = height * (1.0 - aside / 9.0).max(0.0);
                (point.y - 18.0 + bump).min(hole)
            })
        };
        let before = bumpy(0.0, 0.0);
        let [one, other] = [bumpy(2.0, 11.0), bumpy(5.5, 13.0)].map(|skin| seen(&skin, &before));
        let region = Region {
            first: [4, 3, 2],
            last: [42, 30, 27],
        };
        for region in [one.region, region] {
            for (from, to) in [(&one, &other), (&other, &one)] {
                let to = ComparedSkin::new(to);
                let from = ComparedSkin::new(from);
                let found = from
                    .skin
                    .distances(&from.rows, &from.normals, to.searched(), region);
                let expected = plain_distances(from.skin, &to.skin.surface, region);
                assert!(found.len() > 300, "{}", found.len());
                assert_eq!(found, expected);
            }
        }
        let unmoved = SeenSkin {
            moved: vec![false; one.surface.len()],
            ..one.clone()
        };
        let moved = plain_distances(&unmoved, &before.0, one.region);
        let moved: Vec<usize> = moved.iter().map(|(place, ..)| *place).collect();
        let marked = (0..one.moved.len()).filter(|place| one.moved[*place]);
        assert_eq!(marked.collect::<Vec<_>>(), moved);
    }
}
