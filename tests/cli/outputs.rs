//! What a run leaves in its folder.

use rhinoplan::io::nifti::{read, read_header};
use rhinoplan::volume::AnyVolume;
use serde_json::Value;

use crate::head::{DIMS, SPACING, gzip, nifti, picture_plan, plan};
use crate::process::{Desk, names};

const STAGES: [(&str, &str); 5] = [
    ("both", "preoperative"),
    ("both", "move"),
    ("both", "reduce"),
    ("up", "preoperative"),
    ("up", "rotate"),
];

/// In the order of the file, with their units.
const MEASURES: [(&str, &str); 23] = [
    ("volume_A", "mm3"),
    ("volume_B", "mm3"),
    ("volume_C", "mm3"),
    ("volume_D", "mm3"),
    ("volume_E", "mm3"),
    ("volume_F", "mm3"),
    ("volume_G", "mm3"),
    ("volume_H", "mm3"),
    ("volume_I", "mm3"),
    ("volume_J", "mm3"),
    ("volume_K", "mm3"),
    ("volume_total", "mm3"),
    ("gamma", "deg"),
    ("height", "mm"),
    ("tip_x", "voxel"),
    ("tip_y", "voxel"),
    ("tip_z", "voxel"),
    ("move_x", "voxel"),
    ("move_y", "voxel"),
    ("move_z", "voxel"),
    ("jacobian_min", "1"),
    ("displacement_max", "mm"),
    ("displacement_max_outside", "mm"),
];

fn ran() -> Desk {
    let desk = Desk::new();
    desk.write("data/ct.nii.gz", gzip(&nifti()));
    desk.write("data/plan.toml", plan("good", "ct.nii.gz"));
    desk.run(&["run", "data/plan.toml"]).expect(0);
    desk
}

/// A number of `run.json` by its name in `measurements.csv`.
fn recorded(stage: &Value, measure: &str) -> f64 {
    let measures = &stage["measures"];
    let (kind, which) = measure.split_once('_').unwrap_or((measure, ""));
    let axis =
        |list: &Value| list[["x", "y", "z"].iter().position(|a| *a == which).unwrap()].clone();
    let value = match kind {
        "volume" if which == "total" => measures["volume_total_mm3"].clone(),
        "volume" => measures["volume_mm3"][usize::from(which.as_bytes()[0] - b'A')].clone(),
        "gamma" => measures["gamma_deg"].clone(),
        "height" => measures["height_mm"].clone(),
        "tip" => axis(&measures["tip_voxel"]),
        "move" => axis(&measures["move_voxel"]),
        "jacobian" => stage["warp"]["jacobian_min"].clone(),
        _ => stage["warp"][format!("{measure}_mm")].clone(),
    };
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{measure} in {stage}"))
}

#[test]
fn the_files_are_those_of_the_contract_in_the_default_folder() {
    let desk = ran();
    assert_eq!(
        names(&desk.files("out")),
        [
            "good/.rhinoplan.files",
            "good/both/01-move/displacement.nii.gz",
            "good/both/01-move/volume.nii.gz",
            "good/both/02-reduce/displacement.nii.gz",
            "good/both/02-reduce/volume.nii.gz",
            "good/compare.csv",
            "good/compare.json",
            "good/compare.md",
            "good/measurements.csv",
            "good/plan.effective.toml",
            "good/run.json",
            "good/table.md",
            "good/timings.json",
            "good/up/01-rotate/displacement.nii.gz",
            "good/up/01-rotate/volume.nii.gz",
        ]
    );
}

#[test]
fn without_outputs_there_are_tables_only() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    let text = plan("good", "ct.nii");
    let (text, _) = text.split_once("[outputs]").unwrap();
    desk.write("plan.toml", text);
    desk.run(&["run", "plan.toml", "--out", "here"]).expect(0);
    let files = desk.files("here/good");
    assert_eq!(
        names(&files),
        [
            ".rhinoplan.files",
            "compare.csv",
            "compare.json",
            "compare.md",
            "measurements.csv",
            "plan.effective.toml",
            "run.json",
            "table.md",
            "timings.json"
        ]
    );
}

#[test]
fn the_table_of_measures_holds_the_numbers_of_the_record() {
    let desk = ran();
    let record = desk.json("out/good/run.json");
    let table = std::fs::read_to_string(desk.path().join("out/good/measurements.csv")).unwrap();
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("candidate,stage,measure,value,unit"));
    let mut stages = record["candidates"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|candidate| candidate["stages"].as_array().unwrap());
    for (candidate, name) in STAGES {
        let stage = stages.next().unwrap();
        assert_eq!(stage["name"], name);
        for (measure, unit) in MEASURES {
            let cells: Vec<_> = lines.next().unwrap().split(',').collect();
            let [in_candidate, in_stage, called, value, in_unit] = cells[..] else {
                panic!("{cells:?}");
            };
            assert_eq!(
                [in_candidate, in_stage, called, in_unit],
                [candidate, name, measure, unit]
            );
            let value: f64 = value.parse().unwrap();
            assert_eq!(
                value,
                recorded(stage, measure),
                "{candidate} {name} {measure}"
            );
            assert!(value.is_finite());
        }
    }
    assert!(lines.next().is_none() && stages.next().is_none());
}

#[test]
fn the_numbers_are_those_of_the_edits() {
    let desk = ran();
    let record = desk.json("out/good/run.json");
    let of = |candidate: usize, stage: usize, measure: &str| {
        recorded(&record["candidates"][candidate]["stages"][stage], measure)
    };
    let tip = |candidate, stage| ["tip_x", "tip_y", "tip_z"].map(|name| of(candidate, stage, name));
    assert_eq!(tip(0, 0), [32.0, 16.0, 22.0]);
    assert_eq!(tip(0, 1), [34.0, 16.0, 22.0]);
    assert_eq!(tip(0, 2), [34.0, 18.0, 22.0]);
    assert_eq!(of(0, 1, "height"), 16.0 * SPACING);
    assert_eq!(of(0, 2, "height"), 14.0 * SPACING);
    assert!(tip(1, 1)[2] > 22.0, "a positive rotation turns the tip up");
    assert!(of(1, 1, "gamma") != of(1, 0, "gamma"));
    let volume = |stage| of(0, stage, "volume_total");
    assert!(
        volume(2) < 0.97 * volume(0),
        "{} of {}",
        volume(2),
        volume(0)
    );
    assert_eq!(of(0, 0, "jacobian_min"), 1.0);
    assert_eq!(of(0, 0, "displacement_max"), 0.0);
    assert!((2.0 * SPACING..4.0 * SPACING).contains(&of(0, 1, "displacement_max")));
}

#[test]
fn the_table_for_people_has_a_column_for_each_stage() {
    let desk = ran();
    let table = std::fs::read_to_string(desk.path().join("out/good/table.md")).unwrap();
    assert!(table.starts_with("# good\n"));
    assert!(
        table.contains("\n## Straight \\| small (`both`)\n"),
        "{table}"
    );
    assert!(
        table.contains("\n|  | preoperative | move | reduce |\n|---|---:|---:|---:|\n"),
        "{table}"
    );
    assert!(
        table.contains("\n|  | preoperative → move | move → reduce |\n"),
        "{table}"
    );
    assert!(
        table.contains("\n| Nose tip (voxel) | (32, 16, 22) | (34, 16, 22) | (34, 18, 22) |\n")
    );
    assert!(
        table.contains("\n| V (voxel) | (2, 0, 0) | (0, 2, 0) |\n"),
        "{table}"
    );
    assert!(
        table.contains("\n| Height h (mm) | 24.00 | 24.00 | 21.00 |\n"),
        "{table}"
    );
    for row in ('A'..='K').map(|region| format!("\n| Volume {region} (mm³) |")) {
        assert_eq!(table.matches(&row).count(), 2, "{row} for each candidate");
    }
    for block in table.split("\n\n").filter(|block| block.starts_with('|')) {
        let columns: Vec<_> = block
            .lines()
            .map(|line| line.matches('|').count())
            .collect();
        assert!(columns.iter().all(|n| *n == columns[0]), "{block}");
    }
}

#[test]
fn volumes_overlay_the_ct_and_fields_are_what_itk_reads() {
    let desk = ran();
    let ct = read(&desk.path().join("data/ct.nii.gz")).unwrap();
    let AnyVolume::I16(before) = &ct.volume else {
        panic!("the head is int16");
    };
    for stage in ["both/01-move", "both/02-reduce", "up/01-rotate"] {
        let folder = desk.path().join("out/good").join(stage);
        let path = folder.join("volume.nii.gz");
        let template = read_header(&path).unwrap();
        assert_eq!(template.orientation().to_string(), "LPS");
        let scan = read(&path).unwrap();
        assert_eq!(scan.volume.grid(), ct.volume.grid());
        let AnyVolume::I16(after) = &scan.volume else {
            panic!("{stage}: not int16");
        };
        let changed = before
            .as_slice()
            .iter()
            .zip(after.as_slice())
            .filter(|(a, b)| a != b)
            .count();
        assert!(
            (1000..DIMS[0] * DIMS[1] * DIMS[2] / 2).contains(&changed),
            "{stage}: {changed}"
        );

        let packed = std::fs::read(folder.join("displacement.nii.gz")).unwrap();
        let mut field = Vec::new();
        let mut stream = flate2::read::MultiGzDecoder::new(&packed[..]);
        std::io::Read::read_to_end(&mut stream, &mut field).unwrap();
        let i16_at = |at: usize| i16::from_le_bytes([field[at], field[at + 1]]);
        let dim: Vec<_> = (0..6).map(|n| i16_at(40 + 2 * n)).collect();
        assert_eq!(dim, [5, 64, 64, 48, 1, 3]);
        assert_eq!(i16_at(68), 1007);
        assert_eq!(i16_at(70), 16, "float32");
        assert_eq!(field.len(), 352 + 4 * 3 * DIMS.iter().product::<usize>());
        let largest = field[352..]
            .chunks_exact(4)
            .map(|four| f32::from_le_bytes(four.try_into().unwrap()).abs())
            .fold(0.0, f32::max);
        assert!((1.0..10.0).contains(&largest), "{stage}: {largest} mm");
    }
}

#[test]
fn timings_are_of_the_steps_that_a_dry_run_lists() {
    let variants = [
        "",
        "[morph]\ncompare_exact = true\n",
        "[morph]\nscale = \"half\"\n",
        "[morph]\nmodel = \"lee2001\"\nscale = \"half\"\n",
        "[morph]\nmodel = \"lee2001\"\nmethod = \"exact\"\n",
    ];
    for more in variants {
        assert_timings_are_of_the_steps(&(plan("good", "ct.nii") + more));
    }
    assert_timings_are_of_the_steps(&picture_plan("good", "ct.nii"));
}

fn assert_timings_are_of_the_steps(plan: &str) {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", plan);
    let ran = desk
        .run(&["run", "--dry-run", "plan.toml", "--json"])
        .expect(0);
    assert_eq!(
        names(&desk.files("")),
        ["ct.nii", "plan.toml"],
        "nothing is computed"
    );
    let document = ran.document();
    let steps = document["plans"][0]["steps"].as_array().unwrap();
    desk.run(&["run", "plan.toml"]).expect(0);
    let timings = desk.json("out/good/timings.json");
    let phases = timings["phases"].as_array().unwrap();
    assert_eq!(phases.len(), steps.len(), "{plan}");
    let mut sum = 0.0;
    for (phase, step) in phases.iter().zip(steps) {
        assert_eq!(phase["phase"], step["phase"], "{plan}");
        assert_eq!(phase["candidate"], step["at"]["candidate"], "{plan}");
        assert_eq!(phase["stage"], step["at"]["stage"], "{plan}");
        sum += phase["seconds"].as_f64().unwrap();
    }
    let total = timings["total_seconds"].as_f64().unwrap();
    assert!(0.0 < sum && sum <= total, "{sum} of {total} s");
}
