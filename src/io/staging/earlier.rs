//! Results of earlier runs, for a run that may keep them: what was put in place, and what runs left that were
//! killed before they came to that.
//!
//! Nothing here is believed: names are checked as those of the list of files are, and content by its SHA-256.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use super::manifest::{is_plain, look_at, plain_name};
use super::{HIDDEN, KEPT};
use crate::io::digest::sha256_hex_of_file;

/// The largest note that is read, bytes.
const MAX_NOTE_BYTES: u64 = 16 << 20;

/// Where results of earlier runs can be.
#[derive(Debug, Clone)]
pub struct Earlier {
    /// The output folder, then the hidden folders of killed runs.
    roots: Vec<PathBuf>,
}

/// A file of an earlier run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Found {
    /// It is where it belongs.
    InPlace,
    /// A killed run left it here.
    Left(PathBuf),
}

/// Why a file of an earlier run cannot be kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lost {
    /// It is not there.
    Missing,
    /// Its content is another.
    Altered,
}

impl Earlier {
    /// Of a folder. Nothing is changed in it.
    pub fn of(target: &Path) -> Self {
        let mut roots = vec![target.to_owned()];
        roots.extend(hidden_folders(target));
        Self { roots }
    }

    /// Of what was put in place in a folder alone.
    pub fn published(target: &Path) -> Self {
        Self {
            roots: vec![target.to_owned()],
        }
    }

    /// Only those of the folders that are wanted.
    pub(super) fn retain(&mut self, wanted: impl Fn(&Path) -> bool) {
        self.roots.retain(|root| wanted(root));
    }

    /// Whether any earlier run left something to keep.
    pub fn is_empty(&self) -> bool {
        self.roots.iter().all(|root| !root.join(KEPT).is_dir())
    }

    /// Every note of this name (see [`super::Staging::note`]), the published one first. No link is followed.
    pub fn notes(&self, name: &Path) -> Vec<Vec<u8>> {
        let Some(name) = plain_name(&Path::new(KEPT).join(name)) else {
            return Vec::new();
        };
        let notes = self.roots.iter().filter_map(|root| {
            // A pipe is not opened: that would wait for someone to write to it.
            let path = look_at(root, &name)?;
            let mut bytes = Vec::new();
            let mut limited = File::open(path).ok()?.take(MAX_NOTE_BYTES + 1);
            limited.read_to_end(&mut bytes).ok()?;
            (bytes.len() as u64 <= MAX_NOTE_BYTES).then_some(bytes)
        });
        notes.collect()
    }

    /// Where the file of this name and content is.
    ///
    /// # Errors
    /// [`Lost`] where it is nowhere.
    pub fn find(&self, name: &str, sha256: &str) -> Result<Found, Lost> {
        let mut lost = Lost::Missing;
        if !is_plain(name) {
            return Err(lost);
        }
        for (place, root) in self.roots.iter().enumerate() {
            let Some(path) = look_at(root, name) else {
                continue;
            };
            match sha256_hex_of_file(&path) {
                Ok(found) if found == sha256 && place == 0 => return Ok(Found::InPlace),
                Ok(found) if found == sha256 => return Ok(Found::Left(path)),
                _ => lost = Lost::Altered,
            }
        }
        Err(lost)
    }
}

/// The hidden folders of runs in a folder.
pub(super) fn hidden_folders(target: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(target) else {
        return Vec::new();
    };
    let hidden = entries.flatten().filter(|entry| {
        let is_hidden = entry.file_name().to_string_lossy().starts_with(HIDDEN);
        // Of the entry itself: a link is no folder.
        is_hidden && entry.file_type().is_ok_and(|kind| kind.is_dir())
    });
    let mut hidden: Vec<PathBuf> = hidden.map(|entry| entry.path()).collect();
    hidden.sort();
    hidden
}
