//! The steps of one stage on the phantom at three sizes, in voxels per second.
//!
//! `cargo bench` runs all; `cargo bench -- morph` the morphs. Quote medians, and ratios within one run.

#![allow(
    clippy::expect_used,
    reason = "a benchmark that cannot be set up should stop"
)]

mod inputs;

use std::fs;
use std::path::Path;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use inputs::{
    Case, EXTRA_LINES, PAPER, PICTURE, SIZES, TOLERANCES, VIEWS_DEG, boundary, camera, case, head,
    shown, skin_mask, with_lines, within_voxels,
};
use rhinoplan::exec::events::Silent;
use rhinoplan::exec::{RunOptions, prepare, run};
use rhinoplan::io::nifti::{self, Template};
use rhinoplan::measure::{Slabs, region_volumes};
use rhinoplan::morph::audit::WarpAudit;
use rhinoplan::morph::chain::Chain;
use rhinoplan::morph::field::{Evaluation, Field};
use rhinoplan::morph::warp::warp;
use rhinoplan::phantom::Phantom;
use rhinoplan::plan::DEFAULT_SKIN_HU;
use rhinoplan::render::render;
use rhinoplan::resample::{gaussian, half};
use rhinoplan::segment::{Enhance, MEDIAN_SIDE, above, enhance, keep_largest, otsu};
use rhinoplan::simd::Simd;
use rhinoplan::space::GridPoint;
use rhinoplan::surface::signed_distances;
use rhinoplan::volume::{Sample, Volume};

fn main() {
    divan::main();
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

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_lee2001_exact(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    morph(bencher, &case, &case.lee2001, Evaluation::Exact);
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_lee2001_adaptive(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    morph(bencher, &case, &case.lee2001, within_voxels(0.1));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_local_exact(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    morph(bencher, &case, &case.local, Evaluation::Exact);
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_local_adaptive(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let case = case(size);
    morph(bencher, &case, &case.local, within_voxels(0.1));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_extra_lines_exact(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let (case, chain) = with_lines(size, 50);
    morph(bencher, &case, &chain, Evaluation::Exact);
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn morph_extra_lines_adaptive(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let (case, chain) = with_lines(size, 50);
    morph(bencher, &case, &chain, within_voxels(0.1));
}

/// What further lines cost, on the paper's CT.
#[divan::bench(args = EXTRA_LINES, sample_count = 5, sample_size = 1)]
fn morph_lines_exact(bencher: Bencher<'_, '_>, count: usize) {
    let (case, chain) = with_lines(PAPER, count);
    morph(bencher, &case, &chain, Evaluation::Exact);
}

#[divan::bench(args = EXTRA_LINES, sample_count = 5, sample_size = 1)]
fn morph_lines_adaptive(bencher: Bencher<'_, '_>, count: usize) {
    let (case, chain) = with_lines(PAPER, count);
    morph(bencher, &case, &chain, within_voxels(0.1));
}

/// What a coarser map saves, on the paper's CT.
#[divan::bench(args = TOLERANCES, sample_count = 5, sample_size = 1)]
fn morph_lee2001_tolerance(bencher: Bencher<'_, '_>, tolerance: f64) {
    let case = case(PAPER);
    morph(bencher, &case, &case.lee2001, within_voxels(tolerance));
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
    each_simd(bencher, simd, |case| &case.lee2001, within_voxels(0.1));
}

#[divan::bench(args = Simd::all(), sample_count = 5, sample_size = 1)]
fn simd_local_adaptive(bencher: Bencher<'_, '_>, simd: Simd) {
    each_simd(bencher, simd, |case| &case.local, within_voxels(0.1));
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
    let field = Field::evaluated(case.full, &case.local, within_voxels(0.1));
    let moved = warp(case.volume, &field);
    let [before, after] = [case.volume, &moved].map(|volume| boundary(volume, &skin_mask(volume)));
    bencher
        .counter(ItemsCount::new(after.len()))
        .bench(|| signed_distances(black_box(&after), &before, 60.0));
}

/// A view, in pixels per second.
fn view(bencher: Bencher<'_, '_>, size: [usize; 3], azimuth_deg: f64) {
    let volume = head(size);
    let surface = boundary(volume, &skin_mask(volume));
    let camera = camera(&surface, azimuth_deg);
    let object = shown(&surface);
    bencher
        .counter(ItemsCount::new(PICTURE * PICTURE))
        .bench(|| render(black_box(&[object]), &camera));
}

#[divan::bench(args = SIZES, sample_count = 25, sample_size = 1)]
fn view_frontal(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    view(bencher, size, VIEWS_DEG[0]);
}

#[divan::bench(args = SIZES, sample_count = 25, sample_size = 1)]
fn view_oblique_right(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    view(bencher, size, VIEWS_DEG[1]);
}

#[divan::bench(args = SIZES, sample_count = 3, sample_size = 1)]
fn render_phantom(bencher: Bencher<'_, '_>, size: [usize; 3]) {
    let grid = head(size).grid().clone();
    bencher
        .counter(voxels(size))
        .bench(|| Phantom::lee2001().render(black_box(&grid)));
}
