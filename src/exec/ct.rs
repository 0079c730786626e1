//! The CT that a plan names: a NIfTI-1 or NRRD file, a series of DICOM slices, or the built-in phantom.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::io::StoredAxes;
use crate::io::dicom::{self, DicomError, Folder, Series};
use crate::io::digest;
use crate::io::nifti::{self, NiftiError, NiftiProblem, Template, Transform};
use crate::io::nrrd::{self, NrrdError};
use crate::phantom::Phantom as Head;
use crate::plan::{CtSource, Phantom};
use crate::report::record::CtRecord;
use crate::space::{Grid, GridError};
use crate::volume::{AnyVolume, Rescale, Sample, SampleType, Spares, Volume, VolumeError};
use crate::with_volume;

/// Why a CT cannot be used.
#[derive(Debug, Error)]
pub enum CtError {
    /// The file is not a volume that can be read.
    #[error(transparent)]
    Nifti(#[from] NiftiError),
    /// As [`CtError::Nifti`], of an NRRD file.
    #[error(transparent)]
    Nrrd(#[from] NrrdError),
    /// The folder holds no series that can be read, or a choice of them.
    #[error(transparent)]
    Dicom(#[from] DicomError),
    /// A series is asked for of a file that has none.
    #[error(
        "`{}` is no DICOM file or folder, so `ct.series` (or `--series`) chooses nothing in it; leave it out, or name the folder",
        path.display()
    )]
    NoSeries {
        /// The file.
        path: PathBuf,
    },
    /// The file is not the one that the plan was made for.
    #[error(
        "the CT is not the one that the plan is pinned to: its SHA-256 is {found}, the plan's `ct.sha256` {expected}; use the pinned file, or check the landmarks on this one and change the pin"
    )]
    Pin {
        /// The plan's.
        expected: String,
        /// The file's.
        found: String,
    },
    /// The phantom cannot be made.
    #[error("the phantom cannot be made: {0}")]
    Phantom(#[from] VolumeError),
    /// As [`CtError::Phantom`].
    #[error("the phantom cannot be made: {0}")]
    PhantomGrid(#[from] GridError),
    /// As [`CtError::Phantom`].
    #[error("the phantom cannot be made: {0}")]
    PhantomHeader(#[from] NiftiProblem),
}

/// What can be told of a CT without its voxels.
#[derive(Debug, Clone)]
pub struct CtHeader {
    /// The exact grid.
    pub grid: Grid,
    /// What it is read from.
    pub kind: CtKind,
}

/// What a CT is read from.
#[derive(Debug, Clone)]
pub enum CtKind {
    /// A NIfTI-1 file, and what it says of itself.
    Nifti(Box<Template>),
    /// An NRRD file.
    Nrrd {
        /// Whether it says where the volume is.
        is_placed: bool,
    },
    /// A series of DICOM slices.
    Dicom {
        /// How many.
        slices: usize,
        /// Whether they were compressed with loss.
        lossy: bool,
    },
    /// The built-in head.
    Phantom,
}

impl CtHeader {
    /// That of a series.
    pub fn of_series(series: &Series<'_>) -> Self {
        Self {
            grid: series.grid().clone(),
            kind: CtKind::Dicom {
                slices: series.slices(),
                lossy: series.is_lossy(),
            },
        }
    }

    /// What the user should know of it.
    pub fn warning(&self) -> Option<String> {
        match &self.kind {
            CtKind::Nifti(template) if template.transform() == Transform::None => Some(
                "the CT's header gives no position (neither sform nor qform): left and right are taken as \
                 NIfTI's method 1 says, and may be swapped; check with a viewer"
                    .to_owned(),
            ),
            CtKind::Dicom { lossy: true, .. } => Some(
                "the CT's slices were compressed with loss: Hounsfield units, and what is measured by them, are \
                 approximate"
                    .to_owned(),
            ),
            CtKind::Nrrd { is_placed: false } => Some(
                "the CT's header gives no position (no `space`): its axes are taken for left, posterior and \
                 superior, and may be others; check with a viewer"
                    .to_owned(),
            ),
            _ => None,
        }
    }
}

/// A CT with its voxels.
#[derive(Debug)]
pub struct Ct {
    /// The samples as stored, axes in LPS order.
    pub volume: AnyVolume,
    /// How to write what overlays it.
    pub template: Template,
    /// What the record says of it.
    pub record: CtRecord,
}

/// Reads the header alone, however large the file.
///
/// # Errors
/// [`CtError`] for a CT that [`load`] would refuse for its header.
pub fn header(source: &CtSource) -> Result<CtHeader, CtError> {
    match source {
        CtSource::File { path, series, .. } if dicom::is_dicom(path) => {
            let folder = Folder::scan(path)?;
            Ok(CtHeader::of_series(&folder.choose(series.as_deref())?))
        }
        CtSource::File {
            path,
            series: Some(_),
            ..
        } => Err(CtError::NoSeries { path: path.clone() }),
        CtSource::File { path, .. } if nrrd::is_nrrd(path) => {
            let header = nrrd::read_header(path)?;
            Ok(CtHeader {
                grid: header.grid().clone(),
                kind: CtKind::Nrrd {
                    is_placed: header.is_placed(),
                },
            })
        }
        CtSource::File { path, .. } => {
            let template = nifti::read_header(path)?;
            Ok(CtHeader {
                grid: template.grid().clone(),
                kind: CtKind::Nifti(Box::new(template)),
            })
        }
        CtSource::Phantom(Phantom::Lee2001) => Ok(CtHeader {
            grid: Head::default_grid()?,
            kind: CtKind::Phantom,
        }),
    }
}

/// Reads the CT.
///
/// # Errors
/// [`CtError`] where it cannot be used, or is not the one that the plan pins.
pub fn load(source: &CtSource) -> Result<Ct, CtError> {
    load_with(source, &Spares::default())
}

/// As [`load`]; memory that was needed to read it is then among `spares`.
///
/// # Errors
/// As [`load`].
pub fn load_with(source: &CtSource, spares: &Spares) -> Result<Ct, CtError> {
    let ct = match source {
        CtSource::File { path, series, .. } if dicom::is_dicom(path) => {
            let folder = Folder::scan(path)?;
            load_series(&folder.choose(series.as_deref())?)?
        }
        CtSource::File {
            path,
            series: Some(_),
            ..
        } => return Err(CtError::NoSeries { path: path.clone() }),
        CtSource::File { path, .. } => load_file(path, spares)?,
        CtSource::Phantom(phantom) => return load_phantom(*phantom),
    };
    if let CtSource::File {
        sha256: Some(expected),
        ..
    } = source
        && *expected != ct.record.sha256
    {
        return Err(CtError::Pin {
            expected: expected.clone(),
            found: ct.record.sha256,
        });
    }
    Ok(ct)
}

fn load_file(path: &Path, spares: &Spares) -> Result<Ct, CtError> {
    let (format, scan) = if nrrd::is_nrrd(path) {
        ("nrrd", nrrd::read(path)?)
    } else {
        ("nifti", nifti::read_with(path, spares)?)
    };
    let sha256 = digest::hex(&scan.sha256);
    let stored = scan.template.orientation();
    let record = record(format, None, sha256, &scan.volume, stored);
    Ok(Ct {
        volume: scan.volume,
        template: scan.template,
        record,
    })
}

/// A series, its header and its voxels. What is written of it is in LPS order.
///
/// # Errors
/// [`CtError`] where a slice cannot be decoded.
pub fn load_series(series: &Series<'_>) -> Result<Ct, CtError> {
    let scan = series.read()?;
    let stored = series.orientation();
    let record = record("dicom", None, scan.sha256, &scan.volume, stored);
    Ok(Ct {
        volume: scan.volume,
        template: scan.template,
        record,
    })
}

fn load_phantom(phantom: Phantom) -> Result<Ct, CtError> {
    let Phantom::Lee2001 = phantom;
    let volume = Head::lee2001().render(&Head::default_grid()?)?;
    let template = Template::for_grid(volume.grid(), SampleType::I16, Rescale::NONE)?;
    let sha256 = digest::sha256_hex_of(volume.as_slice().iter().map(|sample| sample.to_le_bytes()));
    let volume = AnyVolume::I16(volume);
    let stored = template.orientation();
    let record = record("phantom", Some(phantom.name()), sha256, &volume, stored);
    Ok(Ct {
        volume,
        template,
        record,
    })
}

fn record(
    source: &'static str,
    phantom: Option<&'static str>,
    sha256: String,
    volume: &AnyVolume,
    stored: StoredAxes,
) -> CtRecord {
    fn rescale<T: Sample>(volume: &Volume<T>) -> Rescale {
        volume.rescale()
    }
    let rescale = with_volume!(volume, volume => rescale(volume));
    let (low, high) = volume.hu_range();
    CtRecord {
        source,
        phantom,
        sha256,
        sample_type: volume.sample_type(),
        slope: rescale.slope,
        intercept: rescale.intercept,
        stored_orientation: stored.to_string(),
        grid: volume.grid().clone(),
        hu_range: [low, high],
    }
}
