//! The surface within one cell of eight voxels, for each of the 256 ways in which they can lie inside.
//!
//! Source: marching cubes, W. E. Lorensen, H. E. Cline, Computer Graphics 21(4), 1987, DOI
//! 10.1145/37402.37422. Its table leaves holes where two diagonal corners of a face are inside (M. J. Dürst,
//! Computer Graphics 22(2), 1988, DOI 10.1145/378267.378271). Here the table is made from a rule for faces
//! instead: **corners inside that meet only across a face's diagonal are kept apart**, which is how
//! components are counted as well (6-connected). The rule looks at the face alone, so both cells of a face draw
//! the same lines on it: every line is drawn twice, once each way, and the surface is closed.
//!
//! What remains is to fill each loop of lines with triangles. A diagonal between two points of one face could be
//! drawn by the cell on the other side too, and an edge would have four triangles. The filling has no such
//! diagonal, so each of its diagonals exists in one cell only. Hence every edge has exactly two triangles,
//! and as every point lies in one loop of each of its four cells, also the triangles around every point form
//! one ring: the surface is a 2-manifold for any set of voxels.

use std::sync::OnceLock;

/// Edges of a cell: along each axis, from the corner that [`EDGE_START`] gives.
pub(super) const EDGES: usize = 12;

/// For each edge the corner with the smaller index along the edge's axis; the axis is `edge / 4`.
pub(super) const EDGE_START: [usize; EDGES] = [0, 2, 4, 6, 0, 1, 4, 5, 0, 1, 2, 3];

/// The triangles of each case, as edges of the cell. Bit c of a case says that corner c is inside; the bits of c
/// are its offsets along x, y and z. Triangles turn counterclockwise as seen from outside the object.
pub(super) fn cases() -> &'static [Vec<[u8; 3]>] {
    static CASES: OnceLock<Vec<Vec<[u8; 3]>>> = OnceLock::new();
    CASES.get_or_init(|| (0..=u8::MAX).map(case).collect())
}

fn case(inside: u8) -> Vec<[u8; 3]> {
    let next = lines(inside);
    let mut seen = [false; EDGES];
    let mut triangles = Vec::new();
    for first in 0..EDGES {
        let mut ring = Vec::new();
        let mut at = first;
        while let Some(after) = next[at].filter(|_| !seen[at]) {
            seen[at] = true;
            ring.push(at);
            at = after;
        }
        fill(&ring, &mut triangles);
    }
    triangles
}

/// For each crossed edge the edge that the line drawn from it goes to: on a face seen from outside the cell, from
/// where a counterclockwise walk enters the object to where it leaves it.
fn lines(inside: u8) -> [Option<usize>; EDGES] {
    let mut next = [None; EDGES];
    for axis in 0..3 {
        for side in 0..2 {
            let corners = face(axis, side);
            let is_inside = |place: usize| inside >> corners[place % 4] & 1 == 1;
            // A run of corners inside begins after one edge and ends at another: the line cuts it off.
            for place in 0..4 {
                if is_inside(place + 3) || !is_inside(place) {
                    continue;
                }
                let mut end = place;
                while is_inside(end + 1) {
                    end += 1;
                }
                let entered = edge_between(corners[(place + 3) % 4], corners[place]);
                let left = edge_between(corners[end % 4], corners[(end + 1) % 4]);
                next[entered] = Some(left);
            }
        }
    }
    next
}

/// The corners of a face, counterclockwise as seen from outside the cell.
fn face(axis: usize, side: usize) -> [usize; 4] {
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let at = side << axis;
    match side {
        1 => [at, at | u, at | u | v, at | v],
        _ => [at, at | v, at | u | v, at | u],
    }
}

fn edge_between(a: usize, b: usize) -> usize {
    let (start, axis) = (a & b, (a ^ b).trailing_zeros() as usize);
    let edges = 4 * axis..4 * axis + 4;
    let found = edges.clone().find(|&edge| EDGE_START[edge] == start);
    found.unwrap_or(edges.start)
}

/// Fills a loop with triangles whose diagonals lie in no face.
fn fill(ring: &[usize], to: &mut Vec<[u8; 3]>) {
    let Some(last) = ring.len().checked_sub(1) else {
        return;
    };
    fill_between(ring, 0, last, to);
}

/// Fills the part of a loop that the diagonal from place `i` to place `j` cuts off; whether it can be.
fn fill_between(ring: &[usize], i: usize, j: usize, to: &mut Vec<[u8; 3]>) -> bool {
    if j - i < 2 {
        return true;
    }
    let drawn = |a: usize, b: usize| b - a == 1 || !share_a_face(ring[a], ring[b]);
    let before = to.len();
    // The corners in the middle first: rounder triangles.
    let mut tips: Vec<usize> = (i + 1..j).collect();
    tips.sort_by_key(|&tip| (2 * tip).abs_diff(i + j));
    for tip in tips {
        if drawn(i, tip) && drawn(tip, j) {
            to.push([ring[i], ring[tip], ring[j]].map(|edge| edge as u8));
            if fill_between(ring, i, tip, to) && fill_between(ring, tip, j, to) {
                return true;
            }
            to.truncate(before);
        }
    }
    false
}

fn share_a_face(a: usize, b: usize) -> bool {
    let ends = |edge: usize| {
        let start = EDGE_START[edge];
        [start, start | 1 << (edge / 4)]
    };
    (0..3).any(|axis| {
        let sides = |edge: usize| ends(edge).map(|corner| corner >> axis & 1);
        let ([a0, a1], [b0, b1]) = (sides(a), sides(b));
        a0 == a1 && b0 == b1 && a0 == b0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The edges of a case whose ends differ.
    fn crossed(inside: u8) -> Vec<usize> {
        let is_inside = |corner: usize| inside >> corner & 1 == 1;
        (0..EDGES)
            .filter(|&edge| {
                let start = EDGE_START[edge];
                is_inside(start) != is_inside(start | 1 << (edge / 4))
            })
            .collect()
    }

    #[test]
    fn edges_are_what_their_names_say() {
        for edge in 0..EDGES {
            let start = EDGE_START[edge];
            assert_eq!(start >> (edge / 4) & 1, 0);
            assert_eq!(edge_between(start, start | 1 << (edge / 4)), edge);
        }
    }

    /// Each loop of n points is filled with n - 2 triangles, so that nothing was left open.
    #[test]
    fn every_loop_is_filled_and_no_diagonal_lies_in_a_face() {
        for inside in 0..=u8::MAX {
            let next = lines(inside);
            let crossed = crossed(inside);
            assert!(crossed.iter().all(|&edge| next[edge].is_some()));
            assert_eq!(next.iter().flatten().count(), crossed.len());
            let mut loops = 0;
            let mut seen = [false; EDGES];
            for &edge in &crossed {
                loops += usize::from(!seen[edge]);
                let mut at = edge;
                while !seen[at] {
                    seen[at] = true;
                    at = next[at].unwrap();
                }
            }
            let triangles = &cases()[usize::from(inside)];
            assert_eq!(triangles.len(), crossed.len() - 2 * loops, "{inside:08b}");
            for triangle in triangles {
                for place in 0..3 {
                    let [a, b] = [place, (place + 1) % 3].map(|at| usize::from(triangle[at]));
                    let line = next[a] == Some(b);
                    assert!(line || !share_a_face(a, b), "{inside:08b}");
                }
            }
        }
    }

    #[test]
    fn one_corner_gives_one_triangle_that_looks_away_from_it() {
        let [triangle] = cases()[1][..] else {
            panic!("one triangle");
        };
        // Edges from corner 0 along x, y and z, in this order.
        let place = triangle.iter().position(|&edge| edge == 0).unwrap();
        let turned: Vec<u8> = (0..3).map(|n| triangle[(place + n) % 3]).collect();
        assert_eq!(turned, [0, 4, 8]);
    }

    #[test]
    fn corners_across_a_diagonal_are_apart() {
        assert_eq!(cases()[0b1001].len(), 2, "across a face");
        assert_eq!(cases()[0b1000_0001].len(), 2, "across the cell");
        assert_eq!(cases()[0b0110_1001].len(), 4, "every other corner");
        assert!(cases()[0].is_empty() && cases()[255].is_empty());
    }
}
