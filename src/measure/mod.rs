//! What the paper's section IV measures: the angle and height of the nose, and the volumes of its eleven
//! regions. All in grid millimetres, so an oblique or anisotropic grid needs nothing special.

mod cells;
mod error;
mod geometry;
mod profile;
mod regions;
mod sheet;
mod skin_profile;

#[cfg(test)]
mod tests;

pub use error::MeasureError;
pub use geometry::NoseGeometry;
pub use regions::{REGION_NAMES, REGIONS, RegionVolumes, Slabs, region_volumes};
pub use skin_profile::skin_profile;
