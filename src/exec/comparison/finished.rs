//! What finished runs left, read back: `run.json` of any place, which anyone may have written.

use std::collections::{BTreeMap, HashSet};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use thiserror::Error;

use super::parts::{Joined, join};
use super::{find_sweeps, tip_move};
use crate::compare::{Accept, Change, SurfaceDifference, Swept};
use crate::exec::error::{ExitCode, RunError};
use crate::feature::{Landmark, Landmarks};
use crate::io::artifact::ArtifactError;
use crate::morph::audit::WarpAudit;
use crate::plan::MAX_CANDIDATES;
use crate::report::comparison::{
    ComparedCandidate, ComparedParts, ComparedRun, ComparisonRecord, FORMAT,
};
use crate::report::record::{
    self, FailedRecord, Measures, PREOPERATIVE, PartRecord, Program, named_measures,
};
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

/// Why runs cannot be compared.
#[derive(Debug, Error)]
pub enum CompareError {
    /// There is no record.
    #[error("there is no finished run in `{}`: it has no run.json; give the folder of a plan, as `out/<plan>`", path.display())]
    NoRun {
        /// The folder given.
        path: PathBuf,
    },
    /// The record cannot be read.
    #[error("cannot read `{}`: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// It is a pipe, a device, or far larger than any record.
    #[error("`{}` is no record of a run: {problem}", path.display())]
    NoRecord {
        /// The file.
        path: PathBuf,
        /// What it is instead.
        problem: String,
    },
    /// A folder is given twice.
    #[error("`{}` and `{}` are the same folder", first.display(), second.display())]
    Twice {
        /// One of them.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// One candidate or none.
    #[error(
        "there are not two candidates to compare; give the folders of several runs, or of one with several"
    )]
    TooFew,
    /// Parts of a plan that do not make one run.
    #[error("the parts of `{plan}` cannot be joined: {problem}")]
    Parts {
        /// The plan's name.
        plan: String,
        /// Why.
        problem: String,
    },
    /// The folder to write into is a run's.
    #[error("`{}` is the folder of a run, which holds its own comparison; choose another with --out", path.display())]
    OfARun {
        /// The folder.
        path: PathBuf,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Artifact(#[from] ArtifactError),
    /// A table cannot be made.
    #[error(transparent)]
    Tables(Box<RunError>),
}

impl CompareError {
    /// What the process ends with.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::NoRun { .. } | Self::Unreadable { .. } | Self::NoRecord { .. } => ExitCode::Input,
            Self::Twice { .. }
            | Self::TooFew
            | Self::Parts { .. }
            | Self::OfARun { .. }
            | Self::Artifact(_) => ExitCode::Usage,
            Self::Tables(error) => error.exit_code(),
        }
    }
}

/// What of a record is compared. What else it holds is not looked at, so that a later version may add to it.
#[derive(Debug, Clone, Deserialize)]
pub struct FinishedRun {
    pub(super) program: ProgramRead,
    inputs: InputsRead,
    pub(super) plan: PlanRead,
    pub(super) part: Option<PartRecord>,
    pub(super) candidates: Vec<CandidateRead>,
    #[serde(default)]
    pub(super) failed: Vec<FailedRecord>,
    #[serde(default)]
    pub(super) surface_differences: Vec<SurfaceDifference>,
    /// The parts that it was joined from.
    #[serde(skip)]
    pub(super) parts: Option<ComparedParts>,
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
struct InputsRead {
    plan_sha256: String,
    landmarks_sha256: Option<String>,
    ct: CtRead,
}

#[derive(Debug, Clone, Deserialize)]
struct CtRead {
    sha256: String,
    grid: GridRead,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct GridRead {
    dims: [u64; 3],
    spacing: [f64; 3],
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct PlanRead {
    pub name: String,
    title: Option<String>,
    landmarks_mm: Landmarks<GridPoint>,
    segment: SegmentRead,
    outputs: OutputsRead,
    accept: Option<Accept>,
}

#[derive(Debug, Clone, Deserialize)]
struct OutputsRead {
    charts: bool,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct SegmentRead {
    skin_hu: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct CandidateRead {
    pub name: String,
    title: Option<String>,
    #[serde(default)]
    swept: Vec<Swept>,
    sweep: Option<String>,
    stages: Vec<StageRead>,
    accept: Option<VerdictRead>,
}

#[derive(Debug, Clone, Deserialize)]
struct StageRead {
    name: String,
    measures: Measures,
    warp: WarpAudit,
}

#[derive(Debug, Clone, Deserialize)]
struct VerdictRead {
    accepted: bool,
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
        Self::parse(&bytes).map_err(|problem| no_record(shown(&problem, MAX_PROBLEM)))
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

/// A comparison of finished runs, and whether one that was swept asks for charts.
pub(super) struct Comparison {
    pub record: ComparisonRecord,
    pub charts: bool,
}

/// The candidates of finished runs, compared.
pub(super) fn comparison(folders: &[PathBuf]) -> Result<Comparison, CompareError> {
    let mut given: BTreeMap<PathBuf, &PathBuf> = BTreeMap::new();
    let mut runs = Vec::with_capacity(folders.len());
    for folder in folders {
        runs.push(FinishedRun::read(folder)?);
        if let Ok(canonical) = folder.canonicalize()
            && let Some(first) = given.insert(canonical, folder)
        {
            return Err(CompareError::Twice {
                first: first.clone(),
                second: folder.clone(),
            });
        }
    }
    let candidates: usize = runs.iter().map(|run| run.candidates.len()).sum();
    if candidates < 2 {
        return Err(CompareError::TooFew);
    }
    let Joined {
        runs,
        warnings: of_parts,
    } = join(runs)?;
    let mut record = of_runs(&runs);
    record.warnings.splice(0..0, of_parts);
    let charts = runs.iter().any(|run| run.plan.outputs.charts);
    Ok(Comparison { record, charts })
}

/// The names of runs: those of their plans, numbered where several have the same.
fn names(runs: &[FinishedRun]) -> Vec<String> {
    let name = |run: &FinishedRun| run.plan.name.clone();
    let numbered = runs.iter().enumerate().map(|(place, run)| {
        let same = |other: &&FinishedRun| name(other) == name(run);
        if runs.iter().filter(same).count() == 1 {
            return name(run);
        }
        let before = runs.iter().take(place).filter(same).count();
        format!("{}#{}", name(run), before + 1)
    });
    numbered.collect()
}

fn of_runs(runs: &[FinishedRun]) -> ComparisonRecord {
    let names = names(runs);
    let mut candidates: Vec<ComparedCandidate> = Vec::new();
    let (mut failed, mut sweeps) = (Vec::new(), Vec::new());
    let mut surface_differences = Vec::new();
    for (run, run_name) in runs.iter().zip(&names) {
        // Names of candidates have no slash.
        let full = |name: &str| match runs.len() {
            1 => name.to_owned(),
            _ => format!("{run_name}/{name}"),
        };
        let begin = candidates.len();
        candidates.extend(run.candidates.iter().filter_map(|candidate| {
            let (first, last) = (candidate.stages.first()?, candidate.stages.last()?);
            let named = |stage: &StageRead| named_measures(&stage.measures, &stage.warp);
            let moves = candidate.stages.iter().map(|stage| stage.measures.move_mm);
            Some(ComparedCandidate {
                name: full(&candidate.name),
                title: candidate.title.clone(),
                stage: last.name.clone(),
                accepted: candidate.accept.as_ref().map(|verdict| verdict.accepted),
                swept: candidate.swept.clone(),
                sweep: candidate.sweep.clone(),
                tip_move_mm: tip_move(moves),
                measures: Change::list(named(first), named(last)),
            })
        }));
        let added = candidates.get(begin..).unwrap_or_default();
        sweeps.extend(find_sweeps(run_name, added));
        failed.extend(run.failed.iter().map(|of| FailedRecord {
            candidate: full(&of.candidate),
            error: shown(&of.error, MAX_ERROR),
        }));
        let pairs = run
            .surface_differences
            .iter()
            .map(|pair| SurfaceDifference {
                candidates: pair.candidates.each_ref().map(|name| full(name)),
                ..pair.clone()
            });
        surface_differences.extend(pairs);
    }
    let compared = runs.iter().zip(&names).map(|(run, name)| ComparedRun {
        name: name.clone(),
        title: run.plan.title.clone(),
        version: run.program.version.clone(),
        ct_sha256: run.inputs.ct.sha256.clone(),
        parts: run.parts.clone(),
        accept: run.plan.accept.clone(),
    });
    ComparisonRecord {
        format: FORMAT,
        program: Program::THIS,
        runs: compared.collect(),
        warnings: warnings(runs, &names),
        candidates,
        failed,
        sweeps,
        surface_differences,
    }
}

/// What differs between the runs besides their candidates. Changes are those of each run from its own start, so
/// that none of it is an error.
fn warnings(runs: &[FinishedRun], names: &[String]) -> Vec<String> {
    let Some((first, others)) = runs.split_first() else {
        return Vec::new();
    };
    let mut warnings = Vec::new();
    let mut tell = |what: &str, differs: &dyn Fn(&FinishedRun) -> bool| {
        let others = others.iter().zip(names.iter().skip(1));
        let differing: Vec<String> = others
            .filter(|(run, _)| differs(run))
            .map(|(_, name)| format!("`{name}`"))
            .collect();
        if let (false, Some(name)) = (differing.is_empty(), names.first()) {
            warnings.push(format!(
                "{what} of {} differ from those of `{name}`",
                differing.join(", ")
            ));
        }
    };
    let ct = |run: &FinishedRun| run.inputs.ct.sha256.clone();
    tell("the voxels of the CT", &|run| ct(run) != ct(first));
    tell("the size or the spacing of the grid", &|run| {
        run.inputs.ct.grid != first.inputs.ct.grid
    });
    tell("the landmarks, and so the regions", &|run| {
        let apart = |landmark: Landmark| {
            let of = |run: &FinishedRun| run.plan.landmarks_mm.get(landmark).0;
            (of(run) - of(first)).length() > 1e-6
        };
        Landmark::ALL.into_iter().any(apart)
    });
    tell("the skin thresholds", &|run| {
        run.plan.segment != first.plan.segment
    });
    tell("the versions of the program", &|run| {
        run.program.version != first.program.version
    });
    warnings
}
