//! Why there is no picture.

use thiserror::Error;

/// Why a picture cannot be made.
#[derive(Debug, Error)]
pub enum PictureError {
    /// The SVG text cannot be read: a bug of what wrote it.
    #[error("the drawing cannot be read back as SVG: {0}")]
    Svg(#[from] resvg::usvg::Error),
    /// A picture of no pixels, or of more than can be held.
    #[error("a picture of {width}×{height} pixels cannot be made; it must have 1 to {} million pixels", super::canvas::MAX_PIXELS / 1_000_000)]
    Size {
        /// Pixels across.
        width: u64,
        /// Pixels down.
        height: u64,
    },
    /// An overlay is not as large as the picture under it.
    #[error("an overlay of {overlay:?} pixels does not fit a picture of {picture:?} pixels")]
    OverlaySize {
        /// (width, height) of the overlay.
        overlay: (u32, u32),
        /// (width, height) of the picture.
        picture: (u32, u32),
    },
    /// The picture cannot be written as PNG.
    #[error("the picture cannot be encoded as PNG: {0}")]
    Png(#[from] image::ImageError),
    /// The plotting library failed.
    #[error("the chart cannot be drawn: {0}")]
    Chart(String),
    /// A value that the picture is laid out by is not a usable number.
    #[error("{what} is {value}; it must be a finite number{condition}")]
    Value {
        /// Which value, with its unit.
        what: &'static str,
        /// What it is.
        value: f64,
        /// What else is asked of it, beginning with a space or comma; empty where nothing is.
        condition: &'static str,
    },
    /// Two volumes that are shown side by side are not on the same grid.
    #[error(
        "the volumes before and after are not on the same grid: their voxels cannot be compared"
    )]
    Grids,
    /// Nothing was given to draw.
    #[error("there is nothing to draw: {what}")]
    Empty {
        /// What is missing.
        what: &'static str,
    },
}
