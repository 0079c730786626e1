//! The samples of a slice as little-endian bytes, whatever they are packed in.
//!
//! Decoders are the registry's, but for JPEG-LS and JPEG XL. They allocate what a packed image says of itself, and
//! keep quiet about one that is smaller than its file says; so its own header is compared with the file's first.

use std::borrow::Cow;
use std::io::Read;

use dicom_encoding::adapters::{PixelDataObject, RawPixelData};
use flate2::read::DeflateDecoder;

use super::elements::{DataSet, Pixels};
use super::error::{SliceProblem, with_sources};
use super::packed::{Packed, check_jpeg, check_size};
use super::panics::caught;
use super::slice::{Format, Slice};
use super::syntax::{Packing, Syntax};
use super::{jpeg_ls, jpeg_xl};

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
        Packing::DeflatedFrame => return inflate(format, syntax, &image),
        Packing::Rle => check_rle(format, &image)?,
        Packing::Jpeg => {
            let bits = check_jpeg(&image, format)?;
            if syntax.lossy && bits > 8 {
                return Err(SliceProblem::Syntax {
                    syntax: format!("{syntax} of {bits} bits"),
                    unpacked_by: syntax.unpacked_by(),
                });
            }
        }
        Packing::Jpeg2000 => check_size(Packed::of_jpeg_2000(&image), format)?,
        Packing::JpegLs => return jpeg_ls::decode(format, syntax, &image),
        Packing::JpegXl => {
            return match jpeg_xl::decode(format, syntax, &image)? {
                jpeg_xl::Decoded::Samples(samples) => Ok(samples),
                jpeg_xl::Decoded::Jpeg(jpeg) => {
                    check_jpeg(&jpeg, format)?;
                    by_registry(format, syntax, &jpeg)
                }
            };
        }
        _ => {}
    }
    by_registry(format, syntax, &image)
}

/// What the registry's decoder makes of an image that its file says is packed as `syntax`.
fn by_registry(format: Format, syntax: &Syntax, image: &[u8]) -> Result<Vec<u8>, SliceProblem> {
    let frame = Frame {
        format,
        syntax,
        image,
    };
    let failed = |message: String| SliceProblem::Decode {
        syntax: syntax.to_string(),
        message,
    };
    let reader_of = |of: &Syntax| of.elements()?.pixel_data_reader();
    // One decoder reads all kinds of JPEG, but the registry has no entry for retired ones, or one within JPEG XL.
    let reader = reader_of(syntax).or_else(|| reader_of(&Syntax::jpeg_baseline()));
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

/// As many bytes of a deflated frame (RFC 1951; a zero may follow) as rows, columns and bits make.
fn inflate(format: Format, syntax: &Syntax, image: &[u8]) -> Result<Vec<u8>, SliceProblem> {
    let mut bytes = Vec::new();
    DeflateDecoder::new(image)
        .take(format.plane_bytes())
        .read_to_end(&mut bytes)
        .map_err(|error| SliceProblem::Decode {
            syntax: syntax.to_string(),
            message: error.to_string(),
        })?;
    Ok(bytes)
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
