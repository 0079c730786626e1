//! Adaptive evaluation (paper section III; Lerios et al. 1995; method section 4).
//!
//! A cell's 8 corners are mapped exactly, and so are the 19 further points that halving it would add.
//! Where trilinear interpolation from the corners meets every one of the 19 within the tolerance, the
//! voxels inside take interpolated positions; else the cell is split into 8, down to single voxels.
//!
//! The 19 points alone say nothing of the voxels between them: with lines close together the true
//! error reaches twice the largest at the 19. So a cell is also held to what lies between:
//!
//! - Far from every line, the map is smooth on the scale of the cell. There the 8 centres of the cell's
//!   eighths are checked as well (an error that is odd about the cell's centre vanishes at the 19 and
//!   is largest near these), and all must be within [`FAR_SHARE`] of the tolerance.
//! - Near a line, a bound is added. Let p be the largest difference at the points checked and B the most
//!   that trilinear interpolation over the whole cell can be off by, from a bound on the map's second
//!   derivative ([`bounds`](super::bounds)). Interpolation over an eighth of the cell is off by at most
//!   B/4, and it differs from interpolation over the cell by at most p: p + B/4 bounds the error.
//!
//! A cell of side [`LEAST`] that does not pass is mapped voxel by voxel: exactly, but that of lines beside f2..f9 those far from
//! the cell are summed at its corners, and their sum is interpolated, where a bound on how far it is off allows that
//! ([`still`](super::still)).

use glam::DVec3;

use super::bounds::Bend;
use super::chain::Chain;
use super::stage::StageMap;
use super::still::CellSum;
use super::tile::{CellPlane, CellRow, TILE, Tile, trilinear};
use super::{LANES, Points};
use crate::simd::Real;

/// The share of the tolerance that the points checked in a cell far from every line may use. Over wild
/// lines (two random segments through the nose, 618 runs) no voxel was off by more than the tolerance
/// with 0.6, 0.7 or 0.8, and one by 3 % more with 0.9.
const FAR_SHARE: f64 = 0.6;

/// The share of the tolerance that positions may be off by where the sum of far lines is interpolated.
const SUM_SHARE: f64 = 0.5;

/// The side of the smallest cell that is interpolated. Checking one asks for 35 positions and a bound on the map's second
/// derivative, which is most of what all positions of a smaller one ask for.
const LEAST: usize = 8;

/// The largest cell: a whole tile.
const ROOT: usize = TILE;

/// Points along the side of a tile's lattice.
const SIDE: usize = ROOT + 1;

/// Memory for one worker: the exact positions of one tile, each computed at most once.
#[derive(Debug)]
pub(super) struct Scratch {
    positions: Vec<DVec3>,
    known: Vec<bool>,
    cells: Vec<([usize; 3], usize)>,
}

impl Scratch {
    pub(super) fn new() -> Self {
        Self {
            positions: vec![DVec3::ZERO; SIDE * SIDE * SIDE],
            known: vec![false; SIDE * SIDE * SIDE],
            cells: Vec::new(),
        }
    }

    fn place([x, y, z]: [usize; 3]) -> usize {
        (z * SIDE + y) * SIDE + x
    }

    fn get(&self, at: [usize; 3]) -> DVec3 {
        self.positions[Self::place(at)]
    }

    /// Maps those of the points that are not known yet.
    #[inline(always)]
    fn ensure<F: Real>(&mut self, chain: &Chain, origin: DVec3, wanted: &[[usize; 3]]) {
        let mut batch = [0; LANES];
        let mut filled = 0;
        let mut points = Points::<F>::splat(origin);
        for &at in wanted {
            let place = Self::place(at);
            if self.known[place] {
                continue;
            }
            self.known[place] = true;
            batch[filled] = place;
            points.set(
                filled,
                origin + DVec3::new(at[0] as f64, at[1] as f64, at[2] as f64),
            );
            filled += 1;
            if filled == LANES {
                self.flush(chain, &mut points, &batch);
                filled = 0;
            }
        }
        if filled > 0 {
            self.flush(chain, &mut points, &batch[..filled]);
        }
    }

    /// The exact corners of a cell, where interpolation from them meets its 19 further points and the
    /// centres of its eighths within `limit`.
    #[inline(always)]
    fn corners_if_within<F: Real>(
        &mut self,
        chain: &Chain,
        origin: DVec3,
        at: [usize; 3],
        half: usize,
        metric: DVec3,
        limit: f64,
    ) -> Option<[DVec3; 8]> {
        let wanted = lattice_27(at, half);
        self.ensure::<F>(chain, origin, &wanted);
        let corners = CORNERS.map(|place| self.get(wanted[place]));
        if !self.are_within(&corners, &wanted, at, half, metric, limit) {
            return None;
        }
        let centres = eighth_centres(at, half);
        self.ensure::<F>(chain, origin, &centres);
        let within = self.are_within(&corners, &centres, at, half, metric, limit);
        within.then_some(corners)
    }

    /// Whether interpolation from the corners of a cell meets points whose positions are known.
    #[inline(always)]
    fn are_within(
        &self,
        corners: &[DVec3; 8],
        points: &[[usize; 3]],
        at: [usize; 3],
        half: usize,
        metric: DVec3,
        limit: f64,
    ) -> bool {
        let step = 0.5 / half as f64;
        let mut worst = 0.0;
        for point in points {
            let share = [0, 1, 2].map(|axis| (point[axis] - at[axis]) as f64 * step);
            let off = (trilinear(corners, share) - self.get(*point)) * metric;
            let squared = off.length_squared();
            worst = if squared > worst { squared } else { worst };
        }
        worst <= limit * limit
    }

    #[inline(always)]
    fn flush<F: Real>(&mut self, chain: &Chain, points: &mut Points<F>, places: &[usize]) {
        chain.to_source(points);
        for (lane, &place) in places.iter().enumerate() {
            self.positions[place] = points.get(lane);
        }
    }
}

/// Fills `tile` with source positions that are within `tolerance` of the exact ones; distances are
/// measured after multiplying the axes by `metric`. To the tolerance comes what a position of the precision is off by, up to
/// four times.
#[inline(always)]
pub(super) fn fill<F: Real>(
    chain: &Chain,
    tolerance: f64,
    metric: DVec3,
    scratch: &mut Scratch,
    tile: &mut Tile,
) {
    let origin = tile.index([0; 3]);
    let dims = tile.voxels().dims();
    let mut sum = CellSum::<F>::new();
    scratch.known.fill(false);
    scratch.cells.clear();
    scratch.cells.push(([0; 3], ROOT));
    while let Some((at, side)) = scratch.cells.pop() {
        if (0..3).any(|axis| at[axis] >= dims[axis]) {
            continue;
        }
        let half = side / 2;
        let limit = match chain.bend(tile.index(at), side as f64, metric) {
            Bend::Smooth => tolerance * FAR_SHARE,
            Bend::Bounded(error) => tolerance - error * 0.25,
        };
        let corners = (limit >= 0.0)
            .then(|| scratch.corners_if_within::<F>(chain, origin, at, half, metric, limit))
            .flatten();
        if let Some(corners) = corners {
            if side == ROOT {
                tile.set_cell(corners);
                return;
            }
            interpolate(tile, at, side, dims, &corners);
            continue;
        }
        if half < LEAST {
            let stage = chain.summed_in_cell(
                tile.index(at),
                side as f64,
                metric,
                tolerance * SUM_SHARE,
                &mut sum,
            );
            one_by_one(
                chain,
                stage.map(|stage| (stage, &sum)),
                tile,
                at,
                side,
                dims,
            );
            continue;
        }
        for child in 0..8 {
            let shift = [child & 1, child >> 1 & 1, child >> 2];
            let corner = [0, 1, 2].map(|axis| at[axis] + shift[axis] * half);
            scratch.cells.push((corner, half));
        }
    }
}

/// Maps every voxel of a cell, as many rows at a time as fill the lanes.
#[inline(always)]
fn one_by_one<F: Real>(
    chain: &Chain,
    summed: Option<(&StageMap, &CellSum<F>)>,
    tile: &mut Tile,
    at: [usize; 3],
    side: usize,
    dims: [usize; 3],
) {
    let first = tile.index(at);
    let rows = LANES / side;
    let count = |axis: usize| side.min(dims[axis] - at[axis]);
    for z in 0..count(2) {
        for y in (0..count(1)).step_by(rows) {
            let mut points = Points::<F>::zero();
            for lane in 0..LANES {
                points.x[lane] = F::of(first.x + (lane % side) as f64);
                points.y[lane] = F::of(first.y + (y + lane / side) as f64);
                points.z[lane] = F::of(first.z + z as f64);
            }
            match summed {
                Some((stage, sum)) => {
                    let mut far = [F::of(0.0); LANES];
                    for row in 0..rows {
                        let (first, along) = sum.row(side, y + row, z);
                        for x in 0..side {
                            far[row * side + x] = first + along * F::of(x as f64);
                        }
                    }
                    stage.to_source_in_cell(sum, &far, &mut points);
                }
                None => chain.to_source(&mut points),
            }
            let lanes = points.x.chunks(side).zip(points.y.chunks(side));
            let lanes = lanes.zip(points.z.chunks(side));
            for (row, ((px, py), pz)) in lanes.enumerate().take(count(1) - y) {
                // Voxels past the tile's end mean nothing: a row has room for them.
                let to = Tile::row(at[1] + y + row, at[2] + z).start + at[0];
                tile.put(to..to + side, px, py, pz);
            }
        }
    }
}

/// The places in [`lattice_27`] of the 8 corners, x fastest.
const CORNERS: [usize; 8] = [0, 2, 6, 8, 18, 20, 24, 26];

/// The 27 points of a halved cell, x fastest.
fn lattice_27(at: [usize; 3], half: usize) -> [[usize; 3]; 27] {
    std::array::from_fn(|place| {
        [
            at[0] + place % 3 * half,
            at[1] + place / 3 % 3 * half,
            at[2] + place / 9 * half,
        ]
    })
}

/// The centres of the eighths of a cell, x fastest.
fn eighth_centres(at: [usize; 3], half: usize) -> [[usize; 3]; 8] {
    std::array::from_fn(|eighth| {
        [
            at[0] + half / 2 + (eighth & 1) * half,
            at[1] + half / 2 + (eighth >> 1 & 1) * half,
            at[2] + half / 2 + (eighth >> 2) * half,
        ]
    })
}

/// Fills the voxels of a cell from its corners.
#[inline(always)]
fn interpolate(
    tile: &mut Tile,
    at: [usize; 3],
    side: usize,
    dims: [usize; 3],
    corners: &[DVec3; 8],
) {
    let count = |axis: usize| side.min(dims[axis] - at[axis]);
    for z in 0..count(2) {
        let plane = CellPlane::<f64>::new(corners, side, z);
        for y in 0..count(1) {
            let CellRow { first, along } = plane.row(y);
            let row = Tile::row(at[1] + y, at[2] + z).start + at[0];
            let n = count(0);
            for (x, to) in tile.x[row..row + n].iter_mut().enumerate() {
                *to = first.x + along.x * x as f64;
            }
            for (x, to) in tile.y[row..row + n].iter_mut().enumerate() {
                *to = first.y + along.y * x as f64;
            }
            for (x, to) in tile.z[row..row + n].iter_mut().enumerate() {
                *to = first.z + along.z * x as f64;
            }
        }
    }
}
