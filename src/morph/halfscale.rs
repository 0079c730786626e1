//! Model `local` at half scale: the displacement is evaluated on half the voxels along each axis and
//! brought to full size with a Gaussian; it then samples the full-size CT (method sections 3 and 5).

use glam::DVec3;
use rayon::prelude::*;

use super::chain::{Chain, Lattice, VoxelBox};
use super::field::{Evaluation, Field, Scratch as FieldScratch};
use super::tile::{TILE, Tile, tiles_of};
use crate::resample::gaussian::{REACH, Taps};
use crate::volume::VolumeError;

/// Coarse positions along one axis that a tile of fine voxels can draw on.
const SPAN: usize = TILE / 2 + 2 * REACH;

/// A displacement in voxels of the full lattice, on the half lattice. Kept only where it is not zero.
#[derive(Debug)]
pub struct CoarseDisplacement {
    dims: [usize; 3],
    kept: VoxelBox,
    /// x fastest, over `kept`. Single precision: 1e-6 of a voxel for the largest displacement.
    values: Vec<[f32; 3]>,
}

impl CoarseDisplacement {
    /// Evaluates `chain`, which must have been made for the half lattice.
    ///
    /// # Errors
    /// [`VolumeError::Memory`] where the machine has no memory for it.
    pub fn new(half: Lattice, chain: &Chain, evaluation: Evaluation) -> Result<Self, VolumeError> {
        let field = Field::evaluated(half, chain, evaluation);
        let mut kept = field.support();
        // From the start of a tile on, so that every slab below is one layer of whole tiles.
        kept.start = kept.start.map(|start| start / TILE * TILE);
        let [nx, ny, nz] = kept.dims();
        let len = nx * ny * nz;
        let mut values: Vec<[f32; 3]> = Vec::new();
        values
            .try_reserve_exact(len)
            .map_err(|_| VolumeError::Memory {
                voxels: len,
                bytes_per_voxel: size_of::<[f32; 3]>(),
            })?;
        values.resize(len, [0.0; 3]);
        if kept.is_empty() {
            return Ok(Self {
                dims: half.dims(),
                kept,
                values,
            });
        }
        values
            .par_chunks_mut(nx * ny * TILE)
            .enumerate()
            .for_each_init(
                || (FieldScratch::new(), Tile::new()),
                |(scratch, tile), (slab, to)| {
                    let z0 = kept.start[2] + slab * TILE;
                    let layer = VoxelBox {
                        start: [kept.start[0], kept.start[1], z0],
                        end: [kept.end[0], kept.end[1], (z0 + TILE).min(kept.end[2])],
                    };
                    for part in tiles_of(layer) {
                        field.fill(part, scratch, tile);
                        for offset in tile.offsets() {
                            let [x, y, z] = [0, 1, 2]
                                .map(|axis| part.start[axis] - layer.start[axis] + offset[axis]);
                            // A coarse voxel is two fine ones.
                            let moved = (tile.get(offset) - tile.index(offset)) * 2.0;
                            to[(z * ny + y) * nx + x] = moved.as_vec3().to_array();
                        }
                    }
                },
            );
        Ok(Self {
            dims: half.dims(),
            kept,
            values,
        })
    }

    #[inline]
    fn at(&self, [x, y, z]: [usize; 3]) -> [f64; 3] {
        let VoxelBox { start, end } = self.kept;
        let inside = |at: usize, axis: usize| at >= start[axis] && at < end[axis];
        if !(inside(x, 0) && inside(y, 1) && inside(z, 2)) {
            return [0.0; 3];
        }
        let [nx, ny, _] = self.kept.dims();
        let place = ((z - start[2]) * ny + (y - start[1])) * nx + (x - start[0]);
        self.values[place].map(f64::from)
    }

    /// Fills `tile` with source positions on the full lattice.
    pub(super) fn fill(&self, scratch: &mut Scratch, tile: &mut Tile) {
        let voxels = tile.voxels();
        let dims = voxels.dims();
        // Coarse box that the tile draws on.
        let first = [0, 1, 2].map(|axis| (voxels.start[axis] / 2).saturating_sub(REACH));
        let taps =
            |axis: usize, offset: usize| Taps::new(voxels.start[axis] + offset, self.dims[axis]);
        let last = [0, 1, 2].map(|axis| {
            let taps = taps(axis, dims[axis].saturating_sub(1));
            taps.first + taps.count
        });
        let span = [0, 1, 2].map(|axis| last[axis].saturating_sub(first[axis]).min(SPAN));

        // Along x, then y, then z; what is left has one more axis at full size after each.
        let Scratch { along_x, along_xy } = scratch;
        for cz in 0..span[2] {
            for cy in 0..span[1] {
                for x in 0..dims[0] {
                    let taps = taps(0, x);
                    let at = |c: usize| self.at([c, first[1] + cy, first[2] + cz]);
                    along_x[(cz * SPAN + cy) * TILE + x] = taps.blend(at);
                }
            }
            for y in 0..dims[1] {
                let taps = taps(1, y);
                for x in 0..dims[0] {
                    let at = |c: usize| along_x[(cz * SPAN + (c - first[1])) * TILE + x];
                    along_xy[(cz * TILE + y) * TILE + x] = taps.blend(at);
                }
            }
        }
        for z in 0..dims[2] {
            let taps = taps(2, z);
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let at = |c: usize| along_xy[((c - first[2]) * TILE + y) * TILE + x];
                    let moved = DVec3::from_array(taps.blend(at));
                    let index = tile.index([x, y, z]);
                    tile.set([x, y, z], index + moved);
                }
            }
        }
    }
}

/// Memory for one worker: a tile's displacement on the way up, one axis at a time.
#[derive(Debug)]
pub(super) struct Scratch {
    along_x: Vec<[f64; 3]>,
    along_xy: Vec<[f64; 3]>,
}

impl Scratch {
    pub(super) fn new() -> Self {
        Self {
            along_x: vec![[0.0; 3]; SPAN * SPAN * TILE],
            along_xy: vec![[0.0; 3]; SPAN * TILE * TILE],
        }
    }
}
