//! What must be true of every file of landmarks that was read.

use rhinoplan::feature::Landmark;
use rhinoplan::io::landmarks::{CoordinateSystem, LandmarkFile};

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
pub fn assert_plausible(file: &LandmarkFile) {
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
