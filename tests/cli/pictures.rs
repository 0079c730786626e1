//! Which pictures a run leaves, and when there is nothing to draw.

use std::collections::BTreeSet;

use image::RgbImage;

use crate::head::{
    CANDIDATES, PATIENT, SPACING, VIEWS, gzip, nifti, nifti_with_names, picture_plan, plan_head,
};
use crate::process::{Desk, Ran, names};

const PAGE: &str = include_str!("../../docs/plan.md");

/// The plan's stages, as folders, and its candidates.
const STAGES: [&str; 3] = ["both/01-move", "both/02-reduce", "up/01-rotate"];
const CANDIDATE_FOLDERS: [&str; 2] = ["both", "up"];
const SLICES: [&str; 4] = ["sagittal", "coronal", "coronal-10mm", "axial"];
const TABLES: [&str; 9] = [
    ".rhinoplan.files",
    "compare.csv",
    "compare.json",
    "compare.md",
    "measurements.csv",
    "plan.effective.toml",
    "run.json",
    "table.md",
    "timings.json",
];

fn ran() -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", picture_plan("good", "ct.nii"));
    desk.run(&["run", "plan.toml"]).expect(0);
    desk
}

/// Every picture that the plan asks for.
fn promised() -> BTreeSet<String> {
    let mut files = BTreeSet::new();
    for view in VIEWS {
        files.insert(format!("preoperative/view-{view}.png"));
        for stage in STAGES {
            let kinds = ["view", "pair", "change"];
            files.extend(kinds.map(|kind| format!("{stage}/{kind}-{view}.png")));
        }
    }
    for stage in STAGES {
        files.extend(SLICES.map(|plane| format!("{stage}/slice-{plane}.png")));
    }
    files.insert("contact-sheet.png".to_owned());
    let charts = ["profile.svg", "profile.png", "volumes.svg", "volumes.png"];
    for chart in charts {
        files.insert(chart.to_owned());
        files.extend(CANDIDATE_FOLDERS.map(|candidate| format!("{candidate}/{chart}")));
    }
    files
}

#[test]
fn every_picture_is_in_its_place_and_no_other_file_is() {
    let desk = ran();
    let files = desk.files("out/good");
    let mut expected = promised();
    expected.extend(TABLES.map(str::to_owned));
    let found: BTreeSet<String> = files.keys().cloned().collect();
    assert_eq!(found, expected);
    for (name, bytes) in &files {
        if name.ends_with(".svg") {
            assert!(bytes.starts_with(b"<svg "), "{name}");
        }
        if name.ends_with(".png") {
            assert!(colours(&open(&desk, name)) > 10, "{name}");
        }
    }
    assert_eq!(names(&desk.files("out")).len(), expected.len());
}

/// `both/01-move/view-frontal.png` is listed as `<candidate>/<NN>-<stage>/view-<view>.png`.
#[test]
fn the_page_lists_every_file_by_its_pattern() {
    let (_, listed) = PAGE.split_once("| file | written | |\n").unwrap();
    let (listed, _) = listed.split_once("\n\n").unwrap();
    let listed: BTreeSet<&str> = listed
        .lines()
        .skip(1)
        .flat_map(|row| row.split('|').nth(1).unwrap().split('`').skip(1).step_by(2))
        .collect();
    let mut patterns: BTreeSet<String> = promised()
        .into_iter()
        .chain(TABLES.map(str::to_owned))
        .map(|file| pattern(&file))
        .collect();
    // What other outputs than pictures add (tests/cli/outputs.rs, meshes.rs).
    let others = [
        "volume.nii.gz",
        "displacement.nii.gz",
        "volume.nrrd",
        "displacement-inverse.nii.gz",
        "skin.stl",
        "bone.stl",
        "skin.ply",
        "augmentation.stl",
        "resection.stl",
    ];
    patterns.extend(others.map(|file| format!("<candidate>/<NN>-<stage>/{file}")));
    patterns.extend(["skin.stl", "bone.stl"].map(|file| format!("preoperative/{file}")));
    // And what sweeps do (tests/cli/sweep.rs), and every run for the next.
    let of_sweeps = ["sweep.csv", "sweep.svg", "sweep.png"];
    patterns.extend(of_sweeps.map(str::to_owned));
    patterns.insert(".rhinoplan.kept/".to_owned());
    assert_eq!(listed, patterns.iter().map(String::as_str).collect());
}

fn pattern(file: &str) -> String {
    let mut pattern = file.to_owned();
    for stage in STAGES {
        pattern = pattern.replace(stage, "<candidate>/<NN>-<stage>");
    }
    for candidate in CANDIDATE_FOLDERS {
        if let Some(rest) = pattern.strip_prefix(&format!("{candidate}/")) {
            pattern = format!("<candidate>/{rest}");
        }
    }
    for view in VIEWS {
        pattern = pattern.replace(&format!("-{view}.png"), "-<view>.png");
    }
    pattern
}

#[test]
fn a_picture_shows_what_its_name_says() {
    let desk = ran();
    let [view, before, pair, change] = [
        "both/02-reduce/view-lateral-left.png",
        "preoperative/view-lateral-left.png",
        "both/02-reduce/pair-lateral-left.png",
        "both/02-reduce/change-lateral-left.png",
    ]
    .map(|name| open(&desk, name));
    assert_eq!(view.dimensions(), (256, 256));
    assert_eq!(before.dimensions(), view.dimensions());
    assert!(differing(&view, &before) > 50, "the nose is lower");
    let top = pair.height() - view.height();
    let half = |left: u32| image::imageops::crop_imm(&pair, left, top, 256, 256).to_image();
    assert_eq!(half(0), before);
    assert_eq!(half(pair.width() - 256), view);
    // The tip moved inward, which is blue, and nothing of plain skin is.
    let blue = |picture: &RgbImage| {
        let blue = picture
            .pixels()
            .filter(|p| p.0[2] > p.0[0].saturating_add(25));
        blue.count()
    };
    assert!(blue(&change) > 50 && blue(&view) == 0);
    // What is recorded of it is about what the plan asks for.
    let record = desk.json("out/good/run.json");
    let stages = &record["candidates"][0]["stages"];
    assert!(stages[0].get("surface_change").is_none());
    let inward = stages[2]["surface_change"]["inward_max_mm"]
        .as_f64()
        .unwrap();
    assert!((-3.0 - SPACING..-1.5).contains(&inward), "{inward} mm");
}

#[test]
fn without_skin_there_is_no_change_of_it() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    let text = picture_plan("good", "ct.nii")
        .replace("[\"skin\", \"bone\"]", "[\"bone\"]")
        .replace("opacity = { skin = 0.5 }\n", "");
    desk.write("plan.toml", text);
    desk.run(&["run", "plan.toml"]).expect(0);
    let changes = |name: &&str| name.contains("change-");
    assert_eq!(
        names(&desk.files("out/good"))
            .iter()
            .filter(|n| changes(n))
            .count(),
        0
    );
    let record = desk.json("out/good/run.json");
    assert!(
        record["candidates"][0]["stages"][1]
            .get("surface_change")
            .is_none()
    );
}

#[test]
fn no_picture_holds_more_than_pixels_or_names_the_patient() {
    let desk = Desk::new();
    desk.write("doe-jane/DOE^JANE.nii.gz", gzip(&nifti_with_names()));
    desk.write(
        "doe-jane/plan.toml",
        picture_plan("good", "DOE^JANE.nii.gz"),
    );
    desk.run(&["run", "doe-jane/plan.toml"]).expect(0);
    let (mut drawings, mut pictures) = (0, 0);
    for (name, bytes) in desk.files("out/good") {
        if name.ends_with(".svg") {
            let text = String::from_utf8(bytes).unwrap().to_lowercase();
            let first = PATIENT.to_lowercase();
            let words = first.split(' ').chain(["nii", "plan.toml"]);
            for word in words {
                assert!(!text.contains(word), "{name} holds {word}");
            }
            drawings += 1;
        } else if name.ends_with(".png") {
            let mut chunks = chunks(&bytes);
            chunks.dedup();
            assert_eq!(chunks, ["IHDR", "IDAT", "IEND"], "{name}");
            pictures += 1;
        }
    }
    assert_eq!((drawings, drawings + pictures), (6, promised().len()));
}

/// The names of a PNG's chunks.
fn chunks(file: &[u8]) -> Vec<String> {
    let mut names = Vec::new();
    let mut at = 8;
    while at < file.len() {
        let length = u32::from_be_bytes(file[at..at + 4].try_into().unwrap()) as usize;
        names.push(String::from_utf8(file[at + 4..at + 8].to_vec()).unwrap());
        at += 12 + length;
    }
    names
}

/// A run with `[segment]` and `[views]` as given that is to end with exit code 3 and without outputs.
fn nothing_to_draw(rest: &str) -> Ran {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    let candidates = CANDIDATES.replace("\"volume\", \"displacement\"", "\"views\"");
    let text = plan_head("good", "ct.nii") + &candidates + rest;
    desk.write("plan.toml", text);
    let ran = desk.run(&["run", "plan.toml"]).expect(3);
    assert_eq!(ran.out, "");
    assert!(!desk.path().join("out").exists());
    ran
}

#[test]
fn a_head_without_bone_has_no_surface_of_bone() {
    // At the default threshold, and only where bone is drawn.
    let ran = nothing_to_draw("[views]\nsize = 256\nobjects = [\"skin\", \"bone\"]\n");
    let message =
        "nothing is at or above 300 HU: there is no surface of bone to draw; check the threshold";
    assert!(ran.err.contains(message), "{ran:?}");
}

#[test]
fn a_cut_that_leaves_nothing_is_told() {
    // Air in front of the face, and what lies beyond either end of the scan: nothing at all.
    for clip in [
        "{ plane = \"coronal\", offset = -10, keep = \"anterior\" }",
        "{ plane = \"coronal\", offset = -500, keep = \"anterior\" }",
        "{ plane = \"sagittal\", offset = 500, keep = \"left\" }",
        "{ plane = \"sagittal\", offset = -500, keep = \"right\" }",
        "{ plane = \"axial\", offset = -500, keep = \"inferior\" }",
    ] {
        let ran = nothing_to_draw(&format!("[views]\nsize = 256\nclip = {clip}\n"));
        let message = "nothing is at or above -500 HU in what `views.clip` leaves: \
                       there is no surface of skin to draw";
        assert!(ran.err.contains(message), "{clip}: {ran:?}");
    }
}

fn open(desk: &Desk, name: &str) -> RgbImage {
    let bytes = std::fs::read(desk.path().join("out/good").join(name)).unwrap();
    image::load_from_memory(&bytes).unwrap().to_rgb8()
}

fn differing(a: &RgbImage, b: &RgbImage) -> usize {
    a.pixels().zip(b.pixels()).filter(|(a, b)| a != b).count()
}

fn colours(picture: &RgbImage) -> usize {
    picture
        .pixels()
        .map(|pixel| pixel.0)
        .collect::<BTreeSet<_>>()
        .len()
}
