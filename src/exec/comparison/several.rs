//! The candidates of several finished runs, as one comparison.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::drawings::SAME_MM;
use super::error::CompareError;
use super::finished::{FinishedRun, MAX_ERROR, StageRead};
use super::parts::{Joined, join};
use super::{find_sweeps, tip_move};
use crate::compare::{Change, SurfaceDifference};
use crate::feature::Landmark;
use crate::report::comparison::{ComparedCandidate, ComparedRun, ComparisonRecord, FORMAT};
use crate::report::record::{FailedRecord, Program, named_measures};
use crate::text::shown;

/// Finished runs, read and joined, and the comparison by what their records say.
pub(super) struct Several {
    pub runs: Vec<FinishedRun>,
    pub record: ComparisonRecord,
}

/// Reads the runs in these folders.
pub(super) fn read(folders: &[PathBuf]) -> Result<Several, CompareError> {
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
    Ok(Several { runs, record })
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
        !run.inputs.ct.grid.is_like(&first.inputs.ct.grid)
    });
    tell("the landmarks, and so the regions", &|run| {
        let apart = |landmark: Landmark| {
            let of = |run: &FinishedRun| run.plan.landmarks_mm.get(landmark).0;
            (of(run) - of(first)).length() > SAME_MM
        };
        Landmark::ALL.into_iter().any(apart)
    });
    tell("the skin thresholds", &|run| {
        run.plan.segment.skin_hu != first.plan.segment.skin_hu
    });
    tell("the versions of the program", &|run| {
        run.program.version != first.program.version
    });
    warnings
}
