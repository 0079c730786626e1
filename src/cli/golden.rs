//! `bless` and `verify`: what plans give, kept and compared.

use std::env;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::commands::refuse;
use super::output::Output;
use super::progress::Progress;
use crate::exec::golden::{self, Golden, GoldenError, Verified};
use crate::exec::{self, ExitCode, Ready};
use crate::golden::Settings;
use crate::golden::report::{counted, differing, table};

/// Set by services that run a project's checks.
const CI: &str = "CI";

/// The most rows of a table on the terminal; the report has them all.
const MOST_ROWS: usize = 20;

/// What both commands are told.
pub(super) struct Request<'a> {
    /// Plan files.
    pub plans: &'a [PathBuf],
    /// The golden folder.
    pub golden: &'a Path,
    /// Where outputs go; nowhere, where they are not asked for.
    pub out: Option<&'a Path>,
}

/// `bless`: what plans give is kept.
pub(super) fn bless(request: &Request<'_>, output: &Output) -> ExitCode {
    if env::var_os(CI).is_some_and(|value| !value.is_empty()) {
        output.error(
            "`bless` does not run where the environment variable CI is set: what it keeps has to be looked at first; \
             run it on your own machine and commit what it writes, or unset CI",
        );
        return ExitCode::Usage;
    }
    let (ready, settings) = match begin(request, output) {
        Ok(begun) => begun,
        Err(code) => return code,
    };
    let mut code = ExitCode::Done;
    for plan in &ready {
        let progress = Progress::new(output);
        let result = golden::bless(plan, request.golden, &settings, request.out, &progress);
        drop(progress);
        match result {
            Ok(counts) => {
                let folder = request.golden.join(&plan.plan.name);
                output.result(&format!("{} ({})", folder.display(), counted(&counts)));
                output.push("plans", json!({ "plan": plan.plan.name, "kept": counts }));
            }
            Err(error) => {
                failed(plan, &error, output);
                output.note("nothing of this plan was kept; what was kept before is unchanged");
                code = code.worse(error.exit_code());
            }
        }
    }
    code
}

/// `verify`: plans are run again and compared with what is kept.
pub(super) fn verify(request: &Request<'_>, report: &Path, output: &Output) -> ExitCode {
    if let Err(error) = golden::check_report(report) {
        output.error(&error.to_string());
        return error.exit_code();
    }
    let (ready, settings) = match begin(request, output) {
        Ok(begun) => begun,
        Err(code) => return code,
    };
    let mut code = ExitCode::Done;
    // What cannot be compared is told before anything is computed.
    let mut comparable = Vec::new();
    for plan in &ready {
        match Golden::open(request.golden, &plan.plan.name, &settings) {
            Ok(golden) => comparable.push((plan, golden)),
            Err(error) => {
                failed(plan, &error, output);
                code = code.worse(error.exit_code());
            }
        }
    }
    let mut verified = Vec::new();
    for (plan, golden) in &comparable {
        let progress = Progress::new(output);
        let result = golden::verify(plan, golden, &settings, request.out, &progress);
        drop(progress);
        match result {
            Ok(found) => {
                output.result(&told(&found, report));
                output.push("plans", &found.verdict);
                verified.push(found);
            }
            Err(error) => {
                failed(plan, &error, output);
                code = code.worse(error.exit_code());
            }
        }
    }
    if verified.iter().all(|found| found.verdict.agrees) {
        return code;
    }
    code = code.worse(ExitCode::Differs);
    match golden::write_report(report, &verified) {
        Ok(path) => {
            output.note(&format!("the report is {}", path.display()));
            output.set("report", path.display().to_string());
        }
        Err(error) => {
            output.error(&error.to_string());
            code = code.worse(error.exit_code());
        }
    }
    code
}

fn begin(request: &Request<'_>, output: &Output) -> Result<(Vec<Ready>, Settings), ExitCode> {
    let settings = golden::settings(request.golden).map_err(|error| {
        output.error(&error.to_string());
        error.exit_code()
    })?;
    let ready = exec::prepare(request.plans).and_then(|ready| {
        if let Some(out) = request.out {
            exec::check_folders(&ready, out, None)?;
        }
        Ok(ready)
    });
    match ready {
        Ok(ready) => Ok((ready, settings)),
        Err(refusal) => Err(refuse(&refusal, output)),
    }
}

fn failed(plan: &Ready, error: &GoldenError, output: &Output) {
    output.error(&format!("{}: {error}", plan.file));
}

/// What became of a plan, in a few lines.
fn told(found: &Verified, report: &Path) -> String {
    let verdict = &found.verdict;
    let expected = counted(&verdict.expected);
    if verdict.agrees {
        return format!("{}: agrees ({expected})", verdict.plan);
    }
    let differences = &verdict.differences;
    let mut text = format!(
        "{}: differs in {} (the golden has {expected})",
        verdict.plan,
        counted(&differing(differences))
    );
    for input in &verdict.inputs_changed {
        text.push_str(&format!("\n  {input}"));
    }
    text.push('\n');
    text.push_str(table(differences, MOST_ROWS).trim_end());
    let more = differences.len().saturating_sub(MOST_ROWS);
    if more > 0 {
        let path = report.join(golden::REPORT);
        text.push_str(&format!("\n  … and {more} more in {}", path.display()));
    }
    text
}
