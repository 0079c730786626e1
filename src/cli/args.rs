//! What can be typed.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Parser, Subcommand};

/// Rhinoplasty planning on head CT: plan files, volume morphing, measurements.
///
/// A planning aid, not a prediction of a surgical result.
#[derive(Debug, Parser)]
#[command(version, arg_required_else_help = true, max_term_width = 100)]
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
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
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
    },
    /// Check plans and the headers of their CTs, without computing.
    #[command(after_help = EXIT_CODES)]
    Check {
        /// Plan files.
        #[arg(required = true, value_name = "PLAN")]
        plans: Vec<PathBuf>,
    },
    /// Show grid, orientation, spacing and HU range of a volume.
    Info {
        /// A NIfTI-1 volume (.nii, .nii.gz).
        #[arg(value_name = "CT")]
        ct: PathBuf,
    },
    /// Write the built-in synthetic head `lee2001`.
    Phantom {
        /// The file to write (.nii or .nii.gz).
        #[arg(long, short, value_name = "FILE")]
        output: PathBuf,
    },
}

const EXIT_CODES: &str = "\
Exit codes:
  0   done
  2   the command line or a plan is wrong, or the outputs cannot be written
  3   the CT cannot be used
  70  a bug of this program";

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_is_sound() {
        Args::command().debug_assert();
    }

    #[test]
    fn zero_threads_are_refused() {
        assert!(Args::try_parse_from(["rhinoplan", "check", "a.toml", "--threads", "0"]).is_err());
    }
}
