//! What is drawn and meshed of a volume: the same skin and bone for both.

use std::borrow::Cow;

use crate::plan::Plan;
use crate::segment::{Enhance, EnhanceError, enhance, segment};
use crate::volume::{Mask, Volume, VolumeError};

/// The volume that surfaces are found in: enhanced as the plan asks, or as it is.
pub(super) fn enhanced<'a>(
    plan: &Plan,
    volume: &'a Volume<f32>,
) -> Result<Cow<'a, Volume<f32>>, EnhanceError> {
    let settings = Enhance {
        median: plan.enhance.median,
        smooth_mm: plan.enhance.smooth_mm,
    };
    if settings.is_none() {
        Ok(Cow::Borrowed(volume))
    } else {
        enhance(volume, &settings).map(Cow::Owned)
    }
}

/// The skin.
pub(super) fn skin(plan: &Plan, skin_hu: f64, volume: &Volume<f32>) -> Result<Mask, VolumeError> {
    segment(volume, skin_hu, plan.segment.keep_largest)
}

/// The bones: many, as the jaw is not the skull; but where the skin is one piece, none outside it.
pub(super) fn bone(plan: &Plan, volume: &Volume<f32>, skin: &Mask) -> Result<Mask, VolumeError> {
    let mut bone = segment(volume, plan.segment.bone_hu, false)?;
    if plan.segment.keep_largest {
        bone.intersect(skin);
    }
    Ok(bone)
}
