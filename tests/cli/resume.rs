//! Results of earlier runs: what is kept, what is computed again, and why.

use std::collections::BTreeMap;
use std::fs;
use std::time::SystemTime;

use serde_json::Value;

use crate::head::{CANDIDATES, FAILS_LATE, gzip, nifti, picture_plan, plan, plan_head};
use crate::process::{Desk, Ran};

const ALL_KINDS: &str = "write = [\"views\", \"slices\", \"charts\", \"volume\", \"nrrd\", \"displacement\", \"mesh\", \
                         \"solids\", \"inverse\"]";

fn everything() -> String {
    picture_plan("good", "ct.nii").replace("write = [\"views\", \"slices\", \"charts\"]", ALL_KINDS)
}

fn lee2001(text: &str) -> String {
    text.to_owned() + "\n[morph]\nmodel = \"lee2001\"\nscale = \"half\"\n"
}

fn desk(text: &str) -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", text);
    desk
}

type Files = BTreeMap<String, Vec<u8>>;

/// What a run of a plan gives where nothing was before.
fn fresh(text: &str) -> Files {
    let desk = desk(text);
    desk.run(&["run", "plan.toml"]).expect(0);
    desk.results_and_notes("out/good")
}

/// How many stages of each candidate were computed and kept.
fn counts(ran: &Ran) -> Vec<(u64, u64)> {
    let document = ran.document();
    let candidates = document["runs"][0]["candidates"].as_array().unwrap();
    candidates
        .iter()
        .map(|of| {
            (
                of["computed"].as_u64().unwrap(),
                of["kept"].as_u64().unwrap(),
            )
        })
        .collect()
}

/// Why each stage of the plan would run now; "unchanged" where it would not.
fn reasons(desk: &Desk) -> Vec<String> {
    let ran = desk
        .run(&["run", "plan.toml", "--dry-run", "--json"])
        .expect(0);
    let document = ran.document();
    let steps = document["plans"][0]["steps"].as_array().unwrap().clone();
    let mut stages: Vec<String> = Vec::new();
    for step in steps.iter().filter(|step| step["at"].is_object()) {
        let why = &step["why"];
        assert_eq!(step["runs"], why["because"] != "unchanged");
        let parts = why["parts"].as_array().map(|parts| {
            let parts: Vec<&str> = parts.iter().map(|part| part.as_str().unwrap()).collect();
            parts.join(", ")
        });
        let detail = parts.or(why["file"].as_str().map(str::to_owned));
        let stage = format!(
            "{}: {}{}",
            step["at"]["stage"].as_str().unwrap(),
            why["because"].as_str().unwrap(),
            detail.map_or(String::new(), |detail| format!(": {detail}"))
        );
        if stages.last() != Some(&stage) {
            stages.push(stage);
        }
    }
    stages
}

/// What is changed, into what, what is told of each stage, and how many of each candidate run and are kept.
type Case<'a> = (&'a str, &'a str, [&'a str; 3], [(u64, u64); 2]);

const UNCHANGED: [&str; 3] = ["move: unchanged", "reduce: unchanged", "rotate: unchanged"];

fn modified(desk: &Desk, name: &str) -> SystemTime {
    let path = desk.path().join("out/good").join(name);
    fs::metadata(path).unwrap().modified().unwrap()
}

#[test]
fn what_did_not_change_is_not_computed_again() {
    for text in [everything(), lee2001(&plan("good", "ct.nii"))] {
        let desk = desk(&text);
        let first = desk.run(&["run", "plan.toml", "--json"]).expect(0);
        assert_eq!(counts(&first), [(2, 0), (1, 0)]);
        let before = desk.results_and_notes("out/good");
        let written = modified(&desk, "both/01-move/volume.nii.gz");
        assert_eq!(reasons(&desk), UNCHANGED);
        let second = desk.run(&["run", "plan.toml", "--json"]).expect(0);
        assert_eq!(counts(&second), [(0, 2), (0, 1)]);
        assert!(desk.results_and_notes("out/good") == before);
        assert_eq!(modified(&desk, "both/01-move/volume.nii.gz"), written);
        let phases = desk.json("out/good/timings.json");
        let phases = phases["phases"].as_array().unwrap();
        let phases: Vec<&Value> = phases.iter().map(|of| &of["phase"]).collect();
        assert_eq!(phases, ["read", "landmarks", "publish"]);
        let forced = desk
            .run(&["run", "plan.toml", "--json", "--force"])
            .expect(0);
        assert_eq!(counts(&forced), [(2, 0), (1, 0)]);
        assert!(desk.results_and_notes("out/good") == before);
    }
}

/// Titles, limits, comments, the order of tables, the name of the CT and the place of the folder.
#[test]
fn what_cannot_change_a_stage_does_not() {
    let desk = desk(&everything());
    desk.run(&["run", "plan.toml"]).expect(0);
    let text = everything()
        .replace(
            "name = \"good\"",
            "name = \"good\"\ntitle = \"Other\" # new",
        )
        .replace("path = \"ct.nii\"", "path = \"elsewhere/other.nii\"")
        + "\n[accept]\ngamma = [1, 170]\n";
    desk.write("elsewhere/other.nii", nifti());
    desk.write("plan.toml", &text);
    fs::rename(desk.path().join("out"), desk.path().join("moved")).unwrap();
    let ran = desk
        .run(&["run", "plan.toml", "--json", "--out", "moved"])
        .expect(0);
    assert_eq!(counts(&ran), [(0, 2), (0, 1)]);
    let new = Desk::new();
    new.write("elsewhere/other.nii", nifti());
    new.write("plan.toml", &text);
    new.run(&["run", "plan.toml"]).expect(0);
    assert!(desk.results_and_notes("moved/good") == new.results_and_notes("out/good"));
}

#[test]
fn a_change_runs_what_depends_on_it_and_gives_the_bytes_of_a_fresh_run() {
    for base in [
        picture_plan("good", "ct.nii"),
        lee2001(&plan("good", "ct.nii")),
    ] {
        let has_views = base.contains("views");
        let cases: [Case<'_>; 3] = [
            (
                "rotate = 5",
                "rotate = 6",
                ["unchanged", "unchanged", "changed: its edits"],
                [(0, 2), (1, 0)],
            ),
            (
                "[0, 3, 0]",
                "[0, 4, 0]",
                ["unchanged", "changed: its edits", "unchanged"],
                [(1, 1), (0, 1)],
            ),
            (
                "[2, 0, 0]",
                "[1, 0, 0]",
                [
                    "changed: its edits",
                    "changed: its edits, the stages before",
                    "unchanged",
                ],
                [(2, 0), (0, 1)],
            ),
        ];
        for (from, to, told, computed) in cases {
            let desk = desk(&base);
            desk.run(&["run", "plan.toml"]).expect(0);
            assert!(base.contains(from), "{from}");
            let text = base.replace(from, to);
            desk.write("plan.toml", &text);
            let ran = desk.run(&["run", "plan.toml", "--json"]).expect(0);
            if !has_views {
                assert_eq!(counts(&ran), computed, "{to}");
            }
            let after = desk.results_and_notes("out/good");
            let expected = fresh(&text);
            assert!(after.keys().eq(expected.keys()));
            for (name, bytes) in &expected {
                assert!(after[name] == *bytes, "{to}: {name}");
            }
            if has_views {
                continue;
            }
            // Told before it is done.
            desk.write("plan.toml", &base);
            let stages = ["move", "reduce", "rotate"];
            let told: Vec<String> = stages
                .iter()
                .zip(told)
                .map(|(stage, told)| format!("{stage}: {told}"))
                .collect();
            assert_eq!(reasons(&desk), told);
        }
    }
}

#[test]
fn a_change_of_the_ct_or_of_settings_runs_everything() {
    let base = plan("good", "ct.nii");
    let desk = desk(&base);
    desk.run(&["run", "plan.toml"]).expect(0);
    for (text, part) in [
        (
            base.clone() + "\n[morph]\nmargin = { mm = 15 }\n",
            "[morph]",
        ),
        (base.clone() + "\n[segment]\nskin_hu = -400\n", "[segment]"),
        (base.clone() + "\n[cage]\ndepth = { mm = 5 }\n", "[cage]"),
        (
            base.replace("tip = [32, 16, 22]", "tip = [32, 16, 22.5]"),
            "[f1], [landmarks]",
        ),
        (
            base.replace("\"volume\", ", "\"volume\", \"nrrd\", "),
            "[outputs]",
        ),
    ] {
        assert_ne!(text, base);
        desk.write("plan.toml", text);
        for reason in reasons(&desk) {
            assert!(
                reason.contains(&format!("changed: {part}")),
                "{part}: {reason}"
            );
        }
    }
    desk.write("plan.toml", &base);
    let mut other = nifti();
    let last = other.len() - 1;
    other[last] ^= 1;
    desk.write("ct.nii", &other);
    for reason in reasons(&desk) {
        assert!(reason.ends_with(": changed: the CT"), "{reason}");
    }
    let ran = desk.run(&["run", "plan.toml", "--json"]).expect(0);
    assert_eq!(counts(&ran), [(2, 0), (1, 0)]);
}

#[test]
fn a_file_that_was_altered_or_is_gone_is_noticed() {
    let desk = desk(&everything());
    desk.run(&["run", "plan.toml"]).expect(0);
    let before = desk.results_and_notes("out/good");
    let out = desk.path().join("out/good");
    for name in [
        "both/02-reduce/volume.nii.gz",
        "both/01-move/view-frontal.png",
        "up/01-rotate/skin.ply",
    ] {
        let of_stage = |reason: &String| !reason.ends_with("unchanged");
        let bytes = fs::read(out.join(name)).unwrap();
        fs::write(out.join(name), [&bytes[..], b"x"].concat()).unwrap();
        let told: Vec<String> = reasons(&desk).into_iter().filter(of_stage).collect();
        assert_eq!(told.len(), 1);
        assert!(told[0].ends_with(&format!("altered: {name}")), "{told:?}");
        desk.run(&["run", "plan.toml"]).expect(0);
        assert!(desk.results_and_notes("out/good") == before, "{name}");
        fs::remove_file(out.join(name)).unwrap();
        let told: Vec<String> = reasons(&desk).into_iter().filter(of_stage).collect();
        assert!(told[0].ends_with(&format!("missing: {name}")), "{told:?}");
        desk.run(&["run", "plan.toml"]).expect(0);
        assert!(desk.results_and_notes("out/good") == before, "{name}");
    }
    // What is not of a stage is drawn again.
    for name in [
        "profile.svg",
        "contact-sheet.png",
        "preoperative/view-frontal.png",
    ] {
        fs::write(out.join(name), "mine").unwrap();
        assert_eq!(reasons(&desk), UNCHANGED);
        desk.run(&["run", "plan.toml"]).expect(0);
        assert!(desk.results_and_notes("out/good") == before, "{name}");
    }
}

/// Notes are files that anyone can write to: what is wrong with one costs time and nothing else.
#[test]
fn a_note_that_is_damaged_counts_for_nothing() {
    let desk = desk(&picture_plan("good", "ct.nii"));
    desk.run(&["run", "plan.toml"]).expect(0);
    let before = desk.results_and_notes("out/good");
    let notes: Vec<&String> = before
        .keys()
        .filter(|name| name.starts_with(".rhinoplan.kept/"))
        .collect();
    assert!(notes.len() >= 9, "{notes:?}");
    for (place, name) in notes.into_iter().enumerate() {
        let path = desk.path().join("out/good").join(name);
        let bytes = &before[name];
        let half = bytes.len() / 2;
        let flipped = [&bytes[..half], &[bytes[half] ^ 1], &bytes[half + 1..]].concat();
        let damaged = if place % 2 == 0 {
            flipped
        } else {
            bytes[..half].to_vec()
        };
        fs::write(&path, damaged).unwrap();
        desk.run(&["run", "plan.toml"]).expect(0);
        assert!(desk.results_and_notes("out/good") == before, "{name}");
    }
}

/// A note that lists a file elsewhere: nothing outside the folder is read, moved or removed.
#[test]
fn a_note_reaches_nothing_outside_the_folder() {
    let desk = desk(&plan("good", "ct.nii"));
    desk.run(&["run", "plan.toml"]).expect(0);
    let before = desk.results_and_notes("out/good");
    let name = "out/good/.rhinoplan.kept/up/01-rotate.json";
    let text = fs::read_to_string(desk.path().join(name)).unwrap();
    let (_, note) = text.split_once('\n').unwrap();
    let mut note: Value = serde_json::from_str(note).unwrap();
    let mine = desk.write("mine.png", "mine");
    note["files"]
        .as_array_mut()
        .unwrap()
        .push(serde_json::json!([
            "../../mine.png",
            rhinoplan::io::digest::sha256_hex(b"mine")
        ]));
    let note = note.to_string();
    let digest = blake3::hash(note.as_bytes()).to_hex();
    desk.write(name, format!("{digest}\n{note}"));
    assert!(reasons(&desk)[2].starts_with("rotate: missing"));
    desk.run(&["run", "plan.toml"]).expect(0);
    assert_eq!(fs::read(mine).unwrap(), b"mine");
    assert!(desk.results_and_notes("out/good") == before);
}

#[test]
fn a_candidate_that_cannot_be_computed_stops_no_other() {
    let (candidates, outputs) = CANDIDATES.split_once("[outputs]").unwrap();
    let text = plan_head("good", "ct.nii") + FAILS_LATE + candidates + "[outputs]" + outputs;
    let desk = desk(&text);
    let ran = desk.run(&["run", "plan.toml"]).expect(3);
    let why = "candidate `impossible`, stage `fold`: the nose cannot be measured: gamma";
    assert!(ran.err.contains(why), "{ran:?}");
    assert!(ran.out.ends_with("2 done, 0 kept, 1 failed\n"), "{ran:?}");
    let record = desk.json("out/good/run.json");
    assert_eq!(record["failed"][0]["candidate"], "impossible");
    let names: Vec<&Value> = record["candidates"]
        .as_array()
        .unwrap()
        .iter()
        .map(|of| &of["name"])
        .collect();
    assert_eq!(names, ["both", "up"]);
    assert!(!desk.path().join("out/good/impossible").exists());
    // The next run tries it again, and keeps the others.
    let again = desk.run(&["run", "plan.toml"]).expect(3);
    assert!(
        again.out.ends_with("0 done, 2 kept, 1 failed\n"),
        "{again:?}"
    );
    // What they are is what they are without it.
    desk.write("plan.toml", plan("good", "ct.nii"));
    let ran = desk.run(&["run", "plan.toml", "--json"]).expect(0);
    assert_eq!(counts(&ran), [(0, 2), (0, 1)]);
    assert!(desk.results_and_notes("out/good") == fresh(&plan("good", "ct.nii")));
}

#[test]
fn fail_fast_ends_a_plan_and_leaves_what_it_came_to_for_the_next_run() {
    let (candidates, outputs) = CANDIDATES.split_once("[outputs]").unwrap();
    let text = plan_head("good", "ct.nii") + candidates + FAILS_LATE + "[outputs]" + outputs;
    let desk = desk(&text);
    let args = ["run", "plan.toml", "--fail-fast", "--threads", "1"];
    let ran = desk.run(&args).expect(3);
    assert!(
        ran.err.contains("nothing of this plan was written"),
        "{ran:?}"
    );
    assert!(!desk.path().join("out/good/run.json").exists());
    desk.write("plan.toml", plan("good", "ct.nii"));
    let ran = desk.run(&["run", "plan.toml", "--json"]).expect(0);
    assert_eq!(counts(&ran), [(0, 2), (0, 1)]);
    assert!(desk.results_and_notes("out/good") == fresh(&plan("good", "ct.nii")));
}

#[test]
fn memory_for_one_at_a_time_gives_the_same_bytes() {
    let desk = desk(&everything());
    let expected = fresh(&everything());
    for memory in ["1MiB", "64GiB"] {
        let args = [
            "run",
            "plan.toml",
            "--force",
            "--threads",
            "4",
            "--memory",
            memory,
        ];
        desk.run(&args).expect(0);
        assert!(desk.results_and_notes("out/good") == expected, "{memory}");
    }
}

#[test]
fn parts_are_all_of_it_and_have_no_candidate_in_common() {
    let text = everything();
    let whole = fresh(&text);
    let desk = desk(&text);
    desk.write("other.toml", plan("other", "ct.nii"));
    let mut seen = Vec::new();
    for part in ["1/3", "2/3", "3/3"] {
        desk.run(&["run", "plan.toml", "other.toml", "--shard", part])
            .expect(0);
        let suffix = part.replace('/', "-of-");
        for plan in ["good", "other"] {
            let folder = format!("out/{plan}.{suffix}");
            if !desk.path().join(&folder).exists() {
                continue;
            }
            let record = desk.json(&format!("{folder}/run.json"));
            assert_eq!(record["part"]["of"], 3);
            for candidate in record["candidates"].as_array().unwrap() {
                seen.push(format!("{plan}/{}", candidate["name"].as_str().unwrap()));
            }
            if plan == "good" {
                // The pictures of a part are those of the whole.
                let files = desk.files(&folder);
                let mut of_stages = files
                    .iter()
                    .filter(|(name, _)| name.starts_with("both/0") || name.starts_with("up/0"));
                assert!(of_stages.clone().count() > 20);
                assert!(of_stages.all(|(name, bytes)| whole[name] == *bytes));
            }
        }
    }
    seen.sort();
    assert_eq!(seen, ["good/both", "good/up", "other/both", "other/up"]);
}

#[test]
fn a_gzipped_ct_is_the_same_ct_only_where_its_bytes_are() {
    let desk = desk(&plan("good", "ct.nii.gz"));
    desk.write("ct.nii.gz", gzip(&nifti()));
    desk.run(&["run", "plan.toml"]).expect(0);
    assert_eq!(reasons(&desk), UNCHANGED);
    desk.write("plan.toml", plan("good", "ct.nii"));
    for reason in reasons(&desk) {
        assert!(reason.ends_with(": changed: the CT"), "{reason}");
    }
}
