use glam::{DVec3, Vec3};
use ndarray::Array3;

use super::shade::{Eight, Normals, SURFACE, Shader};
use super::span::WIDE;
use super::*;
use crate::simd::Simd;
use crate::space::{Grid, GridPoint};
use crate::surface::{Region, SemiBoundary, semi_boundary};
use crate::volume::{Mask, Rescale, Volume};

const THRESHOLD: f64 = -500.0;
const CENTRE: DVec3 = DVec3::new(20.0, 20.0, 20.0);

/// The surface of a body with a soft edge, from its signed distance (mm, positive outside).
fn surface(
    dims: [usize; 3],
    spacing: [f64; 3],
    region: Option<Region>,
    distance: impl Fn(DVec3) -> f64,
) -> SemiBoundary {
    let grid = Grid::axis_aligned(dims, spacing).unwrap();
    let [nx, ny, nz] = dims;
    let samples = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| {
        let at = DVec3::new(x as f64, y as f64, z as f64) * grid.spacing();
        let inside = (0.5 - distance(at)).clamp(0.0, 1.0);
        (-1000.0 + 1040.0 * inside).round() as i16
    });
    let volume = Volume::new(grid.clone(), Rescale::NONE, samples).unwrap();
    let samples = volume.samples();
    let inside = |x: usize, y: usize, z: usize| f64::from(samples[[z, y, x]]) >= THRESHOLD;
    let mask = Mask::from_fn(dims, inside).unwrap();
    let region = region.unwrap_or(Region::whole(&grid));
    semi_boundary(&volume, &mask, THRESHOLD, region).unwrap()
}

fn ball(radius: f64) -> SemiBoundary {
    surface([80, 40, 40], [0.5, 1.0, 1.0], None, |p| {
        (p - CENTRE).length() - radius
    })
}

const FRONT: Direction = Direction {
    azimuth_deg: 0.0,
    elevation_deg: 0.0,
};
const LEFT: Direction = Direction {
    azimuth_deg: 90.0,
    elevation_deg: 0.0,
};

/// Along the axes, the diagonals of faces and those of the cube.
fn directions() -> Vec<Direction> {
    let mut all = Vec::new();
    for elevation_deg in [-45.0, 0.0, 45.0] {
        for azimuth in 0..8 {
            all.push(Direction {
                azimuth_deg: f64::from(azimuth) * 45.0,
                elevation_deg,
            });
        }
    }
    for elevation_deg in [-90.0, 90.0] {
        all.push(Direction {
            azimuth_deg: 0.0,
            elevation_deg,
        });
    }
    assert_eq!(all.len(), 26);
    all
}

fn camera(from: Direction, field_mm: f64, size: usize) -> Camera {
    Camera::new(from, GridPoint(CENTRE), field_mm, size).unwrap()
}

fn plain(surface: &SemiBoundary) -> Object<'_> {
    Object {
        surface,
        paint: Paint::Plain(SKIN),
        opacity: 1.0,
    }
}

/// Where a pixel's middle is, mm from the middle of the picture.
fn from_middle(camera: &Camera, column: usize, row: usize) -> (f64, f64) {
    let middle = camera.size() as f64 / 2.0;
    let mm = camera.mm_per_pixel();
    (
        (column as f64 + 0.5 - middle) * mm,
        (middle - row as f64 - 0.5) * mm,
    )
}

#[test]
fn a_ball_is_a_disc_with_its_own_shading_from_everywhere() {
    let radius = 12.0;
    let ball = ball(radius);
    let shader = Shader::new(1.0);
    let objects = [plain(&ball)];
    for from in directions() {
        let camera = camera(from, 30.0, 150);
        let frame = render(&objects, &camera);
        for row in 0..150 {
            for column in 0..150 {
                let (x, y) = from_middle(&camera, column, row);
                let r = libm::hypot(x, y);
                let hit = frame.pick(column, row);
                let pixel = frame.pixels()[row * 150 + column];
                if r > radius + 0.35 {
                    assert!(hit.is_none(), "{from:?}: something at {r} mm");
                    assert_eq!(pixel, BACKGROUND);
                }
                if r < radius - 0.35 {
                    let hit = hit.unwrap_or_else(|| panic!("{from:?}: a hole at {r} mm"));
                    let depth = (radius * radius - r * r).sqrt();
                    // Steep at the rim.
                    let allowed = 0.15 + 0.18 * r / depth;
                    assert!(
                        (hit.depth_mm - depth).abs() < allowed,
                        "{from:?}: {} for {depth}",
                        hit.depth_mm
                    );
                }
                if r < 0.9 * radius {
                    let depth = (radius * radius - r * r).sqrt();
                    let normal = Vec3::new(x as f32, y as f32, depth as f32).normalize();
                    let eight = Eight {
                        normals: Normals {
                            x: [normal.x; WIDE],
                            y: [normal.y; WIDE],
                            z: [normal.z; WIDE],
                        },
                        light: [SURFACE.0; WIDE],
                        gloss: [SURFACE.1; WIDE],
                    };
                    let [[red, green, blue, _], ..] =
                        shader.shade(&shader.linear(&[SKIN; WIDE]), &eight);
                    let expected = [red, green, blue];
                    for (found, expected) in pixel.iter().zip(expected) {
                        assert!(
                            found.abs_diff(expected) <= 14,
                            "{from:?} at {x}, {y}: {found} for {expected}"
                        );
                    }
                }
            }
        }
        let area = frame.covered() as f64 * camera.mm_per_pixel() * camera.mm_per_pixel();
        let expected = std::f64::consts::PI * radius * radius;
        assert!(
            (area / expected - 1.0).abs() < 0.03,
            "{from:?}: area {area} for {expected}"
        );
    }
}

#[test]
fn picking_returns_the_voxel_that_was_projected() {
    // Voxels far enough apart that none hides another from the directions below.
    let lone = [[10, 12, 9], [31, 20, 22], [50, 29, 30], [66, 7, 35]];
    let dims = [80, 40, 40];
    let mask = Mask::from_fn(dims, |x, y, z| lone.contains(&[x, y, z])).unwrap();
    let grid = Grid::axis_aligned(dims, [0.5, 1.0, 1.0]).unwrap();
    let samples = Array3::from_shape_fn((40, 40, 80), |(z, y, x)| {
        if lone.contains(&[x, y, z]) {
            40_i16
        } else {
            -1000
        }
    });
    let volume = Volume::new(grid.clone(), Rescale::NONE, samples).unwrap();
    let surface = semi_boundary(&volume, &mask, THRESHOLD, Region::whole(&grid)).unwrap();
    assert_eq!(surface.len(), lone.len());
    for from in directions() {
        let camera = camera(from, 60.0, 240);
        let frame = render(&[plain(&surface)], &camera);
        for voxel in lone {
            let centre = DVec3::from_array(voxel.map(|at| at as f64)) * grid.spacing();
            let at = camera.project(GridPoint(centre));
            let hit = frame.pick(at.x as usize, at.y as usize);
            let hit = hit.unwrap_or_else(|| panic!("{from:?}: {voxel:?} is not seen"));
            assert_eq!(hit.voxel, voxel, "{from:?}");
            assert_eq!(surface.index(hit.place), Some(voxel));
        }
        assert_eq!(frame.pick(0, 0), None);
        assert_eq!(frame.pick(240, 0), None);
    }
}

#[test]
fn a_picked_voxel_of_a_ball_is_where_the_pixel_is() {
    let ball = ball(12.0);
    for from in directions() {
        let camera = camera(from, 30.0, 100);
        let frame = render(&[plain(&ball)], &camera);
        for (column, row) in (0..100).flat_map(|row| (0..100).map(move |column| (column, row))) {
            let Some(hit) = frame.pick(column, row) else {
                continue;
            };
            let centre = DVec3::from_array(hit.voxel.map(|at| at as f64)) * ball.grid().spacing();
            let (x, y) = from_middle(&camera, column, row);
            let at = camera.project(GridPoint(centre));
            let seen = camera.project(camera.unproject(Projected {
                x: column as f64 + 0.5,
                y: row as f64 + 0.5,
                depth_mm: hit.depth_mm,
            }));
            let apart = libm::hypot(at.x - seen.x, at.y - seen.y) * camera.mm_per_pixel();
            assert!(
                apart < 2.2,
                "{from:?} at {x}, {y}: the voxel is {apart} mm away"
            );
        }
    }
}

/// Whether every pixel is covered whose ray goes through a body by more than a little.
fn no_holes(
    body: &SemiBoundary,
    inside: impl Fn(DVec3) -> bool,
    from: Direction,
    field: f64,
    size: usize,
) {
    let camera = camera(from, field, size);
    let frame = render(&[plain(body)], &camera);
    for row in 0..size {
        for column in 0..size {
            let at = |depth_mm: f64| {
                camera
                    .unproject(Projected {
                        x: column as f64 + 0.5,
                        y: row as f64 + 0.5,
                        depth_mm,
                    })
                    .0
            };
            let first = (0..240).rev().map(|step| f64::from(step) / 4.0 - 30.0);
            let Some(first) = first.into_iter().find(|&depth| inside(at(depth))) else {
                continue;
            };
            let hit = frame.pick(column, row);
            let hit =
                hit.unwrap_or_else(|| panic!("{from:?}, field {field}: a hole at {column}, {row}"));
            assert!(
                hit.depth_mm > first - 1.5,
                "{from:?}, field {field}: at {column}, {row} seen {} mm behind the surface at {}",
                first - hit.depth_mm,
                at(first)
            );
        }
    }
}

#[test]
fn no_holes_at_any_zoom_and_angle() {
    // Balls, a plate, a rod and a shell: flat, thin, curved and hollow.
    let distance = |p: DVec3| {
        let ball = |c: [f64; 3], r: f64| (p - DVec3::from_array(c)).length() - r;
        let plate = (p - DVec3::new(20.0, 30.0, 20.0)).abs() - DVec3::new(12.0, 1.2, 9.0);
        let rod = {
            let q = p - DVec3::new(20.0, 20.0, 31.0);
            libm::hypot(q.y, q.z).max(q.x.abs() - 15.0) - 1.3
        };
        let shell = (ball([15.0, 18.0, 17.0], 8.0)).abs() - 1.1;
        ball([26.0, 15.0, 21.0], 7.0)
            .min(plate.max_element())
            .min(rod)
            .min(shell)
    };
    let body = surface([80, 40, 40], [0.5, 1.0, 1.0], None, distance);
    let mut from = directions();
    // And some that no lattice knows.
    for step in 0..6 {
        from.push(Direction {
            azimuth_deg: 17.0 + 61.0 * f64::from(step),
            elevation_deg: -71.0 + 29.0 * f64::from(step),
        });
    }
    let inside = |p: DVec3| distance(p) < -0.7;
    for from in from {
        no_holes(&body, inside, from, 50.0, 64);
        no_holes(&body, inside, from, 50.0, 11);
        no_holes(&body, inside, from, 9.0, 96);
    }
}

/// A step with sharp edges: its upper half lies 8 mm before its lower half.
fn step() -> (SemiBoundary, impl Fn(DVec3) -> bool) {
    let distance = |p: DVec3| {
        let upper = (12.3 - p.y).max(20.4 + 0.05 * (p.x - 20.0) - p.z);
        upper.min(20.3 - p.y)
    };
    let step = surface([80, 40, 40], [0.5, 1.0, 1.0], None, distance);
    (step, move |p: DVec3| distance(p) < 0.0)
}

#[test]
fn a_face_seen_edge_on_does_not_stand_out() {
    let (step, inside) = step();
    let objects = [plain(&step)];
    let size = 120;
    for (azimuth_deg, elevation_deg) in [(0.0, 0.0), (0.0, 1.5), (0.0, -1.5), (30.0, 0.0)] {
        let from = Direction {
            azimuth_deg,
            elevation_deg,
        };
        for field in [16.0, 24.0] {
            let camera = camera(from, field, size);
            let frame = render(&objects, &camera);
            let first = |column: usize, row: usize| {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let depths = (0..400).rev().map(|step| f64::from(step) / 10.0 - 20.0);
                let mut depths = depths.filter(|&depth_mm| {
                    let at = Projected { x, y, depth_mm };
                    inside(camera.unproject(at).0)
                });
                depths.next().unwrap_or(f64::NEG_INFINITY)
            };
            let first: Vec<f64> = (0..size * size)
                .map(|pixel| first(pixel % size, pixel / size))
                .collect();
            let near = |at: usize| at.saturating_sub(6)..(at + 7).min(size);
            for (column, row) in (0..size * size).map(|pixel| (pixel % size, pixel / size)) {
                let nearest = near(row)
                    .flat_map(|row| near(column).map(move |column| row * size + column))
                    .map(|pixel| first[pixel])
                    .fold(f64::NEG_INFINITY, f64::max);
                let Some(hit) = frame.pick(column, row) else {
                    continue;
                };
                assert!(
                    hit.depth_mm < nearest + 0.6,
                    "{from:?}, {field} mm: {column}, {row} at {} mm, but nothing is nearer than {nearest}",
                    hit.depth_mm
                );
            }
        }
    }
}

#[test]
fn a_sharp_edge_has_no_specks() {
    let (step, _) = step();
    let objects = [plain(&step)];
    let size = 100;
    for (azimuth_deg, elevation_deg) in [(0.0, -4.0), (0.0, -8.0), (30.0, -6.0), (-45.0, -3.0)] {
        let from = Direction {
            azimuth_deg,
            elevation_deg,
        };
        let frame = render(&objects, &camera(from, 24.0, size));
        let light = |column: usize, row: usize| i32::from(frame.pixels()[row * size + column][1]);
        let inner = 1..size - 1;
        for (column, row) in inner
            .clone()
            .flat_map(|c| inner.clone().map(move |r| (c, r)))
        {
            let mut around: Vec<i32> = (row - 1..=row + 1)
                .flat_map(|row| (column - 1..=column + 1).map(move |column| light(column, row)))
                .collect();
            around.sort_unstable();
            let off = light(column, row) - around[4];
            assert!(
                off.abs() <= 45,
                "{from:?}: {column}, {row} is {off} lighter than what is around it"
            );
        }
    }
}

#[test]
fn what_is_translucent_shows_what_is_behind_it() {
    let (outer, inner) = (ball(12.0), ball(6.0));
    let front = camera(FRONT, 30.0, 101);
    let bone = Object {
        surface: &inner,
        paint: Paint::Plain(BONE),
        opacity: 1.0,
    };
    let skin = |opacity: f64| Object {
        opacity,
        ..plain(&outer)
    };
    let middle = |objects: &[Object<'_>]| render(objects, &front).pixels()[50 * 101 + 50];
    let alone = middle(&[skin(1.0)]);
    assert_eq!(middle(&[skin(1.0), bone]), alone, "what is opaque hides");
    let mixed = middle(&[skin(0.4), bone]);
    assert_ne!(mixed, alone);
    assert_eq!(
        middle(&[bone, skin(0.4)]),
        mixed,
        "depth decides, not the order given"
    );
    let hit = render(&[bone, skin(0.4)], &front).pick(50, 50).unwrap();
    assert_eq!(hit.object, 1, "the skin is in front");
}

#[test]
fn a_cut_is_flat_and_ends_where_the_region_does() {
    let region = Region {
        first: [0, 20, 0],
        last: [79, 39, 39],
    };
    let half = surface([80, 40, 40], [0.5, 1.0, 1.0], Some(region), |p| {
        (p - CENTRE).length() - 12.0
    });
    let front = camera(FRONT, 30.0, 101);
    let frame = render(&[plain(&half)], &front);
    let expected = frame.pixels()[50 * 101 + 50];
    for (column, row) in [(20, 50), (80, 50), (50, 20), (50, 80), (37, 61)] {
        assert_eq!(frame.pixels()[row * 101 + column], expected);
        let hit = frame.pick(column, row).unwrap();
        // Half a voxel in front of the first that is kept.
        assert!((hit.depth_mm - 0.5).abs() < 0.02, "{}", hit.depth_mm);
    }
    // From the side, nothing stands in front of the cut.
    let left = camera(LEFT, 30.0, 300);
    let frame = render(&[plain(&half)], &left);
    let column = |y: f64| left.project(GridPoint(DVec3::new(20.0, y, 20.0))).x as usize;
    assert!(frame.pick(column(19.3), 150).is_none());
    assert!(frame.pick(column(19.8), 150).is_some());
}

#[test]
fn edges_have_colours_between() {
    let ball = ball(12.0);
    let frame = render(&[plain(&ball)], &camera(FRONT, 30.0, 150));
    let between = |row: usize| {
        let line = &frame.pixels()[row * 150..(row + 1) * 150];
        line.iter()
            .filter(|pixel| (40..90).contains(&pixel[0]))
            .count()
    };
    let softened = (20..130).filter(|&row| between(row) > 0).count();
    assert!(softened > 40, "only {softened} rows have a soft edge");
}

#[test]
fn values_colour_the_surface() {
    let ball = ball(12.0);
    let values: Vec<f32> = ball
        .iter()
        .map(|(_, _, _, z)| if z >= 20 { 1.0 } else { f32::NAN })
        .collect();
    let colour = |value: f32| {
        if value > 0.5 {
            [255, 0, 0]
        } else {
            [0, 0, 255]
        }
    };
    let object = Object {
        paint: Paint::Scalar {
            values: &values,
            colour: &colour,
        },
        ..plain(&ball)
    };
    let frame = render(&[object], &camera(FRONT, 30.0, 101));
    let upper = frame.pixels()[30 * 101 + 50];
    let lower = frame.pixels()[70 * 101 + 50];
    assert!(upper[0] > 100 && upper[2] < 90, "{upper:?}");
    assert!(lower[2] > 100 && lower[0] < 90, "{lower:?}");
}

/// The colour of a pixel, and the place and the bits of the depth of what it shows.
type Shown = ([u8; 3], Option<(usize, u64)>);

fn shown(frame: &Frame<'_>) -> Vec<Shown> {
    let size = frame.size();
    let hit = |pixel: usize| frame.pick(pixel % size, pixel / size);
    let seen = |pixel| hit(pixel).map(|hit| (hit.place, hit.depth_mm.to_bits()));
    let pixels = frame.pixels().iter().enumerate();
    pixels.map(|(at, &colour)| (colour, seen(at))).collect()
}

#[test]
fn all_instructions_draw_the_same() {
    let region = Region {
        first: [0, 18, 0],
        last: [79, 39, 30],
    };
    // Curved, with a cut and with something a voxel thick.
    let body = surface([80, 40, 40], [0.5, 1.0, 1.0], Some(region), |p| {
        let plate = (p - DVec3::new(20.0, 30.0, 20.0)).abs() - DVec3::new(18.0, 0.5, 9.0);
        ((p - CENTRE).length() - 12.0).min(plate.max_element())
    });
    let values: Vec<f32> = (0..body.len()).map(|at| (at % 100) as f32).collect();
    let colour = |value: f32| [value as u8, 200 - value as u8, 30];
    let coloured = Object {
        paint: Paint::Scalar {
            values: &values,
            colour: &colour,
        },
        ..plain(&body)
    };
    let clear = Object {
        opacity: 0.5,
        ..plain(&body)
    };
    let ball = ball(9.0);
    let sets = [
        vec![plain(&body)],
        vec![coloured],
        vec![clear, plain(&ball)],
    ];
    for (from, size) in directions()
        .into_iter()
        .step_by(5)
        .zip([61, 64, 131, 90, 33, 102])
    {
        let camera = camera(from, 40.0, size);
        for objects in &sets {
            let all = Simd::compare(|_| shown(&render(objects, &camera)));
            let covered = all[0].1.iter().filter(|(_, hit)| hit.is_some());
            assert!(covered.count() > size * size / 20, "{from:?}");
            for (simd, shown) in &all {
                assert!(*shown == all[0].1, "{simd}, {from:?}, {size} pixels");
            }
        }
    }
}

#[test]
fn a_picture_keeps_nothing_of_one_before_it() {
    let (large, small) = (ball(14.0), ball(6.0));
    let camera = camera(FRONT, 30.0, 117);
    let before = shown(&render(&[plain(&small)], &camera));
    // Given back, and taken again by the next.
    drop(render(&[plain(&large)], &camera));
    let after = shown(&render(&[plain(&small)], &camera));
    assert!(before == after);
    assert_eq!(before[0], (BACKGROUND, None));
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let ball = ball(12.0);
    let camera = camera(directions()[3], 30.0, 333);
    let draw = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| render(&[plain(&ball)], &camera).pixels().to_vec())
    };
    let one = draw(1);
    assert!(one == draw(2) && one == draw(5));
}
