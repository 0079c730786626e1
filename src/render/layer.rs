//! One object on the picture: which voxel, how deep, which normal, in every pixel.

use glam::{BVec4A, Vec3, Vec4};
use rayon::prelude::*;

use super::camera::Camera;
use super::compose::Object;
use super::shade::{Paint, Shader};
use super::splat::{Clips, Eye, FLAT, QUAD, Splat};
use crate::surface::SemiBoundary;

/// Rows of a picture that are drawn at a time: small enough for a core's cache.
const BAND: usize = 64;
/// No voxel is at this pixel.
pub(super) const NOTHING: u32 = u32::MAX;

/// An object's picture before it is put over another's.
#[derive(Debug)]
pub(super) struct Layer {
    pub size: usize,
    /// Linear colour times opacity, and opacity.
    pub rgba: Vec<[f32; 4]>,
    /// Towards the viewer, mm; -∞ where nothing is.
    pub depth: Vec<f32>,
    /// Place in the semi-boundary of the foremost disc, or [`NOTHING`].
    pub place: Vec<u32>,
    /// In pixels at an edge, the share that belongs to what is on the near side of it; else [`NO_EDGE`].
    pub near: Vec<f32>,
}

/// A pixel that no edge passes.
pub(super) const NO_EDGE: f32 = -1.0;

/// The depths on the two sides of an edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    /// What is at least this deep is on the near side, mm.
    pub between: f32,
}

impl Edge {
    /// The edge that passes a pixel of this depth, whose neighbours have those: where one differs by
    /// more than `jump_mm`.
    #[inline]
    pub(super) fn at(depth: f32, neighbours: [f32; 4], jump_mm: f32) -> Option<Self> {
        let near = neighbours.iter().fold(depth, |near, &z| near.max(z));
        let far = neighbours.iter().fold(depth, |far, &z| far.min(z));
        if far == f32::NEG_INFINITY {
            let seen = near > far;
            return seen.then_some(Self { between: f32::MIN });
        }
        (near - far > jump_mm).then_some(Self {
            between: (near + far) / 2.0,
        })
    }
}

/// The part of a layer that one worker fills: whole rows.
struct Band<'a> {
    first: usize,
    rgba: &'a mut [[f32; 4]],
    depth: &'a mut [f32],
    place: &'a mut [u32],
    near: &'a mut [f32],
}

impl Layer {
    pub(super) fn new(object: &Object<'_>, camera: &Camera) -> Self {
        let size = camera.size();
        let pixels = size * size;
        let spacing = object.surface.grid().spacing().max_element() as f32;
        let mut layer = Self {
            size,
            rgba: vec![[0.0; 4]; pixels],
            depth: vec![f32::NEG_INFINITY; pixels],
            place: vec![NOTHING; pixels],
            near: vec![NO_EDGE; pixels],
        };
        let painter = Painter {
            object,
            eye: Eye::new(camera, object.surface),
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
                painter.paint(Band {
                    first: number * BAND,
                    rgba,
                    depth,
                    place,
                    near,
                });
            });
        layer
    }
}

struct Painter<'a> {
    object: &'a Object<'a>,
    eye: Eye,
    shader: Shader,
    size: usize,
    /// Discs within this depth of the foremost belong to the same surface.
    blend_mm: f32,
    /// A larger jump of depth between pixels is an edge.
    edge_mm: f32,
}

/// A band with a row more on either side, so that the edges at its rim are seen.
#[derive(Debug, Clone, Copy)]
struct Span {
    /// First row; may be the one above the picture.
    first: isize,
    rows: usize,
    quads: usize,
}

impl Span {
    /// The rows that a splat covers, counted from the span's first.
    fn rows_of(self, splat: &Splat) -> std::ops::Range<usize> {
        let (begin, end) = splat.rows();
        let row = |row: isize| (row - self.first).clamp(0, self.rows as isize) as usize;
        row(begin)..row(end)
    }

    /// The quads of a row that a splat covers, as places in a buffer of the span; and the first's number in
    /// its row.
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
const SAMPLES: [[f32; 2]; 4] = [
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

    fn place(&self, lane: usize) -> u32 {
        self.place[lane].to_bits()
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

/// The middles of a quad's pixels from the first one's left edge.
const MIDDLES: Vec4 = Vec4::new(0.5, 1.5, 2.5, 3.5);

impl Painter<'_> {
    fn paint(&self, band: Band<'_>) {
        let height = band.depth.len() / self.size;
        let span = Span {
            first: band.first as isize - 1,
            rows: height + 2,
            quads: self.size.div_ceil(QUAD),
        };
        let mut splats = self.splats(span);
        let fronts = self.fronts(&splats, span);
        let hidden = Hidden::new(&fronts, span);
        splats.retain(|splat| !hidden.hides(splat, span, self.blend_mm));
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
        for pixel in 0..band.depth.len() {
            let (row, column) = (pixel / self.size + 1, pixel % self.size);
            let (quad, lane) = (row * span.quads + column / QUAD, column % QUAD);
            let numbered = edges.of_quad.get(quad).filter(|&&number| number != NOTHING);
            if let Some(&number) = numbered {
                band.near[pixel] = edges.share(number as usize, lane, &samples);
            }
            let front = &fronts[quad];
            let place = front.place(lane);
            if place == NOTHING {
                continue;
            }
            let sum = &sums[quad];
            let normal = Vec3::new(sum.x[lane], sum.y[lane], sum.z[lane]).normalize_or(Vec3::Z);
            let weight = sum.weight[lane];
            let value = match values.get(quad) {
                Some(sum) if weight > 0.0 => sum[lane] / weight,
                _ => 0.0,
            };
            let cut = place & FLAT != 0;
            band.rgba[pixel] = self.shader.shade(&self.object.paint, normal, value, cut);
            band.depth[pixel] = front.depth[lane];
            band.place[pixel] = place & !FLAT;
        }
    }

    /// The foremost disc of every pixel; of equally deep ones the first drawn.
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
    #[inline]
    fn blend(
        &self,
        splats: &[Splat],
        fronts: &[Front],
        span: Span,
        mut add: impl FnMut(usize, &Splat, Vec4),
    ) {
        let blend_mm = Vec4::splat(self.blend_mm);
        for splat in splats {
            for row in span.rows_of(splat) {
                let line = Line::new(splat, span.first + row as isize);
                let (range, from) = span.quads_of(&line, row);
                let begin = range.start;
                let Some(fronts) = fronts.get(range) else {
                    continue;
                };
                for (quad, front) in fronts.iter().enumerate() {
                    let dx = line.dx(from + quad);
                    let near = line.depth(dx) + blend_mm;
                    let falling = (Vec4::ONE - line.q(dx)).max(Vec4::ZERO);
                    let weight =
                        Vec4::select(near.cmpge(front.depth), falling * falling, Vec4::ZERO);
                    add(begin + quad, splat, weight);
                }
            }
        }
    }

    /// The quads that hold a pixel at an edge of depth.
    fn edges(&self, fronts: &[Front], span: Span) -> Edges {
        let depth = |row: usize, column: Option<usize>| {
            let column = column.filter(|&column| column < self.size);
            column.map(|column| fronts[row * span.quads + column / QUAD].depth[column % QUAD])
        };
        let mut edges = Edges {
            of_quad: vec![NOTHING; span.len()],
            between: Vec::new(),
        };
        for row in 1..span.rows - 1 {
            let line = row * span.quads;
            for quad in 0..span.quads {
                let here = fronts[line + quad].depth;
                let mut between = [None; QUAD];
                for (lane, between) in between.iter_mut().enumerate() {
                    let column = quad * QUAD + lane;
                    if column >= self.size {
                        break;
                    }
                    let z = here[lane];
                    let beside = |column| depth(row, column).unwrap_or(z);
                    let neighbours = [
                        beside(column.checked_sub(1)),
                        beside(Some(column + 1)),
                        self.row_beside(span, row - 1)
                            .map_or(z, |row| depth(row, Some(column)).unwrap_or(z)),
                        self.row_beside(span, row + 1)
                            .map_or(z, |row| depth(row, Some(column)).unwrap_or(z)),
                    ];
                    *between = Edge::at(z, neighbours, self.edge_mm).map(|edge| edge.between);
                }
                if between.iter().any(Option::is_some) {
                    edges.of_quad[line + quad] = edges.between.len() as u32;
                    edges.between.push(between);
                }
            }
        }
        edges
    }

    /// A row of a span, if it is one of the picture.
    fn row_beside(&self, span: Span, row: usize) -> Option<usize> {
        let of_picture = span.first + row as isize;
        (0..self.size as isize).contains(&of_picture).then_some(row)
    }

    /// Depth at the samples of the pixels of the quads at edges.
    fn samples(&self, splats: &[Splat], edges: &Edges, span: Span) -> Vec<[Vec4; SAMPLES.len()]> {
        let mut all = vec![[Vec4::NEG_INFINITY; SAMPLES.len()]; edges.between.len()];
        if all.is_empty() {
            return all;
        }
        for splat in splats {
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
    fn scalar(&self, place: u32) -> f32 {
        match &self.object.paint {
            Paint::Plain(_) => 0.0,
            Paint::Scalar { values, .. } => {
                let value = values.get((place & !FLAT) as usize).copied().unwrap_or(0.0);
                if value.is_finite() { value } else { 0.0 }
            }
        }
    }

    /// What the voxels draw that reach into a span, those near the viewer first as the octant of the
    /// viewing direction has it.
    fn splats(&self, span: Span) -> Vec<Splat> {
        let surface = self.object.surface;
        let [_, ny, nz] = surface.grid().dims();
        let [flip_x, flip_y, flip_z] = self.eye.reversed();
        let reach = self.eye.reach(surface);
        let top = span.first as f32 - reach;
        let bottom = (span.first + span.rows as isize) as f32 + reach;
        let mut splats = Vec::new();
        for z in ordered(nz, flip_z) {
            for y in ordered(ny, flip_y) {
                self.row(surface, [y, z], flip_x, [top, bottom], &mut splats);
            }
        }
        splats.retain(|splat| !span.rows_of(splat).is_empty());
        splats
    }

    fn row(
        &self,
        surface: &SemiBoundary,
        [y, z]: [usize; 2],
        flip: bool,
        [top, bottom]: [f32; 2],
        to: &mut Vec<Splat>,
    ) {
        let range = surface.row_range(y, z);
        let Some(voxels) = surface.voxels().get(range.clone()) else {
            return;
        };
        let (Some(head), Some(tail)) = (voxels.first(), voxels.last()) else {
            return;
        };
        let origin = self.eye.row(y, z);
        let step = self.eye.along_row();
        let ends = [head, tail].map(|voxel| origin.y + step.y * voxel.x() as f32);
        if ends[0].max(ends[1]) < top || ends[0].min(ends[1]) > bottom {
            return;
        }
        for number in ordered(voxels.len(), flip) {
            let voxel = voxels[number];
            let at = origin + step * voxel.x() as f32;
            if at.y < top || at.y > bottom {
                continue;
            }
            let index = [voxel.x(), y, z];
            let place = (range.start + number) as u32;
            self.eye.splats(voxel, index, at, place, to);
        }
    }
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
    /// The share of a pixel's samples on the near side, or [`NO_EDGE`].
    fn share(&self, number: usize, lane: usize, samples: &[[Vec4; SAMPLES.len()]]) -> f32 {
        let (Some(between), Some(samples)) = (self.between.get(number), samples.get(number)) else {
            return NO_EDGE;
        };
        let Some(between) = between[lane] else {
            return NO_EDGE;
        };
        let near = samples.iter().filter(|depth| depth[lane] >= between);
        near.count() as f32 / SAMPLES.len() as f32
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
    /// From where to where the disc reaches, pixels; may be beyond the picture.
    reach: (f32, f32),
}

impl Line {
    #[inline]
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
            reach: splat.reach(dy),
        }
    }

    /// The same, moved by a part of a pixel to the right and down.
    #[inline]
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
    #[inline]
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
    #[inline]
    fn dx(&self, quad: usize) -> Vec4 {
        self.x + Vec4::splat((quad * QUAD) as f32)
    }

    #[inline]
    fn q(&self, dx: Vec4) -> Vec4 {
        dx * (self.a * dx + self.b) + self.c
    }

    #[inline]
    fn depth(&self, dx: Vec4) -> Vec4 {
        self.z + self.zx * dx
    }

    /// The pixels that the disc covers.
    #[inline]
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

/// Rows and quads of the squares in which [`Hidden`] looks at a band.
const SQUARE: usize = 8;

/// The furthest depth in each square of a band: a disc that is behind it everywhere adds nothing.
struct Hidden {
    furthest: Vec<f32>,
    across: usize,
    down: usize,
}

impl Hidden {
    fn new(fronts: &[Front], span: Span) -> Self {
        let quads_of_square = SQUARE / QUAD;
        let across = span.quads.div_ceil(quads_of_square);
        let down = span.rows.div_ceil(SQUARE);
        let mut furthest = vec![f32::INFINITY; across * down];
        for (place, front) in fronts.iter().enumerate() {
            let (row, quad) = (place / span.quads, place % span.quads);
            let square = row / SQUARE * across + quad / quads_of_square;
            furthest[square] = furthest[square].min(front.depth.min_element());
        }
        Self {
            furthest,
            across,
            down,
        }
    }

    fn hides(&self, splat: &Splat, span: Span, blend_mm: f32) -> bool {
        let nearest = splat.z
            + splat.zx.abs() * splat.half_width
            + splat.zy.abs() * splat.half_height
            + blend_mm;
        let square = |at: f32, last: usize| ((at.max(0.0) as usize) / SQUARE).min(last);
        let y = splat.y - span.first as f32;
        let (top, bottom) = (
            square(y - splat.half_height, self.down - 1),
            square(y + splat.half_height, self.down - 1),
        );
        let (left, right) = (
            square(splat.x - splat.half_width, self.across - 1),
            square(splat.x + splat.half_width, self.across - 1),
        );
        (top..=bottom).all(|row| {
            let squares = row * self.across + left..=row * self.across + right;
            self.furthest[squares].iter().all(|&depth| nearest < depth)
        })
    }
}

/// 0 to `len`, or the other way round.
fn ordered(len: usize, reversed: bool) -> impl Iterator<Item = usize> {
    (0..len).map(move |at| if reversed { len - 1 - at } else { at })
}
