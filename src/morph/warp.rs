//! A volume sampled through a field.

use rayon::prelude::*;

use super::field::{Field, Scratch};
use super::tile::{Tile, split_into_tiles};
use crate::volume::{Sample, Trilinear, Volume};

/// The volume whose every voxel takes the value that `source` has at the position that `field` gives it.
///
/// Trilinear; outside `source`, the nearest edge voxel; integers rounded half away from zero
/// (method section 3). A voxel that is not moved keeps its sample bit for bit. The field's lattice
/// must be the volume's.
pub fn warp<T: Sample>(source: &Volume<T>, field: &Field<'_>) -> Volume<T> {
    debug_assert_eq!(source.grid().dims(), field.lattice().dims());
    let mut warped = source.clone();
    let sampler = Trilinear::new(source);
    split_into_tiles(warped.samples_mut(), field.support())
        .into_par_iter()
        .for_each_init(
            || (Scratch::new(), Tile::new()),
            |(scratch, tile), (voxels, mut to)| {
                field.fill(voxels, scratch, tile);
                let [x0, y0, z0] = voxels.start;
                for (z, mut plane) in to.outer_iter_mut().enumerate() {
                    for (y, mut to) in plane.outer_iter_mut().enumerate() {
                        let Some((px, py, pz)) = tile.lanes(y, z) else {
                            continue;
                        };
                        let still = [(y0 + y) as f64, (z0 + z) as f64];
                        let values = sampler.row(px, py, pz);
                        for (lane, to) in to.iter_mut().enumerate() {
                            let unmoved =
                                px[lane] == (x0 + lane) as f64 && [py[lane], pz[lane]] == still;
                            if !unmoved {
                                *to = T::from_interpolated(values[lane]);
                            }
                        }
                    }
                }
            },
        );
    warped
}
