//! Two pictures, pixel by pixel; and where they differ, both beside their difference.

use image::{Rgb, RgbImage};

use super::difference::{Cell, Difference, Kind};
use super::tolerance::Pictures;

/// Brightness of what is off by one in the difference; what is off by more than it may be is red.
const GAIN: u8 = 16;
const OFF: Rgb<u8> = Rgb([255, 40, 40]);
/// Between the three parts.
const GAP: u32 = 4;
const GROUND: Rgb<u8> = Rgb([70, 90, 120]);

/// What is wrong with a picture.
#[derive(Debug, Clone, PartialEq)]
pub enum PictureDifference {
    /// Widths and heights, expected and actual.
    Size([(u32, u32); 2]),
    /// Pixels that are off.
    Pixels {
        /// How many are off by more than they may be.
        off: usize,
        /// Of how many.
        of: usize,
        /// How many may be.
        allowed: usize,
        /// The furthest that one is off, of 255.
        worst: u8,
    },
}

impl PictureDifference {
    /// As a row of a table.
    pub fn row(&self, name: String, tolerance: &Pictures) -> Difference {
        let (unit, expected, found, difference, allowed) = match self {
            Self::Size([expected, found]) => {
                let size = |(width, height)| Cell::Text(format!("{width} × {height}"));
                let (expected, found) = (size(*expected), size(*found));
                (
                    "pixels".to_owned(),
                    expected,
                    found,
                    Cell::Empty,
                    Cell::Empty,
                )
            }
            Self::Pixels {
                off,
                allowed,
                worst,
                ..
            } => (
                format!("pixels off by more than {} of 255", tolerance.channel),
                Cell::Number(0.0),
                Cell::Number(*off as f64),
                Cell::Text(format!("up to {worst} of 255")),
                Cell::Number(*allowed as f64),
            ),
        };
        Difference {
            kind: Kind::Picture,
            measure: name,
            unit,
            expected,
            found,
            difference,
            tolerance: allowed,
        }
    }
}

/// The largest difference of two pixels' channels.
fn apart(a: Rgb<u8>, b: Rgb<u8>) -> u8 {
    let channels = a.0.iter().zip(b.0);
    channels.map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
}

/// What is wrong with `actual`, if anything is.
///
/// # Errors
/// [`PictureDifference`], where more is off than `tolerance` allows.
pub fn compare(
    expected: &RgbImage,
    actual: &RgbImage,
    tolerance: &Pictures,
) -> Result<(), PictureDifference> {
    let sizes = [expected.dimensions(), actual.dimensions()];
    if sizes[0] != sizes[1] {
        return Err(PictureDifference::Size(sizes));
    }
    let pixels = expected.pixels().zip(actual.pixels());
    let (mut off, mut of, mut worst) = (0, 0, 0);
    for (a, b) in pixels {
        let apart = apart(*a, *b);
        of += 1;
        off += usize::from(apart > tolerance.channel);
        worst = worst.max(apart);
    }
    let allowed = (tolerance.share * of as f64) as usize;
    if off > allowed {
        return Err(PictureDifference::Pixels {
            off,
            of,
            allowed,
            worst,
        });
    }
    Ok(())
}

/// Expected | actual | difference: the brighter, the further off, and red where a channel is off by more than
/// `channel`. Where one of them has no pixel, the difference is red.
pub fn side_by_side(expected: &RgbImage, actual: &RgbImage, channel: u8) -> RgbImage {
    let width = expected.width().max(actual.width());
    let height = expected.height().max(actual.height());
    let mut picture = RgbImage::from_pixel(3 * width + 2 * GAP, height, GROUND);
    for y in 0..height {
        for x in 0..width {
            let [a, b] = [expected, actual].map(|part| part.get_pixel_checked(x, y).copied());
            let difference = match (a, b) {
                (Some(a), Some(b)) if apart(a, b) <= channel => {
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

/// Pixels of a small picture made squares, so that its longest side comes near to `side`.
pub fn enlarged(image: &RgbImage, side: u32) -> RgbImage {
    let (width, height) = image.dimensions();
    let by = (side / width.max(height).max(1)).max(1);
    RgbImage::from_fn(width * by, height * by, |x, y| {
        *image.get_pixel(x / by, y / by)
    })
}

/// The picture with a longest side of `side` pixels, each the mean of the area that it covers; as it is, where it
/// is no larger. In whole numbers, so that it is the same on every machine.
pub fn reduced(image: &RgbImage, side: u32) -> RgbImage {
    let (width, height) = image.dimensions();
    let longest = width.max(height);
    if longest <= side {
        return image.clone();
    }
    let shorter = |length: u32| {
        let rounded =
            (u64::from(length) * u64::from(side) + u64::from(longest) / 2) / u64::from(longest);
        (rounded as u32).clamp(1, side)
    };
    let (w, h) = (shorter(width), shorter(height));
    let (columns, rows) = (covered(width, w), covered(height, h));
    let area = u64::from(width) * u64::from(height);
    RgbImage::from_fn(w, h, |x, y| {
        let mut sums = [0_u64; 3];
        let (columns, rows) = (columns.get(x as usize), rows.get(y as usize));
        for &(row, part) in rows.into_iter().flatten() {
            for &(column, of_row) in columns.into_iter().flatten() {
                let pixel = image.get_pixel(column, row);
                for (sum, channel) in sums.iter_mut().zip(pixel.0) {
                    *sum += part * of_row * u64::from(channel);
                }
            }
        }
        Rgb(sums.map(|sum| ((sum + area / 2) / area) as u8))
    })
}

/// Which of `from` pixels in a row each of `to` covers, and how much of each, in shares of a `to`-th. All shares
/// of one sum up to `from`.
fn covered(from: u32, to: u32) -> Vec<Vec<(u32, u64)>> {
    let (from, to) = (u64::from(from), u64::from(to));
    let pixel = |place: u64| {
        let (start, end) = (place * from, (place + 1) * from);
        let touched = start / to..end.div_ceil(to);
        let share = |at: u64| (end.min((at + 1) * to) - start.max(at * to), at as u32);
        touched.map(share).map(|(share, at)| (at, share)).collect()
    };
    (0..to).map(pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compare(expected: &RgbImage, actual: &RgbImage) -> Result<(), PictureDifference> {
        super::compare(expected, actual, &Pictures::default())
    }

    fn side_by_side(expected: &RgbImage, actual: &RgbImage) -> RgbImage {
        super::side_by_side(expected, actual, CHANNEL)
    }

    /// The default.
    const CHANNEL: u8 = 8;

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
        let Err(PictureDifference::Pixels {
            off,
            of,
            allowed,
            worst,
        }) = compare(&disc(60), &disc(61))
        else {
            panic!("a shift is not seen");
        };
        assert_eq!(of, 12_000);
        assert!(off > 5 * allowed, "{off}");
        assert!(worst > 50);
    }

    #[test]
    fn a_picture_of_another_size_differs() {
        let cut = image::imageops::crop_imm(&disc(60), 0, 0, 120, 99).to_image();
        let found = compare(&disc(60), &cut);
        assert_eq!(found, Err(PictureDifference::Size([(120, 100), (120, 99)])));
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
        let eleven = PictureDifference::Pixels {
            off: 11,
            of: 10_000,
            allowed: 10,
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

    #[test]
    fn a_reduced_picture_is_the_mean_of_what_it_covers() {
        let steps = RgbImage::from_fn(8, 4, |x, y| Rgb([(8 * x) as u8, (16 * y) as u8, 7]));
        let half = reduced(&steps, 4);
        assert_eq!(half.dimensions(), (4, 2));
        assert_eq!(*half.get_pixel(1, 1), Rgb([20, 40, 7]));
        // Three columns of two: the middle one is shared.
        let three = RgbImage::from_fn(3, 1, |x, _| Rgb([[0, 90, 240][x as usize], 0, 255]));
        let two = reduced(&three, 2);
        assert_eq!(two.dimensions(), (2, 1));
        assert_eq!(
            [two.get_pixel(0, 0).0[0], two.get_pixel(1, 0).0[0]],
            [30, 190]
        );
        assert_eq!(reduced(&steps, 8), steps);
        assert_eq!(reduced(&steps, 100), steps);
        // Nothing is lost at a size that divides nothing, nor is a thin picture.
        let grey = RgbImage::from_pixel(997, 3, Rgb([201, 5, 250]));
        let small = reduced(&grey, 16);
        assert_eq!(small.dimensions(), (16, 1));
        assert!(small.pixels().all(|pixel| pixel.0 == [201, 5, 250]));
    }

    #[test]
    fn an_enlarged_picture_has_the_same_pixels() {
        let small = RgbImage::from_fn(5, 3, |x, y| Rgb([(8 * x) as u8, (16 * y) as u8, 7]));
        let large = enlarged(&small, 17);
        assert_eq!(large.dimensions(), (15, 9));
        assert_eq!(reduced(&large, 5), small);
        assert_eq!(enlarged(&small, 9), small);
        let nothing = RgbImage::new(0, 0);
        assert_eq!(enlarged(&nothing, 9), nothing);
    }

    #[test]
    fn a_row_says_what_and_how_much() {
        let tolerance = Pictures::default();
        let found = super::compare(&disc(60), &disc(61), &tolerance).unwrap_err();
        let row = found.row("a/view.png".to_owned(), &tolerance).row();
        assert_eq!(
            row[..3],
            ["a/view.png", "pixels off by more than 8 of 255", "0"]
        );
        assert_eq!(row[5], "12");
        let cut = image::imageops::crop_imm(&disc(60), 0, 0, 120, 99).to_image();
        let found = super::compare(&disc(60), &cut, &tolerance).unwrap_err();
        let row = found.row("a/view.png".to_owned(), &tolerance).row();
        assert_eq!(row[1..4], ["pixels", "120 × 100", "120 × 99"]);
    }
}
