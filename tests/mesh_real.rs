//! Meshes of real heads, where they are at hand.

#![allow(clippy::unwrap_used, reason = "tests")]

mod real_data;

use rhinoplan::io::nifti::read;
use rhinoplan::mesh::{SMOOTHING, decimate, is_cut, isosurface, smooth};
use rhinoplan::segment::segment;
use rhinoplan::with_volume;

const SKIN_HU: f64 = -500.0;
const BONE_HU: f64 = 300.0;

/// Noise, metal, a headrest and open airways: every kind of cell there is.
#[test]
fn heads_are_closed_manifolds_before_and_after_decimation() {
    for file in ["cranium.nii.gz", "headphantom.nii.gz"] {
        let Some(path) = real_data::path(file) else {
            continue;
        };
        let ct = read(&path).unwrap();
        with_volume!(&ct.volume, volume => {
            let grid = volume.grid();
            for (threshold_hu, largest) in [(SKIN_HU, true), (BONE_HU, false)] {
                let mask = segment(volume, threshold_hu, largest).unwrap();
                let mut mesh = isosurface(volume, &mask, threshold_hu).unwrap();
                assert!(mesh.triangles().len() > 300_000);
                assert!(mesh.topology().is_sound(), "{file}: {:?}", mesh.topology());
                let found = mesh.volume();
                let voxels = mask.count() as f64 * grid.voxel_volume();
                assert!((found / voxels - 1.0).abs() < 0.05, "{file}: {found} for {voxels}");
                smooth(&mut mesh, SMOOTHING, |point| is_cut(grid, point)).unwrap();
                assert!((mesh.volume() / found - 1.0).abs() < 1e-4);
                decimate(&mut mesh, 100_000).unwrap();
                assert!(mesh.triangles().len() <= 100_000);
                assert!(mesh.topology().is_sound(), "{file}: {:?}", mesh.topology());
                assert!((mesh.volume() / found - 1.0).abs() < 2e-3);
            }
        });
    }
}
