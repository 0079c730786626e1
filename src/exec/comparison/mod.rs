//! Candidates compared: those of one run at its end, and those of several finished runs.

mod finished;
mod skins;

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::error::RunError;
use crate::compare::Change;
use crate::io::artifact::{ArtifactError, save};
use crate::report::comparison::{
    ComparedCandidate, ComparedRun, ComparisonRecord, FORMAT, markdown, write_csv,
};
use crate::report::record::{CandidateRecord, Program, RunRecord};

pub use finished::{CompareError, FinishedRun, MAX_RECORD_BYTES};
pub use skins::{MARGIN_MM, MOST_COMPARED};
pub(super) use skins::{Skins, differences};

/// What became of every measure of a candidate from before its first stage to after its last.
pub(super) fn changes(candidate: &CandidateRecord) -> Vec<Change> {
    let (Some(first), Some(last)) = (candidate.stages.first(), candidate.stages.last()) else {
        return Vec::new();
    };
    Change::list(first.named_measures(), last.named_measures())
}

/// The candidates of a run, compared; none where there is only one.
pub fn of_run(record: &RunRecord) -> Option<ComparisonRecord> {
    if record.candidates.len() < 2 {
        return None;
    }
    let candidates = record.candidates.iter().map(|candidate| ComparedCandidate {
        name: candidate.name.clone(),
        title: candidate.title.clone(),
        stage: candidate
            .stages
            .last()
            .map_or(String::new(), |last| last.name.clone()),
        accepted: candidate.accept.as_ref().map(|verdict| verdict.accepted),
        measures: changes(candidate),
    });
    Some(ComparisonRecord {
        format: FORMAT,
        program: Program::THIS,
        runs: vec![ComparedRun {
            name: record.plan.name.clone(),
            title: record.plan.title.clone(),
            version: record.program.version.to_owned(),
            ct_sha256: record.inputs.ct.sha256.clone(),
        }],
        warnings: Vec::new(),
        candidates: candidates.collect(),
        surface_differences: record.surface_differences.clone(),
    })
}

/// The files of a comparison, by their names.
pub(super) fn files(
    comparison: &ComparisonRecord,
) -> Result<[(&'static str, Vec<u8>); 3], RunError> {
    let mut table = Vec::new();
    write_csv(&mut table, comparison)?;
    let mut json = serde_json::to_vec_pretty(comparison)?;
    json.push(b'\n');
    let text = markdown(comparison).into_bytes();
    Ok([
        ("compare.csv", table),
        ("compare.json", json),
        ("compare.md", text),
    ])
}

/// A comparison of finished runs, and where it is.
#[derive(Debug, Clone, Serialize)]
pub struct CompareReport {
    /// The files that were written.
    #[serde(serialize_with = "shown")]
    pub files: Vec<PathBuf>,
    /// What `compare.json` holds.
    pub comparison: ComparisonRecord,
}

/// Paths need not be Unicode, a document must be.
fn shown<S: serde::Serializer>(paths: &[PathBuf], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(paths.iter().map(|path| path.display().to_string()))
}

/// Compares the candidates of finished runs, given by their folders, and writes `compare.csv`, `compare.json` and
/// `compare.md` into `out`, each whole or not at all. What runs wrote is left alone.
///
/// # Errors
/// [`CompareError`], where a folder holds no finished run, or the files cannot be written.
pub fn compare(folders: &[PathBuf], out: &Path) -> Result<CompareReport, CompareError> {
    let comparison = finished::comparison(folders)?;
    if out.join(finished::RECORD).exists() {
        return Err(CompareError::OfARun {
            path: out.to_owned(),
        });
    }
    fs::create_dir_all(out).map_err(|source| ArtifactError {
        path: out.to_owned(),
        action: "create",
        source,
    })?;
    let mut written = Vec::new();
    let files = files(&comparison).map_err(|error| CompareError::Tables(Box::new(error)))?;
    for (name, bytes) in files {
        let path = out.join(name);
        save(&path, &bytes)?;
        written.push(path);
    }
    Ok(CompareReport {
        files: written,
        comparison,
    })
}
