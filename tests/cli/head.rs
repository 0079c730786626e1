//! A small head, byte by byte: a face, a nose on it, air in front. And plans for it.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

pub const DIMS: [usize; 3] = [64, 64, 48];
pub const SPACING: f64 = 1.5;
pub const AIR: i16 = -1000;
pub const TISSUE: i16 = 40;

/// What the tests look for in outputs.
pub const PATIENT: &str = "Jane Doe";

/// Where the face begins, and the nose on it (an ellipsoid), in voxels.
const FACE_Y: f64 = 30.0;
const NOSE: [f64; 3] = [32.0, 30.0, 24.0];
const RADII: [f64; 3] = [9.0, 14.0, 10.0];

fn hu([x, y, z]: [usize; 3]) -> i16 {
    let at = [x as f64, y as f64, z as f64];
    let r2: f64 = (0..3)
        .map(|axis| (at[axis] - NOSE[axis]) / RADII[axis])
        .map(|d| d * d)
        .sum();
    if at[1] >= FACE_Y || r2 <= 1.0 {
        // Not constant: a warp that moves tissue is seen inside it, too.
        TISSUE + ((x * 7 + y * 5 + z * 3) % 11) as i16
    } else {
        AIR
    }
}

/// The head as an uncompressed NIfTI-1 file, stored in LPS order, the first voxel at LPS (-48, -48, -36).
pub fn nifti() -> Vec<u8> {
    file(352, hu)
}

/// The same head with the patient's name wherever a header has room for one.
pub fn nifti_with_names() -> Vec<u8> {
    let mut bytes = file(352 + 32, hu);
    for (at, room) in [(4, 10), (14, 18), (148, 80), (228, 24), (328, 16)] {
        let text = PATIENT.repeat(room / PATIENT.len());
        bytes[at..at + text.len()].copy_from_slice(text.as_bytes());
    }
    // An extension of 32 bytes, of kind "comment".
    bytes[348] = 1;
    bytes[352..356].copy_from_slice(&32_i32.to_le_bytes());
    bytes[356..360].copy_from_slice(&6_i32.to_le_bytes());
    bytes[360..360 + PATIENT.len()].copy_from_slice(PATIENT.as_bytes());
    bytes
}

/// The same value everywhere.
pub fn constant(value: i16) -> Vec<u8> {
    file(352, |_| value)
}

/// A volume of the head's size whose tissue is where `inside` holds, given voxels.
pub fn tissue(inside: impl Fn([f64; 3]) -> bool) -> Vec<u8> {
    let hu = |voxel: [usize; 3]| {
        if inside(voxel.map(|n| n as f64)) {
            TISSUE
        } else {
            AIR
        }
    };
    file(352, hu)
}

fn file(offset: usize, hu: impl Fn([usize; 3]) -> i16) -> Vec<u8> {
    let mut bytes = vec![0; offset];
    put_i32(&mut bytes, 0, 348);
    let [nx, ny, nz] = DIMS.map(|n| n as i16);
    put_i16s(&mut bytes, 40, &[3, nx, ny, nz, 1, 1, 1, 1]);
    put_i16s(&mut bytes, 70, &[4, 16]);
    let s = SPACING as f32;
    put_f32s(&mut bytes, 76, &[1.0, s, s, s]);
    put_f32s(&mut bytes, 108, &[offset as f32]);
    bytes[123] = 2;
    put_i16s(&mut bytes, 254, &[1]);
    // RAS.
    put_sform(
        &mut bytes,
        [
            [-s, 0.0, 0.0, 48.0],
            [0.0, -s, 0.0, 48.0],
            [0.0, 0.0, s, -36.0],
        ],
    );
    bytes[344..348].copy_from_slice(b"n+1\0");
    for z in 0..DIMS[2] {
        for y in 0..DIMS[1] {
            bytes.extend((0..DIMS[0]).flat_map(|x| hu([x, y, z]).to_le_bytes()));
        }
    }
    bytes
}

pub fn put_i32(bytes: &mut [u8], at: usize, value: i32) {
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
}

pub fn put_i16s(bytes: &mut [u8], at: usize, values: &[i16]) {
    for (place, value) in values.iter().enumerate() {
        bytes[at + 2 * place..][..2].copy_from_slice(&value.to_le_bytes());
    }
}

pub fn put_f32s(bytes: &mut [u8], at: usize, values: &[f32]) {
    for (place, value) in values.iter().enumerate() {
        bytes[at + 4 * place..][..4].copy_from_slice(&value.to_le_bytes());
    }
}

/// Rows of the matrix from stored indices to RAS mm.
pub fn put_sform(bytes: &mut [u8], rows: [[f32; 4]; 3]) {
    put_f32s(bytes, 280, &rows.concat());
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::new(6));
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A plan before its candidates.
pub fn plan_head(name: &str, ct: &str) -> String {
    format!(
        "plan = 1\nname = \"{name}\"\n\n[ct]\npath = \"{ct}\"\n\n[landmarks]\nframe = \"voxel\"\n\
         nasal_bones = [32, 30, 36]\nlip = [32, 30, 12]\nalare_right = [22, 28, 20]\n\
         alare_left = [42, 28, 20]\ntip = [32, 16, 22]\nmaxilla = [32, 32, 20]\n\n"
    )
}

/// Two candidates, of two stages and of one, with every output.
pub const CANDIDATES: &str = "\
[[candidate]]
name = \"both\"
title = \"Straight | small\"

[[candidate.stage]]
name = \"move\"
f1 = [{ move_tip = { voxels = [2, 0, 0] } }]

[[candidate.stage]]
name = \"reduce\"
f1 = [{ move_tip = { mm = [0, 3, 0] } }]

[[candidate]]
name = \"up\"

[[candidate.stage]]
name = \"rotate\"
f1 = [{ rotate = 5 }]

[outputs]
write = [\"volume\", \"displacement\"]
";

/// A candidate of one stage that moves the tip to where gamma has no value: found only by measuring.
pub const FAILS_LATE: &str = "\
[[candidate]]
name = \"impossible\"

[[candidate.stage]]
name = \"fold\"
f1 = [{ tip_to = [32, 30, 12] }]

";

pub fn plan(name: &str, ct: &str) -> String {
    plan_head(name, ct) + CANDIDATES
}

/// The names of the views of [`picture_plan`].
pub const VIEWS: [&str; 3] = ["frontal", "lateral-left", "high-left"];

/// As [`plan`], with every picture in place of volumes. The head has no bone; what is drawn as such is the
/// denser of its tissue.
pub fn picture_plan(name: &str, ct: &str) -> String {
    let all = "write = [\"views\", \"slices\", \"charts\"]";
    plan(name, ct).replace("write = [\"volume\", \"displacement\"]", all)
        + "\n[segment]\nbone_hu = 46\n\n[views]\nnames = [\"frontal\", \"lateral-left\"]\n\
           size = 256\nobjects = [\"skin\", \"bone\"]\nopacity = { skin = 0.5 }\n\n\
           [[views.camera]]\nname = \"high-left\"\nazimuth = 30\nelevation = 20\n"
}
