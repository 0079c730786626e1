//! Colours for a signed quantity, and their legend.

use std::sync::OnceLock;

use super::svg::{Anchor, Colour, Stroke, Svg, TextStyle};
use super::ticks::{label, ticks};

/// Colours on one side of the middle.
const STEPS: usize = 512;

/// The ends of the map, sRGB: inward and outward.
const INWARD: Colour = [59, 76, 192];
const OUTWARD: Colour = [180, 4, 38];
/// The magnitude M of the middle in Msh: a light grey.
const MIDDLE_M: f64 = 88.0;

/// The colour of a signed share: blue at -1 (inward), light grey at 0, red at 1 (outward). Clamped to that
/// range; what is not a number has the colour of 0.
///
/// The "cool to warm" map of K. Moreland, *Diverging Color Maps for Scientific Visualization*, ISVC 2009,
/// DOI 10.1007/978-3-642-10520-3_9: even steps look even, and both sides are told apart with red-green
/// colour blindness.
pub fn diverging(t: f64) -> Colour {
    static TABLE: OnceLock<Vec<Colour>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let share = |n: usize| n as f64 / STEPS as f64 - 1.0;
        (0..=2 * STEPS).map(|n| interpolated(share(n))).collect()
    });
    let t = if t.is_nan() { 0.0 } else { t.clamp(-1.0, 1.0) };
    let place = ((t + 1.0) * STEPS as f64).round() as usize;
    table.get(place).copied().unwrap_or_default()
}

/// Moreland's interpolation: straight in Msh, from the middle to one end.
fn interpolated(t: f64) -> Colour {
    let end = to_msh(if t < 0.0 { INWARD } else { OUTWARD });
    let share = t.abs();
    let [m, s, h] = end;
    // Towards the middle the hue turns away, by an amount that keeps the steps even (his equation 3).
    let spin = s * libm::sqrt((MIDDLE_M * MIDDLE_M - m * m).max(0.0)) / (m * libm::sin(s));
    let middle_hue = if h > -std::f64::consts::FRAC_PI_3 {
        h + spin
    } else {
        h - spin
    };
    let blend = |middle: f64, end: f64| middle * (1.0 - share) + end * share;
    from_msh([blend(MIDDLE_M, m), blend(0.0, s), blend(middle_hue, h)])
}

/// The white point D65 of sRGB (IEC 61966-2-1).
const WHITE: [f64; 3] = [0.950_47, 1.0, 1.088_83];

/// sRGB to Msh, the polar form of CIELAB.
fn to_msh(colour: Colour) -> [f64; 3] {
    let [r, g, b] = colour.map(|level| {
        let level = f64::from(level) / 255.0;
        if level <= 0.040_45 {
            level / 12.92
        } else {
            libm::pow((level + 0.055) / 1.055, 2.4)
        }
    });
    let xyz = [
        0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b,
        0.212_672_9 * r + 0.715_152_2 * g + 0.072_175 * b,
        0.019_333_9 * r + 0.119_192 * g + 0.950_304_1 * b,
    ];
    let f = |value: f64| {
        if value > 0.008_856 {
            libm::cbrt(value)
        } else {
            7.787 * value + 16.0 / 116.0
        }
    };
    let [x, y, z] = [0, 1, 2].map(|axis| f(xyz[axis] / WHITE[axis]));
    let (l, a, b) = (116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z));
    let m = libm::sqrt(l * l + a * a + b * b);
    [m, libm::acos(l / m), libm::atan2(b, a)]
}

fn from_msh([m, s, h]: [f64; 3]) -> Colour {
    let l = m * libm::cos(s);
    let (a, b) = (
        m * libm::sin(s) * libm::cos(h),
        m * libm::sin(s) * libm::sin(h),
    );
    let y = (l + 16.0) / 116.0;
    let inverse = |value: f64| {
        let cube = value * value * value;
        if cube > 0.008_856 {
            cube
        } else {
            (value - 16.0 / 116.0) / 7.787
        }
    };
    let x = inverse(a / 500.0 + y) * WHITE[0];
    let z = inverse(y - b / 200.0) * WHITE[2];
    let y = inverse(y) * WHITE[1];
    [
        3.240_454_2 * x - 1.537_138_5 * y - 0.498_531_4 * z,
        -0.969_266 * x + 1.876_010_8 * y + 0.041_556 * z,
        0.055_643_4 * x - 0.204_025_9 * y + 1.057_225_2 * z,
    ]
    .map(|level| {
        let level = if level <= 0.003_130_8 {
            12.92 * level
        } else {
            1.055 * libm::pow(level, 1.0 / 2.4) - 0.055
        };
        (level.clamp(0.0, 1.0) * 255.0).round() as u8
    })
}

/// What the colours of [`diverging`] stand for in a picture: displacements along the skin's outward
/// normal, in mm. The colour of a displacement d is `diverging(d / limit)`, with
/// [`DivergingLegend::limit_mm`] as the limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DivergingLegend {
    /// The largest movement inward, mm; at most 0.
    pub min_mm: f64,
    /// The largest movement outward, mm; at least 0.
    pub max_mm: f64,
}

/// Height that a legend takes, pixels: ticks with numbers, the bar, and a line of text above it.
pub(super) const LEGEND_HEIGHT: f64 = 46.0;
const BAR_HEIGHT: f64 = 10.0;

impl DivergingLegend {
    /// The displacement, mm, that has the strongest colour on either side: equal movements inward and outward
    /// have colours of equal strength. 0 where nothing moves.
    pub fn limit_mm(&self) -> f64 {
        let finite = |value: f64| if value.is_finite() { value.abs() } else { 0.0 };
        finite(self.min_mm).max(finite(self.max_mm))
    }

    /// Draws the colours from `min_mm` to `max_mm` as a bar whose upper left corner, text included, is at
    /// `corner`; in an ink that the ground rims.
    pub(super) fn draw(
        &self,
        svg: &mut Svg,
        [left, top]: [f64; 2],
        width: f64,
        [ink, ground]: [Colour; 2],
    ) {
        let limit = self.limit_mm();
        let (low, high) = (self.min_mm.min(0.0), self.max_mm.max(0.0));
        let style = TextStyle {
            size: 11.0,
            colour: ink,
            anchor: Anchor::Start,
            halo: Some(ground),
        };
        let end = TextStyle {
            anchor: Anchor::End,
            ..style
        };
        if !(limit > 0.0 && (high - low).is_finite()) {
            let text = "the skin does not move";
            svg.text([left + width, top + LEGEND_HEIGHT - 4.0], text, end);
            return;
        }
        svg.text([left, top + 11.0], "inward", style);
        svg.text([left + width, top + 11.0], "outward, mm", end);
        let bar = top + 17.0;
        let rim = [width + 2.0, BAR_HEIGHT + 2.0];
        svg.rect([left - 1.0, bar - 1.0], rim, ground);
        let columns = width.round().max(1.0) as usize;
        let column = width / columns as f64;
        for n in 0..columns {
            let mm = low + (high - low) * ((n as f64 + 0.5) / columns as f64);
            // A hair wider, so that no ground shows between two.
            let size = [column + if n + 1 < columns { 0.5 } else { 0.0 }, BAR_HEIGHT];
            svg.rect([left + n as f64 * column, bar], size, diverging(mm / limit));
        }
        let (values, step) = ticks(low, high, (width / 36.0).max(2.0) as usize);
        for value in values {
            let x = left + width * ((value - low) / (high - low));
            let (from, to) = ([x, bar + BAR_HEIGHT], [x, bar + BAR_HEIGHT + 4.0]);
            svg.line(from, to, Stroke::solid(1.0, ink));
            let style = TextStyle {
                anchor: Anchor::Middle,
                ..style
            };
            svg.text([x, bar + BAR_HEIGHT + 15.0], &label(value, step), style);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_morelands_table() {
        // CoolWarmFloat33 that he publishes beside the paper, ×255; ours may round the last level elsewhere.
        for (t, published) in [
            (-1.0, [59.0, 76.0, 192.0]),
            (-0.5, [141.3, 176.0, 253.9]),
            (0.0, [220.6, 220.6, 220.6]),
            (0.5, [243.9, 152.5, 121.7]),
            (1.0, [180.0, 4.0, 38.0]),
        ] {
            let found = diverging(t);
            for (found, published) in found.into_iter().zip(published) {
                assert!((f64::from(found) - published).abs() < 1.6, "{t}: {found}");
            }
        }
    }

    #[test]
    fn beyond_the_ends_and_no_number_are_colours_too() {
        assert_eq!(diverging(-9.0), INWARD);
        assert_eq!(diverging(f64::INFINITY), OUTWARD);
        assert_eq!(diverging(f64::NAN), diverging(0.0));
    }

    #[test]
    fn strength_is_the_same_on_both_sides() {
        let legend = DivergingLegend {
            min_mm: -2.0,
            max_mm: 8.0,
        };
        assert_eq!(legend.limit_mm(), 8.0);
        let none = DivergingLegend {
            min_mm: f64::NAN,
            max_mm: 0.0,
        };
        assert_eq!(none.limit_mm(), 0.0);
    }
}
