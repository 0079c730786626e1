//! Why a run ends, and the process's exit code.

use thiserror::Error;

use super::ct::CtError;
use super::events::Place;
use super::nose::NoNose;
use super::pictures::PicturesError;
use super::skin::SkinError;
use crate::feature::LineError;
use crate::io::artifact::ArtifactError;
use crate::io::nifti::WriteError;
use crate::measure::MeasureError;
use crate::mesh::MeshError;
use crate::plan::Diagnostics;
use crate::resample::half::HalfError;
use crate::surface::SurfaceError;
use crate::volume::VolumeError;

/// The exit codes of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ExitCode {
    /// Everything was done.
    #[default]
    Done = 0,
    /// The command line or a plan is wrong, or outputs cannot be written where they were asked for.
    Usage = 2,
    /// The CT, or what is in it, cannot be used.
    Input = 3,
    /// No candidate keeps the limits of its plan, or with `--strict` not every one.
    NotAccepted = 4,
    /// What a plan gives differs from its golden.
    Differs = 5,
    /// A bug of this program.
    Bug = 70,
}

impl ExitCode {
    /// The one that a process ends with that came to both: a bug outweighs the command line and the plans,
    /// which outweigh the CTs, which outweigh goldens, which outweigh limits.
    pub fn worse(self, other: Self) -> Self {
        let rank = |code| match code {
            Self::Done => 0,
            Self::NotAccepted => 1,
            Self::Differs => 2,
            Self::Input => 3,
            Self::Usage => 4,
            Self::Bug => 5,
        };
        if rank(other) > rank(self) {
            other
        } else {
            self
        }
    }
}

/// Where in a plan something went wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct At {
    /// The candidate's name.
    pub candidate: String,
    /// The stage's name.
    pub stage: String,
}

impl From<Place<'_>> for At {
    fn from(place: Place<'_>) -> Self {
        Self {
            candidate: place.candidate.to_owned(),
            stage: place.stage.to_owned(),
        }
    }
}

impl std::fmt::Display for At {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(to, "candidate `{}`, stage `{}`", self.candidate, self.stage)
    }
}

/// Why a run could not be finished. Earlier runs' outputs are as they were.
#[derive(Debug, Error)]
pub enum RunError {
    /// The CT cannot be read.
    #[error(transparent)]
    Ct(#[from] CtError),
    /// The CT gives no skin threshold.
    #[error(transparent)]
    Skin(#[from] SkinError),
    /// There is no nose where the landmarks are.
    #[error(transparent)]
    NoNose(#[from] NoNose),
    /// The skin at the landmarks cannot be found.
    #[error("the skin at the landmarks cannot be found: {0}")]
    SkinAtLandmarks(#[from] SurfaceError),
    /// The plan has faults once its landmarks are moved onto the skin.
    #[error("with its landmarks moved onto the skin (`landmarks.snap`) the plan cannot run:\n{0}")]
    Snapped(Diagnostics),
    /// There is nothing to measure before the first operation.
    #[error("the preoperative nose cannot be measured: {0}")]
    Preoperative(MeasureError),
    /// There is nothing to measure after an operation.
    #[error("{at}: the nose cannot be measured: {source}")]
    Measure {
        /// Where.
        at: At,
        /// Why.
        source: MeasureError,
    },
    /// A feature line has no direction.
    #[error("{at}: {source}")]
    Line {
        /// Where.
        at: At,
        /// Why.
        source: LineError,
    },
    /// Several candidates cannot be computed.
    #[error("{first} (and {others} more candidates cannot be computed)")]
    Candidates {
        /// The first of them.
        first: Box<RunError>,
        /// How many more.
        others: usize,
    },
    /// The volume has no half.
    #[error("{0}; use scale = \"full\"")]
    Half(#[from] HalfError),
    /// No memory.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// An output could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// An output could not be put in place.
    #[error(transparent)]
    Artifact(#[from] ArtifactError),
    /// A picture could not be made.
    #[error(transparent)]
    Pictures(#[from] PicturesError),
    /// A surface could not be made a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A table could not be made.
    #[error("cannot write a table: {0}")]
    Table(#[from] csv::Error),
    /// The record could not be made.
    #[error("cannot write the record: {0}")]
    Record(#[from] serde_json::Error),
}

impl RunError {
    /// Whether it is about one candidate, and others can be computed all the same.
    pub fn is_of_one_candidate(&self) -> bool {
        matches!(
            self,
            Self::Candidates { .. }
                | Self::Measure { .. }
                | Self::Line { .. }
                | Self::Half(_)
                | Self::Volume(_)
                | Self::Mesh(_)
                | Self::Pictures(_)
        )
    }

    /// What the process ends with.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Candidates { first, .. } => first.exit_code(),
            Self::Ct(_) | Self::Skin(_) | Self::NoNose(_) => ExitCode::Input,
            Self::Preoperative(_) | Self::Measure { .. } => ExitCode::Input,
            Self::Half(_) | Self::Volume(_) | Self::Mesh(_) | Self::SkinAtLandmarks(_) => {
                ExitCode::Input
            }
            Self::Snapped(_) => ExitCode::Usage,
            Self::Pictures(PicturesError::Camera(_) | PicturesError::Picture(_)) => ExitCode::Bug,
            Self::Pictures(PicturesError::Enhance(_)) => ExitCode::Usage,
            Self::Pictures(_) => ExitCode::Input,
            Self::Line { .. } | Self::Artifact(_) => ExitCode::Usage,
            Self::Write(WriteError::Mismatch { .. }) | Self::Record(_) => ExitCode::Bug,
            Self::Write(_) | Self::Table(_) => ExitCode::Usage,
        }
    }
}
