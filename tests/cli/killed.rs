//! Runs that end in the middle, and two at once.

#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs;
use std::process::Command;
use std::time::{Duration, Instant};

use rhinoplan::io::staging::Staging;

use crate::head::{nifti, plan};
use crate::process::{Desk, Started, names};

type Files = BTreeMap<String, Vec<u8>>;

/// Two plans of one name, with files and candidates that the other has not, and no number in common.
fn plans() -> [String; 2] {
    let one = plan("good", "ct.nii");
    let other = one
        .replace("[2, 0, 0]", "[3, 0, 0]")
        .replace("[0, 3, 0]", "[0, 4, 0]")
        .replace("name = \"up\"", "name = \"high\"");
    [one, other]
}

/// A working folder with both plans, what a run of each leaves there, and how long the second takes.
struct Bench {
    desk: Desk,
    /// With `timings.json` and what is hidden.
    first: Files,
    /// Without `timings.json`.
    results: [Files; 2],
    takes: Duration,
}

impl Bench {
    fn new() -> Self {
        let desk = Desk::new();
        desk.write("ct.nii", nifti());
        let mut takes = Duration::ZERO;
        let mut runs = ["one.toml", "other.toml"]
            .iter()
            .zip(plans())
            .map(|(name, text)| {
                desk.write(name, text);
                let start = Instant::now();
                desk.run(&["run", name]).expect(0);
                takes = start.elapsed();
                let found = (
                    desk.everything("out/good"),
                    desk.results_and_notes("out/good"),
                );
                fs::remove_dir_all(desk.path().join("out")).unwrap();
                found
            });
        let ((first, one), (_, other)) = (runs.next().unwrap(), runs.next().unwrap());
        drop(runs);
        let results = [one, other];
        for (name, content) in &results[0] {
            assert!(
                // The nose as it is is the same.
                name == ".rhinoplan.kept/start.json" || results[1].get(name) != Some(content),
                "{name} tells nothing"
            );
        }
        Self {
            desk,
            first,
            results,
            takes,
        }
    }

    /// As after a run of the first plan.
    fn reset(&self) {
        let _ = fs::remove_dir_all(self.desk.path().join("out"));
        for (name, content) in &self.first {
            self.desk.write(&format!("out/good/{name}"), content);
        }
    }

    /// Starts the second plan over what the first left, lets `kill` end it, and looks at what is there. Whether
    /// it was killed at work, and how many stages of it the next run kept.
    fn killed(&self, kill: impl FnOnce(&mut Started)) -> (bool, u64) {
        self.reset();
        let mut started = self.desk.start(&["run", "other.toml"]);
        kill(&mut started);
        started.end();
        let mut found = self.desk.files("out/good");
        let hidden = found.keys().any(|name| name.starts_with(".rhinoplan-"));
        // Folders are made before files come, and removed after files went.
        found.retain(|name, _| !name.starts_with(".rhinoplan") && !name.ends_with('/'));
        if let Some(timings) = found.remove("timings.json") {
            serde_json::from_slice::<serde_json::Value>(&timings).unwrap();
        }
        for (name, content) in &found {
            let is_whole = self
                .results
                .iter()
                .any(|run| run.get(name) == Some(content));
            assert!(is_whole, "{name} is of neither run");
        }
        if let Some(record) = found.get("run.json") {
            let mut run = self
                .results
                .iter()
                .find(|run| run["run.json"] == *record)
                .unwrap()
                .clone();
            run.retain(|name, _| !name.starts_with(".rhinoplan"));
            assert!(found == run, "a record among files of another run");
        }
        let next = self.desk.run(&["run", "other.toml", "--json"]).expect(0);
        let after = self.desk.results_and_notes("out/good");
        assert_eq!(names(&after), names(&self.results[1]));
        assert!(after == self.results[1]);
        let document = next.document();
        let candidates = document["runs"][0]["candidates"].as_array().unwrap();
        let kept = candidates.iter().map(|of| of["kept"].as_u64().unwrap());
        (hidden, kept.sum())
    }
}

fn interrupt(started: &mut Started) {
    let id = started.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status().unwrap();
    assert!(sent.success() || started.has_ended());
}

/// Twenty moments at random, and Ctrl-C at two. Every next run gives the bytes of one that was not interrupted, and
/// some of them go on from what was computed before.
#[test]
fn killed_at_any_time_the_next_run_is_as_if_nothing_had_happened() {
    let bench = Bench::new();
    let (mut at_work, mut resumed) = (0, 0);
    let mut count = |(at_its_work, kept): (bool, u64)| {
        at_work += usize::from(at_its_work);
        // Both plans have this stage in common with nothing, so what is kept is of the run that was killed.
        resumed += usize::from(at_its_work && kept > 0);
    };
    // A linear congruential generator: the moments are the same each time, what they hit is not.
    let mut random: u32 = 20_261_122;
    for _ in 0..20 {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let delay = bench.takes.mul_f64(f64::from(random) / f64::from(u32::MAX));
        count(bench.killed(|started| {
            std::thread::sleep(delay);
            started.kill();
        }));
    }
    for part in [3, 6] {
        let delay = bench.takes * part / 8;
        count(bench.killed(|started| {
            std::thread::sleep(delay);
            interrupt(started);
        }));
    }
    assert!(
        at_work >= 6,
        "{at_work} of 22 were killed at work, in {:?}",
        bench.takes
    );
    assert!(
        resumed >= 1,
        "none of {at_work} left anything to go on from"
    );
}

/// Putting files in place begins with taking the record away. How far it comes differs from time to time; every
/// step is tried in the tests of `io::staging`.
#[test]
fn killed_while_files_are_put_in_place_the_next_run_is_as_if_nothing_had_happened() {
    let bench = Bench::new();
    let record = bench.desk.path().join("out/good/run.json");
    for _ in 0..3 {
        bench.killed(|started| {
            while record.exists() && !started.has_ended() {
                std::hint::spin_loop();
            }
            started.kill();
        });
    }
}

#[test]
fn a_first_run_that_is_killed_leaves_nothing_that_looks_like_a_result() {
    let bench = Bench::new();
    let mut started = bench.desk.start(&["run", "other.toml"]);
    std::thread::sleep(bench.takes / 2);
    started.kill();
    started.end();
    let out = bench.desk.path().join("out/good");
    if !out.join("run.json").exists() {
        let hidden = |name: std::ffi::OsString| name.to_string_lossy().starts_with(".rhinoplan");
        let mut entries = fs::read_dir(&out).unwrap();
        assert!(entries.all(|entry| hidden(entry.unwrap().file_name())));
    }
    bench.desk.run(&["run", "other.toml"]).expect(0);
    assert!(bench.desk.results_and_notes("out/good") == bench.results[1]);
}

#[test]
fn a_second_run_into_one_folder_is_refused_while_the_first_is_at_work() {
    let bench = Bench::new();
    bench.reset();
    let first = Staging::new(&bench.desk.path().join("out/good")).unwrap();
    let before = bench.desk.files("out/good");
    let lock = &before[".rhinoplan.lock"];
    assert!(lock.is_empty(), "it names nobody");
    let ran = bench.desk.run(&["run", "other.toml", "--json"]).expect(2);
    let told = "cannot write into `out/good`: another run is writing into this folder; \
                wait for its end, or choose another folder";
    assert!(ran.err.contains(told), "{ran:?}");
    let document = ran.document();
    let message = document["errors"][0]["message"].as_str().unwrap();
    assert!(message.contains(told) && document["errors"][1].is_null());
    assert!(bench.desk.files("out/good") == before);
    // Elsewhere it runs.
    bench
        .desk
        .run(&["run", "other.toml", "--out", "there"])
        .expect(0);
    assert!(bench.desk.results_and_notes("there/good") == bench.results[1]);
    drop(first);
    bench.desk.run(&["run", "other.toml"]).expect(0);
    assert!(bench.desk.results_and_notes("out/good") == bench.results[1]);
}

#[test]
fn two_at_once_never_mix() {
    let bench = Bench::new();
    let mut refused = 0;
    for round in 0..4 {
        if round % 2 == 0 {
            let _ = fs::remove_dir_all(bench.desk.path().join("out"));
        }
        let both = ["one.toml", "other.toml"].map(|plan| bench.desk.start(&["run", plan]));
        let ran = both.map(Started::end);
        let codes = [ran[0].code, ran[1].code];
        for ran in &ran {
            if ran.code != 0 {
                assert_eq!(ran.code, 2, "{ran:?}");
                assert!(
                    ran.err.contains("another run is writing into this folder"),
                    "{ran:?}"
                );
                refused += 1;
            }
        }
        let found = bench.desk.results_and_notes("out/good");
        let winner = bench.results.iter().position(|run| *run == found);
        assert!(winner.is_some_and(|winner| codes[winner] == 0), "{codes:?}");
    }
    assert!(refused > 0, "they were never at work at once");
}
