//! What became of a measure, and how far two noses are apart.

use serde::{Deserialize, Serialize};

use super::measure::measure;

/// A measure of the nose after its last stage, beside the same measure before the first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// Its name in `measurements.csv`.
    pub measure: String,
    /// Its unit there.
    pub unit: &'static str,
    /// Before the first stage.
    pub before: f64,
    /// After the last stage.
    pub value: f64,
    /// `value` less `before`, in the measure's unit.
    pub change: f64,
    /// The same in percent of `before`; none of a measure that has no percentage, or that was 0.
    pub change_percent: Option<f64>,
}

impl Change {
    /// From two values of the measure of that name, in `unit`.
    pub fn new(name: String, unit: &'static str, before: f64, value: f64) -> Self {
        let change = value - before;
        let has_percent = measure(&name).is_some_and(|measure| measure.has_percent);
        let percent = 100.0 * change / before;
        Self {
            measure: name,
            unit,
            before,
            value,
            change,
            change_percent: (has_percent && percent.is_finite()).then_some(percent),
        }
    }

    /// Of every measure, given with its name and unit before the first stage and after the last.
    pub fn list(
        before: Vec<(String, f64, &'static str)>,
        after: Vec<(String, f64, &'static str)>,
    ) -> Vec<Self> {
        let pairs = before.into_iter().zip(after);
        let changes =
            pairs.map(|((_, before, _), (name, value, unit))| Self::new(name, unit, before, value));
        changes.collect()
    }
}

/// How far the skins of two candidates are apart after their last stages, where either moved ([`crate::surface::skin_difference`] says how).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceDifference {
    /// The names of the two.
    pub candidates: [String; 2],
    /// Mean distance over the area, mm.
    pub mean_mm: f64,
    /// 95 % of the area are no further apart, mm.
    pub p95_mm: f64,
    /// The largest distance, mm.
    pub max_mm: f64,
    /// The area that was compared, mm²: the mean of the two skins'.
    pub area_mm2: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn change(name: &str, before: f64, value: f64) -> Change {
        Change::new(name.to_owned(), "mm", before, value)
    }

    #[test]
    fn a_change_is_absolute_and_in_percent() {
        let found = change("height", 20.0, 15.0);
        assert_eq!((found.change, found.change_percent), (-5.0, Some(-25.0)));
        let same = change("gamma", 70.0, 70.0);
        assert_eq!((same.change, same.change_percent), (0.0, Some(0.0)));
    }

    #[test]
    fn what_has_no_percentage_has_none() {
        // A position, a movement, and a volume of nothing.
        for found in [
            change("tip_x", 129.0, 149.0),
            change("move_x", 0.0, 20.0),
            change("volume_A", 0.0, 3.0),
            change("volume_A", 0.0, 0.0),
        ] {
            assert_eq!(found.change_percent, None, "{found:?}");
        }
    }
}
