//! Plans that are right: the numbers they resolve to.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use rhinoplan::feature::{Edit, FeatureKind, Landmark};
use rhinoplan::plan::{
    Camera, Clip, Crop, CtSource, CutPlane, DEFAULT_BONE_HU, DEFAULT_CAGE_DEPTH_MM,
    DEFAULT_MARGIN_MM, DEFAULT_SKIN_HU, DEFAULT_TOLERANCE, DrawnObject, Enhance, Method, Model,
    Object, Outputs, Phantom, Plan, PlanFile, STANDARD_VIEWS, Scale, Segment, Side, SkinThreshold,
    Tolerance, Views,
};
use rhinoplan::space::{
    ContinuousIndex, Grid, GridPoint, GridVector, LpsPoint, LpsVector, RasPoint,
};

/// Rounding of a few additions and products of numbers up to a thousand, mm.
const ROUNDING_MM: f64 = 1e-9;

/// The example of the format's description, as far as this version can run it.
const EXAMPLE: &str = include_str!("plans/example.toml");

/// Anisotropic and oblique, large enough for the paper's landmarks.
fn grid() -> Grid {
    let turn = DMat3::from_axis_angle(DVec3::new(0.2, -0.4, 0.9).normalize(), 0.3);
    let origin = LpsPoint::new(-61.5, 48.25, -310.0);
    Grid::new([320, 320, 151], [0.442, 0.5, 1.25], origin, turn).unwrap()
}

fn resolve(text: &str) -> Plan {
    let file = PlanFile::from_text("plan.toml", Path::new("plans"), text);
    let plan = file.resolve(&grid());
    let plan = plan.unwrap_or_else(|faults| panic!("{faults}"));
    assert!(file.faults().is_empty(), "{}", file.faults());
    plan
}

fn assert_near(found: [f64; 3], expected: [f64; 3]) {
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() < ROUNDING_MM, "{found:?} is not {expected:?}");
    }
}

/// The paper's landmarks in voxels, in the order of [`Landmark::ALL`].
const VOXELS: [[f64; 3]; 6] = [
    [141.1, 71.6, 78.9],
    [141.1, 67.6, 53.1],
    [96.0, 60.0, 60.0],
    [186.0, 60.0, 60.0],
    [129.0, 33.0, 61.0],
    [141.0, 83.6, 60.0],
];

/// A plan with these lines in front of the landmarks and behind them, its points converted by `write`.
fn plan_with(frame: &str, write: impl Fn([f64; 3]) -> [f64; 3], behind: &str) -> String {
    let mut text = format!(
        "plan = 1\nname = \"p\"\n[ct]\nphantom = \"lee2001\"\n[landmarks]\nframe = \"{frame}\"\n"
    );
    for (landmark, voxel) in Landmark::ALL.iter().zip(VOXELS) {
        text.push_str(&format!("{landmark} = {:?}\n", write(voxel)));
    }
    text + behind
}

fn voxel_plan(behind: &str) -> String {
    plan_with("voxel", |voxel| voxel, behind)
}

const ONE_STAGE: &str =
    "[[candidate]]\nname = \"c\"\n[[candidate.stage]]\nname = \"s\"\nf1 = [{ deviate = 1 }]\n";

/// A plan whose candidate `c` has two stages, with this sweep of it.
fn swept(sweep: &str) -> Plan {
    resolve(&voxel_plan(&format!(
        "[[candidate]]\nname = \"c\"\n\
         [[candidate.stage]]\nname = \"a\"\nf1 = [{{ deviate = 1 }}, {{ rotate = 2 }}]\n\
         [[candidate.stage]]\nname = \"b\"\nf1 = [{{ rotate = 3 }}, {{ move_tip = {{ mm = [1, 2, 3] }} }}]\n\
         [[sweep]]\ncandidate = \"c\"\n{sweep}"
    )))
}

#[test]
fn a_sweep_makes_a_candidate_of_every_combination() {
    let plan = swept(
        "[[sweep.vary]]\nstage = \"a\"\nedit = \"deviate\"\nfrom = -0.3\nto = 0.3\nsteps = 3\n\
         [[sweep.vary]]\nstage = \"b\"\nedit = \"move_tip\"\naxis = \"y\"\nvalues = [2.5, 4]\n",
    );
    let names: Vec<&str> = plan.candidates.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "c",
            "c-deviate-m0p3-move-tip-y-2p5",
            "c-deviate-m0p3-move-tip-y-4",
            "c-deviate-0-move-tip-y-2p5",
            "c-deviate-0-move-tip-y-4",
            "c-deviate-0p3-move-tip-y-2p5",
            "c-deviate-0p3-move-tip-y-4",
        ]
    );
    assert!(plan.candidates[0].swept.is_empty());
    let last = &plan.candidates[6];
    assert_eq!(
        last.title.as_deref(),
        Some("deviate 0.3 mm, move_tip y 4 mm")
    );
    let swept: Vec<_> = last
        .swept
        .iter()
        .map(|of| (of.stage.as_str(), of.edit.as_str(), of.value))
        .collect();
    assert_eq!(swept, [("a", "deviate", 0.3), ("b", "move_tip y", 4.0)]);

    // Each is what the plan with these numbers written out has.
    let written = resolve(&voxel_plan(
        "[[candidate]]\nname = \"w\"\n\
         [[candidate.stage]]\nname = \"a\"\nf1 = [{ deviate = 0.3 }, { rotate = 2 }]\n\
         [[candidate.stage]]\nname = \"b\"\nf1 = [{ rotate = 3 }, { move_tip = { mm = [1, 4, 3] } }]\n",
    ));
    assert_eq!(last.stages, written.candidates[0].stages);
}

#[test]
fn the_same_edit_of_two_stages_is_told_apart_by_the_stage() {
    let plan = swept(
        "name = \"s\"\n[[sweep.vary]]\nstage = \"a\"\nedit = \"rotate\"\nvalues = [1]\n\
         [[sweep.vary]]\nstage = \"b\"\nedit = \"rotate\"\nvalues = [-1, 1.5]\n",
    );
    let names: Vec<&str> = plan.candidates.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(
        names,
        ["c", "s-a-rotate-1-b-rotate-m1", "s-a-rotate-1-b-rotate-1p5"]
    );
    assert_eq!(
        plan.candidates[2].title.as_deref(),
        Some("rotate 1°, rotate 1.5°")
    );
}

/// A plan whose only stage has these edits.
fn edited(edits: &str) -> Plan {
    resolve(&voxel_plan(&format!(
        "[[candidate]]\nname = \"c\"\n[[candidate.stage]]\nname = \"s\"\nf1 = [{edits}]\n"
    )))
}

fn to_lps(voxel: [f64; 3]) -> [f64; 3] {
    let grid = grid();
    let point = grid.grid_to_lps(grid.index_to_grid(ContinuousIndex::from(voxel)));
    point.to_array()
}

fn to_ras(voxel: [f64; 3]) -> [f64; 3] {
    RasPoint::from(LpsPoint::from(to_lps(voxel))).to_array()
}

fn to_grid(voxel: [f64; 3]) -> [f64; 3] {
    grid()
        .index_to_grid(ContinuousIndex::from(voxel))
        .to_array()
}

#[test]
fn the_example_of_the_format_resolves() {
    let plan = resolve(EXAMPLE);
    assert_eq!(plan.name, "two-operations");
    assert_eq!(plan.title.as_deref(), Some("Straighten, then reduce"));
    let path = PathBuf::from("plans").join("patient.nii.gz");
    assert_eq!(
        plan.ct,
        CtSource::File {
            path,
            sha256: None,
            series: None
        }
    );
    for (landmark, voxel) in Landmark::ALL.iter().zip(VOXELS) {
        let point = plan.landmarks.get(*landmark).to_array();
        assert_near(point, to_grid(voxel));
    }
    assert_eq!(plan.cage_depth_mm, 11.0);
    assert_near(plan.f1.root.to_array(), to_grid([141.0, 70.0, 84.0]));
    assert_near(plan.f1.tip.to_array(), to_grid([129.0, 33.0, 61.0]));
    assert_eq!(plan.segment.skin_hu, SkinThreshold::Hu(-500.0));
    assert_eq!(plan.segment.bone_hu, 300.0);
    assert_eq!(plan.morph.model, Model::Local { margin_mm: 20.0 });
    assert_eq!(plan.morph.scale, Scale::Full);
    let tolerance = Tolerance::Mm(0.05);
    assert_eq!(plan.morph.method, Method::Adaptive { tolerance });
    assert!(!plan.morph.compare_exact);
    let both = Outputs {
        volume: true,
        displacement: true,
        ..Outputs::default()
    };
    assert_eq!(plan.outputs, both);

    let [candidate] = plan.candidates.as_slice() else {
        panic!("one candidate");
    };
    assert_eq!(candidate.name, "smaller");
    assert_eq!(candidate.title.as_deref(), Some("Straight and smaller"));
    let [straighten, reduce] = candidate.stages.as_slice() else {
        panic!("two stages");
    };
    assert_eq!((&*straighten.name, &*reduce.name), ("straighten", "reduce"));
    assert_eq!(straighten.source, plan.f1);
    assert_near(
        straighten.target.tip.to_array(),
        to_grid([149.0, 33.0, 61.0]),
    );
    assert_eq!(straighten.width, 1.0);
    assert_eq!(reduce.source, straighten.target, "stages accumulate");
    let moved = grid().lps_vector_to_grid(LpsVector::new(0.0, 8.84, 0.0));
    assert!(moved.0.x.abs() > 0.5, "the grid is not oblique");
    let expected = straighten.target.tip + moved;
    assert_near(reduce.target.tip.to_array(), expected.to_array());
    assert_eq!(reduce.target.root, plan.f1.root);
    assert_eq!(reduce.width, 0.95);
}

#[test]
fn the_same_points_in_any_frame_are_the_same_plan() {
    let behind = |write: &dyn Fn([f64; 3]) -> [f64; 3]| {
        format!(
            "[f1]\nroot = {:?}\n{ONE_STAGE}[[candidate.stage]]\nname = \"t\"\nf1 = [{{ tip_to = {:?} }}, {{ root_to = {:?} }}]\n",
            write([141.0, 70.0, 84.0]),
            write([140.0, 40.0, 62.0]),
            write([141.0, 71.0, 83.0])
        )
    };
    let in_voxels = resolve(&plan_with("voxel", |v| v, &behind(&|v| v)));
    let in_lps = resolve(&plan_with("lps", to_lps, &behind(&to_lps)));
    let in_ras = resolve(&plan_with("ras", to_ras, &behind(&to_ras)));
    let last = |plan: &Plan| plan.candidates[0].stages[1].target;
    assert_near(
        last(&in_voxels).tip.to_array(),
        to_grid([140.0, 40.0, 62.0]),
    );
    for other in [&in_lps, &in_ras] {
        for landmark in Landmark::ALL {
            let expected = in_voxels.landmarks.get(landmark).to_array();
            assert_near(other.landmarks.get(landmark).to_array(), expected);
        }
        assert_near(other.f1.root.to_array(), in_voxels.f1.root.to_array());
        assert_near(last(other).tip.to_array(), last(&in_voxels).tip.to_array());
        assert_near(
            last(other).root.to_array(),
            last(&in_voxels).root.to_array(),
        );
    }
}

#[test]
fn what_is_not_written_is_the_default() {
    let plan = resolve(&voxel_plan(ONE_STAGE));
    assert_eq!(plan.title, None);
    assert_eq!(plan.ct, CtSource::Phantom(Phantom::Lee2001));
    assert_eq!(plan.cage_depth_mm, DEFAULT_CAGE_DEPTH_MM);
    assert_eq!(plan.f1.root, plan.landmarks.nasal_bones);
    assert_eq!(plan.f1.tip, plan.landmarks.tip);
    assert_eq!(plan.enhance, Enhance::default());
    let segment = Segment {
        skin_hu: SkinThreshold::Hu(DEFAULT_SKIN_HU),
        bone_hu: DEFAULT_BONE_HU,
        keep_largest: true,
    };
    assert_eq!(plan.segment, segment);
    let margin_mm = DEFAULT_MARGIN_MM;
    assert_eq!(plan.morph.model, Model::Local { margin_mm });
    assert_eq!(plan.morph.scale, Scale::Full);
    let tolerance = DEFAULT_TOLERANCE;
    assert_eq!(plan.morph.method, Method::Adaptive { tolerance });
    assert!(!plan.morph.compare_exact);
    assert_eq!(plan.outputs, Outputs::default());
    assert_eq!(plan.views, None);
    assert_eq!(plan.candidates[0].title, None);
}

#[test]
fn what_is_written_is_not_the_default() {
    let plan = resolve(&voxel_plan(&format!(
        "[cage]\ndepth = {{ voxels = 25 }}\n[segment]\nskin_hu = -300\nbone_hu = 250.5\n\
         [morph]\nmodel = \"lee2001\"\nscale = \"half\"\nmethod = \"exact\"\n\
         [outputs]\nwrite = [\"displacement\"]\n{ONE_STAGE}"
    )));
    assert_eq!(plan.cage_depth_mm, 12.5, "25 voxels of 0.5 mm along y");
    assert_eq!(plan.segment.skin_hu, SkinThreshold::Hu(-300.0));
    assert_eq!(plan.segment.bone_hu, 250.5);
    assert_eq!(plan.morph.model, Model::Lee2001);
    assert_eq!(plan.morph.scale, Scale::Half);
    assert_eq!(plan.morph.method, Method::Exact);
    let displacement = Outputs {
        displacement: true,
        ..Outputs::default()
    };
    assert_eq!(plan.outputs, displacement);

    let plan = resolve(&voxel_plan(&format!(
        "[morph]\nmargin = {{ mm = 12 }}\ntolerance = {{ voxels = 0.1 }}\ncompare_exact = true\n{ONE_STAGE}"
    )));
    assert_eq!(plan.morph.model, Model::Local { margin_mm: 12.0 });
    let tolerance = Tolerance::Voxels(0.1);
    assert_eq!(plan.morph.method, Method::Adaptive { tolerance });
    assert!(plan.morph.compare_exact);
}

#[test]
fn pictures_are_as_written() {
    let plan = resolve(include_str!("plans/pictures.toml"));
    let enhance = Enhance {
        median: Some(3),
        smooth_mm: Some(0.6),
    };
    assert_eq!(plan.enhance, enhance);
    let segment = Segment {
        skin_hu: SkinThreshold::Otsu,
        bone_hu: DEFAULT_BONE_HU,
        keep_largest: false,
    };
    assert_eq!(plan.segment, segment);
    let outputs = Outputs {
        views: true,
        slices: true,
        charts: true,
        ..Outputs::default()
    };
    assert_eq!(plan.outputs, outputs);
    let camera = |name: &str, azimuth_deg, elevation_deg| Camera {
        name: name.to_owned(),
        azimuth_deg,
        elevation_deg,
    };
    let drawn = |object, opacity| DrawnObject { object, opacity };
    let views = Views {
        cameras: vec![
            camera("basal", 0.0, -60.0),
            camera("frontal", 0.0, 0.0),
            camera("high-left", 30.0, 20.0),
            camera("behind", -180.0, -12.5),
        ],
        size: 512,
        objects: vec![drawn(Object::Bone, 1.0), drawn(Object::Skin, 0.4)],
        crop: Crop::Mm(180.0),
        clip: Clip::Plane {
            plane: CutPlane::Sagittal,
            offset_mm: -2.5,
            keep: Side::Left,
        },
    };
    assert_eq!(plan.views, Some(views));
}

#[test]
fn pictures_have_defaults() {
    let views = |views: &str| {
        let outputs = format!("{ONE_STAGE}[outputs]\nwrite = [\"views\"]\n");
        resolve(&voxel_plan(&format!("{outputs}{views}")))
            .views
            .unwrap()
    };
    let default = views("");
    assert_eq!(default, Views::default());
    assert_eq!(views("[views]\n"), default);
    assert_eq!(default.size, 1024);
    let skin = DrawnObject {
        object: Object::Skin,
        opacity: 1.0,
    };
    assert_eq!(default.objects, [skin]);
    assert_eq!((default.crop, default.clip), (Crop::Face, Clip::None));
    let seen = |camera: &Camera| {
        (
            camera.name.clone(),
            camera.azimuth_deg,
            camera.elevation_deg,
        )
    };
    let expected = [
        ("frontal", 0.0, 0.0),
        ("lateral-left", 90.0, 0.0),
        ("lateral-right", -90.0, 0.0),
        ("oblique-left", 45.0, 0.0),
        ("oblique-right", -45.0, 0.0),
        ("basal", 0.0, -60.0),
    ];
    let expected = expected.map(|(name, azimuth, elevation)| (name.to_owned(), azimuth, elevation));
    assert!(default.cameras.iter().map(seen).eq(expected));

    let own = "[[views.camera]]\nname = \"a\"\nazimuth = 1\nelevation = 2\n";
    let both = views(own);
    assert_eq!(both.cameras.len(), STANDARD_VIEWS.len() + 1);
    assert_eq!(both.cameras[..6], default.cameras);
    let only = views(&format!("[views]\nnames = []\n{own}"));
    assert_eq!(only.cameras, both.cameras[6..]);

    let words = [
        ("face", Crop::Face),
        ("head", Crop::Head),
        ("nose", Crop::Nose),
    ];
    for (word, crop) in words {
        assert_eq!(views(&format!("[views]\ncrop = \"{word}\"\n")).crop, crop);
    }
    assert_eq!(views("[views]\nclip = \"nose\"\n").clip, Clip::Nose);
    for (plane, name, sides) in [
        (CutPlane::Sagittal, "sagittal", ["right", "left"]),
        (CutPlane::Coronal, "coronal", ["anterior", "posterior"]),
        (CutPlane::Axial, "axial", ["inferior", "superior"]),
    ] {
        for (side, keep) in sides.into_iter().zip(plane.sides()) {
            let text = format!("[views]\nclip = {{ plane = \"{name}\", keep = \"{side}\" }}\n");
            let clip = Clip::Plane {
                plane,
                offset_mm: 0.0,
                keep,
            };
            assert_eq!(views(&text).clip, clip);
        }
    }
}

#[test]
fn every_edit_is_resolved_to_grid_millimetres() {
    let plan = edited(
        "{ move_tip = { voxels = [2, 4, -1] } }, { move_root = { voxels = [0, 0.5, 0] } }, \
         { move_tip = { mm = [1, 2, 3] } }, { tip_to = [140, 40, 62] }, { root_to = [141, 70, 80] }, \
         { project = 1 }, { rotate = -5.5 }, { lengthen = 0.5 }, { deviate = -2 }, { width = 1.1 }, \
         { width = 0.5 }",
    );
    let stage = &plan.candidates[0].stages[0];
    let turned = grid().lps_vector_to_grid(LpsVector::new(1.0, 2.0, 3.0));
    let point = |voxel| GridPoint::from(to_grid(voxel));
    let expected = [
        Edit::MoveTip(GridVector::new(2.0 * 0.442, 4.0 * 0.5, -1.25)),
        Edit::MoveRoot(GridVector::new(0.0, 0.25, 0.0)),
        Edit::MoveTip(turned),
        Edit::TipTo(point([140.0, 40.0, 62.0])),
        Edit::RootTo(point([141.0, 70.0, 80.0])),
        Edit::Project(1.0),
        Edit::Rotate(-5.5),
        Edit::Lengthen(0.5),
        Edit::Deviate(-2.0),
        Edit::Width(1.1),
        Edit::Width(0.5),
    ];
    assert_eq!(stage.edits, expected);
    assert_eq!(stage.width, 1.1 * 0.5);
    assert_near(stage.target.root.to_array(), to_grid([141.0, 70.0, 80.0]));
}

#[test]
fn a_stage_has_the_kind_of_its_plan_unless_it_says_another() {
    let stage = |name: &str, kind: &str| {
        let header = "[[candidate.stage]]";
        format!("{header}\nname = \"{name}\"\n{kind}f1 = [{{ rotate = 2 }}, {{ lengthen = 1 }}]\n")
    };
    let (line, point) = ("kind = \"line\"\n", "kind = \"point\"\n");
    let stages = stage("a", "") + &stage("b", point) + &stage("c", line) + &stage("d", "");
    let kinds = |f1: &str| {
        let behind = format!("{f1}[[candidate]]\nname = \"c\"\n{stages}");
        let plan = resolve(&voxel_plan(&behind));
        let stages = &plan.candidates[0].stages;
        for pair in stages.windows(2) {
            assert_eq!(
                pair[1].source, pair[0].target,
                "lines accumulate over both kinds"
            );
            assert_ne!(pair[1].source.tip, pair[0].source.tip);
        }
        stages.iter().map(|stage| stage.kind).collect::<Vec<_>>()
    };
    use FeatureKind::{Line, Point};
    assert_eq!(kinds(""), [Line, Point, Line, Line]);
    assert_eq!(kinds("[f1]\nkind = \"line\"\n"), [Line, Point, Line, Line]);
    assert_eq!(
        kinds("[f1]\nkind = \"point\"\n"),
        [Point, Point, Line, Point]
    );
}

#[test]
fn a_vector_in_mm_is_lps_in_every_frame() {
    let behind = ONE_STAGE.replace("deviate = 1", "move_tip = { mm = [1, 2, 3] }");
    let tips = [
        resolve(&plan_with("voxel", |voxel| voxel, &behind)),
        resolve(&plan_with("lps", to_lps, &behind)),
        resolve(&plan_with("ras", to_ras, &behind)),
    ]
    .map(|plan| plan.candidates[0].stages[0].target.tip.to_array());
    assert_near(tips[1], tips[0]);
    assert_near(tips[2], tips[0]);
    let moved = DVec3::from(tips[0]) - DVec3::from(to_grid(VOXELS[4]));
    assert!((moved.length() - 14f64.sqrt()).abs() < ROUNDING_MM);
}

#[test]
fn the_border_of_the_volume_is_inside_in_every_frame() {
    let behind = |write: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let corners = [write([0.0, 0.0, 0.0]), write([319.0, 0.0, 150.0])];
        format!(
            "[[candidate]]\nname = \"c\"\n[[candidate.stage]]\nname = \"s\"\nf1 = [{{ tip_to = {:?} }}, {{ root_to = {:?} }}]\n",
            corners[0], corners[1]
        )
    };
    resolve(&plan_with("voxel", |voxel| voxel, &behind(&|voxel| voxel)));
    resolve(&plan_with("lps", to_lps, &behind(&to_lps)));
    resolve(&plan_with("ras", to_ras, &behind(&to_ras)));
}

#[test]
fn paths_are_relative_to_the_plan_and_pins_are_lower_case() {
    let pin = "AB".repeat(32);
    let with = |path: &str| {
        let ct = format!("path = \"{path}\"\nsha256 = \"{pin}\"\nseries = \"1.2.3\"");
        let text = voxel_plan(ONE_STAGE).replace("phantom = \"lee2001\"", &ct);
        resolve(&text).ct
    };
    let sha256 = Some("ab".repeat(32));
    let series = Some("1.2.3".to_owned());
    let path = PathBuf::from("plans/../ct/a b.nii");
    assert_eq!(
        with("../ct/a b.nii"),
        CtSource::File {
            path,
            sha256: sha256.clone(),
            series: series.clone(),
        }
    );
    let path = PathBuf::from("/data/a.nii");
    assert_eq!(
        with("/data/a.nii"),
        CtSource::File {
            path,
            sha256,
            series
        }
    );
}

#[test]
fn other_spellings_of_toml_are_the_same_plan() {
    let plain = resolve(EXAMPLE);
    let marked = format!("\u{feff}{}", EXAMPLE.replace('\n', "\r\n"));
    assert_eq!(resolve(&marked), plain);
    let inline = voxel_plan(
        "[[candidate]]\nname = \"c\"\nstage = [{ name = \"s\", f1 = [\n  { deviate = 1.0 },\n] }]\n",
    );
    assert_eq!(resolve(&inline), resolve(&voxel_plan(ONE_STAGE)));
    let dotted = voxel_plan(ONE_STAGE).replace("[ct]\nphantom", "ct.phantom");
    assert_eq!(resolve(&dotted), resolve(&voxel_plan(ONE_STAGE)));
}
