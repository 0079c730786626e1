//! What benches work on, and what the test that compares the paths of all kernels does.

#![allow(clippy::expect_used, reason = "what cannot be set up should stop")]

use std::sync::OnceLock;

use glam::DVec3;
use rhinoplan::feature::{Cage, FeatureKind, FeatureLine, NoseBox};
use rhinoplan::morph::chain::{Chain, Lattice};
use rhinoplan::morph::field::Evaluation;
use rhinoplan::morph::pair::Segment;
use rhinoplan::morph::stage::{StageLines, StageMap, Taper};
use rhinoplan::phantom::Phantom;
use rhinoplan::plan::DEFAULT_SKIN_HU;
use rhinoplan::render::{Camera, Direction, Object, Paint, SKIN};
use rhinoplan::segment::segment;
use rhinoplan::space::{ContinuousIndex, Grid, GridPoint};
use rhinoplan::surface::{Region, SemiBoundary, semi_boundary};
use rhinoplan::volume::{Mask, Volume};

/// Voxels along the axes: the paper's CT, and the same head with coarser and finer voxels.
pub const SIZES: [[usize; 3]; 3] = [[160, 160, 76], [320, 320, 151], [512, 512, 400]];

/// The paper's CT.
pub const PAPER: [usize; 3] = SIZES[1];

const FULL_SIZE: [f64; 3] = [320.0, 320.0, 151.0];

pub fn head(size: [usize; 3]) -> &'static Volume<i16> {
    static HEADS: [OnceLock<Volume<i16>>; 3] = [const { OnceLock::new() }; 3];
    let place = SIZES.iter().position(|&known| known == size).unwrap_or(0);
    HEADS[place].get_or_init(|| {
        let default = Phantom::default_grid().expect("the phantom's own grid");
        let spacing =
            [0, 1, 2].map(|axis| default.spacing()[axis] * FULL_SIZE[axis] / size[axis] as f64);
        let grid = Grid::axis_aligned(size, spacing).expect("a finer or coarser grid");
        Phantom::lee2001().render(&grid).expect("memory")
    })
}

pub struct Case {
    pub volume: &'static Volume<i16>,
    pub full: Lattice,
    pub nose: NoseBox,
    /// What `lee2001` is made of.
    map: StageMap,
    pub lee2001: Chain,
    pub local: Chain,
}

/// The paper's first operation: the tip 8.84 mm to the left.
pub fn case(size: [usize; 3]) -> Case {
    let volume = head(size);
    let full = Lattice::full(volume.grid());
    let landmarks = Phantom::lee2001().landmarks_mm();
    let source = FeatureLine::new(landmarks.nasal_bones, landmarks.tip).expect("a line");
    let tip = GridPoint(landmarks.tip.0 + DVec3::new(8.84, 0.0, 0.0));
    let target = FeatureLine::new(landmarks.nasal_bones, tip).expect("a line");
    let cage = Cage::new(&landmarks, 11.0);
    let lines = StageLines {
        kind: FeatureKind::Line,
        source,
        target,
        cage,
    };
    let nose = NoseBox::new(&landmarks, &source, &target);
    let taper = Taper {
        nose,
        margin_mm: 20.0,
    };
    let map = StageMap::lee2001(&lines, &full, &full).expect("a map");
    Case {
        volume,
        full,
        nose,
        lee2001: map.clone().into(),
        map,
        local: StageMap::local(&lines, 1.0, taper, &full)
            .expect("a map")
            .into(),
    }
}

/// Tolerances of the adaptive method, in voxels.
pub const TOLERANCES: [f64; 5] = [0.02, 0.05, 0.1, 0.2, 0.5];

/// The adaptive method within so many voxels.
pub fn within_voxels(tolerance: f64) -> Evaluation {
    Evaluation::Adaptive {
        tolerance,
        metric: DVec3::ONE,
    }
}

/// How many further lines there are.
pub const EXTRA_LINES: [usize; 5] = [0, 10, 25, 50, 100];

/// The paper's first operation with further lines that hold still, which no plan has: short ones all over
/// the head, in no order.
pub fn with_lines(size: [usize; 3], count: usize) -> (Case, Chain) {
    /// Of the plastic number: points spread evenly (Roberts 2018, "The unreasonable effectiveness of quasirandom
    /// sequences").
    const STEPS: DVec3 = DVec3::new(0.819_172_513, 0.671_043_607, 0.549_700_478);
    let dims = DVec3::from(size.map(|n| n as f64));
    let held = (1..=count).map(|place| {
        let start = (STEPS * place as f64).fract();
        let towards = (STEPS * (place + count) as f64).fract();
        Segment::new(start * dims, (start + 0.2 * (towards - start)) * dims)
    });
    let case = case(size);
    let chain = case.map.clone().holding(held).into();
    (case, chain)
}

/// As a run segments the skin: threshold and largest piece.
pub fn skin_mask(volume: &Volume<i16>) -> Mask {
    segment(volume, DEFAULT_SKIN_HU, true).expect("memory")
}

pub fn boundary(volume: &Volume<i16>, mask: &Mask) -> SemiBoundary {
    semi_boundary(volume, mask, DEFAULT_SKIN_HU, Region::whole(volume.grid())).expect("memory")
}

/// Pixels a side of the pictures that are drawn here: what plans get that give no size.
pub const PICTURE: usize = 1024;

/// Where views are from, degrees around the head.
pub const VIEWS_DEG: [f64; 2] = [0.0, -45.0];

/// Framed as by the crop "face": on this head, all of it.
pub fn camera(surface: &SemiBoundary, azimuth_deg: f64) -> Camera {
    let (low, high) = surface.bounds().expect("a head");
    let [low, high] = [low, high].map(|index| {
        let index = ContinuousIndex::from(index.map(|at| at as f64));
        surface.grid().index_to_grid(index).0
    });
    let side_mm = 1.06 * (high - low).x.max((high - low).z);
    let mut centre = (low + high) / 2.0;
    centre.y = low.y + 0.4 * side_mm;
    let from = Direction {
        azimuth_deg,
        elevation_deg: 0.0,
    };
    Camera::new(from, GridPoint(centre), side_mm, PICTURE).expect("a camera")
}

/// The skin, alone.
pub fn shown(surface: &SemiBoundary) -> Object<'_> {
    Object {
        surface,
        paint: Paint::Plain(SKIN),
        opacity: 1.0,
    }
}
