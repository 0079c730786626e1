//! What can be wrong with a folder of DICOM files, with a series and with a slice.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use thiserror::Error;

use super::geometry::GeometryFault;
use crate::space::GridError;

/// A folder or a series that cannot be used, and why.
///
/// Its text names files and series for whoever has the folder before them; nothing of it goes into records.
#[derive(Debug, Error)]
#[error("`{}`: {problem}", path.display())]
pub struct DicomError {
    /// The folder or the file, as the user named it.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: DicomProblem,
}

impl DicomError {
    pub(super) fn new(path: &Path, problem: DicomProblem) -> Self {
        Self {
            path: path.to_owned(),
            problem,
        }
    }
}

/// What is wrong with a folder or a series.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DicomProblem {
    /// The system will not list it.
    #[error("cannot be read: {0}")]
    Io(io::Error),
    /// It holds more than any export does.
    #[error("holds more than {limit} files; name the folder of one examination")]
    TooManyFiles {
        /// How many are looked at.
        limit: usize,
    },
    /// No file in it is a slice of a CT.
    #[error("is a folder that holds no CT series: {found}; name the folder that holds the slices")]
    NoSeries {
        /// What it holds instead.
        found: String,
    },
    /// There is a choice.
    #[error(
        "holds {count} CT series; choose one of them by its UID, with `series` in [ct] of a plan or `--series` of `info`:\n{table}"
    )]
    Several {
        /// How many.
        count: usize,
        /// They, one a line.
        table: String,
    },
    /// The one asked for is not there.
    #[error("holds no CT series with the UID {wanted}; it holds:\n{table}")]
    NoSuchSeries {
        /// The UID asked for.
        wanted: String,
        /// Those that are there, one a line.
        table: String,
    },
    /// One UID stands for slices that are no one stack.
    #[error(
        "under one UID are {count} stacks that differ in orientation, size or pixel spacing; put the files of one of them into a folder of their own:\n{table}"
    )]
    Mixed {
        /// How many.
        count: usize,
        /// They, one a line.
        table: String,
    },
    /// The file named belongs to no series that could be read.
    #[error("is not a slice of a CT series, but {found}")]
    NotASlice {
        /// What it is.
        found: String,
    },
    /// A file named by the user belongs to another series than the one asked for.
    #[error("belongs to the series {found}, but {wanted} is asked for; name its folder")]
    OtherSeries {
        /// Its own.
        found: String,
        /// The one asked for.
        wanted: String,
    },
    /// A file of the series, or one that may be of it.
    #[error("file `{file}` {problem}")]
    Slice {
        /// The name within the folder.
        file: String,
        /// What is wrong with it.
        problem: Arc<SliceProblem>,
    },
    /// The slices do not make a volume.
    #[error(
        "its {slices} slices are no regular stack: {}; rhinoplan does not resample: {remedy}",
        Listed(faults)
    )]
    Geometry {
        /// How many slices.
        slices: usize,
        /// Everything that is wrong, at least one.
        faults: Vec<GeometryFault>,
        /// What to do.
        remedy: &'static str,
    },
    /// The slices make no grid.
    #[error("its geometry cannot be used: {0}")]
    Grid(#[from] GridError),
    /// Voxels lie further from the patient's origin than any scanner's do.
    #[error(
        "has voxels {found:.0} mm from the origin, more than {limit:.0} mm; ImagePositionPatient (0020,0032) or the spacing is damaged: export the series again"
    )]
    FarAway {
        /// The largest coordinate, mm.
        found: f64,
        /// The largest that is accepted, mm.
        limit: f64,
    },
    /// More than is read.
    #[error("claims {voxels} voxels, more than {limit}; name the folder of a head CT")]
    TooManyVoxels {
        /// Found.
        voxels: u64,
        /// Accepted.
        limit: u64,
    },
    /// The machine has no memory for the samples.
    #[error("needs {bytes} bytes of memory for its samples, which are not to be had")]
    Memory {
        /// Bytes asked for.
        bytes: u64,
    },
    /// The volume cannot be written as NIfTI.
    #[error("no NIfTI header can describe it: {0}")]
    Template(String),
}

struct Listed<'a>(&'a [GeometryFault]);

impl fmt::Display for Listed<'_> {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, fault) in self.0.iter().enumerate() {
            if index > 0 {
                to.write_str("; ")?;
            }
            fault.fmt(to)?;
        }
        Ok(())
    }
}

/// What is wrong with a file, worded to follow its name.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SliceProblem {
    /// It is none of this module's.
    #[error("is no DICOM file: there is no \"DICM\" at byte 128")]
    NotDicom,
    /// The system will not read it.
    #[error("cannot be read: {0}")]
    Io(io::Error),
    /// It is larger than a slice can be.
    #[error("is {bytes} bytes long, more than {limit}; one slice is expected in it")]
    TooLarge {
        /// Found.
        bytes: u64,
        /// Accepted.
        limit: u64,
    },
    /// It is not what it was when the folder was looked at.
    #[error("changed while the series was read; read it again")]
    Changed,
    /// The meta information names no transfer syntax.
    #[error("names no transfer syntax (0002,0010); export it again")]
    NoSyntax,
    /// It ends within an element.
    #[error("ends inside its header; copy or export it again")]
    HeaderCut,
    /// The header goes on and on.
    #[error("has no pixels within {limit} bytes; export it again without private elements")]
    HeaderTooLong {
        /// Bytes looked through.
        limit: u64,
    },
    /// Its elements cannot be told apart.
    #[error("is damaged: {0}; copy or export it again")]
    Damaged(String),
    /// An element that a slice needs is absent.
    #[error("has no {element}; export it again, as CT Image Storage")]
    Missing {
        /// Name and tag.
        element: &'static str,
    },
    /// An element with a value that cannot be used.
    #[error("has {element} {found}, expected {expected}")]
    Element {
        /// Name and tag.
        element: &'static str,
        /// The value found.
        found: String,
        /// What is accepted.
        expected: String,
    },
    /// Row and column direction are no pair of axes.
    #[error(
        "has ImageOrientationPatient (0020,0037) with axes of length {row:.4} and {column:.4} at {angle_deg:.2}°, expected two of length 1 at 90°; export it again"
    )]
    Orientation {
        /// Length of the first.
        row: f64,
        /// Length of the second.
        column: f64,
        /// Between them, degrees.
        angle_deg: f64,
    },
    /// The pixels are packed in a way that is not read.
    #[error(
        "is packed as {syntax}, which rhinoplan does not decode; convert it to Explicit VR Little Endian ({unpacked_by})"
    )]
    Syntax {
        /// Name and UID.
        syntax: String,
        /// Programs that do.
        unpacked_by: &'static str,
    },
    /// Fewer or more bytes of pixels than rows and columns make.
    #[error(
        "has {found} bytes of pixels, {expected} expected of its rows, columns and bits; copy or export it again"
    )]
    PixelLength {
        /// Found.
        found: u64,
        /// Expected.
        expected: u64,
    },
    /// Packed pixels end early.
    #[error("ends inside its pixels; copy or export it again")]
    FragmentsCut,
    /// So few bytes cannot hold so many pixels.
    #[error("claims {expected} bytes of pixels, more than {found} bytes can hold; it is damaged")]
    Implausible {
        /// Bytes of the file.
        found: u64,
        /// Bytes that rows, columns and bits claim.
        expected: u64,
    },
    /// The packed image is another than the one that rows and columns describe.
    #[error("holds a packed image of {found}, expected {expected}; export it again")]
    Packed {
        /// What the packed image says of itself.
        found: String,
        /// What the elements say.
        expected: String,
    },
    /// The machine has no memory for it.
    #[error("needs {bytes} bytes of memory, which are not to be had")]
    Memory {
        /// Bytes asked for.
        bytes: u64,
    },
    /// The decoder gave up.
    #[error("cannot be decoded ({syntax}): {message}; export it again, uncompressed")]
    Decode {
        /// Name and UID.
        syntax: String,
        /// What it said.
        message: String,
    },
}

impl SliceProblem {
    /// That of a file on which a decoder panicked.
    pub(super) fn misfit() -> Self {
        Self::Damaged("its elements do not fit together".to_owned())
    }
}

/// What a decoder says, and what led to it.
pub(super) fn with_sources(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        text = format!("{text}: {error}");
        source = error.source();
    }
    text
}
