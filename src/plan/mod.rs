//! Plans: what a surgeon writes, and what the program runs.
//!
//! A plan file becomes a [`Plan`], in which every default is filled in, every unit is resolved and every
//! position is in grid millimetres, so that nothing after it meets a unit, a default or a missing key.
//!
//! ```text
//! text ── decode ──> raw plan (as written, with places) ── resolve, with the CT's grid ──> Plan
//!            └───────────────── faults ─────────────────────┴──> Diagnostics
//! ```
//!
//! [`PlanFile`] is both steps. Faults never stop either step: they are noted, and all reported together.

mod decode;
mod diagnostic;
mod duplicates;
mod effective;
mod file;
mod format;
mod raw;
mod resolve;
mod resolved;
mod schema;
mod source;

pub use diagnostic::{Code, Diagnostic, Diagnostics};
pub use effective::Found;
pub use file::{MAX_PLAN_BYTES, PlanFile, PlanReadError};
pub(crate) use format::MAX_CANDIDATES;
pub use resolved::{
    Camera, Candidate, Clip, Crop, CtSource, CutPlane, DEFAULT_BONE_HU, DEFAULT_CAGE_DEPTH_MM,
    DEFAULT_MARGIN_MM, DEFAULT_SKIN_HU, DEFAULT_TOLERANCE, DEFAULT_VIEW_SIZE, DrawnObject, Enhance,
    MeshSettings, Method, Model, Morph, Object, Outputs, Phantom, Plan, STANDARD_VIEWS, Scale,
    Segment, Side, SkinThreshold, Stage, StandardView, Tolerance, Views,
};
pub use schema::schema;
