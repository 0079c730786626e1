//! Which files earlier runs put into a folder, and with which content.
//!
//! A hidden file in the folder lists them as `sha256sum` does. It is what lets a run remove what the plan no
//! longer has. It can have been edited, or come from anywhere, so it is believed little: only a plain name
//! below the folder counts, of a kind that is written here, and only a file whose content is the one listed
//! is ever removed. Whoever can name the content of a file in a folder that they can write to gains nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use crate::io::digest::sha256_hex_of_file;

/// The file that lists them.
pub(super) const MANIFEST: &str = ".rhinoplan.files";

/// A longer list is not read: what it lists then stays.
const MAX_BYTES: u64 = 64 << 20;

/// `<candidate>/<NN>-<stage>/<file>`
const MAX_DEPTH: usize = 3;

/// What the names of outputs end with.
const KINDS: [&str; 9] = [
    ".csv", ".json", ".md", ".nii.gz", ".nrrd", ".ply", ".png", ".stl", ".svg",
];

/// Files by their names, `/` between folders, with the SHA-256 that each was published with. There are
/// several of one name where a run did not come to its end.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Manifest(BTreeMap<String, BTreeSet<String>>);

impl Manifest {
    /// What is listed in a folder. Where there is no list, or none that can be read, that is nothing.
    pub(super) fn read(folder: &Path) -> Self {
        let path = folder.join(MANIFEST);
        let is_file = path.symlink_metadata().is_ok_and(|found| found.is_file());
        let mut text = String::new();
        let mut read = || {
            File::open(&path)?
                .take(MAX_BYTES + 1)
                .read_to_string(&mut text)
        };
        if !is_file || read().is_err() || text.len() as u64 > MAX_BYTES {
            return Self::default();
        }
        let mut manifest = Self::default();
        for line in text.lines() {
            if let Some((sha256, name)) = line.split_once("  ")
                && is_digest(sha256)
                && is_plain(name)
            {
                manifest.add(name.to_owned(), sha256.to_owned());
            }
        }
        manifest
    }

    pub(super) fn add(&mut self, name: String, sha256: String) {
        self.0.entry(name).or_default().insert(sha256);
    }

    /// With what `other` lists, too.
    pub(super) fn and(mut self, other: &Self) -> Self {
        for (name, digests) in &other.0 {
            let of_name = self.0.entry(name.clone()).or_default();
            of_name.extend(digests.iter().cloned());
        }
        self
    }

    /// The names alone.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// As it is written.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        for (name, digests) in &self.0 {
            for sha256 in digests {
                // Writing to a string does not fail.
                let _ = writeln!(text, "{sha256}  {name}");
            }
        }
        text
    }

    /// What `now` no longer has of this list.
    pub(super) fn left_over(&self, now: &[PathBuf], folder: &Path) -> LeftOver {
        let now: BTreeSet<_> = now.iter().filter_map(|name| plain_name(name)).collect();
        let mut left = LeftOver::default();
        for (name, digests) in self.0.iter().filter(|(name, _)| !now.contains(*name)) {
            match found_at(folder, name) {
                Found::Nothing => {}
                Found::File(path) => {
                    let found = sha256_hex_of_file(&path);
                    if found.is_ok_and(|found| digests.contains(&found)) {
                        left.files.push(name.clone());
                    } else {
                        left.changed.push(name.clone());
                    }
                }
                Found::Other => left.changed.push(name.clone()),
            }
            left.names.push(name.clone());
        }
        left
    }
}

/// Files that an earlier run wrote and this one does not.
#[derive(Debug, Default)]
pub(super) struct LeftOver {
    /// All that are listed, there or not.
    pub(super) names: Vec<String>,
    /// Those with the content that the earlier run gave them.
    pub(super) files: Vec<String>,
    /// Those that are no longer what the earlier run wrote.
    pub(super) changed: Vec<String>,
}

/// A name with `/` between folders, where it has no other parts.
pub(super) fn plain_name(name: &Path) -> Option<String> {
    let parts = name.components().map(|part| match part {
        Component::Normal(part) => part.to_str(),
        _ => None,
    });
    Some(parts.collect::<Option<Vec<_>>>()?.join("/"))
}

fn is_digest(text: &str) -> bool {
    text.len() == 64 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
}

/// Whether a name is one that an output can have: below the folder, nothing hidden, no other way to a folder.
pub fn is_plain(name: &str) -> bool {
    let is_part = |part: &str| {
        let known = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-' || b == b'.';
        !part.is_empty() && !part.starts_with('.') && part.bytes().all(known)
    };
    name.split('/').count() <= MAX_DEPTH
        && name.split('/').all(is_part)
        && KINDS.iter().any(|kind| name.ends_with(kind))
}

enum Found {
    Nothing,
    File(PathBuf),
    /// A link, a folder, or something that is reached through a link.
    Other,
}

/// The file that has this name in the folder, no link followed below it.
pub(super) fn look_at(folder: &Path, name: &str) -> Option<PathBuf> {
    match found_at(folder, name) {
        Found::File(path) => Some(path),
        Found::Nothing | Found::Other => None,
    }
}

/// What has this name in the folder, no link followed below it.
fn found_at(folder: &Path, name: &str) -> Found {
    let mut path = folder.to_owned();
    let mut parts = name.split('/').peekable();
    while let Some(part) = parts.next() {
        path.push(part);
        let Ok(found) = path.symlink_metadata() else {
            return Found::Nothing;
        };
        let is_last = parts.peek().is_none();
        if is_last && found.is_file() {
            return Found::File(path);
        }
        if is_last || !found.is_dir() {
            return Found::Other;
        }
    }
    Found::Nothing
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::io::digest::sha256_hex;

    fn folder_with(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, content) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, content).unwrap();
        }
        folder
    }

    #[test]
    fn what_is_written_is_read_again() {
        let mut manifest = Manifest::default();
        manifest.add("b/01-x/volume.nii.gz".to_owned(), sha256_hex(b"1"));
        manifest.add("a.csv".to_owned(), sha256_hex(b"2"));
        manifest.add("a.csv".to_owned(), sha256_hex(b"3"));
        let folder = folder_with(&[(MANIFEST, &manifest.text())]);
        assert_eq!(Manifest::read(folder.path()), manifest);
        let first = manifest.text();
        assert_eq!(first.lines().count(), 3);
        let mut other = Manifest::default();
        other.add("c.png".to_owned(), sha256_hex(b"4"));
        assert_eq!(manifest.clone().and(&other).text().lines().count(), 4);
        assert_eq!(manifest.clone().and(&manifest), manifest);
    }

    #[test]
    fn only_plain_names_of_outputs_count() {
        let digest = sha256_hex(b"mine");
        let hostile = [
            "../mine.png",
            "/mine.png",
            "a/../../mine.png",
            "./mine.png",
            "a//mine.png",
            ".hidden.png",
            ".hidden/mine.png",
            "mine.toml",
            "mine",
            ".png",
            "a/b/c/mine.png",
            "C:mine.png",
            "a\\mine.png",
            "mine.png\0",
            "Mine.png",
            "",
        ];
        for name in hostile {
            assert!(!is_plain(name), "{name}");
            let text = format!("{digest}  {name}\n");
            let folder = folder_with(&[(MANIFEST, &text)]);
            assert_eq!(Manifest::read(folder.path()), Manifest::default(), "{name}");
        }
        for line in [
            format!("{}  mine.png", &digest[1..]),
            format!("{}  mine.png", digest.to_uppercase()),
            format!("{digest} mine.png"),
            format!("{digest} *mine.png"),
            "mine.png".to_owned(),
        ] {
            let folder = folder_with(&[(MANIFEST, &line)]);
            assert_eq!(Manifest::read(folder.path()), Manifest::default(), "{line}");
        }
        for name in [
            "run.json",
            "a/01-b/volume.nii.gz",
            "preoperative/view-x.png",
        ] {
            assert!(is_plain(name), "{name}");
        }
    }

    #[test]
    fn a_list_that_cannot_be_read_lists_nothing() {
        let folder = folder_with(&[]);
        assert_eq!(Manifest::read(folder.path()), Manifest::default());
        fs::write(folder.path().join(MANIFEST), b"\xff\xfe").unwrap();
        assert_eq!(Manifest::read(folder.path()), Manifest::default());
        fs::remove_file(folder.path().join(MANIFEST)).unwrap();
        fs::create_dir(folder.path().join(MANIFEST)).unwrap();
        assert_eq!(Manifest::read(folder.path()), Manifest::default());
    }

    #[test]
    fn only_files_with_the_content_listed_are_left_over() {
        let folder = folder_with(&[
            ("same.png", "same"),
            ("changed.png", "mine"),
            ("still.png", "same"),
            ("a/01-b/same.stl", "same"),
            ("folder.png/x", ""),
        ]);
        let mut manifest = Manifest::default();
        for name in [
            "same.png",
            "changed.png",
            "still.png",
            "a/01-b/same.stl",
            "folder.png",
            "gone.png",
        ] {
            manifest.add(name.to_owned(), sha256_hex(b"same"));
        }
        let left = manifest.left_over(&["still.png".into()], folder.path());
        assert_eq!(left.files, ["a/01-b/same.stl", "same.png"]);
        assert_eq!(left.changed, ["changed.png", "folder.png"]);
        assert_eq!(left.names.len(), 5);
    }

    #[cfg(unix)]
    #[test]
    fn nothing_is_reached_through_a_link() {
        use std::os::unix::fs::symlink;
        let folder = folder_with(&[("real/x.png", "same"), ("x.png", "same")]);
        let elsewhere = folder_with(&[("x.png", "same")]);
        symlink(elsewhere.path(), folder.path().join("away")).unwrap();
        symlink("real", folder.path().join("near")).unwrap();
        symlink("x.png", folder.path().join("link.png")).unwrap();
        let mut manifest = Manifest::default();
        for name in ["away/x.png", "near/x.png", "link.png"] {
            manifest.add(name.to_owned(), sha256_hex(b"same"));
        }
        let left = manifest.left_over(&[], folder.path());
        assert!(left.files.is_empty(), "{left:?}");
        assert_eq!(left.changed.len(), 3);
    }
}
