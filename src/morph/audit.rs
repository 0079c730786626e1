//! What a map does to tissue, for trust: is it folded, how far does it move, how far is the adaptive
//! evaluation from the exact one (method sections 4 and 6).

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::chain::{Chain, Lattice, VoxelBox};
use super::field::{Field, Scratch};
use super::tile::{TILE, Tile, tiles_of};
use super::{LANES, Points};
use crate::feature::NoseBox;
use crate::simd::{Kernel, Simd};
use crate::volume::{Sample, Trilinear, Volume};

/// What a chain of stages does, over every voxel of a lattice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WarpAudit {
    /// Smallest Jacobian determinant of the map; at or below 0 the map is folded there.
    pub jacobian_min: f64,
    /// Largest displacement, mm.
    pub displacement_max_mm: f64,
    /// Largest displacement of a voxel outside the nose box, mm.
    pub displacement_max_outside_mm: f64,
}

impl WarpAudit {
    /// Of a map that moves nothing.
    pub const IDENTITY: Self = Self {
        jacobian_min: 1.0,
        displacement_max_mm: 0.0,
        displacement_max_outside_mm: 0.0,
    };

    /// Examines `chain` at every voxel of `lattice`, which it must have been made for.
    pub fn new(chain: &Chain, lattice: &Lattice, nose: &NoseBox) -> Self {
        let simd = Simd::widest();
        tiles_of(chain.support(lattice))
            .into_par_iter()
            .map(|voxels| {
                simd.run(AuditTile {
                    chain,
                    lattice,
                    nose,
                    voxels,
                })
            })
            .reduce(|| Self::IDENTITY, Self::worst)
    }

    /// Examines a field that is known at voxels only: the Jacobian determinant is that of central
    /// differences between neighbouring voxels (one-sided at the rim of the lattice).
    pub fn of_field(field: &Field<'_>, nose: &NoseBox) -> Self {
        let lattice = *field.lattice();
        let dims = lattice.dims();
        inner_boxes(field.support())
            .into_par_iter()
            .map_init(
                || (Scratch::new(), Tile::new()),
                |(scratch, tile), inner| {
                    let halo = VoxelBox {
                        start: inner.start.map(|start| start.saturating_sub(1)),
                        end: [0, 1, 2].map(|axis| (inner.end[axis] + 1).min(dims[axis])),
                    };
                    field.fill(halo, scratch, tile);
                    let mut found = Self::IDENTITY;
                    for offset in tile.offsets() {
                        let at = [0, 1, 2].map(|axis| halo.start[axis] + offset[axis]);
                        if !inner.holds(at) {
                            continue;
                        }
                        let target = tile.index(offset);
                        let moved = ((tile.get(offset) - target) * lattice.spacing()).length();
                        let outside = nose.distance(lattice.point_at(target)) > 0.0;
                        found = found.worst(Self {
                            jacobian_min: differences(tile, offset).determinant(),
                            displacement_max_mm: moved,
                            displacement_max_outside_mm: if outside { moved } else { 0.0 },
                        });
                    }
                    found
                },
            )
            .reduce(|| Self::IDENTITY, Self::worst)
    }

    fn worst(self, other: Self) -> Self {
        Self {
            jacobian_min: self.jacobian_min.min(other.jacobian_min),
            displacement_max_mm: self.displacement_max_mm.max(other.displacement_max_mm),
            displacement_max_outside_mm: self
                .displacement_max_outside_mm
                .max(other.displacement_max_outside_mm),
        }
    }
}

/// One tile of voxels under a chain.
struct AuditTile<'a> {
    chain: &'a Chain,
    lattice: &'a Lattice,
    nose: &'a NoseBox,
    voxels: VoxelBox,
}

impl Kernel for AuditTile<'_> {
    type Output = WarpAudit;

    #[inline(always)]
    fn run(self) -> WarpAudit {
        let Self {
            chain,
            lattice,
            nose,
            voxels,
        } = self;
        let spacing = lattice.spacing();
        let first = lattice.point_at(DVec3::ZERO).0;
        let (lo, hi) = (nose.min.0, nose.max.0);
        let lanes = voxels.end[0] - voxels.start[0];
        // The extremes of each lane, distances squared.
        let mut least = [WarpAudit::IDENTITY.jacobian_min; LANES];
        let (mut furthest, mut furthest_outside) = ([0.0; LANES], [0.0; LANES]);
        let mut determinants = [1.0; LANES];
        for z in voxels.start[2]..voxels.end[2] {
            for y in voxels.start[1]..voxels.end[1] {
                let targets = Points::row([voxels.start[0], y, z]);
                let mut sources = targets.clone();
                chain.to_source_with_jacobian(&mut sources, &mut determinants);
                for lane in 0..LANES {
                    let x = (sources.x[lane] - targets.x[lane]) * spacing.x;
                    let y = (sources.y[lane] - targets.y[lane]) * spacing.y;
                    let z = (sources.z[lane] - targets.z[lane]) * spacing.z;
                    let moved = x * x + y * y + z * z;
                    let x = first.x + targets.x[lane] * spacing.x;
                    let y = first.y + targets.y[lane] * spacing.y;
                    let z = first.z + targets.z[lane] * spacing.z;
                    let inside = (x >= lo.x)
                        & (x <= hi.x)
                        & (y >= lo.y)
                        & (y <= hi.y)
                        & (z >= lo.z)
                        & (z <= hi.z);
                    // Lanes past the tile's end are no voxels of it.
                    let counts = lane < lanes;
                    let determinant = determinants[lane];
                    if counts & (determinant < least[lane]) {
                        least[lane] = determinant;
                    }
                    if counts & (moved > furthest[lane]) {
                        furthest[lane] = moved;
                    }
                    if counts & !inside & (moved > furthest_outside[lane]) {
                        furthest_outside[lane] = moved;
                    }
                }
            }
        }
        let largest = |of: [f64; LANES]| of.into_iter().fold(0.0, f64::max).sqrt();
        WarpAudit {
            jacobian_min: least.into_iter().fold(f64::INFINITY, f64::min),
            displacement_max_mm: largest(furthest),
            displacement_max_outside_mm: largest(furthest_outside),
        }
    }
}

/// Boxes that cover another and leave room for a voxel all round them in a tile.
fn inner_boxes(voxels: VoxelBox) -> Vec<VoxelBox> {
    const STEP: usize = TILE - 2;
    let starts = |axis: usize| (voxels.start[axis]..voxels.end[axis]).step_by(STEP);
    let mut boxes = Vec::new();
    for z in starts(2) {
        for y in starts(1) {
            for x in starts(0) {
                let start = [x, y, z];
                let end = [0, 1, 2].map(|axis| (start[axis] + STEP).min(voxels.end[axis]));
                boxes.push(VoxelBox { start, end });
            }
        }
    }
    boxes
}

/// The change of the source position with each axis, in voxels, between the neighbours of a tile's voxel.
fn differences(tile: &Tile, offset: [usize; 3]) -> DMat3 {
    let dims = tile.voxels().dims();
    let along = |axis: usize| {
        let (mut before, mut after) = (offset, offset);
        before[axis] = offset[axis].saturating_sub(1);
        after[axis] = (offset[axis] + 1).min(dims[axis] - 1);
        let steps = (after[axis] - before[axis]).max(1) as f64;
        (tile.get(after) - tile.get(before)) / steps
    };
    let mut columns = DMat3::from_cols(along(0), along(1), along(2));
    // An axis of a single voxel has no neighbours: nothing changes along it but the position itself.
    for (axis, unit) in DVec3::AXES.into_iter().enumerate() {
        if dims[axis] == 1 {
            *columns.col_mut(axis) = unit;
        }
    }
    columns
}

/// How far one field is from another, and what that does to a volume.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct FieldDifference {
    /// Largest distance between source positions, mm.
    pub position_max_mm: f64,
    /// Mean over the voxels that either may move, mm.
    pub position_mean_mm: f64,
    /// Largest distance between source positions, voxels.
    pub position_max_voxels: f64,
    /// Largest difference between sampled values, HU.
    pub value_max_hu: f64,
    /// Mean over the voxels that either may move, HU.
    pub value_mean_hu: f64,
}

impl FieldDifference {
    /// Compares two fields on the same lattice at every voxel, and what each samples from `source`
    /// (before rounding). Sums run in tile order, so the result is the same for any number of threads.
    pub fn new<T: Sample>(source: &Volume<T>, one: &Field<'_>, other: &Field<'_>) -> Self {
        let sampler = Trilinear::new(source);
        let spacing = one.lattice().spacing();
        let slope = source.rescale().slope.abs();
        let parts: Vec<(Self, usize)> = tiles_of(one.support().union(&other.support()))
            .into_par_iter()
            .map_init(
                || (Scratch::new(), Tile::new(), Tile::new()),
                |(scratch, a, b), voxels| {
                    one.fill(voxels, scratch, a);
                    other.fill(voxels, scratch, b);
                    let mut found = Self::default();
                    let mut count = 0;
                    for offset in a.offsets() {
                        let (p, q) = (a.get(offset), b.get(offset));
                        let mm = ((p - q) * spacing).length();
                        let hu =
                            (sampler.at(p.x, p.y, p.z) - sampler.at(q.x, q.y, q.z)).abs() * slope;
                        found.position_max_mm = found.position_max_mm.max(mm);
                        found.position_mean_mm += mm;
                        found.position_max_voxels = found.position_max_voxels.max((p - q).length());
                        found.value_max_hu = found.value_max_hu.max(hu);
                        found.value_mean_hu += hu;
                        count += 1;
                    }
                    (found, count)
                },
            )
            .collect();
        let mut all = Self::default();
        let mut voxels = 0;
        for (part, count) in parts {
            all.position_max_mm = all.position_max_mm.max(part.position_max_mm);
            all.position_max_voxels = all.position_max_voxels.max(part.position_max_voxels);
            all.value_max_hu = all.value_max_hu.max(part.value_max_hu);
            all.position_mean_mm += part.position_mean_mm;
            all.value_mean_hu += part.value_mean_hu;
            voxels += count;
        }
        if voxels > 0 {
            all.position_mean_mm /= voxels as f64;
            all.value_mean_hu /= voxels as f64;
        }
        all
    }
}
