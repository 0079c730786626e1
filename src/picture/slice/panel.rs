//! The pixels of one panel: resampled, windowed, with contours.

use image::{Rgb, RgbImage};

use super::{SliceSettings, SliceView};
use crate::picture::PictureError;
use crate::picture::svg::Colour;
use crate::space::{ContinuousIndex, Grid, GridPoint};
use crate::volume::{Sample, Trilinear, Volume};

/// Width of a contour, pixels.
const CONTOUR: f64 = 1.7;
/// Columns and rows around a panel that gradients look into.
const RIM: u32 = 1;

/// Which millimetres a panel shows, and how its pixels lie in the grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub columns: u32,
    pub rows: u32,
    axes: [usize; 3],
    falls: bool,
    /// Pixels in a millimetre.
    scale: f64,
    /// The corner of least x, y, z, grid mm, and the opposite one.
    low: [f64; 3],
    high: [f64; 3],
    /// Where the slice is cut, grid mm.
    level: f64,
    /// Grid mm in a voxel.
    spacing: [f64; 3],
}

impl Frame {
    /// The box and the margin around it, as far as the volume's voxel centres reach.
    pub fn new(
        grid: &Grid,
        view: &SliceView<'_>,
        settings: &SliceSettings,
    ) -> Result<Self, PictureError> {
        let last = grid
            .index_to_grid(ContinuousIndex(grid.last_index()))
            .to_array();
        let (min, max) = (view.nose.min.to_array(), view.nose.max.to_array());
        let around = |axis: usize| {
            let (a, b) = (min[axis].min(max[axis]), min[axis].max(max[axis]));
            [
                (a - settings.margin_mm).max(0.0),
                (b + settings.margin_mm).min(last[axis]),
            ]
        };
        let ends = [0, 1, 2].map(around);
        let (low, high) = (ends.map(|[low, _]| low), ends.map(|[_, high]| high));
        let axes = view.plane.axes();
        let [across, down, cut] = axes;
        let level = view.tip.to_array()[cut] + view.offset_mm;
        if !(0.0..=last[cut]).contains(&level) {
            return Err(PictureError::Value {
                what: "the place of a slice, mm along the axis that it cuts,",
                value: level,
                condition: " within the volume",
            });
        }
        let extent = [across, down].map(|axis| high[axis] - low[axis]);
        let longest = extent[0].max(extent[1]);
        if !(extent[0] > 0.0 && extent[1] > 0.0 && longest.is_finite()) {
            return Err(PictureError::Empty {
                what: "nothing of the volume is around the nose box, or it is a single voxel thick",
            });
        }
        let scale = f64::from(settings.panel_pixels) / longest;
        let pixels = |mm: f64| (mm * scale).round().max(1.0) as u32;
        Ok(Self {
            columns: pixels(extent[0]),
            rows: pixels(extent[1]),
            axes,
            falls: view.plane.falls(),
            scale,
            low,
            high,
            level,
            spacing: grid.spacing().to_array(),
        })
    }

    /// The least coordinate of an axis that is shown, grid mm.
    pub fn low(&self, axis: usize) -> f64 {
        self.low.get(axis).copied().unwrap_or_default()
    }

    /// The largest coordinate of an axis that is shown, grid mm.
    pub fn high(&self, axis: usize) -> f64 {
        self.high.get(axis).copied().unwrap_or_default()
    }

    /// Where a point is seen, pixels from the panel's upper left corner.
    pub fn place(&self, point: GridPoint) -> [f64; 2] {
        let [across, down, _] = self.axes;
        let at = point.to_array();
        let x = (at[across] - self.low[across]) * self.scale;
        let y = if self.falls {
            (self.high[down] - at[down]) * self.scale
        } else {
            (at[down] - self.low[down]) * self.scale
        };
        [x, y]
    }

    /// The position in the volume, in voxels, that is seen at a place.
    fn index(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        let [across, down, cut] = self.axes;
        let mut at = [0.0; 3];
        at[across] = self.low[across] + x / self.scale;
        at[down] = if self.falls {
            self.high[down] - y / self.scale
        } else {
            self.low[down] + y / self.scale
        };
        at[cut] = self.level;
        [0, 1, 2].map(|axis| at[axis] / self.spacing[axis])
    }
}

/// One value for each pixel.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    columns: usize,
    values: Vec<f64>,
}

impl Layer {
    fn at(&self, x: u32, y: u32) -> f64 {
        let place = y as usize * self.columns + x as usize;
        self.values.get(place).copied().unwrap_or(f64::NAN)
    }
}

/// The HU that a panel shows, at the centres of its pixels and one pixel around it.
#[derive(Debug, Clone)]
pub(super) struct Panel {
    columns: u32,
    rows: u32,
    hu: Layer,
}

impl Panel {
    pub fn new<T: Sample>(volume: &Volume<T>, frame: &Frame) -> Self {
        let sampler = Trilinear::new(volume);
        let (columns, rows) = (frame.columns + 2 * RIM, frame.rows + 2 * RIM);
        let centre = |pixel: u32| f64::from(pixel) - f64::from(RIM) + 0.5;
        let values = (0..rows)
            .flat_map(|row| (0..columns).map(move |column| (column, row)))
            .map(|(column, row)| {
                let [x, y, z] = frame.index([centre(column), centre(row)]);
                volume.rescale().to_hu(sampler.at(x, y, z))
            })
            .collect();
        Self {
            columns: frame.columns,
            rows: frame.rows,
            hu: Layer {
                columns: columns as usize,
                values,
            },
        }
    }

    /// Grey levels of the window: black at its lower end and below, white at its upper end and above.
    pub fn windowed(&self, settings: &SliceSettings) -> RgbImage {
        let low = settings.level_hu - settings.width_hu / 2.0;
        RgbImage::from_fn(self.columns, self.rows, |x, y| {
            let share = (self.hu.at(x + RIM, y + RIM) - low) / settings.width_hu;
            // What is not a number is black.
            let level = (share.clamp(0.0, 1.0) * 255.0).round() as u8;
            Rgb([level; 3])
        })
    }

    /// How much of each pixel is covered by the line where the HU are `threshold`, 0 to 1.
    ///
    /// To first order a pixel is |HU - threshold| / |gradient| away from the line: no pieces of it are
    /// followed, and it is as wide on a steep edge as on a gentle one.
    pub fn contour(&self, threshold: f64) -> Layer {
        let covered = |x: u32, y: u32| {
            let (x, y) = (x + RIM, y + RIM);
            let across = (self.hu.at(x + 1, y) - self.hu.at(x - 1, y)) / 2.0;
            let down = (self.hu.at(x, y + 1) - self.hu.at(x, y - 1)) / 2.0;
            let slope = (across * across + down * down).sqrt();
            let away = (self.hu.at(x, y) - threshold).abs() / slope;
            // No line in what is level or not a number: 0/0 and x/0 end here.
            if away.is_finite() {
                (CONTOUR / 2.0 + 0.5 - away).clamp(0.0, 1.0)
            } else {
                0.0
            }
        };
        let values = (0..self.rows)
            .flat_map(|y| (0..self.columns).map(move |x| (x, y)))
            .map(|(x, y)| covered(x, y))
            .collect();
        Layer {
            columns: self.columns as usize,
            values,
        }
    }
}

/// Lays a colour over a picture, as much of it as a layer says.
pub(super) fn blend(picture: &mut RgbImage, cover: &Layer, colour: Colour) {
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let share = cover.at(x, y).clamp(0.0, 1.0);
        for (level, ink) in pixel.0.iter_mut().zip(colour) {
            let mixed = f64::from(*level) * (1.0 - share) + f64::from(ink) * share;
            *level = mixed.round() as u8;
        }
    }
}
