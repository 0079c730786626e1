//! A handful of positions, one array per axis, so that a loop over them is a loop over vector lanes.

use glam::DVec3;

use crate::simd::Real;

/// Positions handled at once. Two rows of eight: a tile's row, and enough for any vector unit.
pub const LANES: usize = 16;

/// [`LANES`] positions in voxels of a lattice.
#[derive(Debug, Clone)]
#[allow(missing_docs, reason = "the three axes")]
pub struct Points<F = f64> {
    pub x: [F; LANES],
    pub y: [F; LANES],
    pub z: [F; LANES],
}

impl<F: Real> Points<F> {
    /// Neighbouring voxels along x, the first at `start`.
    #[inline(always)]
    pub fn row(start: [usize; 3]) -> Self {
        let mut points = Self {
            x: [F::of(0.0); LANES],
            y: [F::of(start[1] as f64); LANES],
            z: [F::of(start[2] as f64); LANES],
        };
        for (lane, x) in points.x.iter_mut().enumerate() {
            *x = F::of((start[0] + lane) as f64);
        }
        points
    }

    /// All at the origin.
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            x: [F::of(0.0); LANES],
            y: [F::of(0.0); LANES],
            z: [F::of(0.0); LANES],
        }
    }
}

impl Points {
    /// Every lane at one position.
    pub fn splat(at: DVec3) -> Self {
        Self {
            x: [at.x; LANES],
            y: [at.y; LANES],
            z: [at.z; LANES],
        }
    }

    /// The position in one lane; `lane` below [`LANES`].
    #[inline(always)]
    pub fn get(&self, lane: usize) -> DVec3 {
        DVec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    /// Puts a position into one lane; `lane` below [`LANES`].
    #[inline(always)]
    pub fn set(&mut self, lane: usize, at: DVec3) {
        self.x[lane] = at.x;
        self.y[lane] = at.y;
        self.z[lane] = at.z;
    }
}
