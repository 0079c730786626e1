//! `info` and `phantom`.

use std::fs;

use crate::head::{gzip, nifti, put_sform};
use crate::process::{Desk, names};

#[test]
fn info_tells_what_a_volume_is() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("ct.nii.gz", gzip(&nifti()));
    let plain = desk.run(&["info", "ct.nii"]).expect(0).out;
    let packed = desk.run(&["info", "ct.nii.gz"]).expect(0).out;
    let without_digest = |text: &str| text.rsplit_once("SHA-256").unwrap().0.to_owned();
    assert_eq!(without_digest(&plain), without_digest(&packed));
    assert_ne!(plain, packed, "the digest is of the file");
    assert_eq!(
        without_digest(&plain),
        "size         64 × 64 × 48 voxels (left, posterior, superior)\n\
         spacing      1.5 × 1.5 × 1.5 mm\n\
         extent       96.0 × 96.0 × 72.0 mm\n\
         stored as    LPS, i16 (slope 1, intercept 0)\n\
         position     from sform; first voxel at -48.000, -48.000, -36.000 mm (LPS)\n\
         obliquity    0.00°\n\
         range        -1000 to 50 HU\n"
    );
    let ct = desk.run(&["info", "ct.nii", "--json"]).expect(0).document()["ct"].clone();
    assert_eq!(ct["stored_orientation"], "LPS");
    assert_eq!(ct["sample_type"], "i16");
    assert_eq!(ct["hu_range"], serde_json::json!([-1000.0, 50.0]));
    assert_eq!(ct["grid"]["dims"], serde_json::json!([64, 64, 48]));
}

#[test]
fn info_names_flipped_permuted_and_oblique_axes() {
    // Rows of the matrix to RAS, and what nibabel calls the stored axes.
    let (c, s) = (1.5 * 0.984_807_7, 1.5 * 0.173_648_18);
    type Case = ([[f32; 3]; 3], &'static str, &'static str, [usize; 3]);
    let cases: [Case; 4] = [
        (
            [[1.5, 0.0, 0.0], [0.0, 1.5, 0.0], [0.0, 0.0, 1.5]],
            "RAS",
            "0.00°",
            [64, 64, 48],
        ),
        (
            [[-1.5, 0.0, 0.0], [0.0, 1.5, 0.0], [0.0, 0.0, -1.5]],
            "LAI",
            "0.00°",
            [64, 64, 48],
        ),
        (
            [[0.0, 0.0, 1.5], [1.5, 0.0, 0.0], [0.0, -1.5, 0.0]],
            "AIR",
            "0.00°",
            [48, 64, 64],
        ),
        (
            [[-c, s, 0.0], [-s, -c, 0.0], [0.0, 0.0, 1.5]],
            "LPS",
            "10.00°",
            [64, 64, 48],
        ),
    ];
    let desk = Desk::new();
    for (axes, orientation, obliquity, dims) in cases {
        let mut file = nifti();
        put_sform(&mut file, axes.map(|[a, b, c]| [a, b, c, 0.0]));
        desk.write("ct.nii", file);
        let ran = desk.run(&["info", "ct.nii"]).expect(0);
        assert!(
            ran.out
                .contains(&format!("stored as    {orientation}, i16")),
            "{}",
            ran.out
        );
        assert!(
            ran.out.contains(&format!("obliquity    {obliquity}")),
            "{}",
            ran.out
        );
        let [x, y, z] = dims;
        assert!(
            ran.out.contains(&format!("{x} × {y} × {z} voxels")),
            "{}",
            ran.out
        );
    }
}

/// Slow: the whole phantom, made twice and measured twice.
#[test]
fn the_phantom_as_a_file_is_the_phantom_of_a_plan() {
    let desk = Desk::new();
    let ran = desk.run(&["phantom", "-o", "head.nii.gz"]).expect(0);
    assert!(
        ran.out.starts_with("wrote head.nii.gz (320×320×151 voxels"),
        "{ran:?}"
    );
    assert_eq!(names(&desk.files("")), ["head.nii.gz"]);
    let info = desk
        .run(&["info", "head.nii.gz", "--json"])
        .expect(0)
        .document();
    assert_eq!(
        info["ct"]["grid"]["dims"],
        serde_json::json!([320, 320, 151])
    );
    assert_eq!(info["ct"]["stored_orientation"], "LPS");

    let plans = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/plans/two-operations-local.toml"
    );
    let text = fs::read_to_string(plans).unwrap();
    let (text, _) = text.split_once("[outputs]").unwrap();
    let text = text.replace("compare_exact = true", "");
    desk.write("built-in.toml", &text);
    let text = text
        .replace("phantom = \"lee2001\"", "path = \"head.nii.gz\"")
        .replace("name = \"two-operations-local\"", "name = \"from-file\"");
    desk.write("from-file.toml", text);
    desk.run(&["run", "built-in.toml", "from-file.toml"])
        .expect(0);
    let table = |plan: &str| {
        let path = desk.path().join("out").join(plan).join("measurements.csv");
        fs::read_to_string(path).unwrap()
    };
    let (one, other) = (table("two-operations-local"), table("from-file"));
    assert_eq!(one.lines().count(), 1 + 3 * 23);
    // The header of a file holds single-precision spacings and origins.
    const ROUNDING: f64 = 1e-6;
    for (a, b) in one.lines().zip(other.lines()).skip(1) {
        let number = |line: &str| line.split(',').nth(3).unwrap().parse::<f64>().unwrap();
        let (x, y) = (number(a), number(b));
        assert!((x - y).abs() <= ROUNDING * x.abs().max(1.0), "{a}\n{b}");
    }
}
