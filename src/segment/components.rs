//! Pieces of a mask that hang together.
//!
//! Works on the runs along x that the rows of a [`Mask`] consist of, joined by a union-find (R. E. Tarjan,
//! "Efficiency of a good but not linear set union algorithm", Journal of the ACM 22(2), 1975, DOI
//! 10.1145/321879.321884). A volume of labels would take 4 bytes for every voxel, object or not, and more than
//! ten times as long: the phantom's head has one run for 125 of its voxels.

use std::ops::Range;

use rayon::prelude::*;

use crate::volume::{Mask, VolumeError};

/// Bits in a word of a mask.
const WORD: usize = u64::BITS as usize;

/// The largest 6-connected component: voxels hang together where they share a face. Of several that are
/// equally large it is the one that comes first in the order of z, y, x. Empty where the mask is.
///
/// # Errors
/// [`VolumeError::Memory`] where the machine has none.
pub fn keep_largest(mut mask: Mask) -> Result<Mask, VolumeError> {
    let runs = Runs::new(&mask)?;
    let components = Components::new(&runs)?;
    let Some(largest) = components.largest() else {
        return Ok(mask);
    };
    let [_, ny, _] = mask.dims();
    mask.par_rows_mut().for_each(|(y, z, row)| {
        // In most rows there is nothing else.
        for run in runs.row(z * ny + y) {
            if components.first[run] != largest {
                clear(row, runs.runs[run]);
            }
        }
    });
    Ok(mask)
}

/// The rows along x of a part of a grid: their y and z.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Rows {
    pub(super) y: Range<usize>,
    pub(super) z: Range<usize>,
}

impl Rows {
    pub(super) fn contain(&self, y: usize, z: usize) -> bool {
        self.y.contains(&y) && self.z.contains(&z)
    }
}

/// How a mask hangs together outside a part of its rows: what masks that differ in that part alone have in common.
#[derive(Debug)]
pub(super) struct Outside {
    part: Rows,
    runs: Runs,
    /// Of each run the piece that it belongs to.
    piece: Vec<u32>,
    pieces: Vec<Piece>,
}

/// Runs that hang together.
#[derive(Debug, Clone, Copy)]
struct Piece {
    voxels: usize,
    /// The first of its runs, as [`Runs::order`] has them.
    first: u64,
}

impl Outside {
    /// Of `mask` outside `part`.
    pub(super) fn new(mask: &Mask, part: Rows) -> Result<Self, VolumeError> {
        let runs = Runs::of(mask, |y, z| !part.contain(y, z))?;
        let components = Components::new(&runs)?;
        let mut pieces = Vec::new();
        let mut piece = components.first;
        for (row, run) in runs.each() {
            let first = piece[run] as usize;
            // The first of a component is met before the others, and so has its number already.
            piece[run] = if first == run {
                pieces.push(Piece {
                    voxels: components.voxels[run],
                    first: runs.order(row, run),
                });
                // There are no more than runs.
                (pieces.len() - 1) as u32
            } else {
                piece[first]
            };
        }
        Ok(Self {
            part,
            runs,
            piece,
            pieces,
        })
    }

    /// As [`keep_largest`], of a mask that is as the one before outside the part.
    pub(super) fn keep_largest(&self, mut mask: Mask) -> Result<Mask, VolumeError> {
        let [_, ny, nz] = mask.dims();
        let inside = Runs::of(&mask, |y, z| self.part.contain(y, z))?;
        // Pieces first, then the runs of the part.
        let begin = self.pieces.len();
        let mut pieces = room(begin + inside.runs.len())?;
        pieces.extend_from_slice(&self.pieces);
        pieces.extend(inside.each().map(|(row, run)| Piece {
            voxels: inside.runs[run].len(),
            first: inside.order(row, run),
        }));
        let mut sets = Sets::of(pieces.len())?;
        for z in self.part.z.clone() {
            for y in self.part.y.clone() {
                let here = inside.row(z * ny + y);
                let mut beside = |y: usize, z: usize| {
                    let is_inside = self.part.contain(y, z);
                    let other = if is_inside { &inside } else { &self.runs };
                    let there = other.row(z * ny + y);
                    let (one, two) = ((&inside.runs[..], here.clone()), (&other.runs[..], there));
                    for_each_touching(one, two, |one, two| {
                        let two = match is_inside {
                            true => begin + two,
                            false => self.piece[two] as usize,
                        };
                        sets.join(begin + one, two);
                    });
                };
                if y > 0 {
                    beside(y - 1, z);
                }
                if z > 0 {
                    beside(y, z - 1);
                }
                // Within the part, these two are joined from there.
                if y + 1 == self.part.y.end && y + 1 < ny {
                    beside(y + 1, z);
                }
                if z + 1 == self.part.z.end && z + 1 < nz {
                    beside(y, z + 1);
                }
            }
        }
        let roots = sets.into_roots(|place, root| {
            if root != place {
                let Piece { voxels, first } = pieces[place];
                pieces[root].voxels += voxels;
                pieces[root].first = pieces[root].first.min(first);
                pieces[place].voxels = 0;
            }
        });
        let whole = |piece: &Piece| (piece.voxels, std::cmp::Reverse(piece.first));
        let largest = (0..).zip(&pieces).max_by_key(|(_, piece)| whole(piece));
        let Some((largest, _)) = largest else {
            return Ok(mask);
        };
        mask.par_rows_mut().for_each(|(y, z, row)| {
            let at = z * ny + y;
            if self.part.contain(y, z) {
                for run in inside.row(at) {
                    if roots[begin + run] != largest {
                        clear(row, inside.runs[run]);
                    }
                }
            } else {
                for run in self.runs.row(at) {
                    if roots[self.piece[run] as usize] != largest {
                        clear(row, self.runs.runs[run]);
                    }
                }
            }
        });
        Ok(mask)
    }
}

/// Voxels of every 6-connected component, the largest first.
///
/// # Errors
/// As [`keep_largest`].
pub fn component_sizes(mask: &Mask) -> Result<Vec<usize>, VolumeError> {
    let components = Components::new(&Runs::new(mask)?)?;
    let mut sizes = components.voxels;
    sizes.retain(|&voxels| voxels > 0);
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    Ok(sizes)
}

/// Voxels of one row, side by side.
#[derive(Debug, Clone, Copy)]
struct Run {
    begin: u32,
    /// The voxel after the last.
    end: u32,
}

impl Run {
    fn len(self) -> usize {
        (self.end - self.begin) as usize
    }
}

/// The runs of a mask, in the order of z, y, x.
#[derive(Debug)]
struct Runs {
    runs: Vec<Run>,
    /// For each row its first run, or where that would be; then the number of runs.
    rows: Vec<usize>,
    dims: [usize; 3],
}

impl Runs {
    /// All.
    fn new(mask: &Mask) -> Result<Self, VolumeError> {
        Self::of(mask, |_, _| true)
    }

    /// Those of the rows, by y and z, that are `wanted`; the others are as rows without any.
    fn of(mask: &Mask, wanted: impl Fn(usize, usize) -> bool) -> Result<Self, VolumeError> {
        let dims = mask.dims();
        let [nx, ny, nz] = dims;
        let row = |y: usize, z: usize| match wanted(y, z) {
            true => mask.row(y, z),
            false => &[],
        };
        let each_row = || (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z)));
        let each_row = || each_row().map(|(y, z)| row(y, z));
        let count = each_row().map(runs_in).sum();
        let mut runs = room(count)?;
        let mut rows = room(ny * nz + 1)?;
        // A grid has at most 32767 voxels along an axis.
        let run = |begin: usize, end: usize| Run {
            begin: begin as u32,
            end: end as u32,
        };
        for row in each_row() {
            rows.push(runs.len());
            let mut begin = None;
            for_each_edge(row, |at| match begin.take() {
                None => begin = Some(at),
                Some(begin) => runs.push(run(begin, at)),
            });
            // A row of whole words has no padding to end a run.
            if let Some(begin) = begin {
                runs.push(run(begin, nx));
            }
        }
        rows.push(runs.len());
        Ok(Self { runs, rows, dims })
    }

    /// The places of a row's runs; rows are counted along y, then z.
    fn row(&self, row: usize) -> Range<usize> {
        self.rows[row]..self.rows[row + 1]
    }

    /// Every run by its row and place.
    fn each(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let rows = self.rows.windows(2).enumerate();
        rows.flat_map(|(row, ends)| (ends[0]..ends[1]).map(move |run| (row, run)))
    }

    /// A number that is greater for runs that come later in the order of z, y, x.
    fn order(&self, row: usize, run: usize) -> u64 {
        // There are fewer rows than 2³², of at most 32767 voxels.
        (row as u64) << 32 | u64::from(self.runs[run].begin)
    }
}

/// Where bits of a row differ from the one before them, in order. Before the first is a 0.
fn for_each_edge(row: &[u64], mut edge: impl FnMut(usize)) {
    let mut before = 0;
    for (place, &word) in row.iter().enumerate() {
        let mut edges = word ^ (word << 1 | before);
        while edges != 0 {
            edge(place * WORD + edges.trailing_zeros() as usize);
            edges &= edges - 1;
        }
        before = word >> (WORD - 1);
    }
}

/// Number of runs in a row.
fn runs_in(row: &[u64]) -> usize {
    let mut before = 0;
    let mut count = 0;
    for &word in row {
        count += (word & !(word << 1 | before)).count_ones() as usize;
        before = word >> (WORD - 1);
    }
    count
}

/// Clears the bits of a run.
fn clear(row: &mut [u64], run: Run) {
    let (begin, end) = (run.begin as usize, run.end as usize);
    for (place, word) in row.iter_mut().enumerate() {
        let from = begin.saturating_sub(place * WORD).min(WORD);
        let to = end.saturating_sub(place * WORD).min(WORD);
        if from < to {
            *word &= !((u64::MAX >> (WORD - (to - from))) << from);
        }
    }
}

/// Which component each run belongs to.
struct Components {
    /// For each run the first one of its component.
    first: Vec<u32>,
    /// For each run that is the first of its component, the voxels of that; 0 for others.
    voxels: Vec<usize>,
}

impl Components {
    fn new(runs: &Runs) -> Result<Self, VolumeError> {
        let [_, ny, nz] = runs.dims;
        let count = runs.runs.len();
        let mut sets = Sets::of(count)?;
        for row in 0..ny * nz {
            if row % ny > 0 {
                sets.join_touching(&runs.runs, runs.row(row), runs.row(row - 1));
            }
            if row >= ny {
                sets.join_touching(&runs.runs, runs.row(row), runs.row(row - ny));
            }
        }
        let mut voxels = room(count)?;
        voxels.resize(count, 0);
        let first = sets.into_roots(|run, root| voxels[root] += runs.runs[run].len());
        Ok(Self { first, voxels })
    }

    /// The first run of the largest component, and of those the first.
    fn largest(&self) -> Option<u32> {
        let mut largest = None;
        let mut most = 0;
        for (place, &voxels) in (0..).zip(&self.voxels) {
            if voxels > most {
                (largest, most) = (Some(place), voxels);
            }
        }
        largest
    }
}

/// Sets of runs. Each run points to one before it in its set; the first points to itself.
struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    /// Each run alone.
    fn of(count: usize) -> Result<Self, VolumeError> {
        // That many have no room in any memory.
        let last = u32::try_from(count).map_err(|_| no_room::<Run>(count))?;
        let mut parent = room(count)?;
        parent.extend(0..last);
        Ok(Self { parent })
    }

    /// Of each run the first one of its set; each is told with that on the way.
    #[inline]
    fn into_roots(self, mut each: impl FnMut(usize, usize)) -> Vec<u32> {
        let mut parent = self.parent;
        for place in 0..parent.len() {
            // A parent comes before its runs, so its own is already the root.
            let root = parent[parent[place] as usize];
            parent[place] = root;
            each(place, root as usize);
        }
        parent
    }

    /// The first run of the set. Paths are halved on the way.
    fn root(&mut self, mut run: u32) -> u32 {
        loop {
            let parent = self.parent[run as usize];
            if parent == run {
                return run;
            }
            let above = self.parent[parent as usize];
            self.parent[run as usize] = above;
            run = above;
        }
    }

    fn join(&mut self, a: usize, b: usize) {
        // They have places as runs are counted.
        let (a, b) = (self.root(a as u32), self.root(b as u32));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// Joins the runs of two neighbouring rows that share an x.
    fn join_touching(&mut self, runs: &[Run], a: Range<usize>, b: Range<usize>) {
        for_each_touching((runs, a), (runs, b), |one, other| self.join(one, other));
    }
}

/// Every two runs of two rows that share an x. Each row is given as some runs and the places of its own among them, which
/// is what is told.
#[inline]
fn for_each_touching(
    (runs, row): (&[Run], Range<usize>),
    (others, other_row): (&[Run], Range<usize>),
    mut each: impl FnMut(usize, usize),
) {
    let (mut i, mut j) = (row.start, other_row.start);
    while i < row.end && j < other_row.end {
        let (one, other) = (runs[i], others[j]);
        if one.begin < other.end && other.begin < one.end {
            each(i, j);
        }
        if one.end < other.end {
            i += 1;
        } else {
            j += 1;
        }
    }
}

/// An empty list with room for `len`, or an error where the machine has no memory for it.
fn room<T>(len: usize) -> Result<Vec<T>, VolumeError> {
    let mut list = Vec::new();
    list.try_reserve_exact(len).map_err(|_| no_room::<T>(len))?;
    Ok(list)
}

fn no_room<T>(len: usize) -> VolumeError {
    VolumeError::Memory {
        voxels: len,
        bytes_per_voxel: size_of::<T>(),
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use ndarray_ndimage::{Kernel3d, label};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};

    use super::*;

    fn voxels(dims: [usize; 3], inside: &[[usize; 3]]) -> Mask {
        Mask::from_fn(dims, |x, y, z| inside.contains(&[x, y, z])).unwrap()
    }

    /// Each voxel inside with a chance of `share`.
    fn random(dims: [usize; 3], share: f64, rng: &mut ChaCha8Rng) -> Mask {
        let [nx, ny, nz] = dims;
        let drawn = Array3::from_shape_simple_fn((nz, ny, nx), || {
            f64::from(rng.next_u32()) < share * f64::from(u32::MAX)
        });
        Mask::from_fn(dims, |x, y, z| drawn[[z, y, x]]).unwrap()
    }

    /// The largest component and all sizes, from a volume of labels.
    fn by_labels(mask: &Mask) -> (Mask, Vec<usize>) {
        let [nx, ny, nz] = mask.dims();
        let inside = Array3::from_shape_fn((nz, ny, nx), |(z, y, x)| mask.contains(x, y, z));
        let (labels, count) = label::<u32>(&inside, &Kernel3d::Star.generate());
        // In the order in which they are met.
        let mut met: Vec<(u32, usize)> = Vec::new();
        for &label in labels.iter().filter(|&&label| label > 0) {
            match met.iter_mut().find(|(known, _)| *known == label) {
                Some((_, voxels)) => *voxels += 1,
                None => met.push((label, 1)),
            }
        }
        assert_eq!(met.len(), count);
        let largest = met.iter().map(|&(_, voxels)| voxels).max();
        let first = met.iter().find(|&&(_, voxels)| Some(voxels) == largest);
        let kept = first.map_or(0, |&(label, _)| label);
        let kept = Mask::from_fn(mask.dims(), |x, y, z| kept > 0 && labels[[z, y, x]] == kept);
        let mut sizes: Vec<usize> = met.iter().map(|&(_, voxels)| voxels).collect();
        sizes.sort_unstable_by(|a, b| b.cmp(a));
        (kept.unwrap(), sizes)
    }

    #[test]
    fn as_a_volume_of_labels_has_it() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut cut = 0;
        for dims in [[1, 1, 1], [130, 9, 7], [64, 8, 8], [5, 30, 20], [63, 1, 12]] {
            // About where a cubic lattice begins to hang together (0.31), and on both sides of it.
            for share in [0.0, 0.02, 0.1, 0.25, 0.31, 0.4, 0.7, 0.97, 1.0] {
                for _ in 0..4 {
                    let mask = random(dims, share, &mut rng);
                    let (largest, sizes) = by_labels(&mask);
                    assert_eq!(
                        keep_largest(mask.clone()).unwrap(),
                        largest,
                        "{dims:?}, {share}"
                    );
                    assert_eq!(component_sizes(&mask).unwrap(), sizes, "{dims:?}, {share}");
                    cut += usize::from(largest != mask && sizes[0] > 1);
                }
            }
        }
        assert!(cut > 50, "only {cut} masks had anything to leave out");
    }

    #[test]
    fn with_what_is_known_outside_a_part_it_is_the_same() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let (mut grew, mut cut) = (0, 0);
        for dims in [[1, 1, 1], [130, 9, 7], [64, 8, 8], [5, 30, 20], [63, 1, 12]] {
            let [_, ny, nz] = dims;
            for share in [0.0, 0.02, 0.1, 0.25, 0.31, 0.4, 0.7, 0.97] {
                for _ in 0..8 {
                    let before = random(dims, share, &mut rng);
                    let mut range = |n: usize| {
                        let mut end = || rng.next_u32() as usize % (n + 1);
                        let (one, other) = (end(), end());
                        one.min(other)..one.max(other)
                    };
                    let part = Rows {
                        y: range(ny),
                        z: range(nz),
                    };
                    let outside = Outside::new(&before, part.clone()).unwrap();
                    for share in [share, 0.0, 0.5, 1.0] {
                        let other = random(dims, share, &mut rng);
                        let mask = Mask::from_fn(dims, |x, y, z| match part.contain(y, z) {
                            true => other.contains(x, y, z),
                            false => before.contains(x, y, z),
                        });
                        let mask = mask.unwrap();
                        let expected = keep_largest(mask.clone()).unwrap();
                        grew += usize::from(expected.count() > outside.largest());
                        cut += usize::from(expected != mask);
                        let found = outside.keep_largest(mask).unwrap();
                        assert_eq!(found, expected, "{dims:?}, {share}, {part:?}");
                    }
                }
            }
        }
        assert!(grew > 100 && cut > 100, "{grew}, {cut}");
    }

    impl Outside {
        fn largest(&self) -> usize {
            let voxels = self.pieces.iter().map(|piece| piece.voxels);
            voxels.max().unwrap_or_default()
        }
    }

    #[test]
    fn voxels_hang_together_by_faces_only() {
        let edge_and_corner = [[1, 1, 1], [2, 2, 1], [2, 1, 2], [3, 3, 3]];
        assert_eq!(
            component_sizes(&voxels([5; 3], &edge_and_corner)).unwrap(),
            [1; 4]
        );
        let faces = [[1, 1, 1], [2, 1, 1], [2, 2, 1], [2, 2, 2]];
        assert_eq!(component_sizes(&voxels([5; 3], &faces)).unwrap(), [4]);
    }

    #[test]
    fn of_equals_the_first_in_z_y_x_is_kept() {
        // The second begins at a smaller x and y.
        let tied = voxels([70, 4, 4], &[[68, 3, 0], [69, 3, 0], [0, 0, 1], [1, 0, 1]]);
        let first = voxels([70, 4, 4], &[[68, 3, 0], [69, 3, 0]]);
        assert_eq!(keep_largest(tied.clone()).unwrap(), first);
        // Whichever of them is in the part.
        for z in [0..1, 1..2] {
            let outside = Outside::new(&tied, Rows { y: 0..4, z }).unwrap();
            assert_eq!(outside.keep_largest(tied.clone()).unwrap(), first);
        }
    }

    #[test]
    fn arms_that_meet_late_are_one() {
        // A fork whose arms are met one after another, and joined by the last row.
        let fork = Mask::from_fn([129, 6, 1], |x, y, _| x.is_multiple_of(2) || y == 5).unwrap();
        assert_eq!(component_sizes(&fork).unwrap(), [65 * 5 + 129]);
        assert_eq!(keep_largest(fork.clone()).unwrap(), fork);
    }

    #[test]
    fn of_nothing_nothing_is_kept() {
        let empty = Mask::empty([70, 3, 2]).unwrap();
        assert_eq!(keep_largest(empty.clone()).unwrap(), empty);
        assert!(component_sizes(&empty).unwrap().is_empty());
    }
}
