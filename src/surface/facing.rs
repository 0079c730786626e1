//! The nearest point of a surface that looks in about a direction.

use glam::DVec3;

use super::boundary::SemiBoundary;
use crate::space::GridPoint;

/// A point of a surface, and how far it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestFacing {
    /// On the surface, as far as that is known between voxels.
    pub point: GridPoint,
    /// How far it is, mm.
    pub distance_mm: f64,
}

/// The point of `surface` nearest to `from` among those whose outward normal is less than 90° from `facing`;
/// `None` where there is none. Skin is told so from the walls of the airway behind it, which look the other
/// way. What a cut or the end of the scan exposes is no surface.
///
/// Every voxel is looked at: for a surface of a small [`Region`](super::Region). Where the nearest voxel's
/// surface is square to `from`, the point is on the plane through it, which knows the surface between
/// voxels. Of several equally near the first in the order of z, y, x is taken.
pub fn nearest_facing(
    surface: &SemiBoundary,
    from: GridPoint,
    facing: DVec3,
) -> Option<NearestFacing> {
    let mut best: Option<(f64, DVec3, DVec3)> = None;
    for (_, voxel, y, z) in surface.iter() {
        let normal = voxel.normal().as_dvec3();
        if voxel.code().is_cut() || normal.dot(facing) <= 0.0 {
            continue;
        }
        let point = surface.surface_point(voxel, y, z).0;
        let squared = (point - from.0).length_squared();
        if best.is_none_or(|(least, ..)| squared < least) {
            best = Some((squared, point, normal));
        }
    }
    let (_, point, normal) = best?;
    let to = from.0 - point;
    let across = to - normal * to.dot(normal);
    // Further along the plane than a voxel the surface need not follow it.
    let is_square = across.length() <= surface.grid().spacing().max_element();
    let point = if is_square { point + across } else { point };
    Some(NearestFacing {
        point: GridPoint(point),
        distance_mm: (point - from.0).length(),
    })
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::segment::segment;
    use crate::space::Grid;
    use crate::surface::{Region, semi_boundary};
    use crate::volume::{Rescale, Volume};

    const RADIUS: f64 = 12.0;
    const CAVITY: f64 = 7.0;
    const CENTRE: DVec3 = DVec3::new(20.0, 21.0, 19.5);

    /// A ball with a ball of air in it, as a shell of tissue: signed depth, blurred over ±1 mm.
    fn shell() -> SemiBoundary {
        let spacing = DVec3::new(0.8, 0.7, 1.0);
        let grid = Grid::axis_aligned([51, 60, 41], spacing.to_array()).unwrap();
        let samples = Array3::from_shape_fn((41, 60, 51), |(z, y, x)| {
            let at = DVec3::new(x as f64, y as f64, z as f64) * spacing;
            let r = (at - CENTRE).length();
            let depth = (RADIUS - r).min(r - CAVITY);
            (depth.clamp(-1.0, 1.0) * 500.0 - 500.0) as f32
        });
        let volume = Volume::new(grid.clone(), Rescale::NONE, samples).unwrap();
        let mask = segment(&volume, -500.0, true).unwrap();
        semi_boundary(&volume, &mask, -500.0, Region::whole(&grid)).unwrap()
    }

    /// How far a found point may be from the ball, mm: a tenth of a voxel.
    const ON_BALL: f64 = 0.08;

    #[test]
    fn the_point_is_on_the_outside_even_where_the_inside_is_nearer() {
        let surface = shell();
        let mut state = 3_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX) - 0.5
        };
        let (mut inside_nearer, mut furthest) = (0, 0.0_f64);
        for _ in 0..200 {
            let way = DVec3::new(next(), next() - 0.6, next()).normalize();
            let r = 8.0 + 9.0 * (next() + 0.5);
            inside_nearer += usize::from(r - CAVITY < RADIUS - r);
            let from = GridPoint(CENTRE + way * r);
            let found = nearest_facing(&surface, from, way).unwrap();
            let off = (found.point.0 - CENTRE).length() - RADIUS;
            assert!(off.abs() < ON_BALL, "{off} mm off the ball");
            let expected = CENTRE + way * RADIUS;
            furthest = furthest.max((found.point.0 - expected).length());
            assert!((found.distance_mm - (r - RADIUS).abs()).abs() < ON_BALL);
        }
        assert!(inside_nearer > 20, "{inside_nearer}");
        assert!(furthest < 0.5, "{furthest} mm from where it should be");
    }

    #[test]
    fn what_looks_the_other_way_is_not_taken() {
        let surface = shell();
        let front = GridPoint(CENTRE - DVec3::Y * 13.0);
        let found = nearest_facing(&surface, front, DVec3::Y).unwrap();
        // The front wall of the cavity looks back.
        assert!((found.distance_mm - 6.0).abs() < ON_BALL, "{found:?}");
    }

    #[test]
    fn a_cut_is_no_surface() {
        let grid = Grid::axis_aligned([10, 10, 10], [1.0; 3]).unwrap();
        let samples = Array3::from_elem((10, 10, 10), 40_i16);
        let volume = Volume::new(grid.clone(), Rescale::NONE, samples).unwrap();
        let mask = segment(&volume, -500.0, true).unwrap();
        let surface = semi_boundary(&volume, &mask, -500.0, Region::whole(&grid)).unwrap();
        assert!(!surface.is_empty());
        let from = GridPoint::new(5.0, -1.0, 5.0);
        assert_eq!(nearest_facing(&surface, from, DVec3::NEG_Y), None);
    }
}
