//! Frames and the one type that converts between them.
//!
//! | type | is | unit |
//! |---|---|---|
//! | [`ContinuousIndex`] | a position on the voxel lattice, LPS order, voxel centres at integers | voxel |
//! | [`GridPoint`], [`GridVector`] | index × spacing per axis, no rotation: where lines, boxes and measurements live | mm |
//! | [`LpsPoint`], [`LpsVector`] | the patient's frame of DICOM and ITK: left, posterior, superior | mm |
//! | [`RasPoint`], [`RasVector`] | NIfTI's frame: right, anterior, superior; only at the edge of the program | mm |
//!
//! Only a [`Grid`] takes a position from one to another.

mod frames;
mod grid;
mod ras;

pub use frames::{ContinuousIndex, GridPoint, GridVector, LpsPoint, LpsVector};
pub use grid::{Grid, GridError, MAX_AXIS_LENGTH};
pub use ras::{RasPoint, RasVector, lps_axes_to_ras, ras_axes_to_lps};
