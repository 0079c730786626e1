//! The edits of f1 that a plan can write, in the surgeon's words.

use glam::DVec3;
use serde::Serialize;

use super::{FeatureLine, LineError};
use crate::space::{GridPoint, GridVector};

/// One edit of f1, resolved to grid millimetres and degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Edit {
    /// Moves the tip by a vector.
    MoveTip(GridVector),
    /// Moves the root by a vector.
    MoveRoot(GridVector),
    /// Puts the tip at a point.
    TipTo(GridPoint),
    /// Puts the root at a point.
    RootTo(GridPoint),
    /// Moves the tip to anterior, mm.
    Project(f64),
    /// Turns the tip up about the root in the sagittal plane, degrees.
    Rotate(f64),
    /// Moves the tip away from the root along the line, mm.
    Lengthen(f64),
    /// Moves the tip to the patient's left, mm.
    Deviate(f64),
    /// Widens the nose by a factor (model `local`).
    Width(f64),
}

impl Edit {
    /// The line after this edit. [`Edit::Width`] leaves the line as it is.
    ///
    /// # Errors
    /// [`LineError`] where the edit leaves a line of no direction.
    pub fn apply(self, line: FeatureLine) -> Result<FeatureLine, LineError> {
        let FeatureLine { root, tip } = line;
        match self {
            Self::MoveTip(by) => FeatureLine::new(root, tip + by),
            Self::MoveRoot(by) => FeatureLine::new(root + by, tip),
            Self::TipTo(point) => FeatureLine::new(root, point),
            Self::RootTo(point) => FeatureLine::new(point, tip),
            Self::Project(mm) => FeatureLine::new(root, tip + GridVector::new(0.0, -mm, 0.0)),
            Self::Rotate(degrees) => {
                let arm = line.vector().0;
                let (sin, cos) = libm::sincos(degrees.to_radians());
                // In the sagittal plane, with anterior (-y) forward and superior (z) up, a positive
                // angle turns forward into up.
                let turned =
                    DVec3::new(arm.x, arm.y * cos + arm.z * sin, arm.z * cos - arm.y * sin);
                FeatureLine::new(root, root + GridVector(turned))
            }
            Self::Lengthen(mm) => {
                let arm = line.vector().0;
                let length = line.length();
                if length + mm < super::MIN_LENGTH_MM {
                    return Err(LineError::Degenerate {
                        length_mm: (length + mm).max(0.0),
                    });
                }
                FeatureLine::new(root, tip + GridVector(arm * (mm / length)))
            }
            Self::Deviate(mm) => FeatureLine::new(root, tip + GridVector::new(mm, 0.0, 0.0)),
            Self::Width(_) => Ok(line),
        }
    }

    /// The factor by which this edit widens the nose: 1 for every edit but [`Edit::Width`].
    pub fn width_factor(self) -> f64 {
        match self {
            Self::Width(factor) => factor,
            _ => 1.0,
        }
    }
}

/// The line after the edits, applied in order, and the product of their width factors.
///
/// # Errors
/// The place in `edits` of the first that leaves a line of no direction, and why.
pub fn apply_edits(
    edits: &[Edit],
    line: FeatureLine,
) -> Result<(FeatureLine, f64), (usize, LineError)> {
    let mut line = line;
    let mut width = 1.0;
    for (place, edit) in edits.iter().enumerate() {
        line = edit.apply(line).map_err(|error| (place, error))?;
        width *= edit.width_factor();
    }
    Ok((line, width))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line() -> FeatureLine {
        // The tip is 10 mm in front of the root and 10 mm below it.
        FeatureLine::new(
            GridPoint::new(60.0, 30.0, 80.0),
            GridPoint::new(60.0, 20.0, 70.0),
        )
        .unwrap()
    }

    fn tip_after(edit: Edit) -> [f64; 3] {
        let moved = edit.apply(line()).unwrap();
        moved.tip.to_array()
    }

    fn assert_near(found: [f64; 3], expected: [f64; 3]) {
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-12, "{found:?} is not {expected:?}");
        }
    }

    #[test]
    fn words_move_the_tip_as_a_surgeon_means_them() {
        assert_near(tip_after(Edit::Project(2.0)), [60.0, 18.0, 70.0]);
        assert_near(tip_after(Edit::Deviate(3.0)), [63.0, 20.0, 70.0]);
        let step = 5.0 / 2f64.sqrt();
        assert_near(
            tip_after(Edit::Lengthen(5.0)),
            [60.0, 20.0 - step, 70.0 - step],
        );
        // 45° up from "forward and down" is straight forward.
        let reach = 200f64.sqrt();
        assert_near(tip_after(Edit::Rotate(45.0)), [60.0, 30.0 - reach, 80.0]);
    }

    #[test]
    fn rotation_keeps_length_and_side() {
        let start = FeatureLine::new(
            GridPoint::new(60.0, 30.0, 80.0),
            GridPoint::new(64.0, 18.0, 66.0),
        )
        .unwrap();
        let turned = Edit::Rotate(-17.0).apply(start).unwrap();
        assert!((turned.length() - start.length()).abs() < 1e-12);
        assert_eq!(turned.tip.0.x, start.tip.0.x);
        assert!(
            turned.tip.0.z < start.tip.0.z,
            "a negative angle turns down"
        );
    }

    #[test]
    fn edits_apply_in_order_and_widths_multiply() {
        let edits = [
            Edit::Width(1.2),
            Edit::MoveTip(GridVector::new(0.0, 0.0, 10.0)),
            Edit::Lengthen(1.0),
            Edit::Width(0.5),
        ];
        let (moved, width) = apply_edits(&edits, line()).unwrap();
        assert_near(moved.tip.to_array(), [60.0, 19.0, 80.0]);
        assert!((width - 0.6).abs() < 1e-15);
    }

    #[test]
    fn a_line_of_no_direction_is_refused_and_placed() {
        let edits = [Edit::Project(1.0), Edit::TipTo(line().root)];
        let (place, error) = apply_edits(&edits, line()).unwrap_err();
        assert_eq!(place, 1);
        assert!(matches!(error, LineError::Degenerate { .. }));
        assert!(Edit::Lengthen(-20.0).apply(line()).is_err());
        assert!(
            Edit::MoveTip(GridVector::new(f64::NAN, 0.0, 0.0))
                .apply(line())
                .is_err()
        );
    }
}
