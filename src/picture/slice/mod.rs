//! A slice of the CT before and after, side by side.

mod panel;

use image::{Rgb, RgbImage};

use super::PictureError;
use super::canvas::{checked_size, overlay};
use super::overlay::GROUND;
use super::svg::{Anchor, Colour, Stroke, Svg, TextStyle};
use super::text::{elide, width};
use super::ticks::{label, ticks};
use crate::feature::NoseBox;
use crate::space::{GridPoint, GridVector};
use crate::volume::{Sample, Volume};
use panel::{Frame, Panel};

/// The direction that a slice is cut in, along the axes of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plane {
    /// Constant x, seen from the patient's left: anterior is at the left.
    Sagittal,
    /// Constant y, seen from the front: the patient's right is at the left.
    Coronal,
    /// Constant z, seen from below: the patient's right is at the left, anterior is up.
    Axial,
}

impl Plane {
    /// Name, for a file or a caption.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sagittal => "sagittal",
            Self::Coronal => "coronal",
            Self::Axial => "axial",
        }
    }

    /// Where a slice shows the nose, mm from the tip as in [`SliceView::offset_mm`]: a coronal slice through the
    /// tip itself would graze it.
    pub const fn usual_offset_mm(self) -> f64 {
        match self {
            Self::Coronal => 10.0,
            Self::Sagittal | Self::Axial => 0.0,
        }
    }

    /// Axes across (to the right) and down the picture, and the one that is cut: 0 x, 1 y, 2 z.
    const fn axes(self) -> [usize; 3] {
        match self {
            Self::Sagittal => [1, 2, 0],
            Self::Coronal => [0, 2, 1],
            Self::Axial => [0, 1, 2],
        }
    }

    /// Whether the axis that goes down the picture falls along it: z does, so that superior is up.
    const fn falls(self) -> bool {
        !matches!(self, Self::Axial)
    }

    /// What a cut at a positive and at a negative offset is of the tip.
    const fn sides(self) -> [&'static str; 2] {
        match self {
            Self::Sagittal => ["left of", "right of"],
            Self::Coronal => ["behind", "in front of"],
            Self::Axial => ["above", "below"],
        }
    }

    /// Letters at the left, right, top and bottom.
    const fn letters(self) -> [&'static str; 4] {
        match self {
            Self::Sagittal => ["A", "P", "S", "I"],
            Self::Coronal => ["R", "L", "S", "I"],
            Self::Axial => ["R", "L", "A", "P"],
        }
    }

    /// Where the numbers along its two sides grow to.
    const fn directions(self) -> &'static str {
        match self {
            Self::Sagittal => "posterior and superior",
            Self::Coronal => "the patient's left and superior",
            Self::Axial => "the patient's left and posterior",
        }
    }
}

/// How a slice is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SliceSettings {
    /// Middle of the grey scale, HU.
    pub level_hu: f64,
    /// HU from black to white.
    pub width_hu: f64,
    /// The longer side of either panel, pixels: 64 to 4096.
    pub panel_pixels: u32,
    /// How far around the nose box is shown, mm, as far as the volume goes.
    pub margin_mm: f64,
}

impl Default for SliceSettings {
    /// The window for soft tissue, 40 mm around the nose.
    fn default() -> Self {
        Self {
            level_hu: 40.0,
            width_hu: 400.0,
            panel_pixels: 520,
            margin_mm: 40.0,
        }
    }
}

/// Which slice, and what is marked on it. Positions are grid millimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SliceView<'a> {
    /// Its direction.
    pub plane: Plane,
    /// The point from which the numbers along its sides count.
    pub tip: GridPoint,
    /// How far from the tip it is cut, mm: positive to the patient's left, to posterior, to superior.
    pub offset_mm: f64,
    /// The box that is outlined; the slice is cropped around it.
    pub nose: NoseBox,
    /// The threshold of the contours, HU.
    pub skin_hu: f64,
    /// The caption: which candidate and stage.
    pub title: &'a str,
}

/// Colours of the contours, on the eight of `palette`.
const BEFORE: Colour = [86, 180, 233];
const AFTER: Colour = [230, 159, 0];
/// Letters stand on the slice itself, where white would be lost on bone.
const LETTER: Colour = [255, 214, 90];
const BOX: Colour = [0, 200, 140];
const INK: Colour = [236, 236, 240];
const FAINT: Colour = [176, 176, 184];

/// Pixels around the panels: caption and labels above, numbers at the left and below, legend at the bottom.
const HEADER: u32 = 72;
const NUMBERS: u32 = 44;
const GAP: u32 = 16;
const RIGHT: u32 = 14;
const FOOTER: u32 = 74;
/// What the text of the footer needs.
const LEAST_WIDTH: u32 = 700;

/// A picture of one slice of both volumes: `before` at the left, `after` at the right, cropped and scaled
/// alike, both with the skin of both as contours.
///
/// Voxels are interpolated trilinearly to square pixels, so the picture is true to length whatever the
/// spacing. A contour is where the interpolated HU are the threshold; cavities filled with air have some as
/// well.
///
/// # Errors
/// [`PictureError::Grids`] where the volumes' grids differ; [`PictureError::Value`] for settings or positions
/// that cannot be, among them a plane outside the volume; [`PictureError::Empty`] where nothing of the volume
/// is around the box.
pub fn slice<T: Sample>(
    before: &Volume<T>,
    after: &Volume<T>,
    view: &SliceView<'_>,
    settings: &SliceSettings,
) -> Result<RgbImage, PictureError> {
    if before.grid() != after.grid() {
        return Err(PictureError::Grids);
    }
    check(view, settings)?;
    let frame = Frame::new(before.grid(), view, settings)?;
    let (columns, rows) = (frame.columns, frame.rows);
    let content = 2 * (NUMBERS + columns) + GAP + RIGHT;
    let image_width = content.max(LEAST_WIDTH);
    let image_height = HEADER + rows + FOOTER;
    let (image_width, image_height) =
        checked_size(u64::from(image_width), u64::from(image_height))?;
    let mut image = RgbImage::from_pixel(image_width, image_height, Rgb(GROUND));
    let mut svg = Svg::new(image_width, image_height);

    let panels = [Panel::new(before, &frame), Panel::new(after, &frame)];
    let skins = panels.each_ref().map(|panel| panel.contour(view.skin_hu));
    let start = (image_width - content) / 2 + NUMBERS;
    let starts = [start, start + columns + GAP + NUMBERS];
    let names = ["before", "after"];
    // A panel's own contour is drawn last, so it stays whole where the two meet.
    let orders = [[(1, AFTER), (0, BEFORE)], [(0, BEFORE), (1, AFTER)]];
    for (((panel, left), name), order) in panels.iter().zip(starts).zip(names).zip(orders) {
        let mut picture = panel.windowed(settings);
        for (which, colour) in order {
            if let Some(contour) = skins.get(which) {
                panel::blend(&mut picture, contour, colour);
            }
        }
        for (x, y, pixel) in picture.enumerate_pixels() {
            image.put_pixel(left + x, HEADER + y, *pixel);
        }
        annotate(&mut svg, &frame, view, [left, HEADER], name);
    }
    caption(&mut svg, view, settings, [image_width, image_height]);
    overlay(&mut image, &svg.finish())?;
    Ok(image)
}

fn check(view: &SliceView<'_>, settings: &SliceSettings) -> Result<(), PictureError> {
    let finite = |what, value: f64, least: f64, condition| {
        if value.is_finite() && value >= least {
            Ok(())
        } else {
            Err(PictureError::Value {
                what,
                value,
                condition,
            })
        }
    };
    let any = f64::NEG_INFINITY;
    finite("the level of the window, HU,", settings.level_hu, any, "")?;
    let least = f64::MIN_POSITIVE;
    finite(
        "the width of the window, HU,",
        settings.width_hu,
        least,
        " above 0",
    )?;
    finite(
        "the margin around the nose, mm,",
        settings.margin_mm,
        0.0,
        ", 0 or more",
    )?;
    finite("the offset of a slice, mm,", view.offset_mm, any, "")?;
    finite("the skin threshold, HU,", view.skin_hu, any, "")?;
    for point in [view.tip, view.nose.min, view.nose.max] {
        for value in point.to_array() {
            finite("a position in a slice, mm,", value, any, "")?;
        }
    }
    if !(64..=4096).contains(&settings.panel_pixels) {
        return Err(PictureError::Value {
            what: "the longer side of a slice, pixels,",
            value: f64::from(settings.panel_pixels),
            condition: " from 64 to 4096",
        });
    }
    Ok(())
}

/// Box, tip, numbers and letters of a panel whose upper left corner is at `corner`.
fn annotate(svg: &mut Svg, frame: &Frame, view: &SliceView<'_>, corner: [u32; 2], name: &str) {
    let [left, top] = corner.map(f64::from);
    let (wide, high) = (f64::from(frame.columns), f64::from(frame.rows));
    let place = |point: GridPoint| {
        // Far outside is as good as farther: numbers stay short.
        let [x, y] = frame.place(point).map(|at| at.clamp(-1e5, 1e5));
        [left + x, top + y]
    };
    let (a, b) = (place(view.nose.min), place(view.nose.max));
    let low = [a[0].min(b[0]), a[1].min(b[1])];
    let size = [(a[0] - b[0]).abs(), (a[1] - b[1]).abs()];
    let dashed = Stroke {
        dash: Some((5.0, 4.0)),
        ..Stroke::solid(1.2, BOX)
    };
    svg.clipped([left, top], [wide, high], |svg| {
        svg.frame(low, size, dashed);
        let [x, y] = place(view.tip);
        for (across, down) in [(5.0, 0.0), (0.0, 5.0)] {
            let ends = ([x - across, y - down], [x + across, y + down]);
            svg.line(ends.0, ends.1, Stroke::solid(1.2, INK));
        }
    });
    svg.frame([left, top], [wide, high], Stroke::solid(1.0, FAINT));

    let style = |size, anchor, halo| TextStyle {
        size,
        colour: INK,
        anchor,
        halo,
    };
    let heading = style(14.0, Anchor::Middle, None);
    let name = elide(name, 14.0, wide);
    svg.text([left + wide / 2.0, top - 8.0], &name, heading);

    let letter = TextStyle {
        colour: LETTER,
        ..style(14.0, Anchor::Middle, Some(GROUND))
    };
    let [l, r, t, b] = view.plane.letters();
    for (at, text) in [
        ([left + 12.0, top + high / 2.0 + 5.0], l),
        ([left + wide - 12.0, top + high / 2.0 + 5.0], r),
        ([left + wide / 2.0, top + 18.0], t),
        ([left + wide / 2.0, top + high - 8.0], b),
    ] {
        svg.text(at, text, letter);
    }

    let [across, down, _] = view.plane.axes();
    let tip = view.tip.to_array();
    // Every 10 mm, wider where numbers would touch.
    for (axis, length, room) in [(across, wide, 30.0), (down, high, 16.0)] {
        let (from, to) = (frame.low(axis) - tip[axis], frame.high(axis) - tip[axis]);
        let (values, step) = tens(from, to, (length / room) as usize);
        for value in values {
            let mut offset = [0.0; 3];
            offset[axis] = value;
            let [x, y] = place(view.tip + GridVector::from(offset));
            let text = label(value, step);
            if axis == across {
                let y = top + high;
                svg.line([x, y], [x, y + 4.0], Stroke::solid(1.0, FAINT));
                svg.text([x, y + 16.0], &text, style(11.0, Anchor::Middle, None));
            } else {
                svg.line([left - 4.0, y], [left, y], Stroke::solid(1.0, FAINT));
                let place = [left - 7.0, y + 4.0];
                svg.text(place, &text, style(11.0, Anchor::End, None));
            }
        }
    }
}

/// Multiples of 10 mm between two numbers of mm; of more where there would be over `most` of them, and of
/// less where there would be none.
fn tens(from: f64, to: f64, most: usize) -> (Vec<f64>, f64) {
    const STEP: f64 = 10.0;
    let (first, last) = ((from / STEP).ceil(), (to / STEP).floor());
    let count = last - first + 1.0;
    if count < 2.0 || count > most.max(2) as f64 {
        return ticks(from, to, most.clamp(2, 6));
    }
    let at = |n: i64| (first + n as f64) * STEP;
    ((0..count as i64).map(at).collect(), STEP)
}

/// The title above the panels and the legend below them.
fn caption(svg: &mut Svg, view: &SliceView<'_>, settings: &SliceSettings, size: [u32; 2]) {
    let [wide, high] = size.map(f64::from);
    let margin = 14.0;
    let style = |size, colour| TextStyle {
        size,
        colour,
        anchor: Anchor::Start,
        halo: None,
    };
    let title = elide(view.title, 16.0, wide - 2.0 * margin);
    svg.text([margin, 24.0], &title, style(16.0, INK));
    let off = label(view.offset_mm.abs(), 0.1);
    let place = match view.plane.sides() {
        _ if view.offset_mm == 0.0 => "through the tip".to_owned(),
        [side, _] if view.offset_mm > 0.0 => format!("{off} mm {side} the tip"),
        [_, side] => format!("{off} mm {side} the tip"),
    };
    let line = format!(
        "{} slice {place}, window {} to {} HU",
        view.plane.name(),
        label(settings.level_hu - settings.width_hu / 2.0, 1.0),
        label(settings.level_hu + settings.width_hu / 2.0, 1.0),
    );
    let line = elide(&line, 12.0, wide - 2.0 * margin);
    svg.text([margin, 43.0], &line, style(12.0, FAINT));

    let y = high - 34.0;
    let mut x = margin;
    let skin = |name: &str| format!("skin {name} ({} HU)", label(view.skin_hu, 1.0));
    for (text, stroke) in [
        (skin("before"), Stroke::solid(2.5, BEFORE)),
        (skin("after"), Stroke::solid(2.5, AFTER)),
        (
            "nose box".to_owned(),
            Stroke {
                dash: Some((5.0, 4.0)),
                ..Stroke::solid(1.5, BOX)
            },
        ),
        (
            if view.offset_mm == 0.0 {
                "+ tip"
            } else {
                "+ tip, projected"
            }
            .to_owned(),
            Stroke::solid(0.0, INK),
        ),
    ] {
        if stroke.width > 0.0 {
            svg.line([x, y - 4.0], [x + 24.0, y - 4.0], stroke);
            x += 30.0;
        }
        svg.text([x, y], &text, style(12.0, INK));
        x += width(&text, 12.0) + 22.0;
    }
    let line = format!(
        "numbers are mm from the tip, increasing towards {}; R, L, A, P, S, I are the patient's sides",
        view.plane.directions()
    );
    svg.text([margin, high - 13.0], &line, style(12.0, FAINT));
}

#[cfg(test)]
mod tests;
