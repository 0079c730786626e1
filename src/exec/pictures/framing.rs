//! What of the head is in the pictures: the same for every stage of every candidate.

use glam::DVec3;

use crate::feature::NoseBox;
use crate::plan::{Clip, Crop, Plan, Views};
use crate::render::{Camera, CameraError, Direction};
use crate::space::{Grid, GridPoint};
use crate::surface::{Region, SemiBoundary};

/// How far from the nose a face goes at most, mm: to the top of the head, to the chin, to either ear.
const FACE_MM: [f64; 3] = [150.0, 120.0, 95.0];
/// A little more than what has to be in a picture.
const AIR: f64 = 1.06;
/// Where the foremost point of the face is in a picture from the side: this part of the picture from its edge.
const FRONT: f64 = 0.10;
/// The picture of the nose alone, in lengths of its box's diagonal.
const NOSE: f64 = 1.25;

/// The part of the volume that is drawn, and the nose in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Framing {
    /// What is drawn of the volume.
    pub region: Region,
    /// Around the nose of every stage of every candidate.
    pub nose: NoseBox,
}

/// Where the cameras look.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field {
    centre: GridPoint,
    side_mm: f64,
}

/// The box around the nose in every stage of every candidate.
pub(in crate::exec) fn nose_of_all(plan: &Plan) -> NoseBox {
    let stages = plan
        .candidates
        .iter()
        .flat_map(|candidate| &candidate.stages);
    let boxes = stages.map(|stage| NoseBox::new(&plan.landmarks, &stage.source, &stage.target));
    let start = NoseBox::new(&plan.landmarks, &plan.f1, &plan.f1);
    boxes.fold(start, |all, one| all.union(&one))
}

impl Framing {
    pub(super) fn new(plan: &Plan, views: &Views, grid: &Grid) -> Self {
        let nose = nose_of_all(plan);
        let whole = Region::whole(grid);
        let region = match views.clip {
            Clip::None => whole,
            Clip::Nose => {
                let index = |point: GridPoint, round: fn(DVec3) -> DVec3| {
                    let index = round(grid.grid_to_index(point).0);
                    // In range: it lies between the grid's first and last voxels.
                    index
                        .clamp(DVec3::ZERO, grid.last_index())
                        .to_array()
                        .map(|at| at as usize)
                };
                Region {
                    first: index(nose.min, DVec3::floor),
                    last: index(nose.max, DVec3::ceil),
                }
            }
            Clip::Plane {
                plane,
                offset_mm,
                keep,
            } => {
                let axis = plane.axis();
                let at = (plan.f1.tip.0[axis] + offset_mm) / grid.spacing()[axis];
                half(whole, axis, at, keep.is_greater())
            }
        };
        Self { region, nose }
    }

    /// Where cameras look so that the plan's crop of `surface`, what is drawn before the first operation,
    /// is in the picture; `None` where nothing is drawn.
    pub(super) fn field(&self, views: &Views, surface: &SemiBoundary) -> Option<Field> {
        let spacing = surface.grid().spacing();
        let (low, high) = surface.bounds()?;
        let at = |index: [usize; 3]| DVec3::from_array(index.map(|at| at as f64)) * spacing;
        // Noses to come may stand further out than the one there is.
        let low = (at(low) - spacing / 2.0).min(self.nose.min.0);
        let high = at(high) + spacing / 2.0;
        let nose = (self.nose.min.0 + self.nose.max.0) / 2.0;
        // In pictures from the side the face is at the front, however deep the head.
        let face = |middle: DVec3, side_mm: f64| Field {
            centre: GridPoint(DVec3::new(
                middle.x,
                low.y + (0.5 - FRONT) * side_mm,
                middle.z,
            )),
            side_mm,
        };
        Some(match views.crop {
            Crop::Head => {
                let side = views
                    .cameras
                    .iter()
                    .map(|camera| extent(camera, high - low))
                    .fold(0.0, f64::max);
                Field {
                    centre: GridPoint((low + high) / 2.0),
                    side_mm: AIR * side,
                }
            }
            Crop::Face => {
                let [up, down, aside] = FACE_MM;
                let low_face = low.max(nose - DVec3::new(aside, f64::MAX, down));
                let high_face = high.min(nose + DVec3::new(aside, f64::MAX, up));
                let size = high_face - low_face;
                face((low_face + high_face) / 2.0, AIR * size.x.max(size.z))
            }
            Crop::Mm(side_mm) => face(nose, side_mm),
            Crop::Nose => Field {
                centre: GridPoint(nose),
                side_mm: NOSE * (self.nose.max.0 - self.nose.min.0).length(),
            },
        })
    }
}

/// The voxels of `whole` on one side of a plane across an axis, at a continuous index; those on the plane
/// belong to either side. A region that holds none where that side has none.
fn half(whole: Region, axis: usize, at: f64, greater: bool) -> Region {
    let mut region = whole;
    let end = whole.last[axis] + 1;
    if greater {
        // In range: at most one beyond the last voxel.
        region.first[axis] = at.ceil().clamp(0.0, end as f64) as usize;
    } else if at < 0.0 {
        region.first[axis] = end;
    } else {
        region.last[axis] = at.floor().min(whole.last[axis] as f64) as usize;
    }
    region
}

/// The larger side of a box's picture, mm.
fn extent(camera: &crate::plan::Camera, size: DVec3) -> f64 {
    // The field does not matter here.
    Camera::new(direction(camera), GridPoint(DVec3::ZERO), 1.0, 1).map_or(0.0, |camera| {
        let across = camera.right.abs().dot(size);
        let up = camera.up.abs().dot(size);
        across.max(up)
    })
}

fn direction(camera: &crate::plan::Camera) -> Direction {
    Direction {
        azimuth_deg: camera.azimuth_deg,
        elevation_deg: camera.elevation_deg,
    }
}

impl Field {
    /// A camera of the plan, looking here.
    pub(super) fn camera(
        &self,
        camera: &crate::plan::Camera,
        size: usize,
    ) -> Result<Camera, CameraError> {
        Camera::new(direction(camera), self.centre, self.side_mm, size)
    }
}

/// The letters of the patient's sides that a direction points to, the main one first.
pub(super) fn letters(toward: DVec3) -> String {
    const SIDES: [[&str; 2]; 3] = [["R", "L"], ["A", "P"], ["I", "S"]];
    // Less is not worth a letter: 22.5 degrees.
    const LEAST: f64 = 0.38;
    let mut axes: Vec<usize> = (0..3).filter(|&axis| toward[axis].abs() > LEAST).collect();
    axes.sort_by(|&a, &b| toward[b].abs().total_cmp(&toward[a].abs()));
    let letter = |&axis: &usize| SIDES[axis][usize::from(toward[axis] > 0.0)];
    axes.iter().map(letter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_leaves_the_voxels_on_its_side_and_none_from_beyond_the_end() {
        let whole = Region {
            first: [0; 3],
            last: [9; 3],
        };
        let left = |at: f64, greater: bool| {
            let region = half(whole, 1, at, greater);
            assert_eq!((region.first[0], region.last[2]), (0, 9));
            (region.first[1]..=region.last[1]).collect::<Vec<_>>()
        };
        assert_eq!(left(6.5, true), [7, 8, 9]);
        assert_eq!(left(7.0, true), [7, 8, 9]);
        assert_eq!(left(2.5, false), [0, 1, 2]);
        assert_eq!(left(9.0, true), [9]);
        assert_eq!(left(0.0, false), [0]);
        assert_eq!(left(-3.0, true).len(), 10);
        assert_eq!(left(30.0, false).len(), 10);
        assert!(left(9.1, true).is_empty() && left(-0.1, false).is_empty());
    }

    #[test]
    fn letters_name_the_sides() {
        assert_eq!(letters(DVec3::X), "L");
        assert_eq!(letters(-DVec3::Y), "A");
        assert_eq!(letters(DVec3::Z), "S");
        assert_eq!(letters(DVec3::new(-0.8, 0.6, 0.0)), "RP");
        assert_eq!(letters(DVec3::new(0.0, 0.2, -0.98)), "I");
    }
}
