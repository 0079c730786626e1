//! Model `local` at half scale: the displacement is evaluated on half the voxels along each axis and
//! brought to full size with a Gaussian; it then samples the full-size CT (method sections 3 and 5).

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
    /// Of every voxel of the full lattice, along each axis.
    taps: [Vec<Taps>; 3],
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
        // An odd last plane of the full lattice has no half of its own.
        let taps = half
            .dims()
            .map(|n| (0..=2 * n).map(|fine| Taps::new(fine, n)).collect());
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
            return Ok(Self { taps, kept, values });
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
        Ok(Self { taps, kept, values })
    }

    /// A coarse row of one component, from `first` on; 0 where nothing moves.
    #[inline(always)]
    fn row(&self, component: usize, first: [usize; 3], to: &mut [f64]) {
        let VoxelBox { start, end } = self.kept;
        let [first_x, y, z] = first;
        to.fill(0.0);
        if y < start[1] || y >= end[1] || z < start[2] || z >= end[2] {
            return;
        }
        let [nx, ny, _] = self.kept.dims();
        let row = ((z - start[2]) * ny + (y - start[1])) * nx;
        let from = first_x.max(start[0]);
        let until = (first_x + to.len()).min(end[0]);
        if from >= until {
            return;
        }
        let values = &self.values[row + from - start[0]..row + until - start[0]];
        let to = &mut to[from - first_x..until - first_x];
        for (to, value) in to.iter_mut().zip(values) {
            *to = f64::from(value[component]);
        }
    }

    /// Fills `tile` with source positions on the full lattice.
    #[inline(always)]
    pub(super) fn fill(&self, scratch: &mut Scratch, tile: &mut Tile) {
        let voxels = tile.voxels();
        let dims = voxels.dims();
        // Coarse box that the tile draws on.
        let mut first = [0; 3];
        let mut span = [0; 3];
        for axis in 0..3 {
            first[axis] = (voxels.start[axis] / 2).saturating_sub(REACH);
            let last = self.taps[axis][voxels.end[axis].max(1) - 1];
            span[axis] = (last.first + last.count)
                .saturating_sub(first[axis])
                .min(SPAN);
        }
        let [along_x, along_y, along_z] = [0, 1, 2].map(|axis| {
            let taps = &self.taps[axis];
            &taps[voxels.start[axis]..voxels.start[axis] + dims[axis]]
        });
        // Along x, then y, then z; what is left has one more axis at full size after each.
        let Scratch {
            blended_x,
            blended_xy,
        } = scratch;
        let mut coarse = [0.0; SPAN];
        for component in 0..3 {
            for cz in 0..span[2] {
                for (cy, to) in blended_x.iter_mut().enumerate().take(span[1]) {
                    let at = [first[0], first[1] + cy, first[2] + cz];
                    self.row(component, at, &mut coarse[..span[0]]);
                    for (to, taps) in to.iter_mut().zip(along_x) {
                        let from = &coarse[taps.first - first[0]..];
                        let mut sum = 0.0;
                        for (value, weight) in from.iter().zip(&taps.weights[..taps.count]) {
                            sum += value * weight;
                        }
                        *to = sum;
                    }
                }
                for (y, taps) in along_y.iter().enumerate() {
                    let from = &blended_x[taps.first - first[1]..];
                    blended_xy[cz * TILE + y] = taps.blend_rows(from);
                }
            }
            let positions = match component {
                0 => &mut tile.x,
                1 => &mut tile.y,
                _ => &mut tile.z,
            };
            for (z, taps) in along_z.iter().enumerate() {
                for y in 0..dims[1] {
                    let mut moved = [0.0; TILE];
                    for (tap, weight) in taps.weights[..taps.count].iter().enumerate() {
                        let from = &blended_xy[(taps.first + tap - first[2]) * TILE + y];
                        for lane in 0..TILE {
                            moved[lane] += from[lane] * weight;
                        }
                    }
                    let home = [voxels.start[0], voxels.start[1] + y, voxels.start[2] + z];
                    let to = &mut positions[Tile::row(y, z)];
                    for (lane, to) in to.iter_mut().enumerate() {
                        let step = if component == 0 { lane } else { 0 };
                        *to = (home[component] + step) as f64 + moved[lane];
                    }
                }
            }
        }
    }
}

/// Memory for one worker: one component of a tile's displacement on the way up, one axis at a time.
#[derive(Debug)]
pub(super) struct Scratch {
    blended_x: Vec<[f64; TILE]>,
    blended_xy: Vec<[f64; TILE]>,
}

impl Scratch {
    pub(super) fn new() -> Self {
        Self {
            blended_x: vec![[0.0; TILE]; SPAN],
            blended_xy: vec![[0.0; TILE]; SPAN * TILE],
        }
    }
}
