//! The tissue in planes of constant z.

use super::cells::{Cell, cells, weights};
use super::profile::depth;
use crate::volume::{Rescale, Sample, Volume};

/// The largest HU that is computed with: sums of a few such values are finite.
const LARGEST_HU: f64 = 1e300;

/// Sheets between two slices, which stand for layers of equal thickness of one region.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stack {
    /// The region, 0 for A.
    pub region: usize,
    /// The slices around the layers, and the part of the interval that these fill.
    pub cell: Cell,
    /// How many sheets.
    pub sheets: usize,
}

/// What the sheets of a stack show.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Content {
    /// Volume of tissue in front of the base plane, in voxels.
    pub tissue: f64,
    /// Whether a voxel in or beside it is tissue, and whether one is air. Voxels, not what is blended from
    /// them: next to a steep edge a cubic goes beyond its taps.
    pub has_tissue: bool,
    /// See `has_tissue`.
    pub has_air: bool,
    /// The first voxel met that cannot be computed with, as (x, y, z), and its HU.
    pub bad: Option<([usize; 3], f64)>,
}

/// Room for the rows around a strip, kept between the stacks that one thread measures.
#[derive(Debug, Default)]
pub(super) struct Rows {
    near: Row,
    far: Row,
    slices: [Vec<f64>; 4],
}

/// Depths below the threshold's along x, in one row of every sheet of a stack, sheet after sheet.
#[derive(Debug, Default)]
struct Row {
    y: Option<usize>,
    depths: Vec<f64>,
}

/// Measures stacks of sheets in one volume.
pub(super) struct Sheets<'a, T> {
    samples: &'a [T],
    dims: [usize; 3],
    rescale: Rescale,
    skin_depth: f64,
    across: Vec<Cell>,
    deep: Vec<Cell>,
    /// Where lines are laid through a whole pixel along x, as weights of the cell's taps.
    lines: Vec<[f64; 4]>,
}

impl<'a, T: Sample> Sheets<'a, T> {
    /// Of the part of `volume` in front of the plane at `base` (voxels along y); tissue has at least
    /// `skin_hu`. Where a surface comes through a pixel, `lines_per_voxel` lines are laid through it.
    pub fn new(volume: &'a Volume<T>, base: f64, skin_hu: f64, lines_per_voxel: usize) -> Self {
        let dims = volume.grid().dims();
        let [nx, ny, _] = dims;
        let whole = Cell {
            taps: [0; 4],
            from: 0.0,
            to: 1.0,
        };
        Self {
            samples: volume.as_slice(),
            dims,
            rescale: volume.rescale(),
            skin_depth: depth(skin_hu),
            across: cells(nx, f64::NEG_INFINITY, f64::INFINITY).collect(),
            deep: cells(ny, f64::NEG_INFINITY, base).collect(),
            lines: whole.midpoints(lines_per_voxel).map(weights).collect(),
        }
    }

    /// The tissue in a stack.
    pub fn content(&self, stack: &Stack, rows: &mut Rows) -> Content {
        let mut content = Content::default();
        let sheets: Vec<[f64; 4]> = stack.cell.midpoints(stack.sheets).map(weights).collect();
        rows.near.y = None;
        rows.far.y = None;
        let mut area = 0.0;
        for deep in &self.deep {
            let [_, near, far, _] = deep.taps;
            // The far row of one strip is the near row of the next.
            if rows.near.y != Some(near) {
                std::mem::swap(&mut rows.near, &mut rows.far);
            }
            for (row, y) in [(&mut rows.near, near), (&mut rows.far, far)] {
                if row.y == Some(y) {
                    continue;
                }
                if let Err(bad) = self.load(stack, &sheets, y, row, &mut rows.slices) {
                    content.bad = Some(bad);
                    return content;
                }
                for depth in rows.slices[1].iter().chain(&rows.slices[2]) {
                    content.has_tissue |= *depth >= 0.0;
                    content.has_air |= *depth < 0.0;
                }
            }
            let [nx, ..] = self.dims;
            let near = rows.near.depths.chunks_exact(nx);
            for (near, far) in near.zip(rows.far.depths.chunks_exact(nx)) {
                area += self.strip(deep, near, far);
            }
        }
        content.tissue = area * stack.cell.length() / stack.sheets as f64;
        content
    }

    /// The tissue between two rows of a sheet, in pixels: its length along lines parallel to y, on which
    /// depth goes evenly from row to row.
    fn strip(&self, deep: &Cell, near: &[f64], far: &[f64]) -> f64 {
        let mut tissue = 0.0;
        for across in &self.across {
            let at = |row: &[f64], x: usize| row.get(x).copied().unwrap_or_default();
            let near = across.taps.map(|x| at(near, x));
            let far = across.taps.map(|x| at(far, x));
            let inside = [near[1], near[2], far[1], far[2]].map(|depth| depth >= 0.0);
            if inside == [true; 4] {
                tissue += across.length() * deep.length();
                continue;
            }
            if inside == [false; 4] {
                continue;
            }
            let length: f64 = self
                .lines
                .iter()
                .map(|line| length_inside(deep, blend(line, near), blend(line, far)))
                .sum();
            tissue += length * across.length() / self.lines.len() as f64;
        }
        tissue
    }

    /// Blends row `y` of the slices around a stack into one row for each of its sheets.
    fn load(
        &self,
        stack: &Stack,
        sheets: &[[f64; 4]],
        y: usize,
        row: &mut Row,
        slices: &mut [Vec<f64>; 4],
    ) -> Result<(), ([usize; 3], f64)> {
        for (slice, z) in slices.iter_mut().zip(stack.cell.taps) {
            slice.clear();
            for (x, hu) in self.row_hu(y, z).enumerate() {
                if hu.is_nan() || hu.abs() > LARGEST_HU {
                    return Err(([x, y, z], hu));
                }
                slice.push(depth(hu) - self.skin_depth);
            }
        }
        row.y = Some(y);
        row.depths.clear();
        let [a, b, c, d] = slices;
        for sheet in sheets {
            let taps = a.iter().zip(b.iter()).zip(c.iter()).zip(d.iter());
            row.depths
                .extend(taps.map(|(((&a, &b), &c), &d)| blend(sheet, [a, b, c, d])));
        }
        Ok(())
    }

    /// HU of a row of a slice.
    fn row_hu(&self, y: usize, z: usize) -> impl Iterator<Item = f64> {
        let [nx, ny, _] = self.dims;
        let start = (z * ny + y) * nx;
        let row = self.samples.get(start..start + nx).unwrap_or_default();
        row.iter()
            .map(|&sample| self.rescale.to_hu(sample.to_f64()))
    }

    /// Smallest and largest HU of the voxels around `stacks`.
    pub fn hu_range(&self, stacks: &[Stack]) -> (f64, f64) {
        let mut range = (f64::INFINITY, f64::NEG_INFINITY);
        let around = |cell: &Cell| [cell.taps[1], cell.taps[2]];
        let slices = || stacks.iter().flat_map(|stack| around(&stack.cell));
        let rows = self.deep.iter().flat_map(around).max();
        if let (Some(first), Some(last), Some(rows)) = (slices().min(), slices().max(), rows) {
            for (z, y) in (first..=last).flat_map(|z| (0..=rows).map(move |y| (z, y))) {
                for hu in self.row_hu(y, z) {
                    range = (range.0.min(hu), range.1.max(hu));
                }
            }
        }
        range
    }
}

/// A weighted sum of four taps.
#[inline]
fn blend(weights: &[f64; 4], taps: [f64; 4]) -> f64 {
    weights[0] * taps[0] + weights[1] * taps[1] + (weights[2] * taps[2] + weights[3] * taps[3])
}

/// How much of `cell` has a depth of at least 0, where it goes evenly from `start` at 0 to `end` at 1.
#[inline]
fn length_inside(cell: &Cell, start: f64, end: f64) -> f64 {
    let from = start + (end - start) * cell.from;
    let to = start + (end - start) * cell.to;
    let length = cell.length();
    match (from >= 0.0, to >= 0.0) {
        (true, true) => length,
        (false, false) => 0.0,
        (true, false) => length * (from / (from - to)),
        (false, true) => length * (to / (to - from)),
    }
}
