//! Series of DICOM slices; `tests/dicom/fuzz.rs` changes them at random.

use std::fs;
use std::io::Write;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use flate2::Compression;
use flate2::write::DeflateEncoder;

use crate::bounded::{Bench, Expect, Role};
use crate::dicom_builder::{SliceFile, head_slices, rle};

/// Where the elements begin, behind the preamble and the meta information, whose length is its first element.
fn elements(bytes: &[u8]) -> usize {
    144 + u32::from_le_bytes(bytes[140..144].try_into().unwrap()) as usize
}

/// Sequences in one another, which never end.
fn nested(slice: &[u8]) -> Vec<u8> {
    let mut bytes = slice[..elements(slice)].to_vec();
    for _ in 0..100_000 {
        bytes.extend([8, 0, 0x10, 0x11, b'S', b'Q', 0, 0, 0xff, 0xff, 0xff, 0xff]);
        bytes.extend([0xfe, 0xff, 0x00, 0xe0, 0xff, 0xff, 0xff, 0xff]);
    }
    bytes
}

/// An element that claims 4 GB, of which 256 MB of zeros are there, deflated.
fn bomb(slice: &SliceFile) -> Vec<u8> {
    let mut file = slice.clone();
    file.syntax = uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN;
    let bytes = file.bytes();
    let mut packed = DeflateEncoder::new(Vec::new(), Compression::fast());
    let claim = [8, 0, 1, 0, b'U', b'T', 0, 0, 0xf0, 0xff, 0xff, 0xff];
    packed.write_all(&claim).unwrap();
    for _ in 0..16 {
        packed.write_all(&vec![0; 16 << 20]).unwrap();
    }
    [&bytes[..elements(&bytes)], &packed.finish().unwrap()].concat()
}

/// One slice of the program's head is replaced; the series is refused, and the file named.
#[test]
fn the_corpus() {
    let bench = Bench::new();
    let slices = head_slices();
    for (index, slice) in slices.iter().enumerate() {
        bench
            .desk
            .write(&format!("series/{index:02}"), slice.bytes());
    }
    bench.expect(Role::Ct, "series", &Expect::Read);
    let sound = slices[7].bytes();
    let changed = |change: &dyn Fn(&mut SliceFile)| {
        let mut file = slices[7].clone();
        change(&mut file);
        file.bytes()
    };
    let text = |tag, value: &'static str| {
        changed(&|file| {
            file.text(tag, VR::DS, value);
        })
    };
    let huge = |syntax: &'static str| {
        changed(&|file| {
            file.syntax = syntax;
            file.word(tags::ROWS, 32767).word(tags::COLUMNS, 32767);
        })
    };
    let packed = |image: Vec<u8>| {
        changed(&|file| {
            file.fragments(uids::RLE_LOSSLESS, &[&image]);
        })
    };
    let run_lengths = rle(&[7; 64 * 64]);
    let flipped = {
        // A bit of the number of rows.
        let rows = [0x28, 0, 0x10, 0, b'U', b'S', 2, 0];
        let at = sound.windows(8).position(|piece| piece == rows).unwrap();
        let mut bytes = sound.clone();
        bytes[at + 8] ^= 0x10;
        bytes
    };
    let cases: Vec<(Vec<u8>, &'static [&'static str])> = vec![
        (
            sound[..sound.len() - 9].to_vec(),
            &["`07`", "bytes of pixels, 8192 expected"],
        ),
        (sound[..400].to_vec(), &["`07`"]),
        (flipped, &["`07`", "bytes of pixels"]),
        (
            huge(uids::EXPLICIT_VR_LITTLE_ENDIAN),
            &["`07`", "2147352578 expected"],
        ),
        (
            huge(uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN),
            &["`07`", "2147352578"],
        ),
        (
            text(tags::PIXEL_SPACING, "NaN\\1"),
            &["`07`", "PixelSpacing", "finite"],
        ),
        (
            text(tags::IMAGE_POSITION_PATIENT, "0\\inf\\0"),
            &["`07`", "ImagePositionPatient", "finite"],
        ),
        (
            text(tags::IMAGE_ORIENTATION_PATIENT, "1\\0\\0\\0\\0\\0"),
            &["`07`", "ImageOrientationPatient"],
        ),
        (
            text(tags::RESCALE_SLOPE, "1e999"),
            &["`07`", "RescaleSlope"],
        ),
        (
            packed(run_lengths[..run_lengths.len() - 20].to_vec()),
            &["`07`", "cannot be decoded"],
        ),
        (nested(&sound), &["`07`", "more than 64 deep"]),
        (
            bomb(&slices[7]),
            &["`07`", "no pixels within 16777216 bytes"],
        ),
        // No slice at all: the stack has a gap.
        (Vec::new(), &["series"]),
        (b"hello".to_vec(), &["series"]),
    ];
    for (bytes, words) in cases {
        bench.desk.write("series/07", bytes);
        bench.expect(Role::Ct, "series", &Expect::Refused(words));
    }
    // Under any name, and beside what is no slice, the series is read.
    fs::remove_file(bench.path().join("series/07")).unwrap();
    bench.desk.write("series/seven.nii.gz", &sound);
    bench.desk.write("series/empty.dcm", "");
    bench
        .desk
        .write("series/notes\u{feff}.txt", "\u{feff}one\r\ntwo\r\n");
    bench.desk.write("series/within/7.dcm", &sound);
    bench.expect(Role::Ct, "series", &Expect::Read);
    bench.expect(Role::Ct, "series/seven.nii.gz", &Expect::Read);
    bench.expect(
        Role::Ct,
        "series/empty.dcm",
        &Expect::Refused(&["is empty"]),
    );
}

/// A series of many slices that each claim much, and have little, is refused before memory is asked for.
#[test]
fn slices_that_claim_gigabytes_together() {
    let bench = Bench::new();
    let image = rle(&[7; 1500 * 1500]);
    for (index, slice) in head_slices().iter().enumerate() {
        let mut file = slice.clone();
        file.word(tags::ROWS, 1500)
            .word(tags::COLUMNS, 1500)
            .fragments(uids::RLE_LOSSLESS, &[&image[..image.len() / 2]]);
        bench
            .desk
            .write(&format!("series/{index:02}"), file.bytes());
    }
    bench.expect(Role::Ct, "series", &Expect::Refused(&["series"]));
}
