//! Hostile input: every kind of file that the program reads, damaged in every way of a fixed list and at random.
//!
//! - A corpus for each format, and for what is no file at all (`disk.rs`), goes through the program as a process with
//!   200 MiB of memory: exit code, one clear error, no panic, at once, earlier outputs unharmed (`bounded.rs`).
//! - A fuzz target for each format calls the library: each case is read or refused within a bound of time and memory,
//!   and what is read is plausible. `noise.rs` says how to run more of them.
//!
//! `tests/dicom/fuzz.rs` is DICOM's fuzz target; `tests/nifti/hostile.rs`, `tests/dicom/hostile.rs` and the unit tests
//! of `io/` hold the messages of single fields. What is promised is in `docs/hostile-input.md`.

#![cfg(unix)]
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "helpers of tests, which clippy does not take for tests"
)]

mod bounded;
mod dicom;
mod disk;
mod fcsv;
mod json;
mod names;
mod nifti;
mod noise;
mod nrrd;
mod plan;
mod points;
mod volumes;

#[path = "../nifti/builder.rs"]
#[allow(dead_code, unused_imports, reason = "shared with the tests of NIfTI")]
mod nifti_builder;

#[path = "../dicom/builder.rs"]
#[allow(dead_code, reason = "shared with the tests of DICOM")]
mod dicom_builder;

#[path = "../cli/head.rs"]
#[allow(dead_code, reason = "shared with the tests of the program")]
mod head;
#[path = "../cli/process.rs"]
#[allow(dead_code, reason = "shared with the tests of the program")]
mod process;
