//! Trilinear sampling of a volume's stored values.

use super::{Sample, Volume};

/// A volume, ready to be sampled between its voxels.
///
/// A position outside takes the nearest edge voxel (method section 3). The eight neighbours are
/// blended in `f64` along x, then y, then z; a position exactly on a voxel gives that voxel's value.
#[derive(Debug, Clone, Copy)]
pub struct Trilinear<'a, T> {
    samples: &'a [T],
    last: [f64; 3],
    strides: [usize; 3],
}

impl<'a, T: Sample> Trilinear<'a, T> {
    /// Prepares `volume`.
    pub fn new(volume: &'a Volume<T>) -> Self {
        let [nx, ny, _] = volume.grid().dims();
        Self {
            samples: volume.as_slice(),
            last: volume.grid().last_index().to_array(),
            strides: [1, nx, nx * ny],
        }
    }

    /// The stored value at a position in voxels (x, y, z). A position that is not a number gives the
    /// value at 0 on that axis.
    #[inline]
    pub fn at(&self, x: f64, y: f64, z: f64) -> f64 {
        let (x0, fx) = split(x, self.last[0]);
        let (y0, fy) = split(y, self.last[1]);
        let (z0, fz) = split(z, self.last[2]);
        let [_, sy, sz] = self.strides;
        let base = x0 + y0 * sy + z0 * sz;
        // At the last voxel of an axis the fraction is zero and the neighbour is the voxel itself.
        let dx = usize::from(fx > 0.0);
        let dy = if fy > 0.0 { sy } else { 0 };
        let dz = if fz > 0.0 { sz } else { 0 };
        let along_x = |offset: usize| {
            let a = self.samples[base + offset].to_f64();
            let b = self.samples[base + offset + dx].to_f64();
            a + (b - a) * fx
        };
        let along_y = |offset: usize| {
            let a = along_x(offset);
            let b = along_x(offset + dy);
            a + (b - a) * fy
        };
        let a = along_y(0);
        let b = along_y(dz);
        a + (b - a) * fz
    }
}

/// The voxel at or before a position on one axis and the fraction of the way to the next, after
/// clamping to the axis.
#[inline]
fn split(position: f64, last: f64) -> (usize, f64) {
    // Comparisons that NaN fails, so that it becomes 0: one instruction each, unlike `f64::max` and `min`.
    let position = if position > 0.0 { position } else { 0.0 };
    let position = if position < last { position } else { last };
    // An axis has at most 32767 voxels.
    let index = position as u32;
    (index as usize, position - f64::from(index))
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
