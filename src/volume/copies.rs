//! Copies of a volume that are changed in a part of it, one after another.

use std::fmt;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use ndarray::s;

use super::{Sample, Spares, Volume};

/// Copies of one volume. One that is given back with what was changed of it becomes the next, for the price of that part.
pub struct Copies<'a, T> {
    of: &'a Volume<T>,
    spares: &'a Spares,
    unchanged: Mutex<Vec<Volume<T>>>,
}

impl<'a, T: Sample> Copies<'a, T> {
    /// Of a volume, in memory that is at hand where there is any.
    pub fn new(of: &'a Volume<T>, spares: &'a Spares) -> Self {
        Self {
            of,
            spares,
            unchanged: Mutex::default(),
        }
    }

    /// The volume that they are copies of.
    pub fn original(&self) -> &'a Volume<T> {
        self.of
    }

    /// Memory for other volumes.
    pub fn spares(&self) -> &'a Spares {
        self.spares
    }

    /// A copy.
    pub fn take(&self) -> Volume<T> {
        let unchanged = self.list().pop();
        unchanged.unwrap_or_else(|| self.of.par_clone(self.spares))
    }

    /// Takes a copy back that differs from the original in no voxel outside the ranges along x, y and z.
    pub fn give(&self, mut copy: Volume<T>, [x, y, z]: [Range<usize>; 3]) {
        let dims = self.of.grid().dims();
        let inside = [&x, &y, &z].into_iter().zip(dims);
        if copy.grid().dims() != dims || inside.clone().any(|(range, n)| range.end > n) {
            return copy.spare(self.spares);
        }
        if inside.into_iter().all(|(range, _)| !range.is_empty()) {
            let part = s![z, y, x];
            let original = self.of.samples();
            copy.samples_mut()
                .slice_mut(part)
                .assign(&original.slice(part));
        }
        debug_assert!(copy.as_slice() == self.of.as_slice());
        self.list().push(copy);
    }

    fn list(&self) -> std::sync::MutexGuard<'_, Vec<Volume<T>>> {
        // A panic elsewhere leaves the list whole.
        self.unchanged
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T> fmt::Debug for Copies<'_, T> {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.debug_struct("Copies").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::space::Grid;
    use crate::volume::Rescale;

    #[test]
    fn what_is_given_back_is_a_copy_again() {
        let grid = Grid::axis_aligned([7, 6, 5], [1.0; 3]).unwrap();
        let samples = Array3::from_shape_fn((5, 6, 7), |(z, y, x)| (z * 100 + y * 10 + x) as i16);
        let volume = Volume::new(grid, Rescale::NONE, samples).unwrap();
        let spares = Spares::default();
        let copies = Copies::new(&volume, &spares);
        let mut copy = copies.take();
        assert_eq!(copy, volume);
        copy.samples_mut().slice_mut(s![1..3, 0..6, 2..4]).fill(-1);
        let memory = copy.as_slice().as_ptr();
        copies.give(copy, [2..4, 0..6, 1..3]);
        let again = copies.take();
        assert_eq!(again, volume);
        assert_eq!(again.as_slice().as_ptr(), memory);
        assert_ne!(copies.take().as_slice().as_ptr(), memory);
        // Nothing was changed.
        copies.give(again, [3..3, 0..6, 0..5]);
        assert_eq!(copies.take(), volume);
        // No part of it: memory at best.
        copies.give(volume.clone(), [0..8, 0..6, 0..5]);
        assert_eq!(copies.take(), volume);
    }
}
