//! One file: a slice of a CT, or a reason to leave it out.

use std::fmt;

use glam::DVec3;

use super::elements::{self as el, DataSet, Pixels};
use super::error::SliceProblem;
use super::syntax::{Packing, Syntax};
use crate::space::MAX_AXIS_LENGTH;
use crate::volume::{Rescale, SampleType};

/// How far the axes of an image may be from length 1 and from perpendicular. They are written with at least
/// four digits; the grid's own tolerance is the same.
const AXES_TOLERANCE: f64 = 1e-3;

/// The largest file that is read, bytes: no slice takes more, and this much is held for each thread.
pub(super) const MAX_FILE_BYTES: u64 = 256 << 20;

/// How many bytes of pixels one byte of a file may stand for. Deflate packs up to 1032 into one, JPEG 2000 an
/// empty slice of 512 × 512 into some hundreds; what claims more is damaged.
const LARGEST_RATIO: u64 = 2048;

/// Why a file is no slice of a CT.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Skip {
    /// A folder in the folder: not searched.
    Folder,
    /// A pipe, a socket or a device: not opened.
    Special,
    /// A link that leads nowhere.
    DanglingLink,
    /// Not a DICOM file.
    NotDicom,
    /// The list of an exchange medium.
    DicomDir,
    /// Another modality, as far as it is a word of the standard's kind.
    Modality(String),
    /// A scout view.
    Localizer,
    /// A picture of a screen.
    SecondaryCapture,
    /// An enhanced CT, or another image of several frames.
    MultiFrame,
    /// No image, or another kind of image.
    OtherClass,
    /// One slice alone beside a stack.
    Single,
}

impl fmt::Display for Skip {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self {
            Self::Folder => "a folder within the folder, which is not searched",
            Self::Special => "a pipe, a socket or a device",
            Self::DanglingLink => "a link that leads nowhere",
            Self::NotDicom => "no DICOM file",
            Self::DicomDir => "a DICOMDIR",
            Self::Modality(modality) => return write!(to, "of modality {modality}, not CT"),
            Self::Localizer => "a localizer",
            Self::SecondaryCapture => "a secondary capture",
            Self::MultiFrame => {
                "of several frames (Enhanced CT), which rhinoplan does not read; convert it to single \
                 frames or to NIfTI"
            }
            Self::OtherClass => "no CT image",
            Self::Single => "a single slice",
        })
    }
}

/// What is known of the series that a file belongs to.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct Membership {
    pub(super) uid: String,
    pub(super) modality: String,
    pub(super) number: Option<String>,
}

/// What a file turned out to be.
#[derive(Debug)]
pub(super) enum Kind {
    Slice(Box<Slice>),
    Skipped(Skip),
    Faulty(SliceProblem),
}

/// How a slice's samples are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Format {
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// 8 or 16.
    pub(super) allocated: u16,
    /// 1 to `allocated`.
    pub(super) stored: u16,
    /// How far the stored bits are above bit 0.
    pub(super) shift: u16,
    pub(super) signed: bool,
}

impl Format {
    pub(super) fn sample_bytes(self) -> usize {
        usize::from(self.allocated / 8)
    }

    /// At most 32767² × 2, which fits.
    pub(super) fn plane_bytes(self) -> u64 {
        self.rows as u64 * self.columns as u64 * self.sample_bytes() as u64
    }

    pub(super) fn sample_type(self) -> SampleType {
        match (self.allocated, self.signed) {
            (8, false) => SampleType::U8,
            (8, true) => SampleType::I8,
            (_, false) => SampleType::U16,
            (_, true) => SampleType::I16,
        }
    }

    /// The value that the bits of a sample stand for: those above the highest that is stored may be an overlay.
    pub(super) fn value(self, raw: u16) -> i32 {
        let bits = u32::from(self.stored);
        let value = (u32::from(raw) >> self.shift) & ((1 << bits) - 1);
        if self.signed {
            // The sign bit, moved to the top and back.
            (value << (32 - bits)).cast_signed() >> (32 - bits)
        } else {
            value.cast_signed()
        }
    }

    /// The smallest and largest value that can be stored.
    pub(super) fn range(self) -> (f64, f64) {
        let steps = f64::from(1_u32 << self.stored);
        if self.signed {
            (-steps / 2.0, steps / 2.0 - 1.0)
        } else {
            (0.0, steps - 1.0)
        }
    }
}

/// A slice, all but its pixels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Slice {
    pub(super) format: Format,
    /// Centre of the first pixel, LPS mm.
    pub(super) position: DVec3,
    /// Along a row, from column to column: a unit vector, LPS.
    pub(super) along_row: DVec3,
    /// Along a column, from row to row.
    pub(super) along_column: DVec3,
    /// Between columns, and between rows, mm.
    pub(super) spacing: [f64; 2],
    pub(super) rescale: Rescale,
    /// Stored values, first to last, that are no measurement.
    pub(super) padding: Option<(i32, i32)>,
    pub(super) syntax: Syntax,
    /// Whether the file says that its pixels are not what the scanner made.
    pub(super) lossy: bool,
}

impl Slice {
    /// Towards where slices are stacked: from row to column by the right hand.
    pub(super) fn normal(&self) -> DVec3 {
        self.along_row.cross(self.along_column)
    }
}

/// What a file of `len` bytes is.
pub(super) fn classify(data_set: &DataSet<'_>, len: u64) -> (Membership, Kind) {
    let member = Membership {
        uid: plain(data_set, el::SERIES_INSTANCE_UID),
        modality: plain(data_set, el::MODALITY),
        number: Some(plain(data_set, el::SERIES_NUMBER)).filter(|number| !number.is_empty()),
    };
    let kind = match kind(data_set, &member, len) {
        Ok(kind) => kind,
        Err(problem) => Kind::Faulty(problem),
    };
    (member, kind)
}

/// Text to tell series apart and show; what is no text is none.
fn plain(data_set: &DataSet<'_>, of: el::Attribute) -> String {
    let text = data_set.text(of).ok().flatten().unwrap_or_default();
    text.chars()
        .filter(|c| c.is_ascii_graphic())
        .take(64)
        .collect()
}

const DICOMDIR: &str = "1.2.840.10008.1.3.10";
const CT_IMAGE: &str = "1.2.840.10008.5.1.4.1.1.2";
/// Of Enhanced CT and Legacy Converted Enhanced CT.
const ENHANCED: [&str; 2] = ["1.2.840.10008.5.1.4.1.1.2.1", "1.2.840.10008.5.1.4.1.1.2.2"];
/// Of Secondary Capture, and, with a point and a number, of its kinds of several frames.
const SECONDARY_CAPTURE: &str = "1.2.840.10008.5.1.4.1.1.7";

fn kind(data_set: &DataSet<'_>, member: &Membership, len: u64) -> Result<Kind, SliceProblem> {
    if data_set.media_class == DICOMDIR {
        return Ok(Kind::Skipped(Skip::DicomDir));
    }
    let class = plain(data_set, el::SOP_CLASS_UID);
    if class.starts_with(SECONDARY_CAPTURE) {
        return Ok(Kind::Skipped(Skip::SecondaryCapture));
    }
    if member.modality != "CT" {
        let word = member
            .modality
            .chars()
            .filter(char::is_ascii_uppercase)
            .take(16);
        let word: String = word.collect();
        let none = word.is_empty();
        let modality = if none { "unknown".to_owned() } else { word };
        return Ok(Kind::Skipped(Skip::Modality(modality)));
    }
    let frames = data_set.decimals::<1>(el::NUMBER_OF_FRAMES)?;
    if ENHANCED.contains(&class.as_str()) || frames.is_some_and(|[frames]| frames > 1.0) {
        return Ok(Kind::Skipped(Skip::MultiFrame));
    }
    if !class.is_empty() && class != CT_IMAGE {
        return Ok(Kind::Skipped(Skip::OtherClass));
    }
    let image_type = data_set.text(el::IMAGE_TYPE)?.unwrap_or_default();
    if image_type
        .split('\\')
        .any(|word| word.trim() == "LOCALIZER")
    {
        return Ok(Kind::Skipped(Skip::Localizer));
    }
    if member.uid.is_empty() {
        return Err(el::SERIES_INSTANCE_UID.missing());
    }
    Ok(Kind::Slice(Box::new(slice(data_set, len)?)))
}

fn slice(data_set: &DataSet<'_>, len: u64) -> Result<Slice, SliceProblem> {
    let format = format(data_set)?;
    let syntax = data_set.syntax.clone();
    check_pixels(data_set, format, len)?;
    let position = data_set
        .decimals::<3>(el::IMAGE_POSITION_PATIENT)?
        .ok_or_else(|| el::IMAGE_POSITION_PATIENT.missing())?;
    let [a, b, c, d, e, f] = data_set
        .decimals::<6>(el::IMAGE_ORIENTATION_PATIENT)?
        .ok_or_else(|| el::IMAGE_ORIENTATION_PATIENT.missing())?;
    let (row, column) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
    let lengths = [row.length(), column.length()];
    let cosine = row.normalize_or_zero().dot(column.normalize_or_zero());
    let unit = lengths.iter().all(|l| (l - 1.0).abs() <= AXES_TOLERANCE);
    if !unit || cosine.abs() > AXES_TOLERANCE {
        return Err(SliceProblem::Orientation {
            row: lengths[0],
            column: lengths[1],
            angle_deg: libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees(),
        });
    }
    let spacing = data_set
        .decimals::<2>(el::PIXEL_SPACING)?
        .ok_or_else(|| el::PIXEL_SPACING.missing())?;
    if spacing.iter().any(|&spacing| spacing <= 0.0) {
        let found = format!("{}\\{}", spacing[0], spacing[1]);
        return Err(el::PIXEL_SPACING.refuse(found, "two spacings above 0 mm"));
    }
    let [between_rows, between_columns] = spacing;
    let lossy = syntax.lossy || data_set.text(el::LOSSY_IMAGE_COMPRESSION)? == Some("01");
    Ok(Slice {
        format,
        position: DVec3::from_array(position),
        along_row: row.normalize(),
        along_column: column.normalize(),
        spacing: [between_columns, between_rows],
        rescale: rescale(data_set)?,
        padding: padding(data_set, format)?,
        syntax,
        lossy,
    })
}

fn format(data_set: &DataSet<'_>) -> Result<Format, SliceProblem> {
    let word = |of: el::Attribute| data_set.word(of)?.ok_or_else(|| of.missing());
    let length = |of: el::Attribute| match usize::from(word(of)?) {
        length @ 1..=MAX_AXIS_LENGTH => Ok(length),
        other => Err(of.refuse(other, format!("1 to {MAX_AXIS_LENGTH}"))),
    };
    let (rows, columns) = (length(el::ROWS)?, length(el::COLUMNS)?);
    let samples = data_set.word(el::SAMPLES_PER_PIXEL)?.unwrap_or(1);
    if samples != 1 {
        return Err(el::SAMPLES_PER_PIXEL.refuse(samples, "1: a CT has no colours"));
    }
    // CT Image Storage asks for it; where it is left out, MONOCHROME2 is what a CT is.
    let meaning = data_set.text(el::PHOTOMETRIC_INTERPRETATION)?;
    if let Some(other) = meaning.filter(|&meaning| meaning != "MONOCHROME2") {
        return Err(el::PHOTOMETRIC_INTERPRETATION.refuse(other, "MONOCHROME2"));
    }
    let allocated = word(el::BITS_ALLOCATED)?;
    if allocated != 8 && allocated != 16 {
        return Err(el::BITS_ALLOCATED.refuse(allocated, "8 or 16"));
    }
    let stored = data_set.word(el::BITS_STORED)?.unwrap_or(allocated);
    if !(1..=allocated).contains(&stored) {
        return Err(el::BITS_STORED.refuse(stored, format!("1 to {allocated}, the bits allocated")));
    }
    let high = data_set.word(el::HIGH_BIT)?.unwrap_or(stored - 1);
    if !(stored - 1..allocated).contains(&high) {
        let expected = format!("{} to {}", stored - 1, allocated - 1);
        return Err(el::HIGH_BIT.refuse(high, expected));
    }
    let signed = match word(el::PIXEL_REPRESENTATION)? {
        0 => false,
        1 => true,
        other => {
            let expected = "0 (unsigned) or 1 (signed)";
            return Err(el::PIXEL_REPRESENTATION.refuse(other, expected));
        }
    };
    Ok(Format {
        rows,
        columns,
        allocated,
        stored,
        shift: high + 1 - stored,
        signed,
    })
}

/// Whether a file of `len` bytes can hold the pixels that rows and columns claim.
fn check_pixels(data_set: &DataSet<'_>, format: Format, len: u64) -> Result<(), SliceProblem> {
    let expected = format.plane_bytes();
    if data_set.syntax.packing == Packing::Unknown {
        return Err(SliceProblem::Syntax {
            syntax: data_set.syntax.to_string(),
            unpacked_by: data_set.syntax.unpacked_by(),
        });
    }
    let plausible = len.saturating_mul(LARGEST_RATIO) >= expected && expected <= MAX_FILE_BYTES;
    match (data_set.pixels, data_set.syntax.packing) {
        (Pixels::Absent, _) => Err(SliceProblem::Missing {
            element: "PixelData (7FE0,0010)",
        }),
        (
            Pixels::Native {
                len: pixels,
                offset,
                ..
            },
            Packing::Native | Packing::Deflated,
        ) => {
            let pixels = u64::from(pixels);
            // One more where an odd number of bytes is padded.
            if pixels != expected && pixels != expected + expected % 2 {
                return Err(SliceProblem::PixelLength {
                    found: pixels,
                    expected,
                });
            }
            match offset {
                Some(offset) if offset.saturating_add(expected) > len => {
                    Err(SliceProblem::PixelLength {
                        found: len.saturating_sub(offset),
                        expected,
                    })
                }
                None if !plausible => Err(SliceProblem::Implausible {
                    found: len,
                    expected,
                }),
                _ => Ok(()),
            }
        }
        (Pixels::Encapsulated, Packing::Native | Packing::Deflated)
        | (Pixels::Native { .. }, _) => Err(SliceProblem::Damaged(format!(
            "its pixels are not packed as its transfer syntax says, {}",
            data_set.syntax
        ))),
        (Pixels::Encapsulated, _) if !plausible => Err(SliceProblem::Implausible {
            found: len,
            expected,
        }),
        (Pixels::Encapsulated, _) => Ok(()),
    }
}

fn rescale(data_set: &DataSet<'_>) -> Result<Rescale, SliceProblem> {
    // Of original images the unit is always HU. US is "unspecified", HU_MOD of two energies.
    let unit = data_set.text(el::RESCALE_TYPE)?;
    if let Some(other) = unit.filter(|unit| !["HU", "HU_MOD", "US"].contains(unit)) {
        return Err(
            el::RESCALE_TYPE.refuse(other, "HU: what is measured here are Hounsfield units")
        );
    }
    // Left out, they are 1 and 0, as in ITK.
    let [slope] = data_set.decimals(el::RESCALE_SLOPE)?.unwrap_or([1.0]);
    let [intercept] = data_set.decimals(el::RESCALE_INTERCEPT)?.unwrap_or([0.0]);
    // A NIfTI header, which outputs have, keeps them as single-precision numbers.
    let kept = slope as f32;
    if kept == 0.0 || !kept.is_finite() {
        return Err(el::RESCALE_SLOPE.refuse(slope, "a slope other than 0"));
    }
    if !(intercept as f32).is_finite() {
        return Err(el::RESCALE_INTERCEPT.refuse(intercept, "a number of Hounsfield units"));
    }
    Ok(Rescale { slope, intercept })
}

fn padding(data_set: &DataSet<'_>, format: Format) -> Result<Option<(i32, i32)>, SliceProblem> {
    // Read by the pixels' own sign, whatever the element's type: some scanners write one as the other.
    let value = |of| -> Result<_, SliceProblem> {
        let word = data_set.word(of)?;
        Ok(word.map(|word| match format.signed {
            true => i32::from(word.cast_signed()),
            false => i32::from(word),
        }))
    };
    let Some(first) = value(el::PIXEL_PADDING_VALUE)? else {
        return Ok(None);
    };
    let last = value(el::PIXEL_PADDING_RANGE_LIMIT)?.unwrap_or(first);
    Ok(Some((first.min(last), first.max(last))))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWELVE: Format = Format {
        rows: 1,
        columns: 1,
        allocated: 16,
        stored: 12,
        shift: 0,
        signed: false,
    };

    #[test]
    fn bits_outside_of_those_stored_are_left_out() {
        assert_eq!(TWELVE.value(0xf123), 0x123);
        assert_eq!(TWELVE.value(0x0fff), 4095);
        let high = Format { shift: 4, ..TWELVE };
        assert_eq!(high.value(0x123f), 0x123);
        assert_eq!(TWELVE.range(), (0.0, 4095.0));
    }

    #[test]
    fn signs_are_extended_from_the_highest_bit_stored() {
        let signed = Format {
            signed: true,
            ..TWELVE
        };
        for (raw, value) in [(0x0800, -2048), (0x0fff, -1), (0xf7ff, 2047), (0, 0)] {
            assert_eq!(signed.value(raw), value, "{raw:#x}");
        }
        assert_eq!(signed.range(), (-2048.0, 2047.0));
        let whole = Format {
            stored: 16,
            ..signed
        };
        assert_eq!(whole.value(0x8000), -32768);
        let byte = Format {
            allocated: 8,
            stored: 8,
            ..signed
        };
        assert_eq!(byte.value(0xff), -1);
    }
}
