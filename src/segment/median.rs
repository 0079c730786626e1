//! The median of 3×3×3 voxels.
//!
//! The 27 are not sorted out for every voxel. The nine of a column across x are sorted once and serve three
//! windows; and of three sorted columns only thirteen voxels can be the median. What is compared does not
//! depend on the voxels, some 110 choices of the smaller or the greater for each, so the compiler does many at a
//! time. Samples are compared as stored and only the median is turned into Hounsfield units, which gives the
//! same: those rise or fall with the samples, and 27 is odd.

use rayon::prelude::*;

use crate::volume::{Sample, Volume};

/// Voxels that are sorted together. A loop this long is vectorised, where a short one would be unrolled.
const BLOCK: usize = 64;

/// Voxels that the windows of a block reach over.
const REACH: usize = BLOCK + 2;

/// Voxels of a column across x: three along y by three along z.
const COLUMN: usize = 9;

/// Writes the median of every voxel's 3×3×3 window, in Hounsfield units, to a volume of the same size.
/// Beyond the border is its nearest voxel again.
pub(super) fn median<T: Sample>(volume: &Volume<T>, to: &mut Volume<f32>) {
    let [nx, ny, nz] = volume.grid().dims();
    let samples = volume.as_slice();
    let rescale = volume.rescale();
    let row = |y: usize, z: usize| {
        let begin = (z * ny + y) * nx;
        &samples[begin..begin + nx]
    };
    to.as_mut_slice()
        .par_chunks_mut(nx * ny)
        .enumerate()
        .for_each_init(
            || Columns::<T>::new(nx),
            |columns, (z, plane)| {
                let [z0, z1, z2] = around(z, nz);
                for (y, to) in plane.chunks_exact_mut(nx).enumerate() {
                    let [y0, y1, y2] = around(y, ny);
                    columns.sort(&[
                        row(y0, z0),
                        row(y1, z0),
                        row(y2, z0),
                        row(y0, z1),
                        row(y1, z1),
                        row(y2, z1),
                        row(y0, z2),
                        row(y1, z2),
                        row(y2, z2),
                    ]);
                    for (block, to) in to.chunks_mut(BLOCK).enumerate() {
                        let medians = columns.medians(block);
                        for (to, median) in to.iter_mut().zip(medians) {
                            *to = rescale.to_hu(median.to_f64()) as f32;
                        }
                    }
                }
            },
        );
}

/// An index with its neighbours, on an axis of `len` voxels.
fn around(at: usize, len: usize) -> [usize; 3] {
    [at.saturating_sub(1), at, (at + 1).min(len - 1)]
}

/// The sorted columns of one row along x.
struct Columns<T> {
    voxels: usize,
    /// By rank, the least first. The first voxel is the one before the row; past the row's last neighbour
    /// whatever fills a block.
    ranks: [Vec<T>; COLUMN],
}

impl<T: Sample> Columns<T> {
    /// Room for the columns of a row of `voxels`.
    fn new(voxels: usize) -> Self {
        let len = voxels.next_multiple_of(BLOCK) + 2;
        Self {
            voxels,
            ranks: std::array::from_fn(|_| vec![T::default(); len]),
        }
    }

    /// Takes the columns that nine rows make.
    fn sort(&mut self, rows: &[&[T]; COLUMN]) {
        let mut column = [[T::default(); BLOCK]; COLUMN];
        let mut sorted = column;
        for begin in (0..self.voxels).step_by(BLOCK) {
            let end = (begin + BLOCK).min(self.voxels);
            for (to, row) in column.iter_mut().zip(rows) {
                to[..end - begin].copy_from_slice(&row[begin..end]);
            }
            for x in 0..BLOCK {
                let ranks = sort_9(std::array::from_fn(|n| column[n][x]));
                for (to, rank) in sorted.iter_mut().zip(ranks) {
                    to[x] = rank;
                }
            }
            for (to, from) in self.ranks.iter_mut().zip(&sorted) {
                to[begin + 1..=begin + BLOCK].copy_from_slice(from);
            }
        }
        for rank in &mut self.ranks {
            rank[0] = rank[1];
            rank[self.voxels + 1] = rank[self.voxels];
        }
    }

    /// The medians of a block of windows.
    fn medians(&self, block: usize) -> [T; BLOCK] {
        let mut ranks = [[T::default(); REACH]; COLUMN];
        for (to, from) in ranks.iter_mut().zip(&self.ranks) {
            to.copy_from_slice(&from[block * BLOCK..block * BLOCK + REACH]);
        }
        let mut medians = [T::default(); BLOCK];
        for (x, median) in medians.iter_mut().enumerate() {
            let column = |at: usize| std::array::from_fn(|n| ranks[n][at]);
            *median = median_27(column(x), column(x + 1), column(x + 2));
        }
        medians
    }
}

#[inline(always)]
fn least<T: Sample>(a: T, b: T) -> T {
    if b < a { b } else { a }
}

#[inline(always)]
fn greatest<T: Sample>(a: T, b: T) -> T {
    if b < a { a } else { b }
}

/// Puts pairs of places in order, one after another: a sorting network.
macro_rules! in_order {
    ($list:ident: $($a:literal $b:literal),+) => {
        $(($list[$a], $list[$b]) = (least($list[$a], $list[$b]), greatest($list[$a], $list[$b]));)+
    };
}

/// Nine values in order, by 25 comparisons, which is as few as it can be done with (M. Codish et al.,
/// "Twenty-Five Comparators Is Optimal When Sorting Nine Inputs", ICTAI 2014, DOI 10.1109/ICTAI.2014.36).
#[inline(always)]
fn sort_9<T: Sample>(mut v: [T; COLUMN]) -> [T; COLUMN] {
    in_order!(v: 0 3, 1 7, 2 5, 4 8);
    in_order!(v: 0 7, 2 4, 3 8, 5 6);
    in_order!(v: 0 2, 1 3, 4 5, 7 8);
    in_order!(v: 1 4, 3 6, 5 7);
    in_order!(v: 0 1, 2 4, 3 5, 6 8);
    in_order!(v: 2 3, 4 5, 6 7);
    in_order!(v: 1 2, 3 4, 5 6);
    v
}

/// The median of 27 values in three sorted columns.
#[inline(always)]
fn median_27<T: Sample>(a: [T; COLUMN], b: [T; COLUMN], c: [T; COLUMN]) -> T {
    // Sorting the ranks across the columns leaves the columns sorted. Then (n + 1)(m + 1) - 1 others are
    // no greater than rank n of column m, and (9 - n)(3 - m) - 1 no less; the median has 13 on either side.
    // What has more on one side is no candidate, and seven go on each.
    let low = |n: usize| least(least(a[n], b[n]), c[n]);
    let high = |n: usize| greatest(greatest(a[n], b[n]), c[n]);
    let middle = |n: usize| greatest(least(a[n], b[n]), least(greatest(a[n], b[n]), c[n]));
    let five = [middle(2), middle(3), middle(4), middle(5), middle(6)];
    // Four of the low column and four of the high one, merged.
    let mut v = [
        low(5),
        low(6),
        low(7),
        low(8),
        high(0),
        high(1),
        high(2),
        high(3),
    ];
    in_order!(v: 0 4, 1 5, 2 6, 3 7);
    in_order!(v: 2 4, 3 5);
    in_order!(v: 1 2, 3 4, 5 6);
    // The seventh of thirteen in two sorted lists: for every way to take seven from their beginnings, the
    // greatest that is taken; the least of these.
    let ways = [
        greatest(v[1], five[4]),
        greatest(v[2], five[3]),
        greatest(v[3], five[2]),
        greatest(v[4], five[1]),
        greatest(v[5], five[0]),
        v[6],
    ];
    ways.into_iter().reduce(least).unwrap_or(v[6])
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};

    use super::*;
    use crate::space::Grid;
    use crate::volume::Rescale;

    fn volume<T: Sample>(
        dims: [usize; 3],
        rescale: Rescale,
        mut at: impl FnMut(usize, usize, usize) -> T,
    ) -> Volume<T> {
        let [nx, ny, nz] = dims;
        let samples = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| at(x, y, z));
        Volume::new(
            Grid::axis_aligned(dims, [1.0; 3]).unwrap(),
            rescale,
            samples,
        )
        .unwrap()
    }

    fn median_of<T: Sample>(volume: &Volume<T>) -> Volume<f32> {
        let mut to = Volume::zeros(volume.grid().clone(), Rescale::NONE).unwrap();
        median(volume, &mut to);
        to
    }

    /// The same, by sorting 27 values in Hounsfield units for every voxel.
    fn by_sorting<T: Sample>(volume: &Volume<T>) -> Volume<f32> {
        let dims = volume.grid().dims();
        let [nx, ny, nz] = dims;
        self::volume(dims, Rescale::NONE, |x, y, z| {
            let mut window = Vec::new();
            for z in around(z, nz) {
                for y in around(y, ny) {
                    for x in around(x, nx) {
                        let stored = volume.samples()[[z, y, x]].to_f64();
                        window.push(volume.rescale().to_hu(stored));
                    }
                }
            }
            window.sort_by(f64::total_cmp);
            window[13] as f32
        })
    }

    #[test]
    fn nine_values_are_sorted() {
        // A network that sorts all zeros and ones sorts everything (Knuth, TAOCP 3, 5.3.4).
        for bits in 0..1_u32 << COLUMN {
            let values: [u8; COLUMN] = std::array::from_fn(|n| (bits >> n & 1) as u8);
            assert!(sort_9(values).is_sorted(), "{values:?}");
        }
    }

    #[test]
    fn the_fourteenth_of_three_sorted_columns_is_found() {
        // Zeros and ones are enough here too: smaller and greater go through any step between.
        let column =
            |ones: usize| -> [u8; COLUMN] { std::array::from_fn(|n| u8::from(n + ones >= COLUMN)) };
        for a in 0..=COLUMN {
            for b in 0..=COLUMN {
                for c in 0..=COLUMN {
                    let found = median_27(column(a), column(b), column(c));
                    assert_eq!(found, u8::from(a + b + c >= 14), "{a}, {b} and {c} ones");
                }
            }
        }
    }

    #[test]
    fn as_by_sorting_for_any_size_and_type() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let odd = Rescale {
            slope: -0.7,
            intercept: 31.25,
        };
        let sizes = [
            [1, 1, 1],
            [2, 1, 5],
            [1, 4, 3],
            [63, 3, 2],
            [64, 2, 3],
            [65, 4, 4],
            [130, 3, 3],
        ];
        for dims in sizes {
            for rescale in [Rescale::NONE, odd] {
                let shorts = volume(dims, rescale, |_, _, _| rng.next_u32() as i16);
                assert_eq!(median_of(&shorts), by_sorting(&shorts), "{dims:?}");
                // Few values: many are equal.
                let bytes = volume(dims, rescale, |_, _, _| (rng.next_u32() % 3) as u8);
                assert_eq!(median_of(&bytes), by_sorting(&bytes), "{dims:?}");
                let floats = volume(dims, rescale, |_, _, _| rng.next_u32() as f32 * 1e-3 - 1e6);
                assert_eq!(median_of(&floats), by_sorting(&floats), "{dims:?}");
            }
        }
    }

    #[test]
    fn an_edge_stays_and_a_single_voxel_goes() {
        let dims = [70, 8, 8];
        let step = volume(
            dims,
            Rescale::NONE,
            |x, _, _| if x < 35 { -1000_i16 } else { 40 },
        );
        let expected = volume(
            dims,
            Rescale::NONE,
            |x, _, _| if x < 35 { -1000_f32 } else { 40.0 },
        );
        assert_eq!(median_of(&step), expected);
        let mut noisy = step;
        for at in [[4, 4, 20], [0, 0, 0], [7, 7, 50], [3, 3, 64], [1, 6, 34]] {
            noisy.samples_mut()[at] = 3000;
        }
        assert_eq!(median_of(&noisy), expected);
    }
}
