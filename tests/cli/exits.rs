//! Exit codes, and what goes where.

use std::fs;
use std::io::Write;

use crate::head::{
    AIR, CANDIDATES, FAILS_LATE, constant, gzip, nifti, plan, plan_head, put_i16s, put_sform,
};
use crate::process::Desk;

/// Each of these ends with `code`, says `message` on stderr and nothing on stdout; with `--json` stdout is
/// one document that says it too.
fn assert_fails(desk: &Desk, args: &[&str], code: i32, message: &str) {
    let ran = desk.run(args).expect(code);
    assert_eq!(ran.out, "", "{args:?}");
    assert!(ran.err.contains(message), "{args:?}: {}", ran.err);
    let quiet = desk.run(&[args, &["--quiet"]].concat()).expect(code);
    assert!(quiet.err.contains(message), "{args:?}: {}", quiet.err);
    let json = desk.run(&[args, &["--json"]].concat()).expect(code);
    assert!(json.err.contains(message), "{args:?}: {}", json.err);
    let document = json.document();
    let errors = document["errors"].as_array().unwrap();
    assert!(!errors.is_empty(), "{args:?}");
    for error in errors {
        assert!(error["message"].is_string(), "{args:?}: {error}");
    }
}

#[test]
fn what_is_asked_for_goes_to_stdout_and_nothing_else_does() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", plan("good", "ct.nii"));
    for command in [
        &["check", "plan.toml"][..],
        &["run", "--dry-run", "plan.toml"],
        &["run", "--force", "plan.toml"],
        &["info", "ct.nii"],
        &["--help"],
        &["--version"],
    ] {
        let ran = desk.run(command).expect(0);
        assert!(!ran.out.is_empty(), "{command:?}");
        assert_eq!(ran.err, "", "{command:?}");
        let quiet = desk.run(&[command, &["--quiet"]].concat()).expect(0);
        assert_eq!(quiet.err, "", "{command:?}");
        if command[0].starts_with("--") {
            continue;
        }
        let json = desk.run(&[command, &["--json"]].concat()).expect(0);
        assert_eq!(json.document()["errors"], serde_json::json!([]));
        assert_eq!(json.err, ran.out, "prose goes to stderr: {command:?}");
        let both = desk.run(&[command, &["--json", "-q"]].concat()).expect(0);
        both.document();
        assert_eq!(both.err, "", "{command:?}");
    }
}

#[test]
fn a_command_line_that_means_nothing() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", plan("good", "ct.nii"));
    for (args, message) in [
        (&["run", "--forced", "plan.toml"][..], "--forced"),
        (&["run", "plan.toml", "--shard", "3/2"], "expected K/N"),
        (&["run", "plan.toml", "--shard", "0/2"], "expected K/N"),
        (&["run", "plan.toml", "--memory", "plenty"], "plenty"),
        (&["operate", "plan.toml"], "operate"),
        (&["run"], "<PLAN>"),
        (&["check"], "<PLAN>"),
        (&["info"], "<CT>"),
        (&["phantom"], "--output <FILE>"),
        (
            &["phantom", "-o", "head.mha"],
            "must end in .nii or .nii.gz",
        ),
        (&["check", "plan.toml", "--threads", "0"], "1..=1024"),
        (&["check", "plan.toml", "--threads", "100000"], "1..=1024"),
    ] {
        assert_fails(&desk, args, 2, message);
    }
    let ran = desk.run(&[]).expect(2);
    assert!(ran.out.is_empty() && ran.err.contains("Usage: rhinoplan"));
}

#[test]
fn plans_that_cannot_be_run() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", plan("good", "ct.nii"));
    desk.write("same.toml", plan("good", "ct.nii"));
    desk.write(
        "typo.toml",
        plan("typo", "ct.nii").replace("rotate = 5", "turn = 5"),
    );
    desk.write("latin1.toml", b"title = \"Nase gek\xfcrzt\"\n");
    fs::create_dir(desk.path().join("folder")).unwrap();
    for (plans, message) in [
        (&["typo.toml"][..], "unknown key `turn`"),
        (&["nothing.toml"], "there is no plan file nothing.toml"),
        (&["folder"], "folder is a folder"),
        (&["latin1.toml"], "not UTF-8 text: byte 17"),
        (
            &["plan.toml", "same.toml"],
            "two plans of one run have the name `good`",
        ),
        (
            &["plan.toml", "plan.toml"],
            "two plans of one run have the name `good`",
        ),
        // A good plan does not hide a bad one, wherever it stands.
        (&["plan.toml", "typo.toml"], "unknown key `turn`"),
    ] {
        for command in [&["check"][..], &["run"], &["run", "--dry-run"]] {
            assert_fails(&desk, &[command, plans].concat(), 2, message);
        }
    }
    assert!(
        !desk.path().join("out").exists(),
        "nothing runs if one plan is wrong"
    );
}

#[test]
fn outputs_that_cannot_be_written() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", plan("good", "ct.nii"));
    desk.write("file", "");
    assert_fails(
        &desk,
        &["run", "plan.toml", "--out", "file"],
        2,
        "cannot create `file/good`",
    );
    assert_fails(
        &desk,
        &["run", "plan.toml", "--out", "file/a"],
        2,
        "cannot create `file/a/good`",
    );
    assert_fails(
        &desk,
        &["phantom", "-o", "none/x.nii"],
        2,
        "`none/x.nii`: its folder does not exist",
    );
    assert_eq!(fs::read(desk.path().join("file")).unwrap(), b"");
}

#[test]
#[cfg(unix)]
fn a_folder_that_may_not_be_written_to() {
    use std::os::unix::fs::PermissionsExt;
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", plan("good", "ct.nii"));
    let locked = desk.path().join("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    if fs::write(locked.join("probe"), "").is_ok() {
        // Past the capture of passing tests, which `println!` would not get.
        let _ = writeln!(std::io::stderr(), "skipped: this user may write everywhere");
        return;
    }
    assert_fails(
        &desk,
        &["run", "plan.toml", "--out", "locked"],
        2,
        "cannot create `locked/good`",
    );
    assert!(desk.files("locked").is_empty());
}

#[test]
fn cts_that_cannot_be_used() {
    let sound = nifti();
    let mut four = sound.clone();
    put_i16s(&mut four, 40, &[4, 64, 64, 24, 2]);
    let mut sheared = sound.clone();
    put_sform(
        &mut sheared,
        [
            [-1.5, 0.3, 0.0, 0.0],
            [0.0, -1.5, 0.0, 0.0],
            [0.0, 0.0, 1.5, 0.0],
        ],
    );
    let desk = Desk::new();
    desk.write("text.nii", "not an image at all, and shorter than a header");
    desk.write("empty.nii", "");
    desk.write("cut.nii", &sound[..sound.len() - 1000]);
    desk.write("four.nii", four);
    desk.write("sheared.nii", sheared);
    desk.write("cut.nii.gz", &gzip(&sound)[..100]);
    fs::create_dir(desk.path().join("folder")).unwrap();
    for (ct, message) in [
        ("missing.nii", "cannot be read"),
        ("folder", "is a folder that holds no CT series: it is empty"),
        ("text.nii", "is not a NIfTI-1 file"),
        ("empty.nii", "is empty"),
        ("cut.nii", "1000 are missing at the end"),
        ("four.nii", "dim"),
        ("sheared.nii", "sform cannot be used"),
        ("cut.nii.gz", "gzip stream is damaged or cut"),
    ] {
        desk.write("plan.toml", plan("good", ct));
        for command in [&["check"][..], &["run"], &["run", "--dry-run"]] {
            assert_fails(&desk, &[command, &["plan.toml"]].concat(), 3, message);
        }
        assert_fails(&desk, &["info", ct], 3, message);
    }
    assert!(!desk.path().join("out").exists());
}

#[test]
fn a_fault_of_a_plan_outweighs_one_of_its_ct_and_both_are_told() {
    let desk = Desk::new();
    desk.write(
        "plan.toml",
        plan("good", "missing.nii").replace("rotate", "turn"),
    );
    let document = desk
        .run(&["check", "plan.toml", "--json"])
        .expect(2)
        .document();
    let codes: Vec<_> = document["errors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| e["code"].clone())
        .collect();
    assert_eq!(codes, ["unknown-key", "ct"]);
}

#[test]
fn a_ct_that_is_not_the_pinned_one() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    let right = desk.run(&["info", "ct.nii", "--json"]).expect(0).document()["ct"]["sha256"]
        .as_str()
        .unwrap()
        .to_owned();
    let wrong = "0".repeat(64);
    for (pin, code) in [(&right, 0), (&wrong, 3)] {
        let path = format!("\"ct.nii\"\nsha256 = \"{pin}\"");
        desk.write(
            "plan.toml",
            plan("good", "ct.nii").replace("\"ct.nii\"", &path),
        );
        let ran = desk.run(&["run", "plan.toml"]).expect(code);
        if code != 0 {
            assert!(
                ran.err.contains(&right) && ran.err.contains(&wrong),
                "{ran:?}"
            );
            assert_fails(&desk, &["run", "plan.toml"], 3, "pinned");
        }
    }
}

#[test]
fn a_volume_without_a_nose_gives_a_message_and_no_numbers() {
    let desk = Desk::new();
    desk.write("air.nii", constant(AIR));
    desk.write("tissue.nii", constant(40));
    for (ct, message) in [
        ("air.nii", "the CT holds no tissue: -1000 HU in every voxel"),
        (
            "tissue.nii",
            "the CT holds no air, so it has no skin: 40 HU in every voxel",
        ),
    ] {
        desk.write("plan.toml", plan("good", ct));
        assert_fails(&desk, &["run", "plan.toml"], 3, message);
        assert!(!desk.path().join("out").exists());
    }
}

#[test]
fn the_worst_exit_code_wins_in_either_order() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("good.toml", plan("good", "ct.nii"));
    desk.write(
        "input.toml",
        plan_head("input", "ct.nii") + FAILS_LATE + CANDIDATES,
    );
    desk.write("blocked.toml", plan("blocked", "ct.nii"));
    desk.write("out/blocked", "a file where a folder is to be");
    for plans in [
        ["good.toml", "input.toml", "blocked.toml"],
        ["blocked.toml", "input.toml", "good.toml"],
        ["input.toml", "blocked.toml", "good.toml"],
    ] {
        drop(fs::remove_dir_all(desk.path().join("out/good")));
        let document = desk
            .run(&[&["run", "--json"][..], &plans].concat())
            .expect(2)
            .document();
        assert_eq!(document["errors"].as_array().unwrap().len(), 2);
        // Of the one whose candidate cannot be computed there are the others.
        assert_eq!(document["runs"].as_array().unwrap().len(), 2);
        for plan in ["good", "input"] {
            let record = desk.path().join("out").join(plan).join("run.json");
            assert!(record.exists(), "the others still run");
        }
    }
    desk.run(&["run", "input.toml", "good.toml"]).expect(3);
}
