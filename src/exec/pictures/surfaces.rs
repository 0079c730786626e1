//! From a volume to the surfaces that are drawn.

use super::PicturesError;
use super::framing::Framing;
use crate::plan::{self, Plan};
use crate::segment::{Enhance, enhance, segment};
use crate::surface::{SemiBoundary, semi_boundary};
use crate::volume::Volume;

/// The surfaces of one volume, in the order in which the plan names them.
pub(super) struct Surfaces(pub Vec<(plan::DrawnObject, SemiBoundary)>);

impl Surfaces {
    /// Segments a volume, enhanced as the plan asks.
    pub(super) fn new(
        plan: &Plan,
        objects: &[plan::DrawnObject],
        skin_hu: f64,
        volume: &Volume<f32>,
        framing: &Framing,
    ) -> Result<Self, PicturesError> {
        let settings = Enhance {
            median: plan.enhance.median,
            smooth_mm: plan.enhance.smooth_mm,
        };
        if settings.is_none() {
            Self::of(plan, objects, skin_hu, volume, framing)
        } else {
            Self::of(
                plan,
                objects,
                skin_hu,
                &enhance(volume, &settings)?,
                framing,
            )
        }
    }

    fn of(
        plan: &Plan,
        objects: &[plan::DrawnObject],
        skin_hu: f64,
        volume: &Volume<f32>,
        framing: &Framing,
    ) -> Result<Self, PicturesError> {
        let keep_largest = plan.segment.keep_largest;
        let skin = segment(volume, skin_hu, keep_largest)?;
        let surface = |&drawn: &plan::DrawnObject| {
            let surface = match drawn.object {
                plan::Object::Skin => semi_boundary(volume, &skin, skin_hu, framing.region)?,
                plan::Object::Bone => {
                    // Bones are many, and the jaw is not the skull; but what is outside the skin is none.
                    let bone_hu = plan.segment.bone_hu;
                    let mut bone = segment(volume, bone_hu, false)?;
                    if keep_largest {
                        bone.intersect(&skin);
                    }
                    semi_boundary(volume, &bone, bone_hu, framing.region)?
                }
            };
            Ok((drawn, surface))
        };
        objects
            .iter()
            .map(surface)
            .collect::<Result<_, _>>()
            .map(Self)
    }

    /// The skin, where it is drawn.
    pub(super) fn skin(&self) -> Option<&SemiBoundary> {
        let mut surfaces = self.0.iter();
        let skin = surfaces.find(|(drawn, _)| drawn.object == plan::Object::Skin);
        skin.map(|(_, surface)| surface)
    }
}
