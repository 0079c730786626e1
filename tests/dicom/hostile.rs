//! Files that are damaged, or lie: an error that says what, and nothing allocated on their word.

use dicom_core::{Tag, VR};
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;
use rhinoplan::io::dicom::Folder;

use crate::builder::{Dir, SliceFile, expected, hus, read, rle, stack};

/// What reading ends with where the second of four slices is changed.
fn changed(change: impl Fn(&mut SliceFile)) -> String {
    let mut files = stack(4);
    change(&mut files[1]);
    Dir::of(&files).error()
}

#[track_caller]
fn refused(change: impl Fn(&mut SliceFile), message: &str) {
    let found = changed(change);
    assert!(found.contains("file `1.dcm`"), "{found}");
    assert!(found.contains(message), "{message}\n{found}");
}

#[test]
fn elements_with_values_that_cannot_be_used() {
    let text = |tag: Tag, vr: VR, value: &'static str| {
        move |file: &mut SliceFile| {
            file.text(tag, vr, value);
        }
    };
    let word = |tag: Tag, value: u16| {
        move |file: &mut SliceFile| {
            file.word(tag, value);
        }
    };
    refused(
        word(tags::ROWS, 0),
        "Rows (0028,0010) 0, expected 1 to 32767",
    );
    refused(word(tags::COLUMNS, 0), "Columns (0028,0011) 0");
    refused(word(tags::ROWS, 65535), "Rows (0028,0010) 65535");
    refused(
        word(tags::SAMPLES_PER_PIXEL, 3),
        "SamplesPerPixel (0028,0002) 3, expected 1",
    );
    refused(
        word(tags::BITS_ALLOCATED, 32),
        "BitsAllocated (0028,0100) 32, expected 8 or 16",
    );
    refused(
        word(tags::BITS_STORED, 17),
        "BitsStored (0028,0101) 17, expected 1 to 16",
    );
    refused(word(tags::BITS_STORED, 0), "BitsStored (0028,0101) 0");
    refused(
        word(tags::HIGH_BIT, 3),
        "HighBit (0028,0102) 3, expected 15 to 15",
    );
    refused(
        word(tags::PIXEL_REPRESENTATION, 2),
        "PixelRepresentation (0028,0103) 2",
    );
    let meaning = tags::PHOTOMETRIC_INTERPRETATION;
    refused(
        text(meaning, VR::CS, "MONOCHROME1"),
        "MONOCHROME1, expected MONOCHROME2",
    );
    let spacing = tags::PIXEL_SPACING;
    refused(
        text(spacing, VR::DS, "NaN\\NaN"),
        "NaN\\\\NaN, expected 2 finite numbers",
    );
    refused(
        text(spacing, VR::DS, "1"),
        "PixelSpacing (0028,0030) 1, expected 2",
    );
    refused(
        text(spacing, VR::DS, "1\\1\\1"),
        "expected 2 finite numbers",
    );
    refused(
        text(spacing, VR::DS, "1,5\\1,5"),
        "expected 2 finite numbers",
    );
    refused(
        text(spacing, VR::DS, "0\\1"),
        "expected two spacings above 0 mm",
    );
    refused(
        text(spacing, VR::DS, "-1\\1"),
        "expected two spacings above 0 mm",
    );
    refused(
        text(spacing, VR::DS, "1e999\\1"),
        "expected 2 finite numbers",
    );
    let position = tags::IMAGE_POSITION_PATIENT;
    refused(
        text(position, VR::DS, "1\\2\\inf"),
        "expected 3 finite numbers",
    );
    let axes = tags::IMAGE_ORIENTATION_PATIENT;
    refused(text(axes, VR::DS, "1\\0\\0\\1\\0\\0"), "at 0.00°");
    refused(
        text(axes, VR::DS, "0\\0\\0\\0\\1\\0"),
        "length 0.0000 and 1.0000",
    );
    refused(text(axes, VR::DS, "2\\0\\0\\0\\1\\0"), "length 2.0000");
    refused(
        text(tags::RESCALE_SLOPE, VR::DS, "0"),
        "RescaleSlope (0028,1053) 0",
    );
    refused(
        text(tags::RESCALE_SLOPE, VR::DS, "1e-60"),
        "a slope other than 0",
    );
    refused(
        text(tags::RESCALE_INTERCEPT, VR::DS, "1e60"),
        "RescaleIntercept (0028,1052)",
    );
    refused(
        text(tags::RESCALE_TYPE, VR::LO, "Z_EFF"),
        "Z_EFF, expected HU",
    );
    for tag in [
        tags::ROWS,
        tags::COLUMNS,
        tags::BITS_ALLOCATED,
        tags::PIXEL_REPRESENTATION,
        tags::PIXEL_SPACING,
        tags::IMAGE_POSITION_PATIENT,
        tags::IMAGE_ORIENTATION_PATIENT,
        tags::PIXEL_DATA,
        tags::SERIES_INSTANCE_UID,
    ] {
        let shown = format!("({:04X},{:04X})", tag.group(), tag.element());
        refused(
            |file| {
                file.remove(tag);
            },
            &format!("{shown}; export it again"),
        );
    }
    let words = |file: &mut SliceFile| {
        file.words(tags::ROWS, VR::US, &[5, 5]);
    };
    refused(words, "4 bytes long, expected one 16-bit number");
}

#[test]
fn rows_and_columns_that_lie() {
    refused(
        |file| {
            file.word(tags::ROWS, 6);
        },
        "has 60 bytes of pixels, 72 expected",
    );
    refused(
        |file| {
            file.word(tags::ROWS, 4);
        },
        "has 60 bytes of pixels, 48 expected",
    );
    for syntax in [
        uids::EXPLICIT_VR_LITTLE_ENDIAN,
        uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN,
    ] {
        refused(
            |file| {
                file.syntax = syntax;
                file.word(tags::ROWS, 32767).word(tags::COLUMNS, 32767);
            },
            "has 60 bytes of pixels, 2147352578 expected",
        );
    }
    let packed = rle(&[7; 30]);
    refused(
        |file| {
            file.fragments(uids::RLE_LOSSLESS, &[&packed])
                .word(tags::ROWS, 32767)
                .word(tags::COLUMNS, 32767);
        },
        "claims 2147352578 bytes of pixels",
    );
}

#[test]
fn pixels_that_are_cut() {
    let bytes = stack(4).remove(1).bytes();
    let dir = Dir::of(&stack(4));
    for cut in [1, 10, 60] {
        dir.write("1.dcm", &bytes[..bytes.len() - cut]);
        let message = dir.error();
        let found = format!("has {} bytes of pixels, 60 expected", 60 - cut);
        assert!(message.contains(&found), "{message}");
        // Headers tell.
        assert!(Folder::scan(dir.path()).unwrap().choose(None).is_err());
    }
    // Deflated and packed pixels are found to be cut when they are read.
    for (syntax, packed) in [
        (uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN, None),
        (uids::RLE_LOSSLESS, Some(rle(&[7; 30]))),
    ] {
        let mut file = stack(4).remove(1);
        file.syntax = syntax;
        if let Some(packed) = packed {
            file.fragments(syntax, &[&packed]);
        }
        let bytes = file.bytes();
        dir.write("1.dcm", &bytes[..bytes.len() - 9]);
        let message = dir.error();
        assert!(message.contains("file `1.dcm`"), "{message}");
    }
}

#[test]
fn run_length_headers_that_lie() {
    let sound = rle(&[7; 30]);
    let with = |at: usize, value: u32| {
        let mut image = sound.clone();
        image[at..at + 4].copy_from_slice(&value.to_le_bytes());
        image
    };
    let packed = |image: Vec<u8>| {
        changed(|file| {
            file.fragments(uids::RLE_LOSSLESS, &[&image]);
        })
    };
    for count in [0, 1, 3, 15, 16, u32::MAX, 1 << 30] {
        let message = packed(with(0, count));
        assert!(
            message.contains(&format!("{count} run-length segments")),
            "{message}"
        );
    }
    for offset in [0, 63, 1 << 20, u32::MAX] {
        for at in [4, 8] {
            let message = packed(with(at, offset));
            assert!(message.contains("2 run-length segments from"), "{message}");
        }
    }
    assert!(packed(sound[..64].to_vec()).contains("2 run-length segments from"));
    assert!(packed(sound[..20].to_vec()).contains("ends inside its pixels"));
    // The decoder panics where a segment is too short.
    let message = packed(rle(&[7; 20]));
    assert!(
        message.contains("cannot be decoded (RLE Lossless"),
        "{message}"
    );
}

#[test]
fn packed_images_of_another_size() {
    let jpeg = |rows: u16, columns: u16, bits: u8| {
        let mut image = vec![0xff, 0xd8, 0xff, 0xc3, 0, 11, bits];
        image.extend(rows.to_be_bytes());
        image.extend(columns.to_be_bytes());
        image.extend([1, 1, 0x11, 0, 0xff, 0xd9]);
        image
    };
    for (rows, columns, bits, found) in [
        (
            65535,
            65535,
            16,
            "65535×65535 pixels, 1 component(s), 16 bits",
        ),
        (5, 7, 16, "7×5 pixels"),
        (5, 6, 8, "8 bits"),
    ] {
        refused(
            |file| {
                let image = jpeg(rows, columns, bits);
                file.fragments("1.2.840.10008.1.2.4.70", &[&image]);
            },
            found,
        );
    }
    for syntax in [
        "1.2.840.10008.1.2.4.70",
        "1.2.840.10008.1.2.4.80",
        "1.2.840.10008.1.2.4.90",
        "1.2.840.10008.1.2.4.201",
    ] {
        refused(
            |file| {
                file.fragments(syntax, &[b"no such image"]);
            },
            "no size that can be found",
        );
        refused(
            |file| {
                file.fragments(syntax, &[]);
            },
            "no size that can be found",
        );
    }
}

#[test]
fn pixels_that_are_not_packed_as_the_syntax_says() {
    refused(
        |file| {
            file.syntax = uids::RLE_LOSSLESS;
        },
        "its pixels are not packed as its transfer syntax says, RLE Lossless",
    );
    refused(
        |file| {
            file.fragments(uids::RLE_LOSSLESS, &[&rle(&[7; 30])]);
            file.syntax = uids::EXPLICIT_VR_LITTLE_ENDIAN;
        },
        "its pixels are not packed as its transfer syntax says, Explicit VR Little Endian",
    );
}

#[test]
fn syntaxes_that_are_not_decoded_are_named() {
    for (uid, name, by) in [
        (
            "1.2.840.10008.1.2.4.93",
            "JPEG 2000 Part 2 Multi-component",
            "gdcmconv --raw",
        ),
        (
            "1.2.840.10008.1.2.4.92",
            "JPEG 2000 Part 2 Multi-component (Lossless Only)",
            "gdcmconv --raw",
        ),
    ] {
        let refusal = changed(|file| {
            file.fragments(uid, &[b"image"]);
        });
        for part in [format!("is packed as {name} ({uid})"), format!("({by}")] {
            assert!(refusal.contains(&part), "{part} is not in: {refusal}");
        }
    }
}

#[test]
fn a_syntax_that_nobody_knows_is_shown() {
    let (known, unknown) = (b"1.2.840.10008.1.2.4.80", b"1.2.826.0.1.3680043.99");
    let mut file = stack(4).remove(1);
    file.fragments("1.2.840.10008.1.2.4.80", &[b"image"]);
    let mut bytes = file.bytes();
    let at = bytes
        .windows(known.len())
        .position(|piece| piece == known)
        .unwrap();
    bytes[at..at + known.len()].copy_from_slice(unknown);
    let dir = Dir::of(&stack(4));
    dir.write("1.dcm", &bytes);
    let message = dir.error();
    assert!(
        message.contains("is packed as unknown (1.2.826.0.1.3680043.99)"),
        "{message}"
    );
}

/// Sequences within sequences would take a stack frame each where objects are built.
#[test]
fn sequences_that_lie_in_one_another_a_hundred_thousand_deep() {
    let bytes = stack(4).remove(1).bytes();
    // Behind the preamble and the meta information, whose length is its first element.
    let start = 144 + u32::from_le_bytes(bytes[140..144].try_into().unwrap()) as usize;
    let mut hostile = bytes[..start].to_vec();
    for _ in 0..100_000 {
        hostile.extend([8, 0, 0x10, 0x11, b'S', b'Q', 0, 0, 0xff, 0xff, 0xff, 0xff]);
        hostile.extend([0xfe, 0xff, 0x00, 0xe0, 0xff, 0xff, 0xff, 0xff]);
    }
    let dir = Dir::of(&stack(4));
    dir.write("1.dcm", &hostile);
    let message = dir.error();
    assert!(message.contains("more than 64 deep"), "{message}");
}

#[test]
fn lengths_that_claim_gigabytes() {
    let bytes = stack(4).remove(1).bytes();
    let start = 144 + u32::from_le_bytes(bytes[140..144].try_into().unwrap()) as usize;
    let with = |element: &[u8]| [&bytes[..start], element, &bytes[start..]].concat();
    let dir = Dir::of(&stack(4));
    // UT and OB have lengths of 32 bits; the first is wanted of nobody, the second is ImageType.
    for element in [
        &[8, 0, 1, 0, b'U', b'T', 0, 0, 0xf0, 0xff, 0xff, 0xff][..],
        &[8, 0, 8, 0, b'O', b'B', 0, 0, 0xf0, 0xff, 0xff, 0xff],
    ] {
        dir.write("1.dcm", &with(element));
        let message = dir.error();
        assert!(message.contains("file `1.dcm` "), "{message}");
    }
    let mut meta = bytes.clone();
    // The first element of the meta information after its length: OB, four bytes of length.
    assert_eq!(&meta[144..152], [2, 0, 1, 0, b'O', b'B', 0, 0]);
    meta[152..156].copy_from_slice(&u32::MAX.to_le_bytes());
    dir.write("1.dcm", &meta);
    assert!(dir.error().contains("claims 4294967295 bytes"));
}

/// A file of holes: nothing is read of it but its header.
#[test]
fn a_file_far_larger_than_a_slice() {
    let dir = Dir::of(&stack(4));
    let file = std::fs::File::options()
        .write(true)
        .open(dir.path().join("1.dcm"))
        .unwrap();
    file.set_len(1 << 40).unwrap();
    let message = dir.error();
    assert!(
        message.contains("1099511627776 bytes long, more than 268435456"),
        "{message}"
    );
}

/// Zeros deflate a thousandfold.
#[test]
fn a_deflated_bomb_ends() {
    use std::io::Write;
    let mut file = stack(4).remove(1);
    file.syntax = uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN;
    let bytes = file.bytes();
    let start = 144 + u32::from_le_bytes(bytes[140..144].try_into().unwrap()) as usize;
    let mut packed = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::best());
    // An unknown element of 4 GB: 1 GB of it is there.
    packed
        .write_all(&[8, 0, 1, 0, b'U', b'T', 0, 0, 0xf0, 0xff, 0xff, 0xff])
        .unwrap();
    for _ in 0..64 {
        packed.write_all(&vec![0; 16 << 20]).unwrap();
    }
    let bomb = [&bytes[..start], &packed.finish().unwrap()].concat();
    let dir = Dir::of(&stack(4));
    dir.write("1.dcm", &bomb);
    let before = std::time::Instant::now();
    let message = dir.error();
    assert!(
        message.contains("no pixels within 16777216 bytes"),
        "{message}"
    );
    assert!(before.elapsed().as_secs() < 5, "{:?}", before.elapsed());
}

#[test]
fn what_a_file_says_is_shown_escaped() {
    let found = changed(|file| {
        file.text(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "\u{1b}[31mRED");
    });
    assert!(found.contains("\\u{1b}[31mRED"), "{found}");
}

#[test]
fn a_thousand_slices_and_a_thousand_other_files() {
    let files = stack(1000);
    let dir = Dir::of(&files);
    for index in 0..1000 {
        dir.write(&format!("note-{index}.txt"), b"not of the series");
    }
    let scan = read(dir.path(), None).unwrap();
    assert_eq!(scan.volume.grid().dims(), [6, 5, 1000]);
    assert_eq!(
        scan.volume.grid().origin().0,
        DVec3::new(-10.0, -20.0, 30.0)
    );
    assert_eq!(hus(&scan.volume)[..30], expected(1)[..]);
}
