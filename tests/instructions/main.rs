//! How many instructions the hot loops take, counted by valgrind and held against `counts.toml`: unlike times, counts
//! are the same however busy the machine is.
//!
//! They are those of the build that tests use, so that counting builds nothing more. Where they are meant to change:
//!
//! ```sh
//! RHINOPLAN_UPDATE_COUNTS=1 cargo test --test instructions
//! ```
#![cfg(target_arch = "x86_64")]
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test stops where something is wrong"
)]

mod callgrind;
mod kernels;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::{self, Write as _};
use std::path::Path;
use std::process::Command;
use std::thread;

use serde::Deserialize;

/// Instructions of each kernel, by its name.
type Counts = BTreeMap<String, u64>;

/// What is kept.
#[derive(Debug, Deserialize)]
struct Kept {
    /// The compiler of these counts.
    rustc: String,
    /// Without instructions that only some processors have.
    off: Counts,
    /// With AVX2. There are none with AVX-512: valgrind does not know it.
    avx2: Counts,
}

/// How far a count may be from that which is kept, as a share of it.
const TOLERANCE: f64 = 0.05;
/// The same with another compiler than that of the kept counts: enough to see a loop that is no longer vectorised.
const TOLERANCE_OF_ANOTHER_COMPILER: f64 = 0.4;

const KEPT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/tests/instructions/counts.toml"
);

#[test]
fn the_hot_loops_take_no_more_instructions() {
    if let Some(reason) = callgrind::lacking() {
        writeln!(
            io::stderr(),
            "skipped: instructions are not counted, {reason}"
        )
        .unwrap();
        return;
    }
    let [off, avx2] = thread::scope(|scope| {
        ["off", "avx2"]
            .map(|simd| scope.spawn(move || callgrind::count(simd, &kernels::names())))
            .map(|counting| counting.join().unwrap())
    });
    let found = Kept {
        rustc: rustc(),
        off,
        avx2,
    };
    if std::env::var_os("RHINOPLAN_UPDATE_COUNTS").is_some() {
        fs::write(KEPT, shown(&found)).unwrap();
        return;
    }
    let kept: Kept = toml::from_str(&fs::read_to_string(Path::new(KEPT)).unwrap()).unwrap();
    let faults = faults(&kept, &found);
    assert!(
        faults.is_empty(),
        "instructions differ from tests/instructions/counts.toml:\n{faults}\
         If that is meant: RHINOPLAN_UPDATE_COUNTS=1 cargo test --test instructions, and say why in the commit."
    );
}

/// What is run under valgrind, by the test above.
#[test]
#[ignore = "is run by the other test, under valgrind"]
fn every_kernel_once() {
    kernels::run_all();
}

fn rustc() -> String {
    let told = Command::new("rustc").arg("--version").output();
    told.map_or_else(
        |_| "unknown".to_owned(),
        |told| String::from_utf8_lossy(&told.stdout).trim().to_owned(),
    )
}

/// A line for each count that is too far from that which is kept, above or below: a gain that is not kept guards
/// nothing.
fn faults(kept: &Kept, found: &Kept) -> String {
    let tolerance = if kept.rustc == found.rustc {
        TOLERANCE
    } else {
        TOLERANCE_OF_ANOTHER_COMPILER
    };
    let mut faults = String::new();
    for (simd, kept, found) in [
        ("off", &kept.off, &found.off),
        ("avx2", &kept.avx2, &found.avx2),
    ] {
        let names: std::collections::BTreeSet<_> = kept.keys().chain(found.keys()).collect();
        for name in names {
            match (kept.get(name), found.get(name)) {
                (Some(&kept), Some(&found)) => {
                    let change = found as f64 / kept as f64 - 1.0;
                    if change.abs() > tolerance {
                        let percent = 100.0 * change;
                        let most = 100.0 * tolerance;
                        writeln!(
                            faults,
                            "  {name}, {simd}: {found} instead of {kept} ({percent:+.1} %, more than {most:.0} %)"
                        )
                        .unwrap();
                    }
                }
                (None, _) => writeln!(faults, "  {name}, {simd}: no count is kept").unwrap(),
                (_, None) => writeln!(faults, "  {name}, {simd}: there is no such kernel").unwrap(),
            }
        }
    }
    faults
}

/// As TOML.
fn shown(counts: &Kept) -> String {
    let mut text = format!(
        "# Instructions of each kernel on a small head; written by the test beside it.\nrustc = {:?}\n",
        counts.rustc
    );
    for (simd, counts) in [("off", &counts.off), ("avx2", &counts.avx2)] {
        writeln!(text, "\n[{simd}]").unwrap();
        for (name, count) in counts {
            writeln!(text, "{name} = {count}").unwrap();
        }
    }
    text
}

fn kept(rustc: &str, sampling: u64) -> Kept {
    let counts = Counts::from([("sampling".to_owned(), sampling)]);
    Kept {
        rustc: rustc.to_owned(),
        off: counts.clone(),
        avx2: counts,
    }
}

#[test]
fn a_count_that_changed_is_a_fault() {
    let before = kept("rustc 1", 1000);
    assert_eq!(faults(&before, &kept("rustc 1", 1049)), "");
    let more = faults(&before, &kept("rustc 1", 1060));
    assert!(
        more.contains("sampling, avx2: 1060 instead of 1000 (+6.0 %"),
        "{more}"
    );
    assert!(faults(&before, &kept("rustc 1", 900)).contains("-10.0 %"));
    assert_eq!(faults(&before, &kept("rustc 2", 1060)), "");
    assert!(faults(&before, &kept("rustc 2", 1500)).contains("+50.0 %"));
}

#[test]
fn a_kernel_that_is_missing_is_a_fault() {
    let counts = kept("rustc 1", 1000);
    let mut fewer = kept("rustc 1", 1000);
    fewer.off.clear();
    assert!(faults(&counts, &fewer).contains("sampling, off: there is no such kernel"));
    assert!(faults(&fewer, &counts).contains("sampling, off: no count is kept"));
}

#[test]
fn what_is_kept_is_read_as_it_was_written() {
    let read: Kept = toml::from_str(&shown(&kept("rustc 1", 7))).unwrap();
    assert_eq!(read.rustc, "rustc 1");
    assert_eq!(read.off["sampling"], 7);
    assert_eq!(read.avx2["sampling"], 7);
}
