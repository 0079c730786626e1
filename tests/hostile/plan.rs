//! Plans: whatever the text, the answer is a plan or its faults.

use std::collections::HashSet;
use std::path::Path;

use rhinoplan::feature::{FeatureKind, Landmark};
use rhinoplan::plan::{
    Clip, Crop, Diagnostics, MAX_PLAN_BYTES, Plan, PlanFile, SkinThreshold, Views,
};
use rhinoplan::space::Grid;

use crate::bounded::{Bench, Expect, Role};
use crate::head;
use crate::noise::{Noise, Outcome, count, fuzz};

const PLANS: [&str; 3] = [
    include_str!("../plans/example.toml"),
    include_str!("../plans/kitchen-sink.toml"),
    include_str!("../plans/pictures.toml"),
];

/// How many damaged plans are tried by default: about three seconds.
const TRIES: usize = 8000;

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

/// A place between two characters.
fn place(text: &str, noise: &mut Noise) -> usize {
    let mut place = noise.below(text.len() + 1);
    while !text.is_char_boundary(place) {
        place -= 1;
    }
    place
}

fn change(text: &mut String, noise: &mut Noise) {
    match noise.below(6) {
        0 => {
            let at = place(text, noise);
            let piece = noise.one_of(&PIECES);
            text.insert_str(at, piece);
        }
        1 => {
            let (a, b) = (place(text, noise), place(text, noise));
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
            if let Some(&place) = digits.get(noise.below(digits.len())) {
                let digit = noise.below(10).to_string();
                text.replace_range(place..=place, &digit);
            }
        }
        other => {
            // A line is removed, doubled or moved.
            let mut lines: Vec<&str> = text.split('\n').collect();
            let place = noise.below(lines.len());
            let line = lines[place];
            if other != 3 {
                lines.remove(place);
            }
            if other != 4 {
                let to = noise.below(lines.len() + 1);
                lines.insert(to, line);
            }
            *text = lines.join("\n");
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
fn changed_at_random() {
    let grid = grid();
    let mut seen = HashSet::new();
    let here = fuzz("plan::changed_at_random", "plan", TRIES, |index, noise| {
        let mut text = PLANS[index % PLANS.len()].to_owned();
        for _ in 0..=noise.below(4) {
            change(&mut text, noise);
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
                assert!(early.is_empty(), "{text}\n{early}");
                check_plan(&plan);
                Outcome::Read
            }
            Err(faults) => {
                check_faults(&text, &faults);
                assert!(faults.len() >= early.len(), "{text}\n{early}\n{faults}");
                seen.extend(faults.iter().map(|fault| fault.code));
                Outcome::Refused
            }
        }
    });
    // The damage reaches every kind of fault.
    assert!(
        !here || count(TRIES) < TRIES || seen.len() >= 11,
        "{seen:?}"
    );
}

/// Files of the largest size that are made to be slow or large.
fn swollen() -> Vec<String> {
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
    let within = |start: &str, piece: &str, end: &str| {
        let times = (limit - head.len() - start.len() - end.len()) / piece.len();
        format!("{head}{start}{}{end}", piece.repeat(times))
    };
    // As deep as the parser goes.
    let deep = ".a".repeat(70);
    vec![
        fill("a = 1\n"),
        fill("[[candidate]]\n"),
        fill("[["),
        fill("\u{0}"),
        fill("é"),
        fill("\r\n"),
        counted(&|n| format!("a{n}=1\n")),
        counted(&|n| format!("[a{n}.b.c.d]\n")),
        counted(&|n| format!("[a{n}{deep}]\n")),
        counted(&|n| format!("a{n}{deep}=1\n")),
        counted(&|n| {
            format!(
                "[[candidate]]\nname=\"a{n}\"\n[[candidate.stage]]\nname=\"b\"\nf1=[{{rotate=5}}]\n"
            )
        }),
        within("x = [", "{a.a.a.a.a.a.a.a=1},", "]"),
        within("[outputs]\nwrite = [", "\"\",", "]"),
        within("[landmarks]\nlip = [", "1,", "]"),
        format!("{head}x = {}1{}", "[".repeat(70), "]".repeat(70)),
        within("x = ", "[", ""),
        within("x = ", "{a=", ""),
        within("x = \"", "x", "\""),
        within("", "tilte", " = 1"),
        within("", "a.", "x = 1"),
    ]
}

#[test]
fn swollen_plans_are_answered_in_few_words() {
    for text in swollen() {
        let file = PlanFile::from_text("plan.toml", Path::new("."), &text);
        let faults = file.resolve(&grid()).unwrap_err();
        check_faults(&text, &faults);
        let shown = faults.render(false);
        assert!(shown.len() < 200_000, "{} bytes of messages", shown.len());
    }
}

#[test]
fn swollen_plans_are_answered_at_once_and_in_little_memory() {
    let bench = Bench::new();
    for text in swollen() {
        let name = "swollen.toml";
        bench.try_bytes(Role::Plan, name, text, &Expect::Refused(&["swollen.toml"]));
    }
}

#[test]
fn the_corpus() {
    let bench = Bench::new();
    let sound = head::plan("good", "ct.nii");
    let with = |from: &str, to: &str| {
        assert!(sound.contains(from), "{from}");
        sound.replace(from, to).into_bytes()
    };
    let utf16: Vec<u8> = sound.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let mut flipped = sound.clone().into_bytes();
    flipped[0] ^= 2;
    let quote = sound.find("\"voxel\"").unwrap();
    let second = sound.rfind("[[candidate]]").unwrap();
    use Expect::{Read, Refused};
    let cases: Vec<(&str, Vec<u8>, Expect)> = vec![
        ("sound.toml", sound.clone().into(), Read),
        (
            "windows.toml",
            format!("\u{feff}{}", sound.replace('\n', "\r\n")).into(),
            Read,
        ),
        ("wrong.nii.gz", sound.clone().into(), Read),
        ("wrong", sound.clone().into(), Read),
        (
            "spaces.toml",
            b"\xef\xbb\xbf \r\n\t".to_vec(),
            Refused(&["`plan`"]),
        ),
        (
            "cut-in-text.toml",
            sound[..quote + 3].into(),
            Refused(&["not TOML", "cut-in-text.toml:8"]),
        ),
        (
            "cut.toml",
            sound[..second + 30].into(),
            Refused(&["not TOML"]),
        ),
        ("flipped.toml", flipped, Refused(&["flipped.toml:1:1"])),
        (
            "byte.toml",
            [sound.as_bytes(), b"\xff"].concat(),
            Refused(&["not UTF-8", "save it as UTF-8"]),
        ),
        (
            "utf16.toml",
            [b"\xff\xfe", &utf16[..]].concat(),
            Refused(&["not UTF-8", "byte 0"]),
        ),
        (
            "zero.toml",
            with("\"good\"", "\"go\u{0}od\""),
            Refused(&["not TOML", "zero.toml:2"]),
        ),
        (
            "return.toml",
            sound.replace('\n', "\r").into(),
            Refused(&["not TOML"]),
        ),
        (
            "nan.toml",
            with("[32, 16, 22]", "[32, nan, 22]"),
            Refused(&["nan.toml:13", "finite"]),
        ),
        (
            "inf.toml",
            with("[32, 16, 22]", "[32, -inf, 22]"),
            Refused(&["inf.toml:13", "finite"]),
        ),
        (
            "vast.toml",
            with("[32, 16, 22]", "[32, 1e400, 22]"),
            Refused(&["vast.toml:13"]),
        ),
        (
            "whole.toml",
            with("[32, 16, 22]", "[32, 99999999999999999999999, 22]"),
            Refused(&["whole.toml:13"]),
        ),
        (
            "outside.toml",
            with("[32, 16, 22]", "[32, 1e300, 22]"),
            Refused(&["outside.toml:13", "outside"]),
        ),
        (
            "turn.toml",
            with("rotate = 5", "rotate = 1e308"),
            Refused(&["turn.toml:33"]),
        ),
        (
            "version.toml",
            with("plan = 1", "plan = 9223372036854775807"),
            Refused(&["version.toml:1"]),
        ),
        (
            "large.toml",
            sound
                .clone()
                .into_bytes()
                .into_iter()
                .chain(vec![b'#'; 256 << 10])
                .collect(),
            Refused(&["larger than 262144 bytes"]),
        ),
        ("volume.toml", head::nifti(), Refused(&["volume.toml"])),
    ];
    for (name, bytes, expect) in cases {
        bench.try_bytes(Role::Plan, name, bytes, &expect);
    }
}
