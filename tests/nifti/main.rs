//! NIfTI-1 files of every kind, sound and malformed, built byte by byte here: nothing of the reader or the
//! writer under test takes part in making them.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "helpers of tests, which clippy does not take for tests"
)]

mod affine;
mod builder;
mod displacement;
mod hostile;
#[path = "../hostile/noise.rs"]
#[allow(dead_code, reason = "shared with the tests of hostile input")]
mod noise;
mod real;
#[path = "../real_data/mod.rs"]
mod real_data;
mod roundtrip;
