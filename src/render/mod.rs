//! Semi-boundary surface rendering: orthographic pictures of an object's boundary voxels, without a mesh, a
//! GPU or a display.
//!
//! Each boundary voxel is drawn as a small disc in the plane of its surface (`splat.rs`); a first pass
//! finds the foremost disc of every pixel, a second blends the normals of the discs at that depth
//! (`layer.rs`, `span.rs`), and only then is a pixel shaded (`shade.rs`) and its edge smoothed (`edge.rs`, `compose.rs`).
//!
//! Sources: T.-Y. Lee et al., reference 14 of the paper, for projecting the semi-boundary row by row in an order
//! that the octant of the viewing direction gives, voxels culled by their neighbour code; M. Botsch,
//! A. Hornung, M. Zwicker, L. Kobbelt, *High-Quality Surface Splatting on Today's GPUs*, Eurographics
//! Symposium on Point-Based Graphics 2005, DOI 10.2312/SPBG/SPBG05/017-024, for the two passes and
//! deferred shading.

mod camera;
mod compose;
mod edge;
mod layer;
mod memory;
mod shade;
mod span;
mod splat;
mod squares;

pub use camera::{Camera, CameraError, Direction, Projected};
pub use compose::{Frame, Hit, Object, render};
pub use shade::{BACKGROUND, BONE, Paint, SKIN};

#[cfg(test)]
mod tests;
