//! Where depth jumps from a pixel to the next: how much of such a pixel is on the near side.

use glam::Vec4;

use super::span::{Drawn, Line, NOTHING, Span};
use super::splat::{QUAD, Splats};
use super::squares::Squares;
use crate::simd::Kernel;

/// Where the four samples of a pixel at an edge lie, from its middle: no two in a row or a column.
pub(super) const SAMPLES: [[f32; 2]; 4] = [
    [-0.375, -0.125],
    [0.125, -0.375],
    [0.375, 0.125],
    [-0.125, 0.375],
];

/// The middles of a quad's pixels from the first one's left edge.
const MIDDLES: Vec4 = Vec4::new(0.5, 1.5, 2.5, 3.5);

/// The depth that parts the near side of an edge from the far one, mm.
fn between(near: f32, far: f32) -> f32 {
    if far == f32::NEG_INFINITY {
        f32::MIN
    } else {
        (near + far) / 2.0
    }
}

/// Four pixels of which one at least is at an edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeQuad {
    /// Counted from the span's first.
    pub row: usize,
    pub quad: usize,
    /// The depth between the two sides; infinite where a pixel is at no edge.
    between: Vec4,
    /// Which pixels are at an edge, as bits.
    at_edge: u8,
    /// For each sample the pixels, as bits, in which it is on the near side.
    near: [u8; SAMPLES.len()],
}

impl EdgeQuad {
    /// Each pixel at an edge by its column, and how many of its samples are on the near side.
    pub(super) fn pixels(&self) -> impl Iterator<Item = (usize, u8)> {
        let at_edge = (0..QUAD).filter(|&lane| self.at_edge >> lane & 1 == 1);
        at_edge.map(|lane| {
            let near = self.near.iter().map(|bits| bits >> lane & 1).sum();
            (self.quad * QUAD + lane, near)
        })
    }
}

/// The quads at edges of a span. Made once by a worker and used for all of its bands.
#[derive(Debug, Default)]
pub(super) struct Edges {
    /// Row by row.
    pub quads: Vec<EdgeQuad>,
    /// For each quad of the span its number among those, or [`NOTHING`].
    numbers: Vec<u32>,
    marks: Squares<bool>,
}

/// Finds the quads where depth jumps.
pub(super) struct FindEdges<'a> {
    pub edges: &'a mut Edges,
    pub drawn: &'a mut Drawn,
    pub span: Span,
    /// Rows of the picture.
    pub height: usize,
    /// By more than this.
    pub jump_mm: f32,
}

impl Kernel for FindEdges<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            edges, drawn, span, ..
        } = self;
        edges.quads.clear();
        edges.numbers.clear();
        edges.numbers.resize(span.rows * span.quads, NOTHING);
        edges.marks.fill(span, false);
        let jump = Vec4::splat(self.jump_mm);
        let (width, stride) = (span.width(), span.stride());
        for row in 1..span.rows - 1 {
            let begin = span.begin(row);
            // Beyond the picture there is what is at its rim.
            drawn.depth[begin - 1] = drawn.depth[begin];
            drawn.depth[begin + width] = drawn.depth[begin + width - 1];
            let at = span.first + row as isize;
            let above = if at > 0 { begin - stride } else { begin };
            let below = if at + 1 < self.height as isize {
                begin + stride
            } else {
                begin
            };
            let line = |begin: usize| drawn.depth[begin..begin + width].chunks_exact(QUAD);
            let lines = line(begin)
                .zip(line(above))
                .zip(line(below))
                .zip(line(begin - 1))
                .zip(line(begin + 1));
            for (quad, ((((here, above), below), left), right)) in lines.enumerate() {
                let [here, above, below, left, right] =
                    [here, above, below, left, right].map(Vec4::from_slice);
                let near = here.max(above).max(below).max(left).max(right);
                let far = here.min(above).min(below).min(left).min(right);
                // Where nothing is at all, the difference is no number and so not greater.
                let at_edge = (near - far).cmpgt(jump).bitmask();
                if at_edge == 0 {
                    continue;
                }
                let mut parting = [f32::INFINITY; QUAD];
                for (lane, parting) in parting.iter_mut().enumerate() {
                    if at_edge >> lane & 1 == 1 {
                        *parting = between(near[lane], far[lane]);
                    }
                }
                edges.numbers[row * span.quads + quad] = edges.quads.len() as u32;
                edges.marks.mark(row, quad);
                edges.quads.push(EdgeQuad {
                    row,
                    quad,
                    between: Vec4::from_array(parting),
                    at_edge: at_edge as u8,
                    near: [0; SAMPLES.len()],
                });
            }
        }
    }
}

/// Finds which samples are on the near side of their edge: those that a disc on that side covers.
pub(super) struct SampleEdges<'a> {
    pub edges: &'a mut Edges,
    pub splats: &'a Splats,
    pub span: Span,
}

impl Kernel for SampleEdges<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            edges,
            splats,
            span,
        } = self;
        if edges.quads.is_empty() {
            return;
        }
        for splat in &splats.all {
            if !edges.marks.any_below(splat, span) {
                continue;
            }
            let clips = splats
                .clips
                .get(splat.clips as usize)
                .map(|clips| &clips[..]);
            // A sample may be hit where no middle of a pixel is.
            let begin = (splat.x - splat.half_width - 0.5) as u32 as usize / QUAD;
            let end = (splat.x + splat.half_width + 0.5) as u32 as usize / QUAD + 1;
            let (begin, end) = (begin.min(span.quads), end.min(span.quads));
            let x = SAMPLES.map(|[right, _]| MIDDLES - Vec4::splat(splat.x) + right);
            for row in span.rows_of(splat) {
                let base = row * span.quads;
                let numbers = edges.numbers.get(base + begin..base + end);
                let numbers = numbers.unwrap_or_default();
                if numbers.iter().all(|&number| number == NOTHING) {
                    continue;
                }
                let mut lines = [Line::default(); SAMPLES.len()];
                for (line, [_, down]) in lines.iter_mut().zip(SAMPLES) {
                    *line = Line::new(splat, span.first + row as isize, down);
                }
                for (quad, &number) in (begin..).zip(numbers) {
                    let Some(edge) = edges.quads.get_mut(number as usize) else {
                        continue;
                    };
                    // Most discs come after those before them.
                    if edge.near == [edge.at_edge; SAMPLES.len()] {
                        continue;
                    }
                    let first = Vec4::splat((quad * QUAD) as f32);
                    for sample in 0..SAMPLES.len() {
                        let (line, dx) = (&lines[sample], x[sample] + first);
                        let q = dx * (splat.a * dx + line.b) + line.c;
                        let z = line.z + splat.zx * dx;
                        let mut hit = q.cmplt(Vec4::ONE) & z.cmpge(edge.between);
                        for &[k, kx, ky] in clips.unwrap_or(&[]) {
                            let room = (k + ky * line.dy) + kx * dx;
                            hit &= room.cmpge(Vec4::ZERO);
                        }
                        edge.near[sample] |= hit.bitmask() as u8;
                    }
                }
            }
        }
    }
}
