//! Round numbers along an axis.

/// Round numbers within [`low`, `high`], a step of 1, 2 or 5 times a power of ten apart, and the step: the
/// smallest that gives at most `most` of them. None where the ends are not finite or not in order.
///
/// Powers of ten come from the decimal reader, which rounds the same everywhere.
pub(super) fn ticks(low: f64, high: f64, most: usize) -> (Vec<f64>, f64) {
    let span = high - low;
    if !(span.is_finite() && span > 0.0) || most == 0 {
        return (Vec::new(), 1.0);
    }
    let steps = (-300..=300)
        .flat_map(|power| [1, 2, 5].map(|digit| format!("{digit}e{power}")))
        .filter_map(|text| text.parse::<f64>().ok());
    for step in steps {
        // Whole numbers of steps beyond 2⁵³ are not told apart.
        let (first, last) = ((low / step).ceil(), (high / step).floor());
        if first.abs().max(last.abs()) < 9e15 && last - first < most as f64 {
            let count = (last - first) as i64;
            let at = |n: i64| (first + n as f64) * step;
            return ((0..=count).map(at).collect(), step);
        }
    }
    (Vec::new(), 1.0)
}

/// A tick's number, with as many decimals as its step needs.
pub(super) fn label(value: f64, step: f64) -> String {
    // A zero that came out of rounding keeps no sign.
    let value = if value.abs() < step * 1e-9 {
        0.0
    } else {
        value
    };
    let magnitude = value.abs().max(step);
    if value != 0.0 && (magnitude >= 1e7 || step < 1e-4) {
        return format!("{value:.1e}").replace('-', "−");
    }
    let mut decimals = 0;
    let mut rest = step;
    while decimals < 4 && rest < 0.999 {
        rest *= 10.0;
        decimals += 1;
    }
    format!("{value:.decimals$}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_numbers_within_the_range() {
        assert_eq!(
            ticks(-12.0, 31.0, 6),
            (vec![-10.0, 0.0, 10.0, 20.0, 30.0], 10.0)
        );
        assert_eq!(ticks(0.0, 1.0, 6).0.len(), 6);
        assert_eq!(ticks(0.0, 1.0, 6).1, 0.2);
        assert!(!ticks(0.0, 1e300, 8).0.is_empty());
        assert!(!ticks(0.0, 1e-290, 8).0.is_empty());
        for (low, high) in [
            (0.0, 0.0),
            (1.0, 0.0),
            (f64::NAN, 1.0),
            (0.0, f64::INFINITY),
        ] {
            assert!(ticks(low, high, 5).0.is_empty());
        }
        assert!(ticks(f64::MIN, f64::MAX, 5).0.is_empty());
    }

    #[test]
    fn a_label_has_the_decimals_of_its_step() {
        assert_eq!(label(-10.0, 10.0), "−10");
        assert_eq!(label(0.1 + 0.2, 0.1), "0.3");
        assert_eq!(label(0.25, 0.05), "0.25");
        assert_eq!(label(-1e-17, 0.5), "0.0");
        assert_eq!(label(2e9, 1e9), "2.0e9");
    }
}
