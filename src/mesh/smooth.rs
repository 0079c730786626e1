//! Smoothing that does not shrink.

use glam::DVec3;
use rayon::prelude::*;

use super::body::{Mesh, MeshError, room};
use crate::space::GridPoint;

/// Rounds of [`smooth`] that take the steps of the voxels away and leave the shape.
pub const SMOOTHING: usize = 5;

/// How far a vertex goes towards the mean of its neighbours, and then away from it. Frequencies up to 0.1 (on
/// Taubin's scale from 0 to 2) pass: 1/λ + 1/μ = 0.1.
const LAMBDA: f64 = 0.5;
const MU: f64 = 1.0 / (0.1 - 1.0 / LAMBDA);

/// Moves every vertex towards the mean of its neighbours and away again, `rounds` times, but for those that
/// `stays` holds still. The mesh must be closed; its triangles stay as they are.
///
/// Source: G. Taubin, *A signal processing approach to fair surface design*, SIGGRAPH 1995, DOI
/// 10.1145/218380.218473.
///
/// # Errors
/// [`MeshError::Volume`] where the machine has no memory for it.
pub fn smooth(
    mesh: &mut Mesh,
    rounds: usize,
    stays: impl Fn(GridPoint) -> bool + Sync,
) -> Result<(), MeshError> {
    let neighbours = Neighbours::new(mesh)?;
    let mut moved = room(mesh.points.len())?;
    moved.resize(mesh.points.len(), GridPoint(DVec3::ZERO));
    for _ in 0..rounds {
        for step in [LAMBDA, MU] {
            let points = &mesh.points;
            moved.par_iter_mut().enumerate().for_each(|(place, to)| {
                let at = points[place].0;
                let around = neighbours.of(place);
                let sum: DVec3 = around.iter().map(|&point| points[point as usize].0).sum();
                let mean = sum / around.len().max(1) as f64;
                let still = around.is_empty() || stays(GridPoint(at));
                *to = GridPoint(if still { at } else { at + (mean - at) * step });
            });
            std::mem::swap(&mut mesh.points, &mut moved);
        }
    }
    Ok(())
}

/// The points that share an edge with each point.
struct Neighbours {
    begins: Vec<u32>,
    points: Vec<u32>,
}

impl Neighbours {
    /// In a closed mesh each edge is walked once in each direction.
    fn new(mesh: &Mesh) -> Result<Self, MeshError> {
        let mut begins = room(mesh.points.len() + 1)?;
        begins.resize(mesh.points.len() + 1, 0_u32);
        for &from in mesh.triangles.as_flattened() {
            begins[from as usize + 1] += 1;
        }
        for place in 1..begins.len() {
            begins[place] += begins[place - 1];
        }
        let mut points = room(mesh.triangles.len() * 3)?;
        points.resize(mesh.triangles.len() * 3, 0);
        let mut filled = room(begins.len())?;
        filled.extend_from_slice(&begins);
        for &[a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                points[filled[from as usize] as usize] = to;
                filled[from as usize] += 1;
            }
        }
        Ok(Self { begins, points })
    }

    fn of(&self, point: usize) -> &[u32] {
        &self.points[self.begins[point] as usize..self.begins[point + 1] as usize]
    }
}
