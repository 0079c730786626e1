//! Plans run again and held against what is kept of them, in a golden folder:
//!
//! ```text
//! DIR/golden.toml                     tolerances: the user's
//! DIR/<plan>/golden.json              numbers, SHA-256 of volumes, what went in
//! DIR/<plan>/<candidate>/<NN>-<stage>/view-frontal.png, …   pictures, small
//! ```
//!
//! What is kept of a plan is replaced whole or not at all, as the outputs of a run are ([`crate::io::staging`]).

mod compare;
mod error;
mod folder;
mod given;

use std::fs;
use std::path::{Path, PathBuf};

use self::given::Given;
use super::events::Observer;
use super::preflight::Ready;
use crate::golden::report::{Pictures, markdown};
use crate::golden::tolerance::DEFAULT_TEXT;
use crate::golden::{Compare, Counts, Settings, Verdict};
use crate::io::artifact::{ArtifactError, save};
use crate::io::staging::Staging;
use crate::picture::encode_png;

pub use error::GoldenError;
pub use folder::{Golden, SETTINGS, STORED, settings};

/// The record of a run in its folder.
const RECORD: &str = "run.json";

/// The report of what differs, in its folder.
pub const REPORT: &str = "report.md";

/// Runs a plan and keeps what it gives in the folder `golden`, in place of what was kept of it. The outputs go into
/// `out`, or nowhere. Where there is no `golden.toml`, one with the defaults is written.
///
/// # Errors
/// [`GoldenError`]; what was kept is then as it was.
pub fn bless(
    ready: &Ready,
    golden: &Path,
    settings: &Settings,
    out: Option<&Path>,
    observer: &dyn Observer,
) -> Result<Counts, GoldenError> {
    let plan = &ready.plan.name;
    may_keep(golden, plan)?;
    let mut given = Given::new(ready, out, settings.pictures.side, observer)?;
    // Outputs and golden may be asked for in one place.
    may_keep(golden, plan)?;
    if settings.volumes.compare == Compare::Voxels {
        for volume in given.stored.volumes.values_mut() {
            volume.kept = true;
        }
    }
    let earlier = folder::stored(golden, plan).ok();
    let staging = Staging::new(&golden.join(plan))?;
    for name in given.stored.files() {
        folder::no_links(golden, &format!("{plan}/{name}"))?;
        let path = staging.begin(name)?;
        match given.pictures.get(name) {
            Some(picture) => save(&path, &encode_png(picture)?)?,
            None => copy(&given.folder.join(name), &path)?,
        }
    }
    // Last, so that a folder with it is whole.
    let text = given.stored.text()?;
    save(&staging.begin_unlisted(STORED)?, text.as_bytes())?;
    staging.publish()?;
    // The run before this one may have been of another copy of the folder, which leaves no list of its files.
    if let Some(earlier) = earlier {
        let is_gone = |name: &&str| !given.stored.files().any(|now| now == *name);
        folder::remove(golden, plan, earlier.files().filter(is_gone));
    }
    let settings = golden.join(SETTINGS);
    if settings.symlink_metadata().is_err() {
        save(&settings, DEFAULT_TEXT.as_bytes())?;
    }
    Ok(given.stored.counts())
}

/// Whether the folder of a plan can hold what is kept of it.
fn may_keep(golden: &Path, plan: &str) -> Result<(), GoldenError> {
    folder::no_links(golden, plan)?;
    let path = golden.join(plan);
    if path.join(RECORD).symlink_metadata().is_ok() {
        return Err(GoldenError::OfARun { path });
    }
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Result<(), ArtifactError> {
    let copied = fs::copy(from, to);
    copied.map(|_| ()).map_err(|source| ArtifactError {
        path: to.to_owned(),
        action: "write",
        source,
    })
}

/// A plan that was run again.
#[derive(Debug)]
pub struct Verified {
    /// What differs.
    pub verdict: Verdict,
    /// The pictures that differ, by their names: expected | actual | difference, as PNG files.
    pub pictures: Vec<(String, Vec<u8>)>,
}

/// Runs a plan and compares what it gives with what is kept of it. The outputs go into `out`, or nowhere.
///
/// # Errors
/// [`GoldenError`] where the plan cannot be run, or what is kept cannot be compared with.
pub fn verify(
    ready: &Ready,
    golden: &Golden,
    settings: &Settings,
    out: Option<&Path>,
    observer: &dyn Observer,
) -> Result<Verified, GoldenError> {
    let given = Given::new(ready, out, golden.stored.side, observer)?;
    compare::compare(&ready.plan.name, golden, &given, settings)
}

/// Whether a report can be written into a folder.
///
/// # Errors
/// [`GoldenError`] where something else is in it.
pub fn check_report(folder: &Path) -> Result<(), GoldenError> {
    let has = |name: &str| folder.join(name).symlink_metadata().is_ok();
    let path = folder.to_owned();
    if has(RECORD) {
        return Err(GoldenError::OfARun { path });
    }
    if has(SETTINGS) || has(STORED) {
        return Err(GoldenError::OfGoldens { path });
    }
    Ok(())
}

/// Writes `report.md` and its pictures, in place of those of an earlier report; says where.
///
/// # Errors
/// [`GoldenError`] where it cannot be written; an earlier report is then as it was.
pub fn write_report(to: &Path, plans: &[Verified]) -> Result<PathBuf, GoldenError> {
    check_report(to)?;
    let staging = Staging::new(to)?;
    let mut sections: Vec<(&Verdict, Pictures)> = Vec::new();
    for Verified { verdict, pictures } in plans {
        let mut shown = Pictures::new();
        for (name, picture) in pictures {
            let file = format!("{}/{}", verdict.plan, name.replace('/', "."));
            save(&staging.begin(&file)?, picture)?;
            shown.push((name.clone(), file));
        }
        sections.push((verdict, shown));
    }
    save(&staging.begin(REPORT)?, markdown(&sections).as_bytes())?;
    staging.publish()?;
    Ok(to.join(REPORT))
}
