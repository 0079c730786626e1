//! The tissue in one plane of constant z.

use super::cells::{Cell, cells};
use crate::volume::{Rescale, Sample, Volume};

/// The largest HU that is computed with: differences of such values are finite.
const LARGEST_HU: f64 = 1e300;

/// A plane of constant z, between two slices, that stands for a thin layer of one region.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sheet {
    /// The region, 0 for A.
    pub region: usize,
    /// The slice at or below it.
    pub low: usize,
    /// The slice at or above it.
    pub high: usize,
    /// Where it is between the two, 0 to 1.
    pub at: f64,
    /// Thickness of the layer, voxels.
    pub thickness: f64,
}

/// What a sheet shows.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Section {
    /// Area of tissue in front of the base plane, in pixels.
    pub tissue: f64,
    /// Whether any of it is air.
    pub air: bool,
    /// The first voxel met that cannot be computed with, as (x, y, z), and its HU.
    pub bad: Option<([usize; 3], f64)>,
}

/// The last two rows blended, kept between the sheets that one thread measures.
#[derive(Debug, Default)]
pub(super) struct Rows {
    near: Row,
    far: Row,
}

/// HU above the threshold along x, of one row of a sheet.
#[derive(Debug, Default)]
struct Row {
    y: Option<usize>,
    values: Vec<f64>,
}

/// Measures sheets of one volume.
pub(super) struct Sheets<'a, T> {
    samples: &'a [T],
    dims: [usize; 3],
    rescale: Rescale,
    skin_hu: f64,
    across: Vec<Cell>,
    deep: Vec<Cell>,
    lines_per_voxel: usize,
}

impl<'a, T: Sample> Sheets<'a, T> {
    /// Of the part of `volume` in front of the plane at `base` (voxels along y); tissue has at least
    /// `skin_hu`. Where a surface comes through a pixel, `lines_per_voxel` lines are laid through it.
    pub fn new(volume: &'a Volume<T>, base: f64, skin_hu: f64, lines_per_voxel: usize) -> Self {
        let dims = volume.grid().dims();
        let [nx, ny, _] = dims;
        Self {
            samples: volume.as_slice(),
            dims,
            rescale: volume.rescale(),
            skin_hu,
            across: cells(nx, f64::NEG_INFINITY, f64::INFINITY).collect(),
            deep: cells(ny, f64::NEG_INFINITY, base).collect(),
            lines_per_voxel,
        }
    }

    /// The tissue in a sheet: bilinear values of at least 0, summed along lines parallel to y.
    pub fn section(&self, sheet: &Sheet, rows: &mut Rows) -> Section {
        let mut section = Section::default();
        rows.near.y = None;
        rows.far.y = None;
        for deep in &self.deep {
            // The far row of one cell is the near row of the next.
            if rows.near.y != Some(deep.low) {
                std::mem::swap(&mut rows.near, &mut rows.far);
            }
            for (row, y) in [(&mut rows.near, deep.low), (&mut rows.far, deep.high)] {
                if row.y != Some(y)
                    && let Err(bad) = self.blend(sheet, y, row)
                {
                    section.bad = Some(bad);
                    return section;
                }
            }
            section.tissue += self.strip(deep, &rows.near, &rows.far, &mut section.air);
        }
        section
    }

    /// The tissue between two rows.
    fn strip(&self, deep: &Cell, near: &Row, far: &Row, air: &mut bool) -> f64 {
        let mut tissue = 0.0;
        for across in &self.across {
            let end = |row: &Row, x: usize| row.values.get(x).copied().unwrap_or_default();
            let (a, b) = (end(near, across.low), end(near, across.high));
            let (c, d) = (end(far, across.low), end(far, across.high));
            let inside = [a, b, c, d].map(|value| value >= 0.0);
            if inside == [true; 4] {
                tissue += across.length() * deep.length();
                continue;
            }
            *air = true;
            if inside == [false; 4] {
                continue;
            }
            let length: f64 = across
                .midpoints(self.lines_per_voxel)
                .map(|x| length_inside(deep, a + (b - a) * x, c + (d - c) * x))
                .sum();
            tissue += length * across.length() / self.lines_per_voxel as f64;
        }
        tissue
    }

    /// Blends row `y` of the two slices around `sheet` into `row`.
    fn blend(&self, sheet: &Sheet, y: usize, row: &mut Row) -> Result<(), ([usize; 3], f64)> {
        row.values.clear();
        let (low, high) = (self.row(y, sheet.low), self.row(y, sheet.high));
        let mut sound = true;
        row.values.extend(low.iter().zip(high).map(|(&a, &b)| {
            let (a, b) = (self.above(a), self.above(b));
            sound &= a.abs() <= LARGEST_HU && b.abs() <= LARGEST_HU;
            a + (b - a) * sheet.at
        }));
        row.y = Some(y);
        if sound {
            return Ok(());
        }
        for z in [sheet.low, sheet.high] {
            for (x, &sample) in self.row(y, z).iter().enumerate() {
                let hu = self.rescale.to_hu(sample.to_f64());
                if !(hu.abs() <= LARGEST_HU) {
                    return Err(([x, y, z], hu));
                }
            }
        }
        Ok(())
    }

    /// HU above the threshold.
    #[inline]
    fn above(&self, sample: T) -> f64 {
        self.rescale.to_hu(sample.to_f64()) - self.skin_hu
    }

    /// A row of a slice.
    fn row(&self, y: usize, z: usize) -> &'a [T] {
        let [nx, ny, _] = self.dims;
        let start = (z * ny + y) * nx;
        self.samples.get(start..start + nx).unwrap_or_default()
    }

    /// Smallest and largest HU of the voxels that `sheets` draw on.
    pub fn hu_range(&self, sheets: &[Sheet]) -> (f64, f64) {
        let slices = sheets.iter().map(|sheet| sheet.low).min();
        let slices = slices.zip(sheets.iter().map(|sheet| sheet.high).max());
        let rows = self.deep.iter().map(|cell| cell.high).max();
        let mut range = (f64::INFINITY, f64::NEG_INFINITY);
        if let (Some((first, last)), Some(rows)) = (slices, rows) {
            for (z, y) in (first..=last).flat_map(|z| (0..=rows).map(move |y| (z, y))) {
                for &sample in self.row(y, z) {
                    let hu = self.rescale.to_hu(sample.to_f64());
                    range = (range.0.min(hu), range.1.max(hu));
                }
            }
        }
        range
    }
}

/// How much of `cell` has a value of at least 0, where the value goes evenly from `start` at 0 to `end` at
/// 1.
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
