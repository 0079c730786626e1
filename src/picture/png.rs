//! Pictures as files.

use std::io::Cursor;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, RgbImage};

use super::PictureError;

/// A picture as a PNG file: 8-bit RGB, no text, no time, the same bytes for the same pixels.
///
/// # Errors
/// [`PictureError::Png`], for a picture without pixels.
pub fn encode_png(image: &RgbImage) -> Result<Vec<u8>, PictureError> {
    let mut file = Vec::new();
    let (width, height) = image.dimensions();
    PngEncoder::new_with_quality(&mut file, CompressionType::Default, FilterType::Adaptive)
        .write_image(image.as_raw(), width, height, ExtendedColorType::Rgb8)?;
    Ok(file)
}

/// The picture of a PNG file that this program wrote; none where it is none, or larger than any of those.
pub fn decode_png(bytes: &[u8]) -> Option<RgbImage> {
    let mut reader = image::ImageReader::with_format(Cursor::new(bytes), image::ImageFormat::Png);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(1 << 15);
    limits.max_image_height = Some(1 << 15);
    limits.max_alloc = Some(256 << 20);
    reader.limits(limits);
    Some(reader.decode().ok()?.to_rgb8())
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// The names of a PNG's chunks.
    fn chunks(file: &[u8]) -> Vec<String> {
        let mut names = Vec::new();
        let mut at = 8;
        while at < file.len() {
            let length = u32::from_be_bytes(file[at..at + 4].try_into().unwrap()) as usize;
            names.push(String::from_utf8(file[at + 4..at + 8].to_vec()).unwrap());
            at += 12 + length;
        }
        names.dedup();
        names
    }

    #[test]
    fn a_file_holds_the_pixels_and_nothing_else() {
        let image = RgbImage::from_fn(37, 21, |x, y| Rgb([(x * 7) as u8, (y * 11) as u8, 9]));
        let file = encode_png(&image).unwrap();
        assert_eq!(chunks(&file), ["IHDR", "IDAT", "IEND"]);
        assert_eq!(image::load_from_memory(&file).unwrap().to_rgb8(), image);
        assert_eq!(encode_png(&image).unwrap(), file);
    }
}
