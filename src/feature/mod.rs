//! What the surgeon marks: six landmarks, the feature line f1 and its edits, and the cage f2..f9 that
//! holds the rest of the head (paper section III, Figs. 5 and 6).

mod cage;
mod edit;
mod landmarks;
mod line;

pub use cage::{ANTERIOR_CLEARANCE_MM, Cage, NoseBox};
pub use edit::{Edit, apply_edits};
pub use landmarks::{Landmark, Landmarks};
pub use line::{FeatureKind, FeatureLine, LineError, MIN_LENGTH_MM};
