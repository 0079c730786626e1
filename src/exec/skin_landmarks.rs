//! The landmarks that should lie on the skin, and how far from it they are.
//!
//! Of the six points of the paper's Fig. 6, the lip, the two alare points and the tip are points of the
//! skin. The nasal bones and the maxilla are bone, under it.

use glam::DVec3;

use crate::feature::{Landmark, Landmarks};
use crate::space::{Grid, GridPoint};
use crate::surface::{NearestFacing, Region, SurfaceError, nearest_facing, semi_boundary};
use crate::volume::{Mask, Sample, Volume};

/// Further than this from the skin, a landmark is likely to be wrong, mm.
pub const FAR_MM: f64 = 5.0;

/// How far the skin is looked for, mm.
const REACH_MM: f64 = 20.0;

/// The landmarks of the skin, and about where the skin there looks, in the frame of the grid. So the skin
/// is told from the walls of the nostrils, which are as near.
const ON_SKIN: [(Landmark, DVec3); 4] = [
    (Landmark::Lip, DVec3::NEG_Y),
    (Landmark::AlareRight, DVec3::new(-1.0, -1.0, 0.0)),
    (Landmark::AlareLeft, DVec3::new(1.0, -1.0, 0.0)),
    (Landmark::Tip, DVec3::NEG_Y),
];

/// A landmark of the skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkinLandmark {
    /// Which.
    pub landmark: Landmark,
    /// Where the plan puts it.
    pub at: GridPoint,
    /// The skin nearest to it; none within reach.
    pub skin: Option<NearestFacing>,
}

/// How far the landmarks of the skin are from it, in the CT as it is. `head` are its voxels of `skin_hu` or
/// more.
///
/// # Errors
/// [`SurfaceError`] where memory does not suffice.
pub fn skin_landmarks<T: Sample>(
    landmarks: &Landmarks<GridPoint>,
    skin_hu: f64,
    volume: &Volume<T>,
    head: &Mask,
) -> Result<Vec<SkinLandmark>, SurfaceError> {
    let look = |(landmark, facing): (Landmark, DVec3)| {
        let at = *landmarks.get(landmark);
        let surface = semi_boundary(volume, head, skin_hu, around(at, volume.grid()))?;
        let found = nearest_facing(&surface, at, facing);
        Ok(SkinLandmark {
            landmark,
            at,
            skin: found.filter(|skin| skin.distance_mm <= REACH_MM),
        })
    };
    ON_SKIN.into_iter().map(look).collect()
}

/// The voxels within reach of a point.
fn around(at: GridPoint, grid: &Grid) -> Region {
    let voxel = |point: DVec3| {
        let index = (point / grid.spacing()).clamp(DVec3::ZERO, grid.last_index());
        // Clamped to the grid, whose lengths are small.
        index.to_array().map(|n| n as usize)
    };
    // A voxel more, so that the surface at the end of the reach is not cut.
    let reach = REACH_MM + grid.spacing();
    Region {
        first: voxel((at.0 - reach).floor()),
        last: voxel((at.0 + reach).ceil()),
    }
}

impl SkinLandmark {
    /// Where it is moved to, if it is to be moved to skin within `snap_mm`.
    pub fn snapped(&self, snap_mm: f64) -> Option<NearestFacing> {
        self.skin.filter(|skin| skin.distance_mm <= snap_mm)
    }

    /// How far the skin is, in mm, for people.
    pub fn distance(&self) -> String {
        match self.skin {
            Some(skin) => format!("{:.1}", skin.distance_mm),
            None => format!("more than {REACH_MM}"),
        }
    }

    /// What the user should know of it, where it is to be moved to skin within `snap_mm`, or is not to be
    /// moved.
    pub fn warning(&self, snap_mm: Option<f64>) -> Option<String> {
        let allowed = snap_mm.unwrap_or(FAR_MM);
        if self.snapped(allowed).is_some() {
            return None;
        }
        let distance = self.distance();
        let unmoved = match snap_mm {
            Some(snap_mm) => format!(", further than the {snap_mm} mm of `snap`, and is not moved"),
            None => String::new(),
        };
        Some(format!(
            "landmark `{}` is {distance} mm from the skin{unmoved}; check that it is where it should be",
            self.landmark
        ))
    }
}

/// Where the landmarks are moved to; none of those that stay.
pub fn moved(found: &[SkinLandmark], snap_mm: f64) -> Landmarks<Option<GridPoint>> {
    let mut moved = Landmarks::none();
    for of in found {
        *moved.get_mut(of.landmark) = of.snapped(snap_mm).map(|skin| skin.point);
    }
    moved
}
