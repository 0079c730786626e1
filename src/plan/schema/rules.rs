//! What a schema can say of several keys at once.

use serde_json::{Value, json};

use super::super::format::{
    self, METHODS, MODELS, MethodWord, ModelWord, ROTATION_DEG, TableFormat, WIDTH,
};
use super::super::raw::LINE_EDITS;
use super::super::resolved::{CutPlane, Object, Side};
use crate::compare::MEASURES;
use crate::feature::{FeatureKind, Landmark};

/// The rules that tables of this format keep.
pub(super) fn of(format: &TableFormat) -> Vec<Value> {
    let is = |other: &TableFormat| format.name == other.name;
    if is(&format::PLAN) {
        plan()
    } else if is(&format::CT) {
        ct()
    } else if is(&format::LANDMARKS) {
        landmarks()
    } else if is(&format::MORPH) {
        morph()
    } else if is(&format::STAGE) {
        vec![json!({ "if": has_word("kind", FeatureKind::Point.name()), "then": without_line() })]
    } else if is(&format::VARY) {
        vary()
    } else if is(&format::VIEWS) {
        views()
    } else if is(&format::ACCEPT) || MEASURES.iter().any(|of| is(format::limit_of(of))) {
        vec![json!({ "minProperties": 1 })]
    } else if is(&format::CLIP) {
        [CutPlane::Sagittal, CutPlane::Coronal, CutPlane::Axial]
            .map(|plane| {
                let sides = plane.sides().map(Side::name);
                let keep = json!({ "properties": { "keep": { "enum": sides } } });
                json!({ "if": has_word("plane", plane.name()), "then": keep })
            })
            .to_vec()
    } else {
        Vec::new()
    }
}

/// Where `table` is given and keeps `rule`; whether it must be.
fn inside(table: &str, rule: &Value, must: bool) -> Value {
    let mut schema = json!({ "properties": { table: rule } });
    if must {
        schema["required"] = json!([table]);
    }
    schema
}

/// A table in which `key` is given as `word`.
fn has_word(key: &str, word: &str) -> Value {
    inside(key, &json!({ "const": word }), true)
}

/// A table in which the array `key` is given and has `word`.
fn lists(key: &str, word: &str) -> Value {
    inside(key, &json!({ "contains": { "const": word } }), true)
}

/// A table in which none of these keys is given.
fn none_of(keys: &[&str]) -> Value {
    let given: Vec<Value> = keys
        .iter()
        .map(|key| json!({ "required": [key] }))
        .collect();
    json!({ "not": { "anyOf": given } })
}

/// Each stage of each candidate keeps this rule.
fn stages(rule: &Value) -> Value {
    let stages = inside("stage", &json!({ "items": rule }), false);
    inside("candidate", &json!({ "items": stages }), false)
}

/// A stage without these edits.
fn without(edits: &[&str]) -> Value {
    inside("f1", &json!({ "items": none_of(edits) }), false)
}

/// A stage without edits that a point has not.
fn without_line() -> Value {
    without(&LINE_EDITS)
}

fn plan() -> Vec<Value> {
    let writes = |word: &str| inside("outputs", &lists("write", word), true);
    let is_point = inside("f1", &has_word("kind", FeatureKind::Point.name()), true);
    // A stage may say its kind itself.
    let or_kind = json!({ "anyOf": [{ "required": ["kind"] }, without_line()] });
    vec![
        json!({ "if": { "required": ["views"] }, "then": writes("views") }),
        json!({ "if": { "required": ["mesh"] }, "then": writes("mesh") }),
        json!({ "if": inside("morph", &is_lee2001(), true), "then": stages(&without(&["width"])) }),
        json!({ "if": is_point, "then": stages(&or_kind) }),
    ]
}

fn ct() -> Vec<Value> {
    let one = json!([{ "required": ["path"] }, { "required": ["phantom"] }]);
    let of_files = none_of(&["sha256", "series"]);
    vec![
        json!({ "oneOf": one }),
        json!({ "if": { "required": ["phantom"] }, "then": of_files }),
    ]
}

fn landmarks() -> Vec<Value> {
    let mut written = vec!["frame"];
    written.extend(Landmark::ALL.map(Landmark::name));
    vec![json!({
        "if": { "required": ["file"] },
        "then": none_of(&written),
        "else": { "required": written },
    })]
}

fn is_lee2001() -> Value {
    let word = MODELS.iter().find(|(_, word)| *word == ModelWord::Lee2001);
    has_word("model", word.map_or("", |(name, _)| name))
}

fn morph() -> Vec<Value> {
    let exact = METHODS.iter().find(|(_, word)| *word == MethodWord::Exact);
    let is_exact = has_word("method", exact.map_or("", |(name, _)| name));
    vec![
        json!({ "if": is_lee2001(), "then": none_of(&["margin"]) }),
        json!({ "if": is_exact, "then": none_of(&["tolerance", "compare_exact"]) }),
    ]
}

fn vary() -> Vec<Value> {
    let range = ["from", "to", "steps"];
    let has_axes = json!({ "properties": { "edit": { "enum": ["move_tip", "move_root"] } } });
    let bounded = [("rotate", ROTATION_DEG), ("width", WIDTH)].map(|(edit, range)| {
        let number = json!(super::range_of(range));
        let numbers = json!({ "values": { "items": number }, "from": number, "to": number });
        json!({ "if": has_word("edit", edit), "then": { "properties": numbers } })
    });
    let mut rules = vec![
        json!({
            "if": { "required": ["values"] },
            "then": none_of(&range),
            "else": { "required": range },
        }),
        json!({
            "if": has_axes,
            "then": { "required": ["axis"] },
            "else": none_of(&["axis"]),
        }),
    ];
    rules.extend(bounded);
    rules
}

fn views() -> Vec<Value> {
    let mut rules = vec![json!({
        "if": { "required": ["camera"] },
        "else": inside("names", &json!({ "minItems": 1 }), false),
    })];
    for object in [Object::Skin, Object::Bone] {
        let name = object.name();
        let has_opacity = inside("opacity", &json!({ "required": [name] }), true);
        // Where a plan names no objects, skin alone is drawn.
        let must = object != Object::Skin;
        let drawn = inside("objects", &json!({ "contains": { "const": name } }), must);
        rules.push(json!({ "if": has_opacity, "then": drawn }));
    }
    rules
}
