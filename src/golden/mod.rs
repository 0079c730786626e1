//! What a plan gave, kept to be held against what it gives later: numbers, small pictures, hashes of volumes.
//!
//! [`Stored`] is what is kept of a plan; [`Settings`] how far what is found may be from it. [`numbers`], [`pictures`]
//! and [`volumes`] compare, and give a [`Difference`] for everything that is further away; [`report`] puts them in a
//! table. Everything here works on values: reading and writing is left to `exec/golden/`.

pub mod difference;
pub mod numbers;
pub mod pictures;
pub mod report;
pub mod stored;
pub mod tolerance;
pub mod volumes;

pub use difference::{Cell, Counts, Difference, Kind, Verdict};
pub use stored::{Inputs, Number, Stored, StoredError, StoredVolume};
pub use tolerance::{Compare, Settings, SettingsError};
