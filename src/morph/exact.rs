//! Every voxel of a tile mapped exactly.

use super::chain::Chain;
use super::tile::Tile;
use super::{LANES, Points};
use crate::simd::Real;

/// Fills `tile` with the source positions of its voxels, computed in a precision.
#[inline(always)]
pub(super) fn fill<F: Real>(chain: &Chain, tile: &mut Tile) {
    let voxels = tile.voxels();
    let [_, ny, nz] = voxels.dims();
    for z in 0..nz {
        for y in 0..ny {
            // A row has one position for each lane; those past the tile's end are never read.
            let [x0, y0, z0] = voxels.start;
            let mut points = Points::<F>::row([x0, y0 + y, z0 + z]);
            chain.to_source(&mut points);
            let row = Tile::row(y, z);
            debug_assert_eq!(row.len(), LANES);
            tile.put(row, &points.x, &points.y, &points.z);
        }
    }
}
