//! The lines that hold still, all at once: how near they are to a ball, and their part of the sum within a cell, where most
//! are far and need not be asked for every voxel.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in several arrays at once"
)]

use glam::DVec3;

use super::pair::{Measure, Segment};
use super::{EPSILON, LANES, Points};
use crate::simd::{Real, Vector, larger, smaller};

/// Where lines are that fill up the last block: so far that they add nothing, in any precision.
const NOWHERE: DVec3 = DVec3::splat(1e15);

/// The share of what all far lines may be off by that one of them may.
const SHARE_OF_ONE: f64 = 0.125;

/// Lines in the model's units, a lane each.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct StillLines {
    lines: Vec<Segment>,
    blocks: Vec<Block>,
}

/// [`LANES`] lines.
#[derive(Debug, Clone, PartialEq)]
struct Block {
    start: Points,
    along: Points,
    inverse_length2: [f64; LANES],
}

/// Bounds over a ball of sums over all lines, r = d + ε of each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sums {
    /// From the centre to the nearest line.
    pub nearest: f64,
    /// Σ r⁻² at its least.
    pub least: f64,
    /// Σ r⁻², Σ r⁻³ and Σ r⁻⁴ at their most.
    pub most: [f64; 3],
}

/// Σ r⁻² within a cell of the octree: lines that are far from it summed at its corners, between which their sum is
/// interpolated; the others one by one.
#[derive(Debug, Clone)]
pub(super) struct CellSum<F> {
    /// x fastest.
    far: [F; 8],
    near: Vec<Measure<F>>,
}

impl<F: Real> CellSum<F> {
    pub(super) fn new() -> Self {
        Self {
            far: [F::of(0.0); 8],
            near: Vec::new(),
        }
    }

    /// The sum of the far lines along the row at (y, z) of a cell: at its first voxel, and what each next one adds.
    #[inline(always)]
    pub(super) fn row(&self, side: usize, y: usize, z: usize) -> (F, F) {
        let step = F::of(1.0 / side as f64);
        let (v, w) = (F::of(y as f64) * step, F::of(z as f64) * step);
        let face = |x: usize| {
            let front = self.far[x] + (self.far[x + 2] - self.far[x]) * v;
            let back = self.far[x + 4] + (self.far[x + 6] - self.far[x + 4]) * v;
            front + (back - front) * w
        };
        let first = face(0);
        (first, (face(1) - first) * step)
    }

    /// Adds the lines near the cell to `sum`, at positions in the model's units.
    #[inline(always)]
    pub(super) fn add_near(&self, units: &Points<F>, sum: &mut [F; LANES]) {
        for line in &self.near {
            add_weights(line, units, sum);
        }
    }
}

/// Adds r⁻² of a line at each position.
#[inline(always)]
pub(super) fn add_weights<F: Real>(line: &Measure<F>, units: &Points<F>, sum: &mut [F; LANES]) {
    for lane in 0..LANES {
        let (rx, ry, rz) = line.offset_of(units.x[lane], units.y[lane], units.z[lane]);
        let reach = (rx * rx + ry * ry + rz * rz).sqrt() + F::of(EPSILON);
        sum[lane] += F::of(1.0) / (reach * reach);
    }
}

impl StillLines {
    pub(super) fn new(lines: impl IntoIterator<Item = Segment>) -> Self {
        let mut all = Self::default();
        all.extend(lines);
        all
    }

    pub(super) fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    pub(super) fn lines(&self) -> &[Segment] {
        &self.lines
    }

    pub(super) fn extend(&mut self, lines: impl IntoIterator<Item = Segment>) {
        self.lines.extend(lines);
        self.blocks = self.lines.chunks(LANES).map(Block::of).collect();
    }

    /// From a point to the nearest line, infinite where there is none.
    #[inline(always)]
    pub(super) fn nearest(&self, centre: DVec3) -> f64 {
        let mut nearest = [f64::INFINITY; LANES];
        for block in &self.blocks {
            let distances = block.distances::<f64>(centre);
            for lane in 0..LANES {
                nearest[lane] = smaller(nearest[lane], distances[lane]);
            }
        }
        nearest.into_iter().fold(f64::INFINITY, smaller)
    }

    /// Sums over the ball of `radius` about `centre`.
    #[inline(always)]
    pub(super) fn sums(&self, centre: DVec3, radius: f64) -> Sums {
        let mut nearest = [f64::INFINITY; LANES];
        let mut least = [0.0; LANES];
        let mut most = [[0.0; LANES]; 3];
        for block in &self.blocks {
            let distances = block.distances::<f64>(centre);
            for lane in 0..LANES {
                let distance = distances[lane];
                nearest[lane] = smaller(nearest[lane], distance);
                let far = distance + radius + EPSILON;
                least[lane] += 1.0 / (far * far);
                let near = 1.0 / (larger(distance - radius, 0.0) + EPSILON);
                most[0][lane] += near * near;
                most[1][lane] += near * near * near;
                most[2][lane] += near * near * near * near;
            }
        }
        Sums {
            nearest: nearest.into_iter().fold(f64::INFINITY, smaller),
            least: total(least),
            most: most.map(total),
        }
    }

    /// Puts the sum within a cell into `sum`. The cell has its first corner at `first` and `sides` that are positive, in the
    /// model's units; nowhere in it is the sum off by more than `most_off`.
    ///
    /// Along any unit direction 0 ≤ d·d'' ≤ 1 and |d'| ≤ 1, so the second derivative of r⁻² is at most 6/d⁴ where d ≥ ε, and
    /// trilinear interpolation on a box of sides hₐ is off by at most Σhₐ²/8 of that.
    #[inline(always)]
    pub(super) fn in_cell<F: Real>(
        &self,
        first: DVec3,
        sides: DVec3,
        most_off: f64,
        sum: &mut CellSum<F>,
    ) {
        let centre = first + sides * 0.5;
        let radius = 0.5 * sides.length();
        let bend = 0.75 * sides.length_squared();
        let mut left = most_off;
        let mut far = [[F::of(0.0); LANES]; 8];
        sum.near.clear();
        for (block, lines) in self.blocks.iter().zip(self.lines.chunks(LANES)) {
            let distances = block.distances::<f64>(centre);
            let mut offs = [0.0; LANES];
            for lane in 0..LANES {
                let nearest = larger(distances[lane] - radius, EPSILON);
                offs[lane] = bend / (nearest * nearest * nearest * nearest);
            }
            let mut counts = [F::of(0.0); LANES];
            for (lane, line) in lines.iter().enumerate() {
                if offs[lane] <= most_off * SHARE_OF_ONE && offs[lane] <= left {
                    left -= offs[lane];
                    counts[lane] = F::of(1.0);
                } else {
                    sum.near.push(line.measure());
                }
            }
            for (corner, far) in far.iter_mut().enumerate() {
                let share =
                    DVec3::from_array([corner & 1, corner >> 1 & 1, corner >> 2].map(|n| n as f64));
                let distances = block.distances::<F>(first + sides * share);
                for lane in 0..LANES {
                    let reach = distances[lane] + F::of(EPSILON);
                    far[lane] += counts[lane] / (reach * reach);
                }
            }
        }
        sum.far = far.map(total);
    }
}

impl Block {
    fn of(lines: &[Segment]) -> Self {
        let mut block = Self {
            start: Points::splat(NOWHERE),
            along: Points::splat(DVec3::ZERO),
            inverse_length2: [0.0; LANES],
        };
        for (lane, line) in lines.iter().enumerate().take(LANES) {
            block.start.set(lane, line.start);
            block.along.set(lane, line.end - line.start);
            block.inverse_length2[lane] = line.inverse_length2();
        }
        block
    }

    /// From a point to each line.
    #[inline(always)]
    fn distances<F: Real>(&self, at: DVec3) -> [F; LANES] {
        let at: Vector<F> = Vector::of(at);
        let mut distances = [F::of(0.0); LANES];
        for lane in 0..LANES {
            let line = Measure::new(
                self.start.vector(lane),
                self.along.vector(lane),
                F::of(self.inverse_length2[lane]),
            );
            let (rx, ry, rz) = line.offset_of(at.x, at.y, at.z);
            distances[lane] = (rx * rx + ry * ry + rz * rz).sqrt();
        }
        distances
    }
}

/// The sum of all lanes, in the same order for any instructions.
#[inline(always)]
fn total<F: Real>(lanes: [F; LANES]) -> F {
    let mut sums = lanes;
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            let other = sums[lane + width];
            sums[lane] += other;
        }
        width /= 2;
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};

    use super::*;

    /// Short lines in a cube of side 100, the first of them a point.
    fn scattered(count: usize) -> (Vec<Segment>, impl FnMut(f64, f64) -> DVec3) {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let mut point = move |low: f64, high: f64| {
            DVec3::from_array(
                [0; 3]
                    .map(|_| low + (high - low) * f64::from(rng.next_u32()) / f64::from(u32::MAX)),
            )
        };
        let lines = (0..count).map(|place| {
            let start = point(0.0, 100.0);
            let along = point(-20.0, 20.0) * f64::from(u8::from(place > 0));
            Segment::new(start, start + along)
        });
        (lines.collect(), point)
    }

    fn weight(distance: f64) -> f64 {
        ((distance + EPSILON) * (distance + EPSILON)).recip()
    }

    #[test]
    fn sums_bound_those_of_every_point_of_the_ball() {
        for count in [1, 15, 16, 37] {
            let (lines, mut point) = scattered(count);
            let still = StillLines::new(lines.clone());
            for _ in 0..50 {
                let (centre, radius) = (point(0.0, 100.0), 12.0);
                let nearest = lines.iter().map(|line| line.distance(centre));
                let nearest = nearest.fold(f64::INFINITY, f64::min);
                let sums = still.sums(centre, radius);
                assert!((still.nearest(centre) - nearest).abs() < 1e-9);
                assert_eq!(sums.nearest, still.nearest(centre));
                let at = centre + point(-1.0, 1.0).normalize() * radius;
                let sum = |power: usize| {
                    let each = lines.iter().map(|line| line.distance(at) + EPSILON);
                    let powers = each.map(|reach| std::iter::repeat_n(1.0 / reach, power));
                    powers.map(Iterator::product::<f64>).sum::<f64>()
                };
                assert!(sums.least <= sum(2));
                for (power, most) in (2..).zip(sums.most) {
                    assert!(sum(power) <= most);
                }
            }
        }
    }

    #[test]
    fn within_a_cell_the_sum_is_off_by_no_more_than_allowed() {
        let (lines, mut point) = scattered(50);
        let still = StillLines::new(lines.clone());
        let sides = DVec3::new(8.0, 8.0, 11.0);
        let mut sum = CellSum::<f64>::new();
        let (mut near, mut worst) = (0, 0.0_f64);
        for case in 0..200 {
            let first = point(0.0, 90.0);
            let allowed = [1e-2, 1e-3, 1e-4, 0.0][case % 4];
            still.in_cell(first, sides, allowed, &mut sum);
            near += sum.near.len();
            for (y, z) in [(0, 0), (3, 5), (7, 1)] {
                let (start, along) = sum.row(8, y, z);
                let mut units = Points::zero();
                let mut found = [0.0; LANES];
                for x in 0..8 {
                    let share = DVec3::new(x as f64, y as f64, z as f64) / 8.0;
                    units.set(x, first + sides * share);
                    found[x] = start + along * x as f64;
                }
                sum.add_near(&units, &mut found);
                for x in 0..8 {
                    let each = lines.iter().map(|line| weight(line.distance(units.get(x))));
                    let expected: f64 = each.sum();
                    let off = (found[x] - expected).abs();
                    assert!(off <= allowed + 1e-12 * expected, "{off} {allowed}");
                    worst = worst.max(if allowed > 0.0 { off / allowed } else { 0.0 });
                }
            }
        }
        // Neither all of them one by one, nor much less than what is allowed.
        assert!(near > 200 * 50 / 4 && near < 200 * 40, "{near}");
        assert!(worst > 0.05, "{worst}");
    }
}
