//! The head itself: which primitives, where, and how they are joined. Grid millimetres; every field is
//! negative inside.

use super::chain::{Chain, Join, Step};
use super::primitives::{
    Point, Scalar, bend, capsule, ellipse, ellipsoid, intersection, rounded_box, soft_abs, spline,
    union, without,
};

/// Voxel spacing of the default grid in plane, mm: the paper's.
pub(super) const PIXEL_MM: f64 = 0.442;
/// The midline, x in mm.
pub(super) const MIDLINE: f64 = 141.089 * PIXEL_MM;
/// z of the `nasal_bones` landmark, mm.
pub(super) const TOP_Z: f64 = 78.882;
/// z of the `lip` landmark, mm.
pub(super) const LIP_Z: f64 = 53.121;
/// The base plane, y in mm.
pub(super) const BASE_Y: f64 = 83.61 * PIXEL_MM;

/// Thickness of soft tissue over bone, mm: so far down the blurred skin edge does not see it.
const COVER: f64 = 3.0;

/// A part of the head, mirrored parts counted once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Part {
    Cranium,
    Mask,
    Neck,
    Cheeks,
    Chin,
    Brow,
    Sockets,
    Lids,
    LidLines,
    Ears,
    Lips,
    Nose,
    Airway,
    Vault,
    Midface,
    Mandible,
    Spine,
    NasalBones,
    Brain,
}

/// What the skin and the linings of the airways enclose. The order matters: a part is rounded into what
/// stands before it.
pub(super) const TISSUE: Chain<13> = Chain([
    Step(Join::Union, Part::Cranium, 1.0),
    Step(Join::Union, Part::Mask, 8.0),
    Step(Join::Union, Part::Neck, 20.0),
    Step(Join::Union, Part::Cheeks, 14.0),
    Step(Join::Union, Part::Chin, 10.0),
    Step(Join::Union, Part::Brow, 9.0),
    Step(Join::Without, Part::Sockets, 5.0),
    Step(Join::Union, Part::Lids, 2.5),
    Step(Join::Without, Part::LidLines, 0.8),
    Step(Join::Union, Part::Ears, 3.0),
    Step(Join::Union, Part::Lips, 2.5),
    Step(Join::Union, Part::Nose, 4.0),
    Step(Join::Without, Part::Airway, 1.5),
]);

/// Bone, before it is kept beneath the skin.
pub(super) const BONE: Chain<6> = Chain([
    Step(Join::Union, Part::Vault, 1.0),
    Step(Join::Union, Part::Midface, 2.0),
    Step(Join::Union, Part::Mandible, 1.0),
    Step(Join::Union, Part::Spine, 2.0),
    Step(Join::Union, Part::NasalBones, 2.0),
    Step(Join::Without, Part::Brain, 1.0),
]);

/// Rounding of the bone where it is kept beneath the skin, mm.
pub(super) const COVER_ROUNDING: f64 = 1.0;

/// Where bone may be: deep enough beneath the surface of `tissue`.
pub(super) fn cover<S: Scalar>(tissue: S) -> S {
    tissue + COVER
}

/// What the cover leaves of `bone`.
pub(super) fn covered<S: Scalar>(bone: S, tissue: S) -> S {
    intersection(bone, cover(tissue), COVER_ROUNDING)
}

/// The skin and the linings of the airways.
pub(super) fn tissue<S: Scalar>(p: Point<S>) -> S {
    TISSUE.field(TISSUE.whole(), p)
}

/// The brain: all of what the vault holds.
pub(super) fn brain<S: Scalar>(p: Point<S>) -> S {
    Part::Brain.field(p)
}

fn from_midline<S: Scalar>([x, y, z]: Point<S>) -> Point<S> {
    [x - MIDLINE, y, z]
}

impl Part {
    /// The part's field at a point.
    pub fn field<S: Scalar>(self, point: Point<S>) -> S {
        let p = from_midline(point);
        let [u, y, z] = p;
        // Rounded, so that the halves of what crosses the midline meet without a crease.
        let mirrored = [soft_abs(u, 2.0), y, z];
        match self {
            Self::Cranium => ellipsoid(p, [0.0, 86.0, 98.0], [51.0, 51.0, 45.0]),
            Self::Mask => mask(p, mirrored),
            Self::Neck => {
                // It leans forward to the head.
                let along = y - 96.0 + bend(z, 0.004, 0.2);
                let column = ellipse(u, along, S::constant(27.0), S::constant(26.0));
                intersection(column, z - 72.0, 14.0)
            }
            Self::Cheeks => ellipsoid(mirrored, [25.0, 60.0, 66.0], [15.0, 17.0, 11.0]),
            Self::Chin => ellipsoid(p, [0.0, 41.0, 28.5], [15.0, 12.0, 9.0]),
            Self::Brow => {
                // Highest over the middle of the eye.
                let arch = z + bend(mirrored[0] - 17.0, 0.024, 0.4);
                ellipsoid(
                    [mirrored[0], y, arch],
                    [14.0, 39.6, 102.0],
                    [14.0, 7.0, 5.0],
                )
            }
            Self::Sockets => ellipsoid(mirrored, [19.0, 27.0, 93.0], [11.0, 9.5, 6.5]),
            Self::Lids => lids(mirrored),
            Self::LidLines => lid_lines(mirrored),
            Self::Ears => ears(mirrored),
            Self::Lips => lips(mirrored),
            Self::Nose => nose(p),
            Self::Airway => airway(p),
            Self::Vault => ellipsoid(p, [0.0, 87.0, 97.0], [46.0, 45.0, 38.0]),
            Self::Brain => ellipsoid(p, [0.0, 87.0, 97.0], [41.0, 40.0, 33.0]),
            Self::Midface => midface(p, mirrored),
            Self::Mandible => mandible(p, mirrored),
            Self::Spine => {
                let column = ellipse(u, y - 101.0, S::constant(9.0), S::constant(8.0));
                intersection(column, z - 56.0, 2.0)
            }
            Self::NasalBones => capsule(
                // A roof: wider than it is thick.
                [straightened(u, y) * 0.8, y, z],
                ([0.0, 38.0, 81.0], 3.5),
                ([0.0, 30.5, 70.5], 2.2),
            ),
        }
    }
}

/// Closed eyelids over the eyeballs.
fn lids<S: Scalar>(mirrored: Point<S>) -> S {
    ellipsoid(mirrored, [19.0, 43.5, 92.0], [9.5, 8.2, 6.4])
}

/// The line between the closed lids: a thin tube on their surface.
fn lid_lines<S: Scalar>(mirrored: Point<S>) -> S {
    const RADIUS: f64 = 0.65;
    let [side, y, z] = mirrored;
    let across = side - 19.0;
    let height = z - 90.6 - bend(across, 0.036, 0.4);
    // It thins out to the corners of the eye.
    let radius = -bend(across, 0.022, 0.4) + RADIUS;
    let tube = (lids(mirrored).square() + height.square()).sqrt() - radius;
    intersection(tube, y - 39.0, 1.0)
}

/// Ear shells with their hollows.
fn ears<S: Scalar>(mirrored: Point<S>) -> S {
    let [side, y, z] = mirrored;
    // Tilted backwards.
    let p = [side, y - (z - 80.0) * 0.22, z];
    let shell = ellipsoid(p, [50.0, 90.0, 80.0], [4.8, 8.0, 11.5]);
    let hollow = ellipsoid(p, [55.5, 88.3, 80.5], [4.5, 4.6, 7.6]);
    without(shell, hollow, 2.0)
}

/// Upper and lower lip. They taper to the corners of the mouth, where they go under the skin.
fn lips<S: Scalar>([side, y, z]: Point<S>) -> S {
    // They follow the dental arch backwards; the upper one dips to the corners, the lower one rises.
    let bent = y - bend(side, 0.022, 0.32);
    let upper = [side, bent, z + bend(side, 0.010, 0.2)];
    let upper = capsule(upper, ([0.0, 29.5, 45.6], 3.1), ([18.0, 29.5, 45.6], 1.2));
    let lower = [side, bent, z - bend(side, 0.010, 0.2)];
    let lower = capsule(lower, ([0.0, 29.7, 40.6], 3.4), ([17.0, 29.7, 40.6], 1.2));
    union(upper, lower, 0.8)
}

/// Width of one of the slabs A..K, mm; also the step of the nose's splines.
const STEP: f64 = (TOP_Z - LIP_Z) / 11.0;
/// Number of spline steps above the `nasal_bones` plane.
const STEPS_ABOVE: f64 = 5.0;
/// The nose's sections are half-ellipses that stand on this plane inside the face, y in mm.
const NOSE_BACK: f64 = 40.0;
/// The bridge: y in mm at z = 78.882 + 2.342·(5 − n).
const RIDGE: [f64; 18] = [
    38.0, 38.0, 37.5, 37.18, 34.36, 31.65, 28.96, 26.41, 23.99, 21.6, 19.3, 17.45, 15.85, 15.1,
    15.1, 15.5, 16.5, 17.5,
];
/// How far the middle of the face stands in front of the base plane, mm, at the same heights, and on down to
/// the chin.
const FACE_HEIGHT: [f64; 32] = [
    -1.6, -1.6, -0.2, 1.2, 2.3, 3.25, 4.05, 4.7, 5.2, 5.5, 5.6, 5.4, 5.1, 5.05, 5.95, 6.65, 7.03,
    7.3, 7.5, 7.6, 7.5, 7.2, 6.5, 5.8, 5.6, 6.0, 6.7, 7.2, 7.2, 6.6, 5.0, 3.0,
];
/// The lower face's sections change over steps of this height, mm, downwards from [`SECTIONS_TOP`].
const SECTION_STEP: f64 = 8.0;
const SECTIONS_TOP: f64 = 100.0;
/// Half the face's width, mm, from the temples to the chin.
const FACE_WIDTH: [f64; 12] = [
    43.5, 43.5, 45.2, 45.8, 45.8, 45.4, 44.0, 40.8, 35.5, 28.5, 22.0, 20.0,
];
/// How far the front is rounded to the sides beyond its broad curve, a share: none beside the nose, all at
/// the chin.
const CHIN_ROUNDING: [f64; 12] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.15, 0.7, 1.0, 1.0];

/// Cheeks, maxilla, upper lip and lower face: a broad front whose sections beside the nose bend little along z,
/// so that half scale, which blurs most along z, moves it little.
fn mask<S: Scalar>([u, y, z]: Point<S>, mirrored: Point<S>) -> S {
    let t = (-z + TOP_Z) * (1.0 / STEP) + STEPS_ABOVE;
    let section = (-z + SECTIONS_TOP) * (1.0 / SECTION_STEP);
    let front = -spline(&FACE_HEIGHT, t) + BASE_Y;
    let edge = mirrored[0] - 34.0;
    let fold = (edge + soft_abs(edge, 6.0)) * 0.5;
    let chin = bend(u, 0.03, 0.6) * spline(&CHIN_ROUNDING, section);
    let surface = (front + bend(u, 0.003, 0.2) + chin + fold * 1.2 - y) * 0.8;
    // The sides: a superellipse of fourth order, behind the fold.
    let width = spline(&FACE_WIDTH, section);
    let (across, along) = (u.over(width).square(), ((y - 80.0) * (1.0 / 58.0)).square());
    let sides = ((across.square() + along.square()).sqrt().sqrt() - 1.0) * width;
    let body = intersection(surface, sides, 5.0);
    // Behind, the jaw slants inwards to the neck; below, it rises to its angle.
    let body = intersection(body, (mirrored[0] - 42.0) * 0.6 + (y - 79.0) * 0.8, 14.0);
    let below = (-z + 20.0 + bend(y - 34.0, 0.02, 0.35)) * 0.94;
    let body = intersection(body, below, 9.0);
    intersection(body, z - 94.0, 10.0)
}
/// Half the nose's width on the plane [`NOSE_BACK`], mm, at the same heights.
const HALF_WIDTH: [f64; 18] = [
    6.0, 6.0, 6.5, 7.2, 8.5, 10.4, 13.0, 15.6, 18.0, 20.1, 21.9, 23.3, 24.2, 24.8, 25.0, 25.0,
    25.0, 25.0,
];
/// How far the tip lies from the midline, mm (to the patient's right).
const TIP_SHIFT: f64 = (129.0 - 141.089) * PIXEL_MM;
/// The deviation grows from here, y in mm, to the tip: so far back the wings stay where they are.
const SHEAR_FROM: f64 = 28.0;
/// y of the tip, mm.
const TIP_Y: f64 = 33.0 * PIXEL_MM;

/// x from the midline, with the nose's deviation taken out: it grows from [`SHEAR_FROM`] to the
/// tip, so the ridge goes nearly straight from root to tip while face and wings stay almost symmetric.
fn straightened<S: Scalar>(u: S, y: S) -> S {
    let rise = (-y + SHEAR_FROM) * (1.0 / (SHEAR_FROM - TIP_Y));
    let ramp = (rise + soft_abs(rise, 0.12)) * 0.5;
    u - ramp * TIP_SHIFT
}

/// The nose without its nostrils: sections along the bridge and the tip.
fn nose<S: Scalar>([u, y, z]: Point<S>) -> S {
    let straight = straightened(u, y);
    let t = (-z + TOP_Z) * (1.0 / STEP) + STEPS_ABOVE;
    let height = -spline(&RIDGE, t) + NOSE_BACK;
    let width = spline(&HALF_WIDTH, t);
    let bridge = ellipse(straight, -y + NOSE_BACK, width, height);
    let bridge = intersection(bridge, z - 92.0, 4.0);
    let tip = ellipsoid([straight, y, z], [0.0, 21.2, 61.0], [7.2, 6.5, 5.0]);
    let whole = union(bridge, tip, 4.0);
    // The underside rises to the tip and to the rims of the wings.
    let below = -z + (-y + 30.0) * 0.05 + bend(u, 0.0012, 0.2) + 59.4;
    intersection(whole, below, 3.0)
}

/// Nostrils, nasal cavity, nasopharynx and windpipe. The nostrils end blindly: a channel back to the cavity
/// would lie in front of the base plane, where half scale fills some of its 3 mm²/mm at every stage.
fn airway<S: Scalar>([u, y, z]: Point<S>) -> S {
    // The nostrils are longer from front to back than across.
    const STRETCH: f64 = 0.68;
    let side = soft_abs(straightened(u, y), 0.4);
    let p = [side, y * STRETCH, z];
    let at = |x: f64, y: f64, z: f64| [x, y * STRETCH, z];
    let nostril = capsule(p, (at(6.8, 23.5, 52.0), 3.3), (at(6.4, 25.5, 60.6), 3.3));
    let cavity = [soft_abs(u, 0.4), y, z];
    let cavity = rounded_box(cavity, [3.9, 62.0, 66.0], [0.8, 18.0, 4.6], 1.4);
    let pharynx = union(
        capsule(
            [u, y, z],
            ([0.0, 82.0, 64.0], 5.5),
            ([0.0, 85.0, 45.0], 6.0),
        ),
        capsule(
            [u, y, z],
            ([0.0, 85.0, 45.0], 6.0),
            ([0.0, 80.0, -20.0], 6.5),
        ),
        3.0,
    );
    union(union(nostril, cavity, 2.0), pharynx, 4.0)
}

/// Maxilla, cheekbones and the rims of the orbits.
fn midface<S: Scalar>(p: Point<S>, mirrored: Point<S>) -> S {
    let maxilla = ellipsoid(p, [0.0, 62.0, 60.0], [22.0, 20.0, 11.0]);
    let zygoma = ellipsoid(mirrored, [29.0, 57.0, 66.0], [9.0, 10.0, 6.0]);
    let rims = ellipsoid(mirrored, [19.0, 50.0, 78.5], [15.0, 9.0, 11.0]);
    let orbits = ellipsoid(mirrored, [19.0, 52.0, 78.5], [11.0, 18.0, 8.0]);
    let whole = union(union(maxilla, zygoma, 5.0), rims, 5.0);
    without(whole, orbits, 1.5)
}

/// The lower jaw: an arch (in plan, the outline of an ellipse) and its rami.
fn mandible<S: Scalar>([u, y, z]: Point<S>, mirrored: Point<S>) -> S {
    let outline = ellipse(u, y - 72.0, S::constant(27.0), S::constant(33.0));
    let flat = outline.square() * (1.0 / 9.0) + ((z - 38.0) * (1.0 / 6.0)).square();
    let arch = flat.sqrt() * 3.0 - 3.0;
    let arch = intersection(arch, y - 80.0, 3.0);
    let ramus = capsule(
        mirrored,
        ([27.0, 76.0, 40.0], 3.5),
        ([33.0, 82.0, 62.0], 3.0),
    );
    union(arch, ramus, 3.0)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::phantom::primitives::Dual;
    use crate::phantom::render::STEEPEST;

    /// Points all over the head and around it.
    fn points() -> impl Iterator<Item = DVec3> {
        let axis = |to: i32| (0..to).map(|n| f64::from(n) * 1.7 + 0.013);
        axis(84).flat_map(move |x| {
            axis(84).flat_map(move |y| axis(90).map(move |z| DVec3::new(x, y, z - 1.0)))
        })
    }

    #[test]
    fn no_field_is_steeper_near_its_surface_than_the_tiles_assume() {
        const NEAR: f64 = 5.0;
        let mut parts: Vec<Part> = TISSUE.0.iter().map(|step| step.1).collect();
        parts.extend(BONE.0.iter().map(|step| step.1));
        for point in points() {
            let at = Dual::coordinates(point);
            for part in &parts {
                let field = part.field(at);
                let slope = field.gradient.length();
                assert!(
                    field.value.abs() > NEAR || slope < STEEPEST,
                    "{part:?} at {point}: {slope}"
                );
            }
        }
    }

    #[test]
    fn gradients_are_those_of_the_values() {
        const STEP: f64 = 1e-5;
        // Joints are twice differentiable, so central differences are good to about STEP².
        const TOLERANCE: f64 = 1e-6;
        let mut compared = 0;
        for point in points() {
            let field = tissue(Dual::coordinates(point));
            assert_eq!(field.value, tissue(point.to_array()));
            if field.value.abs() > 1.0 {
                continue;
            }
            compared += 1;
            let along = |axis: DVec3| {
                let ahead = tissue((point + axis * STEP).to_array());
                let behind = tissue((point - axis * STEP).to_array());
                (ahead - behind) / (2.0 * STEP)
            };
            let expected = DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
            let off = (field.gradient - expected).length();
            assert!(off < TOLERANCE, "{point}: off by {off}");
        }
        assert!(compared > 1000, "{compared}");
    }

    #[test]
    fn the_depth_is_the_distance_to_the_skin_to_first_order() {
        /// How far from the skin, mm.
        const NEAR: f64 = 0.2;
        /// What the second order may leave of that, mm: a lid line's radius is 0.65 mm and less.
        const LEFT: f64 = 0.1;
        const TYPICAL: f64 = 0.005;
        let mut left = Vec::new();
        for point in points() {
            let field = tissue(Dual::coordinates(point));
            let depth = crate::phantom::depth(field);
            if depth.abs() < NEAR {
                // Along the gradient, the surface must be `depth` away.
                let foot = point + field.gradient.normalize() * depth;
                let there = crate::phantom::depth(tissue(Dual::coordinates(foot)));
                left.push(there.abs());
            }
        }
        left.sort_by(f64::total_cmp);
        assert!(left.len() > 500, "{}", left.len());
        let (typical, most) = (left[left.len() * 95 / 100], left[left.len() - 1]);
        assert!(typical < TYPICAL && most < LEFT, "{typical} {most}");
    }

    #[test]
    fn the_pruned_chain_gives_the_same_field() {
        for point in points().step_by(7) {
            let centre = point.to_array();
            let (whole, steps) = TISSUE.near(TISSUE.whole(), centre, 4.0);
            assert_eq!(whole, tissue(centre));
            if whole.abs() > 6.0 {
                continue;
            }
            assert_eq!(TISSUE.field(steps, centre), whole);
            for off in [DVec3::X, DVec3::NEG_Y, DVec3::Z, DVec3::splat(-0.9)] {
                let at = (point + off * 1.2).to_array();
                assert_eq!(TISSUE.field(steps, at), tissue(at), "{point}");
            }
        }
    }
}
