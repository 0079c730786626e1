//! The bounding box of the nose: the lines f2..f9 that hold the head still, and the box in which
//! model `local` works.

use glam::DVec3;
use serde::Serialize;

use super::{FeatureLine, Landmarks};
use crate::space::GridPoint;

/// How far in front of the foremost tip the box of model `local` begins, mm (method section 3).
pub const ANTERIOR_CLEARANCE_MM: f64 = 5.0;

/// f2..f9: the four edges of the base-plane face of the box around the nose, and the four of the face
/// parallel to it, `depth` further back. The same in source and target. In the units of its corners
/// (grid millimetres as made here).
///
/// Source: paper section III, Figs. 5 and 6; which side the parallel plane is on, method section 2.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cage {
    /// The corner of least x, y and z: right, on the base plane, inferior.
    pub min: DVec3,
    /// The opposite corner: left, `depth` behind the base plane, superior.
    pub max: DVec3,
}

impl Cage {
    /// The cage that the landmarks and the depth (mm) place.
    pub fn new(landmarks: &Landmarks<GridPoint>, depth_mm: f64) -> Self {
        let (x3, x4) = (landmarks.alare_left.0.x, landmarks.alare_right.0.x);
        let (z1, z2) = (landmarks.nasal_bones.0.z, landmarks.lip.0.z);
        let y6 = landmarks.maxilla.0.y;
        Self {
            min: DVec3::new(x3.min(x4), y6, z1.min(z2)),
            max: DVec3::new(x3.max(x4), y6 + depth_mm, z1.max(z2)),
        }
    }

    /// The cage with its corners multiplied axis by axis: other units.
    pub fn scaled(&self, by: DVec3) -> Self {
        Self {
            min: self.min * by,
            max: self.max * by,
        }
    }

    /// The eight edges, f2 to f9, as pairs of points: the base-plane face first, each face in the
    /// order inferior, superior, right, left.
    pub fn edges(&self) -> [(DVec3, DVec3); 8] {
        let face = |y: f64| {
            let corner = |x: f64, z: f64| DVec3::new(x, y, z);
            let (lo, hi) = (self.min, self.max);
            [
                (corner(lo.x, lo.z), corner(hi.x, lo.z)),
                (corner(lo.x, hi.z), corner(hi.x, hi.z)),
                (corner(lo.x, lo.z), corner(lo.x, hi.z)),
                (corner(hi.x, lo.z), corner(hi.x, hi.z)),
            ]
        };
        let [f2, f3, f4, f5] = face(self.min.y);
        let [f6, f7, f8, f9] = face(self.max.y);
        [f2, f3, f4, f5, f6, f7, f8, f9]
    }
}

/// The box in which model `local` moves tissue at full strength, in grid millimetres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NoseBox {
    /// Right, anterior, inferior corner.
    pub min: GridPoint,
    /// Left, posterior, superior corner.
    pub max: GridPoint,
}

impl NoseBox {
    /// The box of one stage: between the alare points, the `lip` and `nasal_bones` planes, and from
    /// 5 mm in front of the foremost tip to the base plane; extended to hold both lines
    /// (method section 3).
    pub fn new(
        landmarks: &Landmarks<GridPoint>,
        source: &FeatureLine,
        target: &FeatureLine,
    ) -> Self {
        let cage = Cage::new(landmarks, 0.0);
        let foremost = source.tip.0.y.min(target.tip.0.y);
        let mut min = DVec3::new(cage.min.x, foremost - ANTERIOR_CLEARANCE_MM, cage.min.z);
        let mut max = cage.max;
        for end in [source.root, source.tip, target.root, target.tip] {
            min = min.min(end.0);
            max = max.max(end.0);
        }
        Self {
            min: GridPoint(min),
            max: GridPoint(max),
        }
    }

    /// The smallest box that holds both.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            min: GridPoint(self.min.0.min(other.min.0)),
            max: GridPoint(self.max.0.max(other.max.0)),
        }
    }

    /// Distance from a point to the box, mm; 0 inside.
    pub fn distance(&self, point: GridPoint) -> f64 {
        let outside = (self.min.0 - point.0).max(point.0 - self.max.0);
        outside.max(DVec3::ZERO).length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn landmarks() -> Landmarks<GridPoint> {
        Landmarks {
            nasal_bones: GridPoint::new(62.0, 31.0, 79.0),
            lip: GridPoint::new(62.0, 30.0, 53.0),
            alare_right: GridPoint::new(42.0, 27.0, 60.0),
            alare_left: GridPoint::new(82.0, 27.0, 60.0),
            tip: GridPoint::new(57.0, 15.0, 61.0),
            maxilla: GridPoint::new(62.0, 37.0, 60.0),
        }
    }

    #[test]
    fn the_parallel_plane_is_behind_the_base_plane() {
        let cage = Cage::new(&landmarks(), 11.0);
        assert_eq!(cage.min, DVec3::new(42.0, 37.0, 53.0));
        assert_eq!(cage.max, DVec3::new(82.0, 48.0, 79.0));
    }

    #[test]
    fn the_edges_are_the_outlines_of_two_coronal_faces() {
        let edges = Cage::new(&landmarks(), 11.0).edges();
        for (place, (a, b)) in edges.iter().enumerate() {
            let along = *b - *a;
            assert_eq!(along.y, 0.0, "edge {place} leaves its face");
            assert_eq!(a.y, if place < 4 { 37.0 } else { 48.0 });
            let expected = if place % 4 < 2 { 40.0 } else { 26.0 };
            assert_eq!(along.length(), expected);
        }
    }

    #[test]
    fn the_box_reaches_past_the_foremost_tip_and_holds_both_lines() {
        let marks = landmarks();
        let source = FeatureLine::new(marks.nasal_bones, marks.tip).unwrap();
        let target = FeatureLine::new(
            GridPoint::new(62.0, 31.0, 90.0),
            GridPoint::new(30.0, 12.0, 61.0),
        )
        .unwrap();
        let nose = NoseBox::new(&marks, &source, &target);
        assert_eq!(nose.min.to_array(), [30.0, 7.0, 53.0]);
        assert_eq!(nose.max.to_array(), [82.0, 37.0, 90.0]);
        assert_eq!(nose.distance(GridPoint::new(50.0, 20.0, 60.0)), 0.0);
        assert_eq!(nose.distance(GridPoint::new(27.0, 3.0, 60.0)), 5.0);
    }
}
