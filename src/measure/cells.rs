//! One axis of a volume, cut into the intervals between neighbouring voxel centres.

/// A part of the interval between two neighbouring voxel centres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    /// The voxel at or before it.
    pub low: usize,
    /// The voxel at or after it: `low` itself in the outer halves of the two voxels at the rim.
    pub high: usize,
    /// Where the part begins and ends, in voxels from the first centre: 0 to 1.
    pub from: f64,
    /// See `from`.
    pub to: f64,
}

impl Cell {
    /// Its length in voxels.
    pub fn length(&self) -> f64 {
        self.to - self.from
    }

    /// The midpoints of `count` equal parts.
    #[inline]
    pub fn midpoints(&self, count: usize) -> impl Iterator<Item = f64> {
        let (from, step) = (self.from, self.length() / count as f64);
        (0..count).map(move |n| from + (n as f64 + 0.5) * step)
    }
}

/// The cells between two positions of an axis of `voxels` voxels, in order. Positions are in voxels, centres
/// at integers; the axis reaches from -½ to `voxels` - ½, and what is beyond is left out.
pub(super) fn cells(voxels: usize, from: f64, to: f64) -> impl Iterator<Item = Cell> {
    // Counted half a voxel back from the rim, so that all is positive: centres are at n + ½ there.
    let rim = voxels as f64;
    let from = (from + 0.5).clamp(0.0, rim);
    let to = (to + 0.5).clamp(0.0, rim);
    // Cell n lies between the centres of the voxels n - 1 and n.
    let (first, last) = ((from + 0.5) as usize, (to + 0.5) as usize);
    (first..=last).filter_map(move |n| {
        let before = n as f64 - 0.5;
        let cell = Cell {
            low: n.saturating_sub(1),
            high: n.min(voxels.saturating_sub(1)),
            from: (from - before).max(0.0),
            to: (to - before).min(1.0),
        };
        (cell.length() > 0.0).then_some(cell)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_cover_the_stretch_and_stop_at_the_rim() {
        for (from, to, length) in [
            (-0.5, 4.5, 5.0),
            (-9.0, 9.0, 5.0),
            (0.25, 0.75, 0.5),
            (1.0, 3.0, 2.0),
            (1.2, 3.7, 2.5),
            (-0.3, -0.1, 0.2),
            (4.25, 7.0, 0.25),
            (5.0, 7.0, 0.0),
            (-7.0, -3.0, 0.0),
            (3.0, 1.0, 0.0),
        ] {
            let found: Vec<Cell> = cells(5, from, to).collect();
            let sum: f64 = found.iter().map(Cell::length).sum();
            assert!((sum - length).abs() < 1e-12, "{from} to {to}: {found:?}");
            for cell in &found {
                assert!(cell.from >= 0.0 && cell.to <= 1.0 && cell.high < 5);
                assert!(cell.high - cell.low <= 1);
            }
            for pair in found.windows(2) {
                assert_eq!((pair[0].to, pair[1].from), (1.0, 0.0));
            }
        }
    }

    #[test]
    fn the_rims_take_their_own_voxel_twice() {
        let found: Vec<Cell> = cells(2, -0.5, 1.5).collect();
        let ends: Vec<_> = found
            .iter()
            .map(|c| (c.low, c.high, c.from, c.to))
            .collect();
        assert_eq!(ends, [(0, 0, 0.5, 1.0), (0, 1, 0.0, 1.0), (1, 1, 0.0, 0.5)]);
    }

    #[test]
    fn a_single_voxel_has_two_halves() {
        assert_eq!(cells(1, -0.5, 0.5).map(|c| c.length()).sum::<f64>(), 1.0);
    }
}
