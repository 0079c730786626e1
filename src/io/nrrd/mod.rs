//! NRRD volumes (`.nrrd`, and `.nhdr` with its data beside it), told apart by content, never by name.
//!
//! Source: G. Kindlmann, *Definition of NRRD File Format* (teem.sourceforge.net/nrrd/format.html).
//!
//! # What is read
//! - Versions 1 to 5 of the format, three axes, integers of 8 to 64 bits, `float` and `double`, in both byte
//!   orders, `raw` or `gzip`. Compressed data is inflated to its end and its checksum verified.
//! - `space`: `left-posterior-superior`, `right-anterior-superior`, `left-anterior-superior` or their
//!   initials, with `space directions` and `space origin`. Others are refused: they do not tell left from
//!   right. Where there is no `space`, the axes are taken for left, posterior and superior with the first
//!   voxel at the origin, as ITK and 3D Slicer do, and [`Header::is_placed`] tells: a caller should warn.
//! - A `data file` of one name, in the header's own folder.
//! - Everything else, key/value pairs among it, is passed over: NRRD has no rescale, so samples are
//!   Hounsfield units.
//!
//! A header's free text (`content`, keys, comments) can name the patient. Nothing of it is kept or written.

mod data;
mod error;
mod header;
mod write;

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use crate::io::nifti::{Scan, Template};
use crate::space::Grid;

pub use error::{NrrdError, NrrdProblem};
pub use write::{OutputType, save_volume};

/// What every NRRD file begins with, before its version.
const MAGIC: &[u8] = b"NRRD000";

/// What a header says of a volume.
#[derive(Debug, Clone)]
pub struct Header {
    grid: Grid,
    template: Template,
    is_placed: bool,
}

impl Header {
    /// Size, spacing and position, axes in LPS order.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// How to write NIfTI files that overlay it, the axes stored as it stores them.
    pub fn template(&self) -> &Template {
        &self.template
    }

    /// Whether the file says where the volume is; otherwise left and right are assumed.
    pub fn is_placed(&self) -> bool {
        self.is_placed
    }
}

/// Whether a file is NRRD, of whatever version. Not one that cannot be read.
pub fn is_nrrd(path: &Path) -> bool {
    // Asked before opening: opening a pipe would wait for someone to write to it.
    if !fs::metadata(path).is_ok_and(|metadata| metadata.is_file()) {
        return false;
    }
    let mut start = Vec::new();
    let read = File::open(path).map(|file| file.take(MAGIC.len() as u64).read_to_end(&mut start));
    matches!(read, Ok(Ok(_))) && start == MAGIC
}

/// Reads and checks the header alone, however large the file.
///
/// # Errors
/// [`NrrdError`] for a file that [`read`] would refuse for its header or its length.
pub fn read_header(path: &Path) -> Result<Header, NrrdError> {
    data::open(path)
        .and_then(|file| file.header.placed())
        .map_err(|problem| NrrdError::new(path, problem))
}

/// Reads a volume. The SHA-256 is of the file's bytes; of a header and its data file, those of one after the
/// other.
///
/// # Errors
/// [`NrrdError`] names the file, the field or the part of it that is wrong, what was found and what is
/// expected.
pub fn read(path: &Path) -> Result<Scan, NrrdError> {
    data::open(path)
        .and_then(data::read)
        .map_err(|problem| NrrdError::new(path, problem))
}

#[cfg(test)]
mod tests;
