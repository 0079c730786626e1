//! The pieces that the head is made of: distance-like functions, negative inside, and how they blend.
//!
//! Everything is generic over [`Scalar`], so the same text gives a value (`f64`) or a value with its
//! gradient ([`Dual`]). All lengths are grid millimetres.

use std::ops::{Add, Mul, Neg, Sub};

use glam::DVec3;

/// A number, or a number that carries its gradient.
pub(super) trait Scalar:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// A value that no coordinate changes.
    fn constant(value: f64) -> Self;
    /// The number without its gradient.
    fn value(self) -> f64;
    /// The square root; 0 (with gradient 0) for a number that is not positive.
    fn sqrt(self) -> Self;
    /// `self / by`. `by` is not zero.
    fn over(self, by: Self) -> Self;

    /// `self²`.
    fn square(self) -> Self {
        self * self
    }

    /// The larger of the two.
    fn larger(self, other: Self) -> Self {
        if self.value() >= other.value() {
            self
        } else {
            other
        }
    }
}

impl Scalar for f64 {
    #[inline]
    fn constant(value: f64) -> Self {
        value
    }
    #[inline]
    fn value(self) -> f64 {
        self
    }
    #[inline]
    fn sqrt(self) -> Self {
        f64::sqrt(self.max(0.0))
    }
    #[inline]
    fn over(self, by: Self) -> Self {
        self / by
    }
}

/// A value and its gradient by x, y and z: forward differentiation (Wengert 1964).
#[derive(Debug, Clone, Copy)]
pub(super) struct Dual {
    pub value: f64,
    pub gradient: DVec3,
}

impl Dual {
    /// The three coordinates of a point, as functions of themselves.
    pub fn coordinates(point: DVec3) -> [Self; 3] {
        let axis = |value, gradient| Self { value, gradient };
        [
            axis(point.x, DVec3::X),
            axis(point.y, DVec3::Y),
            axis(point.z, DVec3::Z),
        ]
    }
}

macro_rules! dual_operator {
    ($trait:ident, $method:ident, $right:ty, |$a:ident, $b:ident| $value:expr, $gradient:expr) => {
        impl $trait<$right> for Dual {
            type Output = Self;
            #[inline]
            fn $method(self, other: $right) -> Self {
                let ($a, $b) = (self, other);
                Self {
                    value: $value,
                    gradient: $gradient,
                }
            }
        }
    };
}

dual_operator!(
    Add,
    add,
    Dual,
    |a, b| a.value + b.value,
    a.gradient + b.gradient
);
dual_operator!(
    Sub,
    sub,
    Dual,
    |a, b| a.value - b.value,
    a.gradient - b.gradient
);
dual_operator!(
    Mul,
    mul,
    Dual,
    |a, b| a.value * b.value,
    a.gradient * b.value + b.gradient * a.value
);
dual_operator!(Add, add, f64, |a, b| a.value + b, a.gradient);
dual_operator!(Sub, sub, f64, |a, b| a.value - b, a.gradient);
dual_operator!(Mul, mul, f64, |a, b| a.value * b, a.gradient * b);

impl Neg for Dual {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self {
            value: -self.value,
            gradient: -self.gradient,
        }
    }
}

impl Scalar for Dual {
    #[inline]
    fn constant(value: f64) -> Self {
        Self {
            value,
            gradient: DVec3::ZERO,
        }
    }
    #[inline]
    fn value(self) -> f64 {
        self.value
    }
    #[inline]
    fn sqrt(self) -> Self {
        if self.value <= 0.0 {
            return Self::constant(0.0);
        }
        let value = self.value.sqrt();
        Self {
            value,
            gradient: self.gradient * (0.5 / value),
        }
    }
    #[inline]
    fn over(self, by: Self) -> Self {
        let value = self.value / by.value;
        Self {
            value,
            gradient: (self.gradient - by.gradient * value) * (1.0 / by.value),
        }
    }
}

/// A point: x to the patient's left, y to posterior, z to superior, mm.
pub(super) type Point<S> = [S; 3];

/// A fixed point or a set of radii, mm.
pub(super) type Constants = [f64; 3];

/// Union of two bodies, rounded where they meet: the cubic polynomial minimum, twice continuously
/// differentiable, which differs from the minimum where the two are less than `width` apart.
#[inline]
pub(super) fn union<S: Scalar>(a: S, b: S, width: f64) -> S {
    let (low, high) = if a.value() <= b.value() {
        (a, b)
    } else {
        (b, a)
    };
    if high.value() - low.value() >= width {
        return low;
    }
    let near = (low - high) * (1.0 / width) + 1.0;
    low - near * near * near * (width / 6.0)
}

/// What two bodies share, rounded as [`union`].
#[inline]
pub(super) fn intersection<S: Scalar>(a: S, b: S, width: f64) -> S {
    -union(-a, -b, width)
}

/// A body without another, rounded as [`union`].
#[inline]
pub(super) fn without<S: Scalar>(body: S, hole: S, width: f64) -> S {
    intersection(body, -hole, width)
}

/// |value|, rounded within `width` of 0, so that mirrored halves meet without a crease.
#[inline]
pub(super) fn soft_abs<S: Scalar>(value: S, width: f64) -> S {
    (value.square() + width * width).sqrt()
}

/// How deep in an ellipsoid its field goes on falling, as a share of its smallest radius. Further in,
/// the field below would change faster and faster.
const DEEPEST: f64 = 0.6;

/// An ellipsoid with its axes along x, y and z: k₀(k₀ − 1)/k₁ with k₀ = |p/r|, k₁ = |p/r²|, which near the
/// surface is the distance to first order.
#[inline]
pub(super) fn ellipsoid<S: Scalar>(p: Point<S>, centre: Constants, radii: Constants) -> S {
    let scaled = |axis: usize| (p[axis] - centre[axis]) * (1.0 / radii[axis]);
    let (x, y, z) = (scaled(0), scaled(1), scaled(2));
    let k0 = (x.square() + y.square() + z.square()).sqrt();
    let deepest = S::constant(-DEEPEST * radii[0].min(radii[1]).min(radii[2]));
    if k0.value() < 1.0 - DEEPEST {
        return deepest;
    }
    let slope = |value: S, axis: usize| (value * (1.0 / radii[axis])).square();
    let k1 = (slope(x, 0) + slope(y, 1) + slope(z, 2)).sqrt();
    (k0 * (k0 - 1.0)).over(k1).larger(deepest)
}

/// An ellipse in the plane of two coordinates, its radii functions of position: the same formula as
/// [`ellipsoid`].
#[inline]
pub(super) fn ellipse<S: Scalar>(x: S, y: S, rx: S, ry: S) -> S {
    let (sx, sy) = (x.over(rx), y.over(ry));
    let k0 = (sx.square() + sy.square()).sqrt();
    let deepest = (if rx.value() < ry.value() { rx } else { ry }) * -DEEPEST;
    if k0.value() < 1.0 - DEEPEST {
        return deepest;
    }
    let k1 = (sx.over(rx).square() + sy.over(ry).square()).sqrt();
    (k0 * (k0 - 1.0)).over(k1).larger(deepest)
}

/// `curvature`/2 · value² near 0, going over into straight arms of slope `slope`: a bend that stays
/// gentle far away.
#[inline]
pub(super) fn bend<S: Scalar>(value: S, curvature: f64, slope: f64) -> S {
    let width = slope / curvature;
    (soft_abs(value, width) - width) * slope
}

/// A segment swept by a ball whose radius goes evenly from `ra` at `a` to `rb` at `b`.
#[inline]
pub(super) fn capsule<S: Scalar>(
    p: Point<S>,
    (a, ra): (Constants, f64),
    (b, rb): (Constants, f64),
) -> S {
    let along = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let length_squared = along[0] * along[0] + along[1] * along[1] + along[2] * along[2];
    let from_a = [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
    let mut t = (from_a[0] * along[0] + from_a[1] * along[1] + from_a[2] * along[2])
        * (1.0 / length_squared);
    if t.value() <= 0.0 {
        t = S::constant(0.0);
    } else if t.value() >= 1.0 {
        t = S::constant(1.0);
    }
    let off = |axis: usize| (from_a[axis] - t * along[axis]).square();
    let distance = (off(0) + off(1) + off(2)).sqrt();
    distance - (t * (rb - ra) + ra)
}

/// A box with its edges along x, y and z and rounded by a ball of `radius`: `half` is half its size
/// before rounding.
#[inline]
pub(super) fn rounded_box<S: Scalar>(
    p: Point<S>,
    centre: Constants,
    half: Constants,
    radius: f64,
) -> S {
    let beyond = |axis: usize| {
        let off = p[axis] - centre[axis];
        off.larger(-off) - half[axis]
    };
    let (x, y, z) = (beyond(0), beyond(1), beyond(2));
    let most = x.larger(y).larger(z);
    if most.value() <= 0.0 {
        return most - radius;
    }
    let zero = S::constant(0.0);
    let squares = x.larger(zero).square() + y.larger(zero).square() + z.larger(zero).square();
    squares.sqrt() - radius
}

/// A uniform cubic B-spline of `controls`, control `n` at parameter `n`; constant beyond its ends.
/// Twice continuously differentiable; a straight row of controls gives that straight line.
#[inline]
pub(super) fn spline<S: Scalar>(controls: &[f64], t: S) -> S {
    let last = controls.len() as f64 - 1.0;
    let t = if t.value() <= 0.0 {
        S::constant(0.0)
    } else if t.value() >= last {
        S::constant(last)
    } else {
        t
    };
    let start = t.value().floor();
    let control = |offset: f64| {
        let place = (start + offset).clamp(0.0, last);
        controls.get(place as usize).copied().unwrap_or_default()
    };
    let u = t - start;
    let v = -u + 1.0;
    let (u2, v2) = (u * u, v * v);
    let w0 = v2 * v;
    let w1 = u2 * (u * 3.0 - 6.0) + 4.0;
    let w2 = v2 * (v * 3.0 - 6.0) + 4.0;
    let w3 = u2 * u;
    (w0 * control(-1.0) + w1 * control(0.0) + w2 * control(1.0) + w3 * control(2.0)) * (1.0 / 6.0)
}
