//! Two pictures as one.

use image::{Rgb, RgbImage};

use super::PictureError;
use super::canvas::{checked_size, overlay};
use super::overlay::GROUND;
use super::svg::{Anchor, Svg, TextStyle};
use super::text::elide;

/// Height of the strip that the labels stand in, pixels.
const HEADER: u32 = 28;
const SEPARATOR: u32 = 2;
const LINE: [u8; 3] = [110, 110, 120];
const INK: [u8; 3] = [236, 236, 240];

/// Two pictures beside each other, a thin line between them, each under its label (as "before" and "after").
/// Pictures of different heights are aligned at the top.
///
/// # Errors
/// [`PictureError::Size`] where they are empty or too large together.
pub fn side_by_side(
    left: &RgbImage,
    right: &RgbImage,
    labels: [&str; 2],
) -> Result<RgbImage, PictureError> {
    let width = u64::from(left.width()) + u64::from(SEPARATOR) + u64::from(right.width());
    let height = u64::from(left.height().max(right.height())) + u64::from(HEADER);
    let (width, height) = checked_size(width, height)?;
    let mut image = RgbImage::from_pixel(width, height, Rgb(GROUND));
    let second = left.width() + SEPARATOR;
    for (picture, start) in [(left, 0), (right, second)] {
        for (x, y, pixel) in picture.enumerate_pixels() {
            image.put_pixel(start + x, HEADER + y, *pixel);
        }
    }
    for x in left.width()..second {
        for y in 0..height {
            image.put_pixel(x, y, Rgb(LINE));
        }
    }
    let mut svg = Svg::new(width, height);
    for (label, picture, start) in [(labels[0], left, 0), (labels[1], right, second)] {
        let style = TextStyle {
            size: 14.0,
            colour: INK,
            anchor: Anchor::Middle,
            halo: None,
        };
        let middle = f64::from(start) + f64::from(picture.width()) / 2.0;
        let label = elide(label, style.size, f64::from(picture.width()) - 8.0);
        svg.text([middle, 19.0], &label, style);
    }
    overlay(&mut image, &svg.finish())?;
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_pictures_are_kept_pixel_by_pixel() {
        let left = RgbImage::from_fn(60, 40, |x, y| Rgb([x as u8, y as u8, 0]));
        let right = RgbImage::from_fn(50, 30, |x, y| Rgb([x as u8, y as u8, 255]));
        let pair = side_by_side(&left, &right, ["before", "after"]).unwrap();
        assert_eq!(pair.dimensions(), (112, 68));
        assert!(
            left.enumerate_pixels()
                .all(|(x, y, p)| pair.get_pixel(x, y + HEADER) == p)
        );
        assert!(
            right
                .enumerate_pixels()
                .all(|(x, y, p)| pair.get_pixel(x + 62, y + HEADER) == p)
        );
        assert_eq!(pair.get_pixel(60, 50).0, LINE);
        assert_eq!(pair.get_pixel(100, 67).0, GROUND);
        let lit = |from: u32, to: u32| {
            (from..to).any(|x| (0..HEADER).any(|y| pair.get_pixel(x, y).0[0] > 200))
        };
        assert!(lit(0, 60) && lit(62, 112));
    }
}
