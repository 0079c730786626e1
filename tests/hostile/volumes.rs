//! What must be true of every volume that was read, whatever the file.

use rhinoplan::io::nifti::Scan;
use rhinoplan::space::{ContinuousIndex, Grid};
use rhinoplan::volume::AnyVolume;
use rhinoplan::with_volume;

use crate::noise::assert_clear;

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

/// What `read_header` and `read` say of one file must agree. The volume, where it was read; nothing where it was
/// refused, clearly and because it was changed.
#[track_caller]
pub fn agreed<H, E: std::fmt::Display>(
    (header, scan): (Result<H, E>, Result<Scan, E>),
    grid: impl Fn(&H) -> &Grid,
    is_changed: bool,
    index: usize,
) -> Option<Scan> {
    let error = match (header, scan) {
        (Ok(header), Ok(scan)) => {
            assert_eq!(grid(&header), scan.volume.grid());
            assert_plausible(&scan.volume);
            return Some(scan);
        }
        (Ok(header), Err(error)) => {
            assert_grid(grid(&header));
            error
        }
        (Err(header), Err(error)) => {
            assert_eq!(header.to_string(), error.to_string());
            error
        }
        (Err(header), Ok(_)) => panic!("case {index} is read, but for `check`: {header}"),
    };
    assert!(is_changed, "case {index} is sound: {error}");
    assert_clear(&error.to_string());
    None
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
