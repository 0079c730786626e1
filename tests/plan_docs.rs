//! The user's reference of the plan file says what the program does.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::path::Path;

use rhinoplan::plan::PlanFile;
use rhinoplan::space::Grid;

const PAGE: &str = include_str!("../docs/plan.md");
const README: &str = include_str!("../README.md");

/// The examples on a page.
fn examples(page: &'static str) -> Vec<&'static str> {
    let blocks = page.split("```toml\n").skip(1);
    blocks
        .map(|block| block.split("```").next().unwrap())
        .collect()
}

fn accept(text: &str) {
    let grid = Grid::axis_aligned([320, 320, 151], [0.442, 0.442, 1.0]).unwrap();
    let file = PlanFile::from_text("docs/plan.md", Path::new("."), text);
    if let Err(faults) = file.resolve(&grid) {
        panic!("{faults}\nin\n{text}");
    }
}

#[test]
fn examples_are_plans() {
    let [whole, edits, views] = examples(PAGE)[..] else {
        panic!("the page has other examples now");
    };
    accept(whole);
    let stage = "f1 = [{ deviate = 8.84 }]";
    assert!(whole.contains(stage));
    accept(&whole.replace(stage, edits));
    let outputs = "[outputs]\nwrite = [\"volume\", \"displacement\"]\n";
    assert!(whole.contains(outputs));
    accept(&whole.replace(outputs, views));
}

#[test]
fn the_readme_shows_a_plan_and_what_a_fault_looks_like() {
    let [plan] = examples(README)[..] else {
        panic!("the README has other plans now");
    };
    accept(plan);
    let grid = Grid::axis_aligned([320, 320, 151], [0.442, 0.442, 1.0]).unwrap();
    let (_, shown) = README.split_once("```text\n").unwrap();
    let (shown, _) = shown.split_once("```").unwrap();
    // The line of the fault is in the plan where the page says it is.
    let before = plan.find("[[candidate]]").unwrap();
    let mut faulty = plan.to_owned();
    faulty.insert_str(before, "[morph]\nmodle = \"local\"\n\n");
    let file = PlanFile::from_text("smaller.toml", Path::new("."), &faulty);
    let faults = file.resolve(&grid).unwrap_err();
    let without_numbers = |text: &str| text.replace(|c: char| c.is_ascii_digit() || c == ' ', "");
    assert_eq!(
        without_numbers(faults.render(false).trim()),
        without_numbers(shown.trim())
    );
}

/// The program lists the keys that it knows where one is unknown: all are on the page.
#[test]
fn every_key_is_explained() {
    let text = "plan = 1\nname = \"a\"\nx = 1\nct.x = 1\nlandmarks.x = 1\ncage.x = 1\nf1.x = 1\n\
                enhance.x = 1\nenhance.smooth.x = 1\nsegment.x = 1\nmorph.x = 1\noutputs.x = 1\n\
                views.x = 1\nviews.opacity.x = 1\nviews.crop.x = 1\nviews.clip.x = 1\n\
                [[views.camera]]\nx = 1\n\
                [mesh]\nx = 1\n[accept]\nx = 1\ngamma.x = 1\n\
                [[candidate]]\nx = 1\n[[candidate.stage]]\nx = 1\nf1 = [{ x = 1 }]\n";
    let file = PlanFile::from_text("p", Path::new("."), text);
    let faults = file.faults();
    let unknown = faults
        .iter()
        .filter(|fault| fault.code.name() == "unknown-key");
    let mut keys = 0;
    for fault in unknown {
        let known = fault.expected.as_deref().unwrap();
        for key in known.split('`').skip(1).step_by(2) {
            keys += 1;
            let as_key = format!("`{key}`");
            let as_table = format!("[{key}]");
            let as_stage = format!(".{key}]]");
            let forms = [as_key, as_table, as_stage];
            assert!(forms.iter().any(|form| PAGE.contains(form)), "{key}");
        }
    }
    assert!(keys > 40, "{keys} keys");
}
