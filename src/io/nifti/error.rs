//! What can be wrong with a NIfTI file, and with writing one.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::header::Transform;
use crate::io::artifact::ArtifactError;
use crate::space::GridError;

/// A file that cannot be used, and why.
#[derive(Debug, Error)]
#[error("`{}`: {problem}", path.display())]
pub struct NiftiError {
    /// The file, as the user named it.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: NiftiProblem,
}

impl NiftiError {
    pub(super) fn new(path: &Path, problem: NiftiProblem) -> Self {
        Self {
            path: path.to_owned(),
            problem,
        }
    }
}

/// What is wrong with a file: what was found, what is expected, and a remedy where one is plain.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NiftiProblem {
    /// The system will not open or read it.
    #[error("cannot be read: {0}")]
    Io(io::Error),
    /// A folder, a pipe or a device.
    #[error("is {found}, not a file; name a .nii or .nii.gz file")]
    NotAFile {
        /// "a folder" or the like.
        found: &'static str,
    },
    /// No bytes at all.
    #[error("is empty; copy or export it again")]
    Empty,
    /// Another format that is easily taken for NIfTI-1.
    #[error("is {found}, which is not supported; {remedy}")]
    Foreign {
        /// The format found.
        found: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// Not an image of any format known here.
    #[error(
        "is not a NIfTI-1 file: its first number (sizeof_hdr) is {found}, expected 348 in either byte order"
    )]
    NotNifti {
        /// The first four bytes as a little-endian number.
        found: i32,
    },
    /// Too short for a header.
    #[error("ends inside the header: {found} of 348 bytes are there; copy or export it again")]
    HeaderCut {
        /// Bytes found.
        found: usize,
    },
    /// A header field with a value that cannot be used.
    #[error("header field {field} is {found}, expected {expected}; {remedy}")]
    Field {
        /// The field's name in the standard.
        field: &'static str,
        /// The value found.
        found: String,
        /// What is accepted.
        expected: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The affine is sheared, not finite or otherwise unusable.
    #[error("its {transform} cannot be used: {error}")]
    Grid {
        /// Where the affine was taken from.
        transform: Transform,
        /// What is wrong with it.
        error: GridError,
    },
    /// The samples end early.
    #[error(
        "is cut short: header and samples need {needed} bytes, {missing} are missing at the end; copy or export it again"
    )]
    Truncated {
        /// Bytes of header and samples, uncompressed.
        needed: u64,
        /// How many of them are not there.
        missing: u64,
    },
    /// The gzip stream is cut, damaged, or fails its checksum.
    #[error(
        "the gzip stream is damaged or cut ({error}); nothing in it can be trusted: copy or export the file again"
    )]
    Gzip {
        /// What the decompressor said.
        error: io::Error,
    },
    /// A gzip stream that could not hold the samples, whatever they are.
    #[error(
        "claims {needed} bytes of header and samples, more than {compressed} bytes of gzip can hold; the header (dim) or the file is damaged"
    )]
    Implausible {
        /// Bytes that the header asks for.
        needed: u64,
        /// Length of the file.
        compressed: u64,
    },
    /// A gzip stream that goes on after the samples.
    #[error(
        "more than {limit} bytes follow the samples in the gzip stream; check dim in the header, or export the file again"
    )]
    TooLong {
        /// How many are read before giving up.
        limit: u64,
    },
    /// NaN or infinity among the samples, or what is far beyond Hounsfield units.
    #[error(
        "{count} of {total} voxels are {}; the first is {value} at stored index ({}, {}, {}); replace them (air is -1000 HU) in the program that wrote the file",
        if value.is_finite() { "too large for Hounsfield units" } else { "not numbers" },
        first[0], first[1], first[2]
    )]
    NotFinite {
        /// How many.
        count: u64,
        /// Of how many.
        total: u64,
        /// The first of them, in the file's own axis order.
        first: [usize; 3],
        /// Its value.
        value: f64,
    },
    /// The machine has no memory for the samples.
    #[error("needs {bytes} bytes of memory for its samples, which are not to be had")]
    Memory {
        /// Bytes asked for.
        bytes: u64,
    },
    /// The decoder refused what the checks let through.
    #[error("cannot be decoded: {0}")]
    Decode(String),
}

/// Why a volume or a field was not written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The writer failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The output file failed.
    #[error(transparent)]
    Artifact(#[from] ArtifactError),
    /// The volume is not one that this template describes.
    #[error("the volume's {what} is {found}, its template's {expected}")]
    Mismatch {
        /// "sample type", "grid" or "rescale".
        what: &'static str,
        /// The volume's.
        found: String,
        /// The template's.
        expected: String,
    },
}
