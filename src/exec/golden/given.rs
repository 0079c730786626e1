//! What a plan gives, in the shape in which it is kept.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;
use rayon::prelude::*;
use tempfile::TempDir;

use super::error::GoldenError;
use super::folder::decode;
use crate::exec::events::Observer;
use crate::exec::preflight::Ready;
use crate::exec::run::{self, RunOptions};
use crate::golden::pictures::reduced;
use crate::golden::stored::{is_picture, is_volume, numbers};
use crate::golden::{Inputs, Stored, StoredVolume};
use crate::io::staging::listed;
use crate::io::written::Written;

/// More than the longest side of any picture that is drawn, pixels.
const MAX_DRAWN: u32 = 1 << 14;

/// Nothing of earlier runs, and nothing that is not whole: what is kept or compared is what this program computes.
const OPTIONS: RunOptions = RunOptions {
    force: true,
    fail_fast: true,
    memory: None,
    part: None,
};

/// A plan that was run.
#[derive(Debug)]
pub(super) struct Given {
    pub stored: Stored,
    /// Reduced, by their names in the plan's folder.
    pub pictures: BTreeMap<String, RgbImage>,
    /// The folder of the plan's outputs.
    pub folder: PathBuf,
    /// It goes away with this, where nobody asked for the outputs.
    _temporary: Option<TempDir>,
}

impl Given {
    /// Runs a plan, its outputs into `out` or into a folder that goes away, and takes what is kept of it, with
    /// pictures of `side` pixels.
    pub(super) fn new(
        ready: &Ready,
        out: Option<&Path>,
        side: u32,
        observer: &dyn Observer,
    ) -> Result<Self, GoldenError> {
        let temporary = match out {
            Some(_) => None,
            None => Some(tempfile::tempdir().map_err(GoldenError::Temporary)?),
        };
        let into = temporary.as_ref().map(TempDir::path).or(out);
        let report = run::run(ready, into.unwrap_or(Path::new("")), &OPTIONS, observer)?;
        let (folder, record) = (report.folder, report.record);
        let names = listed(&folder);
        let pictures = names.par_iter().filter(|name| is_picture(name));
        let pictures = pictures.map(|name| Ok((name.clone(), picture(&folder, name, side)?)));
        let pictures: BTreeMap<_, _> = pictures.collect::<Result<_, GoldenError>>()?;
        let volumes = names.par_iter().filter(|name| is_volume(name));
        let volumes = volumes.map(|name| Ok((name.clone(), volume(&folder, name)?)));
        let volumes = volumes.collect::<Result<_, GoldenError>>()?;
        Ok(Self {
            stored: Stored {
                inputs: Inputs {
                    version: record.program.version.to_owned(),
                    plan_sha256: record.inputs.plan_sha256.clone(),
                    landmarks_sha256: record.inputs.landmarks_sha256.clone(),
                    ct_sha256: record.inputs.ct.sha256.clone(),
                },
                side,
                numbers: numbers(&record),
                pictures: pictures.keys().cloned().collect(),
                volumes,
            },
            pictures,
            folder,
            _temporary: temporary,
        })
    }
}

fn unreadable(name: &str, problem: impl ToString) -> GoldenError {
    GoldenError::Output {
        name: name.to_owned(),
        problem: problem.to_string(),
    }
}

fn picture(folder: &Path, name: &str, side: u32) -> Result<RgbImage, GoldenError> {
    let png = fs::read(folder.join(name)).map_err(|error| unreadable(name, error))?;
    let picture = decode(&png, MAX_DRAWN).map_err(|error| unreadable(name, error))?;
    Ok(reduced(&picture, side))
}

fn volume(folder: &Path, name: &str) -> Result<StoredVolume, GoldenError> {
    let digests = || {
        let written = Written::open(&folder.join(name))?;
        Ok::<_, std::io::Error>(StoredVolume {
            layout_sha256: written.layout_sha256(),
            samples_sha256: written.samples_sha256()?,
            kept: false,
        })
    };
    digests().map_err(|error| unreadable(name, error))
}
