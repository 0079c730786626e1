//! Results of earlier runs that still hold, and what a result depends on.
//!
//! A stage is computed again only where something that can change it did: the CT, what the plan says of it, the
//! stages before it, or how this program computes. Names of files, the place of folders, titles, limits and
//! the order of keys change nothing. Beside its results a run leaves a note on each stage: its key, what was
//! measured, and the SHA-256 of its files. A note that was altered, or whose files were, counts for nothing.

mod left;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::comparison::Skins;
use super::error::RunError;
use super::pictures::nose_of_all;
use super::run::{numbered, stage_folder};
use super::steps::Step;
use super::surfaces;
use crate::compare::SurfaceDifference;
use crate::feature::{Cage, FeatureLine};
use crate::io::artifact::ArtifactError;
use crate::io::digest::sha256_hex;
use crate::io::staging::{Earlier, Found, Lost, Staging};
use crate::morph::audit::{FieldDifference, WarpAudit};
use crate::morph::inverse::InverseAudit;
use crate::plan::{Candidate, Plan};
use crate::report::meshes::{MeshesRecord, SolidsRecord};
use crate::report::record::{CtRecord, Measures, OperationRecord, StageRecord, SurfaceChange};
use crate::space::GridPoint;
use crate::surface::SeenSkin;
pub(super) use left::{Expected, Lacks, Left};

/// The version of what this program computes and draws. It goes up with every change of a number or a file, so that
/// no result of another version is kept.
pub const NUMERIC_VERSION: u32 = 4;

/// Parts of a key that notes of finished runs are held against.
const VERSION: &str = "the program's version";
const CT: &str = "the CT";
const NAME: &str = "the plan's name";
const LANDMARKS: &str = "[landmarks]";
const SEGMENT: &str = "[segment]";
const ENHANCE: &str = "[enhance]";
const VIEWS: &str = "[views]";

/// What a result depends on, by the part of the plan that it is in, each as its BLAKE3.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Key(BTreeMap<String, String>);

impl Key {
    /// What every result of a run depends on.
    fn of_run(plan: &Plan, skin_hu: f64, ct: &CtRecord) -> Result<Self, RunError> {
        let mut key = Self::default();
        key.part(VERSION, &NUMERIC_VERSION)?;
        key.part(CT, ct)?;
        key.part(NAME, &plan.name)?;
        key.part(LANDMARKS, &plan.landmarks)?;
        key.part("[cage]", &Cage::new(&plan.landmarks, plan.cage_depth_mm))?;
        key.part("[f1]", &plan.f1)?;
        key.part(ENHANCE, &plan.enhance)?;
        let segment = &plan.segment;
        key.part(SEGMENT, &(skin_hu, segment.bone_hu, segment.keep_largest))?;
        key.part("[morph]", &plan.morph)?;
        key.part("[outputs]", &plan.outputs)?;
        key.part(VIEWS, &plan.views)?;
        key.part("[mesh]", &plan.mesh)?;
        if plan.outputs.views || plan.outputs.slices {
            // Every picture shows the noses of all candidates in one frame.
            key.part("the box around all noses", &nose_of_all(plan))?;
        }
        Ok(key)
    }

    fn part(&mut self, name: &str, what: &impl Serialize) -> Result<(), RunError> {
        let text = serde_json::to_vec(what)?;
        let digest = blake3::hash(&text).to_hex().to_string();
        self.0.insert(name.to_owned(), digest);
        Ok(())
    }

    /// The parts that differ, in the order of their names.
    fn differs_from(&self, other: &Self) -> Vec<String> {
        let names = self.0.keys().chain(other.0.keys());
        let differs = |name: &&String| self.0.get(*name) != other.0.get(*name);
        let mut differing: Vec<String> = names.filter(differs).cloned().collect();
        differing.sort();
        differing.dedup();
        differing
    }
}

/// The keys of a run.
#[derive(Debug)]
pub(super) struct Keys {
    pub start: Key,
    /// For each candidate of the plan, for each stage.
    pub stages: Vec<Vec<Key>>,
    pub joint: Key,
    /// What the skins of candidates depend on beside that: the box that they are compared in, and how they are written.
    /// None where they are not compared.
    pub skins: Option<String>,
}

impl Keys {
    /// Those of a plan, of which the candidates at these places run.
    pub(super) fn new(
        plan: &Plan,
        skin_hu: f64,
        ct: &CtRecord,
        selected: &[usize],
    ) -> Result<Self, RunError> {
        let run = Key::of_run(plan, skin_hu, ct)?;
        let mut start = run.clone();
        start.part(
            "whether candidates are compared",
            &(plan.candidates.len() > 1),
        )?;
        let candidates = plan.candidates.iter();
        let stages = candidates
            .map(|candidate| Self::of_candidate(plan, candidate, &run))
            .collect::<Result<Vec<_>, _>>()?;
        let skins = if Skins::are_wanted(plan) {
            let text = serde_json::to_vec(&(SeenSkin::FORMAT, nose_of_all(plan)))?;
            Some(blake3::hash(&text).to_hex().to_string())
        } else {
            None
        };
        let mut joint = start.clone();
        joint.part("the box that skins are compared in", &skins)?;
        let chosen = selected
            .iter()
            .filter_map(|&place| Some((plan.candidates.get(place)?, stages.get(place)?)));
        let titles: Vec<_> = chosen
            .clone()
            .map(|(of, _)| (&of.name, &of.title))
            .collect();
        joint.part("titles and names", &(&plan.title, titles))?;
        let stages_of_all: Vec<_> = chosen.map(|(_, keys)| keys).collect();
        joint.part("the candidates", &stages_of_all)?;
        let swept = plan.candidates.iter().map(|of| (&of.sweep, &of.swept));
        let swept: Vec<_> = swept.filter(|(sweep, _)| sweep.is_some()).collect();
        if plan.outputs.charts && !swept.is_empty() {
            // Plots of sweeps say what was swept and show the limits.
            joint.part("[[sweep]] and [accept]", &(swept, &plan.accept))?;
        }
        Ok(Self {
            start,
            stages,
            joint,
            skins,
        })
    }

    fn of_candidate(plan: &Plan, candidate: &Candidate, run: &Key) -> Result<Vec<Key>, RunError> {
        let mut keys = Vec::with_capacity(candidate.stages.len());
        let mut before = Vec::new();
        for (place, stage) in candidate.stages.iter().enumerate() {
            let mut key = run.clone();
            let lines: [FeatureLine; 2] = [stage.source, stage.target];
            let own = (stage.kind, &stage.edits, lines, stage.width);
            key.part("the stages before", &before)?;
            key.part("its edits", &own)?;
            key.part("its names", &(&candidate.name, &stage.name))?;
            let is_last = place + 1 == candidate.stages.len();
            let on_sheet = is_last && plan.outputs.views && plan.candidates.len() > 1;
            key.part("whether it is on a contact sheet", &on_sheet)?;
            keys.push(key);
            before.push(serde_json::to_value(own)?);
        }
        Ok(keys)
    }
}

/// Why something is computed, or is not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "because")]
pub enum Because {
    /// It is kept: nothing that it depends on changed.
    Unchanged,
    /// `--force` was given.
    Forced,
    /// No earlier run left it here.
    New,
    /// Something that it depends on changed.
    Changed {
        /// What, as in "the CT" or "\[morph\]".
        parts: Vec<String>,
    },
    /// A file of it is gone.
    Missing {
        /// Its name in the folder.
        file: String,
    },
    /// A file of it is not what was written.
    Altered {
        /// Its name in the folder.
        file: String,
    },
    /// Something else that is computed needs it.
    Needed,
}

impl std::fmt::Display for Because {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unchanged => to.write_str("kept: nothing changed"),
            Self::Forced => to.write_str("runs: --force"),
            Self::New => to.write_str("runs: no earlier result"),
            Self::Changed { parts } => write!(to, "runs: changed: {}", parts.join(", ")),
            Self::Missing { file } => write!(to, "runs: `{file}` is gone"),
            Self::Altered { file } => write!(to, "runs: `{file}` was altered"),
            Self::Needed => to.write_str("runs: what else runs needs it"),
        }
    }
}

/// What is kept of a stage beside its files, or of the nose as it is.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct StageNote {
    pub measures: Measures,
    pub warp: WarpAudit,
    pub folded: bool,
    pub adaptive_error: Option<FieldDifference>,
    pub surface_change: Option<SurfaceChange>,
    pub meshes: Option<MeshesRecord>,
    pub solids: Option<SolidsRecord>,
    pub inverse: Option<InverseAudit>,
    pub warnings: Vec<String>,
    /// The skin in the midplane, where charts are drawn.
    pub profile: Option<Vec<GridPoint>>,
    /// What the skin beside the note depends on, [`Keys::skins`], where there is one.
    pub skin: Option<String>,
}

impl StageNote {
    /// Of a nose that nothing was done to.
    pub(super) fn unmoved(measures: Measures) -> Self {
        Self {
            measures,
            warp: WarpAudit::IDENTITY,
            folded: false,
            adaptive_error: None,
            surface_change: None,
            meshes: None,
            solids: None,
            inverse: None,
            warnings: Vec::new(),
            profile: None,
            skin: None,
        }
    }

    /// The record of the stage.
    pub(super) fn record(&self, name: &str, operation: Option<OperationRecord>) -> StageRecord {
        StageRecord {
            name: name.to_owned(),
            operation,
            measures: self.measures,
            warp: self.warp,
            folded: self.folded,
            adaptive_error: self.adaptive_error,
            surface_change: self.surface_change,
            meshes: self.meshes,
            solids: self.solids,
            inverse: self.inverse,
        }
    }
}

/// What is kept of what compares candidates.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct JointNote {
    pub surface_differences: Vec<SurfaceDifference>,
}

/// A note as it is written.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Note<N> {
    key: Key,
    found: N,
    /// Names and SHA-256.
    files: Vec<(String, String)>,
    /// Hidden files beside the note: the same.
    beside: Vec<(String, String)>,
}

/// A result of an earlier run that holds.
#[derive(Debug)]
pub(super) struct Hit<N> {
    note: Note<N>,
    name: PathBuf,
    files: Vec<Found>,
}

/// What is kept beside the note on the last stage: its skin, and its pictures on the contact sheet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Beside {
    Skin,
    Tiles,
}

impl Beside {
    const fn ending(self) -> &'static str {
        match self {
            Self::Skin => "skin",
            Self::Tiles => "png",
        }
    }

    fn of(self, note: &Path) -> PathBuf {
        note.with_extension(self.ending())
    }
}

/// The note on the nose as it is. No candidate's folder has its name.
pub(super) fn start_name() -> PathBuf {
    PathBuf::from("start.json")
}

pub(super) fn joint_name() -> PathBuf {
    PathBuf::from("joint.json")
}

pub(super) fn stage_name(candidate: &Candidate, place: usize) -> PathBuf {
    let stage = candidate.stages.get(place);
    let stage = stage.map_or("", |stage| stage.name.as_str());
    stage_name_of(&candidate.name, place, stage)
}

/// The name of the note on a stage, by the names in the plan and its place from 0.
fn stage_name_of(candidate: &str, place: usize, stage: &str) -> PathBuf {
    let mut name = numbered(place, stage);
    name.push_str(".json");
    Path::new(candidate).join(name)
}

/// Looks for a result of an earlier run.
pub(super) fn look<N: DeserializeOwned>(
    earlier: &Earlier,
    name: PathBuf,
    key: &Key,
    force: bool,
) -> Result<Hit<N>, Because> {
    if force {
        return Err(Because::Forced);
    }
    let mut because = Because::New;
    for bytes in earlier.notes(&name) {
        let Some(note) = parse::<N>(&bytes) else {
            continue;
        };
        let parts = note.key.differs_from(key);
        if !parts.is_empty() {
            because = Because::Changed { parts };
            continue;
        }
        match files_of(&note, &name, earlier) {
            Ok(files) => return Ok(Hit { note, name, files }),
            Err(lost) => because = lost,
        }
    }
    Err(because)
}

fn files_of<N>(note: &Note<N>, name: &Path, earlier: &Earlier) -> Result<Vec<Found>, Because> {
    for (beside, sha256) in &note.beside {
        if beside_of(name, beside, sha256, earlier).is_none() {
            return Err(Because::Missing {
                file: beside.clone(),
            });
        }
    }
    let files = note.files.iter().map(|(file, sha256)| {
        earlier.find(file, sha256).map_err(|lost| {
            let file = file.clone();
            match lost {
                Lost::Missing => Because::Missing { file },
                Lost::Altered => Because::Altered { file },
            }
        })
    });
    files.collect()
}

/// A file beside a note, of this name and content.
fn beside_of(note: &Path, name: &str, sha256: &str, earlier: &Earlier) -> Option<Vec<u8>> {
    let kinds = [Beside::Skin, Beside::Tiles];
    let kind = kinds.into_iter().find(|kind| name == kind.ending())?;
    let mut notes = earlier.notes(&kind.of(note)).into_iter();
    notes.find(|bytes| sha256_hex(bytes) == sha256)
}

/// The note in a file, as it was sealed.
fn parse<N: DeserializeOwned>(bytes: &[u8]) -> Option<Note<N>> {
    let (digest, text) = bytes.split_at_checked(64)?;
    let text = text.strip_prefix(b"\n")?;
    if blake3::hash(text).to_hex().as_bytes() != digest {
        return None;
    }
    serde_json::from_slice(text).ok()
}

impl Hit<StageNote> {
    /// The note with another skin.
    pub(super) fn with_skin(
        &self,
        staging: &Staging,
        skin: &[u8],
        depends_on: Option<String>,
    ) -> Result<(), RunError> {
        let tiles = Beside::Tiles.ending();
        let tiles = match self.note.beside.iter().any(|(name, _)| name == tiles) {
            true => Some(read_beside(staging, &self.name, Beside::Tiles)?),
            false => None,
        };
        let mut beside = vec![(Beside::Skin, skin)];
        beside.extend(tiles.iter().map(|bytes| (Beside::Tiles, &bytes[..])));
        let found = StageNote {
            skin: depends_on,
            ..self.note.found.clone()
        };
        let (key, files) = (&self.note.key, self.note.files.clone());
        note(staging, &self.name, key, &found, files, &beside)
    }
}

impl<N: Serialize> Hit<N> {
    /// What was noted.
    pub(super) fn found(&self) -> &N {
        &self.note.found
    }

    /// Makes the files and the note those of this run.
    fn keep(&self, earlier: &Earlier, staging: &Staging) -> Result<(), RunError> {
        for ((name, sha256), found) in self.note.files.iter().zip(&self.files) {
            staging.keep(name, sha256, found)?;
        }
        for (beside, sha256) in &self.note.beside {
            if let Some(bytes) = beside_of(&self.name, beside, sha256, earlier) {
                let name = self.name.with_extension(beside);
                write(staging, &name, &bytes)?;
            }
        }
        let text = serde_json::to_vec(&self.note)?;
        Ok(write(staging, &self.name, &sealed(&text))?)
    }
}

/// Notes a result, the files of which are written. Where there is no room for the note, the result is as good, and
/// the next run computes it again.
pub(super) fn note<N: Serialize>(
    staging: &Staging,
    name: &Path,
    key: &Key,
    found: &N,
    files: Vec<(String, String)>,
    beside: &[(Beside, &[u8])],
) -> Result<(), RunError> {
    let mut listed = Vec::new();
    for (kind, bytes) in beside {
        if write(staging, &kind.of(name), bytes).is_err() {
            return Ok(());
        }
        listed.push((kind.ending().to_owned(), sha256_hex(bytes)));
    }
    let note = Note {
        key: key.clone(),
        found,
        files,
        beside: listed,
    };
    let text = serde_json::to_vec(&note)?;
    let _ = write(staging, name, &sealed(&text));
    Ok(())
}

/// A note as a file: its digest in the first line.
fn sealed(text: &[u8]) -> Vec<u8> {
    let mut bytes = blake3::hash(text).to_hex().as_bytes().to_vec();
    bytes.push(b'\n');
    bytes.extend(text);
    bytes
}

/// The disk is not waited for, as it is for results: a note that is cut short is no note.
fn write(staging: &Staging, name: &Path, bytes: &[u8]) -> Result<(), ArtifactError> {
    let path = staging.note(name)?;
    fs::write(&path, bytes).map_err(|source| {
        let action = "write";
        ArtifactError {
            path,
            action,
            source,
        }
    })
}

/// What this run has beside a note, computed or kept.
pub(super) fn read_beside(
    staging: &Staging,
    note: &Path,
    kind: Beside,
) -> Result<Vec<u8>, RunError> {
    let path = staging.note(&kind.of(note))?;
    fs::read(&path).map_err(|source| {
        let action = "read back";
        RunError::from(ArtifactError {
            path,
            action,
            source,
        })
    })
}

/// The stages of a candidate: what is kept of each, or why it is computed.
pub(super) type StagesOutlook = Vec<Result<Hit<StageNote>, Because>>;

/// What of a run is kept, and why the rest is computed.
#[derive(Debug)]
pub(super) struct Outlook {
    pub start: Result<Hit<StageNote>, Because>,
    /// For each candidate that runs, by its place in the plan, its stages.
    pub candidates: Vec<(usize, StagesOutlook)>,
    pub joint: Result<Hit<JointNote>, Because>,
}

impl Outlook {
    /// Of a plan, of which the candidates at these places run.
    pub(super) fn new(
        plan: &Plan,
        keys: &Keys,
        selected: &[usize],
        earlier: &Earlier,
        force: bool,
    ) -> Self {
        let candidates = selected.iter().filter_map(|&place| {
            let (candidate, keys) = (plan.candidates.get(place)?, keys.stages.get(place)?);
            let stages = keys
                .iter()
                .enumerate()
                .map(|(stage, key)| look(earlier, stage_name(candidate, stage), key, force));
            Some((place, stages.collect::<Vec<_>>()))
        });
        let candidates: Vec<_> = candidates.collect();
        let all_kept = |stages: &[Result<_, _>]| stages.iter().all(Result::is_ok);
        let nothing_runs = candidates.iter().all(|(_, stages)| all_kept(stages));
        let mut start = look(earlier, start_name(), &keys.start, force);
        let mut joint = look(earlier, joint_name(), &keys.joint, force);
        if !nothing_runs {
            start = start.and(Err(Because::Needed));
            joint = joint.and(Err(Because::Needed));
        }
        // Drawings of before and after need both.
        if start.is_err() && surfaces::wanted(plan) {
            joint = joint.and(Err(Because::Needed));
        }
        Self {
            start,
            candidates,
            joint,
        }
    }

    /// Whether the skins of all candidates are at hand, as the plan compares them.
    pub(super) fn has_skins(&self, keys: &Keys) -> bool {
        let of_last = |stages: &[Result<Hit<StageNote>, _>]| match stages.last() {
            Some(Ok(hit)) => hit.note.found.skin == keys.skins,
            _ => false,
        };
        self.candidates.iter().all(|(_, stages)| of_last(stages))
    }

    /// Makes what is kept that of this run, and removes the rest of what killed runs left.
    pub(super) fn keep(&self, earlier: &Earlier, staging: &Staging) -> Result<(), RunError> {
        if let Ok(start) = &self.start {
            start.keep(earlier, staging)?;
        }
        if let Ok(joint) = &self.joint {
            joint.keep(earlier, staging)?;
        }
        let stages = self.candidates.iter().flat_map(|(_, stages)| stages);
        for stage in stages.flatten() {
            stage.keep(earlier, staging)?;
        }
        staging.sweep();
        Ok(())
    }

    /// Why each step runs or not.
    pub(super) fn reasons(&self, plan: &Plan) -> Reasons {
        fn because<N>(found: &Result<Hit<N>, Because>) -> Because {
            match found {
                Ok(_) => Because::Unchanged,
                Err(because) => because.clone(),
            }
        }
        let mut stages = Vec::new();
        for (at, of_candidate) in &self.candidates {
            let Some(candidate) = plan.candidates.get(*at) else {
                continue;
            };
            for (stage, found) in candidate.stages.iter().zip(of_candidate) {
                stages.push(StageReason {
                    candidate: candidate.name.clone(),
                    stage: stage.name.clone(),
                    because: because(found),
                });
            }
        }
        Reasons {
            start: because(&self.start),
            stages,
            joint: because(&self.joint),
        }
    }
}

/// Why each step of a plan would run or not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Reasons {
    /// The nose as it is.
    pub start: Because,
    /// Each stage of each candidate.
    pub stages: Vec<StageReason>,
    /// What compares them.
    pub joint: Because,
}

/// Why a stage would run or not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct StageReason {
    /// The candidate's name.
    pub candidate: String,
    /// The stage's name.
    pub stage: String,
    /// Why.
    #[serde(flatten)]
    pub because: Because,
}

impl Reasons {
    /// Why a step would run or not; none of those that always run.
    pub fn of(&self, step: Step<'_>) -> Option<&Because> {
        match step {
            Step::Always => None,
            Step::Start => Some(&self.start),
            Step::Joint => Some(&self.joint),
            Step::Stage(at) => {
                let is_it =
                    |of: &&StageReason| of.candidate == at.candidate && of.stage == at.stage;
                self.stages.iter().find(is_it).map(|of| &of.because)
            }
        }
    }

    /// Where no earlier run left anything.
    pub(super) fn all_new(plan: &Plan, selected: &[usize]) -> Self {
        let chosen = selected.iter().filter_map(|&at| plan.candidates.get(at));
        let stages = chosen.flat_map(|candidate| {
            candidate.stages.iter().map(|stage| StageReason {
                candidate: candidate.name.clone(),
                stage: stage.name.clone(),
                because: Because::New,
            })
        });
        Self {
            start: Because::New,
            stages: stages.collect(),
            joint: Because::New,
        }
    }
}

/// The files of a stage's folder, read back.
pub(super) fn files_of_stage(
    staging: &Staging,
    candidate: &Candidate,
    place: usize,
) -> Result<Vec<(String, String)>, RunError> {
    Ok(staging.digest(&stage_folder(candidate, place))?)
}
