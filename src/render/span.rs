//! The two passes over the discs of a band: which disc is foremost in each pixel, and the normals of all at that depth.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over vector lanes index several arrays alike"
)]

use std::ops::Range;

use super::splat::{Clips, QUAD, Splat, Splats};
use crate::simd::Kernel;

/// Pixels that are drawn at once: a disc is mostly no wider.
pub(super) const WIDE: usize = 8;
/// No voxel is at this pixel.
pub(super) const NOTHING: u32 = u32::MAX;
/// Weight of a disc some way behind the foremost one. At the rim of something the foremost disc may be there
/// with its own rim only; one pixel of its colour would be a speck.
const FAINT: f32 = 1.0 / 16.0;

/// A band with a row more on either side, so that the edges at its rim are seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    /// First row; may be the one above the picture.
    pub first: isize,
    pub rows: usize,
    pub quads: usize,
}

impl Span {
    /// Pixels of a row; a few more than the picture has where that is no whole number of quads.
    #[inline(always)]
    pub(super) fn width(self) -> usize {
        self.quads * QUAD
    }

    /// From a row to the next in a buffer of the span: there is room for [`WIDE`] pixels before and after it.
    #[inline(always)]
    pub(super) fn stride(self) -> usize {
        self.width() + 2 * WIDE
    }

    /// Pixel 0 of a row in a buffer of the span.
    #[inline(always)]
    pub(super) fn begin(self, row: usize) -> usize {
        row * self.stride() + WIDE
    }

    fn len(self) -> usize {
        self.rows * self.stride()
    }

    /// The rows that a splat covers, counted from the span's first.
    #[inline(always)]
    pub(super) fn rows_of(self, splat: &Splat) -> Range<usize> {
        let (begin, end) = splat.rows();
        let row = |row: isize| (row - self.first).clamp(0, self.rows as isize) as usize;
        row(begin)..row(end)
    }

    /// The columns that a splat covers on any of its rows. To find them for each row takes longer than to look at the
    /// pixels beside the ellipse.
    #[inline(always)]
    fn columns_of(self, splat: &Splat) -> Range<usize> {
        let (left, right) = (splat.x - splat.half_width, splat.x + splat.half_width);
        // Float to integer conversion clamps: what is left of the picture is pixel 0, NaN as well.
        if right > left {
            left as u32 as usize..(right as u32 as usize + 1).min(self.width())
        } else {
            0..0
        }
    }
}

/// What is drawn into a span, for each of its pixels. Made once by a worker and used for all of its bands.
#[derive(Debug, Default)]
pub(super) struct Drawn {
    /// Of the foremost disc, mm; -∞ where nothing is.
    pub depth: Vec<f32>,
    /// Of the foremost disc, or [`NOTHING`].
    pub place: Vec<u32>,
    /// For each row, one after the other: x, y and z of the sums of weighted normals; then, of an object that is coloured
    /// by a value, the sums of weights and of weighted values.
    pub sums: Vec<f32>,
}

/// Sums of weighted normals.
pub(super) const NORMALS: usize = 3;
/// And of weights, and of weighted values.
pub(super) const WITH_VALUES: usize = NORMALS + 2;

/// Finds the foremost disc of every pixel; of equally deep ones the first drawn.
pub(super) struct Fronts<'a> {
    pub drawn: &'a mut Drawn,
    pub splats: &'a Splats,
    pub span: Span,
}

impl Kernel for Fronts<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { drawn, span, .. } = self;
        refill(&mut drawn.depth, f32::NEG_INFINITY, span.len());
        refill(&mut drawn.place, NOTHING, span.len());
        let (all_depths, all_places) = (&mut drawn.depth[..], &mut drawn.place[..]);
        for splat in &self.splats.all {
            let clips = self.splats.clips.get(splat.clips as usize);
            let rows = span.rows_of(splat);
            for first in span.columns_of(splat).step_by(WIDE) {
                let columns = Columns::new(splat, first);
                for row in rows.clone() {
                    let line = Line::new(splat, span.first + row as isize, 0.0);
                    let at = span.begin(row) + first;
                    let (Some(depths), Some(places)) =
                        (wide_mut(all_depths, at), wide_mut(all_places, at))
                    else {
                        continue;
                    };
                    match clips {
                        None => columns.put(&line, [1.0; WIDE], splat.place, depths, places),
                        Some(clips) => {
                            let rim = columns.clipped(clips, line.dy);
                            columns.put(&line, rim, splat.place, depths, places);
                        }
                    }
                }
            }
        }
    }
}

/// Adds up the discs at the depth of the foremost, by weights that fall from 1 in a disc's middle to 0 at its rim.
pub(super) struct Blend<'a, V, const PLANES: usize> {
    pub drawn: &'a mut Drawn,
    pub splats: &'a Splats,
    pub span: Span,
    /// Discs within this depth of the foremost.
    pub blend_mm: f32,
    /// And, faintly, those within this.
    pub faint_mm: f32,
    /// What a voxel is coloured by.
    pub value: V,
}

impl<V: Fn(u32) -> f32, const PLANES: usize> Kernel for Blend<'_, V, PLANES> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { drawn, span, .. } = self;
        let (blend_mm, faint_mm) = (self.blend_mm, self.faint_mm);
        refill(&mut drawn.sums, 0.0, PLANES * span.len());
        let (all_depths, all_sums) = (&drawn.depth[..], &mut drawn.sums[..]);
        let stride = span.stride();
        for splat in &self.splats.all {
            let (near, far) = (splat.strength, FAINT * splat.strength);
            let mut factors = [1.0; PLANES];
            factors[..NORMALS].copy_from_slice(&splat.normal.to_array());
            if PLANES == WITH_VALUES {
                factors[PLANES - 1] = (self.value)(splat.place);
            }
            let rows = span.rows_of(splat);
            for first in span.columns_of(splat).step_by(WIDE) {
                let columns = Columns::new(splat, first);
                for row in rows.clone() {
                    let line = Line::new(splat, span.first + row as isize, 0.0);
                    let Some(depths) = wide(all_depths, span.begin(row) + first) else {
                        continue;
                    };
                    let mut weights = [0.0; WIDE];
                    for lane in 0..WIDE {
                        let behind = depths[lane] - columns.depth(&line, lane);
                        let strength = if behind <= faint_mm { far } else { 0.0 };
                        let strength = if behind <= blend_mm { near } else { strength };
                        let falling = 1.0 - columns.q(&line, lane);
                        let falling = if falling > 0.0 { falling } else { 0.0 };
                        weights[lane] = falling * falling * strength;
                    }
                    let at = row * stride * PLANES + WIDE + first;
                    for plane in 0..PLANES {
                        let Some(sums) = wide_mut(all_sums, at + plane * stride) else {
                            continue;
                        };
                        for lane in 0..WIDE {
                            sums[lane] += weights[lane] * factors[plane];
                        }
                    }
                }
            }
        }
    }
}

/// As many of one value, in the memory that there is.
fn refill<T: Copy>(all: &mut Vec<T>, value: T, len: usize) {
    all.clear();
    all.resize(len, value);
}

#[inline(always)]
pub(super) fn wide<T>(all: &[T], at: usize) -> Option<&[T; WIDE]> {
    all.get(at..)?.first_chunk()
}

#[inline(always)]
fn wide_mut<T>(all: &mut [T], at: usize) -> Option<&mut [T; WIDE]> {
    all.get_mut(at..)?.first_chunk_mut()
}

/// A disc on one row of pixels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Line {
    pub b: f32,
    pub c: f32,
    pub z: f32,
    /// From the disc's middle to the row's.
    pub dy: f32,
}

impl Line {
    /// `down`: from the row's middle, pixels.
    #[inline(always)]
    pub(super) fn new(splat: &Splat, row: isize, down: f32) -> Self {
        let dy = row as f32 + 0.5 - splat.y + down;
        Self {
            b: 2.0 * splat.b * dy,
            c: splat.c * dy * dy,
            z: splat.z + splat.zy * dy,
            dy,
        }
    }
}

/// A disc on some columns of pixels: what is the same on all rows.
#[derive(Debug, Clone, Copy)]
struct Columns {
    /// From the disc's middle to the columns.
    dx: [f32; WIDE],
    a_dx: [f32; WIDE],
    zx_dx: [f32; WIDE],
}

impl Columns {
    #[inline(always)]
    fn new(splat: &Splat, first: usize) -> Self {
        let (mut dx, mut a_dx, mut zx_dx) = ([0.0; WIDE], [0.0; WIDE], [0.0; WIDE]);
        for lane in 0..WIDE {
            let column = (first + lane) as u32;
            // In the quad first, for its numbers are small.
            let (quad, within) = (column & !(QUAD as u32 - 1), column & (QUAD as u32 - 1));
            dx[lane] = (within as f32 + 0.5 - splat.x) + quad as f32;
            a_dx[lane] = splat.a * dx[lane];
            zx_dx[lane] = splat.zx * dx[lane];
        }
        Self { dx, a_dx, zx_dx }
    }

    #[inline(always)]
    fn q(&self, line: &Line, lane: usize) -> f32 {
        self.dx[lane] * (self.a_dx[lane] + line.b) + line.c
    }

    #[inline(always)]
    fn depth(&self, line: &Line, lane: usize) -> f32 {
        line.z + self.zx_dx[lane]
    }

    /// Below which value Q has to be in each column, where a disc is cut off.
    #[inline(always)]
    fn clipped(&self, clips: &Clips, dy: f32) -> [f32; WIDE] {
        let mut rim = [1.0; WIDE];
        for &[k, kx, ky] in clips {
            let k = k + ky * dy;
            for lane in 0..WIDE {
                let room = k + kx * self.dx[lane];
                rim[lane] = if room >= 0.0 {
                    rim[lane]
                } else {
                    f32::NEG_INFINITY
                };
            }
        }
        rim
    }

    /// Puts a disc where it is nearer than what is there.
    #[inline(always)]
    fn put(
        &self,
        line: &Line,
        rim: [f32; WIDE],
        place: u32,
        depths: &mut [f32; WIDE],
        places: &mut [u32; WIDE],
    ) {
        // What is read is read before anything is written: only then does the compiler know that it can be done at once.
        let (was_depth, was_place) = (*depths, *places);
        let mut hit = [false; WIDE];
        let mut z = [0.0; WIDE];
        for lane in 0..WIDE {
            z[lane] = self.depth(line, lane);
            hit[lane] = (self.q(line, lane) < rim[lane]) & (z[lane] > was_depth[lane]);
        }
        let mut place = [place; WIDE];
        for lane in 0..WIDE {
            z[lane] = if hit[lane] { z[lane] } else { was_depth[lane] };
            place[lane] = if hit[lane] {
                place[lane]
            } else {
                was_place[lane]
            };
        }
        (*depths, *places) = (z, place);
    }
}
