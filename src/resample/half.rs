//! To half size.

use glam::DVec3;
use rayon::prelude::*;

use crate::space::{Grid, GridError, GridPoint};
use crate::volume::{Rescale, Sample, Volume, VolumeError};

/// Why a volume has no half.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HalfError {
    /// An axis has a single voxel.
    #[error("half scale needs at least 2 voxels along every axis: {0}")]
    Grid(#[from] GridError),
    /// No memory.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

/// The grid of half the size: ⌊n/2⌋ voxels per axis at twice the spacing, the first centred on the first
/// 2×2×2 block.
///
/// # Errors
/// [`GridError::Dims`] where an axis has a single voxel.
pub fn half_grid(grid: &Grid) -> Result<Grid, GridError> {
    let centre = GridPoint(grid.spacing() * 0.5);
    Grid::new(
        grid.dims().map(|n| n / 2),
        (grid.spacing() * DVec3::splat(2.0)).to_array(),
        grid.grid_to_lps(centre),
        grid.direction(),
    )
}

/// The means of 2×2×2 blocks, in stored units, not rounded. An odd last plane is dropped
/// (method section 5).
///
/// # Errors
/// [`HalfError`] where an axis has a single voxel or the machine no memory.
pub fn half<T: Sample>(volume: &Volume<T>) -> Result<Volume<T::Mean>, HalfError> {
    let grid = half_grid(volume.grid())?;
    let [cx, cy, _] = grid.dims();
    let [nx, ny, _] = volume.grid().dims();
    let samples = volume.as_slice();
    let mut coarse = Volume::<T::Mean>::zeros(grid, Rescale::NONE)?;
    coarse
        .as_mut_slice()
        .par_chunks_mut(cx * cy)
        .enumerate()
        .for_each(|(z, to)| {
            for (y, to) in to.chunks_exact_mut(cx).enumerate() {
                let row = |dy: usize, dz: usize| {
                    let start = ((2 * z + dz) * ny + 2 * y + dy) * nx;
                    &samples[start..start + nx]
                };
                let rows = [row(0, 0), row(1, 0), row(0, 1), row(1, 1)];
                for (x, to) in to.iter_mut().enumerate() {
                    let sum: f64 = rows
                        .iter()
                        .map(|row| row[2 * x].to_f64() + row[2 * x + 1].to_f64())
                        .sum();
                    *to = T::Mean::from_interpolated(sum * 0.125);
                }
            }
        });
    Ok(coarse)
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::space::{ContinuousIndex, LpsPoint};

    #[test]
    fn blocks_are_averaged_and_an_odd_plane_is_dropped() {
        let grid = Grid::axis_aligned([4, 2, 3], [1.0, 1.0, 1.0]).unwrap();
        let samples = Array3::from_shape_fn((3, 2, 4), |(z, y, x)| (x + 10 * y + 100 * z) as i16);
        let coarse = half(&Volume::new(grid, Rescale::NONE, samples).unwrap()).unwrap();
        assert_eq!(coarse.grid().dims(), [2, 1, 1]);
        assert_eq!(coarse.as_slice(), [55.5, 57.5]);
    }

    #[test]
    fn a_coarse_centre_is_at_fine_index_two_c_and_a_half() {
        let turn = glam::DMat3::from_rotation_z(0.3);
        let fine = Grid::new(
            [8, 8, 8],
            [0.5, 0.6, 0.7],
            LpsPoint::new(1.0, 2.0, 3.0),
            turn,
        )
        .unwrap();
        let coarse = half_grid(&fine).unwrap();
        let at = |grid: &Grid, i: [f64; 3]| {
            grid.grid_to_lps(grid.index_to_grid(ContinuousIndex::from(i)))
        };
        let there = at(&coarse, [1.0, 2.0, 3.0]);
        let expected = at(&fine, [2.5, 4.5, 6.5]);
        assert!((there.0 - expected.0).length() < 1e-12);
    }

    #[test]
    fn a_single_plane_has_no_half() {
        let grid = Grid::axis_aligned([4, 4, 1], [1.0; 3]).unwrap();
        assert!(half(&Volume::<i16>::zeros(grid, Rescale::NONE).unwrap()).is_err());
    }
}
