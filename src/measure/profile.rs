//! From Hounsfield units to depth below the skin.

/// HU of air, the level outside an edge.
const AIR_HU: f64 = -1000.0;
/// HU of water, near that of skin: the level inside.
const WATER_HU: f64 = 0.0;
/// Beyond this share of the way from the middle to either level, about two standard deviations from the
/// edge, noise decides how deep a voxel seems.
const SATURATED: f64 = 0.96;
/// What such voxels still gain from there on, by half the difference of the levels: little, but enough that
/// the order of two values is always that of their HU.
const BEYOND: f64 = 0.25;

/// How deep a voxel lies below the skin's edge, in standard deviations of its blur; negative in air.
///
/// A scanner shows an edge nearly as a Gaussian's integral. Between voxels that is far from a straight line
/// at voxel sizes of a standard deviation or two, and its inverse, which this is, is one by construction.
/// So a surface lies where the interpolated *depth*, not the interpolated HU, reaches the threshold's.
/// Strictly increasing: whether a voxel reaches a threshold is not changed by it, for any threshold.
#[inline(always)]
pub(super) fn depth(hu: f64) -> f64 {
    const MIDDLE: f64 = (AIR_HU + WATER_HU) / 2.0;
    const HALF: f64 = (WATER_HU - AIR_HU) / 2.0;
    let share = (hu - MIDDLE) / HALF;
    let inner = if share > -SATURATED {
        share
    } else {
        -SATURATED
    };
    let inner = if inner < SATURATED { inner } else { SATURATED };
    // √2 · erf⁻¹(inner), a least-squares fit of a rational function: within 3e-4 (a test).
    let q = inner * inner;
    let above = 1.254_320_364 + q * (-1.511_380_398 + q * 0.340_404_625);
    let below = 1.0 + q * (-1.459_973_613 + q * 0.489_663_939);
    inner * above / below + (share - inner) * BEYOND
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_undoes_a_gaussian_edge() {
        for n in -200..=200 {
            let sigmas = f64::from(n) / 100.0;
            let inside = 0.5 * libm::erfc(-sigmas * std::f64::consts::FRAC_1_SQRT_2);
            let found = depth(AIR_HU + (WATER_HU - AIR_HU) * inside);
            assert!((found - sigmas).abs() < 3e-4, "{sigmas}: {found}");
        }
    }

    #[test]
    fn it_keeps_the_order_of_all_values() {
        let hu = (-40_000..=40_000).map(|n| f64::from(n) * 0.1);
        let mut last = f64::NEG_INFINITY;
        for depth in hu.map(depth) {
            assert!(depth > last);
            last = depth;
        }
        assert!(depth(1e300).is_finite() && depth(-1e300).is_finite());
    }
}
