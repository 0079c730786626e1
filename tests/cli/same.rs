//! The same plan on the same CT gives the same bytes, and none of them name a place or a person.

use std::io::Read;

use flate2::read::MultiGzDecoder;

use crate::head::{PATIENT, VIEWS, gzip, nifti_with_names, picture_plan, plan};
use crate::process::Desk;

const LEE2001_HALF: &str = "[morph]\nmodel = \"lee2001\"\nscale = \"half\"\n";

fn desk(folder: &str, ct: &str, more: &str) -> Desk {
    let desk = Desk::new();
    desk.write(&format!("{folder}/{ct}"), gzip(&nifti_with_names()));
    desk.write(&format!("{folder}/plan.toml"), plan("good", ct) + more);
    desk
}

#[test]
fn any_number_of_threads_and_any_run_gives_the_same_bytes() {
    for more in ["", LEE2001_HALF] {
        let desk = desk(".", "ct.nii.gz", more);
        assert_same_with_any_threads(&desk, 8 + 3 * 2);
    }
}

#[test]
fn any_number_of_threads_draws_the_same_pictures() {
    // What is enhanced goes through other code than what is not.
    for more in ["", "\n[enhance]\nmedian = 3\nsmooth = { mm = 1.0 }\n"] {
        let desk = Desk::new();
        desk.write("ct.nii.gz", gzip(&nifti_with_names()));
        desk.write("plan.toml", picture_plan("good", "ct.nii.gz") + more);
        let of_stage = 3 * VIEWS.len() + 4;
        let charts = 4 * 3;
        assert_same_with_any_threads(&desk, 9 + VIEWS.len() + 3 * of_stage + charts);
    }
}

#[test]
fn any_instructions_give_the_same_bytes() {
    let pictures = picture_plan("good", "ct.nii.gz") + "\n[enhance]\nmedian = 3\n";
    let plans = [
        pictures,
        plan("good", "ct.nii.gz") + LEE2001_HALF,
        plan("good", "ct.nii.gz") + "[morph]\nmodel = \"lee2001\"\nmethod = \"adaptive\"\n",
    ];
    for plan in plans {
        let desk = Desk::new();
        desk.write("ct.nii.gz", gzip(&nifti_with_names()));
        desk.write("plan.toml", plan);
        let runs = ["off", "avx2", "avx512", ""].map(|simd| {
            let args = ["run", "plan.toml", "--force"];
            desk.run_with("RHINOPLAN_SIMD", simd, &args).expect(0);
            desk.results_and_notes("out/good")
        });
        for run in &runs[1..] {
            assert!(run.len() == runs[0].len() && run.len() > 8);
            for (name, bytes) in &runs[0] {
                assert!(run.get(name) == Some(bytes), "{name}");
            }
        }
    }
}

#[test]
fn a_word_that_names_no_instructions_is_refused() {
    let desk = desk(".", "ct.nii.gz", "");
    let ran = desk.run_with("RHINOPLAN_SIMD", "sse9", &["run", "plan.toml"]);
    let ran = ran.expect(2);
    assert!(
        ran.err
            .contains("RHINOPLAN_SIMD is `sse9`; it can be `off`"),
        "{}",
        ran.err
    );
    assert!(!desk.path().join("out").exists());
}

fn assert_same_with_any_threads(desk: &Desk, files: usize) {
    let runs = ["1", "2", "4", "1"].map(|threads| {
        desk.run(&["run", "plan.toml", "--threads", threads, "--force"])
            .expect(0);
        assert_eq!(
            desk.json("out/good/timings.json")["threads"].to_string(),
            threads
        );
        desk.results_and_notes("out/good")
    });
    let notes = |name: &&String| name.starts_with(".rhinoplan.kept/");
    let notes = runs[0].keys().filter(notes).count();
    assert!(notes >= 5);
    let files = files + notes;
    assert_eq!(runs[0].len(), files);
    for run in &runs[1..] {
        for (name, bytes) in &runs[0] {
            assert!(run.get(name) == Some(bytes), "{name}");
        }
        assert_eq!(run.len(), files);
    }
}

#[test]
fn the_place_of_the_files_does_not_matter_and_is_not_told() {
    let here = desk("here", "ct.nii.gz", "");
    here.run(&["run", "here/plan.toml"]).expect(0);
    let there = desk("doe-jane/1968", "ct.nii.gz", "");
    let plan_path = there.path().join("doe-jane/1968/plan.toml");
    let out = there.path().join("results");
    there
        .run(&[
            "run",
            plan_path.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
        ])
        .expect(0);
    assert!(here.results("out/good") == there.results("results/good"));
}

#[test]
fn another_name_of_the_ct_changes_the_digest_of_the_plan_alone() {
    let desks = ["ct.nii.gz", "DOE^JANE.nii.gz"].map(|ct| {
        let desk = desk(".", ct, "");
        desk.run(&["run", "plan.toml"]).expect(0);
        desk
    });
    let [mut one, mut other] = desks.each_ref().map(|desk| desk.results("out/good"));
    let [mut record, mut same] = desks.each_ref().map(|desk| desk.json("out/good/run.json"));
    for files in [&mut one, &mut other] {
        files.remove("run.json").unwrap();
    }
    assert!(one == other);
    assert_ne!(
        record["inputs"]["plan_sha256"],
        same["inputs"]["plan_sha256"]
    );
    for record in [&mut record, &mut same] {
        record["inputs"]["plan_sha256"].take();
    }
    assert_eq!(record, same);
}

#[test]
fn no_output_names_the_patient_or_a_file() {
    let desk = desk("doe-jane", "DOE^JANE.nii.gz", "");
    assert!(
        nifti_with_names()
            .windows(8)
            .filter(|part| *part == PATIENT.as_bytes())
            .count()
            > 10
    );
    let ran = desk.run(&["run", "doe-jane/plan.toml"]).expect(0);
    let folder = desk.path().file_name().unwrap().to_str().unwrap();
    // Random bytes hold every short word somewhere, so samples are searched for long ones only.
    let long = ["jane doe", "doe^jane", "doe-jane", "plan.toml", folder].map(str::to_lowercase);
    let short = ["jane", "doe", "comment", "nii"];
    let holds = |content: &[u8], word: &str| {
        let lower = content.to_ascii_lowercase();
        lower
            .windows(word.len())
            .any(|part| part == word.as_bytes())
    };
    let mut looked_at = 0;
    for (name, packed) in desk.everything("out/good") {
        let mut content = Vec::new();
        let text = if name.ends_with(".gz") {
            MultiGzDecoder::new(&packed[..])
                .read_to_end(&mut content)
                .unwrap();
            [&packed[..20], &content[..352]].concat()
        } else {
            packed.clone()
        };
        for word in &long {
            assert!(
                !holds(&packed, word) && !holds(&content, word),
                "{name} holds {word}"
            );
        }
        for word in short {
            // The record says which kind of source it was, and the list of files what is written.
            let text = String::from_utf8_lossy(&text)
                .replace("\"nifti\"", "")
                .replace(".nii.gz\n", "\n")
                .replace(".nii.gz\",", "")
                .replace("\npath = \"ct.nii.gz\"\n", "\n");
            assert!(!holds(text.as_bytes(), word), "{name} holds {word}");
        }
        looked_at += 1;
    }
    // Tables, volumes, and the notes on them.
    assert_eq!(looked_at, 9 + 3 * 2 + 7);
    assert!(!ran.out.to_lowercase().contains("jane"), "{}", ran.out);
}
