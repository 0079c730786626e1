//! The semi-boundary: the voxels on the surface of an object, row by row, in eight bytes each.
//!
//! Source: J. K. Udupa, D. Odhner, *Fast visualization, manipulation, and analysis of binary volumetric
//! objects*, IEEE Computer Graphics and Applications 11(6), 1991, DOI 10.1109/38.103394 (reference 13 of the paper).

mod boundary;
mod build;
mod difference;
mod distance;
mod facing;
mod normal;
mod packed;
mod points;
mod sight;

pub use boundary::{BoundaryVoxel, NeighbourCode, SemiBoundary, SurfaceError};
pub use build::{Region, semi_boundary, semi_boundary_in};
pub use difference::{
    ComparedSkin, MOVED_MM, SeenSkin, SkinBefore, SkinDifference, skin_difference,
};
pub use distance::{SurfaceDistance, signed_distances};
pub use facing::{NearestFacing, nearest_facing};
pub use normal::PackedNormal;

#[cfg(test)]
mod tests;
