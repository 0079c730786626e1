//! Where voxels are: all 48 ways to store axes, oblique scans, sform, qform, neither, and units.

use glam::{DMat3, DVec3};
use rhinoplan::io::nifti::{NiftiProblem, Transform, read};
use rhinoplan::space::{ContinuousIndex, GridError, LpsPoint, RasPoint};
use rhinoplan::volume::{AnyVolume, Volume};

use crate::builder::{Folder, Nifti, Noise};

/// A stored volume whose sample at (i, j, k) is 1 + i + 10 j + 100 k, with this sform.
fn numbered(dims: [i16; 3], rows: [[f32; 4]; 3]) -> Nifti {
    let [ni, nj, nk] = dims;
    let mut samples = Vec::new();
    for k in 0..nk {
        for j in 0..nj {
            samples.extend((0..ni).flat_map(|i| (1 + i + 10 * j + 100 * k).to_le_bytes()));
        }
    }
    let mut file = Nifti::new(dims, 4, 2, false, samples);
    file.sform(rows);
    file
}

/// Stored indices of a sample of [`numbered`].
fn stored_index(sample: i16) -> [f64; 3] {
    let number = sample - 1;
    [number % 10, number / 10 % 10, number / 100].map(f64::from)
}

fn i16s(volume: AnyVolume) -> Volume<i16> {
    match volume {
        AnyVolume::I16(volume) => volume,
        other => panic!("{}", other.sample_type()),
    }
}

/// Every sample lies, in the grid, where the affine puts its stored index.
fn assert_in_place(volume: &Volume<i16>, rows: [[f64; 4]; 3], tolerance: f64) {
    let [nx, ny, _] = volume.grid().dims();
    for (index, &sample) in volume.as_slice().iter().enumerate() {
        let [i, j, k] = stored_index(sample);
        let [x, y, z] = rows.map(|[a, b, c, d]| a * i + b * j + c * k + d);
        let expected = LpsPoint::from(RasPoint::new(x, y, z));
        let at = [index % nx, index / nx % ny, index / (nx * ny)].map(|n| n as f64);
        let grid = volume.grid();
        let found = grid.grid_to_lps(grid.index_to_grid(ContinuousIndex::from(at)));
        assert!(
            (found - expected).0.length() < tolerance,
            "{sample}: {found:?} {expected:?}"
        );
    }
}

#[test]
fn all_48_orders_and_flips_put_every_voxel_in_its_place() {
    let folder = Folder::new();
    let spacing = [0.5, 0.75, 1.25];
    let dims = [5, 4, 3];
    let mut codes = std::collections::BTreeSet::new();
    for order in [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ] {
        for signs in 0..8 {
            let mut rows = [
                [0.0, 0.0, 0.0, -31.0],
                [0.0, 0.0, 0.0, 17.0],
                [0.0, 0.0, 0.0, 2.0],
            ];
            let mut code = String::new();
            for (stored, world) in order.into_iter().enumerate() {
                let grows = signs >> stored & 1 == 0;
                rows[world][stored] = if grows {
                    spacing[stored]
                } else {
                    -spacing[stored]
                };
                let (towards, away) = [('R', 'L'), ('A', 'P'), ('S', 'I')][world];
                code.push(if grows { towards } else { away });
            }
            let file = numbered(dims, rows);
            let scan = folder.read(&file.bytes()).unwrap();
            assert_eq!(scan.template.orientation().to_string(), code);
            let volume = i16s(scan.volume);
            let mut lps_dims = [0; 3];
            let mut lps_spacing = [0.0; 3];
            for (stored, world) in order.into_iter().enumerate() {
                lps_dims[world] = dims[stored] as usize;
                lps_spacing[world] = f64::from(spacing[stored]);
            }
            assert_eq!(volume.grid().dims(), lps_dims);
            assert_eq!(volume.grid().spacing().to_array(), lps_spacing);
            assert_eq!(volume.grid().direction(), DMat3::IDENTITY);
            assert_in_place(&volume, rows.map(|row| row.map(f64::from)), 1e-12);
            // And back to the bytes that it came from.
            let mut bytes = Vec::new();
            scan.template.write_volume(&mut bytes, &volume).unwrap();
            assert!(bytes == file.bytes(), "{code}");
            codes.insert(code);
        }
    }
    assert_eq!(codes.len(), 48);
}

#[test]
fn oblique_scans_keep_their_affine() {
    let folder = Folder::new();
    let mut noise = Noise::new(11);
    for round in 0..200 {
        let axis = DVec3::new(noise.unit(), noise.unit(), noise.unit()).normalize();
        let mut turn = DMat3::from_axis_angle(axis, 3.1 * noise.unit());
        if round % 2 == 0 {
            turn.z_axis = -turn.z_axis;
        }
        let spacing = [0.5, 0.75, 1.25];
        let mut rows = [[0.0_f32; 4]; 3];
        for (world, row) in rows.iter_mut().enumerate() {
            for (stored, spacing) in spacing.into_iter().enumerate() {
                row[stored] = (turn.col(stored)[world] * spacing) as f32;
            }
            row[3] = (50.0 * noise.unit()) as f32;
        }
        let file = numbered([5, 4, 3], rows);
        let scan = folder.read(&file.bytes()).unwrap();
        let volume = i16s(scan.volume);
        assert_in_place(&volume, rows.map(|row| row.map(f64::from)), 1e-5);
        let direction = volume.grid().direction();
        for axis in 0..3 {
            assert!(
                direction.col(axis)[axis] > 0.0,
                "axis {axis} points the wrong way"
            );
        }
        assert!(volume.grid().obliquity_deg() < 70.6, "not the nearest axes");
        let mut bytes = Vec::new();
        scan.template.write_volume(&mut bytes, &volume).unwrap();
        assert!(bytes == file.bytes());
    }
}

#[test]
fn a_qform_says_the_same_as_the_sform_of_the_same_rotation() {
    let folder = Folder::new();
    for (factor, third) in [(1.0, 1.0), (-1.0, -1.0), (0.0, 1.0)] {
        // 30° about (1, 2, 2)/3.
        let (half, axis) = (15.0_f64.to_radians(), DVec3::new(1.0, 2.0, 2.0) / 3.0);
        let imaginary = axis * libm::sin(half);
        let turn = DMat3::from_axis_angle(axis, 2.0 * half);
        let mut rows = [[0.0; 4]; 3];
        for (world, row) in rows.iter_mut().enumerate() {
            for (stored, scale) in [1.0, 1.5, 2.0 * third].into_iter().enumerate() {
                row[stored] = turn.col(stored)[world] * scale;
            }
            row[3] = [-10.0, -20.0, 30.0][world];
        }
        let mut file = numbered([5, 4, 3], [[f32::NAN; 4]; 3]);
        file.i16s(252, &[2, 0]).f32s(76, &[factor]);
        file.f32s(256, &imaginary.to_array().map(|value| value as f32));
        let scan = folder.read(&file.bytes()).unwrap();
        assert_eq!(scan.template.transform(), Transform::Qform);
        assert_in_place(&i16s(scan.volume), rows, 1e-5);
    }
}

#[test]
fn the_sform_comes_before_the_qform() {
    let folder = Folder::new();
    let mut file = Nifti::small();
    file.f32s(256, &[0.0, 0.0, 1.0, 5.0, 6.0, 7.0]);
    let scan = folder.read(&file.bytes()).unwrap();
    assert_eq!(scan.template.transform(), Transform::Sform);
    assert_eq!(scan.template.orientation().to_string(), "RAS");
    file.i16s(252, &[1, 0]);
    let scan = folder.read(&file.bytes()).unwrap();
    assert_eq!(scan.template.transform(), Transform::Qform);
    assert_eq!(scan.template.orientation().to_string(), "LPS");
    assert_eq!(
        scan.template.grid().origin(),
        LpsPoint::new(-5.0, -6.0, 7.0)
    );
}

#[test]
fn neither_is_method_1() {
    let folder = Folder::new();
    let mut file = numbered([5, 4, 3], [[9.0; 4]; 3]);
    file.i16s(252, &[0, 0]);
    let scan = folder.read(&file.bytes()).unwrap();
    assert_eq!(scan.template.transform(), Transform::None);
    assert_eq!(scan.template.orientation().to_string(), "RAS");
    let rows = [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.5, 0.0, 0.0],
        [0.0, 0.0, 2.0, 0.0],
    ];
    assert_in_place(&i16s(scan.volume), rows, 1e-12);
}

#[test]
fn metres_and_micrometres_become_millimetres() {
    let folder = Folder::new();
    for (unit, scale) in [(0, 1.0), (2, 1.0), (1, 1000.0), (3, 0.001), (10, 1.0)] {
        for codes in [[0, 1], [1, 0]] {
            let mut file = Nifti::small();
            file.header[123] = unit;
            file.i16s(252, &codes);
            let grid = folder.read(&file.bytes()).unwrap().volume.grid().clone();
            let off = grid.spacing() - DVec3::new(1.0, 1.5, 2.0) * scale;
            assert!(
                off.length() < 1e-12 * scale,
                "unit {unit}: {}",
                grid.spacing()
            );
            // The first voxel in LPS order is the last stored in x and y.
            let first = DVec3::new(6.0, 20.0 - 3.0 * 1.5, 30.0) * scale;
            assert!(
                (grid.origin().0 - first).length() < 1e-9 * scale,
                "{:?}",
                grid.origin()
            );
        }
    }
}

#[test]
fn shear_is_refused_with_its_angle() {
    let folder = Folder::new();
    let rows = [
        [1.0, 0.2, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ];
    let path = folder.write("sheared.nii", &numbered([5, 4, 3], rows).bytes());
    let error = read(&path).unwrap_err();
    let NiftiProblem::Grid {
        transform: Transform::Sform,
        error: GridError::Sheared { angle_deg },
    } = error.problem
    else {
        panic!("{error}");
    };
    assert!(
        (angle_deg - 101.31).abs() < 0.01 || (angle_deg - 78.69).abs() < 0.01,
        "{angle_deg}"
    );
}
