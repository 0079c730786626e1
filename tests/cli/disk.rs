//! A disk that is full. A limit on the size of files stands for it: it fails writes in the middle, in any phase,
//! and needs no rights.

#![cfg(unix)]

use std::collections::BTreeMap;

use crate::head::{nifti, picture_plan, plan};
use crate::process::{Desk, names};

/// What `ulimit -f` counts in.
const BLOCK: usize = 512;

type Files = BTreeMap<String, Vec<u8>>;

fn desk(plan: &str) -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", plan);
    desk
}

fn changed(plan: &str) -> String {
    plan.replace("[2, 0, 0]", "[3, 0, 0]")
}

fn fresh(plan: &str) -> Files {
    let desk = desk(plan);
    desk.run(&["run", "plan.toml"]).expect(0);
    desk.results("out/good")
}

/// With room for files of so many blocks only, the changed plan of a desk fails for `fails`, and leaves
/// everything as it was.
#[track_caller]
fn assert_fails_whole(desk: &Desk, blocks: usize, fails: &str) {
    let before = desk.files("");
    // The signal is ignored, so that writing fails, as it does on a full disk.
    let limit = format!("trap '' XFSZ; ulimit -f {blocks}");
    let ran = desk.run_after(&limit, &["run", "plan.toml"]).expect(2);
    let told = format!("cannot write `out/good/{fails}`: ");
    assert!(ran.err.contains(&told), "{blocks} blocks, {fails}: {ran:?}");
    assert!(
        ran.err.contains("; raise the limit on the size of a file"),
        "{ran:?}"
    );
    assert_eq!(ran.err.matches("error: ").count(), 1, "{ran:?}");
    assert!(
        ran.out.is_empty() && !ran.err.contains(".rhinoplan"),
        "{ran:?}"
    );
    assert!(
        desk.files("") == before,
        "{blocks} blocks: {:?}",
        names(&desk.files(""))
    );
}

/// Runs `first`, then `second` with room for `blocks` only, and then with as much as it needs.
fn assert_survives(first: &str, second: &str, limits: &[(usize, &str)], expected: &Files) {
    let desk = desk(first);
    desk.run(&["run", "plan.toml"]).expect(0);
    desk.write("plan.toml", second);
    for (blocks, fails) in limits {
        assert_fails_whole(&desk, *blocks, fails);
    }
    desk.run(&["run", "plan.toml"]).expect(0);
    assert!(desk.results("out/good") == *expected);
}

/// The first file, in the order in which they are written, that is larger than so many blocks.
fn first_too_large<'a>(files: &Files, order: &[&'a str], blocks: usize) -> Option<&'a str> {
    order
        .iter()
        .copied()
        .find(|name| files[*name].len() > blocks * BLOCK)
}

#[test]
fn every_file_that_does_not_fit_ends_the_run_and_nothing_changes() {
    let volumes = plan("good", "ct.nii");
    let (tables, _) = volumes.split_once("[outputs]").unwrap();
    let last = [
        "measurements.csv",
        "table.md",
        "compare.csv",
        "compare.json",
        "compare.md",
        "plan.effective.toml",
        "run.json",
    ];
    let stages = ["both/01-move", "both/02-reduce", "up/01-rotate"];
    let in_stages: Vec<_> = stages
        .iter()
        .flat_map(|stage| ["volume", "displacement"].map(|what| format!("{stage}/{what}.nii.gz")))
        .collect();
    let with_volumes: Vec<_> = in_stages.iter().map(String::as_str).chain(last).collect();
    for (text, order) in [(tables, &last[..]), (&volumes, &with_volumes)] {
        let second = changed(text);
        let expected = fresh(&second);
        // Just too little for each file.
        let mut limits: Vec<_> = order
            .iter()
            .map(|name| (expected[*name].len() - 1) / BLOCK)
            .filter_map(|blocks| Some((blocks, first_too_large(&expected, order, blocks)?)))
            .collect();
        limits.dedup();
        let mut failing: Vec<_> = limits.iter().map(|(_, fails)| *fails).collect();
        failing.sort_unstable();
        failing.dedup();
        assert!(failing.len() >= 2, "{limits:?}");
        assert_survives(text, &second, &limits, &expected);
    }
}

#[test]
fn what_cannot_be_written_at_all_is_told_in_every_phase() {
    let pictures = picture_plan("good", "ct.nii");
    for (write, fails) in [
        ("nrrd", "both/01-move/volume.nrrd"),
        ("inverse", "both/01-move/displacement-inverse.nii.gz"),
        ("views", "preoperative/view-frontal.png"),
        ("slices", "both/01-move/slice-sagittal.png"),
        ("charts", "both/profile.svg"),
        ("mesh", "preoperative/bone.stl"),
        ("solids", "both/01-move/augmentation.stl"),
    ] {
        let only = format!("write = [\"{write}\"]");
        let mut text = pictures.replace("write = [\"views\", \"slices\", \"charts\"]", &only);
        if write != "views" {
            text.truncate(text.find("[views]").unwrap());
        }
        assert_fails_whole(&desk(&text), 0, fails);
    }
}

/// The signal is not ignored: the process ends as if it were killed.
#[test]
fn a_run_that_the_limit_kills_leaves_nothing_under_a_final_name() {
    let first = plan("good", "ct.nii");
    let second = changed(&first);
    let desk = desk(&first);
    desk.run(&["run", "plan.toml"]).expect(0);
    let before = desk.files("out/good");
    desk.write("plan.toml", &second);
    for blocks in [0, 20] {
        let limit = format!("ulimit -c 0; ulimit -f {blocks}");
        desk.run_after(&limit, &["run", "plan.toml"]).expect(-1);
        let mut after = desk.files("out/good");
        after.retain(|name, _| before.contains_key(name) || !name.starts_with(".rhinoplan"));
        assert!(after == before);
    }
    desk.run(&["run", "plan.toml"]).expect(0);
    assert!(desk.results("out/good") == fresh(&second));
}

#[test]
fn the_phantom_is_written_whole_or_not_at_all() {
    let desk = Desk::new();
    desk.write("head.nii", "mine");
    let limit = "trap '' XFSZ; ulimit -f 64";
    let ran = desk
        .run_after(limit, &["phantom", "-o", "head.nii"])
        .expect(2);
    assert!(ran.err.contains("cannot write `head.nii`: "), "{ran:?}");
    assert_eq!(names(&desk.files("")), ["head.nii"]);
    assert_eq!(desk.files("")["head.nii"], b"mine");
}
