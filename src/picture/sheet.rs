//! Many small pictures on one sheet, in rows and columns.

use image::imageops::{FilterType, crop_imm, replace, resize};
use image::{Rgb, RgbImage};

use super::PictureError;
use super::canvas::{checked_size, overlay};
use super::overlay::GROUND;
use super::svg::{Anchor, Svg, TextStyle};
use super::text::elide;

/// Side of a picture on a sheet, pixels.
pub const TILE: u32 = 256;
/// Between pictures.
const GAP: u32 = 4;
/// Room for the names of rows, left of them.
const LABELS: u32 = 168;
/// Room for the title, and for the names of columns below it.
const TITLE: u32 = 34;
const HEADER: u32 = 26;
const INK: [u8; 3] = [236, 236, 240];

/// A row of a contact sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetRow {
    /// Stands at its beginning; what is before a slash above what is behind it.
    pub label: String,
    /// One for each column, as [`tile`] makes them.
    pub tiles: Vec<RgbImage>,
}

impl SheetRow {
    /// The row of a [`strip`] of pictures.
    pub fn new(label: &str, strip: &RgbImage) -> Self {
        let tiles = (0..strip.width() / TILE)
            .map(|at| crop_imm(strip, at * TILE, 0, TILE, TILE.min(strip.height())).to_image());
        Self {
            label: label.to_owned(),
            tiles: tiles.collect(),
        }
    }
}

/// Pictures of a sheet beside each other, as one.
pub fn strip(tiles: &[RgbImage]) -> RgbImage {
    let mut strip = RgbImage::new(TILE * tiles.len() as u32, TILE);
    for (at, tile) in tiles.iter().enumerate() {
        replace(&mut strip, tile, i64::from(TILE) * at as i64, 0);
    }
    strip
}

/// A picture as small as it is on a sheet.
pub fn tile(picture: &RgbImage) -> RgbImage {
    resize(picture, TILE, TILE, FilterType::Triangle)
}

/// Rows of pictures under a title and the names of the columns. A row of fewer pictures than there are columns
/// ends early; further ones are left out.
///
/// # Errors
/// [`PictureError::Size`] where there is no row or no column, or there are too many.
pub fn contact_sheet(
    title: &str,
    columns: &[&str],
    rows: &[SheetRow],
) -> Result<RgbImage, PictureError> {
    let step = TILE + GAP;
    let across = columns.len() as u64 * u64::from(step);
    let down = rows.len() as u64 * u64::from(step);
    if across == 0 || down == 0 {
        return Err(PictureError::Size {
            width: across,
            height: down,
        });
    }
    let width = u64::from(LABELS) + across;
    let height = u64::from(TITLE + HEADER) + down;
    let (width, height) = checked_size(width, height)?;
    let mut sheet = RgbImage::from_pixel(width, height, Rgb(GROUND));
    let mut svg = Svg::new(width, height);
    let style = |size: f64, anchor: Anchor| TextStyle {
        size,
        colour: INK,
        anchor,
        halo: None,
    };
    let mut write = |at: [f64; 2], text: &str, size: f64, anchor: Anchor, room: u32| {
        let text = elide(text, size, f64::from(room));
        svg.text(at, &text, style(size, anchor));
    };
    write([12.0, 24.0], title, 17.0, Anchor::Start, width - 24);
    // In range from here on: the size of the sheet was checked.
    for (place, name) in columns.iter().enumerate() {
        let middle = LABELS + place as u32 * step + TILE / 2;
        let at = [f64::from(middle), f64::from(TITLE + HEADER) - 9.0];
        write(at, name, 13.0, Anchor::Middle, TILE);
    }
    for (place, row) in rows.iter().enumerate() {
        let top = TITLE + HEADER + place as u32 * step;
        let middle = f64::from(top + TILE / 2);
        // Of several runs: the run above what is of it.
        let lines: Vec<&str> = row.label.splitn(2, '/').collect();
        for (line, text) in lines.iter().enumerate() {
            let down = 18.0 * (line as f64 - (lines.len() - 1) as f64 / 2.0);
            write(
                [12.0, middle + down],
                text,
                14.0,
                Anchor::Start,
                LABELS - 24,
            );
        }
        for (column, tile) in row.tiles.iter().take(columns.len()).enumerate() {
            let left = LABELS + column as u32 * step;
            let inside = tile
                .enumerate_pixels()
                .filter(|(x, y, _)| *x < TILE && *y < TILE);
            for (x, y, pixel) in inside {
                sheet.put_pixel(left + x, top + y, *pixel);
            }
        }
    }
    overlay(&mut sheet, &svg.finish())?;
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(label: &str, colours: &[[u8; 3]]) -> SheetRow {
        let picture = |colour: &[u8; 3]| RgbImage::from_pixel(512, 512, Rgb(*colour));
        SheetRow {
            label: label.to_owned(),
            tiles: colours
                .iter()
                .map(|colour| tile(&picture(colour)))
                .collect(),
        }
    }

    #[test]
    fn every_picture_is_at_its_place_and_every_row_and_column_has_a_name() {
        let colours = [[[200, 0, 0], [0, 200, 0]], [[0, 0, 200], [200, 200, 0]]];
        let rows = [row("before", &colours[0]), row("after", &colours[1])];
        let sheet = contact_sheet("plan", &["frontal", "basal"], &rows).unwrap();
        assert_eq!(sheet.dimensions(), (168 + 2 * 260, 34 + 26 + 2 * 260));
        for (down, colours) in colours.iter().enumerate() {
            for (across, colour) in colours.iter().enumerate() {
                let [left, top] = [168 + 260 * across as u32, 60 + 260 * down as u32];
                for (x, y) in [(0, 0), (128, 128), (255, 255)] {
                    assert_eq!(sheet.get_pixel(left + x, top + y).0, *colour);
                }
            }
        }
        let lit = |x: std::ops::Range<u32>, y: std::ops::Range<u32>| {
            let mut pixels = x.flat_map(|x| y.clone().map(move |y| (x, y)));
            pixels.any(|(x, y)| sheet.get_pixel(x, y).0.iter().all(|level| *level > 150))
        };
        assert!(lit(0..168, 0..34), "the title");
        assert!(
            lit(168..424, 34..60) && lit(428..684, 34..60),
            "the columns"
        );
        assert!(lit(0..168, 60..316) && lit(0..168, 320..576), "the rows");
    }

    #[test]
    fn the_name_of_a_run_stands_above_that_of_its_candidate() {
        let lit = |label: &str| {
            let sheet = contact_sheet("", &["frontal"], &[row(label, &[[0; 3]])]).unwrap();
            // One line stands on 188, the middle of the row.
            [165..176, 180..186, 191..202].map(|mut rows: std::ops::Range<u32>| {
                rows.any(|y| (0..168).any(|x| sheet.get_pixel(x, y).0[0] > 150))
            })
        };
        assert_eq!(lit("candidate"), [false, true, false]);
        assert_eq!(lit("one/other"), [true, false, true], "two lines");
    }

    #[test]
    fn a_sheet_of_nothing_and_one_too_large_are_refused() {
        let one = row("a", &[[1, 2, 3]]);
        let size = |columns: &[&str], rows: &[SheetRow]| contact_sheet("t", columns, rows);
        let only = std::slice::from_ref(&one);
        assert!(matches!(size(&[], only), Err(PictureError::Size { .. })));
        assert!(matches!(size(&["a"], &[]), Err(PictureError::Size { .. })));
        let many = vec![one; 200];
        assert!(matches!(
            size(&["a"; 30], &many),
            Err(PictureError::Size { .. })
        ));
    }
}
