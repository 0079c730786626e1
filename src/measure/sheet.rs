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

/// What one thread knows of the slices around a stack: the next one shares most of them.
#[derive(Debug, Default)]
pub(super) struct Slices {
    /// That of z at z modulo 4: a stack's taps are neighbours.
    planes: [Plane; 4],
    near: Row,
    far: Row,
}

/// The rows of one slice that are looked at.
#[derive(Debug, Default)]
struct Plane {
    z: Option<usize>,
    /// Depths below the threshold's, row after row.
    depths: Vec<f64>,
    /// What holds at each voxel.
    deep: Vec<u8>,
    has_tissue: bool,
    has_air: bool,
}

/// One row along x of the four slices around a stack.
#[derive(Debug, Default)]
struct Row {
    y: Option<usize>,
    /// What holds in all four slices, for each voxel along x.
    all: Vec<u8>,
}

/// Between these depths, in all four slices, every sheet is inside: the cubic that blends them has weights below 0 of
/// together at most an eighth, so that it is at least 9/8 of the least less 1/8 of the most.
const DEEP: std::ops::RangeInclusive<f64> = 1.0..=8.0;
/// The bit of [`Plane::deep`] for this, and for the same in air.
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
    /// Rows that are looked at: so many from the first.
    rows: usize,
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
        let deep: Vec<Cell> = cells(ny, f64::NEG_INFINITY, base).collect();
        let last = deep
            .iter()
            .flat_map(|cell| [cell.taps[1], cell.taps[2]])
            .max();
        Self {
            samples: volume.as_slice(),
            dims,
            rows: last.map_or(0, |last| last + 1),
            rescale: volume.rescale(),
            skin_depth: depth(skin_hu),
            across: cells(nx, f64::NEG_INFINITY, f64::INFINITY).collect(),
            deep,
            lines: lines.collect(),
            lines_per_voxel,
        }
    }

    /// The tissue in a stack.
    pub fn content(&self, stack: &Stack, slices: &mut Slices) -> Content {
        Simd::widest().run(ContentOf {
            sheets: self,
            stack,
            slices,
        })
    }

    /// The tissue between two rows, in pixels, of all sheets together: its length along lines parallel to y, on
    /// which depth goes evenly from row to row.
    #[inline(always)]
    fn strip(
        &self,
        deep: &Cell,
        sheets: &[[f64; 4]],
        planes: [&Plane; 4],
        near: &Row,
        far: &Row,
    ) -> f64 {
        let [nx, ..] = self.dims;
        let row_of = |plane: usize, row: &Row| {
            let begin = row.y.unwrap_or_default() * nx;
            planes[plane]
                .depths
                .get(begin..begin + nx)
                .unwrap_or_default()
        };
        let mut depths: [[&[f64]; 2]; 4] = [[&[]; 2]; 4];
        for (slice, depths) in depths.iter_mut().enumerate() {
            *depths = [row_of(slice, near), row_of(slice, far)];
        }
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
            for (taps, [near, far]) in taps.iter_mut().zip(depths) {
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

    /// Depths of a slice, or the first voxel that cannot be computed with.
    #[inline(always)]
    fn load(&self, z: usize, plane: &mut Plane) -> Result<(), ([usize; 3], f64)> {
        let [nx, ny, _] = self.dims;
        let begin = z * ny * nx;
        let samples = self
            .samples
            .get(begin..begin + self.rows * nx)
            .unwrap_or_default();
        plane.z = None;
        plane.depths.resize(samples.len(), 0.0);
        plane.deep.resize(samples.len(), 0);
        let (mut sound, mut tissue, mut air) = (true, false, false);
        let places = plane.depths.iter_mut().zip(&mut plane.deep);
        for ((to, all), &sample) in places.zip(samples) {
            let hu = self.rescale.to_hu(sample.to_f64());
            sound &= hu.abs() <= LARGEST_HU;
            let depth = depth(hu) - self.skin_depth;
            *to = depth;
            tissue |= depth >= 0.0;
            air |= depth < 0.0;
            let deep = (depth >= *DEEP.start()) & (depth <= *DEEP.end());
            let outside = (-depth >= *DEEP.start()) & (-depth <= *DEEP.end());
            *all = (u8::from(deep) * ALL_DEEP) | (u8::from(outside) * ALL_OUTSIDE);
        }
        if !sound {
            for y in 0..self.rows {
                let mut all = self.row_hu(y, z).enumerate();
                // Not a number is not at most anything.
                if let Some((x, hu)) = all.find(|(_, hu)| hu.is_nan() || hu.abs() > LARGEST_HU) {
                    return Err(([x, y, z], hu));
                }
            }
        }
        (plane.z, plane.has_tissue, plane.has_air) = (Some(z), tissue, air);
        Ok(())
    }

    /// What holds in all slices around a stack, in row `y`.
    #[inline(always)]
    fn look(&self, planes: [&Plane; 4], y: usize, row: &mut Row) {
        let [nx, ..] = self.dims;
        row.y = Some(y);
        row.all.clear();
        row.all.resize(nx, ALL_DEEP | ALL_OUTSIDE);
        for plane in planes {
            let deep = plane.deep.get(y * nx..(y + 1) * nx).unwrap_or_default();
            for (all, deep) in row.all.iter_mut().zip(deep) {
                *all &= deep;
            }
        }
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
    slices: &'a mut Slices,
}

impl<T: Sample> Kernel for ContentOf<'_, '_, T> {
    type Output = Content;

    #[inline(always)]
    fn run(self) -> Content {
        let Self {
            sheets: all,
            stack,
            slices,
        } = self;
        let mut content = Content::default();
        let sheets: Vec<[f64; 4]> = stack.cell.midpoints(stack.sheets).map(weights).collect();
        let Slices { planes, near, far } = slices;
        for z in stack.cell.taps {
            let plane = &mut planes[z % 4];
            if plane.z == Some(z) {
                continue;
            }
            if let Err(bad) = all.load(z, plane) {
                content.bad = Some(bad);
                return content;
            }
        }
        let [a, b, c, d] = stack.cell.taps;
        let around = [
            &planes[a % 4],
            &planes[b % 4],
            &planes[c % 4],
            &planes[d % 4],
        ];
        for plane in [around[1], around[2]] {
            content.has_tissue |= plane.has_tissue;
            content.has_air |= plane.has_air;
        }
        near.y = None;
        far.y = None;
        let mut area = 0.0;
        for deep in &all.deep {
            let [_, y_near, y_far, _] = deep.taps;
            // The far row of one strip is the near row of the next.
            if near.y != Some(y_near) {
                std::mem::swap(near, far);
            }
            for (row, y) in [(&mut *near, y_near), (&mut *far, y_far)] {
                if row.y != Some(y) {
                    all.look(around, y, row);
                }
            }
            area += all.strip(deep, &sheets, around, near, far);
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
