//! Real scans, where they are at hand.

use rhinoplan::io::nifti::{Transform, read, read_header, save_volume};
use rhinoplan::volume::SampleType;
use rhinoplan::with_volume;

use crate::builder::Folder;
use crate::real_data;

fn inflate(path: &std::path::Path) -> Vec<u8> {
    let packed = std::fs::read(path).unwrap();
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(
        &mut flate2::read::MultiGzDecoder::new(&packed[..]),
        &mut bytes,
    )
    .unwrap();
    bytes
}

#[test]
fn headers_of_real_scans() {
    if let Some(path) = real_data::path("cranium.nii.gz") {
        let template = read_header(&path).unwrap();
        assert_eq!(template.grid().dims(), [256, 256, 108]);
        assert_eq!(template.orientation().to_string(), "LPS");
        assert_eq!(template.sample_type(), SampleType::I16);
        assert_eq!(template.transform(), Transform::Sform);
        let spacing = template.grid().spacing();
        assert!(
            (spacing - glam::DVec3::new(0.957, 0.957, 1.5))
                .abs()
                .max_element()
                < 1e-3,
            "{spacing}"
        );
    }
    if let Some(path) = real_data::path("headphantom.nii.gz") {
        let template = read_header(&path).unwrap();
        let spacing = template.grid().spacing();
        assert!(
            (spacing - glam::DVec3::new(0.977, 0.977, 2.0))
                .abs()
                .max_element()
                < 1e-3,
            "{spacing}"
        );
    }
}

#[test]
fn samples_of_real_scans_come_back_byte_for_byte() {
    for name in ["cranium.nii.gz", "headphantom.nii.gz"] {
        let Some(path) = real_data::path(name) else {
            continue;
        };
        let folder = Folder::new();
        let scan = read(&path).unwrap();
        let out = folder.path().join(name);
        with_volume!(&scan.volume, volume => save_volume(&out, &scan.template, volume)).unwrap();
        let (before, after) = (inflate(&path), inflate(&out));
        let offset = f32::from_le_bytes(before[108..112].try_into().unwrap()) as usize;
        assert!(before[offset..] == after[352..], "{name}");
        let (low, high) = scan.volume.hu_range();
        assert!(low < -900.0 && high > 1000.0, "{name}: {low} to {high} HU");
        assert!(read(&out).unwrap().volume == scan.volume);
    }
}
