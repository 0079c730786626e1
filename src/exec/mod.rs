//! Plans executed: everything is checked first, then computed stage by stage, then put in place at once.
//!
//! [`preflight`] turns plan files into [`Ready`] plans or every reason why not. [`run()`] computes one of
//! them and tells an [`Observer`] how it goes. [`golden`] holds what they give against what is kept. None of them knows a
//! terminal.

mod batch;
mod candidate;
pub mod comparison;
pub mod ct;
pub mod error;
pub mod events;
pub mod golden;
mod kept;
pub mod landmarks;
mod meshes;
pub mod nose;
mod objects;
mod operation;
pub mod pictures;
pub mod preflight;
pub mod run;
pub mod skin;
pub mod skin_landmarks;
pub mod steps;
mod surfaces;
mod timings;

pub use batch::{Part, selected};
pub use comparison::{CompareError, CompareReport, compare};
pub use error::{ExitCode, RunError};
pub use events::{Event, Observer, Phase, Place};
pub use kept::{Because, NUMERIC_VERSION, Reasons, StageReason};
pub use preflight::{Ready, Refusal, check_folders, prepare};
pub use run::{CandidateOutcome, RunOptions, RunReport, reasons, run};
pub use steps::{Step, steps};
