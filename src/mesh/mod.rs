//! Closed triangle meshes of the surfaces in a volume, and of what an operation adds and takes away.
//!
//! - [`isosurface`]: the surface of an object, its vertices where HU reach the threshold; closed at the end of
//!   the scan.
//! - [`smooth`]: without shrinking; [`decimate()`]: down to a number of triangles. A closed mesh stays closed.
//! - [`surface_change`]: how far a mesh lies outside or inside another surface.
//! - [`solid`]: the bodies between the skin before and after.
//! - [`write_stl`], [`write_ply`]: the files, in the patient's frame.
//!
//! Everything but the files is in grid millimetres. A mesh that comes from here is a closed oriented
//! 2-manifold, normals pointing out of the object; [`Mesh::topology`] counts what is not.

mod body;
mod change;
mod cube;
mod decimate;
mod extract;
mod ply;
mod smooth;
pub mod solid;

mod stl;

#[cfg(test)]
mod tests;

pub use body::{Mesh, MeshError, Topology};
pub use change::{ChangeFrom, surface_change};
pub use decimate::decimate;
pub use extract::{Crossing, extract, is_cut, isosurface};
pub use ply::{Coloured, write_ply};
pub use smooth::{SMOOTHING, smooth};
pub use stl::write_stl;
