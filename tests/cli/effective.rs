//! `plan.effective.toml`: every value that a run used, and a plan that gives the same bytes.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::head::{gzip, nifti, plan, plan_head};
use crate::process::{Desk, names};

/// The plan's name in its folder.
const EFFECTIVE: &str = "plan.effective.toml";

/// Every key that a plan of one NIfTI file can have, and every edit.
fn every_key() -> String {
    plan_head("good", "ct.nii.gz")
        .replace(
            "name = \"good\"",
            "name = \"good\"\ntitle = 'It is \"good\"'",
        )
        .replace("[landmarks]", "[landmarks]\nsnap = { mm = 3 }")
        .replace("tip = [32, 16, 22]", "tip = [32.5, 15, 22.5]")
        + r#"
[cage]
depth = { voxels = 4 }

[f1]
root = [32, 30, 35]
kind = "point"

[enhance]
median = 3
smooth = { mm = 1 }

[segment]
skin_hu = "otsu"
bone_hu = 20
keep_largest = false

[morph]
model = "local"
scale = "half"
method = "adaptive"
tolerance = { voxels = 0.1 }
margin = { mm = 15 }
compare_exact = true

[[candidate]]
name = "all"
title = "Every edit"

[[candidate.stage]]
name = "line"
kind = "line"
f1 = [
  { move_tip = { voxels = [1, 0, 0] } },
  { move_root = { mm = [0, 0.1, 0] } },
  { tip_to = [32.25, 17, 22.125] },
  { root_to = [32, 29.7, 35.3] },
  { project = -1 },
  { rotate = 2.5 },
  { lengthen = 0.3 },
  { deviate = -0.7 },
  { width = 0.95 },
]

[[candidate.stage]]
name = "point"
f1 = [{ project = -0.1 }]

[outputs]
write = ["inverse", "volume", "nrrd", "displacement", "views", "slices", "charts", "mesh", "solids"]

[views]
names = ["basal", "frontal"]
size = 256
objects = ["bone", "skin"]
opacity = { skin = 0.4 }
crop = { mm = 90 }
clip = { plane = "sagittal", offset = 1.5, keep = "left" }

[[views.camera]]
name = "high-left"
azimuth = 30
elevation = 20.5

[mesh]
triangles = 5000
"#
}

type Files = BTreeMap<String, Vec<u8>>;

/// Takes the record out of a run's files, without the digest of the plan, and of a file of landmarks.
fn take_record(files: &mut Files) -> Value {
    let bytes = files.remove("run.json").unwrap();
    let mut record: Value = serde_json::from_slice(&bytes).unwrap();
    let inputs = record["inputs"].as_object_mut().unwrap();
    assert!(inputs.remove("plan_sha256").is_some());
    inputs.remove("landmarks_sha256");
    record
}

/// Runs a plan, then what it wrote as its effective plan, put into the folder of the plan: the files of both are the
/// same, but for times and digests. Returns the effective plan.
fn assert_runs_to_the_same(desk: &Desk, file: &str) -> String {
    let first = desk.run(&["run", file, "--out", "first"]).expect(0);
    let folder = fs::read_dir(desk.path().join("first"))
        .unwrap()
        .next()
        .unwrap();
    let name = folder.unwrap().file_name().into_string().unwrap();
    let mut files = desk.results(&format!("first/{name}"));
    let text = String::from_utf8(files[EFFECTIVE].clone()).unwrap();
    let again = Path::new(file).with_file_name("again.toml");
    fs::write(desk.path().join(&again), &text).unwrap();
    let second = desk
        .run(&["run", again.to_str().unwrap(), "--out", "second"])
        .expect(0);
    let mut same = desk.results(&format!("second/{name}"));
    assert_eq!(names(&files), names(&same));
    assert_eq!(take_record(&mut files), take_record(&mut same));
    for (name, bytes) in &files {
        assert!(same[name] == *bytes, "{name}\n{text}");
    }
    assert_eq!(
        first.out.replace("first", "second"),
        second.out,
        "what is told"
    );
    text
}

/// The keys of tables, each by its way, without those of arrays.
fn keys(table: &toml::Table, way: &str, to: &mut Vec<String>) {
    for (key, value) in table {
        let way = format!("{way}{key}");
        match value {
            toml::Value::Table(table) => keys(table, &format!("{way}."), to),
            _ => to.push(way),
        }
    }
}

#[test]
fn a_plan_of_every_key_runs_to_the_same_bytes() {
    let desk = Desk::new();
    desk.write("data/ct.nii.gz", gzip(&nifti()));
    desk.write("data/plan.toml", every_key());
    let text = assert_runs_to_the_same(&desk, "data/plan.toml");
    let of = |text: &str| {
        let mut found = Vec::new();
        keys(&text.parse().unwrap(), "", &mut found);
        found.sort();
        found
    };
    // All that is given is there, and what is not given.
    let mut expected = of(&every_key());
    expected.extend(["ct.sha256", "views.opacity.bone"].map(str::to_owned));
    expected.sort();
    assert_eq!(of(&text), expected);
    // What only the run found out.
    for found in [
        "depth = { voxels = 4.0 } # 6.000 mm",
        "skin_hu = \"otsu\" # -479.5 HU in this CT",
        "tip = [32.5, 15.0, 22.5] # moved onto the skin, to [32.",
    ] {
        assert!(text.contains(found), "{found} is not in\n{text}");
    }
}

#[test]
fn a_plan_of_few_keys_has_every_default_filled_in() {
    let desk = Desk::new();
    desk.write("ct.nii.gz", gzip(&nifti()));
    let few = plan("good", "ct.nii.gz");
    let (few, _) = few.split_once("[outputs]").unwrap();
    desk.write("plan.toml", few);
    let text = assert_runs_to_the_same(&desk, "plan.toml");
    for filled_in in [
        "depth = { mm = 11.0 }",
        "root = [32.0, 30.0, 36.0]",
        "kind = \"line\"",
        "skin_hu = -500.0",
        "bone_hu = 300.0",
        "keep_largest = true",
        "model = \"local\"",
        "scale = \"full\"",
        "method = \"adaptive\"",
        "tolerance = { mm = 0.05 }",
        "compare_exact = false",
        "margin = { mm = 20.0 }",
    ] {
        assert!(text.contains(filled_in), "{filled_in} is not in\n{text}");
    }
    // An effective plan is its own.
    let again = desk.files("second/good");
    assert_eq!(String::from_utf8_lossy(&again[EFFECTIVE]), text);
}

#[test]
fn landmarks_of_a_file_stand_in_its_place() {
    let desk = Desk::new();
    desk.write("ct.nii.gz", gzip(&nifti()));
    let points = plan_head("good", "ct.nii.gz");
    let given = |name: &str| {
        let (_, rest) = points.split_once(&format!("{name} = [")).unwrap();
        let numbers: Vec<f64> = rest
            .split(']')
            .next()
            .unwrap()
            .split(", ")
            .map(|n| n.parse().unwrap())
            .collect();
        // LPS of the small head's voxels, its first at (-48, -48, -36), 1.5 mm apart.
        [
            numbers[0] * 1.5 - 48.0,
            numbers[1] * 1.5 - 48.0,
            numbers[2] * 1.5 - 36.0,
        ]
    };
    let names = [
        "nasal_bones",
        "lip",
        "alare_right",
        "alare_left",
        "tip",
        "maxilla",
    ];
    let markups: Vec<Value> = names
        .iter()
        .map(|name| serde_json::json!({ "label": name, "position": given(name) }))
        .collect();
    let markups =
        serde_json::json!({ "markups": [{ "coordinateSystem": "LPS", "controlPoints": markups }] });
    desk.write("points.mrk.json", markups.to_string());
    let whole = plan("good", "ct.nii.gz");
    let (head, rest) = whole.split_once("frame = ").unwrap();
    let (_, rest) = rest.split_once("[[candidate]]").unwrap();
    desk.write(
        "plan.toml",
        format!("{head}file = \"points.mrk.json\"\n\n[[candidate]]{rest}"),
    );
    let text = assert_runs_to_the_same(&desk, "plan.toml");
    assert!(
        text.contains("frame = \"lps\"\n") && !text.contains("file"),
        "{text}"
    );
}

/// Another content than that of the run is refused: the plan pins it.
#[test]
fn the_ct_is_pinned_and_a_path_of_the_machine_is_not_told() {
    let desk = Desk::new();
    let ct = desk.write("cts/ct.nii.gz", gzip(&nifti()));
    desk.write("plan.toml", plan("good", ct.to_str().unwrap()));
    desk.run(&["run", "plan.toml"]).expect(0);
    let text = fs::read_to_string(desk.path().join("out/good").join(EFFECTIVE)).unwrap();
    assert!(text.contains("\npath = \"ct.nii.gz\"\n"), "{text}");
    assert!(!text.contains("cts"), "{text}");
    // Beside the CT it runs.
    desk.write("cts/plan.toml", &text);
    desk.run(&["run", "cts/plan.toml"]).expect(0);
    let mut other = nifti();
    let last = other.len() - 1;
    other[last] ^= 1;
    desk.write("cts/ct.nii.gz", gzip(&other));
    let ran = desk.run(&["run", "cts/plan.toml"]).expect(3);
    assert!(ran.err.contains("SHA-256"), "{ran:?}");
}

/// One of the plans that ship, on the built-in head.
#[test]
fn a_plan_that_ships_runs_to_the_same_bytes() {
    let desk = Desk::new();
    let plans = Path::new(env!("CARGO_MANIFEST_DIR")).join("plans");
    let text = fs::read_to_string(plans.join("two-operations-lee2001-half.toml")).unwrap();
    desk.write("plan.toml", text);
    assert_runs_to_the_same(&desk, "plan.toml");
}
