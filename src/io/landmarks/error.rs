//! What can be wrong with a file of landmarks.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::{CoordinateSystem, MAX_LANDMARK_BYTES};
use crate::feature::Landmark;

/// A file of landmarks that cannot be used, and why.
#[derive(Debug, Error)]
#[error("the landmark file `{}` {problem}", path.display())]
pub struct LandmarkFileError {
    /// The file, as the user named it.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: LandmarkFileProblem,
}

impl LandmarkFileError {
    pub(super) fn new(path: &Path, problem: LandmarkFileProblem) -> Self {
        Self {
            path: path.to_owned(),
            problem,
        }
    }
}

/// What is wrong with a file of landmarks, and a remedy where one is plain.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LandmarkFileProblem {
    /// The system will not open or read it.
    #[error("cannot be read: {0}")]
    Io(io::Error),
    /// A folder, a pipe or a device.
    #[error("is {found}, not a file")]
    NotAFile {
        /// "a folder" or the like.
        found: &'static str,
    },
    /// Nothing in it.
    #[error("is empty; save the markups again")]
    Empty,
    /// Larger than any file of six points.
    #[error("is larger than {MAX_LANDMARK_BYTES} bytes; is it a file of landmarks?")]
    TooLarge,
    /// Not text.
    #[error(
        "is not UTF-8 text: byte {offset} (counted from 0) belongs to no character; save it as UTF-8"
    )]
    NotUtf8 {
        /// The first byte that is not UTF-8, from 0.
        offset: usize,
    },
    /// Neither of the two formats.
    #[error(
        "is neither markups JSON, which begins with `{{`, nor .fcsv, which begins with `#`; save it from 3D Slicer as .mrk.json"
    )]
    Foreign,
    /// Not JSON, or not of markups.
    #[error("is not markups JSON: {}", json(.0))]
    Json(serde_json::Error),
    /// A line of an .fcsv file that is no point.
    #[error("is not a .fcsv file: line {line}: {what}")]
    Table {
        /// From 1.
        line: u64,
        /// What is wrong there.
        what: String,
    },
    /// No coordinate system that is known.
    #[error("{found}; expected `LPS` or `RAS`: save the markups again")]
    System {
        /// What it says of its coordinate system.
        found: String,
    },
    /// Several coordinate systems.
    #[error("holds markups in {} and in {}; save them as one point list", .0.name(), .1.name())]
    Systems(CoordinateSystem, CoordinateSystem),
    /// Another unit than mm.
    #[error("gives coordinates in {found}; expected `mm`: save the markups again in mm")]
    Units {
        /// The unit found.
        found: String,
    },
    /// Points that are not the six landmarks.
    #[error("{0}")]
    Points(PointFaults),
}

/// Everything that is wrong with the points of a file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PointFaults {
    /// Landmarks without a point; with the status of one that has no position.
    pub missing: Vec<(Landmark, Option<String>)>,
    /// Landmarks that several points are labelled with.
    pub double: Vec<Landmark>,
    /// Labels that are no landmark's name, with the one that was probably meant.
    pub unknown: Vec<(String, Option<Landmark>)>,
    /// Landmarks whose position is not three finite numbers, with what it is.
    pub bad: Vec<(Landmark, String)>,
}

impl PointFaults {
    /// Whether nothing is wrong.
    pub fn is_empty(&self) -> bool {
        self.missing.is_empty()
            && self.double.is_empty()
            && self.unknown.is_empty()
            && self.bad.is_empty()
    }
}

/// Labels that a message lists; more are counted.
const MAX_LISTED: usize = 10;
/// Characters of a label that a message repeats.
const MAX_SHOWN: usize = 48;

impl fmt::Display for PointFaults {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut parts = Vec::new();
        if !self.missing.is_empty() {
            let names = self.missing.iter().map(|(landmark, status)| match status {
                Some(status) => format!("`{landmark}` (its position is {})", shown(status)),
                None => format!("`{landmark}`"),
            });
            parts.push(format!("has no {}", joined(names, " and no ")));
        }
        if !self.double.is_empty() {
            let names = self.double.iter().map(|landmark| format!("`{landmark}`"));
            parts.push(format!("has more than one {}", joined(names, " and ")));
        }
        if !self.unknown.is_empty() {
            let names = self.unknown.iter().map(|(label, meant)| match meant {
                Some(meant) => format!("`{}` (did you mean `{meant}`?)", shown(label)),
                None if label.is_empty() => "a point without a label".to_owned(),
                None => format!("`{}`", shown(label)),
            });
            let names = joined(names, ", ");
            parts.push(format!("has points that are no landmark: {names}"));
        }
        for (landmark, found) in &self.bad {
            parts.push(format!(
                "gives `{landmark}` the position {}, which is not three finite numbers",
                shown(found)
            ));
        }
        to.write_str(&parts.join("; "))
    }
}

fn joined(names: impl ExactSizeIterator<Item = String>, with: &str) -> String {
    let more = names.len().saturating_sub(MAX_LISTED);
    let listed: Vec<String> = names.take(MAX_LISTED).collect();
    let listed = listed.join(with);
    if more > 0 {
        format!("{listed} and {more} more")
    } else {
        listed
    }
}

/// Characters of the JSON reader's message that are repeated.
const MAX_JSON: usize = 120;

/// What the JSON reader says, which may quote a text of the file in whole, and ends with the place.
fn json(error: &serde_json::Error) -> String {
    let message = error.to_string();
    let place = format!(" at line {} column {}", error.line(), error.column());
    let (what, place) = match message.strip_suffix(&place) {
        Some(what) => (what, place.as_str()),
        None => (message.as_str(), ""),
    };
    let length = what.chars().count();
    if length <= MAX_JSON {
        return format!("{what}{place}");
    }
    // What was found is at the beginning, what is expected at the end.
    let start: String = what.chars().take(MAX_JSON / 2).collect();
    let end: String = what.chars().skip(length - MAX_JSON / 2).collect();
    format!("{start}…{end}{place}")
}

/// The file's text for a message: control characters escaped, shortened where it is long.
pub(super) fn shown(text: &str) -> String {
    crate::text::shown(text, MAX_SHOWN)
}
