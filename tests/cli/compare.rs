//! Candidates beside each other: of one run, and of several.

use std::fs;

use serde_json::{Value, json};

use crate::head::{gzip, nifti, plan, plan_head};
use crate::process::{Desk, Ran, names};

const UP_ONLY: &str = "[[candidate]]\nname = \"up\"\n\n[[candidate.stage]]\nname = \"rotate\"\nf1 = [{ rotate = 5 }]\n";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii.gz", gzip(&nifti()));
    desk.write("plan.toml", plan("good", "ct.nii.gz"));
    desk.write("up.toml", plan_head("up", "ct.nii.gz") + UP_ONLY);
    desk
}

fn ran() -> Desk {
    let desk = desk();
    desk.run(&["run", "plan.toml", "up.toml"]).expect(0);
    desk
}

fn text(desk: &Desk, name: &str) -> String {
    fs::read_to_string(desk.path().join(name)).unwrap()
}

#[test]
fn a_run_of_two_candidates_compares_them_and_one_of_one_does_not() {
    let desk = ran();
    assert!(
        !names(&desk.files("out/up"))
            .iter()
            .any(|name| name.starts_with("compare"))
    );
    assert!(
        desk.json("out/up/run.json")
            .get("surface_differences")
            .is_none()
    );
    let record = desk.json("out/good/run.json");
    let compared = desk.json("out/good/compare.json");
    assert_eq!(
        compared["surface_differences"],
        record["surface_differences"]
    );
    let mut rows = csv::Reader::from_path(desk.path().join("out/good/compare.csv")).unwrap();
    let rows: Vec<csv::StringRecord> = rows.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 2 * 23 + 3);
    for (place, candidate) in compared["candidates"]
        .as_array()
        .unwrap()
        .iter()
        .enumerate()
    {
        let stages = record["candidates"][place]["stages"].as_array().unwrap();
        assert_eq!(candidate["stage"], stages.last().unwrap()["name"]);
        let height = |stage: &Value| stage["measures"]["height_mm"].as_f64().unwrap();
        let (before, after) = (height(&stages[0]), height(stages.last().unwrap()));
        let found = &candidate["measures"][13];
        let expected = json!({
            "measure": "height",
            "unit": "mm",
            "before": before,
            "value": after,
            "change": after - before,
            "change_percent": 100.0 * (after - before) / before,
        });
        assert_eq!(*found, expected);
        let row = &rows[place * 23 + 13];
        assert_eq!(&row[0], candidate["name"].as_str().unwrap());
        assert_eq!(
            [&row[1], &row[2], &row[4]],
            ["preoperative", "height", "mm"]
        );
        assert_eq!(row[6].parse::<f64>().unwrap(), after - before);
    }
    assert_eq!(
        [&rows[46][0], &rows[46][1], &rows[46][2]],
        ["both", "up", "surface_mean"]
    );
}

/// `both` ends 3 mm lower and 3 mm to the left of where it began, `up` turned by 5 degrees.
#[test]
fn skins_are_apart_by_about_what_tips_are() {
    let desk = ran();
    let pairs = &desk.json("out/good/run.json")["surface_differences"];
    let [pair] = &pairs.as_array().unwrap()[..] else {
        panic!("{pairs}");
    };
    let mm = |key: &str| pair[key].as_f64().unwrap();
    assert!(mm("max_mm") > 2.0 && mm("max_mm") < 6.0, "{pair}");
    assert!(0.0 < mm("mean_mm") && mm("mean_mm") < mm("p95_mm") && mm("p95_mm") <= mm("max_mm"));
    assert!(mm("area_mm2") > 100.0 && mm("area_mm2") < 6000.0, "{pair}");
}

#[test]
fn two_candidates_that_are_the_same_are_not_apart() {
    let desk = desk();
    let twin = UP_ONLY.replace("\"up\"", "\"twin\"");
    desk.write(
        "twins.toml",
        plan_head("twins", "ct.nii.gz") + UP_ONLY + &twin,
    );
    desk.run(&["run", "twins.toml"]).expect(0);
    let pair = &desk.json("out/twins/run.json")["surface_differences"][0];
    assert_eq!(pair["max_mm"], 0.0);
    assert!(
        pair["area_mm2"].as_f64().unwrap() > 100.0,
        "what moved alike is compared: {pair}"
    );
}

#[test]
fn finished_runs_are_compared_by_what_they_left() {
    let desk = ran();
    let before = desk.files("out");
    let ran = desk
        .run(&[
            "compare",
            "out/good",
            "out/up",
            "--out",
            "new/folder",
            "--json",
        ])
        .expect(0);
    let document = ran.document();
    let [warning] = &document["warnings"].as_array().unwrap()[..] else {
        panic!("{document}");
    };
    let lacks = "the distances between skins are without `up/up`: the run of a plan with a single candidate";
    assert!(warning.as_str().unwrap().starts_with(lacks), "{warning}");
    assert!(before == desk.files("out"), "runs are left alone");
    let files = desk.files("new/folder");
    assert_eq!(names(&files), ["compare.csv", "compare.json", "compare.md"]);
    let compared = desk.json("new/folder/compare.json");
    let candidates: Vec<&str> = compared["candidates"]
        .as_array()
        .unwrap()
        .iter()
        .map(|candidate| candidate["name"].as_str().unwrap())
        .collect();
    assert_eq!(candidates, ["good/both", "good/up", "up/up"]);
    assert_eq!(
        compared["candidates"][1]["measures"],
        compared["candidates"][2]["measures"]
    );
    // A run of one candidate keeps no skin.
    let pairs = compared["surface_differences"].as_array().unwrap();
    assert_eq!(pairs.len(), 1);
    assert_eq!(pairs[0]["candidates"], json!(["good/both", "good/up"]));
    // The same bytes, however often, and one run alone is what it wrote itself.
    desk.run(&["compare", "out/good", "out/up", "--out", "again"])
        .expect(0);
    assert!(files == desk.files("again"));
    desk.run(&["compare", "out/good", "--out", "alone"])
        .expect(0);
    for name in ["compare.csv", "compare.json", "compare.md"] {
        assert_eq!(
            text(&desk, &format!("alone/{name}")),
            text(&desk, &format!("out/good/{name}"))
        );
    }
}

#[test]
fn runs_that_began_differently_are_compared_with_a_warning() {
    let desk = ran();
    let mut other = nifti();
    // One voxel of air, a little denser.
    other[352] = other[352].wrapping_add(1);
    desk.write("other.nii", other);
    let moved = plan("good", "other.nii").replace("tip = [32, 16, 22]", "tip = [32, 16.5, 22]");
    desk.write("moved.toml", moved + "\n[segment]\nskin_hu = -400\n");
    desk.run(&["run", "moved.toml", "--out", "more"]).expect(0);
    let ran = desk.run(&["compare", "out/good", "more/good"]).expect(0);
    let warnings = [
        "the voxels of the CT of `good#2` differ from those of `good#1`",
        "the landmarks, and so the regions of `good#2`",
        "the skin thresholds of `good#2`",
    ];
    let page = text(&desk, "compare/compare.md");
    for warning in warnings {
        assert!(ran.err.contains(warning), "{}", ran.err);
        assert!(page.contains(warning), "{page}");
    }
    assert!(!page.contains("spacing"), "{page}");
    assert!(page.contains(" → "), "each says where it began: {page}");
}

fn refused(desk: &Desk, args: &[&str], code: i32, message: &str) {
    let ran: Ran = desk.run(&[&["compare"], args].concat()).expect(code);
    assert!(ran.err.contains(message), "{message}: {}", ran.err);
    assert!(!desk.path().join("compare").exists());
}

#[test]
fn what_is_no_finished_run_is_refused() {
    let desk = ran();
    desk.write("empty/x", "");
    refused(
        &desk,
        &["out"],
        3,
        "there is no finished run in `out`: it has no run.json",
    );
    refused(
        &desk,
        &["nowhere", "out/good"],
        3,
        "no finished run in `nowhere`",
    );
    refused(&desk, &["plan.toml"], 3, "no finished run in `plan.toml`");
    refused(&desk, &["out/up"], 2, "not two candidates");
    refused(
        &desk,
        &["out/good", "out/../out/good"],
        2,
        "the same folder",
    );
    refused(
        &desk,
        &["out/good", "--out", "out/up"],
        2,
        "the folder of a run",
    );
    desk.write("file", "");
    refused(
        &desk,
        &["out/good", "--out", "file"],
        2,
        "cannot create `file`",
    );
    let whole = desk.json("out/good/run.json");
    type Spoil = fn(&mut Value);
    let cases: [(Spoil, &str); 11] = [
        (|run| run["format"] = json!(2), "it is of layout 2"),
        (|run| run["candidates"] = json!({}), "invalid type"),
        (
            |run| run["candidates"][0]["name"] = json!("a | b"),
            "a candidate's name",
        ),
        (
            |run| run["candidates"][0]["name"] = json!("up"),
            "two candidates have the name `up`",
        ),
        (
            |run| run["plan"]["name"] = json!("../up"),
            "the plan's name",
        ),
        (
            |run| run["plan"]["title"] = json!("a\nb"),
            "the plan's title",
        ),
        (
            |run| run["program"]["version"] = json!("1".repeat(300)),
            "the program's version",
        ),
        (
            |run| run["candidates"][0]["stages"] = json!([]),
            "has no stage",
        ),
        (
            |run| run["candidates"][0]["stages"][1]["measures"]["gamma_deg"] = Value::Null,
            "invalid type: null",
        ),
        (
            |run| run["candidates"][0]["stages"][0]["measures"]["volume_mm3"] = json!([1.0]),
            "invalid length 1",
        ),
        (
            |run| run["surface_differences"][0]["candidates"] = json!(["both", "gone"]),
            "candidates that are not there",
        ),
    ];
    for (spoil, message) in cases {
        let mut run = whole.clone();
        spoil(&mut run);
        desk.write("bad/run.json", run.to_string());
        refused(&desk, &["bad", "out/good"], 3, message);
    }
    for (bytes, message) in [
        (&b""[..], "EOF"),
        (b"\xff\xfe", "expected value"),
        (b"{\"format\": 1}", "missing field"),
        (b"{\"format\": 1e999}", "number out of range"),
    ] {
        desk.write("bad/run.json", bytes);
        refused(&desk, &["bad", "out/good"], 3, message);
    }
    let deep = format!(
        "{{\"format\": 1, \"candidates\": [{{\"x\": {}",
        "[".repeat(1 << 20)
    );
    desk.write("bad/run.json", deep);
    refused(&desk, &["bad", "out/good"], 3, "EOF");
    let long = format!("{{\"format\": \"{}\"}}", "x".repeat(1 << 20));
    desk.write("bad/run.json", long);
    refused(&desk, &["bad", "out/good"], 3, "invalid type: string");
    let ran = desk.run(&["compare", "bad", "out/good"]).expect(3);
    assert!(ran.err.len() < 1000, "{} bytes", ran.err.len());
    let large = fs::File::create(desk.path().join("bad/run.json")).unwrap();
    large
        .set_len(rhinoplan::exec::comparison::MAX_RECORD_BYTES + 1)
        .unwrap();
    refused(&desk, &["bad", "out/good"], 3, "larger than");
}
