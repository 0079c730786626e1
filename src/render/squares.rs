//! What tells of a disc, before its pixels are looked at, that nothing of it is needed.

use super::span::{Drawn, Span};
use super::splat::{QUAD, Splat, Splats};
use crate::simd::Kernel;

/// Rows and columns of a square of [`Squares`].
const SQUARE: usize = 8;

/// A value for each square of pixels of a span. Made once by a worker and used for all of its bands.
#[derive(Debug, Default)]
pub(super) struct Squares<V> {
    values: Vec<V>,
    across: usize,
    down: usize,
}

impl<V: Copy> Squares<V> {
    /// All of one value.
    pub(super) fn fill(&mut self, span: Span, value: V) {
        self.across = span.width().div_ceil(SQUARE);
        self.down = span.rows.div_ceil(SQUARE);
        self.values.clear();
        self.values.resize(self.across * self.down, value);
    }

    /// The values of the squares that a disc may reach into, line by line.
    #[inline(always)]
    fn below(&self, splat: &Splat, span: Span) -> impl Iterator<Item = &[V]> {
        let square = |at: f32, last: usize| ((at.max(0.0) as u32 as usize) / SQUARE).min(last);
        let y = splat.y - span.first as f32;
        // A sample may lie half a pixel beyond the middles.
        let (width, height) = (splat.half_width + 0.5, splat.half_height + 0.5);
        let (top, bottom) = (
            square(y - height, self.down - 1),
            square(y + height, self.down - 1),
        );
        let (left, right) = (
            square(splat.x - width, self.across - 1),
            square(splat.x + width, self.across - 1),
        );
        let lines = self.values.chunks(self.across).take(bottom + 1).skip(top);
        lines.map(move |line| &line[left..=right])
    }
}

impl Squares<f32> {
    /// The furthest depth in each, from those of the pixels.
    #[inline(always)]
    fn furthest(&mut self, depths: &[f32], span: Span) {
        self.fill(span, f32::INFINITY);
        for row in 0..span.rows {
            let begin = span.begin(row);
            let depths = depths[begin..begin + span.width()].chunks(SQUARE);
            let line = &mut self.values[row / SQUARE * self.across..][..self.across];
            for (furthest, depths) in line.iter_mut().zip(depths) {
                for &depth in depths {
                    *furthest = if depth < *furthest { depth } else { *furthest };
                }
            }
        }
    }

    /// Whether a disc is so far behind what is foremost everywhere that it adds nothing.
    #[inline(always)]
    fn hide(&self, splat: &Splat, span: Span, reach_mm: f32) -> bool {
        let nearest = splat.z
            + splat.zx.abs() * splat.half_width
            + splat.zy.abs() * splat.half_height
            + reach_mm;
        let mut lines = self.below(splat, span);
        lines.all(|line| line.iter().all(|&depth| nearest < depth))
    }
}

/// Drops the discs that are so far behind what is foremost everywhere that they add nothing.
pub(super) struct Hide<'a> {
    pub furthest: &'a mut Squares<f32>,
    pub drawn: &'a Drawn,
    pub splats: &'a mut Splats,
    pub span: Span,
    pub reach_mm: f32,
}

impl Kernel for Hide<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { furthest, span, .. } = self;
        furthest.furthest(&self.drawn.depth, span);
        let is_seen = |splat: &_| !furthest.hide(splat, span, self.reach_mm);
        self.splats.all.retain(is_seen);
    }
}

impl Squares<bool> {
    /// Marks the square of a quad.
    pub(super) fn mark(&mut self, row: usize, quad: usize) {
        self.values[row / SQUARE * self.across + quad * QUAD / SQUARE] = true;
    }

    /// Whether a disc may reach into one that is marked.
    #[inline(always)]
    pub(super) fn any_below(&self, splat: &Splat, span: Span) -> bool {
        let mut lines = self.below(splat, span);
        lines.any(|line| line.contains(&true))
    }
}
