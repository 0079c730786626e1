//! What can be typed.

use std::path::PathBuf;

use clap::{Parser, Subcommand};

use crate::exec::Part;

/// Rhinoplasty planning on head CT: plan files, volume morphing, measurements.
///
/// A planning aid, not a prediction of a surgical result.
#[derive(Debug, Parser)]
#[command(version, arg_required_else_help = true, max_term_width = 100, after_help = EXIT_CODES)]
pub(super) struct Args {
    #[command(subcommand)]
    pub command: Command,

    /// Print one JSON document on stdout, and prose on stderr.
    #[arg(long, global = true)]
    pub json: bool,

    /// Print nothing but results and errors.
    #[arg(long, short, global = true)]
    pub quiet: bool,

    /// Worker threads; all processors by default. The results are the same for any number.
    #[arg(
        long,
        global = true,
        value_name = "N",
        value_parser = clap::value_parser!(u16).range(1..=MAX_THREADS)
    )]
    pub threads: Option<u16>,
}

/// How a plan is run; none of it changes what comes out.
#[derive(Debug, clap::Args)]
pub(super) struct How {
    /// Compute everything again. Without this, results of earlier runs in the folder that still hold are kept.
    #[arg(long)]
    pub force: bool,

    /// End a plan with its first candidate that cannot be computed. Without this, the others are computed.
    #[arg(long)]
    pub fail_fast: bool,

    /// How much memory candidates may take that are computed beside each other, as 8GiB; what the machine has
    /// free by default. Fewer run at a time where there is less, at least one.
    #[arg(long, value_name = "SIZE")]
    pub memory: Option<bytesize::ByteSize>,

    /// Compute one of several parts of the candidates of all plans, as 2/5, into `<plan>.2-of-5`; `compare` joins
    /// the parts.
    #[arg(long, value_name = "K/N", value_parser = shard)]
    pub shard: Option<(u32, u32)>,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Compute every candidate and stage of every plan.
    #[command(after_help = EXIT_CODES)]
    Run {
        /// Plan files.
        #[arg(required = true, value_name = "PLAN")]
        plans: Vec<PathBuf>,

        /// The folder that gets a folder for each plan.
        #[arg(long, value_name = "DIR", default_value = "out")]
        out: PathBuf,

        /// Check everything and list the steps, but compute nothing.
        #[arg(long)]
        dry_run: bool,

        /// End with exit code 4 where any candidate does not keep the limits of its plan ([accept]); without
        /// this, only where none of a plan does.
        #[arg(long)]
        strict: bool,

        #[command(flatten)]
        how: How,
    },
    /// Check plans and the headers of their CTs, without computing.
    #[command(after_help = EXIT_CODES)]
    Check {
        /// Plan files.
        #[arg(required = true, value_name = "PLAN")]
        plans: Vec<PathBuf>,
    },
    /// Compare the candidates of finished runs: tables, distances between skins, pictures.
    ///
    /// Writes compare.csv, compare.json and compare.md; contact-sheet.png where a run drew views; profile, volumes and
    /// sweep (.svg, .png) where one drew charts; sweep.csv where one swept. All parts of a plan (`run --shard`) make the
    /// same bytes as one run of it. Runs are only read; what they did not keep, or do not have in common, is left out
    /// with a warning.
    #[command(after_help = EXIT_CODES)]
    Compare {
        /// Folders of finished plans, as `out/<plan>`.
        #[arg(required = true, value_name = "DIR")]
        folders: Vec<PathBuf>,

        /// The folder to write into.
        #[arg(long, value_name = "DIR", default_value = "compare")]
        out: PathBuf,
    },
    /// Run plans and keep what they give, small, for `verify` to compare with.
    #[command(after_help = EXIT_CODES)]
    Bless {
        /// Plan files.
        #[arg(required = true, value_name = "PLAN")]
        plans: Vec<PathBuf>,

        /// The golden folder: it gets a folder for each plan, and golden.toml with the tolerances.
        #[arg(long, value_name = "DIR")]
        golden: PathBuf,

        /// The folder for the outputs of the runs, as with `run`; without this they are not kept.
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Run plans again and compare what they give with what `bless` kept.
    #[command(after_help = EXIT_CODES)]
    Verify {
        /// Plan files.
        #[arg(required = true, value_name = "PLAN")]
        plans: Vec<PathBuf>,

        /// The golden folder.
        #[arg(long, value_name = "DIR")]
        golden: PathBuf,

        /// The folder for the outputs of the runs, as with `run`; without this they are not kept.
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,

        /// The folder for the report, written where something differs: report.md and pictures.
        #[arg(long, value_name = "DIR", default_value = "golden-report")]
        report: PathBuf,
    },
    /// Show grid, orientation, spacing and HU range of a volume; list the series of a folder.
    #[command(after_help = EXIT_CODES)]
    Info {
        /// A NIfTI-1 (.nii, .nii.gz) or NRRD (.nrrd, .nhdr) volume, a folder of DICOM slices, or one slice of it.
        #[arg(value_name = "CT")]
        ct: PathBuf,

        /// The SeriesInstanceUID to show, where a folder holds several series.
        #[arg(long, value_name = "UID")]
        series: Option<String>,
    },
    /// Print the landmarks of a 3D Slicer markups file, as a plan writes them.
    #[command(after_help = EXIT_CODES)]
    Landmarks {
        /// Markups of 3D Slicer (.mrk.json, .fcsv), the points labelled with the landmarks' names.
        #[arg(value_name = "FILE")]
        file: PathBuf,

        /// The CT that the landmarks are on.
        #[arg(long, value_name = "CT")]
        ct: PathBuf,

        /// The SeriesInstanceUID of the CT, where its folder holds several series.
        #[arg(long, value_name = "UID")]
        series: Option<String>,
    },
    /// Print the JSON Schema of plan files, for editors that complete and check them.
    #[command(after_help = SCHEMA_HELP)]
    Schema,
    /// Write the built-in synthetic head `lee2001`.
    Phantom {
        /// The file to write (.nii or .nii.gz).
        #[arg(long, short, value_name = "FILE", value_parser = nifti_name)]
        output: PathBuf,
    },
}

/// Far more than any machine profits from. Tens of thousands would be started, one system thread each.
const MAX_THREADS: i64 = 1024;
/// More parts are none that anyone has machines for.
const MAX_SHARDS: u32 = 10_000;

const EXIT_CODES: &str = "\
Exit codes:
  0   done
  2   the command line, a plan or its landmarks are wrong, or the outputs cannot be written
  3   the CT, or a finished run that is to be compared, cannot be used
  4   no candidate keeps the limits of its plan; with --strict, one does not
  5   what a plan gives differs from its golden
  70  a bug of this program";

const SCHEMA_HELP: &str = "\
Save it, and name it in the first line of a plan:
  rhinoplan schema > plan.schema.json
  #:schema ./plan.schema.json
Editors that use Taplo (Even Better TOML for Visual Studio Code, among others) read that line.";

impl How {
    /// The part of a plan's candidates that is asked for, where so many are of plans before it.
    pub fn part(&self, before: usize) -> Option<Part> {
        self.shard.map(|(number, of)| Part { number, of, before })
    }
}

/// `K/N`, K from 1 to N.
fn shard(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once('/');
    let parsed = parsed.and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
    match parsed {
        Some((k, n)) if (1..=n).contains(&k) && n <= MAX_SHARDS => Ok((k, n)),
        _ => Err(format!(
            "expected K/N, as 2/5 for the second of five parts, K from 1 to N, N at most {MAX_SHARDS}"
        )),
    }
}

/// The name of a file to write, whose ending tells whether it is compressed.
fn nifti_name(text: &str) -> Result<PathBuf, String> {
    let lower = text.to_ascii_lowercase();
    if lower.ends_with(".nii") || lower.ends_with(".nii.gz") {
        Ok(text.into())
    } else {
        Err("the name must end in .nii or .nii.gz".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_is_sound() {
        Args::command().debug_assert();
    }

    #[test]
    fn numbers_of_threads_that_make_no_sense_are_refused() {
        let threads = |n| Args::try_parse_from(["rhinoplan", "check", "a.toml", "--threads", n]);
        for n in ["0", "-1", "1025", "65536", "1.5", ""] {
            assert!(threads(n).is_err(), "{n}");
        }
        assert_eq!(threads("1024").unwrap().threads, Some(1024));
    }

    #[test]
    fn a_name_says_what_is_written() {
        for name in ["head.nii", "a.b/HEAD.NII.GZ"] {
            assert_eq!(nifti_name(name), Ok(name.into()));
        }
        for name in ["head", "head.gz", "head.mha", "nii"] {
            assert!(nifti_name(name).is_err(), "{name}");
        }
    }
}
