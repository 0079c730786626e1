//! The bodies between the skin before and after an operation: what is added, and what is taken away.
//!
//! These are skin-difference solids: all that lies between two skins, as far as the map moved them. None is the
//! design of an implant or of a resection.
//!
//! Tissue is where HU, trilinear between voxels, are at least the threshold. A body can be thinner than a voxel, and
//! between two voxels outside it there would be nothing. So the two volumes are sampled more finely than they are
//! stored, and vertices are put where the one skin or the other is crossed, which is exact along each axis.

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::body::{Mesh, MeshError, Topology, area, room};
use super::extract::extract;
use crate::space::{Grid, GridPoint, LpsPoint};
use crate::surface::SurfaceDistance;
use crate::volume::{Mask, Sample, Volume, VolumeError};

/// Voxels are divided until samples are no further apart than this, mm, but into no more than [`MAX_PARTS`]
/// along an axis.
const STEP_MM: f64 = 0.25;
const MAX_PARTS: usize = 4;

/// The most samples: beyond, voxels are divided into fewer parts.
const MAX_SAMPLES: usize = 100_000_000;

/// What is left out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Least {
    /// Bodies that are nowhere thicker, mm.
    pub thickness_mm: f64,
    /// Bodies that are no larger, mm³.
    pub volume_mm3: f64,
}

impl Default for Least {
    fn default() -> Self {
        Self {
            thickness_mm: 0.1,
            volume_mm3: 1.0,
        }
    }
}

/// The skin before or after an operation.
#[derive(Debug, Clone, Copy)]
pub struct Skin<'a, T> {
    /// What it was found in.
    pub volume: &'a Volume<T>,
    /// The object that it bounds, by the threshold.
    pub mask: &'a Mask,
    /// Distances to it.
    pub distance: SurfaceDistance<'a>,
}

/// The bodies of one kind.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// Closed; empty where there is no body.
    pub mesh: Mesh,
    /// What was measured on it.
    pub record: SolidRecord,
}

/// What a solid measures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SolidRecord {
    /// Bodies that are kept. None of them: there is no file.
    pub bodies: usize,
    /// Their volume, mm³, by the divergence theorem.
    pub volume_mm3: f64,
    /// Distance between the two skins over the solid's surface: smallest (at its rim, next to nothing), mean by area,
    /// and largest, mm.
    pub thickness_mm: Option<Thickness>,
    /// Centre of mass, LPS mm.
    pub centroid_lps_mm: Option<LpsPoint>,
    /// What was left out.
    pub least: Least,
    /// Bodies that were left out.
    pub dropped_bodies: usize,
    /// Their volume, mm³: what triangles enclose, and so less than there is where it is thinner than `step_mm`.
    pub dropped_mm3: f64,
    /// All that lies between the two skins, mm³, by counting samples: `volume_mm3`, what was left out, and what of
    /// the film around the bodies is thinner than samples are apart, and so in no mesh.
    pub between_mm3: f64,
    /// Distance between samples along x, y and z, mm: what is thinner may be missing at the rim.
    pub step_mm: [f64; 3],
    /// Triangles of the mesh.
    pub triangles: usize,
    /// What keeps the mesh from being closed: all zero.
    pub topology: Topology,
}

/// A range of distances, mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Thickness {
    /// The smallest.
    pub min: f64,
    /// The mean over the area.
    pub mean: f64,
    /// The largest.
    pub max: f64,
}

/// The bodies that are in `skin` and not in `other`, both by `threshold_hu`: what was added, of the skin after and
/// the one before; what was taken away, the other way round.
///
/// # Errors
/// [`MeshError`] where the two are not on one grid, or the machine has no memory.
pub fn solid<T: Sample>(
    skin: &Skin<'_, T>,
    other: &Skin<'_, T>,
    threshold_hu: f64,
    least: Least,
) -> Result<Solid, MeshError> {
    let grid = skin.volume.grid();
    for dims in [
        skin.mask.dims(),
        other.volume.grid().dims(),
        other.mask.dims(),
    ] {
        if dims != grid.dims() {
            return Err(VolumeError::Shape {
                found: dims,
                expected: grid.dims(),
            }
            .into());
        }
    }
    let Some(between) = Between::new(skin, other, threshold_hu)? else {
        let parts = grid.spacing().map(|spacing| parts(spacing) as f64);
        let step = grid.spacing() / parts;
        let kept = Kept::default();
        return Ok(kept.into_solid(grid, skin, other, least, step));
    };
    let mask = between.mask()?;
    let step = between.step(grid);
    let mut kept = Kept {
        between_mm3: mask.count() as f64 * step.element_product(),
        ..Kept::default()
    };
    for shell in between.mesh(&mask, grid)?.components() {
        let volume = shell.volume();
        let thickness = thickness(&shell, skin, other);
        let thick = thickness.is_none_or(|thickness| thickness.max >= least.thickness_mm);
        if thick && volume.abs() >= least.volume_mm3 {
            kept.shells.push(shell);
        } else if volume > 0.0 {
            kept.dropped_bodies += 1;
            kept.dropped_mm3 += volume;
        }
    }
    Ok(kept.into_solid(grid, skin, other, least, step))
}

/// Parts that a voxel is divided into along an axis.
fn parts(spacing: f64) -> usize {
    ((spacing / STEP_MM).ceil() as usize).clamp(1, MAX_PARTS)
}

#[derive(Default)]
struct Kept {
    shells: Vec<Mesh>,
    dropped_bodies: usize,
    dropped_mm3: f64,
    between_mm3: f64,
}

impl Kept {
    fn into_solid<T: Sample>(
        self,
        grid: &Grid,
        skin: &Skin<'_, T>,
        other: &Skin<'_, T>,
        least: Least,
        step: DVec3,
    ) -> Solid {
        // A hollow body has a shell inside it, of negative volume.
        let bodies = self.shells.iter().filter(|shell| shell.volume() > 0.0);
        let bodies = bodies.count();
        let mesh = Mesh::joined(self.shells);
        let centroid = mesh.centroid();
        let record = SolidRecord {
            bodies,
            // Of no triangles the sum is -0.
            volume_mm3: mesh.volume() + 0.0,
            thickness_mm: thickness(&mesh, skin, other),
            centroid_lps_mm: centroid.map(|centre| grid.grid_to_lps(centre)),
            least,
            dropped_bodies: self.dropped_bodies,
            dropped_mm3: self.dropped_mm3,
            between_mm3: self.between_mm3,
            step_mm: step.to_array(),
            triangles: mesh.triangles().len(),
            topology: mesh.topology(),
        };
        Solid { mesh, record }
    }
}

/// Every vertex lies on one of the skins; the distance to the other is the thickness there. None where no vertex
/// has one in reach.
fn thickness<T: Sample>(mesh: &Mesh, skin: &Skin<'_, T>, other: &Skin<'_, T>) -> Option<Thickness> {
    let at = |point: &GridPoint| {
        let [one, two] = [skin, other].map(|skin| skin.distance.signed(*point));
        Some(one?.abs().max(two?.abs()))
    };
    let thickness: Vec<Option<f64>> = mesh.points().par_iter().map(at).collect();
    let mut found = Thickness {
        min: f64::INFINITY,
        mean: 0.0,
        max: 0.0,
    };
    let (mut sum, mut weights) = (0.0, 0.0);
    for triangle in mesh.triangles() {
        let weight = area(mesh.corners(triangle));
        for &point in triangle {
            if let Some(&Some(thickness)) = thickness.get(point as usize) {
                found.min = found.min.min(thickness);
                found.max = found.max.max(thickness);
                sum += thickness * weight;
                weights += weight;
            }
        }
    }
    found.mean = sum / weights;
    (weights > 0.0).then_some(found)
}

/// Two volumes where they differ, and the finer lattice that they are sampled on.
struct Between {
    /// First voxel of the part of the grid that is looked at, and its voxels.
    first: [usize; 3],
    dims: [usize; 3],
    /// HU above the threshold: of what the body is in, and of what it is not in.
    inside: Vec<f32>,
    outside: Vec<f32>,
    /// Cells that the body can be in, by their first voxel.
    cells: Mask,
    /// Parts that a cell is divided into.
    parts: [usize; 3],
}

impl Between {
    /// None where the two are the same.
    fn new<T: Sample>(
        skin: &Skin<'_, T>,
        other: &Skin<'_, T>,
        threshold_hu: f64,
    ) -> Result<Option<Self>, MeshError> {
        let Some((first, last)) = differing(skin, other) else {
            return Ok(None);
        };
        let dims = [0, 1, 2].map(|axis| last[axis] - first[axis] + 1);
        let crop = |of: &Skin<'_, T>| above_threshold(of, threshold_hu, first, dims);
        let (inside, outside) = (crop(skin)?, crop(other)?);
        let place = |x: usize, y: usize, z: usize| (z * dims[1] + y) * dims[0] + x;
        let cells = Mask::from_fn(dims, |x, y, z| {
            let mut found = [false; 2];
            for corner in 0..8 {
                let near = |axis: usize, n: usize| (n + (corner >> axis & 1)).min(dims[axis] - 1);
                let place = place(near(0, x), near(1, y), near(2, z));
                found[0] |= inside[place] >= 0.0;
                found[1] |= outside[place] < 0.0;
            }
            found == [true; 2]
        })?;
        let spacing = skin.volume.grid().spacing().to_array();
        let mut parts = spacing.map(parts);
        let samples = |parts: [usize; 3]| -> usize {
            let fine = |axis: usize| (dims[axis] - 1).saturating_mul(parts[axis]) + 1;
            (0..3).fold(1, |all, axis| all.saturating_mul(fine(axis)))
        };
        while samples(parts) > MAX_SAMPLES && parts.iter().any(|&parts| parts > 1) {
            parts = parts.map(|parts| parts.saturating_sub(1).max(1));
        }
        Ok(Some(Self {
            first,
            dims,
            inside,
            outside,
            cells,
            parts,
        }))
    }

    /// Distance between samples, mm.
    fn step(&self, grid: &Grid) -> DVec3 {
        grid.spacing() / DVec3::from_array(self.parts.map(|parts| parts as f64))
    }

    /// The samples between the two skins.
    fn mask(&self) -> Result<Mask, VolumeError> {
        let fine = [0, 1, 2].map(|axis| (self.dims[axis] - 1) * self.parts[axis] + 1);
        Mask::from_fn(fine, |x, y, z| {
            let cell = [0, 1, 2].map(|axis| [x, y, z][axis] / self.parts[axis]);
            if !self.cells.contains(cell[0], cell[1], cell[2]) {
                return false;
            }
            let [inside, outside] = self.values([x, y, z]);
            inside >= 0.0 && outside < 0.0
        })
    }

    /// The bodies around the samples of a mask.
    fn mesh(&self, mask: &Mask, grid: &Grid) -> Result<Mesh, MeshError> {
        // Where the nearer of the two skins is: the body ends at either.
        let crossing = |from: [usize; 3], to: [usize; 3]| {
            let (from, to) = (self.values(from), self.values(to));
            let root = |which: usize| from[which] / (from[which] - to[which]);
            let mut share = 1.0;
            if to[0] < 0.0 {
                share = root(0).min(share);
            }
            if to[1] >= 0.0 {
                share = root(1).min(share);
            }
            share
        };
        let first = DVec3::from_array(self.first.map(|n| n as f64)) * grid.spacing();
        extract(mask, self.step(grid), GridPoint(first), &crossing)
    }

    /// Of the two volumes at a sample, trilinear.
    fn values(&self, at: [usize; 3]) -> [f64; 2] {
        let cell = [0, 1, 2].map(|axis| at[axis] / self.parts[axis]);
        let share =
            [0, 1, 2].map(|axis| (at[axis] % self.parts[axis]) as f64 / self.parts[axis] as f64);
        let mut values = [0.0; 2];
        for corner in 0..8 {
            let mut weight = 1.0;
            let mut voxel = cell;
            for axis in 0..3 {
                let far = corner >> axis & 1;
                voxel[axis] += far;
                weight *= if far == 1 {
                    share[axis]
                } else {
                    1.0 - share[axis]
                };
            }
            // The last sample of an axis has no voxel beyond it, nor a weight for one.
            if weight > 0.0 {
                let place = (voxel[2] * self.dims[1] + voxel[1]) * self.dims[0] + voxel[0];
                let of = |field: &[f32]| field.get(place).copied().map_or(0.0, f64::from);
                values[0] += of(&self.inside) * weight;
                values[1] += of(&self.outside) * weight;
            }
        }
        values
    }
}

/// First and last voxel of the box in which two skins can differ, with a voxel around it.
fn differing<T: Sample>(
    one: &Skin<'_, T>,
    other: &Skin<'_, T>,
) -> Option<([usize; 3], [usize; 3])> {
    let dims = one.volume.grid().dims();
    let [nx, ny, _] = dims;
    let (a, b) = (one.volume.as_slice(), other.volume.as_slice());
    let rows = a
        .par_chunks_exact(nx)
        .zip(b.par_chunks_exact(nx))
        .enumerate();
    let boxes = rows.filter_map(|(row, (a, b))| {
        let (y, z) = (row % ny, row / ny);
        let same_mask = one.mask.row(y, z) == other.mask.row(y, z);
        let differs = |x: &usize| {
            a[*x] != b[*x]
                || !same_mask && one.mask.contains(*x, y, z) != other.mask.contains(*x, y, z)
        };
        let first = (0..nx).find(differs)?;
        let last = (0..nx).rev().find(differs)?;
        Some(([first, y, z], [last, y, z]))
    });
    let union = |a: ([usize; 3], [usize; 3]), b: ([usize; 3], [usize; 3])| {
        let low = [0, 1, 2].map(|axis| a.0[axis].min(b.0[axis]));
        let high = [0, 1, 2].map(|axis| a.1[axis].max(b.1[axis]));
        (low, high)
    };
    let (first, last) = boxes.reduce_with(union)?;
    let first = first.map(|n| n.saturating_sub(1));
    Some((
        first,
        [0, 1, 2].map(|axis| (last[axis] + 1).min(dims[axis] - 1)),
    ))
}

/// HU above the threshold in a box. What reaches it and is not of the object (a headrest) is as far below.
fn above_threshold<T: Sample>(
    of: &Skin<'_, T>,
    threshold_hu: f64,
    first: [usize; 3],
    dims: [usize; 3],
) -> Result<Vec<f32>, VolumeError> {
    let [nx, ny, _] = of.volume.grid().dims();
    let samples = of.volume.as_slice();
    let mut values = room(dims.iter().product())?;
    for z in first[2]..first[2] + dims[2] {
        for y in first[1]..first[1] + dims[1] {
            let begin = (z * ny + y) * nx;
            for x in first[0]..first[0] + dims[0] {
                let stored = samples.get(begin + x).copied().unwrap_or_default();
                let above = of.volume.rescale().to_hu(stored.to_f64()) - threshold_hu;
                let is_object = above < 0.0 || of.mask.contains(x, y, z);
                values.push(if is_object { above } else { -above.max(1.0) } as f32);
            }
        }
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::segment::segment;
    use crate::surface::{Region, SemiBoundary, semi_boundary};
    use crate::volume::Rescale;

    const THRESHOLD: f64 = -500.0;
    const CENTRE: DVec3 = DVec3::new(15.3, 16.1, 15.7);

    /// A ball with an edge that is a ramp, and a headrest that no skin holds.
    fn ball(centre: DVec3, radius: f64) -> (Volume<i16>, Mask) {
        let grid = Grid::axis_aligned([60, 54, 32], [0.5, 0.6, 1.0]).unwrap();
        let samples = Array3::from_shape_fn((32, 54, 60), |(z, y, x)| {
            let at = DVec3::new(x as f64, y as f64, z as f64) * grid.spacing();
            let outside = (at - centre).length() - radius;
            let hu = (THRESHOLD - outside * 300.0).clamp(-1000.0, 60.0);
            if y == 53 { 200 } else { hu.round() as i16 }
        });
        let volume = Volume::new(grid, Rescale::NONE, samples).unwrap();
        let mask = segment(&volume, THRESHOLD, true).unwrap();
        (volume, mask)
    }

    fn boundary((volume, mask): &(Volume<i16>, Mask)) -> SemiBoundary {
        let region = Region::whole(volume.grid());
        semi_boundary(volume, mask, THRESHOLD, region).unwrap()
    }

    /// What is added, and what is taken away, from one ball to another.
    fn both(before: (DVec3, f64), after: (DVec3, f64)) -> [Solid; 2] {
        let (before, after) = (ball(before.0, before.1), ball(after.0, after.1));
        let surfaces = [boundary(&before), boundary(&after)];
        let skin = |of: &'_ usize| {
            let (volume, mask) = [&before, &after][*of];
            Skin {
                volume,
                mask,
                distance: SurfaceDistance::new(&surfaces[*of], 20.0),
            }
        };
        let solid =
            |a: usize, b: usize| solid(&skin(&a), &skin(&b), THRESHOLD, Least::default()).unwrap();
        [solid(1, 0), solid(0, 1)]
    }

    fn ball_volume(radius: f64) -> f64 {
        4.0 / 3.0 * std::f64::consts::PI * radius * radius * radius
    }

    #[test]
    fn a_larger_ball_adds_a_shell_of_its_thickness() {
        // One of more than a voxel, and one of less than any spacing.
        for (thickness, tolerance) in [(1.5, 0.02), (0.4, 0.04)] {
            let [added, removed] = both((CENTRE, 9.0), (CENTRE, 9.0 + thickness));
            let expected = ball_volume(9.0 + thickness) - ball_volume(9.0);
            let found = added.record.volume_mm3;
            assert!(
                (found / expected - 1.0).abs() < tolerance,
                "{found} for {expected}"
            );
            let between = added.record.between_mm3;
            assert!((between / expected - 1.0).abs() < 0.01, "{between}");
            assert!(added.record.topology.is_sound(), "{:?}", added.record);
            let range = added.record.thickness_mm.unwrap();
            assert!((range.mean - thickness).abs() < 0.05, "{range:?}");
            assert!((range.max - thickness).abs() < 0.25, "{range:?}");
            assert!((added.record.centroid_lps_mm.unwrap().0 - CENTRE).length() < 0.1);
            assert_eq!(added.record.bodies, 1);
            assert!(removed.mesh.is_empty());
            assert_eq!((removed.record.bodies, removed.record.volume_mm3), (0, 0.0));
            assert_eq!(removed.record.between_mm3, 0.0);
            assert_eq!(removed.record.thickness_mm, None);
        }
    }

    #[test]
    fn a_ball_that_moves_adds_before_it_what_it_leaves_behind() {
        let by = DVec3::new(0.0, -2.0, 0.0);
        let [added, removed] = both((CENTRE, 8.0), (CENTRE + by, 8.0));
        for solid in [&added, &removed] {
            // Two balls of radius r, d apart, share π (4 r + d) (2 r - d)² / 12.
            let shared = std::f64::consts::PI * 34.0 * 14.0 * 14.0 / 12.0;
            let expected = ball_volume(8.0) - shared;
            assert!((solid.record.volume_mm3 / expected - 1.0).abs() < 0.02);
            assert!(solid.record.topology.is_sound());
            let range = solid.record.thickness_mm.unwrap();
            assert!(
                range.min < 0.1 && (range.max - 2.0).abs() < 0.15,
                "{range:?}"
            );
        }
        let centre = added.record.centroid_lps_mm.unwrap().0;
        assert!(centre.y < CENTRE.y - 4.0 && (centre.x - CENTRE.x).abs() < 0.05);
    }

    #[test]
    fn slivers_are_left_out_and_counted() {
        let [added, _] = both((CENTRE, 8.0), (CENTRE, 8.06));
        assert!(added.mesh.is_empty());
        let record = added.record;
        assert_eq!((record.bodies, record.volume_mm3), (0, 0.0));
        // As far as samples fall between the two skins at all.
        let expected = ball_volume(8.06) - ball_volume(8.0);
        assert!(record.dropped_bodies > 0 && record.dropped_mm3 > 0.0);
        assert!(record.dropped_mm3 < expected);
        // No mesh holds it, and it is counted all the same.
        let between = record.between_mm3;
        assert!(
            (between / expected - 1.0).abs() < 0.05,
            "{between} for {expected}"
        );
    }

    #[test]
    fn nothing_changed_is_nothing() {
        let [added, removed] = both((CENTRE, 8.0), (CENTRE, 8.0));
        for solid in [added, removed] {
            assert!(solid.mesh.is_empty());
            assert_eq!((solid.record.bodies, solid.record.dropped_bodies), (0, 0));
            assert!(
                solid.record.volume_mm3.is_sign_positive(),
                "no -0.0 in a record"
            );
        }
    }
}
