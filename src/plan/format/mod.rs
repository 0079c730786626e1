//! The format of plans, as data: every key, its kind, its bounds, its words, its default and what it is for.
//!
//! The decoder takes the names of keys, the words and the bounds from here, and so does the JSON Schema that
//! editors read ([`super::schema`]): neither can know a key that the other does not.

mod tables;
mod words;

use std::fmt;

pub(super) use tables::{
    ACCEPT, CAGE, CAMERA, CANDIDATE, CLIP, CT, EDIT, ENHANCE, F1, LANDMARKS, MESH, MORPH, OPACITY,
    OUTPUTS, PLAN, SEGMENT, STAGE, SWEEP, VARY, VIEWS, limit_of,
};
pub(super) use words::{
    AXES, CLIPS, CROPS, FRAMES, KINDS, METHODS, MODELS, MethodWord, ModelWord, OBJECTS,
    OUTPUT_WORDS, Output, PHANTOMS, PLANES, SCALES, SIDES, SWEPT_EDITS, THRESHOLDS, VIEW_WORDS,
};

/// The version of the format that this program reads.
pub(super) const FORMAT: i64 = 1;
/// The longest name: it is part of a path, with room for a folder's number in front of it.
pub(super) const MAX_NAME: usize = 64;
/// The longest title, in characters.
pub(super) const MAX_TITLE: usize = 200;
/// The longest UID, in characters: the DICOM standard's.
pub(super) const MAX_UID: usize = 64;
/// The most candidates, stages of a candidate and edits of a stage: more come from a broken generator.
pub(crate) const MAX_CANDIDATES: usize = 1000;
pub(super) const MAX_STAGES: usize = 100;
pub(super) const MAX_EDITS: usize = 100;
/// The most sweeps of a plan, numbers that one varies, and values of a number.
pub(super) const MAX_SWEEPS: usize = 100;
pub(super) const MAX_VARIED: usize = 10;
pub(super) const MAX_VALUES: usize = 1000;
/// Values of a range: both ends are among them.
pub(super) const STEPS: Integers = Integers {
    least: 2,
    most: MAX_VALUES as i64,
};
/// The most cameras beside the standard ones.
pub(super) const MAX_CAMERAS: usize = 16;
/// The name under which tables show the nose as it was: no stage can have it.
pub(super) const PREOPERATIVE: &str = "preoperative";

/// A length, in either unit: heads are smaller.
pub(super) const LENGTH: Range = Range::above(0.0, 1000.0);
/// The sigma of a Gaussian, mm: a nose is not much larger.
pub(super) const SIGMA_MM: Range = Range::above(0.0, 10.0);
/// How far a landmark is moved, mm: what is further away was not misplaced by a little.
pub(super) const SNAP_MM: Range = Range::above(0.0, 10.0);
/// Sides of the median filter's window, voxels: only 3×3×3.
pub(super) const MEDIAN: Integers = Integers { least: 3, most: 3 };
/// Thresholds, HU: what 16-bit files can hold.
pub(super) const HU: Range = Range::closed(-32_768.0, 32_768.0);
/// The largest widening factor; its inverse is the smallest.
pub(super) const MAX_WIDTH: f64 = 10.0;
/// Widening factors.
pub(super) const WIDTH: Range = Range::closed(MAX_WIDTH.recip(), MAX_WIDTH);
/// Rotations of the tip, degrees: half a turn has no side.
pub(super) const ROTATION_DEG: Range = Range::between(-180.0, 180.0);
/// Triangles that a mesh may be brought down to: fewer show no nose, more are those of any CT.
pub(super) const TRIANGLES: Integers = Integers {
    least: 1000,
    most: 100_000_000,
};
/// Sides of a picture, pixels: smaller ones show no nose, larger ones fill the memory.
pub(super) const SIZES: Integers = Integers {
    least: 256,
    most: 4096,
};
/// Opacities: what is not there at all is not drawn.
pub(super) const OPACITIES: Range = Range::above(0.0, 1.0);
/// Sides of the square that a picture shows, mm.
pub(super) const CROP_MM: Range = Range::closed(20.0, 1000.0);
/// Distances from the tip to a cut, mm.
pub(super) const OFFSET_MM: Range = Range::closed(-500.0, 500.0);
/// Angles of a camera, degrees.
pub(super) const AZIMUTH_DEG: Range = Range::closed(-180.0, 180.0);
pub(super) const ELEVATION_DEG: Range = Range::closed(-90.0, 90.0);

/// A table of a plan, by its keys.
#[derive(Debug)]
pub(super) struct TableFormat {
    /// As messages name it: the header, where it has one.
    pub name: &'static str,
    /// What it is for, in a sentence.
    pub about: &'static str,
    /// In the order in which plans write them.
    pub keys: &'static [Key],
}

impl TableFormat {
    /// The names of its keys.
    pub fn names(&self) -> Vec<&'static str> {
        self.keys.iter().map(|key| key.name).collect()
    }
}

/// A key and what can be its value.
#[derive(Debug)]
pub(super) struct Key {
    pub name: &'static str,
    pub kind: Kind,
    pub given: Given,
    /// What it is for, with its unit.
    pub about: &'static str,
}

/// Whether a key must be given, and what holds where it is not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Given {
    Required,
    /// What holds without it is not one value, or nothing.
    Optional,
    Boolean(bool),
    Integer(i64),
    Number(f64),
    Mm(f64),
    Word(&'static str),
    Words(&'static [&'static str]),
}

/// What can be the value of a key.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    /// [`FORMAT`].
    Version,
    /// What becomes the name of a file or a folder; all but these.
    Name(&'static [&'static str]),
    /// One line of text.
    Title,
    Path,
    /// A name that the plan gives elsewhere.
    NameOfOther,
    Sha256,
    Uid,
    Boolean,
    Integer(Integers),
    Number(Range),
    /// Any finite number.
    AnyNumber,
    /// An array of at least one such number, and at most so many, each once.
    Numbers(usize),
    /// One of a few words.
    Word(&'static [&'static str]),
    /// An array of some of a few words, each once: not an empty one.
    Words(&'static [&'static str]),
    /// The same, or an empty one.
    WordsOrNone(&'static [&'static str]),
    /// `[x, y, z]`.
    Point,
    /// A number in one of these units, as a table of the one key.
    Measured(&'static [&'static str], Range),
    /// `[x, y, z]` in one of these units, likewise.
    Vector(&'static [&'static str]),
    Table(&'static TableFormat),
    /// An array of at least one table, and at most so many.
    Tables(&'static TableFormat, usize),
    /// The same, of tables of exactly one key.
    Choices(&'static TableFormat, usize),
    /// One of several.
    Either(&'static [Kind]),
    /// `[least, most]`.
    Interval,
}

/// An interval of numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    pub least: f64,
    pub most: f64,
    /// Whether the ends belong to it.
    pub with_ends: (bool, bool),
}

impl Range {
    const fn closed(least: f64, most: f64) -> Self {
        Self {
            least,
            most,
            with_ends: (true, true),
        }
    }

    /// Without its ends.
    const fn between(least: f64, most: f64) -> Self {
        Self {
            least,
            most,
            with_ends: (false, false),
        }
    }

    /// Without its lower end.
    const fn above(least: f64, most: f64) -> Self {
        Self {
            least,
            most,
            with_ends: (false, true),
        }
    }

    pub fn contains(self, number: f64) -> bool {
        let above = number > self.least || (self.with_ends.0 && number == self.least);
        let below = number < self.most || (self.with_ends.1 && number == self.most);
        above && below
    }
}

/// As messages say it: "above 0, at most 10".
impl fmt::Display for Range {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { least, most, .. } = self;
        match self.with_ends {
            (true, true) => write!(to, "from {least} to {most}"),
            (false, true) => write!(to, "above {least}, at most {most}"),
            (false, false) => write!(to, "between {least} and {most}"),
            (true, false) => write!(to, "from {least}, below {most}"),
        }
    }
}

/// An interval of integers, with its ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Integers {
    pub least: i64,
    pub most: i64,
}

impl Integers {
    pub fn contains(self, integer: i64) -> bool {
        (self.least..=self.most).contains(&integer)
    }
}

impl fmt::Display for Integers {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.least == self.most {
            return write!(to, "{}", self.least);
        }
        write!(to, "from {} to {}", self.least, self.most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_belong_to_a_range_where_it_says_so() {
        assert!(WIDTH.contains(0.1) && WIDTH.contains(10.0) && !WIDTH.contains(0.099));
        assert!(!LENGTH.contains(0.0) && LENGTH.contains(f64::MIN_POSITIVE));
        assert!(LENGTH.contains(1000.0) && !LENGTH.contains(1000.1));
        assert!(!ROTATION_DEG.contains(180.0) && ROTATION_DEG.contains(-179.9));
        assert!(!HU.contains(f64::NAN) && !HU.contains(f64::INFINITY));
        assert!(MEDIAN.contains(3) && !MEDIAN.contains(2) && !MEDIAN.contains(4));
    }

    #[test]
    fn ranges_are_put_into_words() {
        assert_eq!(HU.to_string(), "from -32768 to 32768");
        assert_eq!(SIGMA_MM.to_string(), "above 0, at most 10");
        assert_eq!(ROTATION_DEG.to_string(), "between -180 and 180");
        assert_eq!(MEDIAN.to_string(), "3");
        assert_eq!(SIZES.to_string(), "from 256 to 4096");
    }
}
