//! Slices changed at random: each folder is read or refused, at once, and nothing panics, but decoders that are
//! caught.

use std::time::Instant;

use dicom_dictionary_std::uids;

use crate::builder::{BIG_ENDIAN, Dir, SliceFile, rle, stack};
use crate::noise::{AT_ONCE, Noise, Outcome, assert_clear, count, damage, fuzz, tell};
use crate::packed;
use crate::real;
use crate::real_data;

/// How many files are tried, over all syntaxes.
const TRIES: usize = 4000;

/// The preamble, whose content nobody reads, and the letters behind it.
const PREAMBLE: usize = 132;

fn change(bytes: &mut Vec<u8>, noise: &mut Noise) {
    for _ in 0..=noise.below(3) {
        if noise.one_in(8) && bytes.len() > PREAMBLE {
            // Text that numbers are written in.
            let at = PREAMBLE + noise.below(bytes.len() - PREAMBLE);
            bytes[at] = noise.one_of(b"0123456789.-eE\\ naif");
        } else {
            damage(bytes, PREAMBLE, noise);
        }
    }
}

fn seeds() -> Vec<SliceFile> {
    let mut seeds = Vec::new();
    for syntax in [
        uids::IMPLICIT_VR_LITTLE_ENDIAN,
        uids::EXPLICIT_VR_LITTLE_ENDIAN,
        BIG_ENDIAN,
        uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN,
    ] {
        let mut seed = stack(2).remove(1);
        seed.syntax = syntax;
        seeds.push(seed);
    }
    let mut packed = stack(2).remove(1);
    let samples: Vec<i16> = (0..30).map(|index| index / 3 * 100).collect();
    packed.fragments(uids::RLE_LOSSLESS, &[&rle(&samples)]);
    // Twice, as its decoder is known to panic.
    seeds.extend([packed.clone(), packed]);
    seeds
}

#[test]
fn changed_at_random() {
    let seeds: Vec<Vec<u8>> = seeds().iter().map(SliceFile::bytes).collect();
    let dir = Dir::of(&stack(3));
    fuzz("fuzz::changed_at_random", "DICOM", TRIES, |index, noise| {
        let mut bytes = seeds[index % seeds.len()].clone();
        change(&mut bytes, noise);
        dir.write("1.dcm", &bytes);
        match dir.read() {
            Ok(scan) => {
                let [columns, rows, _] = scan.volume.grid().dims();
                assert_eq!([columns, rows], [6, 5], "the other slices have as many");
                assert!(scan.volume.grid().origin().0.is_finite());
                let (low, high) = scan.volume.hu_range();
                assert!(low.is_finite() && high.is_finite());
                Outcome::Read
            }
            Err(error) => {
                assert!(!error.to_string().is_empty());
                Outcome::Refused
            }
        }
    });
}

/// High-Throughput JPEG 2000, JPEG-LS and JPEG XL: what is changed is the image, of which the file says the right
/// length.
#[test]
fn small_packed_images_changed_at_random() {
    let seeds = packed::seeds();
    let dirs: Vec<Dir> = seeds.iter().map(|(files, _)| Dir::of(files)).collect();
    let name = "fuzz::small_packed_images_changed_at_random";
    fuzz(name, "packed DICOM", TRIES, |index, noise| {
        let at = index % seeds.len();
        let ((files, image), dir) = (&seeds[at], &dirs[at]);
        let (mut file, mut image) = (files[1].clone(), image.clone());
        for _ in 0..=noise.below(2) {
            damage(&mut image, 0, noise);
        }
        let syntax = file.syntax;
        file.fragments(syntax, &[&image]);
        dir.write("1.dcm", &file.bytes());
        match dir.read() {
            Ok(scan) => {
                let [columns, rows, slices] = scan.volume.grid().dims();
                assert!([[32, 24], [6, 5]].contains(&[columns, rows]));
                assert_eq!(slices, 2);
                let (low, high) = scan.volume.hu_range();
                assert!(-32768.0 <= low && high <= 65535.0, "{low} to {high} HU");
                Outcome::Read
            }
            Err(error) => {
                assert_clear(&error.to_string());
                Outcome::Refused
            }
        }
    });
}

/// As many hundredths: these are real slices, and decoding takes its time.
#[test]
fn packed_images_changed_at_random() {
    let Some(folder) = real_data::path("dicom-syntaxes") else {
        return;
    };
    let names = [
        "JPEGProcess1_1.2.840.10008.1.2.4.50.dcm",
        "JPEGProcess14_1.2.840.10008.1.2.4.57.dcm",
        "JPEGProcess14SV1_1.2.840.10008.1.2.4.70.dcm",
        "JPEG2000LosslessOnly_1.2.840.10008.1.2.4.90.dcm",
        "JPEGLSLossless_1.2.840.10008.1.2.4.80.dcm",
        "JPEGLSLossy_1.2.840.10008.1.2.4.81.dcm",
    ];
    let mut noise = Noise::new(2001);
    let (mut read, mut refused) = (0, 0);
    for name in names {
        let dir = real::twice(&folder.join(name));
        let sound = std::fs::read(dir.path().join("b")).unwrap();
        // Where the image begins: the first third of its bytes holds what leads a decoder astray.
        let image = sound.len() - 4 - fragment_length(&sound);
        for index in 0..count(TRIES) / 100 {
            let mut bytes = sound.clone();
            for _ in 0..=noise.below(3) {
                let within = if index % 2 == 0 {
                    400
                } else {
                    bytes.len() - image - 8
                };
                let at = image + noise.below(within);
                match noise.below(3) {
                    0 => bytes[at] ^= 1 << noise.below(8),
                    1 => bytes[at] = noise.next() as u8,
                    _ => {
                        let value: u32 = noise.one_of(&[0, 1, 0xff, 0xffff, 0x7fff_ffff, u32::MAX]);
                        bytes[at..at + 4].copy_from_slice(&value.to_be_bytes());
                    }
                }
            }
            dir.write("b", &bytes);
            let start = Instant::now();
            match dir.read() {
                Ok(_) => read += 1,
                Err(_) => refused += 1,
            }
            assert!(start.elapsed() < AT_ONCE, "{name}, try {index}");
        }
    }
    tell(&format!("changed images: {read} read, {refused} refused"));
    assert!(read > 0 && refused > 0);
}

/// The bytes of the last fragment and what follows it.
fn fragment_length(bytes: &[u8]) -> usize {
    let item = [0xfe, 0xff, 0x00, 0xe0];
    let last = bytes.windows(4).rposition(|piece| piece == item).unwrap();
    bytes.len() - last - 4
}
