//! Regional volumes of two real scans against counted voxels.
#![allow(clippy::unwrap_used, reason = "a test stops where something is wrong")]

mod real_data;

use rhinoplan::feature::Landmarks;
use rhinoplan::io::nifti;
use rhinoplan::measure::{NoseGeometry, RegionVolumes, Slabs, region_volumes};
use rhinoplan::space::{ContinuousIndex, GridPoint};
use rhinoplan::volume::{AnyVolume, Sample, Volume};
use rhinoplan::with_volume;

const SKIN_HU: f64 = -500.0;

/// Tissue between the planes, mm³: whole voxels, but for the layers that the planes cut.
fn counted<T: Sample>(volume: &Volume<T>, slabs: &Slabs) -> f64 {
    let planes = slabs.planes();
    let spacing = volume.grid().spacing();
    let share = |n: usize, step: f64, from: f64, to: f64| {
        let centre = n as f64;
        let (low, high) = (
            (from / step).max(centre - 0.5),
            (to / step).min(centre + 0.5),
        );
        (high - low).max(0.0)
    };
    let sum: f64 = volume
        .samples()
        .indexed_iter()
        .filter(|&(_, &sample)| volume.rescale().to_hu(sample.to_f64()) >= SKIN_HU)
        .map(|((z, y, _), _)| {
            share(z, spacing.z, planes[11], planes[0])
                * share(y, spacing.y, f64::NEG_INFINITY, slabs.base_y())
        })
        .sum();
    sum * volume.grid().voxel_volume()
}

/// Measures a scan of the real data whose landmarks are given in voxels, if it is there.
fn measured(
    name: &str,
    landmarks: Landmarks<[f64; 3]>,
) -> Option<(RegionVolumes, f64, NoseGeometry)> {
    let path = real_data::path(name)?;
    let volume: AnyVolume = nifti::read(&path).unwrap().volume;
    let landmarks: Landmarks<GridPoint> =
        landmarks.map(|index| volume.grid().index_to_grid(ContinuousIndex::from(index)));
    let slabs = Slabs::new(&landmarks).unwrap();
    let geometry = NoseGeometry::new(&landmarks).unwrap();
    let (found, counted) = with_volume!(&volume, volume => (
        region_volumes(volume, &slabs, SKIN_HU).unwrap(),
        counted(volume, &slabs)
    ));
    println!(
        "{name}: {found:.1?}, total {:.1}, counted {counted:.1}, {geometry:?}",
        found.total()
    );
    Some((found, counted, geometry))
}

/// How far a count of voxels of 1 to 2 mm may be off, as a share.
const COUNTING: f64 = 0.01;

#[test]
fn cranium() {
    let landmarks = Landmarks {
        nasal_bones: [129.0, 39.0, 46.0],
        lip: [130.0, 26.0, 4.0],
        alare_right: [111.0, 33.0, 19.0],
        alare_left: [148.0, 33.0, 19.0],
        tip: [128.0, 12.0, 24.0],
        maxilla: [111.0, 41.0, 18.0],
    };
    if let Some((found, counted, geometry)) = measured("cranium.nii.gz", landmarks) {
        assert!((found.total() / counted - 1.0).abs() < COUNTING);
        assert!(found.0.iter().all(|&volume| volume > 0.0));
        assert!((geometry.height_mm - 29.0 * 0.957).abs() < 0.1);
    }
}

#[test]
fn headphantom() {
    let landmarks = Landmarks {
        nasal_bones: [118.0, 44.0, 77.0],
        lip: [117.0, 25.0, 38.0],
        alare_right: [98.0, 36.0, 50.0],
        alare_left: [138.0, 36.0, 50.0],
        tip: [117.0, 15.0, 53.0],
        maxilla: [96.0, 40.0, 49.0],
    };
    if let Some((found, counted, _)) = measured("headphantom.nii.gz", landmarks) {
        assert!((found.total() / counted - 1.0).abs() < COUNTING);
        assert_eq!(found.0[0], 0.0, "its root lies behind the base plane");
    }
}
