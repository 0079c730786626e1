//! Output files that appear under their name whole or not at all.
//!
//! An [`Artifact`] is written under a temporary name in the folder of the file to be, and renamed by
//! [`Artifact::commit`]; a rename within a folder is atomic. A run that fails, or an [`Artifact`] that is
//! dropped, leaves the folder as it was (a killed process may leave the hidden temporary file).

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};

use tempfile::NamedTempFile;
use thiserror::Error;

/// What the names of temporary files and folders begin with.
pub(super) const HIDDEN: &str = ".rhinoplan-";

/// Why an output file was not written. Nothing stands under its name but what stood there before.
#[derive(Debug, Error)]
#[error("cannot {action} `{}`: {source}{}", shown(path), remedy(source))]
pub struct ArtifactError {
    /// The file that was to be, or its folder.
    pub path: PathBuf,
    /// What failed, as in "cannot create".
    pub action: &'static str,
    /// What the system said.
    pub source: io::Error,
}

/// A path where the user looks for it: a file on its way through a hidden folder will not be there.
fn shown(path: &Path) -> String {
    let is_hidden = |part: &Component<'_>| part.as_os_str().to_string_lossy().starts_with(HIDDEN);
    let known = path.components().filter(|part| !is_hidden(part));
    known.collect::<PathBuf>().display().to_string()
}

/// What the user can do, where the system's words do not say it.
fn remedy(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "; make room, or choose another folder"
        }
        io::ErrorKind::FileTooLarge => {
            "; raise the limit on the size of a file, or choose a folder on another disk"
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "; choose a folder that you may write to"
        }
        _ => "",
    }
}

/// Writes a whole file.
///
/// # Errors
/// As [`Artifact::create`] and [`Artifact::commit`].
pub fn save(path: &Path, bytes: &[u8]) -> Result<(), ArtifactError> {
    let mut artifact = Artifact::create(path)?;
    artifact
        .write_all(bytes)
        .map_err(|error| artifact.failed(error))?;
    artifact.commit()
}

/// A file being written.
#[derive(Debug)]
pub struct Artifact {
    to: BufWriter<Unnamed>,
    path: PathBuf,
}

/// A temporary file whose errors are the system's own: the library adds its name, which means nothing to the user.
#[derive(Debug)]
struct Unnamed(NamedTempFile);

impl Write for Unnamed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.as_file_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.as_file_mut().flush()
    }
}

impl Artifact {
    /// Begins the file `path`. Its folder must exist.
    ///
    /// # Errors
    /// [`ArtifactError`] where the folder is missing or cannot be written to, or `path` is a folder.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self, ArtifactError> {
        let path = path.into();
        match temporary_beside(&path) {
            Ok(file) => Ok(Self::over(file, path)),
            Err(source) => Err(ArtifactError {
                path,
                action: "create",
                source,
            }),
        }
    }

    fn over(file: NamedTempFile, path: PathBuf) -> Self {
        Self {
            to: BufWriter::new(Unnamed(file)),
            path,
        }
    }

    /// The name that the file will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// An error of writing to this file, with its name.
    pub fn failed(&self, source: io::Error) -> ArtifactError {
        ArtifactError {
            path: self.path.clone(),
            action: "write",
            source,
        }
    }

    /// Writes out what is buffered, has the system store it, and gives the file its name, in place of
    /// one that had it.
    ///
    /// # Errors
    /// [`ArtifactError`] where bytes could not be stored (a full disk shows here at the latest) or the
    /// file could not be renamed. Nothing is left behind.
    pub fn commit(self) -> Result<(), ArtifactError> {
        let Self { to, path } = self;
        let stored = to
            .into_inner()
            .map_err(|error| error.into_error())
            .and_then(|Unnamed(file)| {
                // Only this reports the errors of delayed writing; without it a full disk could pass.
                file.as_file().sync_all()?;
                Ok(file)
            });
        let error = match stored {
            Ok(file) => match file.persist(&path) {
                Ok(_) => return Ok(()),
                Err(error) => ("put in place", error.error),
            },
            Err(error) => ("write", error),
        };
        Err(ArtifactError {
            path,
            action: error.0,
            source: error.1,
        })
    }
}

impl Write for Artifact {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.to.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

/// An empty file in the folder of `path`, hidden, and with the rights that a file made in the plain way
/// would have: the mode goes to `open`, where the system takes the user's umask off it. (Temporary
/// files are private by default, and a rename keeps that.)
fn temporary_beside(path: &Path) -> io::Result<NamedTempFile<File>> {
    if path.file_name().is_none() {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "this is not the name of a file",
        ));
    }
    if path.is_dir() {
        return Err(io::Error::new(
            io::ErrorKind::IsADirectory,
            "a folder has this name",
        ));
    }
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(HIDDEN).suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder).map_err(|error| {
        // The library's own message names the temporary file, which means nothing to the user.
        match error.kind() {
            io::ErrorKind::NotFound => {
                io::Error::new(io::ErrorKind::NotFound, "its folder does not exist")
            }
            kind => error
                .raw_os_error()
                .map_or_else(|| kind.into(), io::Error::from_raw_os_error),
        }
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::io::tests::names;

    #[test]
    fn the_file_has_its_name_only_after_commit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scan.v2.nii");
        let mut artifact = Artifact::create(&path).unwrap();
        artifact.write_all(b"whole").unwrap();
        assert!(!path.exists());
        assert_eq!(
            names(folder.path()).len(),
            1,
            "the temporary file is in the same folder"
        );
        artifact.commit().unwrap();
        assert_eq!(names(folder.path()), ["scan.v2.nii"]);
        assert_eq!(fs::read(&path).unwrap(), b"whole");
    }

    #[test]
    fn a_dropped_file_leaves_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.json");
        fs::write(&path, "before").unwrap();
        let mut artifact = Artifact::create(&path).unwrap();
        artifact.write_all(&[0; 100_000]).unwrap();
        drop(artifact);
        assert_eq!(names(folder.path()), ["run.json"]);
        assert_eq!(fs::read(&path).unwrap(), b"before");
        let mut artifact = Artifact::create(&path).unwrap();
        artifact.write_all(b"after").unwrap();
        artifact.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"after");
    }

    #[cfg(unix)]
    #[test]
    fn rights_are_those_of_a_plain_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let plain = folder.path().join("plain");
        fs::write(&plain, "").unwrap();
        let path = folder.path().join("artifact");
        Artifact::create(&path).unwrap().commit().unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&path), mode(&plain));
    }

    /// The bytes fit the buffer, so that only the commit can see that the disk is full.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("volume.nii");
        let (_, temporary) = NamedTempFile::new_in(folder.path()).unwrap().into_parts();
        let full = File::options().write(true).open("/dev/full").unwrap();
        let mut artifact = Artifact::over(NamedTempFile::from_parts(full, temporary), path.clone());
        artifact.write_all(b"a few bytes").unwrap();
        let error = artifact.commit().unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::StorageFull);
        assert!(!error.to_string().contains(HIDDEN), "{error}");
        assert_eq!((error.action, &error.path), ("write", &path));
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_missing_folder_and_a_folder_in_the_way_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("nowhere").join("a.csv");
        let error = Artifact::create(&missing).unwrap_err();
        assert_eq!(error.action, "create");
        assert!(error.to_string().contains("nowhere"), "{error}");
        let error = Artifact::create(folder.path()).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::IsADirectory);
        assert!(Artifact::create("..").is_err());
    }

    #[test]
    fn errors_name_the_file_where_it_will_be_and_what_to_do() {
        let message = |kind: io::ErrorKind, path: &str| {
            let (path, source) = (path.into(), kind.into());
            let action = "write";
            ArtifactError {
                path,
                action,
                source,
            }
            .to_string()
        };
        let full = message(
            io::ErrorKind::StorageFull,
            "out/x/.rhinoplan-a1b2c3/a/volume.nii.gz",
        );
        assert!(
            full.starts_with("cannot write `out/x/a/volume.nii.gz`: "),
            "{full}"
        );
        assert!(
            full.ends_with("; make room, or choose another folder"),
            "{full}"
        );
        let plain = message(io::ErrorKind::NotADirectory, "../a.b/c");
        assert!(
            plain.starts_with("cannot write `../a.b/c`: ") && !plain.contains(';'),
            "{plain}"
        );
    }

    /// A folder that takes the name while the file is being written.
    #[test]
    fn a_failed_rename_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("late");
        let artifact = Artifact::create(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert_eq!(artifact.commit().unwrap_err().action, "put in place");
        assert_eq!(names(folder.path()), ["late"]);
    }
}
