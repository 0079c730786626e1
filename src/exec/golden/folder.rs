//! The golden folder on the disk, which anyone may have filled: nothing outside it is read, and nothing of any size.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};

use image::{ImageFormat, ImageReader, Limits, RgbImage};

use super::error::GoldenError;
use crate::golden::{Compare, Settings, Stored};
use crate::io::staging::is_plain;

/// In the golden folder: how far a result may be off.
pub const SETTINGS: &str = "golden.toml";
/// In the folder of a plan there: everything but pictures and volumes.
pub const STORED: &str = "golden.json";

/// The largest files that are read, bytes. `golden.json` of the largest plan there can be (some nine thousand stages,
/// at four thousand bytes each) is smaller.
const MAX_SETTINGS_BYTES: u64 = 64 << 10;
const MAX_STORED_BYTES: u64 = 64 << 20;
const MAX_PICTURE_BYTES: u64 = 8 << 20;

/// `golden.toml` of a golden folder; the defaults where there is none.
///
/// # Errors
/// [`GoldenError`] where it cannot be read or understood.
pub fn settings(golden: &Path) -> Result<Settings, GoldenError> {
    let path = golden.join(SETTINGS);
    if path.symlink_metadata().is_err() {
        return Ok(Settings::default());
    }
    let bytes = read(golden, SETTINGS, MAX_SETTINGS_BYTES)?;
    let text = std::str::from_utf8(&bytes).map_err(|error| GoldenError::File {
        path: path.clone(),
        problem: error.to_string(),
    })?;
    Settings::parse(text).map_err(|problem| GoldenError::Settings { path, problem })
}

/// What is kept of a plan, all of it but volumes read and checked.
#[derive(Debug)]
pub struct Golden {
    /// The golden folder.
    root: PathBuf,
    plan: String,
    pub(super) stored: Stored,
    /// By their names in the plan's folder.
    pub(super) pictures: BTreeMap<String, RgbImage>,
}

impl Golden {
    /// Reads what is kept of a plan in the folder `golden`.
    ///
    /// # Errors
    /// [`GoldenError`] where there is nothing, it is damaged, or it does not hold what `settings` ask for.
    pub fn open(golden: &Path, plan: &str, settings: &Settings) -> Result<Self, GoldenError> {
        let stored = stored(golden, plan)?;
        let asks_for_voxels = settings.volumes.compare == Compare::Voxels;
        if asks_for_voxels && stored.volumes.values().any(|volume| !volume.kept) {
            return Err(GoldenError::NotKept {
                plan: plan.to_owned(),
            });
        }
        let picture = |name: &String| {
            let within = format!("{plan}/{name}");
            let bytes = read(golden, &within, MAX_PICTURE_BYTES)?;
            let picture = decode(&bytes, stored.side).map_err(|problem| GoldenError::File {
                path: golden.join(within),
                problem,
            })?;
            Ok((name.clone(), picture))
        };
        let pictures = stored.pictures.iter().map(picture);
        let pictures = pictures.collect::<Result<_, GoldenError>>()?;
        Ok(Self {
            root: golden.to_owned(),
            plan: plan.to_owned(),
            stored,
            pictures,
        })
    }

    /// Where a volume that is kept is.
    pub(super) fn volume(&self, name: &str) -> Result<PathBuf, GoldenError> {
        file_in(&self.root, &format!("{}/{name}", self.plan))
    }
}

/// What `golden.json` of a plan says.
pub(super) fn stored(golden: &Path, plan: &str) -> Result<Stored, GoldenError> {
    let within = format!("{plan}/{STORED}");
    let path = golden.join(&within);
    if path.symlink_metadata().is_err() {
        return Err(GoldenError::None {
            plan: plan.to_owned(),
            path: golden.to_owned(),
        });
    }
    let bytes = read(golden, &within, MAX_STORED_BYTES)?;
    Stored::parse(&bytes, is_plain).map_err(|problem| GoldenError::Stored { path, problem })
}

/// An RGB picture of at most `side` pixels along each side.
pub(super) fn decode(png: &[u8], side: u32) -> Result<RgbImage, String> {
    let mut limits = Limits::default();
    limits.max_image_width = Some(side);
    limits.max_image_height = Some(side);
    let mut reader = ImageReader::with_format(Cursor::new(png), ImageFormat::Png);
    reader.limits(limits);
    let picture = reader.decode().map_err(|error| error.to_string())?;
    Ok(picture.into_rgb8())
}

/// A file in a folder, found not to be elsewhere: there is no link on the way, and it is a file.
fn file_in(root: &Path, name: &str) -> Result<PathBuf, GoldenError> {
    let path = root.join(name);
    let refused = |problem: &str| GoldenError::File {
        path: path.clone(),
        problem: problem.to_owned(),
    };
    no_links(root, name)?;
    match path.symlink_metadata() {
        Ok(found) if found.is_file() => Ok(path),
        Ok(_) => Err(refused("it is no file")),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Err(refused("it is not there")),
        Err(error) => Err(refused(&error.to_string())),
    }
}

/// Refuses a link at any part of `name` below `root`; what is not there is none.
pub(super) fn no_links(root: &Path, name: &str) -> Result<(), GoldenError> {
    let mut path = root.to_owned();
    for part in name.split('/') {
        path.push(part);
        let is_link = path
            .symlink_metadata()
            .is_ok_and(|found| found.is_symlink());
        if is_link {
            return Err(GoldenError::File {
                path,
                problem: "it is a link, which could lead anywhere".to_owned(),
            });
        }
    }
    Ok(())
}

fn read(root: &Path, name: &str, most: u64) -> Result<Vec<u8>, GoldenError> {
    let path = file_in(root, name)?;
    let mut bytes = Vec::new();
    let file = File::open(&path).and_then(|file| file.take(most + 1).read_to_end(&mut bytes));
    let problem = match file {
        Err(error) => error.to_string(),
        Ok(_) if bytes.len() as u64 > most => format!("it is larger than {most} bytes"),
        Ok(_) => return Ok(bytes),
    };
    Err(GoldenError::File { path, problem })
}

/// Removes files of an earlier golden, and folders that are empty without them.
pub(super) fn remove<'a>(golden: &Path, plan: &str, names: impl Iterator<Item = &'a str>) {
    for name in names {
        let within = format!("{plan}/{name}");
        if let Ok(path) = file_in(golden, &within) {
            // One that cannot be removed is in nobody's way: `golden.json` lists what counts.
            let _ = fs::remove_file(path);
        }
        for folder in Path::new(&within).ancestors().skip(1) {
            let is_above = folder.as_os_str() == plan || folder.as_os_str().is_empty();
            if is_above || fs::remove_dir(golden.join(folder)).is_err() {
                break;
            }
        }
    }
}
