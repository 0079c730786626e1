//! Source positions for a small block of voxels, and the blocks that cover a box.

use std::ops::Range;

use glam::DVec3;
use ndarray::{ArrayViewMut3, Axis};

use super::chain::VoxelBox;
use super::{LANES, Points};
use crate::simd::{Real, Vector};

/// Side of a tile, in voxels: a row is [`LANES`] positions.
pub const TILE: usize = LANES;

/// Source positions of the voxels of one tile, in voxels of its lattice.
#[derive(Debug)]
pub struct Tile {
    voxels: VoxelBox,
    /// The corners of a tile that is a single cell, a voxel beyond its last. Its positions are interpolated when they are
    /// asked for: writing them and reading them again takes longer.
    cell: Option<[DVec3; 8]>,
    pub(super) x: Vec<f64>,
    pub(super) y: Vec<f64>,
    pub(super) z: Vec<f64>,
}

impl Tile {
    /// Room for one tile, to be used again and again.
    pub fn new() -> Self {
        let room = || vec![0.0; TILE * TILE * TILE];
        Self {
            voxels: VoxelBox::EMPTY,
            cell: None,
            x: room(),
            y: room(),
            z: room(),
        }
    }

    /// The voxels that it stands for: at most [`TILE`] along each axis.
    pub fn voxels(&self) -> VoxelBox {
        self.voxels
    }

    pub(super) fn begin(&mut self, voxels: VoxelBox) {
        debug_assert!(voxels.dims().iter().all(|&n| n <= TILE));
        self.voxels = voxels;
        self.cell = None;
    }

    /// Makes all of the tile a cell with these corners, x fastest.
    pub(super) fn set_cell(&mut self, corners: [DVec3; 8]) {
        self.cell = Some(corners);
    }

    /// The corners of a tile that is a single cell: all of its positions are among them.
    pub(super) fn corners(&self) -> Option<&[DVec3; 8]> {
        self.cell.as_ref()
    }

    /// Place in the arrays of the row at (y, z) from the tile's start.
    #[inline]
    pub(super) fn row(y: usize, z: usize) -> Range<usize> {
        let start = (z * TILE + y) * TILE;
        start..start + TILE
    }

    /// The source positions of the plane at z from the tile's start.
    #[inline(always)]
    pub(super) fn plane<F: Real>(&self, z: usize) -> TilePlane<'_, F> {
        match &self.cell {
            Some(corners) => TilePlane::Cell(CellPlane::new(corners, TILE, z)),
            None => TilePlane::Stored { tile: self, z },
        }
    }

    /// Puts positions of neighbouring voxels of a row into their places.
    #[inline(always)]
    pub(super) fn put<F: Real>(&mut self, places: Range<usize>, x: &[F], y: &[F], z: &[F]) {
        let put = |to: &mut [f64], from: &[F]| {
            for (to, from) in to.iter_mut().zip(from) {
                *to = from.to_f64();
            }
        };
        put(&mut self.x[places.clone()], x);
        put(&mut self.y[places.clone()], y);
        put(&mut self.z[places], z);
    }

    /// The source position of the voxel at an offset from the tile's start.
    #[inline]
    pub fn get(&self, [x, y, z]: [usize; 3]) -> DVec3 {
        if let Some(corners) = &self.cell {
            let row = CellPlane::<f64>::new(corners, TILE, z).row(y);
            let at = |first: f64, along: f64| first + along * x as f64;
            return DVec3::new(
                at(row.first.x, row.along.x),
                at(row.first.y, row.along.y),
                at(row.first.z, row.along.z),
            );
        }
        let place = (z * TILE + y) * TILE + x;
        DVec3::new(self.x[place], self.y[place], self.z[place])
    }

    #[inline]
    pub(super) fn set(&mut self, [x, y, z]: [usize; 3], at: DVec3) {
        debug_assert!(self.cell.is_none());
        let place = (z * TILE + y) * TILE + x;
        self.x[place] = at.x;
        self.y[place] = at.y;
        self.z[place] = at.z;
    }

    /// The offsets of all voxels, x fastest.
    pub fn offsets(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.voxels.dims();
        (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
    }

    /// The lattice index of an offset.
    pub fn index(&self, offset: [usize; 3]) -> DVec3 {
        let start = self.voxels.start;
        DVec3::from_array([0, 1, 2].map(|axis| (start[axis] + offset[axis]) as f64))
    }
}

/// Interpolates between the corners of a cell, x fastest, at a share of its sides.
#[inline(always)]
pub(super) fn trilinear(corners: &[DVec3; 8], [x, y, z]: [f64; 3]) -> DVec3 {
    let along_x = |pair: usize| corners[pair] + (corners[pair + 1] - corners[pair]) * x;
    let front = along_x(0) + (along_x(2) - along_x(0)) * y;
    let back = along_x(4) + (along_x(6) - along_x(4)) * y;
    front + (back - front) * z
}

/// The source positions of one plane of a tile.
#[derive(Debug)]
pub(super) enum TilePlane<'a, F> {
    /// Interpolated.
    Cell(CellPlane<F>),
    /// One by one.
    Stored { tile: &'a Tile, z: usize },
}

impl<F: Real> TilePlane<'_, F> {
    /// The positions of the row at y from the tile's start, by axis. Those past the tile's end mean nothing.
    #[inline(always)]
    pub(super) fn row(&self, y: usize) -> Option<Points<F>> {
        let mut points = Points::zero();
        match self {
            Self::Cell(plane) => {
                let CellRow { first, along } = plane.row(y);
                for lane in 0..LANES {
                    let place = F::of(lane as f64);
                    points.x[lane] = first.x + along.x * place;
                    points.y[lane] = first.y + along.y * place;
                    points.z[lane] = first.z + along.z * place;
                }
            }
            Self::Stored { tile, z } => {
                let row = Tile::row(y, *z);
                let x = one_row(&tile.x, &row)?;
                let y = one_row(&tile.y, &row)?;
                let z = one_row(&tile.z, &row)?;
                for lane in 0..LANES {
                    points.x[lane] = F::of(x[lane]);
                    points.y[lane] = F::of(y[lane]);
                    points.z[lane] = F::of(z[lane]);
                }
            }
        }
        Some(points)
    }
}

/// A plane of a cell, interpolated between its corners: its first row, and what each next one adds.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellPlane<F> {
    row: CellRow<F>,
    next: CellRow<F>,
}

/// A row of a cell: the position of its first voxel, and what each next one adds.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellRow<F> {
    pub(super) first: Vector<F>,
    pub(super) along: Vector<F>,
}

impl<F: Real> CellPlane<F> {
    /// The plane at z from the start of a cell with these corners, x fastest.
    #[inline(always)]
    pub(super) fn new(corners: &[DVec3; 8], side: usize, z: usize) -> Self {
        let step = 1.0 / side as f64;
        let w = z as f64 * step;
        let edge = |place: usize| corners[place] + (corners[place + 4] - corners[place]) * w;
        let [near, near_end, far, far_end] = [edge(0), edge(1), edge(2), edge(3)];
        let along = (near_end - near) * step;
        Self {
            row: CellRow {
                first: Vector::of(near),
                along: Vector::of(along),
            },
            next: CellRow {
                first: Vector::of((far - near) * step),
                along: Vector::of(((far_end - far) * step - along) * step),
            },
        }
    }

    /// The row at y.
    #[inline(always)]
    pub(super) fn row(&self, y: usize) -> CellRow<F> {
        let y = F::of(y as f64);
        CellRow {
            first: self.row.first.plus(self.next.first, y),
            along: self.row.along.plus(self.next.along, y),
        }
    }
}

fn one_row<'a>(axis: &'a [f64], row: &Range<usize>) -> Option<&'a [f64; LANES]> {
    axis.get(row.clone())?.try_into().ok()
}

impl Default for Tile {
    fn default() -> Self {
        Self::new()
    }
}

/// The tiles that cover a box. They are anchored at voxel 0, so what a voxel gets does not depend on the
/// box.
pub fn tiles_of(voxels: VoxelBox) -> Vec<VoxelBox> {
    if voxels.is_empty() {
        return Vec::new();
    }
    let spans = [0, 1, 2].map(|axis| spans(voxels.start[axis], voxels.end[axis]));
    let [xs, ys, zs] = &spans;
    let mut tiles = Vec::with_capacity(xs.len() * ys.len() * zs.len());
    for z in zs {
        for y in ys {
            for x in xs {
                tiles.push(VoxelBox {
                    start: [x.0, y.0, z.0],
                    end: [x.1, y.1, z.1],
                });
            }
        }
    }
    tiles
}

/// Tile-aligned pieces of start..end. A first piece that begins inside a tile is widened to the whole tile.
fn spans(start: usize, end: usize) -> Vec<(usize, usize)> {
    let first = start / TILE * TILE;
    (first..end)
        .step_by(TILE)
        .map(|at| (at, (at + TILE).min(end)))
        .collect()
}

/// An array cut into disjoint views, one for each tile of a box, in the order of [`tiles_of`].
///
/// The array is indexed `[z, y, x]` and covers the lattice.
pub fn split_into_tiles<T>(
    array: ArrayViewMut3<'_, T>,
    voxels: VoxelBox,
) -> Vec<(VoxelBox, ArrayViewMut3<'_, T>)> {
    if voxels.is_empty() {
        return Vec::new();
    }
    let mut parts = Vec::new();
    for (z, slab) in cut(array, Axis(0), voxels.start[2], voxels.end[2]) {
        for (y, strip) in cut(slab, Axis(1), voxels.start[1], voxels.end[1]) {
            for (x, view) in cut(strip, Axis(2), voxels.start[0], voxels.end[0]) {
                let tile = VoxelBox {
                    start: [x.0, y.0, z.0],
                    end: [x.1, y.1, z.1],
                };
                parts.push((tile, view));
            }
        }
    }
    parts
}

fn cut<T>(
    array: ArrayViewMut3<'_, T>,
    axis: Axis,
    start: usize,
    end: usize,
) -> Vec<((usize, usize), ArrayViewMut3<'_, T>)> {
    let spans = spans(start, end);
    let mut parts = Vec::with_capacity(spans.len());
    let (_, mut rest) = array.split_at(axis, start / TILE * TILE);
    for span in spans {
        let (part, after) = rest.split_at(axis, span.1 - span.0);
        parts.push((span, part));
        rest = after;
    }
    parts
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    #[test]
    fn tiles_cover_the_box_once_and_are_anchored_at_zero() {
        let voxels = VoxelBox {
            start: [3, 17, 40],
            end: [40, 33, 41],
        };
        let mut hits = Array3::<u8>::zeros((50, 50, 50));
        let tiles = tiles_of(voxels);
        let parts = split_into_tiles(hits.view_mut(), voxels);
        assert_eq!(tiles.len(), parts.len());
        for (tile, (expected, mut view)) in tiles.into_iter().zip(parts) {
            assert_eq!(tile, expected);
            assert!(tile.start.iter().all(|start| start % TILE == 0));
            let [nx, ny, nz] = tile.dims();
            assert_eq!(view.shape(), [nz, ny, nx]);
            view += 1;
        }
        assert!(hits.iter().all(|&n| n <= 1));
        let inside = hits.slice(ndarray::s![40..41, 17..33, 3..40]);
        assert!(inside.iter().all(|&n| n == 1));
    }
}
