//! The map against an implementation that shares nothing with this program: written in Python with numpy, in
//! double precision, from the same description, as the plain weighted sum over nine lines.
//!
//! `tests/data/map_reference.csv` holds what it gives for two plans on a head CT: target positions, and the
//! positions in the preoperative CT that they come from after all stages, in voxels.

#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests, which clippy does not take for tests"
)]

use std::path::Path;

use glam::DVec3;
use rhinoplan::feature::{Cage, NoseBox};
use rhinoplan::morph::Points;
use rhinoplan::morph::chain::{Chain, Lattice};
use rhinoplan::morph::stage::{StageLines, StageMap, Taper};
use rhinoplan::plan::{Model, Plan, PlanFile};
use rhinoplan::space::Grid;

/// Largest distance from the reference, voxels: its rounding and ours, a thousandth of what the map must
/// keep to.
const TOLERANCE: f64 = 1e-9;

const LANDMARKS: &str = r#"
    plan = 1
    name = "reference"
    [ct]
    path = "cranium.nii.gz"
    [landmarks]
    frame = "voxel"
    nasal_bones = [129.0, 39.0, 46.0]
    lip = [130.0, 26.0, 4.0]
    alare_right = [111.0, 33.0, 19.0]
    alare_left = [148.0, 33.0, 19.0]
    tip = [128.0, 12.0, 24.0]
    maxilla = [111.0, 41.0, 18.0]
"#;

const LOCAL: &str = r#"
    [morph]
    model = "local"
    [[candidate]]
    name = "words"
    [[candidate.stage]]
    name = "first"
    f1 = [{ project = 2.5 }, { deviate = -3.0 }]
    [[candidate.stage]]
    name = "second"
    f1 = [{ rotate = 8.0 }, { width = 0.9 }]
    [[candidate.stage]]
    name = "third"
    f1 = [{ lengthen = -2.0 }, { width = 1.15 }, { move_root = { mm = [0, 1.0, -0.5] } }]
"#;

const LEE2001: &str = r#"
    [cage]
    depth = { voxels = 25 }
    [morph]
    model = "lee2001"
    [[candidate]]
    name = "two"
    [[candidate.stage]]
    name = "straighten"
    f1 = [{ move_tip = { voxels = [6, 0, 0] } }]
    [[candidate.stage]]
    name = "reduce"
    f1 = [{ move_tip = { mm = [0, 6.3, 0] } }]
"#;

fn grid() -> Grid {
    let in_plane = 0.957_031_190_395_355_2;
    Grid::axis_aligned([256, 256, 108], [in_plane, in_plane, 1.5]).unwrap()
}

fn plan(candidates: &str) -> Plan {
    let text = format!("{LANDMARKS}{candidates}");
    let file = PlanFile::from_text("reference.toml", Path::new(""), &text);
    file.resolve(&grid()).unwrap()
}

fn chain(plan: &Plan) -> Chain {
    let full = Lattice::full(&grid());
    let cage = Cage::new(&plan.landmarks, plan.cage_depth_mm);
    let stages = plan.candidates[0].stages.iter();
    let maps = stages.map(|stage| {
        let lines = StageLines {
            kind: stage.kind,
            source: stage.source,
            target: stage.target,
            cage,
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

#[test]
fn both_models_are_those_of_an_independent_implementation() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/map_reference.csv");
    let mut rows = csv::Reader::from_path(path).unwrap();
    let (local, lee2001) = (chain(&plan(LOCAL)), chain(&plan(LEE2001)));
    let (mut count, mut worst, mut furthest) = (0, 0.0_f64, 0.0_f64);
    for row in rows.deserialize() {
        let (plan, x, y, z, sx, sy, sz): (String, f64, f64, f64, f64, f64, f64) = row.unwrap();
        let (at, expected) = (DVec3::new(x, y, z), DVec3::new(sx, sy, sz));
        let mut points: Points = Points::splat(at);
        match plan.as_str() {
            "local" => local.to_source(&mut points),
            _ => lee2001.to_source(&mut points),
        }
        let off = (points.get(0) - expected).length();
        assert!(
            off < TOLERANCE,
            "{plan} at {at}: {off} voxel from {expected}"
        );
        worst = worst.max(off);
        furthest = furthest.max((expected - at).length());
        count += 1;
    }
    println!(
        "{count} positions, moved by up to {furthest:.1} voxels: largest difference {worst:e} voxel"
    );
    assert!(count == 122 && furthest > 5.0);
}
