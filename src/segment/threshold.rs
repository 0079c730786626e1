//! Voxels by their Hounsfield units, and the threshold between air and soft tissue.

use std::ops::Range;

use rayon::prelude::*;

use crate::volume::{Mask, Rescale, Sample, Volume, VolumeError};

/// Samples that fill a word of a mask.
const WORD: usize = u64::BITS as usize;

/// Samples turned into bits at once.
const BYTE: usize = 8;

/// The voxels of `hu` or more. A sample that is not a number is outside, and so is all where `hu` is none.
///
/// # Errors
/// [`VolumeError::Memory`] where the machine has none.
pub fn above<T: Sample>(volume: &Volume<T>, hu: f64) -> Result<Mask, VolumeError> {
    let mut mask = Mask::empty(volume.grid().dims())?;
    above_in(&mut mask, volume, hu, |_, _| true);
    Ok(mask)
}

/// As [`above`], into a mask of the volume's size, in the rows along x, by y and z, that are `wanted`; the others are left
/// as they are.
pub(super) fn above_in<T: Sample>(
    mask: &mut Mask,
    volume: &Volume<T>,
    hu: f64,
    wanted: impl Fn(usize, usize) -> bool + Sync,
) {
    match Cut::new(volume.rescale(), hu) {
        Some(Cut::AtLeast(cut)) => fill(mask, volume, wanted, |sample: T| sample >= cut),
        Some(Cut::Above(cut)) => fill(mask, volume, wanted, |sample: T| sample > cut),
        Some(Cut::AtMost(cut)) => fill(mask, volume, wanted, |sample: T| sample <= cut),
        Some(Cut::Below(cut)) => fill(mask, volume, wanted, |sample: T| sample < cut),
        None => fill(mask, volume, wanted, |_: T| false),
    }
}

/// Sets the voxels whose samples pass, and no others, in the rows that are wanted.
fn fill<T: Sample>(
    mask: &mut Mask,
    volume: &Volume<T>,
    wanted: impl Fn(usize, usize) -> bool + Sync,
    inside: impl Fn(T) -> bool + Sync,
) {
    let [nx, ny, _] = volume.grid().dims();
    let samples = volume.as_slice();
    mask.par_rows_mut().for_each(|(y, z, row)| {
        if !wanted(y, z) {
            return;
        }
        let begin = (z * ny + y) * nx;
        let samples = samples[begin..begin + nx].chunks(WORD);
        for (word, samples) in row.iter_mut().zip(samples) {
            // By way of bytes, which the compiler compares many at a time.
            let mut passed = [0_u8; WORD];
            for (to, &sample) in passed.iter_mut().zip(samples) {
                *to = u8::from(inside(sample));
            }
            *word = pack(&passed);
        }
    });
}

/// The word whose bit b is byte b, each of which is 0 or 1.
fn pack(bytes: &[u8; WORD]) -> u64 {
    // Byte b times 2^(56 - 7b) has its bit at 56 + b; no two of the other products share a bit, so nothing
    // is carried into the top byte.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let (eights, _) = bytes.as_chunks::<BYTE>();
    eights.iter().enumerate().fold(0, |word, (place, &eight)| {
        let bits = u64::from_le_bytes(eight).wrapping_mul(GATHER) >> (WORD - BYTE);
        word | bits << (BYTE * place)
    })
}

/// What samples are as stored that stand for a threshold or more. The same voxels as by their Hounsfield
/// units, to the last bit, but for integers beyond 2⁵³, which are not rounded here.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Cut<T> {
    AtLeast(T),
    Above(T),
    // Where the slope is negative.
    AtMost(T),
    Below(T),
}

impl<T: Sample> Cut<T> {
    /// `None` where no number passes.
    fn new(rescale: Rescale, hu: f64) -> Option<Self> {
        let rising = rescale.slope > 0.0;
        let stored = |value: f64| if rising { value } else { -value };
        // HU rise with this value, rounding included, so the values that pass begin somewhere.
        let cut = stored(first(|value| rescale.to_hu(stored(value)) >= hu)?);
        // The nearest that the type has, which lies on one side or the other, with none between.
        let nearest = T::from_interpolated(cut);
        Some(match (rising, nearest.to_f64()) {
            (true, value) if value >= cut => Self::AtLeast(nearest),
            (true, _) => Self::Above(nearest),
            (false, value) if value <= cut => Self::AtMost(nearest),
            (false, _) => Self::Below(nearest),
        })
    }
}

/// The least value that passes, infinities included, if any does; whatever is greater has to pass too.
fn first(passes: impl Fn(f64) -> bool) -> Option<f64> {
    if passes(f64::NEG_INFINITY) {
        return Some(f64::NEG_INFINITY);
    }
    if !passes(f64::INFINITY) {
        return None;
    }
    let (mut below, mut at) = (place(f64::NEG_INFINITY), place(f64::INFINITY));
    while below + 1 < at {
        let middle = below.midpoint(at);
        if passes(value(middle)) {
            at = middle;
        } else {
            below = middle;
        }
    }
    Some(value(at))
}

/// A number for each `f64` that is one, in their order.
fn place(value: f64) -> i64 {
    flip(value.to_bits().cast_signed())
}

/// The inverse of [`place`].
fn value(place: i64) -> f64 {
    f64::from_bits(flip(place).cast_unsigned())
}

/// Negative numbers are stored by magnitude: the other way round.
fn flip(bits: i64) -> i64 {
    if bits < 0 { bits ^ i64::MAX } else { bits }
}

/// What counts for [`otsu`], in HU: from air, which scanners clip at -1024, to soft tissue at its densest.
/// Padding at -2000 or -3024, and bone, teeth and metal are left out, so that the split can only be between
/// air and soft tissue. With bone up to 1023 HU it would be 46 to 79 HU higher on two CTs and the phantom.
const OTSU_HU: Range<i16> = -1024..300;

/// The threshold between air and soft tissue, in HU: the voxels of -1024 to below 300 HU are split into two
/// classes with the greatest variance between them (N. Otsu, "A Threshold Selection Method from Gray-Level
/// Histograms", IEEE Transactions on Systems, Man, and Cybernetics 9(1), 1979, DOI
/// 10.1109/TSMC.1979.4310076), whole HU at a time. Where several splits are as good, as in the gap between two
/// clean tissues, the middle of the first and the last of them.
///
/// `None` where there are not two classes: what lies in that range all has the same HU, or nothing does.
pub fn otsu<T: Sample>(volume: &Volume<T>) -> Option<f64> {
    let counts = histogram(volume, &OTSU_HU);
    split(&counts).map(|bin| f64::from(OTSU_HU.start) + bin)
}

/// Voxels in each whole HU of a range, from that up to the next; those outside it are not counted.
fn histogram<T: Sample>(volume: &Volume<T>, range: &Range<i16>) -> Vec<u64> {
    let bins = range.len();
    let rescale = volume.rescale();
    let low = f64::from(range.start);
    volume
        .as_slice()
        .par_chunks(volume.plane_len())
        .fold(
            || vec![0; bins],
            |mut counts, samples| {
                for sample in samples {
                    let off = rescale.to_hu(sample.to_f64()) - low;
                    // Not a number is not counted.
                    if off >= 0.0
                        && let Some(count) = counts.get_mut(off as usize)
                    {
                        *count += 1;
                    }
                }
                counts
            },
        )
        .reduce(
            || vec![0; bins],
            |mut sum, counts| {
                for (sum, count) in sum.iter_mut().zip(counts) {
                    *sum += count;
                }
                sum
            },
        )
}

/// The first bin of the upper class, by Otsu's criterion; the mean of the first and the last bin for which the
/// criterion is greatest. `None` where fewer than two bins hold anything.
fn split(counts: &[u64]) -> Option<f64> {
    let bins = || (0_u64..).zip(counts);
    let total: u64 = counts.iter().sum();
    let sum: u64 = bins().map(|(bin, count)| bin * count).sum();
    let (mut below, mut sum_below) = (0, 0);
    let mut best = 0.0;
    let mut found = None;
    for (bin, count) in bins() {
        // The classes if this bin is the first of the upper one.
        if below > 0 && below < total {
            let (lower, upper) = (below as f64, (total - below) as f64);
            let apart = sum_below as f64 / lower - (sum - sum_below) as f64 / upper;
            let between = lower * upper * apart * apart;
            if between > best {
                best = between;
                found = Some((bin, bin));
            } else if between == best
                && let Some((_, last)) = &mut found
            {
                *last = bin;
            }
        }
        below += count;
        sum_below += bin * count;
    }
    found.map(|(first, last)| (first + last) as f64 / 2.0)
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::phantom::Phantom;
    use crate::space::Grid;

    fn line<T: Sample>(rescale: Rescale, samples: Vec<T>) -> Volume<T> {
        let grid = Grid::axis_aligned([samples.len(), 1, 1], [1.0; 3]).unwrap();
        let samples = Array3::from_shape_vec((1, 1, samples.len()), samples).unwrap();
        Volume::new(grid, rescale, samples).unwrap()
    }

    /// Holds [`above`] against the Hounsfield units of every voxel. Returns how many are inside.
    fn check<T: Sample>(rescale: Rescale, samples: &[T], hu: f64) -> usize {
        let mask = above(&line(rescale, samples.to_vec()), hu).unwrap();
        for (x, sample) in samples.iter().enumerate() {
            let inside = rescale.to_hu(sample.to_f64()) >= hu;
            assert_eq!(
                mask.contains(x, 0, 0),
                inside,
                "{sample:?}, {rescale:?}, {hu} HU"
            );
        }
        mask.count()
    }

    #[test]
    fn the_same_voxels_as_by_their_hounsfield_units() {
        let rescales = [(1.0, 0.0), (-1.0, 0.0), (0.1, -1024.0), (-2.5, 7.3)];
        let thresholds = [
            -500.0, -500.4, -499.6, -0.5, 0.0, 2.5, 7.3, 1e9, -1e9, 1e300, -1e300,
        ];
        let odd = [f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
        let shorts: Vec<i16> = (i16::MIN..=i16::MAX).step_by(3).chain(-600..600).collect();
        let bytes: Vec<u8> = (0..=255).collect();
        let floats: Vec<f32> = [-500.0_f32, -500.4, 2.5, 7.3, 0.0, -0.0, 5240.0, 203.0]
            .into_iter()
            .flat_map(|value| [value.next_down(), value, value.next_up()])
            .chain([f32::NAN, f32::MAX, f32::MIN, f32::INFINITY])
            .collect();
        let doubles: Vec<f64> = floats
            .iter()
            .map(|&value| f64::from(value))
            .flat_map(|value| [value.next_down(), value, value.next_up()])
            .collect();
        let mut inside = 0;
        for (slope, intercept) in rescales {
            let rescale = Rescale { slope, intercept };
            for hu in thresholds.into_iter().chain(odd) {
                inside += check(rescale, &shorts, hu);
                inside += check(rescale, &bytes, hu);
                inside += check(rescale, &floats, hu);
                inside += check(rescale, &doubles, hu);
            }
        }
        assert!(inside > 0);
    }

    #[test]
    fn whole_rows_of_any_length() {
        for len in [1, 7, 8, 63, 64, 65, 127, 128, 130] {
            let samples: Vec<i16> = (0..len)
                .map(|n| if n % 3 == 0 { 40 } else { -1000 })
                .collect();
            let inside = check(Rescale::NONE, &samples, -500.0);
            assert_eq!(inside, (len as usize).div_ceil(3), "{len} voxels");
        }
    }

    #[test]
    fn the_threshold_lies_between_air_and_tissue() {
        let grid = Phantom::default_grid().unwrap();
        let grid = Grid::axis_aligned([80, 80, 38], (grid.spacing() * 4.0).to_array()).unwrap();
        let head = Phantom::lee2001().render(&grid).unwrap();
        let hu = otsu(&head).unwrap();
        assert!((-510.0..-480.0).contains(&hu), "{hu} HU");
    }

    #[test]
    fn padding_bone_and_metal_do_not_move_it() {
        let mut samples = [vec![-1000_i16; 50], vec![40; 30]].concat();
        assert_eq!(otsu(&line(Rescale::NONE, samples.clone())), Some(-479.5));
        for (hu, voxels) in [(-3024, 900), (-2000, 400), (300, 80), (3071, 500)] {
            samples.extend(vec![hu; voxels]);
        }
        let volume = line(Rescale::NONE, samples);
        assert_eq!(otsu(&volume), Some(-479.5));
        assert_eq!(above(&volume, -479.5).unwrap().count(), 30 + 80 + 500);
    }

    #[test]
    fn the_split_is_the_best_of_all() {
        // Three tissues: by hand, 4 of -1000, 4 of -100 and 2 of 40 HU. Between the classes of 4 and 6 lie
        // 4 · 6 · (-1000 - -53.3)² = 2.151e7, between those of 8 and 2 8 · 2 · (-550 - 40)² = 5.57e6.
        let samples = [vec![-1000_i16; 4], vec![-100; 4], vec![40; 2]].concat();
        assert_eq!(otsu(&line(Rescale::NONE, samples)), Some(-549.5));
        let stored: Vec<f32> = vec![10.0, 10.0, 30.0];
        let rescale = Rescale {
            slope: -20.0,
            intercept: 100.0,
        };
        assert_eq!(otsu(&line(rescale, stored)), Some(-299.5));
    }

    #[test]
    fn nothing_is_split_where_there_are_not_two_classes() {
        for samples in [vec![-1000_i16; 9], vec![-3024, 500], vec![-3024, 40, 3000]] {
            assert_eq!(otsu(&line(Rescale::NONE, samples)), None);
        }
        assert_eq!(otsu(&line(Rescale::NONE, vec![f32::NAN, 40.0])), None);
    }
}
