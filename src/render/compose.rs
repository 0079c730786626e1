//! Objects put over each other, with smooth edges: the picture.

use std::mem;

use rayon::prelude::*;

use super::camera::Camera;
use super::edge::SAMPLES;
use super::layer::{Band, Colours, EdgePixel, Painter, Seen, band_rows};
use super::memory::Sheet;
use super::shade::{BACKGROUND, Paint, Srgb};
use super::span::NOTHING;
use crate::surface::SemiBoundary;

/// Something to draw.
#[derive(Debug, Clone, Copy)]
pub struct Object<'a> {
    /// Its surface.
    pub surface: &'a SemiBoundary,
    /// Its colour.
    pub paint: Paint<'a>,
    /// Above 0; 1 hides what is behind it.
    pub opacity: f64,
}

/// What is at a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Place of the object in what was drawn.
    pub object: usize,
    /// Place of the voxel in the object's semi-boundary.
    pub place: usize,
    /// Index of the voxel, x, y, z.
    pub voxel: [usize; 3],
    /// Depth of the surface at the pixel's centre, mm towards the viewer from the camera's centre.
    pub depth_mm: f64,
}

/// A picture, and what it shows where.
#[derive(Debug)]
pub struct Frame<'a> {
    size: usize,
    pixels: Vec<[u8; 3]>,
    objects: Vec<Object<'a>>,
    /// For each object.
    seen: Vec<Seen>,
}

/// Draws objects as a camera sees them.
pub fn render<'a>(objects: &[Object<'a>], camera: &Camera) -> Frame<'a> {
    let size = camera.size();
    let Sheet {
        mut pixels,
        mut seen,
    } = Sheet::take(size);
    let seen = match objects {
        [object] if object.opacity >= 1.0 => {
            alone(object, camera, &mut pixels, &mut seen);
            vec![seen]
        }
        objects => {
            let layers = objects.iter().map(|object| Layer::new(object, camera));
            let layers: Vec<Layer> = layers.collect();
            let lines = pixels.par_chunks_mut(size).enumerate();
            lines.for_each(|(row, line)| match &layers[..] {
                [layer] => layer.show(row, line),
                layers => show(layers, row, line),
            });
            layers.into_iter().map(|layer| layer.seen).collect()
        }
    };
    Frame {
        size,
        pixels,
        objects: objects.to_vec(),
        seen,
    }
}

impl Drop for Frame<'_> {
    fn drop(&mut self) {
        let sheet = Sheet {
            pixels: mem::take(&mut self.pixels),
            seen: mem::take(&mut self.seen).pop().unwrap_or_default(),
        };
        // There is nothing in it where nothing was drawn.
        if sheet.seen.depth.len() == sheet.pixels.len() {
            sheet.give_back();
        }
    }
}

/// Draws an opaque object with nothing before or behind it: straight onto the picture, but for the pixels at edges.
fn alone(object: &Object<'_>, camera: &Camera, pixels: &mut [[u8; 3]], seen: &mut Seen) {
    let size = camera.size();
    let painter = Painter::new(object, camera);
    let rows = band_rows(size);
    let len = rows * size;
    let mut edges = vec![Vec::new(); size.div_ceil(rows)];
    let bands = (
        pixels.par_chunks_mut(len),
        seen.depth.par_chunks_mut(len),
        seen.place.par_chunks_mut(len),
        &mut edges,
    );
    let bands = bands.into_par_iter().enumerate();
    bands.for_each(|(number, (pixels, depth, place, edges))| {
        painter.paint(Band {
            first: number * rows,
            colours: Colours::Picture(pixels),
            depth,
            place,
            edges,
        });
    });
    // The colours beside an edge are those before any edge is smoothed.
    let smooth = |edge: &EdgePixel| {
        let light = |pixel: usize| match seen.place[pixel] {
            NOTHING => [0.0; 4],
            _ => light(pixels[pixel], 1.0),
        };
        over_background(smoothed(seen, size, edge.pixel as usize, edge.near, light))
    };
    let smooth: Vec<Vec<[u8; 3]>> = edges
        .par_iter()
        .map(|edges| edges.iter().map(smooth).collect())
        .collect();
    for (edge, colour) in edges.iter().flatten().zip(smooth.iter().flatten()) {
        pixels[edge.pixel as usize] = *colour;
    }
}

impl Frame<'_> {
    /// Pixels a side.
    pub fn size(&self) -> usize {
        self.size
    }

    /// sRGB, row by row from the top left.
    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// Which voxel is at a pixel (column, row), of the object that is foremost there; `None` where there
    /// is none. This is what clicking on the surface needs.
    ///
    /// It is the voxel whose disc is foremost at the pixel's centre. A disc lies in the plane of the surface
    /// and overlaps its neighbours', so where the surface bulges this can be the voxel beside the one behind
    /// the pixel.
    pub fn pick(&self, column: usize, row: usize) -> Option<Hit> {
        if column >= self.size || row >= self.size {
            return None;
        }
        let pixel = row * self.size + column;
        let hits = self.seen.iter().enumerate();
        let hits = hits.filter(|(_, seen)| seen.place[pixel] != NOTHING);
        let (object, seen) = hits.reduce(|best, next| {
            if next.1.depth[pixel] > best.1.depth[pixel] {
                next
            } else {
                best
            }
        })?;
        let place = seen.place[pixel] as usize;
        Some(Hit {
            object,
            place,
            voxel: self.objects.get(object)?.surface.index(place)?,
            depth_mm: f64::from(seen.depth[pixel]),
        })
    }

    /// Place in its semi-boundary of the voxel that an object, hidden or not, has at a pixel.
    pub fn place_of(&self, object: usize, column: usize, row: usize) -> Option<usize> {
        if column >= self.size || row >= self.size {
            return None;
        }
        let place = self.seen.get(object)?.place[row * self.size + column];
        (place != NOTHING).then_some(place as usize)
    }

    /// How many pixels show something.
    pub fn covered(&self) -> usize {
        let covered = |pixel: &usize| self.seen.iter().any(|seen| seen.place[*pixel] != NOTHING);
        (0..self.size * self.size).filter(covered).count()
    }
}

/// What is drawn later is this much nearer, so that of two objects that a cut lays open in one plane the
/// later is seen, mm.
const LATER_MM: f32 = 0.05;

/// A row of pixels of layers over each other.
fn show(layers: &[Layer], row: usize, line: &mut [[u8; 3]]) {
    let begin = row * line.len();
    for (column, pixel) in line.iter_mut().enumerate() {
        *pixel = if layers.iter().all(|layer| layer.is_empty(begin + column)) {
            BACKGROUND
        } else {
            composed(layers, column, row)
        };
    }
}

/// The layers at a pixel, the nearest on top.
fn composed(layers: &[Layer], column: usize, row: usize) -> [u8; 3] {
    // From the furthest to the nearest; a handful at most.
    let mut order: Vec<(f32, &Layer)> = layers
        .iter()
        .enumerate()
        .map(|(place, layer)| {
            (
                layer.seen.depth[row * layer.size + column] + place as f32 * LATER_MM,
                layer,
            )
        })
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let srgb = Srgb::tables();
    let mut colour = BACKGROUND.map(|value| srgb.linear(value));
    for (_, layer) in order {
        colour = over(layer.smoothed(row * layer.size + column), colour);
    }
    colour.map(|value| srgb.encode(value))
}

/// Light, and how opaque it is, over other light.
fn over([r, g, b, a]: [f32; 4], behind: [f32; 3]) -> [f32; 3] {
    [
        r + behind[0] * (1.0 - a),
        g + behind[1] * (1.0 - a),
        b + behind[2] * (1.0 - a),
    ]
}

/// Light as it is seen before the background, sRGB.
fn over_background(light: [f32; 4]) -> [u8; 3] {
    let srgb = Srgb::tables();
    let behind = BACKGROUND.map(|value| srgb.linear(value));
    over(light, behind).map(|value| srgb.encode(value))
}

/// The linear light of a colour times its opacity, and its opacity.
fn light(colour: [u8; 3], opacity: f32) -> [f32; 4] {
    let [r, g, b] = colour.map(|value| Srgb::tables().linear(value) * opacity);
    [r, g, b, opacity]
}

/// At a pixel where an edge passes, the light of its near and far side by their shares: so many of its samples are on the
/// near side. `light` is that of a pixel without an edge.
fn smoothed(
    seen: &Seen,
    size: usize,
    here: usize,
    samples: u8,
    light: impl Fn(usize) -> [f32; 4],
) -> [f32; 4] {
    let (column, row) = (here % size, here / size);
    let share = f32::from(samples) / SAMPLES.len() as f32;
    let (mut near, mut far) = (here, here);
    let beside = [
        (column > 0).then(|| here - 1),
        (column + 1 < size).then_some(here + 1),
        (row > 0).then(|| here - size),
        (row + 1 < size).then_some(here + size),
    ];
    let depth = &seen.depth;
    for pixel in beside.into_iter().flatten() {
        if depth[pixel] > depth[near] {
            near = pixel;
        }
        if depth[pixel] < depth[far] {
            far = pixel;
        }
    }
    // The pixel's own colour stands for the side that it is on.
    let middle = (depth[near] + depth[far]) / 2.0;
    if depth[here] > middle {
        near = here;
    } else {
        far = here;
    }
    let (near, far) = (light(near), light(far));
    std::array::from_fn(|channel| near[channel] * share + far[channel] * (1.0 - share))
}

/// A pixel that no edge passes.
const NO_EDGE: u8 = u8::MAX;

/// An object's picture before it is put over another's.
#[derive(Debug)]
struct Layer {
    size: usize,
    seen: Seen,
    /// sRGB, and opacity of 255.
    rgba: Vec<[u8; 4]>,
    /// In pixels at an edge, how many of their samples belong to what is on the near side of it; else
    /// [`NO_EDGE`].
    near: Vec<u8>,
}

impl Layer {
    fn new(object: &Object<'_>, camera: &Camera) -> Self {
        let size = camera.size();
        let painter = Painter::new(object, camera);
        let mut layer = Self {
            size,
            seen: Seen::new(size),
            rgba: vec![[0; 4]; size * size],
            near: vec![0; size * size],
        };
        let rows = band_rows(size);
        let len = rows * size;
        let bands = (
            layer.rgba.par_chunks_mut(len),
            layer.seen.depth.par_chunks_mut(len),
            layer.seen.place.par_chunks_mut(len),
            layer.near.par_chunks_mut(len),
        );
        let bands = bands.into_par_iter().enumerate();
        bands.for_each(|(number, (rgba, depth, place, near))| {
            let first = number * rows;
            let mut edges = Vec::new();
            painter.paint(Band {
                first,
                colours: Colours::Layer(rgba),
                depth,
                place,
                edges: &mut edges,
            });
            near.fill(NO_EDGE);
            for edge in edges {
                near[edge.pixel as usize - first * size] = edge.near;
            }
        });
        layer
    }

    /// Whether nothing is at a pixel, nor at an edge that passes it.
    #[inline]
    fn is_empty(&self, pixel: usize) -> bool {
        self.seen.place[pixel] == NOTHING && self.near[pixel] == NO_EDGE
    }

    /// A row of pixels of this layer alone.
    fn show(&self, row: usize, line: &mut [[u8; 3]]) {
        let range = row * self.size..(row + 1) * self.size;
        let shown = self.rgba[range.clone()]
            .iter()
            .zip(&self.near[range.clone()]);
        for (here, (pixel, (&[r, g, b, a], &near))) in range.zip(line.iter_mut().zip(shown)) {
            // Most pixels show one thing, or nothing, and no edge passes them.
            *pixel = match (a, near) {
                (u8::MAX, NO_EDGE) => [r, g, b],
                (0, NO_EDGE) => BACKGROUND,
                _ => over_background(self.smoothed(here)),
            };
        }
    }

    /// The light of a pixel; at an edge, that of its near and far side by their shares.
    fn smoothed(&self, pixel: usize) -> [f32; 4] {
        let of = |pixel: usize| {
            let [r, g, b, a] = self.rgba[pixel];
            light([r, g, b], f32::from(a) / 255.0)
        };
        match self.near[pixel] {
            NO_EDGE => of(pixel),
            samples => smoothed(&self.seen, self.size, pixel, samples, of),
        }
    }
}
