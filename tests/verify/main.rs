//! The plans that ship, held against `golden/verify/` by the program itself, as a user's plans would be.
//!
//! Where results should change, look at `target/verify/report.md`, renew what is kept with
//!
//! ```sh
//! cargo run -- bless plans/*.toml --golden golden/verify
//! ```
//!
//! and say why in CHANGELOG.md.

#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests, which clippy does not take for tests"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Everything that is kept, bytes: it is downloaded with the sources.
const MOST_BYTES: u64 = 2_000_000;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every plan that ships, sorted.
fn plans() -> Vec<PathBuf> {
    let entries = fs::read_dir(root().join("plans")).unwrap();
    let mut plans: Vec<_> = entries
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "toml")
        })
        .collect();
    plans.sort_by_key(|plan| name(plan).to_owned());
    plans
}

fn name(plan: &Path) -> &str {
    plan.file_stem().unwrap().to_str().unwrap()
}

/// Every file of a folder, with its size.
fn files(folder: &Path) -> Vec<(PathBuf, u64)> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(self::files(&path));
        } else {
            let size = path.metadata().unwrap().len();
            files.push((path, size));
        }
    }
    files
}

#[test]
fn every_plan_gives_what_is_kept_of_it() {
    let plans = plans();
    let mut command = Command::new(env!("CARGO_BIN_EXE_rhinoplan"));
    command.current_dir(root()).arg("verify").args(&plans);
    let command = command.args(["--golden", "golden/verify", "--json"]);
    let ran = command
        .args(["--report", "target/verify"])
        .output()
        .unwrap();
    // With --json the tables are there.
    let told = String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(0), "{told}");
    let document: Value = serde_json::from_slice(&ran.stdout).unwrap();
    let verified = document["plans"].as_array().unwrap();
    assert_eq!(verified.len(), plans.len());
    for (plan, verified) in plans.iter().zip(verified) {
        assert_eq!(verified["plan"], name(plan));
        assert_eq!(verified["agrees"], true);
        assert!(
            verified["expected"]["numbers"].as_u64().unwrap() >= 69,
            "{verified}"
        );
    }
    // All kinds of things are compared.
    for kind in ["pictures", "volumes"] {
        let of = |plan: &Value| plan["expected"][kind].as_u64().unwrap();
        assert!(verified.iter().map(of).sum::<u64>() > 10, "{kind}");
    }
}

#[test]
fn the_folder_holds_these_plans_and_no_others_and_is_small() {
    let golden = root().join("golden/verify");
    let mut folders: Vec<_> = fs::read_dir(&golden)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_dir())
        .map(|path| path.file_name().unwrap().to_str().unwrap().to_owned())
        .collect();
    folders.sort();
    let plans = plans();
    assert_eq!(
        folders,
        plans.iter().map(|plan| name(plan)).collect::<Vec<_>>()
    );
    let bytes: u64 = files(&golden).iter().map(|(_, size)| size).sum();
    assert!(bytes < MOST_BYTES, "{bytes} bytes");
    // They run wherever the sources are.
    for plan in &plans {
        let text = fs::read_to_string(plan).unwrap();
        assert!(
            text.contains("phantom = \"lee2001\"") && !text.contains(".."),
            "{}",
            name(plan)
        );
    }
}
