//! What a finished run left beside its results, read for a comparison. It may be anyone's, of another version or of
//! another run than the record beside it: it is held against that record, and counts for nothing where they differ.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{
    Beside, CT, ENHANCE, Key, LANDMARKS, NAME, NUMERIC_VERSION, Note, SEGMENT, StageNote, VERSION,
    VIEWS, beside_of, parse, stage_name_of, start_name,
};
use crate::exec::error::RunError;
use crate::feature::Landmarks;
use crate::io::staging::Earlier;
use crate::morph::audit::WarpAudit;
use crate::report::record::Measures;
use crate::space::GridPoint;

/// The most points of a profile: one for each height of the largest grid.
const MAX_POINTS: usize = 1 << 15;
/// Skin further away than this is none, mm.
const FARTHEST_MM: f64 = 10_000.0;
/// What pictures of candidates have to have in common to be on one sheet, beside the frame.
const DRAWN: [&str; 4] = [CT, ENHANCE, SEGMENT, VIEWS];

/// Why something that a run leaves cannot be had.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::exec) enum Lacks {
    /// There is no note, or it is damaged.
    Note,
    /// It is of another version of the program.
    Version,
    /// It is not of the run that the record is of.
    Record,
    /// What it says is beside it is not, or is not what was noted.
    File,
}

/// What the notes of a run have to agree with.
#[derive(Debug)]
pub(in crate::exec) struct Expected(Key);

impl Expected {
    /// By the record of the run: its CT, the plan's name and landmarks; where skin and bone begin, HU, and whether only
    /// the largest piece counts.
    ///
    /// # Errors
    /// Those of JSON.
    pub(in crate::exec) fn new(
        ct: &impl Serialize,
        name: &str,
        landmarks: &Landmarks<GridPoint>,
        segment: (f64, f64, bool),
    ) -> Result<Self, RunError> {
        let mut key = Key::default();
        key.part(VERSION, &NUMERIC_VERSION)?;
        key.part(CT, ct)?;
        key.part(NAME, &name)?;
        key.part(LANDMARKS, landmarks)?;
        key.part(SEGMENT, &segment)?;
        Ok(Self(key))
    }

    fn check(&self, found: &Key) -> Result<(), Lacks> {
        let differs = |(name, digest): (&String, &String)| found.0.get(name) != Some(digest);
        if found.0.get(VERSION) != self.0.0.get(VERSION) {
            return Err(Lacks::Version);
        }
        if self.0.0.iter().any(differs) {
            return Err(Lacks::Record);
        }
        Ok(())
    }
}

/// A sound note on the nose as it is, or on the last stage of a candidate.
#[derive(Debug)]
pub(in crate::exec) struct Left {
    name: PathBuf,
    /// The skin in the midplane, where charts were drawn.
    pub profile: Option<Vec<GridPoint>>,
    /// SHA-256 of what is beside it.
    skin: Option<String>,
    tiles: Option<String>,
    /// What its pictures depend on.
    drawn: Vec<(&'static str, Option<String>)>,
}

impl Left {
    /// Of the nose as it is, of which the record has these measures.
    pub(in crate::exec) fn of_start(
        folder: &Path,
        expected: &Expected,
        measures: &Measures,
    ) -> Result<Self, Lacks> {
        Self::read(
            folder,
            start_name(),
            expected,
            (measures, &WarpAudit::IDENTITY),
        )
    }

    /// Of a stage, by the names in the record and its place from 0.
    pub(in crate::exec) fn of_stage(
        folder: &Path,
        expected: &Expected,
        (candidate, place, stage): (&str, usize, &str),
        found: (&Measures, &WarpAudit),
    ) -> Result<Self, Lacks> {
        let name = stage_name_of(candidate, place, stage);
        Self::read(folder, name, expected, found)
    }

    fn read(
        folder: &Path,
        name: PathBuf,
        expected: &Expected,
        (measures, warp): (&Measures, &WarpAudit),
    ) -> Result<Self, Lacks> {
        let notes = Earlier::published(folder).notes(&name);
        let bytes = notes.first().ok_or(Lacks::Note)?;
        let note: Note<StageNote> = parse(bytes).ok_or(Lacks::Note)?;
        expected.check(&note.key)?;
        if note.found.measures != *measures || note.found.warp != *warp {
            return Err(Lacks::Record);
        }
        let near = |point: &GridPoint| {
            let coordinates = point.to_array().into_iter();
            coordinates.map(f64::abs).all(|mm| mm <= FARTHEST_MM)
        };
        let profile = note.found.profile;
        if let Some(points) = &profile
            && (points.len() > MAX_POINTS || !points.iter().all(near))
        {
            return Err(Lacks::Note);
        }
        // Longer ones are no digests, and would be held in memory.
        let digest = |text: &String| (text.len() == 64).then(|| text.clone());
        let beside = |kind: Beside| {
            let mut of_kind = note.beside.iter().filter(|(name, _)| name == kind.ending());
            of_kind.next().and_then(|(_, sha256)| digest(sha256))
        };
        Ok(Self {
            skin: beside(Beside::Skin),
            tiles: beside(Beside::Tiles),
            drawn: DRAWN
                .map(|part| (part, note.key.0.get(part).and_then(digest)))
                .into(),
            name,
            profile,
        })
    }

    /// A file beside the note.
    pub(in crate::exec) fn beside(&self, folder: &Path, kind: Beside) -> Result<Vec<u8>, Lacks> {
        let sha256 = match kind {
            Beside::Skin => &self.skin,
            Beside::Tiles => &self.tiles,
        };
        let sha256 = sha256.as_ref().ok_or(Lacks::File)?;
        let earlier = Earlier::published(folder);
        beside_of(&self.name, kind.ending(), sha256, &earlier).ok_or(Lacks::File)
    }

    /// The SHA-256 of its pictures on the contact sheet: those of the same frame are the same.
    pub(in crate::exec) fn tiles(&self) -> Option<&str> {
        self.tiles.as_deref()
    }

    /// What keeps the pictures of two runs from being on one sheet, as parts of their plans.
    pub(in crate::exec) fn drawn_otherwise(&self, other: &Self) -> Vec<&'static str> {
        let parts = self.drawn.iter().zip(&other.drawn);
        let differing = parts.filter(|(one, other)| one != other);
        differing.map(|((part, _), _)| *part).collect()
    }
}
