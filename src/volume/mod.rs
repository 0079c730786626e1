//! A grid with its samples.
//!
//! Samples keep the file's own type; [`Rescale`] says what they mean in Hounsfield units. So a volume
//! that nothing changes is written back bit for bit.

mod copies;
mod mask;
mod pages;
mod sample;
mod spares;
mod trilinear;

use ndarray::{Array3, ArrayView3, ArrayViewMut3};
use rayon::prelude::*;
use thiserror::Error;

use crate::space::Grid;

pub use copies::Copies;
pub use mask::Mask;
pub use pages::{room, untouched_zeros};
pub use sample::{Sample, SampleType};
pub use spares::Spares;
pub use trilinear::Trilinear;

/// Samples that one thread takes at once where there is little to do for each.
const PART: usize = 1 << 16;

/// Hounsfield units from stored samples: `slope · stored + intercept`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rescale {
    /// HU per stored step; never zero, always finite.
    pub slope: f64,
    /// HU of a stored zero; always finite.
    pub intercept: f64,
}

impl Rescale {
    /// Samples that are Hounsfield units already.
    pub const NONE: Self = Self {
        slope: 1.0,
        intercept: 0.0,
    };

    /// The Hounsfield units that a stored value stands for.
    #[inline(always)]
    pub fn to_hu(self, stored: f64) -> f64 {
        self.slope * stored + self.intercept
    }
}

/// Why a [`Volume`] cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum VolumeError {
    /// The sample array's shape is not the grid's.
    #[error("the samples are {found:?} (z, y, x), the grid needs {expected:?}")]
    Shape {
        /// Shape of the array, (z, y, x).
        found: [usize; 3],
        /// Shape that the grid asks for, (z, y, x).
        expected: [usize; 3],
    },
    /// Memory for the samples could not be had.
    #[error("no memory for {voxels} voxels of {bytes_per_voxel} bytes")]
    Memory {
        /// Number of voxels asked for.
        voxels: usize,
        /// Bytes of one.
        bytes_per_voxel: usize,
    },
}

/// Samples on a [`Grid`]. The array is indexed `[z, y, x]`, x fastest, axes in LPS order.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume<T> {
    grid: Grid,
    rescale: Rescale,
    samples: Array3<T>,
}

impl<T: Sample> Volume<T> {
    /// A volume of the samples given, in standard (x fastest) layout.
    ///
    /// # Errors
    /// [`VolumeError::Shape`] where `samples` is not `[nz, ny, nx]` of the grid.
    pub fn new(grid: Grid, rescale: Rescale, samples: Array3<T>) -> Result<Self, VolumeError> {
        let [nx, ny, nz] = grid.dims();
        let expected = [nz, ny, nx];
        if samples.shape() != expected {
            let (z, y, x) = samples.dim();
            return Err(VolumeError::Shape {
                found: [z, y, x],
                expected,
            });
        }
        let samples = if samples.is_standard_layout() {
            samples
        } else {
            samples.as_standard_layout().into_owned()
        };
        Ok(Self {
            grid,
            rescale,
            samples,
        })
    }

    /// A volume of zeros. Memory is asked for, not assumed.
    ///
    /// # Errors
    /// [`VolumeError::Memory`] where the machine has none.
    pub fn zeros(grid: Grid, rescale: Rescale) -> Result<Self, VolumeError> {
        let samples = zeroed(grid.len())?;
        let [nx, ny, nz] = grid.dims();
        let samples =
            Array3::from_shape_vec((nz, ny, nx), samples).map_err(|_| VolumeError::Shape {
                found: [0; 3],
                expected: [nz, ny, nx],
            })?;
        Ok(Self {
            grid,
            rescale,
            samples,
        })
    }

    /// As [`Volume::zeros`], in memory that is at hand where there is any: the samples are whatever they were there.
    ///
    /// # Errors
    /// As [`Volume::zeros`].
    pub fn any_samples(grid: Grid, rescale: Rescale, spares: &Spares) -> Result<Self, VolumeError> {
        let [nx, ny, nz] = grid.dims();
        match spares
            .take(grid.len())
            .map(|samples| Array3::from_shape_vec((nz, ny, nx), samples))
        {
            Some(Ok(samples)) => Ok(Self {
                grid,
                rescale,
                samples,
            }),
            _ => Self::zeros(grid, rescale),
        }
    }

    /// A copy made by all threads, in memory that is at hand where there is any: most of the time of another goes into
    /// pages that are touched for the first time.
    #[must_use]
    pub fn par_clone(&self, spares: &Spares) -> Self {
        let from = self.as_slice();
        let samples = match spares.take(from.len()) {
            Some(mut samples) => {
                let parts = samples.par_chunks_mut(PART).zip(from.par_chunks(PART));
                parts.for_each(|(to, from)| to.copy_from_slice(from));
                samples
            }
            None => {
                // Where there is no room, this ends as any other copy would.
                let mut samples = room(from.len()).unwrap_or_default();
                let copies = from.par_iter().copied().with_min_len(PART);
                copies.collect_into_vec(&mut samples);
                samples
            }
        };
        match Array3::from_shape_vec(self.samples.raw_dim(), samples) {
            Ok(samples) => Self {
                grid: self.grid.clone(),
                rescale: self.rescale,
                samples,
            },
            // Not met: there are as many as before.
            Err(_) => self.clone(),
        }
    }

    /// Gives its memory to volumes to come.
    pub fn spare(self, spares: &Spares) {
        // Both constructors leave the array in standard layout, from its first sample.
        let (samples, _) = self.samples.into_raw_vec_and_offset();
        spares.give(samples);
    }

    /// Size, spacing and position.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// What the samples mean in Hounsfield units.
    pub fn rescale(&self) -> Rescale {
        self.rescale
    }

    /// The samples, indexed `[z, y, x]`.
    pub fn samples(&self) -> ArrayView3<'_, T> {
        self.samples.view()
    }

    /// As [`Volume::samples`], to be written.
    pub fn samples_mut(&mut self) -> ArrayViewMut3<'_, T> {
        self.samples.view_mut()
    }

    /// The samples in memory order: x fastest, then y, then z.
    pub fn as_slice(&self) -> &[T] {
        // Both constructors leave the array in standard layout.
        self.samples.as_slice().unwrap_or_default()
    }

    /// As [`Volume::as_slice`], to be written.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        self.samples.as_slice_mut().unwrap_or_default()
    }

    /// The same in Hounsfield units, each rounded to the nearest `f32` (exact for 16-bit samples without a
    /// rescale): what is drawn or meshed, so that only what is written keeps to the sample's own type.
    ///
    /// # Errors
    /// [`VolumeError::Memory`] where the machine has none.
    pub fn to_hu(&self) -> Result<Volume<f32>, VolumeError> {
        let mut hu = Volume::<f32>::zeros(self.grid.clone(), Rescale::NONE)?;
        let samples = hu.as_mut_slice().par_iter_mut().zip(self.as_slice());
        samples.for_each(|(hu, sample)| *hu = self.rescale.to_hu(sample.to_f64()) as f32);
        Ok(hu)
    }

    /// Voxels of one z plane.
    pub fn plane_len(&self) -> usize {
        let [nx, ny, _] = self.grid.dims();
        nx * ny
    }

    /// Smallest and largest sample in Hounsfield units.
    pub fn hu_range(&self) -> (f64, f64) {
        let none = (f64::INFINITY, f64::NEG_INFINITY);
        let parts = self.as_slice().par_chunks(PART).map(|part| {
            part.iter().fold(none, |(low, high), &sample| {
                let value = sample.to_f64();
                (low.min(value), high.max(value))
            })
        });
        // In order: of zeros of both signs it depends on it which is the smallest.
        let parts: Vec<(f64, f64)> = parts.collect();
        let both = |(a, b): (f64, f64), (c, d): (f64, f64)| (a.min(c), b.max(d));
        let (low, high) = parts.into_iter().fold(none, both);
        let (a, b) = (self.rescale.to_hu(low), self.rescale.to_hu(high));
        (a.min(b), a.max(b))
    }
}

/// `len` zero samples, or an error where the machine has no memory for them. All threads touch its pages.
pub fn zeroed<T: Sample>(len: usize) -> Result<Vec<T>, VolumeError> {
    let mut samples = room(len).map_err(|_| VolumeError::Memory {
        voxels: len,
        bytes_per_voxel: size_of::<T>(),
    })?;
    let zeros = (0..len).into_par_iter().with_min_len(PART);
    zeros.map(|_| T::default()).collect_into_vec(&mut samples);
    Ok(samples)
}

/// A volume of any sample type that a file can hold.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs, reason = "each variant is its sample type")]
pub enum AnyVolume {
    U8(Volume<u8>),
    I8(Volume<i8>),
    U16(Volume<u16>),
    I16(Volume<i16>),
    U32(Volume<u32>),
    I32(Volume<i32>),
    U64(Volume<u64>),
    I64(Volume<i64>),
    F32(Volume<f32>),
    F64(Volume<f64>),
}

/// Runs a body with the [`Volume`] inside an [`AnyVolume`], whatever its sample type.
#[macro_export]
macro_rules! with_volume {
    ($any:expr, $volume:ident => $body:expr) => {
        match $any {
            $crate::volume::AnyVolume::U8($volume) => $body,
            $crate::volume::AnyVolume::I8($volume) => $body,
            $crate::volume::AnyVolume::U16($volume) => $body,
            $crate::volume::AnyVolume::I16($volume) => $body,
            $crate::volume::AnyVolume::U32($volume) => $body,
            $crate::volume::AnyVolume::I32($volume) => $body,
            $crate::volume::AnyVolume::U64($volume) => $body,
            $crate::volume::AnyVolume::I64($volume) => $body,
            $crate::volume::AnyVolume::F32($volume) => $body,
            $crate::volume::AnyVolume::F64($volume) => $body,
        }
    };
}

impl AnyVolume {
    /// Size, spacing and position.
    pub fn grid(&self) -> &Grid {
        with_volume!(self, volume => volume.grid())
    }

    /// Smallest and largest sample in Hounsfield units.
    pub fn hu_range(&self) -> (f64, f64) {
        with_volume!(self, volume => volume.hu_range())
    }

    /// The type that the samples are stored in.
    pub fn sample_type(&self) -> SampleType {
        fn of<T: Sample>(_: &Volume<T>) -> SampleType {
            T::TYPE
        }
        with_volume!(self, volume => of(volume))
    }
}
