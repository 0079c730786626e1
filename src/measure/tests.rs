//! Volumes against bodies whose volumes are known without voxels.

use glam::DVec3;
use ndarray::Array3;

use super::regions::measure;
use super::*;
use crate::feature::Landmarks;
use crate::phantom::{Phantom, SPACING};
use crate::simd::Simd;
use crate::space::{ContinuousIndex, Grid, GridPoint};
use crate::volume::{Rescale, Sample, Volume};

const SKIN_HU: f64 = -500.0;

fn slabs(nasal_bones_z: f64, lip_z: f64, base_y: f64) -> Slabs {
    Slabs::new(&landmarks(nasal_bones_z, lip_z, base_y)).unwrap()
}

fn landmarks(nasal_bones_z: f64, lip_z: f64, base_y: f64) -> Landmarks<GridPoint> {
    Landmarks {
        nasal_bones: GridPoint::new(0.0, 0.0, nasal_bones_z),
        lip: GridPoint::new(0.0, 0.0, lip_z),
        maxilla: GridPoint::new(0.0, base_y, 0.0),
        ..Phantom::lee2001().landmarks_mm()
    }
}

/// A grid whose voxels fill at least `extent` mm.
fn grid(extent: [f64; 3], spacing: [f64; 3]) -> Grid {
    let dims = std::array::from_fn(|axis| (extent[axis] / spacing[axis]).ceil() as usize);
    Grid::axis_aligned(dims, spacing).unwrap()
}

/// A body of water in air, its edge blurred by `sigma` mm; `depth` is mm below its surface.
fn body(grid: &Grid, sigma: f64, depth: impl Fn(DVec3) -> f64) -> Volume<i16> {
    let [nx, ny, nz] = grid.dims();
    let samples = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| {
        let index = ContinuousIndex::new(x as f64, y as f64, z as f64);
        let sigmas = depth(grid.index_to_grid(index).0) / sigma;
        let inside = 0.5 * libm::erfc(-sigmas * std::f64::consts::FRAC_1_SQRT_2);
        (1000.0 * inside - 1000.0).round() as i16
    });
    Volume::new(grid.clone(), Rescale::NONE, samples).unwrap()
}

fn volumes<T: Sample>(volume: &Volume<T>, slabs: &Slabs) -> [f64; REGIONS] {
    region_volumes(volume, slabs, SKIN_HU).unwrap().0
}

/// Fails where a region is further than `percent` from what it should be.
fn assert_near(found: [f64; REGIONS], expected: [f64; REGIONS], percent: f64, what: &str) {
    let off: Vec<f64> = found
        .iter()
        .zip(expected)
        .map(|(found, expected)| 100.0 * (found / expected - 1.0))
        .collect();
    println!("{what}: {off:+.3?} %");
    assert!(
        off.iter().all(|off| off.abs() <= percent),
        "{what}: {off:?} %, {percent} % allowed"
    );
}

/// Voxel sizes (mm), edge blurs (mm) and sub-voxel offsets (mm) that the bodies are measured at.
fn settings() -> impl Iterator<Item = ([f64; 3], f64, DVec3)> {
    let spacings = [SPACING, [0.5; 3], [1.0; 3], [0.9, 0.9, 1.0]];
    let offsets = [
        DVec3::ZERO,
        DVec3::new(0.13, 0.31, 0.47),
        DVec3::new(0.5, -0.2, 0.21),
    ];
    spacings.into_iter().flat_map(move |spacing| {
        [0.4, 0.6, 0.8].into_iter().flat_map(move |sigma| {
            offsets
                .into_iter()
                .map(move |offset| (spacing, sigma, offset))
        })
    })
}

/// How far off a region may be, %. Where voxels are further apart than two standard deviations of the
/// edge, both neighbours of a surface can be plain air and plain tissue, and tell little of where it is;
/// a face parallel to the slices is then off all at once.
fn allowed(spacing: [f64; 3], sigma: f64) -> f64 {
    let coarsest = spacing.into_iter().fold(0.0, f64::max);
    if coarsest <= 0.5 {
        0.3
    } else if coarsest <= 2.0 * sigma {
        0.8
    } else {
        1.0
    }
}

/// The front of the phantom, with noise, on voxels of `spacing` mm.
fn phantom(spacing: [f64; 3]) -> Volume<i16> {
    let grid = grid([142.0, 42.0, 84.0], spacing);
    Phantom::lee2001().render(&grid).unwrap()
}

fn phantom_slabs() -> Slabs {
    Slabs::new(&Phantom::lee2001().landmarks_mm()).unwrap()
}

#[test]
fn the_phantom_at_several_voxel_sizes() {
    let truth = Phantom::lee2001().true_region_volumes();
    for (spacing, percent) in [
        (SPACING, 0.5),
        ([0.5; 3], 0.5),
        ([0.7; 3], 0.5),
        ([1.0; 3], 0.8),
    ] {
        let found = region_volumes(&phantom(spacing), &phantom_slabs(), SKIN_HU).unwrap();
        assert_near(found.0, truth, percent, &format!("{spacing:?}"));
        let total = found.total() / truth.iter().sum::<f64>();
        assert!((total - 1.0).abs() < 0.001, "{spacing:?}: total {total}");
    }
}

#[test]
fn more_lines_change_little() {
    let volume = phantom(SPACING);
    let found = volumes(&volume, &phantom_slabs());
    let finer = measure(&volume, &phantom_slabs(), SKIN_HU, 12).unwrap();
    assert_near(found, finer.0, 0.1, "6 lines by 12");
}

#[test]
fn tilted_half_spaces() {
    let normal = DVec3::new(0.3, 0.9, -0.25).normalize();
    for (spacing, sigma, offset) in settings() {
        let grid = grid([20.0, 24.0, 28.0], spacing);
        let point = DVec3::new(10.0, 10.0, 14.0) + offset;
        let volume = body(&grid, sigma, |p| (p - point).dot(normal));
        let (top, bottom, base) = (22.3, 3.7, 19.83);
        let middle = 0.5 * (grid.dims()[0] - 1) as f64 * spacing[0];
        let width = grid.dims()[0] as f64 * spacing[0];
        let height = (top - bottom) / REGIONS as f64;
        let expected = std::array::from_fn(|n| {
            let z = top - (n as f64 + 0.5) * height;
            let from = DVec3::new(middle, 0.0, z) - point;
            // Where the surface meets (middle, y, z): linear in x and z, so the middle is the mean.
            let front = point.y - (from.x * normal.x + from.z * normal.z) / normal.y;
            (base - front) * width * height
        });
        let what = format!("half-space, {spacing:?}, {sigma}, {offset}");
        assert_near(
            volumes(&volume, &slabs(top, bottom, base)),
            expected,
            0.05,
            &what,
        );
    }
}

#[test]
fn balls() {
    const RADIUS: f64 = 9.0;
    for (spacing, sigma, offset) in settings() {
        let grid = grid([24.0, 24.0, 27.0], spacing);
        let centre = DVec3::new(12.0, 11.5, 12.0) + offset;
        let volume = body(&grid, sigma, |p| RADIUS - (p - centre).length());
        let what = format!("ball, {spacing:?}, {sigma}, {offset}");

        // Every region within the ball; the base plane behind it.
        let (top, bottom) = (centre.z + 6.6, centre.z - 7.7);
        let below = |z: f64| {
            let up = z - centre.z;
            std::f64::consts::PI * (RADIUS * RADIUS * up - up * up * up / 3.0)
        };
        let all = slabs(top, bottom, 22.4);
        let planes = all.planes();
        let expected = std::array::from_fn(|n| below(planes[n]) - below(planes[n + 1]));
        assert_near(
            volumes(&volume, &all),
            expected,
            allowed(spacing, sigma),
            &what,
        );

        // The base plane through the ball, the regions beyond its poles: a spherical cap.
        let cap = RADIUS - 2.3;
        let found = region_volumes(&volume, &slabs(26.5, 0.5, centre.y - 2.3), SKIN_HU).unwrap();
        let expected = std::f64::consts::PI * cap * cap * (RADIUS - cap / 3.0);
        let off = found.total() / expected - 1.0;
        assert!(
            100.0 * off.abs() < allowed(spacing, sigma),
            "{what}: cap {off}"
        );
        assert_eq!(found.0[0], 0.0, "a region without tissue is 0");
    }
}

#[test]
fn cylinders_cut_in_half() {
    const RADIUS: f64 = 6.0;
    for (spacing, sigma, offset) in settings() {
        let grid = grid([18.0, 18.0, 16.0], spacing);
        let axis = DVec3::new(9.0, 8.5, 0.0) + offset;
        let volume = body(&grid, sigma, |p| {
            RADIUS - libm::hypot(p.x - axis.x, p.y - axis.y)
        });
        let (top, bottom) = (13.1, 2.6);
        let half = 0.5 * std::f64::consts::PI * RADIUS * RADIUS * (top - bottom) / REGIONS as f64;
        let what = format!("cylinder, {spacing:?}, {sigma}, {offset}");
        assert_near(
            volumes(&volume, &slabs(top, bottom, axis.y)),
            [half; REGIONS],
            allowed(spacing, sigma),
            &what,
        );
    }
}

#[test]
fn boxes() {
    for (spacing, sigma, offset) in settings() {
        let grid = grid([20.0, 20.0, 20.0], spacing);
        let (low, high) = (
            DVec3::new(4.0, 5.0, 3.0) + offset,
            DVec3::new(16.0, 15.0, 16.0) + offset,
        );
        let volume = body(&grid, sigma, |p| (p - low).min(high - p).min_element());
        let what = format!("box, {spacing:?}, {sigma}, {offset}");
        // Across its middle, where its ends are out of sight.
        let (top, bottom, base) = (low.z + 9.3, low.z + 3.1, low.y + 6.05);
        let area = (high.x - low.x) * (base - low.y);
        let slice = area * (top - bottom) / REGIONS as f64;
        assert_near(
            volumes(&volume, &slabs(top, bottom, base)),
            [slice; REGIONS],
            allowed(spacing, sigma),
            &what,
        );
        // From beyond one end to beyond the other.
        let found = region_volumes(&volume, &slabs(19.2, 0.3, base), SKIN_HU).unwrap();
        let off = found.total() / (area * (high.z - low.z)) - 1.0;
        assert!(
            100.0 * off.abs() < allowed(spacing, sigma),
            "{what}: whole {off}"
        );
    }
}

/// A face across the whole width, y = 6 mm.
fn wall() -> Volume<i16> {
    body(&grid([12.0, 20.0, 20.0], [0.9, 0.7, 1.3]), 0.5, |p| {
        p.y - 6.0
    })
}

#[test]
fn a_shifted_base_plane_changes_volumes_in_proportion() {
    let volume = wall();
    let width = volume.grid().dims()[0] as f64 * 0.9;
    let at = |base| volumes(&volume, &slabs(15.0, 4.0, base));
    for step in 0..60 {
        let base = 11.0 + 0.1 * f64::from(step);
        let (before, after) = (at(base), at(base + 0.1));
        for (before, after) in before.iter().zip(after) {
            // Slabs are 1 mm; behind the surface's blur the change is exact.
            assert!((after - before - width * 0.1).abs() < 1e-9);
        }
    }
}

#[test]
fn a_slice_that_planes_cut_is_shared_in_proportion() {
    let volume = wall();
    let whole = region_volumes(&volume, &slabs(15.0, 4.0, 13.0), SKIN_HU).unwrap();
    for shift in [0.1, 0.35, 0.6, 1.0] {
        let thinner = region_volumes(&volume, &slabs(15.0 - shift, 4.0, 13.0), SKIN_HU).unwrap();
        let share = thinner.total() / whole.total();
        assert!((share - (11.0 - shift) / 11.0).abs() < 1e-12, "{share}");
    }
}

#[test]
fn a_voxel_at_the_rim_reaches_half_a_voxel_out() {
    let volume = wall();
    let [_, ny, nz] = volume.grid().dims();
    let (back, top) = ((ny as f64 - 0.5) * 0.7, (nz as f64 - 0.5) * 1.3);
    let to_the_rim = region_volumes(&volume, &slabs(top, -0.65, back), SKIN_HU).unwrap();
    let beyond = region_volumes(&volume, &slabs(top, -0.65, back + 5.0), SKIN_HU).unwrap();
    assert_eq!(to_the_rim, beyond);
    let width = volume.grid().dims()[0] as f64 * 0.9;
    let expected = width * (back - 6.0) * (top + 0.65);
    assert!((to_the_rim.total() / expected - 1.0).abs() < 1e-3);
    // Slabs that are outside hold nothing.
    let above = volumes(&volume, &slabs(top + 11.0, top - 11.0, back));
    assert!(above[4] == 0.0 && above[5] > 0.0 && above[10] > 0.0);
}

#[test]
fn the_same_bytes_for_any_number_of_threads() {
    let volume = phantom([1.0; 3]);
    let with = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| volumes(&volume, &phantom_slabs()).map(f64::to_bits))
    };
    assert_eq!(with(1), with(2));
    assert_eq!(with(1), with(4));
}

#[test]
fn the_same_bytes_with_any_instructions() {
    let volume = phantom([1.0; 3]);
    let found = Simd::compare(|_| volumes(&volume, &phantom_slabs()).map(f64::to_bits));
    for (simd, bits) in &found {
        assert_eq!(bits, &found[0].1, "{simd}");
    }
}

/// What is deep in tissue, or far outside, is not looked at sheet by sheet: with bone and metal beside it, too.
#[test]
fn a_step_between_extremes_is_measured_as_between_ordinary_values() {
    for (inside, outside) in [(40, -1000), (3071, -1000), (40, -1024), (31_000, -1000)] {
        let wall = wall();
        let samples = wall
            .samples()
            .mapv(|hu| if hu >= 0 { inside } else { outside });
        let volume = Volume::new(wall.grid().clone(), Rescale::NONE, samples).unwrap();
        let fine = measure(&volume, &slabs(20.0, 3.0, 12.0), SKIN_HU, 1).unwrap();
        let finer = measure(&volume, &slabs(20.0, 3.0, 12.0), SKIN_HU, 24).unwrap();
        let (fine, finer) = (fine.total(), finer.total());
        assert!(
            (fine / finer - 1.0).abs() < 1e-6,
            "{inside}: {fine} {finer}"
        );
    }
}

/// The volume in samples of another type, with the slope and intercept that keep its HU.
fn stored<T: Sample>(volume: &Volume<i16>, slope: f64, intercept: f64) -> Volume<T> {
    let samples = volume
        .samples()
        .map(|&hu| T::from_interpolated((f64::from(hu) - intercept) / slope));
    Volume::new(volume.grid().clone(), Rescale { slope, intercept }, samples).unwrap()
}

#[test]
fn storage_does_not_matter() {
    let volume = phantom([1.0; 3]);
    let expected = volumes(&volume, &phantom_slabs());
    assert!(expected[0] < expected[6], "not a constant");
    let slabs = phantom_slabs();
    assert_eq!(
        volumes(&stored::<u16>(&volume, 1.0, -1024.0), &slabs),
        expected
    );
    assert_eq!(
        volumes(&stored::<i16>(&volume, -1.0, 0.0), &slabs),
        expected
    );
    assert_eq!(
        volumes(&stored::<f32>(&volume, -0.5, 16.0), &slabs),
        expected
    );
    assert_eq!(volumes(&stored::<f64>(&volume, 1.0, 0.0), &slabs), expected);
    assert_eq!(
        volumes(&stored::<i32>(&volume, 0.25, -8.0), &slabs),
        expected
    );
}

#[test]
fn bone_under_the_skin_does_not_move_it() {
    let grid = grid([12.0, 20.0, 14.0], [1.0; 3]);
    let plain = body(&grid, 0.5, |p| p.y - 6.3);
    let mut bony = plain.clone();
    // The first voxels that are all tissue become bone.
    for sample in bony.as_mut_slice() {
        if *sample >= -5 {
            *sample = 1500;
        }
    }
    let slabs = slabs(12.0, 1.0, 12.0);
    let share = volumes(&bony, &slabs)[3] / volumes(&plain, &slabs)[3];
    assert!((share - 1.0).abs() < 0.01, "{share}");
}

#[test]
fn all_air_all_tissue_and_elsewhere_are_errors() {
    let grid = grid([10.0, 10.0, 14.0], [1.0; 3]);
    let constant = |hu| {
        let [nx, ny, nz] = grid.dims();
        Volume::new(
            grid.clone(),
            Rescale::NONE,
            Array3::from_elem((nz, ny, nx), hu),
        )
        .unwrap()
    };
    let measure = |volume: &Volume<i16>, slabs| region_volumes(volume, &slabs, SKIN_HU);
    let inside = slabs(12.0, 1.0, 7.0);
    assert_eq!(
        measure(&constant(-1000), inside),
        Err(MeasureError::NoTissue {
            skin_hu: SKIN_HU,
            lowest: -1000.0,
            highest: -1000.0
        })
    );
    assert_eq!(
        measure(&constant(40), inside),
        Err(MeasureError::NoAir {
            skin_hu: SKIN_HU,
            lowest: 40.0,
            highest: 40.0
        })
    );
    // Tissue, but only behind the base plane.
    let behind = body(&grid, 0.4, |p| p.y - 8.0);
    let error = measure(&behind, slabs(12.0, 1.0, 5.0)).unwrap_err();
    assert!(matches!(error, MeasureError::NoTissue { .. }), "{error}");
    for outside in [
        slabs(90.0, 80.0, 7.0),
        slabs(-3.0, -9.0, 7.0),
        slabs(12.0, 1.0, -4.0),
    ] {
        let error = measure(&behind, outside).unwrap_err();
        assert!(matches!(error, MeasureError::Outside { .. }), "{error}");
    }
    let error = region_volumes(&behind, &inside, f64::NAN).unwrap_err();
    assert!(matches!(error, MeasureError::Threshold { .. }), "{error}");
}

#[test]
fn values_that_are_not_numbers_are_named() {
    let grid = grid([10.0, 10.0, 14.0], [1.0; 3]);
    let mut volume = stored::<f64>(&body(&grid, 0.4, |p| p.y - 4.0), 1.0, 0.0);
    let slabs = slabs(12.0, 3.0, 7.0);
    let sound = region_volumes(&volume, &slabs, SKIN_HU).unwrap();
    volume.samples_mut()[[5, 9, 3]] = f64::NAN;
    assert_eq!(region_volumes(&volume, &slabs, SKIN_HU), Ok(sound));
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX] {
        volume.samples_mut()[[5, 2, 3]] = bad;
        let Err(MeasureError::NotFinite { index, .. }) = region_volumes(&volume, &slabs, SKIN_HU)
        else {
            panic!("measured {bad}");
        };
        assert_eq!(index, [3, 2, 5]);
    }
}

#[test]
fn planes_upside_down_or_nowhere_are_refused() {
    let error = |z1, z2, y| Slabs::new(&landmarks(z1, z2, y)).unwrap_err();
    let no_height = |error| matches!(error, MeasureError::NoHeight { .. });
    assert!(no_height(error(3.0, 9.0, 5.0)));
    assert!(no_height(error(3.0, 3.0, 5.0)));
    assert_eq!(error(3.0, f64::NAN, 5.0), MeasureError::Landmark);
    assert_eq!(error(3.0, 1.0, f64::INFINITY), MeasureError::Landmark);
}

#[test]
fn the_planes_are_evenly_spaced_and_end_on_the_landmarks() {
    let planes = phantom_slabs().planes();
    let landmarks = Phantom::lee2001().landmarks_mm();
    assert_eq!(planes[0], landmarks.nasal_bones.0.z);
    assert_eq!(planes[REGIONS], landmarks.lip.0.z);
    for pair in planes.windows(2) {
        let step = (planes[0] - planes[REGIONS]) / REGIONS as f64;
        assert!((pair[0] - pair[1] - step).abs() < 1e-12);
    }
}
