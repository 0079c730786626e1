//! JPEG-LS (ITU-T T.87) of one component.

use super::error::{SliceProblem, with_sources};
use super::packed::{Packed, Segments, check_sign, check_size};
use super::panics::caught;
use super::slice::Format;
use super::syntax::Syntax;

/// The samples of an image as little-endian bytes.
///
/// # Errors
/// [`SliceProblem`] where the image is not the one that the file describes, has lost what the syntax promises to
/// keep, or is damaged.
pub(super) fn decode(
    format: Format,
    syntax: &Syntax,
    image: &[u8],
) -> Result<Vec<u8>, SliceProblem> {
    let failed = |message: String| SliceProblem::Decode {
        syntax: syntax.to_string(),
        message,
    };
    let damaged = || failed("it is damaged".to_owned());
    let (frame, scan) = headers(image);
    check_size(frame, format)?;
    check_sign(frame.map_or(0, |frame| frame.bits), format)?;
    let scan = scan.ok_or_else(damaged)?;
    if scan.near > 0 && syntax.is_lossless() {
        return Err(SliceProblem::Packed {
            found: format!("samples that are off by up to {}", scan.near),
            expected: "lossless ones".to_owned(),
        });
    }
    if !scan.plain {
        return Err(failed(
            "its samples are shifted or numbers of a table".to_owned(),
        ));
    }
    let (Ok(columns), Ok(rows)) = (u32::try_from(format.columns), u32::try_from(format.rows))
    else {
        return Err(damaged());
    };
    let (samples, ..) = caught(|| jpegls::decode(image, columns, rows))
        .ok_or_else(damaged)?
        .map_err(|error| failed(with_sources(&error)))?;
    if format.sample_bytes() == 2 {
        return Ok(samples.into_iter().flat_map(u16::to_le_bytes).collect());
    }
    // A second frame header may say more bits than the first.
    let bytes: Result<Vec<u8>, _> = samples.into_iter().map(u8::try_from).collect();
    bytes.map_err(|_| damaged())
}

/// What the header of a scan says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Scan {
    /// How far a sample may be off.
    near: u8,
    /// Whether samples are what is coded: not numbers of entries of a table, and not shifted, neither of which the
    /// decoder looks at (C.2.3).
    plain: bool,
}

/// What the headers of the frame and its first scan say.
fn headers(image: &[u8]) -> (Option<Packed>, Option<Scan>) {
    let (mut frame, mut scan) = (None, None);
    for (marker, segment) in Segments::of(image).into_iter().flatten() {
        match (marker, segment) {
            (0xf7, _) if frame.is_none() => frame = Packed::of_frame_header(segment),
            (0xda, &[1, _, table, near, _, shift, ..]) => {
                let plain = table == 0 && shift == 0;
                scan = Some(Scan { near, plain });
                break;
            }
            (0xda, _) => break,
            _ => {}
        }
    }
    (frame, scan)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_found_and_cut_anywhere_they_are_none() {
        let image = [
            0xff, 0xd8, 0xff, 0xe8, 0, 4, 9, 9, 0xff, 0xf7, 0, 11, 12, 0, 5, 0, 6, 1, 1, 0x11, 0,
            0xff, 0xda, 0, 8, 1, 1, 0, 3, 0, 0, 0x80,
        ];
        let frame = Packed {
            columns: 6,
            rows: 5,
            components: 1,
            bits: 12,
        };
        let scan = Scan {
            near: 3,
            plain: true,
        };
        assert_eq!(headers(&image), (Some(frame), Some(scan)));
        for end in 0..image.len() - 1 {
            let (frame, scan) = headers(&image[..end]);
            assert_eq!(frame.is_some(), end >= 21, "{end}");
            assert_eq!(scan, None, "{end}");
        }
        for at in [27, 30] {
            let mut other = image;
            other[at] = 1;
            assert!(!headers(&other).1.unwrap().plain);
        }
    }
}
