//! One object on the picture: which voxel, how deep, which normal, in every pixel.

use std::cell::Cell;

use glam::Vec3;
use rayon::prelude::*;

use super::camera::Camera;
use super::compose::Object;
use super::edge::{Edges, FindEdges, SampleEdges};
use super::shade::{BACKGROUND, Eight, LAID_OPEN, Normals, Paint, SURFACE, Shader};
use super::span::{Blend, Drawn, Fronts, NORMALS, NOTHING, Span, WIDE, WITH_VALUES, wide};
use super::splat::{Eye, FLAT, QUAD, Splats};
use super::squares::{Hide, Squares};
use crate::simd::{Kernel, Simd};
use crate::surface::SemiBoundary;

/// The most rows of a picture that are drawn at a time: more do not stay in a core's cache. With fewer, more discs are drawn
/// in two bands.
const MOST_ROWS: usize = 96;

/// Rows of a picture of `size` rows that are drawn at a time: as many bands as are done in as few rounds as there can be. What
/// is drawn is the same for any number.
pub(super) fn band_rows(size: usize) -> usize {
    let threads = rayon::current_num_threads();
    let rounds = size.div_ceil(threads.saturating_mul(MOST_ROWS));
    size.div_ceil(threads.saturating_mul(rounds)).max(1)
}

/// Which voxel is at every pixel, and how deep.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// Towards the viewer, mm; -∞ where nothing is.
    pub depth: Vec<f32>,
    /// Place in the semi-boundary of the foremost disc, or [`NOTHING`].
    pub place: Vec<u32>,
}

impl Seen {
    pub(super) fn new(size: usize) -> Self {
        // Zeroes cost nothing until they are written over.
        Self {
            depth: vec![0.0; size * size],
            place: vec![0; size * size],
        }
    }
}

/// Where the colours of a band go.
pub(super) enum Colours<'a> {
    /// Onto the picture: of an opaque object that is alone.
    Picture(&'a mut [[u8; 3]]),
    /// sRGB and opacity of 255, to be put over or under others'.
    Layer(&'a mut [[u8; 4]]),
}

/// A pixel at an edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgePixel {
    pub pixel: u32,
    /// How many of its samples belong to what is on the near side of the edge.
    pub near: u8,
}

/// The part of a layer that one worker fills: whole rows.
pub(super) struct Band<'a> {
    pub first: usize,
    pub colours: Colours<'a>,
    pub depth: &'a mut [f32],
    pub place: &'a mut [u32],
    pub edges: &'a mut Vec<EdgePixel>,
}

/// What a worker needs for a band. It is kept for the next one, and for the next picture: to get memory from the system
/// takes longer than to draw into it.
#[derive(Debug, Default)]
struct Desk {
    splats: Splats,
    drawn: Drawn,
    furthest: Squares<f32>,
    edges: Edges,
}

thread_local! {
    static DESK: Cell<Option<Box<Desk>>> = const { Cell::new(None) };
}

pub(super) struct Painter<'a> {
    object: &'a Object<'a>,
    eye: Eye,
    /// Near the viewer first, as their rows, as the octant of the viewing direction has it.
    planes: Vec<Plane>,
    shader: Shader,
    size: usize,
    /// Discs within this depth of the foremost belong to the same surface.
    blend_mm: f32,
    /// A larger jump of depth between pixels is an edge.
    edge_mm: f32,
}

/// The rows of the semi-boundary that have one z and any voxels, on the picture.
#[derive(Debug)]
struct Plane {
    rows: Vec<Row>,
    /// From where to where their voxels reach, pixels from the top.
    top: f32,
    bottom: f32,
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

/// Makes the discs that reach into a span.
struct Gather<'a, 'b> {
    painter: &'a Painter<'b>,
    splats: &'a mut Splats,
    span: Span,
}

impl Kernel for Gather<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.painter.gather(self.span, self.splats);
    }
}

/// Shades what was drawn into a band.
struct Fill<'a, 'b, const PLANES: usize> {
    painter: &'a Painter<'b>,
    band: Band<'a>,
    span: Span,
    drawn: &'a Drawn,
}

impl<const PLANES: usize> Kernel for Fill<'_, '_, PLANES> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.painter
            .fill::<PLANES>(self.band, self.span, self.drawn);
    }
}

impl<'a> Painter<'a> {
    pub(super) fn new(object: &'a Object<'a>, camera: &Camera) -> Self {
        let spacing = object.surface.grid().spacing().max_element() as f32;
        let eye = Eye::new(camera, object.surface);
        Self {
            object,
            planes: planes(object.surface, &eye),
            eye,
            shader: Shader::new(object.opacity),
            size: camera.size(),
            blend_mm: spacing,
            edge_mm: 1.5 * spacing + 4.0 * camera.mm_per_pixel() as f32,
        }
    }

    /// Paints a band, with the widest instructions that there are.
    pub(super) fn paint(&self, band: Band<'_>) {
        let mut desk = DESK.take().unwrap_or_default();
        self.paint_on(&mut desk, band);
        DESK.set(Some(desk));
    }

    fn paint_on(&self, desk: &mut Desk, band: Band<'_>) {
        let simd = Simd::widest();
        let span = Span {
            first: band.first as isize - 1,
            rows: band.depth.len() / self.size + 2,
            quads: self.size.div_ceil(QUAD),
        };
        let Desk {
            splats,
            drawn,
            furthest,
            edges,
        } = desk;
        simd.run(Gather {
            painter: self,
            splats,
            span,
        });
        simd.run(Fronts {
            drawn,
            splats,
            span,
        });
        // Discs within this depth of the foremost are what is seen where that has next to no weight.
        let faint_mm = 3.0 * self.blend_mm;
        simd.run(Hide {
            furthest,
            drawn,
            splats,
            span,
            reach_mm: faint_mm,
        });
        match self.object.paint {
            Paint::Plain(_) => simd.run(Blend::<_, NORMALS> {
                drawn,
                splats,
                span,
                blend_mm: self.blend_mm,
                faint_mm,
                value: |_| 0.0,
            }),
            Paint::Scalar { .. } => simd.run(Blend::<_, WITH_VALUES> {
                drawn,
                splats,
                span,
                blend_mm: self.blend_mm,
                faint_mm,
                value: |place| self.scalar(place),
            }),
        }
        simd.run(FindEdges {
            edges,
            drawn,
            span,
            height: self.size,
            jump_mm: self.edge_mm,
        });
        simd.run(SampleEdges {
            edges,
            splats,
            span,
        });
        band.edges.clear();
        for edge in &edges.quads {
            let row = (band.first + edge.row - 1) * self.size;
            // The last quad of a row may reach beyond it.
            let pixels = edge.pixels().filter(|&(column, _)| column < self.size);
            band.edges.extend(pixels.map(|(column, near)| EdgePixel {
                pixel: (row + column) as u32,
                near,
            }));
        }
        match self.object.paint {
            Paint::Plain(_) => simd.run(Fill::<NORMALS> {
                painter: self,
                band,
                span,
                drawn,
            }),
            Paint::Scalar { .. } => simd.run(Fill::<WITH_VALUES> {
                painter: self,
                band,
                span,
                drawn,
            }),
        }
    }

    /// Shades what was drawn into a band.
    #[inline(always)]
    fn fill<const PLANES: usize>(&self, band: Band<'_>, span: Span, drawn: &Drawn) {
        let size = self.size;
        let mut colours = band.colours;
        let plain = match self.object.paint {
            Paint::Plain(colour) => self.shader.linear(&[colour; WIDE]),
            Paint::Scalar { .. } => [[0.0; WIDE]; 3],
        };
        let rows = band.depth.chunks_mut(size).zip(band.place.chunks_mut(size));
        for (number, (depth, place)) in rows.enumerate() {
            let begin = span.begin(number + 1);
            let places = &drawn.place[begin..begin + size];
            depth.copy_from_slice(&drawn.depth[begin..begin + size]);
            for (to, &from) in place.iter_mut().zip(places) {
                *to = if from == NOTHING { from } else { from & !FLAT };
            }
            let sums = (number + 1) * span.stride() * PLANES + WIDE;
            for first in (0..size).step_by(WIDE) {
                let Some(places) = wide(&drawn.place, begin + first) else {
                    continue;
                };
                let pixels = number * size + first..number * size + (first + WIDE).min(size);
                // It is the largest number, with all bits set.
                let (mut bits, mut any_nothing) = (NOTHING, false);
                for &place in places {
                    bits &= place;
                    any_nothing |= place == NOTHING;
                }
                if bits == NOTHING {
                    match &mut colours {
                        Colours::Picture(picture) => picture[pixels].fill(BACKGROUND),
                        Colours::Layer(layer) => layer[pixels].fill([0; 4]),
                    }
                    continue;
                }
                let shaded =
                    self.shaded::<PLANES>(places, &plain, drawn, sums + first, span.stride());
                match &mut colours {
                    Colours::Picture(picture) => {
                        let picture = &mut picture[pixels];
                        for (pixel, [r, g, b, _]) in picture.iter_mut().zip(shaded) {
                            *pixel = [r, g, b];
                        }
                        if any_nothing {
                            let lanes = picture.iter_mut().zip(places);
                            for (pixel, _) in lanes.filter(|(_, place)| **place == NOTHING) {
                                *pixel = BACKGROUND;
                            }
                        }
                    }
                    Colours::Layer(layer) => {
                        for (lane, pixel) in layer[pixels].iter_mut().enumerate() {
                            let is_nothing = places[lane] == NOTHING;
                            *pixel = if is_nothing { [0; 4] } else { shaded[lane] };
                        }
                    }
                }
            }
        }
    }

    /// The colours of pixels whose sums begin at a place.
    #[inline(always)]
    fn shaded<const PLANES: usize>(
        &self,
        places: &[u32; WIDE],
        plain: &[[f32; WIDE]; 3],
        drawn: &Drawn,
        at: usize,
        stride: usize,
    ) -> [[u8; 4]; WIDE] {
        let mut sums = [[0.0; WIDE]; PLANES];
        for (plane, sums) in sums.iter_mut().enumerate() {
            if let Some(found) = wide(&drawn.sums, at + plane * stride) {
                *sums = *found;
            }
        }
        let mut colours = *plain;
        if let (WITH_VALUES, Paint::Scalar { colour, .. }) = (PLANES, &self.object.paint) {
            let mut lanes = [[0; 3]; WIDE];
            for (lane, to) in lanes.iter_mut().enumerate() {
                let (weight, sum) = (sums[NORMALS][lane], sums[NORMALS + 1][lane]);
                *to = colour(if weight > 0.0 { sum / weight } else { 0.0 });
            }
            colours = self.shader.linear(&lanes);
        }
        let (mut light, mut gloss) = ([SURFACE.0; WIDE], [SURFACE.1; WIDE]);
        for lane in 0..WIDE {
            if places[lane] & FLAT != 0 {
                (light[lane], gloss[lane]) = LAID_OPEN;
            }
        }
        self.shader.shade(
            &colours,
            &Eight {
                normals: Normals {
                    x: sums[0],
                    y: sums[1],
                    z: sums[2],
                },
                light,
                gloss,
            },
        )
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
    fn gather(&self, span: Span, splats: &mut Splats) {
        let surface = self.object.surface;
        let reach = self.eye.reach(surface);
        let (first, last) = (span.first as f32, (span.first + span.rows as isize) as f32);
        let (top, bottom) = (first - reach, last + reach);
        let [flip, _, _] = self.eye.reversed();
        let step = self.eye.along_row();
        splats.clear(span.first..span.first + span.rows as isize);
        let is_near = |rows_top: f32, rows_bottom: f32| rows_bottom >= top && rows_top <= bottom;
        let planes = self.planes.iter();
        let planes = planes.filter(|plane| is_near(plane.top, plane.bottom));
        for row in planes.flat_map(|plane| &plane.rows) {
            if !is_near(row.top, row.bottom) {
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
                self.eye.splats(voxel, index, at, place, splats);
            }
        }
        self.eye.flush(splats);
    }
}

/// The planes of the semi-boundary.
fn planes(surface: &SemiBoundary, eye: &Eye) -> Vec<Plane> {
    let [_, ny, nz] = surface.grid().dims();
    let [_, flip_y, flip_z] = eye.reversed();
    let step = eye.along_row();
    let plane = |at: usize| {
        let z = if flip_z { nz - 1 - at } else { at };
        let rows = ordered(ny, flip_y).filter_map(|y| {
            let range = surface.row_range(y, z);
            let voxels = surface.voxels().get(range.clone())?;
            let origin = eye.row(y, z);
            let [a, b] =
                [voxels.first()?, voxels.last()?].map(|voxel| origin.y + step.y * voxel.x() as f32);
            Some(Row {
                // A grid has at most 32767 voxels along an axis, and places have 31 bits.
                y: y as u16,
                z: z as u16,
                begin: range.start as u32,
                end: range.end as u32,
                origin,
                top: a.min(b),
                bottom: a.max(b),
            })
        });
        let rows: Vec<Row> = rows.collect();
        Plane {
            top: rows.iter().fold(f32::INFINITY, |top, row| top.min(row.top)),
            bottom: (rows.iter()).fold(f32::NEG_INFINITY, |bottom, row| bottom.max(row.bottom)),
            rows,
        }
    };
    (0..nz).into_par_iter().map(plane).collect()
}

/// 0 to `len`, or the other way round.
fn ordered(len: usize, reversed: bool) -> impl Iterator<Item = usize> {
    (0..len).map(move |at| if reversed { len - 1 - at } else { at })
}
