//! The line of the skin in a sagittal plane (paper Figs. 10 and 11).

use super::MeasureError;
use super::cells::weights;
use super::profile::depth;
use crate::space::{ContinuousIndex, GridPoint};
use crate::volume::{Sample, Volume};

/// Heights for each slice at which the skin is sought. A whole number, so that slices themselves are among
/// them.
const HEIGHTS_PER_SLICE: u32 = 4;

/// Where a line from anterior to posterior first meets tissue, values of at least `skin_hu`, in the sagittal
/// plane at `plane_x`: one point for each height, upwards from the lower to the upper of `heights`. Grid
/// millimetres; four heights to a slice.
///
/// Between voxels a surface lies where the interpolated depth below the skin, not the interpolated HU,
/// reaches the threshold's, as for the regions A..K. A height is left out where the line meets no tissue,
/// where tissue already fills the volume's foremost voxel (the skin is then outside), and where a voxel at
/// the surface is not a number; so nothing is returned for a plane or heights outside the volume. What lies
/// under an overhang is hidden by it.
///
/// # Errors
/// [`MeasureError::Threshold`] and [`MeasureError::Landmark`] for a threshold, plane or height that is not a
/// finite number.
pub fn skin_profile<T: Sample>(
    volume: &Volume<T>,
    plane_x: f64,
    heights: [f64; 2],
    skin_hu: f64,
) -> Result<Vec<GridPoint>, MeasureError> {
    if !skin_hu.is_finite() {
        return Err(MeasureError::Threshold { skin_hu });
    }
    let [low, high] = heights;
    if !(plane_x.is_finite() && low.is_finite() && high.is_finite()) {
        return Err(MeasureError::Landmark);
    }
    let grid = volume.grid();
    let (spacing, last) = (grid.spacing(), grid.last_index());
    let x = plane_x / spacing.x;
    if !(0.0..=last.x).contains(&x) {
        return Ok(Vec::new());
    }
    let per_slice = f64::from(HEIGHTS_PER_SLICE);
    let first = (low.min(high) / spacing.z).clamp(0.0, last.z + 1.0);
    let top = (low.max(high) / spacing.z).clamp(-1.0, last.z);
    let (first, top) = (
        (first * per_slice).ceil() as i64,
        (top * per_slice).floor() as i64,
    );
    let surface = depth(skin_hu);
    let point = |step: i64| {
        let z = step as f64 / per_slice;
        let y = foremost(volume, x, z, surface)?;
        Some(grid.index_to_grid(ContinuousIndex::new(x, y, z)))
    };
    Ok((first..=top).filter_map(point).collect())
}

/// y, in voxels, where the depth on the line (x, z) first reaches `surface`. Slices are blended cubically, as
/// for the regions: a nose curves between slices 1 mm apart.
fn foremost<T: Sample>(volume: &Volume<T>, x: f64, z: f64, surface: f64) -> Option<f64> {
    let [nx, ny, nz] = volume.grid().dims();
    let samples = volume.samples();
    let at = |x: usize, y: usize, z: usize| {
        let stored = samples.get([z, y, x]).copied().unwrap_or_default();
        depth(volume.rescale().to_hu(stored.to_f64()))
    };
    let (right, left) = (x.floor() as usize, (x.floor() as usize + 1).min(nx - 1));
    let to_left = x - x.floor();
    let below = z.floor() as usize;
    let slice_weights = weights(z - z.floor());
    let slices = [
        below.saturating_sub(1),
        below,
        (below + 1).min(nz - 1),
        (below + 2).min(nz - 1),
    ];
    let blended = |y: usize| -> f64 {
        let row = |z: usize| at(right, y, z) * (1.0 - to_left) + at(left, y, z) * to_left;
        let taps = slices.into_iter().zip(slice_weights);
        // Exactly on a slice the others do not matter, whatever they hold.
        taps.filter(|(_, weight)| *weight != 0.0)
            .map(|(z, weight)| row(z) * weight)
            .sum()
    };
    let mut before = blended(0);
    if before >= surface {
        return None;
    }
    for y in 1..ny {
        let here = blended(y);
        if here >= surface {
            let share = (surface - before) / (here - before);
            return share.is_finite().then(|| (y - 1) as f64 + share);
        }
        before = here;
    }
    None
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::phantom::{Phantom, SPACING};
    use crate::space::Grid;
    use crate::volume::Rescale;

    const SKIN_HU: f64 = -500.0;

    /// A ball of water whose edge is blurred by `sigma` mm.
    fn ball(spacing: [f64; 3], sigma: f64, centre: [f64; 3], radius: f64) -> Volume<i16> {
        let dims = spacing.map(|step| (40.0 / step) as usize);
        let grid = Grid::axis_aligned(dims, spacing).unwrap();
        let samples = Array3::from_shape_fn((dims[2], dims[1], dims[0]), |(z, y, x)| {
            let index = ContinuousIndex::new(x as f64, y as f64, z as f64);
            let away = (grid.index_to_grid(index).0 - glam::DVec3::from(centre)).length();
            let inside =
                0.5 * libm::erfc((away - radius) / sigma * std::f64::consts::FRAC_1_SQRT_2);
            (1000.0 * inside - 1000.0).round() as i16
        });
        Volume::new(grid, Rescale::NONE, samples).unwrap()
    }

    #[test]
    fn it_lies_on_a_ball() {
        // On voxels of up to 1 mm, mm.
        const NEAR: f64 = 0.05;
        let centre = [20.3, 20.1, 19.7];
        for (spacing, plane) in [
            ([0.5; 3], 20.3),
            ([0.442, 0.442, 1.0], 17.15),
            ([0.9, 0.9, 1.0], 23.0),
        ] {
            let volume = ball(spacing, 0.6, centre, 14.0);
            let profile = skin_profile(&volume, plane, [0.0, 39.0], SKIN_HU).unwrap();
            // As many heights as the circle of this plane spans, less what is too steep to be met.
            let spans = 4.0 * 26.0 / spacing[2];
            assert!(profile.len() as f64 > spans, "{}", profile.len());
            let mut worst = 0.0_f64;
            for point in profile {
                assert_eq!(point.0.x, plane);
                // Where the line of sight is within 60 degrees of the normal.
                let from = point.0 - glam::DVec3::from(centre);
                if -from.y > 7.0 {
                    worst = worst.max((from.length() - 14.0).abs());
                }
            }
            println!("{spacing:?}: {worst:.4} mm");
            assert!(worst < NEAR && worst > 0.0, "{spacing:?}: {worst}");
        }
    }

    #[test]
    fn it_lies_on_the_phantoms_skin() {
        let phantom = Phantom::lee2001();
        let grid = Grid::axis_aligned([320, 170, 100], SPACING).unwrap();
        let volume = phantom.render(&grid).unwrap();
        let plane = phantom.landmarks_mm().nasal_bones.0.x;
        let profile = skin_profile(&volume, plane, [56.0, 76.0], SKIN_HU).unwrap();
        assert_eq!(profile.len(), 81);
        let off = profile.iter().map(|&p| phantom.tissue_depth(p).abs());
        let worst = off.fold(0.0, f64::max);
        // Noise of 10 HU moves a blurred edge by up to 0.05 mm.
        assert!(worst < 0.15, "{worst}");
    }

    #[test]
    fn a_height_without_skin_is_left_out() {
        let volume = ball([1.0; 3], 0.6, [20.0; 3], 10.0);
        let z = |profile: &[GridPoint]| (profile[0].0.z, profile[profile.len() - 1].0.z);
        let profile = skin_profile(&volume, 20.0, [-50.0, 500.0], SKIN_HU).unwrap();
        let (low, high) = z(&profile);
        assert!((10.0..11.0).contains(&low) && (29.0..30.5).contains(&high));
        for (plane, heights) in [
            (-1.0, [0.0, 39.0]),
            (40.0, [0.0, 39.0]),
            (20.0, [50.0, 60.0]),
        ] {
            assert_eq!(skin_profile(&volume, plane, heights, SKIN_HU).unwrap(), []);
        }
        // The skin in front of the volume.
        let cut = ball([1.0; 3], 0.6, [20.0, 4.0, 20.0], 10.0);
        let profile = skin_profile(&cut, 20.0, [19.0, 21.0], SKIN_HU).unwrap();
        assert_eq!(profile, []);
    }

    #[test]
    fn no_number_is_an_error_or_left_out() {
        let volume = ball([1.0; 3], 0.6, [20.0; 3], 10.0);
        for (plane, z, skin_hu) in [
            (f64::NAN, 0.0, 0.0),
            (0.0, f64::INFINITY, 0.0),
            (0.0, 0.0, f64::NAN),
        ] {
            assert!(skin_profile(&volume, plane, [z, 1.0], skin_hu).is_err());
        }
        let nothing = Volume::new(
            Grid::axis_aligned([2, 3, 1], [1.0; 3]).unwrap(),
            Rescale::NONE,
            Array3::from_elem((1, 3, 2), f64::NAN),
        );
        let profile = skin_profile(&nothing.unwrap(), 0.5, [0.0, 1.0], SKIN_HU).unwrap();
        assert_eq!(profile, []);
    }
}
