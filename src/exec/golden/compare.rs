//! What a plan gives beside what is kept of it.

use std::io;
use std::path::Path;

use image::RgbImage;

use super::Verified;
use super::error::GoldenError;
use super::folder::Golden;
use super::given::Given;
use crate::golden::stored::is_displacement;
use crate::golden::volumes::{self, Off};
use crate::golden::{
    Cell, Compare, Difference, Inputs, Kind, Settings, StoredVolume, Verdict, numbers, pictures,
};
use crate::io::written::Written;
use crate::io::{nifti, nrrd};
use crate::picture::encode_png;
use crate::volume::Volume;
use crate::with_volume;

/// The longest side of a picture in a report that is large enough to be looked at, pixels.
const SHOWN: u32 = 384;

/// Everything that differs.
pub(super) fn compare(
    plan: &str,
    golden: &Golden,
    given: &Given,
    settings: &Settings,
) -> Result<Verified, GoldenError> {
    let (expected, found) = (&golden.stored, &given.stored);
    let mut differences = numbers::compare(&expected.numbers, &found.numbers, &settings.numbers);
    let mut drawn = Vec::new();
    compare_pictures(golden, given, settings, &mut differences, &mut drawn)?;
    for (name, of) in &expected.volumes {
        let difference = match found.volumes.get(name) {
            Some(other) => compare_volume(golden, given, settings, name, (of, other))?,
            None => Some(Difference::missing(
                Kind::Volume,
                name.clone(),
                "",
                Cell::text("a volume"),
            )),
        };
        differences.extend(difference);
    }
    let new = found.volumes.keys();
    let new = new.filter(|name| !expected.volumes.contains_key(*name));
    differences.extend(new.map(|name| {
        Difference::unexpected(Kind::Volume, name.clone(), "", Cell::text("a volume"))
    }));
    Ok(Verified {
        verdict: Verdict {
            plan: plan.to_owned(),
            agrees: differences.is_empty(),
            expected: expected.counts(),
            inputs_changed: inputs_changed(&expected.inputs, &found.inputs),
            differences,
        },
        pictures: drawn,
    })
}

fn compare_pictures(
    golden: &Golden,
    given: &Given,
    settings: &Settings,
    differences: &mut Vec<Difference>,
    drawn: &mut Vec<(String, Vec<u8>)>,
) -> Result<(), GoldenError> {
    let tolerance = &settings.pictures;
    let none = RgbImage::new(0, 0);
    let size = |picture: &RgbImage| {
        let (width, height) = picture.dimensions();
        Cell::text(format!("{width} × {height}"))
    };
    let mut draw = |name: &String, expected: &RgbImage, found: &RgbImage| {
        let [expected, found] = [expected, found].map(|part| pictures::enlarged(part, SHOWN));
        let picture = pictures::side_by_side(&expected, &found, tolerance.channel);
        drawn.push((name.clone(), encode_png(&picture)?));
        Ok::<_, GoldenError>(())
    };
    for (name, expected) in &golden.pictures {
        let Some(found) = given.pictures.get(name) else {
            let size = size(expected);
            differences.push(Difference::missing(
                Kind::Picture,
                name.clone(),
                "pixels",
                size,
            ));
            draw(name, expected, &none)?;
            continue;
        };
        if let Err(difference) = pictures::compare(expected, found, tolerance) {
            differences.push(difference.row(name.clone(), tolerance));
            draw(name, expected, found)?;
        }
    }
    for (name, found) in &given.pictures {
        if !golden.pictures.contains_key(name) {
            let size = size(found);
            let new = Difference::unexpected(Kind::Picture, name.clone(), "pixels", size);
            differences.push(new);
            draw(name, &none, found)?;
        }
    }
    Ok(())
}

fn compare_volume(
    golden: &Golden,
    given: &Given,
    settings: &Settings,
    name: &str,
    (expected, found): (&StoredVolume, &StoredVolume),
) -> Result<Option<Difference>, GoldenError> {
    let row = name.to_owned();
    if expected.layout_sha256 != found.layout_sha256 {
        let (expected, found) = (&expected.layout_sha256, &found.layout_sha256);
        return Ok(Some(volumes::layout_row(row, expected, found)));
    }
    if expected.samples_sha256 == found.samples_sha256 {
        return Ok(None);
    }
    if settings.volumes.compare == Compare::Hash {
        let (expected, found) = (&expected.samples_sha256, &found.samples_sha256);
        return Ok(Some(volumes::hash_row(row, expected, found)));
    }
    let kept = golden.volume(name)?;
    let now = given.folder.join(name);
    let damaged = |problem: String| GoldenError::File {
        path: kept.clone(),
        problem,
    };
    let unreadable = |problem: String| GoldenError::Output {
        name: name.to_owned(),
        problem,
    };
    let tolerance = &settings.volumes;
    if is_displacement(name) {
        let off = compare_displacements(&kept, &now, settings);
        let off = off.map_err(|error| damaged(error.to_string()))?;
        return Ok(off.row(row, true, tolerance));
    }
    let found = hu(&now).map_err(unreadable)?;
    let expected = hu(&kept).map_err(damaged)?;
    match volumes::compare(&expected, &found, tolerance) {
        Some(off) => Ok(off.row(row, false, tolerance)),
        None => Err(damaged(
            "it is not of the size that it was kept with".to_owned(),
        )),
    }
}

fn compare_displacements(kept: &Path, now: &Path, settings: &Settings) -> io::Result<Off> {
    let (mut kept, mut now) = (Written::open(kept)?, Written::open(now)?);
    let mut off = Off::default();
    loop {
        let (expected, found) = (kept.floats()?, now.floats()?);
        if expected.len() != found.len() {
            let problem = "it is not of the size that it was kept with";
            return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
        }
        if expected.is_empty() {
            return Ok(off);
        }
        let more = volumes::compare_components(&expected, &found, &settings.volumes);
        off = volumes::together(off, more);
    }
}

fn hu(path: &Path) -> Result<Volume<f32>, String> {
    let scan = if nrrd::is_nrrd(path) {
        nrrd::read(path).map_err(|error| error.to_string())?
    } else {
        nifti::read(path).map_err(|error| error.to_string())?
    };
    with_volume!(&scan.volume, volume => volume.to_hu()).map_err(|error| error.to_string())
}

/// What may explain differences.
fn inputs_changed(expected: &Inputs, found: &Inputs) -> Vec<String> {
    let short = |digest: &str| digest.chars().take(12).collect::<String>();
    let mut changed = Vec::new();
    let mut tell = |what: &str, expected: &str, found: &str| {
        if expected != found {
            changed.push(format!(
                "{what}: SHA-256 {}…, the golden's {}…",
                short(found),
                short(expected)
            ));
        }
    };
    tell("the CT is another", &expected.ct_sha256, &found.ct_sha256);
    let text = "the text of the plan is another";
    tell(text, &expected.plan_sha256, &found.plan_sha256);
    if expected.landmarks_sha256 != found.landmarks_sha256 {
        changed.push("the file of landmarks is another".to_owned());
    }
    if expected.version != found.version {
        changed.push(format!(
            "the program is rhinoplan {}, the golden's {}",
            found.version, expected.version
        ));
    }
    changed
}
