//! Adaptive evaluation (paper section III; Lerios et al. 1995; method section 4).
//!
//! A cell's 8 corners are mapped exactly, and so are the 19 further points that halving it would add.
//! Where trilinear interpolation from the corners meets every one of the 19 within the tolerance, the
//! voxels inside take interpolated positions; else the cell is split into 8, down to single voxels.
//!
//! The 19 points alone say nothing of the voxels between them: with lines close together the true
//! error reaches twice the largest at the 19. So a bound is added for what lies between. Let p be the
//! largest difference at the 19 and B the most that trilinear interpolation over the whole cell can be
//! off by, from a bound on the map's second derivative ([`bounds`](super::bounds)). Interpolation over an
//! eighth of the cell is off by at most B/4, and it differs from interpolation over the cell by at most
//! p, so p + B/4 bounds the error anywhere in the cell. In a cell of side 2 every voxel is one of the 27
//! points, and p is the error.

use glam::DVec3;

use super::chain::Chain;
use super::tile::{TILE, Tile};
use super::{LANES, Points};

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
    fn ensure(&mut self, chain: &Chain, origin: DVec3, wanted: &[[usize; 3]]) {
        let mut batch = [0; LANES];
        let mut filled = 0;
        let mut points = Points::splat(origin);
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

    /// The exact corners of a cell, where interpolation from them meets its 19 further points within `limit`.
    fn corners_if_within(
        &mut self,
        chain: &Chain,
        origin: DVec3,
        at: [usize; 3],
        half: usize,
        metric: DVec3,
        limit: f64,
    ) -> Option<[DVec3; 8]> {
        let wanted = lattice_27(at, half);
        self.ensure(chain, origin, &wanted);
        let corners = CORNERS.map(|place| self.get(wanted[place]));
        let within = wanted.iter().enumerate().all(|(place, &point)| {
            let steps = [place % 3, place / 3 % 3, place / 9];
            let interpolated = trilinear(&corners, steps.map(|step| step as f64 * 0.5));
            let off = (interpolated - self.get(point)) * metric;
            off.length_squared() <= limit * limit
        });
        within.then_some(corners)
    }

    fn flush(&mut self, chain: &Chain, points: &mut Points, places: &[usize]) {
        chain.to_source(points);
        for (lane, &place) in places.iter().enumerate() {
            self.positions[place] = points.get(lane);
        }
    }
}

/// Fills `tile` with source positions that are within `tolerance` of the exact ones; distances are
/// measured after multiplying the axes by `metric`.
pub(super) fn fill(
    chain: &Chain,
    tolerance: f64,
    metric: DVec3,
    scratch: &mut Scratch,
    tile: &mut Tile,
) {
    let origin = tile.index([0; 3]);
    let dims = tile.voxels().dims();
    scratch.known.fill(false);
    scratch.cells.clear();
    scratch.cells.push(([0; 3], ROOT));
    while let Some((at, side)) = scratch.cells.pop() {
        if (0..3).any(|axis| at[axis] >= dims[axis]) {
            continue;
        }
        if side == 1 {
            scratch.ensure(chain, origin, &[at]);
            tile.set(at, scratch.get(at));
            continue;
        }
        let half = side / 2;
        let between = if half == 1 {
            0.0
        } else {
            chain.interpolation_error(tile.index(at), side as f64, metric) * 0.25
        };
        let limit = tolerance - between;
        let corners = (limit >= 0.0)
            .then(|| scratch.corners_if_within(chain, origin, at, half, metric, limit))
            .flatten();
        if let Some(corners) = corners {
            interpolate(tile, at, side, dims, &corners);
            continue;
        }
        for child in 0..8 {
            let shift = [child & 1, child >> 1 & 1, child >> 2];
            let corner = [0, 1, 2].map(|axis| at[axis] + shift[axis] * half);
            scratch.cells.push((corner, half));
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

fn trilinear(corners: &[DVec3; 8], [x, y, z]: [f64; 3]) -> DVec3 {
    let along_x = |pair: usize| corners[pair] + (corners[pair + 1] - corners[pair]) * x;
    let front = along_x(0) + (along_x(2) - along_x(0)) * y;
    let back = along_x(4) + (along_x(6) - along_x(4)) * y;
    front + (back - front) * z
}

/// Fills the voxels of a cell from its corners.
fn interpolate(
    tile: &mut Tile,
    at: [usize; 3],
    side: usize,
    dims: [usize; 3],
    corners: &[DVec3; 8],
) {
    let step = 1.0 / side as f64;
    let count = |axis: usize| side.min(dims[axis] - at[axis]);
    for z in 0..count(2) {
        for y in 0..count(1) {
            let (v, w) = (y as f64 * step, z as f64 * step);
            let first = trilinear(corners, [0.0, v, w]);
            let along = (trilinear(corners, [1.0, v, w]) - first) * step;
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
