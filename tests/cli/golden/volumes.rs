//! Volumes by their hash, and voxel by voxel.

use super::{bless, blessed, differences, measures, verify, with_volumes};
use crate::head::{DIMS, gzip, nifti, plan};
use crate::process::Desk;

/// Inside the head, far from the nose, where nothing moves.
const DEEP: [usize; 3] = [5, 60, 40];

/// The head with some voxels changed.
fn head_with(voxels: &[([usize; 3], i16)]) -> Vec<u8> {
    let mut bytes = nifti();
    for ([x, y, z], value) in voxels {
        let at = 352 + 2 * (x + DIMS[0] * (y + DIMS[1] * z));
        bytes[at..at + 2].copy_from_slice(&value.to_le_bytes());
    }
    gzip(&bytes)
}

fn settings(desk: &Desk, volumes: &str) {
    desk.write("golden/golden.toml", format!("[volumes]\n{volumes}"));
}

/// Blessed on a head with some voxels changed, its volumes kept.
fn kept_on(voxels: &[([usize; 3], i16)]) -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii.gz", head_with(voxels));
    desk.write("plan.toml", with_volumes("good"));
    settings(&desk, "compare = \"voxels\"\n");
    bless(&desk).expect(0);
    desk
}

const FILES: [&str; 6] = [
    "both/01-move/volume.nii.gz",
    "both/01-move/volume.nrrd",
    "both/02-reduce/volume.nii.gz",
    "both/02-reduce/volume.nrrd",
    "up/01-rotate/volume.nii.gz",
    "up/01-rotate/volume.nrrd",
];

#[test]
fn by_hash_one_voxel_is_enough_and_the_ct_explains_it() {
    let desk = blessed(&with_volumes("good"));
    desk.write("ct.nii.gz", head_with(&[(DEEP, 47)]));
    let found = differences(&desk);
    let names: Vec<_> = measures(&found).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, FILES);
    for row in &found {
        assert_eq!(row["kind"], "volume");
        assert_eq!(row["unit"], "SHA-256 of the samples");
        assert_ne!(row["expected"], row["found"]);
    }
    let ran = verify(&desk, &[]).expect(5);
    assert!(ran.out.contains("  the CT is another: SHA-256 "), "{ran:?}");
    let report = desk.files("golden-report")["report.md"].clone();
    let report = String::from_utf8(report).unwrap();
    assert!(report.contains("- the CT is another: SHA-256 "), "{report}");
}

#[test]
fn a_file_that_is_compressed_otherwise_is_the_same() {
    let desk = blessed(&with_volumes("good"));
    // Another file of the same voxels: its SHA-256 is another, what comes of it is not.
    desk.write("ct.nii.gz", nifti());
    let document = verify(&desk, &["--json"]).expect(0).document();
    let changed = document["plans"][0]["inputs_changed"].as_array().unwrap();
    assert_eq!(changed.len(), 1);
    assert!(
        changed[0]
            .as_str()
            .unwrap()
            .starts_with("the CT is another")
    );
}

#[test]
fn another_position_is_a_difference_of_its_own() {
    let desk = blessed(&with_volumes("good"));
    let mut moved = nifti();
    // The sform's first offset.
    moved[292..296].copy_from_slice(&50.0_f32.to_le_bytes());
    desk.write("ct.nii.gz", gzip(&moved));
    let found = differences(&desk);
    let names: Vec<_> = measures(&found).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, FILES);
    assert!(
        found
            .iter()
            .all(|row| row["unit"] == "SHA-256 of size, type and position")
    );
}

#[test]
fn voxel_by_voxel_within_hu() {
    let desk = kept_on(&[(DEEP, 100)]);
    verify(&desk, &[]).expect(0);
    desk.write("ct.nii.gz", head_with(&[(DEEP, 103)]));
    settings(&desk, "compare = \"voxels\"\nhu = 3\n");
    verify(&desk, &[]).expect(0);
    settings(&desk, "compare = \"voxels\"\nhu = 2.9\n");
    let found = differences(&desk);
    let names: Vec<_> = measures(&found).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, FILES);
    for row in &found {
        assert_eq!(row["unit"], "voxels off by more than 2.9 HU");
        assert_eq!(
            (&row["found"], &row["tolerance"]),
            (&1.0.into(), &0.0.into())
        );
        assert_eq!(row["difference"], "up to 3 HU");
    }
    settings(&desk, "compare = \"voxels\"\nvoxels = 1\n");
    verify(&desk, &[]).expect(0);
    settings(&desk, "compare = \"hash\"\n");
    verify(&desk, &[]).expect(5);
}

#[test]
fn voxel_by_voxel_within_a_radius() {
    let [x, y, z] = DEEP;
    let desk = kept_on(&[(DEEP, 500)]);
    desk.write("ct.nii.gz", head_with(&[([x + 1, y, z - 1], 500)]));
    let near = "compare = \"voxels\"\nhu = 10\n";
    settings(&desk, near);
    let found = differences(&desk);
    assert!(
        measures(&found).iter().all(|(_, count)| **count == 2.0),
        "{found:?}"
    );
    settings(&desk, &format!("{near}radius = 1\n"));
    verify(&desk, &[]).expect(0);
    desk.write("ct.nii.gz", head_with(&[([x + 2, y, z], 500)]));
    assert_eq!(differences(&desk).len(), FILES.len());
    settings(&desk, &format!("{near}radius = 2\n"));
    verify(&desk, &[]).expect(0);
    // Gone, not moved.
    desk.write("ct.nii.gz", head_with(&[]));
    let found = differences(&desk);
    assert!(
        measures(&found).iter().all(|(_, count)| **count == 1.0),
        "{found:?}"
    );
}

#[test]
fn displacements_within_mm() {
    let desk = Desk::new();
    desk.write("ct.nii.gz", gzip(&nifti()));
    let of = |move_mm: &str| {
        let text = plan("good", "ct.nii.gz").replace("\"volume\", ", "");
        text.replace("voxels = [2, 0, 0]", move_mm)
    };
    let lax = "compare = \"voxels\"\nmm = 0.001\n[numbers]\n";
    let units = ["mm3", "mm2", "mm", "deg", "voxel", "1"];
    let lax = lax.to_owned()
        + &units
            .map(|unit| format!("{unit} = {{ absolute = 1 }}\n"))
            .concat();
    settings(&desk, &lax);
    desk.write("plan.toml", of("mm = [3, 0, 0]"));
    bless(&desk).expect(0);
    desk.write("plan.toml", of("mm = [3.0005, 0, 0]"));
    verify(&desk, &[]).expect(0);
    settings(&desk, &lax.replace("mm = 0.001", "mm = 0.0004"));
    let found = differences(&desk);
    let names: Vec<_> = measures(&found).into_iter().map(|(name, _)| name).collect();
    assert_eq!(
        names,
        [
            "both/01-move/displacement.nii.gz",
            "both/02-reduce/displacement.nii.gz"
        ]
    );
    assert_eq!(found[0]["unit"], "components off by more than 0.0004 mm");
    settings(&desk, &lax.replace("\"voxels\"", "\"hash\""));
    assert_eq!(differences(&desk)[0]["unit"], "SHA-256 of the samples");
}

#[test]
fn voxels_that_were_not_kept_cannot_be_compared() {
    let desk = blessed(&with_volumes("good"));
    settings(&desk, "compare = \"voxels\"\n");
    let ran = verify(&desk, &[]).expect(2);
    assert!(
        ran.err
            .contains("`bless` again, or set `volumes.compare` to \"hash\""),
        "{ran:?}"
    );
    bless(&desk).expect(0);
    verify(&desk, &[]).expect(0);
    assert!(
        desk.files("golden")
            .contains_key("good/both/01-move/volume.nrrd")
    );
    settings(&desk, "");
    bless(&desk).expect(0);
    assert!(
        !desk
            .files("golden")
            .contains_key("good/both/01-move/volume.nrrd")
    );
}
