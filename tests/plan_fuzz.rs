//! Damaged plans: whatever the text, the answer is a plan or its faults, never a panic.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::collections::HashSet;
use std::path::Path;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use rhinoplan::feature::{FeatureKind, Landmark};
use rhinoplan::plan::{
    Clip, Crop, Diagnostics, MAX_PLAN_BYTES, Plan, PlanFile, SkinThreshold, Views,
};
use rhinoplan::space::Grid;

const PLANS: [&str; 3] = [
    include_str!("plans/example.toml"),
    include_str!("plans/kitchen-sink.toml"),
    include_str!("plans/pictures.toml"),
];

/// How many damaged plans are tried: a few seconds.
const TRIALS: usize = 9000;

/// What is inserted: syntax, keys, and values at the borders of what is allowed.
const PIECES: [&str; 59] = [
    "[",
    "]",
    "[[",
    "]]",
    "{",
    "}",
    "\"",
    "\"\"\"",
    "'",
    "=",
    ",",
    ".",
    "#",
    "\n",
    "\r\n",
    "\t",
    "\\",
    "\u{0}",
    "\u{1b}[31m",
    "\u{202e}",
    "\u{feff}",
    "é",
    "日",
    "\u{1f443}",
    "nan",
    "-inf",
    "1e400",
    "-0.0",
    "1e308",
    "0x7F",
    "99999999999999999999",
    "1979-05-27",
    "true",
    "{}",
    "[]",
    "[1, 2, 3]",
    "{ mm = 1 }",
    "{ voxels = [0, 1, 0] }",
    "\nframe = \"ras\"\n",
    "\nmodel = \"lee2001\"\n",
    "\nmethod = \"exact\"\n",
    "\n[[candidate]]\n",
    "\n[[candidate.stage]]\n",
    "\nname = \"a\"\n",
    "{ lengthen = -1e308 },",
    "{ rotate = 179.9 },",
    "{ width = 0.1 },",
    "\n[candidate]\n",
    "\n[views]\n",
    "\nkind = \"point\"\n",
    "\n[[views.camera]]\n",
    "\nobjects = [\"bone\"]\n",
    "\nskin_hu = 1\n",
    "\"views\",",
    "256",
    "{ mm = 1000 }",
    "\"coronal\"",
    "tip",
    "f1.root",
];

fn grid() -> Grid {
    Grid::axis_aligned([320, 320, 151], [0.442, 0.442, 1.0]).unwrap()
}

struct Damage(ChaCha8Rng);

impl Damage {
    fn below(&mut self, bound: usize) -> usize {
        usize::try_from(self.0.next_u64() % bound.max(1) as u64).unwrap()
    }

    /// A place between two characters.
    fn place(&mut self, text: &str) -> usize {
        let mut place = self.below(text.len() + 1);
        while !text.is_char_boundary(place) {
            place -= 1;
        }
        place
    }

    fn apply(&mut self, text: &mut String) {
        match self.below(6) {
            0 => {
                let place = self.place(text);
                let piece = PIECES[self.below(PIECES.len())];
                text.insert_str(place, piece);
            }
            1 => {
                let (a, b) = (self.place(text), self.place(text));
                let end = a.max(b).min(a.min(b) + 30);
                if text.is_char_boundary(end) {
                    text.replace_range(a.min(b)..end, "");
                }
            }
            2 => {
                // A number becomes another.
                let digits: Vec<usize> = text
                    .match_indices(|c: char| c.is_ascii_digit())
                    .map(|(place, _)| place)
                    .collect();
                if let Some(&place) = digits.get(self.below(digits.len())) {
                    let digit = self.below(10).to_string();
                    text.replace_range(place..=place, &digit);
                }
            }
            other => {
                // A line is removed, doubled or moved.
                let mut lines: Vec<&str> = text.split('\n').collect();
                let place = self.below(lines.len());
                let line = lines[place];
                if other != 3 {
                    lines.remove(place);
                }
                if other != 4 {
                    let to = self.below(lines.len() + 1);
                    lines.insert(to, line);
                }
                *text = lines.join("\n");
            }
        }
    }
}

fn check_faults(text: &str, faults: &Diagnostics) {
    let lines = text.matches('\n').count() + 1;
    assert!(!faults.is_empty());
    assert!(faults.iter().is_sorted_by_key(|f| (f.line, f.column)));
    for fault in faults {
        assert!((1..=lines).contains(&fault.line), "{text}\n{fault:?}");
        assert!(fault.column >= 1);
        assert!(!fault.message.is_empty());
        let shown = fault.render(false);
        assert!(!shown.contains('\u{1b}'), "{shown}");
    }
    assert!(faults.render(true).contains('\u{1b}'));
}

/// What the executor relies on.
fn check_plan(plan: &Plan) {
    let last = grid().last_index() + 1e-6;
    for landmark in Landmark::ALL {
        let index = grid().grid_to_index(*plan.landmarks.get(landmark));
        assert!(index.0.cmpge(glam::DVec3::splat(-1e-6)).all() && index.0.cmple(last).all());
    }
    assert!(plan.cage_depth_mm > 0.0);
    if let SkinThreshold::Hu(skin_hu) = plan.segment.skin_hu {
        assert!(plan.segment.bone_hu > skin_hu);
    }
    assert!(plan.enhance.median.is_none_or(|side| side == 3));
    assert!(
        plan.enhance
            .smooth_mm
            .is_none_or(|mm| mm > 0.0 && mm <= 10.0)
    );
    assert_eq!(plan.views.is_some(), plan.outputs.views);
    assert_eq!(plan.mesh.is_some(), plan.outputs.mesh);
    if let Some(views) = &plan.views {
        check_views(views);
    }
    assert!(!plan.candidates.is_empty());
    let names: HashSet<&str> = plan.candidates.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names.len(), plan.candidates.len());
    for candidate in &plan.candidates {
        assert!(!candidate.stages.is_empty());
        let mut line = plan.f1;
        for stage in &candidate.stages {
            assert!(!stage.edits.is_empty());
            assert_eq!(stage.source, line);
            line = stage.target;
            line.validate().unwrap();
            assert!(line.tip.0.y < plan.landmarks.maxilla.0.y);
            assert!((0.1..=10.0).contains(&stage.width));
            let is_point = stage.kind == FeatureKind::Point;
            assert!(!is_point || (stage.width == 1.0 && stage.source.root == stage.target.root));
        }
    }
}

fn check_views(views: &Views) {
    let names: HashSet<&str> = views.cameras.iter().map(|c| c.name.as_str()).collect();
    assert!(!names.is_empty() && names.len() == views.cameras.len());
    for camera in &views.cameras {
        assert!(camera.azimuth_deg.abs() <= 180.0 && camera.elevation_deg.abs() <= 90.0);
    }
    assert!((256..=4096).contains(&views.size));
    assert!((1..=2).contains(&views.objects.len()));
    for drawn in &views.objects {
        assert!(drawn.opacity > 0.0 && drawn.opacity <= 1.0);
    }
    if let Crop::Mm(mm) = views.crop {
        assert!((20.0..=1000.0).contains(&mm));
    }
    if let Clip::Plane {
        plane,
        offset_mm,
        keep,
    } = views.clip
    {
        assert!(plane.sides().contains(&keep) && offset_mm.abs() <= 500.0);
    }
}

#[test]
fn damaged_plans_are_answered() {
    let mut damage = Damage(ChaCha8Rng::seed_from_u64(2001));
    let grid = grid();
    let (mut right, mut seen) = (0, HashSet::new());
    for trial in 0..TRIALS {
        let mut text = PLANS[trial % PLANS.len()].to_owned();
        for _ in 0..=damage.below(4) {
            damage.apply(&mut text);
        }
        let file = PlanFile::from_text("plan.toml", Path::new("."), &text);
        let _ = (
            file.ct(),
            file.name(),
            file.ct_fault("gone", None).render(false),
        );
        let early = file.faults();
        match file.resolve(&grid) {
            Ok(plan) => {
                right += 1;
                assert!(early.is_empty(), "{text}\n{early}");
                check_plan(&plan);
            }
            Err(faults) => {
                check_faults(&text, &faults);
                assert!(faults.len() >= early.len(), "{text}\n{early}\n{faults}");
                seen.extend(faults.iter().map(|fault| fault.code));
            }
        }
    }
    // The damage is neither always fatal nor always harmless, and reaches every kind of fault.
    assert!(right > TRIALS / 50, "{right} of {TRIALS} are still plans");
    assert!(seen.len() >= 11, "{seen:?}");
}

/// Files of the largest size that are made to be slow or large: they are answered, in few words.
#[test]
fn hostile_files_are_answered() {
    let limit = usize::try_from(MAX_PLAN_BYTES).unwrap();
    let head = "plan = 1\n";
    let fill = |piece: &str| head.to_owned() + &piece.repeat((limit - head.len()) / piece.len());
    let counted = |line: &dyn Fn(usize) -> String| {
        let mut text = head.to_owned();
        for n in 0.. {
            let line = line(n);
            if text.len() + line.len() > limit {
                break;
            }
            text.push_str(&line);
        }
        text
    };
    let files = [
        fill("a = 1\n"),
        fill("[[candidate]]\n"),
        fill("[["),
        fill("\u{0}"),
        fill("é"),
        counted(&|n| format!("a{n}=1\n")),
        counted(&|n| format!("[a{n}.b.c.d]\n")),
        format!("{head}[outputs]\nwrite = [{}]", "\"\",".repeat(300_000)),
        format!("{head}[landmarks]\nlip = [{}]", "1,".repeat(500_000)),
        format!("{head}x = {}1{}", "[".repeat(70), "]".repeat(70)),
        format!("{head}x = \"{}\"", "x".repeat(1_000_000)),
        format!("{head}{} = 1", "tilte".repeat(200_000)),
        format!("{head}{}x = 1", "a.".repeat(500_000)),
    ];
    for text in files {
        let file = PlanFile::from_text("plan.toml", Path::new("."), &text);
        let faults = file.resolve(&grid()).unwrap_err();
        check_faults(&text, &faults);
        let shown = faults.render(false);
        assert!(shown.len() < 200_000, "{} bytes of messages", shown.len());
    }
}
