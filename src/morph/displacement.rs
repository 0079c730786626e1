//! A field as displacements in the patient's frame.

use ndarray::ArrayViewMut3;
use rayon::prelude::*;

use super::chain::VoxelBox;
use super::field::{Field, Scratch};
use super::tile::{TILE, Tile, split_into_tiles};
use crate::space::{Grid, GridVector};

/// Fills `to`, indexed `[z, y, x]`, with one component (0 x, 1 y, 2 z) of the displacement of the voxels
/// from `start` on: from a voxel of the warped volume to where its tissue comes from, LPS mm. `start` must be
/// a multiple of [`TILE`] along every axis; the field's lattice must be the grid's.
pub fn fill_component(
    field: &Field<'_>,
    grid: &Grid,
    component: usize,
    start: [usize; 3],
    mut to: ArrayViewMut3<'_, f32>,
) {
    debug_assert!(start.iter().all(|start| start % TILE == 0));
    to.fill(0.0);
    let (nz, ny, nx) = to.dim();
    let whole = VoxelBox {
        start: [0; 3],
        end: [nx, ny, nz],
    };
    let support = field.support();
    split_into_tiles(to, whole).into_par_iter().for_each_init(
        || (Scratch::new(), Tile::new()),
        |(scratch, tile), (voxels, mut to)| {
            let voxels = voxels.shifted(start);
            if !voxels.intersects(&support) {
                return;
            }
            field.fill(voxels, scratch, tile);
            for ((z, y, x), to) in to.indexed_iter_mut() {
                let offset = [x, y, z];
                let moved = (tile.get(offset) - tile.index(offset)) * grid.spacing();
                let moved = grid.grid_vector_to_lps(GridVector(moved));
                *to = moved.0[component] as f32;
            }
        },
    );
}
