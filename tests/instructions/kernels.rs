//! What is counted: every hot loop once, on a small head.

use std::hint::black_box;

use glam::DVec3;
use rhinoplan::feature::{Cage, FeatureKind, FeatureLine, NoseBox};
use rhinoplan::measure::{Slabs, region_volumes};
use rhinoplan::morph::audit::WarpAudit;
use rhinoplan::morph::chain::{Chain, Lattice};
use rhinoplan::morph::field::{Evaluation, Field};
use rhinoplan::morph::stage::{StageLines, StageMap, Taper};
use rhinoplan::morph::warp::warp;
use rhinoplan::phantom::{self, Phantom};
use rhinoplan::plan::DEFAULT_SKIN_HU;
use rhinoplan::render::{Camera, Direction, Object, Paint, SKIN, render};
use rhinoplan::resample::{gaussian, half};
use rhinoplan::segment::segment;
use rhinoplan::simd::{Kernel, Simd};
use rhinoplan::space::{Grid, GridPoint};
use rhinoplan::surface::{Region, SemiBoundary, semi_boundary};
use rhinoplan::volume::{Mask, Trilinear, Volume};

/// Small enough for valgrind, which is some fifty times slower, and large enough that tiles of every kind occur.
const SIZE: [usize; 3] = [96, 96, 64];

/// Pixels a side of the view.
const PICTURE: usize = 256;

/// What is counted as one.
type Work = fn(&Scene);

/// Kernels by name, in the order in which they are counted.
const KERNELS: [(&str, Work); 11] = [
    ("morph_lee2001_exact", |scene| {
        scene.warp(&scene.lee2001, Evaluation::Exact);
    }),
    ("morph_lee2001_adaptive", |scene| {
        scene.warp(&scene.lee2001, TENTH_OF_A_VOXEL);
    }),
    ("morph_local", |scene| {
        scene.warp(&scene.local, TENTH_OF_A_VOXEL);
    }),
    ("audit", |scene| {
        black_box(WarpAudit::new(&scene.lee2001, &scene.lattice, &scene.nose));
    }),
    ("sampling", |scene| {
        black_box(Simd::widest().narrow().run(Sampling(&scene.head)));
    }),
    ("half", |scene| {
        black_box(half::half(&scene.head).unwrap());
    }),
    ("gaussian_up", |scene| {
        let (to, rescale) = (scene.head.grid(), scene.head.rescale());
        black_box(gaussian::upsample::<i16>(&scene.coarse, to, rescale).unwrap());
    }),
    ("regions", |scene| {
        black_box(region_volumes(&scene.head, &scene.slabs, DEFAULT_SKIN_HU).unwrap());
    }),
    ("segment", |scene| {
        black_box(skin_of(&scene.head));
    }),
    ("semi_boundary", |scene| {
        black_box(boundary_of(&scene.head, &scene.mask));
    }),
    ("view", |scene| {
        let object = Object {
            surface: &scene.surface,
            paint: Paint::Plain(SKIN),
            opacity: 1.0,
        };
        black_box(render(&[object], &scene.camera));
    }),
];

const TENTH_OF_A_VOXEL: Evaluation = Evaluation::Adaptive {
    tolerance: 0.1,
    metric: DVec3::ONE,
};

pub fn names() -> Vec<&'static str> {
    KERNELS.iter().map(|&(name, _)| name).collect()
}

/// Runs every kernel, each within [`written_by_callgrind`], and all on this thread: callgrind counts within a function for
/// each thread by itself.
pub fn run_all() {
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread()
        .build_global()
        .unwrap();
    let scene = Scene::new();
    for (_, kernel) in KERNELS {
        written_by_callgrind(kernel, &scene);
    }
}

/// Callgrind writes down what it counted at the end of this.
#[inline(never)]
fn written_by_callgrind(kernel: Work, scene: &Scene) {
    counted_by_callgrind(kernel, black_box(scene));
    // Something left to do, so that the function is called, not jumped to.
    black_box(scene);
}

/// Callgrind counts from the beginning to the end of this.
#[inline(never)]
fn counted_by_callgrind(kernel: Work, scene: &Scene) {
    kernel(black_box(scene));
    black_box(scene);
}

/// What the kernels work on.
struct Scene {
    head: Volume<i16>,
    coarse: Volume<f32>,
    mask: Mask,
    surface: SemiBoundary,
    lattice: Lattice,
    nose: NoseBox,
    slabs: Slabs,
    lee2001: Chain,
    local: Chain,
    camera: Camera,
}

impl Scene {
    /// The paper's first operation on the built-in head, with coarse voxels.
    fn new() -> Self {
        let spacing = [0, 1, 2]
            .map(|axis| phantom::SPACING[axis] * phantom::DIMS[axis] as f64 / SIZE[axis] as f64);
        let grid = Grid::axis_aligned(SIZE, spacing).unwrap();
        let head = Phantom::lee2001().render(&grid).unwrap();
        let lattice = Lattice::full(&grid);
        let landmarks = Phantom::lee2001().landmarks_mm();
        let source = FeatureLine::new(landmarks.nasal_bones, landmarks.tip).unwrap();
        let tip = GridPoint(landmarks.tip.0 + DVec3::new(8.84, 0.0, 0.0));
        let target = FeatureLine::new(landmarks.nasal_bones, tip).unwrap();
        let lines = StageLines {
            kind: FeatureKind::Line,
            source,
            target,
            cage: Cage::new(&landmarks, 11.0),
        };
        let nose = NoseBox::new(&landmarks, &source, &target);
        let taper = Taper {
            nose,
            margin_mm: 20.0,
        };
        let mask = skin_of(&head);
        let surface = boundary_of(&head, &mask);
        let from = Direction {
            azimuth_deg: -45.0,
            elevation_deg: 0.0,
        };
        Self {
            coarse: half::half(&head).unwrap(),
            mask,
            surface,
            lattice,
            nose,
            slabs: Slabs::new(&landmarks).unwrap(),
            lee2001: StageMap::lee2001(&lines, &lattice, &lattice)
                .unwrap()
                .into(),
            local: StageMap::local(&lines, 1.0, taper, &lattice)
                .unwrap()
                .into(),
            camera: Camera::new(from, landmarks.tip, 100.0, PICTURE).unwrap(),
            head,
        }
    }

    fn warp(&self, chain: &Chain, evaluation: Evaluation) {
        let field = Field::evaluated(self.lattice, chain, evaluation);
        black_box(warp(&self.head, &field));
    }
}

fn skin_of(head: &Volume<i16>) -> Mask {
    segment(head, DEFAULT_SKIN_HU, true).unwrap()
}

fn boundary_of(head: &Volume<i16>, mask: &Mask) -> SemiBoundary {
    semi_boundary(head, mask, DEFAULT_SKIN_HU, Region::whole(head.grid())).unwrap()
}

/// Every voxel, a third of a voxel further.
struct Sampling<'a>(&'a Volume<i16>);

impl Kernel for Sampling<'_> {
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        const STEP: usize = 16;
        let sampler = Trilinear::new(self.0);
        let [nx, ny, nz] = self.0.grid().dims();
        let mut sum = 0.0;
        for z in 0..nz {
            for y in 0..ny {
                let (ys, zs) = ([y as f64 + 0.3; STEP], [z as f64 + 0.3; STEP]);
                for first in (0..nx).step_by(STEP) {
                    let xs: [f64; STEP] = std::array::from_fn(|lane| (first + lane) as f64 + 0.3);
                    let values = sampler.row(&xs, &ys, &zs);
                    sum += values.iter().sum::<f64>();
                }
            }
        }
        sum
    }
}
