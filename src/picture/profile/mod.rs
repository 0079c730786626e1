//! The nasal profile of every stage in one plot (paper Figs. 10 and 11).

mod layout;

use plotters::prelude::*;

use super::PictureError;
use super::palette;
use super::plot::{self, Axis, FAINT, FINE, GRID, INK, PAPER, failed, pixels, stroke, text, units};
use super::svg::{Anchor, Stroke, Svg, TextStyle as Text};
use super::text::elide;
use super::ticks::{label, ticks};
use crate::measure::NoseGeometry;
use crate::space::GridPoint;
use layout::{Frame, Place};

/// One stage of the profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfileStage<'a> {
    /// What the table calls it.
    pub name: &'a str,
    /// Its skin in the plane, one point for each height, upwards: what
    /// [`skin_profile`](crate::measure::skin_profile) gives. May be empty.
    pub skin: &'a [GridPoint],
    /// Its tip (P5), gamma and h.
    pub nose: NoseGeometry,
}

/// Profiles in one sagittal plane. Positions are grid millimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfilePlot<'a> {
    /// First line.
    pub title: &'a str,
    /// P1, the landmark `nasal_bones`.
    pub nasal_bones: GridPoint,
    /// P2, the landmark `lip`.
    pub lip: GridPoint,
    /// y of the base plane.
    pub base_y: f64,
    /// x of the plane that the skin is shown in.
    pub plane_x: f64,
    /// The stages, preoperative first. The construction of gamma and h is drawn for the last.
    pub stages: &'a [ProfileStage<'a>],
}

/// A tip this far off the plane is drawn hollow: the skin in the plane does not pass through it, mm.
const OFF_PLANE_MM: f64 = 0.5;
/// Stages that are drawn and in the table; the last is always among them.
const MOST_STAGES: usize = 24;
/// A step of the skin across this many of its heights is a gap, not a line.
const GAP_STEPS: f64 = 2.5;

impl ProfilePlot<'_> {
    /// The sagittal plane midway between P1 and P2: the one to show the skin of all stages in.
    pub fn middle_plane(nasal_bones: GridPoint, lip: GridPoint) -> f64 {
        f64::midpoint(nasal_bones.0.x, lip.0.x)
    }

    /// The plot as SVG. A millimetre is as long across as up; anterior is at the left. Points of the skin that
    /// are not numbers are left out.
    ///
    /// # Errors
    /// [`PictureError::Empty`] where there is no stage, [`PictureError::Value`] where a landmark, tip or the
    /// base plane is not a number or further than 10 m away.
    pub fn svg(&self) -> Result<String, PictureError> {
        let Some(last) = self.stages.last() else {
            return Err(PictureError::Empty {
                what: "a profile needs one stage at least",
            });
        };
        let earlier = self.stages.len().min(MOST_STAGES) - 1;
        let shown: Vec<ProfileStage<'_>> = self.stages.iter().take(earlier).copied().collect();
        let shown = [shown, vec![*last]].concat();
        let frame = Frame::new(self, &shown)?;
        let size = frame.picture();
        let mut svg = Svg::new(size.0, size.1);
        let whole = [f64::from(size.0), f64::from(size.1)];
        svg.rect([0.0, 0.0], whole, PAPER);
        let (element, marks) = plot::draw(size, |area| self.plot(area, &frame, &shown, last))?;
        svg.embed(&element, FINE);
        self.skins(&mut svg, &marks);
        self.annotate(&mut svg, &marks, &shown, last);
        self.captions(&mut svg, &frame);
        self.table(&mut svg, &frame, &shown);
        Ok(svg.finish())
    }

    /// The axes, and where the points of interest have come to lie.
    fn plot(
        &self,
        area: &plot::Area<'_>,
        frame: &Frame,
        shown: &[ProfileStage<'_>],
        last: &ProfileStage<'_>,
    ) -> Result<Marks, PictureError> {
        let (across, up) = (frame.across, frame.up);
        let [margin_left, margin_top, margin_right, margin_bottom] = frame.margins().map(units);
        // As many numbers as have room.
        let most = |mm: f64| (mm * frame.scale / 44.0).clamp(2.0, 14.0) as usize;
        let (x_marks, x_step) = ticks(across[0], across[1], most(across[1] - across[0]));
        let (y_marks, y_step) = ticks(up[0], up[1], most(up[1] - up[0]));
        let mut chart = ChartBuilder::on(area)
            .margin_top(margin_top)
            .margin_right(margin_right)
            .margin_bottom(margin_bottom - units(layout::NUMBERS_BELOW))
            .margin_left(margin_left - units(layout::NUMBERS_LEFT))
            .x_label_area_size(units(layout::NUMBERS_BELOW))
            .y_label_area_size(units(layout::NUMBERS_LEFT))
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
        chart
            .configure_mesh()
            .max_light_lines(0)
            .bold_line_style(stroke(GRID, 1.0))
            .axis_style(stroke(FAINT, 1.0))
            .set_all_tick_mark_size(units(4.0))
            .label_style(text(12.0))
            // Distances in front of the base plane: they grow to the left.
            .x_label_formatter(&|x| label(-x, x_step))
            .y_label_formatter(&|y| label(*y, y_step))
            .draw()
            .map_err(failed)?;

        let at = |place: Place| pixels(chart.backend_coord(&place));
        let [p1, p2] = [self.nasal_bones, self.lip].map(|point| frame.place(point));
        let tip = frame.place(last.nose.tip);
        Ok(Marks {
            p1: at(p1),
            p2: at(p2),
            skins: shown
                .iter()
                .map(|stage| {
                    let runs = frame.runs(stage.skin).into_iter();
                    runs.map(|run| run.into_iter().map(at).collect()).collect()
                })
                .collect(),
            tips: shown
                .iter()
                .map(|stage| at(frame.place(stage.nose.tip)))
                .collect(),
            base: [at((0.0, up[0])), at((0.0, up[1]))],
            foot: at((0.0, tip.1)),
            tip: at(tip),
            arc: layout::arc(tip, p1, p2).into_iter().map(at).collect(),
        })
    }

    fn skins(&self, svg: &mut Svg, marks: &Marks) {
        for (place, runs) in marks.skins.iter().enumerate() {
            let width = if place + 1 == marks.skins.len() {
                2.4
            } else {
                1.7
            };
            for run in runs {
                svg.path(run, look(place, width));
            }
        }
    }

    /// The base plane, h, gamma and the points.
    fn annotate(
        &self,
        svg: &mut Svg,
        marks: &Marks,
        shown: &[ProfileStage<'_>],
        last: &ProfileStage<'_>,
    ) {
        let style = |size, colour, anchor| Text {
            size,
            colour,
            anchor,
            halo: Some(PAPER),
        };
        let thin = Stroke::solid(1.0, INK);
        let dashed = Stroke {
            dash: Some((7.0, 5.0)),
            ..Stroke::solid(1.4, FAINT)
        };
        svg.line(marks.base[0], marks.base[1], dashed);
        svg.line(marks.p1, marks.tip, thin);
        svg.line(marks.p2, marks.tip, thin);
        svg.path(&marks.arc, thin);
        svg.line(marks.tip, marks.foot, thin);
        let [x, y] = marks.foot;
        svg.line([x, y - 5.0], [x, y + 5.0], thin);

        // Both values beyond the foot of h, where no skin is: beside the arc there is that of other stages.
        let (x, anchor) = if marks.tip[0] <= x {
            (x + 8.0, Anchor::Start)
        } else {
            (x - 8.0, Anchor::End)
        };
        let h = format!("h {} mm", fixed(last.nose.height_mm, 2));
        let gamma = format!("γ {}°", fixed(last.nose.gamma_deg, 2));
        svg.text([x, y + 4.5], &h, style(13.0, INK, anchor));
        svg.text([x, y + 22.5], &gamma, style(13.0, INK, anchor));
        let beside = layout::beside_arc(marks.tip, marks.p1, &marks.arc);
        svg.text(beside, "γ", style(13.0, INK, Anchor::Start));
        let [x, y] = marks.base[0];
        let plane = style(12.0, FAINT, Anchor::End);
        svg.text([x - 6.0, y - 8.0], "base plane", plane);

        let rim = |colour| Stroke::solid(1.8, colour);
        for (place, name, down) in [(marks.p1, "P1", -6.0), (marks.p2, "P2", 16.0)] {
            svg.circle(place, 4.0, INK, rim(INK));
            let beside = [place[0] - 9.0, place[1] + down];
            svg.text(beside, name, style(13.0, INK, Anchor::End));
        }
        // The later lie over the earlier. Names stand left of them all, in the air: a name beside its own tip
        // would lie on the tips in front of it.
        let tips = marks.tips.iter().zip(shown).enumerate();
        for (place, (&at, stage)) in tips {
            let (colour, _) = palette::colour(place);
            let hollow = (stage.nose.tip.0.x - self.plane_x).abs() > OFF_PLANE_MM;
            let ground = if hollow { PAPER } else { colour };
            svg.circle(at, 4.5, ground, rim(colour));
        }
        let foremost = marks
            .tips
            .iter()
            .copied()
            .reduce(|a, b| if b[0] < a[0] { b } else { a });
        if let Some([x, y]) = foremost {
            svg.text([x - 10.0, y + 4.5], "P5", style(13.0, INK, Anchor::End));
        }
    }

    fn captions(&self, svg: &mut Svg, frame: &Frame) {
        let style = |size, colour, anchor| Text {
            size,
            colour,
            anchor,
            halo: None,
        };
        let [wide, high] = [frame.picture().0, frame.picture().1].map(f64::from);
        let room = wide - 48.0;
        let title = elide(self.title, 18.0, room);
        svg.text([24.0, 32.0], &title, style(18.0, INK, Anchor::Start));
        let plane = format!(
            "skin in the sagittal plane midway between P1 (nasal bones) and P2 (lip), x = {} mm of the grid",
            fixed(self.plane_x, 1)
        );
        let plane = elide(&plane, 13.0, room);
        svg.text([24.0, 52.0], &plane, style(13.0, FAINT, Anchor::Start));
        let [left, top, ..] = frame.margins();
        let [plot_wide, plot_high] = frame.plot();
        let axis = style(13.0, INK, Anchor::Start);
        svg.text([24.0, top - 12.0], "mm above P2", axis);
        let below = top + plot_high + layout::NUMBERS_BELOW + 14.0;
        let text = "mm in front of the base plane (anterior is left)";
        let middle = left + plot_wide / 2.0;
        svg.text([middle, below], text, style(13.0, INK, Anchor::Middle));
        for (up, note) in [
            (
                32.0,
                "γ and h are measured in space; what is drawn is their projection on this plane.",
            ),
            (
                14.0,
                "A hollow P5 is off the plane: + to the patient's left, − to the right.",
            ),
        ] {
            let note = elide(note, 12.0, room);
            svg.text([24.0, high - up], &note, style(12.0, FAINT, Anchor::Start));
        }
    }

    fn table(&self, svg: &mut Svg, frame: &Frame, shown: &[ProfileStage<'_>]) {
        let style = |colour, anchor| Text {
            size: 13.0,
            colour,
            anchor,
            halo: None,
        };
        let [left, top] = frame.table();
        let columns = [left + 272.0, left + 342.0, left + 476.0];
        let mut y = top + 12.0;
        svg.text([left, y], "stage", style(FAINT, Anchor::Start));
        for (x, name) in columns
            .into_iter()
            .zip(["γ, °", "h, mm", "P5 off plane, mm"])
        {
            svg.text([x, y], name, style(FAINT, Anchor::End));
        }
        svg.line(
            [left, y + 7.0],
            [columns[2], y + 7.0],
            Stroke::solid(1.0, GRID),
        );
        for (place, stage) in shown.iter().enumerate() {
            y += layout::TABLE_ROW;
            svg.line([left, y - 4.0], [left + 21.0, y - 4.0], look(place, 2.4));
            let name = elide(stage.name, 13.0, 180.0);
            svg.text([left + 28.0, y], &name, style(INK, Anchor::Start));
            let values = [
                fixed(stage.nose.gamma_deg, 2),
                fixed(stage.nose.height_mm, 2),
                fixed(stage.nose.tip.0.x - self.plane_x, 1),
            ];
            for (x, value) in columns.into_iter().zip(values) {
                svg.text([x, y], &value, style(INK, Anchor::End));
            }
        }
        if shown.len() < self.stages.len() {
            y += layout::TABLE_ROW;
            let more = format!("and {} more, not drawn", self.stages.len() - shown.len());
            svg.text([left, y], &more, style(FAINT, Anchor::Start));
        }
    }
}

/// Where points have come to lie, pixels.
#[derive(Debug, Clone, PartialEq)]
struct Marks {
    p1: [f64; 2],
    p2: [f64; 2],
    /// The skin of each stage, in unbroken lines.
    skins: Vec<Vec<Vec<[f64; 2]>>>,
    tips: Vec<[f64; 2]>,
    base: [[f64; 2]; 2],
    foot: [f64; 2],
    tip: [f64; 2],
    arc: Vec<[f64; 2]>,
}

/// The line of a stage. Where the colours are used again it is dashed, then dotted.
fn look(place: usize, width: f64) -> Stroke {
    let (colour, round) = palette::colour(place);
    Stroke {
        dash: [None, Some((8.0, 4.0)), Some((2.0, 3.0))]
            .get(round)
            .copied()
            .flatten(),
        ..Stroke::solid(width, colour)
    }
}

/// A number with so many decimals, or a dash where it is none.
fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() || value.abs() > 1e6 {
        return "–".to_owned();
    }
    let text = format!("{value:.decimals$}").replace('-', "−");
    // A zero that came out of rounding keeps no sign.
    let zero = text.chars().all(|c| matches!(c, '−' | '0' | '.'));
    if zero { text.replace('−', "") } else { text }
}

#[cfg(test)]
mod tests;
