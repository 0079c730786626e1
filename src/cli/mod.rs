//! The command line: arguments in, exit code out.
//!
//! Results go to stdout, everything else to stderr. With `--json` stdout holds one JSON document, whatever
//! happens; with `--quiet` stderr holds nothing but errors.

mod args;
mod commands;
mod golden;
mod outcomes;
mod output;
mod progress;

use std::env;
use std::panic;
use std::process;

use clap::Parser;

use crate::exec::ExitCode;
use crate::simd::Simd;
use args::{Args, Command};
use golden::Request;
use output::Output;

impl From<ExitCode> for process::ExitCode {
    fn from(code: ExitCode) -> Self {
        // The codes are all below 256.
        Self::from(code as u8)
    }
}

/// Runs the command that the process was started with.
pub fn main() -> process::ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) => {
            // Help and version go to stdout, usage errors to stderr. Neither can fail usefully.
            let _ = error.print();
            if !error.use_stderr() {
                return ExitCode::Done.into();
            }
            // The arguments mean nothing, but whoever asked for a document waits for one.
            let output = Output::new(env::args_os().any(|arg| arg == "--json"), false);
            let message = error.to_string();
            output.record_error(message.strip_prefix("error: ").unwrap_or(&message).trim());
            return output.finish(ExitCode::Usage).into();
        }
    };
    let output = Output::new(args.json, args.quiet);
    if let Err(problem) = Simd::check_variable() {
        output.error(&problem);
        return output.finish(ExitCode::Usage).into();
    }
    if let Some(threads) = args.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        if let Err(error) = pool.build_global() {
            output.error(&format!("cannot start {threads} threads: {error}"));
            return output.finish(ExitCode::Usage).into();
        }
    }
    // A panic is a bug. It is caught so that the exit code says so and a document is still a document.
    let caught = panic::catch_unwind(|| dispatch(&args.command, &output));
    let code = caught.unwrap_or_else(|_| {
        output.error(
            "this is a bug of rhinoplan; please report it with the plan and the message above",
        );
        ExitCode::Bug
    });
    output.finish(code).into()
}

fn dispatch(command: &Command, output: &Output) -> ExitCode {
    match command {
        Command::Run {
            plans,
            out,
            dry_run,
            strict,
            how,
        } => match (dry_run, how) {
            (true, how) => commands::dry_run(plans, out, how, output),
            (false, how) => commands::run(plans, out, *strict, how, output),
        },
        Command::Compare { folders, out } => commands::compare(folders, out, output),
        Command::Bless { plans, golden, out } => {
            let request = Request {
                plans,
                golden,
                out: out.as_deref(),
            };
            golden::bless(&request, output)
        }
        Command::Verify {
            plans,
            golden,
            out,
            report,
        } => {
            let request = Request {
                plans,
                golden,
                out: out.as_deref(),
            };
            golden::verify(&request, report, output)
        }
        Command::Check { plans } => commands::check(plans, output),
        Command::Info { ct, series } => commands::info(ct, series.as_deref(), output),
        Command::Landmarks { file, ct, series } => {
            commands::landmarks(file, ct, series.as_deref(), output)
        }
        Command::Schema => commands::schema(output),
        Command::Phantom { output: path } => commands::phantom(path, output),
    }
}
