//! Why there is nothing to report.

use thiserror::Error;

/// Why a measurement has no answer. Positions are grid millimetres.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum MeasureError {
    /// A landmark is not at a finite position.
    #[error("a landmark's position is not a finite number of mm")]
    Landmark,
    /// The tip coincides with `nasal_bones` or `lip`.
    #[error(
        "gamma, the angle from `lip` over `tip` to `nasal_bones`, has no value: two of the three are the same point"
    )]
    NoAngle,
    /// The two transverse planes leave nothing between them, or are upside down.
    #[error(
        "the regions A..K have no height: `nasal_bones` is at z = {nasal_bones_z:.2} mm and must be above `lip`, which is at z = {lip_z:.2} mm"
    )]
    NoHeight {
        /// z of the upper plane, mm.
        nasal_bones_z: f64,
        /// z of the lower plane, mm.
        lip_z: f64,
    },
    /// The volume has no voxel in front of the base plane between the transverse planes.
    #[error(
        "the regions A..K are outside the volume: nothing of it is in front of the base plane (y = {base_y:.2} mm) between z = {lip_z:.2} and {nasal_bones_z:.2} mm"
    )]
    Outside {
        /// y of the base plane, mm.
        base_y: f64,
        /// z of the upper plane, mm.
        nasal_bones_z: f64,
        /// z of the lower plane, mm.
        lip_z: f64,
    },
    /// The threshold is not a number of Hounsfield units.
    #[error("the skin threshold is {skin_hu} HU; it must be a finite number")]
    Threshold {
        /// The threshold given.
        skin_hu: f64,
    },
    /// A voxel in or beside the regions is not a number, or too large to compute with.
    #[error(
        "voxel ({}, {}, {}), in the regions A..K, is {hu} HU: their volumes cannot be measured",
        index[0], index[1], index[2]
    )]
    NotFinite {
        /// The voxel, (x, y, z).
        index: [usize; 3],
        /// What it holds.
        hu: f64,
    },
    /// Nothing in the regions reaches the threshold.
    #[error(
        "no tissue in the regions A..K: they hold {lowest} to {highest} HU, all below the skin threshold of {skin_hu} HU; check the landmarks and `skin_hu`"
    )]
    NoTissue {
        /// The threshold.
        skin_hu: f64,
        /// Smallest value of the voxels in and beside the regions, HU.
        lowest: f64,
        /// Largest value of the voxels in and beside the regions, HU.
        highest: f64,
    },
    /// Everything in the regions reaches the threshold: there is no skin surface to measure to.
    #[error(
        "no air in the regions A..K: they hold {lowest} to {highest} HU, nowhere below the skin threshold of {skin_hu} HU; check the landmarks and `skin_hu`"
    )]
    NoAir {
        /// The threshold.
        skin_hu: f64,
        /// Smallest value of the voxels in and beside the regions, HU.
        lowest: f64,
        /// Largest value of the voxels in and beside the regions, HU.
        highest: f64,
    },
}
