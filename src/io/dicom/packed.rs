//! What a packed image says of itself, held against what its file says of it.

use super::error::SliceProblem;
use super::slice::Format;

/// The marker segments of a JPEG stream, each its marker and what follows its length, to the first that is none:
/// behind the header of the first scan (ITU-T T.81, B.1.1).
pub(super) struct Segments<'a>(&'a [u8]);

impl<'a> Segments<'a> {
    /// None where the stream does not begin as one.
    pub(super) fn of(image: &'a [u8]) -> Option<Self> {
        image.strip_prefix(&[0xff, 0xd8]).map(Self)
    }
}

impl<'a> Iterator for Segments<'a> {
    type Item = (u8, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let [0xff, marker, tail @ ..] = self.0 else {
                return None;
            };
            // Markers may be filled up in front.
            if *marker == 0xff {
                self.0 = self.0.get(1..)?;
                continue;
            }
            let length = usize::from(u16::from_be_bytes(*tail.first_chunk()?));
            let segment = tail.get(2..length)?;
            self.0 = tail.get(length..)?;
            return Some((*marker, segment));
        }
    }
}

/// What a packed image says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Packed {
    pub(super) columns: u64,
    pub(super) rows: u64,
    pub(super) components: u64,
    pub(super) bits: u16,
}

impl Packed {
    /// The first frame header of a JPEG stream (ITU-T T.81, B.2.2).
    pub(super) fn of_jpeg(image: &[u8]) -> Option<Self> {
        // All SOF; DHT, JPG and DAC have numbers among them.
        let frame = |marker| matches!(marker, 0xc0..=0xcf) && ![0xc4, 0xc8, 0xcc].contains(&marker);
        let (_, segment) = Segments::of(image)?.find(|(marker, _)| frame(*marker))?;
        Self::of_frame_header(segment)
    }

    /// Of JPEG and JPEG-LS alike.
    pub(super) fn of_frame_header(segment: &[u8]) -> Option<Self> {
        let &[bits, a, b, c, d, components, ..] = segment else {
            return None;
        };
        Some(Self {
            columns: u16::from_be_bytes([c, d]).into(),
            rows: u16::from_be_bytes([a, b]).into(),
            components: components.into(),
            bits: bits.into(),
        })
    }

    /// The size marker of a JPEG 2000 codestream, which may lie in a file of its own kind (ISO/IEC 15444-1,
    /// A.5.1). The smallest subsampling is 1; larger ones give fewer samples than are expected.
    pub(super) fn of_jpeg_2000(image: &[u8]) -> Option<Self> {
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
pub(super) fn check_size(found: Option<Packed>, format: Format) -> Result<(), SliceProblem> {
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

/// How many scans a JPEG of one component may have. Encoders make up to ten; a scan of a few bytes, of which a file
/// may have thousands, can take a pass over all blocks.
const MAX_SCANS: usize = 100;

/// Whether a JPEG is the one that rows, columns and bits describe, and no endless one. Returns the bits of its
/// samples.
pub(super) fn check_jpeg(image: &[u8], format: Format) -> Result<u16, SliceProblem> {
    let found = Packed::of_jpeg(image);
    check_size(found, format)?;
    // Within a scan, 0xff is followed by 0 or a restart marker.
    let scans = image.windows(2).filter(|two| *two == [0xff, 0xda]).count();
    if scans <= MAX_SCANS {
        return Ok(found.map_or(0, |found| found.bits));
    }
    Err(SliceProblem::Packed {
        found: format!("{scans} scans"),
        expected: format!("at most {MAX_SCANS}"),
    })
}

/// Whether samples of so many bits hold the sign, which is the highest bit that is stored.
pub(super) fn check_sign(bits: u16, format: Format) -> Result<(), SliceProblem> {
    if !format.signed || bits >= format.stored {
        return Ok(());
    }
    Err(SliceProblem::Packed {
        found: format!("samples of {bits} bits"),
        expected: format!("{} bits, of which the highest is the sign", format.stored),
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
