//! The head as a volume.

use glam::DVec3;
use rayon::prelude::*;

use super::chain::Steps;
use super::noise::SliceNoise;
use super::primitives::Dual;
use super::shape::{BONE, COVER_ROUNDING, TISSUE, brain, cover, covered};
use super::{AIR_HU, BONE_HU, BRAIN_HU, EDGE_SIGMA_MM, Phantom, TISSUE_HU, depth};
use crate::space::{ContinuousIndex, Grid};
use crate::volume::{Rescale, Volume, VolumeError};

/// Slices that one task renders.
const SLICES: usize = 4;
/// Voxels along x and y of the tiles that are decided as a whole where no surface is near.
const TILE: usize = 16;
/// Voxels along x, y and z of the smaller tiles that the others are cut into.
const SMALL_TILE: [usize; 3] = [4, 4, 2];
/// Beyond so many sigmas an edge is taken as 0 or 1: there it is within 3.4e-6 of that, 0.003 HU.
const EDGE_REACH: f64 = 4.5;
/// No field changes faster than this from point to point near its surface, mm per mm (a test samples the
/// gradients, another compares with the plain rendering).
pub(super) const STEEPEST: f64 = 2.0;
/// A field beyond this is beyond [`EDGE_REACH`], mm.
const FIELD_REACH: f64 = STEEPEST * EDGE_REACH * EDGE_SIGMA_MM;
/// The least value that a scanner stores.
const LEAST_HU: f64 = -1024.0;

impl Phantom {
    /// The head on `grid`, whose index × spacing is taken as the shape's millimetres: samples are HU.
    /// Voxels outside the default grid's extent show the analytic shape as well (the neck goes on below).
    ///
    /// # Errors
    /// [`VolumeError::Memory`] where the machine has none.
    pub fn render(&self, grid: &Grid) -> Result<Volume<i16>, VolumeError> {
        self.render_with(grid, true)
    }

    /// As [`Phantom::render`]; `tiles` decides whole tiles at once where it can.
    fn render_with(&self, grid: &Grid, tiles: bool) -> Result<Volume<i16>, VolumeError> {
        let mut volume = Volume::<i16>::zeros(grid.clone(), Rescale::NONE)?;
        let plane = volume.plane_len();
        volume
            .as_mut_slice()
            .par_chunks_mut(plane * SLICES)
            .enumerate()
            .for_each_init(Vec::new, |values, (place, out)| {
                let first = place * SLICES;
                values.clear();
                values.resize(out.len(), 0.0);
                render_slices(grid, first, values, tiles);
                for (offset, (values, out)) in
                    values.chunks(plane).zip(out.chunks_mut(plane)).enumerate()
                {
                    store(
                        values,
                        out,
                        self.noise.then(|| SliceNoise::new(first + offset)),
                    );
                }
            });
        Ok(volume)
    }
}

/// One slice's HU as samples, with its noise.
fn store(values: &[f32], out: &mut [i16], noise: Option<SliceNoise>) {
    let sample = |hu: f64| hu.round().max(LEAST_HU) as i16;
    match noise {
        None => {
            for (out, &hu) in out.iter_mut().zip(values) {
                *out = sample(f64::from(hu));
            }
        }
        Some(mut noise) => {
            for (out, &hu) in out.iter_mut().zip(values) {
                *out = sample(f64::from(hu) + noise.next_hu());
            }
        }
    }
}

/// Voxels [low, high) of an axis-aligned block.
#[derive(Clone, Copy)]
struct Block {
    low: [usize; 3],
    high: [usize; 3],
}

impl Block {
    /// The blocks of at most `size` voxels that this one is cut into.
    fn cut(self, size: [usize; 3]) -> impl Iterator<Item = Self> {
        let starts = move |axis: usize| (self.low[axis]..self.high[axis]).step_by(size[axis]);
        starts(2).flat_map(move |z| {
            starts(1).flat_map(move |y| {
                starts(0).map(move |x| {
                    let low = [x, y, z];
                    let end = |axis: usize| (low[axis] + size[axis]).min(self.high[axis]);
                    Self {
                        low,
                        high: [end(0), end(1), end(2)],
                    }
                })
            })
        })
    }

    /// The ball around the voxel centres: its centre and its radius, grid millimetres.
    fn ball(self, grid: &Grid) -> (DVec3, f64) {
        let low = position(grid, self.low);
        let high = position(grid, self.high.map(|end| end - 1));
        ((low + high) * 0.5, (high - low).length() * 0.5)
    }
}

/// A voxel's centre, grid millimetres.
fn position(grid: &Grid, index: [usize; 3]) -> DVec3 {
    let [x, y, z] = index.map(|at| at as f64);
    grid.index_to_grid(ContinuousIndex::new(x, y, z)).0
}

/// HU of the slices from `first` on that `values` has room for.
fn render_slices(grid: &Grid, first: usize, values: &mut [f32], tiles: bool) {
    let [nx, ny, _] = grid.dims();
    let whole = Block {
        low: [0, 0, first],
        high: [nx, ny, first + values.len() / (nx * ny)],
    };
    let mut fill = |block: Block, content: &Content| {
        for z in block.low[2]..block.high[2] {
            for y in block.low[1]..block.high[1] {
                let row = ((z - first) * ny + y) * nx;
                let row = &mut values[row + block.low[0]..row + block.high[0]];
                match content {
                    Content::Even(hu) => row.fill(*hu as f32),
                    Content::Mixed(parts) => {
                        for (x, value) in (block.low[0]..).zip(row) {
                            *value = parts.hu(position(grid, [x, y, z])) as f32;
                        }
                    }
                }
            }
        }
    };
    if !tiles {
        fill(whole, &Content::Mixed(Parts::ALL));
        return;
    }
    for tile in whole.cut([TILE, TILE, SLICES]) {
        let content = Content::of(&tile, grid, &Needed::ALL);
        let Content::Mixed(parts) = &content else {
            fill(tile, &content);
            continue;
        };
        for small in tile.cut(SMALL_TILE) {
            fill(small, &Content::of(&small, grid, &parts.needed));
        }
    }
}

/// What a tile holds.
enum Content {
    /// The same HU in every voxel.
    Even(f64),
    /// At least one edge.
    Mixed(Parts),
}

/// What the fields of a tile depend on.
#[derive(Clone, Copy)]
struct Needed {
    tissue: Steps,
    bone: Steps,
    /// Whether the bone's cover cuts it anywhere.
    cover: bool,
}

impl Needed {
    const ALL: Self = Self {
        tissue: TISSUE.whole(),
        bone: BONE.whole(),
        cover: true,
    };
}

/// How much of a material there is in a tile.
#[derive(Clone, Copy, PartialEq)]
enum Share {
    None,
    All,
    /// Its edge comes through: to be asked at every voxel.
    Varies,
}

/// The materials of a tile.
struct Parts {
    tissue: Share,
    bone: Share,
    brain: Share,
    needed: Needed,
}

impl Content {
    /// Of a tile in which only `steps` matter.
    fn of(tile: &Block, grid: &Grid, steps: &Needed) -> Self {
        let (centre, radius) = tile.ball(grid);
        let at = centre.to_array();
        let slack = STEEPEST * radius;
        let (tissue, tissue_steps) = TISSUE.near(steps.tissue, at, slack);
        if tissue > slack + FIELD_REACH {
            return Self::Even(mix(0.0, 0.0, 0.0));
        }
        let (bone, bone_steps) = BONE.near(steps.bone, at, slack);
        let cover_is_far = bone - cover(tissue) > COVER_ROUNDING + 2.0 * slack;
        let parts = Parts {
            tissue: Share::near(tissue, slack),
            bone: Share::near(covered(bone, tissue), slack),
            brain: Share::near(brain(at), slack),
            needed: Needed {
                tissue: tissue_steps,
                bone: bone_steps,
                cover: !cover_is_far,
            },
        };
        match (parts.tissue.even(), parts.bone.even(), parts.brain.even()) {
            (Some(tissue), Some(bone), Some(brain)) => Self::Even(mix(tissue, bone, brain)),
            _ => Self::Mixed(parts),
        }
    }
}

impl Share {
    /// Where the material's field is up to `slack` from `field`.
    fn near(field: f64, slack: f64) -> Self {
        if field > slack + FIELD_REACH {
            Self::None
        } else if field < -slack - FIELD_REACH {
            Self::All
        } else {
            Self::Varies
        }
    }

    /// The share as a number, where it is the same everywhere.
    fn even(self) -> Option<f64> {
        match self {
            Self::None => Some(0.0),
            Self::All => Some(1.0),
            Self::Varies => None,
        }
    }
}

impl Parts {
    /// Everything, everywhere.
    const ALL: Self = Self {
        tissue: Share::Varies,
        bone: Share::Varies,
        brain: Share::Varies,
        needed: Needed::ALL,
    };

    /// HU at a point of the tile.
    fn hu(&self, point: DVec3) -> f64 {
        let at = point.to_array();
        let dual = Dual::coordinates(point);
        let needed = self.needed;
        let cut = self.bone == Share::Varies && needed.cover;
        // Asked for at most once; not used where neither of the two varies.
        let surface = if cut || self.tissue == Share::Varies {
            TISSUE.field(needed.tissue, at)
        } else {
            0.0
        };
        let bone_field = || BONE.field(needed.bone, at);
        let tissue_dual = || TISSUE.field(needed.tissue, dual);
        let bone_dual = || BONE.field(needed.bone, dual);

        let tissue = self.tissue.even();
        let tissue = tissue.unwrap_or_else(|| profile(surface, tissue_dual));
        let bone = match self.bone.even() {
            Some(share) => share,
            None if cut => profile(covered(bone_field(), surface), || {
                covered(bone_dual(), tissue_dual())
            }),
            None => profile(bone_field(), bone_dual),
        };
        let brain_share = self.brain.even();
        let brain = brain_share.unwrap_or_else(|| profile(brain(at), || brain(dual)));
        mix(tissue, bone, brain)
    }
}

/// How much of a material a voxel sees, from the value of its field and, near the edge, its gradient.
fn profile(field: f64, with_gradient: impl FnOnce() -> Dual) -> f64 {
    if field > FIELD_REACH {
        0.0
    } else if field < -FIELD_REACH {
        1.0
    } else {
        edge(depth(with_gradient()))
    }
}

/// HU of a mixture: bone and brain lie in tissue.
fn mix(tissue: f64, bone: f64, brain: f64) -> f64 {
    AIR_HU
        + (TISSUE_HU - AIR_HU) * tissue
        + (BONE_HU - TISSUE_HU) * bone
        + (BRAIN_HU - TISSUE_HU) * brain
}

/// The share of a half-space that a Gaussian of [`EDGE_SIGMA_MM`] sees from `depth` mm inside it.
fn edge(depth: f64) -> f64 {
    let sigmas = depth / EDGE_SIGMA_MM;
    if sigmas >= EDGE_REACH {
        1.0
    } else if sigmas <= -EDGE_REACH {
        0.0
    } else {
        0.5 * libm::erfc(-sigmas * std::f64::consts::FRAC_1_SQRT_2)
    }
}

#[cfg(test)]
mod tests {
    use sha2::{Digest, Sha256};

    use super::*;

    /// A coarse grid over the default extent.
    fn coarse() -> Grid {
        Grid::axis_aligned([71, 71, 76], [2.0, 2.0, 2.0]).unwrap()
    }

    fn sha256(volume: &Volume<i16>) -> String {
        let bytes: Vec<u8> = volume
            .as_slice()
            .iter()
            .flat_map(|sample| sample.to_le_bytes())
            .collect();
        let digest = Sha256::digest(&bytes);
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    #[test]
    fn tiles_give_what_the_plain_rendering_gives() {
        let head = Phantom::lee2001().without_noise();
        for (dims, spacing) in [
            ([142, 142, 151], [1.0, 1.0, 1.0]),
            ([47, 71, 30], [3.0, 2.0, 5.0]),
            // The default grid's voxels, every slice of the nose.
            ([320, 130, 80], [0.442, 0.442, 1.0]),
        ] {
            let grid = Grid::axis_aligned(dims, spacing).unwrap();
            let tiled = head.render_with(&grid, true).unwrap();
            let plain = head.render_with(&grid, false).unwrap();
            let differing = tiled
                .as_slice()
                .iter()
                .zip(plain.as_slice())
                .filter(|(t, p)| t != p)
                .count();
            assert_eq!(differing, 0, "of {} at {spacing:?}", grid.len());
            let (low, high) = plain.hu_range();
            assert!(low == AIR_HU && high >= BONE_HU, "not a constant volume");
        }
    }

    #[test]
    fn materials_are_constant_away_from_edges() {
        let grid = coarse();
        let head = Phantom::lee2001().without_noise();
        let volume = head.render(&grid).unwrap();
        let hu = |at: [usize; 3]| volume.samples()[[at[2], at[1], at[0]]];
        assert_eq!(hu([0, 0, 0]), -1000);
        assert_eq!(hu([70, 70, 75]), -1000);
        assert_eq!(hu([31, 42, 24]), -1000, "the windpipe");
        assert_eq!(hu([31, 44, 49]), 35, "the brain");
        assert_eq!(hu([31, 50, 10]), 900, "the spine");
        // The cheek, between skin and bone.
        assert_eq!(hu([22, 22, 33]), 0, "soft tissue");
    }

    #[test]
    fn the_skin_is_half_way_between_air_and_tissue() {
        let head = Phantom::lee2001().without_noise();
        let grid = Phantom::default_grid().unwrap();
        let volume = head.render(&grid).unwrap();
        let mut compared = 0;
        for z in (54..79).map(|z| z as usize) {
            for y in 20..84 {
                for x in 80..200 {
                    let hu = f64::from(volume.samples()[[z, y, x]]);
                    let point = position(&grid, [x, y, z]);
                    let depth = head.tissue_depth(crate::space::GridPoint(point));
                    if depth.abs() < 0.05 {
                        compared += 1;
                        // 0.05 mm is 0.1 σ: 40 HU of the edge's 1000.
                        assert!((hu + 500.0).abs() < 41.0, "{hu} at {depth} mm");
                    }
                    assert!((hu >= -500.0) == (depth >= 0.0) || depth.abs() < 2e-3);
                }
            }
        }
        assert!(compared > 200, "{compared}");
    }

    #[test]
    fn any_number_of_threads_gives_the_pinned_bytes() {
        /// Of the samples, little-endian, on [`coarse`]. It changes with the shape, and only with it.
        const PINNED: &str = "e40decc398db4c062f9c89d96c7ac65ae83b4f1d224fb285207c62e1a479f5fc";
        let grid = coarse();
        let render = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
                .install(|| Phantom::lee2001().render(&grid).unwrap())
        };
        let one = render(1);
        assert_eq!(one, render(2));
        assert_eq!(one, render(4));
        assert_eq!(sha256(&one), PINNED);
    }

    #[test]
    fn noise_is_ten_hu_on_everything_and_clamped() {
        let grid = coarse();
        let head = Phantom::lee2001();
        let noisy = head.render(&grid).unwrap();
        let clean = head.without_noise().render(&grid).unwrap();
        let pairs = || noisy.as_slice().iter().zip(clean.as_slice());
        let differences: Vec<f64> = pairs()
            .filter(|(_, c)| **c > -900)
            .map(|(n, c)| f64::from(*n) - f64::from(*c))
            .collect();
        let count = differences.len() as f64;
        let mean = differences.iter().sum::<f64>() / count;
        let spread = (differences.iter().map(|d| d * d).sum::<f64>() / count).sqrt();
        assert!(
            mean.abs() < 0.15 && (spread - 10.0).abs() < 0.15,
            "{mean} {spread}"
        );
        let least = noisy.as_slice().iter().min().unwrap();
        assert_eq!(*least, LEAST_HU as i16);
    }
}
