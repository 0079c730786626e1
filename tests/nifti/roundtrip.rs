//! What is read is what the file stores, and what is written reads back the same.

use rhinoplan::io::gzip::GzipWriter;
use rhinoplan::io::nifti::{
    ByteOrder, Scan, WriteError, read, read_header, read_with, save_volume,
};
use rhinoplan::space::Grid;
use rhinoplan::volume::{AnyVolume, Rescale, Sample, Spares, Volume};
use rhinoplan::with_volume;

use crate::builder::{Folder, Nifti, Noise, TYPES, gzip};

/// A template's volume as an uncompressed file.
fn written(scan: &Scan, volume: &AnyVolume) -> Vec<u8> {
    let mut bytes = Vec::new();
    with_volume!(volume, volume => scan.template.write_volume(&mut bytes, volume)).unwrap();
    bytes
}

/// Random bytes, but finite where they are floats.
fn noise(code: i16, count: usize, size: usize) -> Vec<u8> {
    let mut noise = Noise::new(code as u64);
    let mut bytes = Vec::new();
    for _ in 0..count {
        let mut sample = noise.next().to_le_bytes();
        match code {
            16 => sample[..4].copy_from_slice(&(noise.unit() as f32 * 3e38).to_le_bytes()),
            // As large as Hounsfield units are let be, with all the bits of a double.
            64 => sample = (noise.unit() * 3e38).to_le_bytes(),
            _ => {}
        }
        bytes.extend_from_slice(&sample[..size]);
    }
    bytes
}

#[test]
fn every_type_and_byte_order_keeps_every_bit() {
    let folder = Folder::new();
    for (name, code, size) in TYPES {
        for big in [false, true] {
            let dims = [7, 5, 3];
            let little = noise(code, 105, size);
            let stored = if big {
                little
                    .chunks(size)
                    .flat_map(|sample| sample.iter().rev().copied())
                    .collect()
            } else {
                little.clone()
            };
            // Not LPS, so that every sample moves.
            let file = Nifti::new(dims, code, size, big, stored);
            for bytes in [file.bytes(), file.gzip()] {
                let scan = folder.read(&bytes).unwrap();
                assert_eq!(scan.volume.sample_type().to_string(), name);
                let order = if big {
                    ByteOrder::Big
                } else {
                    ByteOrder::Little
                };
                assert_eq!(scan.template.byte_order(), order);
                // Stored RAS: x and y are reversed in LPS.
                let found = with_volume!(&scan.volume, volume => le_bytes(volume));
                let expected: Vec<u8> = little
                    .chunks(7 * 5 * size)
                    .flat_map(|plane| plane.chunks(size).rev().flatten().copied())
                    .collect();
                assert!(found == expected, "{name}, big endian: {big}");
                assert!(
                    written(&scan, &scan.volume) == file.bytes(),
                    "{name}, big endian: {big}"
                );
            }
        }
    }
}

fn le_bytes<T: Sample>(volume: &Volume<T>) -> Vec<u8> {
    volume
        .as_slice()
        .iter()
        .flat_map(|sample| sample.le_bytes().as_ref().to_vec())
        .collect()
}

#[test]
fn a_changed_volume_reads_back_the_same_gzipped_or_not() {
    let folder = Folder::new();
    let scan = folder.read(&Nifti::small().gzip()).unwrap();
    let AnyVolume::I16(mut volume) = scan.volume else {
        panic!("i16 expected")
    };
    volume
        .as_mut_slice()
        .iter_mut()
        .for_each(|sample| *sample = sample.wrapping_mul(3));
    for name in ["out.nii", "out.nii.gz", "1.2.840.113.nii", "scan.v2.NII.GZ"] {
        let path = folder.path().join(name);
        save_volume(&path, &scan.template, &volume).unwrap();
        let magic = std::fs::read(&path).unwrap()[..2] == [0x1f, 0x8b];
        assert_eq!(magic, name.to_lowercase().ends_with(".gz"), "{name}");
        let back = read(&path).unwrap();
        assert_eq!(back.volume, AnyVolume::I16(volume.clone()));
    }
}

#[test]
fn pieces_and_batches_join_without_a_seam() {
    // Wider than a piece of the reader and a batch of the writer, in every direction that they are cut.
    let folder = Folder::new();
    for (dims, code, size) in [
        ([300, 2100, 4], 4, 2),
        ([3, 5, 9000], 64, 8),
        ([32767, 60, 2], 2, 1),
    ] {
        let count = dims.iter().map(|&n| n as usize).product();
        let file = Nifti::new(dims, code, size, false, noise(code, count, size));
        for bytes in [file.bytes(), file.gzip()] {
            let scan = folder.read(&bytes).unwrap();
            assert!(written(&scan, &scan.volume) == file.bytes(), "{dims:?}");
        }
    }
}

#[test]
fn memory_that_a_gzip_file_was_inflated_in_is_given_away() {
    let folder = Folder::new();
    let path = folder.path().join("ct");
    let given = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let spares = Spares::default();
        let scan = read_with(&path, &spares).unwrap();
        assert!(scan.volume == read(&path).unwrap().volume);
        spares.take::<i16>(scan.volume.grid().len()).is_some()
    };
    let file = Nifti::small();
    assert!(given(&file.gzip()));
    assert!(!given(&file.bytes()));
    let bytes = file.bytes();
    let (first, second) = bytes.split_at(400);
    let members = [gzip(first), gzip(second)].concat();
    assert!(!given(&members), "of several members");
    let with_more = [file.bytes(), vec![1; 77]].concat();
    assert!(!given(&gzip(&with_more)), "with bytes after the samples");
    let big: Vec<u8> = noise(4, 60, 2);
    let big = Nifti::new([5, 4, 3], 4, 2, true, big);
    assert!(!given(&big.gzip()), "of the other byte order");
}

#[test]
fn slope_and_intercept_are_told_and_kept_and_do_not_touch_the_samples() {
    let folder = Folder::new();
    let (nan, infinite) = (f32::NAN, f32::INFINITY);
    let none = Rescale::NONE;
    let some = Rescale {
        slope: 0.5,
        intercept: -1024.0,
    };
    for (slope, intercept, expected) in [
        (0.5, -1024.0, some),
        (1.0, 0.0, none),
        (
            -2.0,
            7.0,
            Rescale {
                slope: -2.0,
                intercept: 7.0,
            },
        ),
        (0.0, -1024.0, none),
        (0.0, nan, none),
        (nan, -1024.0, none),
        (infinite, 3.0, none),
        (nan, nan, none),
    ] {
        let mut file = Nifti::small();
        let plain = folder.read(&file.bytes()).unwrap();
        file.f32s(112, &[slope, intercept]);
        let scan = folder.read(&file.bytes()).unwrap();
        assert_eq!(scan.template.rescale(), expected);
        with_volume!(&scan.volume, volume => assert_eq!(volume.rescale(), expected));
        assert_eq!(
            with_volume!(&scan.volume, volume => le_bytes(volume)),
            with_volume!(&plain.volume, volume => le_bytes(volume))
        );
        let bytes = written(&scan, &scan.volume);
        if slope.is_finite() && intercept.is_finite() {
            assert!(bytes == file.bytes(), "{slope} {intercept}");
        }
        assert_eq!(folder.read(&bytes).unwrap().volume, scan.volume);
    }
}

#[test]
fn the_header_is_kept_but_for_what_could_name_the_patient() {
    let folder = Folder::new();
    let mut file = Nifti::small();
    file.text(4, "PATIENT 01")
        .text(14, "DOE^JANE")
        .text(148, "Jane Doe, *1970-01-01");
    file.text(228, "/home/doe/jane.dcm").text(328, "JANE DOE");
    file.f32s(124, &[3000.0, -1000.0]);
    file.header[39] = 0x39;
    // An extension, as dcm2niix writes them: 32 bytes of DICOM.
    file.between = [
        &[1, 0, 0, 0, 32, 0, 0, 0, 2, 0, 0, 0][..],
        b"PatientName=Jane Doe    ",
    ]
    .concat();
    file.f32s(108, &[384.0]);
    let scan = folder.read(&file.bytes()).unwrap();
    let plain = folder.read(&Nifti::small().bytes()).unwrap();
    assert_eq!(
        scan.volume, plain.volume,
        "the extension is not taken for samples"
    );
    let bytes = written(&scan, &scan.volume);
    let mut expected = Nifti::small();
    expected.f32s(124, &[3000.0, -1000.0]);
    expected.header[39] = 0x39;
    assert!(bytes == expected.bytes());
    assert!(
        !bytes
            .windows(3)
            .any(|three| three.eq_ignore_ascii_case(b"doe"))
    );
    let debug = format!("{:?}", scan.template);
    assert!(
        !debug.contains("74, 97, 110, 101"),
        "the template itself has forgotten the name"
    );
}

#[test]
fn trailing_axes_of_one_are_kept() {
    let folder = Folder::new();
    let mut file = Nifti::small();
    file.i16s(40, &[5, 5, 4, 3, 1, 1]);
    let scan = folder.read(&file.bytes()).unwrap();
    assert_eq!(scan.volume.grid().dims(), [5, 4, 3]);
    assert!(written(&scan, &scan.volume) == file.bytes());
}

#[test]
fn the_hash_is_that_of_the_file() {
    use sha2::{Digest, Sha256};
    let folder = Folder::new();
    let file = Nifti::small();
    let trailing = [file.bytes(), vec![7; 300_000]].concat();
    for bytes in [file.bytes(), file.gzip(), trailing] {
        let expected: [u8; 32] = Sha256::digest(&bytes).into();
        assert_eq!(folder.read(&bytes).unwrap().sha256, expected);
    }
}

#[test]
fn a_volume_of_another_type_grid_or_scaling_is_refused() {
    let folder = Folder::new();
    let scan = folder.read(&Nifti::small().bytes()).unwrap();
    let grid = scan.template.grid().clone();
    let what = |error: Result<(), WriteError>| match error {
        Err(WriteError::Mismatch { what, .. }) => what,
        other => panic!("{other:?}"),
    };
    let to = std::io::sink;
    let floats = Volume::<f32>::zeros(grid.clone(), Rescale::NONE).unwrap();
    assert_eq!(
        what(scan.template.write_volume(to(), &floats)),
        "sample type"
    );
    let elsewhere = Grid::axis_aligned([5, 4, 3], [1.0, 1.5, 2.0]).unwrap();
    let elsewhere = Volume::<i16>::zeros(elsewhere, Rescale::NONE).unwrap();
    assert_eq!(what(scan.template.write_volume(to(), &elsewhere)), "grid");
    let scaled = Rescale {
        slope: 2.0,
        intercept: 0.0,
    };
    let scaled = Volume::<i16>::zeros(grid, scaled).unwrap();
    assert_eq!(what(scan.template.write_volume(to(), &scaled)), "rescale");
    // Nothing appears under the name either.
    let path = folder.path().join("never.nii.gz");
    assert!(save_volume(&path, &scan.template, &scaled).is_err());
    assert!(!path.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error_compressed_or_not() {
    let folder = Folder::new();
    let scan = folder.read(&Nifti::small().bytes()).unwrap();
    let AnyVolume::I16(volume) = &scan.volume else {
        panic!("i16 expected")
    };
    let full = || {
        std::fs::File::options()
            .write(true)
            .open("/dev/full")
            .unwrap()
    };
    assert!(scan.template.write_volume(full(), volume).is_err());
    let buffered = std::io::BufWriter::new(full());
    assert!(
        scan.template.write_volume(buffered, volume).is_err(),
        "lost in a buffer"
    );
    let mut gzip = GzipWriter::new(full());
    let written = scan.template.write_volume(&mut gzip, volume);
    assert!(written.is_err() || gzip.finish().is_err());
}

#[test]
fn a_saved_file_in_a_missing_folder_is_named() {
    let folder = Folder::new();
    let scan = folder.read(&Nifti::small().bytes()).unwrap();
    let AnyVolume::I16(volume) = &scan.volume else {
        panic!("i16 expected")
    };
    let path = folder.path().join("nowhere").join("volume.nii.gz");
    let error = save_volume(&path, &scan.template, volume)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("nowhere") && error.contains("folder"),
        "{error}"
    );
}

#[test]
fn a_header_is_read_without_the_samples() {
    let folder = Folder::new();
    let file = Nifti::small();
    for bytes in [file.bytes(), file.gzip()] {
        let template = read_header(&folder.write("a.nii", &bytes)).unwrap();
        let scan = folder.read(&bytes).unwrap();
        assert_eq!(template.grid(), scan.volume.grid());
        assert_eq!(template.stored_dims(), [5, 4, 3]);
        assert_eq!(template.orientation().to_string(), "RAS");
    }
}
