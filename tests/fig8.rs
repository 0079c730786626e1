//! The paper's Fig. 8 (section III) in numbers: a nose is lengthened, its pose is altered, and a line or a
//! point feature is to bring it back. What is left is how far the tissue of the lengthened nose is from
//! where the lengthening alone had put it: both maps lead to the CT, and their difference is measured
//! there, at the same voxel. The numbers are those of `docs/fig8.md`.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "helpers of tests, which clippy does not take for tests"
)]

use std::path::Path;

use glam::DVec3;
use rhinoplan::feature::{Cage, FeatureKind, NoseBox};
use rhinoplan::morph::chain::{Chain, Lattice};
use rhinoplan::morph::field::{Evaluation, Field};
use rhinoplan::morph::stage::{StageLines, StageMap, Taper};
use rhinoplan::morph::warp::warp;
use rhinoplan::morph::{LANES, Points};
use rhinoplan::phantom::Phantom;
use rhinoplan::plan::{Model, Plan, PlanFile, SkinThreshold, Stage};
use rhinoplan::space::{Grid, GridPoint};
use rhinoplan::volume::Volume;

/// How much smaller what a line leaves is than what a point leaves, at least: a half would be clear.
const CLEARLY: f64 = 0.5;

/// Distances from where tissue should come from, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Residual {
    mean: f64,
    largest: f64,
    /// The voxel of the largest.
    at: DVec3,
}

fn grid() -> Grid {
    Phantom::default_grid().unwrap()
}

const PAGE: &str = include_str!("../docs/fig8.md");
const PLAN: &str = include_str!("../plans/fig8.toml");
const TILT: &str = "{ rotate = 6.0 }, { deviate = 4.0 }";
const BACK: &str = "{ deviate = -4.0 }, { rotate = -6.0 }";

fn resolve(text: &str) -> Plan {
    let file = PlanFile::from_text("fig8.toml", Path::new(""), text);
    file.resolve(&grid()).unwrap()
}

fn plan(model: Model) -> Plan {
    let mut plan = resolve(PLAN);
    plan.morph.model = model;
    plan
}

/// The map from a stage's voxels to the CT.
fn chain(plan: &Plan, stages: &[Stage]) -> Chain {
    let full = Lattice::full(&grid());
    let maps = stages.iter().map(|stage| {
        let lines = StageLines {
            kind: stage.kind,
            source: stage.source,
            target: stage.target,
            cage: Cage::new(&plan.landmarks, plan.cage_depth_mm),
        };
        match plan.morph.model {
            Model::Lee2001 => StageMap::lee2001(&lines, &full, &full).unwrap(),
            Model::Local { margin_mm } => {
                let nose = NoseBox::new(&plan.landmarks, &stage.source, &stage.target);
                StageMap::local(&lines, stage.width, Taper { nose, margin_mm }, &full).unwrap()
            }
        }
    });
    Chain::new(maps.collect())
}

/// The voxels of the nose after its first stage: tissue in the nose box, and those of them that have air
/// beside them.
fn nose(plan: &Plan, lengthen: &Stage) -> (Vec<DVec3>, Vec<DVec3>) {
    let SkinThreshold::Hu(skin_hu) = plan.segment.skin_hu else {
        panic!("the plan gives a threshold");
    };
    let head: Volume<i16> = Phantom::lee2001().render(&grid()).unwrap();
    let map = chain(plan, std::slice::from_ref(lengthen));
    let full = Lattice::full(&grid());
    let lengthened = warp(&head, &Field::evaluated(full, &map, Evaluation::Exact));
    let samples = lengthened.samples();
    let is_tissue = |[x, y, z]: [usize; 3]| {
        let sample = samples.get([z, y, x]);
        sample.is_some_and(|&sample| f64::from(sample) >= skin_hu)
    };
    let nose = NoseBox::new(&plan.landmarks, &lengthen.source, &lengthen.target);
    let [nx, ny, nz] = grid().dims();
    let (mut tissue, mut surface) = (Vec::new(), Vec::new());
    for (z, y, x) in
        (1..nz - 1).flat_map(|z| (1..ny - 1).flat_map(move |y| (1..nx - 1).map(move |x| (z, y, x))))
    {
        let at = DVec3::new(x as f64, y as f64, z as f64);
        let is_inside = nose.distance(GridPoint(at * grid().spacing())) == 0.0;
        if !is_inside || !is_tissue([x, y, z]) {
            continue;
        }
        tissue.push(at);
        let beside = [
            [x - 1, y, z],
            [x + 1, y, z],
            [x, y - 1, z],
            [x, y + 1, z],
            [x, y, z - 1],
            [x, y, z + 1],
        ];
        if !beside.into_iter().all(is_tissue) {
            surface.push(at);
        }
    }
    (tissue, surface)
}

/// How far two maps are apart at these voxels, mm.
fn apart(a: &Chain, b: &Chain, voxels: &[DVec3]) -> Residual {
    let mut sum = 0.0;
    let (mut largest, mut worst) = (0.0, DVec3::ZERO);
    for voxels in voxels.chunks(LANES) {
        let mut to_a: Points = Points::zero();
        for (lane, &at) in voxels.iter().enumerate() {
            to_a.set(lane, at);
        }
        let mut to_b = to_a.clone();
        a.to_source(&mut to_a);
        b.to_source(&mut to_b);
        for (lane, &at) in voxels.iter().enumerate() {
            let off = (to_a.get(lane) - to_b.get(lane)) * grid().spacing();
            sum += off.length();
            if off.length() > largest {
                (largest, worst) = (off.length(), at);
            }
        }
    }
    Residual {
        mean: sum / voxels.len() as f64,
        largest,
        at: worst,
    }
}

/// What is left of the tilt, and what the tilt was: in tissue, and at the surface.
struct Returned {
    tilt: [Residual; 2],
    line: [Residual; 2],
    point: [Residual; 2],
}

fn returned(plan: &Plan) -> Returned {
    let [line, point] = plan.candidates.as_slice() else {
        panic!("two candidates");
    };
    let lengthen = &line.stages[0];
    let (tissue, surface) = nose(plan, lengthen);
    println!(
        "{} voxels of tissue, {} of them at the surface",
        tissue.len(),
        surface.len()
    );
    assert!(tissue.len() > 20_000 && surface.len() > 2_000);
    let wanted = chain(plan, std::slice::from_ref(lengthen));
    let left = |stages: &[Stage]| {
        let map = chain(plan, stages);
        [&tissue, &surface].map(|voxels| apart(&wanted, &map, voxels))
    };
    Returned {
        tilt: left(&line.stages[..2]),
        line: left(&line.stages),
        point: left(&point.stages),
    }
}

/// The row of a table of the page.
fn row(what: &str, [tissue, surface]: [Residual; 2]) -> String {
    let [x, y, z] = tissue.at.to_array();
    format!(
        "| {what} | {:.3} | {:.3} | {:.3} | {:.3} | ({x}, {y}, {z}) |",
        tissue.mean, tissue.largest, surface.mean, surface.largest
    )
}

#[test]
fn a_line_returns_the_nose_better_than_a_point() {
    let mut missing = Vec::new();
    for model in [Model::Local { margin_mm: 20.0 }, Model::Lee2001] {
        let Returned { tilt, line, point } = returned(&plan(model));
        let rows = [
            row("(c) tilted", tilt),
            row("(d) returned with the line", line),
            row("(e) returned with the point", point),
        ];
        println!("{}\n{}", model.name(), rows.join("\n"));
        for place in 0..2 {
            // Both are attempts to return: each leaves less than there was.
            assert!(point[place].mean < tilt[place].mean);
            assert!(point[place].largest < tilt[place].largest);
            assert!(line[place].mean < CLEARLY * point[place].mean);
            assert!(line[place].largest < CLEARLY * point[place].largest);
        }
        missing.extend(rows.into_iter().filter(|row| !PAGE.contains(row.as_str())));
    }
    assert!(missing.is_empty(), "docs/fig8.md does not say {missing:#?}");
}

/// The plan's tilt is no lucky one.
#[test]
fn so_it_does_after_other_tilts() {
    assert_eq!(PLAN.matches(TILT).count(), 2);
    assert_eq!(PLAN.matches(BACK).count(), 2);
    for (tilt, back) in [
        ("{ rotate = 6.0 }", "{ rotate = -6.0 }"),
        ("{ rotate = -6.0 }", "{ rotate = 6.0 }"),
        ("{ deviate = 4.0 }", "{ deviate = -4.0 }"),
        ("{ deviate = -8.0 }", "{ deviate = 8.0 }"),
    ] {
        let plan = resolve(&PLAN.replace(TILT, tilt).replace(BACK, back));
        let Returned { line, point, .. } = returned(&plan);
        let [line, point] = [line[0], point[0]];
        let row = format!(
            "| `{tilt}` | {:.3} | {:.3} | {:.3} | {:.3} |",
            line.mean, line.largest, point.mean, point.largest
        );
        println!("{row}");
        assert!(line.mean < CLEARLY * point.mean);
        assert!(line.largest < point.largest);
        assert!(PAGE.contains(&row), "docs/fig8.md does not say {row}");
    }
}

/// The tip itself comes back with either: that is all that a point asks for.
#[test]
fn both_return_the_tip() {
    let plan = plan(Model::Local { margin_mm: 20.0 });
    for candidate in &plan.candidates {
        let [lengthen, tilt, back] = candidate.stages.as_slice() else {
            panic!("three stages");
        };
        assert!((tilt.target.tip - lengthen.target.tip).0.length() > 4.0);
        assert!((back.target.tip - lengthen.target.tip).0.length() < 1e-9);
        let tip = grid().grid_to_index(back.target.tip).0;
        let wanted = chain(&plan, std::slice::from_ref(lengthen));
        let left = apart(&wanted, &chain(&plan, &candidate.stages), &[tip]);
        assert!(left.largest < 1e-3, "{left:?}");
    }
    let kinds = plan.candidates.iter().map(|c| c.stages[2].kind);
    assert!(kinds.eq([FeatureKind::Line, FeatureKind::Point]));
}
