//! The built-in synthetic head, `lee2001`: an analytic shape on the paper's grid, whose landmarks,
//! measurements and true regional volumes are known without voxels.
//!
//! The shape is a set of signed functions of a point in grid millimetres (`shape`), so it can be
//! rendered on any grid (`render`), measured by quadrature (`truth`) and compared. What it is made
//! of and how near it comes to the paper's Table I: `docs/phantom.md`.

mod chain;
mod noise;
mod primitives;
mod render;
mod shape;
mod truth;

use crate::feature::Landmarks;
use crate::space::{ContinuousIndex, Grid, GridError, GridPoint};
use primitives::Dual;

pub use truth::REGIONS;

/// Voxels of the default grid: the paper's CT (section III).
pub const DIMS: [usize; 3] = [320, 320, 151];
/// Spacing of the default grid, mm. In plane it follows from the paper's h = 22.37 mm.
pub const SPACING: [f64; 3] = [shape::PIXEL_MM, shape::PIXEL_MM, 1.0];

/// HU of air.
pub const AIR_HU: f64 = -1000.0;
/// HU of soft tissue near the skin: water, so that half-way to air is exactly the skin threshold.
pub const TISSUE_HU: f64 = 0.0;
/// HU of bone.
pub const BONE_HU: f64 = 900.0;
/// HU of the brain.
pub const BRAIN_HU: f64 = 35.0;
/// Standard deviation of the Gaussian that blurs every edge, mm.
pub const EDGE_SIGMA_MM: f64 = 0.5;

/// The built-in head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phantom {
    noise: bool,
}

impl Default for Phantom {
    fn default() -> Self {
        Self::lee2001()
    }
}

impl Phantom {
    /// The head of the paper's first patient, with scanner-like noise.
    pub const fn lee2001() -> Self {
        Self { noise: true }
    }

    /// The same head without noise.
    pub const fn without_noise(self) -> Self {
        Self { noise: false }
    }

    /// The default grid: 320×320×151 voxels of 0.442×0.442×1 mm, axes left, posterior and superior, first
    /// voxel at the LPS origin.
    ///
    /// # Errors
    /// None for these constants; the type is [`Grid`]'s.
    pub fn default_grid() -> Result<Grid, GridError> {
        Grid::axis_aligned(DIMS, SPACING)
    }

    /// The six landmarks, in voxels of the default grid.
    pub const fn landmarks(&self) -> Landmarks<ContinuousIndex> {
        Landmarks {
            nasal_bones: ContinuousIndex::new(141.089, 71.61, shape::TOP_Z),
            lip: ContinuousIndex::new(141.089, 67.61, shape::LIP_Z),
            alare_right: ContinuousIndex::new(96.0, 60.0, 60.0),
            alare_left: ContinuousIndex::new(186.0, 60.0, 60.0),
            tip: ContinuousIndex::new(129.0, 33.0, 61.0),
            maxilla: ContinuousIndex::new(141.089, 83.61, 60.0),
        }
    }

    /// The six landmarks, in grid millimetres: the same points on every grid.
    pub fn landmarks_mm(&self) -> Landmarks<GridPoint> {
        let [x, y, z] = SPACING;
        self.landmarks()
            .map(|index| GridPoint::new(index.0.x * x, index.0.y * y, index.0.z * z))
    }

    /// Signed distance to the surface of the tissue (skin and airway lining), mm, positive in tissue.
    /// First-order exact at the surface, a sign and an order of magnitude away from it.
    pub fn tissue_depth(&self, at: GridPoint) -> f64 {
        depth(shape::tissue(Dual::coordinates(at.0)))
    }

    /// True volumes of the regions A..K, mm³: tissue in front of the base plane, in 11 slabs from the
    /// `nasal_bones` plane down to the `lip` plane. Found by quadrature of the analytic surface, within
    /// 0.02 %.
    pub fn true_region_volumes(&self) -> [f64; REGIONS] {
        truth::region_volumes(truth::CELLS_PER_REGION)
    }

    /// The sum of [`Phantom::true_region_volumes`], mm³.
    pub fn true_total(&self) -> f64 {
        self.true_region_volumes().iter().sum()
    }
}

/// Depth below the surface from a field that is negative inside: the value over the gradient's length.
fn depth(field: Dual) -> f64 {
    // On the surface the length is near 1 (a test holds it); where two sides of a wall meet it
    // vanishes, and there the field alone is far enough from 0.
    const LEAST_SLOPE: f64 = 0.5;
    -field.value / field.gradient.length().max(LEAST_SLOPE)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn head() -> Phantom {
        Phantom::lee2001()
    }

    /// The paper's gamma (degrees) and h (mm) for a tip in voxels.
    fn gamma_and_h(tip: [f64; 3]) -> (f64, f64) {
        let marks = head().landmarks_mm();
        let tip = DVec3::from_array(tip) * DVec3::from_array(SPACING);
        let (a, b) = (marks.lip.0 - tip, marks.nasal_bones.0 - tip);
        let cosine = a.dot(b) / (a.length() * b.length());
        (libm::acos(cosine).to_degrees(), marks.maxilla.0.y - tip.y)
    }

    #[test]
    fn the_landmarks_give_the_papers_angles_and_heights_as_printed() {
        let found = [
            [129.0, 33.0, 61.0],
            [149.0, 33.0, 61.0],
            [149.0, 53.0, 61.0],
        ]
        .map(|tip| {
            let (gamma, h) = gamma_and_h(tip);
            format!("{gamma:.2} {h:.2}")
        });
        assert_eq!(found, ["70.95 22.37", "72.42 22.37", "110.54 13.53"]);
        assert_eq!(head().landmarks().tip.to_array(), [129.0, 33.0, 61.0]);
    }

    #[test]
    fn the_skin_passes_through_the_skin_landmarks() {
        let marks = head().landmarks_mm();
        for (name, at, within) in [
            ("nasal_bones", marks.nasal_bones, 0.1),
            ("tip", marks.tip, 0.1),
            ("lip", marks.lip, 0.5),
            ("alare_right", marks.alare_right, 1.0),
            ("alare_left", marks.alare_left, 1.0),
        ] {
            let depth = head().tissue_depth(at);
            assert!(depth.abs() < within, "{name} is {depth:.3} mm deep");
        }
        assert!(head().tissue_depth(marks.maxilla) > 3.0);
    }

    /// y of the foremost skin and the x at which it is, on the plane z, looked for about `x`.
    fn ridge(z: f64) -> (f64, f64) {
        let mut foremost = (f64::INFINITY, 0.0);
        for x in (480..720).map(|x| f64::from(x) * 0.1) {
            let skin = (80..400)
                .map(|y| f64::from(y) * 0.1)
                .find(|&y| head().tissue_depth(GridPoint::new(x, y, z)) > 0.0);
            if let Some(y) = skin
                && y < foremost.0
            {
                foremost = (y, x);
            }
        }
        foremost
    }

    #[test]
    fn the_ridge_goes_straight_from_the_root_to_the_deviated_tip() {
        /// mm; the bridge is a little convex and stands in front of the line.
        const WITHIN: f64 = 1.7;
        let marks = head().landmarks_mm();
        let (root, tip) = (marks.nasal_bones.0, marks.tip.0);
        for share in [0.25, 0.5, 0.75, 1.0] {
            let on_line = root.lerp(tip, share);
            let (y, x) = ridge(on_line.z);
            assert!((x - on_line.x).abs() < WITHIN, "x {x} for {on_line}");
            assert!((y - on_line.y).abs() < WITHIN, "y {y} for {on_line}");
        }
    }

    #[test]
    fn the_head_lies_inside_the_field_of_view_but_for_its_neck() {
        const CLEARANCE: f64 = -3.0;
        let last = Phantom::default_grid().unwrap();
        let last = last.index_to_grid(ContinuousIndex(last.last_index())).0;
        let deepest = |make: &dyn Fn(f64, f64) -> DVec3| {
            let shares = || (0..=60).map(|n| f64::from(n) / 60.0);
            shares()
                .flat_map(|a| shares().map(move |b| (a, b)))
                .map(|(a, b)| head().tissue_depth(GridPoint(make(a, b) * last)))
                .fold(f64::NEG_INFINITY, f64::max)
        };
        for (side, depth) in [
            ("right", deepest(&|a, b| DVec3::new(0.0, a, b))),
            ("left", deepest(&|a, b| DVec3::new(1.0, a, b))),
            ("front", deepest(&|a, b| DVec3::new(a, 0.0, b))),
            ("back", deepest(&|a, b| DVec3::new(a, 1.0, b))),
            ("top", deepest(&|a, b| DVec3::new(a, b, 1.0))),
        ] {
            assert!(depth < CLEARANCE, "{side}: {depth}");
        }
        assert!(deepest(&|a, b| DVec3::new(a, b, 0.0)) > 3.0, "the neck");
    }

    /// Sizes of the face-connected parts of `inside`, on a lattice of `n` points.
    fn parts(inside: &[bool], n: [usize; 3]) -> Vec<usize> {
        let strides = [1, n[0], n[0] * n[1]];
        let mut seen = vec![false; inside.len()];
        let mut sizes = Vec::new();
        for start in 0..inside.len() {
            if !inside[start] || seen[start] {
                continue;
            }
            seen[start] = true;
            let mut queue = vec![start];
            let mut size = 0;
            while let Some(at) = queue.pop() {
                size += 1;
                for axis in 0..3 {
                    let place = at / strides[axis] % n[axis];
                    let before = (place > 0).then(|| at - strides[axis]);
                    let after = (place + 1 < n[axis]).then(|| at + strides[axis]);
                    for next in [before, after].into_iter().flatten() {
                        if inside[next] && !seen[next] {
                            seen[next] = true;
                            queue.push(next);
                        }
                    }
                }
            }
            sizes.push(size);
        }
        sizes
    }

    #[test]
    fn tissue_is_one_piece_and_air_is_outside_and_in_the_airway() {
        let n = [142, 142, 151];
        let tissue: Vec<bool> = (0..n[0] * n[1] * n[2])
            .map(|at| {
                let [x, y, z] = [at % n[0], at / n[0] % n[1], at / (n[0] * n[1])];
                shape::tissue([x as f64, y as f64, z as f64]) < 0.0
            })
            .collect();
        let air: Vec<bool> = tissue.iter().map(|t| !t).collect();
        assert_eq!(parts(&tissue, n).len(), 1);
        // The nostrils are part of the outside; the windpipe leaves through the lower edge.
        assert_eq!(parts(&air, n).len(), 2);
        let throat = |y: f64, z: f64| shape::tissue([shape::MIDLINE, y, z]) > 0.0;
        assert!(throat(84.0, 55.0) && throat(82.0, 20.0), "a windpipe");
    }
}
