//! The precision that a kernel computes in.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub};

use glam::DVec3;

use super::round::Round;

/// 2⁵²: the sum of this and a whole number below it has that number as the low bits.
const BITS: f64 = 4_503_599_627_370_496.0;

/// 2²³: the same in single precision.
const BITS_OF_SINGLE: f32 = 8_388_608.0;

/// A floating-point number: `f64`, in which everything is computed that is kept, or `f32`, of which a vector holds twice as
/// many, where it is enough to know a value roughly.
pub trait Real:
    Copy
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + MulAssign
    + Send
    + Sync
    + Round
{
    /// 1.5 · 2⁵², or 2²³: the sum of this and a number of fewer than 32 bits, or 22, is a whole number, rounded to nearest.
    const WHOLE: Self;

    /// How near to 1 a share may be that is 1 but for what its operands were rounded by.
    const SLACK: Self;

    /// The nearest number.
    fn of(value: f64) -> Self;

    /// The square root, correctly rounded.
    fn sqrt(self) -> Self;

    /// The number as it is.
    fn to_f64(self) -> f64;

    /// x + y · `row` + z · `plane` of whole numbers from 0 on: below 2²² each and 2³² together in single precision, 2⁵²
    /// in double.
    fn place(at: [Self; 3], row: usize, plane: usize) -> u64;
}

impl Real for f64 {
    const WHOLE: Self = 6_755_399_441_055_744.0;

    const SLACK: Self = 0.0;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }

    #[inline(always)]
    fn place([x, y, z]: [Self; 3], row: usize, plane: usize) -> u64 {
        let place = x + y * row as Self + z * plane as Self;
        (place + BITS).to_bits() - BITS.to_bits()
    }
}

impl Real for f32 {
    const WHOLE: Self = 12_582_912.0;

    const SLACK: Self = 1e-5;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value as Self
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        self.into()
    }

    #[inline(always)]
    fn place([x, y, z]: [Self; 3], row: usize, plane: usize) -> u64 {
        // Not a place of the volume where one of them is out of range: wrong, but no worse.
        let whole = |at: Self| {
            (at + BITS_OF_SINGLE)
                .to_bits()
                .wrapping_sub(BITS_OF_SINGLE.to_bits())
        };
        let (row, plane) = (row as u32, plane as u32);
        let rows = whole(y)
            .wrapping_mul(row)
            .wrapping_add(whole(z).wrapping_mul(plane));
        whole(x).wrapping_add(rows).into()
    }
}

/// A [`DVec3`] in any precision.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs, reason = "the three axes")]
pub struct Vector<F> {
    pub x: F,
    pub y: F,
    pub z: F,
}

impl<F: Real> Vector<F> {
    /// This and `times` another.
    #[inline(always)]
    pub fn plus(self, other: Self, times: F) -> Self {
        Self {
            x: self.x + other.x * times,
            y: self.y + other.y * times,
            z: self.z + other.z * times,
        }
    }

    /// The nearest vector.
    #[inline(always)]
    pub fn of(vector: DVec3) -> Self {
        Self {
            x: F::of(vector.x),
            y: F::of(vector.y),
            z: F::of(vector.z),
        }
    }
}

/// The larger of two numbers: one instruction on every vector unit, unlike `f64::max`, which has to look for what is no
/// number.
#[inline(always)]
pub fn larger<F: Real>(a: F, b: F) -> F {
    if a > b { a } else { b }
}

/// The smaller of two numbers, likewise.
#[inline(always)]
pub fn smaller<F: Real>(a: F, b: F) -> F {
    if a < b { a } else { b }
}

/// How far a number is from zero.
#[inline(always)]
pub fn size<F: Real>(a: F) -> F {
    larger(a, -a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_whole_in_any_precision() {
        let (row, plane) = (1021, 1021 * 999);
        for at in [[0, 0, 0], [1, 0, 0], [1020, 998, 4000], [17, 500, 77]] {
            let [x, y, z] = at;
            let expected = (x + y * row + z * plane) as u64;
            assert!(expected < 1 << 32);
            assert_eq!(f64::place(at.map(|at| at as f64), row, plane), expected);
            assert_eq!(f32::place(at.map(|at| at as f32), row, plane), expected);
        }
        // More than single precision holds.
        assert_eq!(f32::place([1020.0, 998.0, 4000.0], row, plane) % 2, 0);
        assert_eq!(f32::place([1019.0, 998.0, 4000.0], row, plane) % 2, 1);
    }

    #[test]
    fn the_whole_number_nearest_to_one() {
        assert_eq!((41.7_f64 + f64::WHOLE) - f64::WHOLE, 42.0);
        assert_eq!((-41.7_f32 + f32::WHOLE) - f32::WHOLE, -42.0);
        assert_eq!((200_000.25_f32 + f32::WHOLE) - f32::WHOLE, 200_000.0);
    }
}
