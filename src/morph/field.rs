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

/// The least tolerance, as a share of the lattice's longest side, beside which single precision does not count: a position
/// of it is off by less than a twentieth of this (half a unit in its last place is 2⁻²⁴, and its displacement a few).
const SINGLE_DOES: f64 = 4e-5;

/// The share of [`SINGLE_DOES`] that interpolated positions can be off by because of single precision: a twentieth each where
/// they are interpolated and in the corners that they are interpolated from, and two where those were checked.
const SINGLE_TAKES: f64 = 0.2;

impl Evaluation {
    /// Whether single precision is enough on a lattice.
    fn is_rough(&self, on: &Lattice) -> bool {
        match self {
            Self::Exact => false,
            Self::Adaptive { tolerance, metric } => *tolerance >= single_does(on, *metric),
        }
    }
}

/// The least tolerance on a lattice beside which single precision does not count.
fn single_does(on: &Lattice, metric: DVec3) -> f64 {
    let longest = on.dims().into_iter().max().unwrap_or_default() as f64;
    SINGLE_DOES * longest * metric.max_element()
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

    /// Whether positions may be in single precision: where the tolerance is far above what that is off by.
    pub(super) fn is_rough(&self) -> bool {
        match &self.kind {
            Kind::Evaluated(evaluation) => evaluation.is_rough(&self.lattice),
            Kind::Upsampled(_) => false,
        }
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
        let moves_all = field.chain.moves_all(&tile.voxels());
        let rough = field.is_rough();
        match &field.kind {
            Kind::Evaluated(Evaluation::Exact) => return exact::fill::<f64>(field.chain, tile),
            // At the rim of what moves, what does not is told apart voxel by voxel anyway.
            Kind::Evaluated(Evaluation::Adaptive { .. }) if !moves_all => {
                return match rough {
                    true => exact::fill::<f32>(field.chain, tile),
                    false => exact::fill::<f64>(field.chain, tile),
                };
            }
            Kind::Evaluated(Evaluation::Adaptive { tolerance, metric }) => {
                let (chain, scratch) = (field.chain, &mut scratch.octree);
                // Called where they are, so that they are inlined.
                match rough {
                    true => {
                        let takes = SINGLE_TAKES * single_does(&field.lattice, *metric);
                        octree::fill::<f32>(chain, *tolerance - takes, *metric, scratch, tile);
                    }
                    false => octree::fill::<f64>(chain, *tolerance, *metric, scratch, tile),
                }
            }
            Kind::Upsampled(coarse) => coarse.fill(&mut scratch.upsample, tile),
        }
        if !moves_all {
            for offset in tile.offsets() {
                let index = tile.index(offset);
                if !field.chain.moves(index) {
                    tile.set(offset, index);
                }
            }
        }
    }
}
