//! The outputs of a run, put in place together.
//!
//! Files are written into a hidden folder beside where they will be, and renamed into place by
//! [`Staging::publish`], in the order in which they were begun. A run that fails leaves what earlier runs
//! wrote as it was: a file that could not be put in place is found before the first one is. (A disk that
//! fails between two renames can still leave new files beside old ones; `run.json` is then the old one.)

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::artifact::ArtifactError;

/// The files of a run that is not finished.
#[derive(Debug)]
pub struct Staging {
    target: PathBuf,
    /// Taken when the hidden folder is removed, which must come before the target folder is tried.
    hidden: Option<TempDir>,
    files: Vec<PathBuf>,
    /// Folders made for the target, the target first.
    made: Vec<PathBuf>,
}

impl Staging {
    /// Makes the folder `target`, and the hidden one in it.
    ///
    /// # Errors
    /// [`ArtifactError`] where a folder cannot be made.
    pub fn new(target: &Path) -> Result<Self, ArtifactError> {
        let failed = |source| ArtifactError {
            path: target.to_owned(),
            action: "create",
            source,
        };
        let missing = target
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists());
        // What is made from here on goes away again with this value, if nothing comes of it.
        let mut staging = Self {
            target: target.to_owned(),
            hidden: None,
            files: Vec::new(),
            made: missing.map(Path::to_owned).collect(),
        };
        fs::create_dir_all(target).map_err(failed)?;
        let hidden = tempfile::Builder::new()
            .prefix(".rhinoplan-")
            .tempdir_in(target)
            .map_err(|error| failed(plain(error)))?;
        staging.hidden = Some(hidden);
        Ok(staging)
    }

    /// Where to write the file that will be `name` in the target folder; folders on the way are made.
    ///
    /// # Errors
    /// [`ArtifactError`] where a folder cannot be made, or the file could not be put in place.
    pub fn begin(&mut self, name: impl AsRef<Path>) -> Result<PathBuf, ArtifactError> {
        let name = name.as_ref();
        self.check(name)?;
        let path = self.hidden_folder().join(name);
        make_parent(&path)?;
        self.files.push(name.to_owned());
        Ok(path)
    }

    /// Puts every file in place, in the order of [`Staging::begin`], over those that were there.
    ///
    /// # Errors
    /// [`ArtifactError`] for the first file that cannot be put in place; then none is.
    pub fn publish(self) -> Result<Vec<PathBuf>, ArtifactError> {
        for name in &self.files {
            self.check(name)?;
        }
        let mut published = Vec::with_capacity(self.files.len());
        for name in &self.files {
            let path = self.target.join(name);
            make_parent(&path)?;
            fs::rename(self.hidden_folder().join(name), &path).map_err(|source| ArtifactError {
                path: path.clone(),
                action: "put in place",
                source,
            })?;
            published.push(path);
        }
        Ok(published)
    }

    /// Whether a file could be renamed to `name` in the target folder, as far as that can be told.
    fn check(&self, name: &Path) -> Result<(), ArtifactError> {
        let path = self.target.join(name);
        let refused = |reason: &str| ArtifactError {
            path: path.clone(),
            action: "put in place",
            source: io::Error::other(reason),
        };
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
            .map_err(|error| ArtifactError {
                path: path.clone(),
                action: "put in place",
                source: plain(error),
            })
    }

    fn hidden_folder(&self) -> &Path {
        self.hidden.as_ref().map_or(&self.target, TempDir::path)
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        self.hidden = None;
        for folder in &self.made {
            // Fails where something is in it: the run succeeded, or someone else uses it.
            let _ = fs::remove_dir(folder);
        }
    }
}

/// Without the name of a temporary file, which means nothing to the user.
fn plain(error: io::Error) -> io::Error {
    error
        .raw_os_error()
        .map_or_else(|| error.kind().into(), io::Error::from_raw_os_error)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::tests::names;

    #[test]
    fn files_appear_together_and_nothing_else_does() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("a/plan");
        let mut staging = Staging::new(&target).unwrap();
        fs::write(staging.begin("one/two.txt").unwrap(), "2").unwrap();
        fs::write(staging.begin("run.json").unwrap(), "{}").unwrap();
        assert_eq!(names(&target).len(), 1, "only the hidden folder");
        staging.publish().unwrap();
        assert_eq!(names(&target), ["one", "run.json"]);
        assert_eq!(fs::read_to_string(target.join("one/two.txt")).unwrap(), "2");
    }

    #[test]
    fn a_run_that_fails_leaves_what_was_there() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("plan");
        let mut first = Staging::new(&target).unwrap();
        fs::write(first.begin("run.json").unwrap(), "first").unwrap();
        first.publish().unwrap();
        let mut second = Staging::new(&target).unwrap();
        fs::write(second.begin("run.json").unwrap(), "second").unwrap();
        drop(second);
        assert_eq!(names(&target), ["run.json"]);
        assert_eq!(
            fs::read_to_string(target.join("run.json")).unwrap(),
            "first"
        );
    }

    #[test]
    fn a_first_run_that_fails_leaves_no_folder() {
        let root = tempfile::tempdir().unwrap();
        drop(Staging::new(&root.path().join("out/plan")).unwrap());
        assert!(names(root.path()).is_empty());
    }

    #[test]
    fn folders_that_were_there_stay() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("out/plan");
        fs::create_dir_all(&target).unwrap();
        drop(Staging::new(&target).unwrap());
        assert!(target.exists());
        fs::write(root.path().join("file"), "").unwrap();
        assert!(Staging::new(&root.path().join("file/plan")).is_err());
        assert_eq!(names(root.path()), ["file", "out"]);
    }

    #[test]
    fn nothing_is_put_in_place_where_something_cannot_be() {
        let root = tempfile::tempdir().unwrap();
        let old = root.path().join("a.txt");
        fs::write(&old, "old").unwrap();
        // What stands in the way is known at once, or comes while the run is at work.
        for late in [false, true] {
            for (obstacle, name) in [("stage", "stage/volume"), ("run.json/x", "run.json")] {
                let obstacle = root.path().join(obstacle);
                let block = || {
                    make_parent(&obstacle).unwrap();
                    fs::write(&obstacle, "").unwrap();
                };
                if !late {
                    block();
                }
                let mut staging = Staging::new(root.path()).unwrap();
                fs::write(staging.begin("a.txt").unwrap(), "new").unwrap();
                let error = match staging.begin(name) {
                    Ok(path) => {
                        fs::write(path, "new").unwrap();
                        block();
                        staging.publish().unwrap_err()
                    }
                    Err(error) => {
                        assert!(!late);
                        drop(staging);
                        error
                    }
                };
                assert!(error.path.ends_with(name), "{error}");
                assert_eq!(fs::read_to_string(&old).unwrap(), "old");
                let blocker = root
                    .path()
                    .join(if name == "run.json" { name } else { "stage" });
                if blocker.is_dir() {
                    fs::remove_dir_all(blocker).unwrap();
                } else {
                    fs::remove_file(blocker).unwrap();
                }
                assert_eq!(names(root.path()), ["a.txt"]);
            }
        }
    }
}
