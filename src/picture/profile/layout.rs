//! Which millimetres are shown, and where: no drawing.

use super::{GAP_STEPS, ProfilePlot, ProfileStage};
use crate::picture::PictureError;
use crate::space::GridPoint;

/// A point of the plot: mm behind the base plane (negative in front of it) and mm above P2.
pub(super) type Place = (f64, f64);

/// Room for the numbers along the axes, pixels.
pub(super) const NUMBERS_LEFT: f64 = 52.0;
pub(super) const NUMBERS_BELOW: f64 = 24.0;
pub(super) const TABLE_ROW: f64 = 24.0;

/// Pixels behind the base plane that h's number needs.
const BEHIND: f64 = 100.0;

const TOP: f64 = 92.0;
const BELOW: f64 = 104.0;
const LEFT: f64 = 76.0;
const TABLE_WIDTH: f64 = 476.0;
const TABLE_GAP: f64 = 36.0;
const RIGHT: f64 = 24.0;
/// The most that the plot takes, pixels across and up, and the least.
const MOST: [f64; 2] = [660.0, 700.0];
const LEAST: f64 = 240.0;
/// Shown around everything, mm.
const AROUND_MM: f64 = 6.0;
/// Anything further away than this is no nose, mm.
const FARTHEST_MM: f64 = 10_000.0;

/// The part of the plane that is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Frame {
    base_y: f64,
    lip_z: f64,
    /// Ends of the axes, mm.
    pub across: [f64; 2],
    pub up: [f64; 2],
    /// Pixels in a millimetre, in both directions.
    pub scale: f64,
    rows: usize,
}

impl Frame {
    /// Around the landmarks, tips and skin of the stages.
    pub fn new(plot: &ProfilePlot<'_>, shown: &[ProfileStage<'_>]) -> Result<Self, PictureError> {
        let near = |value: f64| value.is_finite() && value.abs() <= FARTHEST_MM;
        let points = [plot.nasal_bones, plot.lip];
        let points = points
            .into_iter()
            .chain(shown.iter().map(|stage| stage.nose.tip));
        let values = points.clone().flat_map(GridPoint::to_array);
        for value in values.chain([plot.base_y, plot.plane_x]) {
            if !near(value) {
                return Err(PictureError::Value {
                    what: "a position in the profile, mm,",
                    value,
                    condition: " within 10 m",
                });
            }
        }
        let mut frame = Self {
            base_y: plot.base_y,
            lip_z: plot.lip.0.z,
            across: [0.0, 0.0],
            up: [0.0, 0.0],
            scale: 1.0,
            rows: shown.len() + 2,
        };
        let skin = shown.iter().flat_map(|stage| stage.skin.iter().copied());
        let skin = skin.filter(|point| near(point.0.y) && near(point.0.z));
        for point in points.chain(skin) {
            let (x, y) = frame.place(point);
            frame.across = [frame.across[0].min(x), frame.across[1].max(x)];
            frame.up = [frame.up[0].min(y), frame.up[1].max(y)];
        }
        let around = |[low, high]: [f64; 2]| [low - AROUND_MM, high + AROUND_MM];
        (frame.across, frame.up) = (around(frame.across), around(frame.up));
        let lengths = [frame.across, frame.up].map(|[low, high]| high - low);
        frame.scale = (MOST[0] / lengths[0]).min(MOST[1] / lengths[1]);
        frame.across[1] = frame.across[1].max(BEHIND / frame.scale);
        // Whole pixels, and never a sliver: the axes are lengthened, so that the scale stays that of both.
        let fill = |ends: [f64; 2]| {
            let pixels = ((ends[1] - ends[0]) * frame.scale).ceil().max(LEAST);
            let more = (pixels / frame.scale - (ends[1] - ends[0])) / 2.0;
            [ends[0] - more, ends[1] + more]
        };
        (frame.across, frame.up) = (fill(frame.across), fill(frame.up));
        Ok(frame)
    }

    /// A point, projected onto the plane.
    pub fn place(&self, point: GridPoint) -> Place {
        (point.0.y - self.base_y, point.0.z - self.lip_z)
    }

    /// Size of the plot, pixels: width, height.
    pub fn plot(&self) -> [f64; 2] {
        [self.across, self.up].map(|[low, high]| ((high - low) * self.scale).round())
    }

    /// Around the plot, pixels: left, top, right, bottom. Numbers along the axes are within.
    pub fn margins(&self) -> [f64; 4] {
        let (width, height) = self.picture();
        let [wide, high] = self.plot();
        let right = f64::from(width) - LEFT - wide;
        [LEFT, TOP, right, f64::from(height) - TOP - high]
    }

    /// Size of the picture, pixels.
    pub fn picture(&self) -> (u32, u32) {
        let [wide, high] = self.plot();
        let width = LEFT + wide + TABLE_GAP + TABLE_WIDTH + RIGHT;
        let rows = self.rows as f64 * TABLE_ROW;
        let height = TOP + high.max(rows) + BELOW;
        (width.round() as u32, height.round() as u32)
    }

    /// The table's upper left corner, pixels.
    pub fn table(&self) -> [f64; 2] {
        [LEFT + self.plot()[0] + TABLE_GAP, TOP]
    }

    /// The skin as unbroken lines: a point that is not a number, or heights without skin, end one.
    pub fn runs(&self, skin: &[GridPoint]) -> Vec<Vec<Place>> {
        let places = || skin.iter().map(|&point| self.place(point));
        let near = |&(x, y): &Place| x.abs() <= 2.0 * FARTHEST_MM && y.abs() <= 2.0 * FARTHEST_MM;
        let heights = places().zip(places().skip(1));
        let steps = heights.map(|(a, b)| b.1 - a.1).filter(|step| *step > 0.0);
        let step = steps.fold(f64::INFINITY, f64::min);
        let mut runs: Vec<Vec<Place>> = Vec::new();
        let mut before: Option<Place> = None;
        for place in places() {
            if !near(&place) {
                before = None;
                continue;
            }
            let goes_on =
                before.is_some_and(|(_, height)| (place.1 - height).abs() <= GAP_STEPS * step);
            match runs.last_mut() {
                Some(run) if goes_on => run.push(place),
                _ => runs.push(vec![place]),
            }
            before = Some(place);
        }
        runs
    }
}

/// Points of the arc at `tip` from the direction of `p1` to that of `p2`, the short way round. Empty where a
/// direction is none.
pub(super) fn arc(tip: Place, p1: Place, p2: Place) -> Vec<Place> {
    /// The arc's radius, as a share of the shorter side of the angle.
    const SHARE: f64 = 0.22;
    const PIECES: u32 = 32;
    let to = |end: Place| (end.0 - tip.0, end.1 - tip.1);
    let length = |(x, y): Place| (x * x + y * y).sqrt();
    let (a, b) = (to(p1), to(p2));
    let radius = SHARE * length(a).min(length(b));
    if radius <= 0.0 {
        return Vec::new();
    }
    let (from, till) = (libm::atan2(a.1, a.0), libm::atan2(b.1, b.0));
    let turn = std::f64::consts::TAU;
    let mut sweep = till - from;
    if sweep > turn / 2.0 {
        sweep -= turn;
    } else if sweep < -turn / 2.0 {
        sweep += turn;
    }
    (0..=PIECES)
        .map(|piece| {
            let angle = from + sweep * f64::from(piece) / f64::from(PIECES);
            (
                tip.0 + radius * libm::cos(angle),
                tip.1 + radius * libm::sin(angle),
            )
        })
        .collect()
}

/// Where gamma's number begins: beside the first third of the arc, away from the tip. Pixels.
pub(super) fn beside_arc(tip: [f64; 2], p1: [f64; 2], arc: &[[f64; 2]]) -> [f64; 2] {
    let on_arc = arc.get(arc.len() / 3).copied().unwrap_or(p1);
    let away = [on_arc[0] - tip[0], on_arc[1] - tip[1]];
    let length = (away[0] * away[0] + away[1] * away[1]).sqrt().max(1.0);
    [
        on_arc[0] + away[0] / length * 10.0,
        on_arc[1] + away[1] / length * 10.0,
    ]
}
