//! Valgrind's callgrind, driven.

use std::env;
use std::fs;
use std::path::Path;
use std::process::Command;

use rhinoplan::simd::{Simd, VARIABLE};

use super::Counts;

/// The function within which callgrind counts, and the one after which it writes down how many. One function for both
/// does not do: valgrind 3.19 then heeds only the last of the two options. Neither has closures, which would have its
/// name as well.
const COUNTED: &str = "*counted_by_callgrind*";
const WRITTEN: &str = "*written_by_callgrind*";

/// Why nothing can be counted here, where that is so.
pub fn lacking() -> Option<String> {
    if !cfg!(debug_assertions) || cfg!(target_feature = "avx2") {
        return Some(
            "because the counts are those of the profile `dev`, for any processor".to_owned(),
        );
    }
    let valgrind = Command::new("valgrind").arg("--version").output();
    if !valgrind.is_ok_and(|told| told.status.success()) {
        return Some("because valgrind is not installed".to_owned());
    }
    let has_avx2 = Simd::all().iter().any(|simd| simd.to_string() == "avx2");
    (!has_avx2).then(|| "because this processor has no AVX2".to_owned())
}

/// The instructions of every kernel, of those that `simd` allows: this program is run once more, under valgrind.
pub fn count(simd: &str, names: &[&str]) -> Counts {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("instructions-{simd}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let out = folder.join("callgrind");
    let told = Command::new("valgrind")
        .args(["--tool=callgrind", "--quiet"])
        .arg(format!("--toggle-collect={COUNTED}"))
        .arg(format!("--dump-after={WRITTEN}"))
        .arg(format!("--callgrind-out-file={}", out.display()))
        .arg(env::current_exe().unwrap())
        .args([
            "--exact",
            "every_kernel_once",
            "--ignored",
            "--test-threads=1",
        ])
        .env(VARIABLE, simd)
        .output()
        .unwrap();
    assert!(
        told.status.success(),
        "under valgrind: {}\n{}",
        String::from_utf8_lossy(&told.stdout),
        String::from_utf8_lossy(&told.stderr)
    );
    // A file for each time that the function was left, numbered from 1.
    let counts = names.iter().enumerate().map(|(place, &name)| {
        let file = folder.join(format!("callgrind.{}", place + 1));
        let text = fs::read_to_string(&file).unwrap();
        (name.to_owned(), total(&text))
    });
    counts.collect()
}

/// All instructions of a dump.
fn total(dump: &str) -> u64 {
    let line = dump.lines().find_map(|line| line.strip_prefix("totals: "));
    line.unwrap().trim().parse().unwrap()
}
