//! Source positions for tiles of voxels, by whichever method.

use glam::DVec3;

use super::chain::{Chain, Lattice, VoxelBox};
use super::halfscale::CoarseDisplacement;
use super::tile::Tile;
use super::{exact, octree};
use crate::simd::{Kernel, Simd};

/// How densely a chain is evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Evaluation {
    /// At every voxel.
    Exact,
    /// On an octree.
    Adaptive {
        /// Largest distance from the exact source position.
        tolerance: f64,
        /// What the axes of a lattice displacement are multiplied by before its length is taken: the
        /// lattice's spacing for a tolerance in mm.
        metric: DVec3,
    },
}

/// Where every voxel of a lattice comes from.
#[derive(Debug)]
pub struct Field<'a> {
    lattice: Lattice,
    chain: &'a Chain,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    Evaluated(Evaluation),
    Upsampled(CoarseDisplacement),
}

/// Memory for one worker that fills tiles.
#[derive(Debug)]
pub struct Scratch {
    octree: octree::Scratch,
    upsample: super::halfscale::Scratch,
}

impl Scratch {
    /// Room for one tile.
    pub fn new() -> Self {
        Self {
            octree: octree::Scratch::new(),
            upsample: super::halfscale::Scratch::new(),
        }
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

impl<'a> Field<'a> {
    /// The chain evaluated on its own lattice.
    pub fn evaluated(lattice: Lattice, chain: &'a Chain, evaluation: Evaluation) -> Self {
        Self {
            lattice,
            chain,
            kind: Kind::Evaluated(evaluation),
        }
    }

    /// A displacement of half the size brought to the full lattice. `chain` is the same map on the full
    /// lattice, which tells where nothing may move.
    pub fn upsampled(lattice: Lattice, chain: &'a Chain, coarse: CoarseDisplacement) -> Self {
        Self {
            lattice,
            chain,
            kind: Kind::Upsampled(coarse),
        }
    }

    /// The lattice that it is for.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The voxels outside which nothing moves.
    pub fn support(&self) -> VoxelBox {
        self.chain.support(&self.lattice)
    }

    /// Puts the source positions of `voxels` (at most a tile) into `tile`. A voxel that the chain does not
    /// move gets its own index, to the bit.
    pub fn fill(&self, voxels: VoxelBox, scratch: &mut Scratch, tile: &mut Tile) {
        tile.begin(voxels);
        Simd::widest().run(FillTile {
            field: self,
            scratch,
            tile,
        });
    }
}

/// The source positions of one tile.
struct FillTile<'a, 'f> {
    field: &'a Field<'f>,
    scratch: &'a mut Scratch,
    tile: &'a mut Tile,
}

impl Kernel for FillTile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            field,
            scratch,
            tile,
        } = self;
        match &field.kind {
            Kind::Evaluated(Evaluation::Exact) => {
                exact::fill(field.chain, tile);
                return;
            }
            // At the rim of what moves, what does not is told apart voxel by voxel anyway.
            Kind::Evaluated(Evaluation::Adaptive { .. })
                if !field.chain.moves_all(&tile.voxels()) =>
            {
                exact::fill(field.chain, tile);
                return;
            }
            Kind::Evaluated(Evaluation::Adaptive { tolerance, metric }) => {
                octree::fill(field.chain, *tolerance, *metric, &mut scratch.octree, tile);
            }
            Kind::Upsampled(coarse) => coarse.fill(&mut scratch.upsample, tile),
        }
        if !field.chain.moves_all(&tile.voxels()) {
            for offset in tile.offsets() {
                let index = tile.index(offset);
                if !field.chain.moves(index) {
                    tile.set(offset, index);
                }
            }
        }
    }
}
