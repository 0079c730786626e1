//! Slices through the tip of a stage, before and after.

use std::path::Path;

use super::framing::nose_of_all;
use super::{PicturesError, write_bytes};
use crate::exec::error::RunError;
use crate::io::staging::Staging;
use crate::picture::{Plane, SliceSettings, SliceView, encode_png, slice};
use crate::plan::Plan;
use crate::space::GridPoint;
use crate::volume::Volume;

/// What is written: the three planes through the tip, and, as a coronal plane only touches the tip, one
/// further back.
const SLICES: [(&str, Plane, f64); 4] = [
    ("slice-sagittal.png", Plane::Sagittal, 0.0),
    ("slice-coronal.png", Plane::Coronal, 0.0),
    ("slice-coronal-10mm.png", Plane::Coronal, 10.0),
    ("slice-axial.png", Plane::Axial, 0.0),
];

/// Writes the slices of a stage into its folder. They show the volumes as they are, not enhanced.
pub(in crate::exec) fn write_slices(
    staging: &Staging,
    folder: &Path,
    plan: &Plan,
    skin_hu: f64,
    [before, after]: [&Volume<f32>; 2],
    tip: GridPoint,
    caption: &str,
) -> Result<(), RunError> {
    let title = format!("{}: {caption}", plan.name);
    for (name, plane, offset_mm) in SLICES {
        let view = SliceView {
            plane,
            tip,
            offset_mm,
            nose: nose_of_all(plan),
            skin_hu,
            title: &title,
        };
        let picture =
            slice(before, after, &view, &SliceSettings::default()).map_err(PicturesError::from)?;
        let png = encode_png(&picture).map_err(PicturesError::from)?;
        write_bytes(staging, &folder.join(name), &png)?;
    }
    Ok(())
}
