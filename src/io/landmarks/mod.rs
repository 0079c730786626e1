//! Landmarks that were placed in 3D Slicer: markups JSON (`.mrk.json`) and fiducial tables (`.fcsv`), told
//! apart by content, never by name.
//!
//! Points are found by their labels, which are the six landmarks' names. Whatever else a file holds (its
//! display, orientations, descriptions) is not looked at.
//!
//! # What is read
//! - Markups JSON of any schema version: the control points of all markups. `coordinateSystem` is `LPS` or
//!   `RAS`; where it is not given it is LPS, the default of Slicer's schema. `coordinateUnits` is mm, given
//!   or not.
//! - `.fcsv`: the columns that the header names, else Slicer's. The header must give `CoordinateSystem`:
//!   `LPS`, `RAS`, or a number of earlier versions, of which Slicer's developer guide ("Markups fiducial
//!   point list file format") says that RAS was 0 and LPS was 1.
//! - A point whose position is not `defined` (a placeholder, or one that is being placed) is not there.
//! - UTF-8 with or without a byte order mark, lines ended in either way.

mod error;
mod fcsv;
mod json;

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::feature::{Landmark, Landmarks};
use crate::io::digest;
use crate::space::{LpsPoint, RasPoint};

pub use error::{LandmarkFileError, LandmarkFileProblem, PointFaults};

/// The largest file that is read, bytes. Six points take three thousand.
pub const MAX_LANDMARK_BYTES: u64 = 1 << 20;

/// What the numbers of a file mean, mm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CoordinateSystem {
    /// x to the left, y to posterior, z to superior.
    Lps,
    /// x to the right, y to anterior, z to superior.
    Ras,
}

impl CoordinateSystem {
    /// As 3D Slicer writes it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lps => "LPS",
            Self::Ras => "RAS",
        }
    }

    fn from_name(name: &str) -> Option<Self> {
        match name {
            "LPS" => Some(Self::Lps),
            "RAS" => Some(Self::Ras),
            _ => None,
        }
    }
}

/// The six landmarks of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct LandmarkFile {
    /// What the numbers mean.
    pub system: CoordinateSystem,
    /// The numbers as they are in the file, mm: finite.
    pub points: Landmarks<[f64; 3]>,
    /// SHA-256 of the file's bytes, hexadecimal.
    pub sha256: String,
}

impl LandmarkFile {
    /// The positions in the patient's frame.
    pub fn lps(&self) -> Landmarks<LpsPoint> {
        self.points.map(|point| match self.system {
            CoordinateSystem::Lps => LpsPoint::from(point),
            CoordinateSystem::Ras => LpsPoint::from(RasPoint::from(point)),
        })
    }
}

/// Reads the landmarks of a file.
///
/// # Errors
/// [`LandmarkFileError`] names the file and what is wrong with it: every point that is missing, double,
/// unknown or at no position at once.
pub fn read(path: &Path) -> Result<LandmarkFile, LandmarkFileError> {
    let read = || parse(&bytes(path)?);
    read().map_err(|problem| LandmarkFileError::new(path, problem))
}

/// The bytes of a file, if it is one, and not too large.
fn bytes(path: &Path) -> Result<Vec<u8>, LandmarkFileProblem> {
    // Asked before opening: opening a pipe would wait for someone to write to it.
    let metadata = fs::metadata(path).map_err(LandmarkFileProblem::Io)?;
    if metadata.is_dir() {
        return Err(LandmarkFileProblem::NotAFile { found: "a folder" });
    }
    if !metadata.is_file() {
        return Err(LandmarkFileProblem::NotAFile {
            found: "a pipe or a device",
        });
    }
    let file = File::open(path).map_err(LandmarkFileProblem::Io)?;
    let mut bytes = Vec::new();
    let mut limited = file.take(MAX_LANDMARK_BYTES + 1);
    limited
        .read_to_end(&mut bytes)
        .map_err(LandmarkFileProblem::Io)?;
    if bytes.len() as u64 > MAX_LANDMARK_BYTES {
        return Err(LandmarkFileProblem::TooLarge);
    }
    Ok(bytes)
}

/// The landmarks in a file's bytes.
///
/// # Errors
/// As [`read`], without the file's name.
pub fn parse(bytes: &[u8]) -> Result<LandmarkFile, LandmarkFileProblem> {
    let text = std::str::from_utf8(bytes).map_err(|error| LandmarkFileProblem::NotUtf8 {
        offset: error.valid_up_to(),
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let list = match text.trim_start().chars().next() {
        None => return Err(LandmarkFileProblem::Empty),
        Some('{') => json::parse(text)?,
        Some('#') => fcsv::parse(text)?,
        Some(_) => return Err(LandmarkFileProblem::Foreign),
    };
    Ok(LandmarkFile {
        system: list.system,
        points: choose(list.points)?,
        sha256: digest::hex(&Sha256::digest(bytes)),
    })
}

/// The points of a file of either kind.
#[derive(Debug)]
struct PointList {
    system: CoordinateSystem,
    points: Vec<ControlPoint>,
}

/// A point, as far as it can be read.
#[derive(Debug)]
struct ControlPoint {
    label: String,
    position: Position,
}

#[derive(Debug)]
enum Position {
    /// Three finite numbers.
    At([f64; 3]),
    /// Not placed yet; the word for it.
    NotPlaced(String),
    /// What is there instead of three finite numbers.
    Bad(String),
}

/// The landmarks among the points, each found once.
fn choose(points: Vec<ControlPoint>) -> Result<Landmarks<[f64; 3]>, LandmarkFileProblem> {
    let mut faults = PointFaults::default();
    let mut found: Landmarks<Option<[f64; 3]>> = Landmarks::none();
    let mut seen: Vec<Landmark> = Vec::new();
    let mut not_placed: Vec<(Landmark, String)> = Vec::new();
    for point in points {
        let label = point.label.trim();
        let landmark = Landmark::ALL.into_iter().find(|l| l.name() == label);
        let Some(landmark) = landmark else {
            // A placeholder under another name is not a point.
            if !matches!(point.position, Position::NotPlaced(_)) {
                faults.unknown.push((label.to_owned(), nearest(label)));
            }
            continue;
        };
        match point.position {
            Position::NotPlaced(word) => not_placed.push((landmark, word)),
            _ if seen.contains(&landmark) => {
                if !faults.double.contains(&landmark) {
                    faults.double.push(landmark);
                }
            }
            Position::At(at) => {
                seen.push(landmark);
                *found.get_mut(landmark) = Some(at);
            }
            Position::Bad(what) => {
                seen.push(landmark);
                faults.bad.push((landmark, what));
            }
        }
    }
    for landmark in Landmark::ALL {
        if !seen.contains(&landmark) {
            let status = not_placed.iter().find(|(of, _)| *of == landmark);
            let status = status.map(|(_, word)| word.clone());
            faults.missing.push((landmark, status));
        }
    }
    let whole = || {
        Some(Landmarks {
            nasal_bones: found.nasal_bones?,
            lip: found.lip?,
            alare_right: found.alare_right?,
            alare_left: found.alare_left?,
            tip: found.tip?,
            maxilla: found.maxilla?,
        })
    };
    match whole() {
        Some(points) if faults.is_empty() => Ok(points),
        _ => Err(LandmarkFileProblem::Points(faults)),
    }
}

/// The landmark that a label was probably meant for: the only nearest one, at most one slip in three
/// characters away.
fn nearest(label: &str) -> Option<Landmark> {
    // Longer than any name with its slips; comparing costs the product of the lengths.
    if label.len() > 32 {
        return None;
    }
    let folded = label.to_lowercase().replace(['-', ' '], "_");
    let slips = |landmark: Landmark| strsim::damerau_levenshtein(&folded, landmark.name());
    let near = Landmark::ALL
        .into_iter()
        .filter(|&landmark| slips(landmark) <= landmark.name().len() / 3);
    let least = near.clone().map(slips).min()?;
    let mut nearest = near.filter(|&landmark| slips(landmark) == least);
    match (nearest.next(), nearest.next()) {
        (Some(landmark), None) => Some(landmark),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
