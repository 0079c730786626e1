//! NIfTI's frame. Nothing inside the program knows it: files and landmarks are converted here.

use glam::{DMat3, DVec3};

use super::frames::{LpsPoint, LpsVector, frame_type};
use serde::{Deserialize, Serialize};

frame_type! {
    /// A position in NIfTI's world frame, mm: x to the right, y to anterior, z to superior.
    RasPoint
}
frame_type! {
    /// A displacement in NIfTI's world frame, mm.
    RasVector
}

const FLIP: DVec3 = DVec3::new(-1.0, -1.0, 1.0);

impl From<RasPoint> for LpsPoint {
    fn from(point: RasPoint) -> Self {
        LpsPoint(point.0 * FLIP)
    }
}

impl From<LpsPoint> for RasPoint {
    fn from(point: LpsPoint) -> Self {
        RasPoint(point.0 * FLIP)
    }
}

impl From<RasVector> for LpsVector {
    fn from(vector: RasVector) -> Self {
        LpsVector(vector.0 * FLIP)
    }
}

/// A matrix whose columns are axes in RAS, as columns in LPS.
pub fn ras_axes_to_lps(axes: DMat3) -> DMat3 {
    DMat3::from_diagonal(FLIP) * axes
}

/// A matrix whose columns are axes in LPS, as columns in RAS.
pub fn lps_axes_to_ras(axes: DMat3) -> DMat3 {
    DMat3::from_diagonal(FLIP) * axes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn right_and_anterior_change_sign_and_superior_stays() {
        assert_eq!(
            LpsPoint::from(RasPoint::new(1.0, 2.0, 3.0)),
            LpsPoint::new(-1.0, -2.0, 3.0)
        );
        assert_eq!(
            RasPoint::from(LpsPoint::new(-1.0, -2.0, 3.0)),
            RasPoint::new(1.0, 2.0, 3.0)
        );
    }
}
