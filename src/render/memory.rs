//! Memory of pictures that are no longer looked at, kept for the next ones: to get as much from the system, page by page,
//! takes a third of the time that a picture does.

use std::sync::{Mutex, PoisonError};

use super::layer::Seen;

/// At most so many pixels are kept: five pictures of 1024 pixels a side, 55 MiB in all.
const KEPT: usize = 5 << 20;

/// The pixels of a picture and what one object shows in them. Nobody knows what is in it before it is written.
#[derive(Debug, Default)]
pub(super) struct Sheet {
    pub pixels: Vec<[u8; 3]>,
    pub seen: Seen,
}

/// The one that was last used is last.
static SPARE: Mutex<Vec<Sheet>> = Mutex::new(Vec::new());

impl Sheet {
    /// One for as many pixels a side.
    pub(super) fn take(size: usize) -> Self {
        let mut spare = SPARE.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = |sheet: &Self| sheet.pixels.len() == size * size;
        if let Some(found) = spare.iter().rposition(fits) {
            return spare.remove(found);
        }
        drop(spare);
        Self {
            pixels: vec![[0; 3]; size * size],
            seen: Seen::new(size),
        }
    }

    /// Keeps it for another picture, and forgets those that were not used for longest.
    pub(super) fn give_back(self) {
        let mut spare = SPARE.lock().unwrap_or_else(PoisonError::into_inner);
        spare.push(self);
        let mut pixels: usize = spare.iter().map(|sheet| sheet.pixels.len()).sum();
        while pixels > KEPT {
            pixels -= spare.remove(0).pixels.len();
        }
    }
}
