//! The outputs of a run, put in place together.
//!
//! Files are written into a hidden folder beside where they will be, and renamed into place by
//! [`Staging::publish`]. Only one run at a time does so in a folder: the others are refused.
//!
//! - A run that fails leaves what earlier runs wrote as it was. A file that could not be put in place is found
//!   before the first one is, and where a rename fails all the same, those before it are undone.
//! - A run that is killed leaves its hidden folder, of which the next one keeps what it can use (see [`Earlier`])
//!   and removes the rest. If it was killed among the
//!   renames, files of two runs are beside each other, each of them whole: then the last file of a run,
//!   which is the first to be taken away and comes back last, is not there.
//! - What the run before wrote and this one does not is removed, if nobody changed it since: see `manifest`.

mod earlier;
mod lock;
mod manifest;
mod publish;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;
use tempfile::TempDir;

use self::earlier::hidden_folders;
pub use self::earlier::{Earlier, Found, Lost};
use self::lock::{Asked, Lock};
pub use self::manifest::is_plain;
use self::manifest::{MANIFEST, Manifest, plain_name};
use self::publish::{Made, Move, carry_out};
use super::artifact::{ArtifactError, HIDDEN, save};
use super::digest::sha256_hex_of_file;

/// In the hidden folder: what is taken away while files are put in place.
const OLD: &str = ".old";

/// In the hidden folder: the list of files, to be renamed when all is done, which needs no room on the disk.
const NOW: &str = ".now";

/// Notes on results, by which a later run tells whether it can keep them: in the output folder once a run is
/// published, in its hidden folder until then.
const KEPT: &str = ".rhinoplan.kept";

/// What the last run into a folder put there and is there still: names, `/` between their parts. Without the files
/// that every run writes.
pub fn listed(folder: &Path) -> Vec<String> {
    let manifest = Manifest::read(folder);
    let names = manifest.names();
    let is_there = |name: &&str| {
        let found = folder.join(name).symlink_metadata();
        found.is_ok_and(|found| found.is_file())
    };
    names.filter(is_there).map(str::to_owned).collect()
}

/// The files of a run that is not finished.
///
/// Dropped without [`Staging::publish`], it leaves the folder as it was. (What is dropped is in this order:
/// the hidden folder, the lock, folders that were made and are empty.) Several threads can write files at once.
#[derive(Debug)]
pub struct Staging {
    hidden: TempDir,
    lock: Result<Lock, io::Error>,
    _made: Made,
    target: PathBuf,
    files: Mutex<Files>,
}

#[derive(Debug, Default)]
struct Files {
    begun: Vec<Begun>,
    /// Files of earlier runs that are in place and stay.
    kept: Vec<PathBuf>,
    /// What is known of the content of files.
    digests: BTreeMap<PathBuf, String>,
}

#[derive(Debug, Clone)]
struct Begun {
    name: PathBuf,
    is_listed: bool,
}

/// What became of the files of earlier runs that this one did not write. Names within the folder, `/`
/// between their parts.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Published {
    /// Removed.
    pub removed: Vec<String>,
    /// Left, because they are no longer what was written.
    pub kept: Vec<String>,
}

impl Staging {
    /// Makes the folder `target`, takes its lock, and makes the hidden folder. What killed runs left stays until
    /// [`Staging::sweep`].
    ///
    /// # Errors
    /// [`ArtifactError`] where a folder cannot be made, or another run is writing into it.
    pub fn new(target: &Path) -> Result<Self, ArtifactError> {
        let failed = |action| {
            move |source| ArtifactError {
                path: target.to_owned(),
                action,
                source: plain(source),
            }
        };
        // What is made from here on goes away again, if nothing comes of it.
        let mut made = Made::default();
        made.make(target).map_err(failed("create"))?;
        let asked = Lock::ask(target, |folder| made.make(folder)).map_err(failed("write into"))?;
        let lock = match asked {
            Asked::Held(lock) => Ok(lock),
            Asked::None(error) => Err(error),
            Asked::Busy => {
                return Err(failed("write into")(io::Error::other(
                    "another run is writing into this folder; wait for its end, or choose another folder",
                )));
            }
        };
        let hidden = tempfile::Builder::new()
            .prefix(HIDDEN)
            .tempdir_in(target)
            .map_err(failed("write into"))?;
        Ok(Self {
            hidden,
            lock,
            _made: made,
            target: target.to_owned(),
            files: Mutex::default(),
        })
    }

    /// Results of earlier runs. Where the file system has no locks, what killed runs left is not among them: it
    /// might be in use.
    pub fn earlier(&self) -> Earlier {
        let mut earlier = Earlier::of(&self.target);
        let own = self.hidden_folder();
        earlier.retain(|root| {
            root == self.target || (self.lock.is_ok() && root.file_name() != own.file_name())
        });
        earlier
    }

    /// Removes what killed runs left, but for what was kept of it. Without a lock it does nothing.
    pub fn sweep(&self) {
        if self.lock.is_err() {
            return;
        }
        let own = self.hidden_folder();
        for folder in hidden_folders(&self.target) {
            if folder.file_name() != own.file_name() {
                // One that cannot be removed, another user's perhaps, is in nobody's way.
                let _ = fs::remove_dir_all(folder);
            }
        }
    }

    /// Makes a file of an earlier run one of this run, as [`Earlier::find`] found it.
    ///
    /// # Errors
    /// [`ArtifactError`] where it cannot be taken over.
    pub fn keep(&self, name: &str, sha256: &str, found: &Found) -> Result<(), ArtifactError> {
        if let Found::Left(from) = found {
            let to = self.begin(name)?;
            fs::rename(from, &to).map_err(|source| put_in_place(&to, source))?;
        } else {
            self.files().kept.push(PathBuf::from(name));
        }
        let digests = &mut self.files().digests;
        digests.insert(PathBuf::from(name), sha256.to_owned());
        Ok(())
    }

    /// Where to write a note on results: a hidden file that is published with the others, and that
    /// [`Earlier::notes`] gives to later runs, published or not. It is to be written after what it is about.
    ///
    /// # Errors
    /// [`ArtifactError`] where its folder cannot be made.
    pub fn note(&self, name: &Path) -> Result<PathBuf, ArtifactError> {
        let path = self.hidden_folder().join(KEPT).join(name);
        make_parent(&path)?;
        Ok(path)
    }

    /// Leaves the hidden folder, so that the next run can keep what is in it.
    pub fn leave(mut self) {
        self.hidden.disable_cleanup(true);
    }

    /// Takes back the files that were begun in a folder of the target.
    pub fn forget(&self, folder: &Path) {
        let mut files = self.files();
        let stays = |name: &Path| !name.starts_with(folder);
        files.begun.retain(|file| stays(&file.name));
        files.kept.retain(|name| stays(name));
        files.digests.retain(|name, _| stays(name));
        drop(files);
        let _ = fs::remove_dir_all(self.hidden_folder().join(folder));
        let _ = fs::remove_dir_all(self.hidden_folder().join(KEPT).join(folder));
    }

    /// Only whole values are ever put in, so one that a panic left is as good.
    fn files(&self) -> MutexGuard<'_, Files> {
        self.files.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the user should know where the file system has no locks.
    pub fn warning(&self) -> Option<String> {
        let error = self.lock.as_ref().err()?;
        Some(format!(
            "`{}` is on a file system without locks ({error}): do not start another run into it before this one ends",
            self.target.display()
        ))
    }

    /// Where to write the file that will be `name` in the target folder; folders on the way are made. The last
    /// file that is begun is the one whose being there says that a run is whole.
    ///
    /// # Errors
    /// [`ArtifactError`] where a folder cannot be made, or the file could not be put in place.
    pub fn begin(&self, name: impl AsRef<Path>) -> Result<PathBuf, ArtifactError> {
        self.begin_file(name.as_ref(), true)
    }

    /// As [`Staging::begin`], for a file that every run writes. It is never left over, so the list of files does
    /// without it, and stays the same where only such a file differs.
    ///
    /// # Errors
    /// As [`Staging::begin`].
    pub fn begin_unlisted(&self, name: impl AsRef<Path>) -> Result<PathBuf, ArtifactError> {
        self.begin_file(name.as_ref(), false)
    }

    fn begin_file(&self, name: &Path, is_listed: bool) -> Result<PathBuf, ArtifactError> {
        self.check(name)?;
        let path = self.hidden_folder().join(name);
        make_parent(&path)?;
        self.files().begun.push(Begun {
            name: name.to_owned(),
            is_listed,
        });
        Ok(path)
    }

    /// Reads back the files written so far for the list of files, those of one folder of the target or all.
    /// [`Staging::publish`] does it for the rest. Returns what is known of files in that folder, in the order of
    /// their names, `/` between folders.
    ///
    /// # Errors
    /// [`ArtifactError`] where one cannot be read.
    pub fn digest(&self, folder: &Path) -> Result<Vec<(String, String)>, ArtifactError> {
        let new: Vec<PathBuf> = {
            let files = self.files();
            let new = files.begun.iter().filter(|file| {
                file.is_listed
                    && file.name.starts_with(folder)
                    && !files.digests.contains_key(&file.name)
            });
            new.map(|file| file.name.clone()).collect()
        };
        let digests = new.into_par_iter().map(|name| {
            let path = self.hidden_folder().join(&name);
            match sha256_hex_of_file(&path) {
                Ok(sha256) => Ok((name, sha256)),
                Err(source) => Err(ArtifactError {
                    path,
                    action: "read back",
                    source,
                }),
            }
        });
        let digests = digests.collect::<Result<Vec<_>, _>>()?;
        let mut files = self.files();
        files.digests.extend(digests);
        let of_folder = files
            .digests
            .iter()
            .filter(|(name, _)| name.starts_with(folder));
        Ok(of_folder
            .filter_map(|(name, sha256)| Some((plain_name(name)?, sha256.clone())))
            .collect())
    }

    /// Puts every file in place, in the order of [`Staging::begin`], instead of those that were there, and
    /// removes what is left over of earlier runs.
    ///
    /// # Errors
    /// [`ArtifactError`] for the first file that cannot be put in place; then none is.
    pub fn publish(mut self) -> Result<Published, ArtifactError> {
        self.digest(Path::new(""))?;
        let (names, kept) = {
            let files = self.files();
            let names: Vec<_> = files.begun.iter().map(|file| file.name.clone()).collect();
            (names, files.kept.clone())
        };
        for name in &names {
            self.check(name)?;
        }
        let earlier = Manifest::read(&self.target);
        let left = earlier.left_over(&[&names[..], &kept].concat(), &self.target);
        let now = self.manifest();
        let settled = self.hidden_folder().join(NOW);
        save(&settled, now.text().as_bytes())?;
        // Killed from here on, the next run knows the files of both.
        self.write_manifest(&now.clone().and(&earlier))?;
        let mut made = Made::default();
        let moves = self.moves(&names, &left.files, &mut made)?;
        if let Err(stuck) = carry_out(&moves) {
            let mut error = put_in_place(&stuck.at.path, stuck.source);
            if !stuck.is_undone {
                // What was there before is in it.
                self.hidden.disable_cleanup(true);
                let saved = self.hidden_folder().join(OLD);
                error.source = io::Error::other(format!(
                    "{}; earlier files could not all be put back and are in `{}`, which the next run removes",
                    error.source,
                    saved.display()
                ));
            }
            return Err(error);
        }
        // While they are still listed: killed among these, the next run goes on with them.
        for name in &left.names {
            self.remove_empty_folders(name);
        }
        // A list of files that are gone does no harm, so a run that is whole does not fail for it.
        let _ = fs::rename(settled, self.target.join(MANIFEST));
        Ok(Published {
            removed: left.files,
            kept: left.changed,
        })
    }

    /// The hidden folder, named as the user named the target: `TempDir` makes it absolute.
    fn hidden_folder(&self) -> PathBuf {
        let path = self.hidden.path();
        path.file_name()
            .map_or_else(|| path.to_owned(), |name| self.target.join(name))
    }

    fn manifest(&self) -> Manifest {
        let mut manifest = Manifest::default();
        for (name, sha256) in &self.files().digests {
            if let Some(name) = plain_name(name) {
                manifest.add(name, sha256.clone());
            }
        }
        manifest
    }

    fn write_manifest(&self, manifest: &Manifest) -> Result<(), ArtifactError> {
        let (from, to) = (
            self.hidden_folder().join(MANIFEST),
            self.target.join(MANIFEST),
        );
        save(&from, manifest.text().as_bytes())?;
        fs::rename(from, &to).map_err(|source| put_in_place(&to, source))
    }

    /// The renames that publishing is: what stands in the place of a file, and what is left over, into the
    /// hidden folder; then the files into their places. The last file's place is the first to be emptied.
    fn moves(
        &self,
        names: &[PathBuf],
        left_over: &[String],
        made: &mut Made,
    ) -> Result<Vec<Move>, ArtifactError> {
        let hidden = self.hidden_folder();
        let mut moves = Vec::new();
        // The notes first: without them the results are computed again, with those of another run they would
        // not be.
        let (notes, notes_now) = (self.target.join(KEPT), hidden.join(KEPT));
        let replaced_notes = notes.symlink_metadata().is_ok();
        if replaced_notes {
            let to = hidden.join(OLD).join(KEPT);
            make_parent(&to).map_err(|error| put_in_place(&notes, error.source))?;
            moves.push(Move {
                from: notes.clone(),
                to,
                path: notes.clone(),
            });
        }
        let replaced = names
            .last()
            .into_iter()
            .chain(names.iter().rev().skip(1).rev());
        for name in replaced
            .map(PathBuf::as_path)
            .chain(left_over.iter().map(Path::new))
        {
            let path = self.target.join(name);
            if path.symlink_metadata().is_err() {
                continue;
            }
            let to = hidden.join(OLD).join(name);
            make_parent(&to).map_err(|error| put_in_place(&path, error.source))?;
            moves.push(Move {
                from: path.clone(),
                to,
                path,
            });
        }
        for name in names {
            let path = self.target.join(name);
            if let Some(folder) = path.parent() {
                made.make(folder).map_err(|source| ArtifactError {
                    path: folder.to_owned(),
                    action: "create",
                    source,
                })?;
            }
            moves.push(Move {
                from: hidden.join(name),
                to: path.clone(),
                path,
            });
        }
        if notes_now.is_dir() {
            moves.push(Move {
                from: notes_now,
                to: notes.clone(),
                path: notes,
            });
        }
        Ok(moves)
    }

    /// The folders of a file that is gone, up to the target, as far as nothing is in them.
    fn remove_empty_folders(&self, name: &str) {
        for folder in Path::new(name).ancestors().skip(1) {
            if folder.as_os_str().is_empty() {
                return;
            }
            match fs::remove_dir(self.target.join(folder)) {
                Ok(()) => {}
                // A killed run got this far.
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(_) => return,
            }
        }
    }

    /// Whether a file could be renamed to `name` in the target folder, as far as that can be told.
    fn check(&self, name: &Path) -> Result<(), ArtifactError> {
        let path = self.target.join(name);
        let refused = |reason: &str| put_in_place(&path, io::Error::other(reason));
        if path.is_dir() {
            return Err(refused("a folder has this name"));
        }
        let mut above = path.ancestors().skip(1);
        let Some(folder) = above.find(|folder| folder.symlink_metadata().is_ok()) else {
            return Err(refused("its folder is gone"));
        };
        if !folder.is_dir() {
            let reason = format!("`{}` is not a folder", folder.display());
            return Err(refused(&reason));
        }
        tempfile::tempfile_in(folder)
            .map(drop)
            .map_err(|error| put_in_place(&path, plain(error)))
    }
}

fn put_in_place(path: &Path, source: io::Error) -> ArtifactError {
    ArtifactError {
        path: path.to_owned(),
        action: "put in place",
        source,
    }
}

/// Without the name of a temporary file, which means nothing to the user.
fn plain(error: io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(code) => io::Error::from_raw_os_error(code),
        // What this program says itself has no kind, and stays.
        None if error.kind() == io::ErrorKind::Other => error,
        None => error.kind().into(),
    }
}

fn make_parent(path: &Path) -> Result<(), ArtifactError> {
    let Some(parent) = path.parent() else {
        return Ok(());
    };
    fs::create_dir_all(parent).map_err(|source| ArtifactError {
        path: parent.to_owned(),
        action: "create",
        source,
    })
}
