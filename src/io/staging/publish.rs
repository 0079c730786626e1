//! Renames that are all done, or undone.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// One rename. The folder that it goes to must exist.
#[derive(Debug)]
pub(super) struct Move {
    pub(super) from: PathBuf,
    pub(super) to: PathBuf,
    /// The file that it is about, where the user looks for it.
    pub(super) path: PathBuf,
}

/// A rename that failed.
#[derive(Debug)]
pub(super) struct Stuck<'a> {
    pub(super) at: &'a Move,
    pub(super) source: io::Error,
    /// Whether those before it were undone.
    pub(super) is_undone: bool,
}

/// Renames in order; where one fails, those before it are undone, the last first.
pub(super) fn carry_out(moves: &[Move]) -> Result<(), Stuck<'_>> {
    for (done, at) in moves.iter().enumerate() {
        if let Err(source) = fs::rename(&at.from, &at.to) {
            let mut is_undone = true;
            for back in moves.iter().take(done).rev() {
                is_undone &= fs::rename(&back.to, &back.from).is_ok();
            }
            return Err(Stuck {
                at,
                source,
                is_undone,
            });
        }
    }
    Ok(())
}

/// Folders that were made on the way to something, and go away again with this where they are empty.
#[derive(Debug, Default)]
pub(super) struct Made(Vec<PathBuf>);

impl Made {
    /// Makes a folder and those above it.
    pub(super) fn make(&mut self, folder: &Path) -> io::Result<()> {
        let missing = folder
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists());
        let missing: Vec<_> = missing.map(Path::to_owned).collect();
        // Also where only some of them can be made.
        self.0.splice(0..0, missing);
        fs::create_dir_all(folder)
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        for folder in &self.0 {
            // Fails where something is in it: it came to something, or someone else uses it.
            let _ = fs::remove_dir(folder);
        }
    }
}
