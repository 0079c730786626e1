//! From a volume to the surfaces that are drawn.

use super::PicturesError;
use super::framing::Framing;
use crate::exec::objects;
use crate::plan::{self, Plan};
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
        let volume = objects::enhanced(plan, volume)?;
        let skin = objects::skin(plan, skin_hu, &volume)?;
        let surface = |&drawn: &plan::DrawnObject| {
            let surface = match drawn.object {
                plan::Object::Skin => semi_boundary(&volume, &skin, skin_hu, framing.region)?,
                plan::Object::Bone => {
                    let bone = objects::bone(plan, &volume, &skin)?;
                    semi_boundary(&volume, &bone, plan.segment.bone_hu, framing.region)?
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
