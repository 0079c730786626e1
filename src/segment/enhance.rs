//! Less noise before a threshold is laid.

use rayon::prelude::*;
use thiserror::Error;

use super::{median, smooth};
use crate::volume::{Rescale, Sample, Volume, VolumeError};

/// The one side that the median's window can have, in voxels.
pub const MEDIAN_SIDE: usize = 3;

/// What is done to a volume before it is segmented, in this order.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Enhance {
    /// Side of the median's window, in voxels: [`MEDIAN_SIDE`].
    pub median: Option<usize>,
    /// Standard deviation of the Gaussian, mm, the same along each axis; greater than zero.
    pub smooth_mm: Option<f64>,
}

impl Enhance {
    /// Whether nothing is done.
    pub fn is_none(&self) -> bool {
        self.median.is_none() && self.smooth_mm.is_none()
    }
}

/// Why a volume cannot be enhanced.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EnhanceError {
    /// A window that there is no median for.
    #[error("a median over {side} voxels is not offered; the side of its window is {MEDIAN_SIDE}")]
    MedianSide {
        /// The side asked for, voxels.
        side: usize,
    },
    /// A standard deviation that is not a positive number of mm.
    #[error("smoothing by {sigma_mm} mm; it needs a number greater than 0")]
    Sigma {
        /// The one asked for, mm.
        sigma_mm: f64,
    },
    /// A Gaussian that is too wide for the grid.
    #[error(
        "smoothing by {sigma_mm} mm reaches over {reach:.0} voxels of {spacing_mm} mm; {max} is the most", max = smooth::MAX_REACH
    )]
    Reach {
        /// The standard deviation asked for, mm.
        sigma_mm: f64,
        /// Distance between voxels along the axis, mm.
        spacing_mm: f64,
        /// Voxels on either side that it takes.
        reach: f64,
    },
    /// No memory.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

/// A volume with less noise, in Hounsfield units: the median of 3×3×3 voxels, then a Gaussian, as far as
/// they are asked for. Beyond the border, both see its nearest voxel again.
///
/// # Errors
/// [`EnhanceError`] where a setting is out of range or the machine has no memory.
pub fn enhance<T: Sample>(
    volume: &Volume<T>,
    settings: &Enhance,
) -> Result<Volume<f32>, EnhanceError> {
    let grid = volume.grid();
    let kernels = match settings.smooth_mm {
        None => None,
        Some(sigma_mm) => Some(smooth::kernels(sigma_mm, grid)?),
    };
    let mut enhanced = Volume::<f32>::zeros(grid.clone(), Rescale::NONE)?;
    match settings.median {
        None => in_hu(volume, &mut enhanced),
        Some(MEDIAN_SIDE) => median::median(volume, &mut enhanced),
        Some(side) => return Err(EnhanceError::MedianSide { side }),
    }
    if let Some(kernels) = kernels {
        smooth::smooth(&mut enhanced, &kernels);
    }
    Ok(enhanced)
}

fn in_hu<T: Sample>(volume: &Volume<T>, to: &mut Volume<f32>) {
    let rescale = volume.rescale();
    let plane = volume.plane_len();
    to.as_mut_slice()
        .par_chunks_mut(plane)
        .zip(volume.as_slice().par_chunks(plane))
        .for_each(|(to, from)| {
            for (to, sample) in to.iter_mut().zip(from) {
                *to = rescale.to_hu(sample.to_f64()) as f32;
            }
        });
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::space::Grid;

    fn ramp() -> Volume<i16> {
        let grid = Grid::axis_aligned([20, 6, 5], [0.5, 0.5, 1.0]).unwrap();
        let rescale = Rescale {
            slope: 0.5,
            intercept: -1024.0,
        };
        let samples = Array3::from_shape_fn((5, 6, 20), |(z, y, x)| (90 * x + 7 * y + z) as i16);
        Volume::new(grid, rescale, samples).unwrap()
    }

    #[test]
    fn nothing_asked_for_is_the_volume_in_hounsfield_units() {
        let volume = ramp();
        assert!(Enhance::default().is_none());
        let same = enhance(&volume, &Enhance::default()).unwrap();
        assert_eq!(same.rescale(), Rescale::NONE);
        assert_eq!(same.samples()[[2, 3, 4]], 0.5 * 383.0 - 1024.0);
    }

    #[test]
    fn the_median_comes_first() {
        let mut volume = ramp();
        volume.samples_mut()[[2, 3, 10]] = 30_000;
        let with = |median, smooth_mm| enhance(&volume, &Enhance { median, smooth_mm }).unwrap();
        let both = with(Some(MEDIAN_SIDE), Some(0.5));
        let median = with(Some(MEDIAN_SIDE), None);
        let then = Enhance {
            median: None,
            smooth_mm: Some(0.5),
        };
        assert!(!then.is_none());
        assert_eq!(both, enhance(&median, &then).unwrap());
        assert_ne!(both, with(None, Some(0.5)));
        let highest = |volume: &Volume<f32>| volume.hu_range().1;
        assert!(highest(&both) < 0.0 && highest(&with(None, Some(0.5))) > 100.0);
    }

    #[test]
    fn other_windows_are_refused() {
        for side in [0, 1, 2, 5] {
            let settings = Enhance {
                median: Some(side),
                smooth_mm: None,
            };
            let error = enhance(&ramp(), &settings).unwrap_err();
            assert_eq!(error, EnhanceError::MedianSide { side });
        }
    }
}
