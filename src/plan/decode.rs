//! From TOML values to Rust values, noting every fault and going on.
//!
//! serde stops at the first fault and loses the place of those inside `flatten` and `untagged`; this
//! walks the spanned document instead. Every function here returns `None` only after noting a fault.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::diagnostic::{Code, Fault};
use super::format::{Integers, Range, TableFormat};
use super::source::{Located, Span};

pub(super) type Value<'i> = Spanned<DeValue<'i>>;

/// The faults noted so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Faults {
    pub list: Vec<Fault>,
    /// How many were found after the list was full.
    pub dropped: usize,
}

/// How many faults are kept. A file with more is not a plan, and its faults would fill the memory.
const MAX_KEPT: usize = 5000;

/// A table whose keys are all known or noted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Table<'a, 'i> {
    entries: &'a DeTable<'i>,
    /// The header, the braces of an inline table, or the first key of the file.
    pub span: Span,
    name: &'static str,
}

impl Faults {
    pub fn push(&mut self, fault: Fault) {
        if self.is_full() {
            self.dropped += 1;
        } else {
            self.list.push(fault);
        }
    }

    /// Whether further faults are only counted.
    pub fn is_full(&self) -> bool {
        self.list.len() >= MAX_KEPT
    }

    /// The table that a value is, its unknown keys noted.
    pub fn table<'a, 'i>(
        &mut self,
        value: &'a Value<'i>,
        format: &TableFormat,
    ) -> Option<Table<'a, 'i>> {
        let name = format.name;
        let Some(entries) = value.get_ref().as_table() else {
            self.wrong_type(value, name, &format!("a table, {name}"), None);
            return None;
        };
        Some(self.entries(entries, value.span().into(), name, &format.names()))
    }

    /// As [`Faults::table`], of a table's content.
    pub fn entries<'a, 'i>(
        &mut self,
        entries: &'a DeTable<'i>,
        span: Span,
        name: &'static str,
        known: &[&str],
    ) -> Table<'a, 'i> {
        for key in entries.keys() {
            let written = key.get_ref().as_ref();
            if !known.contains(&written) {
                let shown = quote(written, '`');
                let fault = Fault::new(
                    Code::UnknownKey,
                    key.span().into(),
                    format!("unknown key {shown} in {name}"),
                );
                if self.is_full() {
                    self.dropped += 1;
                    continue;
                }
                let hint = nearest(written, known)
                    .map(|near| format!("did you mean `{near}`?"))
                    .or_else(|| home(written).map(|home| format!("{shown} belongs in {home}")));
                let fault = fault.found(shown).expected(one_of(known, '`'));
                self.push(fault.hint(hint));
            }
        }
        Table {
            entries,
            span,
            name,
        }
    }

    /// Notes that a key must be given, at the table that lacks it.
    pub fn missing(&mut self, table: &Table<'_, '_>, key: &str, expected: &str) {
        let message = format!("{} does not give `{key}`", table.name);
        let fault = Fault::new(Code::MissingKey, table.span, message);
        self.push(fault.expected(expected));
    }

    pub fn wrong_type(
        &mut self,
        value: &Value<'_>,
        what: &str,
        expected: &str,
        hint: Option<String>,
    ) {
        let fault = Fault::new(
            Code::WrongType,
            value.span().into(),
            format!("{what} has a value of the wrong type"),
        );
        self.push(fault.found(describe(value)).expected(expected).hint(hint));
    }

    pub fn bad_value(&mut self, value: &Value<'_>, what: &str, problem: &str, expected: &str) {
        let fault = Fault::new(
            Code::BadValue,
            value.span().into(),
            format!("{what} {problem}"),
        );
        self.push(fault.found(describe(value)).expected(expected));
    }

    /// A finite number; integers are numbers.
    pub fn number(&mut self, value: &Value<'_>, what: &str, expected: &str) -> Option<f64> {
        let number = match value.get_ref() {
            DeValue::Integer(integer) => {
                let Some(integer) = small_integer(integer.as_str(), integer.radix()) else {
                    self.bad_value(value, what, "is too large", expected);
                    return None;
                };
                integer as f64
            }
            DeValue::Float(float) => float.as_str().parse().unwrap_or(f64::NAN),
            _ => {
                self.wrong_type(value, what, expected, None);
                return None;
            }
        };
        if number.is_finite() {
            return Some(number);
        }
        self.bad_value(value, what, "is not a finite number", expected);
        None
    }

    /// A finite number in a range, or the fault that it is out of range.
    pub fn number_in(
        &mut self,
        value: &Value<'_>,
        what: &str,
        expected: &str,
        range: Range,
    ) -> Option<f64> {
        let number = self.number(value, what, expected)?;
        if range.contains(number) {
            return Some(number);
        }
        self.bad_value(value, what, "is out of range", expected);
        None
    }

    /// An integer in a range. A number with a decimal point is not one.
    pub fn integer_in(
        &mut self,
        value: &Value<'_>,
        what: &str,
        expected: &str,
        range: Integers,
    ) -> Option<i64> {
        let DeValue::Integer(integer) = value.get_ref() else {
            self.wrong_type(value, what, expected, None);
            return None;
        };
        let integer = small_integer(integer.as_str(), integer.radix());
        let integer = integer.filter(|&integer| range.contains(integer));
        if integer.is_none() {
            self.bad_value(value, what, "is out of range", expected);
        }
        integer
    }

    pub fn string<'a>(
        &mut self,
        value: &'a Value<'_>,
        what: &str,
        expected: &str,
    ) -> Option<&'a str> {
        let string = value.get_ref().as_str();
        if string.is_none() {
            self.wrong_type(value, what, expected, None);
        }
        string
    }

    pub fn boolean(&mut self, value: &Value<'_>, what: &str) -> Option<bool> {
        let boolean = value.get_ref().as_bool();
        if boolean.is_none() {
            self.wrong_type(value, what, "`true` or `false`", None);
        }
        boolean
    }

    /// One of a few words.
    pub fn word<T: Copy>(
        &mut self,
        value: &Value<'_>,
        what: &str,
        words: &[(&str, T)],
    ) -> Option<T> {
        let names: Vec<&str> = words.iter().map(|(name, _)| *name).collect();
        self.word_or(value, what, words, &one_of(&names, '"'))
    }

    /// One of a few words, where something else than a word is `expected` as well.
    pub fn word_or<T: Copy>(
        &mut self,
        value: &Value<'_>,
        what: &str,
        words: &[(&str, T)],
        expected: &str,
    ) -> Option<T> {
        let names: Vec<&str> = words.iter().map(|(name, _)| *name).collect();
        let written = self.string(value, what, expected)?;
        let found = words.iter().find(|(name, _)| *name == written);
        if let Some((_, word)) = found {
            return Some(*word);
        }
        let fault = Fault::new(
            Code::BadValue,
            value.span().into(),
            format!("{what} is not a known word"),
        );
        let hint = nearest(written, &names).map(|near| format!("did you mean \"{near}\"?"));
        self.push(fault.found(describe(value)).expected(expected).hint(hint));
        None
    }

    /// An array with something in it.
    pub fn array<'a, 'i>(
        &mut self,
        value: &'a Value<'i>,
        what: &str,
        expected: &str,
    ) -> Option<&'a [Value<'i>]> {
        let Some(array) = value.get_ref().as_array() else {
            self.wrong_type(value, what, expected, None);
            return None;
        };
        if array.is_empty() {
            self.bad_value(value, what, "is empty", expected);
            return None;
        }
        Some(array)
    }

    /// Three finite numbers.
    pub fn triple(
        &mut self,
        value: &Value<'_>,
        what: &str,
        expected: &str,
    ) -> Option<Located<[f64; 3]>> {
        let Some(array) = value.get_ref().as_array() else {
            self.wrong_type(value, what, expected, None);
            return None;
        };
        let numbers: Vec<Option<f64>> = array
            .iter()
            .take(3)
            .map(|item| self.number(item, what, "a finite number"))
            .collect();
        if array.len() != 3 {
            let problem = format!("has {} values instead of three", array.len());
            self.bad_value(value, what, &problem, expected);
            return None;
        }
        let [Some(x), Some(y), Some(z)] = *numbers.as_slice() else {
            return None;
        };
        Some(Located {
            value: [x, y, z],
            span: value.span().into(),
        })
    }

    /// A table of exactly one key of `known`, and the key's value: a choice between several.
    pub fn choice<'a, 'i>(
        &mut self,
        value: &'a Value<'i>,
        what: &'static str,
        known: &[&'static str],
        expected: &str,
        hint: Option<String>,
    ) -> Option<(&'static str, &'a Value<'i>)> {
        let Some(entries) = value.get_ref().as_table() else {
            self.wrong_type(value, what, expected, hint);
            return None;
        };
        let table = self.entries(entries, value.span().into(), what, known);
        if entries.len() != 1 {
            let fault = Fault::new(
                Code::Conflict,
                table.span,
                format!("{what} takes exactly one key"),
            );
            self.push(fault.found(describe(value)).expected(expected));
            return None;
        }
        known
            .iter()
            .find_map(|name| Some((*name, table.get(name)?)))
    }
}

impl<'a, 'i> Table<'a, 'i> {
    pub fn get(&self, key: &str) -> Option<&'a Value<'i>> {
        self.entries.get(key)
    }

    /// Where a key's value is, or the table where there is none.
    pub fn place(&self, key: &str) -> Span {
        self.get(key).map_or(self.span, |value| value.span().into())
    }

    /// Where a key itself is, or the table where it is not given.
    pub fn key_place(&self, key: &str) -> Span {
        let entry = self.entries.get_key_value(key);
        entry.map_or(self.span, |(key, _)| key.span().into())
    }
}

/// An integer that fits 64 bits.
pub(super) fn small_integer(digits: &str, radix: u32) -> Option<i64> {
    i64::from_str_radix(digits, radix).ok()
}

/// A value in a few words.
pub(super) fn describe(value: &Value<'_>) -> String {
    match value.get_ref() {
        DeValue::String(string) => quote(string, '"'),
        DeValue::Integer(integer) => shorten(&integer.to_string()),
        DeValue::Float(float) => shorten(float.as_str()),
        DeValue::Boolean(boolean) => format!("`{boolean}`"),
        DeValue::Datetime(_) => "a date or time".to_owned(),
        DeValue::Array(array) => match array.len() {
            0 => "an empty array".to_owned(),
            1 => "an array of one value".to_owned(),
            n => format!("an array of {n} values"),
        },
        DeValue::Table(table) if table.is_empty() => "an empty table".to_owned(),
        DeValue::Table(table) => {
            let mut keys: Vec<_> = table.keys().collect();
            keys.sort_by_key(|key| key.span().start);
            let shown: Vec<_> = keys
                .iter()
                .take(4)
                .map(|key| quote(key.get_ref(), '`'))
                .collect();
            let more = if keys.len() > shown.len() {
                ", …"
            } else {
                ""
            };
            format!("a table of {}{more}", shown.join(", "))
        }
    }
}

/// The user's text between marks, control characters escaped, shortened where it is long.
pub(super) fn quote(text: &str, mark: char) -> String {
    let shown = crate::text::shown(text, MAX_SHOWN);
    format!("{mark}{shown}{mark}")
}

fn shorten(number: &str) -> String {
    match number.char_indices().nth(MAX_SHOWN) {
        Some((end, _)) => format!("{}…", number.get(..end).unwrap_or_default()),
        None => number.to_owned(),
    }
}

/// Characters of the user's text that a message repeats.
const MAX_SHOWN: usize = 48;

/// "`a`, `b` or `c`".
pub(super) fn one_of(words: &[&str], mark: char) -> String {
    let marked: Vec<String> = words
        .iter()
        .map(|word| format!("{mark}{word}{mark}"))
        .collect();
    match marked.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
        None => String::new(),
    }
}

/// The known word that was probably meant: the only nearest one, at most one slip in three characters away.
/// Units are too short for slips: `cm` does not mean `mm`.
pub(super) fn nearest<'k>(written: &str, known: &[&'k str]) -> Option<&'k str> {
    if written.len() > MAX_SHOWN {
        return None;
    }
    let folded = written.to_lowercase().replace('-', "_");
    let slips = |word: &str| strsim::damerau_levenshtein(&folded, &word.to_lowercase());
    let close = |word: &&&str| slips(word) <= word.chars().count() / 3;
    let near: Vec<&&str> = known.iter().filter(close).collect();
    let least = near.iter().map(|word| slips(word)).min()?;
    let mut nearest = near.iter().filter(|word| slips(word) == least);
    match (nearest.next(), nearest.next()) {
        (Some(word), None) => Some(word),
        _ => None,
    }
}

/// Where a key belongs that is easily written somewhere else.
fn home(key: &str) -> Option<&'static str> {
    Some(match key {
        "path" | "phantom" | "sha256" => "[ct]",
        "snap" | "frame" | "nasal_bones" | "lip" | "alare_left" | "alare_right" | "tip"
        | "maxilla" => "[landmarks]",
        "depth" => "[cage]",
        "root" => "[f1]",
        "kind" => "[f1], or a [[candidate.stage]]",
        "median" | "smooth" => "[enhance]",
        "skin_hu" | "bone_hu" | "keep_largest" => "[segment]",
        "model" | "scale" | "method" | "tolerance" | "margin" | "compare_exact" => "[morph]",
        "names" | "size" | "objects" | "opacity" | "crop" | "clip" => "[views]",
        "camera" => "[views], as [[views.camera]]",
        "azimuth" | "elevation" => "[[views.camera]]",
        "write" => "[outputs]",
        "triangles" => "[mesh]",
        "stage" => "[[candidate]], as [[candidate.stage]]",
        "f1" => "[[candidate.stage]]",
        "move_tip" | "move_root" | "tip_to" | "root_to" | "project" | "rotate" | "lengthen"
        | "deviate" | "width" => "the array `f1` of a [[candidate.stage]]",
        "min" | "max" | "change" => "a limit of [accept]",
        "change_percent" => "a limit of a volume, an angle or a height",
        measure if crate::compare::measure(measure).is_some() => "[accept]",
        _ => return None,
    })
}
