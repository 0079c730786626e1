//! What an earlier run of a changed plan wrote does not stay and look like a result of this one.

use std::fs;

use crate::head::{nifti, picture_plan, plan};
use crate::process::{Desk, names};

const ALL: &str = "write = [\"volume\", \"nrrd\", \"displacement\", \"inverse\", \"views\", \"slices\", \
                   \"charts\", \"mesh\", \"solids\"]";

fn desk(plan: &str) -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", plan);
    desk
}

fn everything() -> String {
    picture_plan("good", "ct.nii").replace("write = [\"views\", \"slices\", \"charts\"]", ALL)
}

/// What a first run of a plan leaves.
fn fresh(plan: &str) -> std::collections::BTreeMap<String, Vec<u8>> {
    let desk = desk(plan);
    desk.run(&["run", "plan.toml"]).expect(0);
    desk.results("out/good")
}

#[test]
fn files_of_every_kind_go_away_with_the_plan_that_asked_for_them() {
    let desk = desk(&everything());
    desk.run(&["run", "plan.toml"]).expect(0);
    let before = desk.results("out/good");
    for kind in [
        "volume.nii.gz",
        ".nrrd",
        "displacement.nii.gz",
        "displacement-inverse.nii.gz",
        "view-frontal.png",
        "slice-axial.png",
        "profile.svg",
        "skin.stl",
        "skin.ply",
        "augmentation.stl",
    ] {
        assert!(before.keys().any(|name| name.ends_with(kind)), "{kind}");
    }
    let text = plan("good", "ct.nii");
    let (tables, _) = text.split_once("[outputs]").unwrap();
    desk.write("plan.toml", tables);
    let ran = desk.run(&["run", "plan.toml"]).expect(0);
    let expected = fresh(tables);
    assert_eq!(names(&desk.results("out/good")), names(&expected));
    assert!(desk.results("out/good") == expected);
    let gone = before.len() - expected.len();
    let told = format!("removed {gone} files of an earlier run, which this plan does not write");
    assert!(gone > 50 && ran.out.contains(&told), "{gone}: {ran:?}");
}

#[test]
fn stages_and_candidates_that_are_no_longer_in_the_plan_go_away() {
    let desk = desk(&plan("good", "ct.nii"));
    desk.run(&["run", "plan.toml"]).expect(0);
    let text = plan("good", "ct.nii")
        .replace("name = \"reduce\"", "name = \"less\"")
        .replace("name = \"up\"", "name = \"high\"");
    desk.write("plan.toml", &text);
    let document = desk
        .run(&["run", "plan.toml", "--json"])
        .expect(0)
        .document();
    assert!(desk.results("out/good") == fresh(&text));
    assert_eq!(
        document["runs"][0]["removed"],
        serde_json::json!([
            "both/02-reduce/displacement.nii.gz",
            "both/02-reduce/volume.nii.gz",
            "up/01-rotate/displacement.nii.gz",
            "up/01-rotate/volume.nii.gz",
        ])
    );
    let document = desk
        .run(&["run", "plan.toml", "--json"])
        .expect(0)
        .document();
    assert_eq!(document["runs"][0]["removed"], serde_json::json!([]));
}

#[test]
fn what_the_user_made_or_changed_stays_and_what_was_changed_is_told() {
    let desk = desk(&plan("good", "ct.nii"));
    desk.run(&["run", "plan.toml"]).expect(0);
    desk.write("out/good/up/01-rotate/volume.nii.gz", "repainted");
    desk.write("out/good/up/notes.txt", "mine");
    desk.write(
        "plan.toml",
        plan("good", "ct.nii").replace("name = \"up\"", "name = \"high\""),
    );
    let ran = desk.run(&["run", "plan.toml"]).expect(0);
    let told = "`out/good/up/01-rotate/volume.nii.gz` is of an earlier run";
    assert!(ran.err.contains(told), "{ran:?}");
    let files = desk.files("out/good/up");
    assert_eq!(names(&files), ["01-rotate/volume.nii.gz", "notes.txt"]);
    assert_eq!(files["notes.txt"], b"mine");
    let again = desk.run(&["run", "plan.toml"]).expect(0);
    assert_eq!(again.err, "");
    assert!(
        again.out.ends_with("0 done, 2 kept, 0 failed\n"),
        "{again:?}"
    );
    assert_eq!(desk.files("out/good/up"), files);
}

#[test]
fn a_run_that_fails_removes_nothing() {
    let desk = desk(&plan("good", "ct.nii"));
    desk.run(&["run", "plan.toml"]).expect(0);
    let before = desk.files("out");
    let other = plan("good", "ct.nii").replace("name = \"up\"", "name = \"high\"");
    desk.write("plan.toml", other + "[segment]\nskin_hu = -1001.0\n");
    desk.run(&["run", "plan.toml"]).expect(3);
    assert!(desk.files("out") == before);
}

#[test]
#[cfg(unix)]
fn two_plans_whose_folders_are_one_are_refused() {
    let desk = desk(&plan("good", "ct.nii"));
    desk.write("other.toml", plan("other", "ct.nii"));
    fs::create_dir_all(desk.path().join("out/good")).unwrap();
    std::os::unix::fs::symlink("good", desk.path().join("out/other")).unwrap();
    for command in [&["run"][..], &["run", "--dry-run"]] {
        let args = [command, &["plan.toml", "other.toml"]].concat();
        let ran = desk.run(&args).expect(2);
        assert!(
            ran.err.contains(
                "`out/good` and `out/other`, of plan.toml and other.toml, are the same folder"
            ),
            "{ran:?}"
        );
        assert!(desk.files("out/good").is_empty());
    }
}
