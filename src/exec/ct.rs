//! The CT that a plan names: a file, or the built-in phantom.

use std::path::Path;

use thiserror::Error;

use crate::io::digest;
use crate::io::nifti::{self, NiftiError, NiftiProblem, Template, Transform};
use crate::phantom::Phantom as Head;
use crate::plan::{CtSource, Phantom};
use crate::report::record::CtRecord;
use crate::space::{Grid, GridError};
use crate::volume::{AnyVolume, Rescale, Sample, SampleType, Volume, VolumeError};
use crate::with_volume;

/// Why a CT cannot be used.
#[derive(Debug, Error)]
pub enum CtError {
    /// The file is not a volume that can be read.
    #[error(transparent)]
    Nifti(#[from] NiftiError),
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
    /// What the file says of itself; none for a phantom.
    pub template: Option<Template>,
}

impl CtHeader {
    /// What the user should know of it.
    pub fn warning(&self) -> Option<String> {
        let template = self.template.as_ref()?;
        (template.transform() == Transform::None).then(|| {
            "the CT's header gives no position (neither sform nor qform): left and right are taken as \
             NIfTI's method 1 says, and may be swapped; check with a viewer"
                .to_owned()
        })
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
        CtSource::File { path, .. } => {
            let template = nifti::read_header(path)?;
            Ok(CtHeader {
                grid: template.grid().clone(),
                template: Some(template),
            })
        }
        CtSource::Phantom(Phantom::Lee2001) => Ok(CtHeader {
            grid: Head::default_grid()?,
            template: None,
        }),
    }
}

/// Reads the CT.
///
/// # Errors
/// [`CtError`] where it cannot be used, or is not the one that the plan pins.
pub fn load(source: &CtSource) -> Result<Ct, CtError> {
    match source {
        CtSource::File { path, sha256, .. } => load_file(path, sha256.as_deref()),
        CtSource::Phantom(phantom) => load_phantom(*phantom),
    }
}

fn load_file(path: &Path, pin: Option<&str>) -> Result<Ct, CtError> {
    let scan = nifti::read(path)?;
    let found = digest::hex(&scan.sha256);
    if let Some(expected) = pin
        && expected != found
    {
        return Err(CtError::Pin {
            expected: expected.to_owned(),
            found,
        });
    }
    let record = record("nifti", None, found, &scan.volume, &scan.template);
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
    let record = record("phantom", Some(phantom.name()), sha256, &volume, &template);
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
    template: &Template,
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
        stored_orientation: template.orientation().to_string(),
        grid: volume.grid().clone(),
        hu_range: [low, high],
    }
}
