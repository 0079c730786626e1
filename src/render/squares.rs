//! What tells of a disc, before its pixels are looked at, that nothing of it is needed.

use super::layer::Span;
use super::splat::{QUAD, Splat};

/// Rows and columns of a square of [`Squares`].
const SQUARE: usize = 8;

/// A value for each square of pixels of a band.
pub(super) struct Squares<V> {
    values: Vec<V>,
    across: usize,
    down: usize,
}

impl<V: Copy> Squares<V> {
    /// From the values of the quads, in their order.
    fn new(
        of_quads: impl Iterator<Item = V>,
        span: Span,
        none: V,
        joined: impl Fn(V, V) -> V,
    ) -> Self {
        let quads_of_square = SQUARE / QUAD;
        let across = span.quads.div_ceil(quads_of_square);
        let down = span.rows.div_ceil(SQUARE);
        let mut values = vec![none; across * down];
        for (place, value) in of_quads.enumerate() {
            let (row, quad) = (place / span.quads, place % span.quads);
            let square = &mut values[row / SQUARE * across + quad / quads_of_square];
            *square = joined(*square, value);
        }
        Self {
            values,
            across,
            down,
        }
    }

    /// The values of the squares that a disc may reach into, line by line.
    #[inline(always)]
    fn below(&self, splat: &Splat, span: Span) -> impl Iterator<Item = &[V]> {
        let square = |at: f32, last: usize| ((at.max(0.0) as usize) / SQUARE).min(last);
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
    /// The furthest depth in each, from those of the quads.
    pub(super) fn furthest(depths: impl Iterator<Item = f32>, span: Span) -> Self {
        Self::new(depths, span, f32::INFINITY, f32::min)
    }

    /// Whether a disc is so far behind what is foremost everywhere that it adds nothing.
    #[inline(always)]
    pub(super) fn hide(&self, splat: &Splat, span: Span, reach_mm: f32) -> bool {
        let nearest = splat.z
            + splat.zx.abs() * splat.half_width
            + splat.zy.abs() * splat.half_height
            + reach_mm;
        let mut lines = self.below(splat, span);
        lines.all(|line| line.iter().all(|&depth| nearest < depth))
    }
}

impl Squares<bool> {
    /// Whether any quad of each is marked.
    pub(super) fn marked(marks: impl Iterator<Item = bool>, span: Span) -> Self {
        Self::new(marks, span, false, |a, b| a || b)
    }

    /// Whether a disc may reach into one that is marked.
    #[inline(always)]
    pub(super) fn any_below(&self, splat: &Splat, span: Span) -> bool {
        let mut lines = self.below(splat, span);
        lines.any(|line| line.contains(&true))
    }
}
