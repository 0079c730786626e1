//! What a sweep varied: which candidates belong together, and which of their numbers is drawn against which.

use std::collections::HashMap;

use serde::{Deserialize, Deserializer, Serialize};

/// The units that a swept number can have.
const UNITS: [&str; 4] = ["mm", "voxel", "deg", "1"];

/// A number of an edit that a sweep varies, and the value that a candidate has of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Swept {
    /// The stage's name.
    pub stage: String,
    /// The edit's name, and the axis of a vector: `rotate`, `move_tip y`.
    pub edit: String,
    /// The value that it has here, in the unit of the plan.
    pub value: f64,
    /// That unit: `mm`, `voxel`, `deg` or `1`.
    pub unit: &'static str,
}

// Not derived: that would take a unit that lives for ever for one that is borrowed from the text.
impl<'de> Deserialize<'de> for Swept {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        struct Read {
            stage: String,
            edit: String,
            value: f64,
            unit: String,
        }
        let Read {
            stage,
            edit,
            value,
            unit,
        } = Read::deserialize(from)?;
        let known = UNITS.into_iter().find(|known| *known == unit);
        let unit = known.ok_or_else(|| serde::de::Error::unknown_variant(&unit, &UNITS))?;
        Ok(Self {
            stage,
            edit,
            value,
            unit,
        })
    }
}

/// A number of an edit that a sweep varies.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize)]
pub struct SweptNumber {
    /// The stage's name.
    pub stage: String,
    /// The edit's name, and the axis of a vector.
    pub edit: String,
    /// The unit of its values.
    pub unit: &'static str,
}

/// Candidates of one sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sweep {
    /// The run that it is of.
    pub run: String,
    /// What the names of its candidates begin with: the sweep's name, or that of the candidate that it varies.
    pub name: String,
    /// What it varies, in the order of the plan.
    pub numbers: Vec<SweptNumber>,
    /// Its candidates, in the order of the plan.
    pub candidates: Vec<SweptCandidate>,
}

/// A candidate of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SweptCandidate {
    /// Its name.
    pub name: String,
    /// A value for each of the sweep's numbers.
    pub values: Vec<f64>,
}

impl SweptNumber {
    /// The column that it has in a table: stage, edit and unit.
    pub fn column(&self) -> String {
        match self.unit {
            "1" => format!("{} {}", self.stage, self.edit),
            unit => format!("{} {} ({unit})", self.stage, self.edit),
        }
    }
}

impl Sweep {
    /// The sweeps among the candidates of a run, which are given by their names, the names of their sweeps and their
    /// swept numbers. Those of one name that vary the same numbers are one.
    pub fn find<'a>(
        run: &str,
        candidates: impl IntoIterator<Item = (&'a str, Option<&'a str>, &'a [Swept])>,
    ) -> Vec<Self> {
        let mut sweeps: Vec<Self> = Vec::new();
        let mut places: HashMap<(String, Vec<SweptNumber>), usize> = HashMap::new();
        for (candidate, sweep, swept) in candidates {
            let Some(name) = sweep.filter(|_| !swept.is_empty()) else {
                continue;
            };
            let number = |of: &Swept| SweptNumber {
                stage: of.stage.clone(),
                edit: of.edit.clone(),
                unit: of.unit,
            };
            let numbers: Vec<SweptNumber> = swept.iter().map(number).collect();
            let next = sweeps.len();
            let place = *places
                .entry((name.to_owned(), numbers.clone()))
                .or_insert(next);
            if place == next {
                sweeps.push(Self {
                    run: run.to_owned(),
                    name: name.to_owned(),
                    numbers,
                    candidates: Vec::new(),
                });
            }
            if let Some(of) = sweeps.get_mut(place) {
                of.candidates.push(SweptCandidate {
                    name: candidate.to_owned(),
                    // Adding zero makes one zero of the two.
                    values: swept.iter().map(|of| of.value + 0.0).collect(),
                });
            }
        }
        sweeps
    }

    /// The values of one of its numbers, each once, in order.
    pub fn values(&self, number: usize) -> Vec<f64> {
        let all = self.candidates.iter();
        let mut values: Vec<f64> = all
            .filter_map(|of| of.values.get(number).copied())
            .collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values
    }

    /// The number with most values, the first of several, leaving out `but`.
    fn longest(&self, but: Option<usize>) -> Option<usize> {
        let others = (0..self.numbers.len()).filter(|&number| Some(number) != but);
        // The last of several that are largest wins: turned round, the first.
        others.rev().max_by_key(|&number| self.values(number).len())
    }

    /// How it is drawn.
    pub fn lines(&self) -> SweepLines {
        let axis = self.longest(None).unwrap_or_default();
        let mut lines: Vec<SweepLine> = Vec::new();
        let mut places: HashMap<Vec<u64>, usize> = HashMap::new();
        for (place, candidate) in self.candidates.iter().enumerate() {
            let Some(&x) = candidate.values.get(axis) else {
                continue;
            };
            let mut others = candidate.values.clone();
            others.remove(axis);
            let key = others.iter().map(|value| value.to_bits()).collect();
            let line = *places.entry(key).or_insert(lines.len());
            if line == lines.len() {
                lines.push(SweepLine {
                    candidate: place,
                    points: Vec::new(),
                });
            }
            if let Some(line) = lines.get_mut(line) {
                line.points.push((x, place));
            }
        }
        for line in &mut lines {
            line.points.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        SweepLines {
            axis,
            second: self.longest(Some(axis)),
            lines,
        }
    }
}

/// The candidates of a sweep as lines over one of its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepLines {
    /// The number along the axis: the first that has most values.
    pub axis: usize,
    /// The first of the others that has most values.
    pub second: Option<usize>,
    /// A line for each combination of the other numbers, in the order of the plan.
    pub lines: Vec<SweepLine>,
}

/// Candidates that differ in one number alone.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepLine {
    /// One of them, by its place in the sweep: what it has of the other numbers, all have.
    pub candidate: usize,
    /// The value of the one number and the candidate's place, by the value.
    pub points: Vec<(f64, usize)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn swept(numbers: &[(&str, f64)]) -> Vec<Swept> {
        let one = |&(edit, value): &(&str, f64)| Swept {
            stage: "refine".to_owned(),
            edit: edit.to_owned(),
            value,
            unit: "mm",
        };
        numbers.iter().map(one).collect()
    }

    fn found(given: &[(&str, Option<&str>, Vec<Swept>)]) -> Vec<Sweep> {
        let given = given
            .iter()
            .map(|(name, sweep, swept)| (*name, *sweep, &swept[..]));
        Sweep::find("run", given)
    }

    #[test]
    fn candidates_of_one_name_and_the_same_numbers_are_one_sweep() {
        let sweeps = found(&[
            ("base", None, vec![]),
            ("a-1", Some("a"), swept(&[("rotate", 1.0)])),
            ("b-1", Some("b"), swept(&[("rotate", 1.0)])),
            ("a-2", Some("a"), swept(&[("rotate", -0.0)])),
            ("a-p", Some("a"), swept(&[("project", 1.0)])),
        ]);
        let names: Vec<Vec<&str>> = sweeps
            .iter()
            .map(|sweep| sweep.candidates.iter().map(|of| of.name.as_str()).collect())
            .collect();
        assert_eq!(names, [vec!["a-1", "a-2"], vec!["b-1"], vec!["a-p"]]);
        assert!(sweeps[0].candidates[1].values[0].is_sign_positive());
        assert_eq!(sweeps[0].numbers[0].column(), "refine rotate (mm)");
    }

    #[test]
    fn the_first_number_with_most_values_is_along_the_axis() {
        let grid: Vec<_> = [(0.0, 5.0), (0.0, 1.0), (0.0, 3.0), (2.0, 5.0), (2.0, 1.0)]
            .map(|(a, b)| ("c", Some("s"), swept(&[("a", a), ("b", b), ("c", 7.0)])))
            .into();
        let sweeps = found(&grid);
        let drawn = sweeps[0].lines();
        assert_eq!((drawn.axis, drawn.second), (1, Some(0)));
        let lines: Vec<_> = drawn.lines.iter().map(|line| &line.points[..]).collect();
        assert_eq!(
            lines,
            [&[(1.0, 1), (3.0, 2), (5.0, 0)][..], &[(1.0, 4), (5.0, 3)]]
        );
        assert_eq!(drawn.lines[1].candidate, 3);
        // As many values of both: the first.
        let square: Vec<_> = [(0.0, 5.0), (1.0, 4.0)]
            .map(|(a, b)| ("c", Some("s"), swept(&[("a", a), ("b", b)])))
            .into();
        let drawn = found(&square)[0].lines();
        assert_eq!(
            (drawn.axis, drawn.second, drawn.lines.len()),
            (0, Some(1), 2)
        );
        let one = found(&[("c", Some("s"), swept(&[("a", 1.0)]))])[0].lines();
        assert_eq!((one.axis, one.second, one.lines.len()), (0, None, 1));
    }

    #[test]
    fn a_unit_is_one_that_a_plan_has() {
        let read = |unit: &str| {
            let text = format!(r#"{{"stage":"s","edit":"rotate","value":1,"unit":"{unit}"}}"#);
            serde_json::from_str::<Swept>(&text)
        };
        assert_eq!(read("deg").unwrap().unit, "deg");
        assert!(read("<b>").is_err());
    }
}
