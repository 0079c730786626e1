//! The head as a volume.

use rayon::prelude::*;

use super::noise::SliceNoise;
use super::primitives::Dual;
use super::shape::{bone, brain_field, tissue};
use super::{AIR_HU, BONE_HU, BRAIN_HU, EDGE_SIGMA_MM, Phantom, TISSUE_HU, depth};
use crate::space::{ContinuousIndex, Grid};
use crate::volume::{Rescale, Volume, VolumeError};

/// Slices that one task renders.
const SLICES: usize = 4;
/// Voxels along x and y of the tiles that are decided as a whole where no surface is near.
const TILE: usize = 8;
/// Beyond so many sigmas an edge is 0 or 1 (to 1e-9).
const EDGE_REACH: f64 = 6.0;
/// No field changes faster than this from point to point, mm per mm (a test compares with the plain
/// rendering).
const STEEPEST: f64 = 1.5;
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

/// HU of the slices from `first` on that `values` has room for.
fn render_slices(grid: &Grid, first: usize, values: &mut [f32], tiles: bool) {
    let [nx, ny, _] = grid.dims();
    let slices = values.len() / (nx * ny);
    for y0 in (0..ny).step_by(TILE) {
        for x0 in (0..nx).step_by(TILE) {
            let (x1, y1) = ((x0 + TILE).min(nx), (y0 + TILE).min(ny));
            let low = ContinuousIndex::new(x0 as f64, y0 as f64, first as f64);
            let high = ContinuousIndex::new(
                (x1 - 1) as f64,
                (y1 - 1) as f64,
                (first + slices - 1) as f64,
            );
            let (low, high) = (grid.index_to_grid(low).0, grid.index_to_grid(high).0);
            let parts = if tiles {
                Parts::near((low + high) * 0.5, (high - low).length() * 0.5)
            } else {
                Parts::ALL
            };
            for z in 0..slices {
                for y in y0..y1 {
                    let start = (z * ny + y) * nx;
                    let row = &mut values[start + x0..start + x1];
                    if let Some(hu) = parts.same_everywhere() {
                        row.fill(hu as f32);
                        continue;
                    }
                    for (offset, value) in row.iter_mut().enumerate() {
                        let index = ContinuousIndex::new(
                            (x0 + offset) as f64,
                            y as f64,
                            (first + z) as f64,
                        );
                        *value = parts.hu(grid.index_to_grid(index).0) as f32;
                    }
                }
            }
        }
    }
}

/// How much of a material there is in a tile.
#[derive(Clone, Copy, PartialEq)]
enum Share {
    None,
    All,
    /// Its edge comes through: ask at every voxel.
    Varies,
}

/// What a tile is made of.
struct Parts {
    tissue: Share,
    bone: Share,
    brain: Share,
}

impl Parts {
    const ALL: Self = Self {
        tissue: Share::Varies,
        bone: Share::Varies,
        brain: Share::Varies,
    };

    /// Of the ball of `radius` mm around `centre`.
    fn near(centre: glam::DVec3, radius: f64) -> Self {
        // `depth` may double a field's value.
        let reach = STEEPEST * radius + EDGE_REACH * EDGE_SIGMA_MM * 1.5;
        let share = |field: f64| {
            if field > reach {
                Share::None
            } else if field < -reach {
                Share::All
            } else {
                Share::Varies
            }
        };
        let at = centre.to_array();
        let surface = tissue(at);
        let tissue = share(surface);
        if tissue == Share::None {
            return Self {
                tissue,
                bone: Share::None,
                brain: Share::None,
            };
        }
        Self {
            tissue,
            bone: share(bone(at, surface)),
            brain: share(brain_field(at)),
        }
    }

    /// The tile's HU where no edge comes through.
    fn same_everywhere(&self) -> Option<f64> {
        let share = |share| match share {
            Share::None => Some(0.0),
            Share::All => Some(1.0),
            Share::Varies => None,
        };
        Some(mix(
            share(self.tissue)?,
            share(self.bone)?,
            share(self.brain)?,
        ))
    }

    /// HU at a point of the tile.
    fn hu(&self, point: glam::DVec3) -> f64 {
        let at = Dual::coordinates(point);
        let wanted = |share| share == Share::Varies;
        let surface = if wanted(self.tissue) || wanted(self.bone) {
            tissue(at)
        } else {
            Dual::coordinates(point)[0]
        };
        let part = |share, field: &dyn Fn() -> Dual| match share {
            Share::None => 0.0,
            Share::All => 1.0,
            Share::Varies => edge(depth(field())),
        };
        mix(
            part(self.tissue, &|| surface),
            part(self.bone, &|| bone(at, surface)),
            part(self.brain, &|| brain_field(at)),
        )
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
