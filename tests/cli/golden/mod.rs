//! `bless` and `verify`.

mod damaged;
mod differs;
mod kept;
mod volumes;

use serde_json::Value;

use crate::head::{gzip, nifti, plan};
use crate::process::{Desk, Ran};

/// Volumes in both formats, displacements, and a few pictures.
const ALL: &str =
    "write = [\"volume\", \"nrrd\", \"displacement\", \"views\", \"slices\", \"charts\"]";
const VIEWS: &str = "\n[views]\nnames = [\"frontal\"]\nsize = 256\n";

fn with_all(name: &str) -> String {
    plan(name, "ct.nii.gz").replace("write = [\"volume\", \"displacement\"]", ALL) + VIEWS
}

/// As [`with_all`], with tables alone.
fn with_numbers(name: &str) -> String {
    let text = plan(name, "ct.nii.gz");
    let (text, _) = text.split_once("[outputs]").unwrap();
    text.to_owned()
}

/// As [`with_all`], with volumes alone.
fn with_volumes(name: &str) -> String {
    plan(name, "ct.nii.gz").replace("\"displacement\"", "\"nrrd\"")
}

/// A desk with a CT and a plan on it, blessed.
fn blessed(plan: &str) -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii.gz", gzip(&nifti()));
    desk.write("plan.toml", plan);
    bless(&desk).expect(0);
    desk
}

fn bless(desk: &Desk) -> Ran {
    desk.run(&["bless", "plan.toml", "--golden", "golden"])
}

fn verify(desk: &Desk, more: &[&str]) -> Ran {
    desk.run(&[&["verify", "plan.toml", "--golden", "golden"], more].concat())
}

/// The differences of the only plan, in the document of a `verify` that found some.
fn differences(desk: &Desk) -> Vec<Value> {
    let document = verify(desk, &["--json"]).expect(5).document();
    assert_eq!(document["errors"], serde_json::json!([]));
    assert_eq!(document["plans"][0]["agrees"], false);
    document["plans"][0]["differences"]
        .as_array()
        .unwrap()
        .clone()
}

/// The measures, with what was found.
fn measures(differences: &[Value]) -> Vec<(&str, &Value)> {
    differences
        .iter()
        .map(|row| (row["measure"].as_str().unwrap(), &row["found"]))
        .collect()
}

#[test]
fn what_did_not_change_agrees() {
    let desk = blessed(&with_all("good"));
    let ran = verify(&desk, &[]).expect(0);
    assert_eq!(
        ran.out,
        "good: agrees (125 numbers, 25 pictures, 9 volumes)\n"
    );
    assert_eq!(ran.err, "");
    let document = verify(&desk, &["--json", "-q", "--threads", "1"])
        .expect(0)
        .document();
    assert_eq!(document["plans"][0]["agrees"], true);
    assert_eq!(document["plans"][0]["differences"], serde_json::json!([]));
    assert_eq!(document["plans"][0]["expected"]["pictures"], 25);
    assert_eq!(document["report"], Value::Null);
    for folder in ["golden-report", "out"] {
        assert!(!desk.path().join(folder).exists(), "{folder}");
    }
}

#[test]
fn outputs_are_there_where_they_are_asked_for() {
    let desk = blessed(&with_numbers("good"));
    verify(&desk, &["--out", "again"]).expect(0);
    assert!(desk.path().join("again/good/run.json").is_file());
    desk.write("file", "");
    let ran = verify(&desk, &["--out", "file"]).expect(2);
    assert!(ran.err.contains("cannot create `file/good`"), "{ran:?}");
}

#[test]
fn ci_does_not_bless() {
    let desk = blessed(&with_numbers("good"));
    let before = desk.files("golden");
    let edited = with_numbers("good").replace("[2, 0, 0]", "[3, 0, 0]");
    desk.write("plan.toml", edited);
    let args = ["bless", "plan.toml", "--golden", "golden"];
    for value in ["true", "1", "false"] {
        let ran = desk.run_in_ci(value, &args).expect(2);
        assert!(ran.err.contains("CI is set"), "{ran:?}");
        assert!(ran.err.contains("unset CI"), "{ran:?}");
        assert_eq!(ran.out, "");
    }
    let ran = desk.run_in_ci("true", &[&args[..], &["--json"]].concat());
    assert_eq!(
        ran.expect(2).document()["errors"].as_array().unwrap().len(),
        1
    );
    assert!(before == desk.files("golden"), "nothing was kept");
    let ran = desk.run_in_ci("true", &["verify", "plan.toml", "--golden", "golden"]);
    ran.expect(5);
    desk.run_in_ci("", &args).expect(0);
    assert!(before != desk.files("golden"));
}

#[test]
fn several_plans_are_each_told_of() {
    let desk = blessed(&with_numbers("good"));
    let edited = with_numbers("edited");
    desk.write("edited.toml", &edited);
    desk.run(&["bless", "edited.toml", "--golden", "golden"])
        .expect(0);
    desk.write("edited.toml", edited.replace("[2, 0, 0]", "[3, 0, 0]"));
    desk.write("unknown.toml", with_numbers("unknown"));
    let fails = with_numbers("good").replace("tip = [32, 16, 22]", "tip = [32, 3, 22]");
    let plans = [
        "verify",
        "--golden",
        "golden",
        "unknown.toml",
        "edited.toml",
        "plan.toml",
    ];
    let ran = desk.run(&plans).expect(2);
    assert!(
        ran.err
            .contains("unknown.toml: there is no golden of `unknown` in `golden`"),
        "{ran:?}"
    );
    assert!(ran.err.contains("rhinoplan bless"), "{ran:?}");
    assert!(ran.out.contains("edited: differs in "), "{ran:?}");
    assert!(ran.out.contains("\ngood: agrees ("), "{ran:?}");
    let report = desk.files("golden-report")["report.md"].clone();
    let report = String::from_utf8(report).unwrap();
    assert!(report.contains("1 of 2 plans differ"), "{report}");
    // What cannot be run does not stop the others either, and outweighs that they differ.
    desk.write("plan.toml", fails);
    let ran = desk.run(&["verify", "--golden", "golden", "plan.toml", "edited.toml"]);
    let ran = ran.expect(3);
    assert!(ran.err.contains("plan.toml: "), "{ran:?}");
    assert!(ran.out.contains("edited: differs in "), "{ran:?}");
}

#[test]
fn plans_with_faults_are_refused_before_anything_runs() {
    let desk = blessed(&with_numbers("good"));
    desk.write(
        "typo.toml",
        with_numbers("typo").replace("rotate = 5", "turn = 5"),
    );
    for command in ["bless", "verify"] {
        let args = [command, "plan.toml", "typo.toml", "--golden", "golden"];
        let ran = desk.run(&args).expect(2);
        assert!(ran.err.contains("unknown key `turn`"), "{ran:?}");
        assert_eq!(ran.out, "");
    }
}
