//! The limits that a plan sets to its candidates, and whether they keep them.

use serde::{Deserialize, Deserializer, Serialize};

use super::change::Change;
use super::measure::{Measure, measure};

/// The limits of a plan, all of which a candidate must keep to be accepted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Accept {
    /// At least one, in the order of [`super::MEASURES`].
    pub limits: Vec<Limit>,
}

/// What of a measure is limited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// The measure after the last stage.
    Value,
    /// What it is more than before the first stage.
    Change,
    /// The same in percent.
    ChangePercent,
}

/// One limit; the ends belong to what is allowed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// The measure's name.
    #[serde(serialize_with = "name", deserialize_with = "named")]
    pub measure: &'static Measure,
    /// What of it is limited.
    pub of: Quantity,
    /// The least that is allowed; none where there is no such end.
    pub min: Option<f64>,
    /// The most that is allowed; none where there is no such end.
    pub max: Option<f64>,
}

fn name<S: serde::Serializer>(measure: &&'static Measure, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(measure.name)
}

fn named<'de, D: Deserializer<'de>>(from: D) -> Result<&'static Measure, D::Error> {
    let given = String::deserialize(from)?;
    let unknown = || serde::de::Error::custom(format!("`{given}` is no measure"));
    measure(&given).ok_or_else(unknown)
}

/// Whether a candidate is accepted.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// Whether every limit is kept.
    pub accepted: bool,
    /// Every limit, in the order of the plan's.
    pub limits: Vec<Checked>,
}

/// A limit, and what was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Checked {
    /// The measure's name.
    pub measure: &'static str,
    /// What of it is limited.
    pub of: Quantity,
    /// The unit of the numbers.
    pub unit: &'static str,
    /// The least that is allowed.
    pub min: Option<f64>,
    /// The most that is allowed.
    pub max: Option<f64>,
    /// What was found; none where there is no such number, as of a percentage of nothing.
    pub found: Option<f64>,
    /// Whether the limit is kept. What was not found keeps none.
    pub kept: bool,
}

impl Accept {
    /// Holds a candidate's changes against the limits.
    pub fn verdict(&self, changes: &[Change]) -> Verdict {
        let limits: Vec<Checked> = self
            .limits
            .iter()
            .map(|limit| limit.check(changes))
            .collect();
        Verdict {
            accepted: limits.iter().all(|limit| limit.kept),
            limits,
        }
    }
}

impl Accept {
    /// The limits of a measure.
    pub fn of<'a>(&'a self, measure: &'a str) -> impl Iterator<Item = &'a Limit> {
        self.limits
            .iter()
            .filter(move |limit| limit.measure.name == measure)
    }

    /// The values of a measure that keep all limits of it, from the least to the most, infinite where there is no end:
    /// of a nose where it was `before` before the first stage. None where it has no limit, or no value keeps all.
    pub fn range(&self, measure: &str, before: f64) -> Option<[f64; 2]> {
        let ranges = self.of(measure).map(|limit| limit.range(before));
        let both = |a: Option<[f64; 2]>, b: Option<[f64; 2]>| {
            let ([a, b], [c, d]) = (a?, b?);
            Some([a.max(c), b.min(d)])
        };
        let range = ranges.reduce(both)??;
        (range[0] <= range[1]).then_some(range)
    }
}

impl Limit {
    /// What is allowed, as in "70 to 110 deg", and of what, where that is not the value.
    pub fn shown(&self) -> String {
        let allowed = self.check(&[]).allowed();
        match self.of {
            Quantity::Value => allowed,
            Quantity::Change | Quantity::ChangePercent => format!("change {allowed}"),
        }
    }

    /// The values of the measure that keep the limit; none where a percentage is of nothing.
    fn range(&self, before: f64) -> Option<[f64; 2]> {
        let value = |limit: f64| match self.of {
            Quantity::Value => limit,
            Quantity::Change => before + limit,
            Quantity::ChangePercent => before + before * limit / 100.0,
        };
        if self.of == Quantity::ChangePercent && !(self.measure.has_percent && before > 0.0) {
            return None;
        }
        Some([
            self.min.map_or(f64::NEG_INFINITY, value),
            self.max.map_or(f64::INFINITY, value),
        ])
    }

    fn check(&self, changes: &[Change]) -> Checked {
        let change = changes
            .iter()
            .find(|change| change.measure == self.measure.name);
        let found = change.and_then(|change| match self.of {
            Quantity::Value => Some(change.value),
            Quantity::Change => Some(change.change),
            Quantity::ChangePercent => change.change_percent,
        });
        let within = |found: f64| {
            self.min.is_none_or(|min| found >= min) && self.max.is_none_or(|max| found <= max)
        };
        Checked {
            measure: self.measure.name,
            of: self.of,
            unit: match self.of {
                Quantity::Value | Quantity::Change => self.measure.unit,
                Quantity::ChangePercent => "%",
            },
            min: self.min,
            max: self.max,
            found,
            kept: found.is_some_and(within),
        }
    }
}

impl Verdict {
    /// The limits that are not kept.
    pub fn failures(&self) -> impl Iterator<Item = &Checked> {
        self.limits.iter().filter(|limit| !limit.kept)
    }
}

impl Checked {
    /// What is limited, as in "change of `volume_total`".
    pub fn what(&self) -> String {
        match self.of {
            Quantity::Value => format!("`{}`", self.measure),
            Quantity::Change | Quantity::ChangePercent => format!("change of `{}`", self.measure),
        }
    }

    /// What is allowed, as in "70 to 110 deg".
    pub fn allowed(&self) -> String {
        let unit = self.shown_unit();
        match (self.min, self.max) {
            (Some(min), Some(max)) => format!("{min} to {max}{unit}"),
            (Some(min), None) => format!("at least {min}{unit}"),
            (None, Some(max)) => format!("at most {max}{unit}"),
            (None, None) => "anything".to_owned(),
        }
    }

    /// What was found, with as many digits as it takes to see on which side of the limit it lies.
    pub fn shown(&self) -> String {
        let Some(found) = self.found else {
            return "not a number".to_owned();
        };
        let is_kept = |shown: &str| {
            let shown: f64 = shown.parse().unwrap_or(f64::NAN);
            self.min.is_none_or(|min| shown >= min) && self.max.is_none_or(|max| shown <= max)
        };
        let digits = if self.unit == "1" { 3 } else { 2 };
        let shown = (digits..=12)
            .map(|digits| format!("{found:.digits$}"))
            .find(|shown| is_kept(shown) == self.kept);
        shown.unwrap_or_else(|| found.to_string()) + self.shown_unit()
    }

    fn shown_unit(&self) -> &'static str {
        match self.unit {
            "mm3" => " mm³",
            "deg" => "°",
            "mm" => " mm",
            "voxel" => " voxels",
            "%" => " %",
            _ => "",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::measure::measure;
    use super::*;

    fn limit(name: &str, of: Quantity, min: Option<f64>, max: Option<f64>) -> Limit {
        Limit {
            measure: measure(name).unwrap(),
            of,
            min,
            max,
        }
    }

    fn changes() -> Vec<Change> {
        [("height", "mm", 20.0, 15.0), ("volume_A", "mm3", 0.0, 4.0)]
            .map(|(name, unit, before, value)| Change::new(name.to_owned(), unit, before, value))
            .into()
    }

    fn kept(of: Quantity, min: Option<f64>, max: Option<f64>) -> bool {
        let limits = vec![limit("height", of, min, max)];
        Accept { limits }.verdict(&changes()).accepted
    }

    #[test]
    fn the_ends_are_allowed_and_what_is_beyond_is_not() {
        use Quantity::{Change, ChangePercent, Value};
        for (of, at) in [(Value, 15.0), (Change, -5.0), (ChangePercent, -25.0)] {
            assert!(kept(of, Some(at), Some(at)));
            assert!(kept(of, Some(at), None) && kept(of, None, Some(at)));
            assert!(!kept(of, Some(at + 1e-9), None));
            assert!(!kept(of, None, Some(at - 1e-9)));
        }
    }

    #[test]
    fn one_limit_that_is_not_kept_fails_and_is_named() {
        let accept = Accept {
            limits: vec![
                limit("height", Quantity::Value, Some(10.0), None),
                limit("height", Quantity::ChangePercent, Some(-20.0), Some(0.0)),
            ],
        };
        let verdict = accept.verdict(&changes());
        assert!(!verdict.accepted);
        let failed: Vec<_> = verdict.failures().collect();
        let [failed] = failed[..] else {
            panic!("{failed:?}")
        };
        assert_eq!(failed.what(), "change of `height`");
        assert_eq!(failed.allowed(), "-20 to 0 %");
        assert_eq!(failed.shown(), "-25.00 %");
    }

    #[test]
    fn a_percentage_of_nothing_and_a_measure_that_is_not_there_keep_no_limit() {
        for (name, of) in [
            ("volume_A", Quantity::ChangePercent),
            ("volume_B", Quantity::Value),
        ] {
            let limits = vec![limit(name, of, Some(-1e9), Some(1e9))];
            let verdict = Accept { limits }.verdict(&changes());
            assert!(!verdict.accepted);
            assert_eq!(verdict.limits[0].shown(), "not a number");
        }
    }

    #[test]
    fn the_range_of_a_measure_is_that_of_all_its_limits() {
        use Quantity::{Change, ChangePercent, Value};
        let range = |limits: Vec<Limit>, before| Accept { limits }.range("height", before);
        let of = |of, min, max| limit("height", of, min, max);
        let value = of(Value, Some(10.0), Some(19.0));
        assert_eq!(range(vec![value], 20.0), Some([10.0, 19.0]));
        let percent = of(ChangePercent, Some(-20.0), None);
        assert_eq!(range(vec![percent], 20.0), Some([16.0, f64::INFINITY]));
        assert_eq!(range(vec![value, percent], 20.0), Some([16.0, 19.0]));
        let change = of(Change, None, Some(-11.0));
        assert_eq!(range(vec![change], 20.0), Some([f64::NEG_INFINITY, 9.0]));
        assert_eq!(range(vec![value, change], 20.0), None, "nothing keeps both");
        assert_eq!(range(vec![percent], 0.0), None);
        assert_eq!(range(vec![], 20.0), None);
        assert_eq!(percent.shown(), "change at least -20 %");
        assert_eq!(value.shown(), "10 to 19 mm");
        // Written and read back.
        let accept = Accept {
            limits: vec![value, percent],
        };
        let text = serde_json::to_string(&accept).unwrap();
        assert_eq!(serde_json::from_str::<Accept>(&text).unwrap(), accept);
        assert!(serde_json::from_str::<Accept>(&text.replace("height", "hight")).is_err());
    }

    #[test]
    fn what_is_shown_is_on_its_side_of_the_limit() {
        let mut checked = Accept {
            limits: vec![limit("height", Quantity::Value, None, Some(15.0))],
        }
        .verdict(&changes())
        .limits
        .remove(0);
        assert_eq!(checked.shown(), "15.00 mm");
        checked.found = Some(15.00004);
        checked.kept = false;
        assert_eq!(checked.shown(), "15.00004 mm");
    }
}
