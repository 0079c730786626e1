//! One suite over every way of evaluating the map: the short form against the general sum, adaptive
//! against exact, composition against doing it by hand, on anisotropic and oblique grids.

use glam::{DMat3, DVec3};
use ndarray::Array3;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use super::audit::{FieldDifference, WarpAudit};
use super::chain::{Chain, Lattice};
use super::field::{Evaluation, Field, Scratch};
use super::halfscale::CoarseDisplacement;
use super::inverse::{ClosedForm, Forward, Inverse, Sampled, TOLERANCE};
use super::pair::{Frame, Segment};
use super::reference::LineSum;
use super::stage::{StageLines, StageMap, Taper};
use super::tile::{Tile, tiles_of};
use super::warp::warp;
use super::{EPSILON, LANES, Points};
use crate::feature::{Cage, FeatureKind, FeatureLine, Landmarks, NoseBox};
use crate::simd::Simd;
use crate::space::{Grid, GridPoint, LpsPoint};
use crate::volume::{Rescale, Volume};

/// Anisotropic and oblique. A third of the phantom's size: what is tested here does not need more.
fn grid() -> Grid {
    let turn = DMat3::from_axis_angle(DVec3::new(0.2, 0.9, -0.4).normalize(), 0.3);
    let origin = LpsPoint::new(-31.0, 17.0, 5.0);
    Grid::new([100, 90, 52], [0.9, 1.0, 1.7], origin, turn).unwrap()
}

/// A nose in the middle of [`grid`].
fn landmarks() -> Landmarks<GridPoint> {
    Landmarks {
        nasal_bones: GridPoint::new(45.0, 32.0, 58.0),
        lip: GridPoint::new(45.0, 30.0, 32.0),
        alare_right: GridPoint::new(27.0, 28.0, 40.0),
        alare_left: GridPoint::new(64.0, 28.0, 40.0),
        tip: GridPoint::new(41.0, 15.0, 41.0),
        maxilla: GridPoint::new(45.0, 37.0, 40.0),
    }
}

fn line(root: DVec3, tip: DVec3) -> FeatureLine {
    FeatureLine::new(GridPoint(root), GridPoint(tip)).unwrap()
}

fn preoperative() -> FeatureLine {
    line(landmarks().nasal_bones.0, landmarks().tip.0)
}

fn moved(tip_by: [f64; 3]) -> FeatureLine {
    let start = preoperative();
    line(start.root.0, start.tip.0 + DVec3::from_array(tip_by))
}

fn lines(source: FeatureLine, target: FeatureLine) -> StageLines {
    StageLines {
        kind: FeatureKind::Line,
        source,
        target,
        cage: Cage::new(&landmarks(), 11.0),
    }
}

fn taper(source: &FeatureLine, target: &FeatureLine) -> Taper {
    Taper {
        nose: NoseBox::new(&landmarks(), source, target),
        margin_mm: 14.0,
    }
}

fn local(source: FeatureLine, target: FeatureLine, width: f64, on: &Lattice) -> StageMap {
    let taper = taper(&source, &target);
    StageMap::local(&lines(source, target), width, taper, on).unwrap()
}

fn lee2001(source: FeatureLine, target: FeatureLine, on: &Lattice) -> StageMap {
    StageMap::lee2001(&lines(source, target), on, on).unwrap()
}

/// Both models of one operation on the full lattice.
fn both_models(source: FeatureLine, target: FeatureLine) -> [StageMap; 2] {
    let full = Lattice::full(&grid());
    [
        local(source, target, 1.0, &full),
        lee2001(source, target, &full),
    ]
}

/// Both models of one operation on the tip alone, on the full lattice.
fn both_of_a_point(source: FeatureLine, target: FeatureLine) -> [StageMap; 2] {
    let full = Lattice::full(&grid());
    let point = StageLines {
        kind: FeatureKind::Point,
        ..lines(source, target)
    };
    [
        StageMap::local(&point, 1.0, taper(&source, &target), &full).unwrap(),
        StageMap::lee2001(&point, &full, &full).unwrap(),
    ]
}

/// Both models and both kinds of feature.
fn all_maps(source: FeatureLine, target: FeatureLine) -> impl Iterator<Item = StageMap> {
    let lines = both_models(source, target).into_iter();
    lines.chain(both_of_a_point(source, target))
}

fn source_of(chain: &Chain, at: DVec3) -> DVec3 {
    let mut points: Points = Points::splat(at);
    chain.to_source(&mut points);
    points.get(LANES - 1)
}

/// Something in every voxel, smooth enough to interpolate and rough enough that a shift shows.
fn textured() -> Volume<i16> {
    let grid = grid();
    let [nx, ny, nz] = grid.dims();
    let samples = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| {
        let wave =
            libm::sin(x as f64 * 0.7) + libm::sin(y as f64 * 0.5) * libm::cos(z as f64 * 0.9);
        (wave * 700.0) as i16
    });
    Volume::new(grid, Rescale::NONE, samples).unwrap()
}

fn adaptive_mm(tolerance: f64) -> Evaluation {
    Evaluation::Adaptive {
        tolerance,
        metric: grid().spacing(),
    }
}

#[test]
fn the_tip_comes_from_where_it_was() {
    let (source, target) = (preoperative(), moved([3.0, 4.0, -2.0]));
    for stage in all_maps(source, target) {
        let at = target.tip.0 / grid().spacing();
        let from = source_of(&stage.into(), at) * grid().spacing();
        assert!((from - source.tip.0).length() < 1e-3, "{from}");
    }
}

#[test]
fn a_translated_f1_translates_the_tissue_on_it() {
    let by = DVec3::new(2.0, 3.0, -1.5);
    let source = preoperative();
    let target = line(source.root.0 + by, source.tip.0 + by);
    for stage in both_models(source, target) {
        let chain = Chain::from(stage);
        for place in [0.0, 0.3, 0.8, 1.0] {
            let at = target.root.0.lerp(target.tip.0, place) / grid().spacing();
            let moved = (source_of(&chain, at) - at) * grid().spacing();
            assert!((moved + by).length() < 1e-4, "{moved} at {place}");
        }
        // On the cage nothing moves.
        for (a, b) in Cage::new(&landmarks(), 11.0).edges() {
            let at = a.lerp(b, 0.4) / grid().spacing();
            assert!((source_of(&chain, at) - at).length() < 1e-3);
        }
    }
}

/// Written out from the definition: V + (P' − P), weighted by (|V − P| + ε)⁻² against the eight edges.
#[test]
fn a_point_translates_by_the_distance_to_it() {
    let (source, target) = (preoperative(), moved([3.0, 4.0, -2.0]));
    let (from, to) = (source.tip.0, target.tip.0);
    let weight = |distance: f64| 1.0 / ((distance + 1e-3) * (distance + 1e-3));
    let to_segment = |(a, b): (DVec3, DVec3), at: DVec3| {
        let place = ((at - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        at.distance(a.lerp(b, place))
    };
    let cage = Cage::new(&landmarks(), 11.0);
    let taper = taper(&source, &target);
    let spacing = grid().spacing();
    let [local, lee2001] = both_of_a_point(source, target).map(Chain::from);
    let mut furthest = 0.0_f64;
    for index in [
        [48.9, 19.3, 23.1],
        [47.2, 20.0, 28.4],
        [40.0, 30.0, 22.0],
        [36.1, 43.7, 31.9],
        [25.0, 25.0, 15.0],
        [90.0, 80.0, 50.0],
    ] {
        let index = DVec3::from_array(index);
        let share = |unit: DVec3| {
            let at = index * spacing / unit;
            let own = weight(at.distance(to / unit));
            let edges = cage.edges();
            let held = edges.map(|(a, b)| weight(to_segment((a / unit, b / unit), at)));
            own / (own + held.iter().sum::<f64>())
        };
        let by_local = (from - to) * share(DVec3::ONE) * taper.at(GridPoint(index * spacing));
        let by_lee2001 = (from - to) * share(spacing);
        for (chain, expected) in [(&local, by_local), (&lee2001, by_lee2001)] {
            let found = (source_of(chain, index) - index) * spacing;
            assert!((found - expected).length() < 1e-12, "{found} at {index}");
            furthest = furthest.max(found.length());
        }
    }
    assert!(furthest > 3.0, "{furthest}");
}

/// A tip that stays keeps a point where it is, however the root moves.
#[test]
fn a_point_knows_no_root() {
    let source = preoperative();
    let root = source.root.0 + DVec3::new(3.0, -2.0, 4.0);
    for stage in both_of_a_point(source, line(root, source.tip.0)) {
        assert!(stage.is_identity());
    }
    let tip = source.tip.0 + DVec3::new(2.0, 1.0, 0.0);
    let [_, with] = both_of_a_point(source, line(root, tip));
    let [_, without] = both_of_a_point(source, line(source.root.0, tip));
    assert_eq!(with, without);
}

#[test]
fn a_ramp_under_an_affine_map_is_the_ramp_of_the_affine_map() {
    // With the cage out of reach λ is 1 and the map is the affine map of f1 alone.
    let grid = grid();
    let far = Cage {
        min: DVec3::splat(1e12),
        max: DVec3::splat(1e12 + 1.0),
    };
    let (source, target) = (preoperative(), moved([1.0, -2.0, 1.5]));
    let stage_lines = StageLines {
        kind: FeatureKind::Line,
        source,
        target,
        cage: far,
    };
    let full = Lattice::full(&grid);
    let stages = [
        StageMap::lee2001(&stage_lines, &full, &full).unwrap(),
        StageMap::local(
            &stage_lines,
            1.2,
            Taper {
                nose: taper(&source, &target).nose,
                margin_mm: 1e12,
            },
            &full,
        )
        .unwrap(),
    ];
    let slope = DVec3::new(3.0, -5.0, 7.0);
    let [nx, ny, nz] = grid.dims();
    let ramp = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| {
        slope.dot(DVec3::new(x as f64, y as f64, z as f64))
    });
    let ramp = Volume::new(grid.clone(), Rescale::NONE, ramp).unwrap();
    for stage in stages {
        let sum = stage.as_line_sum();
        let scale = stage.to_units(DVec3::ONE) - stage.to_units(DVec3::ZERO);
        let to_units = |at: DVec3| stage.to_units(at);
        let expected: Vec<f64> = ramp
            .samples()
            .indexed_iter()
            .map(|((z, y, x), _)| {
                let at = DVec3::new(x as f64, y as f64, z as f64);
                let from = at + sum.displacement(to_units(at)) / scale;
                // The nearest edge voxel outside.
                slope.dot(from.clamp(DVec3::ZERO, grid.last_index()))
            })
            .collect();
        let chain = Chain::from(stage);
        for evaluation in [Evaluation::Exact, adaptive_mm(1e-6)] {
            let warped = warp(&ramp, &Field::evaluated(full, &chain, evaluation));
            let worst = warped
                .as_slice()
                .iter()
                .zip(&expected)
                .fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs()));
            assert!(worst < 1e-4, "{evaluation:?}: {worst}");
            assert_ne!(warped, ramp);
        }
    }
}

#[test]
fn no_edit_gives_the_input_bit_for_bit() {
    let grid = grid();
    let start = preoperative();
    let [nx, ny, nz] = grid.dims();
    // Values that interpolation would not survive.
    let odd = [f32::MAX, -0.0, f32::MIN_POSITIVE, 1.0e-45, -f32::MAX];
    let samples = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| odd[(x + 2 * y + 3 * z) % 5]);
    let volume = Volume::new(grid.clone(), Rescale::NONE, samples).unwrap();
    let full = Lattice::full(&grid);
    for stage in all_maps(start, start) {
        let chain = Chain::from(stage);
        for evaluation in [Evaluation::Exact, adaptive_mm(0.05)] {
            let warped = warp(&volume, &Field::evaluated(full, &chain, evaluation));
            let bits =
                |v: &Volume<f32>| v.as_slice().iter().map(|s| s.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&warped), bits(&volume));
        }
        let audit = WarpAudit::new(&chain, &full, &taper(&start, &start).nose);
        assert_eq!(audit, WarpAudit::IDENTITY);
    }
}

#[test]
fn outside_box_and_margin_the_output_is_the_input() {
    let volume = textured();
    let grid = grid();
    let full = Lattice::full(&grid);
    let half = Lattice::half(&grid);
    let (source, target) = (preoperative(), moved([-4.0, 5.0, 2.0]));
    let chain = Chain::from(local(source, target, 1.1, &full));
    let coarse_chain = Chain::from(local(source, target, 1.1, &half));
    let taper = taper(&source, &target);
    let coarse = CoarseDisplacement::new(half, &coarse_chain, Evaluation::Exact).unwrap();
    let fields = [
        Field::evaluated(full, &chain, Evaluation::Exact),
        Field::evaluated(full, &chain, adaptive_mm(0.3)),
        Field::upsampled(full, &chain, coarse),
    ];
    for field in fields {
        let warped = warp(&volume, &field);
        let mut changed = 0;
        for (((z, y, x), &a), &b) in volume.samples().indexed_iter().zip(&warped.samples()) {
            let point = GridPoint(DVec3::new(x as f64, y as f64, z as f64) * grid.spacing());
            if taper.at(point) == 0.0 {
                assert_eq!(a, b, "voxel {x}, {y}, {z} is outside");
            } else if a != b {
                changed += 1;
            }
        }
        assert!(changed > 10_000, "only {changed} voxels changed");
    }
}

#[test]
fn two_stages_are_the_double_map_made_by_hand() {
    let grid = grid();
    let full = Lattice::full(&grid);
    let (first, second, third) = (
        preoperative(),
        moved([4.0, 0.0, 0.0]),
        moved([4.0, 5.0, 1.0]),
    );
    let (one, two) = (
        local(first, second, 1.0, &full),
        local(second, third, 0.9, &full),
    );
    let chain = Chain::new(vec![one.clone(), two.clone()]);
    let volume = textured();
    let warped = warp(&volume, &Field::evaluated(full, &chain, Evaluation::Exact));
    let sampler = crate::volume::Trilinear::new(&volume);
    let (one, two) = (Chain::from(one), Chain::from(two));
    for (x, y, z) in [
        (45, 18, 24),
        (48, 25, 26),
        (40, 15, 30),
        (52, 30, 22),
        (5, 80, 50),
    ] {
        let at = DVec3::new(x as f64, y as f64, z as f64);
        let from = source_of(&one, source_of(&two, at));
        let expected = sampler.at(from.x, from.y, from.z).round() as i16;
        assert_eq!(warped.samples()[[z, y, x]], expected);
    }
}

#[test]
fn half_scale_follows_lines_and_landmarks_to_half_a_voxel() {
    let grid = grid();
    let (full, half) = (Lattice::full(&grid), Lattice::half(&grid));
    let (source, target) = (preoperative(), moved([3.0, 4.0, -2.0]));
    // `local` is a map in mm: the same on both lattices.
    let fine = Chain::from(local(source, target, 1.0, &full));
    let coarse = Chain::from(local(source, target, 1.0, &half));
    let at = DVec3::new(22.0, 11.0, 13.0);
    let a = full.point_at(source_of(&fine, at * 2.0 + 0.5)).0;
    let b = half.point_at(source_of(&coarse, at)).0;
    assert!((a - b).length() < 1e-10);
    // `lee2001` in coarse voxels, evaluated on either lattice.
    let lines = lines(source, target);
    let on_half = Chain::from(StageMap::lee2001(&lines, &half, &half).unwrap());
    let on_full = Chain::from(StageMap::lee2001(&lines, &half, &full).unwrap());
    let a = full.point_at(source_of(&on_full, at * 2.0 + 0.5)).0;
    let b = half.point_at(source_of(&on_half, at)).0;
    assert!((a - b).length() < 1e-10);
    assert!((a - half.point_at(at).0).length() > 0.1, "the point moved");
}

#[test]
fn a_displacement_of_half_size_is_near_the_one_of_full_size() {
    let grid = grid();
    let (full, half) = (Lattice::full(&grid), Lattice::half(&grid));
    let (source, target) = (preoperative(), moved([3.0, 4.0, -2.0]));
    let fine = Chain::from(local(source, target, 1.0, &full));
    let coarse = Chain::from(local(source, target, 1.0, &half));
    let up = CoarseDisplacement::new(half, &coarse, Evaluation::Exact).unwrap();
    let difference = FieldDifference::new(
        &textured(),
        &Field::evaluated(full, &fine, Evaluation::Exact),
        &Field::upsampled(full, &fine, up),
    );
    // The blur rounds the peak at the tip off; elsewhere the two agree.
    assert!(difference.position_mean_mm < 0.05, "{difference:?}");
    assert!(difference.position_max_mm < 1.0, "{difference:?}");
    assert!(difference.position_max_mm > 0.0);
}

#[test]
fn the_jacobian_is_that_of_finite_differences() {
    let full = Lattice::full(&grid());
    let (first, second, third) = (
        preoperative(),
        moved([4.0, 2.0, 0.0]),
        moved([1.0, 5.0, 1.0]),
    );
    let chain = Chain::new(vec![
        local(first, second, 1.2, &full),
        local(second, third, 1.0, &full),
    ]);
    let global = Chain::from(lee2001(first, second, &full));
    let [point, global_point] = both_of_a_point(first, second);
    // A line and a point in one candidate.
    let mixed = Chain::new(vec![point, local(second, third, 0.9, &full)]);
    for chain in [chain, global, mixed, Chain::from(global_point)] {
        let mut seen = Vec::new();
        for at in [
            [40.3, 12.4, 20.1],
            [52.7, 22.2, 25.3],
            [60.2, 41.0, 30.6],
            [20.5, 30.1, 12.2],
        ] {
            let at = DVec3::from_array(at);
            let mut points: Points = Points::splat(at);
            let determinants = chain.to_source_with_jacobian(&mut points).value;
            assert!((points.get(3) - source_of(&chain, at)).length() < 1e-11);
            let step = 1e-5;
            let slope = |axis: DVec3| {
                (source_of(&chain, at + axis * step) - source_of(&chain, at - axis * step))
                    / (2.0 * step)
            };
            let expected =
                DMat3::from_cols(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z)).determinant();
            assert!(
                (determinants[3] - expected).abs() < 1e-5,
                "{} is not {expected} at {at}",
                determinants[3]
            );
            seen.push(expected);
        }
        assert!(seen.iter().any(|d| (d - 1.0).abs() > 0.02), "{seen:?}");
    }
}

#[test]
fn differences_of_a_field_agree_with_the_closed_form() {
    let full = Lattice::full(&grid());
    let (source, target) = (preoperative(), moved([3.0, 4.0, -2.0]));
    let nose = taper(&source, &target).nose;
    for stage in all_maps(source, target) {
        let chain = Chain::from(stage);
        let closed = WarpAudit::new(&chain, &full, &nose);
        let exact = Field::evaluated(full, &chain, Evaluation::Exact);
        let differences = WarpAudit::of_field(&exact, &nose);
        let off = (closed.jacobian_min - differences.jacobian_min).abs();
        assert!(off < 0.05, "{closed:?} {differences:?}");
        let off = closed.displacement_max_mm - differences.displacement_max_mm;
        assert!(off.abs() < 1e-9);
        let off = closed.displacement_max_outside_mm - differences.displacement_max_outside_mm;
        assert!(off.abs() < 1e-9);
        assert!(closed.jacobian_min < 0.95);
    }
}

#[test]
fn an_audit_tells_the_worst_of_all_voxels() {
    let full = Lattice::full(&grid());
    let (source, target) = (preoperative(), moved([6.0, 4.0, -5.0]));
    let nose = taper(&source, &target).nose;
    let two = |map: StageMap| Chain::new(vec![map.clone(), map]);
    for map in all_maps(source, target) {
        for chain in [Chain::from(map.clone()), two(map)] {
            let (mut least, mut furthest, mut outside) = (1.0_f64, 0.0_f64, 0.0_f64);
            let [nx, ny, nz] = full.dims();
            for (z, y, x) in ndarray::indices((nz, ny, nx)) {
                let at = DVec3::new(x as f64, y as f64, z as f64);
                let mut points: Points = Points::splat(at);
                let determinants = chain.to_source_with_jacobian(&mut points).value;
                let moved = ((points.get(0) - at) * full.spacing()).length();
                least = least.min(determinants[0]);
                furthest = furthest.max(moved);
                if nose.distance(full.point_at(at)) > 0.0 {
                    outside = outside.max(moved);
                }
            }
            let found = WarpAudit::new(&chain, &full, &nose);
            let expected = WarpAudit {
                jacobian_min: least,
                displacement_max_mm: furthest,
                displacement_max_outside_mm: outside,
            };
            assert_eq!(found, expected);
            assert!(least < 0.9 && outside > 0.5);
        }
    }
}

#[test]
fn a_tolerance_decides_on_the_precision() {
    let full = Lattice::full(&grid());
    let chain = Chain::from(local(preoperative(), moved([3.0, 4.0, -2.0]), 1.0, &full));
    let volume = textured();
    let within = |tolerance: f64| {
        let metric = DVec3::ONE;
        Field::evaluated(full, &chain, Evaluation::Adaptive { tolerance, metric })
    };
    let exact = Field::evaluated(full, &chain, Evaluation::Exact);
    assert!(!exact.is_rough() && !within(0.0039).is_rough() && within(0.0041).is_rough());
    // At the rim, and where the map bends most, every voxel is mapped for itself, nearly as exactly.
    let off = FieldDifference::new(&volume, &exact, &within(0.0041));
    assert!(
        off.position_max_voxels > 0.0 && off.position_max_voxels <= 0.0041,
        "{off:?}"
    );
    assert_eq!(
        FieldDifference::new(&volume, &exact, &within(0.0)),
        FieldDifference::default()
    );
    // What does not move is not touched in any precision.
    let rough = warp(&volume, &within(0.1));
    let support = exact.support();
    for ((z, y, x), sample) in rough.samples().indexed_iter() {
        let index = DVec3::new(x as f64, y as f64, z as f64);
        if !support.holds([x, y, z]) || !chain.moves(index) {
            assert_eq!(*sample, volume.samples()[[z, y, x]]);
        }
    }
    let mut scratch = Scratch::new();
    let mut tile = Tile::new();
    for voxels in tiles_of(support) {
        within(0.1).fill(voxels, &mut scratch, &mut tile);
        for offset in tile.offsets() {
            let index = tile.index(offset);
            assert!(chain.moves(index) || tile.get(offset) == index);
        }
    }
    let precise = warp(&volume, &exact);
    let mut apart = rough.as_slice().iter().zip(precise.as_slice());
    assert!(apart.any(|(a, b)| a != b));
}

#[test]
fn single_precision_misses_no_tile_that_holds_an_extreme() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut between =
        |low: f64, high: f64| low + (high - low) * f64::from(rng.next_u32()) / f64::from(u32::MAX);
    let near = grid();
    // Where coordinates are large, and voxels small.
    let far = Grid::axis_aligned([520, 50, 40], [0.17, 0.6, 1.1]).unwrap();
    let mut worst = 0.0_f64;
    for case in 0..40 {
        let full = Lattice::full(if case % 4 == 3 { &far } else { &near });
        let mut any = |reach: f64| [0; 3].map(|_| between(-reach, reach));
        let mut stages = Vec::new();
        let mut source = moved(any(3.0));
        for _ in 0..=case % 3 {
            let reach = [0.3, 8.0, 40.0][case % 3];
            let start = source;
            let target = line(
                start.root.0 + DVec3::from_array(any(reach / 4.0)),
                start.tip.0 + DVec3::from_array(any(reach)),
            );
            let [by, _, _] = any(0.5);
            stages.push(match case % 5 {
                0 => lee2001(start, target, &full),
                1 => both_of_a_point(start, target)[case % 2].clone(),
                2 => lee2001(start, target, &full).holding((0..9).map(|_| {
                    let at = DVec3::from_array(any(40.0)) + 45.0;
                    Segment::new(at, at + DVec3::from_array(any(20.0)))
                })),
                _ => local(start, target, 1.0 + by, &full),
            });
            source = target;
        }
        let nose = taper(&preoperative(), &source).nose;
        let chain = Chain::new(stages);
        worst = worst.max(WarpAudit::screening_is_off_by(&chain, &full, &nose));
    }
    assert!(worst < 0.1, "{worst}");
}

#[test]
fn a_fold_is_seen() {
    // The tip is pushed through the base plane and out behind it.
    let full = Lattice::full(&grid());
    let (source, target) = (preoperative(), moved([0.0, 60.0, 0.0]));
    let stage = local(source, target, 1.0, &full);
    let nose = taper(&source, &target).nose;
    let audit = WarpAudit::new(&stage.into(), &full, &nose);
    assert!(audit.jacobian_min <= 0.0, "{audit:?}");
    assert!(audit.displacement_max_mm > 55.0);
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let grid = grid();
    let (full, half) = (Lattice::full(&grid), Lattice::half(&grid));
    let volume = textured();
    let (source, target) = (preoperative(), moved([3.0, 4.0, -2.0]));
    let chain = Chain::from(local(source, target, 1.0, &full));
    let coarse_chain = Chain::from(local(source, target, 1.0, &half));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let adaptive = Field::evaluated(full, &chain, adaptive_mm(0.05));
            let exact = Field::evaluated(full, &chain, Evaluation::Exact);
            let coarse = CoarseDisplacement::new(half, &coarse_chain, adaptive_mm(0.05)).unwrap();
            (
                warp(&volume, &adaptive),
                warp(&volume, &Field::upsampled(full, &chain, coarse)),
                FieldDifference::new(&volume, &exact, &adaptive),
                WarpAudit::new(&chain, &full, &taper(&source, &target).nose),
            )
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(4));
    assert_ne!(one.0, volume);
}

#[test]
fn any_instructions_give_the_same_bytes() {
    let grid = grid();
    let (full, half) = (Lattice::full(&grid), Lattice::half(&grid));
    let shorts = textured();
    let floats = shorts.samples().mapv(|value| f32::from(value) * 1.37);
    let floats = Volume::new(grid.clone(), Rescale::NONE, floats).unwrap();
    let (source, target) = (preoperative(), moved([3.0, 4.0, -2.0]));
    for stages in all_maps(source, target) {
        let chain = Chain::from(stages);
        let coarse_chain = Chain::from(local(source, target, 1.0, &half));
        let found = Simd::compare(|_| {
            let adaptive = Field::evaluated(full, &chain, adaptive_mm(0.05));
            let exact = Field::evaluated(full, &chain, Evaluation::Exact);
            let coarse = CoarseDisplacement::new(half, &coarse_chain, adaptive_mm(0.05)).unwrap();
            let nose = taper(&source, &target).nose;
            (
                warp(&shorts, &exact),
                warp(&floats, &exact),
                warp(&shorts, &adaptive),
                warp(&floats, &Field::upsampled(full, &chain, coarse)),
                WarpAudit::new(&chain, &full, &nose),
            )
        });
        for (simd, one) in &found {
            assert_eq!(one, &found[0].1, "{simd}");
        }
    }
}

/// An f1 whose ends are anywhere near the nose, before and after: far wilder than a surgeon's.
fn operation() -> impl Strategy<Value = (FeatureLine, FeatureLine)> {
    let point = || (20.0..70.0, 5.0..45.0, 20.0..70.0).prop_map(|(x, y, z)| DVec3::new(x, y, z));
    (point(), point(), point(), point())
        .prop_filter("lines of at least 5 mm", |(a, b, c, d)| {
            a.distance(*b) > 5.0 && c.distance(*d) > 5.0
        })
        .prop_map(|(a, b, c, d)| (line(a, b), line(c, d)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_short_form_of_a_point_is_the_general_sum(
        (source, target) in operation(),
        at in (-20.0..120.0, -20.0..110.0, -20.0..70.0),
    ) {
        let at = DVec3::new(at.0, at.1, at.2);
        let spacing = grid().spacing();
        let [local, lee2001] = both_of_a_point(source, target);
        for (stage, unit) in [(local, DVec3::ONE), (lee2001, spacing)] {
            let edges = Cage::new(&landmarks(), 11.0).edges();
            let sum = LineSum::new(&[], Frame::Literal)
                .unwrap()
                .with_point(source.tip.0 / unit, target.tip.0 / unit)
                .with_fixed_lines(edges.map(|(a, b)| (a / unit, b / unit)));
            let point = GridPoint(at * spacing);
            let strength = stage.taper().map_or(1.0, |taper| taper.at(point));
            let expected = sum.displacement(point.0 / unit) * strength * unit;
            let found = (source_of(&stage.into(), at) - at) * spacing;
            let allowed = 1e-10 * (1.0 + expected.length());
            prop_assert!((found - expected).length() < allowed, "{found} is not {expected}");
        }
    }

    #[test]
    fn the_short_form_is_the_general_sum(
        (source, target) in operation(),
        at in (-20.0..120.0, -20.0..110.0, -20.0..70.0),
    ) {
        let at = DVec3::new(at.0, at.1, at.2);
        for stage in all_maps(source, target) {
            let unit = stage.to_units(at);
            let strength = stage.taper().map_or(1.0, |taper| taper.at(GridPoint(unit)));
            let scale = stage.to_units(DVec3::ONE) - stage.to_units(DVec3::ZERO);
            let expected = stage.as_line_sum().displacement(unit) * strength / scale;
            let found = source_of(&stage.into(), at) - at;
            let allowed = 1e-10 * (1.0 + expected.length());
            prop_assert!((found - expected).length() < allowed, "{found} is not {expected}");
        }
    }
}

/// Ordinary and extreme edits of a nose, for the true error of the adaptive method.
/// Fifty short lines in and around the nose, from a seed.
fn fifty_lines() -> Vec<Segment> {
    let mut state = 7_u64;
    let mut next = |from: f64, to: f64| {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        from + (to - from) * (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut point = || DVec3::new(next(5.0, 85.0), next(10.0, 80.0), next(5.0, 80.0));
    (0..50)
        .map(|_| {
            let start = point();
            Segment::new(start, start + (point() - start) * 0.2)
        })
        .collect()
}

#[test]
fn further_lines_that_hold_still_are_part_of_the_sum() {
    let full = Lattice::full(&grid());
    let (source, target) = (preoperative(), moved([6.0, 4.0, -5.0]));
    let nose = taper(&source, &target).nose;
    for map in all_maps(source, target) {
        let map = map.holding(fifty_lines());
        let (sum, tapers) = (map.as_line_sum(), map.taper().is_some());
        let chain = Chain::from(map.clone());
        if !tapers {
            for at in [DVec3::new(45.0, 20.0, 30.0), DVec3::new(60.0, 41.0, 9.0)] {
                let expected = map.to_units(at) + sum.displacement(map.to_units(at));
                let found = map.to_units(source_of(&chain, at));
                assert!((found - expected).length() < 1e-9, "{found} {expected}");
            }
        }
        // The gradient is that of this sum, and the octree keeps its tolerance.
        let step = 1e-4;
        let at = DVec3::new(48.0, 21.0, 28.0);
        let along = |axis: DVec3| {
            (source_of(&chain, at + axis * step) - source_of(&chain, at - axis * step))
                / (2.0 * step)
        };
        let expected = DMat3::from_cols(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
        let determinants = chain
            .to_source_with_jacobian(&mut Points::<f64>::splat(at))
            .value;
        assert!((determinants[0] / expected.determinant() - 1.0).abs() < 1e-5);
        let exact = Field::evaluated(full, &chain, Evaluation::Exact);
        let adaptive = Field::evaluated(full, &chain, adaptive_mm(0.5));
        let found = FieldDifference::new(&textured(), &exact, &adaptive);
        assert!(found.position_max_mm <= 0.5, "{found:?}");
        // Model `local` moves so little of this grid that all of it is mapped exactly.
        assert!(tapers || found.position_max_mm > 0.0);
        assert!(WarpAudit::new(&chain, &full, &nose).displacement_max_mm > 0.5);
    }
}

fn plausible_edit() -> impl Strategy<Value = [f64; 3]> {
    [-10.0..10.0, -8.0..12.0, -8.0..8.0]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn adaptive_is_within_the_tolerance_at_every_voxel(
        tip in plausible_edit(),
        root in [-4.0..4.0, -4.0..4.0, -4.0..4.0],
        mm in 0.02..0.5,
    ) {
        let full = Lattice::full(&grid());
        let source = preoperative();
        let target = line(
            source.root.0 + DVec3::from_array(root),
            source.tip.0 + DVec3::from_array(tip),
        );
        for stage in all_maps(source, target) {
            let chain = Chain::from(stage);
            let exact = Field::evaluated(full, &chain, Evaluation::Exact);
            let adaptive = Field::evaluated(full, &chain, adaptive_mm(mm));
            let difference = FieldDifference::new(&textured(), &exact, &adaptive);
            println!(
                "tolerance {mm:.6} mm: largest true error {:.6} mm, mean {:.5} mm",
                difference.position_max_mm, difference.position_mean_mm
            );
            prop_assert!(difference.position_max_mm <= mm, "{difference:?} for {mm} mm");
        }
    }

    #[test]
    fn adaptive_is_within_the_tolerance_for_any_lines((source, target) in operation()) {
        let full = Lattice::full(&grid());
        for stage in all_maps(source, target) {
            let chain = Chain::from(stage);
            let exact = Field::evaluated(full, &chain, Evaluation::Exact);
            let metric = DVec3::ONE;
            for tolerance in [0.1, 1.0] {
                let adaptive = Evaluation::Adaptive { tolerance, metric };
                let adaptive = Field::evaluated(full, &chain, adaptive);
                let difference = FieldDifference::new(&textured(), &exact, &adaptive);
                println!(
                    "tolerance {tolerance} voxel: largest true error {:.4} voxel",
                    difference.position_max_voxels
                );
                prop_assert!(difference.position_max_voxels <= tolerance, "{difference:?}");
            }
        }
    }
}

#[test]
fn epsilon_is_the_decided_one() {
    assert_eq!(EPSILON, 1e-3);
}

/// Largest distance, in voxels, from a preoperative voxel to where the map takes its inverse; and how many move.
fn worst_residual(map: &impl Forward, inverse: &Inverse) -> (f64, usize) {
    let [nx, ny, nz] = map.lattice().dims();
    let mut worst = 0.0_f64;
    let mut moved = 0;
    for z in 0..nz {
        for y in 0..ny {
            for x in (0..nx).step_by(LANES) {
                let sources = Points::row([x, y, z]);
                let mut there = sources.clone();
                let count = LANES.min(nx - x);
                for lane in 0..count {
                    let by = inverse.at([x + lane, y, z]);
                    moved += usize::from(by != DVec3::ZERO);
                    there.set(lane, there.get(lane) + by);
                }
                map.to_source(&mut there);
                for lane in 0..count {
                    worst = worst.max((there.get(lane) - sources.get(lane)).length());
                }
            }
        }
    }
    (worst, moved)
}

#[test]
fn the_inverse_of_two_stages_leads_back() {
    let full = Lattice::full(&grid());
    let (first, second) = (moved([5.0, 1.0, 2.0]), moved([2.0, -2.5, 0.0]));
    for stages in [
        vec![
            local(preoperative(), first, 0.9, &full),
            local(first, second, 1.0, &full),
        ],
        vec![
            lee2001(preoperative(), first, &full),
            lee2001(first, second, &full),
        ],
    ] {
        let chain = Chain::new(stages);
        let map = ClosedForm {
            chain: &chain,
            lattice: &full,
        };
        let inverse = Inverse::new(&map).unwrap();
        let audit = inverse.audit();
        assert_eq!(audit.not_converged, 0, "{audit:?}");
        let (worst, moved) = worst_residual(&map, &inverse);
        // The inverse is kept in single precision.
        assert!(worst <= TOLERANCE + 1e-5, "{worst}");
        assert!(moved > 20_000, "{moved}");
        assert!(audit.displacement_max_mm > 2.0);
        // Nothing moves where the map does not.
        for voxel in [[0, 0, 0], [99, 89, 51], [45, 80, 20]] {
            let at = DVec3::from_array(voxel.map(|n: usize| n as f64));
            assert_eq!(inverse.at(voxel) == DVec3::ZERO, !chain.moves(at));
        }
    }
}

#[test]
fn at_half_scale_the_field_that_is_written_is_inverted() {
    let (full, half) = (Lattice::full(&grid()), Lattice::half(&grid()));
    let target = moved([4.0, 1.5, 2.0]);
    let chain = Chain::new(vec![local(preoperative(), target, 1.0, &full)]);
    let on_half = Chain::new(vec![local(preoperative(), target, 1.0, &half)]);
    let coarse = CoarseDisplacement::new(half, &on_half, Evaluation::Exact).unwrap();
    let field = Field::upsampled(full, &chain, coarse);
    let map = Sampled::new(&field).unwrap();
    let mut written = ndarray::Array3::zeros((52, 90, 100));
    super::displacement::fill_component(&field, &grid(), 0, [0; 3], written.view_mut());
    let mut at = Points::splat(DVec3::new(44.0, 18.0, 27.0));
    map.to_source(&mut at);
    let by = (at.get(0) - DVec3::new(44.0, 18.0, 27.0)) * grid().spacing();
    let by = grid().grid_vector_to_lps(crate::space::GridVector(by));
    assert!((by.0.x as f32 - written[[27, 18, 44]]).abs() < 1e-5);
    assert!(written[[27, 18, 44]].abs() > 1.0);
    let inverse = Inverse::new(&map).unwrap();
    assert_eq!(inverse.audit().not_converged, 0, "{:?}", inverse.audit());
    let (worst, moved) = worst_residual(&map, &inverse);
    assert!(
        worst <= TOLERANCE + 1e-5 && moved > 10_000,
        "{worst} {moved}"
    );
}

#[test]
fn a_folded_map_says_what_has_no_inverse() {
    let full = Lattice::full(&grid());
    // Further than the taper can take up.
    let target = moved([30.0, 0.0, 0.0]);
    let stage = local(preoperative(), target, 1.0, &full);
    let nose = NoseBox::new(&landmarks(), &preoperative(), &target);
    let chain = Chain::new(vec![stage]);
    assert!(WarpAudit::new(&chain, &full, &nose).jacobian_min < 0.0);
    let map = ClosedForm {
        chain: &chain,
        lattice: &full,
    };
    let inverse = Inverse::new(&map).unwrap();
    let audit = inverse.audit();
    let (worst, _) = worst_residual(&map, &inverse);
    assert_eq!(audit.not_converged > 0, worst > 2.0 * TOLERANCE);
    assert!(audit.newton > 0);
}
