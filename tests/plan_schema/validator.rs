//! The schema at work, as an editor has it: TOML read as JSON, then validated.

use std::sync::OnceLock;

use jsonschema::Validator;
use rhinoplan::plan::{Code, Diagnostic};
use serde_json::Value;

/// The validator of plans. As draft 7 it must say the same, for editors that know no later one.
fn validators() -> &'static [Validator; 2] {
    static VALIDATORS: OnceLock<[Validator; 2]> = OnceLock::new();
    VALIDATORS.get_or_init(|| {
        let schema = rhinoplan::plan::schema();
        assert!(jsonschema::meta::is_valid(&schema));
        let mut as_draft_7 = schema.clone();
        as_draft_7["$schema"] = "http://json-schema.org/draft-07/schema#".into();
        assert!(jsonschema::meta::is_valid(&as_draft_7));
        [schema, as_draft_7].map(|schema| jsonschema::validator_for(&schema).unwrap())
    })
}

/// What the schema has against a document.
pub fn errors(document: &Value) -> Vec<String> {
    let [errors, of_draft_7] = validators().each_ref().map(|validator| {
        let errors = validator.iter_errors(document);
        errors
            .map(|error| format!("{}: {error}", error.instance_path()))
            .collect::<Vec<_>>()
    });
    assert_eq!(errors, of_draft_7, "{document:#}");
    errors
}

/// The same of a text; none where it is not TOML.
pub fn errors_of_text(text: &str) -> Option<Vec<String>> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let table: toml::Table = text.parse().ok()?;
    Some(errors(&serde_json::to_value(table).unwrap()))
}

/// Why no schema could refuse a plan for this fault; none where one can.
pub fn beyond_a_schema(fault: &Diagnostic) -> Option<&'static str> {
    match fault.code {
        Code::OutsideVolume | Code::WrongSide | Code::Orientation | Code::BadEdit => {
            Some("it is about where points are in the CT, or what edits add up to")
        }
        Code::BadValue if fault.message == "f1 has no direction" => {
            Some("it is about two points in one place")
        }
        Code::LandmarkFile | Code::Ct => Some("it is about what another file holds"),
        Code::BadValue if fault.message.contains("is not above the skin threshold") => {
            Some("it is about which of two numbers is larger")
        }
        Code::BadValue if fault.message.contains(" allows nothing") => {
            Some("it is about which of two numbers is larger")
        }
        Code::DuplicateName if fault.message.starts_with("another ") => {
            Some("it is about a name that another table has")
        }
        Code::BadValue
            if ["`sweep.candidate` is not", "`sweep.vary.stage` is not"]
                .iter()
                .any(|start| fault.message.starts_with(start)) =>
        {
            Some("it is about a name that another table has")
        }
        Code::Conflict if fault.message.starts_with("the stage has ") => {
            Some("it is about the edits of a stage that is named")
        }
        Code::Conflict if fault.message == "this number is varied twice" => {
            Some("it is about two tables that differ in other keys")
        }
        Code::BadValue if fault.message.ends_with("is where `from` is") => {
            Some("it is about two numbers that are the same")
        }
        Code::TooMany | Code::BadValue
            if fault.message.contains(" this sweep ")
                || fault.message.starts_with("this sweep ") =>
        {
            Some("it is about what combinations of values add up to")
        }
        Code::WrongType if is_whole_with_a_point(fault) => Some("JSON does not tell 3.0 from 3"),
        _ => None,
    }
}

/// Whether a key of an integer has a number such as 3.0.
fn is_whole_with_a_point(fault: &Diagnostic) -> bool {
    let integers = [
        "`plan`",
        "`enhance.median`",
        "`views.size`",
        "`mesh.triangles`",
    ];
    let is_integer = integers.iter().any(|key| fault.message.starts_with(key));
    let found = fault.found.as_deref().unwrap_or_default();
    let number = found.parse::<f64>();
    is_integer && number.is_ok_and(|number| number.fract() == 0.0) && found.contains(['.', 'e'])
}
