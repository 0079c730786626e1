//! Two pictures, pixel by pixel; and where they differ, both beside their difference.

use std::fmt;

use image::{Rgb, RgbImage};

/// A channel may be off by this much of 255. The program gives the same bytes on every x86-64 machine; on
/// another one, or after a change of arithmetic that is none of results, a shade may be rounded the other
/// way.
pub const CHANNEL: u8 = 8;

/// The share of pixels that may be off by more: those at an edge of which one of the four samples fell on the
/// other side. A face that moves by a pixel changes more than ten times as many (a test in `main.rs`).
pub const SHARE: f64 = 0.001;

/// Brightness of what is off by one in the difference; what is off by more than [`CHANNEL`] is red.
const GAIN: u8 = 16;
const OFF: Rgb<u8> = Rgb([255, 40, 40]);
/// Between the three parts.
const GAP: u32 = 4;
const GROUND: Rgb<u8> = Rgb([70, 90, 120]);

/// What is wrong with a picture.
#[derive(Debug, Clone, PartialEq)]
pub enum Difference {
    /// Widths and heights, expected and actual.
    Size([(u32, u32); 2]),
    /// Pixels that are off by more than [`CHANNEL`], and the furthest that one is.
    Pixels { off: usize, of: usize, worst: u8 },
}

impl fmt::Display for Difference {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size([(width, height), (w, h)]) => {
                write!(to, "{w} x {h} pixels, expected {width} x {height}")
            }
            Self::Pixels { off, of, worst } => write!(
                to,
                "{off} of {of} pixels are off by more than {CHANNEL} of 255, the worst by {worst}; at most {} may be",
                allowed(*of)
            ),
        }
    }
}

fn allowed(pixels: usize) -> usize {
    (SHARE * pixels as f64) as usize
}

/// The largest difference of two pixels' channels.
fn apart(a: Rgb<u8>, b: Rgb<u8>) -> u8 {
    let channels = a.0.iter().zip(b.0);
    channels.map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
}

/// What is wrong with `actual`, if anything is.
pub fn compare(expected: &RgbImage, actual: &RgbImage) -> Result<(), Difference> {
    let sizes = [expected.dimensions(), actual.dimensions()];
    if sizes[0] != sizes[1] {
        return Err(Difference::Size(sizes));
    }
    let pixels = expected.pixels().zip(actual.pixels());
    let (mut off, mut of, mut worst) = (0, 0, 0);
    for (a, b) in pixels {
        let apart = apart(*a, *b);
        of += 1;
        off += usize::from(apart > CHANNEL);
        worst = worst.max(apart);
    }
    if off > allowed(of) {
        return Err(Difference::Pixels { off, of, worst });
    }
    Ok(())
}

/// Expected | actual | difference. Where one of them has no pixel, the difference is red.
pub fn side_by_side(expected: &RgbImage, actual: &RgbImage) -> RgbImage {
    let width = expected.width().max(actual.width());
    let height = expected.height().max(actual.height());
    let mut picture = RgbImage::from_pixel(3 * width + 2 * GAP, height, GROUND);
    for y in 0..height {
        for x in 0..width {
            let [a, b] = [expected, actual].map(|part| part.get_pixel_checked(x, y).copied());
            let difference = match (a, b) {
                (Some(a), Some(b)) if apart(a, b) <= CHANNEL => {
                    Rgb([apart(a, b).saturating_mul(GAIN); 3])
                }
                (None, None) => GROUND,
                _ => OFF,
            };
            let parts = [a.unwrap_or(GROUND), b.unwrap_or(GROUND), difference];
            for (place, pixel) in (0..).zip(parts) {
                picture.put_pixel(place * (width + GAP) + x, y, pixel);
            }
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc that shades off, on a dark ground: what a view is made of.
    fn disc(left: u32) -> RgbImage {
        RgbImage::from_fn(120, 100, |x, y| {
            let (dx, dy) = (f64::from(x) - f64::from(left), f64::from(y) - 50.0);
            let r2 = (dx * dx + dy * dy) / (40.0 * 40.0);
            let shade = if r2 < 1.0 { 220.0 - 120.0 * r2 } else { 30.0 };
            Rgb([shade as u8, (shade * 0.8) as u8, (shade * 0.7) as u8])
        })
    }

    #[test]
    fn the_same_picture_is_the_same() {
        assert_eq!(compare(&disc(60), &disc(60)), Ok(()));
    }

    #[test]
    fn a_picture_that_moved_by_a_pixel_differs() {
        let Err(Difference::Pixels { off, of, worst }) = compare(&disc(60), &disc(61)) else {
            panic!("a shift is not seen");
        };
        assert_eq!(of, 12_000);
        assert!(off > 5 * allowed(of), "{off}");
        assert!(worst > 50);
    }

    #[test]
    fn a_picture_of_another_size_differs() {
        let cut = image::imageops::crop_imm(&disc(60), 0, 0, 120, 99).to_image();
        let found = compare(&disc(60), &cut);
        assert_eq!(found, Err(Difference::Size([(120, 100), (120, 99)])));
    }

    #[test]
    fn the_limits_are_where_they_are_said_to_be() {
        let expected = RgbImage::from_pixel(100, 100, Rgb([100; 3]));
        let changed = |pixels: u32, by: u8| {
            let mut actual = expected.clone();
            for x in 0..pixels {
                // One channel is enough.
                actual.put_pixel(x, 7, Rgb([100, 100 + by, 100]));
            }
            compare(&expected, &actual)
        };
        assert_eq!(changed(100, CHANNEL), Ok(()));
        assert_eq!(changed(10, CHANNEL + 1), Ok(()));
        let eleven = Difference::Pixels {
            off: 11,
            of: 10_000,
            worst: 9,
        };
        assert_eq!(changed(11, CHANNEL + 1), Err(eleven));
    }

    #[test]
    fn three_parts_stand_beside_each_other() {
        let (expected, mut actual) = (disc(60), disc(60));
        actual.put_pixel(10, 20, Rgb([255, 255, 255]));
        let Rgb([r, g, b]) = *actual.get_pixel(60, 50);
        actual.put_pixel(60, 50, Rgb([r - 2, g, b]));
        let picture = side_by_side(&expected, &actual);
        assert_eq!(picture.dimensions(), (3 * 120 + 2 * GAP, 100));
        let part = |place: u32| {
            let left = place * (120 + GAP);
            image::imageops::crop_imm(&picture, left, 0, 120, 100).to_image()
        };
        assert_eq!(part(0), expected);
        assert_eq!(part(1), actual);
        let difference = part(2);
        assert_eq!(*difference.get_pixel(10, 20), OFF);
        assert_eq!(*difference.get_pixel(60, 50), Rgb([2 * GAIN; 3]));
        let dark = difference.pixels().filter(|pixel| pixel.0 == [0; 3]);
        assert_eq!(dark.count(), 120 * 100 - 2);
    }

    #[test]
    fn parts_of_two_sizes_stand_beside_each_other() {
        let cut = image::imageops::crop_imm(&disc(60), 0, 0, 110, 90).to_image();
        let picture = side_by_side(&disc(60), &cut);
        assert_eq!(picture.dimensions(), (3 * 120 + 2 * GAP, 100));
        let at = |place: u32, x: u32, y: u32| *picture.get_pixel(place * (120 + GAP) + x, y);
        assert_eq!(at(1, 115, 95), GROUND);
        assert_eq!(at(2, 115, 50), OFF);
        assert_eq!(at(2, 50, 95), OFF);
        assert_eq!(at(2, 50, 50), Rgb([0; 3]));
    }
}
