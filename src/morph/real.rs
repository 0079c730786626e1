//! The precision that a map is computed in.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub};

use glam::DVec3;

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
{
    /// The nearest number.
    fn of(value: f64) -> Self;

    /// The square root, correctly rounded.
    fn sqrt(self) -> Self;

    /// The number as it is.
    fn to_f64(self) -> f64;
}

impl Real for f64 {
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
}

impl Real for f32 {
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
}

/// A [`DVec3`] in any precision.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vector<F> {
    pub x: F,
    pub y: F,
    pub z: F,
}

impl<F: Real> Vector<F> {
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
pub(super) fn larger<F: Real>(a: F, b: F) -> F {
    if a > b { a } else { b }
}

/// The smaller of two numbers, likewise.
#[inline(always)]
pub(super) fn smaller<F: Real>(a: F, b: F) -> F {
    if a < b { a } else { b }
}

/// How far a number is from zero.
#[inline(always)]
pub(super) fn size<F: Real>(a: F) -> F {
    larger(a, -a)
}
