//! Numbers held against those that are kept, one by one.

use std::collections::{BTreeMap, BTreeSet};

use super::difference::{Cell, Difference, Kind};
use super::stored::Number;
use super::tolerance::Numbers;

/// What of the numbers differs: those that are kept in their order, then those that are not.
pub fn compare(expected: &[Number], found: &[Number], tolerance: &Numbers) -> Vec<Difference> {
    let by_key: BTreeMap<_, _> = found
        .iter()
        .map(|number| (number.key(), number.value))
        .collect();
    let mut differences = Vec::new();
    for number in expected {
        match by_key.get(&number.key()) {
            None => differences.push(Difference::missing(
                Kind::Number,
                number.name(),
                &number.unit,
                Cell::number(number.value),
            )),
            Some(found) => differences.extend(one(number, *found, tolerance)),
        }
    }
    let kept: BTreeSet<_> = expected.iter().map(Number::key).collect();
    let new = found.iter().filter(|number| !kept.contains(&number.key()));
    differences.extend(new.map(|number| {
        Difference::unexpected(
            Kind::Number,
            number.name(),
            &number.unit,
            Cell::number(number.value),
        )
    }));
    differences
}

/// The difference, if it is one. What is not a number agrees with nothing but its like.
fn one(expected: &Number, found: Option<f64>, tolerance: &Numbers) -> Option<Difference> {
    let differs = |difference, allowed| Difference {
        kind: Kind::Number,
        measure: expected.name(),
        unit: expected.unit.clone(),
        expected: Cell::number(expected.value),
        found: Cell::number(found),
        difference,
        tolerance: allowed,
    };
    let tolerance = tolerance.of(&expected.unit);
    match (expected.value, found) {
        (None, None) => None,
        (Some(a), Some(b)) => {
            let (difference, allowed) = (b - a, tolerance.allowed(a));
            let agrees = difference.abs() <= allowed;
            (!agrees).then(|| differs(Cell::Number(difference), Cell::Number(allowed)))
        }
        (Some(a), None) => Some(differs(Cell::Empty, Cell::Number(tolerance.allowed(a)))),
        (None, Some(_)) => Some(differs(Cell::Empty, Cell::Empty)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::golden::Settings;

    fn number(measure: &str, unit: &str, value: f64) -> Number {
        Number::new("straight", "midline", measure, unit, value)
    }

    fn tolerance(text: &str) -> Numbers {
        Settings::parse(text).unwrap().numbers
    }

    #[test]
    fn a_tolerance_holds_on_both_sides_and_ends_where_it_says() {
        let tolerance = tolerance("[numbers]\nmm = { absolute = 0.25 }\ndeg = { relative = 0.5 }");
        let differs = |unit: &str, expected: f64, found: f64| {
            let (expected, found) = (number("m", unit, expected), number("m", unit, found));
            !compare(&[expected], &[found], &tolerance).is_empty()
        };
        for (found, is_off) in [(10.25, false), (9.75, false), (10.26, true), (9.74, true)] {
            assert_eq!(differs("mm", 10.0, found), is_off, "{found}");
        }
        for (found, is_off) in [(-6.0, false), (-2.0, false), (-6.1, true), (-1.9, true)] {
            assert_eq!(differs("deg", -4.0, found), is_off, "{found}");
        }
    }

    #[test]
    fn a_difference_says_everything() {
        let tolerance = tolerance("[numbers]\nmm = { absolute = 0.25, relative = 0.05 }");
        let found = compare(
            &[number("height", "mm", 10.0)],
            &[number("height", "mm", 9.0)],
            &tolerance,
        );
        assert_eq!(
            found[0].row(),
            ["straight/midline: height", "mm", "10", "9", "-1", "0.5"]
        );
    }

    #[test]
    fn no_number_agrees_with_what_is_none() {
        let tolerance = tolerance("[numbers]\nmm = { absolute = 1e300, relative = 1e300 }");
        let of =
            |a: f64, b: f64| compare(&[number("m", "mm", a)], &[number("m", "mm", b)], &tolerance);
        for (a, b) in [
            (1.0, f64::NAN),
            (f64::NAN, 1.0),
            (1.0, f64::INFINITY),
            (f64::NEG_INFINITY, 0.0),
        ] {
            assert_eq!(of(a, b).len(), 1, "{a} {b}");
        }
        assert_eq!(of(f64::NAN, f64::NAN), []);
        // Beyond what can be subtracted.
        assert_eq!(of(f64::MAX, -f64::MAX), []);
        let none = Settings::default().numbers;
        let (a, b) = (number("m", "mm", f64::MAX), number("m", "mm", -f64::MAX));
        assert_eq!(compare(&[a], &[b], &none).len(), 1);
    }

    #[test]
    fn what_is_gone_and_what_is_new_is_told() {
        let (a, b) = (number("a", "mm", 1.0), number("b", "mm", 2.0));
        let other_unit = number("a", "mm3", 1.0);
        let tolerance = Settings::default().numbers;
        let found = compare(
            &[a.clone(), b.clone()],
            std::slice::from_ref(&b),
            &tolerance,
        );
        assert_eq!(
            found[0].row()[..4],
            ["straight/midline: a", "mm", "1", "not found"]
        );
        let found = compare(
            std::slice::from_ref(&b),
            &[a.clone(), b.clone()],
            &tolerance,
        );
        assert_eq!(
            found[0].row()[..4],
            ["straight/midline: a", "mm", "not expected", "1"]
        );
        assert_eq!(compare(&[a], &[other_unit], &tolerance).len(), 2);
        let b = [b];
        assert_eq!(compare(&b, &b, &tolerance), []);
    }
}
