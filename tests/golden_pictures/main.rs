//! Golden pictures: what plans draw, held against `golden/pictures/`.
//!
//! A picture that differs by more than `rhinoplan verify` allows by default fails, and is left as
//! expected | actual | difference in `target/golden-pictures/`. Where pictures should change, renew them with
//! `RHINOPLAN_UPDATE_PICTURES=1 cargo test --test golden_pictures`, look at them, and say why in CHANGELOG.md.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "helpers of tests, which clippy does not take for tests"
)]

use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;
use rhinoplan::exec::events::Silent;
use rhinoplan::exec::{self, RunOptions};
use rhinoplan::golden::pictures::{self, PictureDifference};
use rhinoplan::golden::tolerance::Pictures;
use rhinoplan::picture::encode_png;

/// Renews the golden pictures where it is set.
const UPDATE: &str = "RHINOPLAN_UPDATE_PICTURES";

/// All golden pictures together, bytes: they are downloaded with the sources.
const MOST_BYTES: u64 = 1_500_000;

/// A plan, and which of the pictures that it draws are kept.
struct Gallery {
    /// From the package's folder.
    plan: &'static str,
    /// From the plan's output folder.
    pictures: &'static [&'static str],
}

/// Each picture is there for something that no other shows.
const FIG8: Gallery = Gallery {
    plan: "plans/fig8.toml",
    pictures: &[
        // A whole face; below it, what moved, with the legend and a range of both signs.
        "line/03-return/view-frontal.png",
        "line/03-return/change-lateral-left.png",
        // As the line's, but for what a point leaves.
        "point/03-return/change-lateral-left.png",
    ],
};

const FOUR_CANDIDATES: Gallery = Gallery {
    plan: "plans/four-candidates.toml",
    pictures: &[
        "turned-up/02-rotate/view-basal.png",
        "reduced/01-reduce/slice-sagittal.png",
        "turned-up/profile.png",
        "volumes.png",
    ],
};

const TRANSLUCENT: Gallery = Gallery {
    plan: "tests/plans/translucent.toml",
    pictures: &["lower/01-reduce/view-oblique-right.png"],
};

/// A cut on all sides, and a camera of the plan's own.
const CLIP_NOSE: Gallery = Gallery {
    plan: "tests/plans/clip-nose.toml",
    pictures: &["lower/01-reduce/view-high-left.png"],
};

const GALLERIES: [Gallery; 4] = [FIG8, FOUR_CANDIDATES, TRANSLUCENT, CLIP_NOSE];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn golden_folder() -> PathBuf {
    root().join("golden/pictures")
}

/// `plans/fig8.toml` and `line/03-return/view-frontal.png` are in `fig8.line.03-return.view-frontal.png`.
fn golden_name(gallery: &Gallery, picture: &str) -> String {
    let plan = Path::new(gallery.plan).file_stem().unwrap();
    format!("{}.{}", plan.to_str().unwrap(), picture.replace('/', "."))
}

fn compare(expected: &RgbImage, actual: &RgbImage) -> Result<(), PictureDifference> {
    pictures::compare(expected, actual, &Pictures::default())
}

fn side_by_side(expected: &RgbImage, actual: &RgbImage) -> RgbImage {
    pictures::side_by_side(expected, actual, Pictures::default().channel)
}

fn open(path: &Path) -> RgbImage {
    let bytes = fs::read(path).unwrap_or_else(|error| {
        panic!(
            "{}: {error}; a new picture is kept with {UPDATE}=1",
            path.display()
        )
    });
    image::load_from_memory(&bytes).unwrap().to_rgb8()
}

/// Runs a plan once and compares, or renews, its pictures. All that differ are told at once.
fn check(gallery: &Gallery) {
    let out = tempfile::tempdir().unwrap();
    let mut ready = exec::prepare(&[root().join(gallery.plan)]).unwrap();
    // Not what this is about, and most of the time.
    ready[0].plan.outputs.volume = false;
    ready[0].plan.outputs.displacement = false;
    let drawn = exec::run(&ready[0], out.path(), &RunOptions::default(), &Silent)
        .unwrap()
        .folder;
    let mut wrong = Vec::new();
    for picture in gallery.pictures {
        let name = golden_name(gallery, picture);
        let (golden, actual) = (golden_folder().join(&name), drawn.join(picture));
        if std::env::var_os(UPDATE).is_some() {
            fs::create_dir_all(golden_folder()).unwrap();
            fs::copy(&actual, &golden).unwrap();
            continue;
        }
        let (expected, actual) = (open(&golden), open(&actual));
        if let Err(difference) = compare(&expected, &actual) {
            let left = leave(
                &root().join("target/golden-pictures"),
                &name,
                &expected,
                &actual,
            );
            let told = difference.row(name, &Pictures::default()).row();
            wrong.push(format!("{}; see {}", told.join(", "), left.display()));
        }
    }
    assert!(
        wrong.is_empty(),
        "{}\nif they are right, renew them: {UPDATE}=1 cargo test --test golden_pictures",
        wrong.join("\n")
    );
}

/// Writes expected | actual | difference, and says where.
fn leave(folder: &Path, name: &str, expected: &RgbImage, actual: &RgbImage) -> PathBuf {
    fs::create_dir_all(folder).unwrap();
    let path = folder.join(name);
    let png = encode_png(&side_by_side(expected, actual)).unwrap();
    fs::write(&path, png).unwrap();
    path
}

#[test]
fn fig8() {
    check(&FIG8);
}

#[test]
fn four_candidates() {
    check(&FOUR_CANDIDATES);
}

#[test]
fn bone_shows_through_skin() {
    check(&TRANSLUCENT);
}

#[test]
fn the_nose_alone() {
    check(&CLIP_NOSE);
}

#[test]
fn the_folder_holds_these_pictures_and_no_others_and_is_small() {
    if std::env::var_os(UPDATE).is_some() {
        // Other tests are writing them.
        return;
    }
    let mut expected: Vec<String> = GALLERIES
        .iter()
        .flat_map(|gallery| {
            gallery
                .pictures
                .iter()
                .map(|name| golden_name(gallery, name))
        })
        .collect();
    expected.sort();
    let entries = fs::read_dir(golden_folder()).unwrap().map(Result::unwrap);
    let (mut found, mut bytes) = (Vec::new(), 0);
    for entry in entries {
        bytes += entry.metadata().unwrap().len();
        found.push(entry.file_name().into_string().unwrap());
    }
    found.sort();
    assert_eq!(found, expected);
    assert!(bytes < MOST_BYTES, "{bytes} bytes");
}

#[test]
fn a_view_that_moved_by_a_pixel_differs_clearly() {
    for (gallery, place) in [(&FIG8, 0), (&FOUR_CANDIDATES, 0), (&TRANSLUCENT, 0)] {
        let name = golden_name(gallery, gallery.pictures[place]);
        let view = open(&golden_folder().join(&name));
        let (width, height) = view.dimensions();
        let moved = RgbImage::from_fn(width, height, |x, y| *view.get_pixel(x.max(1) - 1, y));
        let Err(PictureDifference::Pixels { off, of, .. }) = compare(&view, &moved) else {
            panic!("{name}: the shift is not seen");
        };
        println!("{name}: {off} of {of} pixels");
        assert!(
            off as f64 > 10.0 * Pictures::default().share * of as f64,
            "{name}: {off} of {of}"
        );
    }
}

/// The golden pictures themselves: a nose that is a little other is told from the one that is kept.
#[test]
fn pictures_of_two_noses_differ_and_are_left_side_by_side() {
    let [line, point] = [FIG8.pictures[1], FIG8.pictures[2]]
        .map(|name| open(&golden_folder().join(golden_name(&FIG8, name))));
    assert!(compare(&line, &point).is_err());
    let folder = tempfile::tempdir().unwrap();
    let left = leave(&folder.path().join("new"), "two.png", &line, &point);
    assert!(left.ends_with("new/two.png"));
    let (width, height) = line.dimensions();
    let picture = open(&left);
    assert!(picture.width() > 3 * width && picture.height() == height);
    assert_eq!(picture, side_by_side(&line, &point));
}
