//! Every kernel with all instructions that the processor has, on what the benches work on, at all their sizes: the same bytes.

#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests, which clippy does not take for tests"
)]

#[path = "../benches/inputs/mod.rs"]
mod inputs;

use std::hash::{DefaultHasher, Hash, Hasher};
use std::time::Instant;

use inputs::{
    EXTRA_LINES, PAPER, SIZES, TOLERANCES, VIEWS_DEG, boundary, camera, case, head, shown,
    skin_mask, with_lines, within_voxels,
};
use rhinoplan::measure::{Slabs, region_volumes};
use rhinoplan::morph::audit::WarpAudit;
use rhinoplan::morph::chain::Chain;
use rhinoplan::morph::field::{Evaluation, Field};
use rhinoplan::morph::warp::warp;
use rhinoplan::phantom::Phantom;
use rhinoplan::plan::DEFAULT_SKIN_HU;
use rhinoplan::render::render;
use rhinoplan::resample::{gaussian, half};
use rhinoplan::segment::above;
use rhinoplan::simd::Simd;

/// Runs `work` with each set of instructions: what it hashes has to be the same.
fn same(what: &str, work: impl Fn(&mut DefaultHasher)) {
    let begin = Instant::now();
    let all = Simd::compare(|_| {
        let mut hasher = DefaultHasher::new();
        work(&mut hasher);
        hasher.finish()
    });
    for (simd, hash) in &all {
        assert_eq!(
            *hash, all[0].1,
            "{what} with {simd} is not as with {}",
            all[0].0
        );
    }
    println!("{what}: {} paths, {:.1?}", all.len(), begin.elapsed());
}

fn same_morph(what: &str, case: &inputs::Case, chain: &Chain, evaluation: Evaluation) {
    same(what, |to| {
        let field = Field::evaluated(case.full, chain, evaluation);
        warp(case.volume, &field).as_slice().hash(to);
    });
}

/// Every kernel on a head of one size.
fn same_steps(size: [usize; 3]) {
    let volume = head(size);
    let case = case(size);
    for evaluation in [Evaluation::Exact, within_voxels(0.1)] {
        same_morph("lee2001", &case, &case.lee2001, evaluation);
        same_morph("local", &case, &case.local, evaluation);
        let (_, chain) = with_lines(size, 50);
        same_morph("50 extra lines", &case, &chain, evaluation);
    }
    same("audit", |to| {
        let audit = WarpAudit::new(&case.lee2001, &case.full, &case.nose);
        format!("{audit:?}").hash(to);
    });
    same("half and Gaussian", |to| {
        let coarse = half::half(volume).unwrap();
        let bits = |value: &f32| value.to_bits();
        coarse
            .as_slice()
            .iter()
            .map(bits)
            .for_each(|bits| bits.hash(to));
        let fine = gaussian::upsample::<i16>(&coarse, volume.grid(), volume.rescale()).unwrap();
        fine.as_slice().hash(to);
    });
    same("regions", |to| {
        let slabs = Slabs::new(&Phantom::lee2001().landmarks_mm()).unwrap();
        let regions = region_volumes(volume, &slabs, DEFAULT_SKIN_HU).unwrap();
        regions.0.map(f64::to_bits).hash(to);
    });
    same("segmentation and surface", |to| {
        let mask = above(volume, DEFAULT_SKIN_HU).unwrap();
        let [_, ny, nz] = mask.dims();
        (0..nz).for_each(|z| (0..ny).for_each(|y| mask.row(y, z).hash(to)));
        format!("{:?}", boundary(volume, &skin_mask(volume)).voxels()).hash(to);
    });
    let surface = boundary(volume, &skin_mask(volume));
    for azimuth_deg in VIEWS_DEG {
        let camera = camera(&surface, azimuth_deg);
        same("view", |to| {
            render(&[shown(&surface)], &camera).pixels().hash(to)
        });
    }
}

#[test]
fn every_path_gives_the_same_bytes_on_the_coarse_head() {
    same_steps(SIZES[0]);
}

#[test]
fn every_path_gives_the_same_bytes_on_the_papers_head() {
    same_steps(PAPER);
    let paper = case(PAPER);
    for tolerance in TOLERANCES {
        same_morph(
            "a tolerance",
            &paper,
            &paper.lee2001,
            within_voxels(tolerance),
        );
    }
    for count in EXTRA_LINES {
        let (_, chain) = with_lines(PAPER, count);
        same_morph("extra lines", &paper, &chain, within_voxels(0.1));
    }
}

#[test]
fn every_path_gives_the_same_bytes_on_the_fine_head() {
    same_steps(SIZES[2]);
}
