//! Real scans, where they are at hand.

use std::path::Path;

use rhinoplan::io::dicom::{Folder, SeriesState};
use rhinoplan::io::nifti;
use rhinoplan::space::ContinuousIndex;

use crate::builder::{Dir, hus, read};
use crate::noise::tell;
use crate::real_data;

/// Positions in the two files are single-precision numbers of some hundreds of mm.
const SAME_PLACE_MM: f64 = 1e-3;

#[test]
fn the_head_phantom_is_the_one_in_nifti() {
    let (Some(folder), Some(file)) = (
        real_data::path("headphantom-dicom"),
        real_data::path("headphantom.nii.gz"),
    ) else {
        return;
    };
    let slices = read(&folder, None).unwrap();
    let crop = nifti::read(&file).unwrap();
    let (whole, part) = (slices.volume.grid(), crop.volume.grid());
    assert_eq!(whole.dims(), [512, 512, 76]);
    let place = |index: [f64; 3]| {
        let at = part.grid_to_lps(part.index_to_grid(ContinuousIndex::from(index)));
        whole.grid_to_index(whole.lps_to_grid(at)).0
    };
    let start = place([0.0; 3]).round();
    let [nx, ny, nz] = part.dims();
    // Every corner of the crop lies on a voxel of the slices, or where one would be.
    for corner in 0..8 {
        let index = [nx, ny, nz].map(|n| (n - 1) as f64);
        let index = [0, 1, 2].map(|axis| {
            if corner >> axis & 1 == 1 {
                index[axis]
            } else {
                0.0
            }
        });
        let there = place(index) - start - glam::DVec3::from_array(index);
        let mm = (there * whole.spacing()).length();
        assert!(mm < SAME_PLACE_MM, "{index:?}: {mm} mm");
    }
    let (ours, theirs) = (hus(&slices.volume), hus(&crop.volume));
    let (mut same, mut outside) = (0_usize, 0_usize);
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let [i, j, k] = [x, y, z].map(|n| n as f64);
                let at = start + glam::DVec3::new(i, j, k);
                let inside =
                    at.cmpge(glam::DVec3::ZERO).all() && at.cmple(whole.last_index()).all();
                if !inside {
                    outside += 1;
                    continue;
                }
                let [i, j, k] = at.to_array().map(|n| n as usize);
                let (a, b) = (ours[i + 512 * (j + 512 * k)], theirs[x + nx * (y + ny * z)]);
                assert_eq!(a, b, "({x}, {y}, {z})");
                same += 1;
            }
        }
    }
    tell(&format!(
        "headphantom: {same} voxels equal, {outside} outside of the slices"
    ));
    assert!(same > nx * ny * 50, "{same} of {}", nx * ny * nz);
    let (low, high) = slices.volume.hu_range();
    assert!(low < -1000.0 && high > 1000.0, "{low} to {high} HU");
}

#[test]
fn the_tilted_series_is_refused_with_angle_and_gaps() {
    let Some(folder) = real_data::path("tilted-dicom") else {
        return;
    };
    let message = read(&folder, None).unwrap_err().to_string();
    for part in [
        "28 slices",
        "tilted by 18.5°",
        "4 mm (13×, first after 0 mm)",
        "7 mm (13×, first after 53.11 mm)",
        "1.08 mm (1×, after 52.03 mm)",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
}

/// The slice in every syntax: the UID's end, and whether it decodes, and without loss.
const SYNTAXES: [(&str, bool, bool); 16] = [
    ("LittleEndianImplicit_1.2.840.10008.1.2.dcm", true, true),
    ("LittleEndianExplicit_1.2.840.10008.1.2.1.dcm", true, true),
    ("BigEndianExplicit_1.2.840.10008.1.2.2.dcm", true, true),
    (
        "DeflatedExplicitVRLittleEndian_1.2.840.10008.1.2.1.99.dcm",
        true,
        true,
    ),
    ("CTImage.dcm", true, true),
    ("RLELossless_1.2.840.10008.1.2.5.dcm", true, true),
    ("JPEGProcess14_1.2.840.10008.1.2.4.57.dcm", true, true),
    ("JPEGProcess14SV1_1.2.840.10008.1.2.4.70.dcm", true, true),
    (
        "JPEG2000LosslessOnly_1.2.840.10008.1.2.4.90.dcm",
        true,
        true,
    ),
    ("JPEG2000_1.2.840.10008.1.2.4.91.dcm", true, false),
    ("JPEGProcess1_1.2.840.10008.1.2.4.50.dcm", true, false),
    ("JPEGProcess2_4_1.2.840.10008.1.2.4.51.dcm", false, false),
    ("JPEGProcess6_8_1.2.840.10008.1.2.4.53.dcm", false, false),
    ("JPEGProcess10_12_1.2.840.10008.1.2.4.55.dcm", false, false),
    ("JPEGLSLossless_1.2.840.10008.1.2.4.80.dcm", true, true),
    ("JPEGLSLossy_1.2.840.10008.1.2.4.81.dcm", true, false),
];

/// A slice and its copy 2 mm further, so that there is a volume.
pub fn twice(path: &Path) -> Dir {
    let bytes = std::fs::read(path).unwrap();
    let dir = Dir::new();
    dir.write("a", &bytes);
    dir.write("b", &moved(&bytes));
    dir
}

/// The file with its slice 2 mm further, the length of every element unchanged.
fn moved(bytes: &[u8]) -> Vec<u8> {
    use std::io::{Read, Write};
    let (from, to) = (b"\\4.700000", b"\\6.700000");
    let replaced = |bytes: &[u8]| {
        let at = bytes.windows(from.len()).position(|piece| piece == from)?;
        let mut bytes = bytes.to_vec();
        bytes[at..at + to.len()].copy_from_slice(to);
        Some(bytes)
    };
    if let Some(moved) = replaced(bytes) {
        return moved;
    }
    // Deflated, behind the meta information.
    let start = 144 + u32::from_le_bytes(bytes[140..144].try_into().unwrap()) as usize;
    let mut inflated = Vec::new();
    flate2::read::DeflateDecoder::new(&bytes[start..])
        .read_to_end(&mut inflated)
        .unwrap();
    let mut packed = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(&replaced(&inflated).unwrap()).unwrap();
    [&bytes[..start], &packed.finish().unwrap()].concat()
}

#[test]
fn every_transfer_syntax_decodes_or_is_refused_by_name() {
    let Some(folder) = real_data::path("dicom-syntaxes") else {
        return;
    };
    let plain = twice(&folder.join("LittleEndianExplicit_1.2.840.10008.1.2.1.dcm"));
    let plain = hus(&plain.read().unwrap().volume);
    assert!(plain.iter().any(|hu| *hu < -900.0) && plain.iter().any(|hu| *hu > 500.0));
    for (name, decodes, lossless) in SYNTAXES {
        let path = folder.join(name);
        let dir = twice(&path);
        match dir.read() {
            Ok(scan) => {
                assert!(decodes, "{name}");
                let found = hus(&scan.volume);
                assert_eq!(found.len(), plain.len());
                let differences = found.iter().zip(&plain).map(|(a, b)| (a - b).abs());
                let largest = differences.fold(0.0, f64::max);
                tell(&format!("{name}: within {largest} HU"));
                if lossless {
                    assert_eq!(largest, 0.0, "{name}");
                }
            }
            Err(error) => {
                let message = error.to_string();
                tell(&format!("{name}: {message}"));
                assert!(!decodes, "{name}: {message}");
                let uid = name.rsplit_once('_').unwrap().1.trim_end_matches(".dcm");
                for part in [format!("({uid}) of 12 bits"), "(dcmdjpeg or".to_owned()] {
                    assert!(message.contains(&part), "{part}: {message}");
                }
            }
        }
    }
}

#[test]
fn files_without_pixels_or_spacing() {
    let Some(folder) = real_data::path("dicom-syntaxes") else {
        return;
    };
    for (name, message) in [
        ("no-pixel-data.dcm", "of modality SR, not CT"),
        ("no-pixel-spacing.dcm", "of modality US, not CT"),
    ] {
        let path = folder.join(name);
        let found = read(&path, None).unwrap_err().to_string();
        assert!(found.contains(message), "{found}");
        let alone = Dir::new();
        alone.write(name, &std::fs::read(&path).unwrap());
        assert!(alone.error().contains(message));
        let lines = Folder::scan(alone.path()).unwrap().series();
        assert_eq!(lines[0].state, SeriesState::Skipped);
    }
}
