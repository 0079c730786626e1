//! A set of voxels, one bit each: an object segmented from a volume.

use rayon::prelude::*;

use super::VolumeError;

/// Bits in a word.
const WORD: usize = u64::BITS as usize;

/// Which voxels of a grid belong to an object.
///
/// Rows along x are padded to whole words, so that neighbouring rows are compared word by word. The bits
/// of the padding are always 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    dims: [usize; 3],
    words_per_row: usize,
    words: Vec<u64>,
}

impl Mask {
    /// The empty set in a grid of `dims` voxels.
    ///
    /// # Errors
    /// [`VolumeError::Memory`] where the machine has no memory for it.
    pub fn empty(dims: [usize; 3]) -> Result<Self, VolumeError> {
        let words_per_row = dims[0].div_ceil(WORD);
        let len = words_per_row * dims[1] * dims[2];
        let mut words = room(len)?;
        words.resize(len, 0);
        Ok(Self {
            dims,
            words_per_row,
            words,
        })
    }

    /// The same set.
    ///
    /// # Errors
    /// As [`Mask::empty`].
    pub fn try_clone(&self) -> Result<Self, VolumeError> {
        let mut words = room(self.words.len())?;
        words.extend_from_slice(&self.words);
        Ok(Self { words, ..*self })
    }

    /// The voxels for which `inside(x, y, z)` holds, asked in parallel.
    ///
    /// # Errors
    /// As [`Mask::empty`].
    pub fn from_fn(
        dims: [usize; 3],
        inside: impl Fn(usize, usize, usize) -> bool + Sync,
    ) -> Result<Self, VolumeError> {
        let mut mask = Self::empty(dims)?;
        mask.par_rows_mut().for_each(|(y, z, row)| {
            for (place, word) in row.iter_mut().enumerate() {
                let begin = place * WORD;
                let bits = WORD.min(dims[0] - begin);
                for bit in 0..bits {
                    *word |= u64::from(inside(begin + bit, y, z)) << bit;
                }
            }
        });
        Ok(mask)
    }

    /// Voxels along x, y and z.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Words in a row along x.
    pub fn words_per_row(&self) -> usize {
        self.words_per_row
    }

    /// The row along x at (y, z): bit b of word w is voxel 64 w + b. Both must be in the grid.
    pub fn row(&self, y: usize, z: usize) -> &[u64] {
        let begin = (z * self.dims[1] + y) * self.words_per_row;
        &self.words[begin..begin + self.words_per_row]
    }

    /// Every row along x with its y and z, in parallel.
    pub fn par_rows_mut(
        &mut self,
    ) -> impl IndexedParallelIterator<Item = (usize, usize, &mut [u64])> {
        let ny = self.dims[1];
        let rows = self.words.par_chunks_exact_mut(self.words_per_row);
        rows.enumerate()
            .map(move |(place, row)| (place % ny, place / ny, row))
    }

    /// Whether a voxel belongs to the set; no voxel outside the grid does.
    pub fn contains(&self, x: usize, y: usize, z: usize) -> bool {
        let [nx, ny, nz] = self.dims;
        x < nx && y < ny && z < nz && self.row(y, z)[x / WORD] >> (x % WORD) & 1 == 1
    }

    /// Leaves only what `other` holds as well. Nothing is left where the grids differ.
    pub fn intersect(&mut self, other: &Self) {
        if self.dims != other.dims {
            self.words.fill(0);
            return;
        }
        let words = self.words.par_iter_mut().zip(&other.words);
        words.for_each(|(word, other)| *word &= other);
    }

    /// Number of voxels in the set.
    pub fn count(&self) -> usize {
        let bits = |word: &u64| word.count_ones() as usize;
        self.words.par_iter().map(bits).sum()
    }

    /// Whether no voxel is in the set.
    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|&word| word == 0)
    }
}

fn room(words: usize) -> Result<Vec<u64>, VolumeError> {
    let mut list = Vec::new();
    list.try_reserve_exact(words)
        .map_err(|_| VolumeError::Memory {
            voxels: words,
            bytes_per_voxel: size_of::<u64>(),
        })?;
    Ok(list)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask_below(mask: &Mask, end: usize) -> usize {
        let [_, ny, nz] = mask.dims();
        let rows = (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z)));
        rows.map(|(y, z)| (0..end).filter(|&x| mask.contains(x, y, z)).count())
            .sum()
    }

    #[test]
    fn holds_what_it_was_made_from_and_nothing_beyond_the_grid() {
        let dims = [130, 5, 3];
        let inside = |x: usize, y: usize, z: usize| (x * 7 + y * 3 + z).is_multiple_of(4);
        let mask = Mask::from_fn(dims, inside).unwrap();
        let mut count = 0;
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    assert_eq!(mask.contains(x, y, z), inside(x, y, z));
                    count += usize::from(inside(x, y, z));
                }
            }
        }
        assert_eq!(mask.count(), count);
        let mut both = mask.clone();
        both.intersect(&Mask::from_fn(dims, |x, _, _| x >= 64).unwrap());
        assert!(both.contains(129, 1, 0) == inside(129, 1, 0) && !both.contains(4, 0, 0));
        assert_eq!(both.count() + mask_below(&mask, 64), count);
        both.intersect(&Mask::empty([1, 1, 1]).unwrap());
        assert!(both.is_empty());
        assert!(!mask.contains(130, 0, 0) && !mask.contains(0, 5, 0) && !mask.contains(0, 0, 3));
        assert!(!mask.is_empty() && Mask::empty(dims).unwrap().is_empty());
    }
}
