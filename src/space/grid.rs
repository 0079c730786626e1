//! The voxel lattice of a volume: the only type that converts between frames.

use glam::{DMat3, DVec3};
use serde::Serialize;
use thiserror::Error;

use super::frames::{ContinuousIndex, GridPoint, GridVector, LpsPoint, LpsVector};

/// The longest axis that a grid may have, in voxels (NIfTI-1 stores lengths as `i16`).
pub const MAX_AXIS_LENGTH: usize = 32_767;

/// Largest cosine between two direction columns that still counts as perpendicular. Headers store
/// `f32` and are often rounded to four digits; 1e-3 (0.06°) lets those pass and refuses real shear.
const PERPENDICULAR_TOLERANCE: f64 = 1e-3;

/// Size, spacing and position of a volume, axes in LPS order.
///
/// `direction`'s columns are the unit vectors of the x, y and z index axes in LPS mm. They are the
/// nearest to left, posterior and superior, but need not equal them (an oblique scan).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Grid {
    dims: [usize; 3],
    spacing: DVec3,
    origin: LpsPoint,
    #[serde(serialize_with = "direction_as_rows")]
    direction: DMat3,
    #[serde(skip)]
    inverse_direction: DMat3,
}

/// Why a [`Grid`] cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum GridError {
    /// An axis is empty or longer than [`MAX_AXIS_LENGTH`].
    #[error("the grid is {}×{}×{} voxels; every axis must have 1 to {MAX_AXIS_LENGTH}", dims[0], dims[1], dims[2])]
    Dims {
        /// The lengths found.
        dims: [usize; 3],
    },
    /// A spacing is not a positive finite number of mm.
    #[error("the voxel spacing is {}×{}×{} mm; every axis needs a positive finite spacing", spacing[0], spacing[1], spacing[2])]
    Spacing {
        /// The spacing found, mm.
        spacing: [f64; 3],
    },
    /// The origin or a direction cosine is not finite, or a direction column is zero.
    #[error(
        "the affine holds a value that is not finite, or an axis of no length; its position in space is unknown"
    )]
    NotFinite,
    /// Two axes are not perpendicular.
    #[error(
        "the affine is sheared: two of its axes meet at {angle_deg:.3}° instead of 90°; resample the volume to a rectangular grid first"
    )]
    Sheared {
        /// The angle found, degrees.
        angle_deg: f64,
    },
}

impl Grid {
    /// A grid of `dims` voxels at `spacing` mm, whose first voxel's centre is at `origin` and whose
    /// axes are the columns of `direction` (normalised here).
    ///
    /// # Errors
    /// [`GridError`] where a value is out of range, not finite, or the axes are not perpendicular.
    pub fn new(
        dims: [usize; 3],
        spacing: [f64; 3],
        origin: LpsPoint,
        direction: DMat3,
    ) -> Result<Self, GridError> {
        if dims.iter().any(|&n| n == 0 || n > MAX_AXIS_LENGTH) {
            return Err(GridError::Dims { dims });
        }
        if spacing.iter().any(|&s| !(s.is_finite() && s > 0.0)) {
            return Err(GridError::Spacing { spacing });
        }
        if !origin.0.is_finite() || !direction.is_finite() {
            return Err(GridError::NotFinite);
        }
        let axes =
            [direction.x_axis, direction.y_axis, direction.z_axis].map(|axis| axis.try_normalize());
        let [Some(x), Some(y), Some(z)] = axes else {
            return Err(GridError::NotFinite);
        };
        for cosine in [x.dot(y), y.dot(z), z.dot(x)] {
            if cosine.abs() > PERPENDICULAR_TOLERANCE {
                let angle_deg = libm::acos(cosine).to_degrees();
                return Err(GridError::Sheared { angle_deg });
            }
        }
        let direction = DMat3::from_cols(x, y, z);
        Ok(Self {
            dims,
            spacing: DVec3::from_array(spacing),
            origin,
            direction,
            inverse_direction: direction.inverse(),
        })
    }

    /// A grid at the LPS origin whose axes are left, posterior and superior.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn axis_aligned(dims: [usize; 3], spacing: [f64; 3]) -> Result<Self, GridError> {
        Self::new(dims, spacing, LpsPoint::new(0.0, 0.0, 0.0), DMat3::IDENTITY)
    }

    /// Voxels along x (left), y (posterior) and z (superior).
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Never true: a grid has at least one voxel.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Distance between voxel centres along each axis, mm.
    pub fn spacing(&self) -> DVec3 {
        self.spacing
    }

    /// Volume of a voxel, mm³.
    pub fn voxel_volume(&self) -> f64 {
        self.spacing.x * self.spacing.y * self.spacing.z
    }

    /// Centre of voxel (0, 0, 0).
    pub fn origin(&self) -> LpsPoint {
        self.origin
    }

    /// The index axes as unit columns in LPS.
    pub fn direction(&self) -> DMat3 {
        self.direction
    }

    /// The largest angle between an index axis and the anatomical axis it stands for, degrees.
    pub fn obliquity_deg(&self) -> f64 {
        let least = self
            .direction
            .x_axis
            .x
            .min(self.direction.y_axis.y)
            .min(self.direction.z_axis.z);
        libm::acos(least.clamp(-1.0, 1.0)).to_degrees()
    }

    /// Voxels to grid millimetres.
    pub fn index_to_grid(&self, index: ContinuousIndex) -> GridPoint {
        GridPoint(index.0 * self.spacing)
    }

    /// Grid millimetres to voxels.
    pub fn grid_to_index(&self, point: GridPoint) -> ContinuousIndex {
        ContinuousIndex(point.0 / self.spacing)
    }

    /// Grid millimetres to the patient's frame.
    pub fn grid_to_lps(&self, point: GridPoint) -> LpsPoint {
        LpsPoint(self.origin.0 + self.direction * point.0)
    }

    /// The patient's frame to grid millimetres.
    pub fn lps_to_grid(&self, point: LpsPoint) -> GridPoint {
        GridPoint(self.inverse_direction * (point.0 - self.origin.0))
    }

    /// A displacement in grid millimetres, turned into the patient's frame.
    pub fn grid_vector_to_lps(&self, vector: GridVector) -> LpsVector {
        LpsVector(self.direction * vector.0)
    }

    /// A displacement in the patient's frame, turned into grid millimetres.
    pub fn lps_vector_to_grid(&self, vector: LpsVector) -> GridVector {
        GridVector(self.inverse_direction * vector.0)
    }

    /// Whether a position lies between the centres of the first and last voxels of every axis.
    pub fn contains(&self, index: ContinuousIndex) -> bool {
        let last = self.last_index();
        index.0.cmpge(DVec3::ZERO).all() && index.0.cmple(last).all()
    }

    /// The index of the last voxel of every axis.
    pub fn last_index(&self) -> DVec3 {
        DVec3::from_array(self.dims.map(|n| (n - 1) as f64))
    }
}

/// Rows, because that is how a matrix is read in JSON.
fn direction_as_rows<S: serde::Serializer>(direction: &DMat3, to: S) -> Result<S::Ok, S::Error> {
    direction.transpose().to_cols_array_2d().serialize(to)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn oblique() -> Grid {
        let turn = DMat3::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.35);
        Grid::new(
            [20, 30, 40],
            [0.5, 0.75, 1.25],
            LpsPoint::new(-10.0, 20.0, 5.0),
            turn,
        )
        .unwrap()
    }

    #[test]
    fn every_conversion_returns() {
        let grid = oblique();
        let index = ContinuousIndex::new(3.25, 7.5, 11.0);
        let there = grid.grid_to_lps(grid.index_to_grid(index));
        let back = grid.grid_to_index(grid.lps_to_grid(there));
        assert!((back.0 - index.0).length() < 1e-12);
        let vector = GridVector::new(1.0, -2.0, 3.0);
        let back = grid.lps_vector_to_grid(grid.grid_vector_to_lps(vector));
        assert!((back.0 - vector.0).length() < 1e-12);
    }

    #[test]
    fn vectors_do_not_see_the_origin() {
        let grid = oblique();
        let zero = grid.grid_vector_to_lps(GridVector::new(0.0, 0.0, 0.0));
        assert_eq!(zero.0, DVec3::ZERO);
    }

    #[test]
    fn shear_is_refused_with_its_angle() {
        let sheared = DMat3::from_cols(DVec3::X, DVec3::new(0.1, 1.0, 0.0), DVec3::Z);
        let error = Grid::new([2; 3], [1.0; 3], LpsPoint::new(0.0, 0.0, 0.0), sheared);
        let Err(GridError::Sheared { angle_deg }) = error else {
            panic!("accepted a sheared affine");
        };
        assert!((angle_deg - 84.29).abs() < 0.01);
    }

    #[test]
    fn bad_spacing_dims_and_origin_are_refused() {
        let origin = LpsPoint::new(0.0, 0.0, 0.0);
        let unit = DMat3::IDENTITY;
        assert!(Grid::new([0, 1, 1], [1.0; 3], origin, unit).is_err());
        assert!(Grid::new([40_000, 1, 1], [1.0; 3], origin, unit).is_err());
        assert!(Grid::new([1; 3], [0.0, 1.0, 1.0], origin, unit).is_err());
        assert!(Grid::new([1; 3], [f64::NAN, 1.0, 1.0], origin, unit).is_err());
        assert!(
            Grid::new(
                [1; 3],
                [1.0; 3],
                LpsPoint::new(f64::INFINITY, 0.0, 0.0),
                unit
            )
            .is_err()
        );
        assert!(Grid::new([1; 3], [1.0; 3], origin, DMat3::ZERO).is_err());
    }
}
