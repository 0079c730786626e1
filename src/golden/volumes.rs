//! Volumes and displacements held against those that are kept.

use rayon::prelude::*;

use super::difference::{Cell, Difference, Kind};
use super::tolerance::Volumes;
use crate::volume::Volume;

/// How far two volumes, or two displacements, are apart.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Off {
    /// How many voxels, or components, are off by more than they may be.
    pub count: u64,
    /// The furthest that one of these is off, HU or mm; infinite where one is not a number.
    pub worst: f64,
}

impl Off {
    fn and(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            worst: self.worst.max(other.worst),
        }
    }
}

/// Compares two volumes of one size in Hounsfield units. A voxel is off where no voxel of the other volume that is
/// at most `radius` away along each axis is within `hu` of it; this is asked of the voxels of both volumes, so
/// that neither something that came nor something that went is overlooked.
///
/// The three numbers are those of ITK's `TestingComparisonImageFilter` (`DifferenceThreshold`, `ToleranceRadius`,
/// and the number of pixels that may differ), which asks one way only. Beyond the volume's faces there is nothing to agree
/// with. A value that is not a number agrees with none.
pub fn compare(expected: &Volume<f32>, found: &Volume<f32>, tolerance: &Volumes) -> Option<Off> {
    if expected.grid().dims() != found.grid().dims() {
        return None;
    }
    let plane = found.plane_len().max(1);
    let planes = expected
        .as_slice()
        .par_chunks(plane)
        .zip(found.as_slice().par_chunks(plane));
    let off = planes.enumerate().map(|(z, (a, b))| {
        let mut off = Off::default();
        for (index, (&a, &b)) in a.iter().zip(b).enumerate() {
            // Nearly all of them.
            if is_near(a, b, tolerance.hu) {
                continue;
            }
            let at = z * plane + index;
            if tolerance.radius == 0
                || !is_near_any(a, found, at, tolerance)
                || !is_near_any(b, expected, at, tolerance)
            {
                off = off.and(one(f64::from(a), f64::from(b)));
            }
        }
        off
    });
    Some(off.reduce(Off::default, Off::and))
}

/// Compares as many components of two displacements as there are, mm.
pub fn compare_components(expected: &[f32], found: &[f32], tolerance: &Volumes) -> Off {
    let pairs = expected.iter().zip(found);
    let off = pairs.filter(|(a, b)| !is_near(**a, **b, tolerance.mm));
    off.fold(Off::default(), |off, (a, b)| {
        off.and(one(f64::from(*a), f64::from(*b)))
    })
}

/// Both parts of one comparison.
pub fn together(one: Off, other: Off) -> Off {
    one.and(other)
}

fn one(a: f64, b: f64) -> Off {
    let apart = (a - b).abs();
    Off {
        count: 1,
        worst: if apart.is_nan() { f64::INFINITY } else { apart },
    }
}

/// False of what is not a number.
fn is_near(a: f32, b: f32, allowed: f64) -> bool {
    (f64::from(a) - f64::from(b)).abs() <= allowed
}

/// Whether a voxel of `volume` around place `at` is near `value`.
fn is_near_any(value: f32, volume: &Volume<f32>, at: usize, tolerance: &Volumes) -> bool {
    let [nx, ny, nz] = volume.grid().dims();
    let samples = volume.as_slice();
    let around = |place: usize, length: usize| {
        let radius = tolerance.radius as usize;
        place.saturating_sub(radius)..(place + radius + 1).min(length)
    };
    let (x, y, z) = (at % nx, at / nx % ny, at / (nx * ny));
    around(z, nz).any(|z| {
        around(y, ny).any(|y| {
            let row = (z * ny + y) * nx;
            let columns = around(x, nx);
            let row = samples.get(row + columns.start..row + columns.end);
            let mut row = row.into_iter().flatten();
            row.any(|near| is_near(value, *near, tolerance.hu))
        })
    })
}

/// The difference of samples that are not all the same, by their SHA-256.
pub fn hash_row(name: String, expected: &str, found: &str) -> Difference {
    Difference {
        kind: Kind::Volume,
        measure: name,
        unit: "SHA-256 of the samples".to_owned(),
        expected: short(expected),
        found: short(found),
        difference: Cell::Empty,
        tolerance: Cell::text("the same"),
    }
}

/// The difference of what a file says of its samples: their number, type, grid and position.
pub fn layout_row(name: String, expected: &str, found: &str) -> Difference {
    Difference {
        unit: "SHA-256 of size, type and position".to_owned(),
        ..hash_row(name, expected, found)
    }
}

/// The first digits of a digest: enough to tell two apart.
fn short(digest: &str) -> Cell {
    Cell::text(digest.get(..12).unwrap_or(digest))
}

impl Off {
    /// As a row of a table, where more is off than may be: of a volume, or of a displacement.
    pub fn row(
        self,
        name: String,
        is_displacement: bool,
        tolerance: &Volumes,
    ) -> Option<Difference> {
        if self.count <= tolerance.voxels {
            return None;
        }
        let (what, allowed, unit) = if is_displacement {
            ("components", tolerance.mm, "mm")
        } else {
            ("voxels", tolerance.hu, "HU")
        };
        let within = match tolerance.radius {
            radius @ 1.. if !is_displacement => format!(" within radius {radius}"),
            _ => String::new(),
        };
        Some(Difference {
            kind: Kind::Volume,
            measure: name,
            unit: format!("{what} off by more than {allowed} {unit}{within}"),
            expected: Cell::Number(0.0),
            found: Cell::Number(self.count as f64),
            difference: Cell::Text(format!("up to {} {unit}", Cell::Number(self.worst))),
            tolerance: Cell::Number(tolerance.voxels as f64),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::golden::Settings;
    use crate::space::{Grid, LpsPoint};
    use crate::volume::Rescale;

    fn volume(voxels: &[([usize; 3], f32)]) -> Volume<f32> {
        let spacing = [1.0; 3];
        let grid = Grid::new(
            [9, 8, 7],
            spacing,
            LpsPoint::new(0.0, 0.0, 0.0),
            glam::DMat3::IDENTITY,
        );
        let mut volume = Volume::zeros(grid.unwrap(), Rescale::NONE).unwrap();
        for ([x, y, z], value) in voxels {
            volume.samples_mut()[[*z, *y, *x]] = *value;
        }
        volume
    }

    fn off(a: &[([usize; 3], f32)], b: &[([usize; 3], f32)], text: &str) -> Off {
        let settings = Settings::parse(&format!("[volumes]\n{text}")).unwrap();
        let there = compare(&volume(a), &volume(b), &settings.volumes).unwrap();
        let back = compare(&volume(b), &volume(a), &settings.volumes).unwrap();
        assert_eq!(there, back);
        there
    }

    #[test]
    fn a_voxel_may_be_off_by_so_many_hu() {
        let (a, b) = ([([4, 4, 3], 10.0)], [([4, 4, 3], 12.0)]);
        assert_eq!(off(&a, &b, "hu = 2.0").count, 0);
        let found = off(&a, &b, "hu = 1.9");
        assert_eq!((found.count, found.worst), (1, 2.0));
        assert_eq!(off(&[], &[([4, 4, 3], f32::NAN)], "hu = 1e9").count, 1);
    }

    #[test]
    fn a_radius_forgives_what_moved_and_not_what_came_or_went() {
        let here = [([4, 4, 3], 500.0)];
        for (there, radius, count) in [
            ([5, 4, 3], 0, 2),
            ([5, 4, 3], 1, 0),
            ([5, 5, 4], 1, 0),
            ([3, 3, 2], 1, 0),
            ([6, 4, 3], 1, 2),
            ([6, 4, 3], 2, 0),
            ([4, 4, 6], 2, 2),
            ([4, 4, 6], 3, 0),
        ] {
            let found = off(&here, &[(there, 500.0)], &format!("radius = {radius}"));
            assert_eq!(found.count, count, "{there:?} within {radius}");
        }
        // One that is gone, which ITK's direction alone would not see in one of the two orders.
        assert_eq!(off(&here, &[], "radius = 4").count, 1);
        // The HU count as well.
        assert_eq!(off(&here, &[([5, 4, 3], 502.0)], "radius = 1").count, 2);
        assert_eq!(
            off(&here, &[([5, 4, 3], 502.0)], "radius = 1\nhu = 2").count,
            0
        );
    }

    #[test]
    fn rows_do_not_join_at_the_faces() {
        // The last voxel of a row and the first of the next are neighbours in memory alone.
        let found = off(&[([8, 4, 3], 500.0)], &[([0, 5, 3], 500.0)], "radius = 1");
        assert_eq!(found.count, 2);
        let found = off(&[([0, 7, 3], 500.0)], &[([0, 0, 4], 500.0)], "radius = 1");
        assert_eq!(found.count, 2);
        assert_eq!(
            off(&[([0, 0, 0], 1e3)], &[([1, 1, 1], 1e3)], "radius = 4").count,
            0
        );
    }

    #[test]
    fn so_many_voxels_may_be_off() {
        let settings = Settings::parse("[volumes]\nvoxels = 2\nradius = 1").unwrap();
        let row = |count| Off { count, worst: 3.0 }.row("v".to_owned(), false, &settings.volumes);
        assert_eq!(row(2), None);
        assert_eq!(
            row(3).unwrap().row(),
            [
                "v",
                "voxels off by more than 1 HU within radius 1",
                "0",
                "3",
                "up to 3 HU",
                "2"
            ]
        );
    }

    #[test]
    fn volumes_of_two_sizes_are_not_compared() {
        let grid = Grid::new(
            [9, 8, 6],
            [1.0; 3],
            LpsPoint::new(0.0, 0.0, 0.0),
            glam::DMat3::IDENTITY,
        );
        let small = Volume::zeros(grid.unwrap(), Rescale::NONE).unwrap();
        assert_eq!(compare(&volume(&[]), &small, &Volumes::default()), None);
    }

    #[test]
    fn components_of_displacements_are_compared_in_mm() {
        let tolerance = Volumes::default();
        let found = compare_components(&[0.0, 1.0, 2.0], &[0.0005, 1.0, 2.5], &tolerance);
        assert_eq!((found.count, found.worst), (1, 0.5));
        let found = compare_components(&[f32::NAN], &[f32::NAN], &tolerance);
        assert_eq!((found.count, found.worst), (1, f64::INFINITY));
        let row = found.row("displacement.nii.gz".to_owned(), true, &tolerance);
        assert_eq!(row.unwrap().unit, "components off by more than 0.001 mm");
    }
}
