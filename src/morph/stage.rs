//! One stage's map in its short form: the hot loop of the program.
//!
//! f2..f9 map every point to itself, so the weighted sum of paper equation 3 is
//! V' = V + λ(V)·(V'₁ − V) with λ = w₁/Σw: one affine map and nine distances for a voxel
//! (method section 3). Eight of the nine lines are parallel to x or z. Where f1 is a point, it is a line of
//! no length here, and its map a translation.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in a dozen arrays at once"
)]

use glam::{DMat3, DVec3};

use super::pair::{Frame, PairMap, Segment};
use super::reference::LineSum;
use super::{Chain, EPSILON, LANES, Lattice, Points};
use crate::feature::{Cage, FeatureKind, FeatureLine, LineError, NoseBox};
use crate::space::GridPoint;

/// Below this a distance is zero as far as its direction is concerned: the gradient there is taken as zero.
const NO_DISTANCE: f64 = 1e-12;

/// Where model `local` fades out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Taper {
    /// Full strength inside.
    pub nose: NoseBox,
    /// Nothing beyond this distance from the box, mm.
    pub margin_mm: f64,
}

impl Taper {
    /// t of method section 3: 1 in the box, 0 from the margin on.
    pub fn at(&self, point: GridPoint) -> f64 {
        fade((self.nose.distance(point) / self.margin_mm).min(1.0))
    }
}

/// 1 − s³(6s² − 15s + 10): from 1 at 0 to exactly 0 at 1, flat at both ends.
#[inline]
pub(super) fn fade(s: f64) -> f64 {
    1.0 - s * s * s * (6.0 * s * s - 15.0 * s + 10.0)
}

/// Its derivative.
#[inline]
fn fade_slope(s: f64) -> f64 {
    -30.0 * s * s * (s - 1.0) * (s - 1.0)
}

/// The map of one stage from target to source positions.
///
/// It computes in the model's units and is evaluated on a lattice: unit = lattice index ·
/// `scale` + `offset`.
#[derive(Debug, Clone, PartialEq)]
pub struct StageMap {
    scale: DVec3,
    offset: DVec3,
    pub(super) f1: Segment,
    pub(super) pair: PairMap,
    pub(super) cage: Cage,
    pub(super) taper: Option<Taper>,
}

/// A stage's lines and the cage, in grid millimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageLines {
    /// What of the two lines f1' and f1 is the feature.
    pub kind: FeatureKind,
    /// f1' of the paper.
    pub source: FeatureLine,
    /// f1 of the paper.
    pub target: FeatureLine,
    /// f2..f9.
    pub cage: Cage,
}

impl StageLines {
    /// f1, and what its pair does, in the units that `to_units` takes grid millimetres to.
    fn feature(
        &self,
        to_units: impl Fn(GridPoint) -> DVec3,
        frame: Frame,
    ) -> Result<(Segment, PairMap), LineError> {
        self.source.validate()?;
        self.target.validate()?;
        match self.kind {
            FeatureKind::Line => {
                let segment =
                    |line: &FeatureLine| Segment::new(to_units(line.root), to_units(line.tip));
                let f1 = segment(&self.target);
                Ok((f1, PairMap::new(segment(&self.source), f1, frame)?))
            }
            FeatureKind::Point => {
                let (source, target) = (to_units(self.source.tip), to_units(self.target.tip));
                Ok((Segment::point(target), PairMap::translation(source, target)))
            }
        }
    }
}

impl StageMap {
    /// Model `lee2001`: in voxels of the lattice `units`, evaluated on the lattice `on`.
    ///
    /// # Errors
    /// [`LineError`] where a line has no direction.
    pub fn lee2001(lines: &StageLines, units: &Lattice, on: &Lattice) -> Result<Self, LineError> {
        let to_units = |point| units.index_of(point);
        let (f1, pair) = lines.feature(to_units, Frame::Literal)?;
        Ok(Self {
            scale: on.spacing() / units.spacing(),
            offset: units.index_of(on.point_at(DVec3::ZERO)),
            f1,
            pair,
            cage: Cage {
                min: to_units(GridPoint(lines.cage.min)),
                max: to_units(GridPoint(lines.cage.max)),
            },
            taper: None,
        })
    }

    /// Model `local`: in grid millimetres, evaluated on the lattice `on`. `width` is the line's: a point has
    /// none.
    ///
    /// # Errors
    /// [`LineError`] where a line has no direction.
    pub fn local(
        lines: &StageLines,
        width: f64,
        taper: Taper,
        on: &Lattice,
    ) -> Result<Self, LineError> {
        let (f1, pair) = lines.feature(|point| point.0, Frame::Unit { width })?;
        Ok(Self {
            scale: on.spacing(),
            offset: on.point_at(DVec3::ZERO).0,
            f1,
            pair,
            cage: lines.cage,
            taper: Some(taper),
        })
    }

    /// Whether no point moves.
    pub fn is_identity(&self) -> bool {
        self.pair.is_identity()
    }

    /// Where the stage fades out, for model `local`.
    pub fn taper(&self) -> Option<&Taper> {
        self.taper.as_ref()
    }

    /// The nine lines as a general sum, in the model's units: the reference for the short form. The
    /// taper is not part of it.
    pub fn as_line_sum(&self) -> LineSum {
        LineSum::of(self.f1, self.pair).with_fixed_lines(self.cage.edges())
    }

    /// Units of the model for each voxel of the lattice.
    pub(super) fn scale(&self) -> DVec3 {
        self.scale
    }

    /// A lattice position in the model's units.
    pub fn to_units(&self, index: DVec3) -> DVec3 {
        index * self.scale + self.offset
    }

    /// Moves target positions (lattice voxels) to their sources, in place.
    #[inline]
    pub fn to_source(&self, points: &mut Points) {
        let units = self.units_of(points);
        let strength = self.strength(&units);
        let PairMap {
            origin,
            linear: m,
            shift,
        } = self.pair;
        let (back_x, back_y, back_z) = (1.0 / self.scale.x, 1.0 / self.scale.y, 1.0 / self.scale.z);
        for lane in 0..LANES {
            let x = units.x[lane] - origin.x;
            let y = units.y[lane] - origin.y;
            let z = units.z[lane] - origin.z;
            let s = strength[lane];
            let gx = m.x_axis.x * x + m.y_axis.x * y + m.z_axis.x * z + shift.x;
            let gy = m.x_axis.y * x + m.y_axis.y * y + m.z_axis.y * z + shift.y;
            let gz = m.x_axis.z * x + m.y_axis.z * y + m.z_axis.z * z + shift.z;
            points.x[lane] += s * gx * back_x;
            points.y[lane] += s * gy * back_y;
            points.z[lane] += s * gz * back_z;
        }
    }

    #[inline]
    fn units_of(&self, points: &Points) -> Points {
        let mut units = Points::ZERO;
        for lane in 0..LANES {
            units.x[lane] = points.x[lane] * self.scale.x + self.offset.x;
            units.y[lane] = points.y[lane] * self.scale.y + self.offset.y;
            units.z[lane] = points.z[lane] * self.scale.z + self.offset.z;
        }
        units
    }

    /// t·λ at positions in the model's units.
    #[inline]
    fn strength(&self, units: &Points) -> [f64; LANES] {
        let along = self.f1.end - self.f1.start;
        let inverse_length2 = self.f1.inverse_length2();
        let (a, lo, hi) = (self.f1.start, self.cage.min, self.cage.max);
        let mut strength = [0.0; LANES];
        for lane in 0..LANES {
            let (x, y, z) = (units.x[lane], units.y[lane], units.z[lane]);
            let (ax, ay, az) = (x - a.x, y - a.y, z - a.z);
            let place =
                ((ax * along.x + ay * along.y + az * along.z) * inverse_length2).clamp(0.0, 1.0);
            let (rx, ry, rz) = (
                ax - place * along.x,
                ay - place * along.y,
                az - place * along.z,
            );
            let reach = (rx * rx + ry * ry + rz * rz).sqrt() + EPSILON;

            let beyond_x = (lo.x - x).max(x - hi.x).max(0.0);
            let beyond_z = (lo.z - z).max(z - hi.z).max(0.0);
            let (bx2, bz2) = (beyond_x * beyond_x, beyond_z * beyond_z);
            let (x_lo2, x_hi2) = ((x - lo.x) * (x - lo.x), (x - hi.x) * (x - hi.x));
            let (z_lo2, z_hi2) = ((z - lo.z) * (z - lo.z), (z - hi.z) * (z - hi.z));
            let mut held = 0.0;
            for face in [lo.y, hi.y] {
                let y2 = (y - face) * (y - face);
                for distance2 in [
                    bx2 + y2 + z_lo2,
                    bx2 + y2 + z_hi2,
                    bz2 + y2 + x_lo2,
                    bz2 + y2 + x_hi2,
                ] {
                    let reach = distance2.sqrt() + EPSILON;
                    held += 1.0 / (reach * reach);
                }
            }
            // w₁ / (w₁ + Σ) with numerator and denominator multiplied by (d₁ + ε)².
            strength[lane] = 1.0 / (1.0 + reach * reach * held);
        }
        if let Some(taper) = &self.taper {
            let (lo, hi) = (taper.nose.min.0, taper.nose.max.0);
            for lane in 0..LANES {
                let out_x = (lo.x - units.x[lane]).max(units.x[lane] - hi.x).max(0.0);
                let out_y = (lo.y - units.y[lane]).max(units.y[lane] - hi.y).max(0.0);
                let out_z = (lo.z - units.z[lane]).max(units.z[lane] - hi.z).max(0.0);
                let away = (out_x * out_x + out_y * out_y + out_z * out_z).sqrt();
                strength[lane] *= fade((away / taper.margin_mm).min(1.0));
            }
        }
        strength
    }

    /// Moves target positions to their sources and multiplies `determinants` by the Jacobian determinant
    /// of this map there. Closed form; on a feature line itself, where a distance has no gradient, that
    /// gradient counts as zero. The determinant is the same in voxels and in mm.
    pub fn to_source_with_jacobian(&self, points: &mut Points, determinants: &mut [f64; LANES]) {
        let units = self.units_of(points);
        let (strength, gradient) = self.strength_and_gradient(&units);
        let m = self.pair.linear;
        for lane in 0..LANES {
            let pull = self.pair.displacement(units.get(lane));
            let (s, by) = (strength[lane], gradient.get(lane));
            let jacobian = DMat3::from_cols(
                DVec3::X + m.x_axis * s + pull * by.x,
                DVec3::Y + m.y_axis * s + pull * by.y,
                DVec3::Z + m.z_axis * s + pull * by.z,
            );
            determinants[lane] *= jacobian.determinant();
            points.set(lane, points.get(lane) + pull * s / self.scale);
        }
    }

    /// t·λ and its gradient, at positions in the model's units.
    fn strength_and_gradient(&self, units: &Points) -> ([f64; LANES], Points) {
        let along = self.f1.end - self.f1.start;
        let inverse_length2 = self.f1.inverse_length2();
        let (a, lo, hi) = (self.f1.start, self.cage.min, self.cage.max);
        let mut strength = [0.0; LANES];
        let mut gradient = Points::ZERO;
        for lane in 0..LANES {
            let (x, y, z) = (units.x[lane], units.y[lane], units.z[lane]);
            let to = DVec3::new(x - a.x, y - a.y, z - a.z);
            let place = (to.dot(along) * inverse_length2).clamp(0.0, 1.0);
            let f1 = inverse_square(to - along * place);
            let (out_x, out_z) = (beyond(x, lo.x, hi.x), beyond(z, lo.z, hi.z));
            let mut held = Weight::default();
            for face in [lo.y, hi.y] {
                let y = y - face;
                held += inverse_square(DVec3::new(out_x, y, z - lo.z));
                held += inverse_square(DVec3::new(out_x, y, z - hi.z));
                held += inverse_square(DVec3::new(x - lo.x, y, out_z));
                held += inverse_square(DVec3::new(x - hi.x, y, out_z));
            }
            let inverse_total = 1.0 / (f1.weight + held.weight);
            strength[lane] = f1.weight * inverse_total;
            // (w₁'Σ − w₁Σ')/Σ², written so that the terms of w₁' cancel before they are computed.
            let slope = f1.gradient * held.weight - held.gradient * f1.weight;
            gradient.set(lane, slope * (inverse_total * inverse_total));
        }
        if let Some(taper) = &self.taper {
            let (lo, hi) = (taper.nose.min.0, taper.nose.max.0);
            for lane in 0..LANES {
                let out = DVec3::new(
                    beyond(units.x[lane], lo.x, hi.x),
                    beyond(units.y[lane], lo.y, hi.y),
                    beyond(units.z[lane], lo.z, hi.z),
                );
                let away = out.length();
                let s = (away / taper.margin_mm).min(1.0);
                let t = fade(s);
                let slope = out * (fade_slope(s) / (taper.margin_mm * away.max(NO_DISTANCE)));
                gradient.set(lane, gradient.get(lane) * t + slope * strength[lane]);
                strength[lane] *= t;
            }
        }
        (strength, gradient)
    }
}

/// Signed distance by which a coordinate lies outside an interval; 0 inside.
#[inline]
fn beyond(at: f64, lo: f64, hi: f64) -> f64 {
    (at - hi).max(0.0) + (at - lo).min(0.0)
}

/// A weight and its gradient.
#[derive(Debug, Clone, Copy, Default)]
struct Weight {
    weight: f64,
    gradient: DVec3,
}

impl std::ops::AddAssign for Weight {
    fn add_assign(&mut self, other: Self) {
        self.weight += other.weight;
        self.gradient += other.gradient;
    }
}

/// (d + ε)⁻² for the vector from the nearest point of a line.
#[inline]
fn inverse_square(away: DVec3) -> Weight {
    let distance = away.length();
    let inverse = 1.0 / (distance + EPSILON);
    let weight = inverse * inverse;
    Weight {
        weight,
        gradient: away * (-2.0 * weight * inverse / distance.max(NO_DISTANCE)),
    }
}

/// One map after another is a [`Chain`]; a single stage is a chain of one.
impl From<StageMap> for Chain {
    fn from(stage: StageMap) -> Self {
        Chain::new(vec![stage])
    }
}
