//! What is not as it was.

use std::fmt;

use serde::{Serialize, Serializer};

/// What a difference is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the names say it")]
pub enum Kind {
    Number,
    Picture,
    Volume,
}

/// What stands in a column of a table of differences.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Nothing to say.
    Empty,
    /// A number, in the unit of its row.
    Number(f64),
    /// Anything else.
    Text(String),
}

impl Cell {
    /// Some words.
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// A number; what is stored of one that is none is nothing.
    pub fn number(value: Option<f64>) -> Self {
        match value {
            Some(value) => Self::Number(value),
            None => Self::text("not a number"),
        }
    }
}

impl fmt::Display for Cell {
    /// As short as tells it: six decimals, or three digits of what is far from 1.
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => Ok(()),
            Self::Text(text) => to.write_str(text),
            Self::Number(value) if value.is_nan() => to.write_str("not a number"),
            Self::Number(value) if *value == 0.0 => to.write_str("0"),
            Self::Number(value) if (1e-3..1e9).contains(&value.abs()) => {
                let text = format!("{value:.6}");
                to.write_str(text.trim_end_matches('0').trim_end_matches('.'))
            }
            Self::Number(value) => {
                let text = format!("{value:.3e}");
                let (digits, power) = text.split_once('e').unwrap_or((&text, "0"));
                let digits = digits.trim_end_matches('0').trim_end_matches('.');
                write!(to, "{digits}e{power}")
            }
        }
    }
}

impl Serialize for Cell {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Empty => to.serialize_none(),
            Self::Number(value) => to.serialize_f64(*value),
            Self::Text(text) => to.serialize_str(text),
        }
    }
}

/// Something that is further from what is expected than it may be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// What it is of.
    pub kind: Kind,
    /// The measure with its candidate and stage; the file, by its name in the plan's folder.
    pub measure: String,
    /// What the other columns count.
    pub unit: String,
    /// What is kept.
    pub expected: Cell,
    /// What was found instead.
    pub found: Cell,
    /// How far the two are apart.
    pub difference: Cell,
    /// How far they may be apart.
    pub tolerance: Cell,
}

impl Difference {
    /// Of something that is kept and that the plan no longer gives.
    pub fn missing(kind: Kind, measure: String, unit: &str, expected: Cell) -> Self {
        Self {
            kind,
            measure,
            unit: unit.to_owned(),
            expected,
            found: Cell::text("not found"),
            difference: Cell::Empty,
            tolerance: Cell::Empty,
        }
    }

    /// Of something that the plan gives and that is not kept.
    pub fn unexpected(kind: Kind, measure: String, unit: &str, found: Cell) -> Self {
        Self {
            kind,
            measure,
            unit: unit.to_owned(),
            expected: Cell::text("not expected"),
            found,
            difference: Cell::Empty,
            tolerance: Cell::Empty,
        }
    }

    /// The columns of a table, in order; [`COLUMNS`] are their names.
    pub fn row(&self) -> [String; 6] {
        [
            self.measure.clone(),
            self.unit.clone(),
            self.expected.to_string(),
            self.found.to_string(),
            self.difference.to_string(),
            self.tolerance.to_string(),
        ]
    }
}

/// The names of the columns of [`Difference::row`].
pub const COLUMNS: [&str; 6] = [
    "measure",
    "unit",
    "expected",
    "found",
    "difference",
    "tolerance",
];

/// How much there is of a plan.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Counts {
    pub numbers: usize,
    pub pictures: usize,
    pub volumes: usize,
}

/// What became of a plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// The plan's name.
    pub plan: String,
    /// Whether nothing differs.
    pub agrees: bool,
    /// What the golden holds of it.
    pub expected: Counts,
    /// What went in and is not what the golden was made of: no difference by itself, but it may explain some.
    pub inputs_changed: Vec<String>,
    /// Everything that differs: numbers, pictures, volumes.
    pub differences: Vec<Difference>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_short_as_tells_them() {
        for (value, shown) in [
            (0.0, "0"),
            (-0.0, "0"),
            (12359.25, "12359.25"),
            (110.0, "110"),
            (-0.1234567, "-0.123457"),
            (0.0001, "1e-4"),
            (2.5e12, "2.5e12"),
            (-1.23456e-7, "-1.235e-7"),
            (f64::NAN, "not a number"),
        ] {
            assert_eq!(Cell::Number(value).to_string(), shown);
        }
        assert_eq!(Cell::number(None).to_string(), "not a number");
    }

    #[test]
    fn a_document_has_numbers_where_there_are_any() {
        let found = Difference::unexpected(Kind::Number, "a".to_owned(), "mm", Cell::Number(1.5));
        let document = serde_json::to_value(&found).unwrap();
        assert_eq!(document["found"], 1.5);
        assert_eq!(document["expected"], "not expected");
        assert_eq!(document["difference"], serde_json::Value::Null);
    }
}
