//! Flat pictures: slices, the nasal profile, bar charts, and what is written over a 3-D view.
//!
//! Functions take data and return an image or SVG text; none knows a plan or the disk. Text is set in DejaVu
//! Sans, which is part of the program, and never in a font of the machine: a picture is the same bytes
//! everywhere. For the same reason ticks and layout are computed here, with `libm`.

mod canvas;
mod chart;
mod colormap;
mod error;
mod overlay;
mod pair;
mod palette;
mod plot;
mod png;
mod profile;
mod sheet;
mod slice;
mod svg;
mod sweep;
mod text;
mod ticks;

pub use canvas::{overlay, rasterize};
pub use chart::{Series, VolumeChart};
pub use colormap::{DivergingLegend, diverging};
pub use error::PictureError;
pub use overlay::{SideLetters, ViewOverlay};
pub use pair::side_by_side;
pub use png::{decode_png, encode_png};
pub use profile::{ProfilePlot, ProfileStage};
pub use sheet::{SheetRow, TILE, contact_sheet, strip, tile};
pub use slice::{Plane, SliceSettings, SliceView, slice};
pub use sweep::{SweepPanel, SweepPlot, SweepSeries};
