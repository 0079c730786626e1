//! Stages one after another, on a lattice of voxels.

use std::ops::Range;

use glam::DVec3;

use super::Points;
use super::bounds::{Bend, Bounds};
use super::stage::{Determinants, StageMap};
use super::still::CellSum;
use crate::simd::Real;
use crate::space::{Grid, GridPoint};

/// Voxel centres in grid millimetres of the full-size volume: its own, or those of half its size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    dims: [usize; 3],
    spacing: DVec3,
    first: GridPoint,
}

impl Lattice {
    /// The volume's own voxels.
    pub fn full(grid: &Grid) -> Self {
        Self {
            dims: grid.dims(),
            spacing: grid.spacing(),
            first: GridPoint(DVec3::ZERO),
        }
    }

    /// Blocks of 2×2×2 voxels; an odd last plane is dropped. A coarse centre c sits at fine index
    /// 2c + ½ (method section 5).
    pub fn half(grid: &Grid) -> Self {
        Self {
            dims: grid.dims().map(|n| n / 2),
            spacing: grid.spacing() * 2.0,
            first: GridPoint(grid.spacing() * 0.5),
        }
    }

    /// Voxels along x, y and z.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Distance between centres, mm.
    pub fn spacing(&self) -> DVec3 {
        self.spacing
    }

    /// The position of a lattice index.
    pub fn point_at(&self, index: DVec3) -> GridPoint {
        GridPoint(self.first.0 + index * self.spacing)
    }

    /// The lattice index of a position.
    pub fn index_of(&self, point: GridPoint) -> DVec3 {
        (point.0 - self.first.0) / self.spacing
    }

    /// All its voxels.
    pub fn all(&self) -> VoxelBox {
        VoxelBox {
            start: [0; 3],
            end: self.dims,
        }
    }
}

/// A box of voxels: from `start` up to, not including, `end`; axes x, y, z.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "described above")]
pub struct VoxelBox {
    pub start: [usize; 3],
    pub end: [usize; 3],
}

impl VoxelBox {
    /// A box of no voxels.
    pub const EMPTY: Self = Self {
        start: [0; 3],
        end: [0; 3],
    };

    /// Whether it holds no voxel.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|axis| self.start[axis] >= self.end[axis])
    }

    /// Voxels along each axis.
    pub fn dims(&self) -> [usize; 3] {
        [0, 1, 2].map(|axis| self.end[axis].saturating_sub(self.start[axis]))
    }

    /// Its voxels along x, y and z.
    pub fn ranges(&self) -> [Range<usize>; 3] {
        [0, 1, 2].map(|axis| self.start[axis]..self.end[axis])
    }

    /// The box moved by `by` voxels.
    #[must_use]
    pub fn shifted(&self, by: [usize; 3]) -> Self {
        Self {
            start: [0, 1, 2].map(|axis| self.start[axis] + by[axis]),
            end: [0, 1, 2].map(|axis| self.end[axis] + by[axis]),
        }
    }

    /// Whether it holds this voxel.
    pub fn holds(&self, at: [usize; 3]) -> bool {
        (0..3).all(|axis| at[axis] >= self.start[axis] && at[axis] < self.end[axis])
    }

    /// Whether a voxel is in both.
    pub fn intersects(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.start[axis] < other.end[axis] && other.start[axis] < self.end[axis])
    }

    /// The smallest box that holds both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        if self.is_empty() {
            return *other;
        }
        if other.is_empty() {
            return *self;
        }
        Self {
            start: [0, 1, 2].map(|axis| self.start[axis].min(other.start[axis])),
            end: [0, 1, 2].map(|axis| self.end[axis].max(other.end[axis])),
        }
    }
}

/// The map of several stages: from a voxel of the last stage's volume to the preoperative CT,
/// V → T₁(T₂(… V)).
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    stages: Vec<StageMap>,
}

impl Chain {
    /// The stages, first operation first. All must have been made for the same lattice.
    pub fn new(stages: Vec<StageMap>) -> Self {
        Self { stages }
    }

    /// Moves target positions to their sources, in place. The last operation is undone first.
    #[inline(always)]
    pub fn to_source<F: Real>(&self, points: &mut Points<F>) {
        for stage in self.moving().rev() {
            stage.to_source(points);
        }
    }

    /// As [`Chain::to_source`], with the Jacobian determinant of the whole chain at each position.
    #[inline(always)]
    pub fn to_source_with_jacobian<F: Real>(&self, points: &mut Points<F>) -> Determinants<F> {
        let mut determinants = Determinants::ones();
        for stage in self.moving().rev() {
            stage.to_source_with_jacobian(points, &mut determinants);
        }
        determinants
    }

    /// How many stages move anything.
    pub(super) fn depth(&self) -> usize {
        self.moving().count()
    }

    /// How far trilinear interpolation between the corners of a cell can be from the map, anywhere in the
    /// cell, after the axes are multiplied by `metric`. The cell's first corner is `at`, its side `side`
    /// voxels.
    ///
    /// On a box of sides hₐ, trilinear interpolation of a function whose second derivative along any unit
    /// direction is at most M is off by at most M·Σhₐ²/8.
    #[inline(always)]
    pub(super) fn bend(&self, at: DVec3, side: f64, metric: DVec3) -> Bend {
        let mut centre = at + DVec3::splat(side * 0.5);
        let mut radius = 0.0;
        let mut sides2 = 0.0;
        let mut to_metric = 0.0;
        let mut smooth = true;
        let mut all = Bounds::IDENTITY;
        let mut stages = self.moving().rev().enumerate().peekable();
        while let Some((place, stage)) = stages.next() {
            if place == 0 {
                let sides = stage.scale() * side;
                sides2 = sides.length_squared();
                radius = 0.5 * sides.length();
                to_metric = (metric / stage.scale()).max_element();
            }
            let at = stage.to_units(centre);
            smooth &= stage.is_far(at, radius);
            let is_last = stages.peek().is_none();
            if smooth && is_last {
                break;
            }
            let bounds = stage.bounds(at, radius);
            // Chain rule: (f∘g)'' = f''(g', g') + f'·g''.
            all = Bounds {
                lipschitz: bounds.lipschitz * all.lipschitz,
                curvature: bounds.curvature * all.lipschitz * all.lipschitz
                    + bounds.lipschitz * all.curvature,
            };
            if !is_last {
                radius *= bounds.lipschitz;
                let mut points: Points = Points::splat(centre);
                stage.to_source(&mut points);
                centre = points.get(0);
            }
        }
        if smooth {
            Bend::Smooth
        } else if all.curvature == 0.0 {
            Bend::Bounded(0.0)
        } else {
            Bend::Bounded(all.curvature * sides2 * 0.125 * to_metric)
        }
    }

    /// Sums the lines of a chain of one stage for a cell, so that no position in it is off by more than `off` for it, after
    /// the axes are multiplied by `metric`. None where there are more stages, or none.
    #[inline(always)]
    pub(super) fn summed_in_cell<F: Real>(
        &self,
        at: DVec3,
        side: f64,
        metric: DVec3,
        off: f64,
        sum: &mut CellSum<F>,
    ) -> Option<&StageMap> {
        let mut stages = self.moving();
        let stage = stages.next()?;
        if stages.next().is_some() || stage.held.is_empty() {
            return None;
        }
        let (first, sides) = (stage.to_units(at), stage.scale() * side);
        let to_metric = (metric / stage.scale()).max_element();
        let most_off =
            stage.sum_tolerance(first + sides * 0.5, 0.5 * sides.length(), off / to_metric);
        stage.held.in_cell(first, sides, most_off, sum);
        Some(stage)
    }

    /// Whether the tissue at a lattice position may come from elsewhere. Where this is false,
    /// [`Chain::to_source`] leaves the position as it is, to the bit.
    pub fn moves(&self, index: DVec3) -> bool {
        self.moving().any(|stage| match stage.taper() {
            None => true,
            Some(taper) => taper.nose.distance(GridPoint(stage.to_units(index))) < taper.margin_mm,
        })
    }

    /// Whether [`Chain::moves`] holds at every voxel of a box; `false` may also mean "not known".
    pub fn moves_all(&self, voxels: &VoxelBox) -> bool {
        let corner = |axis: usize, last: bool| {
            if last {
                voxels.end[axis].saturating_sub(1) as f64
            } else {
                voxels.start[axis] as f64
            }
        };
        self.moving().any(|stage| match stage.taper() {
            None => true,
            // The distance to a box is convex: largest at a corner.
            Some(taper) => (0..8).all(|c| {
                let at = DVec3::new(
                    corner(0, c & 1 != 0),
                    corner(1, c & 2 != 0),
                    corner(2, c & 4 != 0),
                );
                taper.nose.distance(GridPoint(stage.to_units(at))) < taper.margin_mm
            }),
        })
    }

    /// The voxels of a lattice outside which nothing moves.
    pub fn support(&self, on: &Lattice) -> VoxelBox {
        self.moving()
            .map(|stage| match stage.taper() {
                None => on.all(),
                Some(taper) => {
                    let margin = DVec3::splat(taper.margin_mm);
                    let lo = on.index_of(GridPoint(taper.nose.min.0 - margin)).floor();
                    let hi = on.index_of(GridPoint(taper.nose.max.0 + margin)).ceil();
                    let dims = on.dims();
                    // `as` clamps to the range of usize, and turns a negative number into 0.
                    VoxelBox {
                        start: [0, 1, 2].map(|axis| (lo[axis] as usize).min(dims[axis])),
                        end: [0, 1, 2]
                            .map(|axis| (hi[axis] as usize).saturating_add(1).min(dims[axis])),
                    }
                }
            })
            .fold(VoxelBox::EMPTY, |all, one| all.union(&one))
    }

    fn moving(&self) -> impl DoubleEndedIterator<Item = &StageMap> {
        self.stages.iter().filter(|stage| !stage.is_identity())
    }
}
