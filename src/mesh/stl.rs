//! Binary STL.

use std::io::{self, Write};

use glam::DVec3;

use super::body::Mesh;
use crate::space::{Grid, GridPoint};

/// The header, padded to 80 bytes. It must not begin with `solid`, which marks the text form. 3D Slicer looks for
/// `SPACE=`, and takes the frame for the one its user set where that is not there.
const HEADER: &[u8] = b"rhinoplan. SPACE=LPS";
const HEADER_LEN: usize = 80;

/// Writes a mesh as binary STL, LPS mm, little endian: 80 bytes of header, the number of triangles, and for each its
/// outward unit normal and three corners.
///
/// # Errors
/// Those of `to`.
pub fn write_stl(mut to: impl Write, mesh: &Mesh, grid: &Grid) -> io::Result<()> {
    let mut header = [0; HEADER_LEN];
    header[..HEADER.len()].copy_from_slice(HEADER);
    to.write_all(&header)?;
    // No mesh has more than 10⁸.
    to.write_all(&(mesh.triangles().len() as u32).to_le_bytes())?;
    let points = InLps::new(mesh, grid);
    for triangle in mesh.triangles() {
        let [a, b, c] = points.turned(triangle).map(|point| points.at(point));
        let corners = [a, b, c].map(|corner| DVec3::from_array(corner.map(f64::from)));
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let normal = normal.normalize_or_zero().as_vec3().to_array();
        let mut record = [0; 50];
        let numbers = [normal, a, b, c];
        let slots = record.chunks_exact_mut(4);
        for (slot, number) in slots.zip(numbers.as_flattened()) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        to.write_all(&record)?;
    }
    to.flush()
}

/// The points of a mesh as files store them.
pub(super) struct InLps {
    points: Vec<[f32; 3]>,
    /// Whether the grid's axes are left-handed, so that turning them over turns triangles round.
    mirrored: bool,
}

impl InLps {
    pub(super) fn new(mesh: &Mesh, grid: &Grid) -> Self {
        let stored = |point: &GridPoint| grid.grid_to_lps(*point).0.as_vec3().to_array();
        Self {
            points: mesh.points().iter().map(stored).collect(),
            mirrored: grid.direction().determinant() < 0.0,
        }
    }

    pub(super) fn at(&self, point: u32) -> [f32; 3] {
        let point = self.points.get(point as usize);
        point.copied().unwrap_or_default()
    }

    pub(super) fn all(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// The triangle as it turns counterclockwise in the patient's frame.
    pub(super) fn turned(&self, &[a, b, c]: &[u32; 3]) -> [u32; 3] {
        if self.mirrored { [a, c, b] } else { [a, b, c] }
    }
}
