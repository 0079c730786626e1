//! The skin threshold of a run: the plan's number, or what the CT says.

use thiserror::Error;

use crate::plan::{Segment, SkinThreshold};
use crate::segment::otsu;
use crate::volume::AnyVolume;
use crate::with_volume;

/// Why no skin threshold can be found in a CT.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum SkinError {
    /// All its values are the same.
    #[error(
        "skin_hu = \"otsu\" finds nothing to separate: all values of the CT from -1024 to below 300 HU are the same; check the file, or give `skin_hu` in HU"
    )]
    Nothing,
    /// What it finds is not below bone.
    #[error(
        "skin_hu = \"otsu\" finds {skin_hu} HU, which is not below bone_hu = {bone_hu}; give `skin_hu` in HU, or a higher `bone_hu`"
    )]
    NotBelowBone {
        /// The threshold found, HU.
        skin_hu: f64,
        /// The plan's, HU.
        bone_hu: f64,
    },
}

/// Where tissue begins, HU: below where bone does.
///
/// # Errors
/// [`SkinError`] where the plan leaves it to the CT, and that gives none.
pub(super) fn skin_hu(segment: &Segment, ct: &AnyVolume) -> Result<f64, SkinError> {
    let skin_hu = match segment.skin_hu {
        SkinThreshold::Hu(hu) => return Ok(hu),
        SkinThreshold::Otsu => with_volume!(ct, volume => otsu(volume)),
    };
    let skin_hu = skin_hu.ok_or(SkinError::Nothing)?;
    let bone_hu = segment.bone_hu;
    if skin_hu < bone_hu {
        Ok(skin_hu)
    } else {
        Err(SkinError::NotBelowBone { skin_hu, bone_hu })
    }
}
