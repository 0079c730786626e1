//! Why finished runs cannot be compared.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::exec::error::{ExitCode, RunError};
use crate::exec::pictures::PicturesError;
use crate::io::artifact::ArtifactError;

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

impl From<RunError> for CompareError {
    fn from(error: RunError) -> Self {
        Self::Tables(Box::new(error))
    }
}

impl From<PicturesError> for CompareError {
    fn from(error: PicturesError) -> Self {
        RunError::from(error).into()
    }
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
