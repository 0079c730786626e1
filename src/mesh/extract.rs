//! From a set of voxels to the mesh of its surface.

use glam::DVec3;
use rayon::prelude::*;

use super::body::{MAX_TRIANGLES, Mesh, MeshError, room};
use super::cube::{EDGE_START, cases};
use crate::space::{Grid, GridPoint};
use crate::volume::{Mask, Sample, Volume, VolumeError};

/// How near a vertex may come to a voxel's centre, as a share of the distance to the next. Vertices on different
/// edges then never coincide, and no triangle is without an area.
const MARGIN: f64 = 0.01;

/// Where the surface passes between two neighbouring voxels.
pub trait Crossing: Sync {
    /// How far from the voxel `inside` to its face neighbour `outside`, as a share of their distance: taken
    /// as the nearest from 0.01 to 0.99, and as a half where it is not a number.
    fn share(&self, inside: [usize; 3], outside: [usize; 3]) -> f64;
}

impl<F: Fn([usize; 3], [usize; 3]) -> f64 + Sync> Crossing for F {
    fn share(&self, inside: [usize; 3], outside: [usize; 3]) -> f64 {
        self(inside, outside)
    }
}

/// The surface of the object `mask`, which was segmented from `volume` by `threshold_hu`: closed, its vertices on
/// the lines between neighbouring voxels, where HU, linear between the two, reach the threshold. Where the scan
/// ends, the object does as well, flat and half a voxel beyond the last centre.
///
/// # Errors
/// [`MeshError`] where the mask is not of the volume, or the surface too large for the machine or for a
/// file.
pub fn isosurface<T: Sample>(
    volume: &Volume<T>,
    mask: &Mask,
    threshold_hu: f64,
) -> Result<Mesh, MeshError> {
    let grid = volume.grid();
    if mask.dims() != grid.dims() {
        return Err(VolumeError::Shape {
            found: mask.dims(),
            expected: grid.dims(),
        }
        .into());
    }
    let [nx, ny, _] = grid.dims();
    let samples = volume.as_slice();
    let hu = |[x, y, z]: [usize; 3]| {
        let sample = samples.get((z * ny + y) * nx + x).copied();
        volume.rescale().to_hu(sample.unwrap_or_default().to_f64())
    };
    let crossing = |inside: [usize; 3], outside: [usize; 3]| {
        let (inside, outside) = (hu(inside), hu(outside));
        (inside - threshold_hu) / (inside - outside)
    };
    extract(mask, grid.spacing(), GridPoint(DVec3::ZERO), &crossing)
}

/// The surface of a set of voxels whose first centre is at `first`, closed as in [`isosurface`].
///
/// # Errors
/// As [`isosurface`].
pub fn extract(
    mask: &Mask,
    spacing: DVec3,
    first: GridPoint,
    crossing: &impl Crossing,
) -> Result<Mesh, MeshError> {
    let lattice = Padded::new(mask);
    // Planes of voxels, the two beyond the ends among them; each has the vertices on the edges that begin in it.
    let planes: Vec<Vec<Vertex>> = (0..lattice.dims[2])
        .into_par_iter()
        .map_init(
            || [const { Vec::new() }; 2],
            |flags, z| lattice.vertices(z, flags, crossing),
        )
        .collect();
    let mut begins = room(planes.len() + 1)?;
    let mut total = 0;
    for plane in &planes {
        begins.push(total as u32);
        total += plane.len();
        // A closed surface has about two triangles for each point.
        if total > MAX_TRIANGLES / 2 {
            return Err(MeshError::TooMany(total.saturating_mul(2)));
        }
    }
    let layers: Vec<Vec<[u32; 3]>> = (1..planes.len())
        .into_par_iter()
        .map_init(
            || Lookup::new(&lattice),
            |lookup, z| lookup.triangles(&lattice, &planes, &begins, z - 1),
        )
        .collect();
    let count: usize = layers.iter().map(Vec::len).sum();
    let mut triangles = room(count)?;
    for layer in layers {
        triangles.extend(layer);
    }
    let mut points = room(total)?;
    for (z, plane) in planes.into_iter().enumerate() {
        let place = |vertex: &Vertex| {
            let node = (vertex.edge / 3) as usize;
            let [nx, _, _] = lattice.dims;
            let mut at = DVec3::new((node % nx) as f64, (node / nx) as f64, z as f64);
            at[(vertex.edge % 3) as usize] += vertex.share;
            // Node 0 is the voxel before the first.
            GridPoint(first.0 + (at - DVec3::ONE) * spacing)
        };
        points.extend(plane.iter().map(place));
    }
    Ok(Mesh { points, triangles })
}

/// Whether a point of an [`isosurface`] is where the scan ends, and not on the object's own surface.
pub fn is_cut(grid: &Grid, point: GridPoint) -> bool {
    !grid.contains(grid.grid_to_index(point))
}

/// A vertex on an edge of the lattice.
#[derive(Debug, Clone, Copy)]
struct Vertex {
    /// Three times the node that the edge begins at, counted within its plane, and the axis.
    edge: u32,
    /// From that node, as a share of the edge.
    share: f64,
}

/// A mask with a layer of voxels outside around it.
struct Padded<'a> {
    mask: &'a Mask,
    dims: [usize; 3],
}

impl<'a> Padded<'a> {
    fn new(mask: &'a Mask) -> Self {
        Self {
            mask,
            dims: mask.dims().map(|n| n + 2),
        }
    }

    /// Puts a plane into `flags`, a byte for each node; whether any is inside.
    fn unpack(&self, z: usize, flags: &mut Vec<u8>) -> bool {
        let [nx, ny, nz] = self.dims;
        flags.clear();
        flags.resize(nx * ny, 0);
        if z == 0 || z + 1 >= nz {
            return false;
        }
        let mut any = false;
        for (y, row) in flags.chunks_exact_mut(nx).enumerate().take(ny - 1).skip(1) {
            let words = self.mask.row(y - 1, z - 1);
            if words.iter().all(|&word| word == 0) {
                continue;
            }
            any = true;
            for (to, word) in row[1..nx - 1].chunks_mut(64).zip(words) {
                for (bit, to) in to.iter_mut().enumerate() {
                    *to = (word >> bit & 1) as u8;
                }
            }
        }
        any
    }

    /// The vertices on the edges that begin in plane `z`, in order.
    fn vertices(
        &self,
        z: usize,
        [here, above]: &mut [Vec<u8>; 2],
        crossing: &impl Crossing,
    ) -> Vec<Vertex> {
        let any = self.unpack(z, here);
        let mut vertices = Vec::new();
        if !(self.unpack(z + 1, above) || any) {
            return vertices;
        }
        let [nx, ny, _] = self.dims;
        for y in 0..ny {
            for x in 0..nx {
                let node = y * nx + x;
                let inside = here[node];
                let ends = [
                    (x + 1 < nx).then(|| here[node + 1]),
                    (y + 1 < ny).then(|| here[node + nx]),
                    Some(above[node]),
                ];
                for (axis, end) in ends.into_iter().enumerate() {
                    if end.is_some_and(|end| end != inside) {
                        let share = self.share([x, y, z], axis, inside != 0, crossing);
                        vertices.push(Vertex {
                            edge: (node * 3 + axis) as u32,
                            share,
                        });
                    }
                }
            }
        }
        vertices
    }

    /// Where the surface crosses the edge from a node along an axis.
    fn share(&self, node: [usize; 3], axis: usize, inside: bool, by: &impl Crossing) -> f64 {
        let mut next = node;
        next[axis] += 1;
        let voxel = |node: [usize; 3]| {
            let within = (0..3).all(|axis| node[axis] > 0 && node[axis] + 1 < self.dims[axis]);
            within.then(|| node.map(|n| n - 1))
        };
        // Half a voxel beyond the last.
        let (Some(from), Some(to)) = (voxel(node), voxel(next)) else {
            return 0.5;
        };
        let share = match inside {
            true => by.share(from, to),
            false => by.share(to, from),
        };
        let share = if share.is_nan() { 0.5 } else { share };
        let share = share.clamp(MARGIN, 1.0 - MARGIN);
        if inside { share } else { 1.0 - share }
    }
}

/// Memory for one worker: a layer of cells, and the numbers of the vertices on its edges.
struct Lookup {
    flags: [Vec<u8>; 2],
    /// For each edge that begins in the two planes, as [`Vertex::edge`].
    numbers: [Vec<u32>; 2],
}

impl Lookup {
    fn new(lattice: &Padded<'_>) -> Self {
        let [nx, ny, _] = lattice.dims;
        let numbers = || vec![0; nx * ny * 3];
        Self {
            flags: [Vec::new(), Vec::new()],
            numbers: [numbers(), numbers()],
        }
    }

    /// The triangles of the cells between planes `z` and `z + 1`.
    fn triangles(
        &mut self,
        lattice: &Padded<'_>,
        planes: &[Vec<Vertex>],
        begins: &[u32],
        z: usize,
    ) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        for side in 0..2 {
            let (plane, begin) = (&planes[z + side], begins[z + side]);
            // Numbers that are left from another layer are never asked for: their edges are not crossed.
            for (number, vertex) in plane.iter().enumerate() {
                self.numbers[side][vertex.edge as usize] = begin + number as u32;
            }
        }
        let [below, above] = &mut self.flags;
        let any = lattice.unpack(z, below);
        if !(lattice.unpack(z + 1, above) || any) {
            return triangles;
        }
        let [nx, ny, _] = lattice.dims;
        for y in 0..ny - 1 {
            for x in 0..nx - 1 {
                let node = y * nx + x;
                let corners = |plane: &[u8]| {
                    plane[node]
                        | plane[node + 1] << 1
                        | plane[node + nx] << 2
                        | plane[node + nx + 1] << 3
                };
                let case = corners(below) | corners(above) << 4;
                if case == 0 || case == u8::MAX {
                    continue;
                }
                let number = |edge: u8| {
                    let start = EDGE_START[usize::from(edge)];
                    let node = node + (start & 1) + (start >> 1 & 1) * nx;
                    self.numbers[start >> 2][node * 3 + usize::from(edge) / 4]
                };
                let of_case = &cases()[usize::from(case)];
                triangles.extend(of_case.iter().map(|triangle| triangle.map(number)));
            }
        }
        triangles
    }
}
