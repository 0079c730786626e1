//! The program as a process: what it prints, writes and ends with.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "helpers of tests, which clippy does not take for tests"
)]

mod accept;
mod across;
mod anatomy;
mod check;
mod compare;
mod disk;
mod effective;
mod exits;
mod failures;
mod golden;
mod head;
mod killed;
mod landmarks;
mod left_over;
mod meshes;
mod nrrd;
mod outputs;
mod pictures;
mod process;
mod real;
#[path = "../real_data/mod.rs"]
mod real_data;
mod resume;
mod same;
mod schema;
mod skin;
mod snap;
mod sweep;
mod volumes;
