//! The steps of one stage on the phantom at three sizes, in voxels per second.
//!
//! `cargo bench` runs all; `cargo bench -- morph` the morphs. Quote medians, and ratios within one run.

#![allow(
    clippy::expect_used,
    reason = "a benchmark that cannot be set up should stop"
)]

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::DVec3;
use rhinoplan::exec::events::Silent;
use rhinoplan::exec::{RunOptions, prepare, run};
use rhinoplan::feature::{Cage, FeatureKind, FeatureLine, NoseBox};
use rhinoplan::io::nifti::{self, Template};
use rhinoplan::measure::{Slabs, region_volumes};
use rhinoplan::morph::audit::WarpAudit;
use rhinoplan::morph::chain::{Chain, Lattice};
use rhinoplan::morph::field::{Evaluation, Field};
use rhinoplan::morph::pair::Segment;
use rhinoplan::morph::stage::{StageLines, StageMap, Taper};
use rhinoplan::morph::warp::warp;
use rhinoplan::phantom::Phantom;
use rhinoplan::plan::DEFAULT_SKIN_HU;
use rhinoplan::render::{Camera, Direction, Object, Paint, SKIN, render};
use rhinoplan::resample::{gaussian, half};
use rhinoplan::segment::{Enhance, MEDIAN_SIDE, above, enhance, keep_largest, otsu, segment};
use rhinoplan::simd::Simd;
use rhinoplan::space::{ContinuousIndex, Grid, GridPoint};
use rhinoplan::surface::{Region, SemiBoundary, semi_boundary, signed_distances};
use rhinoplan::volume::{Mask, Sample, Volume};

fn main() {
    divan::main();
}

/// Voxels along the axes: the paper's CT, and the same head with coarser and finer voxels.
const SIZES: [[usize; 3]; 3] = [[160, 160, 76], [320, 320, 151], [512, 512, 400]];

/// The paper's CT.
const PAPER: [usize; 3] = SIZES[1];

const FULL_SIZE: [f64; 3] = [320.0, 320.0, 151.0];

fn head(size: [usize; 3]) -> &'static Volume<i16> {
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

struct Case {
    volume: &'static Volume<i16>,
    full: Lattice,
    nose: NoseBox,
    /// What `lee2001` is made of.
    map: StageMap,
    lee2001: Chain,
    local: Chain,
}

/// The paper's first operation: the tip 8.84 mm to the left.
fn case(size: [usize; 3]) -> Case {
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

fn voxels(size: [usize; 3]) -> ItemsCount {
    ItemsCount::new(size.iter().product::<usize>())
}

fn morph(bencher: Bencher<'_, '_>, case: &Case, chain: &Chain, evaluation: Evaluation) {
    let field = Field::evaluated(case.full, chain, evaluation);
    bencher
        .counter(voxels(case.full.dims()))
        .bench(|| warp(black_box(case.volume), &field));
}

fn tenth_of_a_voxel() -> Evaluation {
    Evaluation::Adaptive {
        tolerance: 0.1,
        metric: DVec3::ONE,
    }
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_lee2001_exact(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    morph(bencher, &case, &case.lee2001, Evaluation::Exact);
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_lee2001_adaptive(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    morph(bencher, &case, &case.lee2001, tenth_of_a_voxel());
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_local_exact(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    morph(bencher, &case, &case.local, Evaluation::Exact);
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_local_adaptive(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    morph(bencher, &case, &case.local, tenth_of_a_voxel());
}

/// The paper's first operation with further lines that hold still, which no plan has: short ones all over
/// the head, in no order.
fn with_lines(size: [usize; 3], count: usize) -> (Case, Chain) {
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

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_extra_lines_exact(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let (case, chain) = with_lines(size, 50);
    morph(bencher, &case, &chain, Evaluation::Exact);
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_extra_lines_adaptive(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let (case, chain) = with_lines(size, 50);
    morph(bencher, &case, &chain, tenth_of_a_voxel());
}

/// What further lines cost, on the paper's CT.
const EXTRA_LINES: [usize; 5] = [0, 10, 25, 50, 100];

#[divan::bench(args = EXTRA_LINES, sample_count = 5, sample_size = 1)]
fn morph_lines_exact(bencher: Bencher<'_, '_>, count: usize) {
    let (case, chain) = with_lines(PAPER, count);
    morph(bencher, &case, &chain, Evaluation::Exact);
}

#[divan::bench(args = EXTRA_LINES, sample_count = 5, sample_size = 1)]
fn morph_lines_adaptive(bencher: Bencher<'_, '_>, count: usize) {
    let (case, chain) = with_lines(PAPER, count);
    morph(bencher, &case, &chain, tenth_of_a_voxel());
}

/// What a coarser map saves, on the paper's CT; tolerances in voxels.
#[divan::bench(args = [0.02, 0.05, 0.1, 0.2, 0.5], sample_count = 5, sample_size = 1)]
fn morph_lee2001_tolerance(bencher: Bencher<'_, '_>, tolerance: f64) {
    let case = case(PAPER);
    let evaluation = Evaluation::Adaptive {
        tolerance,
        metric: DVec3::ONE,
    };
    morph(bencher, &case, &case.lee2001, evaluation);
}

/// A morph of the paper's CT with each of the instructions that there are: what they give, in one run.
fn each_simd(
    bencher: Bencher<'_, '_>,
    simd: Simd,
    chain: impl Fn(&Case) -> &Chain,
    evaluation: Evaluation,
) {
    let case = case(PAPER);
    let mut bencher = Some(bencher);
    Simd::compare(|tried| {
        if tried == simd
            && let Some(bencher) = bencher.take()
        {
            morph(bencher, &case, chain(&case), evaluation);
        }
    });
}

#[divan::bench(args = Simd::all(), sample_count = 5, sample_size = 1)]
fn simd_lee2001_exact(bencher: Bencher<'_, '_>, simd: Simd) {
    each_simd(bencher, simd, |case| &case.lee2001, Evaluation::Exact);
}

#[divan::bench(args = Simd::all(), sample_count = 5, sample_size = 1)]
fn simd_lee2001_adaptive(bencher: Bencher<'_, '_>, simd: Simd) {
    each_simd(bencher, simd, |case| &case.lee2001, tenth_of_a_voxel());
}

#[divan::bench(args = Simd::all(), sample_count = 5, sample_size = 1)]
fn simd_local_adaptive(bencher: Bencher<'_, '_>, simd: Simd) {
    each_simd(bencher, simd, |case| &case.local, tenth_of_a_voxel());
}

/// A folder of this process alone, in the target folder, and away at the end.
fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder")
}

fn template(volume: &Volume<i16>) -> Template {
    Template::for_grid(volume.grid(), i16::TYPE, volume.rescale()).expect("a header")
}

/// The head as a header's `f32` places it, so that a file can hold it.
fn save(volume: &Volume<i16>, file: &Path) {
    let template = template(volume);
    let samples = volume.samples().to_owned();
    let placed = Volume::new(template.grid().clone(), template.rescale(), samples);
    nifti::save_volume(file, &template, &placed.expect("the same size")).expect("a file");
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn write_gz(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let volume = head(size);
    let folder = folder();
    let file = folder.path().join("head.nii.gz");
    bencher
        .counter(voxels(size))
        .bench(|| save(black_box(volume), &file));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn read_gz(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let folder = folder();
    let file = folder.path().join("head.nii.gz");
    save(head(size), &file);
    bencher
        .counter(voxels(size))
        .bench(|| nifti::read(black_box(&file)).expect("a volume"));
}

/// A plan from its CT to its tables and `volume.nii.gz`: all that a process does but start.
#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn whole_run(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let folder = folder();
    save(head(size), &folder.path().join("head.nii.gz"));
    let landmarks = Phantom::lee2001().landmarks_mm();
    let mut plan = String::from(
        "plan = 1\nname = \"run\"\n[ct]\npath = \"head.nii.gz\"\n[landmarks]\nframe = \"lps\"\n",
    );
    for (name, GridPoint(at)) in [
        ("nasal_bones", landmarks.nasal_bones),
        ("lip", landmarks.lip),
        ("alare_right", landmarks.alare_right),
        ("alare_left", landmarks.alare_left),
        ("tip", landmarks.tip),
        ("maxilla", landmarks.maxilla),
    ] {
        plan.push_str(&format!("{name} = [{}, {}, {}]\n", at.x, at.y, at.z));
    }
    plan.push_str(
        "[[candidate]]\nname = \"straight\"\n[[candidate.stage]]\nname = \"straighten\"\n\
         f1 = [{ deviate = 8.84 }]\n[outputs]\nwrite = [\"volume\"]\n",
    );
    let file = folder.path().join("run.toml");
    fs::write(&file, plan).expect("a plan");
    let options = RunOptions {
        force: true,
        ..RunOptions::default()
    };
    let out = folder.path().join("out");
    bencher.counter(voxels(size)).bench(|| {
        let ready = prepare(std::slice::from_ref(&file)).expect("a plan that can run");
        run(&ready[0], &out, &options, &Silent).expect("a run")
    });
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn copy(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let volume = head(size);
    bencher
        .counter(voxels(size))
        .bench(|| black_box(volume).clone());
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn audit_lee2001(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    bencher
        .counter(voxels(size))
        .bench(|| WarpAudit::new(black_box(&case.lee2001), &case.full, &case.nose));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn half_down(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let volume = head(size);
    bencher
        .counter(voxels(size))
        .bench(|| half::half(black_box(volume)));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn gaussian_up(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let volume = head(size);
    let coarse = half::half(volume).expect("a half");
    bencher
        .counter(voxels(size))
        .bench(|| gaussian::upsample::<i16>(black_box(&coarse), volume.grid(), volume.rescale()));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn measure_regions(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let volume = head(size);
    let slabs = Slabs::new(&Phantom::lee2001().landmarks_mm()).expect("slabs");
    bencher
        .counter(voxels(size))
        .bench(|| region_volumes(black_box(volume), &slabs, DEFAULT_SKIN_HU));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn segment_threshold(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let volume = head(size);
    bencher
        .counter(voxels(size))
        .bench(|| above(black_box(volume), DEFAULT_SKIN_HU));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn segment_otsu(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let volume = head(size);
    bencher
        .counter(voxels(size))
        .bench(|| otsu(black_box(volume)));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn segment_keep_largest(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let mask = above(head(size), DEFAULT_SKIN_HU).expect("memory");
    bencher
        .counter(voxels(size))
        .with_inputs(|| mask.clone())
        .bench_values(keep_largest);
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn enhance_median(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let settings = Enhance {
        median: Some(MEDIAN_SIDE),
        smooth_mm: None,
    };
    let volume = head(size);
    bencher
        .counter(voxels(size))
        .bench(|| enhance(black_box(volume), &settings));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn enhance_smooth(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let settings = Enhance {
        median: None,
        smooth_mm: Some(0.5),
    };
    let volume = head(size);
    bencher
        .counter(voxels(size))
        .bench(|| enhance(black_box(volume), &settings));
}

/// As a run segments the skin: threshold and largest piece.
fn skin_mask(volume: &Volume<i16>) -> Mask {
    segment(volume, DEFAULT_SKIN_HU, true).expect("memory")
}

fn boundary(volume: &Volume<i16>, mask: &Mask) -> SemiBoundary {
    semi_boundary(volume, mask, DEFAULT_SKIN_HU, Region::whole(volume.grid())).expect("memory")
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn segment_skin(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let volume = head(size);
    bencher
        .counter(voxels(size))
        .bench(|| skin_mask(black_box(volume)));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn surface_skin(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let volume = head(size);
    let mask = skin_mask(volume);
    bencher
        .counter(voxels(size))
        .bench(|| boundary(black_box(volume), &mask));
}

/// How far the skin moved, counted in boundary voxels: of the first operation, where the nose is another.
#[divan::bench(args = SIZES, sample_count = 3, sample_size = 1)]
fn surface_change(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    let field = Field::evaluated(case.full, &case.local, tenth_of_a_voxel());
    let moved = warp(case.volume, &field);
    let [before, after] = [case.volume, &moved].map(|volume| boundary(volume, &skin_mask(volume)));
    bencher
        .counter(ItemsCount::new(after.len()))
        .bench(|| signed_distances(black_box(&after), &before, 60.0));
}

/// Pixels a side of the pictures that are drawn here: what plans get that give no size.
const PICTURE: usize = 1024;

/// A view, in pixels per second, framed as by the crop "face": on this head, all of it.
fn view(bencher: Bencher<'_, '_>, size: [usize; 3], azimuth_deg: f64) {
    let volume = head(size);
    let surface = boundary(volume, &skin_mask(volume));
    let (low, high) = surface.bounds().expect("a head");
    let [low, high] = [low, high].map(|index| {
        let index = ContinuousIndex::from(index.map(|at| at as f64));
        volume.grid().index_to_grid(index).0
    });
    let side_mm = 1.06 * (high - low).x.max((high - low).z);
    let mut centre = (low + high) / 2.0;
    centre.y = low.y + 0.4 * side_mm;
    let from = Direction {
        azimuth_deg,
        elevation_deg: 0.0,
    };
    let camera = Camera::new(from, GridPoint(centre), side_mm, PICTURE).expect("a camera");
    let object = Object {
        surface: &surface,
        paint: Paint::Plain(SKIN),
        opacity: 1.0,
    };
    bencher
        .counter(ItemsCount::new(PICTURE * PICTURE))
        .bench(|| render(black_box(&[object]), &camera));
}

#[divan::bench(args = SIZES, sample_count = 25, sample_size = 1)]
fn view_frontal(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    view(bencher, size, 0.0);
}

#[divan::bench(args = SIZES, sample_count = 25, sample_size = 1)]
fn view_oblique_right(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    view(bencher, size, -45.0);
}

#[divan::bench(args = SIZES, sample_count = 3, sample_size = 1)]
fn render_phantom(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let grid = head(size).grid().clone();
    bencher
        .counter(voxels(size))
        .bench(|| Phantom::lee2001().render(black_box(&grid)));
}
