//! The general map: any number of pairs of feature lines, or of feature points (paper equation 3).
//!
//! The plans of this program use nine lines of which eight hold still, for which
//! [`stage`](super::stage) has a shorter form. This one is what further lines need, and the reference that
//! the short form is tested against.

use glam::DVec3;

use super::pair::{Frame, PairMap, Segment};
use super::{EPSILON, LANES, Points};
use crate::feature::LineError;

/// A weighted sum over pairs of lines, in the units of the lines.
#[derive(Debug, Clone, PartialEq)]
pub struct LineSum {
    lines: Vec<(Segment, PairMap)>,
}

impl LineSum {
    /// The map of the `pairs` (source, target), all with the same kind of frame.
    ///
    /// # Errors
    /// The first pair that has no frame, by its place, and why.
    pub fn new(pairs: &[(Segment, Segment)], frame: Frame) -> Result<Self, (usize, LineError)> {
        let mut lines = Vec::with_capacity(pairs.len());
        for (place, &(source, target)) in pairs.iter().enumerate() {
            let map = PairMap::new(source, target, frame).map_err(|error| (place, error))?;
            lines.push((target, map));
        }
        Ok(Self { lines })
    }

    /// A sum of one line whose map is known.
    pub(super) fn of(target: Segment, map: PairMap) -> Self {
        Self {
            lines: vec![(target, map)],
        }
    }

    /// Adds a pair of point features.
    #[must_use]
    pub fn with_point(mut self, source: DVec3, target: DVec3) -> Self {
        let map = PairMap::translation(source, target);
        self.lines.push((Segment::point(target), map));
        self
    }

    /// Adds lines that are the same in source and target.
    #[must_use]
    pub fn with_fixed_lines(mut self, lines: impl IntoIterator<Item = (DVec3, DVec3)>) -> Self {
        for (start, end) in lines {
            let map = PairMap {
                origin: start,
                linear: glam::DMat3::ZERO,
                shift: DVec3::ZERO,
            };
            self.lines.push((Segment::new(start, end), map));
        }
        self
    }

    /// V' − V: where the tissue at `point` comes from, relative to it.
    pub fn displacement(&self, point: DVec3) -> DVec3 {
        let mut weighted = DVec3::ZERO;
        let mut total = 0.0;
        for (target, map) in &self.lines {
            let reach = target.distance(point) + EPSILON;
            let weight = 1.0 / (reach * reach);
            weighted += weight * map.displacement(point);
            total += weight;
        }
        if total > 0.0 {
            weighted / total
        } else {
            DVec3::ZERO
        }
    }

    /// Moves target positions to their sources.
    pub fn to_source(&self, points: &mut Points) {
        for lane in 0..LANES {
            let at = points.get(lane);
            points.set(lane, at + self.displacement(at));
        }
    }
}
