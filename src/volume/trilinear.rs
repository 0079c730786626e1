//! Trilinear sampling of a volume's stored values.

use glam::DVec3;

use super::{Sample, Volume};
use crate::simd::{Real, larger, pairs, smaller};

/// A volume, ready to be sampled between its voxels.
///
/// A position outside takes the nearest edge voxel (method section 3). The eight neighbours are
/// blended along x, then y, then z; a position exactly on a voxel gives that voxel's value.
#[derive(Debug, Clone, Copy)]
pub struct Trilinear<'a, T> {
    samples: &'a [T],
    axes: [Axis; 3],
}

#[derive(Debug, Clone, Copy)]
struct Axis {
    /// Index of the last voxel.
    last: f64,
    /// Index of the last voxel that has a neighbour after it.
    last_pair: f64,
    /// Samples from one voxel to the next.
    stride: usize,
    /// The same, or 0 on an axis of a single voxel, which is its own neighbour.
    to_next: usize,
}

impl Axis {
    fn new(length: usize, stride: usize) -> Self {
        Self {
            last: length.saturating_sub(1) as f64,
            last_pair: length.saturating_sub(2) as f64,
            stride,
            to_next: if length > 1 { stride } else { 0 },
        }
    }

    /// The first voxel of a pair around a position, and how far between the two it is, after clamping
    /// to the axis. A position on a voxel may be the end of one pair or the start of the next.
    ///
    /// Where the caller knows that it is inside, a voxel from either end, nothing is clamped.
    #[inline(always)]
    fn split<F: Real, const INSIDE: bool>(&self, position: F) -> (F, F) {
        let half = F::of(0.5);
        if INSIDE {
            let voxel = (position - half + F::WHOLE) - F::WHOLE;
            return (voxel, position - voxel);
        }
        // Comparisons that NaN fails, so that it becomes 0: one instruction each, unlike `f64::max`.
        let position = larger(position, F::of(0.0));
        let position = smaller(position, F::of(self.last));
        let before = smaller(position - half, F::of(self.last_pair));
        let voxel = (before + F::WHOLE) - F::WHOLE;
        (voxel, position - voxel)
    }
}

impl<'a, T: Sample> Trilinear<'a, T> {
    /// Prepares `volume`.
    pub fn new(volume: &'a Volume<T>) -> Self {
        let [nx, ny, nz] = volume.grid().dims();
        Self {
            samples: volume.as_slice(),
            axes: [Axis::new(nx, 1), Axis::new(ny, nx), Axis::new(nz, nx * ny)],
        }
    }

    /// The stored value at a position in voxels (x, y, z). A position that is not a number gives the
    /// value at 0 on that axis.
    #[inline]
    pub fn at(&self, x: f64, y: f64, z: f64) -> f64 {
        let (place, shares) = self.split::<f64, false>(x, y, z);
        blend(self.corners(place), shares)
    }

    /// As [`Trilinear::at`], for a row of positions: the same values, each step done for all of them before the next. In
    /// single precision, which is for volumes of fewer than 2³² voxels, values are off by what positions are, and
    /// by some 10⁻⁷ of the samples.
    #[inline(always)]
    pub fn row<F: Real, const N: usize>(&self, x: &[F; N], y: &[F; N], z: &[F; N]) -> [F; N] {
        self.row_where::<F, N, false>(x, y, z)
    }

    /// As [`Trilinear::row`], for positions that [`Trilinear::holds`].
    #[inline(always)]
    pub fn row_inside<F: Real, const N: usize>(
        &self,
        x: &[F; N],
        y: &[F; N],
        z: &[F; N],
    ) -> [F; N] {
        self.row_where::<F, N, true>(x, y, z)
    }

    /// Whether a position, and so all between several, is a voxel or more from the volume's ends.
    pub fn holds(&self, at: DVec3) -> bool {
        let inside = |axis: usize| at[axis] >= 1.0 && at[axis] <= self.axes[axis].last - 1.0;
        inside(0) && inside(1) && inside(2)
    }

    #[inline(always)]
    fn row_where<F: Real, const N: usize, const INSIDE: bool>(
        &self,
        x: &[F; N],
        y: &[F; N],
        z: &[F; N],
    ) -> [F; N] {
        let mut places = [0; N];
        let mut shares = [[F::of(0.0); N]; 3];
        for lane in 0..N {
            let (place, [fx, fy, fz]) = self.split::<F, INSIDE>(x[lane], y[lane], z[lane]);
            places[lane] = place;
            shares[0][lane] = fx;
            shares[1][lane] = fy;
            shares[2][lane] = fz;
        }
        let mut values = [F::of(0.0); N];
        let [ax, ..] = &self.axes;
        let pairs = (ax.to_next > 0).then(|| pairs(self.samples, &places, self.rows()));
        if let Some(Some(pairs)) = pairs {
            for lane in 0..N {
                let corners = [0, 1, 2, 3].map(|row| pairs[row][lane]);
                values[lane] = blend(corners, [0, 1, 2].map(|axis| shares[axis][lane]));
            }
        } else {
            // A volume of one voxel along x has no pairs.
            for lane in 0..N {
                let corners = self.corners(places[lane]);
                values[lane] = blend(corners, [0, 1, 2].map(|axis| shares[axis][lane]));
            }
        }
        values
    }

    /// The first of the eight voxels around a position, and how far along each axis it is between them.
    #[inline(always)]
    fn split<F: Real, const INSIDE: bool>(&self, x: F, y: F, z: F) -> (u64, [F; 3]) {
        let [ax, ay, az] = &self.axes;
        let (x0, fx) = ax.split::<F, INSIDE>(x);
        let (y0, fy) = ay.split::<F, INSIDE>(y);
        let (z0, fz) = az.split::<F, INSIDE>(z);
        let place = F::place([x0, y0, z0], ay.stride, az.stride);
        (place, [fx, fy, fz])
    }

    /// What is added to the first voxel's place for the four pairs along x.
    #[inline(always)]
    fn rows(&self) -> [usize; 4] {
        let [_, ay, az] = &self.axes;
        [0, ay.to_next, az.to_next, ay.to_next + az.to_next]
    }

    /// The pairs along x of the eight voxels from a place on.
    #[inline(always)]
    fn corners(&self, place: u64) -> [[T; 2]; 4] {
        let [ax, ..] = &self.axes;
        self.rows().map(|row| {
            let first = place as usize + row;
            [self.samples[first], self.samples[first + ax.to_next]]
        })
    }
}

/// Blends pairs along x, then y, then z.
#[inline(always)]
fn blend<T: Sample, F: Real>(corners: [[T; 2]; 4], [fx, fy, fz]: [F; 3]) -> F {
    let one = F::of(1.0);
    // Both ends of a blend are exact, which a + (b - a)·f is not at f = 1.
    let (gx, gy, gz) = (one - fx, one - fy, one - fz);
    let value = |sample: T| F::of(sample.to_f64());
    let [a, b, c, d] = corners.map(|[first, second]| value(first) * gx + value(second) * fx);
    let near = a * gy + b * fy;
    let far = c * gy + d * fy;
    near * gz + far * fz
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::space::Grid;
    use crate::volume::Rescale;

    fn ramp() -> Volume<f64> {
        let grid = Grid::axis_aligned([4, 5, 6], [1.0, 2.0, 3.0]).unwrap();
        let samples = Array3::from_shape_fn((6, 5, 4), |(z, y, x)| {
            1.0 + 2.0 * x as f64 - 3.0 * y as f64 + 5.0 * z as f64
        });
        Volume::new(grid, Rescale::NONE, samples).unwrap()
    }

    #[test]
    fn a_ramp_is_exact_between_voxels() {
        let volume = ramp();
        let sampler = Trilinear::new(&volume);
        for (x, y, z) in [(0.25, 1.75, 3.5), (2.9, 0.1, 4.99), (3.0, 4.0, 5.0)] {
            let expected = 1.0 + 2.0 * x - 3.0 * y + 5.0 * z;
            assert!((sampler.at(x, y, z) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_row_is_its_positions_one_by_one() {
        let volume = ramp();
        let sampler = Trilinear::new(&volume);
        let x: [f64; 16] = std::array::from_fn(|lane| lane as f64 * 0.31 - 0.6);
        let y = x.map(|x| 4.2 - x * 1.1);
        let z = x.map(|x| x * x);
        let row = sampler.row(&x, &y, &z);
        for lane in 0..16 {
            assert_eq!(row[lane], sampler.at(x[lane], y[lane], z[lane]));
        }
        assert!(row[3] != row[4]);
    }

    #[test]
    fn single_precision_is_near_and_exact_on_voxels() {
        let grid = Grid::axis_aligned([600, 7, 5], [1.0; 3]).unwrap();
        let samples = Array3::from_shape_fn((5, 7, 600), |(z, y, x)| {
            ((x * 7919 + y * 104_729 + z * 1_299_709) % 4000) as i16 - 1000
        });
        let volume = Volume::new(grid, Rescale::NONE, samples).unwrap();
        let sampler = Trilinear::new(&volume);
        for start in [-3.0, 250.0, 590.0] {
            let x: [f32; 16] = std::array::from_fn(|lane| start + lane as f32 * 0.873);
            let y = x.map(|x| (x * 0.31).rem_euclid(8.0) - 1.0);
            let z = x.map(|x| (x * 0.77).rem_euclid(6.0) - 1.0);
            let found = sampler.row(&x, &y, &z);
            let [x, y, z] = [x, y, z].map(|at| at.map(f64::from));
            let expected = sampler.row(&x, &y, &z);
            for (found, expected) in found.into_iter().zip(expected) {
                assert!(
                    (f64::from(found) - expected).abs() < 2e-3,
                    "{found} {expected}"
                );
            }
        }
        let x: [f32; 16] = std::array::from_fn(|lane| 580.0 + lane as f32);
        let value = |lane: usize| f32::from(volume.samples()[[4, 6, 580 + lane]]);
        assert_eq!(
            sampler.row(&x, &[6.0; 16], &[4.0; 16]),
            std::array::from_fn(value)
        );
    }

    #[test]
    fn inside_nothing_needs_to_be_clamped() {
        let volume = ramp();
        let sampler = Trilinear::new(&volume);
        assert!(sampler.holds(DVec3::new(1.0, 3.0, 4.0)));
        for beyond in [[0.9, 2.0, 2.0], [1.5, 3.1, 2.0], [1.5, 2.0, f64::NAN]] {
            assert!(!sampler.holds(DVec3::from_array(beyond)));
        }
        let x: [f64; 16] = std::array::from_fn(|lane| 1.0 + lane as f64 / 15.0);
        let y = x.map(|x| x * 2.0 - 1.0);
        let z = x.map(|x| (5.0 - x).trunc());
        assert_eq!(sampler.row_inside(&x, &y, &z), sampler.row(&x, &y, &z));
    }

    #[test]
    fn outside_takes_the_nearest_edge_voxel() {
        let volume = ramp();
        let sampler = Trilinear::new(&volume);
        assert_eq!(sampler.at(-7.0, 2.0, 2.0), sampler.at(0.0, 2.0, 2.0));
        assert_eq!(sampler.at(99.0, 99.0, 99.0), sampler.at(3.0, 4.0, 5.0));
        assert_eq!(
            sampler.at(f64::INFINITY, 0.0, 0.0),
            sampler.at(3.0, 0.0, 0.0)
        );
        assert!(sampler.at(f64::NAN, 0.0, 0.0).is_finite());
    }

    #[test]
    fn on_a_voxel_the_neighbours_do_not_matter() {
        let mut volume = ramp();
        volume.as_mut_slice().fill(f64::MAX);
        volume.as_mut_slice()[0] = 3.0;
        assert_eq!(Trilinear::new(&volume).at(0.0, 0.0, 0.0), 3.0);
    }
}
