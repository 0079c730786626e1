//! From half to full size with a separable, normalised Gaussian.

use rayon::prelude::*;

use crate::simd::{Kernel, Simd};
use crate::space::Grid;
use crate::volume::{Rescale, Sample, Spares, Volume, VolumeError};

/// Standard deviation, in coarse voxels (method section 5).
const SIGMA: f64 = 0.5;

/// Coarse voxels on either side that a fine voxel can draw on: four standard deviations, where the next
/// tap would weigh 3e-5 of the whole.
pub const REACH: usize = 2;

/// The coarse voxels that one fine voxel draws on along one axis, and their weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Taps {
    /// The first coarse index.
    pub first: usize,
    /// How many, from there.
    pub count: usize,
    /// Weights, of which the first `count` are used and sum to 1.
    pub weights: [f64; 2 * REACH],
}

impl Taps {
    /// The taps of fine index `fine` on an axis of `coarse` voxels, at least one. A coarse centre c is at
    /// fine index 2c + ½. Taps beyond the ends are left out and the others share their weight.
    pub fn new(fine: usize, coarse: usize) -> Self {
        let position = fine as f64 * 0.5 - 0.25;
        // The four nearest centres: two at or before the position, two after.
        let base = fine.div_ceil(2);
        let first = base.saturating_sub(REACH).min(coarse.saturating_sub(1));
        let end = (base + REACH).min(coarse);
        let count = end.saturating_sub(first).max(1);
        let mut weights = [0.0; 2 * REACH];
        let mut total = 0.0;
        for (tap, weight) in weights.iter_mut().take(count).enumerate() {
            let off = ((first + tap) as f64 - position) / SIGMA;
            *weight = libm::exp(-0.5 * off * off);
            total += *weight;
        }
        for weight in &mut weights {
            *weight /= total;
        }
        Self {
            first,
            count,
            weights,
        }
    }

    /// The weighted sum of rows, of which the first is that of the first tap.
    #[inline(always)]
    pub fn blend_rows<const N: usize>(&self, rows: &[[f64; N]]) -> [f64; N] {
        let mut sums = [0.0; N];
        for (row, weight) in rows.iter().zip(&self.weights[..self.count]) {
            for (sum, value) in sums.iter_mut().zip(row) {
                *sum += value * weight;
            }
        }
        sums
    }
}

/// A volume of half size (as [`half`](super::half::half) makes it, in stored units) at full size on
/// `grid`, in samples of type `T`.
///
/// # Errors
/// [`VolumeError`] where the machine has no memory, or `coarse` is not half of `grid`.
pub fn upsample<T: Sample>(
    coarse: &Volume<T::Mean>,
    grid: &Grid,
    rescale: Rescale,
) -> Result<Volume<T>, VolumeError> {
    upsample_with(coarse, grid, rescale, &Spares::default())
}

/// As [`upsample`], in memory that is at hand where there is any.
///
/// # Errors
/// As [`upsample`].
pub fn upsample_with<T: Sample>(
    coarse: &Volume<T::Mean>,
    grid: &Grid,
    rescale: Rescale,
    spares: &Spares,
) -> Result<Volume<T>, VolumeError> {
    let [nx, ny, nz] = grid.dims();
    let [cx, cy, cz] = coarse.grid().dims();
    if [nx / 2, ny / 2, nz / 2] != [cx, cy, cz] {
        return Err(VolumeError::Shape {
            found: [cz, cy, cx],
            expected: [nz / 2, ny / 2, nx / 2],
        });
    }
    let mut full = Volume::<T>::any_samples(grid.clone(), rescale, spares)?;
    let plane = full.plane_len();
    let taps = |n: usize, c: usize| (0..n).map(|fine| Taps::new(fine, c)).collect::<Vec<_>>();
    let (along_x, along_y, along_z) = (taps(nx, cx), taps(ny, cy), taps(nz, cz));
    let across = Across::new(&along_x, cx);
    let simd = Simd::widest();
    let coarse = coarse.as_slice();
    full.as_mut_slice()
        .par_chunks_mut(plane)
        .zip(&along_z)
        .for_each_init(
            || Scratch {
                plane: vec![0.0; cx * cy],
                row: vec![0.0; cx + 2 * REACH],
                full: vec![0.0; nx],
            },
            |scratch, (to, along_z)| {
                simd.run(UpsamplePlane {
                    coarse,
                    dims: [cx, cy],
                    across: &across,
                    along_y: &along_y,
                    along_z,
                    scratch,
                    to,
                });
            },
        );
    Ok(full)
}

/// Memory for one worker.
struct Scratch {
    /// A coarse plane, blended along z.
    plane: Vec<f64>,
    /// A row of it, blended along y, with [`REACH`] zeros at either end.
    row: Vec<f64>,
    /// The same, blended along x.
    full: Vec<f64>,
}

/// The taps of a whole row, which is blended in order: the two fine voxels of a coarse one draw on neighbouring ones.
struct Across {
    /// Of fine voxels 2c and 2c + 1, for each coarse c: the weights of c - 2, …, c + 1 and of c - 1, …, c + 2. Taps beyond
    /// the ends weigh 0.
    even: Vec<[f64; 4]>,
    odd: Vec<[f64; 4]>,
    /// The last fine voxel of an odd number.
    last: Option<Taps>,
}

impl Across {
    fn new(taps: &[Taps], coarse: usize) -> Self {
        let weights = |fine: usize, first: usize| {
            // `first` counts from the zeros that the row begins with.
            let mut weights = [0.0; 4];
            if let Some(taps) = taps.get(fine) {
                for tap in 0..taps.count {
                    let place = (taps.first + tap + REACH).wrapping_sub(first);
                    if let Some(weight) = weights.get_mut(place) {
                        *weight = taps.weights[tap];
                    }
                }
            }
            weights
        };
        Self {
            even: (0..coarse).map(|c| weights(2 * c, c)).collect(),
            odd: (0..coarse).map(|c| weights(2 * c + 1, c + 1)).collect(),
            last: taps.get(2 * coarse).copied(),
        }
    }
}

/// One plane of the full volume.
struct UpsamplePlane<'a, C, T> {
    coarse: &'a [C],
    dims: [usize; 2],
    across: &'a Across,
    along_y: &'a [Taps],
    along_z: &'a Taps,
    scratch: &'a mut Scratch,
    to: &'a mut [T],
}

impl<C: Sample, T: Sample> Kernel for UpsamplePlane<'_, C, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let [cx, cy] = self.dims;
        let Scratch { plane, row, full } = self.scratch;
        plane.fill(0.0);
        for tap in 0..self.along_z.count {
            let weight = self.along_z.weights[tap];
            let start = (self.along_z.first + tap) * cx * cy;
            let from = self.coarse.get(start..start + cx * cy).unwrap_or_default();
            for (sum, &value) in plane.iter_mut().zip(from) {
                *sum += value.to_f64() * weight;
            }
        }
        for (to, taps) in self.to.chunks_exact_mut(full.len()).zip(self.along_y) {
            let inner = &mut row[REACH..REACH + cx];
            inner.fill(0.0);
            for tap in 0..taps.count {
                let weight = taps.weights[tap];
                let start = (taps.first + tap) * cx;
                for (sum, &value) in inner.iter_mut().zip(&plane[start..start + cx]) {
                    *sum += value * weight;
                }
            }
            let pairs = full.chunks_exact_mut(2);
            let windows = row.windows(5);
            let weights = self.across.even.iter().zip(&self.across.odd);
            for ((pair, from), (even, odd)) in pairs.zip(windows).zip(weights) {
                let (mut first, mut second) = (0.0, 0.0);
                for tap in 0..4 {
                    first += from[tap] * even[tap];
                    second += from[tap + 1] * odd[tap];
                }
                pair[0] = first;
                pair[1] = second;
            }
            if let (Some(taps), Some(last)) = (&self.across.last, full.last_mut()) {
                let mut sum = 0.0;
                for tap in 0..taps.count {
                    sum += row[REACH + taps.first + tap] * taps.weights[tap];
                }
                *last = sum;
            }
            for (to, &value) in to.iter_mut().zip(full.iter()) {
                *to = T::from_interpolated(value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use ndarray::Array3;

    use super::*;
    use crate::resample::half::half;

    #[test]
    fn taps_are_the_four_nearest_and_sum_to_one() {
        for (fine, first) in [(8, 2), (9, 3)] {
            let taps = Taps::new(fine, 20);
            assert_eq!((taps.first, taps.count), (first, 4));
            let sum: f64 = taps.weights.iter().sum();
            assert!((sum - 1.0).abs() < 1e-15);
            let position = fine as f64 / 2.0 - 0.25;
            for tap in 0..4 {
                assert!(((taps.first + tap) as f64 - position).abs() <= 2.0);
            }
        }
    }

    #[test]
    fn taps_stay_on_the_axis() {
        for coarse in 1..6 {
            for fine in 0..=2 * coarse {
                let taps = Taps::new(fine, coarse);
                assert!(taps.count >= 1 && taps.first + taps.count <= coarse);
                let sum: f64 = taps.weights[..taps.count].iter().sum();
                assert!((sum - 1.0).abs() < 1e-15, "{fine} of {coarse}: {sum}");
            }
        }
    }

    #[test]
    fn constants_stay_constant_even_on_odd_axes() {
        let grid = Grid::axis_aligned([9, 12, 7], [0.5, 0.75, 2.0]).unwrap();
        let volume = Volume::new(
            grid.clone(),
            Rescale::NONE,
            Array3::from_elem((7, 12, 9), -731_i16),
        )
        .unwrap();
        let coarse = half(&volume).unwrap();
        let full = upsample::<i16>(&coarse, &grid, Rescale::NONE).unwrap();
        assert_eq!(full, volume);
    }

    #[test]
    fn every_voxel_is_the_blend_of_its_taps_with_any_instructions() {
        for dims in [[9, 12, 7], [40, 3, 2], [2, 2, 9], [33, 17, 16]] {
            let [nx, ny, nz] = dims;
            let grid = Grid::axis_aligned(dims, [0.5, 0.75, 2.0]).unwrap();
            let samples = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| {
                f64::from((x * 37 + y * 91 + z * 53) as u32 % 200)
            });
            let volume = Volume::new(grid.clone(), Rescale::NONE, samples).unwrap();
            let coarse = half(&volume).unwrap();
            let found = Simd::compare(|_| upsample::<f64>(&coarse, &grid, Rescale::NONE).unwrap());
            for (simd, full) in &found {
                assert_eq!(full, &found[0].1, "{simd}");
            }
            for ((z, y, x), &value) in found[0].1.samples().indexed_iter() {
                let taps = |fine: usize, n: usize| {
                    let taps = Taps::new(fine, n / 2);
                    (0..taps.count).map(move |tap| (taps.first + tap, taps.weights[tap]))
                };
                let mut sum = 0.0;
                for (z, of_z) in taps(z, nz) {
                    for (y, of_y) in taps(y, ny) {
                        for (x, of_x) in taps(x, nx) {
                            sum += of_z * of_y * of_x * coarse.samples()[[z, y, x]];
                        }
                    }
                }
                assert!((sum - value).abs() < 1e-9, "{dims:?}: {x}, {y}, {z}");
            }
        }
    }

    #[test]
    fn a_blob_keeps_its_centroid_in_millimetres() {
        let grid = Grid::axis_aligned([40, 36, 31], [0.5, 0.75, 2.0]).unwrap();
        let centre = DVec3::new(18.3, 17.6, 14.2);
        let samples = Array3::from_shape_fn((31, 36, 40), |(z, y, x)| {
            let off = DVec3::new(x as f64, y as f64, z as f64) - centre;
            1000.0 * libm::exp(-off.length_squared() / 18.0)
        });
        let volume = Volume::new(grid.clone(), Rescale::NONE, samples).unwrap();
        let full = upsample::<f64>(&half(&volume).unwrap(), &grid, Rescale::NONE).unwrap();
        let off = centroid(&full) - centroid(&volume);
        assert!(off.length() < 0.01, "the blob moved by {off} mm");
        assert_ne!(full, volume, "half scale blurs");
    }

    fn centroid(volume: &Volume<f64>) -> DVec3 {
        let mut sum = DVec3::ZERO;
        let mut total = 0.0;
        for ((z, y, x), &value) in volume.samples().indexed_iter() {
            sum += DVec3::new(x as f64, y as f64, z as f64) * value;
            total += value;
        }
        sum / total * volume.grid().spacing()
    }
}
