//! The angle gamma and the height h of the nose (paper section IV, Fig. 10 b).

use serde::Serialize;

use super::MeasureError;
use crate::feature::Landmarks;
use crate::space::GridPoint;

/// How pointed the nose is and how far it stands out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NoseGeometry {
    /// The tip that was measured, grid mm.
    pub tip: GridPoint,
    /// gamma: the angle P2-P5-P1 at the tip, between `lip` and `nasal_bones`, in degrees.
    pub gamma_deg: f64,
    /// h: distance from the base plane to the tip in mm, negative where the tip is behind the plane.
    pub height_mm: f64,
}

impl NoseGeometry {
    /// Of the nose whose six landmarks are given.
    ///
    /// # Errors
    /// [`MeasureError::Landmark`] for a position that is not finite, [`MeasureError::NoAngle`] where the
    /// tip is the same point as `nasal_bones` or `lip`.
    pub fn new(landmarks: &Landmarks<GridPoint>) -> Result<Self, MeasureError> {
        let tip = landmarks.tip;
        let (up, down) = (landmarks.nasal_bones - tip, landmarks.lip - tip);
        let height_mm = landmarks.maxilla.0.y - tip.0.y;
        if !(up.0.is_finite() && down.0.is_finite() && height_mm.is_finite()) {
            return Err(MeasureError::Landmark);
        }
        // Unit vectors, so that products of very short or very long ones neither vanish nor overflow.
        let (Some(up), Some(down)) = (up.0.try_normalize(), down.0.try_normalize()) else {
            return Err(MeasureError::NoAngle);
        };
        // Unlike the arc cosine this keeps its digits near 0 and 180 degrees.
        let gamma_deg = libm::atan2(up.cross(down).length(), up.dot(down)).to_degrees();
        Ok(Self {
            tip,
            gamma_deg,
            height_mm,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::{Phantom, SPACING};

    fn with_tip(tip: [f64; 3]) -> Landmarks<GridPoint> {
        let tip = GridPoint::new(
            tip[0] * SPACING[0],
            tip[1] * SPACING[1],
            tip[2] * SPACING[2],
        );
        Landmarks {
            tip,
            ..Phantom::lee2001().landmarks_mm()
        }
    }

    #[test]
    fn the_three_noses_of_table_1() {
        // Half of the last digit that the paper prints.
        const PRINTED: f64 = 0.005;
        for (tip, gamma, height) in [
            ([129.0, 33.0, 61.0], 70.95, 22.37),
            ([149.0, 33.0, 61.0], 72.42, 22.37),
            ([149.0, 53.0, 61.0], 110.54, 13.53),
        ] {
            let found = NoseGeometry::new(&with_tip(tip)).unwrap();
            assert!((found.gamma_deg - gamma).abs() < PRINTED, "{found:?}");
            assert!((found.height_mm - height).abs() < PRINTED, "{found:?}");
            assert_eq!(found.tip, with_tip(tip).tip);
        }
    }

    fn on_a_line(nasal_bones: f64, lip: f64) -> Landmarks<GridPoint> {
        Landmarks {
            nasal_bones: GridPoint::new(nasal_bones, 0.0, 0.0),
            lip: GridPoint::new(lip, 0.0, 0.0),
            tip: GridPoint::new(0.0, 0.0, 0.0),
            ..Phantom::lee2001().landmarks_mm()
        }
    }

    #[test]
    fn flat_and_folded_angles_are_exact() {
        let gamma = |a, b| NoseGeometry::new(&on_a_line(a, b)).unwrap().gamma_deg;
        assert_eq!(gamma(1.0, -7.0), 180.0);
        assert_eq!(gamma(3.0, 5.0), 0.0);
    }

    #[test]
    fn a_small_angle_keeps_its_digits() {
        let mut landmarks = on_a_line(1.0, 1.0);
        landmarks.lip.0.y = 1e-9;
        let found = NoseGeometry::new(&landmarks)
            .unwrap()
            .gamma_deg
            .to_radians();
        assert!((found - 1e-9).abs() < 1e-22, "{found}");
    }

    #[test]
    fn a_tip_behind_the_base_plane_has_a_negative_height() {
        let found = NoseGeometry::new(&with_tip([129.0, 93.61, 61.0])).unwrap();
        assert!((found.height_mm + 10.0 * SPACING[1]).abs() < 1e-12);
    }

    #[test]
    fn no_angle_and_no_number_are_errors() {
        let error = |landmarks| NoseGeometry::new(&landmarks).unwrap_err();
        assert_eq!(error(on_a_line(0.0, 1.0)), MeasureError::NoAngle);
        assert_eq!(error(on_a_line(1.0, 0.0)), MeasureError::NoAngle);
        assert_eq!(error(on_a_line(f64::NAN, 1.0)), MeasureError::Landmark);
        assert_eq!(
            error(with_tip([0.0, f64::INFINITY, 0.0])),
            MeasureError::Landmark
        );
    }
}
