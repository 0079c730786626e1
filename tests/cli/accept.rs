//! The limits that a plan sets to its candidates.

use crate::head::{gzip, nifti, plan};
use crate::process::{Desk, Ran};

/// Of `both`, which is lower than `up`: 10.5 mm less 3, and 10.5 mm less nothing.
const BOTH_ONLY: &str = "\n[accept]\nheight = { max = 22 }\njacobian_min = 0.1\n";
const NONE: &str = "\n[accept]\nvolume_total = { change_percent = [5, 10] }\n";
const ALL: &str = "\n[accept]\nheight = [1, 40]\ntip_x = { change = [-1, 4] }\n";

fn desk(accept: &str) -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii.gz", gzip(&nifti()));
    desk.write("plan.toml", plan("good", "ct.nii.gz") + accept);
    desk
}

fn run(desk: &Desk, more: &[&str], code: i32) -> Ran {
    desk.run(&[&["run", "plan.toml"], more].concat())
        .expect(code)
}

#[test]
fn one_that_keeps_the_limits_will_do_unless_all_have_to() {
    let desk = desk(BOTH_ONLY);
    let ran = run(&desk, &[], 0);
    assert!(ran.out.contains("; accepted\n"), "{}", ran.out);
    let failed = "; not accepted:\n    `height` is ";
    assert!(ran.out.contains(failed), "{}", ran.out);
    assert!(ran.out.contains("allowed: at most 22 mm"), "{}", ran.out);
    let files = desk.results("out/good");
    run(&desk, &["--strict"], 4);
    assert!(
        files == desk.results("out/good"),
        "the exit code alone differs"
    );
}

#[test]
fn none_that_keeps_them_is_exit_code_4_and_everything_is_written() {
    let desk = desk(NONE);
    let ran = run(&desk, &["--json"], 4);
    let document = ran.document();
    assert_eq!(document["errors"], serde_json::json!([]));
    let candidates = document["runs"][0]["record"]["candidates"]
        .as_array()
        .unwrap();
    for candidate in candidates {
        assert_eq!(candidate["accept"]["accepted"], false);
        let limit = &candidate["accept"]["limits"][0];
        assert_eq!(limit["measure"], "volume_total");
        assert_eq!(limit["of"], "change_percent");
        let total =
            |stage: &serde_json::Value| stage["measures"]["volume_total_mm3"].as_f64().unwrap();
        let stages = candidate["stages"].as_array().unwrap();
        let (before, after) = (total(&stages[0]), total(stages.last().unwrap()));
        let percent = 100.0 * (after / before - 1.0);
        assert!((limit["found"].as_f64().unwrap() - percent).abs() < 1e-9);
    }
    let text = std::fs::read_to_string(desk.path().join("out/good/table.md")).unwrap();
    assert_eq!(
        text.matches("Limits of the plan: **not accepted**.")
            .count(),
        2
    );
    assert_eq!(
        text.matches("| change of `volume_total` | 5 to 10 % |")
            .count(),
        2
    );
    let text = std::fs::read_to_string(desk.path().join("out/good/compare.md")).unwrap();
    assert!(text.contains("| accepted | | **no** | **no** |"), "{text}");
}

#[test]
fn all_that_keep_them_are_exit_code_0_with_strict_too() {
    run(&desk(ALL), &["--strict"], 0);
    // Without limits there is nothing to be strict about.
    let desk = desk("");
    let ran = run(&desk, &["--strict"], 0);
    assert!(!ran.out.contains("accepted"), "{}", ran.out);
    assert!(
        desk.json("out/good/run.json")["plan"]
            .get("accept")
            .is_none()
    );
}

#[test]
fn an_error_outweighs_a_limit() {
    let desk = desk(NONE);
    let impossible = plan("bad", "ct.nii.gz").replace(
        "[[candidate]]\nname = \"up\"",
        &format!("{}[[candidate]]\nname = \"up\"", crate::head::FAILS_LATE),
    );
    desk.write("bad.toml", impossible);
    desk.run(&["run", "plan.toml", "bad.toml"]).expect(3);
    assert!(desk.path().join("out/good/run.json").exists());
}
