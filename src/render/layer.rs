//! One object on the picture: which voxel, how deep, which normal, in every pixel.

use glam::{BVec4A, Vec3, Vec4};
use rayon::prelude::*;

use super::camera::Camera;
use super::compose::Object;
use super::shade::{self, Normals, Paint, Shader};
use super::splat::{Clips, Eye, FLAT, QUAD, Splat};
use super::squares::Squares;
use crate::simd::{Kernel, Simd};
use crate::surface::SemiBoundary;

/// Rows of a picture that are drawn at a time: small enough for a core's cache.
const BAND: usize = 64;
/// Weight of a disc some way behind the foremost one. At the rim of something the foremost disc may be there
/// with its own rim only; one pixel of its colour would be a speck.
const FAINT: f32 = 1.0 / 16.0;
/// No voxel is at this pixel.
pub(super) const NOTHING: u32 = u32::MAX;

/// An object's picture before it is put over another's.
#[derive(Debug)]
pub(super) struct Layer {
    pub size: usize,
    /// sRGB, and opacity of 255.
    pub rgba: Vec<[u8; 4]>,
    /// Towards the viewer, mm; -∞ where nothing is.
    pub depth: Vec<f32>,
    /// Place in the semi-boundary of the foremost disc, or [`NOTHING`].
    pub place: Vec<u32>,
    /// In pixels at an edge, how many of their samples belong to what is on the near side of it; else
    /// [`NO_EDGE`].
    pub near: Vec<u8>,
}

/// A pixel that no edge passes.
pub(super) const NO_EDGE: u8 = u8::MAX;

/// The depth that parts the near side of an edge from the far one, mm.
fn between(near: f32, far: f32) -> f32 {
    if far == f32::NEG_INFINITY {
        f32::MIN
    } else {
        (near + far) / 2.0
    }
}

/// The part of a layer that one worker fills: whole rows.
struct Band<'a> {
    first: usize,
    rgba: &'a mut [[u8; 4]],
    depth: &'a mut [f32],
    place: &'a mut [u32],
    near: &'a mut [u8],
}

impl Layer {
    pub(super) fn new(object: &Object<'_>, camera: &Camera) -> Self {
        let size = camera.size();
        let pixels = size * size;
        let spacing = object.surface.grid().spacing().max_element() as f32;
        let mut layer = Self {
            size,
            rgba: vec![[0; 4]; pixels],
            depth: filled(f32::NEG_INFINITY, pixels),
            place: filled(NOTHING, pixels),
            near: filled(NO_EDGE, pixels),
        };
        let eye = Eye::new(camera, object.surface);
        let painter = Painter {
            object,
            rows: rows(object.surface, &eye),
            eye,
            shader: Shader::new(object.opacity),
            size,
            blend_mm: spacing,
            edge_mm: 1.5 * spacing + 4.0 * camera.mm_per_pixel() as f32,
        };
        let len = BAND * size;
        let bands = (
            layer.rgba.par_chunks_mut(len),
            layer.depth.par_chunks_mut(len),
            layer.place.par_chunks_mut(len),
            layer.near.par_chunks_mut(len),
        );
        bands
            .into_par_iter()
            .enumerate()
            .for_each(|(number, (rgba, depth, place, near))| {
                Simd::widest().run(PaintBand {
                    painter: &painter,
                    band: Band {
                        first: number * BAND,
                        rgba,
                        depth,
                        place,
                        near,
                    },
                });
            });
        layer
    }
}

/// Memory is slow to come by: every worker takes its share.
fn filled<V: Copy + Send + Sync>(value: V, len: usize) -> Vec<V> {
    rayon::iter::repeat_n(value, len).collect()
}

struct PaintBand<'a, 'b> {
    painter: &'a Painter<'b>,
    band: Band<'a>,
}

impl Kernel for PaintBand<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.painter.paint(self.band);
    }
}

struct Painter<'a> {
    object: &'a Object<'a>,
    eye: Eye,
    /// Those that have voxels, near the viewer first as the octant of the viewing direction has it.
    rows: Vec<Row>,
    shader: Shader,
    size: usize,
    /// Discs within this depth of the foremost belong to the same surface.
    blend_mm: f32,
    /// A larger jump of depth between pixels is an edge.
    edge_mm: f32,
}

/// A row of the semi-boundary on the picture.
#[derive(Debug, Clone, Copy)]
struct Row {
    y: u16,
    z: u16,
    /// Where it begins and ends among the voxels.
    begin: u32,
    end: u32,
    /// Its voxel at x = 0, on the picture.
    origin: Vec3,
    /// From where to where its voxels reach, pixels from the top.
    top: f32,
    bottom: f32,
}

/// A band with a row more on either side, so that the edges at its rim are seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    /// First row; may be the one above the picture.
    pub first: isize,
    pub rows: usize,
    pub quads: usize,
}

impl Span {
    /// The rows that a splat covers, counted from the span's first.
    #[inline(always)]
    fn rows_of(self, splat: &Splat) -> std::ops::Range<usize> {
        let (begin, end) = splat.rows();
        let row = |row: isize| (row - self.first).clamp(0, self.rows as isize) as usize;
        row(begin)..row(end)
    }

    /// The quads of a row that a splat covers, as places in a buffer of the span; and the first's number in
    /// its row.
    #[inline(always)]
    fn quads_of(self, line: &Line, row: usize) -> (std::ops::Range<usize>, usize) {
        let (from, to) = line.quads();
        let base = row * self.quads;
        (base + from.min(self.quads)..base + to.min(self.quads), from)
    }

    fn len(self) -> usize {
        self.rows * self.quads
    }
}

/// Where the four samples of a pixel at an edge lie, from its middle: no two in a row or a column.
pub(super) const SAMPLES: [[f32; 2]; 4] = [
    [-0.375, -0.125],
    [0.125, -0.375],
    [0.375, 0.125],
    [-0.125, 0.375],
];

/// Four pixels of the first pass: the foremost disc.
#[derive(Debug, Clone, Copy)]
struct Front {
    depth: Vec4,
    /// The bits of each lane are a place: so four are chosen at once.
    place: Vec4,
}

impl Front {
    const NOTHING: Self = Self {
        depth: Vec4::NEG_INFINITY,
        place: bits(NOTHING),
    };

    #[inline(always)]
    fn places(&self) -> [u32; QUAD] {
        self.place.to_array().map(f32::to_bits)
    }
}

/// Four times the same bits.
const fn bits(value: u32) -> Vec4 {
    Vec4::splat(f32::from_bits(value))
}

/// Four pixels of the second pass: sums of weighted normals, and of weights.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    x: Vec4,
    y: Vec4,
    z: Vec4,
    weight: Vec4,
}

/// What was drawn into a span, not yet shaded.
struct Drawn {
    fronts: Vec<Front>,
    sums: Vec<Sums>,
    /// Sums of weighted values; none where the object has one colour.
    values: Vec<Vec4>,
    edges: Edges,
    /// Depth at the samples of the quads at edges.
    samples: Vec<[Vec4; SAMPLES.len()]>,
}

/// The middles of a quad's pixels from the first one's left edge.
const MIDDLES: Vec4 = Vec4::new(0.5, 1.5, 2.5, 3.5);

impl Painter<'_> {
    #[inline(always)]
    fn paint(&self, band: Band<'_>) {
        let height = band.depth.len() / self.size;
        let span = Span {
            first: band.first as isize - 1,
            rows: height + 2,
            quads: self.size.div_ceil(QUAD),
        };
        let mut splats = self.splats(span);
        let fronts = self.fronts(&splats, span);
        let depths = fronts.iter().map(|front| front.depth.min_element());
        let furthest = Squares::furthest(depths, span);
        splats.retain(|splat| !furthest.hide(splat, span, self.faint_mm()));
        let mut sums = vec![Sums::default(); span.len()];
        self.blend(&splats, &fronts, span, |quad, splat, weight| {
            if let Some(sum) = sums.get_mut(quad) {
                sum.x += weight * splat.normal.x;
                sum.y += weight * splat.normal.y;
                sum.z += weight * splat.normal.z;
                sum.weight += weight;
            }
        });
        let mut values = Vec::new();
        if let Paint::Scalar { .. } = self.object.paint {
            values = vec![Vec4::ZERO; span.len()];
            self.blend(&splats, &fronts, span, |quad, splat, weight| {
                if let Some(sum) = values.get_mut(quad) {
                    *sum += weight * self.scalar(splat.place);
                }
            });
        }
        let edges = self.edges(&fronts, span);
        let samples = self.samples(&splats, &edges, span);
        let drawn = Drawn {
            fronts,
            sums,
            values,
            edges,
            samples,
        };
        self.fill(band, span, &drawn);
    }

    /// Shades what was drawn into a band.
    #[inline(always)]
    fn fill(&self, band: Band<'_>, span: Span, drawn: &Drawn) {
        let lines = (band.rgba.chunks_mut(self.size))
            .zip(band.depth.chunks_mut(self.size))
            .zip(band.place.chunks_mut(self.size))
            .zip(band.near.chunks_mut(self.size));
        for (row, (((rgba, depth), place), near)) in (1..).zip(lines) {
            let line = row * span.quads;
            // The last quad of a row may reach beyond it.
            let quads = (rgba.chunks_mut(QUAD))
                .zip(depth.chunks_mut(QUAD))
                .zip(place.chunks_mut(QUAD))
                .zip(near.chunks_mut(QUAD));
            for (quad, (((rgba, depth), place), near)) in (line..).zip(quads) {
                let number = drawn.edges.of_quad[quad];
                if number != NOTHING {
                    for (lane, near) in near.iter_mut().enumerate() {
                        *near = drawn.edges.share(number as usize, lane, &drawn.samples);
                    }
                }
                let front = &drawn.fronts[quad];
                let places = front.places();
                if places == [NOTHING; QUAD] {
                    continue;
                }
                let Sums { x, y, z, weight } = drawn.sums[quad];
                let shaded = self.shader.shade(
                    &self.object.paint,
                    &shade::Quad {
                        normals: Normals { x, y, z },
                        values: drawn.values.get(quad).map_or(Vec4::ZERO, |&sum| {
                            Vec4::select(weight.cmpgt(Vec4::ZERO), sum / weight, Vec4::ZERO)
                        }),
                        cut: flat(places),
                    },
                );
                let lanes = rgba.iter_mut().zip(depth).zip(place).enumerate();
                for (lane, ((rgba, depth), to)) in lanes {
                    if places[lane] != NOTHING {
                        *rgba = shaded[lane];
                        *depth = front.depth[lane];
                        *to = places[lane] & !FLAT;
                    }
                }
            }
        }
    }

    /// The foremost disc of every pixel; of equally deep ones the first drawn.
    #[inline(always)]
    fn fronts(&self, splats: &[Splat], span: Span) -> Vec<Front> {
        let mut fronts = vec![Front::NOTHING; span.len()];
        for splat in splats {
            let place = bits(splat.place);
            for row in span.rows_of(splat) {
                let line = Line::new(splat, span.first + row as isize);
                let (range, from) = span.quads_of(&line, row);
                let Some(fronts) = fronts.get_mut(range) else {
                    continue;
                };
                for (quad, front) in fronts.iter_mut().enumerate() {
                    let dx = line.dx(from + quad);
                    let z = line.depth(dx);
                    let hit = line.covered(dx) & z.cmpgt(front.depth);
                    front.depth = Vec4::select(hit, z, front.depth);
                    front.place = Vec4::select(hit, place, front.place);
                }
            }
        }
        fronts
    }

    /// Gives each disc at the depth of the foremost to `add`, with the place of a quad in the span and the
    /// weights that the disc has in its pixels: they fall from 1 in its middle to 0 at its rim.
    #[inline(always)]
    fn blend(
        &self,
        splats: &[Splat],
        fronts: &[Front],
        span: Span,
        mut add: impl FnMut(usize, &Splat, Vec4),
    ) {
        let (near_mm, far_mm) = (Vec4::splat(self.blend_mm), Vec4::splat(self.faint_mm()));
        for splat in splats {
            let (near, far) = (
                Vec4::splat(splat.strength),
                Vec4::splat(FAINT * splat.strength),
            );
            for row in span.rows_of(splat) {
                let line = Line::new(splat, span.first + row as isize);
                let (range, from) = span.quads_of(&line, row);
                let begin = range.start;
                let Some(fronts) = fronts.get(range) else {
                    continue;
                };
                for (quad, front) in fronts.iter().enumerate() {
                    let dx = line.dx(from + quad);
                    let behind = front.depth - line.depth(dx);
                    let strength = Vec4::select(behind.cmple(far_mm), far, Vec4::ZERO);
                    let strength = Vec4::select(behind.cmple(near_mm), near, strength);
                    let falling = (Vec4::ONE - line.q(dx)).max(Vec4::ZERO);
                    let weight = falling * falling * strength;
                    add(begin + quad, splat, weight);
                }
            }
        }
    }

    /// Discs within this depth of the foremost are what is seen where that has next to no weight.
    #[inline(always)]
    fn faint_mm(&self) -> f32 {
        3.0 * self.blend_mm
    }

    /// The quads that hold a pixel at an edge of depth.
    #[inline(always)]
    fn edges(&self, fronts: &[Front], span: Span) -> Edges {
        let jump = Vec4::splat(self.edge_mm);
        let last_row = self.size as isize - 1;
        let mut edges = Edges {
            of_quad: vec![NOTHING; span.len()],
            between: Vec::new(),
        };
        for row in 1..span.rows - 1 {
            let line = row * span.quads;
            let at = span.first + row as isize;
            for quad in 0..span.quads {
                let place = line + quad;
                let here = fronts[place].depth;
                // Beyond the picture there is what is at its rim.
                let above = if at > 0 {
                    fronts[place - span.quads].depth
                } else {
                    here
                };
                let below = if at < last_row {
                    fronts[place + span.quads].depth
                } else {
                    here
                };
                let [a, b, c, d] = here.to_array();
                let before = if quad > 0 {
                    fronts[place - 1].depth.w
                } else {
                    a
                };
                let after = if quad + 1 < span.quads {
                    fronts[place + 1].depth.x
                } else {
                    d
                };
                let left = Vec4::new(before, a, b, c);
                let right = Vec4::new(b, c, d, after);
                let near = here.max(above).max(below).max(left).max(right);
                let far = here.min(above).min(below).min(left).min(right);
                // Where nothing is at all, the difference is no number and so not greater.
                let at_edge = (near - far).cmpgt(jump).bitmask();
                if at_edge == 0 {
                    continue;
                }
                let between = std::array::from_fn(|lane| {
                    (at_edge >> lane & 1 == 1).then(|| between(near[lane], far[lane]))
                });
                edges.of_quad[place] = edges.between.len() as u32;
                edges.between.push(between);
            }
        }
        edges
    }

    /// Depth at the samples of the pixels of the quads at edges.
    #[inline(always)]
    fn samples(&self, splats: &[Splat], edges: &Edges, span: Span) -> Vec<[Vec4; SAMPLES.len()]> {
        let mut all = vec![[Vec4::NEG_INFINITY; SAMPLES.len()]; edges.between.len()];
        if all.is_empty() {
            return all;
        }
        let at_edges = edges.of_quad.iter().map(|&number| number != NOTHING);
        let at_edges = Squares::marked(at_edges, span);
        for splat in splats {
            if !at_edges.any_below(splat, span) {
                continue;
            }
            for row in span.rows_of(splat) {
                // A sample may be hit where no middle of a pixel is.
                let begin = (splat.x - splat.half_width - 0.5) as u32 as usize / QUAD;
                let end = (splat.x + splat.half_width + 0.5) as u32 as usize / QUAD + 1;
                let base = row * span.quads;
                let range = base + begin.min(span.quads)..base + end.min(span.quads);
                let numbers = edges.of_quad.get(range).unwrap_or_default();
                if numbers.iter().all(|&number| number == NOTHING) {
                    continue;
                }
                let line = Line::new(splat, span.first + row as isize);
                for (quad, &number) in numbers.iter().enumerate() {
                    let Some(depths) = all.get_mut(number as usize) else {
                        continue;
                    };
                    for (depth, sample) in depths.iter_mut().zip(SAMPLES) {
                        let line = line.moved(splat, sample);
                        let dx = line.dx(begin + quad);
                        let z = line.depth(dx);
                        let hit = line.covered(dx) & z.cmpgt(*depth);
                        *depth = Vec4::select(hit, z, *depth);
                    }
                }
            }
        }
        all
    }

    /// The value of a voxel that is coloured by one; what has none is drawn as unchanged.
    #[inline(always)]
    fn scalar(&self, place: u32) -> f32 {
        match &self.object.paint {
            Paint::Plain(_) => 0.0,
            Paint::Scalar { values, .. } => {
                let value = values.get((place & !FLAT) as usize).copied().unwrap_or(0.0);
                if value.is_finite() { value } else { 0.0 }
            }
        }
    }

    /// What the voxels draw that reach into a span.
    #[inline(always)]
    fn splats(&self, span: Span) -> Vec<Splat> {
        let surface = self.object.surface;
        let reach = self.eye.reach(surface);
        let (first, last) = (span.first as f32, (span.first + span.rows as isize) as f32);
        let (top, bottom) = (first - reach, last + reach);
        let [flip, _, _] = self.eye.reversed();
        let step = self.eye.along_row();
        let mut splats = Vec::new();
        for row in &self.rows {
            if row.bottom < top || row.top > bottom {
                continue;
            }
            let (y, z) = (usize::from(row.y), usize::from(row.z));
            let begin = row.begin as usize;
            let voxels = surface.voxels().get(begin..row.end as usize);
            let voxels = voxels.unwrap_or_default();
            for number in ordered(voxels.len(), flip) {
                let voxel = voxels[number];
                let at = row.origin + step * voxel.x() as f32;
                let reach = self.eye.disc_reach(voxel);
                if at.y + reach < first || at.y - reach > last {
                    continue;
                }
                let index = [voxel.x(), y, z];
                let place = (begin + number) as u32;
                self.eye.splats(voxel, index, at, place, &mut splats);
            }
        }
        splats.retain(|splat| !span.rows_of(splat).is_empty());
        splats
    }
}

/// The rows that have voxels.
fn rows(surface: &SemiBoundary, eye: &Eye) -> Vec<Row> {
    let [_, ny, nz] = surface.grid().dims();
    let [_, flip_y, flip_z] = eye.reversed();
    let step = eye.along_row();
    let mut rows = Vec::new();
    for z in ordered(nz, flip_z) {
        for y in ordered(ny, flip_y) {
            let range = surface.row_range(y, z);
            let voxels = surface.voxels().get(range.clone()).unwrap_or_default();
            let (Some(head), Some(tail)) = (voxels.first(), voxels.last()) else {
                continue;
            };
            let origin = eye.row(y, z);
            let [a, b] = [head, tail].map(|voxel| origin.y + step.y * voxel.x() as f32);
            rows.push(Row {
                // A grid has at most 32767 voxels along an axis, and places have 31 bits.
                y: y as u16,
                z: z as u16,
                begin: range.start as u32,
                end: range.end as u32,
                origin,
                top: a.min(b),
                bottom: a.max(b),
            });
        }
    }
    rows
}

/// The quads at edges.
#[derive(Debug)]
struct Edges {
    /// For each quad of a span its number among those at edges, or [`NOTHING`].
    of_quad: Vec<u32>,
    /// For each pixel of a quad at an edge, the depth between its two sides.
    between: Vec<[Option<f32>; QUAD]>,
}

impl Edges {
    /// How many of a pixel's samples are on the near side, or [`NO_EDGE`].
    fn share(&self, number: usize, lane: usize, samples: &[[Vec4; SAMPLES.len()]]) -> u8 {
        let (Some(between), Some(samples)) = (self.between.get(number), samples.get(number)) else {
            return NO_EDGE;
        };
        let Some(between) = between[lane] else {
            return NO_EDGE;
        };
        let near = samples.iter().filter(|depth| depth[lane] >= between);
        near.count() as u8
    }
}

/// A disc on one row of pixels.
#[derive(Debug, Clone, Copy)]
struct Line {
    x: Vec4,
    a: Vec4,
    b: Vec4,
    c: Vec4,
    z: Vec4,
    zx: Vec4,
    clips: Option<Clips>,
    /// From the disc's middle to the row's.
    dy: f32,
    /// From where to where the disc reaches on any row, pixels; may be beyond the picture. To find this
    /// for each row takes longer than to look at the pixels beside the ellipse.
    reach: (f32, f32),
}

impl Line {
    #[inline(always)]
    fn new(splat: &Splat, row: isize) -> Self {
        let dy = row as f32 + 0.5 - splat.y;
        Self {
            x: MIDDLES - Vec4::splat(splat.x),
            a: Vec4::splat(splat.a),
            b: Vec4::splat(2.0 * splat.b * dy),
            c: Vec4::splat(splat.c * dy * dy),
            z: Vec4::splat(splat.z + splat.zy * dy),
            zx: Vec4::splat(splat.zx),
            clips: splat.clips,
            dy,
            reach: (splat.x - splat.half_width, splat.x + splat.half_width),
        }
    }

    /// The same, moved by a part of a pixel to the right and down.
    #[inline(always)]
    fn moved(&self, splat: &Splat, [right, down]: [f32; 2]) -> Self {
        let dy = self.dy + down;
        Self {
            x: self.x + Vec4::splat(right),
            b: Vec4::splat(2.0 * splat.b * dy),
            c: Vec4::splat(splat.c * dy * dy),
            z: Vec4::splat(splat.z + splat.zy * dy),
            dy,
            ..*self
        }
    }

    /// The quads with a covered pixel: first, and one after the last.
    #[inline(always)]
    fn quads(&self) -> (usize, usize) {
        // Float to integer conversion clamps: what is left of the picture is pixel 0, NaN as well.
        let begin = self.reach.0 as u32 as usize;
        let end = self.reach.1 as u32 as usize;
        if self.reach.1 > self.reach.0 {
            (begin / QUAD, end / QUAD + 1)
        } else {
            (0, 0)
        }
    }

    /// From the disc's middle to the pixels of a quad.
    #[inline(always)]
    fn dx(&self, quad: usize) -> Vec4 {
        self.x + Vec4::splat((quad * QUAD) as f32)
    }

    #[inline(always)]
    fn q(&self, dx: Vec4) -> Vec4 {
        dx * (self.a * dx + self.b) + self.c
    }

    #[inline(always)]
    fn depth(&self, dx: Vec4) -> Vec4 {
        self.z + self.zx * dx
    }

    /// The pixels that the disc covers.
    #[inline(always)]
    fn covered(&self, dx: Vec4) -> BVec4A {
        let inside = self.q(dx).cmplt(Vec4::ONE);
        match self.clips {
            None => inside,
            Some(clips) => clips.iter().fold(inside, |inside, &[k, kx, ky]| {
                let room = Vec4::splat(k + ky * self.dy) + Vec4::splat(kx) * dx;
                inside & room.cmpge(Vec4::ZERO)
            }),
        }
    }
}

/// Which of four places are flat ends.
#[inline(always)]
fn flat(places: [u32; QUAD]) -> BVec4A {
    // Most quads have none.
    if places.iter().fold(0, |bits, place| bits | place) & FLAT == 0 {
        BVec4A::FALSE
    } else {
        BVec4A::from_array(places.map(|place| place & FLAT != 0))
    }
}

/// 0 to `len`, or the other way round.
fn ordered(len: usize, reversed: bool) -> impl Iterator<Item = usize> {
    (0..len).map(move |at| if reversed { len - 1 - at } else { at })
}
