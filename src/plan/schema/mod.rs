//! The JSON Schema of plans, for editors: made of the same tables that the decoder reads.
//!
//! Draft 2020-12, in the keywords that mean the same in draft 7, because editors differ in what they know.
//! Everything is in place, without references and without merging alternatives, so that an editor can complete
//! keys anywhere. What no schema can say is left to `rhinoplan check`: positions in the CT, names that are given
//! twice, and which of two numbers is larger.

mod rules;

use serde_json::{Map, Value, json};

use super::format::{self, FORMAT, Given, Integers, Key, Kind, MAX_NAME, MAX_TITLE, MAX_UID};
use super::format::{Range, TableFormat};

/// The JSON Schema of plan files: a document.
pub fn schema() -> Value {
    let mut schema = table(&format::PLAN);
    let head = [
        (
            "$schema",
            json!("https://json-schema.org/draft/2020-12/schema"),
        ),
        ("title", json!("rhinoplan plan")),
        ("description", json!(format::PLAN.about)),
    ];
    schema.extend(head.map(|(name, value)| (name.to_owned(), value)));
    Value::Object(schema)
}

/// A schema of one part: its keywords.
type Part = Map<String, Value>;

fn part<const N: usize>(keywords: [(&str, Value); N]) -> Part {
    keywords
        .into_iter()
        .map(|(keyword, value)| (keyword.to_owned(), value))
        .collect()
}

fn table(format: &TableFormat) -> Part {
    let properties: Part = format
        .keys
        .iter()
        .map(|key| (key.name.to_owned(), self::key(key)))
        .collect();
    let mut table = part([
        ("type", json!("object")),
        ("properties", Value::Object(properties)),
        ("additionalProperties", json!(false)),
    ]);
    let required: Vec<&str> = format
        .keys
        .iter()
        .filter(|key| key.given == Given::Required)
        .map(|key| key.name)
        .collect();
    if !required.is_empty() {
        table.insert("required".to_owned(), json!(required));
    }
    let rules = rules::of(format);
    if !rules.is_empty() {
        table.insert("allOf".to_owned(), Value::Array(rules));
    }
    table
}

/// A table of exactly one of its keys.
fn choice(format: &TableFormat) -> Part {
    let mut table = table(format);
    table.insert("minProperties".to_owned(), json!(1));
    table.insert("maxProperties".to_owned(), json!(1));
    table.insert("description".to_owned(), json!(format.about));
    table
}

fn key(key: &Key) -> Value {
    let mut schema = kind(key.kind);
    schema.insert("description".to_owned(), json!(key.about));
    let default = match key.given {
        Given::Required | Given::Optional => None,
        Given::Boolean(boolean) => Some(json!(boolean)),
        Given::Integer(integer) => Some(json!(integer)),
        Given::Number(value) => Some(number(value)),
        Given::Mm(mm) => Some(json!({ "mm": number(mm) })),
        Given::Word(word) => Some(json!(word)),
        Given::Words(words) => Some(json!(words)),
    };
    if let Some(default) = default {
        schema.insert("default".to_owned(), default);
    }
    Value::Object(schema)
}

fn kind(kind: Kind) -> Part {
    match kind {
        Kind::Version => part([("const", json!(FORMAT)), ("type", json!("integer"))]),
        Kind::Name(taken) => {
            let mut name = text(r"^[a-z0-9][a-z0-9-]*$", MAX_NAME);
            if !taken.is_empty() {
                name.insert("not".to_owned(), json!({ "enum": taken }));
            }
            name
        }
        // No control characters: those of Unicode's category Cc.
        Kind::Title => text(r"^[^\x00-\x1f\x7f-\x9f]*$", MAX_TITLE),
        Kind::Path => part([
            ("type", json!("string")),
            ("minLength", json!(1)),
            ("pattern", json!(r"^[^\x00]*$")),
        ]),
        Kind::NameOfOther => part([("type", json!("string"))]),
        Kind::Sha256 => text("^[0-9A-Fa-f]{64}$", 64),
        Kind::Uid => text("^[!-~]+$", MAX_UID),
        Kind::Boolean => part([("type", json!("boolean"))]),
        Kind::Integer(Integers { least, most }) => part([
            ("type", json!("integer")),
            ("minimum", json!(least)),
            ("maximum", json!(most)),
        ]),
        Kind::Number(range) => range_of(range),
        Kind::AnyNumber => part([("type", json!("number"))]),
        Kind::Numbers(most) => part([
            ("type", json!("array")),
            ("items", json!({ "type": "number" })),
            ("minItems", json!(1)),
            ("maxItems", json!(most)),
            ("uniqueItems", json!(true)),
        ]),
        Kind::Word(words) => part([("type", json!("string")), ("enum", json!(words))]),
        Kind::Words(words) => {
            let mut array = self::kind(Kind::WordsOrNone(words));
            array.insert("minItems".to_owned(), json!(1));
            array
        }
        Kind::WordsOrNone(words) => part([
            ("type", json!("array")),
            ("items", json!({ "type": "string", "enum": words })),
            ("uniqueItems", json!(true)),
        ]),
        Kind::Interval => numbers(2),
        Kind::Point => numbers(3),
        Kind::Measured(units, range) => unit(units, &range_of(range)),
        Kind::Vector(units) => unit(units, &self::kind(Kind::Point)),
        Kind::Table(format) => table(format),
        Kind::Tables(format, most) => {
            let mut item = table(format);
            item.insert("description".to_owned(), json!(format.about));
            tables(item, most)
        }
        Kind::Choices(format, most) => tables(choice(format), most),
        Kind::Either(kinds) => {
            let either = kinds.iter().map(|kind| Value::Object(self::kind(*kind)));
            part([("anyOf", either.collect())])
        }
    }
}

fn text(pattern: &str, longest: usize) -> Part {
    part([
        ("type", json!("string")),
        ("pattern", json!(pattern)),
        ("maxLength", json!(longest)),
    ])
}

/// An array of so many numbers.
fn numbers(count: usize) -> Part {
    part([
        ("type", json!("array")),
        ("items", json!({ "type": "number" })),
        ("minItems", json!(count)),
        ("maxItems", json!(count)),
    ])
}

pub(super) fn range_of(range: Range) -> Part {
    let least = ["exclusiveMinimum", "minimum"][usize::from(range.with_ends.0)];
    let most = ["exclusiveMaximum", "maximum"][usize::from(range.with_ends.1)];
    part([
        ("type", json!("number")),
        (least, number(range.least)),
        (most, number(range.most)),
    ])
}

/// A table of exactly one unit.
fn unit(units: &[&str], value: &Part) -> Part {
    let is_vector = value.contains_key("items");
    let properties: Part = units
        .iter()
        .map(|unit| {
            let about = match (*unit, is_vector) {
                ("mm", true) => {
                    "Millimetres along the patient's axes, LPS: left, posterior, superior."
                }
                (_, true) => "Voxels along the axes of the grid, in LPS order.",
                ("mm", false) => "Millimetres.",
                (_, false) => "Voxels.",
            };
            let mut value = value.clone();
            value.insert("description".to_owned(), json!(about));
            ((*unit).to_owned(), Value::Object(value))
        })
        .collect();
    part([
        ("type", json!("object")),
        ("properties", Value::Object(properties)),
        ("additionalProperties", json!(false)),
        ("minProperties", json!(1)),
        ("maxProperties", json!(1)),
    ])
}

fn tables(item: Part, most: usize) -> Part {
    part([
        ("type", json!("array")),
        ("items", Value::Object(item)),
        ("minItems", json!(1)),
        ("maxItems", json!(most)),
    ])
}

/// A number as people write it: whole ones without a decimal point.
fn number(number: f64) -> Value {
    if number.fract() == 0.0 && number.abs() < 1e9 {
        json!(number as i64)
    } else {
        json!(number)
    }
}
