//! The outputs of a run, put in place together.
//!
//! Files are written into a hidden folder beside where they will be, and renamed into place by
//! [`Staging::publish`], in the order in which they were begun. A run that fails leaves what earlier runs
//! wrote as it was.

use std::fs;
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
        fs::create_dir_all(target).map_err(failed)?;
        let hidden = tempfile::Builder::new()
            .prefix(".rhinoplan-")
            .tempdir_in(target)
            .map_err(failed)?;
        Ok(Self {
            target: target.to_owned(),
            hidden: Some(hidden),
            files: Vec::new(),
        })
    }

    /// Where to write the file that will be `name` in the target folder; folders on the way are made.
    ///
    /// # Errors
    /// [`ArtifactError`] where a folder cannot be made.
    pub fn begin(&mut self, name: impl AsRef<Path>) -> Result<PathBuf, ArtifactError> {
        let name = name.as_ref();
        let path = self.hidden_folder().join(name);
        make_parent(&path)?;
        self.files.push(name.to_owned());
        Ok(path)
    }

    /// Puts every file in place, in the order of [`Staging::begin`], over those that were there.
    ///
    /// # Errors
    /// [`ArtifactError`] for the first file that cannot be put in place; those before it are.
    pub fn publish(self) -> Result<Vec<PathBuf>, ArtifactError> {
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

    fn hidden_folder(&self) -> &Path {
        self.hidden.as_ref().map_or(&self.target, TempDir::path)
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        self.hidden = None;
        // Only succeeds where nothing was there before and nothing came of it.
        let _ = fs::remove_dir(&self.target);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

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
        let target = root.path().join("plan");
        drop(Staging::new(&target).unwrap());
        assert!(!target.exists());
    }
}
