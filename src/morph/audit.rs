//! What a map does to tissue, for trust: is it folded, how far does it move, how far is the adaptive
//! evaluation from the exact one (method sections 4 and 6).

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in several arrays at once"
)]

use std::ops::Range;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::chain::{Chain, Lattice, VoxelBox};
use super::field::{Field, Scratch};
use super::tile::{TILE, Tile, tiles_of};
use super::{LANES, Points};
use crate::feature::NoseBox;
use crate::simd::{Kernel, Simd, larger, smaller};
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
    ///
    /// Every voxel is looked at in single precision first, and in double precision where an extreme may be: in all tiles
    /// whose own comes nearer to it than single precision can be off.
    pub fn new(chain: &Chain, lattice: &Lattice, nose: &NoseBox) -> Self {
        let simd = Simd::widest();
        let around = Around::new(lattice, nose);
        let under = |voxels| TileUnder {
            chain,
            around: &around,
            voxels,
        };
        let tiles: Vec<TileUnder<'_>> = tiles_of(chain.support(lattice))
            .into_iter()
            .map(under)
            .collect();
        let screen = |&tile: &TileUnder<'_>| simd.run(ScreenTile(tile));
        let screened: Vec<Screened> = tiles.par_iter().map(screen).collect();
        let all = Screened::all(&screened);
        let tiles = tiles.into_par_iter().zip(screened);
        tiles
            .filter(|(_, screened)| screened.may_hold(&all))
            .map(|(tile, _)| simd.run(AuditTile(tile)))
            .reduce(|| Self::IDENTITY, Self::worst)
    }

    /// Examines a field that is known at voxels only: the Jacobian determinant is that of central
    /// differences between neighbouring voxels (one-sided at the rim of the lattice).
    pub fn of_field(field: &Field<'_>, nose: &NoseBox) -> Self {
        let lattice = *field.lattice();
        let dims = lattice.dims();
        let simd = Simd::widest();
        let around = Around::new(&lattice, nose);
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
                    simd.run(AuditFieldTile {
                        tile,
                        inner,
                        around: &around,
                    })
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
#[derive(Clone, Copy)]
struct TileUnder<'a> {
    chain: &'a Chain,
    around: &'a Around,
    voxels: VoxelBox,
}

/// A look at one, in double precision.
struct AuditTile<'a>(TileUnder<'a>);

impl Kernel for AuditTile<'_> {
    type Output = WarpAudit;

    #[inline(always)]
    fn run(self) -> WarpAudit {
        let TileUnder {
            chain,
            around,
            voxels,
        } = self.0;
        let lanes = voxels.end[0] - voxels.start[0];
        let mut extremes = Extremes::NONE;
        for z in voxels.start[2]..voxels.end[2] {
            for y in voxels.start[1]..voxels.end[1] {
                let targets = Points::row([voxels.start[0], y, z]);
                let mut sources = targets.clone();
                let determinants = chain.to_source_with_jacobian(&mut sources);
                extremes.add(around, 0..lanes, &determinants.value, &targets, &sources);
            }
        }
        extremes.found()
    }
}

/// How far single precision may be off, of the terms that a determinant is added up from, for each stage of a chain: some
/// hundred times what its roundings amount to.
const OFF_DETERMINANT: f64 = 2e-5;

/// The same of a displacement and a voxel's size together.
const OFF_DISPLACEMENT: f64 = 1e-3;

/// Between which bounds the extremes of a tile lie.
#[derive(Debug, Clone, Copy)]
struct Screened {
    /// Smallest Jacobian determinant.
    least: [f64; 2],
    /// Largest displacement, mm.
    furthest: [f64; 2],
    /// Largest displacement outside the nose box, mm.
    furthest_outside: [f64; 2],
}

impl Screened {
    /// Where single precision does not do.
    const UNKNOWN: Self = Self {
        least: [f64::NEG_INFINITY, f64::INFINITY],
        furthest: [0.0, f64::INFINITY],
        furthest_outside: [0.0, f64::INFINITY],
    };

    /// Bounds for the extremes of all tiles, and of what does not move.
    fn all(tiles: &[Self]) -> Self {
        let identity = WarpAudit::IDENTITY;
        let none = Self {
            least: [identity.jacobian_min; 2],
            furthest: [identity.displacement_max_mm; 2],
            furthest_outside: [identity.displacement_max_outside_mm; 2],
        };
        let smallest = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].min(b[1])];
        let largest = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].max(b[1])];
        tiles.iter().fold(none, |all, tile| Self {
            least: smallest(all.least, tile.least),
            furthest: largest(all.furthest, tile.furthest),
            furthest_outside: largest(all.furthest_outside, tile.furthest_outside),
        })
    }

    /// Whether an extreme of all tiles may be in this one.
    fn may_hold(&self, all: &Self) -> bool {
        self.least[0] <= all.least[1]
            || self.furthest[1] >= all.furthest[0]
            || self.furthest_outside[1] >= all.furthest_outside[0]
    }
}

/// A look at one, in single precision.
struct ScreenTile<'a>(TileUnder<'a>);

impl Kernel for ScreenTile<'_> {
    type Output = Screened;

    #[inline(always)]
    fn run(self) -> Screened {
        let TileUnder {
            chain,
            around,
            voxels,
        } = self.0;
        let lanes = voxels.end[0] - voxels.start[0];
        let spacing = around.spacing.as_vec3();
        let between = |low: f64, at: f64, high: f64| (at >= low) & (at <= high);
        let mut inside_x = [false; LANES];
        for lane in 0..LANES {
            let x = around.first.x + (voxels.start[0] + lane) as f64 * around.spacing.x;
            inside_x[lane] = between(around.low.x, x, around.high.x);
        }
        let mut least = [f32::INFINITY; LANES];
        let mut terms = [1.0_f32; LANES];
        let mut furthest = [0.0_f32; LANES];
        let mut furthest_outside = [0.0_f32; LANES];
        let mut sum = [0.0_f32; LANES];
        for z in voxels.start[2]..voxels.end[2] {
            let at = around.first.z + z as f64 * around.spacing.z;
            let inside_z = between(around.low.z, at, around.high.z);
            for y in voxels.start[1]..voxels.end[1] {
                let at = around.first.y + y as f64 * around.spacing.y;
                let inside_yz = inside_z & between(around.low.y, at, around.high.y);
                let targets = Points::<f32>::row([voxels.start[0], y, z]);
                let mut sources = targets.clone();
                let determinants = chain.to_source_with_jacobian(&mut sources);
                for lane in 0..LANES {
                    let x = (sources.x[lane] - targets.x[lane]) * spacing.x;
                    let y = (sources.y[lane] - targets.y[lane]) * spacing.y;
                    let z = (sources.z[lane] - targets.z[lane]) * spacing.z;
                    let moved = x * x + y * y + z * z;
                    let inside = inside_yz & inside_x[lane];
                    let outside = if inside { 0.0 } else { moved };
                    least[lane] = smaller(determinants.value[lane], least[lane]);
                    terms[lane] = larger(determinants.terms[lane], terms[lane]);
                    furthest[lane] = larger(moved, furthest[lane]);
                    furthest_outside[lane] = larger(outside, furthest_outside[lane]);
                    // What is no number, which comparisons pass over, stays.
                    sum[lane] += determinants.value[lane] + moved;
                }
            }
        }
        let of = |lanes: &[f32]| lanes.iter().copied().fold(0.0, f32::max);
        let counts = |all: &[f32; LANES]| of(&all[..lanes]);
        let sound = sum[..lanes].iter().all(|sum| sum.is_finite());
        let terms = f64::from(counts(&terms));
        if !sound || !terms.is_finite() {
            return Screened::UNKNOWN;
        }
        let stages = chain.depth() as f64;
        let least = least[..lanes].iter().copied().fold(f32::INFINITY, f32::min);
        let off = OFF_DETERMINANT * stages * terms;
        let bounds = |furthest: f64| {
            let off = OFF_DISPLACEMENT * stages * (furthest + around.spacing.max_element());
            [furthest - off, furthest + off]
        };
        Screened {
            least: [f64::from(least) - off, f64::from(least) + off],
            furthest: bounds(f64::from(counts(&furthest).sqrt())),
            furthest_outside: bounds(f64::from(counts(&furthest_outside).sqrt())),
        }
    }
}

#[cfg(test)]
impl WarpAudit {
    /// How far single precision is off at most in any tile: the share of what it may be.
    pub(super) fn screening_is_off_by(chain: &Chain, lattice: &Lattice, nose: &NoseBox) -> f64 {
        let around = &Around::new(lattice, nose);
        let tiles = tiles_of(chain.support(lattice)).into_par_iter();
        let shares = tiles.map(|voxels| {
            let tile = TileUnder {
                chain,
                around,
                voxels,
            };
            let screened = Simd::widest().run(ScreenTile(tile));
            let exact = Simd::widest().run(AuditTile(tile));
            let share = |[low, high]: [f64; 2], most: f64, exact: f64| {
                assert!(high.is_finite());
                2.0 * (((low + high) / 2.0).min(most) - exact).abs() / (high - low)
            };
            let Self {
                jacobian_min,
                displacement_max_mm,
                displacement_max_outside_mm,
            } = exact;
            // An audit tells of no determinant above that of what does not move.
            share(screened.least, Self::IDENTITY.jacobian_min, jacobian_min)
                .max(share(screened.furthest, f64::MAX, displacement_max_mm))
                .max(share(
                    screened.furthest_outside,
                    f64::MAX,
                    displacement_max_outside_mm,
                ))
        });
        shares.reduce(|| 0.0, f64::max)
    }
}

/// One tile of a field with a voxel more on every side, but for the lattice's own.
struct AuditFieldTile<'a> {
    tile: &'a Tile,
    inner: VoxelBox,
    around: &'a Around,
}

impl Kernel for AuditFieldTile<'_> {
    type Output = WarpAudit;

    #[inline(always)]
    fn run(self) -> WarpAudit {
        let Self {
            tile,
            inner,
            around,
        } = self;
        let halo = tile.voxels();
        let [nx, ny, nz] = halo.dims();
        let range = |axis: usize| {
            let start = halo.start[axis];
            inner.start[axis] - start..inner.end[axis] - start
        };
        let mut extremes = Extremes::NONE;
        let (ys, zs) = (range(1), range(2));
        for z in zs {
            let (under, over) = (z.saturating_sub(1), (z + 1).min(nz - 1));
            let plane = tile.plane(z);
            let (plane_under, plane_over) = (tile.plane(under), tile.plane(over));
            for y in ys.clone() {
                let (above, below) = (y.saturating_sub(1), (y + 1).min(ny - 1));
                let (Some(here), Some(above_row), Some(below_row), Some(under_row), Some(over_row)) = (
                    plane.row(y),
                    plane.row(above),
                    plane.row(below),
                    plane_under.row(y),
                    plane_over.row(y),
                ) else {
                    continue;
                };
                let along_y = difference(&above_row, &below_row, below - above, 1);
                let along_z = difference(&under_row, &over_row, over - under, 2);
                let along_x = along_row(&here, nx);
                let mut determinants = [1.0; LANES];
                for lane in 0..LANES {
                    let (a, b, c) = (along_x.get(lane), along_y.get(lane), along_z.get(lane));
                    determinants[lane] = DMat3::from_cols(a, b, c).determinant();
                }
                let [x, _, _] = halo.start;
                let targets = Points::row([x, halo.start[1] + y, halo.start[2] + z]);
                extremes.add(around, range(0), &determinants, &targets, &here);
            }
        }
        extremes.found()
    }
}

/// The change between two rows that are so many voxels apart. An axis of a single voxel has no neighbours: nothing
/// changes along it but the position itself.
#[inline(always)]
fn difference(before: &Points, after: &Points, steps: usize, axis: usize) -> Points {
    if steps == 0 {
        return Points::splat(DVec3::AXES[axis]);
    }
    let share = 1.0 / steps as f64;
    let mut change = Points::zero();
    for lane in 0..LANES {
        change.x[lane] = (after.x[lane] - before.x[lane]) * share;
        change.y[lane] = (after.y[lane] - before.y[lane]) * share;
        change.z[lane] = (after.z[lane] - before.z[lane]) * share;
    }
    change
}

/// The change along a row of `n` voxels.
#[inline(always)]
fn along_row(row: &Points, n: usize) -> Points {
    if n == 1 {
        return Points::splat(DVec3::X);
    }
    let (mut before, mut after) = (row.clone(), row.clone());
    for lane in 0..LANES {
        let (to_before, to_after) = (lane.saturating_sub(1), (lane + 1).min(n - 1));
        before.x[lane] = row.x[to_before];
        before.y[lane] = row.y[to_before];
        before.z[lane] = row.z[to_before];
        after.x[lane] = row.x[to_after];
        after.y[lane] = row.y[to_after];
        after.z[lane] = row.z[to_after];
    }
    let mut change = difference(&before, &after, 2, 0);
    // One-sided at either end.
    for lane in [0, n - 1] {
        change.set(lane, change.get(lane) * 2.0);
    }
    change
}

/// What positions are held against.
struct Around {
    spacing: DVec3,
    /// The first voxel and the corners of the nose box, grid millimetres.
    first: DVec3,
    low: DVec3,
    high: DVec3,
}

impl Around {
    fn new(lattice: &Lattice, nose: &NoseBox) -> Self {
        Self {
            spacing: lattice.spacing(),
            first: lattice.point_at(DVec3::ZERO).0,
            low: nose.min.0,
            high: nose.max.0,
        }
    }
}

/// The extremes that each lane met; distances squared.
struct Extremes {
    least: [f64; LANES],
    furthest: [f64; LANES],
    furthest_outside: [f64; LANES],
}

impl Extremes {
    const NONE: Self = Self {
        least: [WarpAudit::IDENTITY.jacobian_min; LANES],
        furthest: [0.0; LANES],
        furthest_outside: [0.0; LANES],
    };

    /// Adds a row, of which the lanes in `counts` are voxels.
    #[inline(always)]
    fn add(
        &mut self,
        around: &Around,
        counts: Range<usize>,
        determinants: &[f64; LANES],
        targets: &Points,
        sources: &Points,
    ) {
        let Around {
            spacing,
            first,
            low,
            high,
        } = around;
        for lane in 0..LANES {
            let x = (sources.x[lane] - targets.x[lane]) * spacing.x;
            let y = (sources.y[lane] - targets.y[lane]) * spacing.y;
            let z = (sources.z[lane] - targets.z[lane]) * spacing.z;
            let moved = x * x + y * y + z * z;
            let x = first.x + targets.x[lane] * spacing.x;
            let y = first.y + targets.y[lane] * spacing.y;
            let z = first.z + targets.z[lane] * spacing.z;
            let inside = (x >= low.x)
                & (x <= high.x)
                & (y >= low.y)
                & (y <= high.y)
                & (z >= low.z)
                & (z <= high.z);
            let counts = (lane >= counts.start) & (lane < counts.end);
            let determinant = determinants[lane];
            if counts & (determinant < self.least[lane]) {
                self.least[lane] = determinant;
            }
            if counts & (moved > self.furthest[lane]) {
                self.furthest[lane] = moved;
            }
            if counts & !inside & (moved > self.furthest_outside[lane]) {
                self.furthest_outside[lane] = moved;
            }
        }
    }

    fn found(self) -> WarpAudit {
        let largest = |of: [f64; LANES]| of.into_iter().fold(0.0, f64::max).sqrt();
        WarpAudit {
            jacobian_min: self.least.into_iter().fold(f64::INFINITY, f64::min),
            displacement_max_mm: largest(self.furthest),
            displacement_max_outside_mm: largest(self.furthest_outside),
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
