//! What a folder holds after runs that end well, badly, or in the middle.

use std::collections::BTreeMap;

use super::*;
use crate::io::tests::names;

#[test]
fn files_appear_together_and_nothing_else_does() {
    let root = tempfile::tempdir().unwrap();
    let target = root.path().join("a/plan");
    let staging = Staging::new(&target).unwrap();
    fs::write(staging.begin("one/two.txt").unwrap(), "2").unwrap();
    fs::write(staging.begin("run.json").unwrap(), "{}").unwrap();
    let begun = names(&target);
    assert_eq!(begun.len(), 2, "only the hidden folder and the lock");
    assert!(begun.iter().all(|name| name.starts_with(".rhinoplan")));
    staging.publish().unwrap();
    assert_eq!(names(&target), [MANIFEST, "one", "run.json"]);
    assert_eq!(fs::read_to_string(target.join("one/two.txt")).unwrap(), "2");
}

#[test]
fn a_run_that_fails_leaves_what_was_there() {
    let root = tempfile::tempdir().unwrap();
    let target = root.path().join("plan");
    let first = Staging::new(&target).unwrap();
    fs::write(first.begin("run.json").unwrap(), "first").unwrap();
    first.publish().unwrap();
    let second = Staging::new(&target).unwrap();
    fs::write(second.begin("run.json").unwrap(), "second").unwrap();
    drop(second);
    assert_eq!(names(&target), [MANIFEST, "run.json"]);
    assert_eq!(
        fs::read_to_string(target.join("run.json")).unwrap(),
        "first"
    );
}

#[test]
fn a_first_run_that_fails_leaves_no_folder() {
    let root = tempfile::tempdir().unwrap();
    drop(Staging::new(&root.path().join("out/plan")).unwrap());
    assert!(names(root.path()).is_empty());
}

#[test]
fn folders_that_were_there_stay() {
    let root = tempfile::tempdir().unwrap();
    let target = root.path().join("out/plan");
    fs::create_dir_all(&target).unwrap();
    drop(Staging::new(&target).unwrap());
    assert!(target.exists());
    fs::write(root.path().join("file"), "").unwrap();
    assert!(Staging::new(&root.path().join("file/plan")).is_err());
    assert_eq!(names(root.path()), ["file", "out"]);
}

#[test]
fn nothing_is_put_in_place_where_something_cannot_be() {
    let root = tempfile::tempdir().unwrap();
    let old = root.path().join("a.txt");
    fs::write(&old, "old").unwrap();
    // What stands in the way is known at once, or comes while the run is at work.
    for late in [false, true] {
        for (obstacle, name) in [("stage", "stage/volume"), ("run.json/x", "run.json")] {
            let obstacle = root.path().join(obstacle);
            let block = || {
                make_parent(&obstacle).unwrap();
                fs::write(&obstacle, "").unwrap();
            };
            if !late {
                block();
            }
            let staging = Staging::new(root.path()).unwrap();
            fs::write(staging.begin("a.txt").unwrap(), "new").unwrap();
            let error = match staging.begin(name) {
                Ok(path) => {
                    fs::write(path, "new").unwrap();
                    block();
                    staging.publish().unwrap_err()
                }
                Err(error) => {
                    assert!(!late);
                    drop(staging);
                    error
                }
            };
            assert!(error.path.ends_with(name), "{error}");
            assert_eq!(fs::read_to_string(&old).unwrap(), "old");
            let blocker = root
                .path()
                .join(if name == "run.json" { name } else { "stage" });
            if blocker.is_dir() {
                fs::remove_dir_all(blocker).unwrap();
            } else {
                fs::remove_file(blocker).unwrap();
            }
            assert_eq!(names(root.path()), ["a.txt"]);
        }
    }
}

/// The files of a folder by name, hidden ones too, links as where they lead.
fn files(folder: &Path) -> BTreeMap<String, String> {
    let mut files = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder_of_it) = open.pop() {
        for entry in fs::read_dir(folder_of_it).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() && !path.is_symlink() {
                open.push(path);
            } else {
                let content = fs::read_to_string(&path).unwrap_or_default();
                files.insert(
                    plain_name(path.strip_prefix(folder).unwrap()).unwrap(),
                    content,
                );
            }
        }
    }
    files
}

/// Some files of a run, each with its name and `what` in it.
fn begin(target: &Path, names: &[&str], what: &str) -> Staging {
    let staging = Staging::new(target).unwrap();
    staging.sweep();
    for name in names {
        let path = staging.begin(name).unwrap();
        fs::write(path, format!("{what} of {name}")).unwrap();
    }
    staging
}

const FIRST: [&str; 4] = [
    "a/01-x/volume.nii.gz",
    "b/01-y/volume.nii.gz",
    "table.md",
    "run.json",
];
const SECOND: [&str; 4] = [
    "a/01-x/volume.nii.gz",
    "a/02-z/volume.nii.gz",
    "table.md",
    "run.json",
];

#[test]
fn what_the_run_before_wrote_and_this_one_does_not_goes_away() {
    let (root, fresh) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    begin(root.path(), &FIRST, "first").publish().unwrap();
    let published = begin(root.path(), &SECOND, "second").publish().unwrap();
    assert_eq!(published.removed, ["b/01-y/volume.nii.gz"]);
    assert!(published.kept.is_empty());
    begin(fresh.path(), &SECOND, "second").publish().unwrap();
    assert_eq!(files(root.path()), files(fresh.path()));
    assert_eq!(
        names(root.path()),
        names(fresh.path()),
        "no empty folder stays"
    );
}

/// Killed while it removes folders, a run leaves some of them, and the list of its files and of those before.
#[test]
fn empty_folders_that_a_killed_run_left_go_away() {
    for gone in ["", "b/01-y"] {
        let root = tempfile::tempdir().unwrap();
        begin(root.path(), &FIRST, "first").publish().unwrap();
        fs::remove_file(root.path().join("b/01-y/volume.nii.gz")).unwrap();
        if !gone.is_empty() {
            fs::remove_dir(root.path().join(gone)).unwrap();
        }
        let published = begin(root.path(), &SECOND, "second").publish().unwrap();
        assert_eq!(published, Published::default());
        assert!(!root.path().join("b").exists(), "{gone}");
    }
}

#[test]
fn what_is_not_the_run_befores_stays() {
    let root = tempfile::tempdir().unwrap();
    let more = [&FIRST[..], &["b/01-y/view-frontal.png"]].concat();
    begin(root.path(), &more, "first").publish().unwrap();
    // The user's: a file beside one that goes, one that was changed, and one that was never listed.
    fs::write(root.path().join("b/notes.txt"), "mine").unwrap();
    fs::write(root.path().join("b/01-y/view-frontal.png"), "cropped").unwrap();
    fs::create_dir(root.path().join("c")).unwrap();
    fs::write(root.path().join("c/volume.nii.gz"), "mine").unwrap();
    let published = begin(root.path(), &SECOND, "second").publish().unwrap();
    assert_eq!(published.removed, ["b/01-y/volume.nii.gz"]);
    assert_eq!(published.kept, ["b/01-y/view-frontal.png"]);
    let found = files(root.path());
    assert_eq!(found["b/notes.txt"], "mine");
    assert_eq!(found["b/01-y/view-frontal.png"], "cropped");
    assert_eq!(found["c/volume.nii.gz"], "mine");
    let again = begin(root.path(), &SECOND, "second").publish().unwrap();
    assert_eq!(again, Published::default(), "it is told once");
}

#[test]
fn a_list_that_someone_edited_removes_nothing_of_others() {
    use crate::io::digest::sha256_hex;
    let root = tempfile::tempdir().unwrap();
    let target = root.path().join("out/plan");
    begin(&target, &FIRST, "first").publish().unwrap();
    let victims = [
        "victim.png",
        "out/victim.png",
        "out/plan/.victim.png",
        "out/plan/plan.toml",
    ];
    for victim in victims {
        fs::write(root.path().join(victim), "mine").unwrap();
    }
    let absolute = root.path().join("victim.png").display().to_string();
    let hostile = [
        "../../victim.png",
        "../victim.png",
        ".victim.png",
        "plan.toml",
        &absolute,
    ];
    let lines = hostile.map(|name| format!("{}  {name}\n", sha256_hex(b"mine")));
    fs::write(target.join(MANIFEST), lines.concat()).unwrap();
    let published = begin(&target, &SECOND, "second").publish().unwrap();
    assert_eq!(published, Published::default());
    for victim in victims {
        assert_eq!(
            fs::read_to_string(root.path().join(victim)).unwrap(),
            "mine"
        );
    }
}

#[test]
fn a_second_run_is_refused_and_harms_nothing() {
    let root = tempfile::tempdir().unwrap();
    let target = root.path().join("plan");
    let first = begin(&target, &FIRST, "first");
    let error = Staging::new(&target).unwrap_err().to_string();
    assert!(
        error.contains("plan`: another run is writing into this folder"),
        "{error}"
    );
    first.publish().unwrap();
    assert_eq!(files(&target)["run.json"], "first of run.json");
    assert!(Staging::new(&target).unwrap().warning().is_none());
}

#[test]
fn what_killed_runs_left_goes_away_and_nothing_else_does() {
    let root = tempfile::tempdir().unwrap();
    let target = root.path().join("plan");
    for name in [".rhinoplan-a1b2c3/a/01-x", ".rhinoplan", "rhinoplan-x"] {
        fs::create_dir_all(target.join(name)).unwrap();
        fs::write(target.join(name).join("part"), "").unwrap();
    }
    fs::write(target.join(".rhinoplan-file"), "").unwrap();
    let elsewhere = root.path().join("elsewhere");
    fs::create_dir(&elsewhere).unwrap();
    fs::write(elsewhere.join("mine"), "").unwrap();
    #[cfg(unix)]
    for (from, to) in [
        (elsewhere.clone(), ".rhinoplan-link"),
        (target.join("rhinoplan-x"), ".rhinoplan-near"),
    ] {
        std::os::unix::fs::symlink(from, target.join(to)).unwrap();
    }
    let before = names(&target);
    let staging = Staging::new(&target).unwrap();
    assert!(names(&target).contains(&".rhinoplan-a1b2c3".to_owned()));
    staging.sweep();
    drop(staging);
    let after = names(&target);
    assert!(!after.iter().any(|name| name == ".rhinoplan-a1b2c3"));
    assert_eq!(after.len() + 1, before.len());
    assert_eq!(names(&elsewhere), ["mine"]);
    assert_eq!(names(&target.join("rhinoplan-x")), ["part"]);
}

/// Renames what publishing renames, up to the one of that number, and leaves everything as a killed run does.
/// Whether there was anything left to do.
fn killed_after(staging: Staging, count: usize) -> bool {
    let mut staging = staging;
    staging.digest(Path::new("")).unwrap();
    let earlier = Manifest::read(&staging.target);
    let names: Vec<_> = staging
        .files()
        .begun
        .iter()
        .map(|file| file.name.clone())
        .collect();
    let left = earlier.left_over(&names, &staging.target);
    staging
        .write_manifest(&staging.manifest().and(&earlier))
        .unwrap();
    let mut made = Made::default();
    let moves = staging.moves(&names, &left.files, &mut made).unwrap();
    carry_out(&moves[..count.min(moves.len())]).unwrap();
    staging.hidden.disable_cleanup(true);
    count < moves.len()
}

#[test]
fn killed_between_any_two_renames_the_next_run_comes_to_the_same() {
    let fresh = tempfile::tempdir().unwrap();
    let third = ["c/01-x/volume.nii.gz", "table.md", "run.json"];
    begin(fresh.path(), &third, "third").publish().unwrap();
    let mut count = 0;
    let mut goes_on = true;
    while goes_on {
        let root = tempfile::tempdir().unwrap();
        begin(root.path(), &FIRST, "first").publish().unwrap();
        let first = files(root.path());
        goes_on = killed_after(begin(root.path(), &SECOND, "second"), count);
        let mut found = files(root.path());
        found.retain(|name, _| !name.starts_with(".rhinoplan"));
        let is_of = |what: &str| {
            found
                .iter()
                .all(|(name, text)| *text == format!("{what} of {name}"))
        };
        match found.get("run.json") {
            Some(text) if text.starts_with("second") => {
                assert!(!goes_on && is_of("second") && found.len() == SECOND.len());
            }
            Some(_) => {
                assert_eq!(count, 0, "taken away before anything else");
                assert!(is_of("first") && found.len() == FIRST.len());
            }
            None => assert!(count > 0 && goes_on),
        }
        for (name, text) in &found {
            assert!(
                first.get(name) == Some(text) || *text == format!("second of {name}"),
                "{name}"
            );
        }
        // A third plan, which has other files than either: both runs' are known and go away.
        begin(root.path(), &third, "third").publish().unwrap();
        assert_eq!(
            files(root.path()),
            files(fresh.path()),
            "after {count} renames"
        );
        assert_eq!(names(root.path()), names(fresh.path()));
        count += 1;
    }
    assert_eq!(
        count,
        3 + 1 + 4 + 1,
        "three are replaced, one goes, four come; and none"
    );
}

#[test]
fn a_rename_that_fails_undoes_those_before_it() {
    let root = tempfile::tempdir().unwrap();
    begin(root.path(), &FIRST, "first").publish().unwrap();
    let before = files(root.path());
    let second = begin(root.path(), &SECOND[..3], "second");
    // It is not there to be renamed: what the disk did to it does not matter.
    second.begin_unlisted("timings.json").unwrap();
    fs::write(second.begin("run.json").unwrap(), "second").unwrap();
    let error = second.publish().unwrap_err();
    assert!(error.path.ends_with("timings.json"), "{error}");
    let mut after = files(root.path());
    assert_ne!(after[MANIFEST], before[MANIFEST], "lists the files of both");
    after.insert(MANIFEST.to_owned(), before[MANIFEST].clone());
    assert_eq!(after, before);
    assert!(!root.path().join("a/02-z").exists());
    begin(root.path(), &SECOND, "second").publish().unwrap();
    assert!(!root.path().join("b").exists());
}
