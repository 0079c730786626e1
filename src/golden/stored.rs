//! `golden.json`: what is kept of a plan, beside its pictures and, where they are compared voxel by voxel, its
//! volumes.
//!
//! No date, no path, no title and nothing of a scan's header text. One line for each number and file, so that
//! a version control system shows what changed.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::difference::Counts;
use super::tolerance::{MAX_SIDE, MIN_SIDE};
use crate::mesh::solid::SolidRecord;
use crate::report::meshes::{MeshRecord, MeshesRecord, SolidsRecord};
use crate::report::record::{RunRecord, StageRecord};
use crate::text::shown;

/// The version of this file's layout.
pub const FORMAT: u64 = 1;

/// The longest name of a candidate, a stage, a measure or a version, bytes.
const MAX_NAME: usize = 160;
/// The longest message of what is wrong, characters.
const MAX_PROBLEM: usize = 300;

/// What is kept of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Stored {
    /// What it was computed from, and with.
    pub inputs: Inputs,
    /// The longest side of the pictures, pixels.
    pub side: u32,
    /// Every number.
    pub numbers: Vec<Number>,
    /// The pictures, by their names in the plan's folder.
    pub pictures: BTreeSet<String>,
    /// The volumes and displacements, by their names in the plan's folder.
    pub volumes: BTreeMap<String, StoredVolume>,
}

/// What went in. A golden is not bound to it, but it explains differences.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inputs {
    /// The version of the program.
    pub version: String,
    /// SHA-256 of the plan file's bytes, hexadecimal.
    pub plan_sha256: String,
    /// SHA-256 of the file of landmarks, where the plan names one.
    pub landmarks_sha256: Option<String>,
    /// SHA-256 of the CT, as in `run.json`.
    pub ct_sha256: String,
}

/// A number, and what it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Number {
    /// The candidate's name.
    pub candidate: String,
    /// The stage's name, or `against <candidate>` of a distance between two.
    pub stage: String,
    /// The measure's name, in `measurements.csv` where it is one of those.
    pub measure: String,
    /// Its unit.
    pub unit: String,
    /// None of what is not a number.
    pub value: Option<f64>,
}

/// A volume, told by what it holds: a file that is compressed otherwise is the same.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredVolume {
    /// SHA-256 of what its header says of size, type, scaling and position.
    pub layout_sha256: String,
    /// SHA-256 of its samples, not compressed.
    pub samples_sha256: String,
    /// Whether the volume is kept, too.
    pub kept: bool,
}

/// Why a `golden.json` is none.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0}; restore it, or `bless` again")]
pub struct StoredError(pub String);

#[derive(Deserialize)]
struct Layout {
    format: u64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Read {
    #[serde(rename = "format")]
    _format: u64,
    inputs: Inputs,
    side: u32,
    numbers: Vec<Number>,
    pictures: Vec<String>,
    volumes: BTreeMap<String, StoredVolume>,
}

impl Number {
    /// Of a candidate and a stage.
    pub fn new(candidate: &str, stage: &str, measure: &str, unit: &str, value: f64) -> Self {
        Self {
            candidate: candidate.to_owned(),
            stage: stage.to_owned(),
            measure: measure.to_owned(),
            unit: unit.to_owned(),
            value: value.is_finite().then_some(value),
        }
    }

    /// What tells it from all others of a plan.
    pub(super) fn key(&self) -> [&str; 4] {
        [&self.candidate, &self.stage, &self.measure, &self.unit]
    }

    /// For a table.
    pub(super) fn name(&self) -> String {
        format!("{}/{}: {}", self.candidate, self.stage, self.measure)
    }
}

impl Stored {
    /// How much there is.
    pub fn counts(&self) -> Counts {
        Counts {
            numbers: self.numbers.len(),
            pictures: self.pictures.len(),
            volumes: self.volumes.len(),
        }
    }

    /// The files beside `golden.json`, by their names.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        let kept = self.volumes.iter().filter(|(_, volume)| volume.kept);
        let volumes = kept.map(|(name, _)| name.as_str());
        self.pictures.iter().map(String::as_str).chain(volumes)
    }

    /// As it is written: a line for each number and file.
    ///
    /// # Errors
    /// Those of making JSON, which there are none of.
    pub fn text(&self) -> Result<String, serde_json::Error> {
        let mut text = format!("{{\n  \"format\": {FORMAT},\n  \"inputs\": {{\n");
        let inputs = [
            ("version", json(&self.inputs.version)?),
            ("plan_sha256", json(&self.inputs.plan_sha256)?),
            ("landmarks_sha256", json(&self.inputs.landmarks_sha256)?),
            ("ct_sha256", json(&self.inputs.ct_sha256)?),
        ];
        let inputs = inputs.map(|(key, value)| format!("    \"{key}\": {value}"));
        let numbers = lines(self.numbers.iter().map(json))?;
        let pictures = lines(self.pictures.iter().map(json))?;
        let volumes = self.volumes.iter();
        let volumes =
            lines(volumes.map(|(name, volume)| Ok(format!("{}: {}", json(name)?, json(volume)?))))?;
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{}\n  }},\n  \"side\": {},\n  \"numbers\": [{numbers}],\n  \"pictures\": [{pictures}],\n  \"volumes\": {{{volumes}}}\n}}",
            inputs.join(",\n"),
            self.side,
        );
        Ok(text)
    }

    /// Reads what [`Stored::text`] gives; `is_name` says whether a name is one of a file below the plan's folder.
    ///
    /// # Errors
    /// [`StoredError`] for everything that [`Stored::text`] does not give.
    pub fn parse(bytes: &[u8], is_name: impl Fn(&str) -> bool) -> Result<Self, StoredError> {
        let damaged =
            |error: serde_json::Error| StoredError(shown(&error.to_string(), MAX_PROBLEM));
        let layout: Layout = serde_json::from_slice(bytes).map_err(damaged)?;
        if layout.format != FORMAT {
            return Err(StoredError(format!(
                "it is of layout {}; this version of rhinoplan reads {FORMAT}",
                layout.format
            )));
        }
        let read: Read = serde_json::from_slice(bytes).map_err(damaged)?;
        let pictures: BTreeSet<String> = read.pictures.iter().cloned().collect();
        let stored = Self {
            inputs: read.inputs,
            side: read.side,
            numbers: read.numbers,
            pictures,
            volumes: read.volumes,
        };
        stored.check(is_name)?;
        if stored.pictures.len() != read.pictures.len() {
            return Err(StoredError("it lists a picture twice".to_owned()));
        }
        Ok(stored)
    }

    /// Names become paths and parts of tables.
    fn check(&self, is_name: impl Fn(&str) -> bool) -> Result<(), StoredError> {
        let wrong = |problem: String| Err(StoredError(shown(&problem, MAX_PROBLEM)));
        if !(MIN_SIDE..=MAX_SIDE).contains(&self.side) {
            return wrong(format!(
                "`side` is {}; expected {MIN_SIDE} to {MAX_SIDE}",
                self.side
            ));
        }
        let inputs = &self.inputs;
        let mut digests = vec![&inputs.plan_sha256, &inputs.ct_sha256];
        digests.extend(&inputs.landmarks_sha256);
        for volume in self.volumes.values() {
            digests.extend([&volume.layout_sha256, &volume.samples_sha256]);
        }
        if let Some(found) = digests.into_iter().find(|digest| !is_digest(digest)) {
            return wrong(format!("`{found}` is no SHA-256"));
        }
        if !is_text(&inputs.version) {
            return wrong(format!("`{}` is no version", inputs.version));
        }
        let mut keys = BTreeSet::new();
        for number in &self.numbers {
            if let Some(found) = number.key().into_iter().find(|part| !is_text(part)) {
                return wrong(format!("`{found}` names no number"));
            }
            if !keys.insert(number.key()) {
                return wrong(format!("it has `{}` twice", number.name()));
            }
        }
        let is_picture = |name: &&String| is_name(name) && name.ends_with(".png");
        let is_volume = |name: &&String| is_name(name) && is_volume(name);
        let strange = self.pictures.iter().find(|name| !is_picture(name));
        let strange = strange.or_else(|| self.volumes.keys().find(|name| !is_volume(name)));
        if let Some(found) = strange {
            return wrong(format!("`{found}` is no name of a picture or a volume"));
        }
        Ok(())
    }
}

fn json<T: Serialize>(what: &T) -> Result<String, serde_json::Error> {
    serde_json::to_string(what)
}

/// Items on lines of their own, with what is between two brackets around them.
fn lines(
    items: impl Iterator<Item = Result<String, serde_json::Error>>,
) -> Result<String, serde_json::Error> {
    let items: Vec<_> = items.collect::<Result<_, _>>()?;
    if items.is_empty() {
        return Ok(String::new());
    }
    Ok(format!("\n    {}\n  ", items.join(",\n    ")))
}

fn is_digest(text: &str) -> bool {
    text.len() == 64 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
}

/// Names and words as this program gives them: they go into tables as they are.
fn is_text(text: &str) -> bool {
    let known = |b: u8| b.is_ascii_alphanumeric() || b" -_.+".contains(&b);
    !text.is_empty() && text.len() <= MAX_NAME && text.bytes().all(known)
}

/// Whether a file that a run writes is a volume or a displacement.
pub fn is_volume(name: &str) -> bool {
    name.ends_with(".nii.gz") || name.ends_with(".nrrd")
}

/// Whether a volume is a displacement, by its name.
pub fn is_displacement(name: &str) -> bool {
    let file = name.rsplit('/').next().unwrap_or(name);
    file.starts_with("displacement")
}

/// Whether a file that a run writes is a picture that is kept: not those that are made of others (before | after,
/// the contact sheet).
pub fn is_picture(name: &str) -> bool {
    let file = name.rsplit('/').next().unwrap_or(name);
    let is_kept = ["view-", "change-", "slice-"]
        .iter()
        .any(|kind| file.starts_with(kind))
        || ["profile.png", "volumes.png"].contains(&file);
    is_kept && file.ends_with(".png")
}

/// Every number of a run that is kept: the measures of every stage of every candidate, how exact the map is, and
/// what was measured on surfaces.
pub fn numbers(record: &RunRecord) -> Vec<Number> {
    let mut numbers = Vec::new();
    for candidate in &record.candidates {
        for stage in &candidate.stages {
            let mut add = |measure: &str, value: f64, unit: &str| {
                numbers.push(Number::new(
                    &candidate.name,
                    &stage.name,
                    measure,
                    unit,
                    value,
                ));
            };
            for (measure, value, unit) in stage.named_measures() {
                add(&measure, value, unit);
            }
            others(stage, &mut add);
        }
    }
    for pair in &record.surface_differences {
        let [one, other] = &pair.candidates;
        let against = format!("against {other}");
        let mut add = |measure: &str, value: f64, unit: &str| {
            numbers.push(Number::new(one, &against, measure, unit, value));
        };
        add("surface_mean", pair.mean_mm, "mm");
        add("surface_p95", pair.p95_mm, "mm");
        add("surface_max", pair.max_mm, "mm");
        add("surface_area", pair.area_mm2, "mm2");
    }
    numbers
}

type Add<'a> = &'a mut dyn FnMut(&str, f64, &str);

fn others(stage: &StageRecord, add: Add<'_>) {
    if let Some(error) = stage.adaptive_error {
        add("adaptive_error_max", error.position_max_mm, "mm");
        add("adaptive_error_mean", error.position_mean_mm, "mm");
        add("adaptive_error_max_hu", error.value_max_hu, "HU");
        add("adaptive_error_mean_hu", error.value_mean_hu, "HU");
    }
    if let Some(change) = stage.surface_change {
        add("surface_inward_max", change.inward_max_mm, "mm");
        add("surface_outward_max", change.outward_max_mm, "mm");
    }
    if let Some(MeshesRecord { skin, bone, change }) = &stage.meshes {
        if let Some(skin) = skin {
            mesh("skin", skin, add);
        }
        if let Some(bone) = bone {
            mesh("bone", bone, add);
        }
        if let Some(change) = change {
            add("skin_mesh_inward_max", change.inward_max_mm, "mm");
            add("skin_mesh_outward_max", change.outward_max_mm, "mm");
        }
    }
    if let Some(SolidsRecord {
        augmentation,
        resection,
    }) = &stage.solids
    {
        solid("augmentation", augmentation, add);
        solid("resection", resection, add);
    }
    if let Some(inverse) = &stage.inverse {
        add("inverse_residual_max", inverse.residual_max_mm, "mm");
        add(
            "inverse_displacement_max",
            inverse.displacement_max_mm,
            "mm",
        );
        add(
            "inverse_not_converged",
            inverse.not_converged as f64,
            "count",
        );
    }
}

fn mesh(name: &str, mesh: &MeshRecord, add: Add<'_>) {
    add(
        &format!("{name}_mesh_triangles"),
        mesh.triangles as f64,
        "count",
    );
    add(&format!("{name}_mesh_volume"), mesh.volume_mm3, "mm3");
    add(&format!("{name}_mesh_area"), mesh.area_mm2, "mm2");
}

fn solid(name: &str, solid: &SolidRecord, add: Add<'_>) {
    add(&format!("{name}_bodies"), solid.bodies as f64, "count");
    add(
        &format!("{name}_triangles"),
        solid.triangles as f64,
        "count",
    );
    add(&format!("{name}_volume"), solid.volume_mm3, "mm3");
    add(&format!("{name}_between"), solid.between_mm3, "mm3");
    if let Some(thickness) = solid.thickness_mm {
        add(&format!("{name}_thickness_mean"), thickness.mean, "mm");
        add(&format!("{name}_thickness_max"), thickness.max, "mm");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored() -> Stored {
        let volume = StoredVolume {
            layout_sha256: "a".repeat(64),
            samples_sha256: "b".repeat(64),
            kept: true,
        };
        let volumes = [("up/01-rotate/volume.nii.gz".to_owned(), volume)];
        Stored {
            inputs: Inputs {
                version: "0.1.0".to_owned(),
                plan_sha256: "0".repeat(64),
                landmarks_sha256: None,
                ct_sha256: "1".repeat(64),
            },
            side: 256,
            numbers: vec![
                Number::new("up", "rotate", "height", "mm", 0.1 + 0.2),
                Number::new("up", "against down", "surface_max", "mm", f64::NAN),
            ],
            pictures: ["up/01-rotate/view-frontal.png".to_owned()].into(),
            volumes: volumes.into(),
        }
    }

    fn parse(text: &str) -> Result<Stored, StoredError> {
        Stored::parse(text.as_bytes(), |name| !name.starts_with(['/', '.']))
    }

    #[test]
    fn what_is_written_comes_back_to_the_bit() {
        let text = stored().text().unwrap();
        assert_eq!(parse(&text).unwrap(), stored());
        // Nothing but this program's own layout of it is written anywhere.
        let nothing = Stored {
            numbers: Vec::new(),
            pictures: BTreeSet::new(),
            volumes: BTreeMap::new(),
            ..stored()
        };
        assert_eq!(parse(&nothing.text().unwrap()).unwrap(), nothing);
        let line = text.lines().find(|line| line.contains("height")).unwrap();
        assert_eq!(
            line,
            "    {\"candidate\":\"up\",\"stage\":\"rotate\",\"measure\":\"height\",\"unit\":\"mm\",\"value\":0.30000000000000004},"
        );
    }

    #[test]
    fn what_is_damaged_or_not_of_this_program_is_refused() {
        let text = stored().text().unwrap();
        for (from, to, said) in [
            ("\"format\": 1", "\"format\": 2", "layout 2"),
            ("\"side\": 256", "\"side\": 100000", "`side` is 100000"),
            ("\"side\": 256", "\"side\": -1", "-1"),
            ("up/01", "../01", "no name of a picture or a volume"),
            ("up/01", "/etc", "no name of a picture or a volume"),
            (
                "view-frontal.png",
                "view-frontal.toml",
                "no name of a picture",
            ),
            (
                "volume.nii.gz",
                "volume.sh",
                "no name of a picture or a volume",
            ),
            ("bbbb", "bb", "no SHA-256"),
            ("0.1.0", "0.1.0\\n# <script>", "no version"),
            ("\"rotate\"", "\"ro|tate\"", "names no number"),
            ("\"height\"", "\"\"", "names no number"),
            ("0.30000000000000004", "\"0.3\"", "invalid type"),
            ("0.30000000000000004", "1e999", "out of range"),
            ("\"kept\":true", "\"kept\":true,\"x\":1", "unknown field"),
            ("\n}\n", "", "EOF"),
        ] {
            assert!(text.contains(from), "{from}");
            let error = parse(&text.replace(from, to)).unwrap_err();
            assert!(error.0.contains(said), "{from} → {to}: {error}");
            assert!(error.to_string().contains("`bless` again"), "{error}");
        }
        assert!(parse("").is_err() && parse("[]").is_err());
        let mut twice = stored();
        twice.numbers.push(twice.numbers[0].clone());
        let error = parse(&twice.text().unwrap()).unwrap_err();
        assert!(error.0.contains("`up/rotate: height` twice"), "{error}");
        let line = "    \"up/01-rotate/view-frontal.png\"";
        let text = text.replace(line, &format!("{line},\n{line}"));
        assert!(parse(&text).unwrap_err().0.contains("a picture twice"));
    }

    #[test]
    fn pictures_that_are_made_of_others_are_not_kept() {
        for name in [
            "a/01-b/view-frontal.png",
            "a/01-b/slice-axial.png",
            "profile.png",
            "a/volumes.png",
        ] {
            assert!(is_picture(name), "{name}");
        }
        for name in [
            "contact-sheet.png",
            "a/01-b/pair-frontal.png",
            "profile.svg",
            "view-/run.json",
        ] {
            assert!(!is_picture(name), "{name}");
        }
        assert!(is_displacement("a/01-b/displacement-inverse.nii.gz"));
        assert!(!is_displacement("displacement/01-b/volume.nii.gz"));
        assert!(is_volume("a/01-b/volume.nrrd") && !is_volume("a/skin.stl"));
    }
}
