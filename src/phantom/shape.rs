//! The head itself: which primitives, where. Grid millimetres; every field is negative inside.

use super::primitives::{
    Point, Scalar, capsule, ellipse, ellipsoid, intersection, soft_abs, spline, union, without,
};

/// Voxel spacing of the default grid in plane, mm: the paper's.
pub(super) const PIXEL_MM: f64 = 0.442;
/// The midline, x in mm.
pub(super) const MIDLINE: f64 = 141.089 * PIXEL_MM;
/// z of the `nasal_bones` and `lip` landmarks, mm.
pub(super) const TOP_Z: f64 = 78.882;
/// See [`TOP_Z`].
pub(super) const LIP_Z: f64 = 53.121;
/// The base plane, y in mm.
pub(super) const BASE_Y: f64 = 83.61 * PIXEL_MM;

/// Width of one of the slabs A..K, mm; also the step of the nose's splines.
const STEP: f64 = (TOP_Z - LIP_Z) / 11.0;
/// Number of spline steps above the `nasal_bones` plane.
const STEPS_ABOVE: f64 = 5.0;
/// The nose's sections are half-ellipses that stand on this plane inside the face, y in mm.
const NOSE_BACK: f64 = 40.0;

/// The bridge: y in mm at z = 78.882 + 2.342·(5 − n).
const RIDGE: [f64; 18] = [
    37.5, 36.5, 35.2, 34.2, 33.1, 31.7, 30.0, 27.8, 25.5, 23.1, 20.6, 18.1, 15.9, 14.6, 14.8, 16.0,
    18.0, 20.0,
];
/// Half the nose's width on the plane [`NOSE_BACK`], mm, at the same heights.
const HALF_WIDTH: [f64; 18] = [
    7.5, 7.5, 7.5, 7.5, 7.5, 7.6, 7.8, 8.6, 10.0, 12.2, 14.8, 16.0, 16.0, 15.5, 15.0, 14.5, 14.0,
    14.0,
];
/// How far the tip lies from the midline, mm (to the patient's right).
const TIP_SHIFT: f64 = (129.0 - 141.089) * PIXEL_MM;
/// How far root and tip stand in front of the base plane, mm.
const ROOT_HEIGHT: f64 = BASE_Y - 71.61 * PIXEL_MM;
/// See [`ROOT_HEIGHT`].
const TIP_HEIGHT: f64 = BASE_Y - 33.0 * PIXEL_MM;

/// x from the midline, with the nose's deviation taken out: it grows from the root's height to the
/// tip's, so the ridge is a straight line from root to tip while the face stays symmetric.
fn straightened<S: Scalar>(u: S, y: S) -> S {
    let rise = (-y + (BASE_Y - ROOT_HEIGHT)) * (1.0 / (TIP_HEIGHT - ROOT_HEIGHT));
    let ramp = (rise + soft_abs(rise, 0.12)) * 0.5;
    u - ramp * TIP_SHIFT
}

/// The nose without its nostrils: sections along the bridge, tip and wings, cut off below.
fn nose<S: Scalar>([u, y, z]: Point<S>) -> S {
    let straight = straightened(u, y);
    let t = (-z + TOP_Z) * (1.0 / STEP) + STEPS_ABOVE;
    let height = -spline(&RIDGE, t) + NOSE_BACK;
    let width = spline(&HALF_WIDTH, t);
    let bridge = ellipse(straight, -y + NOSE_BACK, width, height);
    let bridge = intersection(bridge, z - 92.0, 4.0);
    let tip = ellipsoid([straight, y, z], [0.0, 21.0, 61.6], [7.0, 6.3, 4.6]);
    let wings = ellipsoid(
        [soft_abs(u, 1.0), y, z],
        [14.0, 29.5, 61.6],
        [5.8, 8.5, 4.6],
    );
    let whole = union(union(bridge, tip, 2.5), wings, 2.5);
    let below = -z + (-y + 36.0) * 0.085 + 57.4;
    intersection(whole, below, 4.0)
}

/// Nostrils, nasal cavity, nasopharynx and windpipe.
fn airway<S: Scalar>([u, y, z]: Point<S>) -> S {
    // The nostrils are longer from front to back than across.
    const STRETCH: f64 = 0.68;
    let side = soft_abs(straightened(u, y), 0.4);
    let p = [side, y * STRETCH, z];
    let at = |x: f64, y: f64, z: f64| [x, y * STRETCH, z];
    let nostril = union(
        capsule(p, (at(6.6, 25.0, 52.0), 2.9), (at(5.8, 26.5, 61.0), 2.7)),
        capsule(p, (at(5.8, 26.5, 61.0), 2.7), (at(3.9, 42.0, 65.0), 2.0)),
        2.0,
    );
    let p = [soft_abs(u, 0.4), y, z];
    let cavity = ellipsoid(p, [3.9, 60.0, 66.0], [2.2, 24.0, 7.0]);
    let p = [u, y, z];
    let pharynx = union(
        capsule(p, ([0.0, 82.0, 64.0], 5.5), ([0.0, 86.0, 45.0], 6.0)),
        capsule(p, ([0.0, 86.0, 45.0], 6.0), ([0.0, 82.0, -20.0], 6.5)),
        3.0,
    );
    union(union(nostril, cavity, 2.0), pharynx, 4.0)
}

/// Lips and the muzzle that carries them.
fn mouth<S: Scalar>([u, y, z]: Point<S>) -> S {
    let muzzle = ellipsoid([u, y, z], [0.0, 47.0, 47.0], [19.0, 14.0, 11.5]);
    // The lips follow the dental arch backwards and dip to the corners.
    let bent = y - u.square() * 0.022;
    let upper = ellipsoid(
        [u, bent, z + u.square() * 0.012],
        [0.0, 34.0, 51.3],
        [14.0, 4.6, 3.2],
    );
    let lower = ellipsoid(
        [u, bent, z - u.square() * 0.010],
        [0.0, 34.6, 46.2],
        [12.0, 4.4, 3.2],
    );
    let lips = union(upper, lower, 0.8);
    union(muzzle, lips, 2.0)
}

/// Everything that the skin encloses, airways not yet taken out.
fn solid<S: Scalar>([u, y, z]: Point<S>) -> S {
    let p = [u, y, z];
    let side = soft_abs(u, 2.0);
    let mirrored = [side, y, z];

    let cranium = ellipsoid(p, [0.0, 86.0, 96.0], [51.0, 51.0, 44.0]);
    let face = ellipsoid(p, [0.0, 77.0, 60.0], [42.0, 37.0, 30.0]);
    let jaw = ellipsoid(p, [0.0, 71.0, 42.0], [37.0, 33.0, 16.0]);
    let head = union(union(cranium, face, 10.0), jaw, 8.0);

    let neck = ellipse(u, y - 90.0, S::constant(28.0), S::constant(27.0));
    let neck = intersection(neck, z - 55.0, 10.0);
    let head = union(head, neck, 10.0);

    let cheeks = ellipsoid(mirrored, [26.0, 54.0, 65.0], [13.0, 12.0, 9.0]);
    let head = union(head, cheeks, 8.0);
    let chin = ellipsoid(p, [0.0, 44.0, 33.5], [13.0, 11.0, 8.0]);
    let head = union(head, chin, 6.0);
    let brow = ellipsoid(mirrored, [15.0, 41.5, 88.0], [15.0, 6.0, 4.5]);
    let head = union(head, brow, 6.0);

    let sockets = ellipsoid(mirrored, [19.0, 33.0, 79.0], [11.0, 8.5, 6.5]);
    let head = without(head, sockets, 6.0);
    let lids = ellipsoid(mirrored, [19.0, 48.0, 78.5], [9.5, 8.2, 6.2]);
    let head = union(head, lids, 2.0);

    let ears = ellipsoid(mirrored, [50.5, 90.0, 74.0], [4.5, 8.0, 12.0]);
    let shells = ellipsoid(mirrored, [56.0, 88.5, 74.5], [4.0, 4.5, 8.0]);
    let head = union(head, without(ears, shells, 2.0), 2.5);

    let head = union(head, mouth(p), 3.0);
    union(head, nose(p), 3.0)
}

/// The skin and the linings of the airways: where the head's tissue is.
pub(super) fn tissue<S: Scalar>([x, y, z]: Point<S>) -> S {
    let p = [x - MIDLINE, y, z];
    without(solid(p), airway(p), 1.2)
}

/// Bone, at least [`COVER`] beneath the `tissue` surface.
pub(super) fn bone<S: Scalar>([x, y, z]: Point<S>, tissue: S) -> S {
    /// Thickness of soft tissue over bone, mm: so far down the blurred skin edge does not see it.
    const COVER: f64 = 3.0;
    let p = [x - MIDLINE, y, z];
    let [u, y, z] = p;
    let mirrored = [soft_abs(u, 2.0), y, z];

    let vault = without(
        ellipsoid(p, [0.0, 87.0, 97.0], [46.0, 45.0, 38.0]),
        brain(p),
        1.0,
    );
    let maxilla = ellipsoid(p, [0.0, 62.0, 60.0], [22.0, 20.0, 11.0]);
    let zygoma = ellipsoid(mirrored, [30.0, 57.0, 66.0], [9.0, 10.0, 6.0]);
    let rims = ellipsoid(mirrored, [19.0, 50.0, 78.5], [15.0, 9.0, 11.0]);
    let orbits = ellipsoid(mirrored, [19.0, 52.0, 78.5], [11.0, 18.0, 8.0]);
    let upper = union(union(maxilla, zygoma, 5.0), rims, 5.0);
    let upper = without(union(upper, vault, 2.0), orbits, 1.5);

    // The mandible: an arch (in plan an ellipse's outline) and its rami.
    let arch = ellipse(u, y - 72.0, S::constant(27.0), S::constant(33.0));
    let arch =
        (arch.square() * (1.0 / 9.0) + ((z - 38.0) * (1.0 / 6.0)).square()).sqrt() * 3.0 - 3.0;
    let arch = intersection(arch, y - 80.0, 3.0);
    let rami = capsule(
        mirrored,
        ([27.0, 76.0, 40.0], 3.5),
        ([33.0, 82.0, 62.0], 3.0),
    );
    let mandible = union(arch, rami, 3.0);

    // The nasal bones: a roof under the upper half of the bridge.
    let roof = capsule(
        [straightened(u, y) * 0.8, y, z],
        ([0.0, 38.0, 81.0], 3.5),
        ([0.0, 30.5, 70.5], 2.2),
    );
    let spine = ellipse(u, y - 100.0, S::constant(9.0), S::constant(8.0));
    let spine = intersection(spine, z - 62.0, 2.0);
    let lower = union(mandible, spine, 1.0);
    let whole = union(union(upper, lower, 1.0), roof, 2.0);
    intersection(whole, tissue + COVER, 1.0)
}

/// The brain: `p` is relative to the midline.
fn brain<S: Scalar>(p: Point<S>) -> S {
    ellipsoid(p, [0.0, 87.0, 97.0], [41.0, 40.0, 33.0])
}

/// As [`brain`], of a point in grid millimetres.
pub(super) fn brain_field<S: Scalar>([x, y, z]: Point<S>) -> S {
    brain([x - MIDLINE, y, z])
}
