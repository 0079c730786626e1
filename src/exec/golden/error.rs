//! Why a golden can be neither made nor compared with.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::exec::error::{ExitCode, RunError};
use crate::golden::{SettingsError, StoredError};
use crate::io::artifact::ArtifactError;
use crate::picture::PictureError;
use crate::volume::VolumeError;

/// Why a golden can be neither made nor compared with. What is kept is as it was.
#[derive(Debug, Error)]
pub enum GoldenError {
    /// `golden.toml` says something that means nothing.
    #[error("`{}`: {problem}", path.display())]
    Settings {
        /// The file.
        path: PathBuf,
        /// What.
        problem: SettingsError,
    },
    /// Nothing is kept of a plan.
    #[error("there is no golden of `{plan}` in `{}`; look at what the plan gives, and keep it with `rhinoplan bless`", path.display())]
    None {
        /// The plan's name.
        plan: String,
        /// The golden folder.
        path: PathBuf,
    },
    /// A `golden.json` is damaged, or of another version.
    #[error("`{}`: {problem}", path.display())]
    Stored {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: StoredError,
    },
    /// A file of the golden cannot be used.
    #[error("`{}`: {problem}; restore it, or `bless` again", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// Voxels are to be compared and were not kept.
    #[error(
        "golden.toml has volumes compared voxel by voxel, but the golden of `{plan}` holds no more than their SHA-256; `bless` again, or set `volumes.compare` to \"hash\""
    )]
    NotKept {
        /// The plan's name.
        plan: String,
    },
    /// A folder is that of a run.
    #[error("`{}` is the folder of a run, and would be mixed with what is kept or reported; choose another", path.display())]
    OfARun {
        /// The folder.
        path: PathBuf,
    },
    /// The report would be written among goldens.
    #[error("`{}` holds goldens; choose another folder with --report", path.display())]
    OfGoldens {
        /// The folder.
        path: PathBuf,
    },
    /// The plan could not be run.
    #[error(transparent)]
    Run(#[from] RunError),
    /// An output of the run cannot be read back.
    #[error("cannot read back `{name}`: {problem}")]
    Output {
        /// Its name in the plan's folder.
        name: String,
        /// Why.
        problem: String,
    },
    /// There is no folder for what the run writes.
    #[error("cannot make a temporary folder: {0}; name a folder with --out")]
    Temporary(io::Error),
    /// A file cannot be written.
    #[error(transparent)]
    Artifact(#[from] ArtifactError),
    /// The machine has no memory for a volume.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// A picture cannot be encoded.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// `golden.json` cannot be made.
    #[error("cannot write what is kept: {0}")]
    Json(#[from] serde_json::Error),
}

impl GoldenError {
    /// What the process ends with.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Run(error) => error.exit_code(),
            Self::Volume(_) => ExitCode::Input,
            Self::Picture(_) | Self::Json(_) => ExitCode::Bug,
            Self::Settings { .. }
            | Self::None { .. }
            | Self::Stored { .. }
            | Self::File { .. }
            | Self::NotKept { .. }
            | Self::OfARun { .. }
            | Self::OfGoldens { .. }
            | Self::Output { .. }
            | Self::Temporary(_)
            | Self::Artifact(_) => ExitCode::Usage,
        }
    }
}
