//! CT series in DICOM: a folder of slices, one file each, in any order and under any names.
//!
//! [`Folder::scan`] reads every header in a folder, [`Folder::choose`] picks a series and finds its grid, and
//! [`Series::read`] takes its voxels. Nothing is resampled: what is not a regular stack is refused with what is
//! irregular about it.
//!
//! # What is read
//! - CT Image Storage: one frame, one sample a pixel, MONOCHROME2, 8 or 16 bits allocated, signed or not.
//! - Files with a preamble and meta information (PS3.10), in implicit or explicit little endian, big endian or
//!   deflated; pixels as they are, run-length encoded, JPEG (8-bit baseline and extended, lossless), JPEG 2000,
//!   JPEG-LS, JPEG XL. Every other transfer syntax is refused by its name.
//! - A series is the files of one SeriesInstanceUID, orientation, size and pixel spacing. Localizers,
//!   secondary captures, other modalities, images of several frames, DICOMDIR and files that are no DICOM are
//!   left out, and told of by [`Folder::series`] and [`Folder::others`]. A file of the series that is damaged is an
//!   error, never left out.
//! - Slices are ordered by ImagePositionPatient along the normal of ImageOrientationPatient, and so spaced.
//! - Samples stay as they are stored where every slice has the same RescaleSlope and RescaleIntercept (1 and 0
//!   where they are left out); else all become HU.
//! - Voxels of PixelPaddingValue (to PixelPaddingRangeLimit) become air, [`PADDING_HU`].
//!
//! # Privacy
//! Of a file's elements only those that place and scale its pixels are kept (`elements`), and the
//! SeriesInstanceUID, the series' number and the modality, to choose by. These are shown to the user, and are in
//! no volume, template or record.

mod elements;
mod error;
mod folder;
mod geometry;
mod jpeg_ls;
mod jpeg_xl;
mod packed;
mod panics;
mod pixels;
mod series;
mod slice;
mod syntax;

pub use error::{DicomError, DicomProblem, SliceProblem};
pub use folder::{Folder, OtherFiles, SeriesLine, SeriesState, is_dicom};
pub use geometry::{Gap, GeometryFault};
pub use series::{PADDING_HU, Scan, Series};
pub use slice::Skip;
