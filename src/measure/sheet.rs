//! The tissue in planes of constant z.

use super::cells::{Cell, cells, weights};
use super::profile::depth;
use crate::simd::{Kernel, Simd};
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
}

/// One row along x of the four slices around a stack.
#[derive(Debug, Default)]
struct Row {
    y: Option<usize>,
    /// Depths below the threshold's, slice after slice.
    depths: [Vec<f64>; 4],
    /// What holds in all four slices, for each voxel along x.
    all: Vec<u8>,
}

/// Between these depths, in all four slices, every sheet is inside: the cubic that blends them has weights below 0 of
/// together at most an eighth, so that it is at least 9/8 of the least less 1/8 of the most.
const DEEP: std::ops::RangeInclusive<f64> = 1.0..=8.0;
/// The bit of [`Row::all`] for this, and for the same in air.
const ALL_DEEP: u8 = 1;
const ALL_OUTSIDE: u8 = 2;

/// Lines that are computed at once.
const LINES: usize = 8;

/// Weights of the four taps for up to [`LINES`] lines, tap by tap.
#[derive(Debug, Clone, Copy)]
struct Lines {
    weights: [[f64; LINES]; 4],
    count: usize,
}

/// Measures stacks of sheets in one volume.
pub(super) struct Sheets<'a, T> {
    samples: &'a [T],
    dims: [usize; 3],
    rescale: Rescale,
    skin_depth: f64,
    across: Vec<Cell>,
    deep: Vec<Cell>,
    /// Where lines are laid through a whole pixel along x.
    lines: Vec<Lines>,
    lines_per_voxel: usize,
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
        let lines: Vec<[f64; 4]> = whole.midpoints(lines_per_voxel).map(weights).collect();
        let lines = lines.chunks(LINES).map(|some| {
            let mut weights = [[0.0; LINES]; 4];
            for (lane, line) in some.iter().enumerate() {
                for (tap, weight) in line.iter().enumerate() {
                    weights[tap][lane] = *weight;
                }
            }
            Lines {
                weights,
                count: some.len(),
            }
        });
        Self {
            samples: volume.as_slice(),
            dims,
            rescale: volume.rescale(),
            skin_depth: depth(skin_hu),
            across: cells(nx, f64::NEG_INFINITY, f64::INFINITY).collect(),
            deep: cells(ny, f64::NEG_INFINITY, base).collect(),
            lines: lines.collect(),
            lines_per_voxel,
        }
    }

    /// The tissue in a stack.
    pub fn content(&self, stack: &Stack, rows: &mut Rows) -> Content {
        Simd::widest().run(ContentOf {
            sheets: self,
            stack,
            rows,
        })
    }

    /// The tissue between two rows, in pixels, of all sheets together: its length along lines parallel to y, on
    /// which depth goes evenly from row to row.
    #[inline(always)]
    fn strip(&self, deep: &Cell, sheets: &[[f64; 4]], near: &Row, far: &Row) -> f64 {
        let mut tissue = 0.0;
        for across in &self.across {
            let [_, first, second, _] = across.taps;
            let all = |x: usize| {
                let of = |row: &Row| row.all.get(x).copied().unwrap_or_default();
                of(near) & of(far)
            };
            let all = all(first) & all(second);
            if all & ALL_OUTSIDE != 0 {
                continue;
            }
            let whole = across.length() * deep.length();
            if all & ALL_DEEP != 0 {
                tissue += whole * sheets.len() as f64;
                continue;
            }
            // Four taps of the near row, then four of the far one, of each slice.
            let mut taps = [[0.0; 8]; 4];
            for (slice, taps) in taps.iter_mut().enumerate() {
                let (near, far) = (&near.depths[slice], &far.depths[slice]);
                for (place, &x) in across.taps.iter().enumerate() {
                    taps[place] = near.get(x).copied().unwrap_or_default();
                    taps[place + 4] = far.get(x).copied().unwrap_or_default();
                }
            }
            let [a, b, c, d] = &taps;
            for sheet in sheets {
                let mut on_sheet = [0.0; 8];
                for (lane, value) in on_sheet.iter_mut().enumerate() {
                    *value = blend(sheet, [a[lane], b[lane], c[lane], d[lane]]);
                }
                let [_, one, two, _, _, three, four, _] = on_sheet;
                let inside = |depth: f64| u8::from(depth >= 0.0);
                let inside = inside(one) + inside(two) + inside(three) + inside(four);
                if inside == 4 {
                    tissue += whole;
                } else if inside > 0 {
                    let length: f64 = self
                        .lines
                        .iter()
                        .map(|lines| length_inside(deep, lines, &on_sheet))
                        .sum();
                    tissue += length * across.length() / self.lines_per_voxel as f64;
                }
            }
        }
        tissue
    }

    /// Depths of row `y` of the slices around a stack.
    #[inline(always)]
    fn load(&self, stack: &Stack, y: usize, row: &mut Row) -> Result<(), ([usize; 3], f64)> {
        let [nx, ny, _] = self.dims;
        row.y = Some(y);
        row.all.clear();
        row.all.resize(nx, ALL_DEEP | ALL_OUTSIDE);
        for (depths, z) in row.depths.iter_mut().zip(stack.cell.taps) {
            let start = (z * ny + y) * nx;
            let samples = self.samples.get(start..start + nx).unwrap_or_default();
            depths.clear();
            depths.resize(nx, 0.0);
            let mut sound = true;
            for ((to, all), &sample) in depths.iter_mut().zip(&mut row.all).zip(samples) {
                let hu = self.rescale.to_hu(sample.to_f64());
                sound &= hu.abs() <= LARGEST_HU;
                let depth = depth(hu) - self.skin_depth;
                *to = depth;
                let deep = (depth >= *DEEP.start()) & (depth <= *DEEP.end());
                let outside = (-depth >= *DEEP.start()) & (-depth <= *DEEP.end());
                *all &= (u8::from(deep) * ALL_DEEP) | (u8::from(outside) * ALL_OUTSIDE);
            }
            if !sound {
                let mut all = self.row_hu(y, z).enumerate();
                // Not a number is not at most anything.
                if let Some((x, hu)) = all.find(|(_, hu)| hu.is_nan() || hu.abs() > LARGEST_HU) {
                    return Err(([x, y, z], hu));
                }
            }
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

/// [`Sheets::content`] of one stack.
struct ContentOf<'a, 'v, T> {
    sheets: &'a Sheets<'v, T>,
    stack: &'a Stack,
    rows: &'a mut Rows,
}

impl<T: Sample> Kernel for ContentOf<'_, '_, T> {
    type Output = Content;

    #[inline(always)]
    fn run(self) -> Content {
        let Self {
            sheets: all,
            stack,
            rows,
        } = self;
        let mut content = Content::default();
        let sheets: Vec<[f64; 4]> = stack.cell.midpoints(stack.sheets).map(weights).collect();
        rows.near.y = None;
        rows.far.y = None;
        let mut area = 0.0;
        for deep in &all.deep {
            let [_, near, far, _] = deep.taps;
            // The far row of one strip is the near row of the next.
            if rows.near.y != Some(near) {
                std::mem::swap(&mut rows.near, &mut rows.far);
            }
            for (row, y) in [(&mut rows.near, near), (&mut rows.far, far)] {
                if row.y == Some(y) {
                    continue;
                }
                if let Err(bad) = all.load(stack, y, row) {
                    content.bad = Some(bad);
                    return content;
                }
                for slice in [1, 2] {
                    let (mut tissue, mut air) = (false, false);
                    for depth in &row.depths[slice] {
                        tissue |= *depth >= 0.0;
                        air |= *depth < 0.0;
                    }
                    content.has_tissue |= tissue;
                    content.has_air |= air;
                }
            }
            area += all.strip(deep, &sheets, &rows.near, &rows.far);
        }
        content.tissue = area * stack.cell.length() / stack.sheets as f64;
        content
    }
}

/// A weighted sum of four taps.
#[inline(always)]
fn blend(weights: &[f64; 4], taps: [f64; 4]) -> f64 {
    weights[0] * taps[0] + weights[1] * taps[1] + (weights[2] * taps[2] + weights[3] * taps[3])
}

/// How much of `cell` has a depth of at least 0, along all of the lines together, where it goes evenly from the near
/// row's, at 0, to the far row's, at 1. Taps are the four of the near row and the four of the far one.
#[inline(always)]
fn length_inside(cell: &Cell, lines: &Lines, taps: &[f64; 8]) -> f64 {
    let mut shares = [0.0; LINES];
    for lane in 0..LINES {
        let [a, b, c, d] = &lines.weights;
        let line = [a[lane], b[lane], c[lane], d[lane]];
        let start = blend(&line, [taps[0], taps[1], taps[2], taps[3]]);
        let end = blend(&line, [taps[4], taps[5], taps[6], taps[7]]);
        let from = start + (end - start) * cell.from;
        let to = start + (end - start) * cell.to;
        let (low, high) = if from < to { (from, to) } else { (to, from) };
        let cut = high / (high - low);
        let cut = if high >= 0.0 { cut } else { 0.0 };
        shares[lane] = if low >= 0.0 { 1.0 } else { cut };
    }
    let shares: f64 = shares.iter().take(lines.count).sum();
    shares * cell.length()
}
