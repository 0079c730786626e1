//! One run at a time into a folder.
//!
//! The system takes the lock away with the process that holds it, however that ends, so there is no stale
//! lock: a file that a killed run left locks nothing.

use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// The file that is locked. It is empty: it names no process, user or machine.
pub(super) const LOCK: &str = ".rhinoplan.lock";

/// How often to begin again where the file goes away between being opened and being locked.
const ATTEMPTS: usize = 20;

/// A folder's lock, held until this is dropped.
#[derive(Debug)]
pub(super) struct Lock {
    /// Open as long as the lock is held.
    file: File,
    path: PathBuf,
}

/// What came of asking for a lock.
#[derive(Debug)]
pub(super) enum Asked {
    Held(Lock),
    /// Another run holds it.
    Busy,
    /// The file system has no locks, and said this.
    None(io::Error),
}

impl Lock {
    /// Asks for the lock of a folder, and does not wait for it. `make_folder` is called first: the folder goes
    /// away with a run that was the first and failed, perhaps between two steps of this one.
    pub(super) fn ask(
        folder: &Path,
        mut make_folder: impl FnMut(&Path) -> io::Result<()>,
    ) -> io::Result<Asked> {
        let path = folder.join(LOCK);
        let mut gone = io::Error::from(io::ErrorKind::NotFound);
        for _ in 0..ATTEMPTS {
            make_folder(folder)?;
            let file = match open(&path) {
                Ok(file) => file,
                Err(error) if error.kind() == io::ErrorKind::NotFound => {
                    gone = error;
                    continue;
                }
                Err(error) => return Err(error),
            };
            match file.try_lock() {
                Ok(()) if is_at(&file, &path) => return Ok(Asked::Held(Self { file, path })),
                // The run that held it ended and took the file away: this lock would stop nobody.
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Ok(Asked::Busy),
                Err(TryLockError::Error(error)) => return Ok(Asked::None(error)),
            }
        }
        Err(gone)
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Only while it is locked, so that nobody else can hold it. Where it cannot be told whether an open
        // file is still the one of that name, it stays: see `is_at`.
        if cfg!(unix) && is_at(&self.file, &self.path) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

fn open(path: &Path) -> io::Result<File> {
    // A pipe would block, and a link could lead anywhere.
    if path.symlink_metadata().is_ok_and(|found| !found.is_file()) {
        let reason = format!("`{LOCK}` in it is not a file; remove it");
        return Err(io::Error::other(reason));
    }
    File::options()
        .write(true)
        .create(true)
        .truncate(false)
        .open(path)
        // One that a killed run of another user left can be locked all the same.
        .or_else(|error| File::open(path).map_err(|_| error))
}

/// Whether an open file is still the one with this name.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), path.symlink_metadata()) {
        (Ok(open), Ok(named)) => (open.dev(), open.ino()) == (named.dev(), named.ino()),
        _ => false,
    }
}

/// Nobody removes it there, so it is.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::io::tests::names;

    fn ask(folder: &Path) -> Asked {
        Lock::ask(folder, |folder| fs::create_dir_all(folder)).unwrap()
    }

    fn held(folder: &Path) -> Lock {
        match ask(folder) {
            Asked::Held(lock) => lock,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn one_holds_it_and_the_next_gets_it_afterwards() {
        let folder = tempfile::tempdir().unwrap();
        for _ in 0..3 {
            let lock = held(folder.path());
            assert!(matches!(ask(folder.path()), Asked::Busy));
            assert_eq!(names(folder.path()), [LOCK]);
            assert_eq!(fs::read(folder.path().join(LOCK)).unwrap(), b"");
            drop(lock);
            #[cfg(unix)]
            assert!(names(folder.path()).is_empty());
        }
    }

    #[test]
    fn a_file_that_a_killed_run_left_locks_nothing() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(LOCK), "").unwrap();
        drop(held(folder.path()));
    }

    #[cfg(unix)]
    #[test]
    fn a_lock_on_a_file_that_was_taken_away_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let first = held(folder.path());
        fs::remove_file(folder.path().join(LOCK)).unwrap();
        let second = held(folder.path());
        drop(first);
        assert!(
            matches!(ask(folder.path()), Asked::Busy),
            "it is the second's"
        );
        drop(second);
        assert!(names(folder.path()).is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_file_is_not_opened() {
        let root = tempfile::tempdir().unwrap();
        let (folder, elsewhere) = (root.path().join("out"), root.path().join("elsewhere"));
        fs::create_dir(&folder).unwrap();
        std::os::unix::fs::symlink(&elsewhere, folder.join(LOCK)).unwrap();
        let error = Lock::ask(&folder, |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("remove it"), "{error}");
        assert!(!elsewhere.exists());
    }

    /// Many at once, each of which makes and removes the folder: at any time at most one holds it.
    #[test]
    fn at_most_one_of_many_holds_it() {
        use std::sync::atomic::{AtomicUsize, Ordering};
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("out");
        let (inside, got) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        // An attempt may find the folder gone under it too often; that is no lock either.
                        let asked = Lock::ask(&folder, |folder| fs::create_dir_all(folder));
                        if let Ok(Asked::Held(lock)) = asked {
                            assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                            std::thread::yield_now();
                            inside.fetch_sub(1, Ordering::SeqCst);
                            got.fetch_add(1, Ordering::SeqCst);
                            drop(lock);
                            let _ = fs::remove_dir(&folder);
                        }
                    }
                });
            }
        });
        assert!(got.into_inner() > 10);
    }
}
