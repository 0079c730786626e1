//! One object on the picture: which voxel, how deep, which normal, in every pixel.

use glam::{BVec4A, Vec3, Vec4};
use rayon::prelude::*;

use super::camera::Camera;
use super::compose::Object;
use super::shade::{Paint, Shader};
use super::splat::{Eye, QUAD, Splat};
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
    /// Falls to 0 at the edge of what is drawn, in proportion to the distance.
    pub inside: Vec<f32>,
    /// A larger jump of depth between pixels is an edge, mm.
    pub edge_mm: f32,
}

/// The part of a layer that one worker fills: whole rows.
struct Band<'a> {
    first: usize,
    rgba: &'a mut [[f32; 4]],
    depth: &'a mut [f32],
    place: &'a mut [u32],
    inside: &'a mut [f32],
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
            inside: vec![0.0; pixels],
            edge_mm: 1.5 * spacing + 4.0 * camera.mm_per_pixel() as f32,
        };
        let painter = Painter {
            object,
            eye: Eye::new(camera, object.surface),
            shader: Shader::new(object.opacity),
            size,
            blend_mm: spacing,
        };
        let len = BAND * size;
        let bands = (
            layer.rgba.par_chunks_mut(len),
            layer.depth.par_chunks_mut(len),
            layer.place.par_chunks_mut(len),
            layer.inside.par_chunks_mut(len),
        );
        bands
            .into_par_iter()
            .enumerate()
            .for_each(|(number, (rgba, depth, place, inside))| {
                painter.paint(Band {
                    first: number * BAND,
                    rgba,
                    depth,
                    place,
                    inside,
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
}

/// Four pixels of the first pass: the foremost disc.
#[derive(Debug, Clone, Copy)]
struct Front {
    depth: Vec4,
    place: [u32; QUAD],
}

/// Four pixels of the second pass: sums of weighted normals and values, and of weights.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    x: Vec4,
    y: Vec4,
    z: Vec4,
    weight: Vec4,
    value: Vec4,
}

/// The middles of a quad's pixels from the first one's left edge.
const MIDDLES: Vec4 = Vec4::new(0.5, 1.5, 2.5, 3.5);

impl Painter<'_> {
    fn paint(&self, band: Band<'_>) {
        let height = band.depth.len() / self.size;
        let splats = self.splats(band.first, height);
        let fronts = self.fronts(&splats, band.first, height);
        let sums = self.sums(&splats, &fronts, band.first, height);
        let quads = self.size.div_ceil(QUAD);
        for pixel in 0..band.depth.len() {
            let (row, column) = (pixel / self.size, pixel % self.size);
            let (quad, lane) = (row * quads + column / QUAD, column % QUAD);
            let front = &fronts[quad];
            let place = front.place[lane];
            if place == NOTHING {
                continue;
            }
            let sum = &sums[quad];
            let normal = Vec3::new(sum.x[lane], sum.y[lane], sum.z[lane]).normalize_or(Vec3::Z);
            let weight = sum.weight[lane];
            let value = if weight > 0.0 { sum.value[lane] / weight } else { 0.0 };
            let cut = self.is_cut(place);
            band.rgba[pixel] = self.shader.shade(&self.object.paint, normal, value, cut);
            band.depth[pixel] = front.depth[lane];
            band.place[pixel] = place;
            band.inside[pixel] = weight.sqrt();
        }
    }

    /// The foremost disc of every pixel of a band; of equally deep ones the first drawn.
    fn fronts(&self, splats: &[Splat], first: usize, height: usize) -> Vec<Front> {
        let quads = self.size.div_ceil(QUAD);
        let nothing = Front {
            depth: Vec4::NEG_INFINITY,
            place: [NOTHING; QUAD],
        };
        let mut fronts = vec![nothing; quads * height];
        for splat in splats {
            let (begin, end) = splat.rows(first + height);
            for row in begin.max(first)..end {
                let line = Line::new(splat, row);
                let (from, to) = splat.quads(row);
                let base = (row - first) * quads;
                let Some(fronts) = fronts.get_mut(base + from..base + to.min(quads)) else {
                    continue;
                };
                for (quad, front) in fronts.iter_mut().enumerate() {
                    let dx = line.dx(from + quad);
                    let z = line.depth(dx);
                    let mut hit = line.q(dx).cmplt(Vec4::ONE) & z.cmpgt(front.depth);
                    if splat.clips.is_some() {
                        hit &= line.kept(dx);
                    }
                    front.depth = Vec4::select(hit, z, front.depth);
                    let hit = hit.bitmask();
                    for (lane, place) in front.place.iter_mut().enumerate() {
                        *place = if hit >> lane & 1 == 1 { splat.place } else { *place };
                    }
                }
            }
        }
        fronts
    }

    /// The weighted sums over the discs at the depth of the foremost.
    fn sums(&self, splats: &[Splat], fronts: &[Front], first: usize, height: usize) -> Vec<Sums> {
        let quads = self.size.div_ceil(QUAD);
        let hidden = Hidden::new(fronts, quads, height);
        let mut all = vec![Sums::default(); fronts.len()];
        for splat in splats {
            if hidden.hides(splat, first, self.blend_mm) {
                continue;
            }
            let [nx, ny, nz] = splat.normal.to_array().map(Vec4::splat);
            let value = Vec4::splat(self.scalar(splat.place));
            let (begin, end) = splat.rows(first + height);
            for row in begin.max(first)..end {
                let line = Line::new(splat, row);
                let (from, to) = splat.quads(row);
                let base = (row - first) * quads;
                let range = base + from..base + to.min(quads);
                let (Some(fronts), Some(sums)) = (fronts.get(range.clone()), all.get_mut(range))
                else {
                    continue;
                };
                for (quad, (front, sum)) in fronts.iter().zip(sums).enumerate() {
                    let dx = line.dx(from + quad);
                    let near = line.depth(dx) + Vec4::splat(self.blend_mm);
                    let falling = (Vec4::ONE - line.q(dx)).max(Vec4::ZERO);
                    let weight = Vec4::select(near.cmpge(front.depth), falling * falling, Vec4::ZERO);
                    sum.x += weight * nx;
                    sum.y += weight * ny;
                    sum.z += weight * nz;
                    sum.weight += weight;
                    sum.value += weight * value;
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
                let value = values.get(place as usize).copied().unwrap_or(0.0);
                if value.is_finite() { value } else { 0.0 }
            }
        }
    }

    fn is_cut(&self, place: u32) -> bool {
        let voxels = self.object.surface.voxels();
        voxels
            .get(place as usize)
            .is_some_and(|voxel| voxel.code().is_cut())
    }

    /// What the voxels draw that reach into `height` rows from `first`, those near the viewer first as the
    /// octant of the viewing direction has it.
    fn splats(&self, first: usize, height: usize) -> Vec<Splat> {
        let surface = self.object.surface;
        let [_, ny, nz] = surface.grid().dims();
        let [flip_x, flip_y, flip_z] = self.eye.reversed();
        let reach = self.eye.reach(surface);
        let (top, bottom) = (first as f32 - reach, (first + height) as f32 + reach);
        let mut splats = Vec::new();
        for z in ordered(nz, flip_z) {
            for y in ordered(ny, flip_y) {
                self.row(surface, [y, z], flip_x, [top, bottom], &mut splats);
            }
        }
        splats.retain(|splat| {
            let (begin, end) = splat.rows(first + height);
            begin.max(first) < end
        });
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
            to.extend(self.eye.splat(voxel, index, at, place));
        }
    }
}

/// A disc on one row of pixels.
struct Line {
    x: Vec4,
    a: Vec4,
    b: Vec4,
    c: Vec4,
    z: Vec4,
    zx: Vec4,
    clips: [[f32; 3]; 2],
    dy: f32,
}

impl Line {
    #[inline]
    fn new(splat: &Splat, row: usize) -> Self {
        let dy = row as f32 + 0.5 - splat.y;
        Self {
            x: MIDDLES - Vec4::splat(splat.x),
            a: Vec4::splat(splat.a),
            b: Vec4::splat(2.0 * splat.b * dy),
            c: Vec4::splat(splat.c * dy * dy),
            z: Vec4::splat(splat.z + splat.zy * dy),
            zx: Vec4::splat(splat.zx),
            clips: splat.clips.unwrap_or_default(),
            dy,
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

    /// The pixels that the end of what is drawn leaves.
    fn kept(&self, dx: Vec4) -> BVec4A {
        let [a, b] = self.clips.map(|[k, kx, ky]| {
            (Vec4::splat(k + ky * self.dy) + Vec4::splat(kx) * dx).cmpge(Vec4::ZERO)
        });
        a & b
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
    fn new(fronts: &[Front], quads: usize, height: usize) -> Self {
        let quads_of_square = SQUARE / QUAD;
        let across = quads.div_ceil(quads_of_square);
        let down = height.div_ceil(SQUARE);
        let mut furthest = vec![f32::INFINITY; across * down];
        for (place, front) in fronts.iter().enumerate() {
            let (row, quad) = (place / quads, place % quads);
            let square = row / SQUARE * across + quad / quads_of_square;
            furthest[square] = furthest[square].min(front.depth.min_element());
        }
        Self {
            furthest,
            across,
            down,
        }
    }

    fn hides(&self, splat: &Splat, first: usize, blend_mm: f32) -> bool {
        let nearest = splat.z
            + splat.zx.abs() * splat.half_width
            + splat.zy.abs() * splat.half_height
            + blend_mm;
        let square = |at: f32, last: usize| ((at.max(0.0) as usize) / SQUARE).min(last);
        let y = splat.y - first as f32;
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
