//! DICOM series of every kind, sound and malformed. Sound ones are written with `dicom-object`, which the reader
//! under test does not use; malformed ones are those, damaged.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "helpers of tests, which clippy does not take for tests"
)]

mod builder;
mod fuzz;
mod geometry;
mod hostile;
#[path = "../hostile/noise.rs"]
#[allow(dead_code, reason = "shared with the tests of hostile input")]
mod noise;
mod packed;
mod program;
mod real;
#[path = "../real_data/mod.rs"]
mod real_data;
mod selection;
mod values;

#[path = "../cli/head.rs"]
#[allow(dead_code, reason = "shared with the tests of the program")]
mod head;
#[path = "../cli/process.rs"]
#[allow(dead_code, reason = "shared with the tests of the program")]
mod process;
