//! What can be wrong with an NRRD file.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::header::MAX_HEADER;
use crate::io::nifti::NiftiProblem;
use crate::space::GridError;

/// A file that cannot be used, and why.
#[derive(Debug, Error)]
#[error("`{}`: {problem}", path.display())]
pub struct NrrdError {
    /// The file, as the user named it.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: NrrdProblem,
}

impl NrrdError {
    pub(super) fn new(path: &Path, problem: NrrdProblem) -> Self {
        Self {
            path: path.to_owned(),
            problem,
        }
    }
}

/// What is wrong with a file: what was found, what is expected, and a remedy where one is plain.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NrrdProblem {
    /// Not NRRD, or of a version that is not known.
    #[error("is not an NRRD file: it begins with `{found}`, expected `NRRD0001` to `NRRD0005`")]
    Magic {
        /// The first line, or as much of it as is short.
        found: String,
    },
    /// A header without an end.
    #[error("has no empty line within {MAX_HEADER} bytes; its header is damaged")]
    HeaderTooLong,
    /// A line that is no field.
    #[error("line {line} of the header is no field: `{found}`")]
    Line {
        /// From 1.
        line: usize,
        /// The line.
        found: String,
    },
    /// A field that is not there.
    #[error("the header has no field `{field}`; {remedy}")]
    Missing {
        /// The field's name in the format.
        field: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// A field that is there twice.
    #[error("the header gives the field `{field}` twice")]
    Twice {
        /// The field's name in the format.
        field: &'static str,
    },
    /// A field with a value that cannot be used.
    #[error("header field `{field}` is `{found}`, expected {expected}")]
    Field {
        /// The field's name in the format.
        field: &'static str,
        /// The value found.
        found: String,
        /// What is accepted.
        expected: String,
    },
    /// The axes are sheared, singular or not finite.
    #[error("its `space directions` cannot be used: {0}")]
    Grid(#[from] GridError),
    /// The data file is not there or cannot be opened.
    #[error("its data file `{name}` cannot be read: {error}")]
    DataFile {
        /// Its name.
        name: String,
        /// What the system said.
        error: io::Error,
    },
    /// The position cannot be written to an output.
    #[error("its position cannot be written to an output: {0}")]
    Position(NiftiProblem),
    /// Whatever can be wrong with the bytes of any volume.
    #[error(transparent)]
    Bytes(#[from] NiftiProblem),
}
