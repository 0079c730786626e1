//! Candidates compared: those of one run at its end, and those of several finished runs.

mod across;
mod at_hand;
mod drawings;
mod error;
mod finished;
mod parts;
mod plots;
mod several;
mod skins;

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::error::RunError;
use super::pictures::{PicturesError, png_of};
use crate::compare::{Change, SurfaceDifference, Sweep};
use crate::io::artifact::{ArtifactError, save};
use crate::picture::PictureError;
use crate::plan::Plan;
use crate::report::comparison::{
    ComparedCandidate, ComparedParts, ComparedRun, ComparisonRecord, FORMAT, markdown, write_csv,
};
use crate::report::record::{CandidateRecord, FailedRecord, Program, RunRecord};
use crate::report::sweep;
use crate::space::GridVector;
use crate::text::shown as shown_text;
use at_hand::{AtHand, Gaps};
use drawings::Drawings;
use plots::SweepPlots;
use several::Several;

pub use error::CompareError;
pub use finished::{FinishedRun, MAX_RECORD_BYTES};
pub use skins::{MARGIN_MM, MOST_COMPARED};
pub(super) use skins::{Skins, differences};

/// What became of every measure of a candidate from before its first stage to after its last.
pub(super) fn changes(candidate: &CandidateRecord) -> Vec<Change> {
    let (Some(first), Some(last)) = (candidate.stages.first(), candidate.stages.last()) else {
        return Vec::new();
    };
    Change::list(first.named_measures(), last.named_measures())
}

/// How far the stages of a candidate together moved the tip, given what each did.
fn tip_move(moves: impl Iterator<Item = GridVector>) -> [f64; 3] {
    moves.fold([0.0; 3], |sum, moved| {
        let [x, y, z] = moved.to_array();
        [sum[0] + x, sum[1] + y, sum[2] + z]
    })
}

/// The sweeps of a run among its candidates.
fn find_sweeps(run: &str, candidates: &[ComparedCandidate]) -> Vec<Sweep> {
    let given = candidates
        .iter()
        .map(|of| (of.name.as_str(), of.sweep.as_deref(), &of.swept[..]));
    Sweep::find(run, given)
}

fn compared(candidate: &CandidateRecord) -> ComparedCandidate {
    let moves = candidate.stages.iter().map(|stage| stage.measures.move_mm);
    ComparedCandidate {
        name: candidate.name.clone(),
        title: candidate.title.clone(),
        stage: candidate
            .stages
            .last()
            .map_or(String::new(), |last| last.name.clone()),
        accepted: candidate.accept.as_ref().map(|verdict| verdict.accepted),
        swept: candidate.swept.clone(),
        sweep: candidate.sweep.clone(),
        tip_move_mm: tip_move(moves),
        measures: changes(candidate),
    }
}

/// The plots of a run's sweeps, as SVG, with the names of their files without an ending.
///
/// # Errors
/// Those of the drawing.
pub(super) fn sweep_plots(
    plan: &Plan,
    candidates: &[&CandidateRecord],
) -> Result<Vec<(String, String)>, PictureError> {
    let candidates: Vec<ComparedCandidate> = candidates.iter().map(|of| compared(of)).collect();
    let limits = plan
        .accept
        .iter()
        .map(|accept| (plan.name.as_str(), accept));
    let plots = SweepPlots {
        title: plan.title.as_deref().unwrap_or(&plan.name),
        several_runs: false,
        sweeps: &find_sweeps(&plan.name, &candidates),
        candidates: &candidates,
        accept: limits.collect(),
    };
    plots.draw()
}

/// The candidates of a run, compared; none where there is only one.
pub fn of_run(record: &RunRecord) -> Option<ComparisonRecord> {
    if record.candidates.len() < 2 {
        return None;
    }
    let candidates: Vec<ComparedCandidate> = record.candidates.iter().map(compared).collect();
    let failed = record.failed.iter().map(|of| FailedRecord {
        candidate: of.candidate.clone(),
        error: shown_text(&of.error, finished::MAX_ERROR),
    });
    let parts = record.part.as_ref().map(|part| ComparedParts {
        given: vec![part.number],
        of: part.of,
    });
    Some(ComparisonRecord {
        format: FORMAT,
        program: Program::THIS,
        runs: vec![ComparedRun {
            name: record.plan.name.clone(),
            title: record.plan.title.clone(),
            version: record.program.version.to_owned(),
            ct_sha256: record.inputs.ct.sha256.clone(),
            parts,
            accept: record.plan.accept.clone(),
        }],
        warnings: Vec::new(),
        sweeps: find_sweeps(&record.plan.name, &candidates),
        candidates,
        failed: failed.collect(),
        surface_differences: record.surface_differences.clone(),
    })
}

/// The tables of a comparison, by their names: `sweep.csv` where there is a sweep.
pub(super) fn files(
    comparison: &ComparisonRecord,
) -> Result<Vec<(&'static str, Vec<u8>)>, RunError> {
    let mut table = Vec::new();
    write_csv(&mut table, comparison)?;
    let mut json = serde_json::to_vec_pretty(comparison)?;
    json.push(b'\n');
    let text = markdown(comparison).into_bytes();
    let mut files = vec![
        ("compare.csv", table),
        ("compare.json", json),
        ("compare.md", text),
    ];
    if !comparison.sweeps.is_empty() {
        let mut table = Vec::new();
        sweep::write_csv(&mut table, comparison)?;
        files.push(("sweep.csv", table));
    }
    Ok(files)
}

/// A comparison of finished runs, and where it is.
#[derive(Debug, Clone, Serialize)]
pub struct CompareReport {
    /// The files that were written.
    #[serde(serialize_with = "shown")]
    pub files: Vec<PathBuf>,
    /// What the user should know of the folder; not part of the comparison.
    pub warnings: Vec<String>,
    /// What `compare.json` holds.
    pub comparison: ComparisonRecord,
}

/// Paths need not be Unicode, a document must be.
fn shown<S: serde::Serializer>(paths: &[PathBuf], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(paths.iter().map(|path| path.display().to_string()))
}

/// Compares the candidates of finished runs, given by their folders, and writes into `out` what a run writes that
/// compares its candidates, each file whole or not at all: `compare.csv`, `compare.json` and `compare.md`, and contact
/// sheets, charts and what there is of sweeps where runs have them. Parts of one plan are one run. What runs wrote is
/// left alone; what they left and cannot be used is a warning.
///
/// # Errors
/// [`CompareError`], where a folder holds no finished run, or the files cannot be written.
pub fn compare(folders: &[PathBuf], out: &Path) -> Result<CompareReport, CompareError> {
    let Several { runs, mut record } = several::read(folders)?;
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
    let mut pictures = Vec::new();
    let (found, warnings) = with_what_is_left(&runs, &record, |name, bytes| {
        let path = out.join(name);
        save(&path, bytes)?;
        pictures.push(path);
        Ok(())
    })?;
    record.warnings.extend(warnings);
    across::with_found(&mut record, found);
    let mut written = Vec::new();
    for (name, bytes) in files(&record)? {
        let path = out.join(name);
        save(&path, &bytes)?;
        written.push(path);
    }
    written.extend(pictures);
    Ok(CompareReport {
        warnings: left_over(out, &written),
        files: written,
        comparison: record,
    })
}

/// Distances between skins that no run found itself, and pictures of the candidates of all runs, which are given away;
/// with what is to be known of that.
fn with_what_is_left(
    runs: &[FinishedRun],
    record: &ComparisonRecord,
    mut write: impl FnMut(&str, &[u8]) -> Result<(), CompareError>,
) -> Result<(Vec<SurfaceDifference>, Vec<String>), CompareError> {
    let (mut gaps, mut warnings) = (Gaps::default(), Vec::new());
    let at_hand = AtHand::new(runs, record)?;
    let found = across::across(&at_hand, &mut gaps, &mut warnings);
    let title = match record.runs.as_slice() {
        [run] => run.title.clone().unwrap_or_else(|| run.name.clone()),
        runs => format!("comparison of {} runs", runs.len()),
    };
    let mut drawings = Drawings {
        at_hand: &at_hand,
        title: &title,
        gaps: &mut gaps,
        warnings: &mut warnings,
    };
    drawings.sheets(&mut write)?;
    if runs.iter().any(|run| run.plan.outputs.charts) {
        let charts = [
            ("profile", drawings.profile()),
            ("volumes", drawings.volumes()),
        ];
        let charts = charts
            .into_iter()
            .filter_map(|(name, svg)| Some((name.to_owned(), svg?)));
        let plots = sweep_plots_of(record, &title).map_err(PicturesError::from)?;
        for (name, svg) in charts.chain(plots) {
            write(&format!("{name}.svg"), svg.as_bytes())?;
            write(&format!("{name}.png"), &png_of(&svg)?)?;
        }
    }
    warnings.extend(gaps.warnings());
    Ok((found, warnings))
}

/// The plots of the sweeps of a comparison of finished runs, as SVG, with the names of their files without an ending.
fn sweep_plots_of(
    comparison: &ComparisonRecord,
    title: &str,
) -> Result<Vec<(String, String)>, PictureError> {
    let runs = &comparison.runs;
    let limits = runs
        .iter()
        .filter_map(|run| Some((run.name.as_str(), run.accept.as_ref()?)));
    let plots = SweepPlots {
        title,
        several_runs: runs.len() > 1,
        candidates: &comparison.candidates,
        sweeps: &comparison.sweeps,
        accept: limits.collect::<HashMap<_, _>>(),
    };
    plots.draw()
}

/// What an earlier comparison seems to have left in the folder, where this one has no such file. It may be anyone's, so
/// it is left.
fn left_over(out: &Path, written: &[PathBuf]) -> Vec<String> {
    let Ok(entries) = fs::read_dir(out) else {
        return Vec::new();
    };
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut left: Vec<PathBuf> = paths
        .filter(|path| {
            let name = path.file_name().map(|name| name.to_string_lossy());
            let name = name.unwrap_or_default();
            let is_picture = name.ends_with(".svg") || name.ends_with(".png");
            let begins = ["sweep", "contact-sheet", "profile", "volumes"];
            let drawn = is_picture && begins.iter().any(|begin| name.starts_with(begin));
            (drawn || name == "sweep.csv") && !written.contains(path)
        })
        .collect();
    left.sort();
    left.iter()
        .map(|path| {
            format!(
                "`{}` is not of this comparison; it was left",
                path.display()
            )
        })
        .collect()
}
