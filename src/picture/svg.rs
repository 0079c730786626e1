//! A small writer of SVG: shapes without curves or turns, and text in the embedded font.

use std::fmt::Write as _;

use super::canvas::FONT_FAMILY;
use super::text::escape;

/// A colour, sRGB.
pub(super) type Colour = [u8; 3];

/// Where a text's position is on its line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// How a text is set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TextStyle {
    pub size: f64,
    pub colour: Colour,
    pub anchor: Anchor,
    /// The colour of a rim around the letters, which keeps them readable on any ground.
    pub halo: Option<Colour>,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stroke {
    pub width: f64,
    pub colour: Colour,
    /// Lengths of dash and gap.
    pub dash: Option<(f64, f64)>,
}

impl Stroke {
    pub const fn solid(width: f64, colour: Colour) -> Self {
        Self {
            width,
            colour,
            dash: None,
        }
    }
}

/// A drawing in the making. Coordinates are pixels, x to the right and y down; they are written with two
/// decimals.
#[derive(Debug, Clone)]
pub(super) struct Svg {
    content: String,
}

// Writing to a string cannot fail, so its result is not looked at.
impl Svg {
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            content: format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">\n"
            ),
        }
    }

    /// Puts in an SVG element whose units are `per_pixel` to one of ours.
    pub fn embed(&mut self, element: &str, per_pixel: u32) {
        let scale = 1.0 / f64::from(per_pixel);
        let _ = writeln!(
            self.content,
            "<g transform=\"scale({scale})\">\n{element}</g>"
        );
    }

    pub fn finish(mut self) -> String {
        self.content.push_str("</svg>\n");
        self.content
    }

    /// What `body` draws, cut off at a rectangle: a nested viewport.
    pub fn clipped(
        &mut self,
        [x, y]: [f64; 2],
        [width, height]: [f64; 2],
        body: impl FnOnce(&mut Self),
    ) {
        let _ = writeln!(
            self.content,
            r#"<svg x="{x:.2}" y="{y:.2}" width="{width:.2}" height="{height:.2}" viewBox="{x:.2} {y:.2} {width:.2} {height:.2}" overflow="hidden">"#
        );
        body(self);
        self.content.push_str("</svg>\n");
    }

    pub fn rect(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], fill: Colour) {
        let fill = hex(fill);
        let _ = writeln!(
            self.content,
            r#"<rect x="{x:.2}" y="{y:.2}" width="{width:.2}" height="{height:.2}" fill="{fill}"/>"#
        );
    }

    /// The outline of a rectangle.
    pub fn frame(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], stroke: Stroke) {
        let stroke = attributes(stroke);
        let _ = writeln!(
            self.content,
            r#"<rect x="{x:.2}" y="{y:.2}" width="{width:.2}" height="{height:.2}" fill="none" {stroke}/>"#
        );
    }

    /// A line through several points.
    pub fn path(&mut self, points: &[[f64; 2]], stroke: Stroke) {
        let stroke = attributes(stroke);
        let _ = write!(self.content, r#"<polyline fill="none" {stroke} points=""#);
        for [x, y] in points {
            let _ = write!(self.content, "{x:.2},{y:.2} ");
        }
        let _ = writeln!(self.content, "\"/>");
    }

    pub fn circle(&mut self, [x, y]: [f64; 2], radius: f64, fill: Colour, rim: Stroke) {
        let (fill, rim) = (hex(fill), attributes(rim));
        let _ = writeln!(
            self.content,
            r#"<circle cx="{x:.2}" cy="{y:.2}" r="{radius:.2}" fill="{fill}" {rim}/>"#
        );
    }

    pub fn line(&mut self, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], stroke: Stroke) {
        let stroke = attributes(stroke);
        let _ = writeln!(
            self.content,
            r#"<line x1="{x1:.2}" y1="{y1:.2}" x2="{x2:.2}" y2="{y2:.2}" {stroke}/>"#
        );
    }

    /// A line of text whose base line is at y.
    pub fn text(&mut self, [x, y]: [f64; 2], text: &str, style: TextStyle) {
        let anchor = match style.anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let _ = write!(
            self.content,
            r#"<text x="{x:.2}" y="{y:.2}" font-family="{FONT_FAMILY}" font-size="{:.2}" text-anchor="{anchor}" fill="{}""#,
            style.size,
            hex(style.colour),
        );
        if let Some(halo) = style.halo {
            let _ = write!(
                self.content,
                r#" stroke="{}" stroke-width="{:.2}" stroke-linejoin="bevel" paint-order="stroke""#,
                hex(halo),
                style.size * HALO,
            );
        }
        let _ = writeln!(self.content, ">{}</text>", escape(text));
    }
}

/// Width of the rim around letters, as a share of the font size.
const HALO: f64 = 0.22;

fn hex([red, green, blue]: Colour) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn attributes(stroke: Stroke) -> String {
    let mut text = format!(
        r#"stroke="{}" stroke-width="{:.2}""#,
        hex(stroke.colour),
        stroke.width
    );
    if let Some((dash, gap)) = stroke.dash {
        let _ = write!(text, r#" stroke-dasharray="{dash:.2} {gap:.2}""#);
    }
    text
}
