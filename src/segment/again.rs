//! The object in volumes that differ from one that was segmented in a part of it.

use std::ops::Range;

use super::components::{Outside, Rows};
use super::threshold::{above, above_in};
use super::{keep_largest, segment};
use crate::volume::{Mask, Sample, Volume, VolumeError};

/// The object in a volume, and what it takes to find those in volumes that differ from it in a part alone, for about
/// the price of that part.
#[derive(Debug)]
pub struct Segmented {
    threshold_hu: f64,
    largest: bool,
    object: Mask,
    around: Option<Around>,
}

/// What does not change.
#[derive(Debug)]
struct Around {
    /// The rows that do.
    part: Rows,
    /// All voxels of the threshold or more.
    all: Mask,
    /// How they hang together, where only the largest piece is kept.
    outside: Option<Outside>,
}

impl Segmented {
    /// As [`segment`]. `part` is where other volumes will differ: voxels along x, y and z; none where there will be none,
    /// or nothing is known of them.
    ///
    /// # Errors
    /// As [`segment`].
    pub fn new<T: Sample>(
        volume: &Volume<T>,
        threshold_hu: f64,
        largest: bool,
        part: Option<[Range<usize>; 3]>,
    ) -> Result<Self, VolumeError> {
        let [_, ny, nz] = volume.grid().dims();
        let inside = |[_, y, z]: &[Range<usize>; 3]| y.end <= ny && z.end <= nz;
        let all = above(volume, threshold_hu)?;
        let (object, around) = match part.filter(inside) {
            None if largest => (keep_largest(all)?, None),
            None => (all, None),
            Some([_, y, z]) => {
                let part = Rows { y, z };
                let outside = match largest {
                    true => Some(Outside::new(&all, part.clone())?),
                    false => None,
                };
                let object = all.try_clone()?;
                let object = match &outside {
                    Some(outside) => outside.keep_largest(object)?,
                    None => object,
                };
                (object, Some(Around { part, all, outside }))
            }
        };
        Ok(Self {
            threshold_hu,
            largest,
            object,
            around,
        })
    }

    /// The object.
    pub fn object(&self) -> &Mask {
        &self.object
    }

    /// The object in a volume of the same grid that differs from the first one in no voxel outside the part: what
    /// [`segment`] finds in it.
    ///
    /// # Errors
    /// As [`segment`].
    pub fn again<T: Sample>(&self, volume: &Volume<T>) -> Result<Mask, VolumeError> {
        let around = self.around.as_ref();
        let around = around.filter(|around| around.all.dims() == volume.grid().dims());
        let Some(Around { part, all, outside }) = around else {
            return segment(volume, self.threshold_hu, self.largest);
        };
        let mut object = all.try_clone()?;
        above_in(&mut object, volume, self.threshold_hu, |y, z| {
            part.contain(y, z)
        });
        match outside {
            Some(outside) => outside.keep_largest(object),
            None => Ok(object),
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::s;

    use super::*;
    use crate::phantom::Phantom;
    use crate::space::Grid;

    #[test]
    fn what_changed_in_a_part_is_found_as_if_all_were_looked_at() {
        let spacing = Phantom::default_grid().unwrap().spacing() * 4.0;
        let grid = Grid::axis_aligned([80, 80, 38], spacing.to_array()).unwrap();
        let before = Phantom::lee2001().render(&grid).unwrap();
        // In front of the face and in it: a bar to a table, a piece that hangs in the air, a hole.
        let part = [0..80, 0..60, 4..20];
        let mut table = before.clone();
        table.samples_mut().slice_mut(s![.., 0, ..]).fill(100);
        let after = |from: &Volume<i16>| {
            let mut after = from.clone();
            let mut samples = after.samples_mut();
            samples.slice_mut(s![5..7, 1..30, 40..42]).fill(60);
            samples.slice_mut(s![15..18, 2..4, 5..70]).fill(60);
            samples.slice_mut(s![10..12, 20..60, 30..50]).fill(-1000);
            after
        };
        let mut joined = 0;
        for before in [&before, &table] {
            for largest in [true, false] {
                for hu in [-500.0, 5000.0, f64::NAN] {
                    let known = |part| Segmented::new(before, hu, largest, part).unwrap();
                    let of_before = segment(before, hu, largest).unwrap();
                    let after = after(before);
                    let of_after = segment(&after, hu, largest).unwrap();
                    for part in [Some(part.clone()), Some([0..80, 0..80, 0..38]), None] {
                        let known = known(part);
                        assert_eq!(known.object(), &of_before);
                        assert_eq!(known.again(before).unwrap(), of_before);
                        assert_eq!(known.again(&after).unwrap(), of_after);
                    }
                    // The table is part of the head where the bar joins them.
                    joined += usize::from(
                        of_after.contains(3, 0, 30) && largest && !of_before.contains(3, 0, 30),
                    );
                    // A part that is not in the grid is of another volume.
                    let other = known(Some([0..80, 0..81, 4..20]));
                    assert_eq!(other.again(&after).unwrap(), of_after);
                }
            }
        }
        assert_eq!(joined, 1);
        let smaller = Grid::axis_aligned([40, 40, 19], (spacing * 2.0).to_array()).unwrap();
        let smaller = Phantom::lee2001().render(&smaller).unwrap();
        let known = Segmented::new(&before, -500.0, true, Some(part)).unwrap();
        let expected = segment(&smaller, -500.0, true).unwrap();
        assert_eq!(known.again(&smaller).unwrap(), expected);
    }
}
