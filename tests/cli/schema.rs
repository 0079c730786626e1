//! What `schema` prints.

use serde_json::Value;

use crate::process::Desk;

#[test]
fn the_schema_is_printed_and_nothing_else() {
    let desk = Desk::new();
    let ran = desk.run(&["schema"]).expect(0);
    assert_eq!(ran.err, "");
    let printed: Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!(printed, rhinoplan::plan::schema());
    assert_eq!(
        printed["$schema"],
        "https://json-schema.org/draft/2020-12/schema"
    );
    // Text of several lines, the last one ended, the same each time.
    assert!(ran.out.lines().count() > 100 && ran.out.ends_with("}\n"));
    assert_eq!(desk.run(&["schema", "--quiet"]).expect(0).out, ran.out);
    assert!(desk.files("").is_empty());
    let document = desk.run(&["schema", "--json"]).expect(0).document();
    assert_eq!(document["schema"], printed);
}

#[test]
fn help_says_how_an_editor_finds_it() {
    let ran = Desk::new().run(&["schema", "--help"]).expect(0);
    assert!(
        ran.out.contains("rhinoplan schema > plan.schema.json"),
        "{ran:?}"
    );
    assert!(ran.out.contains("#:schema ./plan.schema.json"), "{ran:?}");
    Desk::new().run(&["schema", "plan.toml"]).expect(2);
}
