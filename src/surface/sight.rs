//! Which voxels of a skin can be seen from outside.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::boundary::{BoundaryVoxel, SemiBoundary};
use super::build::Region;
use crate::volume::Mask;

/// From where skin is looked at, towards the viewer in the grid's axes: the six views of clinical photography
/// (from the front, from either side, from between them, and from 60° below).
const VIEWS: [DVec3; 6] = [
    DVec3::NEG_Y,
    DVec3::X,
    DVec3::NEG_X,
    DVec3::new(H, -H, 0.0),
    DVec3::new(-H, -H, 0.0),
    DVec3::new(0.0, -0.5, -0.866_025_403_784_438_6),
];
const H: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Of each boundary voxel of the object `mask` whether it is in `region` and seen by one of [`VIEWS`]. `normals` are
/// those of the voxels.
pub(super) fn seen(
    surface: &SemiBoundary,
    normals: &[Vec3],
    mask: &Mask,
    region: Region,
) -> Vec<bool> {
    let front = Front::new(mask, region);
    let [_, ny, nz] = surface.grid().dims();
    let planes = (0..nz).into_par_iter().map(|z| {
        let mut seen = Vec::new();
        for y in 0..ny {
            let voxels = surface.row_range(y, z).zip(surface.row(y, z));
            seen.extend(voxels.map(|(place, &voxel)| {
                let normal = normals.get(place).map(|normal| normal.as_dvec3());
                region.contains([voxel.x(), y, z])
                    && !voxel.code().is_cut()
                    && normal
                        .is_some_and(|normal| is_seen(surface, voxel, normal, [y, z], mask, &front))
            }));
        }
        seen
    });
    planes.collect::<Vec<_>>().concat()
}

/// Where the object begins, seen from the front: beyond that a ray meets nothing. For every x of the planes up to some z,
/// looked at up to some y, the rows of x one plane after the other.
struct Front {
    nx: usize,
    /// The first y of the object at an x and z.
    first: Vec<u16>,
    /// The least of these at this x or one of those after it; before it; at this z or one of those below it.
    after: Vec<u16>,
    before: Vec<u16>,
    below: Vec<u16>,
}

impl Front {
    /// Up to what lies a little further in than `region`; so far most rays begin.
    fn new(mask: &Mask, region: Region) -> Self {
        const BEYOND: usize = 4;
        let [nx, ny, nz] = mask.dims();
        let ny = ny.min(region.last[1].saturating_add(BEYOND));
        let nz = nz.min(region.last[2].saturating_add(BEYOND));
        // A grid has at most 32767 voxels along an axis.
        let none = u16::try_from(ny).unwrap_or(u16::MAX);
        let mut first = vec![none; nx * nz];
        first.par_chunks_mut(nx).enumerate().for_each(|(z, first)| {
            let mut met = vec![0_u64; mask.words_per_row()];
            for y in 0..none {
                for (place, (word, met)) in mask.row(y.into(), z).iter().zip(&mut met).enumerate() {
                    let mut new = word & !*met;
                    *met |= word;
                    while new != 0 {
                        if let Some(first) =
                            first.get_mut(place * 64 + new.trailing_zeros() as usize)
                        {
                            *first = y;
                        }
                        new &= new - 1;
                    }
                }
            }
        });
        let [mut after, mut before, mut below] = [first.clone(), first.clone(), first.clone()];
        for row in before.chunks_mut(nx) {
            lower(row.iter_mut());
        }
        for row in after.chunks_mut(nx) {
            lower(row.iter_mut().rev());
        }
        for place in nx..below.len() {
            below[place] = below[place].min(below[place - nx]);
        }
        Self {
            nx,
            first,
            after,
            before,
            below,
        }
    }

    /// Whether it is known that a ray towards `view`, which is not along x, meets nothing of the object at this voxel
    /// nor further on.
    #[inline]
    fn is_clear(&self, view: DVec3, [x, y, z]: [usize; 3]) -> bool {
        // A ray goes to lower y; beside that it keeps its x and z, or one of them changes in one direction.
        let least = if view.z < 0.0 {
            &self.below
        } else if view.x > 0.0 {
            &self.after
        } else if view.x < 0.0 {
            &self.before
        } else {
            &self.first
        };
        let least = least.get(z * self.nx + x).copied();
        least.is_some_and(|least| y < usize::from(least))
    }
}

/// Makes each no more than those before it.
fn lower<'a>(row: impl Iterator<Item = &'a mut u16>) {
    let mut least = u16::MAX;
    for at in row {
        least = least.min(*at);
        *at = least;
    }
}

/// Whether one of [`VIEWS`] sees the voxel past everything else of the object.
fn is_seen(
    surface: &SemiBoundary,
    voxel: BoundaryVoxel,
    normal: DVec3,
    [y, z]: [usize; 2],
    mask: &Mask,
    front: &Front,
) -> bool {
    let spacing = surface.grid().spacing();
    let [nx, ny, nz] = surface.grid().dims();
    // Clear of the surface itself, whose voxels stand out by up to one.
    let from = surface.point_of([voxel.x(), y, z], voxel.offset, normal).0
        + normal * (1.5 * spacing.max_element());
    // Voxels and half a voxel, so that the whole part is the nearest.
    let from = from / spacing + 0.5;
    VIEWS.iter().any(|&view| {
        let mut at = from;
        let step = view * spacing.min_element() / spacing;
        normal.dot(view) > 0.0
            && loop {
                // Straight along a row no voxel is passed over: the row is looked at as a whole.
                let along_row = view.y == 0.0 && view.z == 0.0;
                if !(at.x >= 0.0 && at.y >= 0.0 && at.z >= 0.0) {
                    break true;
                }
                // Truncated.
                let (x, y, z) = (at.x as usize, at.y as usize, at.z as usize);
                if x >= nx || y >= ny || z >= nz {
                    break true;
                }
                if along_row {
                    break is_clear(mask.row(y, z), x, view.x > 0.0);
                }
                if front.is_clear(view, [x, y, z]) {
                    break true;
                }
                if mask.contains(x, y, z) {
                    break false;
                }
                at += step;
            }
    })
}

/// Whether a row of a mask has no voxel from `x` on, forward or back.
fn is_clear(row: &[u64], x: usize, forward: bool) -> bool {
    let (place, bit) = (x / 64, x % 64);
    let here = row.get(place).copied().unwrap_or_default();
    let (here, beyond) = match forward {
        true => (here >> bit, row.get(place + 1..)),
        false => (here << (63 - bit), row.get(..place)),
    };
    here == 0 && beyond.unwrap_or_default().iter().all(|&word| word == 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::difference::tests::skin;
    use crate::surface::points::normals;

    #[test]
    fn a_row_is_clear_where_no_voxel_follows() {
        for inside in [0, 5, 63, 64, 100, 129] {
            let mask = Mask::from_fn([130, 1, 1], |x, _, _| x == inside).unwrap();
            for x in 0..130 {
                assert_eq!(is_clear(mask.row(0, 0), x, true), x > inside, "{x}");
                assert_eq!(is_clear(mask.row(0, 0), x, false), x < inside, "{x}");
            }
        }
    }

    #[test]
    fn the_front_changes_nothing_but_the_time() {
        let hollow = skin(|at| {
            let outer = 11.0 - (at - DVec3::new(12.0, 18.0, 16.0)).length();
            let hole = (at - DVec3::new(14.0, 12.0, 10.0)).abs() - DVec3::new(3.0, 9.0, 8.0);
            outer.min(hole.max_element())
        });
        // Pieces all over the grid, so that rays pass by some of them.
        let pieces = skin(|at| {
            let wave = |x: f64| libm::sin(1.1 * x);
            wave(at.x) + wave(at.y + 1.0) * wave(at.z) + 0.3 * wave(0.37 * at.y) - 0.9
        });
        for (surface, mask) in [hollow, pieces] {
            let normals = normals(&surface);
            let region = Region {
                first: [3, 2, 4],
                last: [40, 30, 22],
            };
            let found = seen(&surface, &normals, &mask, region);
            let blind = Front {
                nx: mask.dims()[0],
                first: Vec::new(),
                after: Vec::new(),
                before: Vec::new(),
                below: Vec::new(),
            };
            let front = Front::new(&mask, region);
            let (mut clear, mut hidden) = (0, 0);
            for ((place, voxel, y, z), found) in surface.iter().zip(found) {
                let is_in = region.contains([voxel.x(), y, z]) && !voxel.code().is_cut();
                let normal = normals[place].as_dvec3();
                let plain = is_in && is_seen(&surface, voxel, normal, [y, z], &mask, &blind);
                assert_eq!(found, plain, "{} {y} {z}", voxel.x());
                let ahead = [voxel.x(), y.saturating_sub(1), z];
                clear += usize::from(front.is_clear(DVec3::NEG_Y, ahead));
                hidden += usize::from(is_in && !plain);
            }
            assert!(clear > 50 && hidden > 10, "{clear}, {hidden}");
        }
    }
}
