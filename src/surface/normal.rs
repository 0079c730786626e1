//! Unit vectors in four bytes.

use glam::{DVec3, Vec3};

/// Steps from 0 to 1 on the faces of the octahedron.
const STEPS: f64 = i16::MAX as f64;

/// A unit vector, quantised: projected onto the octahedron |x| + |y| + |z| = 1, whose lower half is
/// unfolded around the upper one, and stored as two 16-bit coordinates. Worst error about 0.004 degrees.
///
/// Source: Z. H. Cigolle et al., *A Survey of Efficient Representations for Independent Unit Vectors*,
/// Journal of Computer Graphics Techniques 3(2), 2014.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PackedNormal([i16; 2]);

impl PackedNormal {
    /// Towards the front of the face: what stands in where there is no direction at all.
    pub const ANTERIOR: Self = Self([0, -i16::MAX]);

    /// Its two numbers, little endian.
    pub(super) fn to_bytes(self) -> [u8; 4] {
        let [[a, b], [c, d]] = self.0.map(i16::to_le_bytes);
        [a, b, c, d]
    }

    /// What [`PackedNormal::to_bytes`] gave. Any bytes are a direction.
    pub(super) fn from_bytes([a, b, c, d]: [u8; 4]) -> Self {
        Self([[a, b], [c, d]].map(i16::from_le_bytes))
    }

    /// The nearest representable direction. `None` for a vector that has no direction.
    pub fn new(vector: DVec3) -> Option<Self> {
        let sum = vector.x.abs() + vector.y.abs() + vector.z.abs();
        if !(sum.is_finite() && sum > 0.0) {
            return None;
        }
        let on = vector / sum;
        let (u, v) = if on.z >= 0.0 {
            (on.x, on.y)
        } else {
            let fold = |along: f64, across: f64| (1.0 - across.abs()).copysign(along);
            (fold(on.x, on.y), fold(on.y, on.x))
        };
        // In range: both are at most 1 in size.
        Some(Self([
            (u * STEPS).round() as i16,
            (v * STEPS).round() as i16,
        ]))
    }

    /// The unit vector.
    #[inline]
    pub fn unpack(self) -> Vec3 {
        let [[x], [y], [z]] = Self::unpack_all(&[self]);
        Vec3::new(x, y, z)
    }

    /// Some unit vectors, by component.
    #[inline(always)]
    pub fn unpack_all<const N: usize>(packed: &[Self; N]) -> [[f32; N]; 3] {
        let scale = 1.0 / STEPS as f32;
        let [mut xs, mut ys, mut zs] = [[0.0; N]; 3];
        for lane in 0..N {
            let [u, v] = packed[lane].0;
            let (u, v) = (f32::from(u) * scale, f32::from(v) * scale);
            let z = 1.0 - u.abs() - v.abs();
            // Below the equator the corners are folded back.
            let fold = if z < 0.0 { -z } else { 0.0 };
            let x = u - fold.copysign(u);
            let y = v - fold.copysign(v);
            let length = (x * x + y * y + z * z).sqrt();
            (xs[lane], ys[lane], zs[lane]) = (x / length, y / length, z / length);
        }
        [xs, ys, zs]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_direction_returns() {
        let steps = [-1.0, -0.7, -0.31, -0.001, 0.0, 0.002, 0.4, 0.83, 1.0];
        let mut worst: f64 = 0.0;
        for x in steps {
            for y in steps {
                for z in steps {
                    let Some(packed) = PackedNormal::new(DVec3::new(x, y, z)) else {
                        assert_eq!((x, y, z), (0.0, 0.0, 0.0));
                        continue;
                    };
                    let back = packed.unpack().as_dvec3();
                    assert!((back.length() - 1.0).abs() < 1e-6);
                    worst = worst.max((back - DVec3::new(x, y, z).normalize()).length());
                }
            }
        }
        assert!(worst < 1e-4, "worst error {worst}");
    }

    #[test]
    fn what_has_no_direction_is_refused() {
        assert_eq!(PackedNormal::new(DVec3::ZERO), None);
        assert_eq!(PackedNormal::new(DVec3::new(f64::NAN, 0.0, 1.0)), None);
        assert_eq!(PackedNormal::new(DVec3::new(f64::INFINITY, 0.0, 1.0)), None);
    }
}
