//! How far a surface moved.

use rayon::prelude::*;

use super::body::Mesh;
use crate::space::GridPoint;
use crate::surface::SurfaceDistance;
use crate::volume::{Mask, Sample, Volume};

/// An object before and after an operation. All are on one grid.
#[derive(Debug, Clone, Copy)]
pub struct ChangeFrom<'a, T> {
    /// What the surfaces were found in, before and after.
    pub volumes: [&'a Volume<T>; 2],
    /// The objects.
    pub masks: [&'a Mask; 2],
    /// The surface before.
    pub before: SurfaceDistance<'a>,
}

/// For each point of a mesh of the surface after, how far it lies outside (positive) or inside the surface before,
/// mm. NaN where that is out of reach. Exactly 0 where the eight voxels around the point are the same before
/// and after.
pub fn surface_change<T: Sample>(mesh: &Mesh, from: &ChangeFrom<'_, T>) -> Vec<f32> {
    let change = |point: &GridPoint| {
        if from.is_same_around(*point) {
            return 0.0;
        }
        let distance = from.before.signed(*point);
        distance.map_or(f32::NAN, |distance| distance as f32)
    };
    mesh.points().par_iter().map(change).collect()
}

impl<T: Sample> ChangeFrom<'_, T> {
    fn is_same_around(&self, point: GridPoint) -> bool {
        let [before, after] = self.volumes;
        let grid = before.grid();
        let [nx, ny, nz] = grid.dims();
        let at = grid.grid_to_index(point).0.floor();
        // `as` clamps to the range of usize, and turns a negative number into 0.
        let low = [at.x as usize, at.y as usize, at.z as usize];
        (0..8).all(|corner: usize| {
            let near = |axis: usize, n: usize| (low[axis] + (corner >> axis & 1)).min(n - 1);
            let [x, y, z] = [near(0, nx), near(1, ny), near(2, nz)];
            let place = (z * ny + y) * nx + x;
            let inside = self.masks.map(|mask| mask.contains(x, y, z));
            before.as_slice().get(place) == after.as_slice().get(place) && inside[0] == inside[1]
        })
    }
}
