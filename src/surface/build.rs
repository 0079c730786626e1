//! From a mask and the volume it was taken from to its semi-boundary, in one parallel pass.

use glam::DVec3;
use rayon::prelude::*;

use super::boundary::{BoundaryVoxel, NeighbourCode, SemiBoundary, SurfaceError, offset_step};
use super::normal::PackedNormal;
use crate::space::Grid;
use crate::volume::{Mask, Sample, Volume, VolumeError};

/// A surface through a voxel meets one of its exposed faces at a cosine of at least 1/√3 (in voxels); what
/// is less, with some room for noise, is not its normal.
const LEAST_SQUARE: f64 = 0.5;

/// The most boundary voxels of a surface: their places have 31 bits.
const MAX_VOXELS: usize = i32::MAX as usize;

/// The part of a volume that is looked at: first and last voxel of each axis. What lies outside is cut off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// First voxel of each axis.
    pub first: [usize; 3],
    /// Last voxel of each axis.
    pub last: [usize; 3],
}

impl Region {
    /// Whether a voxel is in it.
    pub fn contains(&self, at: [usize; 3]) -> bool {
        (0..3).all(|axis| self.first[axis] <= at[axis] && at[axis] <= self.last[axis])
    }

    /// What two have in common; a region that holds none where that is nothing.
    pub fn and(&self, other: &Self) -> Self {
        let each = |axis: usize| {
            let first = self.first[axis].max(other.first[axis]);
            (first, self.last[axis].min(other.last[axis]))
        };
        let [x, y, z] = [0, 1, 2].map(each);
        Self {
            first: [x.0, y.0, z.0],
            last: [x.1, y.1, z.1],
        }
    }

    /// All of a grid.
    pub fn whole(grid: &Grid) -> Self {
        Self {
            first: [0; 3],
            last: grid.dims().map(|n| n - 1),
        }
    }

    /// The same, no larger than the grid; `None` where nothing is left.
    fn within(self, grid: &Grid) -> Option<Self> {
        let last = std::array::from_fn(|axis| self.last[axis].min(grid.dims()[axis] - 1));
        let kept = (0..3).all(|axis| self.first[axis] <= last[axis]);
        kept.then_some(Self {
            first: self.first,
            last,
        })
    }
}

/// The semi-boundary of the object `mask`, within `region`.
///
/// `volume` is what the mask was segmented from by `threshold_hu`: it gives the normals (the gradient, by
/// the 3×3×3 Sobel operator, in millimetres) and where within a voxel the surface lies (where HU, linear
/// between neighbours, reach the threshold). Faces at the end of the scan or of the region are flat.
///
/// # Errors
/// [`SurfaceError`] where the mask is not of the volume, or memory or indices do not suffice.
pub fn semi_boundary<T: Sample>(
    volume: &Volume<T>,
    mask: &Mask,
    threshold_hu: f64,
    region: Region,
) -> Result<SemiBoundary, SurfaceError> {
    build(volume, mask, threshold_hu, region, region)
}

/// The part in `region` of the semi-boundary of all of the object `mask`: as [`semi_boundary`], but nothing is cut open
/// where the region ends.
///
/// # Errors
/// As [`semi_boundary`].
pub fn semi_boundary_in<T: Sample>(
    volume: &Volume<T>,
    mask: &Mask,
    threshold_hu: f64,
    region: Region,
) -> Result<SemiBoundary, SurfaceError> {
    let whole = Region::whole(volume.grid());
    build(volume, mask, threshold_hu, whole, region)
}

/// The voxels in `kept` of the semi-boundary of what `region` leaves of the object.
fn build<T: Sample>(
    volume: &Volume<T>,
    mask: &Mask,
    threshold_hu: f64,
    region: Region,
    kept: Region,
) -> Result<SemiBoundary, SurfaceError> {
    let grid = volume.grid();
    let [_, ny, nz] = grid.dims();
    if mask.dims() != grid.dims() {
        return Err(SurfaceError::Shape {
            mask: mask.dims(),
            volume: grid.dims(),
        });
    }
    let builder = Builder {
        samples: Samples::new(volume),
        spacing: grid.spacing(),
        threshold_hu,
        offset_step: offset_step(grid),
        mask,
    };
    let region = region.within(grid).zip(kept.within(grid));
    let planes: Vec<Plane> = (0..nz)
        .into_par_iter()
        .map(|z| builder.plane(z, region))
        .collect();
    let total: usize = planes.iter().map(|plane| plane.voxels.len()).sum();
    if total > MAX_VOXELS {
        return Err(SurfaceError::TooMany(total));
    }
    let mut voxels = Vec::new();
    let mut rows = Vec::new();
    reserve(&mut voxels, total)?;
    reserve(&mut rows, ny * nz + 1)?;
    for plane in &planes {
        // Fits: it is at most `total`.
        let begin = voxels.len() as u32;
        rows.extend(plane.rows.iter().map(|row| begin + row));
        voxels.extend_from_slice(&plane.voxels);
    }
    rows.push(total as u32);
    Ok(SemiBoundary {
        grid: grid.clone(),
        region: region.map_or(Region::whole(grid), |(_, kept)| kept),
        rows,
        voxels,
    })
}

fn reserve<V>(to: &mut Vec<V>, len: usize) -> Result<(), VolumeError> {
    to.try_reserve_exact(len).map_err(|_| VolumeError::Memory {
        voxels: len,
        bytes_per_voxel: size_of::<V>(),
    })
}

/// The boundary voxels of one z plane, and where each of its rows begins.
struct Plane {
    rows: Vec<u32>,
    voxels: Vec<BoundaryVoxel>,
}

struct Builder<'a, T> {
    samples: Samples<'a, T>,
    spacing: DVec3,
    threshold_hu: f64,
    offset_step: f64,
    mask: &'a Mask,
}

impl<T: Sample> Builder<'_, T> {
    fn plane(&self, z: usize, region: Option<(Region, Region)>) -> Plane {
        let [_, ny, _] = self.mask.dims();
        let mut plane = Plane {
            rows: Vec::with_capacity(ny),
            voxels: Vec::new(),
        };
        for y in 0..ny {
            plane.rows.push(plane.voxels.len() as u32);
            if let Some((region, kept)) = region
                && (kept.first[1]..=kept.last[1]).contains(&y)
                && (kept.first[2]..=kept.last[2]).contains(&z)
            {
                self.row(y, z, region, kept, &mut plane.voxels);
            }
        }
        plane
    }

    /// The boundary voxels of one row, those in `kept`: words of 64 voxels are compared with their neighbours at once.
    fn row(&self, y: usize, z: usize, region: Region, kept: Region, to: &mut Vec<BoundaryVoxel>) {
        let row = self.mask.row(y, z);
        if row.iter().all(|&word| word == 0) {
            return;
        }
        let neighbour = |outside: bool, y: usize, z: usize| match outside {
            true => None,
            false => Some(self.mask.row(y, z)),
        };
        let beside = [
            neighbour(y == region.first[1], y.wrapping_sub(1), z),
            neighbour(y == region.last[1], y + 1, z),
            neighbour(z == region.first[2], y, z.wrapping_sub(1)),
            neighbour(z == region.last[2], y, z + 1),
        ];
        for place in 0..row.len() {
            let here = inside_word(row, place, kept);
            if here == 0 {
                continue;
            }
            let before = match place.checked_sub(1) {
                Some(place) => inside_word(row, place, region),
                None => 0,
            };
            let after = if place + 1 < row.len() {
                inside_word(row, place + 1, region)
            } else {
                0
            };
            let mut exposed = [0_u64; 6];
            let object = inside_word(row, place, region);
            exposed[0] = here & !(object << 1 | before >> 63);
            exposed[1] = here & !(object >> 1 | after << 63);
            for (face, row) in exposed[2..].iter_mut().zip(beside) {
                *face = here & !row.map_or(0, |row| row[place]);
            }
            let mut boundary = exposed.iter().fold(0, |any, face| any | face);
            while boundary != 0 {
                let bit = boundary.trailing_zeros();
                boundary &= boundary - 1;
                let faces = exposed.iter().enumerate();
                let faces = faces.fold(0_u8, |bits, (face, word)| {
                    bits | ((word >> bit & 1) as u8) << face
                });
                let x = place * 64 + bit as usize;
                to.push(self.voxel([x, y, z], faces, region));
            }
        }
    }

    fn voxel(&self, at: [usize; 3], faces: u8, region: Region) -> BoundaryVoxel {
        let exposed = |face: usize| faces >> face & 1 == 1;
        // A face where the region or the scan ends: nothing is known beyond it.
        let ends = |face: usize| {
            let axis = face / 2;
            let at_end = if face.is_multiple_of(2) {
                region.first[axis]
            } else {
                region.last[axis]
            };
            at[axis] == at_end
        };
        let cut = (0..6).all(|face| !exposed(face) || ends(face));
        let outward = |face: usize| DVec3::from_array(NeighbourCode::FACES[face].map(f64::from));
        let exposed_faces = || (0..6).filter(|&face| exposed(face));
        let flat = exposed_faces().fold(DVec3::ZERO, |sum, face| sum + outward(face));
        // HU fall outwards. Where the gradient looks along every exposed face, the voxel is of something
        // so thin that its two sides cancel, and the gradient is noise.
        let gradient = || {
            let outwards = -self.samples.gradient(at, self.spacing);
            // Between voxels, not mm: it is voxels that have faces.
            let per_voxel = outwards * self.spacing;
            let facing = exposed_faces()
                .map(|face| per_voxel.dot(outward(face)))
                .fold(f64::NEG_INFINITY, f64::max);
            let square = facing >= LEAST_SQUARE * per_voxel.length();
            (square && outwards.is_finite()).then_some(outwards)
        };
        let found = if cut { None } else { gradient() }.and_then(PackedNormal::new);
        let normal = found
            .or_else(|| PackedNormal::new(flat))
            .or_else(|| {
                exposed_faces()
                    .next()
                    .and_then(|face| PackedNormal::new(outward(face)))
            })
            .unwrap_or(PackedNormal::ANTERIOR);
        let direction = normal.unpack().as_dvec3();
        let offset = if cut {
            // The flat end is half a voxel away.
            (direction.abs() * self.spacing).max_element() / 2.0
        } else if flat == DVec3::ZERO && found.is_none() {
            0.0
        } else {
            self.crossing(at, faces, direction, ends)
        };
        let steps = (offset / self.offset_step).round().clamp(-127.0, 127.0);
        BoundaryVoxel {
            // A grid has at most 32767 voxels along an axis.
            x: at[0] as u16,
            code: NeighbourCode::new(faces, cut),
            offset: steps as i8,
            normal,
        }
    }

    /// How far the surface is from a voxel's centre along its normal, mm: through each exposed face HU fall
    /// linearly to the neighbour's and cross the threshold on the way; the plane across the normal goes
    /// through these crossings, each weighted by how squarely it is met.
    fn crossing(
        &self,
        at: [usize; 3],
        faces: u8,
        normal: DVec3,
        ends: impl Fn(usize) -> bool,
    ) -> f64 {
        let here = self.samples.hu(at);
        let (mut sum, mut weights) = (0.0, 0.0);
        for (face, toward) in NeighbourCode::FACES.iter().enumerate() {
            if faces >> face & 1 == 0 || ends(face) {
                continue;
            }
            let axis = face / 2;
            let along = normal[axis] * f64::from(toward[axis]);
            if along <= 0.0 {
                // Looks away from the normal: the other side of something thin.
                continue;
            }
            let mut beside = at;
            beside[axis] = at[axis].saturating_add_signed(isize::from(toward[axis]));
            let there = self.samples.hu(beside);
            let fraction = (here - self.threshold_hu) / (here - there);
            let fraction = if fraction.is_finite() {
                fraction.clamp(0.0, 1.0)
            } else {
                0.5
            };
            let weight = along * along;
            sum += weight * fraction * self.spacing[axis] * along;
            weights += weight;
        }
        if weights > 0.0 { sum / weights } else { 0.0 }
    }
}

/// The bits of a word of a row that lie in the region.
fn inside_word(row: &[u64], place: usize, region: Region) -> u64 {
    let mut word = row[place];
    let begin = place * 64;
    if begin < region.first[0] {
        let below = region.first[0] - begin;
        word = if below >= 64 {
            0
        } else {
            word & (u64::MAX << below)
        };
    }
    if begin + 63 > region.last[0] {
        let kept = (region.last[0] + 1).saturating_sub(begin);
        word = if kept == 0 {
            0
        } else {
            word & (u64::MAX >> (64 - kept.min(64)))
        };
    }
    word
}

/// A volume, read in HU.
struct Samples<'a, T> {
    samples: &'a [T],
    dims: [usize; 3],
    volume: &'a Volume<T>,
}

impl<'a, T: Sample> Samples<'a, T> {
    fn new(volume: &'a Volume<T>) -> Self {
        Self {
            samples: volume.as_slice(),
            dims: volume.grid().dims(),
            volume,
        }
    }

    fn hu(&self, [x, y, z]: [usize; 3]) -> f64 {
        let [nx, ny, _] = self.dims;
        let stored = self.samples[(z * ny + y) * nx + x];
        self.volume.rescale().to_hu(stored.to_f64())
    }

    /// The gradient at a voxel, HU/mm: central differences, each the mean of the nine along its axis with
    /// the weights 1, 2, 1 across. Beyond the last voxel the nearest one stands in.
    fn gradient(&self, at: [usize; 3], spacing: DVec3) -> DVec3 {
        let [nx, ny, _] = self.dims;
        let near = |axis: usize| {
            let last = self.dims[axis] - 1;
            let at = at[axis];
            [at.saturating_sub(1), at, (at + 1).min(last)]
        };
        let [xs, ys, zs] = [near(0), near(1), near(2)];
        const ACROSS: [f64; 3] = [1.0, 2.0, 1.0];
        const ALONG: [f64; 3] = [-1.0, 0.0, 1.0];
        let mut sum = DVec3::ZERO;
        for (k, z) in zs.into_iter().enumerate() {
            for (j, y) in ys.into_iter().enumerate() {
                let row = (z * ny + y) * nx;
                let [a, b, c] = xs.map(|x| self.samples[row + x].to_f64());
                let smooth = a + 2.0 * b + c;
                sum.x += ACROSS[j] * ACROSS[k] * (c - a);
                sum.y += ALONG[j] * ACROSS[k] * smooth;
                sum.z += ACROSS[j] * ALONG[k] * smooth;
            }
        }
        let steps = DVec3::new(
            (xs[2] - xs[0]) as f64,
            (ys[2] - ys[0]) as f64,
            (zs[2] - zs[0]) as f64,
        );
        let apart = (steps * spacing).max(DVec3::splat(f64::MIN_POSITIVE));
        sum * self.volume.rescale().slope / (16.0 * apart)
    }
}
