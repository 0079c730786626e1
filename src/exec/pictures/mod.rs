//! The pictures of a run: views of the surface, slices, profiles and charts.
//!
//! What the preoperative nose looks like is found once and kept: every stage is drawn with the same cameras
//! and beside the same pictures.

mod charts;
mod framing;
mod sheets;
mod slices;
mod surfaces;
mod views;

use std::path::Path;

use image::RgbImage;
use thiserror::Error;

use crate::exec::error::RunError;
use crate::io::artifact::save;
use crate::io::staging::Staging;
use crate::picture::{PictureError, encode_png, rasterize};
use crate::render::CameraError;
use crate::segment::EnhanceError;
use crate::surface::SurfaceError;
use crate::volume::VolumeError;

pub(super) use charts::{CandidateProfiles, Charted, Charts, profile, write_charts};
pub(super) use framing::nose_of_all;
pub(super) use sheets::{SheetStart, Sheets};
pub(super) use slices::write_slices;
pub(super) use views::Gallery;

/// The folder of the pictures of the nose as it is, within the plan's.
pub(super) const PREOPERATIVE_FOLDER: &str = "preoperative";

/// Why pictures cannot be made.
#[derive(Debug, Error)]
pub enum PicturesError {
    /// There is no surface to draw.
    #[error(
        "nothing is at or above {threshold_hu} HU{within}: there is no surface of {object} to draw; check the threshold"
    )]
    NoSurface {
        /// What was looked for.
        object: &'static str,
        /// The threshold, HU.
        threshold_hu: f64,
        /// Where it was looked for, if not everywhere; begins with a space.
        within: &'static str,
    },
    /// The volume cannot be enhanced.
    #[error(transparent)]
    Enhance(#[from] EnhanceError),
    /// There is no surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// No memory.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// A camera takes no picture.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A picture cannot be made.
    #[error(transparent)]
    Picture(#[from] PictureError),
}

/// Puts bytes where a file of that name will be published.
pub(super) fn write_bytes(staging: &Staging, name: &Path, bytes: &[u8]) -> Result<(), RunError> {
    Ok(save(&staging.begin(name)?, bytes)?)
}

/// Writes a drawing as SVG, and as PNG beside it.
pub(super) fn write_drawing(staging: &Staging, name: &Path, svg: &str) -> Result<(), RunError> {
    write_bytes(staging, &name.with_extension("svg"), svg.as_bytes())?;
    write_bytes(staging, &name.with_extension("png"), &png_of(svg)?)
}

/// A drawing as PNG.
pub(super) fn png_of(svg: &str) -> Result<Vec<u8>, PicturesError> {
    let picture = rasterize(svg, 1.0)?;
    let (width, height) = picture.dimensions();
    let opaque = RgbImage::from_fn(width, height, |x, y| {
        let [r, g, b, _] = picture.get_pixel(x, y).0;
        image::Rgb([r, g, b])
    });
    Ok(encode_png(&opaque)?)
}
