//! A handful of positions, one array per axis, so that a loop over them is a loop over vector lanes.

use glam::DVec3;

use crate::simd::{Real, Vector};

/// Positions handled at once. Two rows of eight: a tile's row, and enough for any vector unit.
pub const LANES: usize = 16;

/// [`LANES`] positions in voxels of a lattice.
#[derive(Debug, Clone, PartialEq)]
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

    /// Every lane at the position nearest to one.
    pub fn splat(at: DVec3) -> Self {
        Self {
            x: [F::of(at.x); LANES],
            y: [F::of(at.y); LANES],
            z: [F::of(at.z); LANES],
        }
    }

    /// The position in one lane; `lane` below [`LANES`].
    #[inline(always)]
    pub fn get(&self, lane: usize) -> DVec3 {
        DVec3::new(
            self.x[lane].to_f64(),
            self.y[lane].to_f64(),
            self.z[lane].to_f64(),
        )
    }

    /// Puts the position nearest to one into one lane; `lane` below [`LANES`].
    #[inline(always)]
    pub fn set(&mut self, lane: usize, at: DVec3) {
        self.x[lane] = F::of(at.x);
        self.y[lane] = F::of(at.y);
        self.z[lane] = F::of(at.z);
    }

    /// The position in one lane, in any precision; `lane` below [`LANES`].
    #[inline(always)]
    pub(super) fn vector<G: Real>(&self, lane: usize) -> Vector<G> {
        Vector {
            x: G::of(self.x[lane].to_f64()),
            y: G::of(self.y[lane].to_f64()),
            z: G::of(self.z[lane].to_f64()),
        }
    }
}
