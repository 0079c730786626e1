//! How the axes of a file or a series lie in LPS order, and the grid in that order.

use std::fmt;

use glam::DMat3;
use ndarray::{ArrayBase, Ix3, RawData};

use crate::space::{Grid, GridError, LpsPoint};

/// Where each stored axis (i fastest, then j, then k) points.
///
/// Shown as three letters, the direction towards which each stored axis grows: `RAS` grows to the right,
/// anterior and superior (nibabel's `aff2axcodes`). LPS order is `LPS`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredAxes {
    /// For each stored axis, the LPS axis (0 x, 1 y, 2 z) that it lies along.
    pub(super) lps: [usize; 3],
    /// For each stored axis, whether it grows against that LPS axis.
    pub(super) flipped: [bool; 3],
}

impl StoredAxes {
    /// Stored in LPS order: nothing to permute or flip.
    pub const LPS: Self = Self {
        lps: [0, 1, 2],
        flipped: [false; 3],
    };

    /// Lengths by LPS axis, from lengths by stored axis.
    pub(super) fn to_lps(self, stored: [usize; 3]) -> [usize; 3] {
        let mut lengths = [0; 3];
        for (axis, length) in self.lps.into_iter().zip(stored) {
            lengths[axis] = length;
        }
        lengths
    }

    /// An array indexed `[z, y, x]` in LPS order, turned (not copied) into one indexed `[k, j, i]` as
    /// the file is.
    pub(super) fn stored_view<S: RawData>(self, lps: ArrayBase<S, Ix3>) -> ArrayBase<S, Ix3> {
        let [i, j, k] = self.lps.map(|axis| 2 - axis);
        let mut stored = lps.permuted_axes([k, j, i]);
        for (axis, flipped) in self.flipped.into_iter().enumerate() {
            if flipped {
                stored.invert_axis(ndarray::Axis(2 - axis));
            }
        }
        stored
    }
}

impl fmt::Display for StoredAxes {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (axis, flipped) in self.lps.into_iter().zip(self.flipped) {
            let (along, against) = [("L", "R"), ("P", "A"), ("S", "I")][axis];
            to.write_str(if flipped { against } else { along })?;
        }
        Ok(())
    }
}

/// For each LPS axis the stored axis that it is taken from. The order settles ties (a scan turned by
/// exactly 45°).
const PERMUTATIONS: [[usize; 3]; 6] = [
    [0, 1, 2],
    [1, 0, 2],
    [0, 2, 1],
    [2, 1, 0],
    [1, 2, 0],
    [2, 0, 1],
];

/// The grid in LPS order, and where its axes are stored. `columns` are the stored axes in LPS mm.
///
/// Among the six ways to name the axes, the one with the largest sum of |cosines| to left, posterior and
/// superior is taken: no axis is chosen before the others, so none is left with a poor match.
///
/// # Errors
/// [`GridError`] where the axes are no grid.
pub(super) fn place(
    stored: [usize; 3],
    columns: DMat3,
    origin: LpsPoint,
) -> Result<(Grid, StoredAxes), GridError> {
    let units = [0, 1, 2].map(|axis| columns.col(axis).normalize_or_zero());
    let score =
        |from: [usize; 3]| -> f64 { (0..3).map(|axis| units[from[axis]][axis].abs()).sum() };
    let mut from = PERMUTATIONS[0];
    for candidate in PERMUTATIONS {
        if score(candidate) > score(from) {
            from = candidate;
        }
    }
    let mut axes = StoredAxes::LPS;
    let mut origin = origin.0;
    let mut direction = DMat3::ZERO;
    let mut spacing = [0.0; 3];
    for (lps, from) in from.into_iter().enumerate() {
        let column = columns.col(from);
        let flipped = column[lps] < 0.0;
        axes.lps[from] = lps;
        axes.flipped[from] = flipped;
        spacing[lps] = column.length();
        if flipped {
            // The first voxel in LPS order is the last that is stored along this axis.
            origin += column * (stored[from].saturating_sub(1)) as f64;
        }
        *direction.col_mut(lps) = if flipped { -column } else { column };
    }
    let grid = Grid::new(axes.to_lps(stored), spacing, LpsPoint(origin), direction)?;
    Ok((grid, axes))
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    #[test]
    fn a_view_in_stored_order_holds_the_voxels_of_the_grid() {
        // x, y, z of the voxel, as digits.
        let lps = Array3::from_shape_fn((4, 3, 2), |(z, y, x)| x * 100 + y * 10 + z);
        // Stored i runs to anterior, j to superior, k to the right.
        let axes = StoredAxes {
            lps: [1, 2, 0],
            flipped: [true, false, true],
        };
        assert_eq!(axes.to_string(), "ASR");
        let stored_lengths = [3, 4, 2];
        assert_eq!(axes.to_lps(stored_lengths), [2, 3, 4]);
        let stored = axes.stored_view(lps.view());
        assert_eq!(stored.dim(), (2, 4, 3));
        assert_eq!(
            stored[[0, 0, 0]],
            120,
            "x and y at their ends, z at its start"
        );
        for ((k, j, i), &voxel) in stored.indexed_iter() {
            assert_eq!(voxel, (1 - k) * 100 + (2 - i) * 10 + j);
        }
    }
}
