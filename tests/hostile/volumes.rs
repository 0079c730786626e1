//! What must be true of every volume that was read, whatever the file.

use rhinoplan::space::{ContinuousIndex, Grid};
use rhinoplan::volume::AnyVolume;
use rhinoplan::with_volume;

/// A grid that lines, boxes and measurements can be computed on, and samples that are Hounsfield units.
#[track_caller]
pub fn assert_plausible(volume: &AnyVolume) {
    assert_grid(volume.grid());
    let samples = with_volume!(volume, volume => volume.as_slice().len());
    assert_eq!(samples, volume.grid().len());
    let (low, high) = volume.hu_range();
    let is_f32 = |hu: f64| (hu as f32).is_finite();
    assert!(is_f32(low) && is_f32(high) && low <= high, "{low} {high}");
}

#[track_caller]
pub fn assert_grid(grid: &Grid) {
    assert!(grid.dims().iter().all(|n| (1..=32_767).contains(n)));
    let spacing = grid.spacing();
    assert!(
        spacing.is_finite() && spacing.min_element() > 0.0,
        "{grid:?}"
    );
    assert!(
        grid.voxel_volume().is_finite() && grid.voxel_volume() > 0.0,
        "{grid:?}"
    );
    assert!(grid.origin().0.is_finite(), "{grid:?}");
    let far = grid.grid_to_lps(grid.index_to_grid(ContinuousIndex(grid.last_index())));
    assert!(far.0.is_finite(), "{grid:?}");
    let direction = grid.direction();
    for axis in 0..3 {
        assert!((direction.col(axis).length() - 1.0).abs() < 1e-9);
    }
    // Perpendicular within 0.06°, so the determinant is that of a turn, or of one and a mirror.
    assert!((direction.determinant().abs() - 1.0).abs() < 1e-5);
}
