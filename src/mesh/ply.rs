//! Binary PLY with the change of the surface as numbers and colours.

use std::io::{self, Write};

use super::body::Mesh;
use super::stl::InLps;
use crate::space::Grid;

/// What a vertex carries besides its place.
#[derive(Debug, Clone, Copy)]
pub struct Coloured<'a> {
    /// For each point how far the surface moved, mm; positive is outward; NaN where that is not known.
    pub change_mm: &'a [f32],
    /// The change, mm, that has the strongest colour; above 0.
    pub limit_mm: f64,
    /// The colour of a share of that, from -1 to 1; also of what is not a number.
    pub colour: fn(f64) -> [u8; 3],
}

/// Writes a mesh as PLY (`binary_little_endian 1.0`), LPS mm: each vertex with its `change_mm` as a float and its
/// colour, each face three vertices.
///
/// # Errors
/// Those of `to`.
pub fn write_ply(
    mut to: impl Write,
    mesh: &Mesh,
    grid: &Grid,
    data: &Coloured<'_>,
) -> io::Result<()> {
    let (vertices, faces) = (mesh.points().len(), mesh.triangles().len());
    let limit = data.limit_mm;
    write!(
        to,
        "ply\nformat binary_little_endian 1.0\ncomment rhinoplan. SPACE=LPS\n\
         comment coordinates are LPS mm\n\
         comment change_mm is the distance to the preoperative surface, positive outward\n\
         comment colours are blue at -{limit:.3} mm, grey at 0, red at {limit:.3} mm\n\
         element vertex {vertices}\n\
         property float x\nproperty float y\nproperty float z\nproperty float change_mm\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )?;
    let points = InLps::new(mesh, grid);
    for (place, at) in points.all().iter().enumerate() {
        let change = data.change_mm.get(place).copied().unwrap_or(f32::NAN);
        let mut record = [0; 19];
        let (numbers, colour) = record.split_at_mut(16);
        let [x, y, z] = *at;
        for (slot, number) in numbers.chunks_exact_mut(4).zip([x, y, z, change]) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        colour.copy_from_slice(&(data.colour)(f64::from(change) / limit));
        to.write_all(&record)?;
    }
    for triangle in mesh.triangles() {
        let mut record = [3; 13];
        let indices = record[1..].chunks_exact_mut(4);
        for (slot, point) in indices.zip(points.turned(triangle)) {
            slot.copy_from_slice(&point.to_le_bytes());
        }
        to.write_all(&record)?;
    }
    to.flush()
}
