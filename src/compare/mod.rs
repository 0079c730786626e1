//! Noses held against the nose as it is, against the limits of a plan, and against each other.
//!
//! Numbers in, numbers out: the measures of `measurements.csv` by their names, whoever measured them. The
//! distance between surfaces is found in [`crate::surface`]; here it only has a place among the rest.

mod accept;
mod change;
mod measure;
mod sweep;

pub use accept::{Accept, Checked, Limit, Quantity, Verdict};
pub use change::{Change, SurfaceDifference};
pub(crate) use measure::COUNT;
pub use measure::{BareNumber, MEASURES, Measure, measure};
pub use sweep::{Sweep, SweepLine, SweepLines, Swept, SweptCandidate, SweptNumber};
