//! NIfTI-1 volumes: single files `.nii` and `.nii.gz`, told apart by content, never by name.
//!
//! [`read_header`] looks at the first 352 bytes, [`read`] takes the whole file. Both give a [`Template`]:
//! the header as it was, and how the stored axes lie in LPS order. Whatever is computed from a scan is
//! written through its template, so that an output overlays its input in every viewer.
//!
//! The `nifti` crate parses the header and decodes samples. Everything about it that goes wrong without
//! a word is kept out of its reach: this module opens files, inflates and verifies gzip, checks the
//! header before anything is allocated, computes the affine, and writes.
//!
//! # What is read
//! - All integer types of 8 to 64 bits, `f32` and `f64`, in both byte orders. RGB, complex and 128-bit
//!   floats are refused, as are NIfTI-2, Analyze 7.5 and `.hdr`/`.img` pairs.
//! - 3-D volumes; further axes must have length 1.
//! - `scl_slope` of zero or not finite means no scaling, as in nibabel.
//! - Position: the sform where `sform_code > 0`, else the qform where `qform_code > 0`, else "method 1"
//!   of the standard: spacing from `pixdim`, axes right, anterior, superior, first voxel at the origin.
//!   Programs disagree about the last (ITK takes LPS axes; nibabel mirrors x and centres the volume), so
//!   left and right are then a guess: [`Template::transform`] tells, and a caller should warn.
//! - Metres and micrometres (`xyzt_units`) are converted to mm; unknown units are taken as mm.
//! - Bytes after the samples are ignored, as in nibabel, but a gzip stream is always read to its end
//!   and its checksums verified; it may have several members.
//! - A float volume with NaN or infinity in it is refused.
//!
//! # Privacy
//! A header's free text (`descrip`, `aux_file`, `intent_name`, `db_name`, `data_type`) and its extensions
//! (which may be whole DICOM headers) can name the patient. Nothing of them is kept or written.

mod affine;
mod error;
mod header;
mod samples;
mod source;
mod template;
mod write;

use std::path::Path;

use crate::volume::{AnyVolume, Spares};

pub use super::axes::StoredAxes;
pub use error::{NiftiError, NiftiProblem, WriteError};
pub use header::{ByteOrder, Transform};
pub use template::Template;
pub use write::{GridSlab, SLAB, save_displacement, save_volume};

// What other formats of volumes share.
pub(super) use header::FIRST_OFFSET;
pub(super) use samples::NotNumbers;
pub(super) use source::{Content, LARGEST_RATIO, check_claim};
pub(super) use write::{row_of, write_rows};

/// A volume as [`read`] found it.
#[derive(Debug, Clone)]
pub struct Scan {
    /// The samples as stored, axes in LPS order.
    pub volume: AnyVolume,
    /// How to write something that overlays it.
    pub template: Template,
    /// SHA-256 of the file's bytes (of the compressed ones where it is compressed).
    pub sha256: [u8; 32],
}

/// Reads and checks the header alone, however large the file.
///
/// # Errors
/// [`NiftiError`] for a file that [`read`] would refuse for its header or its length.
pub fn read_header(path: &Path) -> Result<Template, NiftiError> {
    let read = || {
        let source = source::Source::open(path)?;
        Template::from_header(&source.header()?)
    };
    read().map_err(|problem| NiftiError::new(path, problem))
}

/// Reads a volume.
///
/// # Errors
/// [`NiftiError`] names the file, the field or the part of it that is wrong, what was found and what is
/// expected.
pub fn read(path: &Path) -> Result<Scan, NiftiError> {
    read_with(path, &Spares::default())
}

/// As [`read`]. A gzip file of one member, in this machine's byte order and with nothing after the samples, is inflated
/// at once; where it was is then among `spares`. Other files are read in pieces, about 2 MiB beside the samples.
///
/// # Errors
/// As [`read`].
pub fn read_with(path: &Path, spares: &Spares) -> Result<Scan, NiftiError> {
    let read = || {
        let source = source::Source::open(path)?;
        let header = source.header()?;
        let template = Template::from_header(&header)?;
        let (volume, sha256) = samples::read(source, &header, &template, spares)?;
        Ok(Scan {
            volume,
            template,
            sha256,
        })
    };
    read().map_err(|problem| NiftiError::new(path, problem))
}
