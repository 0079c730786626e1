//! What one pair of feature lines does to a point (paper equations 1 and 2).

use glam::{DMat3, DVec3};

use crate::feature::LineError;
use crate::simd::{Real, Vector, larger, smaller};

/// Two vectors closer to parallel than this (sine of their angle) give no cross product to build a frame on.
const PARALLEL_TOLERANCE: f64 = 1e-9;

/// A feature as the map sees it: two points in the model's units, which are one for a point feature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// The paper's A.
    pub start: DVec3,
    /// The paper's B.
    pub end: DVec3,
}

impl Segment {
    /// From `start` to `end`.
    pub const fn new(start: DVec3, end: DVec3) -> Self {
        Self { start, end }
    }

    /// A point feature.
    pub const fn point(at: DVec3) -> Self {
        Self { start: at, end: at }
    }

    /// Distance from a point to the segment (not to the line through it; method section 3).
    pub fn distance(&self, point: DVec3) -> f64 {
        let to = point - self.start;
        if self.start == self.end {
            return to.length();
        }
        let along = self.end - self.start;
        let place = (to.dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (to - along * place).length()
    }

    /// Ready to be measured from many points.
    #[inline(always)]
    pub(super) fn measure<F: Real>(&self) -> Measure<F> {
        Measure::new(
            Vector::of(self.start),
            Vector::of(self.end - self.start),
            F::of(self.inverse_length2()),
        )
    }

    /// 1/|AB|²; 0 for a point feature, of which the start is then the nearest place to everything.
    #[inline]
    pub(super) fn inverse_length2(&self) -> f64 {
        if self.start == self.end {
            0.0
        } else {
            1.0 / (self.end - self.start).length_squared()
        }
    }
}

/// A segment with what every distance to it asks for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measure<F> {
    start: Vector<F>,
    along: Vector<F>,
    inverse_length2: F,
}

impl<F: Real> Measure<F> {
    /// A line by its start, where its end is from there, and 1/|AB|².
    #[inline(always)]
    pub(super) fn new(start: Vector<F>, along: Vector<F>, inverse_length2: F) -> Self {
        Self {
            start,
            along,
            inverse_length2,
        }
    }

    /// The vector to a point from the nearest place of the segment.
    #[inline(always)]
    pub(super) fn offset_of(&self, x: F, y: F, z: F) -> (F, F, F) {
        let (a, along) = (self.start, self.along);
        let (ax, ay, az) = (x - a.x, y - a.y, z - a.z);
        let place = (ax * along.x + ay * along.y + az * along.z) * self.inverse_length2;
        let place = smaller(larger(place, F::of(0.0)), F::of(1.0));
        (
            ax - place * along.x,
            ay - place * along.y,
            az - place * along.z,
        )
    }
}

/// How the two axes across a line are scaled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frame {
    /// As the paper prints it: none is normalised, so the axes across the line grow with its length
    /// (model `lee2001`).
    Literal,
    /// Unit length across the line, and the lateral axis of the source divided by a width factor (model
    /// `local`).
    Unit {
        /// Above 1 widens the nose.
        width: f64,
    },
}

/// The affine map of one pair, as a displacement: V'₁ − V = `linear` · (V − `origin`) + `shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairMap {
    /// The paper's A: the start of the target line.
    pub origin: DVec3,
    /// M − I, where M takes target axes to source axes.
    pub linear: DMat3,
    /// A' − A.
    pub shift: DVec3,
}

impl PairMap {
    /// The map that takes the `target` line to the `source` line.
    ///
    /// # Errors
    /// [`LineError::Degenerate`] where a line has no length or shares no frame axis with the other (which
    /// a finite pair of lines always does), [`LineError::NotFinite`] where an end is not finite.
    pub fn new(source: Segment, target: Segment, frame: Frame) -> Result<Self, LineError> {
        let (from, to) = (source.end - source.start, target.end - target.start);
        if !from.is_finite() || !to.is_finite() {
            return Err(LineError::NotFinite);
        }
        let degenerate = LineError::Degenerate {
            length_mm: from.length().min(to.length()),
        };
        let identity = Self {
            origin: target.start,
            linear: DMat3::ZERO,
            shift: DVec3::ZERO,
        };
        let axis = common_axis(from, to).ok_or(degenerate)?;
        let widens = match frame {
            Frame::Literal => false,
            Frame::Unit { width } => width != 1.0,
        };
        if source == target && !widens {
            // Exactly the identity, not the identity within rounding: no edit changes no bit.
            return Ok(identity);
        }
        let (mut source_axes, mut target_axes) = (axes(from, axis), axes(to, axis));
        if let Frame::Unit { width } = frame {
            for frame in [&mut source_axes, &mut target_axes] {
                frame.y_axis = frame.y_axis.normalize();
                frame.z_axis = frame.z_axis.normalize();
            }
            source_axes.z_axis /= width;
        }
        let rows = DMat3::from_cols(
            target_axes.x_axis / target_axes.x_axis.length_squared(),
            target_axes.y_axis / target_axes.y_axis.length_squared(),
            target_axes.z_axis / target_axes.z_axis.length_squared(),
        );
        Ok(Self {
            origin: target.start,
            linear: source_axes * rows.transpose() - DMat3::IDENTITY,
            shift: source.start - target.start,
        })
    }

    /// The map that takes the `target` point to the `source` point: everything moves alike.
    pub fn translation(source: DVec3, target: DVec3) -> Self {
        Self {
            origin: target,
            linear: DMat3::ZERO,
            shift: source - target,
        }
    }

    /// Whether no point moves.
    pub fn is_identity(&self) -> bool {
        self.linear == DMat3::ZERO && self.shift == DVec3::ZERO
    }

    /// V'₁ − V.
    pub fn displacement(&self, point: DVec3) -> DVec3 {
        self.linear * (point - self.origin) + self.shift
    }
}

/// X along the line, Y = X × `axis`, Z = X × Y, none normalised.
fn axes(along: DVec3, axis: DVec3) -> DMat3 {
    let y = along.cross(axis);
    DMat3::from_cols(along, y, along.cross(y))
}

/// The first of x̂, ŷ, ẑ that is parallel to neither line: chosen once for a pair, so that source and
/// target frames correspond.
fn common_axis(source: DVec3, target: DVec3) -> Option<DVec3> {
    let clear = |along: DVec3, axis: DVec3| {
        along.cross(axis).length() > PARALLEL_TOLERANCE * along.length()
    };
    [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .find(|&axis| clear(source, axis) && clear(target, axis))
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: DVec3 = DVec3::new(60.0, 30.0, 80.0);

    fn line(start: DVec3, along: [f64; 3]) -> Segment {
        Segment::new(start, start + DVec3::from_array(along))
    }

    #[test]
    fn the_target_line_goes_to_the_source_line() {
        let source = line(A, [-5.0, -17.0, -18.0]);
        let target = line(A + DVec3::new(1.0, 2.0, 3.0), [4.0, -12.0, -17.0]);
        for frame in [Frame::Literal, Frame::Unit { width: 1.3 }] {
            let map = PairMap::new(source, target, frame).unwrap();
            for place in [0.0, 0.25, 1.0, 1.5] {
                let at = target.start.lerp(target.end, place);
                let expected = source.start.lerp(source.end, place);
                assert!((at + map.displacement(at) - expected).length() < 1e-12);
            }
        }
    }

    #[test]
    fn a_translated_line_translates_everything() {
        let source = line(A, [-5.0, -17.0, -18.0]);
        let by = DVec3::new(3.0, -1.0, 2.0);
        let target = Segment::new(source.start + by, source.end + by);
        for frame in [Frame::Literal, Frame::Unit { width: 1.0 }] {
            let map = PairMap::new(source, target, frame).unwrap();
            let far = DVec3::new(-40.0, 120.0, 3.0);
            assert!((map.displacement(far) + by).length() < 1e-12);
        }
    }

    #[test]
    fn literal_axes_scale_with_the_line_and_unit_axes_do_not() {
        let source = line(A, [0.0, -10.0, 0.0]);
        let target = line(A, [0.0, -20.0, 0.0]);
        let across = A + DVec3::new(1.0, 0.0, 0.0);
        // The target is twice as long: Z, the lateral axis, is X × Y, four times as long.
        let literal = PairMap::new(source, target, Frame::Literal).unwrap();
        assert!((literal.displacement(across).x - (0.25 - 1.0)).abs() < 1e-12);
        let unit = PairMap::new(source, target, Frame::Unit { width: 1.0 }).unwrap();
        assert!(unit.displacement(across).length() < 1e-12);
    }

    #[test]
    fn a_width_above_one_widens() {
        let same = line(A, [0.0, -15.0, -15.0]);
        let map = PairMap::new(same, same, Frame::Unit { width: 2.0 }).unwrap();
        assert!(!map.is_identity());
        // A point 4 mm beside the ridge comes from 2 mm beside it: tissue moved outward.
        let beside = A + DVec3::new(4.0, 0.0, 0.0);
        assert!((map.displacement(beside) - DVec3::new(-2.0, 0.0, 0.0)).length() < 1e-12);
    }

    #[test]
    fn no_edit_is_the_identity_to_the_bit() {
        let same = line(A, [-5.3, -17.1, -18.7]);
        let map = PairMap::new(same, same, Frame::Literal).unwrap();
        assert!(map.is_identity());
        assert_eq!(map.displacement(DVec3::new(0.1, 0.2, 0.3)), DVec3::ZERO);
    }

    #[test]
    fn the_axis_is_shared_where_one_line_is_parallel_to_x() {
        // Parallel to x in the target only: both frames must use ŷ, or the map would turn by 90°.
        let source = line(A, [10.0, 0.0, 1e-6]);
        let target = line(A, [10.0, 0.0, 0.0]);
        let map = PairMap::new(source, target, Frame::Unit { width: 1.0 }).unwrap();
        let beside = A + DVec3::new(0.0, 5.0, 5.0);
        assert!(map.displacement(beside).length() < 1e-5);
        assert_eq!(
            common_axis(DVec3::new(0.0, 3.0, 0.0), DVec3::new(2.0, 0.0, 0.0)),
            Some(DVec3::Z)
        );
    }

    #[test]
    fn distances_to_a_point_are_those_to_both_its_ends() {
        let at = A + DVec3::new(3.0, -4.0, 12.0);
        assert_eq!(Segment::point(A).distance(at), 13.0);
        assert_eq!(Segment::point(A).distance(A), 0.0);
        assert_eq!(Segment::point(A).inverse_length2(), 0.0);
        assert_eq!(line(A, [0.0, 3.0, -4.0]).inverse_length2(), 0.04);
    }

    #[test]
    fn a_line_of_no_length_is_refused() {
        let point = line(A, [0.0, 0.0, 0.0]);
        let good = line(A, [0.0, -15.0, -15.0]);
        assert!(PairMap::new(point, good, Frame::Literal).is_err());
        assert!(PairMap::new(good, point, Frame::Literal).is_err());
    }
}
