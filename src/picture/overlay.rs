//! What is written over a 3-D view: its caption, a scale bar, where the patient's sides are, and the colours.

use super::colormap::{DivergingLegend, LEGEND_HEIGHT};
use super::svg::{Anchor, Colour, Stroke, Svg, TextStyle};
use super::text::elide;

/// The ground of the views, which text keeps clear of.
pub(super) const GROUND: Colour = [28, 28, 34];
const INK: Colour = [236, 236, 240];
const FAINT: Colour = [176, 176, 184];

/// From the picture's edges to what is written, pixels.
const MARGIN: f64 = 12.0;
/// Lengths of the scale bar, mm, in the order in which they are tried: 10 wherever it fits.
const BAR_MM: [f64; 7] = [10.0, 20.0, 50.0, 100.0, 5.0, 2.0, 1.0];
/// The shortest scale bar, pixels.
const LEAST_BAR: f64 = 16.0;

/// The letters at the middle of a view's sides, as R, L, A, P, S or I; empty where a side has none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[allow(missing_docs, reason = "each is a side of the picture")]
pub struct SideLetters<'a> {
    pub left: &'a str,
    pub right: &'a str,
    pub top: &'a str,
    pub bottom: &'a str,
}

/// What is written over a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewOverlay<'a> {
    /// Size of the view, pixels: width, height.
    pub size: (u32, u32),
    /// Size of a pixel in mm (of an orthographic view, or at the depth of the tip); the scale bar is left out
    /// where it is not positive.
    pub mm_per_pixel: f64,
    /// First line at the upper left.
    pub title: &'a str,
    /// Second line, smaller.
    pub subtitle: &'a str,
    /// Where the patient's sides are.
    pub letters: SideLetters<'a>,
    /// What the colours mean, at the lower right.
    pub legend: Option<DivergingLegend>,
}

impl ViewOverlay<'_> {
    /// The drawing, as large as the view and transparent: give it to [`overlay`](super::overlay).
    pub fn svg(&self) -> String {
        let (width, height) = (f64::from(self.size.0), f64::from(self.size.1));
        let mut svg = Svg::new(self.size.0, self.size.1);
        let style = |size, colour, anchor| TextStyle {
            size,
            colour,
            anchor,
            halo: Some(GROUND),
        };
        // The letter at the top is in the middle: text keeps to what is left of it, or goes below it.
        let room = width - 2.0 * MARGIN;
        let top = if self.letters.top.is_empty() {
            0.0
        } else {
            4.0
        };
        let title = elide(self.title, 15.0, room / 2.0 - 14.0 + top);
        svg.text([MARGIN, 25.0], &title, style(15.0, INK, Anchor::Start));
        let subtitle = elide(self.subtitle, 12.0, room);
        let faint = style(12.0, FAINT, Anchor::Start);
        svg.text([MARGIN, 43.0], &subtitle, faint);

        let letter = style(16.0, INK, Anchor::Middle);
        let SideLetters {
            left,
            right,
            top,
            bottom,
        } = self.letters;
        for (place, text) in [
            ([MARGIN + 6.0, height / 2.0 + 6.0], left),
            ([width - MARGIN - 6.0, height / 2.0 + 6.0], right),
            ([width / 2.0, 25.0], top),
            ([width / 2.0, height - MARGIN], bottom),
        ] {
            svg.text(place, &elide(text, 16.0, 60.0), letter);
        }

        // Half the width each, clear of the letter at the bottom.
        let half = width / 2.0 - MARGIN - 24.0;
        self.scale_bar(&mut svg, height, half);
        if let Some(legend) = &self.legend
            && half >= 100.0
        {
            // Its outermost numbers reach beyond the bar.
            let bar = half.min(220.0) - 12.0;
            let corner = [
                width - MARGIN - 8.0 - bar,
                height - MARGIN - LEGEND_HEIGHT + 4.0,
            ];
            legend.draw(&mut svg, corner, bar, [INK, GROUND]);
        }
        svg.finish()
    }

    fn scale_bar(&self, svg: &mut Svg, height: f64, room: f64) {
        let pixels = |mm: f64| mm / self.mm_per_pixel;
        let fits = |mm: &f64| (LEAST_BAR..=room).contains(&pixels(*mm));
        let Some(mm) = BAR_MM.into_iter().find(fits) else {
            return;
        };
        let (from, to, y) = (MARGIN, MARGIN + pixels(mm), height - MARGIN - 4.0);
        for stroke in [Stroke::solid(5.0, GROUND), Stroke::solid(2.0, INK)] {
            let rim = (stroke.width - 2.0) / 2.0;
            svg.line([from - rim, y], [to + rim, y], stroke);
            for x in [from, to] {
                svg.line([x, y - 4.0 - rim], [x, y + 4.0 + rim], stroke);
            }
        }
        let style = TextStyle {
            size: 12.0,
            colour: INK,
            anchor: Anchor::Start,
            halo: Some(GROUND),
        };
        svg.text([from, y - 9.0], &format!("{mm} mm"), style);
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::picture::{overlay, rasterize};

    fn view(size: (u32, u32), mm_per_pixel: f64) -> ViewOverlay<'static> {
        ViewOverlay {
            size,
            mm_per_pixel,
            title: "smaller: reduce",
            subtitle: "frontal view, skin at −500 HU",
            letters: SideLetters {
                left: "R",
                right: "L",
                top: "S",
                bottom: "I",
            },
            legend: Some(DivergingLegend {
                min_mm: -6.3,
                max_mm: 2.1,
            }),
        }
    }

    #[test]
    fn the_scale_bar_is_as_long_as_it_says() {
        let mut image = RgbImage::from_pixel(640, 480, Rgb(GROUND));
        let mut view = view((640, 480), 0.125);
        view.legend = None;
        overlay(&mut image, &view.svg()).unwrap();
        let y = 480 - MARGIN as u32 - 4;
        let lit = (0..300).filter(|&x| image.get_pixel(x, y).0[0] > 128);
        // 80 pixels of bar and half of the stroke of the end marks.
        assert_eq!(lit.count(), 82);
    }

    #[test]
    fn it_fits_views_of_any_size_and_any_text() {
        for size in [(1, 1), (64, 64), (320, 200), (1600, 1200)] {
            for mm_per_pixel in [0.0, -1.0, f64::NAN, 1e-12, 0.2, 1e12] {
                let mut view = view(size, mm_per_pixel);
                view.title =
                    "<script>&\"\0 of a title that does not end and so has to be cut somewhere";
                let svg = view.svg();
                assert!(!svg.contains("<script") && !svg.contains("NaN") && !svg.contains("inf"));
                assert_eq!(rasterize(&svg, 1.0).unwrap().dimensions(), size);
            }
        }
    }
}
