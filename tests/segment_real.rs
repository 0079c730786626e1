//! Thresholds and components on two real scans.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test stops where something is wrong"
)]

mod real_data;

use rhinoplan::io::nifti;
use rhinoplan::segment::{component_sizes, keep_largest, otsu, segment};
use rhinoplan::volume::{AnyVolume, Mask, Volume};

const SKIN_HU: f64 = -500.0;

/// A scan of the real data, if it is there. Both hold 16-bit integers.
fn scan(name: &str) -> Option<Volume<i16>> {
    let path = real_data::path(name)?;
    let AnyVolume::I16(volume) = nifti::read(&path).unwrap().volume else {
        panic!("{name} does not hold 16-bit integers");
    };
    Some(volume)
}

/// Voxels of a mask from row y on.
fn behind(mask: &Mask, from: usize) -> usize {
    let [nx, ny, nz] = mask.dims();
    let inside = |y| (0..nz).flat_map(move |z| (0..nx).map(move |x| (x, y, z)));
    (from..ny)
        .flat_map(inside)
        .filter(|&(x, y, z)| mask.contains(x, y, z))
        .count()
}

#[test]
fn the_head_holder_of_cranium_is_left_out() {
    let Some(volume) = scan("cranium.nii.gz") else {
        return;
    };
    let hu = otsu(&volume).unwrap();
    assert!((-490.0..-470.0).contains(&hu), "{hu} HU");

    // The head, two shells of the holder, and 30 specks.
    let all = segment(&volume, SKIN_HU, false).unwrap();
    let sizes = component_sizes(&all).unwrap();
    assert_eq!(sizes.len(), 33);
    assert_eq!(sizes[..4], [2_323_306, 42_079, 40_699, 13]);

    let head = segment(&volume, SKIN_HU, true).unwrap();
    assert_eq!(component_sizes(&head).unwrap(), sizes[..1]);
    // The occiput ends at y = 244; from there on is nothing but the holder.
    assert_eq!((behind(&all, 245), behind(&head, 245)), (17_535, 0));
    // In front of y = 140, where the holder begins, only specks are lost.
    let lost = |from: usize| behind(&all, from) - behind(&head, from);
    assert!(lost(140) >= 42_079 + 40_699);
    assert!(lost(0) - lost(140) < 100, "{}", lost(0) - lost(140));
}

/// It lies on its mat without a gap of air: with the mat it is one piece, and no threshold for skin parts them.
#[test]
fn the_headphantom_stays_on_its_mat() {
    let Some(volume) = scan("headphantom.nii.gz") else {
        return;
    };
    let hu = otsu(&volume).unwrap();
    assert!((-475.0..-455.0).contains(&hu), "{hu} HU");
    let all = segment(&volume, SKIN_HU, false).unwrap();
    assert_eq!(component_sizes(&all).unwrap(), [2_387_619]);
    assert_eq!(keep_largest(all.clone()).unwrap(), all);
    // The last five rows are all mat.
    assert_eq!(behind(&all, 240), 235 * 120 * 5);
}
