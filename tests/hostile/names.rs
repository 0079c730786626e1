//! Names and paths of a plan do not lead out of the output folder.

use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::symlink;

use crate::head::{nifti, picture_plan, plan};
use crate::noise::tell;
use crate::process::{Desk, names};

/// Names that would lead elsewhere, or mean something to a shell, a terminal or another system.
const BAD: [&str; 22] = [
    "",
    ".",
    "..",
    "../good",
    "../../tmp/evil",
    "/tmp/evil",
    "a/b",
    "a/../../b",
    "a\\\\b",
    "C:evil",
    "-rf",
    "~",
    "$HOME",
    "a b",
    "a.b",
    "run.json",
    "UPPER",
    "ä",
    "a\\u0000b",
    "a\\nb",
    "\\u001b[31m",
    "\\u202ename",
];

/// Where a plan gives a name: a text of it, and the same with `NAME` in place of the name.
const PLACES: [(&str, &str); 4] = [
    ("name = \"good\"", "name = \"NAME\""),
    ("name = \"both\"", "name = \"NAME\""),
    ("name = \"reduce\"", "name = \"NAME\""),
    ("name = \"high-left\"", "name = \"NAME\""),
];

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("work/ct.nii", nifti());
    desk
}

#[test]
fn names_that_lead_elsewhere_are_refused() {
    let desk = desk();
    let sound = picture_plan("good", "ct.nii");
    let long = "x".repeat(65);
    for (from, to) in PLACES {
        assert_eq!(sound.matches(from).count(), 1, "{from}");
        for bad in BAD.into_iter().chain([long.as_str()]) {
            let text = sound.replace(from, &to.replace("NAME", bad));
            desk.write("work/plan.toml", text);
            let before = desk.files("");
            let ran = desk.run(&["run", "work/plan.toml", "--out", "work/out"]);
            let ran = ran.expect(2);
            assert!(
                ran.err.contains("cannot name a file or folder"),
                "{bad:?}: {ran:?}"
            );
            assert!(desk.files("") == before, "{bad:?} in {from}");
        }
    }
}

/// Everything that a plan with every output makes is in its folder, and nothing else is touched.
#[test]
fn a_run_writes_into_its_own_folder_alone() {
    let desk = desk();
    desk.write("work/out/other/run.json", "another plan's");
    desk.write("out/good/run.json", "another folder's");
    let all = "write = [\"views\", \"slices\", \"charts\", \"volume\", \"displacement\", \"inverse\", \"nrrd\", \
               \"mesh\", \"solids\"]";
    let text =
        picture_plan("good", "ct.nii").replace("write = [\"views\", \"slices\", \"charts\"]", all);
    assert!(text.contains(all));
    desk.write("work/plan.toml", text);
    let before = desk.files("");
    desk.run(&["run", "work/plan.toml", "--out", "work/out"])
        .expect(0);
    let after = desk.files("");
    for (name, bytes) in &before {
        assert!(after[name] == *bytes, "{name} is another");
    }
    let made: Vec<&str> = names(&after)
        .into_iter()
        .filter(|name| !before.contains_key(*name))
        .collect();
    assert!(made.len() > 40, "{made:?}");
    assert!(
        made.iter().all(|name| name.starts_with("work/out/good/")),
        "{made:?}"
    );
}

/// A link in place of an output is replaced; what it leads to is not written to.
#[test]
fn links_in_place_of_outputs_are_not_followed() {
    let desk = desk();
    desk.write("work/plan.toml", plan("good", "ct.nii"));
    desk.write("precious", "mine");
    let folder = desk.path().join("work/out/good");
    fs::create_dir_all(folder.join("both/01-move")).unwrap();
    for name in ["run.json", "timings.json", "both/01-move/volume.nii.gz"] {
        symlink(desk.path().join("precious"), folder.join(name)).unwrap();
    }
    desk.run(&["run", "work/plan.toml", "--out", "work/out"])
        .expect(0);
    assert_eq!(fs::read(desk.path().join("precious")).unwrap(), b"mine");
    let record = folder.join("run.json");
    assert!(!record.is_symlink() && fs::metadata(record).unwrap().len() > 1000);
}

/// Nor is what stands in the way of an output read or waited for.
#[test]
fn a_pipe_in_place_of_an_output_does_not_block() {
    let bench = crate::bounded::Bench::new();
    let pipe = bench.path().join("head.nii");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    if !made.is_ok_and(|status| status.success()) {
        tell("skipped: there is no mkfifo");
        return;
    }
    let ended = bench.run(&["run", "good.toml", "--out", "head.nii"].map(OsStr::new));
    assert_eq!(ended.code, 2, "{ended:?}");
    bench.assert_unharmed("head.nii");
}
