//! A run that fails leaves everything as it was.

use std::fs;

use crate::head::{CANDIDATES, FAILS_LATE, gzip, nifti, plan, plan_head};
use crate::process::Desk;

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", plan("good", "ct.nii"));
    desk
}

/// The first candidate can be computed and its volumes are written before the last fails.
fn fails_late() -> String {
    let (candidates, outputs) = CANDIDATES.split_once("[outputs]").unwrap();
    plan_head("good", "ct.nii") + candidates + FAILS_LATE + "[outputs]" + outputs
}

#[test]
fn a_run_that_fails_late_leaves_an_earlier_one_whole() {
    let desk = desk();
    desk.run(&["run", "plan.toml"]).expect(0);
    let before = desk.files("");
    assert_eq!(before.len(), 2 + 9 + 3 * 2);
    for (text, message) in [
        (
            fails_late(),
            "candidate `impossible`, stage `fold`: the nose cannot be measured: gamma",
        ),
        (
            plan("good", "ct.nii") + "[segment]\nskin_hu = -1001.0\n",
            "the CT holds no air, so it has no skin: -1000 to 50 HU",
        ),
    ] {
        desk.write("plan.toml", text);
        let ran = desk.run(&["run", "plan.toml"]).expect(3);
        assert!(ran.err.contains(message), "{ran:?}");
        assert!(
            ran.err.contains("what earlier runs wrote is unchanged"),
            "{ran:?}"
        );
        desk.write("plan.toml", &before["plan.toml"]);
        assert!(desk.files("") == before);
    }
}

#[test]
fn a_ct_that_breaks_leaves_an_earlier_run_whole() {
    let desk = desk();
    desk.write("ct.nii", gzip(&nifti()));
    desk.run(&["run", "plan.toml"]).expect(0);
    let before = desk.files("out");
    let mut broken = gzip(&nifti());
    let last = broken.len() - 6;
    broken[last] ^= 1;
    desk.write("ct.nii", broken);
    desk.run(&["run", "plan.toml"]).expect(3);
    assert!(desk.files("out") == before);
}

#[test]
fn a_stage_folder_that_cannot_be_made_is_found_before_anything_is_replaced() {
    let desk = desk();
    desk.run(&["run", "plan.toml"]).expect(0);
    // What stands where the last stage's folder is to be, or in place of one of its files.
    for (obstacle, blocks) in [
        ("out/good/up/01-rotate", "is not a folder"),
        ("out/good/run.json/x", "a folder has this name"),
    ] {
        let blocker = obstacle.trim_end_matches("/x");
        let blocker = desk.path().join(blocker);
        let kept = desk.path().join("kept");
        fs::rename(&blocker, &kept).unwrap();
        desk.write(obstacle, "mine");
        // Different results, so that a file that is replaced is seen.
        let text = plan("good", "ct.nii").replace("[2, 0, 0]", "[3, 0, 0]");
        desk.write("plan.toml", text);
        let before = desk.files("");
        let ran = desk.run(&["run", "plan.toml"]).expect(2);
        assert!(ran.err.contains(blocks), "{ran:?}");
        assert!(
            !ran.err.contains(".rhinoplan-"),
            "a name nobody knows: {ran:?}"
        );
        assert!(desk.files("") == before);
        if blocker.is_dir() {
            fs::remove_dir_all(&blocker).unwrap();
        } else {
            fs::remove_file(&blocker).unwrap();
        }
        fs::rename(&kept, &blocker).unwrap();
    }
}

#[test]
fn a_first_run_that_fails_leaves_no_folder() {
    let desk = desk();
    desk.write("plan.toml", fails_late());
    let before = desk.files("");
    desk.run(&["run", "plan.toml", "--out", "a/b"]).expect(3);
    assert!(desk.files("") == before);
}

#[test]
fn a_later_success_replaces_what_was_there() {
    let desk = desk();
    desk.run(&["run", "plan.toml"]).expect(0);
    let first = desk.results("out/good");
    let text = plan("good", "ct.nii").replace("rotate = 5", "rotate = 6");
    desk.write("plan.toml", text);
    desk.run(&["run", "plan.toml"]).expect(0);
    let second = desk.results("out/good");
    assert!(first.keys().eq(second.keys()));
    for (name, content) in &first {
        assert_eq!(
            second[name] == *content,
            name.starts_with("both/"),
            "{name}"
        );
    }
}
