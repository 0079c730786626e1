//! Slices changed at random: each folder is read or refused, at once, and nothing panics, but decoders that are
//! caught.

use std::time::{Duration, Instant};

use dicom_dictionary_std::uids;

use crate::builder::{BIG_ENDIAN, Dir, SliceFile, rle, stack, tell};
use crate::real::twice;
use crate::real_data;

/// How many files are tried, over all syntaxes; `RHINOPLAN_FUZZ` gives another number.
const TRIES: usize = 4000;

/// What one may take: a hundred times what a sound one does, on a busy machine.
const AT_ONCE: Duration = Duration::from_secs(5);

struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    fn below(&mut self, bound: usize) -> usize {
        (self.next() >> 11) as usize % bound
    }
}

/// Numbers that lengths and counts are bad at.
const EXTREMES: [u32; 10] = [
    0,
    1,
    3,
    0x7f,
    0xff,
    0xffff,
    0x8000_0000,
    0x7fff_ffff,
    0xffff_fffe,
    0xffff_ffff,
];

fn change(bytes: &mut Vec<u8>, noise: &mut Noise) {
    // What is behind the preamble, whose content nobody reads.
    for _ in 0..=noise.below(3) {
        let at = 132 + noise.below(bytes.len().saturating_sub(140).max(1));
        if at + 4 > bytes.len() {
            return;
        }
        match noise.below(8) {
            0 => bytes[at] ^= 1 << noise.below(8),
            1 => bytes[at] = noise.next() as u8,
            2 => bytes.truncate(at),
            3 => {
                let value = EXTREMES[noise.below(EXTREMES.len())];
                bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
            }
            4 => {
                let value = EXTREMES[noise.below(EXTREMES.len())] as u16;
                bytes[at..at + 2].copy_from_slice(&value.to_le_bytes());
            }
            5 => {
                let end = (at + noise.below(40)).min(bytes.len());
                bytes.drain(at..end);
            }
            6 => {
                let end = (at + noise.below(40)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let to = 132 + noise.below(at - 131);
                bytes.splice(to..to, piece);
            }
            _ => {
                // Text that numbers are written in.
                let letters = b"0123456789.-eE\\ naif";
                bytes[at] = letters[noise.below(letters.len())];
            }
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

fn tries() -> usize {
    let asked = std::env::var("RHINOPLAN_FUZZ").ok();
    asked.and_then(|tries| tries.parse().ok()).unwrap_or(TRIES)
}

#[test]
fn changed_at_random() {
    let tries = tries();
    let seeds: Vec<Vec<u8>> = seeds().iter().map(SliceFile::bytes).collect();
    let dir = Dir::of(&stack(3));
    let mut noise = Noise(0x9e37_79b9_7f4a_7c15);
    let (mut read, mut refused) = (0, 0);
    for index in 0..tries {
        let mut bytes = seeds[index % seeds.len()].clone();
        change(&mut bytes, &mut noise);
        dir.write("1.dcm", &bytes);
        let start = Instant::now();
        match dir.read() {
            Ok(_) => read += 1,
            Err(error) => {
                refused += 1;
                assert!(!error.to_string().is_empty());
            }
        }
        assert!(
            start.elapsed() < AT_ONCE,
            "try {index}: {:?}",
            start.elapsed()
        );
    }
    tell(&format!(
        "{tries} changed files: {read} read, {refused} refused"
    ));
    assert!(tries < 100 || (read > tries / 20 && refused > tries / 5));
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
    ];
    let mut noise = Noise(0x2545_f491_4f6c_dd1d);
    let (mut read, mut refused) = (0, 0);
    for name in names {
        let dir = twice(&folder.join(name));
        let sound = std::fs::read(dir.path().join("b")).unwrap();
        // Where the image begins: the first third of its bytes holds what leads a decoder astray.
        let image = sound.len() - 4 - fragment_length(&sound);
        for index in 0..tries() / 100 {
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
                        let value = EXTREMES[noise.below(EXTREMES.len())];
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
