//! NIfTI-1, plain and in gzip.

use rhinoplan::io::nifti::{read, read_header};
use rhinoplan::with_volume;

use crate::bounded::{Bench, Expect, Role};
use crate::head;
use crate::nifti_builder::{Folder, Nifti, TYPES, gzip};
use crate::noise::{Noise, Outcome, damage, fuzz};
use crate::volumes::agreed;

/// Files that are tried by default: about a second.
const TRIES: usize = 5000;

fn changed(bytes: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    change(&mut bytes);
    bytes
}

fn flip(bytes: &[u8], at: usize) -> Vec<u8> {
    changed(bytes, |bytes| bytes[at] ^= 0x10)
}

/// Floats in place of the head's integers, one of them `value`.
fn with_voxel(value: f64) -> Vec<u8> {
    let mut file = head::nifti();
    let samples = file.split_off(352);
    head::put_i16s(&mut file, 70, &[64, 64]);
    for (index, pair) in samples.chunks_exact(2).enumerate() {
        let hu = i16::from_le_bytes([pair[0], pair[1]]);
        let hu = if index == 5000 { value } else { f64::from(hu) };
        file.extend(hu.to_le_bytes());
    }
    file
}

/// Bytes that gzip cannot make smaller.
fn incompressible(len: usize) -> Vec<u8> {
    let mut noise = Noise::new(7);
    (0..len).map(|_| noise.next() as u8).collect()
}

/// A header of 384 MB whose first plane is there, stored so that the plane touches every page of the volume.
fn one_plane_of_many() -> Vec<u8> {
    let plane = incompressible(800 * 800);
    let mut file = Nifti::new([800, 800, 600], 2, 1, false, plane);
    // Stored k is x.
    file.sform([
        [0.0, 0.0, -1.0, 0.0],
        [0.0, -1.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
    ]);
    file.gzip()
}

#[test]
fn the_corpus() {
    let bench = Bench::new();
    let sound = head::nifti();
    let packed = gzip(&sound);
    let (first, second) = sound.split_at(100_000);
    let members = [gzip(first), gzip(&[]), gzip(second)].concat();
    let dims = |dims: [i16; 3]| {
        let mut file = sound.clone();
        head::put_i16s(&mut file, 42, &dims);
        file
    };
    let float = |at: usize, value: f32| changed(&sound, |file| head::put_f32s(file, at, &[value]));
    let claims = |bytes: &[u8]| gzip(&[&dims([800, 800, 400])[..352], bytes].concat());
    use Expect::{Read, Refused};
    let cases: Vec<(&str, Vec<u8>, Expect)> = vec![
        // Names and containers that are right.
        ("sound.nii", sound.clone(), Read),
        ("packed.nii.gz", packed.clone(), Read),
        ("members.nii.gz", members.clone(), Read),
        ("packed.nii", packed.clone(), Read),
        ("plain.nii.gz", sound.clone(), Read),
        ("wrong.dcm", sound.clone(), Read),
        ("wrong.mrk.json", packed.clone(), Read),
        ("wrong", packed.clone(), Read),
        // Cut.
        (
            "cut-in-header.nii",
            sound[..200].to_vec(),
            Refused(&["ends inside the header", "200 of 348"]),
        ),
        (
            "cut-in-samples.nii",
            sound[..9000].to_vec(),
            Refused(&["are missing at the end"]),
        ),
        (
            "cut.nii.gz",
            packed[..packed.len() / 2].to_vec(),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "cut-in-trailer.nii.gz",
            packed[..packed.len() - 3].to_vec(),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "cut-member.nii.gz",
            members[..members.len() - 900].to_vec(),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "members-missing.nii.gz",
            gzip(first),
            Refused(&["are missing at the end"]),
        ),
        // Flipped.
        ("flipped-magic.nii", flip(&sound, 345), Refused(&["magic"])),
        (
            "flipped-size.nii",
            flip(&sound, 0),
            Refused(&["not a NIfTI-1 file"]),
        ),
        (
            "flipped.nii.gz",
            flip(&packed, packed.len() / 2),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "bad-crc.nii.gz",
            flip(&packed, packed.len() - 8),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "bad-length.nii.gz",
            flip(&packed, packed.len() - 2),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "bad-crc-of-first.nii.gz",
            flip(&members, gzip(first).len() - 8),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "garbage-behind.nii.gz",
            [&packed[..], b"garbage"].concat(),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        // Sizes that lie, and dimensions that are huge.
        (
            "larger.nii",
            dims([64, 64, 49]),
            Refused(&["8192 are missing at the end"]),
        ),
        (
            "huge.nii",
            dims([32767; 3]),
            Refused(&["are missing at the end"]),
        ),
        (
            "huge.nii.gz",
            gzip(&dims([32767; 3])),
            Refused(&["bytes of gzip can hold"]),
        ),
        (
            "large.nii.gz",
            claims(&incompressible(600_000)),
            Refused(&["are missing at the end"]),
        ),
        (
            "turned.nii.gz",
            one_plane_of_many(),
            Refused(&["are missing at the end"]),
        ),
        (
            "negative.nii",
            dims([64, -64, 48]),
            Refused(&["dim[2]", "-64"]),
        ),
        ("none.nii", dims([64, 0, 48]), Refused(&["dim[2]"])),
        (
            "bomb.nii.gz",
            gzip(&[&sound[..], &vec![0; 64 << 20]].concat()),
            Refused(&["follow the samples"]),
        ),
        (
            "offset.nii",
            float(108, 1e7),
            Refused(&["are missing at the end"]),
        ),
        (
            "bad-offset.nii",
            float(108, f32::INFINITY),
            Refused(&["vox_offset", "inf"]),
        ),
        // Values and affines that are no numbers, or no Hounsfield units.
        (
            "nan.nii.gz",
            gzip(&with_voxel(f64::NAN)),
            Refused(&["1 of 196608 voxels are not numbers", "NaN"]),
        ),
        (
            "inf.nii",
            with_voxel(f64::NEG_INFINITY),
            Refused(&["not numbers", "-inf"]),
        ),
        (
            "vast.nii",
            with_voxel(-1e200),
            Refused(&["too large for Hounsfield units"]),
        ),
        (
            "sform-nan.nii",
            float(284, f32::NAN),
            Refused(&["srow_x", "NaN"]),
        ),
        (
            "sform-inf.nii",
            float(312, f32::INFINITY),
            Refused(&["srow_z", "inf"]),
        ),
        (
            "sform-flat.nii",
            float(320, 0.0),
            Refused(&["sform cannot be used"]),
        ),
        (
            "intercept-nan.nii",
            changed(&sound, |file| head::put_f32s(file, 112, &[1.0, f32::NAN])),
            Refused(&["scl_inter", "NaN"]),
        ),
        (
            "slope-vast.nii",
            float(112, 3e38),
            Refused(&["scl_slope", "at most 1e18"]),
        ),
        // Other formats.
        (
            "text.nii",
            b"not an image at all".to_vec(),
            Refused(&["not a NIfTI-1 file"]),
        ),
        ("zeros.nii", vec![0; 4096], Refused(&["not a NIfTI-1 file"])),
        (
            "text.nii.gz",
            gzip(b"\xef\xbb\xbfone line\r\n"),
            Refused(&["not a NIfTI-1 file"]),
        ),
    ];
    for (name, bytes, expect) in cases {
        bench.try_bytes(Role::Ct, name, bytes, &expect);
    }
}

/// Fields of a header: where they are, and how wide.
const I16_FIELDS: [usize; 14] = [40, 42, 44, 46, 48, 50, 52, 54, 68, 70, 72, 74, 252, 254];
const F32_FIELDS: [usize; 31] = [
    76, 80, 84, 88, 92, 108, 112, 116, 124, 128, 256, 260, 264, 268, 272, 276, 280, 284, 288, 292,
    296, 300, 304, 308, 312, 316, 320, 324, 56, 60, 64,
];
const I16_VALUES: [i16; 16] = [
    0, 1, -1, 2, 3, 4, 5, 7, 8, 16, 64, 256, 1007, 2048, 32767, -32768,
];
const F32_VALUES: [f32; 20] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -2.0,
    352.0,
    353.0,
    368.0,
    -1024.0,
    1e-45,
    1e-20,
    1e10,
    1e18,
    -3e38,
    3.4e38,
    0.999_999_9,
];

/// A sound file of any type, order of bytes and kind of position.
fn any_sound(noise: &mut Noise) -> Nifti {
    let (_, code, bytes) = noise.one_of(&TYPES);
    let dims = [0; 3].map(|_| 1 + noise.below(6) as i16);
    let voxels = dims.iter().map(|&n| n as usize).product::<usize>();
    let big = noise.one_in(3);
    let samples = (0..voxels)
        .flat_map(|n| {
            let value = n as f64 * 3.0 - 20.0;
            let mut sample = match code {
                16 => (value as f32).to_le_bytes().to_vec(),
                64 => value.to_le_bytes().to_vec(),
                _ => (value as i64).to_le_bytes()[..bytes].to_vec(),
            };
            if big {
                sample.reverse();
            }
            sample
        })
        .collect();
    let mut file = Nifti::new(dims, code, bytes, big, samples);
    match noise.below(4) {
        // The quaternion, or neither.
        0 => drop(file.i16s(254, &[0])),
        1 => drop(file.i16s(252, &[0, 0])),
        2 => drop(file.sform([
            [0.0, 0.6, -1.6, 1.0],
            [0.0, 0.8, 1.2, 2.0],
            [-1.5, 0.0, 0.0, 3.0],
        ])),
        _ => {}
    }
    if noise.one_in(3) {
        file.f32s(112, &[0.5, -1024.0]);
    }
    file
}

/// Changes what the checks look at: whole fields to values at the borders of what is allowed.
fn change_header(file: &mut Nifti, noise: &mut Noise) {
    match noise.below(8) {
        0 | 1 => drop(file.i16s(noise.one_of(&I16_FIELDS), &[noise.one_of(&I16_VALUES)])),
        2..=4 => drop(file.f32s(noise.one_of(&F32_FIELDS), &[noise.one_of(&F32_VALUES)])),
        5 => {
            let at = noise.below(348);
            file.header[at] ^= 1 << noise.below(8);
        }
        6 => {
            // A gap before the samples, known to the header or not.
            let gap = 16 * noise.below(20);
            file.between = vec![noise.next() as u8; 4 + gap];
            if noise.one_in(2) {
                file.f32s(108, &[352.0 + gap as f32]);
            }
        }
        _ => {
            // A few samples fewer or more, or another bit pattern of one: NaN among them.
            let len = file.samples.len();
            match noise.below(3) {
                _ if len == 0 => {}
                0 => file.samples.truncate(noise.below(len)),
                1 => file.samples.extend(vec![0x7f; 1 + noise.below(40)]),
                _ => {
                    let at = noise.below(len);
                    let end = (at + 8).min(len);
                    file.samples[at..end].fill(noise.one_of(&[0xff, 0x7f, 0xf0, 0]));
                }
            }
        }
    }
}

/// The file as it is, packed, or packed in pieces.
fn contain(bytes: Vec<u8>, noise: &mut Noise) -> Vec<u8> {
    match noise.below(4) {
        0 | 1 => bytes,
        2 => gzip(&bytes),
        _ => {
            let (first, second) = bytes.split_at(noise.below(bytes.len() + 1));
            [gzip(first), gzip(second)].concat()
        }
    }
}

#[test]
fn changed_at_random() {
    let folder = Folder::new();
    fuzz(
        "nifti::changed_at_random",
        "NIfTI",
        TRIES,
        |index, noise| {
            let mut file = any_sound(noise);
            let changes = noise.below(4);
            for _ in 0..changes {
                change_header(&mut file, noise);
            }
            let mut bytes = contain(file.bytes(), noise);
            let damaged = noise.one_in(3);
            if damaged {
                damage(&mut bytes, 0, noise);
            }
            let path = folder.write("volume.nii", &bytes);
            let both = (read_header(&path), read(&path));
            let Some(scan) = agreed(both, |header| header.grid(), damaged || changes > 0, index)
            else {
                return Outcome::Refused;
            };
            // What was read can be written, and is then the same.
            let mut again = Vec::new();
            with_volume!(&scan.volume, volume => scan.template.write_volume(&mut again, volume))
                .unwrap();
            assert!(folder.read(&again).unwrap().volume == scan.volume);
            Outcome::Read
        },
    );
}
