//! The semi-boundary: the voxels on the surface of an object, row by row, in eight bytes each.
//!
//! Source: J. K. Udupa, D. Odhner, *Fast visualization, manipulation, and analysis of binary volumetric
//! objects*, IEEE Computer Graphics and Applications 11(6), 1991, DOI 10.1109/38.103394 (the paper's \[13\]).

mod boundary;
mod build;
mod distance;
mod normal;

pub use boundary::{BoundaryVoxel, NeighbourCode, SemiBoundary, SurfaceError};
pub use build::{Region, semi_boundary};
pub use distance::{SurfaceDistance, signed_distances};
pub use normal::PackedNormal;

#[cfg(test)]
mod tests;
