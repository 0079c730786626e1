//! A series that has been chosen: its grid from headers, its voxels from files.

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use ndarray::{Array3, ArrayViewMut2, Axis};
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::elements::DataSet;
use super::error::{DicomError, DicomProblem, SliceProblem};
use super::geometry::Stack;
use super::panics::caught;
use super::pixels;
use super::slice::{Kind, MAX_FILE_BYTES, Slice, classify};
use crate::io::StoredAxes;
use crate::io::digest;
use crate::io::nifti::Template;
use crate::space::Grid;
use crate::text::shown_name;
use crate::volume::{AnyVolume, Rescale, Sample, SampleType, Volume, zeroed};

/// What voxels become that hold no measurement (PixelPaddingValue), HU: air, and what most scanners write
/// outside their field of view.
pub const PADDING_HU: f64 = -1024.0;

/// The most voxels of a series: 2¹³ slices of 512 × 512, 25 times a head. Packed slices claim far more bytes than
/// they have, and memory is asked for before they are unpacked.
const MAX_VOXELS: u64 = 1 << 31;

/// A series of a [`super::Folder`], its slices in order.
#[derive(Debug)]
pub struct Series<'a> {
    folder: &'a Path,
    slices: Vec<&'a (OsString, Slice)>,
    grid: Grid,
    axes: StoredAxes,
    /// Whether samples become HU on reading, because they mean something else from slice to slice.
    converts: bool,
    sample_type: SampleType,
    rescale: Rescale,
    template: Template,
}

/// A series with its voxels.
#[derive(Debug, Clone)]
pub struct Scan {
    /// The samples, axes in LPS order: as stored, or HU where slices are scaled differently.
    pub volume: AnyVolume,
    /// How to write what overlays it: in LPS order.
    pub template: Template,
    /// The SHA-256 of the series: see [`Series::read`].
    pub sha256: String,
    /// How many voxels held no measurement and became air.
    pub padded: u64,
}

impl<'a> Series<'a> {
    pub(super) fn new(
        folder: &'a Path,
        slices: &'a [(OsString, Slice)],
        stack: Stack,
    ) -> Result<Self, DicomProblem> {
        let Stack {
            order, grid, axes, ..
        } = stack;
        let slices: Vec<_> = order
            .iter()
            .filter_map(|&index| slices.get(index))
            .collect();
        let voxels = grid.dims().iter().map(|&n| n as u64).product();
        if voxels > MAX_VOXELS {
            let limit = MAX_VOXELS;
            return Err(DicomProblem::TooManyVoxels { voxels, limit });
        }
        let meaning = |slice: &Slice| (slice.format.sample_type(), slice.rescale);
        let meanings: Vec<_> = slices.iter().map(|(_, slice)| meaning(slice)).collect();
        let same = meanings.windows(2).all(|pair| pair[0] == pair[1]);
        let (sample_type, rescale) = match meanings.first() {
            Some(first) if same => *first,
            _ => (common_type(&slices), Rescale::NONE),
        };
        let template = Template::for_grid(&grid, sample_type, rescale)
            .map_err(|problem| DicomProblem::Template(problem.to_string()))?;
        Ok(Self {
            folder,
            slices,
            grid,
            axes,
            converts: !same,
            sample_type,
            rescale,
            template,
        })
    }

    /// Size, spacing and position, axes in LPS order.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// How the series lies: its columns, rows and slices in order of the normal, `LPS` for a common axial one.
    pub fn orientation(&self) -> StoredAxes {
        self.axes
    }

    /// How many slices it has.
    pub fn slices(&self) -> usize {
        self.slices.len()
    }

    /// Whether pixels were compressed with loss on the way, so that HU are approximate.
    pub fn is_lossy(&self) -> bool {
        self.slices.iter().any(|(_, slice)| slice.lossy)
    }

    /// Reads the voxels, slices in parallel; beside the volume a file or two for each thread are held.
    ///
    /// The digest does not depend on names: the SHA-256 of every slice's file as a line of 64 lower-case
    /// hexadecimal digits, lines sorted, and the SHA-256 of that text.
    ///
    /// # Errors
    /// [`DicomError`] for the first slice, in order, that cannot be decoded.
    pub fn read(&self) -> Result<Scan, DicomError> {
        match self.sample_type {
            SampleType::U8 => self.typed::<u8>(),
            SampleType::I8 => self.typed::<i8>(),
            SampleType::U16 => self.typed::<u16>(),
            SampleType::I16 => self.typed::<i16>(),
            _ => self.typed::<f32>(),
        }
    }

    fn typed<T: Sample>(&self) -> Result<Scan, DicomError> {
        let fail = |problem| DicomError::new(self.folder, problem);
        let voxels = self.grid.len();
        let memory = || DicomProblem::Memory {
            bytes: voxels as u64 * size_of::<T>() as u64,
        };
        let samples = zeroed::<T>(voxels).map_err(|_| fail(memory()))?;
        let [nx, ny, nz] = self.grid.dims();
        let mut samples =
            Array3::from_shape_vec((nz, ny, nx), samples).map_err(|_| fail(memory()))?;
        let mut stored = self.axes.stored_view(samples.view_mut());
        let read: Vec<_> = stored
            .axis_iter_mut(Axis(0))
            .into_par_iter()
            .zip(&self.slices)
            .map(|(plane, (file, slice))| self.slice(file, slice, plane))
            .collect();
        let mut lines = Vec::with_capacity(read.len());
        let mut padded = 0;
        for (result, (file, _)) in read.into_iter().zip(&self.slices) {
            let file = shown_name(file);
            let (sha256, count) = result.map_err(|problem| {
                let problem = Arc::new(problem);
                fail(DicomProblem::Slice { file, problem })
            })?;
            lines.push(sha256 + "\n");
            padded += count;
        }
        lines.sort();
        let volume = Volume::new(self.grid.clone(), self.rescale, samples);
        Ok(Scan {
            volume: T::wrap(volume.map_err(|_| fail(memory()))?),
            template: self.template.clone(),
            sha256: digest::sha256_hex_of(lines),
            padded,
        })
    }

    /// Fills a plane from a file. The file's SHA-256, and how many voxels are padding.
    fn slice<T: Sample>(
        &self,
        file: &OsStr,
        slice: &Slice,
        mut plane: ArrayViewMut2<'_, T>,
    ) -> Result<(String, u64), SliceProblem> {
        let bytes = whole(&self.folder.join(file))?;
        let data_set =
            caught(|| DataSet::open(bytes.as_slice())).unwrap_or(Err(SliceProblem::Changed))?;
        match classify(&data_set, bytes.len() as u64) {
            (_, Kind::Slice(now)) if *now == *slice => {}
            _ => return Err(SliceProblem::Changed),
        }
        let stored = caught(|| pixels::stored(slice, &bytes, data_set))
            .unwrap_or_else(|| Err(SliceProblem::misfit()))?;
        let (format, rescale) = (slice.format, slice.rescale);
        let air = match self.converts {
            true => PADDING_HU,
            false => (PADDING_HU - rescale.intercept) / rescale.slope,
        };
        let air = T::from_interpolated(air);
        let (first, last) = slice.padding.unwrap_or((i32::MAX, i32::MIN));
        let mut padded = 0;
        let width = format.sample_bytes();
        let rows = stored.chunks_exact(width * format.columns);
        for (mut row, stored) in plane.rows_mut().into_iter().zip(rows) {
            for (voxel, sample) in row.iter_mut().zip(stored.chunks_exact(width)) {
                let raw = match *sample {
                    [low, high] => u16::from_le_bytes([low, high]),
                    [byte] => byte.into(),
                    _ => 0,
                };
                let value = format.value(raw);
                *voxel = if first <= value && value <= last {
                    padded += 1;
                    air
                } else if self.converts {
                    T::from_interpolated(rescale.to_hu(value.into()))
                } else {
                    T::from_interpolated(value.into())
                };
            }
        }
        Ok((digest::hex(&Sha256::digest(&bytes)), padded))
    }
}

/// A type for the HU of every slice: `i16` where all are whole and fit, else `f32`, which holds 16 bits times any
/// slope to a part in ten million.
fn common_type(slices: &[&(OsString, Slice)]) -> SampleType {
    let fits = slices.iter().all(|(_, slice)| {
        let Rescale { slope, intercept } = slice.rescale;
        let (low, high) = slice.format.range();
        let whole = slope.fract() == 0.0 && intercept.fract() == 0.0;
        let within = [low, high].into_iter().all(|end| {
            (f64::from(i16::MIN)..=f64::from(i16::MAX)).contains(&slice.rescale.to_hu(end))
        });
        whole && within
    });
    if fits {
        SampleType::I16
    } else {
        SampleType::F32
    }
}

/// A file's bytes, never more than [`MAX_FILE_BYTES`].
fn whole(path: &Path) -> Result<Vec<u8>, SliceProblem> {
    let metadata = std::fs::metadata(path).map_err(SliceProblem::Io)?;
    if !metadata.is_file() {
        return Err(SliceProblem::Changed);
    }
    let file = File::open(path).map_err(SliceProblem::Io)?;
    let expected = metadata.len().min(MAX_FILE_BYTES);
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(usize::try_from(expected).unwrap_or(usize::MAX))
        .map_err(|_| SliceProblem::Memory { bytes: expected })?;
    file.take(MAX_FILE_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(SliceProblem::Io)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(SliceProblem::Changed);
    }
    Ok(bytes)
}
