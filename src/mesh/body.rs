//! A mesh, and what can be said of it.

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::space::GridPoint;
use crate::surface::SurfaceError;
use crate::volume::VolumeError;

/// The most triangles of a mesh. STL counts them in 32 bits; at 24 bytes for each here and 50 in a file, more is
/// noise and not a surface.
pub(super) const MAX_TRIANGLES: usize = 100_000_000;

/// Why there is no mesh.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MeshError {
    /// More triangles than are of use.
    #[error(
        "the surface has {0} triangles, more than a mesh may have ({MAX_TRIANGLES}); is the threshold inside the noise?"
    )]
    TooMany(usize),
    /// There is no semi-boundary to measure from.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// No memory, or volumes of different shapes.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

/// Triangles on shared points, in grid millimetres. Seen from outside the object they turn
/// counterclockwise.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    pub(super) points: Vec<GridPoint>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// What keeps a mesh from being a closed, consistently oriented 2-manifold: all 0 where it is one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Topology {
    /// Edges that have one triangle.
    pub open_edges: usize,
    /// Edges that have more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles turn against each other.
    pub flipped_edges: usize,
    /// Triangles without an area once their corners are rounded as files store them (`f32`).
    pub degenerate_triangles: usize,
}

impl Topology {
    /// Whether the mesh is a closed, consistently oriented 2-manifold without degenerate triangles.
    pub fn is_sound(&self) -> bool {
        *self == Self::default()
    }
}

impl Mesh {
    /// The points, which triangles count from 0.
    pub fn points(&self) -> &[GridPoint] {
        &self.points
    }

    /// The triangles, as places in [`Mesh::points`].
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Whether there is no surface.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// A point by its number in a triangle.
    #[inline]
    pub(super) fn at(&self, point: u32) -> DVec3 {
        self.points
            .get(point as usize)
            .map_or(DVec3::ZERO, |at| at.0)
    }

    /// The corners of a triangle.
    #[inline]
    pub(super) fn corners(&self, triangle: &[u32; 3]) -> [DVec3; 3] {
        triangle.map(|point| self.at(point))
    }

    /// What it encloses, mm³, by the divergence theorem; negative where it is turned inside out.
    pub fn volume(&self) -> f64 {
        let reference = self.at(0);
        let six_fold = |triangle: &[u32; 3]| {
            let [a, b, c] = self.corners(triangle).map(|corner| corner - reference);
            a.dot(b.cross(c))
        };
        self.triangles.iter().map(six_fold).sum::<f64>() / 6.0
    }

    /// Area, mm².
    pub fn area(&self) -> f64 {
        let area = |triangle: &[u32; 3]| area(self.corners(triangle));
        self.triangles.iter().map(area).sum()
    }

    /// The centre of mass of what it encloses; none where that has no volume.
    pub fn centroid(&self) -> Option<GridPoint> {
        let reference = self.at(0);
        let mut moment = DVec3::ZERO;
        let mut six_fold = 0.0;
        for triangle in &self.triangles {
            let [a, b, c] = self.corners(triangle).map(|corner| corner - reference);
            let part = a.dot(b.cross(c));
            six_fold += part;
            // Of the tetrahedron to the reference point.
            moment += (a + b + c) * (part / 4.0);
        }
        let centre = reference + moment / six_fold;
        centre.is_finite().then_some(GridPoint(centre))
    }

    /// Counts what is wrong with it.
    pub fn topology(&self) -> Topology {
        let directed = |[a, b, c]: &[u32; 3]| [(*a, *b), (*b, *c), (*c, *a)];
        // Both directions of an edge side by side, each with its direction in the lowest bit.
        let keyed = |(a, b): (u32, u32)| {
            let undirected = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
            (undirected, a > b)
        };
        let mut edges: Vec<(u64, bool)> = self
            .triangles
            .par_iter()
            .flat_map_iter(|triangle| directed(triangle).map(keyed))
            .collect();
        edges.par_sort_unstable();
        let mut found = Topology::default();
        for same in edges.chunk_by(|a, b| a.0 == b.0) {
            match same {
                [_] => found.open_edges += 1,
                [a, b] => found.flipped_edges += usize::from(a.1 == b.1),
                _ => found.non_manifold_edges += 1,
            }
        }
        let degenerate = |triangle: &&[u32; 3]| {
            let stored = |corner: DVec3| corner.as_vec3().as_dvec3();
            area(self.corners(triangle).map(stored)) == 0.0
        };
        found.degenerate_triangles = self.triangles.par_iter().filter(degenerate).count();
        found
    }

    /// The parts that hang together, each a mesh of its own, in the order of their first points.
    pub fn components(&self) -> Vec<Self> {
        let mut parent: Vec<u32> = (0..self.points.len() as u32).collect();
        for &[a, b, c] in &self.triangles {
            join(&mut parent, a, b);
            join(&mut parent, b, c);
        }
        let mut parts: Vec<Self> = Vec::new();
        let mut part_of = vec![u32::MAX; self.points.len()];
        let mut place_of = vec![0_u32; self.points.len()];
        for (place, point) in self.points.iter().enumerate() {
            let root = root(&mut parent, place as u32) as usize;
            if part_of[root] == u32::MAX {
                part_of[root] = parts.len() as u32;
                parts.push(Self::default());
            }
            part_of[place] = part_of[root];
            let part = &mut parts[part_of[root] as usize];
            place_of[place] = part.points.len() as u32;
            part.points.push(*point);
        }
        for triangle in &self.triangles {
            let part = &mut parts[part_of[triangle[0] as usize] as usize];
            part.triangles
                .push(triangle.map(|point| place_of[point as usize]));
        }
        parts
    }

    /// Meshes beside each other in one.
    pub(super) fn joined(parts: impl IntoIterator<Item = Self>) -> Self {
        let mut all = Self::default();
        for part in parts {
            let first = all.points.len() as u32;
            all.points.extend(part.points);
            let moved = part.triangles.into_iter();
            all.triangles
                .extend(moved.map(|triangle| triangle.map(|point| point + first)));
        }
        all
    }
}

pub(super) fn area([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

/// The first point of a set; paths are halved on the way.
fn root(parent: &mut [u32], mut point: u32) -> u32 {
    while parent[point as usize] != point {
        let above = parent[parent[point as usize] as usize];
        parent[point as usize] = above;
        point = above;
    }
    point
}

fn join(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parent, a), root(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}

/// An empty list with room for `len`, or an error where the machine has no memory for it.
pub(super) fn room<T>(len: usize) -> Result<Vec<T>, VolumeError> {
    let mut list = Vec::new();
    list.try_reserve_exact(len)
        .map_err(|_| VolumeError::Memory {
            voxels: len,
            bytes_per_voxel: size_of::<T>(),
        })?;
    Ok(list)
}
