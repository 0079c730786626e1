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

use glam::DVec3;

use super::pair::{Frame, PairMap, Segment};
use super::reference::LineSum;
use super::still::{CellSum, StillLines, add_weights};
use super::{Chain, EPSILON, LANES, Lattice, Points};
use crate::feature::{Cage, FeatureKind, FeatureLine, LineError, NoseBox};
use crate::simd::{Real, Vector, larger, size, smaller};
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
#[inline(always)]
pub(super) fn fade<F: Real>(s: F) -> F {
    F::of(1.0) - s * s * s * (F::of(6.0) * s * s - F::of(15.0) * s + F::of(10.0))
}

/// Its derivative.
#[inline(always)]
fn fade_slope<F: Real>(s: F) -> F {
    F::of(-30.0) * s * s * (s - F::of(1.0)) * (s - F::of(1.0))
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
    /// Lines that hold still beside f2..f9, in the model's units.
    pub(super) held: StillLines,
    /// f2..f9 and those.
    pub(super) still: StillLines,
}

/// f2..f9.
fn segments_of(cage: &Cage) -> impl Iterator<Item = Segment> + use<> {
    let edges = cage.edges().into_iter();
    edges.map(|(start, end)| Segment::new(start, end))
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
        let cage = Cage {
            min: to_units(GridPoint(lines.cage.min)),
            max: to_units(GridPoint(lines.cage.max)),
        };
        Ok(Self {
            scale: on.spacing() / units.spacing(),
            offset: units.index_of(on.point_at(DVec3::ZERO)),
            f1,
            pair,
            cage,
            taper: None,
            held: StillLines::default(),
            still: StillLines::new(segments_of(&cage)),
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
            held: StillLines::default(),
            still: StillLines::new(segments_of(&lines.cage)),
        })
    }

    /// Adds lines that are the same in source and target, given in the model's units: they hold what is near them as
    /// f2..f9 do. No plan has such lines.
    #[must_use]
    pub fn holding(mut self, lines: impl IntoIterator<Item = Segment>) -> Self {
        let lines: Vec<Segment> = lines.into_iter().collect();
        self.still.extend(lines.iter().copied());
        self.held.extend(lines);
        self
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
        let still = self.still.lines().iter();
        LineSum::of(self.f1, self.pair).with_fixed_lines(still.map(|line| (line.start, line.end)))
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
    #[inline(always)]
    pub fn to_source<F: Real>(&self, points: &mut Points<F>) {
        let units = self.units_of(points);
        let further = self.further_weights(&units);
        self.pull(&units, &further, points);
    }

    /// As [`StageMap::to_source`], within a cell: `far` is the sum of the weights of those lines beside f2..f9 that are far from
    /// it.
    #[inline(always)]
    pub(super) fn to_source_in_cell<F: Real>(
        &self,
        cell: &CellSum<F>,
        far: &[F; LANES],
        points: &mut Points<F>,
    ) {
        let units = self.units_of(points);
        let mut further = *far;
        cell.add_near(&units, &mut further);
        self.pull(&units, &further, points);
    }

    /// Moves positions, given also in the model's units, and with the sum of the weights there of what holds still beside
    /// f2..f9.
    #[inline(always)]
    fn pull<F: Real>(&self, units: &Points<F>, further: &[F; LANES], points: &mut Points<F>) {
        let strength = self.strength(units, further);
        let m = self.pair.linear;
        let mx: Vector<F> = Vector::of(m.x_axis);
        let my: Vector<F> = Vector::of(m.y_axis);
        let mz: Vector<F> = Vector::of(m.z_axis);
        let (origin, shift) = (Vector::of(self.pair.origin), Vector::of(self.pair.shift));
        let back: Vector<F> = Vector::of(1.0 / self.scale);
        for lane in 0..LANES {
            let x = units.x[lane] - origin.x;
            let y = units.y[lane] - origin.y;
            let z = units.z[lane] - origin.z;
            let s = strength[lane];
            let gx = mx.x * x + my.x * y + mz.x * z + shift.x;
            let gy = mx.y * x + my.y * y + mz.y * z + shift.y;
            let gz = mx.z * x + my.z * y + mz.z * z + shift.z;
            points.x[lane] += s * gx * back.x;
            points.y[lane] += s * gy * back.y;
            points.z[lane] += s * gz * back.z;
        }
    }

    #[inline(always)]
    fn units_of<F: Real>(&self, points: &Points<F>) -> Points<F> {
        let (scale, offset) = (Vector::of(self.scale), Vector::of(self.offset));
        let mut units = Points::zero();
        for lane in 0..LANES {
            units.x[lane] = points.x[lane] * scale.x + offset.x;
            units.y[lane] = points.y[lane] * scale.y + offset.y;
            units.z[lane] = points.z[lane] * scale.z + offset.z;
        }
        units
    }

    /// t·λ at positions in the model's units, with the sum of the weights there of what holds still beside f2..f9.
    #[inline(always)]
    fn strength<F: Real>(&self, units: &Points<F>, further: &[F; LANES]) -> [F; LANES] {
        let f1 = self.f1.measure::<F>();
        let lo: Vector<F> = Vector::of(self.cage.min);
        let hi: Vector<F> = Vector::of(self.cage.max);
        let (none, one) = (F::of(0.0), F::of(1.0));
        let epsilon = F::of(EPSILON);
        let mut strength = [none; LANES];
        for lane in 0..LANES {
            let (x, y, z) = (units.x[lane], units.y[lane], units.z[lane]);
            let (rx, ry, rz) = f1.offset_of(x, y, z);
            let reach = (rx * rx + ry * ry + rz * rz).sqrt() + epsilon;

            let beyond_x = outside(x, lo.x, hi.x);
            let beyond_z = outside(z, lo.z, hi.z);
            let (bx2, bz2) = (beyond_x * beyond_x, beyond_z * beyond_z);
            let (x_lo2, x_hi2) = ((x - lo.x) * (x - lo.x), (x - hi.x) * (x - hi.x));
            let (z_lo2, z_hi2) = ((z - lo.z) * (z - lo.z), (z - hi.z) * (z - hi.z));
            let by_face = |face: F| {
                let y2 = (y - face) * (y - face);
                let weight = |distance2: F| {
                    let reach = distance2.sqrt() + epsilon;
                    reach * reach
                };
                inverse_sum(
                    weight(bx2 + y2 + z_lo2),
                    weight(bx2 + y2 + z_hi2),
                    weight(bz2 + y2 + x_lo2),
                    weight(bz2 + y2 + x_hi2),
                )
            };
            let held = by_face(lo.y) + by_face(hi.y) + further[lane];
            // w₁ / (w₁ + Σ) with numerator and denominator multiplied by (d₁ + ε)².
            strength[lane] = one / (one + reach * reach * held);
        }
        if let Some(taper) = &self.taper {
            let lo: Vector<F> = Vector::of(taper.nose.min.0);
            let hi: Vector<F> = Vector::of(taper.nose.max.0);
            let margin = F::of(taper.margin_mm);
            for lane in 0..LANES {
                let out_x = outside(units.x[lane], lo.x, hi.x);
                let out_y = outside(units.y[lane], lo.y, hi.y);
                let out_z = outside(units.z[lane], lo.z, hi.z);
                let away = (out_x * out_x + out_y * out_y + out_z * out_z).sqrt();
                let s = away / margin;
                // In single precision what is just beyond the margin may seem just within.
                strength[lane] *= fade(if s < one - F::SLACK { s } else { one });
            }
        }
        strength
    }

    /// Σ (d + ε)⁻² over the lines that hold still beside f2..f9.
    #[inline(always)]
    fn further_weights<F: Real>(&self, units: &Points<F>) -> [F; LANES] {
        let mut weights = [F::of(0.0); LANES];
        for line in self.held.lines() {
            add_weights(&line.measure(), units, &mut weights);
        }
        weights
    }

    /// The same, with the gradient of the sum.
    #[inline(always)]
    fn further_gradients<F: Real>(&self, units: &Points<F>) -> [Weight<F>; LANES] {
        let mut weights = [Weight::none(); LANES];
        for line in self.held.lines() {
            let line = line.measure();
            for lane in 0..LANES {
                let (rx, ry, rz) = line.offset_of(units.x[lane], units.y[lane], units.z[lane]);
                weights[lane] = weights[lane].and(Weight::of(rx, ry, rz));
            }
        }
        weights
    }

    /// Moves target positions to their sources and multiplies `determinants` by the Jacobian determinant
    /// of this map there. Closed form; on a feature line itself, where a distance has no gradient, that
    /// gradient counts as zero. The determinant is the same in voxels and in mm.
    #[inline(always)]
    pub fn to_source_with_jacobian<F: Real>(
        &self,
        points: &mut Points<F>,
        determinants: &mut Determinants<F>,
    ) {
        let units = self.units_of(points);
        let (strength, gradient) = self.strength_and_gradient(&units);
        let m = self.pair.linear;
        let mx: Vector<F> = Vector::of(m.x_axis);
        let my: Vector<F> = Vector::of(m.y_axis);
        let mz: Vector<F> = Vector::of(m.z_axis);
        let largest_m = m
            .to_cols_array()
            .into_iter()
            .fold(0.0, |all, one| larger(all, size(one)));
        let largest_m = F::of(largest_m);
        let (origin, shift) = (Vector::of(self.pair.origin), Vector::of(self.pair.shift));
        let back: Vector<F> = Vector::of(1.0 / self.scale);
        let one = F::of(1.0);
        for lane in 0..LANES {
            let x = units.x[lane] - origin.x;
            let y = units.y[lane] - origin.y;
            let z = units.z[lane] - origin.z;
            let s = strength[lane];
            let gx = mx.x * x + my.x * y + mz.x * z + shift.x;
            let gy = mx.y * x + my.y * y + mz.y * z + shift.y;
            let gz = mx.z * x + my.z * y + mz.z * z + shift.z;
            // I + s·M + g ∇sᵀ, by columns.
            let (sx, sy, sz) = (gradient.x[lane], gradient.y[lane], gradient.z[lane]);
            let (xx, xy, xz) = (
                one + mx.x * s + gx * sx,
                mx.y * s + gy * sx,
                mx.z * s + gz * sx,
            );
            let (yx, yy, yz) = (
                my.x * s + gx * sy,
                one + my.y * s + gy * sy,
                my.z * s + gz * sy,
            );
            let (zx, zy, zz) = (
                mz.x * s + gx * sz,
                mz.y * s + gy * sz,
                one + mz.z * s + gz * sz,
            );
            determinants.value[lane] *=
                zx * (xy * yz - xz * yy) + zy * (xz * yx - xx * yz) + zz * (xx * yy - xy * yx);
            let largest_g = larger(larger(size(gx), size(gy)), size(gz)) + one;
            let steepest = larger(larger(size(sx), size(sy)), size(sz));
            let entry = one + largest_m * s + largest_g * steepest;
            determinants.terms[lane] *= F::of(6.0) * entry * entry * entry;
            points.x[lane] += s * gx * back.x;
            points.y[lane] += s * gy * back.y;
            points.z[lane] += s * gz * back.z;
        }
    }

    /// t·λ and its gradient, at positions in the model's units.
    #[inline(always)]
    fn strength_and_gradient<F: Real>(&self, units: &Points<F>) -> ([F; LANES], Points<F>) {
        let f1 = self.f1.measure::<F>();
        let lo: Vector<F> = Vector::of(self.cage.min);
        let hi: Vector<F> = Vector::of(self.cage.max);
        let mut strength = [F::of(0.0); LANES];
        let mut gradient = Points::zero();
        let further = self.further_gradients(units);
        for lane in 0..LANES {
            let (x, y, z) = (units.x[lane], units.y[lane], units.z[lane]);
            let (rx, ry, rz) = f1.offset_of(x, y, z);
            let f1 = Weight::of(rx, ry, rz);
            let (out_x, out_z) = (beyond(x, lo.x, hi.x), beyond(z, lo.z, hi.z));
            let by_face = |face: F| {
                let y = y - face;
                let below = Weight::of(out_x, y, z - lo.z);
                let above = Weight::of(out_x, y, z - hi.z);
                let right = Weight::of(x - lo.x, y, out_z);
                let left = Weight::of(x - hi.x, y, out_z);
                below.and(above).and(right.and(left))
            };
            let held = by_face(lo.y).and(by_face(hi.y)).and(further[lane]);
            let inverse_total = F::of(1.0) / (f1.weight + held.weight);
            strength[lane] = f1.weight * inverse_total;
            // (w₁'Σ − w₁Σ')/Σ², written so that the terms of w₁' cancel before they are computed.
            let inverse_total2 = inverse_total * inverse_total;
            let slope = |f1_slope: F, held_slope: F| {
                (f1_slope * held.weight - held_slope * f1.weight) * inverse_total2
            };
            gradient.x[lane] = slope(f1.x, held.x);
            gradient.y[lane] = slope(f1.y, held.y);
            gradient.z[lane] = slope(f1.z, held.z);
        }
        if let Some(taper) = &self.taper {
            let lo: Vector<F> = Vector::of(taper.nose.min.0);
            let hi: Vector<F> = Vector::of(taper.nose.max.0);
            let margin = F::of(taper.margin_mm);
            for lane in 0..LANES {
                let out_x = beyond(units.x[lane], lo.x, hi.x);
                let out_y = beyond(units.y[lane], lo.y, hi.y);
                let out_z = beyond(units.z[lane], lo.z, hi.z);
                let away = (out_x * out_x + out_y * out_y + out_z * out_z).sqrt();
                let s = smaller(away / margin, F::of(1.0));
                let t = fade(s);
                let slope = fade_slope(s) / (margin * larger(away, F::of(NO_DISTANCE)));
                let pull = slope * strength[lane];
                gradient.x[lane] = gradient.x[lane] * t + out_x * pull;
                gradient.y[lane] = gradient.y[lane] * t + out_y * pull;
                gradient.z[lane] = gradient.z[lane] * t + out_z * pull;
                strength[lane] *= t;
            }
        }
        (strength, gradient)
    }
}

/// Jacobian determinants at positions.
#[derive(Debug, Clone)]
pub struct Determinants<F = f64> {
    /// What they are.
    pub value: [F; LANES],
    /// A bound on the sum of the absolute values of the terms that they were added up from: what rounding made of them
    /// is a small share of this, also where the terms cancel.
    pub terms: [F; LANES],
}

impl<F: Real> Determinants<F> {
    /// Where nothing moves.
    #[inline(always)]
    pub fn ones() -> Self {
        Self {
            value: [F::of(1.0); LANES],
            terms: [F::of(1.0); LANES],
        }
    }
}

/// 1/a + 1/b + 1/c + 1/d, with a single division: most of what a position costs are roots and divisions. Squares of
/// distances within a volume, so that no product leaves the range of `f64`.
#[inline(always)]
fn inverse_sum<F: Real>(a: F, b: F, c: F, d: F) -> F {
    let (ab, cd) = (a * b, c * d);
    ((a + b) * cd + (c + d) * ab) / (ab * cd)
}

/// Distance by which a coordinate lies outside an interval.
#[inline(always)]
fn outside<F: Real>(at: F, lo: F, hi: F) -> F {
    larger(larger(lo - at, at - hi), F::of(0.0))
}

/// Signed distance by which a coordinate lies outside an interval; 0 inside.
#[inline(always)]
fn beyond<F: Real>(at: F, lo: F, hi: F) -> F {
    larger(at - hi, F::of(0.0)) + smaller(at - lo, F::of(0.0))
}

/// A weight and its gradient.
#[derive(Debug, Clone, Copy)]
struct Weight<F> {
    weight: F,
    x: F,
    y: F,
    z: F,
}

impl<F: Real> Weight<F> {
    #[inline(always)]
    fn none() -> Self {
        let none = F::of(0.0);
        Self {
            weight: none,
            x: none,
            y: none,
            z: none,
        }
    }

    /// (d + ε)⁻² for the vector from the nearest point of a line.
    #[inline(always)]
    fn of(x: F, y: F, z: F) -> Self {
        let distance = (x * x + y * y + z * z).sqrt();
        let (reach, distance) = (
            distance + F::of(EPSILON),
            larger(distance, F::of(NO_DISTANCE)),
        );
        // Both inverses with one division.
        let both = F::of(1.0) / (reach * distance);
        let inverse = both * distance;
        let weight = inverse * inverse;
        // −2·(d + ε)⁻³ along the unit vector.
        let slope = F::of(-2.0) * weight * both;
        Self {
            weight,
            x: x * slope,
            y: y * slope,
            z: z * slope,
        }
    }

    /// The sum.
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self {
            weight: self.weight + other.weight,
            x: self.x + other.x,
            y: self.y + other.y,
            z: self.z + other.z,
        }
    }
}

/// One map after another is a [`Chain`]; a single stage is a chain of one.
impl From<StageMap> for Chain {
    fn from(stage: StageMap) -> Self {
        Chain::new(vec![stage])
    }
}
