//! `run.json`: everything that went into a run and everything that it measured.
//!
//! No date, no duration, no path and nothing of a scan's header text: the same plan on the same CT gives
//! the same bytes on every machine, and nothing in them names the patient.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::meshes::{MeshesRecord, SolidsRecord};
use crate::compare::{Accept, SurfaceDifference, Swept, Verdict};
use crate::feature::{Cage, Edit, FeatureKind, FeatureLine, Landmarks};
use crate::measure::{REGION_NAMES, REGIONS};
use crate::morph::audit::{FieldDifference, WarpAudit};
use crate::morph::inverse::InverseAudit;
use crate::plan::{Enhance, MeshSettings, Morph, Outputs, Plan, Segment, SkinThreshold, Views};
use crate::space::{ContinuousIndex, Grid, GridPoint, GridVector};
use crate::volume::SampleType;

/// The version of this record's layout.
pub const FORMAT: u32 = 1;

/// The name of the first row of every candidate: the nose as it is.
pub const PREOPERATIVE: &str = "preoperative";

/// A whole run of one plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunRecord {
    /// [`FORMAT`].
    pub format: u32,
    /// What computed it.
    pub program: Program,
    /// What went in.
    pub inputs: Inputs,
    /// The plan with every default filled in and every unit resolved.
    pub plan: PlanRecord,
    /// Which part of the candidates ran, where they were shared out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<PartRecord>,
    /// What the user should know of the CT and the landmarks, as the run told it; not there where there is
    /// nothing to tell. What is to be known of a stage is in its own record.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// What came out.
    pub candidates: Vec<CandidateRecord>,
    /// Candidates that could not be computed, and why; not there where all could.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<FailedRecord>,
    /// How far the skins of each two candidates are apart; not there where there is one candidate, or too many.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub surface_differences: Vec<SurfaceDifference>,
}

/// A part of the candidates, `--shard` on the command line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartRecord {
    /// Which, from 1.
    pub number: u32,
    /// How many there are.
    pub of: u32,
    /// How many candidates the plan has in all parts.
    pub candidates: usize,
    /// The candidates of this part by their names, those that failed among them, each with its place in the plan from 0.
    pub places: BTreeMap<String, usize>,
}

/// A candidate that could not be computed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FailedRecord {
    /// Its name.
    pub candidate: String,
    /// Why.
    pub error: String,
}

/// This program.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Program {
    /// `rhinoplan`.
    pub name: &'static str,
    /// Its version.
    pub version: &'static str,
}

impl Program {
    /// This program, as it was built.
    pub const THIS: Self = Self {
        name: env!("CARGO_PKG_NAME"),
        version: env!("CARGO_PKG_VERSION"),
    };
}

/// The files that went into a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inputs {
    /// SHA-256 of the plan file's bytes, hexadecimal.
    pub plan_sha256: String,
    /// SHA-256 of the bytes of the file that gives the landmarks, hexadecimal; not there where the plan
    /// itself does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub landmarks_sha256: Option<String>,
    /// The CT.
    pub ct: CtRecord,
}

/// The CT that a run read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CtRecord {
    /// `nifti`, `nrrd`, `dicom`, or `phantom` with its name.
    pub source: &'static str,
    /// The built-in phantom's name.
    pub phantom: Option<&'static str>,
    /// SHA-256 of the file's bytes; of a series, as [`crate::io::dicom::Series::read`] makes it; of a
    /// phantom's samples, little endian, x fastest. Hexadecimal.
    pub sha256: String,
    /// The type that samples are stored in.
    pub sample_type: SampleType,
    /// HU for each stored step.
    pub slope: f64,
    /// HU of a stored zero.
    pub intercept: f64,
    /// How the file stores its axes, as nibabel names it; a series' are columns, rows and slices, a phantom
    /// is in LPS order.
    pub stored_orientation: String,
    /// Size, spacing, position, in LPS order, mm.
    pub grid: Grid,
    /// Smallest and largest sample, HU.
    pub hu_range: [f64; 2],
}

/// The plan as it ran. Positions are in grid millimetres: index × spacing per axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs, reason = "the plan's own fields")]
pub struct PlanRecord {
    pub name: String,
    pub title: Option<String>,
    pub landmarks_mm: Landmarks<GridPoint>,
    pub landmarks_voxel: Landmarks<ContinuousIndex>,
    /// Not there where the plan asks for no landmark to be moved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub snap: Option<SnapRecord>,
    pub cage_mm: Cage,
    pub cage_depth_mm: f64,
    pub f1_mm: FeatureLine,
    pub enhance: Enhance,
    pub segment: SegmentRecord,
    pub morph: Morph,
    pub outputs: Outputs,
    pub views: Option<Views>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshSettings>,
    /// Not there where the plan sets no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accept: Option<Accept>,
}

/// Landmarks that were moved onto the skin. The plan's other positions are those after that.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SnapRecord {
    /// The plan's limit, mm.
    pub mm: f64,
    /// The landmarks that were moved.
    pub moved: Vec<SnappedLandmark>,
}

/// A landmark that was moved onto the skin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SnappedLandmark {
    /// Its name in the plan.
    pub name: &'static str,
    /// Where the plan puts it, voxels in LPS order.
    pub from_voxel: ContinuousIndex,
    /// Where it was moved to.
    pub to_voxel: ContinuousIndex,
    /// From the one to the other, mm.
    pub distance_mm: f64,
}

/// What was tissue and what was bone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SegmentRecord {
    /// Tissue began here, HU.
    pub skin_hu: f64,
    /// Where that is from.
    pub skin_hu_from: ThresholdSource,
    /// Bone began here, HU.
    pub bone_hu: f64,
    /// Whether only the largest connected piece of an object was drawn.
    pub keep_largest: bool,
}

/// Where a threshold is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ThresholdSource {
    /// The plan gives it.
    Plan,
    /// Otsu's method found it in the CT.
    Otsu,
}

impl SegmentRecord {
    fn new(segment: &Segment, skin_hu: f64) -> Self {
        Self {
            skin_hu,
            skin_hu_from: match segment.skin_hu {
                SkinThreshold::Hu(_) => ThresholdSource::Plan,
                SkinThreshold::Otsu => ThresholdSource::Otsu,
            },
            bone_hu: segment.bone_hu,
            keep_largest: segment.keep_largest,
        }
    }
}

impl PlanRecord {
    /// What `plan` says, on the grid it was resolved for, with the skin threshold that the run used and the
    /// landmarks that it moved.
    pub fn new(plan: &Plan, skin_hu: f64, grid: &Grid, snap: Option<SnapRecord>) -> Self {
        Self {
            name: plan.name.clone(),
            title: plan.title.clone(),
            landmarks_mm: plan.landmarks,
            landmarks_voxel: plan.landmarks.map(|point| grid.grid_to_index(point)),
            snap,
            cage_mm: Cage::new(&plan.landmarks, plan.cage_depth_mm),
            cage_depth_mm: plan.cage_depth_mm,
            f1_mm: plan.f1,
            enhance: plan.enhance,
            segment: SegmentRecord::new(&plan.segment, skin_hu),
            morph: plan.morph,
            outputs: plan.outputs,
            views: plan.views.clone(),
            mesh: plan.mesh,
            accept: plan.accept.clone(),
        }
    }
}

/// One candidate nose.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CandidateRecord {
    /// Its name in the plan.
    pub name: String,
    /// Its title in the plan, or what a sweep varied.
    pub title: Option<String>,
    /// The numbers that a sweep gave it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub swept: Vec<Swept>,
    /// The name of that sweep.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sweep: Option<String>,
    /// The nose as it is, then each stage.
    pub stages: Vec<StageRecord>,
    /// Whether the last stage keeps the limits of the plan, where it sets any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accept: Option<Verdict>,
}

impl RunRecord {
    /// Whether the run does what the plan's limits ask for: one candidate at least keeps them, or with
    /// `strict` every one. Without limits it does.
    pub fn is_accepted(&self, strict: bool) -> bool {
        let verdicts = self.candidates.iter().map(|candidate| &candidate.accept);
        let mut verdicts = verdicts
            .flatten()
            .map(|verdict| verdict.accepted)
            .peekable();
        if verdicts.peek().is_none() {
            return true;
        }
        if strict {
            verdicts.all(|accepted| accepted)
        } else {
            verdicts.any(|accepted| accepted)
        }
    }
}

/// The nose after a stage, or before the first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageRecord {
    /// [`PREOPERATIVE`], or the stage's name in the plan.
    pub name: String,
    /// What the stage does to f1; nothing before the first.
    pub operation: Option<OperationRecord>,
    /// What was measured.
    pub measures: Measures,
    /// How the map that made it behaves; the identity before the first stage.
    pub warp: WarpAudit,
    /// Whether the map is folded somewhere: its smallest Jacobian determinant is not positive.
    pub folded: bool,
    /// How far the adaptive evaluation is from the exact one, where the plan asks for it.
    pub adaptive_error: Option<FieldDifference>,
    /// How far the skin moved, where views are drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_change: Option<SurfaceChange>,
    /// The meshes, where they are written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub meshes: Option<MeshesRecord>,
    /// The bodies between the skin before the first stage and this one, where they are written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solids: Option<SolidsRecord>,
    /// How well the map was inverted, where its inverse is written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inverse: Option<InverseAudit>,
}

/// How far the skin that the views of a stage show lies from that before the first stage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfaceChange {
    /// The furthest inward, mm; at most 0.
    pub inward_max_mm: f64,
    /// The furthest outward, mm; at least 0.
    pub outward_max_mm: f64,
}

/// What a stage does.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OperationRecord {
    /// What of f1 was the feature.
    pub kind: FeatureKind,
    /// The edits, resolved to grid mm and degrees.
    pub edits: Vec<Edit>,
    /// f1 as the stage found it, grid mm.
    pub source_mm: FeatureLine,
    /// f1 as it leaves it, grid mm.
    pub target_mm: FeatureLine,
    /// Product of the width factors.
    pub width: f64,
}

/// The measures of method section 6.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Measures {
    /// Tissue of the regions A..K, mm³.
    pub volume_mm3: [f64; REGIONS],
    /// Their sum, mm³.
    pub volume_total_mm3: f64,
    /// Angle P2-P5-P1 at the tip, degrees.
    pub gamma_deg: f64,
    /// Distance from the tip to the base plane, mm.
    pub height_mm: f64,
    /// The tip (pronasale, the end of f1), voxels in LPS order.
    pub tip_voxel: ContinuousIndex,
    /// Movement of the tip since the stage before, voxels (the paper's V).
    pub move_voxel: [f64; 3],
    /// The same in grid mm.
    pub move_mm: GridVector,
}

impl StageRecord {
    /// Every measure by its name in `measurements.csv`, with its unit, in the order of that file.
    pub fn named_measures(&self) -> Vec<(String, f64, &'static str)> {
        named_measures(&self.measures, &self.warp)
    }
}

/// As [`StageRecord::named_measures`], of what a stage's record holds.
pub fn named_measures(measures: &Measures, warp: &WarpAudit) -> Vec<(String, f64, &'static str)> {
    let mut named: Vec<_> = REGION_NAMES
        .iter()
        .zip(measures.volume_mm3)
        .map(|(name, volume)| (format!("volume_{name}"), volume, "mm3"))
        .collect();
    let mut add = |name: &str, value: f64, unit| named.push((name.to_owned(), value, unit));
    add("volume_total", measures.volume_total_mm3, "mm3");
    add("gamma", measures.gamma_deg, "deg");
    add("height", measures.height_mm, "mm");
    for (axis, value) in ["x", "y", "z"].iter().zip(measures.tip_voxel.to_array()) {
        add(&format!("tip_{axis}"), value, "voxel");
    }
    for (axis, value) in ["x", "y", "z"].iter().zip(measures.move_voxel) {
        add(&format!("move_{axis}"), value, "voxel");
    }
    add("jacobian_min", warp.jacobian_min, "1");
    add("displacement_max", warp.displacement_max_mm, "mm");
    let outside = warp.displacement_max_outside_mm;
    add("displacement_max_outside", outside, "mm");
    named
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::MEASURES;

    #[test]
    fn limits_know_every_measure_by_its_name_and_unit() {
        let measures = Measures {
            volume_mm3: [1.0; REGIONS],
            volume_total_mm3: 11.0,
            gamma_deg: 70.0,
            height_mm: 20.0,
            tip_voxel: ContinuousIndex::new(1.0, 2.0, 3.0),
            move_voxel: [0.0; 3],
            move_mm: GridVector::new(0.0, 0.0, 0.0),
        };
        let named = named_measures(&measures, &WarpAudit::IDENTITY);
        let found: Vec<_> = named
            .iter()
            .map(|(name, _, unit)| (name.as_str(), *unit))
            .collect();
        assert_eq!(found, MEASURES.map(|measure| (measure.name, measure.unit)));
    }
}
