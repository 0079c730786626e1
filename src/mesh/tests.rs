use glam::DVec3;
use ndarray::Array3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use super::*;
use crate::phantom::Phantom;
use crate::segment::segment;
use crate::space::{Grid, GridPoint};
use crate::volume::{Mask, Rescale, Volume};

const THRESHOLD: f64 = -500.0;
/// By how much smoothing may change a volume: it is given back to first order.
const SMOOTHED: f64 = 1e-5;

/// A ball of `radius` mm with an edge that is a ramp, on a grid of uneven spacing.
fn ball(radius: f64) -> (Volume<i16>, Mask) {
    let grid = Grid::axis_aligned([50, 44, 30], [0.5, 0.6, 1.0]).unwrap();
    let centre = DVec3::new(12.3, 13.1, 14.7);
    let samples = Array3::from_shape_fn((30, 44, 50), |(z, y, x)| {
        let at = DVec3::new(x as f64, y as f64, z as f64) * grid.spacing();
        let outside = (at - centre).length() - radius;
        (THRESHOLD - outside * 300.0).clamp(-1000.0, 60.0).round() as i16
    });
    let volume = Volume::new(grid, Rescale::NONE, samples).unwrap();
    let mask = segment(&volume, THRESHOLD, true).unwrap();
    (volume, mask)
}

fn ball_volume(radius: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius * radius * radius
}

fn random_mask(dims: [usize; 3], one_in: u32, seed: u64) -> Mask {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let [nx, ny, nz] = dims;
    let bits: Vec<bool> = (0..nx * ny * nz)
        .map(|_| random.next_u32() % one_in == 0)
        .collect();
    Mask::from_fn(dims, |x, y, z| bits[(z * ny + y) * nx + x]).unwrap()
}

fn any_share(inside: [usize; 3], outside: [usize; 3]) -> f64 {
    let mixed = inside.iter().chain(&outside).fold(7_usize, |hash, &n| {
        hash.wrapping_mul(0x9e37_79b9).wrapping_add(n)
    });
    (mixed % 1009) as f64 / 1008.0
}

#[test]
fn a_ball_has_its_volume_and_every_vertex_its_radius() {
    let (volume, mask) = ball(9.4);
    let mesh = isosurface(&volume, &mask, THRESHOLD).unwrap();
    assert!(mesh.topology().is_sound(), "{:?}", mesh.topology());
    let relative = mesh.volume() / ball_volume(9.4) - 1.0;
    assert!(relative.abs() < 0.005, "{relative}");
    for point in mesh.points() {
        let radius = (point.0 - DVec3::new(12.3, 13.1, 14.7)).length();
        assert!((radius - 9.4).abs() < 0.02, "{radius}");
    }
    let centroid = mesh.centroid().unwrap();
    assert!((centroid.0 - DVec3::new(12.3, 13.1, 14.7)).length() < 0.01);
    assert_eq!(mesh.components().len(), 1);
    // Euler: V - E + F = 2 for a sphere.
    let faces = mesh.triangles().len();
    assert_eq!(mesh.points().len() + faces - faces * 3 / 2, 2);
}

#[test]
fn random_voxels_give_a_closed_manifold() {
    for (seed, one_in) in [(1, 2), (2, 2), (3, 3), (4, 8)] {
        let mask = random_mask([23, 70, 19], one_in, seed);
        let first = GridPoint::new(0.0, 0.0, 0.0);
        let mesh = extract(&mask, DVec3::new(0.4, 0.4, 1.0), first, &any_share).unwrap();
        assert!(mesh.triangles().len() > 20_000);
        assert!(mesh.topology().is_sound(), "{:?}", mesh.topology());
        assert!(mesh.volume() > 0.0);
    }
}

/// Also around each point the triangles form one ring: in a closed mesh, as many edges as triangles meet there, and
/// they hang together.
#[test]
fn the_triangles_around_a_point_are_one_ring() {
    let mask = random_mask([12, 13, 11], 2, 9);
    let first = GridPoint::new(0.0, 0.0, 0.0);
    let mesh = extract(&mask, DVec3::ONE, first, &any_share).unwrap();
    let mut around = vec![Vec::new(); mesh.points().len()];
    for &[a, b, c] in mesh.triangles() {
        for [at, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
            around[at as usize].push((from, to));
        }
    }
    for ring in around {
        let first = ring[0].0;
        let mut at = first;
        for walked in 1..=ring.len() {
            at = ring.iter().find(|(from, _)| *from == at).unwrap().1;
            assert_eq!(at == first, walked == ring.len());
        }
    }
}

#[test]
fn an_object_that_fills_the_volume_is_a_closed_box() {
    let mask = Mask::from_fn([4, 5, 6], |_, _, _| true).unwrap();
    let first = GridPoint::new(0.0, 0.0, 0.0);
    let mesh = extract(&mask, DVec3::new(1.0, 2.0, 3.0), first, &any_share).unwrap();
    assert!(mesh.topology().is_sound());
    let points = mesh.points().iter().map(|point| point.0);
    let low = points.clone().reduce(DVec3::min).unwrap();
    let high = points.reduce(DVec3::max).unwrap();
    // Half a voxel beyond the first and last centres; its edges are cut off.
    assert_eq!(low, DVec3::new(-0.5, -1.0, -1.5));
    assert_eq!(high, DVec3::new(3.5, 9.0, 16.5));
    let relative = mesh.volume() / (4.0 * 10.0 * 18.0) - 1.0;
    assert!((-0.08..0.0).contains(&relative), "{relative}");
}

#[test]
fn smoothing_keeps_the_volume() {
    let (volume, mask) = ball(9.4);
    let mut mesh = isosurface(&volume, &mask, THRESHOLD).unwrap();
    let before = mesh.volume();
    let rough = roughness(&mesh);
    smooth(&mut mesh, SMOOTHING, |_| false).unwrap();
    assert!(mesh.topology().is_sound());
    assert!((mesh.volume() / before - 1.0).abs() < SMOOTHED);
    // The vertices lay on the ball already.
    assert!(roughness(&mesh) < 1.1 * rough);
    // Steps of whole voxels, which a threshold inside noise gives, go as well.
    let first = GridPoint::new(0.0, 0.0, 0.0);
    let half = |_: [usize; 3], _: [usize; 3]| 0.5;
    let mut steps = extract(&mask, volume.grid().spacing(), first, &half).unwrap();
    let (before, rough) = (steps.volume(), roughness(&steps));
    smooth(&mut steps, SMOOTHING, |_| false).unwrap();
    assert!((steps.volume() / before - 1.0).abs() < SMOOTHED);
    assert!(roughness(&steps) < 0.6 * rough);
}

/// Mean angle between triangles and the direction from the ball's centre, radians.
fn roughness(mesh: &Mesh) -> f64 {
    let angles = mesh.triangles().iter().map(|triangle| {
        let [a, b, c] = triangle.map(|point| mesh.points()[point as usize].0);
        let normal = (b - a).cross(c - a).normalize();
        let outward = ((a + b + c) / 3.0 - DVec3::new(12.3, 13.1, 14.7)).normalize();
        libm::acos(normal.dot(outward).min(1.0))
    });
    angles.sum::<f64>() / mesh.triangles().len() as f64
}

#[test]
fn decimated_meshes_are_closed_and_keep_their_shape() {
    let (volume, mask) = ball(9.4);
    let mut mesh = isosurface(&volume, &mask, THRESHOLD).unwrap();
    smooth(&mut mesh, SMOOTHING, |_| false).unwrap();
    let (before, all) = (mesh.volume(), mesh.triangles().len());
    decimate(&mut mesh, all / 6).unwrap();
    assert!(mesh.triangles().len() <= all / 6 && mesh.triangles().len() > all / 7);
    assert!(mesh.topology().is_sound(), "{:?}", mesh.topology());
    // About what a polyhedron with its vertices on the ball lacks.
    assert!((mesh.volume() / before - 1.0).abs() < 4e-3);
    for point in mesh.points() {
        let radius = (point.0 - DVec3::new(12.3, 13.1, 14.7)).length();
        assert!((radius - 9.4).abs() < 0.06, "{radius}");
    }
}

#[test]
fn noise_decimated_as_far_as_it_goes_stays_closed() {
    let mask = random_mask([20, 20, 20], 3, 5);
    let first = GridPoint::new(0.0, 0.0, 0.0);
    let mut mesh = extract(&mask, DVec3::ONE, first, &any_share).unwrap();
    let before = mesh.triangles().len();
    decimate(&mut mesh, 1).unwrap();
    assert!(mesh.triangles().len() < before);
    assert!(mesh.topology().is_sound(), "{:?}", mesh.topology());
}

#[test]
fn the_phantoms_head_is_closed_and_decimates() {
    let spacing = Phantom::default_grid().unwrap().spacing() * 2.0;
    let grid = Grid::axis_aligned([160, 160, 76], spacing.to_array()).unwrap();
    let head = Phantom::lee2001().render(&grid).unwrap();
    for (threshold, least) in [(THRESHOLD, 50_000), (300.0, 10_000)] {
        let mask = segment(&head, threshold, true).unwrap();
        let mut mesh = isosurface(&head, &mask, threshold).unwrap();
        assert!(mesh.triangles().len() > least);
        assert!(mesh.topology().is_sound(), "{:?}", mesh.topology());
        let before = mesh.volume();
        smooth(&mut mesh, SMOOTHING, |point| is_cut(&grid, point)).unwrap();
        let smoothed = mesh.volume();
        assert!((smoothed / before - 1.0).abs() < SMOOTHED);
        assert!(mesh.topology().is_sound(), "{:?}", mesh.topology());
        decimate(&mut mesh, 10_000).unwrap();
        assert!(mesh.triangles().len() <= 10_000);
        assert!(mesh.topology().is_sound(), "{:?}", mesh.topology());
        assert!((mesh.volume() / smoothed - 1.0).abs() < 5e-3);
    }
}

#[test]
fn files_hold_what_the_formats_say() {
    let (volume, mask) = ball(4.0);
    let mesh = isosurface(&volume, &mask, THRESHOLD).unwrap();
    let mut stl = Vec::new();
    write_stl(&mut stl, &mesh, volume.grid()).unwrap();
    assert_eq!(stl.len(), 84 + 50 * mesh.triangles().len());
    assert!(stl.starts_with(b"rhinoplan. SPACE=LPS\0"));
    let number = |at: usize| f32::from_le_bytes(stl[at..at + 4].try_into().unwrap());
    let normal = DVec3::new(number(84).into(), number(88).into(), number(92).into());
    assert!((normal.length() - 1.0).abs() < 1e-6);
    let corner = DVec3::new(number(96).into(), number(100).into(), number(104).into());
    assert!(
        normal.dot(corner - DVec3::new(12.3, 13.1, 14.7)) > 3.0,
        "outward"
    );

    let change: Vec<f32> = (0..mesh.points().len()).map(|n| n as f32).collect();
    let data = Coloured {
        change_mm: &change,
        limit_mm: 2.0,
        colour: |share| [(share * 10.0) as u8, 2, 3],
    };
    let mut ply = Vec::new();
    write_ply(&mut ply, &mesh, volume.grid(), &data).unwrap();
    let header = ply
        .windows(11)
        .position(|text| text == b"end_header\n")
        .unwrap()
        + 11;
    let (points, faces) = (mesh.points().len(), mesh.triangles().len());
    assert_eq!(ply.len(), header + 19 * points + 13 * faces);
    let second = header + 19;
    let number = f32::from_le_bytes(ply[second + 12..second + 16].try_into().unwrap());
    assert_eq!(number, 1.0);
    assert_eq!(ply[second + 16..second + 19], [5, 2, 3]);
    assert_eq!(ply[header + 19 * points], 3);
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let (volume, mask) = ball(9.4);
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut mesh = isosurface(&volume, &mask, THRESHOLD).unwrap();
            smooth(&mut mesh, SMOOTHING, |_| false).unwrap();
            decimate(&mut mesh, 2000).unwrap();
            mesh
        })
    };
    let one = build(1);
    assert!(!one.is_empty());
    assert_eq!(one, build(3));
}

#[test]
fn nothing_has_no_surface() {
    let mask = Mask::empty([5, 6, 7]).unwrap();
    let first = GridPoint::new(0.0, 0.0, 0.0);
    let mesh = extract(&mask, DVec3::ONE, first, &any_share).unwrap();
    assert!(mesh.is_empty() && mesh.volume() == 0.0 && mesh.centroid().is_none());
    assert!(mesh.topology().is_sound() && mesh.components().is_empty());
}
