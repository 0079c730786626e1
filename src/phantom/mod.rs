//! The built-in synthetic head, `lee2001`: an analytic shape on the paper's grid, whose landmarks,
//! measurements and true regional volumes are known without voxels.
//!
//! The shape is a set of signed functions of a point in grid millimetres ([`shape`]), so it can be
//! rendered on any grid ([`render`]), measured by quadrature ([`truth`]) and compared. What it is made
//! of and how near it comes to the paper's Table I: `docs/phantom.md`.

mod chain;
mod noise;
mod primitives;
mod render;
mod shape;
mod truth;

use crate::feature::Landmarks;
use crate::space::{ContinuousIndex, Grid, GridError, GridPoint};
use primitives::Dual;

pub use truth::REGIONS;

/// Voxels of the default grid: the paper's CT (section III).
pub const DIMS: [usize; 3] = [320, 320, 151];
/// Spacing of the default grid, mm. In plane it follows from the paper's h = 22.37 mm.
pub const SPACING: [f64; 3] = [shape::PIXEL_MM, shape::PIXEL_MM, 1.0];

/// HU of air.
pub const AIR_HU: f64 = -1000.0;
/// HU of soft tissue near the skin: water, so that half-way to air is exactly the skin threshold.
pub const TISSUE_HU: f64 = 0.0;
/// HU of bone.
pub const BONE_HU: f64 = 900.0;
/// HU of the brain.
pub const BRAIN_HU: f64 = 35.0;
/// Standard deviation of the Gaussian that blurs every edge, mm.
pub const EDGE_SIGMA_MM: f64 = 0.5;

/// The built-in head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phantom {
    noise: bool,
}

impl Default for Phantom {
    fn default() -> Self {
        Self::lee2001()
    }
}

impl Phantom {
    /// The head of the paper's first patient, with scanner-like noise.
    pub const fn lee2001() -> Self {
        Self { noise: true }
    }

    /// The same head without noise.
    pub const fn without_noise(self) -> Self {
        Self { noise: false }
    }

    /// The default grid: 320×320×151 voxels of 0.442×0.442×1 mm, axes left, posterior and superior, first
    /// voxel at the LPS origin.
    ///
    /// # Errors
    /// None for these constants; the type is [`Grid`]'s.
    pub fn default_grid() -> Result<Grid, GridError> {
        Grid::axis_aligned(DIMS, SPACING)
    }

    /// The six landmarks, in voxels of the default grid.
    pub const fn landmarks(&self) -> Landmarks<ContinuousIndex> {
        Landmarks {
            nasal_bones: ContinuousIndex::new(141.089, 71.61, shape::TOP_Z),
            lip: ContinuousIndex::new(141.089, 67.61, shape::LIP_Z),
            alare_right: ContinuousIndex::new(96.0, 60.0, 60.0),
            alare_left: ContinuousIndex::new(186.0, 60.0, 60.0),
            tip: ContinuousIndex::new(129.0, 33.0, 61.0),
            maxilla: ContinuousIndex::new(141.089, 83.61, 60.0),
        }
    }

    /// The six landmarks, in grid millimetres: the same points on every grid.
    pub fn landmarks_mm(&self) -> Landmarks<GridPoint> {
        let [x, y, z] = SPACING;
        self.landmarks()
            .map(|index| GridPoint::new(index.0.x * x, index.0.y * y, index.0.z * z))
    }

    /// Signed distance to the surface of the tissue (skin and airway lining), mm, positive in tissue.
    /// First-order exact at the surface, a sign and an order of magnitude away from it.
    pub fn tissue_depth(&self, at: GridPoint) -> f64 {
        depth(shape::tissue(Dual::coordinates(at.0)))
    }

    /// True volumes of the regions A..K, mm³: tissue in front of the base plane, in 11 slabs from the
    /// `nasal_bones` plane down to the `lip` plane. Found by quadrature of the analytic surface, within
    /// 0.02 %.
    pub fn true_region_volumes(&self) -> [f64; REGIONS] {
        truth::region_volumes(truth::CELLS_PER_REGION)
    }

    /// The sum of [`Phantom::true_region_volumes`], mm³.
    pub fn true_total(&self) -> f64 {
        self.true_region_volumes().iter().sum()
    }
}

/// Depth below the surface from a field that is negative inside: the value over the gradient's length.
fn depth(field: Dual) -> f64 {
    // On the surface the length is near 1 (a test holds it); where two sides of a wall meet it
    // vanishes, and there the field alone is far enough from 0.
    const LEAST_SLOPE: f64 = 0.5;
    -field.value / field.gradient.length().max(LEAST_SLOPE)
}
