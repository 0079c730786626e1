//! `golden.toml`: how far a result may be from the one that is kept.

use serde::Deserialize;
use thiserror::Error;

/// What `bless` writes where there is no `golden.toml`: every default, and what it means.
pub const DEFAULT_TEXT: &str = include_str!("default.toml");

/// The longest side that small pictures may have, pixels.
pub const MAX_SIDE: u32 = 1024;
/// The shortest: nothing could be told on fewer.
pub const MIN_SIDE: u32 = 16;
/// The largest radius, voxels. Beyond it almost any two noses agree.
pub const MAX_RADIUS: u32 = 4;

/// Everything that `golden.toml` says.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// How far numbers may be off, by their unit.
    pub numbers: Numbers,
    /// How far pictures may be off.
    pub pictures: Pictures,
    /// How volumes are compared.
    pub volumes: Volumes,
}

/// How far a number may be off: by `absolute`, or by `relative` times what is expected, whichever is more.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tolerance {
    /// In the number's unit.
    pub absolute: f64,
    /// A share of what is expected.
    pub relative: f64,
}

impl Tolerance {
    /// The most that a number may be off, in its unit.
    pub fn allowed(self, expected: f64) -> f64 {
        self.absolute.max(self.relative * expected.abs())
    }
}

/// The program gives the same bytes on every x86-64 machine, but a change of arithmetic that moves a source
/// position by 1e-10 voxel may round a few voxels to the next HU, and that is not a change of result.
const ROUNDING: Tolerance = Tolerance {
    absolute: 1e-4,
    relative: 1e-5,
};

/// Of meshes: the same rounding may take a triangle of a thousand to the other side. One body is one body.
const COUNTED: Tolerance = Tolerance {
    absolute: 0.0,
    relative: 1e-3,
};

/// The tolerance of each unit.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs, reason = "each field is its unit")]
pub struct Numbers {
    pub mm3: Tolerance,
    pub mm2: Tolerance,
    pub mm: Tolerance,
    pub deg: Tolerance,
    pub voxel: Tolerance,
    #[serde(rename = "HU")]
    pub hu: Tolerance,
    #[serde(rename = "1")]
    pub one: Tolerance,
    pub count: Tolerance,
}

impl Default for Numbers {
    fn default() -> Self {
        Self {
            mm3: ROUNDING,
            mm2: ROUNDING,
            mm: ROUNDING,
            deg: ROUNDING,
            voxel: ROUNDING,
            hu: ROUNDING,
            one: ROUNDING,
            count: COUNTED,
        }
    }
}

impl Numbers {
    fn all(&self) -> [(&'static str, Tolerance); 8] {
        [
            ("mm3", self.mm3),
            ("mm2", self.mm2),
            ("mm", self.mm),
            ("deg", self.deg),
            ("voxel", self.voxel),
            ("HU", self.hu),
            ("1", self.one),
            ("count", self.count),
        ]
    }

    /// That of a unit, as `measurements.csv` names it. What has another unit has to be the same.
    pub fn of(&self, unit: &str) -> Tolerance {
        let mut all = self.all().into_iter();
        all.find(|(known, _)| *known == unit)
            .map_or(Tolerance::default(), |(_, tolerance)| tolerance)
    }
}

/// How far pictures may be off.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Pictures {
    /// The longest side of the pictures that are kept, pixels. Of no effect on those that are kept already.
    pub side: u32,
    /// A channel may be off by this much of 255.
    pub channel: u8,
    /// The share of pixels that may be off by more.
    pub share: f64,
}

impl Default for Pictures {
    fn default() -> Self {
        Self {
            side: 256,
            channel: 8,
            share: 0.001,
        }
    }
}

/// How volumes are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Compare {
    /// Every sample is the same: their SHA-256 is.
    Hash,
    /// Voxel by voxel, within a tolerance; the volumes themselves are kept.
    Voxels,
}

/// How volumes are compared, and how far they may be off.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Volumes {
    /// By what.
    pub compare: Compare,
    /// A voxel may be off by this much, HU.
    pub hu: f64,
    /// A component of a displacement may be off by this much, mm.
    pub mm: f64,
    /// How many voxels (components, of displacements) may be off by more.
    pub voxels: u64,
    /// A voxel agrees with any of the other volume that is at most this many voxels away along each axis.
    pub radius: u32,
}

impl Default for Volumes {
    fn default() -> Self {
        Self {
            compare: Compare::Hash,
            hu: 1.0,
            mm: 0.001,
            voxels: 0,
            radius: 0,
        }
    }
}

/// What is wrong with `golden.toml`.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{}{problem}; correct it, or remove the file and `bless` again for one with the defaults", at(*line))]
pub struct SettingsError {
    /// Where, counted from 1.
    pub line: Option<usize>,
    /// What.
    pub problem: String,
}

fn at(line: Option<usize>) -> String {
    line.map_or(String::new(), |line| format!("line {line}: "))
}

impl Settings {
    /// Reads the text of `golden.toml`. What is not in it has its default; of a unit's tolerance, nought.
    ///
    /// # Errors
    /// [`SettingsError`] names the line or the key, what was found and what is expected.
    pub fn parse(text: &str) -> Result<Self, SettingsError> {
        let settings: Self = toml::from_str(text).map_err(|error| SettingsError {
            line: error.span().map(|span| line_of(text, span.start)),
            problem: one_line(error.message()),
        })?;
        settings.check()?;
        Ok(settings)
    }

    fn check(&self) -> Result<(), SettingsError> {
        for (unit, tolerance) in self.numbers.all() {
            not_negative(&format!("numbers.{unit}.absolute"), tolerance.absolute)?;
            not_negative(&format!("numbers.{unit}.relative"), tolerance.relative)?;
        }
        let share = self.pictures.share;
        within("pictures.share", share, 0.0, 1.0)?;
        let side = self.pictures.side.into();
        within("pictures.side", side, MIN_SIDE.into(), MAX_SIDE.into())?;
        not_negative("volumes.hu", self.volumes.hu)?;
        not_negative("volumes.mm", self.volumes.mm)?;
        let radius = self.volumes.radius.into();
        within("volumes.radius", radius, 0.0, MAX_RADIUS.into())
    }
}

fn not_negative(key: &str, value: f64) -> Result<(), SettingsError> {
    if value >= 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(SettingsError {
        line: None,
        problem: format!("`{key}` is {value}; expected a number that is not negative"),
    })
}

fn within(key: &str, value: f64, least: f64, most: f64) -> Result<(), SettingsError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(SettingsError {
        line: None,
        problem: format!("`{key}` is {value}; expected a number from {least} to {most}"),
    })
}

/// The line of a byte, counted from 1.
fn line_of(text: &str, byte: usize) -> usize {
    let before = text.bytes().take(byte);
    1 + before.filter(|byte| *byte == b'\n').count()
}

fn one_line(message: &str) -> String {
    crate::text::shown(&message.trim().replace('\n', ", "), 300)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_that_is_written_holds_the_defaults() {
        assert_eq!(Settings::parse(DEFAULT_TEXT), Ok(Settings::default()));
        assert_eq!(Settings::parse(""), Ok(Settings::default()));
        // Every key is there to be changed.
        for key in [
            "mm3", "mm2", "mm", "deg", "voxel", "HU", "1", "count", "side", "channel", "share",
            "compare", "hu", "voxels", "radius",
        ] {
            let written = format!("\n{key} = ");
            assert!(DEFAULT_TEXT.contains(&written), "{key}");
        }
    }

    #[test]
    fn keys_that_are_given_are_taken() {
        let settings = Settings::parse(
            "[numbers]\nmm = { absolute = 1 }\n1 = { relative = 0.5 }\n\
             [volumes]\ncompare = \"voxels\"\nradius = 2\n",
        );
        let settings = settings.unwrap();
        let mm = settings.numbers.of("mm");
        // What is left out of a tolerance is nought, not the default.
        assert_eq!((mm.absolute, mm.relative), (1.0, 0.0));
        assert_eq!(settings.numbers.of("1").relative, 0.5);
        assert_eq!(settings.numbers.of("deg"), ROUNDING);
        assert_eq!(settings.numbers.of("parsec"), Tolerance::default());
        assert_eq!(settings.volumes.compare, Compare::Voxels);
        assert_eq!((settings.volumes.radius, settings.volumes.hu), (2, 1.0));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        for (text, line, said) in [
            ("[numbers]\nmn = { absolute = 1.0 }", Some(2), "`mn`"),
            ("[numbers]\nmm = { absolut = 1.0 }", Some(2), "`absolut`"),
            ("[picture]", Some(1), "`picture`"),
            ("[pictures]\nchannel = 256", Some(2), "256"),
            ("[volumes]\ncompare = \"bytes\"", Some(2), "`bytes`"),
            ("[volumes]\nvoxels = -1", Some(2), "-1"),
            ("[volumes]\n\nvoxels =", Some(3), ""),
            (
                "[numbers]\ndeg = { absolute = -1 }",
                None,
                "`numbers.deg.absolute` is -1",
            ),
            (
                "[numbers]\nmm3 = { relative = nan }",
                None,
                "`numbers.mm3.relative` is NaN",
            ),
            ("[volumes]\nhu = inf", None, "`volumes.hu` is inf"),
            (
                "[pictures]\nshare = 1.5",
                None,
                "`pictures.share` is 1.5; expected a number from 0 to 1",
            ),
            (
                "[pictures]\nside = 8",
                None,
                "`pictures.side` is 8; expected a number from 16 to 1024",
            ),
            ("[volumes]\nradius = 5", None, "from 0 to 4"),
        ] {
            let error = Settings::parse(text).unwrap_err();
            assert_eq!(error.line, line, "{error}");
            assert!(error.problem.contains(said), "{error}");
            assert!(error.to_string().contains("correct it"), "{error}");
        }
    }

    #[test]
    fn the_larger_of_both_is_allowed() {
        let tolerance = Tolerance {
            absolute: 0.5,
            relative: 0.1,
        };
        assert_eq!(tolerance.allowed(2.0), 0.5);
        assert_eq!(tolerance.allowed(-20.0), 2.0);
    }
}
