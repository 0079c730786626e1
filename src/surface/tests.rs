use glam::DVec3;
use ndarray::Array3;
use proptest::prelude::*;

use super::*;
use crate::space::{Grid, GridPoint};
use crate::volume::{Mask, Rescale, Volume};

const THRESHOLD: f64 = -500.0;

/// HU of a body with a soft edge 2 mm wide, from the signed distance (mm, positive outside).
fn hu(distance: f64) -> i16 {
    let inside = (0.5 - distance / 2.0).clamp(0.0, 1.0);
    (-1000.0 + 1000.0 * inside).round() as i16
}

/// The volume of a body, and the voxels in it.
fn body(
    dims: [usize; 3],
    spacing: [f64; 3],
    distance: impl Fn(DVec3) -> f64,
) -> (Volume<i16>, Mask) {
    let grid = Grid::axis_aligned(dims, spacing).unwrap();
    let [nx, ny, nz] = dims;
    let samples = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| {
        hu(distance(
            DVec3::new(x as f64, y as f64, z as f64) * grid.spacing(),
        ))
    });
    let volume = Volume::new(grid, Rescale::NONE, samples).unwrap();
    let samples = volume.samples();
    let inside = |x: usize, y: usize, z: usize| f64::from(samples[[z, y, x]]) >= THRESHOLD;
    let mask = Mask::from_fn(dims, inside).unwrap();
    (volume.clone(), mask)
}

fn whole(volume: &Volume<i16>, mask: &Mask) -> SemiBoundary {
    semi_boundary(volume, mask, THRESHOLD, Region::whole(volume.grid())).unwrap()
}

fn ball(radius: f64) -> (Volume<i16>, Mask) {
    let centre = DVec3::new(20.0, 20.0, 20.0);
    body([80, 40, 30], [0.5, 1.0, 1.4], |p| {
        (p - centre).length() - radius
    })
}

#[test]
fn the_faces_of_a_box_are_counted_exactly() {
    // Across the ends of 64-voxel words, and of every small size.
    for (first, size) in [
        ([60, 3, 2], [10, 4, 5]),
        ([1, 1, 1], [1, 1, 1]),
        ([62, 2, 2], [2, 3, 1]),
        ([5, 1, 1], [130, 6, 7]),
    ] {
        let [a, b, c] = size;
        let dims = [140, 10, 10];
        let within = |at: usize, axis: usize| (first[axis]..first[axis] + size[axis]).contains(&at);
        let inside = |x: usize, y: usize, z: usize| within(x, 0) && within(y, 1) && within(z, 2);
        let mask = Mask::from_fn(dims, inside).unwrap();
        let grid = Grid::axis_aligned(dims, [1.0; 3]).unwrap();
        let samples =
            Array3::from_shape_fn(
                (10, 10, 140),
                |(z, y, x)| {
                    if inside(x, y, z) { 40_i16 } else { -1000 }
                },
            );
        let volume = Volume::new(grid, Rescale::NONE, samples).unwrap();
        let surface = whole(&volume, &mask);
        assert_eq!(surface.face_count(), 2 * (a * b + b * c + c * a));
        let inner = |n: usize| n.saturating_sub(2);
        assert_eq!(surface.len(), a * b * c - inner(a) * inner(b) * inner(c));
        assert_eq!(
            surface.bounds(),
            Some((
                first,
                [first[0] + a - 1, first[1] + b - 1, first[2] + c - 1]
            ))
        );
    }
}

proptest! {
    #[test]
    fn codes_say_which_neighbours_are_outside(seed: u64) {
        let dims = [70, 5, 4];
        let noise = |x: usize, y: usize, z: usize| {
            let mixed = (x as u64 + 71 * y as u64 + 397 * z as u64 + 1)
                .wrapping_mul(seed | 1)
                .wrapping_mul(0x9E37_79B9_7F4A_7C15);
            mixed >> 63 == 1
        };
        let mask = Mask::from_fn(dims, noise).unwrap();
        let grid = Grid::axis_aligned(dims, [1.0; 3]).unwrap();
        let volume = Volume::<i16>::zeros(grid, Rescale::NONE).unwrap();
        let region = Region { first: [3, 1, 0], last: [68, 4, 2] };
        let surface = semi_boundary(&volume, &mask, THRESHOLD, region).unwrap();
        let inside = |at: [isize; 3]| {
            (0..3).all(|axis| {
                (region.first[axis] as isize..=region.last[axis] as isize).contains(&at[axis])
            }) && noise(at[0] as usize, at[1] as usize, at[2] as usize)
        };
        let mut found = surface.iter();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let at = [x as isize, y as isize, z as isize];
                    if !inside(at) {
                        continue;
                    }
                    let faces = NeighbourCode::FACES.iter().enumerate().fold(0_u8, |bits, (face, to)| {
                        let beside = std::array::from_fn(|axis| at[axis] + isize::from(to[axis]));
                        bits | u8::from(!inside(beside)) << face
                    });
                    if faces == 0 {
                        continue;
                    }
                    let (place, voxel, row, plane) = found.next().unwrap();
                    prop_assert_eq!([voxel.x(), row, plane], [x, y, z]);
                    prop_assert_eq!(voxel.code().faces(), faces);
                    prop_assert_eq!(surface.index(place), Some([x, y, z]));
                }
            }
        }
        prop_assert!(found.next().is_none());
    }
}

#[test]
fn points_and_normals_of_a_ball_are_on_and_across_it() {
    let radius = 8.3;
    let (volume, mask) = ball(radius);
    let surface = whole(&volume, &mask);
    assert!(surface.len() > 500);
    let (mut off, mut turned): (f64, f64) = (0.0, 0.0);
    for (_, voxel, y, z) in surface.iter() {
        let from = surface.surface_point(voxel, y, z).0 - DVec3::splat(20.0);
        off = off.max((from.length() - radius).abs());
        let cosine = from.normalize().dot(voxel.normal().as_dvec3());
        turned = turned.max(libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees());
    }
    // Voxels are up to 1.4 mm long.
    assert!(off < 0.15, "a point is {off} mm off the ball");
    assert!(turned < 10.0, "a normal is turned by {turned}°");
}

#[test]
fn what_a_region_cuts_is_flat() {
    let (volume, mask) = ball(8.3);
    let mut region = Region::whole(volume.grid());
    region.first[1] = 20;
    let surface = semi_boundary(&volume, &mask, THRESHOLD, region).unwrap();
    let middle = surface.row(20, 14);
    let flat: Vec<_> = middle
        .iter()
        .filter(|voxel| voxel.code().is_cut())
        .collect();
    assert!(flat.len() > 25);
    for voxel in flat {
        assert_eq!(voxel.normal().to_array(), [0.0, -1.0, 0.0]);
        let point = surface.surface_point(*voxel, 20, 14);
        assert!((point.0.y - 19.5).abs() < 0.01);
    }
    assert!(surface.row(19, 14).is_empty());
    // The rim belongs to the surface.
    assert!(!middle.first().unwrap().code().is_cut());
}

#[test]
fn a_part_is_that_of_the_whole() {
    let (volume, mask) = ball(8.3);
    let all = whole(&volume, &mask);
    for (first, last) in [
        ([24, 13, 9], [41, 20, 22]),
        ([0; 3], [38, 17, 11]),
        ([30, 20, 10], [200, 200, 200]),
        ([64, 0, 0], [79, 39, 29]),
        ([0; 3], [79, 39, 29]),
    ] {
        let region = Region { first, last };
        let part = semi_boundary_in(&volume, &mask, THRESHOLD, region).unwrap();
        let of = |surface: &SemiBoundary| {
            let voxels = surface
                .iter()
                .filter(|(_, voxel, y, z)| region.contains([voxel.x(), *y, *z]));
            voxels
                .map(|(_, voxel, y, z)| (voxel, y, z))
                .collect::<Vec<_>>()
        };
        assert_eq!(part.len(), of(&part).len());
        assert_eq!(of(&part), of(&all));
        assert_eq!(part.rows.len(), all.rows.len());
    }
    let cut = Region {
        first: [24, 13, 9],
        last: [41, 20, 22],
    };
    let part = semi_boundary_in(&volume, &mask, THRESHOLD, cut).unwrap();
    assert!(
        part.len() > 100
            && part.len() < semi_boundary(&volume, &mask, THRESHOLD, cut).unwrap().len()
    );
}

#[test]
fn a_region_outside_leaves_nothing() {
    let (volume, mask) = ball(8.3);
    let region = Region {
        first: [200, 0, 0],
        last: [210, 5, 5],
    };
    assert!(
        semi_boundary(&volume, &mask, THRESHOLD, region)
            .unwrap()
            .is_empty()
    );
}

#[test]
fn a_mask_of_another_volume_is_refused() {
    let (volume, _) = ball(8.3);
    let mask = Mask::empty([80, 40, 31]).unwrap();
    let surface = semi_boundary(&volume, &mask, THRESHOLD, Region::whole(volume.grid()));
    assert!(matches!(surface, Err(SurfaceError::Shape { .. })));
}

#[test]
fn distances_between_balls_are_the_difference_of_their_radii() {
    let [small, large] = [7.0, 8.5].map(|radius| {
        let (volume, mask) = ball(radius);
        whole(&volume, &mask)
    });
    for (after, before, expected) in [(&large, &small, 1.5), (&small, &large, -1.5)] {
        let distances = signed_distances(after, before, 10.0);
        assert_eq!(distances.len(), after.len());
        let mean = distances.iter().sum::<f32>() / distances.len() as f32;
        assert!((mean - expected).abs() < 0.03, "mean {mean}");
        for distance in distances {
            assert!((distance - expected).abs() < 0.25, "{distance}");
        }
    }
    assert!(
        signed_distances(&small, &small, 10.0)
            .iter()
            .all(|&d| d == 0.0)
    );
    assert!(
        signed_distances(&large, &small, 0.5)
            .iter()
            .all(|d| d.is_nan())
    );
}

#[test]
fn the_nearest_point_is_that_of_a_full_search() {
    let (volume, mask) = ball(7.7);
    let surface = whole(&volume, &mask);
    let distance = SurfaceDistance::new(&surface, 100.0);
    for probe in [
        [3.0, 4.0, 5.0],
        [20.0, 20.0, 20.3],
        [39.0, 1.0, 20.0],
        [19.0, 27.9, 21.0],
        [-5.0, 50.0, 60.0],
    ] {
        let from = DVec3::from_array(probe);
        let points = surface
            .iter()
            .map(|(_, voxel, y, z)| surface.surface_point(voxel, y, z).0);
        let nearest = points
            .map(|point| (point - from).length())
            .fold(f64::INFINITY, f64::min);
        let found = distance.nearest_point(GridPoint(from)).unwrap();
        assert!(
            ((found.0 - from).length() - nearest).abs() < 1e-12,
            "from {probe:?}"
        );
    }
    assert!(distance.signed(GridPoint::new(20.0, 20.0, 20.0)).unwrap() < -7.5);
    let near = SurfaceDistance::new(&surface, 2.0);
    assert_eq!(near.signed(GridPoint::new(20.0, 20.0, 20.0)), None);
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let (volume, mask) = ball(8.3);
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| whole(&volume, &mask))
    };
    let one = build(1);
    assert_eq!(one, build(3));
    assert_eq!(one, build(4));
}
