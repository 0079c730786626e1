//! What must be true of every file of landmarks that was read.

use rhinoplan::feature::Landmark;
use rhinoplan::io::landmarks::{CoordinateSystem, LandmarkFile, parse};

use crate::noise::{Outcome, assert_clear};

/// A sound file's points: inside the program's head, LPS mm.
pub const AT: [[f64; 3]; 6] = [
    [0.0, -3.0, 18.0],
    [0.0, -3.0, -18.0],
    [-15.0, -6.0, -6.0],
    [15.0, -6.0, -6.0],
    [0.0, -24.0, -3.0],
    [0.0, 0.0, -6.0],
];

/// Words and numbers that cells and values are bad at.
pub const WORDS: [&str; 30] = [
    "NaN",
    "nan",
    "inf",
    "-Infinity",
    "1e999",
    "-1e999",
    "1e308",
    "1e-400",
    "0x10",
    "1,5",
    "1_000",
    "+1",
    "-",
    ".",
    "",
    " ",
    "null",
    "true",
    "\"\"",
    "[]",
    "{}",
    "tip",
    "lip",
    "LPS",
    "RAS",
    "0",
    "1",
    "99999999999999999999",
    "\u{0}",
    "\u{202e}tip",
];

#[track_caller]
fn assert_plausible(file: &LandmarkFile) {
    assert_eq!(file.sha256.len(), 64);
    let lps = file.lps();
    for landmark in Landmark::ALL {
        let at = *file.points.get(landmark);
        assert!(at.iter().all(|mm| mm.is_finite()), "{landmark}: {at:?}");
        let turned = match file.system {
            CoordinateSystem::Lps => at,
            CoordinateSystem::Ras => [-at[0], -at[1], at[2]],
        };
        assert_eq!(lps.get(landmark).0.to_array(), turned);
    }
}

/// What [`parse`] says of a file: read and plausible, `assert_found` in its text; or refused, clearly and because
/// it was changed.
pub fn judged(
    bytes: &[u8],
    is_changed: bool,
    index: usize,
    assert_found: impl Fn(&str, &LandmarkFile),
) -> Outcome {
    match parse(bytes) {
        Ok(file) => {
            assert_plausible(&file);
            assert_found(std::str::from_utf8(bytes).unwrap(), &file);
            Outcome::Read
        }
        Err(problem) => {
            assert!(is_changed, "case {index} is sound: {problem}");
            assert_clear(&problem.to_string());
            Outcome::Refused
        }
    }
}
