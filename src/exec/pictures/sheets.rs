//! Contact sheets: the nose as it is, and under it candidates, in every view.

use image::RgbImage;

use super::PicturesError;
use crate::picture::{SheetRow, contact_sheet, encode_png};

/// How many candidates are on one contact sheet; more are on further ones.
const SHEET_ROWS: usize = 20;

/// The nose as it is, seen by the cameras of the candidates that follow it.
pub(in crate::exec) struct SheetStart<'a> {
    pub label: &'a str,
    pub picture: &'a RgbImage,
}

/// What is on contact sheets.
pub(in crate::exec) struct Sheets<'a> {
    pub title: &'a str,
    /// The names of the views.
    pub columns: &'a [&'a str],
    pub starts: &'a [SheetStart<'a>],
    /// The name of each candidate, and which start it has.
    pub rows: &'a [(&'a str, usize)],
}

impl Sheets<'_> {
    /// Draws every sheet and gives it away as a PNG file, with its name. Each begins with the nose as it is, and so do
    /// candidates that have another one than those above them. Pictures of candidates, by their places, are asked for
    /// one sheet at a time.
    ///
    /// # Errors
    /// Those of the drawing, of `picture` and of `write`.
    pub(in crate::exec) fn draw<E: From<PicturesError>>(
        &self,
        picture: impl Fn(usize) -> Result<RgbImage, E>,
        mut write: impl FnMut(&str, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let all: Vec<(usize, &(&str, usize))> = self.rows.iter().enumerate().collect();
        for (number, some) in all.chunks(SHEET_ROWS).enumerate() {
            let mut rows = Vec::new();
            let mut last = None;
            for &(place, &(name, start)) in some {
                if last != Some(start)
                    && let Some(start) = self.starts.get(start)
                {
                    rows.push(SheetRow::new(start.label, start.picture));
                }
                last = Some(start);
                rows.push(SheetRow::new(name, &picture(place)?));
            }
            let name = if self.rows.len() > SHEET_ROWS {
                format!("contact-sheet-{:02}.png", number + 1)
            } else {
                "contact-sheet.png".to_owned()
            };
            let sheet = contact_sheet(self.title, self.columns, &rows);
            let sheet = sheet.map_err(PicturesError::from)?;
            write(&name, &encode_png(&sheet).map_err(PicturesError::from)?)?;
        }
        Ok(())
    }
}
