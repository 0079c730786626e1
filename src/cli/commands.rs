//! What each command does, in terms of the library.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::How;
use super::outcomes::Outcomes;
use super::output::Output;
use super::progress::Progress;
use crate::exec::ct::{self, Ct, CtError, CtHeader, CtKind};
use crate::exec::landmarks::LandmarksOnCt;
use crate::exec::nose::HuRange;
use crate::exec::preflight::output_folder;
use crate::exec::{self, Because, ExitCode, Ready, Refusal, RunOptions, RunReport, Step, selected};
use crate::io::artifact::Artifact;
use crate::io::dicom::{self, DicomProblem, Folder, OtherFiles};
use crate::io::nifti;
use crate::plan::{self, CtSource, Phantom};
use crate::space::Grid;
use crate::with_volume;

/// `run`: each plan in turn. A plan that fails does not stop the next; the worst exit code is kept.
pub(super) fn run(
    plans: &[PathBuf],
    out: &Path,
    strict: bool,
    how: &How,
    output: &Output,
) -> ExitCode {
    let ready = match prepare_into(plans, out, how) {
        Ok(ready) => ready,
        Err(refusal) => return refuse(&refusal, output),
    };
    let mut code = ExitCode::Done;
    let mut outcomes = Outcomes::default();
    for (plan, options) in with_options(&ready, how) {
        let name = &plan.plan.name;
        if selected(&plan.plan, options.part.as_ref()).is_empty() {
            output.note(&format!(
                "{}: this part has none of its candidates",
                plan.file
            ));
            continue;
        }
        let progress = Progress::new(output);
        let result = exec::run(plan, out, &options, &progress);
        drop(progress);
        match result {
            Ok(report) => {
                output.result(&summary(&report));
                outcomes.add(name, &report.candidates);
                for failed in &report.record.failed {
                    output.error(&format!("{}: {}", plan.file, failed.error));
                }
                output.push("runs", &report);
                code = code.worse(report.code);
                if !report.record.is_accepted(strict) {
                    code = code.worse(ExitCode::NotAccepted);
                }
            }
            Err(error) => {
                output.error(&format!("{}: {error}", plan.file));
                output
                    .note("nothing of this plan was written; what earlier runs wrote is unchanged");
                outcomes.add_failed(name, &error.to_string());
                code = code.worse(error.exit_code());
            }
        }
    }
    if outcomes.are_worth_a_table() {
        output.result(&outcomes.table());
    }
    code
}

fn prepare_into(plans: &[PathBuf], out: &Path, how: &How) -> Result<Vec<Ready>, Refusal> {
    let ready = exec::prepare(plans)?;
    exec::check_folders(&ready, out, how.part(0).as_ref())?;
    Ok(ready)
}

/// Each plan with how it is run: parts are dealt out over the candidates of all plans.
fn with_options<'a>(ready: &'a [Ready], how: &How) -> Vec<(&'a Ready, RunOptions)> {
    let mut before = 0;
    let each = ready.iter().map(|plan| {
        let options = RunOptions {
            force: how.force,
            fail_fast: how.fail_fast,
            memory: how.memory.map(|size| size.as_u64()),
            part: how.part(before),
        };
        before += plan.plan.candidates.len();
        (plan, options)
    });
    each.collect()
}

/// `run --dry-run`: what would be done, and why.
pub(super) fn dry_run(plans: &[PathBuf], out: &Path, how: &How, output: &Output) -> ExitCode {
    let ready = match prepare_into(plans, out, how) {
        Ok(ready) => ready,
        Err(refusal) => return refuse(&refusal, output),
    };
    let mut code = ExitCode::Done;
    for (ready, options) in with_options(&ready, how) {
        let Ready { file, plan, ct, .. } = ready;
        warn(file, ct, output);
        let reasons = match exec::reasons(ready, out, &options) {
            Ok(reasons) => reasons,
            Err(error) => {
                output.error(&format!("{file}: {error}"));
                code = code.worse(error.exit_code());
                continue;
            }
        };
        let selected = selected(plan, options.part.as_ref());
        let steps = exec::steps(plan, &selected);
        let runs = |step: Step<'_>| reasons.of(step) != Some(&Because::Unchanged);
        let count_of = |wanted: &dyn Fn(Step<'_>) -> bool| -> usize {
            let wanted = steps.iter().filter(|(step, _)| wanted(*step));
            wanted.map(|(_, phases)| phases.len()).sum()
        };
        output.result(&format!(
            "{} ({} of {} steps) into {}",
            plan.name,
            count_of(&runs),
            count_of(&|_| true),
            output_folder(out, plan, options.part.as_ref()).display()
        ));
        let mut listed = Vec::new();
        // A single candidate is compared with none.
        for (step, phases) in steps.iter().filter(|(_, phases)| !phases.is_empty()) {
            let because = reasons.of(*step);
            if let Some(because) = because {
                output.result(&format!("  {}: {because}", describe_step(*step)));
            }
            for phase in phases.iter().filter(|_| runs(*step)) {
                let deeper = if because.is_some() { "  " } else { "" };
                output.result(&format!("  {deeper}{}", phase.describe()));
            }
            listed.extend(phases.iter().map(|phase| {
                let place = match step {
                    Step::Stage(place) => Some(place),
                    _ => None,
                };
                json!({ "phase": phase, "at": place, "why": because, "runs": runs(*step) })
            }));
        }
        output.push("plans", json!({ "plan": plan.name, "steps": listed }));
    }
    code
}

fn describe_step(step: Step<'_>) -> String {
    match step {
        Step::Always => String::new(),
        Step::Start => "the nose as it is".to_owned(),
        Step::Stage(place) => format!("{} / {}", place.candidate, place.stage),
        Step::Joint => "all candidates".to_owned(),
    }
}

/// `check`: everything that can be known without computing.
pub(super) fn check(plans: &[PathBuf], output: &Output) -> ExitCode {
    let ready = match exec::prepare(plans) {
        Ok(ready) => ready,
        Err(refusal) => return refuse(&refusal, output),
    };
    for Ready { file, plan, ct, .. } in &ready {
        warn(file, ct, output);
        let stages: usize = plan.candidates.iter().map(|c| c.stages.len()).sum();
        output.result(&format!(
            "{file}: ok ({}, {} on a CT of {})",
            count(plan.candidates.len(), "candidate"),
            count(stages, "stage"),
            size(&ct.grid)
        ));
        output.push(
            "plans",
            json!({
                "file": file,
                "plan": plan.name,
                "candidates": plan.candidates.len(),
                "stages": stages,
            }),
        );
    }
    ExitCode::Done
}

/// `compare`: the candidates of finished runs.
pub(super) fn compare(folders: &[PathBuf], out: &Path, output: &Output) -> ExitCode {
    let report = match exec::compare(folders, out) {
        Ok(report) => report,
        Err(error) => {
            output.error(&error.to_string());
            return error.exit_code();
        }
    };
    for warning in report.comparison.warnings.iter().chain(&report.warnings) {
        output.warning(warning);
    }
    let candidates = count(report.comparison.candidates.len(), "candidate");
    let runs = count(report.comparison.runs.len(), "run");
    let mut text = format!("{} ({candidates} of {runs})", out.display());
    for file in &report.files {
        text.push_str(&format!("\n  {}", file.display()));
    }
    output.result(&text);
    output.set("comparison", &report);
    ExitCode::Done
}

/// `info`: what a volume is.
pub(super) fn info(path: &Path, series: Option<&str>, output: &Output) -> ExitCode {
    let result = if dicom::is_dicom(path) {
        info_of_folder(path, series, output)
    } else {
        let source = CtSource::File {
            path: path.to_owned(),
            sha256: None,
            series: series.map(str::to_owned),
        };
        ct::header(&source).and_then(|header| {
            show(&header, &ct::load(&source)?, output);
            Ok(())
        })
    };
    match result {
        Ok(()) => ExitCode::Done,
        Err(error) => {
            output.error(&error.to_string());
            ExitCode::Input
        }
    }
}

/// The series of a folder, and what the one that is chosen is. A choice that is still to be made is no error.
fn info_of_folder(path: &Path, series: Option<&str>, output: &Output) -> Result<(), CtError> {
    let folder = Folder::scan(path)?;
    output.set("series", folder.series());
    output.set("other_files", folder.others());
    if !folder.series().is_empty() {
        output.result(&folder.table());
    }
    for OtherFiles {
        because,
        files,
        first,
    } in folder.others()
    {
        let and_more = if files > 1 {
            format!(" and {} more", files - 1)
        } else {
            String::new()
        };
        output.result(&format!(
            "  not in a series: `{first}`{and_more}: {because}"
        ));
    }
    let chosen = match folder.choose(series) {
        Err(error) if matches!(error.problem, DicomProblem::Several { .. }) => {
            output.note("choose one with --series UID, and with `series` in [ct] of a plan");
            return Ok(());
        }
        chosen => chosen?,
    };
    show(
        &CtHeader::of_series(&chosen),
        &ct::load_series(&chosen)?,
        output,
    );
    Ok(())
}

fn show(header: &CtHeader, ct: &Ct, output: &Output) {
    if let Some(warning) = header.warning() {
        output.warning(&warning);
    }
    output.result(&describe(header, &ct.record));
    output.set("ct", &ct.record);
}

/// `landmarks`: the points of a markups file on the grid of a CT, ready to paste into a plan.
pub(super) fn landmarks(file: &Path, ct: &Path, series: Option<&str>, output: &Output) -> ExitCode {
    let found = match LandmarksOnCt::read(file, ct, series) {
        Ok(found) => found,
        Err(error) => {
            output.error(&error.to_string());
            return error.exit_code();
        }
    };
    if let Some(warning) = found.warning() {
        output.warning(&warning);
    }
    output.result(found.plan_text().trim_end());
    output.set("landmarks", &found);
    ExitCode::Done
}

/// `schema`: the JSON Schema of plans.
pub(super) fn schema(output: &Output) -> ExitCode {
    let schema = plan::schema();
    // `{:#}` of a JSON value is its text over several lines.
    output.result(&format!("{schema:#}"));
    output.set("schema", schema);
    ExitCode::Done
}

/// `phantom`: the built-in head as a file.
pub(super) fn phantom(path: &Path, output: &Output) -> ExitCode {
    // Before the work, not after it: can the file be written at all?
    if let Err(error) = Artifact::create(path) {
        output.error(&error.to_string());
        return ExitCode::Usage;
    }
    let ct = match ct::load(&CtSource::Phantom(Phantom::Lee2001)) {
        Ok(ct) => ct,
        Err(error) => {
            output.error(&error.to_string());
            return ExitCode::Input;
        }
    };
    if let Err(error) = with_volume!(&ct.volume, volume => {
        nifti::save_volume(path, &ct.template, volume)
    }) {
        output.error(&error.to_string());
        return ExitCode::Usage;
    }
    output.result(&format!(
        "wrote {} ({}, SHA-256 of the samples {})",
        path.display(),
        size(ct.volume.grid()),
        ct.record.sha256
    ));
    output.set("ct", &ct.record);
    ExitCode::Done
}

fn warn(file: &str, ct: &CtHeader, output: &Output) {
    if let Some(warning) = ct.warning() {
        output.warning(&format!("{file}: {warning}"));
    }
}

pub(super) fn refuse(refusal: &Refusal, output: &Output) -> ExitCode {
    for message in refusal.unplaced() {
        output.error(message);
    }
    for fault in refusal.diagnostics() {
        output.fault(fault);
    }
    let faults = refusal.unplaced().count() + refusal.diagnostics().count();
    output.note(&format!("{}; nothing was computed", count(faults, "fault")));
    refusal.exit_code()
}

/// A few lines for each candidate: where it ends, and what changed.
fn summary(report: &RunReport) -> String {
    let mut text = format!("{}", report.folder.display());
    for candidate in &report.record.candidates {
        let (Some(first), Some(last)) = (candidate.stages.first(), candidate.stages.last()) else {
            continue;
        };
        let (before, after) = (&first.measures, &last.measures);
        let change = 100.0 * (after.volume_total_mm3 / before.volume_total_mm3 - 1.0);
        text.push_str(&format!(
            "\n  {}: gamma {:.2}° → {:.2}°, height {:.2} → {:.2} mm, volume {:.0} → {:.0} mm³ ({change:+.1} %)",
            candidate.name,
            before.gamma_deg,
            after.gamma_deg,
            before.height_mm,
            after.height_mm,
            before.volume_total_mm3,
            after.volume_total_mm3,
        ));
        let Some(verdict) = &candidate.accept else {
            continue;
        };
        if verdict.accepted {
            text.push_str("; accepted");
        } else {
            text.push_str("; not accepted:");
        }
        for failed in verdict.failures() {
            let (what, found, allowed) = (failed.what(), failed.shown(), failed.allowed());
            text.push_str(&format!("\n    {what} is {found}; allowed: {allowed}"));
        }
    }
    if !report.removed.is_empty() {
        text.push_str(&format!(
            "\n  removed {} of an earlier run, which this plan does not write",
            count(report.removed.len(), "file")
        ));
    }
    text
}

fn describe(header: &CtHeader, record: &crate::report::record::CtRecord) -> String {
    let grid = &record.grid;
    let ([nx, ny, nz], spacing, origin) = (grid.dims(), grid.spacing(), grid.origin().0);
    let range = HuRange(record.hu_range);
    let position = match &header.kind {
        CtKind::Nifti(template) => format!("{:?}", template.transform()).to_lowercase(),
        CtKind::Nrrd { is_placed: true } => "space directions".to_owned(),
        CtKind::Dicom { slices, .. } => format!("{slices} slices"),
        CtKind::Nrrd { is_placed: false } | CtKind::Phantom => "none".to_owned(),
    };
    format!(
        "size         {nx} × {ny} × {nz} voxels (left, posterior, superior)\n\
         spacing      {} × {} × {} mm\n\
         extent       {:.1} × {:.1} × {:.1} mm\n\
         stored as    {}, {} (slope {}, intercept {})\n\
         position     from {position}; first voxel at {:.3}, {:.3}, {:.3} mm (LPS)\n\
         obliquity    {:.2}°\n\
         range        {range}\n\
         SHA-256      {}",
        mm(spacing.x),
        mm(spacing.y),
        mm(spacing.z),
        nx as f64 * spacing.x,
        ny as f64 * spacing.y,
        nz as f64 * spacing.z,
        record.stored_orientation,
        record.sample_type,
        record.slope,
        record.intercept,
        origin.x,
        origin.y,
        origin.z,
        grid.obliquity_deg(),
        record.sha256,
    )
}

fn size(grid: &Grid) -> String {
    let ([nx, ny, nz], spacing) = (grid.dims(), grid.spacing());
    format!(
        "{nx}×{ny}×{nz} voxels of {}×{}×{} mm",
        mm(spacing.x),
        mm(spacing.y),
        mm(spacing.z)
    )
}

/// A spacing for people: files hold single-precision numbers, whose last digits mean nothing.
fn mm(spacing: f64) -> f64 {
    (spacing * 1e4).round() / 1e4
}

fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}
