//! Images that other programs packed: by OpenJPH 0.26.3 (High-Throughput JPEG 2000), CharLS in pyjpegls 1.5.1
//! (JPEG-LS), libjxl 0.11.2 (JPEG XL) and libjpeg-turbo 3.1.3 (JPEG).

use dicom_dictionary_std::tags;
use glam::DVec3;
use rhinoplan::io::dicom::{Folder, Scan};

use crate::builder::{Dir, SliceFile, expected, hu, hus, stack};

const JPEG_BASELINE: &str = "1.2.840.10008.1.2.4.50";
const SPECTRAL_SELECTION: &str = "1.2.840.10008.1.2.4.53";
const PROGRESSIVE: &str = "1.2.840.10008.1.2.4.55";
const JPEG_LS: &str = "1.2.840.10008.1.2.4.80";
const JPEG_LS_NEAR: &str = "1.2.840.10008.1.2.4.81";
const JPEG_XL_LOSSLESS: &str = "1.2.840.10008.1.2.4.110";
const JPEG_XL_OF_JPEG: &str = "1.2.840.10008.1.2.4.111";
const JPEG_XL: &str = "1.2.840.10008.1.2.4.112";
const HIGH_THROUGHPUT_UID: &str = "1.2.840.10008.1.2.4.201";

macro_rules! packed {
    ($name:literal) => {
        include_bytes!(concat!("packed/", $name))
    };
}

/// The first two planes of a stack as codestreams of High-Throughput JPEG 2000, by OpenJPH 0.26.3: their common
/// beginning, what differs, and their common end.
const HIGH_THROUGHPUT: [&str; 4] = [
    "ff4fff5100294000000000060000000500000000000000000000000600000005000000000000000000018f0101ff50000800020000\
     0009ff52000c00020001000104044001ff5c00072088888888ff64001700014f70656e4a50482056657220302e32362e332eff90\
     000a00000000002e0001ff93c0002d40",
    "cf9f7ef9a31fff79bfef7df7144bcc63",
    "077f7be0dbfe7bedad677df5144bcc63",
    "00f9b800c0002400f8951300ffd9",
];

/// The first two planes of a stack, packed so.
fn high_throughput() -> [Vec<u8>; 2] {
    let [begin, first, second, end] = HIGH_THROUGHPUT;
    [first, second].map(|middle| {
        let digits = format!("{begin}{middle}{end}");
        let byte = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).unwrap();
        (0..digits.len()).step_by(2).map(byte).collect()
    })
}

#[test]
fn high_throughput_jpeg_2000() {
    for uid in [
        HIGH_THROUGHPUT_UID,
        "1.2.840.10008.1.2.4.202",
        "1.2.840.10008.1.2.4.203",
    ] {
        let mut files = stack(2);
        for (file, image) in files.iter_mut().zip(high_throughput()) {
            file.fragments(uid, &[&image]);
        }
        let scan = Dir::of(&files).read().unwrap();
        assert_eq!(hus(&scan.volume), expected(2), "{uid}");
    }
}

const COLUMNS: i32 = 32;
const ROWS: i32 = 24;

/// HU of the image in `packed/`: air outside, a shell of bone, tissue and a hollow in it, with noise.
fn image() -> Vec<i32> {
    let value = |x: i32, y: i32| {
        let distance = (2 * x - 31) * (2 * x - 31) + (2 * y - 23) * (2 * y - 23);
        let noise = (x * 7919 + y * 104_729 + x * y * 31) % 41 - 20;
        match distance {
            0..25 => -990 + noise.div_euclid(4),
            25..=225 => 40 + noise,
            226..=400 => 1100 + noise,
            _ => -1024,
        }
    };
    (0..ROWS)
        .flat_map(|y| (0..COLUMNS).map(move |x| value(x, y)))
        .collect()
}

/// How the samples of the image are stored.
#[derive(Clone, Copy)]
enum Samples {
    /// (HU + 1024) / 10.
    Eight,
    /// HU + 1024.
    Twelve,
    /// HU, in 16 bits or, where a file says so, fewer.
    Signed(u16),
}

/// The image twice, 2 mm apart, in the same fragments.
fn files(samples: Samples, syntax: &'static str, fragments: &[&[u8]]) -> Vec<SliceFile> {
    sized([COLUMNS as u16, ROWS as u16], samples, syntax, fragments)
}

fn sized(
    size: [u16; 2],
    samples: Samples,
    syntax: &'static str,
    fragments: &[&[u8]],
) -> Vec<SliceFile> {
    let (allocated, stored, signed, rescale) = match samples {
        Samples::Eight => (8, 8, 0, (10.0, -1024.0)),
        Samples::Twelve => (16, 12, 0, (1.0, -1024.0)),
        Samples::Signed(stored) => (16, stored, 1, (1.0, 0.0)),
    };
    let file = |z: f64| {
        let mut file = SliceFile::new(size, &[]);
        file.word(tags::BITS_ALLOCATED, allocated)
            .word(tags::BITS_STORED, stored)
            .word(tags::HIGH_BIT, stored - 1)
            .word(tags::PIXEL_REPRESENTATION, signed)
            .rescale(rescale.0, rescale.1)
            .at(DVec3::new(0.0, 0.0, z))
            .fragments(syntax, fragments);
        file
    };
    [0.0, 2.0].map(file).to_vec()
}

#[track_caller]
fn values(files: &[SliceFile]) -> Vec<f64> {
    values_of(&Dir::of(files).read().unwrap())
}

#[track_caller]
fn values_of(scan: &Scan) -> Vec<f64> {
    let all = hus(&scan.volume);
    let (first, second) = all.split_at(all.len() / 2);
    assert_eq!(first, second);
    first.to_vec()
}

#[track_caller]
fn refusal(files: &[SliceFile]) -> String {
    Dir::of(files).error()
}

/// What every bit depth and sign is packed as.
const LOSSLESS: [(Samples, &str, &[u8]); 8] = [
    (Samples::Eight, JPEG_LS, packed!("8.jls")),
    (Samples::Twelve, JPEG_LS, packed!("12.jls")),
    (Samples::Signed(16), JPEG_LS, packed!("16.jls")),
    (Samples::Signed(16), JPEG_LS_NEAR, packed!("16.jls")),
    (Samples::Eight, JPEG_XL_LOSSLESS, packed!("8.jxl")),
    (Samples::Twelve, JPEG_XL_LOSSLESS, packed!("12.jxl")),
    (Samples::Signed(16), JPEG_XL_LOSSLESS, packed!("16.jxl")),
    (Samples::Signed(16), JPEG_XL, packed!("16.jxl")),
];

#[test]
fn jpeg_ls_and_jpeg_xl_of_every_depth_and_sign_are_exact() {
    for (samples, syntax, packed) in LOSSLESS {
        let expected: Vec<f64> = image()
            .into_iter()
            .map(|hu| match samples {
                Samples::Eight => f64::from((hu + 1024) / 10 * 10 - 1024),
                _ => f64::from(hu),
            })
            .collect();
        let whole = files(samples, syntax, &[packed]);
        assert_eq!(values(&whole), expected, "{syntax}");
        // An odd length is padded by a zero; a frame may lie in any number of fragments.
        let (begin, rest) = packed.split_at(40);
        let (middle, end) = rest.split_at(100);
        let padded = [end, &[0]].concat();
        let pieces = files(samples, syntax, &[begin, middle, &padded]);
        assert_eq!(values(&pieces), expected, "{syntax} in pieces");
    }
}

#[test]
fn the_highest_bit_that_is_stored_is_the_sign() {
    // HU + 1024, of which what is above 2047 is below zero as a signed number of 12 bits.
    let expected: Vec<f64> = image()
        .into_iter()
        .map(|hu| {
            f64::from(if hu < 1024 {
                hu + 1024
            } else {
                hu + 1024 - 4096
            })
        })
        .collect();
    assert!(expected.iter().any(|value| *value < 0.0));
    for (syntax, packed) in [
        (JPEG_LS, &packed!("12.jls")[..]),
        (JPEG_XL_LOSSLESS, packed!("12.jxl")),
    ] {
        let signed = files(Samples::Signed(12), syntax, &[packed]);
        assert_eq!(values(&signed), expected, "{syntax}");
    }
}

#[test]
fn near_lossless_samples_are_as_far_off_as_their_encoder_left_them() {
    let near = packed!("12-near-3.jls");
    let found = values(&files(Samples::Twelve, JPEG_LS_NEAR, &[near]));
    let off: Vec<f64> = found
        .iter()
        .zip(image())
        .map(|(found, hu)| found - f64::from(hu))
        .collect();
    let largest = off
        .iter()
        .fold(0.0, |largest: f64, off| largest.max(off.abs()));
    // As CharLS decodes it.
    let sums = (
        off.iter().sum::<f64>(),
        off.iter().map(|off| off.abs()).sum::<f64>(),
    );
    assert_eq!((largest, sums), (3.0, (147.0, 659.0)));
    let message = refusal(&files(Samples::Twelve, JPEG_LS, &[near]));
    assert!(
        message.contains("samples that are off by up to 3, expected lossless ones"),
        "{message}"
    );
}

#[test]
fn a_jpeg_that_is_packed_once_more_is_that_jpeg() {
    let jpeg = values(&files(Samples::Eight, JPEG_BASELINE, &[packed!("8.jpg")]));
    let sum: f64 = jpeg.iter().map(|hu| (hu + 1024.0) / 10.0).sum();
    // libjpeg-turbo makes 48272 of it; decoders may differ by 1.
    assert!((sum - 48272.0).abs() < 768.0, "{sum}");
    for syntax in [JPEG_XL_OF_JPEG, JPEG_XL] {
        let again = files(Samples::Eight, syntax, &[packed!("8-of-jpeg.jxl")]);
        assert_eq!(values(&again), jpeg, "{syntax}");
        let folder = Dir::of(&again);
        let folder = Folder::scan(folder.path()).unwrap();
        let lossy = folder.choose(None).unwrap().is_lossy();
        assert_eq!(
            lossy,
            syntax == JPEG_XL_OF_JPEG,
            "the other may be lossless"
        );
    }
    let lossless = files(
        Samples::Eight,
        JPEG_XL_LOSSLESS,
        &[packed!("8-of-jpeg.jxl")],
    );
    let message = refusal(&lossless);
    assert!(
        message.contains("lossy JPEG, expected lossless"),
        "{message}"
    );
}

/// A JPEG in JPEG XL whose text ("JFIF", the last 21 bytes of its box) is replaced by 300 MiB of zeros, packed into 241.
fn bomb() -> Vec<u8> {
    let mut image = packed!("8-of-jpeg.jxl").to_vec();
    let name = image.windows(4).position(|four| four == b"jbrd").unwrap();
    let length = u32::from_be_bytes(image[name - 4..name].try_into().unwrap());
    let end = name - 4 + length as usize;
    let zeros = packed!("300-MiB-of-zeros.br");
    image.splice(end - 21..end, zeros.iter().copied());
    let length = length - 21 + zeros.len() as u32;
    image[name - 4..name].copy_from_slice(&length.to_be_bytes());
    image
}

#[test]
fn texts_of_a_jpeg_that_inflate_to_hundreds_of_mebibytes_are_not_unpacked() {
    let start = std::time::Instant::now();
    let message = refusal(&files(Samples::Eight, JPEG_XL_OF_JPEG, &[&bomb()]));
    let refused = "(JPEG XL JPEG Recompression (1.2.840.10008.1.2.4.111)): it holds more text than";
    assert!(message.contains(refused), "{message}");
    assert!(start.elapsed().as_secs() < 5, "{:?}", start.elapsed());
}

#[test]
fn retired_kinds_of_jpeg_are_read_if_they_have_8_bits() {
    let baseline = values(&files(Samples::Eight, JPEG_BASELINE, &[packed!("8.jpg")]));
    // The same coefficients, in several scans.
    let progressive = &packed!("8-progressive.jpg")[..];
    for syntax in [PROGRESSIVE, SPECTRAL_SELECTION] {
        let found = values_of(&retired(syntax, progressive).read().unwrap());
        assert_eq!(found, baseline, "{syntax}");
    }
    let begin = progressive
        .windows(2)
        .position(|two| two == [0xff, 0xda])
        .unwrap();
    let endless = [progressive, &progressive[begin..begin + 10].repeat(100)].concat();
    let message = retired(PROGRESSIVE, &endless).error();
    assert!(
        message.contains(" scans, expected at most 100"),
        "{message}"
    );
}

/// The library that writes files does not know the syntax: it is put in place of another of its length.
fn retired(syntax: &str, image: &[u8]) -> Dir {
    let dir = Dir::new();
    let sound = files(Samples::Eight, JPEG_BASELINE, &[image]);
    for (index, file) in sound.iter().enumerate() {
        let mut bytes = file.bytes();
        let at = bytes
            .windows(syntax.len())
            .position(|piece| piece == JPEG_BASELINE.as_bytes())
            .unwrap();
        bytes[at..at + syntax.len()].copy_from_slice(syntax.as_bytes());
        dir.write(&format!("{index}.dcm"), &bytes);
    }
    dir
}

#[test]
fn jpeg_xl_in_floating_point_is_refused() {
    let message = refusal(&files(
        Samples::Signed(16),
        JPEG_XL,
        &[packed!("lossy.jxl")],
    ));
    for part in [
        "file `0.dcm` cannot be decoded (JPEG XL (1.2.840.10008.1.2.4.112))",
        "coded in floating point (VarDCT or XYB)",
        "export it again, uncompressed",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
}

#[test]
fn images_that_are_not_what_their_file_says_are_refused() {
    for (syntax, twelve, eight) in [
        (JPEG_LS, &packed!("12.jls")[..], &packed!("8.jls")[..]),
        (JPEG_XL_LOSSLESS, packed!("12.jxl"), packed!("8.jxl")),
    ] {
        for size in [[31, 24], [24, 32], [32, 25], [512, 512]] {
            let message = refusal(&sized(size, Samples::Twelve, syntax, &[twelve]));
            let found = "holds a packed image of 32×24 pixels, 1 component(s), 12 bits, expected";
            assert!(message.contains(found), "{syntax} {size:?}: {message}");
        }
        let message = refusal(&files(Samples::Twelve, syntax, &[eight]));
        assert!(message.contains("8 bits, expected"), "{message}");
        let message = refusal(&files(Samples::Eight, syntax, &[twelve]));
        assert!(message.contains("12 bits, expected"), "{message}");
        let message = refusal(&files(Samples::Signed(16), syntax, &[twelve]));
        assert!(
            message
                .contains("samples of 12 bits, expected 16 bits, of which the highest is the sign"),
            "{message}"
        );
        for cut in 1..twelve.len() {
            let message = refusal(&files(Samples::Twelve, syntax, &[&twelve[..cut]]));
            assert!(message.contains("file `0.dcm` "), "{cut}: {message}");
        }
        let message = refusal(&files(Samples::Twelve, syntax, &[]));
        assert!(message.contains("file `0.dcm` "), "{message}");
    }
}

/// Seeds of the fuzz target: each the second of two slices, so that its folder is a stack.
pub fn seeds() -> Vec<(Vec<SliceFile>, Vec<u8>)> {
    let mut seeds = Vec::new();
    let mut add = |files: Vec<SliceFile>, packed: &[u8]| {
        seeds.push((files, packed.to_vec()));
    };
    for (samples, syntax, packed) in LOSSLESS {
        add(files(samples, syntax, &[packed]), packed);
    }
    let near = packed!("12-near-3.jls");
    add(files(Samples::Twelve, JPEG_LS_NEAR, &[near]), near);
    let jpeg = packed!("8-of-jpeg.jxl");
    add(files(Samples::Eight, JPEG_XL_OF_JPEG, &[jpeg]), jpeg);
    let lossy = packed!("lossy.jxl");
    add(files(Samples::Signed(16), JPEG_XL, &[lossy]), lossy);
    let mut small = stack(2);
    let [_, second] = high_throughput();
    small[1].fragments(HIGH_THROUGHPUT_UID, &[&second]);
    add(small.clone(), &second);
    for (syntax, packed) in [
        (JPEG_LS, &packed!("stack.jls")[..]),
        (JPEG_XL_LOSSLESS, packed!("stack.jxl")),
    ] {
        small[1].fragments(syntax, &[packed]);
        add(small.clone(), packed);
    }
    seeds
}

#[test]
fn the_seeds_of_the_stack_are_its_second_plane() {
    for (files, packed) in seeds().iter().rev().take(3) {
        assert!(packed.len() < 200);
        let scan = Dir::of(files).read().unwrap();
        assert_eq!(hus(&scan.volume), expected(2));
    }
    assert_eq!(hu([0, 0, 1]), -900);
}
