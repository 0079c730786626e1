//! The samples of a slice as little-endian bytes, whatever they are packed in.
//!
//! Decoders are the registry's. They allocate what a packed image says of itself, and keep quiet about one that
//! is smaller than its file says; so its own header is compared with the file's first.

use std::borrow::Cow;

use dicom_encoding::adapters::{PixelDataObject, RawPixelData};

use super::elements::{DataSet, Pixels};
use super::error::{SliceProblem, with_sources};
use super::panics::caught;
use super::slice::{Format, Slice};
use super::syntax::{Packing, Syntax};

/// The samples of a slice, from the bytes of its file and its data set, read up to the pixels.
///
/// # Errors
/// [`SliceProblem`] where there are fewer than rows and columns make, or the decoder refuses.
pub(super) fn stored<'a>(
    slice: &Slice,
    file: &'a [u8],
    data_set: DataSet<'_>,
) -> Result<Cow<'a, [u8]>, SliceProblem> {
    let expected = slice.format.plane_bytes();
    let wanted = usize::try_from(expected).unwrap_or(usize::MAX);
    let cut = |found: usize| SliceProblem::PixelLength {
        found: found as u64,
        expected,
    };
    let samples = match data_set.pixels {
        Pixels::Native {
            words,
            offset: Some(offset),
            ..
        } => {
            let swapped = words && data_set.is_big_endian();
            let start = usize::try_from(offset).unwrap_or(usize::MAX);
            let bytes = file.get(start..).unwrap_or_default();
            if swapped {
                // Words are swapped also where they hold two samples each.
                let mut bytes = bytes
                    .get(..wanted.next_multiple_of(2))
                    .unwrap_or(bytes)
                    .to_vec();
                for pair in bytes.chunks_exact_mut(2) {
                    pair.reverse();
                }
                Cow::Owned(bytes)
            } else {
                Cow::Borrowed(bytes)
            }
        }
        Pixels::Native { .. } => Cow::Owned(data_set.into_native(expected)?),
        Pixels::Encapsulated | Pixels::Absent => {
            Cow::Owned(unpack(slice, data_set.into_fragments()?)?)
        }
    };
    let found = samples.len();
    match samples {
        Cow::Borrowed(bytes) => bytes.get(..wanted).map(Cow::Borrowed),
        Cow::Owned(mut bytes) => (found >= wanted).then(|| {
            bytes.truncate(wanted);
            Cow::Owned(bytes)
        }),
    }
    .ok_or_else(|| cut(found))
}

fn unpack(slice: &Slice, mut fragments: Vec<Vec<u8>>) -> Result<Vec<u8>, SliceProblem> {
    let (format, syntax) = (slice.format, &slice.syntax);
    if syntax.packing == Packing::Fragments {
        return Ok(fragments.concat());
    }
    // One frame may lie in several fragments, except run-length encoded (PS3.5, A.4.2).
    let image = match fragments.len() {
        1 => fragments.swap_remove(0),
        _ => fragments.concat(),
    };
    match syntax.packing {
        Packing::Rle => check_rle(format, &image)?,
        Packing::Jpeg => check_size(Packed::of_jpeg(&image), format)?,
        Packing::Jpeg2000 => check_size(Packed::of_jpeg_2000(&image), format)?,
        _ => {}
    }
    let frame = Frame {
        format,
        syntax,
        image: &image,
    };
    let failed = |message: String| SliceProblem::Decode {
        syntax: syntax.to_string(),
        message,
    };
    let reader = syntax
        .elements()
        .and_then(|elements| elements.pixel_data_reader());
    let reader = reader.ok_or_else(|| failed("there is no decoder".to_owned()))?;
    let decoded = caught(|| {
        let mut bytes = Vec::new();
        reader.decode_frame(&frame, 0, &mut bytes).map(|()| bytes)
    });
    match decoded {
        Some(Ok(bytes)) => Ok(bytes),
        Some(Err(error)) => Err(failed(with_sources(&error))),
        None => Err(failed("it is damaged".to_owned())),
    }
}

/// What a decoder is given: one frame.
struct Frame<'a> {
    format: Format,
    syntax: &'a Syntax,
    image: &'a [u8],
}

impl PixelDataObject for Frame<'_> {
    fn transfer_syntax_uid(&self) -> &str {
        self.syntax.uid()
    }

    fn rows(&self) -> Option<u16> {
        u16::try_from(self.format.rows).ok()
    }

    fn cols(&self) -> Option<u16> {
        u16::try_from(self.format.columns).ok()
    }

    fn samples_per_pixel(&self) -> Option<u16> {
        Some(1)
    }

    fn bits_allocated(&self) -> Option<u16> {
        Some(self.format.allocated)
    }

    fn bits_stored(&self) -> Option<u16> {
        Some(self.format.stored)
    }

    fn photometric_interpretation(&self) -> Option<&str> {
        Some("MONOCHROME2")
    }

    fn number_of_frames(&self) -> Option<u32> {
        Some(1)
    }

    fn number_of_fragments(&self) -> Option<u32> {
        Some(1)
    }

    fn fragment(&self, fragment: usize) -> Option<Cow<'_, [u8]>> {
        (fragment == 0).then_some(Cow::Borrowed(self.image))
    }

    fn offset_table(&self) -> Option<Cow<'_, [u32]>> {
        None
    }

    fn raw_pixel_data(&self) -> Option<RawPixelData> {
        Some(RawPixelData {
            fragments: std::iter::once(self.image.to_vec()).collect(),
            offset_table: std::iter::empty().collect(),
        })
    }
}

/// Run-length encoded data begins with 64 bytes: how many segments there are, one for each byte of a sample,
/// and where they begin (PS3.5, G.5). The decoder allocates what is written there.
fn check_rle(format: Format, image: &[u8]) -> Result<(), SliceProblem> {
    let number = |at: usize| {
        let bytes = image.get(at..)?.first_chunk::<4>()?;
        Some(u32::from_le_bytes(*bytes))
    };
    let (Some(found), Some(first), Some(second), true) =
        (number(0), number(4), number(8), image.len() >= 64)
    else {
        return Err(SliceProblem::FragmentsCut);
    };
    let expected = u32::from(format.allocated / 8);
    let end = image.len() as u64;
    // Nothing is packed worse than one more byte for 128, but the decoder's memory is 64 times what there is.
    let longest = 1024 + format.plane_bytes() * 2;
    let second = if expected == 2 { second.into() } else { end };
    let ordered = 64 <= first && u64::from(first) <= second && second <= end;
    if found == expected && ordered && end <= longest {
        return Ok(());
    }
    Err(SliceProblem::Packed {
        found: format!("{found} run-length segments from {first} in {end} bytes"),
        expected: format!("{expected} from 64 in at most {longest} bytes"),
    })
}

/// What a packed image says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Packed {
    columns: u64,
    rows: u64,
    components: u64,
    bits: u16,
}

impl Packed {
    /// The first frame header of a JPEG stream (ITU-T T.81, B.2.2).
    fn of_jpeg(image: &[u8]) -> Option<Self> {
        let mut rest = image.strip_prefix(&[0xff, 0xd8])?;
        loop {
            let [0xff, marker, tail @ ..] = rest else {
                return None;
            };
            // Markers may be filled up in front.
            if *marker == 0xff {
                rest = rest.get(1..)?;
                continue;
            }
            let length = usize::from(u16::from_be_bytes(*tail.first_chunk()?));
            let segment = tail.get(2..length)?;
            // All SOF; DHT, JPG and DAC have numbers among them.
            if matches!(marker, 0xc0..=0xcf) && ![0xc4, 0xc8, 0xcc].contains(marker) {
                let &[bits, a, b, c, d, components, ..] = segment else {
                    return None;
                };
                return Some(Self {
                    columns: u16::from_be_bytes([c, d]).into(),
                    rows: u16::from_be_bytes([a, b]).into(),
                    components: components.into(),
                    bits: bits.into(),
                });
            }
            rest = tail.get(length..)?;
        }
    }

    /// The size marker of a JPEG 2000 codestream, which may lie in a file of its own kind (ISO/IEC 15444-1,
    /// A.5.1). The smallest subsampling is 1; larger ones give fewer samples than are expected.
    fn of_jpeg_2000(image: &[u8]) -> Option<Self> {
        let start = image
            .windows(4)
            .position(|four| four == [0xff, 0x4f, 0xff, 0x51])?;
        let size = image.get(start + 4..)?;
        let number = |at: usize| {
            let bytes = size.get(at..)?.first_chunk::<4>()?;
            Some(u64::from(u32::from_be_bytes(*bytes)))
        };
        let (width, height, left, top) = (number(4)?, number(8)?, number(12)?, number(16)?);
        let components = u16::from_be_bytes(*size.get(36..)?.first_chunk()?);
        let &[depth, across, down] = size.get(38..)?.first_chunk()?;
        if across != 1 || down != 1 {
            return None;
        }
        Some(Self {
            columns: width.checked_sub(left)?,
            rows: height.checked_sub(top)?,
            components: components.into(),
            bits: u16::from(depth & 0x7f) + 1,
        })
    }
}

/// Whether a packed image is the one that rows, columns and bits describe.
fn check_size(found: Option<Packed>, format: Format) -> Result<(), SliceProblem> {
    let expected = || {
        let Format {
            rows,
            columns,
            allocated,
            ..
        } = format;
        format!("{columns}×{rows} pixels, 1 component, {allocated}-bit samples")
    };
    let Some(found) = found else {
        return Err(SliceProblem::Packed {
            found: "no size that can be found".to_owned(),
            expected: expected(),
        });
    };
    let size = (found.columns, found.rows) == (format.columns as u64, format.rows as u64);
    // A decoder gives one byte for up to 8 bits, and two for more.
    let bytes = usize::from(found.bits.div_ceil(8)) == format.sample_bytes();
    if size && bytes && found.components == 1 {
        return Ok(());
    }
    let Packed {
        columns,
        rows,
        components,
        bits,
    } = found;
    Err(SliceProblem::Packed {
        found: format!("{columns}×{rows} pixels, {components} component(s), {bits} bits"),
        expected: expected(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jpeg_frame_is_found_behind_other_segments() {
        let stream = [
            0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xff, 0xc4, 0, 3, 9, 0xff, 0xc3, 0, 11, 16,
            1, 0, 0, 200, 1, 1, 0x11, 0,
        ];
        let expected = Packed {
            columns: 200,
            rows: 256,
            components: 1,
            bits: 16,
        };
        assert_eq!(Packed::of_jpeg(&stream), Some(expected));
        for end in 0..stream.len() - 5 {
            // Cut anywhere, it is nothing, and no panic.
            assert_eq!(Packed::of_jpeg(&stream[..end]), None);
        }
        assert_eq!(Packed::of_jpeg(&[0xff, 0xd8, 0xff, 0xe0, 0, 0]), None);
    }

    #[test]
    fn a_jpeg_2000_size_is_found_in_a_file_of_its_own_kind() {
        let mut stream = b"\0\0\0\x0cjP  ....".to_vec();
        stream.extend([0xff, 0x4f, 0xff, 0x51, 0, 41, 0, 0]);
        for number in [210_u32, 110, 10, 10, 64, 64, 0, 0] {
            stream.extend(number.to_be_bytes());
        }
        stream.extend([0, 1, 0x8b, 1, 1]);
        let expected = Packed {
            columns: 200,
            rows: 100,
            components: 1,
            bits: 12,
        };
        assert_eq!(Packed::of_jpeg_2000(&stream), Some(expected));
        for end in 0..stream.len() {
            assert_eq!(Packed::of_jpeg_2000(&stream[..end]), None);
        }
    }
}
