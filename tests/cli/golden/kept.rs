//! What is kept, and how it is replaced.

use std::fs;

use super::{bless, blessed, verify, with_all, with_numbers};
use crate::head::{FAILS_LATE, PATIENT, gzip, nifti_with_names, plan_head};
use crate::process::{Desk, names};

#[test]
fn numbers_small_pictures_and_hashes_are_kept() {
    let desk = blessed(&with_all("good"));
    let files = desk.files("golden");
    let found = names(&files);
    assert!(found.contains(&"golden.toml") && found.contains(&"good/golden.json"));
    for kept in [
        "good/preoperative/view-frontal.png",
        "good/both/01-move/change-frontal.png",
        "good/up/01-rotate/slice-sagittal.png",
        "good/up/profile.png",
        "good/volumes.png",
    ] {
        let picture = image::load_from_memory(&files[kept]).unwrap().to_rgb8();
        let longest = picture.width().max(picture.height());
        assert!((64..=256).contains(&longest), "{kept}: {longest}");
    }
    // Nothing large, and nothing that is made of what is there.
    for name in &found {
        assert!(
            !name.ends_with(".nii.gz") && !name.ends_with(".nrrd"),
            "{name}"
        );
        assert!(
            !name.contains("pair-") && !name.contains("contact-sheet"),
            "{name}"
        );
    }
    let stored = desk.json("golden/good/golden.json");
    assert_eq!(stored["format"], 1);
    let numbers = stored["numbers"].as_array().unwrap();
    let table = desk.run(&["run", "plan.toml"]).expect(0);
    assert_eq!(table.err, "");
    let csv = fs::read_to_string(desk.path().join("out/good/measurements.csv")).unwrap();
    for line in csv.lines().skip(1) {
        let [candidate, stage, measure, value, unit] =
            line.split(',').collect::<Vec<_>>().try_into().unwrap();
        let number = numbers.iter().find(|number| {
            number["candidate"] == candidate
                && number["stage"] == stage
                && number["measure"] == measure
        });
        let number = number.unwrap_or_else(|| panic!("{line}"));
        assert_eq!(number["unit"], unit, "{line}");
        let value: f64 = value.parse().unwrap();
        assert!(
            (number["value"].as_f64().unwrap() - value).abs() <= 1e-9 * value.abs(),
            "{line}"
        );
    }
    for (stage, measure) in [
        ("against up", "surface_p95"),
        ("move", "surface_outward_max"),
    ] {
        let is_there =
            |number: &serde_json::Value| number["stage"] == stage && number["measure"] == measure;
        assert!(numbers.iter().any(is_there), "{measure}");
    }
    assert_eq!(stored["volumes"].as_object().unwrap().len(), 9);
}

#[test]
fn the_same_is_kept_again_byte_for_byte() {
    let desk = blessed(&with_all("good"));
    let before = desk.files("golden");
    bless(&desk).expect(0);
    assert!(before == desk.files("golden"));
    desk.run(&["bless", "plan.toml", "--golden", "one", "--threads", "1"])
        .expect(0);
    assert!(before == desk.files("one"));
}

#[test]
fn golden_toml_is_the_users() {
    let desk = blessed(&with_numbers("good"));
    let written = fs::read_to_string(desk.path().join("golden/golden.toml")).unwrap();
    assert!(written.starts_with("# How far the results"), "{written}");
    desk.write("golden/golden.toml", "# mine\n");
    bless(&desk).expect(0);
    let left = fs::read_to_string(desk.path().join("golden/golden.toml")).unwrap();
    assert_eq!(left, "# mine\n");
}

#[test]
fn a_smaller_picture_is_kept_where_that_is_asked_for() {
    let desk = blessed(&with_all("good"));
    // Of those that are kept already it says nothing.
    desk.write("golden/golden.toml", "[pictures]\nside = 100\n");
    verify(&desk, &[]).expect(0);
    bless(&desk).expect(0);
    let view = &desk.files("golden")["good/both/01-move/view-frontal.png"];
    let view = image::load_from_memory(view).unwrap();
    assert_eq!(view.width().max(view.height()), 100);
    verify(&desk, &[]).expect(0);
}

#[test]
fn what_a_plan_no_longer_gives_is_removed() {
    let fewer = with_all("good").replace("\"slices\", ", "");
    let fresh = blessed(&fewer).files("golden");
    for has_list in [true, false] {
        let desk = blessed(&with_all("good"));
        if !has_list {
            // A copy of the folder without hidden files.
            fs::remove_file(desk.path().join("golden/good/.rhinoplan.files")).unwrap();
        }
        desk.write("plan.toml", &fewer);
        bless(&desk).expect(0);
        let now = desk.files("golden");
        assert!(fresh == now, "{:?}", names(&now));
    }
    // With a candidate, its folder goes.
    let desk = blessed(&with_all("good"));
    let (before, after) = with_all("good")
        .split_once("[[candidate]]\nname = \"up\"")
        .map(|(before, after)| {
            (
                before.to_owned(),
                after.split_once("[outputs]").unwrap().1.to_owned(),
            )
        })
        .unwrap();
    desk.write("plan.toml", format!("{before}[outputs]{after}"));
    bless(&desk).expect(0);
    assert!(!desk.path().join("golden/good/up").exists());
    verify(&desk, &[]).expect(0);
}

#[test]
fn a_bless_that_fails_leaves_what_was_kept() {
    let desk = blessed(&with_all("good"));
    let before = desk.files("golden");
    // Found while it runs; the plan after it is kept all the same.
    desk.write("plan.toml", plan_head("good", "ct.nii.gz") + FAILS_LATE);
    desk.write("other.toml", with_numbers("other"));
    let ran = desk
        .run(&["bless", "plan.toml", "other.toml", "--golden", "golden"])
        .expect(3);
    assert!(
        ran.err.contains("what was kept before is unchanged"),
        "{ran:?}"
    );
    assert!(ran.out.starts_with("golden/other (119 numbers"), "{ran:?}");
    let mut after = desk.files("golden");
    after.retain(|name, _| !name.starts_with("other/"));
    assert!(before == after);
    // Found while it is put in place.
    let blocked = desk.path().join("golden/good/up/profile.png");
    fs::remove_file(&blocked).unwrap();
    fs::create_dir(&blocked).unwrap();
    let before = desk.files("golden/good");
    desk.write(
        "plan.toml",
        with_all("good").replace("[2, 0, 0]", "[3, 0, 0]"),
    );
    let ran = bless(&desk).expect(2);
    assert!(ran.err.contains("a folder has this name"), "{ran:?}");
    assert!(before == desk.files("golden/good"));
}

#[test]
fn folders_are_not_mixed() {
    let desk = blessed(&with_numbers("good"));
    desk.run(&["run", "plan.toml"]).expect(0);
    let run = desk.files("out");
    let ran = desk
        .run(&["bless", "plan.toml", "--golden", "out"])
        .expect(2);
    assert!(
        ran.err.contains("`out/good` is the folder of a run"),
        "{ran:?}"
    );
    assert!(run == desk.files("out"));
    // A run that would make it one.
    let ran = desk
        .run(&["bless", "plan.toml", "--golden", "new", "--out", "new"])
        .expect(2);
    assert!(ran.err.contains("is the folder of a run"), "{ran:?}");
    assert!(!desk.path().join("new/good/golden.json").exists());
    let golden = desk.files("golden");
    for folder in ["golden", "golden/good"] {
        let ran = verify(&desk, &["--report", folder]).expect(2);
        assert!(ran.err.contains("holds goldens"), "{ran:?}");
    }
    verify(&desk, &["--report", "out/good"]).expect(2);
    assert!(golden == desk.files("golden") && run == desk.files("out"));
}

#[test]
fn nothing_names_the_patient_the_machine_or_the_file() {
    let desk = Desk::new();
    desk.write("scans/doe-jane.nii.gz", gzip(&nifti_with_names()));
    let of = |by: &str| {
        let text = with_all("good").replace("ct.nii.gz", "scans/doe-jane.nii.gz");
        text.replace("title = \"Straight | small\"", "title = \"For Jane Doe\"")
            .replace("[2, 0, 0]", by)
    };
    desk.write("doe-plan.toml", of("[2, 0, 0]"));
    // As it is for whoever wants to see a difference in volumes too.
    desk.write("golden/golden.toml", "[volumes]\ncompare = \"voxels\"\n");
    desk.run(&["bless", "doe-plan.toml", "--golden", "golden"])
        .expect(0);
    desk.write("doe-plan.toml", of("[3, 0, 0]"));
    desk.run(&["verify", "doe-plan.toml", "--golden", "golden"])
        .expect(5);
    let mut files = desk.files("golden");
    assert!(files.keys().any(|name| name.ends_with("volume.nii.gz")));
    files.extend(desk.files("golden-report"));
    let folder = desk.path().to_str().unwrap().to_owned();
    for (name, bytes) in &files {
        let text = String::from_utf8_lossy(bytes);
        for word in [PATIENT, "Jane", "doe", &folder] {
            assert!(!text.contains(word), "{name}: {word}");
        }
        assert!(!name.contains("doe"), "{name}");
    }
}
