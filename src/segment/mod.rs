//! The object in a CT: enhancement, thresholds, components.
//!
//! A head is what is denser than a threshold, and of that the largest piece that hangs together: the
//! table, the head-holder, cables and noise are pieces of their own. The voxels left out are still in the
//! volume; only the [`Mask`] lacks them.

mod again;
mod components;
mod enhance;
mod median;
mod smooth;
mod threshold;

pub use again::Segmented;
pub use components::{component_sizes, keep_largest};
pub use enhance::{Enhance, EnhanceError, MEDIAN_SIDE, enhance};
pub use threshold::{above, otsu};

use crate::volume::{Mask, Sample, Volume, VolumeError};

/// The voxels of `threshold_hu` or more; of these the largest 6-connected component only, where `largest`
/// is set. None of them is an empty mask.
///
/// # Errors
/// [`VolumeError::Memory`] where the machine has none.
pub fn segment<T: Sample>(
    volume: &Volume<T>,
    threshold_hu: f64,
    largest: bool,
) -> Result<Mask, VolumeError> {
    let object = above(volume, threshold_hu)?;
    if largest {
        keep_largest(object)
    } else {
        Ok(object)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::Phantom;
    use crate::space::Grid;

    /// The phantom's head, small, with a table behind it.
    fn on_a_table() -> Volume<i16> {
        let spacing = Phantom::default_grid().unwrap().spacing() * 4.0;
        let grid = Grid::axis_aligned([80, 80, 38], spacing.to_array()).unwrap();
        let mut volume = Phantom::lee2001().render(&grid).unwrap();
        volume
            .samples_mut()
            .slice_mut(ndarray::s![.., 79, ..])
            .fill(100);
        volume
    }

    #[test]
    fn the_largest_is_the_head_without_its_table() {
        let volume = on_a_table();
        let all = segment(&volume, -500.0, false).unwrap();
        let head = segment(&volume, -500.0, true).unwrap();
        assert_eq!(all.count(), head.count() + 80 * 38);
        assert!(all.contains(40, 79, 20) && !head.contains(40, 79, 20));
        assert!(segment(&volume, 5000.0, true).unwrap().is_empty());
    }

    #[test]
    fn as_many_threads_as_you_like_give_the_same() {
        let volume = on_a_table();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let settings = Enhance {
                    median: Some(MEDIAN_SIDE),
                    smooth_mm: Some(3.0),
                };
                let enhanced = enhance(&volume, &settings).unwrap();
                let bits: Vec<u32> = enhanced.as_slice().iter().map(|hu| hu.to_bits()).collect();
                let hu = otsu(&volume).unwrap();
                (bits, hu.to_bits(), segment(&enhanced, hu, true).unwrap())
            })
        };
        let one = run(1);
        assert!(!one.2.is_empty());
        assert_eq!(run(4), one);
    }
}
