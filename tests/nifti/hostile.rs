//! Malformed files: each is refused by name, or read right. None panics, none shifts a voxel.
//!
//! Random damage is in `tests/hostile/nifti.rs`.

use std::path::Path;

use rhinoplan::io::nifti::{NiftiError, NiftiProblem, read, read_header};

use crate::builder::{Folder, Nifti, gzip};

/// A change to a sound file, and words that the message must hold.
type Case = (
    &'static str,
    for<'a> fn(&'a mut Nifti) -> &'a mut Nifti,
    &'static [&'static str],
);

const HEADERS: &[Case] = &[
    ("size 0", |f| f.i32(0, 0), &["sizeof_hdr", "is 0", "348"]),
    ("nifti-2", |f| f.i32(0, 540), &["NIfTI-2", "convert"]),
    (
        "nifti-2, swapped",
        |f| f.i32(0, 540_i32.swap_bytes()),
        &["NIfTI-2"],
    ),
    (
        "pair",
        |f| f.text(344, "ni1"),
        &[".hdr/.img", "single .nii"],
    ),
    (
        "analyze",
        |f| f.raw(344, &[0; 4]),
        &["Analyze 7.5", "left from right"],
    ),
    ("magic", |f| f.text(344, "n+7"), &["magic", "n+7", "n+1"]),
    ("no axes", |f| f.i16s(40, &[0]), &["dim[0]", "is 0"]),
    ("eight axes", |f| f.i16s(40, &[8]), &["dim[0]", "is 8"]),
    ("negative axes", |f| f.i16s(40, &[-3]), &["dim[0]", "is -3"]),
    (
        "one slice",
        |f| f.i16s(40, &[2]),
        &["dim[0]", "is 2", "stack"],
    ),
    (
        "negative length",
        |f| f.i16s(44, &[-4]),
        &["dim[2]", "is -4"],
    ),
    ("length 0", |f| f.i16s(46, &[0]), &["dim[3]", "is 0"]),
    (
        "time",
        |f| f.i16s(40, &[4, 5, 2, 2, 3]),
        &["dim[4]", "is 3", "several volumes"],
    ),
    (
        "negative time",
        |f| f.i16s(40, &[4, 5, 4, 3, -1]),
        &["dim[4]", "is -1"],
    ),
    (
        "vectors",
        |f| f.i16s(40, &[5, 5, 2, 2, 1, 3]).i16s(68, &[1007]),
        &["dim[5]", "vector field"],
    ),
    (
        "rgb",
        |f| f.i16s(70, &[128, 24]),
        &["datatype", "RGB24", "convert"],
    ),
    ("rgba", |f| f.i16s(70, &[2304, 32]), &["datatype", "RGBA32"]),
    (
        "complex64",
        |f| f.i16s(70, &[32, 64]),
        &["datatype", "complex64"],
    ),
    (
        "complex128",
        |f| f.i16s(70, &[1792, 128]),
        &["datatype", "complex128"],
    ),
    (
        "float128",
        |f| f.i16s(70, &[1536, 128]),
        &["datatype", "float128"],
    ),
    ("binary", |f| f.i16s(70, &[1, 1]), &["datatype", "one bit"]),
    (
        "unknown type",
        |f| f.i16s(70, &[77, 16]),
        &["datatype", "77"],
    ),
    (
        "bitpix 0",
        |f| f.i16s(72, &[0]),
        &["bitpix", "is 0", "expected 16"],
    ),
    ("bitpix 8", |f| f.i16s(72, &[8]), &["bitpix", "is 8"]),
    ("bitpix 12", |f| f.i16s(72, &[12]), &["bitpix", "is 12"]),
    ("bitpix -16", |f| f.i16s(72, &[-16]), &["bitpix", "is -16"]),
    (
        "bitpix of f64",
        |f| f.i16s(70, &[64, 16]),
        &["bitpix", "is 16", "expected 64"],
    ),
    (
        "offset 0",
        |f| f.f32s(108, &[0.0]),
        &["vox_offset", "is 0", "352"],
    ),
    (
        "offset 348",
        |f| f.f32s(108, &[348.0]),
        &["vox_offset", "is 348"],
    ),
    (
        "offset NaN",
        |f| f.f32s(108, &[f32::NAN]),
        &["vox_offset", "NaN"],
    ),
    (
        "offset -inf",
        |f| f.f32s(108, &[f32::NEG_INFINITY]),
        &["vox_offset", "-inf"],
    ),
    (
        "offset 352.5",
        |f| f.f32s(108, &[352.5]),
        &["vox_offset", "352.5", "whole"],
    ),
    ("offset huge", |f| f.f32s(108, &[1e30]), &["vox_offset"]),
    (
        "offset beyond",
        |f| f.f32s(108, &[368.0]),
        &["cut short", "16 are missing"],
    ),
    (
        "intercept NaN",
        |f| f.f32s(112, &[2.0, f32::NAN]),
        &["scl_inter", "NaN", "scl_slope"],
    ),
    (
        "intercept inf",
        |f| f.f32s(112, &[2.0, f32::INFINITY]),
        &["scl_inter", "inf"],
    ),
    (
        "sform NaN",
        |f| f.f32s(284, &[f32::NAN]),
        &["srow_x", "NaN", "finite"],
    ),
    (
        "sform inf",
        |f| f.f32s(324, &[f32::INFINITY]),
        &["srow_z", "inf"],
    ),
    (
        "sform zero",
        |f| f.sform([[0.0; 4]; 3]),
        &["sform", "spacing"],
    ),
    (
        "sform flat",
        |f| f.f32s(316, &[0.0, 0.0, 0.0]),
        &["sform", "spacing"],
    ),
    (
        "qform NaN",
        |f| f.i16s(254, &[0]).f32s(260, &[f32::NAN]),
        &["quatern", "NaN"],
    ),
    (
        "qform offset",
        |f| f.i16s(254, &[0]).f32s(272, &[f32::INFINITY]),
        &["qoffset", "inf"],
    ),
    (
        "qform long",
        |f| f.i16s(254, &[0]).f32s(256, &[0.8, 0.8, 0.0]),
        &["quatern", "1.131371"],
    ),
    (
        "qfac NaN",
        |f| f.i16s(254, &[0]).f32s(76, &[f32::NAN]),
        &["pixdim[0]", "NaN"],
    ),
    (
        "negative pixdim",
        |f| f.i16s(254, &[0]).f32s(84, &[-1.5]),
        &["pixdim[2]", "-1.5"],
    ),
    (
        "pixdim 0",
        |f| f.i16s(252, &[0, 0]).f32s(88, &[0.0]),
        &["pixdim[3]", "is 0"],
    ),
    (
        "pixdim inf",
        |f| f.i16s(252, &[0, 0]).f32s(80, &[f32::INFINITY]),
        &["pixdim[1]", "inf"],
    ),
    ("units", |f| f.raw(123, &[5]), &["xyzt_units", "is 5", "mm"]),
    (
        "70 TB",
        |f| f.i16s(40, &[3, 32767, 32767, 32767]).i16s(70, &[4, 16]),
        &["cut short", "are missing"],
    ),
];

/// The message, which must name the file and no other path.
fn message(error: &NiftiError, path: &Path) -> String {
    assert_eq!(error.path, path);
    let text = error.to_string();
    assert!(
        text.starts_with(&format!("`{}`: ", path.display())),
        "{text}"
    );
    text
}

#[test]
fn every_bad_header_is_refused_with_field_value_and_remedy() {
    let folder = Folder::new();
    for (name, change, words) in HEADERS {
        let mut file = Nifti::small();
        change(&mut file);
        for bytes in [file.bytes(), file.gzip()] {
            let path = folder.write("bad.nii.gz", &bytes);
            let whole = message(&read(&path).expect_err(name), &path);
            // A small gzip that promises terabytes is told apart from a cut file.
            if whole.contains("claims") && words.contains(&"cut short") {
                continue;
            }
            if bytes.starts_with(&[0x1f, 0x8b]) && words.contains(&"cut short") {
                assert!(whole.contains("cut short"), "{name}: {whole}");
                continue;
            }
            for word in *words {
                assert!(
                    whole.contains(word),
                    "{name}: \"{word}\" is not in: {whole}"
                );
            }
            let header = message(&read_header(&path).expect_err(name), &path);
            assert_eq!(header, whole, "{name}");
        }
    }
}

#[test]
fn qforms_that_the_standard_settles_are_read() {
    let folder = Folder::new();
    // qfac 0 means 1; a quaternion a rounding too long is normalised.
    for (at, values) in [(76, &[0.0_f32][..]), (256, &[0.0, 0.0, 1.000_000_2])] {
        let mut file = Nifti::small();
        file.i16s(254, &[0]).f32s(at, values);
        folder.read(&file.bytes()).unwrap();
    }
}

#[test]
fn samples_are_taken_from_vox_offset_whatever_the_extension_flag_says() {
    let folder = Folder::new();
    let expected = folder.read(&Nifti::small().bytes()).unwrap().volume;
    for flag in [0, 1] {
        for gap in [12, 16, 160, 200_000] {
            let mut file = Nifti::small();
            file.between = vec![0x55; 4 + gap];
            file.between[..4].copy_from_slice(&[flag, 0, 0, 0]);
            file.f32s(108, &[352.0 + gap as f32]);
            for bytes in [file.bytes(), file.gzip()] {
                let found = folder.read(&bytes).unwrap().volume;
                assert!(found == expected, "flag {flag}, {gap} bytes");
            }
        }
    }
}

#[test]
fn bytes_after_the_samples_are_ignored_within_reason() {
    let folder = Folder::new();
    let expected = folder.read(&Nifti::small().bytes()).unwrap().volume;
    for extra in [1, 1000, 17 << 20] {
        let bytes = [Nifti::small().bytes(), vec![0; extra]].concat();
        assert!(folder.read(&bytes).unwrap().volume == expected);
        let packed = folder.read(&gzip(&bytes));
        if extra <= 16 << 20 {
            assert!(packed.unwrap().volume == expected);
        } else {
            assert!(matches!(
                packed.unwrap_err().problem,
                NiftiProblem::TooLong { .. }
            ));
        }
    }
}

#[test]
fn cut_files_say_how_much_is_missing() {
    let folder = Folder::new();
    let whole = Nifti::small().bytes();
    for cut in [1, 2, 60, 119, 120] {
        let bytes = &whole[..whole.len() - cut];
        for bytes in [bytes.to_vec(), gzip(bytes)] {
            let error = folder.read(&bytes).unwrap_err();
            let NiftiProblem::Truncated { needed, missing } = error.problem else {
                panic!("{error}")
            };
            assert_eq!((needed, missing), (472, cut as u64));
        }
    }
    for keep in [4, 131, 132, 347] {
        for bytes in [whole[..keep].to_vec(), gzip(&whole[..keep])] {
            let error = folder.read(&bytes).unwrap_err();
            assert!(
                matches!(error.problem, NiftiProblem::HeaderCut { found } if found == keep),
                "{error}"
            );
        }
    }
    for bytes in [vec![], gzip(&[])] {
        assert!(matches!(
            folder.read(&bytes).unwrap_err().problem,
            NiftiProblem::Empty
        ));
    }
}

/// Every cut of the gzip stream, trailer included, and every single flipped bit of it.
#[test]
fn damaged_gzip_is_never_read_as_something_else() {
    let folder = Folder::new();
    let sound = Nifti::small();
    let packed = sound.gzip();
    let expected = folder.read(&packed).unwrap().volume;
    for keep in 3..packed.len() {
        assert!(
            folder.read(&packed[..keep]).is_err(),
            "cut to {keep} of {}",
            packed.len()
        );
    }
    let mut refused = 0;
    for bit in 0..packed.len() * 8 {
        let mut damaged = packed.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        match folder.read(&damaged) {
            Err(_) => refused += 1,
            // Some bits carry nothing: the time in gzip's header, or which of two zeros is repeated.
            Ok(scan) => assert!(
                scan.volume == expected,
                "bit {bit} changed the volume unnoticed"
            ),
        }
    }
    assert!(
        refused > packed.len() * 7,
        "only {refused} of {} bits matter",
        packed.len() * 8
    );
    let trailer = packed.len() - 8;
    for at in [trailer, trailer + 4] {
        let mut damaged = packed.clone();
        damaged[at] ^= 0x40;
        let error = folder.read(&damaged).unwrap_err();
        assert!(
            matches!(error.problem, NiftiProblem::Gzip { .. }),
            "{error}"
        );
    }
    let garbage = [&packed[..], b"garbage"].concat();
    assert!(folder.read(&garbage).is_err());
}

#[test]
fn several_gzip_members_are_one_file() {
    let folder = Folder::new();
    let whole = Nifti::small().bytes();
    let expected = folder.read(&whole).unwrap().volume;
    for cut in [1, 100, 348, 352, 400, whole.len() - 1] {
        let (first, second) = whole.split_at(cut);
        let members = [gzip(first), gzip(&[]), gzip(second)].concat();
        assert!(
            folder.read(&members).unwrap().volume == expected,
            "cut at {cut}"
        );
        let mut damaged = members.clone();
        let last = damaged.len() - 8;
        damaged[last] ^= 1;
        assert!(folder.read(&damaged).is_err());
    }
}

#[test]
fn content_decides_and_the_name_does_not() {
    let folder = Folder::new();
    let file = Nifti::small();
    let expected = folder.read(&file.bytes()).unwrap().volume;
    for (name, bytes) in [
        ("plain.nii.gz", file.bytes()),
        ("packed.nii", file.gzip()),
        ("1.2.840.113", file.bytes()),
        ("packed.img", file.gzip()),
    ] {
        assert!(
            read(&folder.write(name, &bytes)).unwrap().volume == expected,
            "{name}"
        );
    }
}

#[test]
fn other_formats_and_no_files_are_named() {
    let folder = Folder::new();
    let mut dicom = vec![0; 400];
    dicom[128..132].copy_from_slice(b"DICM");
    for (bytes, word) in [
        (dicom, "DICOM"),
        (b"NRRD0004\ntype: short\n".to_vec(), "NRRD"),
        (b"ObjectType = Image\n".to_vec(), "MetaImage"),
        (
            b"%PDF-1.7 and much more that is not a scan".to_vec(),
            "not a NIfTI-1 file",
        ),
        (gzip(b"text"), "not a NIfTI-1 file"),
    ] {
        let error = folder.read(&bytes).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
    let error = read(folder.path()).unwrap_err();
    assert!(error.to_string().contains("is a folder"), "{error}");
    let missing = folder.path().join("missing.nii");
    let error = read(&missing).unwrap_err();
    assert!(matches!(error.problem, NiftiProblem::Io(_)), "{error}");
    #[cfg(target_os = "linux")]
    assert!(
        read(Path::new("/dev/zero"))
            .unwrap_err()
            .to_string()
            .contains("device")
    );
}

#[test]
fn a_bomb_is_refused_before_memory_is_asked_for() {
    let folder = Folder::new();
    let mut file = Nifti::small();
    file.i16s(40, &[3, 32767, 32767, 32767]);
    let packed = file.gzip();
    let path = folder.write("bomb.nii.gz", &packed);
    for error in [read(&path).unwrap_err(), read_header(&path).unwrap_err()] {
        assert!(
            matches!(error.problem, NiftiProblem::Implausible { .. }),
            "{error}"
        );
        assert!(error.to_string().contains("70362301923678"), "{error}");
    }
    let zeros = gzip(&[Nifti::small().bytes(), vec![0; 64 << 20]].concat());
    assert!(zeros.len() < 100_000);
    assert!(matches!(
        folder.read(&zeros).unwrap_err().problem,
        NiftiProblem::TooLong { .. }
    ));
}

#[test]
fn voxels_that_are_not_numbers_are_counted_and_the_first_is_named() {
    let folder = Folder::new();
    for (code, big) in [(16, false), (16, true), (64, false), (64, true)] {
        let values: Vec<f64> = (0..60)
            .map(|index| match index {
                28 => f64::NEG_INFINITY,
                33 | 59 => f64::NAN,
                _ => f64::from(index),
            })
            .collect();
        let sample = |&value: &f64| -> Vec<u8> {
            match (code, big) {
                (16, false) => (value as f32).to_le_bytes().to_vec(),
                (16, true) => (value as f32).to_be_bytes().to_vec(),
                (_, false) => value.to_le_bytes().to_vec(),
                (_, true) => value.to_be_bytes().to_vec(),
            }
        };
        let samples = values.iter().flat_map(sample).collect();
        let file = Nifti::new(
            [5, 4, 3],
            code,
            if code == 16 { 4 } else { 8 },
            big,
            samples,
        );
        for bytes in [file.bytes(), file.gzip()] {
            let error = folder.read(&bytes).unwrap_err();
            let NiftiProblem::NotFinite {
                count,
                total,
                first,
                value,
            } = error.problem
            else {
                panic!("{error}");
            };
            assert_eq!((count, total, first), (3, 60, [3, 1, 1]));
            assert_eq!(value, f64::NEG_INFINITY);
        }
    }
}
