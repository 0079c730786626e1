//! What pictures show.

use serde::Serialize;

/// A camera that every plan has by name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandardView {
    /// The name that plans and files use.
    pub name: &'static str,
    /// As [`Camera::azimuth_deg`].
    pub azimuth_deg: f64,
    /// As [`Camera::elevation_deg`].
    pub elevation_deg: f64,
}

/// The standard views, in the order in which they are drawn where a plan names none: the six of clinical
/// photography of the nose. Left and right are the side of the patient that is seen.
pub const STANDARD_VIEWS: [StandardView; 6] = [
    standard("frontal", 0.0, 0.0),
    standard("lateral-left", 90.0, 0.0),
    standard("lateral-right", -90.0, 0.0),
    standard("oblique-left", 45.0, 0.0),
    standard("oblique-right", -45.0, 0.0),
    standard("basal", 0.0, -60.0),
];

const fn standard(name: &'static str, azimuth_deg: f64, elevation_deg: f64) -> StandardView {
    StandardView {
        name,
        azimuth_deg,
        elevation_deg,
    }
}

/// Side of a picture where a plan gives none, pixels.
pub const DEFAULT_VIEW_SIZE: u32 = 1024;

/// The pictures of a nose.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Views {
    /// From where, at least one, with unique names: the standard views that the plan names, then its own.
    pub cameras: Vec<Camera>,
    /// Side of the square picture, pixels.
    pub size: u32,
    /// What is drawn, at least one, each once.
    pub objects: Vec<DrawnObject>,
    /// How much of it is in the picture.
    pub crop: Crop,
    /// What of it is left out.
    pub clip: Clip,
}

impl Default for Views {
    /// The six standard views of the skin of the face.
    fn default() -> Self {
        Self {
            cameras: STANDARD_VIEWS.iter().map(Camera::from).collect(),
            size: DEFAULT_VIEW_SIZE,
            objects: vec![DrawnObject {
                object: Object::Skin,
                opacity: 1.0,
            }],
            crop: Crop::Face,
            clip: Clip::None,
        }
    }
}

/// From where a picture is taken. The camera looks at the nose.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Camera {
    /// `[a-z0-9][a-z0-9-]*`.
    pub name: String,
    /// About the superior axis, degrees from -180 to 180: 0 looks from anterior, a positive angle from the
    /// patient's left.
    pub azimuth_deg: f64,
    /// Degrees from -90 to 90: a positive angle looks from above.
    pub elevation_deg: f64,
}

impl From<&StandardView> for Camera {
    fn from(view: &StandardView) -> Self {
        Self {
            name: view.name.to_owned(),
            azimuth_deg: view.azimuth_deg,
            elevation_deg: view.elevation_deg,
        }
    }
}

/// A surface that is drawn, and how.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DrawnObject {
    /// Which.
    pub object: Object,
    /// Above 0, at most 1: nothing shows through.
    pub opacity: f64,
}

/// A surface that can be drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Object {
    /// The border of what is at or above the skin threshold.
    Skin,
    /// The border of what is at or above the bone threshold.
    Bone,
}

impl Object {
    /// The name that plans use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Skin => "skin",
            Self::Bone => "bone",
        }
    }
}

/// How much of the head is in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "named after what the picture holds")]
pub enum Crop {
    Face,
    Head,
    Nose,
    /// A square of this side, mm.
    Mm(f64),
}

/// What of the head is left out of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Clip {
    /// Nothing.
    None,
    /// All that is outside the nose box.
    Nose,
    /// All that is on one side of a plane through the tip, or parallel to that.
    Plane {
        /// How the plane lies.
        plane: CutPlane,
        /// From the tip to the plane, mm, positive to the left, posterior or superior.
        offset_mm: f64,
        /// The side that is drawn: one of `plane`'s.
        keep: Side,
    },
}

/// How a cut lies: normal to an axis of the voxel grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "anatomical names")]
pub enum CutPlane {
    Sagittal,
    Coronal,
    Axial,
}

impl CutPlane {
    /// The name that plans use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sagittal => "sagittal",
            Self::Coronal => "coronal",
            Self::Axial => "axial",
        }
    }

    /// The axis that it is normal to: 0, 1, 2 for x, y, z of LPS order.
    pub const fn axis(self) -> usize {
        match self {
            Self::Sagittal => 0,
            Self::Coronal => 1,
            Self::Axial => 2,
        }
    }

    /// Its two sides, that of smaller coordinates first.
    pub const fn sides(self) -> [Side; 2] {
        match self {
            Self::Sagittal => [Side::Right, Side::Left],
            Self::Coronal => [Side::Anterior, Side::Posterior],
            Self::Axial => [Side::Inferior, Side::Superior],
        }
    }
}

/// One side of a cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "anatomical names")]
pub enum Side {
    Left,
    Right,
    Anterior,
    Posterior,
    Superior,
    Inferior,
}

impl Side {
    /// The name that plans use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Anterior => "anterior",
            Self::Posterior => "posterior",
            Self::Superior => "superior",
            Self::Inferior => "inferior",
        }
    }

    /// Whether coordinates in LPS order are greater on this side than on the plane.
    pub const fn is_greater(self) -> bool {
        matches!(self, Self::Left | Self::Posterior | Self::Superior)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_plane_has_a_side_of_smaller_and_one_of_greater_coordinates() {
        for plane in [CutPlane::Sagittal, CutPlane::Coronal, CutPlane::Axial] {
            assert_eq!(plane.sides().map(Side::is_greater), [false, true]);
        }
    }
}
