//! Slices from numbers.

use std::path::{Path, PathBuf};

use dicom_core::value::{PixelFragmentSequence, Value};
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};
use glam::DVec3;
use rhinoplan::io::dicom::{DicomError, Folder, Scan};
use rhinoplan::volume::AnyVolume;
use rhinoplan::with_volume;

use crate::head::{DIMS, SPACING, nifti};

/// Retired from the standard, not from archives.
pub const BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";

pub const SERIES: &str = "1.2.826.0.1.3680043.8.498.1";

/// What no output may hold: tag, type, text.
pub const IDENTITY: [(Tag, VR, &str); 18] = [
    (tags::PATIENT_NAME, VR::PN, "Doe^Jane"),
    (tags::PATIENT_ID, VR::LO, "HOSPITAL-4711"),
    (tags::PATIENT_BIRTH_DATE, VR::DA, "19610203"),
    (tags::STUDY_DATE, VR::DA, "20251122"),
    (tags::STUDY_TIME, VR::TM, "093217"),
    (tags::ACCESSION_NUMBER, VR::SH, "ACC-0815"),
    (tags::INSTITUTION_NAME, VR::LO, "Saint Elsewhere"),
    (tags::REFERRING_PHYSICIAN_NAME, VR::PN, "Craig^Mark"),
    (tags::STUDY_DESCRIPTION, VR::LO, "Nose of Jane"),
    (tags::SERIES_DESCRIPTION, VR::LO, "Thin slices of Jane"),
    (
        tags::STUDY_INSTANCE_UID,
        VR::UI,
        "1.2.826.0.1.3680043.8.498.77",
    ),
    (tags::OTHER_PATIENT_NAMES, VR::PN, "Roe^Janet"),
    (tags::PATIENT_ADDRESS, VR::LO, "Elm Street 13"),
    (tags::PATIENT_COMMENTS, VR::LT, "Fell off a horse"),
    (tags::OPERATORS_NAME, VR::PN, "Chapel^Nurse"),
    (tags::DEVICE_SERIAL_NUMBER, VR::LO, "SN-90210"),
    // Of a maker's own, behind the element that says whose.
    (Tag(0x0009, 0x0010), VR::LO, "MAKER OF SCANNERS"),
    (Tag(0x0009, 0x1001), VR::LO, "Private Jane"),
];

/// A file to be.
#[derive(Clone)]
pub struct SliceFile {
    pub object: InMemDicomObject,
    pub syntax: &'static str,
}

impl SliceFile {
    /// A sound slice, signed 16 bits, HU as they are, of 1 × 1.5 mm pixels, axial, first pixel at (-10, -20, 30).
    pub fn new([columns, rows]: [u16; 2], samples: &[i16]) -> Self {
        let words: Vec<u16> = samples
            .iter()
            .map(|sample| sample.cast_unsigned())
            .collect();
        let mut file = Self {
            object: InMemDicomObject::new_empty(),
            syntax: uids::EXPLICIT_VR_LITTLE_ENDIAN,
        };
        for (tag, vr, text) in IDENTITY {
            file.text(tag, vr, text);
        }
        file.text(tags::SOP_CLASS_UID, VR::UI, uids::CT_IMAGE_STORAGE)
            .text(
                tags::SOP_INSTANCE_UID,
                VR::UI,
                "1.2.826.0.1.3680043.8.498.99",
            )
            .text(tags::IMAGE_TYPE, VR::CS, "ORIGINAL\\PRIMARY\\AXIAL")
            .text(tags::MODALITY, VR::CS, "CT")
            .text(tags::SERIES_INSTANCE_UID, VR::UI, SERIES)
            .text(tags::SERIES_NUMBER, VR::IS, "4")
            .text(tags::SLICE_THICKNESS, VR::DS, "99")
            .word(tags::SAMPLES_PER_PIXEL, 1)
            .text(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2")
            .word(tags::ROWS, rows)
            .word(tags::COLUMNS, columns)
            .text(tags::PIXEL_SPACING, VR::DS, "1.5\\1")
            .word(tags::BITS_ALLOCATED, 16)
            .word(tags::BITS_STORED, 16)
            .word(tags::HIGH_BIT, 15)
            .word(tags::PIXEL_REPRESENTATION, 1)
            .rescale(1.0, 0.0)
            .text(tags::RESCALE_TYPE, VR::LO, "HU")
            .at(DVec3::new(-10.0, -20.0, 30.0))
            .oriented(DVec3::X, DVec3::Y)
            .words(tags::PIXEL_DATA, VR::OW, &words);
        file
    }

    pub fn put(&mut self, tag: Tag, vr: VR, value: PrimitiveValue) -> &mut Self {
        self.object.put(DataElement::new(tag, vr, value));
        self
    }

    pub fn text(&mut self, tag: Tag, vr: VR, text: &str) -> &mut Self {
        self.put(tag, vr, PrimitiveValue::from(text))
    }

    pub fn word(&mut self, tag: Tag, word: u16) -> &mut Self {
        self.put(tag, VR::US, PrimitiveValue::from(word))
    }

    pub fn words(&mut self, tag: Tag, vr: VR, words: &[u16]) -> &mut Self {
        self.put(tag, vr, PrimitiveValue::U16(words.to_vec().into()))
    }

    pub fn bytes_of(&mut self, tag: Tag, bytes: &[u8]) -> &mut Self {
        self.put(tag, VR::OB, PrimitiveValue::U8(bytes.to_vec().into()))
    }

    pub fn fragments(&mut self, syntax: &'static str, fragments: &[&[u8]]) -> &mut Self {
        self.syntax = syntax;
        let fragments = fragments.iter().map(|f| f.to_vec()).collect::<Vec<_>>();
        let value = PixelFragmentSequence::new(Vec::new(), fragments);
        self.object.put(DataElement::new(
            tags::PIXEL_DATA,
            VR::OB,
            Value::PixelSequence(value),
        ));
        self
    }

    pub fn remove(&mut self, tag: Tag) -> &mut Self {
        self.object.remove_element(tag);
        self
    }

    pub fn rescale(&mut self, slope: f64, intercept: f64) -> &mut Self {
        self.text(tags::RESCALE_SLOPE, VR::DS, &slope.to_string());
        self.text(tags::RESCALE_INTERCEPT, VR::DS, &intercept.to_string())
    }

    pub fn at(&mut self, position: DVec3) -> &mut Self {
        let text = joined(&[position]);
        self.text(tags::IMAGE_POSITION_PATIENT, VR::DS, &text)
    }

    pub fn oriented(&mut self, row: DVec3, column: DVec3) -> &mut Self {
        let text = joined(&[row, column]);
        self.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, &text)
    }

    pub fn bytes(&self) -> Vec<u8> {
        let meta = FileMetaTableBuilder::new()
            .transfer_syntax(self.syntax)
            .media_storage_sop_class_uid(uids::CT_IMAGE_STORAGE)
            .media_storage_sop_instance_uid("1.2.826.0.1.3680043.8.498.99");
        let mut bytes = Vec::new();
        let file = self.object.clone().with_meta(meta).unwrap();
        file.write_all(&mut bytes).unwrap();
        bytes
    }
}

/// Decimal strings of at most 16 characters.
fn joined(vectors: &[DVec3]) -> String {
    let numbers = vectors.iter().flat_map(|v| v.to_array());
    let numbers: Vec<String> = numbers.map(|n| format!("{n:.10}")).collect();
    numbers.join("\\")
}

/// The HU of voxel (x, y, z) of [`stack`]: no two alike in a hundred slices.
pub fn hu([x, y, z]: [usize; 3]) -> i16 {
    (x + 10 * y + 100 * (z % 100)) as i16 - 1000
}

pub const COLUMNS: u16 = 6;
pub const ROWS: u16 = 5;

/// A sound series of `n` axial slices 2 mm apart, in order.
pub fn stack(n: usize) -> Vec<SliceFile> {
    let slice = |z| {
        let samples: Vec<i16> = (0..usize::from(ROWS))
            .flat_map(|y| (0..usize::from(COLUMNS)).map(move |x| hu([x, y, z])))
            .collect();
        let mut file = SliceFile::new([COLUMNS, ROWS], &samples);
        file.at(DVec3::new(-10.0, -20.0, 30.0 + 2.0 * z as f64));
        file
    };
    (0..n).map(slice).collect()
}

/// The head of the program's tests as slices.
pub fn head_slices() -> Vec<SliceFile> {
    let bytes = nifti();
    let samples: Vec<i16> = bytes[352..]
        .chunks_exact(2)
        .map(|pair| i16::from_le_bytes([pair[0], pair[1]]))
        .collect();
    let [nx, ny, _] = DIMS;
    let slice = |(z, plane): (usize, &[i16])| {
        let mut file = SliceFile::new([nx as u16, ny as u16], plane);
        file.at(DVec3::new(-48.0, -48.0, -36.0 + SPACING * z as f64))
            .text(tags::PIXEL_SPACING, VR::DS, "1.5\\1.5");
        file
    };
    samples
        .chunks_exact(nx * ny)
        .enumerate()
        .map(slice)
        .collect()
}

/// A folder that goes away with the test.
pub struct Dir(tempfile::TempDir);

impl Dir {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// With files `0.dcm`, `1.dcm` …
    pub fn of(files: &[SliceFile]) -> Self {
        let dir = Self::new();
        for (index, file) in files.iter().enumerate() {
            dir.write(&format!("{index}.dcm"), &file.bytes());
        }
        dir
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    pub fn read(&self) -> Result<Scan, DicomError> {
        read(self.path(), None)
    }

    /// The message that reading ends with.
    #[track_caller]
    pub fn error(&self) -> String {
        match self.read() {
            Ok(scan) => panic!("was read: {:?}", scan.volume.grid()),
            Err(error) => error.to_string(),
        }
    }
}

pub fn read(path: &Path, uid: Option<&str>) -> Result<Scan, DicomError> {
    Folder::scan(path)?.choose(uid)?.read()
}

/// Every sample in HU, x fastest.
pub fn hus(volume: &AnyVolume) -> Vec<f64> {
    use rhinoplan::volume::Sample;
    with_volume!(volume, volume => {
        let rescale = volume.rescale();
        volume.as_slice().iter().map(|sample| rescale.to_hu(sample.to_f64())).collect()
    })
}

/// The HU of [`stack`], x fastest.
pub fn expected(n: usize) -> Vec<f64> {
    let mut all = Vec::new();
    for z in 0..n {
        for y in 0..usize::from(ROWS) {
            all.extend((0..usize::from(COLUMNS)).map(|x| f64::from(hu([x, y, z]))));
        }
    }
    all
}

/// Bytes in runs, each segment its own (PS3.5, annex G): of 16-bit samples the high bytes first.
pub fn rle(samples: &[i16]) -> Vec<u8> {
    let mut segments: Vec<Vec<u8>> = Vec::new();
    for byte in [1, 0] {
        let bytes: Vec<u8> = samples
            .iter()
            .map(|sample| sample.to_le_bytes()[byte])
            .collect();
        let mut packed = Vec::new();
        // A run of two, then single bytes: both kinds of code.
        let mut rest = bytes.as_slice();
        while let [first, tail @ ..] = rest {
            let run = rest
                .iter()
                .take(128)
                .take_while(|next| *next == first)
                .count();
            if run > 1 {
                packed.extend([(1 - run as i16) as i8 as u8, *first]);
                rest = &rest[run..];
            } else {
                packed.extend([0, *first]);
                rest = tail;
            }
        }
        if packed.len() % 2 == 1 {
            packed.push(0x80);
        }
        segments.push(packed);
    }
    let mut image = vec![0; 64];
    image[0] = 2;
    image[4..8].copy_from_slice(&64_u32.to_le_bytes());
    image[8..12].copy_from_slice(&(64 + segments[0].len() as u32).to_le_bytes());
    image.extend(segments.concat());
    image
}
