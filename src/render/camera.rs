//! Where a picture is taken from.

use glam::DVec3;
use thiserror::Error;

use crate::space::GridPoint;

/// The largest picture, pixels a side.
pub const MAX_SIZE: usize = 8192;

/// From where the head is seen. (0°, 0°) is from the front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// About the superior axis, degrees: positive moves the camera to the patient's left.
    pub azimuth_deg: f64,
    /// Degrees: positive moves the camera up, -90 looks from below.
    pub elevation_deg: f64,
}

/// An orthographic camera, in the frame of a grid (millimetres, no rotation).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Unit vector to the picture's right.
    pub right: DVec3,
    /// Unit vector to the picture's top.
    pub up: DVec3,
    /// Unit vector from the head to the viewer.
    pub toward: DVec3,
    /// What lies in the middle of the picture.
    pub centre: GridPoint,
    mm_per_pixel: f64,
    size: usize,
}

/// A point in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projected {
    /// Pixels from the left edge; the first pixel's centre is at 0.5.
    pub x: f64,
    /// Pixels from the top edge.
    pub y: f64,
    /// Towards the viewer, mm from the plane of the camera's centre.
    pub depth_mm: f64,
}

/// Why a camera takes no picture.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum CameraError {
    /// The picture has no pixels, or too many.
    #[error("a picture of {size} pixels a side; it must have 1 to {MAX_SIZE}")]
    Size {
        /// The size asked for.
        size: usize,
    },
    /// The field, a direction or the centre is not a usable number.
    #[error("the camera's field ({field_mm} mm), direction or centre is not a usable number")]
    Field {
        /// The field asked for, mm.
        field_mm: f64,
    },
}

impl Camera {
    /// A square picture of `size` pixels that shows `field_mm` mm around `centre`. At 90 degrees of
    /// elevation the patient's front is at the picture's bottom, at -90 degrees at its top.
    ///
    /// # Errors
    /// [`CameraError`] where a value is out of range or not finite.
    pub fn new(
        from: Direction,
        centre: GridPoint,
        field_mm: f64,
        size: usize,
    ) -> Result<Self, CameraError> {
        if size == 0 || size > MAX_SIZE {
            return Err(CameraError::Size { size });
        }
        let angles = from.azimuth_deg.is_finite() && from.elevation_deg.is_finite();
        if !(angles && centre.0.is_finite() && field_mm.is_finite() && field_mm > 0.0) {
            return Err(CameraError::Field { field_mm });
        }
        let (sin_a, cos_a) = libm::sincos(from.azimuth_deg.to_radians());
        let (sin_e, cos_e) = libm::sincos(from.elevation_deg.to_radians());
        // In LPS order: x to the left, y to posterior, z up; from the front is from -y.
        let right = DVec3::new(cos_a, sin_a, 0.0);
        let toward = DVec3::new(sin_a * cos_e, -cos_a * cos_e, sin_e);
        Ok(Self {
            right,
            up: toward.cross(right),
            toward,
            centre,
            mm_per_pixel: field_mm / size as f64,
            size,
        })
    }

    /// Pixels a side.
    pub fn size(&self) -> usize {
        self.size
    }

    /// What a pixel shows, mm.
    pub fn mm_per_pixel(&self) -> f64 {
        self.mm_per_pixel
    }

    /// Where a point is in the picture.
    pub fn project(&self, point: GridPoint) -> Projected {
        let from = point.0 - self.centre.0;
        let middle = self.size as f64 / 2.0;
        Projected {
            x: middle + from.dot(self.right) / self.mm_per_pixel,
            y: middle - from.dot(self.up) / self.mm_per_pixel,
            depth_mm: from.dot(self.toward),
        }
    }

    /// The point that a place in the picture shows at a depth.
    pub fn unproject(&self, at: Projected) -> GridPoint {
        let middle = self.size as f64 / 2.0;
        let across = (at.x - middle) * self.mm_per_pixel;
        let up = (middle - at.y) * self.mm_per_pixel;
        GridPoint(self.centre.0 + self.right * across + self.up * up + self.toward * at.depth_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(azimuth_deg: f64, elevation_deg: f64) -> Camera {
        let from = Direction {
            azimuth_deg,
            elevation_deg,
        };
        Camera::new(from, GridPoint::new(10.0, 20.0, 30.0), 100.0, 200).unwrap()
    }

    fn near(a: DVec3, b: DVec3) {
        assert!((a - b).length() < 1e-12, "{a} is not {b}");
    }

    #[test]
    fn standard_directions_show_the_anatomy_where_a_photograph_does() {
        let (left, posterior, superior) = (DVec3::X, DVec3::Y, DVec3::Z);
        // Frontal: the patient's left at the viewer's right.
        let frontal = camera(0.0, 0.0);
        near(frontal.right, left);
        near(frontal.up, superior);
        near(frontal.toward, -posterior);
        // From the patient's left, the face looks to the viewer's left.
        let lateral = camera(90.0, 0.0);
        near(lateral.toward, left);
        near(lateral.right, posterior);
        near(lateral.up, superior);
        // From below, the tip of the nose is at the top and the patient's left still at the right.
        let basal = camera(0.0, -90.0);
        near(basal.toward, -superior);
        near(basal.up, -posterior);
        near(basal.right, left);
    }

    #[test]
    fn projection_returns() {
        let camera = camera(33.0, -21.0);
        let point = GridPoint::new(13.0, 2.0, 40.0);
        let back = camera.unproject(camera.project(point));
        near(back.0, point.0);
        let middle = camera.project(camera.centre);
        assert_eq!((middle.x, middle.y, middle.depth_mm), (100.0, 100.0, 0.0));
        let right = camera.project(GridPoint(camera.centre.0 + camera.right));
        assert!((right.x - 102.0).abs() < 1e-9 && (right.y - 100.0).abs() < 1e-9);
    }

    #[test]
    fn what_cannot_be_a_picture_is_refused() {
        let front = Direction {
            azimuth_deg: 0.0,
            elevation_deg: 0.0,
        };
        let centre = GridPoint::new(0.0, 0.0, 0.0);
        assert!(Camera::new(front, centre, 100.0, 0).is_err());
        assert!(Camera::new(front, centre, 100.0, MAX_SIZE + 1).is_err());
        assert!(Camera::new(front, centre, 0.0, 10).is_err());
        assert!(Camera::new(front, centre, f64::NAN, 10).is_err());
        assert!(Camera::new(front, GridPoint::new(f64::NAN, 0.0, 0.0), 1.0, 10).is_err());
    }
}
