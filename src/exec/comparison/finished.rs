//! What a finished run left, read back: `run.json` of any place, which anyone may have written.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::error::CompareError;
use crate::compare::{Accept, SurfaceDifference, Swept};
use crate::exec::error::RunError;
use crate::exec::kept::Expected;
use crate::feature::Landmarks;
use crate::morph::audit::WarpAudit;
use crate::plan::MAX_CANDIDATES;
use crate::report::comparison::ComparedParts;
use crate::report::record::{self, FailedRecord, Measures, PREOPERATIVE, PartRecord};
use crate::space::GridPoint;
use crate::text::shown;

/// The record of a run in its folder.
pub(super) const RECORD: &str = "run.json";

/// The largest `run.json` that is read, bytes: the largest plan there can be (some nine thousand stages, at four
/// thousand bytes each) leaves less.
pub const MAX_RECORD_BYTES: u64 = 64 << 20;

/// The longest name, as in a plan.
const MAX_NAME: usize = 64;
/// The longest message of what is wrong with a record, characters.
const MAX_PROBLEM: usize = 300;
/// The longest reason why a candidate failed that is repeated, characters.
pub(super) const MAX_ERROR: usize = 1000;
/// The longest free text, characters: a title of a plan.
const MAX_TEXT: usize = 200;

/// What of a record is compared. What else it holds is not looked at, so that a later version may add to it.
#[derive(Debug, Clone, Deserialize)]
pub struct FinishedRun {
    pub(super) program: ProgramRead,
    pub(super) inputs: InputsRead,
    pub(super) plan: PlanRead,
    pub(super) part: Option<PartRecord>,
    pub(super) candidates: Vec<CandidateRead>,
    #[serde(default)]
    pub(super) failed: Vec<FailedRecord>,
    #[serde(default)]
    pub(super) surface_differences: Vec<SurfaceDifference>,
    /// The parts that it was joined from, where some are missing.
    #[serde(skip)]
    pub(super) parts: Option<ComparedParts>,
    /// Where it is, or its parts are.
    #[serde(skip)]
    pub(super) folders: Vec<PathBuf>,
}

/// Read first: what else a record of another layout holds may mean something else.
#[derive(Debug, Deserialize)]
struct Layout {
    format: u64,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct ProgramRead {
    pub version: String,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct InputsRead {
    plan_sha256: String,
    landmarks_sha256: Option<String>,
    pub ct: CtRead,
}

/// All that a record says of a CT, in the same order: notes have the digest of it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct CtRead {
    source: String,
    phantom: Option<String>,
    pub sha256: String,
    sample_type: String,
    slope: f64,
    intercept: f64,
    stored_orientation: String,
    pub grid: GridRead,
    hu_range: [f64; 2],
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct GridRead {
    pub dims: [usize; 3],
    pub spacing: [f64; 3],
    origin: [f64; 3],
    direction: [[f64; 3]; 3],
}

impl GridRead {
    /// Whether grid millimetres are the same.
    pub fn is_like(&self, other: &Self) -> bool {
        self.dims == other.dims && self.spacing == other.spacing
    }
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct PlanRead {
    pub name: String,
    pub title: Option<String>,
    pub landmarks_mm: Landmarks<GridPoint>,
    pub segment: SegmentRead,
    pub outputs: OutputsRead,
    pub views: Option<ViewsRead>,
    pub accept: Option<Accept>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct OutputsRead {
    pub charts: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(super) struct SegmentRead {
    pub skin_hu: f64,
    pub bone_hu: f64,
    pub keep_largest: bool,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct ViewsRead {
    pub cameras: Vec<CameraRead>,
}

#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub(super) struct CameraRead {
    pub name: String,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct CandidateRead {
    pub name: String,
    pub title: Option<String>,
    #[serde(default)]
    pub swept: Vec<Swept>,
    pub sweep: Option<String>,
    pub stages: Vec<StageRead>,
    pub accept: Option<VerdictRead>,
    /// Where its run is.
    #[serde(skip)]
    pub folder: PathBuf,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct StageRead {
    pub name: String,
    pub measures: Measures,
    pub warp: WarpAudit,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct VerdictRead {
    pub accepted: bool,
}

impl FinishedRun {
    /// What parts of one run have in common.
    pub(super) fn whole(&self) -> [String; 4] {
        let InputsRead {
            plan_sha256,
            landmarks_sha256,
            ct,
        } = &self.inputs;
        [
            self.plan.name.clone(),
            plan_sha256.clone(),
            landmarks_sha256.clone().unwrap_or_default(),
            ct.sha256.clone(),
        ]
    }

    /// Reads the record of the run in `folder`.
    ///
    /// # Errors
    /// [`CompareError`] where there is none, or it is not what this program writes.
    pub fn read(folder: &Path) -> Result<Self, CompareError> {
        let path = folder.join(RECORD);
        let no_record = |problem: String| CompareError::NoRecord {
            path: path.clone(),
            problem,
        };
        let unreadable = |source: io::Error| match source.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => CompareError::NoRun {
                path: folder.to_owned(),
            },
            _ => CompareError::Unreadable {
                path: path.clone(),
                source,
            },
        };
        // Asked before opening: opening a pipe would wait for someone to write to it.
        let metadata = fs::metadata(&path).map_err(unreadable)?;
        if !metadata.is_file() {
            return Err(no_record("it is no file".to_owned()));
        }
        let file = File::open(&path).map_err(unreadable)?;
        let mut bytes = Vec::new();
        let mut limited = file.take(MAX_RECORD_BYTES + 1);
        limited.read_to_end(&mut bytes).map_err(unreadable)?;
        if bytes.len() as u64 > MAX_RECORD_BYTES {
            return Err(no_record(format!(
                "it is larger than {MAX_RECORD_BYTES} bytes"
            )));
        }
        // What is wrong may repeat what is there, which may be long.
        let parsed = Self::parse(&bytes);
        let mut run = parsed.map_err(|problem| no_record(shown(&problem, MAX_PROBLEM)))?;
        for candidate in &mut run.candidates {
            candidate.folder = folder.to_owned();
        }
        run.folders = vec![folder.to_owned()];
        Ok(run)
    }

    /// How many candidates its plan has, in all parts.
    pub(super) fn planned(&self) -> usize {
        let here = self.candidates.len() + self.failed.len();
        self.part.as_ref().map_or(here, |part| part.candidates)
    }

    /// What its notes have to agree with.
    pub(super) fn expected(&self) -> Result<Expected, RunError> {
        let SegmentRead {
            skin_hu,
            bone_hu,
            keep_largest,
        } = self.plan.segment;
        let (ct, plan) = (&self.inputs.ct, &self.plan);
        let segment = (skin_hu, bone_hu, keep_largest);
        Expected::new(ct, &plan.name, &plan.landmarks_mm, segment)
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let layout: Layout = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
        if layout.format != u64::from(record::FORMAT) {
            return Err(format!(
                "it is of layout {}; this version of rhinoplan reads {}",
                layout.format,
                record::FORMAT
            ));
        }
        let run: Self = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
        run.check()?;
        Ok(run)
    }

    /// Names and texts become part of tables, and pairs have to be of candidates.
    fn check(&self) -> Result<(), String> {
        let text = |text: &str, what: &str| {
            let sound = text.chars().count() <= MAX_TEXT && !text.chars().any(char::is_control);
            let problem = || {
                format!("{what} is longer than {MAX_TEXT} characters or holds control characters")
            };
            if sound { Ok(()) } else { Err(problem()) }
        };
        let name = |name: &str, what: &str| {
            let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
            let sound = !name.is_empty()
                && name.len() <= MAX_NAME
                && !name.starts_with('-')
                && name.chars().all(allowed);
            if sound {
                Ok(())
            } else {
                Err(format!("{what} is none that a plan can have"))
            }
        };
        text(&self.program.version, "the program's version")?;
        text(&self.inputs.ct.sha256, "the SHA-256 of the CT")?;
        name(&self.plan.name, "the plan's name")?;
        text(
            self.plan.title.as_deref().unwrap_or_default(),
            "the plan's title",
        )?;
        text(&self.inputs.plan_sha256, "the SHA-256 of the plan")?;
        let cameras = self.plan.views.iter().flat_map(|views| &views.cameras);
        for camera in cameras {
            text(&camera.name, "a camera's name")?;
        }
        let mut names = HashSet::new();
        for candidate in &self.candidates {
            name(&candidate.name, "a candidate's name")?;
            text(
                candidate.title.as_deref().unwrap_or_default(),
                "a candidate's title",
            )?;
            if !names.insert(candidate.name.as_str()) {
                return Err(format!("two candidates have the name `{}`", candidate.name));
            }
            if let Some(sweep) = &candidate.sweep {
                name(sweep, "a sweep's name")?;
            }
            for swept in &candidate.swept {
                name(&swept.stage, "a swept stage's name")?;
                let allowed = |c: char| c.is_ascii_lowercase() || c == '_' || c == ' ';
                if swept.edit.len() > MAX_NAME || !swept.edit.chars().all(allowed) {
                    return Err("a swept edit's name is none that a plan can have".to_owned());
                }
            }
            for stage in &candidate.stages {
                name(&stage.name, "a stage's name")?;
            }
            let first = candidate.stages.first().map(|stage| stage.name.as_str());
            if first != Some(PREOPERATIVE) || candidate.stages.len() < 2 {
                return Err(format!(
                    "candidate `{}` has no stage, or does not begin with the nose as it is",
                    candidate.name
                ));
            }
        }
        let is_known = |pair: &SurfaceDifference| {
            pair.candidates
                .iter()
                .all(|name| names.contains(name.as_str()))
        };
        if !self.surface_differences.iter().all(is_known) {
            return Err("it has the distance between candidates that are not there".to_owned());
        }
        for failed in &self.failed {
            name(&failed.candidate, "a failed candidate's name")?;
            if !names.insert(failed.candidate.as_str()) {
                return Err(format!("candidate `{}` is there twice", failed.candidate));
            }
        }
        self.part
            .as_ref()
            .map_or(Ok(()), |part| check_part(part, &names))
    }
}

/// A part has a place for each of its candidates, and they are in the plan.
fn check_part(part: &PartRecord, names: &HashSet<&str>) -> Result<(), String> {
    let numbered = (1..=part.of).contains(&part.number);
    let placed = part.places.len() == names.len()
        && part.places.keys().all(|name| names.contains(name.as_str()))
        && part.places.values().all(|&place| place < part.candidates);
    if numbered && placed && part.candidates <= MAX_CANDIDATES {
        Ok(())
    } else {
        Err(
            "it does not say which part of the plan it is, or which candidates are in it"
                .to_owned(),
        )
    }
}
