//! A Gaussian of the same width in mm along each axis.
//!
//! Each voxel takes c + Σ wₙ (aₙ + bₙ - 2c), c itself and aₙ, bₙ the voxels n before and n after: the
//! weighted mean, in a form that leaves what is constant as it is, bit for bit, in single precision too. (The
//! Gaussian of `resample/` has other taps: it lies between two grids.)

use ndarray::Axis;
use rayon::prelude::*;

use super::EnhanceError;
use crate::space::Grid;
use crate::volume::Volume;

/// The most voxels on either side that a voxel may take: bounds the time that a small spacing costs.
pub(super) const MAX_REACH: usize = 256;

/// Voxels further away than this many standard deviations are left out, as in the Gaussian that goes up from
/// half scale: none of them would weigh 4e-4 of the middle one.
const CUT: f64 = 4.0;

/// For each axis the weights of the voxels 1, 2, … to either side. With the middle one they sum to 1.
pub(super) type Kernels = [Vec<f32>; 3];

/// The kernels of a Gaussian of `sigma_mm` on a grid.
///
/// # Errors
/// [`EnhanceError`] where `sigma_mm` is not a positive number, or too many voxels.
pub(super) fn kernels(sigma_mm: f64, grid: &Grid) -> Result<Kernels, EnhanceError> {
    if !(sigma_mm.is_finite() && sigma_mm > 0.0) {
        return Err(EnhanceError::Sigma { sigma_mm });
    }
    let [x, y, z] = grid.spacing().to_array();
    Ok([
        kernel(sigma_mm, x)?,
        kernel(sigma_mm, y)?,
        kernel(sigma_mm, z)?,
    ])
}

fn kernel(sigma_mm: f64, spacing_mm: f64) -> Result<Vec<f32>, EnhanceError> {
    let sigma = sigma_mm / spacing_mm;
    let reach = CUT * sigma;
    if reach > MAX_REACH as f64 {
        return Err(EnhanceError::Reach {
            sigma_mm,
            spacing_mm,
            reach,
        });
    }
    let side = (1..=reach as usize).map(|n| {
        let off = n as f64 / sigma;
        libm::exp(-0.5 * off * off)
    });
    let side: Vec<f64> = side.collect();
    let total = 1.0 + 2.0 * side.iter().sum::<f64>();
    Ok(side.iter().map(|weight| (weight / total) as f32).collect())
}

/// Smooths a volume in place. Beyond the border is its nearest voxel again.
pub(super) fn smooth(volume: &mut Volume<f32>, kernels: &Kernels) {
    let [nx, ny, _] = volume.grid().dims();
    let [along_x, along_y, along_z] = kernels;
    let reach = along_x.len();
    volume.as_mut_slice().par_chunks_mut(nx * ny).for_each_init(
        || (vec![0.0; nx + 2 * reach], vec![0.0; nx * ny]),
        |(padded, from), plane| {
            for (to, row) in from.chunks_exact_mut(nx).zip(plane.chunks_exact(nx)) {
                padded[..reach].fill(row[0]);
                padded[reach..reach + nx].copy_from_slice(row);
                padded[reach + nx..].fill(row[nx - 1]);
                blend(
                    to,
                    along_x,
                    row,
                    |n| &padded[reach - n..],
                    |n| &padded[reach + n..],
                );
            }
            blend_rows(plane.chunks_exact_mut(nx), along_y, from);
        },
    );
    // One slab across z for each row of a plane.
    volume
        .samples_mut()
        .axis_iter_mut(Axis(1))
        .into_par_iter()
        .for_each_init(Vec::new, |from, mut slab| {
            from.clear();
            from.extend(slab.iter());
            let rows = slab.axis_iter_mut(Axis(0));
            blend_rows(rows.filter_map(|row| row.into_slice()), along_z, from);
        });
}

/// Blends whole rows across their direction: `from` holds as many as `to`, one behind the other.
fn blend_rows<'a>(to: impl Iterator<Item = &'a mut [f32]>, kernel: &[f32], from: &[f32]) {
    for (place, to) in to.enumerate() {
        let len = to.len();
        let last = from.len() / len - 1;
        let row = |at: usize| &from[at * len..(at + 1) * len];
        blend(
            to,
            kernel,
            row(place),
            |n| row(place.saturating_sub(n)),
            |n| row((place + n).min(last)),
        );
    }
}

/// Writes the blend of a row with those n voxels before and after it. What is given may be longer.
fn blend<'a>(
    to: &mut [f32],
    kernel: &[f32],
    middle: &[f32],
    before: impl Fn(usize) -> &'a [f32],
    after: impl Fn(usize) -> &'a [f32],
) {
    to.copy_from_slice(middle);
    for (place, &weight) in kernel.iter().enumerate() {
        let sides = before(place + 1).iter().zip(after(place + 1));
        for ((to, &middle), (&before, &after)) in to.iter_mut().zip(middle).zip(sides) {
            *to += weight * ((before + after) - 2.0 * middle);
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};

    use super::*;
    use crate::volume::Rescale;

    fn volume(grid: &Grid, at: impl FnMut((usize, usize, usize)) -> f32) -> Volume<f32> {
        let [nx, ny, nz] = grid.dims();
        let samples = Array3::from_shape_fn((nz, ny, nx), at);
        Volume::new(grid.clone(), Rescale::NONE, samples).unwrap()
    }

    fn smoothed(volume: &Volume<f32>, sigma_mm: f64) -> Volume<f32> {
        let mut smoothed = volume.clone();
        smooth(&mut smoothed, &kernels(sigma_mm, volume.grid()).unwrap());
        smoothed
    }

    #[test]
    fn a_constant_stays_bit_for_bit() {
        let grid = Grid::axis_aligned([9, 12, 7], [0.5, 0.75, 2.0]).unwrap();
        for value in [-731.3, 0.1, 3071.0, -500.0] {
            let constant = volume(&grid, |_| value);
            assert_eq!(smoothed(&constant, 1.7), constant);
        }
    }

    #[test]
    fn an_impulse_keeps_its_sum_and_has_the_variance_asked_for_in_mm() {
        /// What the tails beyond four standard deviations hold of the variance: 1.1e-3.
        const TAILS: f64 = 2e-3;
        let sigma = 2.0;
        let grid = Grid::axis_aligned([41, 31, 15], [0.5, 0.8, 2.0]).unwrap();
        let middle = [20, 15, 7];
        let [x, y, z] = middle;
        let impulse = volume(&grid, |at| if at == (z, y, x) { 1000.0 } else { 0.0 });
        let smoothed = smoothed(&impulse, sigma);
        let sum: f64 = smoothed.as_slice().iter().map(|&v| f64::from(v)).sum();
        assert!((sum - 1000.0).abs() < 1e-2, "{sum}");
        for axis in 0..3 {
            let square = |at: [usize; 3]| {
                let off = (at[axis] as f64 - middle[axis] as f64) * grid.spacing()[axis];
                off * off
            };
            let moment: f64 = smoothed
                .samples()
                .indexed_iter()
                .map(|((z, y, x), &value)| f64::from(value) * square([x, y, z]))
                .sum();
            let variance = moment / sum;
            let share = variance / (sigma * sigma);
            assert!((share - 1.0).abs() < TAILS, "axis {axis}: {variance} mm²");
        }
    }

    /// The same, voxel by voxel, as the sum over the whole box in double precision.
    fn by_definition(volume: &Volume<f32>, sigma_mm: f64) -> Volume<f32> {
        let dims = volume.grid().dims();
        let spacing = volume.grid().spacing();
        let reach = [0, 1, 2].map(|axis| (CUT * sigma_mm / spacing[axis]) as isize);
        let near = |at: usize, off: isize, len: usize| at.saturating_add_signed(off).min(len - 1);
        self::volume(volume.grid(), |(z, y, x)| {
            let (mut sum, mut total) = (0.0, 0.0);
            for dz in -reach[2]..=reach[2] {
                for dy in -reach[1]..=reach[1] {
                    for dx in -reach[0]..=reach[0] {
                        let off = glam::DVec3::new(dx as f64, dy as f64, dz as f64) * spacing;
                        let weight = libm::exp(-0.5 * off.length_squared() / (sigma_mm * sigma_mm));
                        let [x, y, z] = [
                            near(x, dx, dims[0]),
                            near(y, dy, dims[1]),
                            near(z, dz, dims[2]),
                        ];
                        sum += weight * f64::from(volume.samples()[[z, y, x]]);
                        total += weight;
                    }
                }
            }
            (sum / total) as f32
        })
    }

    #[test]
    fn as_by_definition_borders_and_thin_axes_included() {
        /// Single precision, over sums of some hundred values of up to 2000 HU.
        const ROUNDING: f32 = 2e-3;
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for dims in [[13, 9, 6], [1, 7, 5], [20, 1, 1], [3, 4, 2]] {
            let grid = Grid::axis_aligned(dims, [0.5, 0.8, 2.0]).unwrap();
            let noise = volume(&grid, |_| (rng.next_u32() % 4000) as f32 - 2000.0);
            for sigma in [0.1, 0.6, 1.3] {
                let (found, expected) = (smoothed(&noise, sigma), by_definition(&noise, sigma));
                for (found, expected) in found.as_slice().iter().zip(expected.as_slice()) {
                    assert!(
                        (found - expected).abs() < ROUNDING,
                        "{dims:?}, {sigma} mm: {found} for {expected}"
                    );
                }
            }
            assert_ne!(smoothed(&noise, 0.6), noise);
            assert_eq!(smoothed(&noise, 0.1), noise, "no neighbour within 0.4 mm");
        }
    }

    #[test]
    fn a_width_that_is_none_or_reaches_too_far_is_refused() {
        let grid = Grid::axis_aligned([4; 3], [0.5, 0.5, 1e-6]).unwrap();
        for sigma in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                kernels(sigma, &grid),
                Err(EnhanceError::Sigma { .. })
            ));
        }
        let error = kernels(1.0, &grid).unwrap_err();
        assert_eq!(
            error.to_string(),
            "smoothing by 1 mm reaches over 4000000 voxels of 0.000001 mm; 256 is the most"
        );
        assert!(kernels(6e-5, &grid).is_ok());
    }
}
