//! Landmarks from 3D Slicer: in a plan, and printed for one.

use std::fs;

use serde_json::Value;

use crate::head::{CANDIDATES, DIMS, SPACING, nifti, plan, put_sform};
use crate::process::{Desk, Ran};
use crate::real_data;

/// Voxels of the landmarks of the small head's plans.
const VOXELS: [(&str, [f64; 3]); 6] = [
    ("nasal_bones", [32.0, 30.0, 36.0]),
    ("lip", [32.0, 30.0, 12.0]),
    ("alare_right", [22.0, 28.0, 20.0]),
    ("alare_left", [42.0, 28.0, 20.0]),
    ("tip", [32.0, 16.0, 22.0]),
    ("maxilla", [32.0, 32.0, 20.0]),
];

/// The small head's first voxel is at LPS (-48, -48, -36).
fn lps([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x * SPACING - 48.0, y * SPACING - 48.0, z * SPACING - 36.0]
}

fn json(system: &str, turn: f64) -> String {
    let points = VOXELS.map(|(name, voxel)| {
        let [x, y, z] = lps(voxel);
        let at = [turn * x, turn * y, z];
        format!("{{\"label\": \"{name}\", \"position\": {at:?}}}")
    });
    format!(
        "{{\"markups\": [{{\"coordinateSystem\": \"{system}\", \"controlPoints\": [{}]}}]}}",
        points.join(",\r\n")
    )
}

fn fcsv(system: &str, turn: f64) -> String {
    let rows = VOXELS.map(|(name, voxel)| {
        let [x, y, z] = lps(voxel);
        format!("1,{},{},{z},0,0,0,1,1,1,0,{name},,\n", turn * x, turn * y)
    });
    format!("# CoordinateSystem = {system}\n{}", rows.concat())
}

fn plan_with_file(name: &str, file: &str) -> String {
    format!(
        "plan = 1\nname = \"{name}\"\n\n[ct]\npath = \"../ct.nii\"\n\n[landmarks]\nfile = \"{file}\"\n\n\
         {CANDIDATES}"
    )
}

/// Every form of the file gives the run that the points in the plan give, and nothing but its digest is kept.
#[test]
fn a_file_is_as_good_as_points_in_the_plan() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plans/points.toml", plan("points", "../ct.nii"));
    desk.run(&["run", "plans/points.toml"]).expect(0);
    let expected = desk.json("out/points/run.json");
    assert_eq!(expected["inputs"].get("landmarks_sha256"), None);
    for (name, content) in [
        ("lps.mrk.json", json("LPS", 1.0)),
        ("ras.mrk.json", json("RAS", -1.0)),
        ("lps.fcsv", fcsv("LPS", 1.0)),
        ("zero.fcsv", fcsv("0", -1.0)),
        ("one.fcsv", fcsv("1", 1.0)),
    ] {
        desk.write(&format!("plans/jane-doe/{name}"), content);
        let text = plan_with_file("points", &format!("jane-doe/{name}"));
        desk.write("plans/file.toml", text);
        desk.run(&["check", "plans/file.toml"]).expect(0);
        desk.run(&["run", "plans/file.toml"]).expect(0);
        let mut found = desk.json("out/points/run.json");
        let digest = found["inputs"]
            .as_object_mut()
            .unwrap()
            .remove("landmarks_sha256");
        assert_eq!(digest.unwrap().as_str().unwrap().len(), 64);
        found["inputs"]["plan_sha256"] = expected["inputs"]["plan_sha256"].clone();
        assert_eq!(found, expected, "{name}");
        for (file, bytes) in desk.files("out/points") {
            let text = String::from_utf8_lossy(&bytes);
            assert!(!text.contains("jane") && !text.contains(name), "{file}");
        }
    }
}

#[test]
fn faults_of_the_file_are_faults_of_the_plan() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plans/broken.toml", plan_with_file("broken", "a.fcsv"));
    desk.write("plans/a.fcsv", fcsv("2", 1.0));
    let ran = desk
        .run(&["check", "plans/broken.toml", "--json"])
        .expect(2);
    let error = ran.document()["errors"][0].clone();
    assert_eq!(error["code"], "landmark-file");
    assert_eq!((&error["line"], &error["column"]), (&8.into(), &8.into()));
    let message = error["message"].as_str().unwrap();
    assert!(message.contains("plans/a.fcsv"), "{message}");
    assert!(message.contains("`CoordinateSystem` as `2`"), "{message}");
    // The wrong frame: every point is judged, and the remedy said.
    desk.write("plans/a.fcsv", fcsv("RAS", 1.0));
    let ran = desk.run(&["check", "plans/broken.toml"]).expect(2);
    let hint = "if the file's numbers were in LPS every landmark would be in the volume";
    assert!(ran.err.contains(hint), "{}", ran.err);
}

fn printed(desk: &Desk, file: &str) -> Ran {
    desk.run(&["landmarks", file, "--ct", "ct.nii"]).expect(0)
}

#[test]
fn what_is_printed_is_the_table_of_a_plan() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("a.mrk.json", json("RAS", -1.0));
    let ran = printed(&desk, "a.mrk.json");
    assert_eq!(ran.err, "");
    assert_eq!(
        ran.out,
        "[landmarks]\n\
         frame = \"voxel\"\n\
         nasal_bones = [32.000, 30.000, 36.000]  # LPS mm: 0.000, -3.000, 18.000\n\
         lip         = [32.000, 30.000, 12.000]  # LPS mm: 0.000, -3.000, -18.000\n\
         alare_right = [22.000, 28.000, 20.000]  # LPS mm: -15.000, -6.000, -6.000\n\
         alare_left  = [42.000, 28.000, 20.000]  # LPS mm: 15.000, -6.000, -6.000\n\
         tip         = [32.000, 16.000, 22.000]  # LPS mm: 0.000, -24.000, -3.000\n\
         maxilla     = [32.000, 32.000, 20.000]  # LPS mm: 0.000, 0.000, -6.000\n"
    );
    let text = format!(
        "plan = 1\nname = \"pasted\"\n[ct]\npath = \"ct.nii\"\n{}{CANDIDATES}",
        ran.out
    );
    desk.write("pasted.toml", text);
    desk.run(&["check", "pasted.toml"]).expect(0);
    let ran = desk.run(&["landmarks", "a.mrk.json", "--ct", "ct.nii", "--json"]);
    let document = ran.expect(0).document()["landmarks"].clone();
    assert_eq!(document["coordinate_system"], "RAS");
    for (name, voxel) in VOXELS {
        assert_eq!(document["voxel"][name], serde_json::json!(voxel));
        assert_eq!(document["lps_mm"][name], serde_json::json!(lps(voxel)));
    }
}

#[test]
fn what_cannot_be_printed() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("a.fcsv", fcsv("LPS", 1.0));
    desk.write("turned.fcsv", fcsv("RAS", 1.0));
    desk.write("empty.fcsv", "");
    fs::create_dir(desk.path().join("folder")).unwrap();
    for (file, ct, code, message) in [
        ("none.fcsv", "ct.nii", 2, "`none.fcsv` cannot be read"),
        ("empty.fcsv", "ct.nii", 2, "`empty.fcsv` is empty"),
        ("folder", "ct.nii", 2, "is a folder, not a file"),
        ("a.fcsv", "none.nii", 3, "none.nii"),
        ("a.fcsv", "a.fcsv", 3, "not a NIfTI-1 file"),
        ("turned.fcsv", "ct.nii", 0, ""),
    ] {
        let ran = desk.run(&["landmarks", file, "--ct", ct]).expect(code);
        assert!(ran.err.contains(message), "{}", ran.err);
        assert_eq!(ran.out.is_empty(), code != 0);
    }
    // A CT that is somewhere else.
    let mut far = nifti();
    put_sform(
        &mut far,
        [
            [-1.5, 0.0, 0.0, 48.0],
            [0.0, -1.5, 0.0, 48.0],
            [0.0, 0.0, 1.5, 64.0],
        ],
    );
    desk.write("far.nii", far);
    let ran = desk
        .run(&["landmarks", "a.fcsv", "--ct", "far.nii"])
        .expect(2);
    assert!(
        ran.err.contains("`lip` at voxel (32.0, 30.0, -54.7)"),
        "{}",
        ran.err
    );
    assert!(ran.err.contains("(0, 0, 0) to (63, 63, 47)"), "{}", ran.err);
    assert_eq!(DIMS, [64, 64, 48]);
    desk.run(&["landmarks", "a.fcsv"]).expect(2);
}

/// How far the voxels of real markups may be from the whole numbers that they were placed at: the files
/// give mm to four decimals.
const WRITTEN_TO_VOXEL: f64 = 0.01;

#[test]
fn real_markups_are_where_the_voxels_are() {
    let heads = [
        (
            "cranium",
            [
                [129, 39, 46],
                [130, 26, 4],
                [111, 33, 19],
                [148, 33, 19],
                [128, 12, 24],
                [111, 41, 18],
            ],
        ),
        (
            "headphantom",
            [
                [118, 44, 77],
                [117, 25, 38],
                [98, 36, 50],
                [138, 36, 50],
                [117, 15, 53],
                [96, 40, 49],
            ],
        ),
    ];
    for (name, voxels) in heads {
        let [file, ct] =
            ["mrk.json", "nii.gz"].map(|end| real_data::path(&format!("{name}.{end}")));
        let (Some(file), Some(ct)) = (file, ct) else {
            continue;
        };
        let desk = Desk::new();
        let args = [
            "landmarks",
            file.to_str().unwrap(),
            "--ct",
            ct.to_str().unwrap(),
            "--json",
        ];
        let document = desk.run(&args).expect(0).document();
        let mut furthest = 0.0_f64;
        for ((landmark, _), expected) in VOXELS.iter().zip(voxels) {
            let found: &Value = &document["landmarks"]["voxel"][landmark];
            for (axis, expected) in expected.into_iter().enumerate() {
                let off = found[axis].as_f64().unwrap() - f64::from(expected);
                furthest = furthest.max(off.abs());
            }
        }
        assert!(furthest < WRITTEN_TO_VOXEL, "{name}: {furthest} voxels off");
    }
}
