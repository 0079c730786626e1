//! The way back: where the tissue of the preoperative CT goes to.
//!
//! The map T takes a voxel of a stage's volume to where its tissue comes from. Its inverse is found point by
//! point: for a preoperative position s, the v with T(v) = s. First by the iteration v ← v - (T(v) - s), which
//! converges where the displacement changes by less than it is long from point to point (M. Chen, W. Lu, Q. Chen,
//! K. J. Ruchala, G. H. Olivera, *A simple fixed-point approach to invert a deformation field*, Medical Physics
//! 35(1), 2008, DOI 10.1118/1.2816107); where that does not help any more, by Newton steps that are shortened
//! until they do. A map that is folded has places with no inverse or several: one of them, or the nearest that was
//! found, is taken, and what is left over is reported.

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::chain::{Chain, Lattice, VoxelBox};
use super::field::{Field, Scratch};
use super::tile::{TILE, Tile, tiles_of};
use super::{LANES, Points};
use crate::space::{Grid, GridVector};
use crate::volume::VolumeError;

/// A position is inverted where T(v) is within this of s, voxels.
pub const TOLERANCE: f64 = 0.01;

/// Rounds of the plain iteration, and Newton steps after them.
const ROUNDS: usize = 30;
const NEWTON_STEPS: usize = 30;

/// How often a Newton step is halved.
const HALVINGS: usize = 8;

/// Half the distance, in voxels, over which a map is differentiated.
const DIFFERENCE: f64 = 1e-3;

/// A map on a lattice that can be asked at any position.
pub trait Forward: Sync {
    /// The lattice whose voxels positions count.
    fn lattice(&self) -> &Lattice;

    /// The voxels outside which nothing moves.
    fn support(&self) -> VoxelBox;

    /// Moves target positions to their sources, in place.
    fn to_source(&self, points: &mut Points);
}

/// A chain in closed form, on the lattice that it was made for.
#[derive(Debug, Clone, Copy)]
pub struct ClosedForm<'a> {
    /// The chain.
    pub chain: &'a Chain,
    /// Its lattice.
    pub lattice: &'a Lattice,
}

impl Forward for ClosedForm<'_> {
    fn lattice(&self) -> &Lattice {
        self.lattice
    }

    fn support(&self) -> VoxelBox {
        self.chain.support(self.lattice)
    }

    fn to_source(&self, points: &mut Points) {
        self.chain.to_source(points);
    }
}

/// A field as it is written, one displacement for each voxel, trilinear between them: what a program that reads
/// the file sees. Beyond the first and last voxels, those displacements hold.
#[derive(Debug)]
pub struct Sampled {
    lattice: Lattice,
    kept: Kept,
}

impl Sampled {
    /// Evaluates a field at every voxel that it may move.
    ///
    /// # Errors
    /// [`VolumeError::Memory`] where the machine has no memory for it.
    pub fn new(field: &Field<'_>) -> Result<Self, VolumeError> {
        let mut kept = Kept::new(field.support())?;
        kept.fill(|part, scratch: &mut (Scratch, Tile), to| {
            let (scratch, tile) = scratch;
            field.fill(part, scratch, tile);
            for (offset, to) in tile.offsets().zip(to) {
                *to = (tile.get(offset) - tile.index(offset)).as_vec3().to_array();
            }
        });
        Ok(Self {
            lattice: *field.lattice(),
            kept,
        })
    }

    fn displacement(&self, at: DVec3) -> DVec3 {
        let last = self.lattice.dims().map(|n| (n - 1) as f64);
        let at = at.clamp(DVec3::ZERO, DVec3::from_array(last));
        let low = at.floor();
        let share = at - low;
        let [x, y, z] = [low.x as usize, low.y as usize, low.z as usize];
        let mut moved = DVec3::ZERO;
        for corner in 0..8 {
            let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight = |offset: usize, share: f64| if offset == 1 { share } else { 1.0 - share };
            let weight = weight(i, share.x) * weight(j, share.y) * weight(k, share.z);
            if weight > 0.0 {
                moved +=
                    DVec3::from_array(self.kept.at([x + i, y + j, z + k]).map(f64::from)) * weight;
            }
        }
        moved
    }
}

impl Forward for Sampled {
    fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    fn support(&self) -> VoxelBox {
        self.kept.voxels
    }

    fn to_source(&self, points: &mut Points) {
        for lane in 0..LANES {
            let at = points.get(lane);
            points.set(lane, at + self.displacement(at));
        }
    }
}

/// How well a map was inverted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct InverseAudit {
    /// The tolerance, voxels.
    pub tolerance_voxels: f64,
    /// Largest distance from a preoperative voxel to where the map takes its inverse, mm.
    pub residual_max_mm: f64,
    /// Voxels for which that is more than the tolerance: the map is folded there, or nearly.
    pub not_converged: usize,
    /// Voxels that needed Newton steps.
    pub newton: usize,
    /// Longest inverse displacement, mm.
    pub displacement_max_mm: f64,
}

/// From every voxel of the preoperative CT to where its tissue is after a stage.
#[derive(Debug)]
pub struct Inverse {
    kept: Kept,
    audit: InverseAudit,
}

impl Inverse {
    /// Inverts a map at every voxel. A voxel at which nothing moves has no displacement, to the bit.
    ///
    /// # Errors
    /// [`VolumeError::Memory`] where the machine has no memory for it.
    pub fn new(map: &impl Forward) -> Result<Self, VolumeError> {
        let spacing = map.lattice().spacing();
        // What moves stays within the support: the map is the identity on its rim and beyond.
        let mut kept = Kept::new(map.support())?;
        let audits = kept.fill(|part, _: &mut (), to| {
            let mut audit = InverseAudit::NONE;
            let [nx, ny, nz] = part.dims();
            let rows = (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z)));
            for ((y, z), row) in rows.zip(to.chunks_exact_mut(nx)) {
                let [x0, y0, z0] = part.start;
                let sources = Points::row([x0, y0 + y, z0 + z]);
                let solved = solve(map, &sources, nx);
                for (lane, to) in row.iter_mut().enumerate() {
                    let moved = solved.targets.get(lane) - sources.get(lane);
                    *to = moved.as_vec3().to_array();
                    let residual = solved.residuals.get(lane);
                    audit.add(moved, residual, solved.newton[lane], spacing);
                }
            }
            audit
        });
        let audit = audits.iter().fold(InverseAudit::NONE, InverseAudit::joined);
        Ok(Self { kept, audit })
    }

    /// How well the map was inverted.
    pub fn audit(&self) -> InverseAudit {
        self.audit
    }

    /// The displacement of a preoperative voxel, in voxels.
    pub fn at(&self, voxel: [usize; 3]) -> DVec3 {
        DVec3::from_array(self.kept.at(voxel).map(f64::from))
    }

    /// Fills `to`, indexed `[z, y, x]`, with one component (0 x, 1 y, 2 z) of the displacement of the
    /// preoperative voxels from `start` on, LPS mm.
    pub fn fill_component(
        &self,
        grid: &Grid,
        component: usize,
        start: [usize; 3],
        mut to: ndarray::ArrayViewMut3<'_, f32>,
    ) {
        let planes = to.outer_iter_mut().into_par_iter().enumerate();
        planes.for_each(|(z, mut plane)| {
            for ((y, x), to) in plane.indexed_iter_mut() {
                let moved = self.at([x + start[0], y + start[1], z + start[2]]);
                let moved = grid.grid_vector_to_lps(GridVector(moved * grid.spacing()));
                *to = moved.0[component] as f32;
            }
        });
    }
}

impl InverseAudit {
    const NONE: Self = Self {
        tolerance_voxels: TOLERANCE,
        residual_max_mm: 0.0,
        not_converged: 0,
        newton: 0,
        displacement_max_mm: 0.0,
    };

    fn add(&mut self, moved: DVec3, residual: DVec3, newton: bool, spacing: DVec3) {
        self.not_converged += usize::from(!is_solved(residual));
        self.newton += usize::from(newton);
        self.residual_max_mm = self.residual_max_mm.max((residual * spacing).length());
        self.displacement_max_mm = self.displacement_max_mm.max((moved * spacing).length());
    }

    fn joined(self, other: &Self) -> Self {
        Self {
            tolerance_voxels: TOLERANCE,
            residual_max_mm: self.residual_max_mm.max(other.residual_max_mm),
            not_converged: self.not_converged + other.not_converged,
            newton: self.newton + other.newton,
            displacement_max_mm: self.displacement_max_mm.max(other.displacement_max_mm),
        }
    }
}

fn is_solved(residual: DVec3) -> bool {
    residual.length() <= TOLERANCE
}

/// A row of positions, inverted.
struct Solved {
    targets: Points,
    /// Of each, T(target) - source, voxels.
    residuals: Points,
    newton: [bool; LANES],
}

/// Inverts the first `count` positions of a row.
fn solve(map: &impl Forward, sources: &Points, count: usize) -> Solved {
    // Every lane at its best so far, and what that leaves.
    let mut targets = sources.clone();
    let mut residuals = residuals_of(map, &targets, sources);
    let mut newton = [false; LANES];
    let mut trial = targets.clone();
    let mut left = residuals.clone();
    let mut failed = [0_u8; LANES];
    for _ in 0..ROUNDS {
        let open = |lane: usize| !is_solved(residuals.get(lane)) && failed[lane] < 3;
        if !(0..count).any(open) {
            break;
        }
        for lane in 0..LANES {
            trial.set(lane, trial.get(lane) - left.get(lane));
        }
        left = residuals_of(map, &trial, sources);
        for (lane, failed) in failed.iter_mut().enumerate().take(count) {
            if left.get(lane).length_squared() < residuals.get(lane).length_squared() {
                // One that is solved goes on to be so: later rounds only bring it nearer.
                targets.set(lane, trial.get(lane));
                residuals.set(lane, left.get(lane));
                *failed = 0;
            } else {
                *failed = failed.saturating_add(1);
            }
        }
    }
    for (lane, newton) in newton.iter_mut().enumerate().take(count) {
        if !is_solved(residuals.get(lane)) {
            *newton = true;
            let (target, residual) = by_newton(map, targets.get(lane), sources.get(lane));
            targets.set(lane, target);
            residuals.set(lane, residual);
        }
    }
    Solved {
        targets,
        residuals,
        newton,
    }
}

fn residuals_of(map: &impl Forward, targets: &Points, sources: &Points) -> Points {
    let mut found = targets.clone();
    map.to_source(&mut found);
    for lane in 0..LANES {
        found.set(lane, found.get(lane) - sources.get(lane));
    }
    found
}

/// Newton's method with shortened steps, from `start`: the best target found, and what it leaves.
fn by_newton(map: &impl Forward, start: DVec3, source: DVec3) -> (DVec3, DVec3) {
    let mut at = start;
    let mut best = None;
    for _ in 0..NEWTON_STEPS {
        // The position and the six beside it, in one go.
        let mut around = Points::splat(at);
        let sides = [DVec3::X, DVec3::Y, DVec3::Z];
        for (axis, side) in sides.into_iter().enumerate() {
            around.set(1 + 2 * axis, at - side * DIFFERENCE);
            around.set(2 + 2 * axis, at + side * DIFFERENCE);
        }
        map.to_source(&mut around);
        let residual = around.get(0) - source;
        best = Some((at, residual));
        if is_solved(residual) {
            break;
        }
        let column = |axis: usize| {
            (around.get(2 + 2 * axis) - around.get(1 + 2 * axis)) / (2.0 * DIFFERENCE)
        };
        let jacobian = DMat3::from_cols(column(0), column(1), column(2));
        // Levenberg's damping keeps the step finite where the map is folding.
        let transposed = jacobian.transpose();
        let damping = 1e-9 + 1e-6 * residual.length_squared();
        let normal = transposed * jacobian + DMat3::from_diagonal(DVec3::splat(damping));
        let step = normal.inverse() * (transposed * residual);
        if !step.is_finite() {
            break;
        }
        let mut steps = Points::splat(at);
        for halving in 0..HALVINGS {
            let share = 1.0 / (1_u32 << halving) as f64;
            steps.set(halving, at - step * share);
        }
        let mut reached = steps.clone();
        map.to_source(&mut reached);
        let left = |halving: usize| (reached.get(halving) - source).length_squared();
        let shorter = (0..HALVINGS).find(|&halving| left(halving) < residual.length_squared());
        match shorter {
            Some(halving) => at = steps.get(halving),
            None => break,
        }
    }
    best.unwrap_or_else(|| {
        let mut there = Points::splat(start);
        map.to_source(&mut there);
        (start, there.get(0) - source)
    })
}

/// Vectors for the voxels of a box, zero elsewhere.
#[derive(Debug)]
struct Kept {
    voxels: VoxelBox,
    tiles: [usize; 3],
    /// Tile by tile, as [`tiles_of`] gives them; x fastest within each. Single precision: 1e-6 of a voxel for the
    /// largest displacement.
    values: Vec<[f32; 3]>,
    /// Where each tile begins.
    begins: Vec<usize>,
}

impl Kept {
    fn new(voxels: VoxelBox) -> Result<Self, VolumeError> {
        let mut begins = vec![0];
        let mut len = 0;
        if !voxels.is_empty() {
            for part in tiles_of(voxels) {
                len += part.dims().iter().product::<usize>();
                begins.push(len);
            }
        }
        let mut values = Vec::new();
        values
            .try_reserve_exact(len)
            .map_err(|_| VolumeError::Memory {
                voxels: len,
                bytes_per_voxel: size_of::<[f32; 3]>(),
            })?;
        values.resize(len, [0.0; 3]);
        let tiles =
            [0, 1, 2].map(|axis| voxels.end[axis].div_ceil(TILE) - voxels.start[axis] / TILE);
        Ok(Self {
            voxels,
            tiles,
            values,
            begins,
        })
    }

    /// Fills every tile, in parallel; what `work` says of each, in the order of tiles.
    fn fill<S: Default + Send, R: Send>(
        &mut self,
        work: impl Fn(VoxelBox, &mut S, &mut [[f32; 3]]) -> R + Sync,
    ) -> Vec<R> {
        if self.voxels.is_empty() {
            return Vec::new();
        }
        let mut parts = Vec::new();
        let mut rest = self.values.as_mut_slice();
        for part in tiles_of(self.voxels) {
            let len = part.dims().iter().product();
            let (values, after) = std::mem::take(&mut rest).split_at_mut(len);
            parts.push((part, values));
            rest = after;
        }
        parts
            .into_par_iter()
            .map_init(S::default, |scratch, (part, values)| {
                work(part, scratch, values)
            })
            .collect()
    }

    #[inline]
    fn at(&self, voxel: [usize; 3]) -> [f32; 3] {
        let first = [0, 1, 2].map(|axis| self.voxels.start[axis] / TILE);
        let inside =
            |axis: usize| voxel[axis] >= first[axis] * TILE && voxel[axis] < self.voxels.end[axis];
        if self.voxels.is_empty() || !(0..3).all(inside) {
            return [0.0; 3];
        }
        let [tx, ty, tz] = [0, 1, 2].map(|axis| voxel[axis] / TILE - first[axis]);
        let number = (tz * self.tiles[1] + ty) * self.tiles[0] + tx;
        let [x, y, z] = voxel.map(|at| at % TILE);
        let side = |axis: usize| {
            let begin = voxel[axis] / TILE * TILE;
            TILE.min(self.voxels.end[axis] - begin)
        };
        let place = (z * side(1) + y) * side(0) + x;
        let begin = self.begins.get(number).copied().unwrap_or_default();
        self.values.get(begin + place).copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map in closed form on a small lattice.
    struct Closed<F>(Lattice, F);

    impl<F: Fn(DVec3) -> DVec3 + Sync> Forward for Closed<F> {
        fn lattice(&self) -> &Lattice {
            &self.0
        }

        fn support(&self) -> VoxelBox {
            self.0.all()
        }

        fn to_source(&self, points: &mut Points) {
            for lane in 0..LANES {
                points.set(lane, (self.1)(points.get(lane)));
            }
        }
    }

    fn grid() -> Grid {
        Grid::axis_aligned([37, 20, 18], [0.5, 1.0, 2.0]).unwrap()
    }

    fn closed<F: Fn(DVec3) -> DVec3 + Sync>(map: F) -> Closed<F> {
        Closed(Lattice::full(&grid()), map)
    }

    #[test]
    fn a_translation_is_taken_back() {
        let by = DVec3::new(3.25, -2.5, 1.125);
        let inverse = Inverse::new(&closed(|at| at + by)).unwrap();
        for voxel in [[0, 0, 0], [16, 3, 2], [36, 19, 17]] {
            assert_eq!(inverse.at(voxel), -by);
        }
        let audit = inverse.audit();
        assert_eq!((audit.not_converged, audit.newton), (0, 0));
        assert_eq!(audit.residual_max_mm, 0.0);
        let longest = (by * grid().spacing()).length();
        assert!((audit.displacement_max_mm - longest).abs() < 1e-12);
    }

    #[test]
    fn nothing_that_does_not_move_is_moved() {
        let still = |at: DVec3| {
            if at.x < 20.0 {
                at
            } else {
                at + DVec3::new(0.0, 0.3, 0.0)
            }
        };
        let inverse = Inverse::new(&closed(still)).unwrap();
        assert_eq!(inverse.at([19, 5, 5]), DVec3::ZERO);
        assert!((inverse.at([20, 5, 5]).y + 0.3).abs() < 1e-6);
        let mut component = ndarray::Array3::from_elem((18, 20, 37), 9.0);
        inverse.fill_component(&grid(), 1, [0; 3], component.view_mut());
        assert_eq!(component[[5, 5, 19]], 0.0);
        assert!((component[[5, 5, 20]] + 0.3).abs() < 1e-6);
    }

    /// A map that stretches so much that the plain iteration runs away.
    #[test]
    fn where_the_iteration_diverges_newton_does_not() {
        let stretched = |at: DVec3| DVec3::new(3.5 * at.x - 40.0, at.y, at.z);
        let inverse = Inverse::new(&closed(stretched)).unwrap();
        let audit = inverse.audit();
        assert_eq!(audit.not_converged, 0);
        assert!(audit.newton > 37 * 20 * 17, "{}", audit.newton);
        assert!(audit.residual_max_mm <= TOLERANCE * 2.0);
        let expected = (30.0 + 40.0) / 3.5 - 30.0;
        assert!((inverse.at([30, 4, 4]).x - expected).abs() < 0.01);
    }

    /// Positions below x = 10 have no inverse at all.
    #[test]
    fn a_fold_is_counted_and_the_nearest_is_taken() {
        let folded =
            |at: DVec3| DVec3::new(10.0 + (at.x - 18.0) * (at.x - 18.0) / 20.0, at.y, at.z);
        let inverse = Inverse::new(&closed(folded)).unwrap();
        let audit = inverse.audit();
        assert_eq!(audit.not_converged, 10 * 20 * 18);
        // Voxel 0 is 10 voxels of 0.5 mm from the nearest that the map reaches.
        assert!(
            (audit.residual_max_mm - 5.0).abs() < 0.01,
            "{}",
            audit.residual_max_mm
        );
        let solved = folded(DVec3::new(20.0, 3.0, 3.0) + inverse.at([20, 3, 3]));
        assert!((solved.x - 20.0).abs() <= TOLERANCE);
    }
}
