//! What samples become.

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use rhinoplan::io::dicom::{Folder, PADDING_HU};
use rhinoplan::volume::{AnyVolume, Rescale, SampleType};

use crate::builder::{BIG_ENDIAN, COLUMNS, Dir, ROWS, SliceFile, expected, hu, hus, rle, stack};

const N: usize = 3;
const PLANE: usize = COLUMNS as usize * ROWS as usize;

/// The stack with its samples stored anew: `store` gives the word for HU.
fn stored(store: impl Fn(i16) -> u16, change: impl Fn(usize, &mut SliceFile)) -> Dir {
    let mut files = stack(N);
    for (z, file) in files.iter_mut().enumerate() {
        let words: Vec<u16> = plane(z).into_iter().map(&store).collect();
        file.words(tags::PIXEL_DATA, VR::OW, &words);
        change(z, file);
    }
    Dir::of(&files)
}

fn plane(z: usize) -> Vec<i16> {
    (0..PLANE)
        .map(|index| {
            hu([
                index % usize::from(COLUMNS),
                index / usize::from(COLUMNS),
                z,
            ])
        })
        .collect()
}

fn rescale(volume: &AnyVolume) -> Rescale {
    rhinoplan::with_volume!(volume, volume => volume.rescale())
}

#[test]
fn samples_stay_as_they_are_stored_where_all_slices_mean_the_same() {
    let signed = Dir::of(&stack(N)).read().unwrap();
    assert_eq!(signed.volume.sample_type(), SampleType::I16);
    assert_eq!(rescale(&signed.volume), Rescale::NONE);
    assert_eq!(hus(&signed.volume), expected(N));
    let unsigned = stored(
        |hu| (hu + 1024).cast_unsigned(),
        |_, file| {
            file.word(tags::PIXEL_REPRESENTATION, 0)
                .rescale(1.0, -1024.0);
        },
    );
    let unsigned = unsigned.read().unwrap();
    assert_eq!(unsigned.volume.sample_type(), SampleType::U16);
    assert_eq!(rescale(&unsigned.volume).intercept, -1024.0);
    assert_eq!(hus(&unsigned.volume), expected(N));
    assert_eq!(unsigned.template.sample_type(), SampleType::U16);
}

#[test]
fn the_lowest_signed_sample_with_a_negative_intercept() {
    let dir = stored(
        |_| 0x8000,
        |_, file| {
            file.rescale(1.0, -1024.0);
        },
    );
    let scan = dir.read().unwrap();
    assert_eq!(hus(&scan.volume), vec![-33792.0; N * PLANE]);
}

#[test]
fn twelve_bits_with_an_overlay_above_them_and_bits_high_up() {
    for (high, shift) in [(11, 0), (15, 4)] {
        let dir = stored(
            |hu| ((hu + 1024).cast_unsigned() << shift) | if shift == 0 { 0xf000 } else { 0x000f },
            |_, file| {
                file.word(tags::BITS_STORED, 12)
                    .word(tags::HIGH_BIT, high)
                    .word(tags::PIXEL_REPRESENTATION, 0)
                    .rescale(1.0, -1024.0);
            },
        );
        assert_eq!(hus(&dir.read().unwrap().volume), expected(N), "{high}");
    }
    // Signed: bit 11 is the sign, whatever is above it.
    let dir = stored(
        |hu| hu.cast_unsigned() & 0x0fff,
        |_, file| {
            file.word(tags::BITS_STORED, 12).word(tags::HIGH_BIT, 11);
        },
    );
    assert_eq!(hus(&dir.read().unwrap().volume), expected(N));
}

#[test]
fn eight_bits() {
    let mut files = stack(N);
    for (z, file) in files.iter_mut().enumerate() {
        // 15 samples: padded to an even number.
        let bytes: Vec<u8> = (0..16).map(|index| index * 3 + z as u8).collect();
        file.word(tags::ROWS, 3)
            .word(tags::COLUMNS, 5)
            .word(tags::BITS_ALLOCATED, 8)
            .word(tags::BITS_STORED, 8)
            .word(tags::HIGH_BIT, 7)
            .word(tags::PIXEL_REPRESENTATION, 0)
            .rescale(8.0, -1000.0)
            .bytes_of(tags::PIXEL_DATA, &bytes);
    }
    let expected: Vec<f64> = (0..N)
        .flat_map(|z| (0..15).map(move |index| f64::from(index * 3 + z as u8) * 8.0 - 1000.0))
        .collect();
    let little = Dir::of(&files).read().unwrap();
    assert_eq!(little.volume.sample_type(), SampleType::U8);
    assert_eq!(hus(&little.volume), expected);
    // As words, which big endian turns round.
    for file in &mut files {
        let bytes = file
            .object
            .element(tags::PIXEL_DATA)
            .unwrap()
            .to_bytes()
            .unwrap();
        let words: Vec<u16> = bytes
            .chunks(2)
            .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
            .collect();
        file.syntax = BIG_ENDIAN;
        file.words(tags::PIXEL_DATA, VR::OW, &words);
    }
    assert_eq!(hus(&Dir::of(&files).read().unwrap().volume), expected);
}

#[test]
fn slices_that_are_scaled_differently_become_hu() {
    let dir = stored(
        |hu| hu.cast_unsigned(),
        |z, file| {
            file.rescale(1.0, 10.0 * z as f64);
        },
    );
    let scan = dir.read().unwrap();
    // -32768 … 32767 plus 20 does not fit 16 bits.
    assert_eq!(scan.volume.sample_type(), SampleType::F32);
    assert_eq!(rescale(&scan.volume), Rescale::NONE);
    let shifted: Vec<f64> = expected(N)
        .iter()
        .enumerate()
        .map(|(index, hu)| hu + 10.0 * (index / PLANE) as f64)
        .collect();
    assert_eq!(hus(&scan.volume), shifted);
    let narrow = stored(
        |hu| (hu + 1024).cast_unsigned(),
        |z, file| {
            file.word(tags::BITS_STORED, 12)
                .word(tags::HIGH_BIT, 11)
                .word(tags::PIXEL_REPRESENTATION, 0)
                .rescale(1.0, -1024.0 + 10.0 * z as f64);
        },
    );
    let scan = narrow.read().unwrap();
    assert_eq!(scan.volume.sample_type(), SampleType::I16);
    assert_eq!(hus(&scan.volume), shifted);
    let fractions = stored(
        |hu| hu.cast_unsigned(),
        |z, file| {
            file.rescale(if z == 1 { 0.5 } else { 1.0 }, 0.0);
        },
    );
    let scan = fractions.read().unwrap();
    assert_eq!(scan.volume.sample_type(), SampleType::F32);
    let halved: Vec<f64> = expected(N)
        .iter()
        .enumerate()
        .map(|(index, hu)| if index / PLANE == 1 { hu * 0.5 } else { *hu })
        .collect();
    assert_eq!(hus(&scan.volume), halved);
}

#[test]
fn signed_and_unsigned_slices_in_one_series() {
    let dir = stored(
        |hu| hu.cast_unsigned(),
        |z, file| {
            if z == 2 {
                let words: Vec<u16> = plane(2)
                    .iter()
                    .map(|hu| (hu + 1000).cast_unsigned())
                    .collect();
                file.word(tags::PIXEL_REPRESENTATION, 0)
                    .rescale(1.0, -1000.0)
                    .words(tags::PIXEL_DATA, VR::OW, &words);
            }
        },
    );
    assert_eq!(hus(&dir.read().unwrap().volume), expected(N));
}

#[test]
fn padding_is_air() {
    let air = |value: i16| hu([0, 0, 0]) <= value && value <= hu([3, 0, 0]);
    let becomes: Vec<f64> = expected(N)
        .iter()
        .map(|&hu| if air(hu as i16) { PADDING_HU } else { hu })
        .collect();
    let count = becomes.iter().filter(|hu| **hu == PADDING_HU).count() as u64;
    assert_eq!(count, 4);
    // Either end first; and signed numbers under an unsigned type, as some scanners write them.
    for (first, last) in [(-1000_i16, -997_i16), (-997, -1000)] {
        let dir = stored(
            |hu| hu.cast_unsigned(),
            |_, file| {
                file.word(tags::PIXEL_PADDING_VALUE, first.cast_unsigned())
                    .word(tags::PIXEL_PADDING_RANGE_LIMIT, last.cast_unsigned());
            },
        );
        let scan = dir.read().unwrap();
        assert_eq!(hus(&scan.volume), becomes);
        assert_eq!(scan.padded, count);
    }
    let one = stored(
        |hu| (hu + 1000).cast_unsigned(),
        |_, file| {
            file.word(tags::PIXEL_REPRESENTATION, 0)
                .rescale(1.0, -1000.0)
                .word(tags::PIXEL_PADDING_VALUE, 17);
        },
    );
    let scan = one.read().unwrap();
    assert_eq!(scan.padded, 0, "no voxel has that value");
    assert_eq!(hus(&scan.volume), expected(N));
    let clamped = stored(
        |hu| (hu + 1000).cast_unsigned(),
        |_, file| {
            file.word(tags::PIXEL_REPRESENTATION, 0)
                .rescale(1.0, -1000.0)
                .word(tags::PIXEL_PADDING_VALUE, 25);
        },
    );
    let scan = clamped.read().unwrap();
    assert_eq!(scan.padded, 1);
    // u16 with -1000 as its least: air is as near as the type comes.
    assert_eq!(hus(&scan.volume)[25 % 10 + 6 * 2], -1000.0);
}

#[test]
fn slopes_that_are_left_out_are_one() {
    let dir = stored(
        |hu| hu.cast_unsigned(),
        |_, file| {
            file.remove(tags::RESCALE_SLOPE)
                .remove(tags::RESCALE_INTERCEPT)
                .remove(tags::RESCALE_TYPE);
        },
    );
    assert_eq!(hus(&dir.read().unwrap().volume), expected(N));
}

const DEFLATED_FRAME: &str = "1.2.840.10008.1.2.8.1";

fn deflated(samples: &[i16]) -> Vec<u8> {
    use std::io::Write;
    let bytes: Vec<u8> = samples.iter().flat_map(|hu| hu.to_le_bytes()).collect();
    let mut packed = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::best());
    packed.write_all(&bytes).unwrap();
    packed.finish().unwrap()
}

#[test]
fn a_deflated_frame_that_lies_or_is_cut() {
    let with = |packed: &[u8]| {
        let mut files = stack(N);
        files[1].fragments(DEFLATED_FRAME, &[packed]);
        Dir::of(&files)
    };
    // What is more than a plane is never inflated.
    let bomb = deflated(&[0; 10_000_000]);
    assert!(bomb.len() < 30_000);
    assert!(with(&bomb).read().is_ok());
    for (packed, message) in [
        (
            deflated(&plane(1)[..20]),
            "has 40 bytes of pixels, 60 expected",
        ),
        (
            deflated(&plane(1))[..10].to_vec(),
            "cannot be decoded (Deflated Image Frame Compression (1.2.840.10008.1.2.8.1))",
        ),
    ] {
        let found = with(&packed).error();
        assert!(found.contains(message), "{message}: {found}");
    }
}

#[test]
fn every_syntax_that_this_test_can_write() {
    let mut files = stack(N);
    let mut digests = std::collections::BTreeSet::new();
    for syntax in [
        uids::IMPLICIT_VR_LITTLE_ENDIAN,
        uids::EXPLICIT_VR_LITTLE_ENDIAN,
        BIG_ENDIAN,
        uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN,
    ] {
        for file in &mut files {
            file.syntax = syntax;
        }
        let scan = Dir::of(&files).read().unwrap();
        assert_eq!(hus(&scan.volume), expected(N), "{syntax}");
        digests.insert(scan.sha256);
    }
    for (z, file) in files.iter_mut().enumerate() {
        file.fragments(uids::RLE_LOSSLESS, &[&rle(&plane(z))]);
    }
    let scan = Dir::of(&files).read().unwrap();
    assert_eq!(hus(&scan.volume), expected(N));
    digests.insert(scan.sha256);
    for (z, file) in files.iter_mut().enumerate() {
        let bytes: Vec<u8> = plane(z).iter().flat_map(|hu| hu.to_le_bytes()).collect();
        let (start, end) = bytes.split_at(20);
        let syntax = "1.2.840.10008.1.2.1.98";
        file.fragments(syntax, &[start, end]);
    }
    let scan = Dir::of(&files).read().unwrap();
    assert_eq!(hus(&scan.volume), expected(N));
    digests.insert(scan.sha256);
    for (z, file) in files.iter_mut().enumerate() {
        let packed = deflated(&plane(z));
        let (start, end) = packed.split_at(20);
        file.fragments(DEFLATED_FRAME, &[start, end]);
    }
    let scan = Dir::of(&files).read().unwrap();
    assert_eq!(hus(&scan.volume), expected(N));
    digests.insert(scan.sha256);
    assert_eq!(digests.len(), 7, "the digest is of the files");
}

#[test]
fn the_digest_knows_neither_names_nor_order_and_is_what_the_documentation_says() {
    let files = stack(N);
    let forwards = Dir::of(&files).read().unwrap();
    let backwards: Vec<_> = files.iter().rev().cloned().collect();
    let dir = Dir::of(&backwards);
    dir.write("readme.txt", b"not of the series");
    let backwards = dir.read().unwrap();
    assert_eq!(forwards.sha256, backwards.sha256);
    use sha2::Digest;
    let hex = |bytes: &[u8]| -> String {
        let digest = sha2::Sha256::digest(bytes);
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    };
    let mut lines: Vec<String> = files.iter().map(|file| hex(&file.bytes()) + "\n").collect();
    lines.sort();
    assert_eq!(forwards.sha256, hex(lines.concat().as_bytes()));
}

#[test]
fn any_number_of_threads_gives_the_same_volume() {
    let dir = Dir::of(&stack(40));
    let read = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| dir.read().unwrap())
    };
    let (one, many) = (read(1), read(7));
    assert!(one.volume == many.volume);
    assert_eq!(one.sha256, many.sha256);
}

#[test]
fn loss_is_told() {
    let mut files = stack(N);
    let lossy = |files: &[SliceFile]| {
        let dir = Dir::of(files);
        let folder = Folder::scan(dir.path()).unwrap();
        folder.choose(None).unwrap().is_lossy()
    };
    assert!(!lossy(&files));
    files[1].text(tags::LOSSY_IMAGE_COMPRESSION, VR::CS, "01");
    assert!(lossy(&files));
}
