//! Volumes of the regions A..K as bars (paper Fig. 12).

use plotters::prelude::*;

use super::PictureError;
use super::palette;
use super::plot::{self, Axis, FAINT, FINE, GRID, INK, PAPER, failed, fill, stroke, text, units};
use super::svg::{Anchor, Colour, Stroke, Svg, TextStyle as Text};
use super::text::{elide, width};
use super::ticks::{label, ticks};
use crate::measure::{REGION_NAMES, REGIONS};

/// The volumes of one stage.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// What the legend says: a stage, or a candidate.
    pub label: String,
    /// A..K, mm³. A value that is not a number, or beyond 10¹⁵, is not drawn, and the chart says so.
    pub values: [f64; REGIONS],
}

/// Regional volumes of several stages, to be compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumeChart<'a> {
    /// First line.
    pub title: &'a str,
    /// Second line, smaller; may be empty.
    pub subtitle: &'a str,
    /// What is compared, the preoperative volumes first.
    pub series: &'a [Series],
}

const WIDTH: u32 = 1120;
/// Height of the part with the axes, pixels; the legend is above it and takes what it needs.
const PLOT: f64 = 440.0;
const LEFT: f64 = 96.0;
const RIGHT: f64 = 24.0;
/// Room for the letters below the axis, and below them for its title and the note.
const LETTERS: f64 = 26.0;
const BOTTOM: f64 = 62.0;
/// More series than this are lines, and not all of them are in the legend.
const MOST_BARS: usize = 12;
/// The part of a region that its bars fill.
const FILLED: f64 = 0.84;
const LARGEST: f64 = 1e15;
/// Width of a hollow bar's rim, pixels, and half of it in regions.
const RIM: f64 = 1.6;
const RIM_INSET: f64 = RIM / 2.0 * REGIONS as f64 / (WIDTH as f64 - LEFT - RIGHT);

const LEGEND_SIZE: f64 = 13.0;
const LEGEND_ROW: f64 = 22.0;
const LONGEST_LABEL: f64 = 230.0;
const MOST_LEGENDS: usize = 24;

impl VolumeChart<'_> {
    /// The chart as SVG: up to twelve series as grouped bars, more as lines.
    ///
    /// # Errors
    /// [`PictureError::Empty`] where there is no series.
    pub fn svg(&self) -> Result<String, PictureError> {
        if self.series.is_empty() {
            return Err(PictureError::Empty {
                what: "a chart needs the volumes of one stage at least",
            });
        }
        let legend = self.legend();
        let rows = legend.iter().map(|entry| entry.row + 1).max().unwrap_or(0);
        let top = 62.0 + rows as f64 * LEGEND_ROW + 34.0;
        let height = (top + PLOT + LETTERS + BOTTOM).round() as u32;
        let mut svg = Svg::new(WIDTH, height);
        svg.rect([0.0, 0.0], [f64::from(WIDTH), f64::from(height)], PAPER);
        let (element, ()) = plot::draw((WIDTH, height), |area| self.axes(area, top))?;
        svg.embed(&element, FINE);
        self.captions(&mut svg, top);
        for entry in &legend {
            entry.draw(&mut svg);
        }
        Ok(svg.finish())
    }

    fn drawn(value: f64) -> bool {
        value.is_finite() && value.abs() <= LARGEST
    }

    /// Lowest and highest value, 0 among them, and the numbers along the axis.
    fn range(&self) -> (f64, f64, Vec<f64>, f64) {
        let values = self.series.iter().flat_map(|series| series.values);
        let (low, high) = values
            .filter(|value| Self::drawn(*value))
            .fold((0.0_f64, 0.0_f64), |(low, high), value| {
                (low.min(value), high.max(value))
            });
        // Nothing but zeros, or next to it: an axis of some length all the same.
        let high = if high - low < 1e-9 { low + 1.0 } else { high };
        let (_, step) = ticks(low, high, 8);
        let (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
        let (values, step) = ticks(low, high, 10);
        (low, high, values, step)
    }

    fn axes(&self, area: &plot::Area<'_>, top: f64) -> Result<(), PictureError> {
        let (low, high, marks, step) = self.range();
        let centres: Vec<f64> = (0..REGIONS).map(|n| n as f64 + 0.5).collect();
        let mut chart = ChartBuilder::on(area)
            .margin_top(units(top))
            .margin_right(units(RIGHT))
            .margin_bottom(units(BOTTOM))
            .margin_left(0)
            .x_label_area_size(units(LETTERS))
            .y_label_area_size(units(LEFT))
            .build_cartesian_2d(
                Axis {
                    ends: [0.0, REGIONS as f64],
                    marks: centres,
                },
                Axis {
                    ends: [low, high],
                    marks,
                },
            )
            .map_err(failed)?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .max_light_lines(0)
            .bold_line_style(stroke(GRID, 1.0))
            .axis_style(stroke(FAINT, 1.0))
            .set_all_tick_mark_size(units(4.0))
            .x_label_style(text(14.0))
            .y_label_style(text(12.0))
            .x_label_formatter(&|x| {
                let name = REGION_NAMES.get(x.floor() as usize);
                name.map(char::to_string).unwrap_or_default()
            })
            .y_label_formatter(&|y| label(*y, step))
            .draw()
            .map_err(failed)?;
        if self.series.len() <= MOST_BARS {
            let wide = FILLED / self.series.len() as f64;
            for (place, series) in self.series.iter().enumerate() {
                let look = Look::of(place);
                for (region, &value) in series.values.iter().enumerate() {
                    if !Self::drawn(value) {
                        continue;
                    }
                    let left = region as f64 + (1.0 - FILLED) / 2.0 + place as f64 * wide;
                    let [from, to] = [left + wide * 0.04, left + wide * 0.96];
                    let bar = |style| Rectangle::new([(from, 0.0), (to, value)], style);
                    let body = fill(if look.hollow { PAPER } else { look.colour });
                    chart.draw_series([bar(body)]).map_err(failed)?;
                    if look.hollow {
                        // The library's rectangles have hair lines only, so a path goes around, within the
                        // bar by half its width.
                        let [from, to] = [from + RIM_INSET, to - RIM_INSET];
                        let corners = [(from, 0.0), (from, value), (to, value), (to, 0.0)];
                        let rim = PathElement::new(corners.to_vec(), stroke(look.colour, RIM));
                        chart.draw_series([rim]).map_err(failed)?;
                    }
                }
            }
        } else {
            for (place, series) in self.series.iter().enumerate().rev() {
                let (colour, _) = palette::colour(place);
                let width = if place == 0 { 3.0 } else { 1.5 };
                let points = series.values.iter().enumerate();
                let points: Vec<(f64, f64)> = points
                    .map(|(region, &value)| (region as f64 + 0.5, value))
                    .collect();
                // A line ends where a value is missing.
                for run in points.split(|&(_, value)| !Self::drawn(value)) {
                    let line = PathElement::new(run.to_vec(), stroke(colour, width));
                    let dots = run
                        .iter()
                        .map(|&point| Circle::new(point, units(2.5), fill(colour)));
                    chart.draw_series(dots).map_err(failed)?;
                    if run.len() > 1 {
                        chart.draw_series([line]).map_err(failed)?;
                    }
                }
            }
        }
        // The axis at 0, over the bars that stand on it.
        let zero = PathElement::new(vec![(0.0, 0.0), (REGIONS as f64, 0.0)], stroke(INK, 1.0));
        chart.draw_series([zero]).map_err(failed)?;
        Ok(())
    }

    fn captions(&self, svg: &mut Svg, top: f64) {
        let style = |size, colour, anchor| Text {
            size,
            colour,
            anchor,
            halo: None,
        };
        let room = f64::from(WIDTH) - 48.0;
        let title = elide(self.title, 18.0, room);
        svg.text([24.0, 32.0], &title, style(18.0, INK, Anchor::Start));
        let subtitle = elide(self.subtitle, 13.0, room);
        svg.text([24.0, 52.0], &subtitle, style(13.0, FAINT, Anchor::Start));
        let unit = style(13.0, INK, Anchor::Start);
        svg.text([24.0, top - 14.0], "volume, mm³", unit);
        let axis = top + PLOT + LETTERS + 18.0;
        let middle = LEFT + (f64::from(WIDTH) - LEFT - RIGHT) / 2.0;
        svg.text(
            [middle, axis],
            "region, from the nasal bones (A) down to the lip (K)",
            style(13.0, INK, Anchor::Middle),
        );
        let values = self.series.iter().flat_map(|series| series.values);
        let missing = values.filter(|value| !Self::drawn(*value)).count();
        if missing > 0 {
            let all = self.series.len() * REGIONS;
            let note = format!("{missing} of {all} values are not numbers and are not drawn");
            svg.text(
                [LEFT, axis + 22.0],
                &note,
                style(12.0, FAINT, Anchor::Start),
            );
        }
    }

    /// The legend's entries, flowing in rows.
    fn legend(&self) -> Vec<Entry> {
        let lines = self.series.len() > MOST_BARS;
        let shown = if self.series.len() > MOST_LEGENDS {
            MOST_LEGENDS - 1
        } else {
            self.series.len()
        };
        let mut entries = Vec::new();
        let (mut x, mut row) = (24.0, 0);
        let mut put = |text: String, look: Option<Look>| {
            let mark = if look.is_some() { 22.0 } else { 0.0 };
            let wide = mark + width(&text, LEGEND_SIZE) + 24.0;
            if x > 24.0 && x + wide > f64::from(WIDTH) - 24.0 {
                (x, row) = (24.0, row + 1);
            }
            entries.push(Entry { x, row, text, look });
            x += wide;
        };
        for (place, series) in self.series.iter().take(shown).enumerate() {
            let look = Look {
                hollow: !lines && Look::of(place).hollow,
                ..Look::of(place)
            };
            put(elide(&series.label, LEGEND_SIZE, LONGEST_LABEL), Some(look));
        }
        if shown < self.series.len() {
            let more = self.series.len() - shown;
            put(format!("and {more} more, in the same colours again"), None);
        }
        entries
    }
}

/// How a series is told apart.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Look {
    colour: Colour,
    hollow: bool,
}

impl Look {
    fn of(place: usize) -> Self {
        let (colour, round) = palette::colour(place);
        Self {
            colour,
            hollow: round % 2 == 1,
        }
    }
}

/// An entry of the legend.
#[derive(Debug, Clone, PartialEq)]
struct Entry {
    x: f64,
    row: usize,
    text: String,
    look: Option<Look>,
}

impl Entry {
    fn draw(&self, svg: &mut Svg) {
        let y = 76.0 + self.row as f64 * LEGEND_ROW;
        let mut x = self.x;
        if let Some(look) = self.look {
            svg.rect([x, y - 11.0], [14.0, 12.0], look.colour);
            if look.hollow {
                svg.rect([x + 2.0, y - 9.0], [10.0, 8.0], PAPER);
            } else {
                // A rim, or yellow would be hard to see on white.
                svg.frame([x, y - 11.0], [14.0, 12.0], Stroke::solid(0.5, FAINT));
            }
            x += 22.0;
        }
        let style = Text {
            size: LEGEND_SIZE,
            colour: INK,
            anchor: Anchor::Start,
            halo: None,
        };
        svg.text([x, y], &self.text, style);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::rasterize;

    fn series(count: usize) -> Vec<Series> {
        (0..count)
            .map(|n| Series {
                label: format!("stage {n}"),
                values: std::array::from_fn(|region| {
                    1000.0 + 100.0 * region as f64 - 20.0 * n as f64
                }),
            })
            .collect()
    }

    fn chart(series: &[Series]) -> Result<String, PictureError> {
        let chart = VolumeChart {
            title: "<script>&\"'</script>",
            subtitle: "preoperative and after each stage",
            series,
        };
        chart.svg()
    }

    /// x, y, width, height of the filled rectangles of a colour, in the library's units.
    fn bars(svg: &str, colour: &str) -> Vec<[f64; 4]> {
        let value = |line: &str, name: &str| -> f64 {
            let start = line.find(&format!(" {name}=\"")).unwrap() + name.len() + 3;
            let rest = &line[start..];
            rest[..rest.find('"').unwrap()].parse().unwrap()
        };
        svg.lines()
            .filter(|line| {
                line.starts_with("<rect") && line.contains(&format!("fill=\"{colour}\""))
            })
            .filter(|line| line.contains("opacity"))
            .map(|line| ["x", "y", "width", "height"].map(|name| value(line, name)))
            .collect()
    }

    #[test]
    fn bars_are_as_high_as_their_values() {
        let mut values = [0.0; REGIONS];
        values[0] = 200.0;
        values[1] = 100.0;
        values[2] = -50.0;
        values[3] = f64::NAN;
        let one = Series {
            label: "only".to_owned(),
            values,
        };
        let svg = chart(&[one]).unwrap();
        let bars = bars(&svg, "#000000");
        assert_eq!(bars.len(), REGIONS - 1);
        let [a, b, c, e] = [bars[0], bars[1], bars[2], bars[3]];
        // Whole units: one off in either end of a bar.
        assert!(
            (a[3] - 2.0 * b[3]).abs() <= 3.0 && a[3] > 1000.0,
            "{a:?} {b:?}"
        );
        assert!((a[3] - 4.0 * c[3]).abs() <= 6.0, "{a:?} {c:?}");
        assert!(
            (c[1] - (a[1] + a[3])).abs() <= 2.0,
            "one hangs where the others stand"
        );
        assert_eq!(e[3], 0.0);
        assert!(svg.contains("1 of 11 values are not numbers"));
    }

    #[test]
    fn any_number_of_series_and_any_values_make_a_chart() {
        for count in [1, 2, 3, 8, 9, 12, 13, 24, 25, 200] {
            let svg = chart(&series(count)).unwrap();
            assert!(rasterize(&svg, 0.5).is_ok(), "{count}");
        }
        for value in [
            0.0,
            -0.0,
            1e-320,
            1e-12,
            -3.0,
            1e15,
            1e300,
            f64::MAX,
            f64::NAN,
            f64::NEG_INFINITY,
        ] {
            let mut series = series(2);
            series[1].values = [value; REGIONS];
            assert!(rasterize(&chart(&series).unwrap(), 0.5).is_ok(), "{value}");
            series[0].values = [-value; REGIONS];
            let svg = chart(&series).unwrap();
            assert!(rasterize(&svg, 0.5).is_ok(), "{value}");
            assert!(!svg.contains("NaN") && !svg.contains("inf\""), "{value}");
        }
        assert!(matches!(chart(&[]), Err(PictureError::Empty { .. })));
    }

    #[test]
    fn the_same_text_again_with_titles_escaped_and_labels_cut() {
        let mut series = series(12);
        series[3].label = "a very long name of a candidate, ".repeat(20);
        let svg = chart(&series).unwrap();
        assert_eq!(svg, chart(&series).unwrap());
        assert!(svg.contains("&lt;script&gt;&amp;&quot;") && !svg.contains("<script"));
        assert!(svg.contains('…'));
    }
}
