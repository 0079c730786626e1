//! Measures of swept candidates against a number that the sweep varies, as small charts in one picture.

use plotters::prelude::*;

use super::PictureError;
use super::palette;
use super::plot::{self, Axis, FAINT, FINE, GRID, INK, PAPER, failed, fill, stroke, text, units};
use super::svg::{Anchor, Colour, Stroke, Svg, TextStyle as Text};
use super::text::{elide, width};
use super::ticks::{label, ticks};

/// Candidates that differ in the number along the axis alone.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepSeries {
    /// What they share, in words; for the legend.
    pub label: String,
    /// What they share of the second number: the colour, where there are many lines.
    pub second: f64,
    /// Values of the number along the axis, in order.
    pub x: Vec<f64>,
    /// For each of them, whether the candidate breaks a limit of the plan.
    pub broken: Vec<bool>,
}

/// One of the small charts.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepPanel {
    /// The measure, with its unit.
    pub title: String,
    /// For each line, the measure at each of its points. What is not a number, or beyond 10¹⁵, is not drawn.
    pub values: Vec<Vec<f64>>,
    /// The values that the plan allows, from the least to the most; infinite where there is no end.
    pub allowed: Option<[f64; 2]>,
    /// The limits in words; may be empty.
    pub limits: String,
    /// The axis is as long as this at least, so that rounding errors do not look like a change.
    pub least_span: f64,
}

/// Measures against a swept number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweepPlot<'a> {
    /// First line.
    pub title: &'a str,
    /// Second line, smaller; may be empty.
    pub subtitle: &'a str,
    /// What is along the axis, with its unit.
    pub x: &'a str,
    /// What colours stand for where there are many lines: the second number, with its unit.
    pub second: &'a str,
    /// The lines of every chart.
    pub lines: &'a [SweepSeries],
    /// The charts, in rows of two.
    pub panels: &'a [SweepPanel],
}

const WIDTH: f64 = 1120.0;
const MARGIN: f64 = 24.0;
/// Between two charts beside each other.
const GAP: f64 = 28.0;
/// A chart: its name, the plot, the numbers below it and the name of the axis.
const NAME: f64 = 34.0;
const PLOT: f64 = 250.0;
const NUMBERS_BELOW: f64 = 24.0;
const AXIS_NAME: f64 = 34.0;
const NUMBERS_LEFT: f64 = 66.0;
/// Room for notes below the charts.
const NOTES: f64 = 34.0;
/// More lines than this are coloured by their second number.
const MOST_NAMED: usize = 8;
const LEGEND_SIZE: f64 = 13.0;
const LEGEND_ROW: f64 = 22.0;
const LEGEND_TOP: f64 = 78.0;
const LONGEST_LABEL: f64 = 320.0;
const SCALE: [f64; 2] = [220.0, 12.0];
const SCALE_STEPS: usize = 55;
const LARGEST: f64 = 1e15;
/// The share of an axis that is free beyond the outermost points, on either side.
const PADDING: f64 = 0.06;
/// A limit that is further beyond the points than this share of what they take up is not on the axis.
const LIMIT_WITHIN: f64 = 0.75;
/// What the plan allows, and its edge.
const ALLOWED: Colour = [223, 240, 227];
const ALLOWED_EDGE: Colour = [112, 170, 128];
/// From few to much, each darker than the next: even with colour blindness, and none too pale for white paper.
const SEQUENCE: [Colour; 4] = [[38, 24, 96], [34, 96, 148], [34, 158, 128], [214, 182, 38]];

impl SweepPlot<'_> {
    /// The plot as SVG.
    ///
    /// # Errors
    /// [`PictureError::Empty`] where there is no chart, or no point in it.
    pub fn svg(&self) -> Result<String, PictureError> {
        let points = self.lines.iter().map(|line| line.x.len()).sum::<usize>();
        if self.panels.is_empty() || points == 0 {
            return Err(PictureError::Empty {
                what: "a plot of a sweep needs one candidate at least",
            });
        }
        let legend = self.legend();
        let rows = match legend.iter().map(|entry| entry.row + 1).max() {
            None if self.is_scaled() => 1,
            rows => rows.unwrap_or(0),
        };
        let top = LEGEND_TOP - 14.0 + rows as f64 * LEGEND_ROW;
        let chart_rows = self.panels.len().div_ceil(2) as f64;
        let row = NAME + PLOT + NUMBERS_BELOW + AXIS_NAME;
        let height = (top + chart_rows * row + NOTES).round();
        let size = (WIDTH as u32, height as u32);
        let mut svg = Svg::new(size.0, size.1);
        svg.rect([0.0, 0.0], [WIDTH, height], PAPER);
        let wide = (WIDTH - 2.0 * MARGIN - GAP) / 2.0;
        let corner = |place: usize| {
            let (across, down) = ((place % 2) as f64, (place / 2) as f64);
            [MARGIN + across * (wide + GAP), top + down * row]
        };
        let (element, ()) = plot::draw(size, |area| {
            for (place, panel) in self.panels.iter().enumerate() {
                let [left, top] = corner(place);
                let margins = [
                    top + NAME,
                    WIDTH - left - wide,
                    height - top - NAME - PLOT - NUMBERS_BELOW,
                    left,
                ];
                self.panel(area, panel, margins.map(units))?;
            }
            Ok(())
        })?;
        svg.embed(&element, FINE);
        for (place, panel) in self.panels.iter().enumerate() {
            self.captions(&mut svg, panel, corner(place), wide);
        }
        self.headings(&mut svg, height);
        for entry in &legend {
            entry.draw(&mut svg);
        }
        if self.is_scaled() {
            self.scale(&mut svg);
        }
        Ok(svg.finish())
    }

    fn is_scaled(&self) -> bool {
        self.lines.len() > MOST_NAMED
    }

    fn drawn(value: f64) -> bool {
        value.is_finite() && value.abs() <= LARGEST
    }

    /// The smallest and the largest of some numbers.
    fn ends(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
        values
            .filter(|value| Self::drawn(*value))
            .fold(None, |ends, value| {
                let [low, high] = ends.unwrap_or([value; 2]);
                Some([f64::min(low, value), f64::max(high, value)])
            })
    }

    /// With room on both sides.
    fn padded([low, high]: [f64; 2], least: f64) -> [f64; 2] {
        // Next to the largest numbers a span of one would be lost.
        let least = least.max(low.abs().max(high.abs()) * 1e-9);
        let more = (least - (high - low)).max(0.0) / 2.0;
        let (low, high) = (low - more, high + more);
        let free = (high - low) * PADDING;
        [low - free, high + free]
    }

    fn across(&self) -> [f64; 2] {
        let all = self.lines.iter().flat_map(|line| line.x.iter().copied());
        let ends = Self::ends(all).unwrap_or_default();
        let least = if ends[0] == ends[1] { 1.0 } else { 0.0 };
        Self::padded(ends, least)
    }

    /// The points, and limits that are near.
    fn up(panel: &SweepPanel) -> [f64; 2] {
        let ends = Self::ends(panel.values.iter().flatten().copied()).unwrap_or_default();
        let [mut low, mut high] = ends;
        let near = (high - low).max(panel.least_span) * LIMIT_WITHIN;
        for limit in panel.allowed.into_iter().flatten() {
            if limit >= ends[0] - near && limit <= ends[1] + near {
                low = low.min(limit);
                high = high.max(limit);
            }
        }
        Self::padded([low, high], panel.least_span)
    }

    /// A chart within margins: top, right, bottom, left.
    fn panel(
        &self,
        area: &plot::Area<'_>,
        panel: &SweepPanel,
        [top, right, bottom, left]: [i32; 4],
    ) -> Result<(), PictureError> {
        let (across, up) = (self.across(), Self::up(panel));
        let (x_marks, x_step) = ticks(across[0], across[1], 8);
        let (y_marks, y_step) = ticks(up[0], up[1], 7);
        let mut chart = ChartBuilder::on(area)
            .margin_top(top)
            .margin_right(right)
            .margin_bottom(bottom)
            .margin_left(left)
            .x_label_area_size(units(NUMBERS_BELOW))
            .y_label_area_size(units(NUMBERS_LEFT))
            .build_cartesian_2d(
                Axis {
                    ends: across,
                    marks: x_marks,
                },
                Axis {
                    ends: up,
                    marks: y_marks,
                },
            )
            .map_err(failed)?;
        if let Some([least, most]) = panel.allowed
            && least <= up[1]
            && most >= up[0]
        {
            let [from, to] = [least, most].map(|end| end.clamp(up[0], up[1]));
            let corners = [(across[0], from), (across[1], to)];
            let band = Rectangle::new(corners, fill(ALLOWED));
            chart.draw_series([band]).map_err(failed)?;
            for end in [least, most]
                .into_iter()
                .filter(|end| (up[0]..=up[1]).contains(end))
            {
                let edge = vec![(across[0], end), (across[1], end)];
                let edge = PathElement::new(edge, stroke(ALLOWED_EDGE, 1.0));
                chart.draw_series([edge]).map_err(failed)?;
            }
        }
        chart
            .configure_mesh()
            .max_light_lines(0)
            .bold_line_style(stroke(GRID, 1.0))
            .axis_style(stroke(FAINT, 1.0))
            .set_all_tick_mark_size(units(4.0))
            .label_style(text(12.0))
            .x_label_formatter(&|x| label(*x, x_step))
            .y_label_formatter(&|y| label(*y, y_step))
            .draw()
            .map_err(failed)?;
        let (thin, radius) = if self.is_scaled() {
            (1.3, 2.8)
        } else {
            (1.8, 3.6)
        };
        // The first line lies over the others: it is the one that is called first.
        let lines = self.lines.iter().zip(&panel.values).enumerate().rev();
        for (place, (line, values)) in lines {
            let colour = self.colour(place, line);
            let points: Vec<((f64, f64), bool)> = line
                .x
                .iter()
                .zip(values)
                .map(|(&x, &y)| (x, y))
                .zip(line.broken.iter().copied())
                .collect();
            // A line ends where a value is missing.
            for run in points.split(|&((x, y), _)| !(Self::drawn(x) && Self::drawn(y))) {
                if run.len() > 1 {
                    let path = run.iter().map(|&(point, _)| point).collect::<Vec<_>>();
                    let path = PathElement::new(path, stroke(colour, thin));
                    chart.draw_series([path]).map_err(failed)?;
                }
                for &(point, broken) in run {
                    let dot = |radius: f64, colour| Circle::new(point, units(radius), fill(colour));
                    chart.draw_series([dot(radius, colour)]).map_err(failed)?;
                    if broken {
                        let hole = dot(radius - 1.4, PAPER);
                        chart.draw_series([hole]).map_err(failed)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn colour(&self, place: usize, line: &SweepSeries) -> Colour {
        if !self.is_scaled() {
            return palette::colour(place).0;
        }
        let [low, high] = self.second_ends();
        let share = if high > low {
            (line.second - low) / (high - low)
        } else {
            0.0
        };
        sequence(share)
    }

    fn second_ends(&self) -> [f64; 2] {
        Self::ends(self.lines.iter().map(|line| line.second)).unwrap_or_default()
    }

    /// What stands around a chart.
    fn captions(&self, svg: &mut Svg, panel: &SweepPanel, [left, top]: [f64; 2], wide: f64) {
        let style = |size, colour, anchor| Text {
            size,
            colour,
            anchor,
            halo: None,
        };
        let y = top + NAME - 10.0;
        svg.text([left, y], &panel.title, style(14.0, INK, Anchor::Start));
        if !panel.limits.is_empty() {
            let room = wide - width(&panel.title, 14.0) - 24.0;
            let limits = elide(&format!("allowed: {}", panel.limits), 12.0, room);
            svg.text([left + wide, y], &limits, style(12.0, FAINT, Anchor::End));
        }
        let middle = left + NUMBERS_LEFT + (wide - NUMBERS_LEFT) / 2.0;
        let below = top + NAME + PLOT + NUMBERS_BELOW + 14.0;
        let x = elide(self.x, 13.0, wide);
        svg.text([middle, below], &x, style(13.0, INK, Anchor::Middle));
    }

    fn headings(&self, svg: &mut Svg, height: f64) {
        let style = |size, colour| Text {
            size,
            colour,
            anchor: Anchor::Start,
            halo: None,
        };
        let room = WIDTH - 2.0 * MARGIN;
        let title = elide(self.title, 18.0, room);
        svg.text([MARGIN, 32.0], &title, style(18.0, INK));
        let subtitle = elide(self.subtitle, 13.0, room);
        svg.text([MARGIN, 52.0], &subtitle, style(13.0, FAINT));
        let mut notes: Vec<&str> = Vec::new();
        if self.panels.iter().any(|panel| panel.allowed.is_some()) {
            notes.push("Shaded: what the plan allows.");
        }
        if self.lines.iter().any(|line| line.broken.contains(&true)) {
            notes.push("Hollow: a candidate that does not keep every limit of the plan.");
        }
        if self
            .panels
            .iter()
            .flat_map(|panel| panel.values.iter().flatten())
            .any(|value| !Self::drawn(*value))
        {
            notes.push("Values that are not numbers are not drawn.");
        }
        svg.text(
            [MARGIN, height - 14.0],
            &notes.join(" "),
            style(12.0, FAINT),
        );
    }

    /// The names of lines, flowing in rows; none where a scale tells them.
    fn legend(&self) -> Vec<Entry> {
        if self.is_scaled() || self.lines.len() < 2 {
            return Vec::new();
        }
        let mut entries = Vec::with_capacity(self.lines.len());
        let (mut x, mut row) = (MARGIN, 0);
        for (place, line) in self.lines.iter().enumerate() {
            let text = elide(&line.label, LEGEND_SIZE, LONGEST_LABEL);
            let wide = 34.0 + width(&text, LEGEND_SIZE) + 24.0;
            if x > MARGIN && x + wide > WIDTH - MARGIN {
                (x, row) = (MARGIN, row + 1);
            }
            let colour = self.colour(place, line);
            entries.push(Entry {
                x,
                row,
                text,
                colour,
            });
            x += wide;
        }
        entries
    }

    /// What colours stand for.
    fn scale(&self, svg: &mut Svg) {
        let style = |anchor| Text {
            size: LEGEND_SIZE,
            colour: INK,
            anchor,
            halo: None,
        };
        let [low, high] = self.second_ends();
        let name = elide(&format!("colour: {}", self.second), LEGEND_SIZE, 420.0);
        let y = LEGEND_TOP;
        svg.text([MARGIN, y], &name, style(Anchor::Start));
        let mut x = MARGIN + width(&name, LEGEND_SIZE) + 20.0;
        let (_, step) = ticks(low, high, 20);
        let [low, high] = [low, high].map(|end| label(end, step.min(0.1)));
        let [low, high] = [low, high].map(|text| trimmed(&text));
        svg.text([x, y], &low, style(Anchor::Start));
        // On whole pixels: neighbours would show seams.
        x = (x + width(&low, LEGEND_SIZE) + 8.0).round();
        let [wide, high_px] = SCALE;
        let one = wide / SCALE_STEPS as f64;
        for step in 0..SCALE_STEPS {
            let colour = sequence((step as f64 + 0.5) / SCALE_STEPS as f64);
            let left = x + step as f64 * one;
            svg.rect([left, y - 11.0], [one, high_px], colour);
        }
        svg.text([x + wide + 8.0, y], &high, style(Anchor::Start));
        let x = x + wide + 8.0 + width(&high, LEGEND_SIZE) + 24.0;
        let lines = format!("{} lines", self.lines.len());
        svg.text(
            [x, y],
            &lines,
            Text {
                colour: FAINT,
                ..style(Anchor::Start)
            },
        );
    }
}

/// Without zeros at the end of its fraction.
fn trimmed(number: &str) -> String {
    if !number.contains('.') || number.contains('e') {
        return number.to_owned();
    }
    number
        .trim_end_matches('0')
        .trim_end_matches('.')
        .to_owned()
}

/// A colour from the first of [`SEQUENCE`] at 0 to the last at 1, straight between neighbours.
fn sequence(share: f64) -> Colour {
    let parts = SEQUENCE.len() - 1;
    let at = share.clamp(0.0, 1.0) * parts as f64;
    let first = (at.floor() as usize).min(parts - 1);
    let rest = at - first as f64;
    let of = |place: usize| SEQUENCE.get(place).copied().unwrap_or_default();
    let (from, to) = (of(first), of(first + 1));
    std::array::from_fn(|channel| {
        let [from, to] = [from[channel], to[channel]].map(f64::from);
        (from + (to - from) * rest).round() as u8
    })
}

/// An entry of the legend.
#[derive(Debug, Clone, PartialEq)]
struct Entry {
    x: f64,
    row: usize,
    text: String,
    colour: Colour,
}

impl Entry {
    fn draw(&self, svg: &mut Svg) {
        let y = LEGEND_TOP + self.row as f64 * LEGEND_ROW;
        let middle = y - 4.5;
        let line = Stroke::solid(1.8, self.colour);
        svg.line([self.x, middle], [self.x + 26.0, middle], line);
        svg.circle([self.x + 13.0, middle], 3.6, self.colour, line);
        let style = Text {
            size: LEGEND_SIZE,
            colour: INK,
            anchor: Anchor::Start,
            halo: None,
        };
        svg.text([self.x + 34.0, y], &self.text, style);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::rasterize;

    fn lines(count: usize) -> Vec<SweepSeries> {
        let line = |n: usize| SweepSeries {
            label: format!("project {n} <mm>"),
            second: n as f64,
            x: vec![0.0, 5.0, 10.0],
            broken: vec![false; 3],
        };
        (0..count).map(line).collect()
    }

    fn panel(lines: usize, allowed: Option<[f64; 2]>) -> SweepPanel {
        let values = |n: usize| [100.0, 110.0, 120.0].map(|value| value - n as f64).to_vec();
        SweepPanel {
            title: "angle γ, °".to_owned(),
            values: (0..lines).map(values).collect(),
            allowed,
            limits: if allowed.is_some() { "90 to 110°" } else { "" }.to_owned(),
            least_span: 1.0,
        }
    }

    fn svg(lines: &[SweepSeries], panels: &[SweepPanel]) -> Result<String, PictureError> {
        let plot = SweepPlot {
            title: "<script>&\"'</script>",
            subtitle: "after the last stage",
            x: "rotate, °",
            second: "project, mm",
            lines,
            panels,
        };
        plot.svg()
    }

    /// Centres of the dots of a colour, in the library's units.
    fn dots(svg: &str, colour: &str) -> Vec<[f64; 2]> {
        let value = |line: &str, name: &str| -> f64 {
            let start = line.find(&format!(" {name}=\"")).unwrap() + name.len() + 3;
            let rest = &line[start..];
            rest[..rest.find('"').unwrap()].parse().unwrap()
        };
        svg.lines()
            .filter(|line| line.starts_with("<circle") && line.contains("opacity"))
            .filter(|line| line.to_lowercase().contains(&format!("fill=\"{colour}\"")))
            .map(|line| ["cx", "cy"].map(|name| value(line, name)))
            .collect()
    }

    #[test]
    fn points_are_where_their_numbers_are() {
        let svg = svg(&lines(1), &[panel(1, None)]).unwrap();
        let dots = dots(&svg, "#000000");
        let [a, b, c] = [dots[0], dots[1], dots[2]];
        assert_eq!(dots.len(), 3);
        assert!(a[0] < b[0] && a[1] > b[1], "to the right, and up: {dots:?}");
        assert!((c[0] - b[0] - (b[0] - a[0])).abs() <= 2.0, "{dots:?}");
        assert!((c[1] - b[1] - (b[1] - a[1])).abs() <= 2.0, "{dots:?}");
        assert!(!svg.contains("<script>") && svg.contains("&lt;script&gt;"));
        assert!(!svg.contains("project"), "one line needs no legend");
    }

    #[test]
    fn few_lines_are_named_and_many_have_a_scale() {
        let few = svg(&lines(8), &[panel(8, None)]).unwrap();
        assert!((0..8).all(|n| few.contains(&format!("project {n} &lt;mm&gt;"))));
        assert!(!few.contains("colour: "));
        let many = svg(&lines(9), &[panel(9, None)]).unwrap();
        assert!(many.contains("colour: project, mm") && many.contains("9 lines"));
        assert!(!many.contains("&lt;mm&gt;"));
        assert_eq!(dots(&many, "#261860").len(), 3, "the smallest");
        assert_eq!(dots(&many, "#d6b626").len(), 3, "the largest");
    }

    #[test]
    fn what_is_allowed_is_shaded_and_what_breaks_a_limit_is_hollow() {
        let mut lines = lines(1);
        let band = "#dff0e3";
        let without = svg(&lines, &[panel(1, None)]).unwrap().to_lowercase();
        assert!(!without.contains(band) && !without.contains("allowed"));
        lines[0].broken[2] = true;
        let allowed = panel(1, Some([f64::NEG_INFINITY, 112.0]));
        let with = svg(&lines, &[allowed]).unwrap();
        assert_eq!(dots(&with, "#ffffff").len(), 1);
        assert!(with.to_lowercase().contains(band));
        assert!(with.contains("allowed: 90 to 110°") && with.contains("Hollow"));
        // A limit far beyond the points does not press them together.
        let far = SweepPlot::up(&panel(1, Some([-1e6, 118.0])));
        assert!(far[0] > 90.0 && far[1] > 120.0);
        let near = SweepPlot::up(&panel(1, Some([95.0, 118.0])));
        assert!(near[0] < 95.0 && near[0] > 90.0);
    }

    #[test]
    fn what_is_no_number_is_left_out_and_a_constant_has_an_axis() {
        let mut odd = panel(1, Some([f64::NAN, f64::INFINITY]));
        odd.values = vec![vec![7.0, f64::NAN, 7.0]];
        let svg = svg(&lines(1), &[odd.clone()]).unwrap();
        assert_eq!(dots(&svg, "#000000").len(), 2);
        assert!(svg.contains("not numbers"));
        let [low, high] = SweepPlot::up(&odd);
        assert!(low < 6.5 && high > 7.5);
        odd.values = vec![vec![f64::INFINITY; 3]];
        assert!(self::svg(&lines(1), &[odd]).is_ok());
    }

    #[test]
    fn nothing_is_no_plot_and_every_plot_can_be_drawn() {
        assert!(matches!(
            svg(&[], &[panel(0, None)]),
            Err(PictureError::Empty { .. })
        ));
        assert!(matches!(
            svg(&lines(1), &[]),
            Err(PictureError::Empty { .. })
        ));
        for count in [1, 3, 40] {
            let panels = vec![panel(count, Some([90.0, 110.0])); 4];
            let drawn = rasterize(&svg(&lines(count), &panels).unwrap(), 1.0).unwrap();
            assert!(drawn.width() == 1120 && drawn.height() > 700);
        }
    }
}
