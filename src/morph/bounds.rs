//! How much one stage's map can bend within a ball: what makes the adaptive method's tolerance hold at
//! every voxel and not only where it looks.
//!
//! Every distance to a segment changes by at most the distance moved, so its range over the ball follows
//! from its value at the centre. For r = d + ε with d the distance to a segment, along any unit direction,
//! |d'| ≤ 1 and 0 ≤ d·d'' ≤ 1; for a point feature likewise. With ρ = r₁²·Σ rₖ⁻² over the cage, λ = 1/(1 + ρ).

use glam::DVec3;

use super::EPSILON;
use super::stage::{StageMap, Taper, fade};
use super::still::Sums;
use crate::space::GridPoint;

/// Largest |t'| and |t''| of the fade from 1 to 0 over a unit of length, along any direction: 15/8 and
/// 10/√3 (attained at s = 1/2 and s = (3 − √3)/6).
const FADE_SLOPE: f64 = 1.875;
const FADE_CURVATURE: f64 = 5.773_502_691_896_258;

/// A ball counts as far from a line where it is at least this many of its radii away from it.
const FAR: f64 = 1.0;

/// A ball counts as small for the fade where its radius is at most this share of the margin.
const SMALL_FOR_FADE: f64 = 0.2;

/// How a map bends within a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Bend {
    /// No line is near, and the fade is wide: a smooth map on the scale of the cell.
    Smooth,
    /// The most that trilinear interpolation from the cell's corners can be off by. Infinite where a line
    /// runs through the cell.
    Bounded(f64),
}

/// Bounds over a region, along any unit direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    /// Of the first derivative of the map.
    pub lipschitz: f64,
    /// Of the second.
    pub curvature: f64,
}

impl Bounds {
    pub(super) const IDENTITY: Self = Self {
        lipschitz: 1.0,
        curvature: 0.0,
    };
}

/// Bounds of a factor of the displacement: its value and its two derivatives.
struct Factor {
    value: f64,
    slope: f64,
    curvature: f64,
}

impl StageMap {
    /// Whether the ball of `radius` about `centre`, in the model's units, is far from all nine lines and
    /// small for the fade.
    #[inline(always)]
    pub(super) fn is_far(&self, centre: DVec3, radius: f64) -> bool {
        let far = |distance: f64| distance - radius >= FAR * radius;
        let small = |taper: &Taper| {
            radius <= SMALL_FOR_FADE * taper.margin_mm
                || taper.nose.distance(GridPoint(centre)) - radius >= taper.margin_mm
        };
        self.taper.as_ref().is_none_or(small)
            && far(self.f1.distance(centre))
            && far(self.still.nearest(centre))
    }

    /// Bounds over the ball of `radius` about `centre`, in the model's units.
    #[inline(always)]
    pub(super) fn bounds(&self, centre: DVec3, radius: f64) -> Bounds {
        let fade = self.taper.as_ref().map_or(
            Factor {
                value: 1.0,
                slope: 0.0,
                curvature: 0.0,
            },
            |taper| fade_bounds(taper, centre, radius),
        );
        if fade.value == 0.0 {
            return Bounds::IDENTITY;
        }
        let lambda = self.lambda_bounds(centre, radius);
        // s = t·λ, and the displacement is s·g with g affine.
        let value = fade.value * lambda.value;
        let slope = fade.value * lambda.slope + fade.slope * lambda.value;
        let curvature = fade.value * lambda.curvature
            + 2.0 * fade.slope * lambda.slope
            + fade.curvature * lambda.value;
        let stretch = self.stretch();
        let pull = self.pull_bound(centre, radius);
        Bounds {
            lipschitz: 1.0 + value * stretch + slope * pull,
            curvature: curvature * pull + 2.0 * slope * stretch,
        }
    }

    /// How far Σ (d + ε)⁻² over the lines that hold still may be off within the ball of `radius` about `centre` so that no
    /// position is off by more than `off`, all in the model's units.
    ///
    /// With q = r₁² and the sum H, λ = 1/(1 + q·H) and |∂λ/∂H| = q/(1 + q·H)², at most 1/(4·H).
    #[inline(always)]
    pub(super) fn sum_tolerance(&self, centre: DVec3, radius: f64, off: f64) -> f64 {
        let f1 = self.f1.distance(centre);
        let (r_min, r_max) = ((f1 - radius).max(0.0) + EPSILON, f1 + radius + EPSILON);
        let least = self.still.sums(centre, radius).least;
        let scale = 1.0 / (1.0 + r_min * r_min * least);
        let slope = (0.25 / least).min(r_max * r_max * scale * scale);
        off / (slope * self.pull_bound(centre, radius))
    }

    /// The largest displacement by f1's map alone over the ball.
    #[inline(always)]
    fn pull_bound(&self, centre: DVec3, radius: f64) -> f64 {
        self.pair.displacement(centre).length() + self.stretch() * radius
    }

    /// The Frobenius norm of the linear part of f1's map.
    fn stretch(&self) -> f64 {
        let linear = self.pair.linear;
        let columns = [linear.x_axis, linear.y_axis, linear.z_axis];
        columns
            .map(DVec3::length_squared)
            .iter()
            .sum::<f64>()
            .sqrt()
    }

    #[inline(always)]
    fn lambda_bounds(&self, centre: DVec3, radius: f64) -> Factor {
        let f1 = self.f1.distance(centre);
        let nearest_f1 = (f1 - radius).max(0.0);
        let (r_min, r_max) = (nearest_f1 + EPSILON, f1 + radius + EPSILON);
        let Sums {
            nearest,
            least,
            most: [s2, s3, s4],
        } = self.still.sums(centre, radius);
        let nearest = (nearest - radius).max(0.0);
        let rho_min = r_min * r_min * least;
        let scale = 1.0 / (1.0 + rho_min);
        let rho_slope = 2.0 * r_max * s2 + 2.0 * r_max * r_max * s3;
        // Nearer than ε the second derivative of the distance outweighs the rest.
        let rho_curvature = if nearest_f1.min(nearest) <= EPSILON {
            f64::INFINITY
        } else {
            2.0 * (1.0 + EPSILON / nearest_f1) * s2 + 8.0 * r_max * s3 + 6.0 * r_max * r_max * s4
        };
        Factor {
            value: scale,
            slope: rho_slope * scale * scale,
            curvature: rho_curvature * scale * scale
                + 2.0 * rho_slope * rho_slope * scale * scale * scale,
        }
    }
}

fn fade_bounds(taper: &Taper, centre: DVec3, radius: f64) -> Factor {
    let distance = taper.nose.distance(GridPoint(centre));
    if distance - radius >= taper.margin_mm {
        return Factor {
            value: 0.0,
            slope: 0.0,
            curvature: 0.0,
        };
    }
    let nearest = (distance - radius).max(0.0);
    let (lo, hi) = (taper.nose.min.0, taper.nose.max.0);
    let depth = (centre - lo).min(hi - centre).min_element();
    let moves = depth < radius;
    let m = taper.margin_mm;
    Factor {
        value: fade(nearest / m),
        slope: if moves { FADE_SLOPE / m } else { 0.0 },
        curvature: if moves { FADE_CURVATURE / (m * m) } else { 0.0 },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_constants_bound_the_fade() {
        let (mut slope, mut curvature) = (0.0_f64, 0.0_f64);
        let step = 1e-4;
        for place in 1..10_000 {
            let s = place as f64 * step;
            let (a, b, c) = (fade(s - step), fade(s), fade((s + step).min(1.0)));
            slope = slope.max((c - a).abs() / (2.0 * step));
            curvature = curvature.max((a - 2.0 * b + c).abs() / (step * step));
            // Across the box's edges the distance itself bends by 1/distance.
            curvature = curvature.max((c - a).abs() / (2.0 * step) / s);
        }
        assert!(slope <= FADE_SLOPE && slope > FADE_SLOPE - 1e-3);
        assert!(curvature <= FADE_CURVATURE + 1e-4 && curvature > FADE_CURVATURE - 1e-3);
    }
}
