//! What a run found, as data and as tables. Nothing here computes a measure.
//!
//! [`record`] is what everything else is written from; [`csv`] and [`markdown`] are two views of it, [`comparison`]
//! is its candidates beside each other.

pub mod comparison;
pub mod csv;
pub mod markdown;
pub mod meshes;
pub mod record;
pub mod sweep;
