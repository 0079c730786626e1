//! Scanner-like noise that is the same for any number of threads.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

/// Standard deviation, HU.
pub(super) const SIGMA_HU: f64 = 10.0;
/// Any number would do: the year of the paper and its grid.
const SEED: u64 = 2_001_320_320_151;
/// 16-bit uniform numbers summed for one value.
const TERMS: u32 = 8;

/// The noise of one z slice: a stream of its own, so that slices can be made in any order.
pub(super) struct SliceNoise {
    stream: ChaCha8Rng,
    scale: f64,
}

impl SliceNoise {
    /// The noise of slice `z`, from its first voxel on.
    pub fn new(z: usize) -> Self {
        let mut stream = ChaCha8Rng::seed_from_u64(SEED);
        stream.set_stream(z as u64);
        // A uniform number of 2¹⁶ steps has the variance (2³² − 1)/12.
        let variance = f64::from(TERMS) * (f64::from(u32::MAX) / 12.0);
        Self {
            stream,
            scale: SIGMA_HU / variance.sqrt(),
        }
    }

    /// The next voxel's noise, HU: a sum of uniform numbers (Irwin and Hall 1927), near Gaussian and,
    /// unlike a Box-Muller pair, free of transcendental functions.
    #[inline]
    pub fn next_hu(&mut self) -> f64 {
        const MEAN: f64 = TERMS as f64 * 65_535.0 / 2.0;
        let sum = sixteen_bit_sum(self.stream.next_u64()) + sixteen_bit_sum(self.stream.next_u64());
        (sum as f64 - MEAN) * self.scale
    }
}

/// The sum of the four 16-bit parts of a word.
#[inline]
fn sixteen_bit_sum(word: u64) -> u64 {
    const PART: u64 = 0xFFFF;
    (word & PART) + (word >> 16 & PART) + (word >> 32 & PART) + (word >> 48)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_has_its_mean_spread_and_tails() {
        const COUNT: usize = 200_000;
        let mut noise = SliceNoise::new(7);
        let values: Vec<f64> = (0..COUNT).map(|_| noise.next_hu()).collect();
        let mean = values.iter().sum::<f64>() / COUNT as f64;
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / COUNT as f64;
        // Four standard errors of each.
        assert!(mean.abs() < 0.09, "mean {mean}");
        assert!((variance.sqrt() - SIGMA_HU).abs() < 0.07, "{variance}");
        let beyond = |sigmas: f64| {
            values
                .iter()
                .filter(|v| v.abs() > sigmas * SIGMA_HU)
                .count() as f64
                / COUNT as f64
        };
        // A Gaussian has 31.7 % and 4.55 %.
        assert!((beyond(1.0) - 0.317).abs() < 0.01);
        assert!((beyond(2.0) - 0.0455).abs() < 0.005);
    }

    #[test]
    fn slices_have_different_noise_and_repeat_their_own() {
        let take = |z| {
            let mut noise = SliceNoise::new(z);
            std::array::from_fn::<f64, 8, _>(|_| noise.next_hu())
        };
        assert_eq!(take(3), take(3));
        assert_ne!(take(3), take(4));
    }
}
