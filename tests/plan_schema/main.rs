//! The schema of plans and the parser say the same.
//!
//! Both take keys, words and bounds from one declaration, but how a value is decoded is written by hand, and so are
//! rules among several keys. Here values of every kind are put at every place that the schema knows, and both must
//! accept or refuse each. That faults of plans are refused by both is tested with them, in `tests/plan_errors`.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

mod validator;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use rhinoplan::plan::{Code, Diagnostic, Plan, PlanFile};
use rhinoplan::space::Grid;
use serde_json::{Value, json};
use validator::{beyond_a_schema, errors, errors_of_text};

const EVERY_KEY: &str = include_str!("every-key.toml");

/// A place in a document.
#[derive(Debug, Clone, PartialEq)]
enum Step {
    Key(String),
    /// The first item of an array.
    First,
}

/// What the schema says of a place: its keywords, its way from the root, and for every table on it whether it is
/// one of exactly one key.
#[derive(Debug, Clone)]
struct Place {
    way: Vec<Step>,
    schema: Value,
    /// Whether it is the only key of its table.
    is_alone: bool,
}

/// Every place that the schema knows, tables before what is in them.
fn places() -> Vec<Place> {
    let mut places = Vec::new();
    let root = Place {
        way: Vec::new(),
        schema: rhinoplan::plan::schema(),
        is_alone: false,
    };
    collect(root, &mut places);
    places
}

fn collect(place: Place, places: &mut Vec<Place>) {
    places.push(place.clone());
    let at = |step: Step, schema: &Value, is_alone| Place {
        way: [place.way.as_slice(), &[step]].concat(),
        schema: schema.clone(),
        is_alone,
    };
    let mut forms = vec![&place.schema];
    if let Some(either) = place.schema["anyOf"].as_array() {
        forms.extend(either);
    }
    for form in forms {
        let is_alone = form["maxProperties"] == 1;
        for (key, schema) in form["properties"].as_object().into_iter().flatten() {
            collect(at(Step::Key(key.clone()), schema, is_alone), places);
        }
        if form["items"].is_object() {
            collect(at(Step::First, &form["items"], false), places);
        }
    }
}

/// The document with this value there, or without what is there.
fn changed(document: &Value, place: &Place, value: Option<&Value>) -> Option<Value> {
    let mut document = document.clone();
    let (last, way) = place.way.split_last()?;
    let mut at = &mut document;
    for step in way {
        at = match step {
            Step::Key(key) => at.as_object_mut()?.get_mut(key)?,
            Step::First => at.as_array_mut()?.first_mut()?,
        };
    }
    match (last, value) {
        (Step::Key(key), Some(value)) if place.is_alone => *at = json!({ key: value }),
        (Step::Key(key), Some(value)) => {
            at.as_object_mut()?.insert(key.clone(), value.clone());
        }
        (Step::Key(key), None) => {
            at.as_object_mut()?.remove(key)?;
        }
        (Step::First, Some(value)) => *at.as_array_mut()?.first_mut()? = value.clone(),
        (Step::First, None) => {
            at.as_array_mut()?.remove(0);
        }
    }
    Some(document)
}

fn every_key() -> Value {
    let table: toml::Table = EVERY_KEY.parse().unwrap();
    serde_json::to_value(table).unwrap()
}

/// The plan, as the parser reads it.
fn parsed(document: &Value) -> PlanFile {
    let text = toml::to_string(document).unwrap();
    PlanFile::from_text("plan.toml", Path::new("."), &text)
}

/// The faults that the parser finds, but those that no schema could.
fn faults(document: &Value) -> Vec<Diagnostic> {
    let faults = parsed(document).faults();
    let of_schema = faults
        .iter()
        .filter(|fault| beyond_a_schema(fault).is_none());
    of_schema.cloned().collect()
}

/// Both say the same of a plan. Returns whether they accept it.
#[track_caller]
fn same_verdict(document: &Value, what: &str) -> bool {
    let (schema, parser) = (errors(document), faults(document));
    assert_eq!(
        schema.is_empty(),
        parser.is_empty(),
        "{what}\nthe schema says {schema:#?}\nthe parser says {parser:#?}"
    );
    schema.is_empty()
}

/// Values to try at a place: of every kind, and at the bounds and the words that the schema gives.
fn probes(schema: &Value) -> Vec<Value> {
    let mut probes: Vec<Value> = vec![
        json!(true),
        json!(""),
        json!("zzz"),
        json!("Zz z\u{7}"),
        json!("preoperative"),
        json!("a\u{0}b"),
        json!("é".repeat(70)),
        json!("a".repeat(64)),
        json!("a".repeat(65)),
        json!("a".repeat(201)),
        json!("0".repeat(64)),
        json!("g".repeat(64)),
        json!(0),
        json!(1),
        json!(-1),
        json!(2),
        json!(3),
        json!(0.5),
        json!(-0.5),
        json!(179.5),
        json!(-180),
        json!(1_000_000_000),
        json!([]),
        json!([1, 2, 3]),
        json!([0.5, -1.5]),
        json!([1, 2, 3, 4]),
        json!([1, "a", 3]),
        json!(["zzz"]),
        json!([{}]),
        json!([1]),
        json!({}),
        json!({ "mm": 5 }),
        json!({ "mm": 50 }),
        json!({ "mm": 0 }),
        json!({ "mm": 5, "voxels": 5 }),
        json!({ "voxels": 5 }),
        json!({ "cm": 5 }),
        json!({ "mm": [1, 2, 3] }),
        json!({ "voxels": [1, 2] }),
        json!({ "project": 1 }),
        json!({ "project": 1, "width": 1 }),
    ];
    let mut forms = vec![schema];
    forms.extend(schema["anyOf"].as_array().into_iter().flatten());
    for form in forms {
        for bound in ["minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"] {
            if let Some(bound) = form[bound].as_f64() {
                // As integers where they are, which TOML tells from other numbers.
                for probe in [bound - 1.0, bound, bound + 1.0] {
                    let whole = probe.fract() == 0.0;
                    probes.push(if whole {
                        json!(probe as i64)
                    } else {
                        json!(probe)
                    });
                }
                probes.extend([json!(bound + 1e-6), json!(bound - 1e-6)]);
            }
        }
        probes.extend(form["const"].is_number().then(|| form["const"].clone()));
        let words = |schema: &Value| schema["enum"].as_array().cloned().unwrap_or_default();
        for word in words(form) {
            probes.push(json!(word.as_str().unwrap().to_uppercase()));
            probes.push(word);
        }
        let items = words(&form["items"]);
        for word in &items {
            probes.extend([json!([word]), json!([word, word]), json!([word, 1])]);
        }
        probes.push(json!(items));
    }
    probes
}

fn shown(place: &Place) -> String {
    let steps = place.way.iter().map(|step| match step {
        Step::Key(key) => key.as_str(),
        Step::First => "0",
    });
    steps.collect::<Vec<_>>().join(".")
}

/// Plans to put values into: every key cannot be given at once.
fn bases() -> Vec<Value> {
    let every_key = every_key();
    let mut of_file = every_key.clone();
    let snap = of_file["landmarks"]["snap"].clone();
    of_file["landmarks"] = json!({ "file": "patient.mrk.json", "snap": snap });
    let mut as_published = every_key.clone();
    as_published["ct"] = json!({ "phantom": "lee2001" });
    as_published["f1"] = json!({ "kind": "point" });
    as_published["morph"] = json!({ "model": "lee2001", "method": "exact" });
    as_published["candidate"][0]["stage"] = json!([{ "name": "a", "f1": [{ "rotate": 1 }] }]);
    as_published["views"] = json!({ "clip": "nose" });
    vec![every_key, of_file, as_published]
}

#[test]
fn values_of_every_kind_at_every_place_have_one_verdict() {
    let (mut accepted, mut refused) = (0, 0);
    for base in bases() {
        assert!(same_verdict(&base, "the plan to begin with"));
        for place in &places() {
            let Some(without) = changed(&base, place, None) else {
                // The root, or a place in a table that this plan has not.
                continue;
            };
            same_verdict(&without, &format!("without {}", shown(place)));
            accepted += 1;
        }
        for place in &places() {
            for probe in probes(&place.schema) {
                let Some(document) = changed(&base, place, Some(&probe)) else {
                    continue;
                };
                let what = format!("{} = {probe}", shown(place));
                *(if same_verdict(&document, &what) {
                    &mut accepted
                } else {
                    &mut refused
                }) += 1;
            }
        }
    }
    // Neither accepts, or refuses, whatever it is given.
    assert!(accepted > 700 && refused > 5000, "{accepted}, {refused}");
}

/// The one difference of kinds.
#[test]
fn a_whole_number_with_a_decimal_point_is_an_integer_to_the_schema_alone() {
    let mut document = every_key();
    document["views"]["size"] = json!(512.0);
    assert!(errors(&document).is_empty());
    let faults = parsed(&document).faults();
    let codes: Vec<Code> = faults.iter().map(|fault| fault.code).collect();
    assert_eq!(codes, [Code::WrongType]);
    document["views"]["size"] = json!(512.5);
    assert!(!same_verdict(&document, "half a pixel"));
}

/// The words between marks.
fn listed(text: &str, mark: char) -> BTreeSet<String> {
    text.split(mark)
        .skip(1)
        .step_by(2)
        .map(str::to_owned)
        .collect()
}

fn keys(schema: &Value) -> Option<BTreeSet<String>> {
    let mut forms = vec![schema];
    forms.extend(schema["anyOf"].as_array().into_iter().flatten());
    let mut of_tables = forms
        .iter()
        .filter_map(|form| form["properties"].as_object());
    let first = of_tables.next()?;
    assert!(
        of_tables.next().is_none(),
        "two kinds of table at one place"
    );
    Some(first.keys().cloned().collect())
}

/// What the parser lists where it meets an unknown key is what the schema has there.
#[test]
fn every_table_has_the_same_keys_in_both() {
    let mut tables = 0;
    for base in bases() {
        for place in places() {
            let Some(keys) = keys(&place.schema) else {
                continue;
            };
            let unknown = json!({ "qqq": 1 });
            let document = if place.way.is_empty() {
                let mut document = base.clone();
                document["qqq"] = json!(1);
                document
            } else {
                match changed(&base, &place, Some(&unknown)) {
                    Some(document) => document,
                    None => continue,
                }
            };
            let faults = faults(&document);
            let expected: Vec<&str> = faults
                .iter()
                .filter(|fault| fault.found.as_deref() == Some("`qqq`"))
                .filter_map(|fault| fault.expected.as_deref())
                .collect();
            let [expected] = expected[..] else {
                panic!("{}: {faults:#?}", shown(&place));
            };
            assert_eq!(listed(expected, '`'), keys, "{}", shown(&place));
            tables += 1;
        }
    }
    assert!(tables > 60, "{tables} tables");
}

/// What the parser lists where it meets an unknown word is what the schema has there.
#[test]
fn every_word_is_in_both() {
    let base = every_key();
    let mut places_of_words = 0;
    for place in places() {
        let mut forms = vec![&place.schema];
        forms.extend(place.schema["anyOf"].as_array().into_iter().flatten());
        let Some(words) = forms.iter().find_map(|form| form["enum"].as_array()) else {
            continue;
        };
        let words: BTreeSet<String> = words
            .iter()
            .map(|word| word.as_str().unwrap().to_owned())
            .collect();
        let way = shown(&place);
        let mut base = base.clone();
        if way == "ct.phantom" {
            base["ct"] = json!({});
        }
        let document = changed(&base, &place, Some(&json!("qqq"))).unwrap();
        let faults = faults(&document);
        let fault = faults
            .iter()
            .find(|fault| fault.found.as_deref() == Some("\"qqq\""));
        let fault = fault.unwrap_or_else(|| panic!("{way}: {faults:#?}"));
        assert_eq!(fault.code, Code::BadValue, "{way}");
        let listed = listed(fault.expected.as_deref().unwrap(), '"');
        assert_eq!(listed, words, "{way}");
        places_of_words += 1;
    }
    assert!(places_of_words >= 14, "{places_of_words}");
}

#[test]
fn every_key_is_explained_to_the_editor() {
    let mut explained = 0;
    for place in places() {
        // Items of an array that are no tables are explained with the array.
        if place.way.last() != Some(&Step::First) || place.schema["properties"].is_object() {
            let about = place.schema["description"].as_str();
            let about = about.unwrap_or_else(|| panic!("{} has no description", shown(&place)));
            assert!(about.ends_with('.') && about.len() > 5, "{about}");
            explained += 1;
        }
    }
    assert!(explained >= 90, "{explained}");
}

fn resolved(document: &Value) -> Plan {
    let grid = Grid::axis_aligned([320, 320, 151], [0.442, 0.442, 1.0]).unwrap();
    let file = parsed(document);
    file.resolve(&grid)
        .unwrap_or_else(|faults| panic!("{faults}"))
}

/// A key that is not given, and one that is given its default, are the same plan.
#[test]
fn defaults_are_the_parsers() {
    let mut defaults = 0;
    for place in places() {
        let default = &place.schema["default"];
        if default.is_null() {
            continue;
        }
        let way = shown(&place);
        let mut base = every_key();
        if way == "views.objects" {
            base["views"]["opacity"] = json!({ "skin": 0.5 });
        }
        let without = resolved(&changed(&base, &place, None).unwrap());
        let with = resolved(&changed(&base, &place, Some(default)).unwrap());
        assert_eq!(without, with, "{way}");
        if !["f1.kind", "morph.model", "morph.method"].contains(&way.as_str()) {
            // The plan to begin with is none of defaults, so that this test can tell one.
            assert_ne!(resolved(&base), with, "{way}");
        }
        defaults += 1;
    }
    assert!(defaults >= 17, "{defaults}");
}

fn plans_in(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut plans: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "toml")
        })
        .collect();
    plans.sort();
    plans
}

#[test]
fn every_plan_that_ships_is_valid() {
    let plans = [plans_in("plans"), plans_in("tests/plans")].concat();
    assert!(plans.len() >= 11, "{plans:?}");
    for plan in plans {
        let text = std::fs::read_to_string(&plan).unwrap();
        let errors = errors_of_text(&text);
        if plan.ends_with("kitchen-sink.toml") {
            // Faults of every kind, a key given twice among them: it is no TOML.
            assert_eq!(errors, None);
            let once = text.replace("tip = [129.0, 33.0, 62.0]", "#");
            assert!(errors_of_text(&once).unwrap().len() > 5);
        } else {
            assert_eq!(errors.unwrap(), [""; 0], "{}", plan.display());
        }
    }
}

/// `$ref`, `$defs`, `prefixItems` and their like are written differently in earlier drafts.
#[test]
fn the_keywords_are_those_of_both_drafts() {
    fn walk(schema: &Value, found: &mut BTreeSet<String>) {
        for (keyword, value) in schema.as_object().into_iter().flatten() {
            found.insert(keyword.clone());
            let parts: Vec<&Value> = match keyword.as_str() {
                "properties" => value.as_object().unwrap().values().collect(),
                "allOf" | "anyOf" | "oneOf" => value.as_array().unwrap().iter().collect(),
                "items" | "contains" | "not" | "if" | "then" | "else" => vec![value],
                _ => Vec::new(),
            };
            parts.into_iter().for_each(|part| walk(part, found));
        }
    }
    let mut found = BTreeSet::new();
    walk(&rhinoplan::plan::schema(), &mut found);
    let known = [
        "$schema",
        "additionalProperties",
        "allOf",
        "anyOf",
        "const",
        "contains",
        "default",
        "description",
        "else",
        "enum",
        "exclusiveMaximum",
        "exclusiveMinimum",
        "if",
        "items",
        "maxItems",
        "maxLength",
        "maxProperties",
        "maximum",
        "minItems",
        "minLength",
        "minProperties",
        "minimum",
        "not",
        "oneOf",
        "pattern",
        "properties",
        "required",
        "then",
        "title",
        "type",
        "uniqueItems",
    ];
    let found: Vec<&str> = found.iter().map(String::as_str).collect();
    assert_eq!(found, known);
}
