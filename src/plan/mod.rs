//! Plans: what a surgeon writes, and what the program runs.
//!
//! A plan file becomes a [`Plan`], in which every default is filled in, every unit is resolved and every
//! position is in grid millimetres, so that nothing after it meets a unit, a default or a missing key.

mod resolved;

pub use resolved::{
    Candidate, CtSource, DEFAULT_BONE_HU, DEFAULT_CAGE_DEPTH_MM, DEFAULT_MARGIN_MM,
    DEFAULT_SKIN_HU, DEFAULT_TOLERANCE, Method, Model, Morph, Outputs, Phantom, Plan, Scale,
    Segment, Stage, Tolerance,
};
