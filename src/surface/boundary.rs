//! The semi-boundary as it is stored.

use glam::{DVec3, Vec3};
use thiserror::Error;

use super::build::Region;
use super::normal::PackedNormal;
use crate::space::{Grid, GridPoint};
use crate::volume::VolumeError;

/// Which of a voxel's six faces are exposed: their neighbour is not in the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NeighbourCode(u8);

impl NeighbourCode {
    /// The outward directions of the six faces, in the order of their bits: right, left, anterior,
    /// posterior, inferior, superior.
    pub const FACES: [[i8; 3]; 6] = [
        [-1, 0, 0],
        [1, 0, 0],
        [0, -1, 0],
        [0, 1, 0],
        [0, 0, -1],
        [0, 0, 1],
    ];
    /// Set where every exposed face was made by a cut or by the end of the scan, so that the voxel's
    /// neighbour says nothing of the surface.
    const CUT: u8 = 1 << 6;
    const SIX: u8 = 0b11_1111;

    pub(super) fn new(faces: u8, cut: bool) -> Self {
        Self(faces & Self::SIX | if cut { Self::CUT } else { 0 })
    }

    /// All that it holds.
    pub(super) fn to_byte(self) -> u8 {
        self.0
    }

    /// What [`NeighbourCode::to_byte`] gave.
    pub(super) fn from_byte(byte: u8) -> Self {
        Self(byte & (Self::SIX | Self::CUT))
    }

    /// The six bits.
    #[inline]
    pub fn faces(self) -> u8 {
        self.0 & Self::SIX
    }

    /// Whether the voxel is exposed only where the object was cut, or where the scan ends.
    #[inline]
    pub fn is_cut(self) -> bool {
        self.0 & Self::CUT != 0
    }

    /// Whether two opposite faces are exposed: the object is a voxel thick there.
    #[inline]
    pub fn is_thin(self) -> bool {
        self.0 & self.0 >> 1 & 0b01_0101 != 0
    }

    /// The faces that look at a viewer in the direction `toward`, as bits.
    pub fn looking(toward: DVec3) -> u8 {
        Self::bits(|_, cosine| cosine > 0.0, toward)
    }

    /// The faces that a surface which looks at the viewer can expose, as bits. A surface need not be square
    /// to the faces of the voxels that it passes through: in voxels, one of them it meets at 55° or less.
    pub fn of_surfaces_looking(toward: DVec3, spacing: DVec3) -> u8 {
        let possible = |axis: usize, cosine: f64| {
            let ratios = DVec3::splat(spacing[axis]) / spacing;
            let least = 1.0 / ratios.length_squared();
            cosine > -(1.0 - least).max(0.0).sqrt()
        };
        Self::bits(possible, toward)
    }

    fn bits(holds: impl Fn(usize, f64) -> bool, toward: DVec3) -> u8 {
        let faces = Self::FACES.iter().enumerate();
        faces.fold(0, |bits, (place, face)| {
            let cosine = DVec3::from_array(face.map(f64::from)).dot(toward);
            bits | u8::from(holds(place / 2, cosine)) << place
        })
    }
}

/// A voxel on the surface of an object, without its y and z, which its row gives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BoundaryVoxel {
    pub(super) x: u16,
    pub(super) code: NeighbourCode,
    /// From the centre to the surface along the normal, in steps of [`SemiBoundary::offset_step`].
    pub(super) offset: i8,
    pub(super) normal: PackedNormal,
}

const _: () = assert!(size_of::<BoundaryVoxel>() == 8);

impl BoundaryVoxel {
    /// Index along x.
    #[inline]
    pub fn x(self) -> usize {
        usize::from(self.x)
    }

    /// Which faces are exposed.
    #[inline]
    pub fn code(self) -> NeighbourCode {
        self.code
    }

    /// From the centre to the surface along the normal, in steps of [`SemiBoundary::offset_step`].
    #[inline]
    pub fn offset_steps(self) -> f32 {
        f32::from(self.offset)
    }

    /// The outward unit normal, in the frame of the grid (millimetres, no rotation).
    #[inline]
    pub fn normal(self) -> Vec3 {
        self.normal.unpack()
    }

    /// The normals of some voxels, by component.
    #[inline(always)]
    pub fn normals<const N: usize>(voxels: &[Self; N]) -> [[f32; N]; 3] {
        let mut packed = [PackedNormal::default(); N];
        for lane in 0..N {
            packed[lane] = voxels[lane].normal;
        }
        PackedNormal::unpack_all(&packed)
    }
}

/// Why there is no semi-boundary.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SurfaceError {
    /// The mask's shape is not the volume's.
    #[error("the mask is {mask:?} voxels, the volume {volume:?}")]
    Shape {
        /// Of the mask.
        mask: [usize; 3],
        /// Of the volume.
        volume: [usize; 3],
    },
    /// More boundary voxels than an index of 32 bits counts.
    #[error(
        "the surface has {0} voxels, more than can be indexed; is the threshold inside the noise?"
    )]
    TooMany(usize),
    /// No memory.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

/// The boundary voxels of one object: those that have a face neighbour outside it, for every row along x
/// in order of x, with the rows indexed.
#[derive(Debug, Clone, PartialEq)]
pub struct SemiBoundary {
    pub(super) grid: Grid,
    pub(super) region: Region,
    /// Where each row begins; one more than there are rows. Row (y, z) is number z · ny + y.
    pub(super) rows: Vec<u32>,
    pub(super) voxels: Vec<BoundaryVoxel>,
}

impl SemiBoundary {
    /// The grid of the volume that it was taken from.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The part of the grid that was looked at.
    pub fn region(&self) -> Region {
        self.region
    }

    /// All boundary voxels, row by row: z slowest, x fastest.
    pub fn voxels(&self) -> &[BoundaryVoxel] {
        &self.voxels
    }

    /// Number of boundary voxels.
    pub fn len(&self) -> usize {
        self.voxels.len()
    }

    /// Whether there is no surface.
    pub fn is_empty(&self) -> bool {
        self.voxels.is_empty()
    }

    /// Where row (y, z) begins and ends in [`SemiBoundary::voxels`]; empty outside the grid.
    #[inline]
    pub fn row_range(&self, y: usize, z: usize) -> std::ops::Range<usize> {
        let [_, ny, nz] = self.grid.dims();
        if y >= ny || z >= nz {
            return 0..0;
        }
        let row = z * ny + y;
        match self.rows.get(row..row + 2) {
            Some(&[begin, end]) => begin as usize..end as usize,
            _ => 0..0,
        }
    }

    /// The voxels of row (y, z), in order of x.
    pub fn row(&self, y: usize, z: usize) -> &[BoundaryVoxel] {
        self.voxels.get(self.row_range(y, z)).unwrap_or_default()
    }

    /// The rows, y and z, that have voxels: a surface that is held only around the nose has few.
    pub(super) fn rows_with_voxels(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let [_, ny, _] = self.grid.dims();
        let rows = self.rows.windows(2).enumerate();
        let rows = rows.filter(|(_, ends)| ends.first() < ends.last());
        rows.map(move |(row, _)| [row % ny, row / ny])
    }

    /// The voxel index (x, y, z) of a boundary voxel, by its place in [`SemiBoundary::voxels`].
    pub fn index(&self, place: usize) -> Option<[usize; 3]> {
        let voxel = self.voxels.get(place)?;
        let [_, ny, _] = self.grid.dims();
        let row = self.rows.partition_point(|&begin| begin as usize <= place);
        let row = row.checked_sub(1)?;
        Some([voxel.x(), row % ny, row / ny])
    }

    /// Exposed faces, counted over all voxels.
    pub fn face_count(&self) -> usize {
        let faces = |voxel: &BoundaryVoxel| voxel.code.faces().count_ones() as usize;
        self.voxels.iter().map(faces).sum()
    }

    /// What one step of a voxel's stored offset is, mm: the longest spacing over 100, so that the offset
    /// reaches a little beyond a whole voxel.
    #[inline]
    pub fn offset_step(&self) -> f64 {
        offset_step(&self.grid)
    }

    /// The point of the surface that a boundary voxel stands for: its centre, moved along the normal to
    /// where the threshold is crossed.
    pub fn surface_point(&self, voxel: BoundaryVoxel, y: usize, z: usize) -> GridPoint {
        self.point_of([voxel.x(), y, z], voxel.offset, voxel.normal().as_dvec3())
    }

    /// The same, from the parts of a voxel.
    #[inline]
    pub(super) fn point_of(&self, index: [usize; 3], offset: i8, normal: DVec3) -> GridPoint {
        let (spacing, step) = (self.grid.spacing(), self.offset_step());
        GridPoint(surface_point(index, offset, normal, spacing, step))
    }

    /// Every boundary voxel with its place, y and z, in the order of [`SemiBoundary::voxels`].
    pub fn iter(&self) -> impl Iterator<Item = (usize, BoundaryVoxel, usize, usize)> + '_ {
        let [_, ny, nz] = self.grid.dims();
        (0..ny * nz).flat_map(move |row| {
            let (y, z) = (row % ny, row / ny);
            self.row_range(y, z)
                .map(move |place| (place, self.voxels[place], y, z))
        })
    }

    /// The smallest box of boundary voxels, first and last index of each axis; `None` where there is none.
    pub fn bounds(&self) -> Option<([usize; 3], [usize; 3])> {
        self.iter().fold(None, |bounds, (_, voxel, y, z)| {
            let at = [voxel.x(), y, z];
            Some(match bounds {
                None => (at, at),
                Some((low, high)) => (
                    std::array::from_fn(|axis| at[axis].min(low[axis])),
                    std::array::from_fn(|axis| at[axis].max(high[axis])),
                ),
            })
        })
    }
}

pub(super) fn offset_step(grid: &Grid) -> f64 {
    grid.spacing().max_element() / 100.0
}

/// The surface point of a voxel.
#[inline]
pub(super) fn surface_point(
    index: [usize; 3],
    offset: i8,
    normal: DVec3,
    spacing: DVec3,
    offset_step: f64,
) -> DVec3 {
    let centre = DVec3::from(index.map(|at| at as f64)) * spacing;
    centre + normal * (f64::from(offset) * offset_step)
}
