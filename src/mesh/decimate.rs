//! Fewer triangles for the same shape.
//!
//! Edges are collapsed in the order of the error that this makes (M. Garland, P. S. Heckbert, *Surface
//! simplification using quadric error metrics*, SIGGRAPH 1997, DOI 10.1145/258734.258849). One is collapsed only
//! where that keeps the surface a closed 2-manifold: its ends have no neighbours in common but the tips of its two
//! triangles, the link condition (T. K. Dey, H. Edelsbrunner, S. Guha, D. V. Nekhayev, *Topology preserving edge
//! contraction*, 1999).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::{DMat3, DVec3};

use super::body::{Mesh, MeshError, area, room};
use crate::space::GridPoint;

/// A triangle may turn by no more than this in one collapse: the cosine of 60°.
const LEAST_TURN: f64 = 0.5;

/// The least that a triangle may fill of the equilateral one over its longest side, or of what it filled before.
const LEAST_FILL: f64 = 0.05;

/// Collapses edges of a closed mesh until no more than `triangles` are left, or none can be collapsed any
/// more. The result is closed, and its points are not those of before.
///
/// # Errors
/// [`MeshError::Volume`] where the machine has no memory for it.
pub fn decimate(mesh: &mut Mesh, triangles: usize) -> Result<(), MeshError> {
    if mesh.triangles.len() <= triangles {
        return Ok(());
    }
    let mut work = Work::new(mesh)?;
    while work.alive > triangles {
        let Some(next) = work.queue.pop() else {
            break;
        };
        let [a, b] = next.ends;
        if next.stamps == [work.stamps[a as usize], work.stamps[b as usize]] {
            work.collapse(a, b, next.to);
        }
    }
    *mesh = work.finish()?;
    Ok(())
}

/// The sum of squared distances to planes, as p·A·p + 2 b·p + c.
#[derive(Debug, Clone, Copy)]
struct Quadric {
    /// Of A: xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: DVec3,
    c: f64,
}

impl Quadric {
    const ZERO: Self = Self {
        a: [0.0; 6],
        b: DVec3::ZERO,
        c: 0.0,
    };

    /// Of a triangle's plane, times its area.
    fn of_triangle([p, q, r]: [DVec3; 3]) -> Self {
        let across = (q - p).cross(r - p);
        let weight = 0.5 * across.length();
        let normal = across.normalize_or_zero();
        let offset = -normal.dot(p);
        let DVec3 { x, y, z } = normal;
        Self {
            a: [x * x, x * y, x * z, y * y, y * z, z * z].map(|product| product * weight),
            b: normal * (offset * weight),
            c: offset * offset * weight,
        }
    }

    fn add(&mut self, other: &Self) {
        for (to, value) in self.a.iter_mut().zip(other.a) {
            *to += value;
        }
        self.b += other.b;
        self.c += other.c;
    }

    fn matrix(&self) -> DMat3 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz])
    }

    fn error(&self, at: DVec3) -> f64 {
        (self.matrix() * at + self.b * 2.0).dot(at) + self.c
    }

    /// Where the error is least. Along directions in which it hardly changes, as within a plane, the point stays
    /// near `middle`.
    fn best(&self, middle: DVec3) -> Option<DVec3> {
        let matrix = self.matrix();
        let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
        let hold = trace * 1e-3;
        let held = matrix + DMat3::from_diagonal(DVec3::splat(hold));
        let best = middle - held.inverse() * (matrix * middle + self.b);
        best.is_finite().then_some(best)
    }
}

/// An edge that may be collapsed. Greatest is the one to collapse first.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    error: f64,
    ends: [u32; 2],
    /// Of the ends, when this was made: an end that changed has other candidates now.
    stamps: [u32; 2],
    to: DVec3,
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        let error = other.error.total_cmp(&self.error);
        error.then_with(|| other.ends.cmp(&self.ends))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Candidate {}

/// The mesh while edges are collapsed.
struct Work {
    points: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// The triangles around each point. A triangle that is gone is in none.
    around: Vec<Vec<u32>>,
    quadrics: Vec<Quadric>,
    stamps: Vec<u32>,
    queue: BinaryHeap<Candidate>,
    /// Triangles that are left.
    alive: usize,
}

impl Work {
    fn new(mesh: &Mesh) -> Result<Self, MeshError> {
        let count = mesh.points.len();
        let mut points = room(count)?;
        points.extend(mesh.points.iter().map(|point| point.0));
        let mut triangles = room(mesh.triangles.len())?;
        triangles.extend_from_slice(&mesh.triangles);
        let mut around: Vec<Vec<u32>> = room(count)?;
        around.resize_with(count, || Vec::with_capacity(6));
        let mut quadrics = room(count)?;
        quadrics.resize(count, Quadric::ZERO);
        let mut stamps = room(count)?;
        stamps.resize(count, 0);
        for (place, triangle) in mesh.triangles.iter().enumerate() {
            let quadric = Quadric::of_triangle(mesh.corners(triangle));
            for &point in triangle {
                around[point as usize].push(place as u32);
                quadrics[point as usize].add(&quadric);
            }
        }
        let mut work = Self {
            points,
            triangles,
            around,
            quadrics,
            stamps,
            queue: BinaryHeap::new(),
            alive: mesh.triangles.len(),
        };
        let mut candidates = room(mesh.triangles.len() / 2 * 3)?;
        for &[a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                // Each edge once, though it is walked twice.
                if from < to {
                    candidates.push(work.candidate(from, to));
                }
            }
        }
        work.queue = BinaryHeap::from(candidates);
        Ok(work)
    }

    fn candidate(&self, a: u32, b: u32) -> Candidate {
        let ends = [a.min(b), a.max(b)];
        let [p, q] = ends.map(|end| self.points[end as usize]);
        let mut quadric = self.quadrics[ends[0] as usize];
        quadric.add(&self.quadrics[ends[1] as usize]);
        let middle = (p + q) * 0.5;
        let reach = (p - q).length();
        let best = quadric.best(middle);
        // A point far off is that of planes that hardly meet.
        let to = best
            .filter(|best| (*best - middle).length() <= reach)
            .unwrap_or(middle);
        Candidate {
            error: quadric.error(to).max(0.0),
            ends,
            stamps: ends.map(|end| self.stamps[end as usize]),
            to,
        }
    }

    /// Collapses the edge from `a` to `b` into `to`, where the surface stays sound.
    fn collapse(&mut self, a: u32, b: u32, to: DVec3) {
        let shared = |triangle: &u32| self.triangles[*triangle as usize].contains(&b);
        let gone: Vec<u32> = self.around[a as usize]
            .iter()
            .copied()
            .filter(shared)
            .collect();
        if gone.len() != 2 || !self.keeps_manifold(a, b) {
            return;
        }
        if !(self.keeps_shape(a, b, to) && self.keeps_shape(b, a, to)) {
            return;
        }
        for &triangle in &gone {
            for point in self.triangles[triangle as usize] {
                self.around[point as usize].retain(|&other| other != triangle);
            }
        }
        self.alive -= gone.len();
        let moved = std::mem::take(&mut self.around[b as usize]);
        for &triangle in &moved {
            for point in &mut self.triangles[triangle as usize] {
                if *point == b {
                    *point = a;
                }
            }
        }
        self.around[a as usize].extend(moved);
        self.points[a as usize] = to;
        let other = self.quadrics[b as usize];
        self.quadrics[a as usize].add(&other);
        // The point b is in no triangle now, and no candidate of it holds.
        self.stamps[a as usize] += 1;
        self.stamps[b as usize] += 1;
        for other in self.neighbours(a) {
            let candidate = self.candidate(a, other);
            self.queue.push(candidate);
        }
    }

    /// The points that share an edge with a point, sorted.
    fn neighbours(&self, point: u32) -> Vec<u32> {
        let triangles = self.around[point as usize].iter();
        let mut points: Vec<u32> = triangles
            .flat_map(|&triangle| self.triangles[triangle as usize])
            .filter(|&other| other != point)
            .collect();
        points.sort_unstable();
        points.dedup();
        points
    }

    /// The link condition: the two ends have only the tips of the edge's triangles as common neighbours, and no
    /// common edge opposite them, as the ends of a tetrahedron's edge have.
    fn keeps_manifold(&self, a: u32, b: u32) -> bool {
        let (of_a, of_b) = (self.neighbours(a), self.neighbours(b));
        let common = of_a
            .iter()
            .filter(|point| of_b.binary_search(point).is_ok());
        common.count() == 2 && (of_a.len() > 3 || of_b.len() > 3)
    }

    /// Whether the triangles of `end` that stay keep their direction and do not become slivers when it moves.
    fn keeps_shape(&self, end: u32, other: u32, to: DVec3) -> bool {
        self.around[end as usize].iter().all(|&triangle| {
            let triangle = self.triangles[triangle as usize];
            if triangle.contains(&other) {
                return true;
            }
            let before = triangle.map(|point| self.points[point as usize]);
            let mut after = before;
            for (corner, point) in after.iter_mut().zip(triangle) {
                if point == end {
                    *corner = to;
                }
            }
            let normal = |[p, q, r]: [DVec3; 3]| (q - p).cross(r - p).normalize_or_zero();
            normal(before).dot(normal(after)) >= LEAST_TURN
                && fill(after) >= LEAST_FILL.min(fill(before))
        })
    }

    fn finish(self) -> Result<Mesh, MeshError> {
        let mut number = room(self.points.len())?;
        number.resize(self.points.len(), u32::MAX);
        let mut mesh = Mesh {
            points: Vec::new(),
            triangles: room(self.alive)?,
        };
        for (place, point) in self.points.iter().enumerate() {
            if !self.around[place].is_empty() {
                number[place] = mesh.points.len() as u32;
                mesh.points.push(GridPoint(*point));
            }
        }
        for (place, triangle) in self.triangles.iter().enumerate() {
            let [first, _, _] = *triangle;
            if self.around[first as usize].contains(&(place as u32)) {
                let numbered = triangle.map(|point| number[point as usize]);
                mesh.triangles.push(numbered);
            }
        }
        Ok(mesh)
    }
}

/// A triangle's area over that of the equilateral one over its longest side.
fn fill(corners: [DVec3; 3]) -> f64 {
    let [p, q, r] = corners;
    let longest = [q - p, r - q, p - r]
        .map(DVec3::length_squared)
        .into_iter()
        .fold(0.0, f64::max);
    area(corners) / (longest * 0.25 * 3.0_f64.sqrt())
}
