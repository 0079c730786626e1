//! A threshold from the values themselves.

use crate::volume::{Sample, Volume};

/// The values that count, HU: what a CT scale spans from below air to above soft tissue. Metal, and the
/// values that scanners pad with, do not.
const LEAST_HU: f64 = -1024.0;
const MOST_HU: f64 = 1024.0;

/// Classes of the histogram, of 1 HU.
const BINS: usize = 2049;

/// The threshold that best separates a volume's values into two classes, HU: that of the largest variance
/// between the classes. A value at the threshold or above is of the upper class; where several
/// thresholds separate alike, because nothing lies between them, the middle one is taken. Values outside
/// -1024..=1024 HU do not count. None where fewer than two different values are left.
///
/// Source: N. Otsu, *A threshold selection method from gray-level histograms*, IEEE Transactions on Systems,
/// Man, and Cybernetics 9(1), 1979.
pub fn otsu<T: Sample>(volume: &Volume<T>) -> Option<f64> {
    let rescale = volume.rescale();
    let mut counts = vec![0_u64; BINS];
    for sample in volume.as_slice() {
        let hu = rescale.to_hu(sample.to_f64());
        if !(LEAST_HU..=MOST_HU).contains(&hu) {
            continue;
        }
        // In range, so that `as` neither clamps nor meets a NaN.
        let bin = (hu - LEAST_HU).round() as usize;
        if let Some(count) = counts.get_mut(bin) {
            *count += 1;
        }
    }
    separate(&counts).map(|place| LEAST_HU + place)
}

/// The place between two bins that separates a histogram best, in bins.
fn separate(counts: &[u64]) -> Option<f64> {
    let total: u64 = counts.iter().sum();
    let moment = |(bin, &count): (usize, &u64)| bin as f64 * count as f64;
    let whole: f64 = counts.iter().enumerate().map(moment).sum();
    let (mut below, mut below_moment) = (0_u64, 0.0);
    let mut best = 0.0;
    let mut places: Option<(usize, usize)> = None;
    for (bin, &count) in counts.iter().enumerate() {
        below += count;
        below_moment += bin as f64 * count as f64;
        let above = total - below;
        if below == 0 || above == 0 {
            continue;
        }
        let apart = below_moment / below as f64 - (whole - below_moment) / above as f64;
        let between = below as f64 * above as f64 * apart * apart;
        if between > best {
            best = between;
            places = Some((bin, bin));
        } else if let Some((_, last)) = &mut places
            && count == 0
            && *last + 1 == bin
        {
            // Nothing in this bin: it separates as the one before it did.
            *last = bin;
        }
    }
    places.map(|(first, last)| (first + last) as f64 * 0.5 + 0.5)
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::space::Grid;
    use crate::volume::Rescale;

    fn of(samples: Vec<i16>, rescale: Rescale) -> Option<f64> {
        let grid = Grid::axis_aligned([samples.len(), 1, 1], [1.0; 3]).unwrap();
        let samples = Array3::from_shape_vec((1, 1, samples.len()), samples).unwrap();
        otsu(&Volume::new(grid, rescale, samples).unwrap())
    }

    #[test]
    fn two_peaks_are_separated_in_the_middle_of_the_gap() {
        assert_eq!(
            of(vec![-1000, -1000, -1000, 40], Rescale::NONE),
            Some(-480.0)
        );
        let rescale = Rescale {
            slope: 0.5,
            intercept: -1000.0,
        };
        assert_eq!(of(vec![0, 0, 2000, 2000], rescale), Some(-500.0));
    }

    #[test]
    fn what_is_outside_the_range_does_not_count() {
        let values = vec![-3024, -1000, -1000, 40, 3071, 3071, 3071];
        assert_eq!(
            of(values, Rescale::NONE),
            of(vec![-1000, -1000, 40], Rescale::NONE)
        );
    }

    #[test]
    fn one_value_cannot_be_separated() {
        assert_eq!(of(vec![40; 9], Rescale::NONE), None);
        assert_eq!(of(vec![-3024, 40, 40], Rescale::NONE), None);
    }
}
