//! Whether there is a nose where the landmarks are, told from the voxels: numbers of an absent nose look like
//! any others.

use std::fmt;

use thiserror::Error;

use super::skin_landmarks::SkinLandmark;
use crate::feature::{Landmark, Landmarks};
use crate::measure::{REGION_NAMES, RegionVolumes, Slabs};
use crate::space::{Grid, GridPoint};
use crate::volume::Mask;

/// Further than this from any skin, the tip is not that of this nose, mm. Decided: the most that
/// `landmarks.snap` may ask for, twice what a run warns of. Landmarks that were read by eye are within 2 mm.
pub const LOST_MM: f64 = 10.0;

/// How far the skin at the tip must stand in front of that of the cheeks, in widths of the nose. Decided: two
/// real heads have 0.7 and 0.9, the built-in one 0.5; the forehead and the occiput of one 0.1 to 0.2, a wall
/// nothing.
const LEAST_RELIEF: f64 = 0.25;

/// How far beyond the alare points the cheeks are looked at, in widths of the nose.
const BESIDE: f64 = 0.25;

/// The smallest and largest value of a CT, HU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HuRange(pub [f64; 2]);

impl fmt::Display for HuRange {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.0;
        if low == high {
            write!(to, "{low} HU in every voxel")
        } else {
            write!(to, "{low} to {high} HU")
        }
    }
}

/// Why there is no nose to be measured.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum NoNose {
    /// Nothing reaches the skin threshold.
    #[error(
        "the CT holds no tissue: {range}, nowhere the {skin_hu} HU at which skin begins; check that it is a CT in HU, and `segment.skin_hu`"
    )]
    NoTissue {
        /// What it holds.
        range: HuRange,
        /// The threshold, HU.
        skin_hu: f64,
    },
    /// Everything reaches it.
    #[error(
        "the CT holds no air, so it has no skin: {range}, nowhere below the {skin_hu} HU at which skin begins; check that it is a CT in HU, and `segment.skin_hu`"
    )]
    NoAir {
        /// What it holds.
        range: HuRange,
        /// The threshold, HU.
        skin_hu: f64,
    },
    /// The landmarks are not on this face.
    #[error(
        "there is no nose where the landmarks are: {found} from the skin, and {LOST_MM} mm are the most; either they are misplaced or of another CT, or the head lies otherwise than the CT's header says, as upside-down or back to front (`rhinoplan info` shows its axes)"
    )]
    OffTheSkin {
        /// Which landmarks, and how far.
        found: String,
    },
    /// The scan begins behind the skin of the nose.
    #[error(
        "the scan cuts off the nose: at the height of the tip (voxel z = {z}) tissue fills its foremost voxels; the nose must lie in the scan, with air in front"
    )]
    CutOff {
        /// The slice of the tip.
        z: usize,
    },
    /// Nothing stands out from the face.
    #[error(
        "no nose stands out where the landmarks are: at the tip the skin is {relief_mm:.1} mm in front of the cheeks beside it, and a nose of this width ({width_mm:.1} mm from `alare_right` to `alare_left`) needs {least_mm:.1} mm; check the landmarks, and that the head lies as the CT's header says"
    )]
    Flat {
        /// From the cheeks to the foremost skin at the height of the tip, mm; negative where it is behind.
        relief_mm: f64,
        /// From one alare point to the other along x, mm.
        width_mm: f64,
        /// The least that would do, mm.
        least_mm: f64,
    },
    /// In front of the base plane there is nothing at the tip.
    #[error(
        "no nose stands in front of the base plane: region {region}, which holds the tip, has no tissue; check `tip`, and that `maxilla` is behind it"
    )]
    Empty {
        /// The region's name.
        region: char,
    },
}

/// Refuses a volume without tissue, and one without air.
///
/// # Errors
/// [`NoNose::NoTissue`], [`NoNose::NoAir`].
pub fn skin_exists(mask: &Mask, skin_hu: f64, range: [f64; 2]) -> Result<(), NoNose> {
    let range = HuRange(range);
    let voxels: usize = mask.dims().iter().product();
    match mask.count() {
        0 => Err(NoNose::NoTissue { range, skin_hu }),
        all if all == voxels => Err(NoNose::NoAir { range, skin_hu }),
        _ => Ok(()),
    }
}

/// Refuses landmarks that are on no nose: the tip, or most of those of the skin, further than [`LOST_MM`]
/// from it; a nose that the scan cuts off; a face from which nothing stands out. `mask` is the head.
///
/// # Errors
/// [`NoNose`].
pub fn nose_exists(
    found: &[SkinLandmark],
    landmarks: &Landmarks<GridPoint>,
    mask: &Mask,
    grid: &Grid,
) -> Result<(), NoNose> {
    let is_lost = |of: &&SkinLandmark| of.snapped(LOST_MM).is_none();
    let lost: Vec<&SkinLandmark> = found.iter().filter(is_lost).collect();
    if lost.iter().any(|of| of.landmark == Landmark::Tip) || 2 * lost.len() > found.len() {
        let far: Vec<String> = lost
            .iter()
            .map(|of| format!("`{}` is {} mm", of.landmark, of.distance()))
            .collect();
        return Err(NoNose::OffTheSkin {
            found: far.join(", "),
        });
    }
    stands_out(landmarks, mask, grid)
}

/// Compares the foremost tissue between the alare points, at the height of the tip, with that beside them.
fn stands_out(landmarks: &Landmarks<GridPoint>, mask: &Mask, grid: &Grid) -> Result<(), NoNose> {
    let [nx, ny, _] = mask.dims();
    let nearest = |mm: f64, axis: usize| {
        let voxel = (mm / grid.spacing()[axis]).round();
        // Clamped to the grid, whose lengths are small.
        voxel.clamp(0.0, grid.last_index()[axis]) as usize
    };
    let (right, left) = (landmarks.alare_right.0.x, landmarks.alare_left.0.x);
    let width_mm = left - right;
    let z = nearest(landmarks.tip.0.z, 2);
    // Where a line meets nothing, the face is further behind than the scan goes.
    let foremost = |x: usize| (0..ny).find(|&y| mask.contains(x, y, z)).unwrap_or(ny);
    let between = nearest(right, 0)..=nearest(left, 0).min(nx - 1);
    let nose = between.map(foremost).min().unwrap_or(ny);
    if nose == 0 {
        return Err(NoNose::CutOff { z });
    }
    let [right, left] = [right - BESIDE * width_mm, left + BESIDE * width_mm];
    // The mean of both sides, so that a head that is turned to one is no flatter.
    let cheeks = (foremost(nearest(right, 0)) + foremost(nearest(left, 0))) as f64 / 2.0;
    let relief_mm = (cheeks - nose as f64) * grid.spacing().y;
    let least_mm = LEAST_RELIEF * width_mm;
    if nose == ny || relief_mm < least_mm {
        return Err(NoNose::Flat {
            relief_mm,
            width_mm,
            least_mm,
        });
    }
    Ok(())
}

/// What the user should know of regions without tissue. A nose without a dip at its root has none in the
/// uppermost; from the tip down there is a face.
///
/// # Errors
/// [`NoNose::Empty`] where the tip's own region is such a one.
pub fn regions_hold_a_nose(
    volumes: &RegionVolumes,
    slabs: &Slabs,
    tip: GridPoint,
) -> Result<Option<String>, NoNose> {
    // The planes go down from A; a tip on the lowest is in K.
    let planes = slabs.planes();
    let below = planes.iter().skip(1).filter(|&&z| tip.0.z < z).count();
    let of_tip = below.min(REGION_NAMES.len() - 1);
    let empty: Vec<char> = volumes
        .named()
        .skip(of_tip)
        .filter(|(_, mm3)| *mm3 <= 0.0)
        .map(|(name, _)| name)
        .collect();
    let region = REGION_NAMES.get(of_tip).copied().unwrap_or_default();
    if empty.contains(&region) {
        return Err(NoNose::Empty { region });
    }
    if empty.is_empty() {
        return Ok(None);
    }
    let names: Vec<String> = empty.iter().map(char::to_string).collect();
    Ok(Some(format!(
        "below the tip, {} {} no tissue in front of the base plane; check `maxilla` and `lip`",
        if names.len() == 1 {
            "region"
        } else {
            "regions"
        },
        names.join(", ") + if names.len() == 1 { " has" } else { " have" }
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::NearestFacing;

    const DIMS: [usize; 3] = [60, 50, 40];

    fn grid() -> Grid {
        Grid::axis_aligned(DIMS, [1.0, 1.5, 2.0]).unwrap()
    }

    /// A nose 20 mm wide, its tip at voxel (30, 10, 20).
    fn landmarks() -> Landmarks<GridPoint> {
        let grid = grid();
        let at = |x, y, z| grid.index_to_grid([x, y, z].into());
        Landmarks {
            nasal_bones: at(30.0, 25.0, 30.0),
            lip: at(30.0, 20.0, 10.0),
            alare_right: at(20.0, 22.0, 18.0),
            alare_left: at(40.0, 22.0, 18.0),
            tip: at(30.0, 10.0, 20.0),
            maxilla: at(30.0, 30.0, 18.0),
        }
    }

    /// A face at y = 25 on which a nose stands, `high` voxels, between x = 22 and 38.
    fn face(high: usize) -> Mask {
        Mask::from_fn(DIMS, |x, y, _| {
            y >= 25 || (22..=38).contains(&x) && y + high >= 25
        })
        .unwrap()
    }

    fn found(distances: [Option<f64>; 4]) -> Vec<SkinLandmark> {
        let names = [
            Landmark::Lip,
            Landmark::AlareRight,
            Landmark::AlareLeft,
            Landmark::Tip,
        ];
        let landmarks = landmarks();
        let one = |(landmark, distance): (Landmark, Option<f64>)| {
            let at = *landmarks.get(landmark);
            let skin = distance.map(|distance_mm| NearestFacing {
                point: at,
                distance_mm,
            });
            SkinLandmark { landmark, at, skin }
        };
        names.into_iter().zip(distances).map(one).collect()
    }

    const NEAR: Option<f64> = Some(1.0);

    fn look(distances: [Option<f64>; 4], mask: &Mask) -> Result<(), NoNose> {
        nose_exists(&found(distances), &landmarks(), mask, &grid())
    }

    #[test]
    fn a_lost_tip_or_most_points_lost_is_no_nose() {
        let far = Some(LOST_MM + 0.1);
        let face = face(12);
        for (distances, lost) in [
            ([NEAR; 4], 0),
            ([Some(LOST_MM); 4], 0),
            ([None, NEAR, NEAR, NEAR], 0),
            ([far, far, NEAR, NEAR], 0),
            ([NEAR, NEAR, NEAR, far], 1),
            ([far, None, far, NEAR], 3),
            ([None; 4], 4),
        ] {
            match look(distances, &face) {
                Ok(()) => assert_eq!(lost, 0, "{distances:?}"),
                Err(NoNose::OffTheSkin { found }) => {
                    assert_eq!(found.matches(" mm").count(), lost, "{found}");
                }
                Err(other) => panic!("{other}"),
            }
        }
        let error = look([NEAR, None, NEAR, far], &face)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("`alare_right` is more than 20 mm, `tip` is 10.1 mm from"),
            "{error}"
        );
    }

    #[test]
    fn a_face_needs_a_quarter_of_the_width_in_front_of_the_cheeks() {
        // The nose is 20 mm wide: 5 mm are needed, more than 3 voxels of 1.5 mm.
        assert_eq!(look([NEAR; 4], &face(4)), Ok(()));
        for high in [3, 0] {
            let flat = NoNose::Flat {
                relief_mm: high as f64 * 1.5,
                width_mm: 20.0,
                least_mm: 5.0,
            };
            assert_eq!(look([NEAR; 4], &face(high)), Err(flat));
        }
        // A dent.
        let dent = Mask::from_fn(DIMS, |x, y, _| {
            y >= 25 + 10 * usize::from(x.abs_diff(30) <= 10)
        });
        let error = look([NEAR; 4], &dent.unwrap()).unwrap_err();
        assert!(matches!(error, NoNose::Flat { relief_mm, .. } if relief_mm == -15.0));
        // Tissue elsewhere, none on the lines; and none beside the nose, which then stands alone.
        let behind = Mask::from_fn(DIMS, |_, y, z| y >= 25 && z != 20).unwrap();
        assert!(look([NEAR; 4], &behind).is_err());
        let alone = Mask::from_fn(DIMS, |x, y, _| y >= 13 && (22..=38).contains(&x)).unwrap();
        assert_eq!(look([NEAR; 4], &alone), Ok(()));
    }

    #[test]
    fn a_head_turned_to_one_side_is_no_flatter() {
        // Cheeks 6 voxels apart in depth, the nose 12 before their middle.
        let turned = Mask::from_fn(DIMS, |x, y, _| {
            let cheek = 22 + (x * 6) / 30;
            y >= cheek || (22..=38).contains(&x) && y >= 14
        });
        assert_eq!(look([NEAR; 4], &turned.unwrap()), Ok(()));
    }

    #[test]
    fn a_nose_that_the_scan_cuts_off() {
        assert_eq!(look([NEAR; 4], &face(25)), Err(NoNose::CutOff { z: 20 }));
        assert_eq!(look([NEAR; 4], &face(24)), Ok(()));
    }

    #[test]
    fn landmarks_at_the_end_of_the_scan() {
        let mut at_edge = landmarks();
        at_edge.alare_right.0.x = 0.0;
        at_edge.alare_left.0.x = 59.0;
        let found = found([NEAR; 4]);
        assert_eq!(nose_exists(&found, &at_edge, &face(12), &grid()), Ok(()));
        at_edge.tip.0 = glam::DVec3::splat(1e9);
        assert_eq!(nose_exists(&found, &at_edge, &face(12), &grid()), Ok(()));
    }

    #[test]
    fn a_volume_without_skin_says_what_it_holds() {
        let empty = Mask::empty(DIMS).unwrap();
        let full = Mask::from_fn(DIMS, |_, _, _| true).unwrap();
        assert_eq!(skin_exists(&face(12), -500.0, [-1000.0, 40.0]), Ok(()));
        for (mask, range, message) in [
            (
                &empty,
                [-1000.0; 2],
                "no tissue: -1000 HU in every voxel, nowhere the -500 HU",
            ),
            (
                &empty,
                [-1000.0, -600.0],
                "no tissue: -1000 to -600 HU, nowhere",
            ),
            (
                &full,
                [40.0; 2],
                "no air, so it has no skin: 40 HU in every voxel, nowhere below",
            ),
        ] {
            let error = skin_exists(mask, -500.0, range).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }

    #[test]
    fn regions_from_the_tip_down_hold_something() {
        let slabs = Slabs::new(&landmarks()).unwrap();
        let tip = landmarks().tip;
        let with = |empty: &[usize]| {
            let mut volumes = [100.0; 11];
            for &region in empty {
                volumes[region] = 0.0;
            }
            regions_hold_a_nose(&RegionVolumes(volumes), &slabs, tip)
        };
        // z = 20 is the middle of z = 30 to 10: region F.
        assert_eq!(with(&[]), Ok(None));
        assert_eq!(with(&[0, 1, 4]), Ok(None));
        assert_eq!(with(&[5]), Err(NoNose::Empty { region: 'F' }));
        let warning = with(&[6, 10]).unwrap().unwrap();
        assert!(warning.contains("regions G, K have no tissue"), "{warning}");
        let warning = with(&[0, 10]).unwrap().unwrap();
        assert!(warning.contains("region K has no tissue"), "{warning}");
        // A tip below or above the regions is in the last or the first.
        for (z, region) in [(0.0, 'K'), (100.0, 'A')] {
            let tip = GridPoint::new(30.0, 15.0, z);
            let none = RegionVolumes([0.0; 11]);
            let error = regions_hold_a_nose(&none, &slabs, tip).unwrap_err();
            assert_eq!(error, NoNose::Empty { region });
        }
    }
}
