//! What plots and charts share: the plotting library, drawn into our SVG.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::prelude::*;

use super::PictureError;
use super::canvas::FONT_FAMILY;
use super::svg::Colour;

/// Units of the library to a pixel. It puts everything on whole units; at a quarter of a pixel that does not
/// show.
pub(super) const FINE: u32 = 4;

/// Ink of text and axes on the white ground of plots.
pub(super) const INK: Colour = [40, 40, 46];
/// Ink of what is less important.
pub(super) const FAINT: Colour = [110, 110, 118];
/// Grid lines.
pub(super) const GRID: Colour = [222, 222, 226];
/// The ground of plots.
pub(super) const PAPER: Colour = [255, 255, 255];

/// Where the library draws.
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// What `body` draws on an area of `size` pixels, as an SVG element to be put into one of the same size.
pub(super) fn draw<R>(
    size: (u32, u32),
    body: impl FnOnce(&Area<'_>) -> Result<R, PictureError>,
) -> Result<(String, R), PictureError> {
    let mut element = String::new();
    let result = {
        let backend = SVGBackend::with_string(&mut element, (size.0 * FINE, size.1 * FINE));
        let area = backend.into_drawing_area();
        let result = body(&area)?;
        area.present().map_err(failed)?;
        result
    };
    Ok((element, result))
}

/// The library's error as ours.
pub(super) fn failed(error: impl std::fmt::Display) -> PictureError {
    PictureError::Chart(error.to_string())
}

/// Pixels as the library's units.
pub(super) fn units(pixels: f64) -> i32 {
    (pixels * f64::from(FINE)).round() as i32
}

/// A place of the library's as pixels.
pub(super) fn pixels((x, y): (i32, i32)) -> [f64; 2] {
    [x, y].map(|unit| f64::from(unit) / f64::from(FINE))
}

/// A line of `width` pixels.
pub(super) fn stroke(colour: Colour, width: f64) -> ShapeStyle {
    let [red, green, blue] = colour;
    let width = units(width).max(1) as u32;
    RGBColor(red, green, blue).stroke_width(width)
}

/// A filled shape.
pub(super) fn fill(colour: Colour) -> ShapeStyle {
    let [red, green, blue] = colour;
    RGBColor(red, green, blue).filled()
}

/// Text of `size` pixels.
pub(super) fn text(size: f64) -> TextStyle<'static> {
    /// The library divides font sizes by this on the way to SVG.
    const SHRINK: f64 = 1.24;
    let [red, green, blue] = INK;
    let font = (FONT_FAMILY, size * SHRINK * f64::from(FINE)).into_font();
    font.color(&RGBColor(red, green, blue))
}

/// An axis whose numbers stand where we say: the library's own choice takes powers and logarithms from the
/// system.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    /// Its ends; the first is the smaller.
    pub ends: [f64; 2],
    /// Where its numbers stand.
    pub marks: Vec<f64>,
}

impl Ranged for Axis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let [low, high] = self.ends;
        let (from, to) = (f64::from(limit.0), f64::from(limit.1));
        (from + (to - from) * ((value - low) / (high - low))).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.marks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.ends[0]..self.ends[1]
    }
}
