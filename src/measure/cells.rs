//! One axis of a volume, cut into the intervals between neighbouring voxel centres.

/// A part of the interval between two neighbouring voxel centres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    /// Four voxels in order: the interval lies between the second and the third. Beyond the rim its voxel
    /// is taken again; in the outer half of a voxel at the rim, all four are that voxel.
    pub taps: [usize; 4],
    /// Where the part begins and ends, in voxels from the second tap's centre: 0 to 1.
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
    pub fn midpoints(&self, count: usize) -> impl Iterator<Item = f64> {
        let (from, step) = (self.from, self.length() / count as f64);
        (0..count).map(move |n| from + (n as f64 + 0.5) * step)
    }
}

/// The cells between two positions of an axis of `voxels` voxels, in order. Positions are in voxels, centres
/// at integers; the axis reaches from -½ to `voxels` - ½, and what is beyond is left out.
pub(super) fn cells(voxels: usize, from: f64, to: f64) -> impl Iterator<Item = Cell> {
    let rim = voxels as f64;
    let last = voxels.saturating_sub(1);
    // From the rim on, where voxel n reaches from n to n + 1 and all is positive.
    let from = (from + 0.5).clamp(0.0, rim);
    let to = (to + 0.5).clamp(0.0, rim);
    // Cell n lies between the centres of the voxels n - 1 and n.
    let (first, final_cell) = ((from + 0.5) as usize, (to + 0.5) as usize);
    (first..=final_cell).filter_map(move |n| {
        let before = n as f64 - 0.5;
        let taps = if n == 0 || n > last {
            [n.min(last); 4]
        } else {
            [n.saturating_sub(2), n - 1, n, (n + 1).min(last)]
        };
        let cell = Cell {
            taps,
            from: (from - before).max(0.0),
            to: (to - before).min(1.0),
        };
        (cell.length() > 0.0).then_some(cell)
    })
}

/// The weights of a cell's four taps at `t`, 0 to 1, between the second and the third: the cubic
/// convolution of Keys (1981) with a = -½. They sum to 1.
#[inline]
pub(super) fn weights(t: f64) -> [f64; 4] {
    let u = 1.0 - t;
    [
        -0.5 * t * u * u,
        1.0 + t * t * (1.5 * t - 2.5),
        1.0 + u * u * (1.5 * u - 2.5),
        -0.5 * u * t * t,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_cover_the_stretch_and_stop_at_the_rim() {
        for (from, to, length) in [
            (-0.5, 4.5, 5.0),
            (-9.0, f64::INFINITY, 5.0),
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
                assert!(cell.from >= 0.0 && cell.to <= 1.0);
                assert!(cell.taps.is_sorted() && cell.taps[3] < 5);
            }
            for pair in found.windows(2) {
                assert_eq!((pair[0].to, pair[1].from), (1.0, 0.0));
            }
        }
    }

    #[test]
    fn the_rims_take_their_own_voxel_again() {
        let found: Vec<_> = cells(3, -0.5, 2.5)
            .map(|c| (c.taps, c.from, c.to))
            .collect();
        let expected = [
            ([0, 0, 0, 0], 0.5, 1.0),
            ([0, 0, 1, 2], 0.0, 1.0),
            ([0, 1, 2, 2], 0.0, 1.0),
            ([2, 2, 2, 2], 0.0, 0.5),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_single_voxel_has_two_halves() {
        assert_eq!(cells(1, -0.5, 0.5).map(|c| c.length()).sum::<f64>(), 1.0);
    }

    #[test]
    fn the_weights_reproduce_parabolas_and_the_taps() {
        assert_eq!(weights(0.0).map(f64::abs), [0.0, 1.0, 0.0, 0.0]);
        assert_eq!(weights(1.0).map(f64::abs), [0.0, 0.0, 1.0, 0.0]);
        for t in [0.1, 0.25, 0.5, 0.9] {
            let sum = |f: &dyn Fn(f64) -> f64| -> f64 {
                (0..4).map(|n| weights(t)[n] * f(n as f64 - 1.0)).sum()
            };
            assert!((sum(&|_| 1.0) - 1.0).abs() < 1e-15);
            assert!((sum(&|x| x) - t).abs() < 1e-15);
            assert!((sum(&|x| x * x) - t * t).abs() < 1e-15);
        }
    }
}
