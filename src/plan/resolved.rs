//! The plan as it runs.

mod views;

use std::path::PathBuf;

use serde::Serialize;

use crate::compare::{Accept, Swept};
use crate::feature::{Edit, FeatureKind, FeatureLine, Landmarks};
use crate::space::GridPoint;

pub use views::{
    Camera, Clip, Crop, CutPlane, DEFAULT_VIEW_SIZE, DrawnObject, Object, STANDARD_VIEWS, Side,
    StandardView, Views,
};

/// Skin threshold where a plan gives none: half-way between air and soft tissue (method section 6).
pub const DEFAULT_SKIN_HU: f64 = -500.0;
/// Bone threshold where a plan gives none.
pub const DEFAULT_BONE_HU: f64 = 300.0;
/// Depth of the cage where a plan gives none: the paper's 20 to 30 pixels at 0.442 mm.
pub const DEFAULT_CAGE_DEPTH_MM: f64 = 11.0;
/// Margin in which model `local` fades out, where a plan gives none.
pub const DEFAULT_MARGIN_MM: f64 = 20.0;
/// Tolerance of the adaptive method where a plan gives none.
pub const DEFAULT_TOLERANCE: Tolerance = Tolerance::Mm(DEFAULT_TOLERANCE_MM);
/// The same, mm.
pub(super) const DEFAULT_TOLERANCE_MM: f64 = 0.05;

/// A plan with every default filled in, every unit resolved, every position in grid millimetres of the
/// CT that it names.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// `[a-z0-9][a-z0-9-]*`; names the output folder.
    pub name: String,
    /// Free text.
    pub title: Option<String>,
    /// Where the voxels come from.
    pub ct: CtSource,
    /// The six landmarks.
    pub landmarks: Landmarks<GridPoint>,
    /// How far the landmarks of the skin may be from it to be moved onto it, mm; none where they stay.
    pub snap_mm: Option<f64>,
    /// Distance from the base plane to the back face of the cage, mm.
    pub cage_depth_mm: f64,
    /// The preoperative feature line f1.
    pub f1: FeatureLine,
    /// What is done to the volume that surfaces are found in, never to the one written or measured.
    pub enhance: Enhance,
    /// Thresholds.
    pub segment: Segment,
    /// How volumes are morphed.
    pub morph: Morph,
    /// The noses to compute, at least one, with unique names.
    pub candidates: Vec<Candidate>,
    /// What is written beside the tables.
    pub outputs: Outputs,
    /// What pictures show: given where, and only where, `outputs.views` is.
    pub views: Option<Views>,
    /// How meshes are made: given where, and only where, `outputs.mesh` is.
    pub mesh: Option<MeshSettings>,
    /// What a candidate must keep to be accepted, where the plan says so.
    pub accept: Option<Accept>,
}

/// Where the voxels come from.
#[derive(Debug, Clone, PartialEq)]
pub enum CtSource {
    /// A file or a folder, its path already relative to the working folder and not to the plan.
    File {
        /// The file to open, or the folder of slices.
        path: PathBuf,
        /// The SHA-256 that the plan pins its content to, as 64 lower-case hex digits.
        sha256: Option<String>,
        /// The SeriesInstanceUID of the slices to read, where a folder holds several series.
        series: Option<String>,
    },
    /// The built-in synthetic head.
    Phantom(Phantom),
}

/// A built-in synthetic head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phantom {
    /// The head of the size and landmarks of the paper's experiment.
    Lee2001,
}

impl Phantom {
    /// The name that plans use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lee2001 => "lee2001",
        }
    }
}

/// How a volume is made smoother before surfaces are found in it, the median first.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Enhance {
    /// Side of the median filter's window, voxels; none where there is no such filter.
    pub median: Option<usize>,
    /// Sigma of the Gaussian filter, mm; none where there is no such filter.
    pub smooth_mm: Option<f64>,
}

/// What is tissue and what is bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Tissue begins here.
    pub skin_hu: SkinThreshold,
    /// Bone begins here, HU. Above `skin_hu` where that is a number.
    pub bone_hu: f64,
    /// Whether only the largest connected piece of an object is drawn.
    pub keep_largest: bool,
}

/// Where tissue begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SkinThreshold {
    /// At this value, HU.
    Hu(f64),
    /// Where Otsu's method separates the CT's values.
    Otsu,
}

impl SkinThreshold {
    /// The word that plans use for [`SkinThreshold::Otsu`].
    pub const OTSU: &'static str = "otsu";
}

/// How volumes are morphed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Morph {
    /// The map.
    pub model: Model,
    /// The size it is computed at.
    pub scale: Scale,
    /// How densely it is evaluated.
    pub method: Method,
    /// Whether an adaptive run is compared with the exact one, voxel by voxel, for the report.
    pub compare_exact: bool,
}

/// The two maps of method section 3.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Model {
    /// The paper's, in voxels: global, one resampling for each stage.
    Lee2001,
    /// In millimetres, tapered to nothing outside the nose, stages composed.
    Local {
        /// How far from the box the taper reaches zero, mm.
        margin_mm: f64,
    },
}

impl Model {
    /// The name that plans use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lee2001 => "lee2001",
            Self::Local { .. } => "local",
        }
    }
}

/// The size at which the map is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "each variant is its scale")]
pub enum Scale {
    Full,
    Half,
}

impl Scale {
    /// The name that plans use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Half => "half",
        }
    }
}

/// How densely the map is evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// At every voxel.
    Exact,
    /// On an octree, interpolated where that stays within the tolerance.
    Adaptive {
        /// Largest distance between an interpolated and the exact source position.
        tolerance: Tolerance,
    },
}

impl Method {
    /// The name that plans use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Adaptive { .. } => "adaptive",
        }
    }
}

/// A distance between source positions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Tolerance {
    /// In millimetres.
    Mm(f64),
    /// In voxels of the full grid.
    Voxels(f64),
}

/// One candidate nose.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// `[a-z0-9][a-z0-9-]*`, unique in the plan.
    pub name: String,
    /// Free text.
    pub title: Option<String>,
    /// At least one, with unique names.
    pub stages: Vec<Stage>,
    /// The numbers that a sweep gave it; none of a candidate that the plan gives itself.
    pub swept: Vec<Swept>,
    /// The name of that sweep.
    pub sweep: Option<String>,
}

/// One step of an operation: f1 as the stage found it, and as it leaves it.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// `[a-z0-9][a-z0-9-]*`, unique in its candidate.
    pub name: String,
    /// What of f1 is the feature.
    pub kind: FeatureKind,
    /// At least one, in the order in which they apply. Those of a point move the tip alone.
    pub edits: Vec<Edit>,
    /// f1' of the paper: the target of the stage before, or the preoperative line.
    pub source: FeatureLine,
    /// f1 of the paper: the source after the edits.
    pub target: FeatureLine,
    /// Product of the width factors; 1 where there is none, and for a point.
    pub width: f64,
}

/// What is written beside the tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Outputs {
    /// `volume.nii.gz` for each stage.
    pub volume: bool,
    /// `volume.nrrd` for each stage.
    pub nrrd: bool,
    /// `displacement.nii.gz` for each stage.
    pub displacement: bool,
    /// Pictures of the surfaces, for the nose as it is and for each stage.
    pub views: bool,
    /// Pictures of slices, likewise.
    pub slices: bool,
    /// Charts of the measurements.
    pub charts: bool,
    /// `skin.stl`, `bone.stl` and `skin.ply`, for the nose as it is and for each stage.
    pub mesh: bool,
    /// `augmentation.stl` and `resection.stl` for each stage.
    pub solids: bool,
    /// `displacement-inverse.nii.gz` for each stage.
    pub inverse: bool,
}

/// How meshes are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct MeshSettings {
    /// The most triangles of a mesh; none where there are as many as come.
    pub triangles: Option<usize>,
}
