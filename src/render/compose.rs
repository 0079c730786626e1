//! Objects put over each other, with smooth edges: the picture.

use rayon::prelude::*;

use super::camera::Camera;
use super::layer::{Layer, NO_EDGE, NOTHING, SAMPLES};
use super::shade::{BACKGROUND, Paint, Srgb};
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
    layers: Vec<Layer>,
}

/// Draws objects as a camera sees them.
pub fn render<'a>(objects: &[Object<'a>], camera: &Camera) -> Frame<'a> {
    let layers: Vec<Layer> = objects
        .iter()
        .map(|object| Layer::new(object, camera))
        .collect();
    let size = camera.size();
    let mut pixels = vec![[0; 3]; size * size];
    pixels
        .par_chunks_mut(size)
        .enumerate()
        .for_each(|(row, line)| match &layers[..] {
            [layer] => layer.show(row, line),
            layers => show(layers, row, line),
        });

    Frame {
        size,
        pixels,
        objects: objects.to_vec(),
        layers,
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
        let hits = self.layers.iter().enumerate();
        let hits = hits.filter(|(_, layer)| layer.place[pixel] != NOTHING);
        let (object, layer) = hits.reduce(|best, next| {
            if next.1.depth[pixel] > best.1.depth[pixel] {
                next
            } else {
                best
            }
        })?;
        let place = layer.place[pixel] as usize;
        Some(Hit {
            object,
            place,
            voxel: self.objects.get(object)?.surface.index(place)?,
            depth_mm: f64::from(layer.depth[pixel]),
        })
    }

    /// Place in its semi-boundary of the voxel that an object, hidden or not, has at a pixel.
    pub fn place_of(&self, object: usize, column: usize, row: usize) -> Option<usize> {
        if column >= self.size || row >= self.size {
            return None;
        }
        let place = self.layers.get(object)?.place[row * self.size + column];
        (place != NOTHING).then_some(place as usize)
    }

    /// How many pixels show something.
    pub fn covered(&self) -> usize {
        let covered = |pixel: &usize| {
            self.layers
                .iter()
                .any(|layer| layer.place[*pixel] != NOTHING)
        };
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
    let srgb = Srgb::tables();
    let mut colour = BACKGROUND.map(|value| srgb.linear(value));
    let mut put = |[r, g, b, a]: [f32; 4]| {
        colour = [
            r + colour[0] * (1.0 - a),
            g + colour[1] * (1.0 - a),
            b + colour[2] * (1.0 - a),
        ];
    };
    if let [layer] = layers {
        put(layer.smoothed(column, row));
        return colour.map(|value| srgb.encode(value));
    }
    // From the furthest to the nearest; a handful at most.
    let mut order: Vec<(f32, &Layer)> = layers
        .iter()
        .enumerate()
        .map(|(place, layer)| {
            (
                layer.depth[row * layer.size + column] + place as f32 * LATER_MM,
                layer,
            )
        })
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (_, layer) in order {
        put(layer.smoothed(column, row));
    }
    colour.map(|value| srgb.encode(value))
}

impl Layer {
    /// Whether nothing is at a pixel, nor at an edge that passes it.
    #[inline]
    fn is_empty(&self, pixel: usize) -> bool {
        self.place[pixel] == NOTHING && self.near[pixel] == NO_EDGE
    }

    /// A row of pixels of this layer alone.
    fn show(&self, row: usize, line: &mut [[u8; 3]]) {
        let range = row * self.size..(row + 1) * self.size;
        let shown = self.rgba[range.clone()].iter().zip(&self.near[range]);
        for (column, (pixel, (&[r, g, b, a], &near))) in line.iter_mut().zip(shown).enumerate() {
            // Most pixels show one thing, or nothing, and no edge passes them.
            match (a, near) {
                (u8::MAX, NO_EDGE) => *pixel = [r, g, b],
                (0, NO_EDGE) => *pixel = BACKGROUND,
                _ => *pixel = composed(std::slice::from_ref(self), column, row),
            }
        }
    }

    /// The linear light of a pixel times its opacity, and its opacity.
    fn light(&self, pixel: usize) -> [f32; 4] {
        let [r, g, b, a] = self.rgba[pixel];
        let opacity = f32::from(a) / 255.0;
        let [r, g, b] = [r, g, b].map(|value| Srgb::tables().linear(value) * opacity);
        [r, g, b, opacity]
    }

    /// The light of a pixel; at an edge, that of its near and far side by their shares.
    fn smoothed(&self, column: usize, row: usize) -> [f32; 4] {
        let size = self.size;
        let here = row * size + column;
        let samples = self.near[here];
        if samples == NO_EDGE {
            return self.light(here);
        }
        let share = f32::from(samples) / SAMPLES.len() as f32;
        let (mut near, mut far) = (here, here);
        let beside = [
            (column > 0).then(|| here - 1),
            (column + 1 < size).then_some(here + 1),
            (row > 0).then(|| here - size),
            (row + 1 < size).then_some(here + size),
        ];
        for pixel in beside.into_iter().flatten() {
            if self.depth[pixel] > self.depth[near] {
                near = pixel;
            }
            if self.depth[pixel] < self.depth[far] {
                far = pixel;
            }
        }
        // The pixel's own colour stands for the side that it is on.
        let middle = (self.depth[near] + self.depth[far]) / 2.0;
        if self.depth[here] > middle {
            near = here;
        } else {
            far = here;
        }
        let (near, far) = (self.light(near), self.light(far));
        std::array::from_fn(|channel| near[channel] * share + far[channel] * (1.0 - share))
    }
}
