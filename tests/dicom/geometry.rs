//! Where the voxels of a series lie.

use dicom_core::VR;
use dicom_dictionary_std::tags;
use glam::{DMat3, DVec3};
use rhinoplan::io::dicom::Folder;
use rhinoplan::space::{ContinuousIndex, Grid};
use rhinoplan::volume::AnyVolume;

use crate::builder::{Dir, SliceFile, expected, hus, stack};

/// The voxels of the volume that is sliced in every way: left, posterior, superior.
const DIMS: [usize; 3] = [4, 3, 5];
const SPACING: [f64; 3] = [1.0, 1.5, 2.25];
const ORIGIN: [f64; 3] = [-7.0, 11.0, 30.5];

fn code([x, y, z]: [usize; 3]) -> i16 {
    (x + 10 * y + 100 * z) as i16
}

/// Slices of that volume, its rows along one signed axis and its columns along another.
fn sliced(row: (usize, bool), column: (usize, bool)) -> Vec<SliceFile> {
    let unit = |(axis, back): (usize, bool)| DVec3::AXES[axis] * if back { -1.0 } else { 1.0 };
    let normal = unit(row).cross(unit(column));
    let across = 3 - row.0 - column.0;
    let through = (across, normal[across] < 0.0);
    let voxel = |i: usize, j: usize, k: usize| {
        let mut at = [0; 3];
        for ((axis, back), n) in [(row, i), (column, j), (through, k)] {
            at[axis] = if back { DIMS[axis] - 1 - n } else { n };
        }
        at
    };
    let slice = |k: usize| {
        let samples: Vec<i16> = (0..DIMS[column.0])
            .flat_map(|j| (0..DIMS[row.0]).map(move |i| (i, j)))
            .map(|(i, j)| code(voxel(i, j, k)))
            .collect();
        let mut file = SliceFile::new([DIMS[row.0] as u16, DIMS[column.0] as u16], &samples);
        let first = voxel(0, 0, k);
        let at = |axis: usize| ORIGIN[axis] + SPACING[axis] * first[axis] as f64;
        let spacing = format!("{}\\{}", SPACING[column.0], SPACING[row.0]);
        file.at(DVec3::new(at(0), at(1), at(2)))
            .oriented(unit(row), unit(column))
            .text(tags::PIXEL_SPACING, VR::DS, &spacing);
        file
    };
    (0..DIMS[across]).map(slice).collect()
}

#[test]
fn every_axis_order_is_the_same_volume() {
    let mut seen = std::collections::BTreeSet::new();
    for row in 0..3 {
        for column in (0..3).filter(|column| *column != row) {
            for signs in 0..8 {
                let (row, column) = ((row, signs & 1 == 1), (column, signs & 2 == 2));
                let mut files = sliced(row, column);
                // Names along the normal, and against it.
                if signs & 4 == 4 {
                    files.reverse();
                }
                let dir = Dir::of(&files);
                let folder = Folder::scan(dir.path()).unwrap();
                let series = folder.choose(None).unwrap();
                seen.insert(series.orientation().to_string());
                let scan = series.read().unwrap();
                let grid = scan.volume.grid();
                assert_eq!(grid.dims(), DIMS);
                assert_eq!(grid.spacing().to_array(), SPACING);
                assert_eq!(grid.origin().0.to_array(), ORIGIN);
                assert_eq!(grid.direction(), DMat3::IDENTITY);
                let AnyVolume::I16(volume) = &scan.volume else {
                    panic!("stored as i16");
                };
                for ((z, y, x), &sample) in volume.samples().indexed_iter() {
                    assert_eq!(sample, code([x, y, z]), "{}", series.orientation());
                }
                assert_eq!(scan.template.orientation().to_string(), "LPS");
                assert_eq!(scan.template.grid().dims(), DIMS);
            }
        }
    }
    // Slices are taken along the right-handed normal, so that these are all there can be.
    assert_eq!(seen.len(), 24, "{seen:?}");
    assert!(seen.contains("LPS") && seen.contains("PIR"), "{seen:?}");
}

fn turned() -> DMat3 {
    DMat3::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.3)
}

#[test]
fn an_oblique_series_keeps_its_directions() {
    let turn = turned();
    let mut files = stack(4);
    for (z, file) in files.iter_mut().enumerate() {
        file.oriented(turn.x_axis, turn.y_axis)
            .at(DVec3::new(5.0, -6.0, 7.0) + turn.z_axis * 2.0 * z as f64);
    }
    let scan = Dir::of(&files).read().unwrap();
    let grid: &Grid = scan.volume.grid();
    assert!(grid.direction().abs_diff_eq(turn, 1e-8), "{grid:?}");
    assert!(grid.obliquity_deg() > 10.0);
    assert_eq!(hus(&scan.volume), expected(4));
    let at = grid.grid_to_lps(grid.index_to_grid(ContinuousIndex::new(5.0, 4.0, 3.0)));
    let there = DVec3::new(5.0, -6.0, 7.0) + turn * DVec3::new(5.0, 6.0, 6.0);
    assert!((at.0 - there).length() < 1e-6, "{at:?}");
    // What is written from it holds the voxels where they are.
    let written = scan.template.grid();
    let at = written.grid_to_lps(written.index_to_grid(ContinuousIndex::new(5.0, 4.0, 3.0)));
    assert!((at.0 - there).length() < 1e-4, "{at:?}");
}

#[test]
fn names_instance_numbers_and_thickness_do_not_count() {
    let mut files = stack(5);
    for (index, file) in files.iter_mut().enumerate() {
        let number = ["3", "1", "1", "9", "0"][index];
        file.text(tags::INSTANCE_NUMBER, VR::IS, number)
            .text(tags::SLICE_LOCATION, VR::DS, "0");
    }
    let dir = Dir::new();
    for (file, name) in files.iter().zip(["z", "b.dcm", "IM-1", "0", "noise.txt"]) {
        dir.write(name, &file.bytes());
    }
    let scan = dir.read().unwrap();
    assert_eq!(hus(&scan.volume), expected(5));
    assert_eq!(scan.volume.grid().spacing().z, 2.0);
}

#[test]
fn a_missing_slice_is_refused_with_its_place() {
    let mut files = stack(8);
    files.remove(3);
    let message = Dir::of(&files).error();
    assert!(
        message.contains("7 slices are no regular stack"),
        "{message}"
    );
    assert!(
        message.contains("missing from a spacing of 2 mm: 1 after 4 mm, from the first"),
        "{message}"
    );
}

#[test]
fn duplicates_are_refused_with_their_place() {
    let mut files = stack(4);
    files.push(files[2].clone());
    let message = Dir::of(&files).error();
    assert!(
        message.contains("1 of them lie where another one lies, at 4 mm from the first"),
        "{message}"
    );
}

#[test]
fn uneven_spacing_is_refused_with_its_gaps() {
    let mut files = stack(6);
    for (file, z) in files.iter_mut().zip([0.0, 4.0, 8.0, 9.08, 16.08, 23.08]) {
        file.at(DVec3::new(0.0, 0.0, z));
    }
    let message = Dir::of(&files).error();
    assert!(
        message.contains(
            "they are 4 mm (2×, first after 0 mm), 7 mm (2×, first after 9.08 mm), 1.08 mm (1×, after 8 mm) apart"
        ),
        "{message}"
    );
    assert!(message.contains("does not resample"), "{message}");
}

#[test]
fn a_tilted_gantry_is_refused_with_its_angle() {
    let mut files = stack(6);
    for (k, file) in files.iter_mut().enumerate() {
        let along = 2.0 * k as f64;
        file.at(DVec3::new(0.0, along * libm::tan(-0.2), along));
    }
    let message = Dir::of(&files).error();
    assert!(message.contains("tilted by 11.5°"), "{message}");
    assert!(!message.contains("apart"), "even otherwise: {message}");
}

#[test]
fn one_slice_is_no_volume() {
    let message = Dir::of(&stack(1)).error();
    assert!(message.contains("one slice has no spacing"), "{message}");
}

#[test]
fn positions_beyond_any_scanner_are_refused() {
    let mut files = stack(3);
    for (k, file) in files.iter_mut().enumerate() {
        file.at(DVec3::new(1e7, 0.0, 2.0 * k as f64));
    }
    let message = Dir::of(&files).error();
    assert!(message.contains("10000005 mm from the origin"), "{message}");
}
