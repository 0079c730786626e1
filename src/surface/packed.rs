//! A skin as bytes, to be kept between runs.

use super::boundary::{BoundaryVoxel, NeighbourCode, SemiBoundary};
use super::build::Region;
use super::difference::SeenSkin;
use super::normal::PackedNormal;
use crate::space::Grid;

const MAGIC: [u8; 8] = *b"rpskin02";
/// A voxel: x, faces, offset, normal, flags.
const VOXEL: usize = 2 + 1 + 1 + 4 + 1;
const SEEN: u8 = 1;
const MOVED: u8 = 2;

impl SeenSkin {
    /// The version of what [`SeenSkin::to_bytes`] gives.
    pub const FORMAT: [u8; 8] = MAGIC;

    /// The skin as bytes, little endian: dimensions, first and last voxel of the region where it is compared, then for
    /// every row along x that has voxels its number, how many they are, and they.
    pub fn to_bytes(&self) -> Vec<u8> {
        let surface = &self.surface;
        let [nx, ny, nz] = surface.grid().dims();
        let mut bytes = Vec::with_capacity(64 + surface.len() * (VOXEL + 1));
        bytes.extend(MAGIC);
        let Region { first, last } = self.region;
        for number in [[nx, ny, nz], first, last].as_flattened() {
            // A grid has at most 65,535 voxels along an axis.
            bytes.extend((*number as u32).to_le_bytes());
        }
        for row in 0..ny * nz {
            let (y, z) = (row % ny, row / ny);
            let places = surface.row_range(y, z);
            if places.is_empty() {
                continue;
            }
            bytes.extend((row as u32).to_le_bytes());
            bytes.extend((places.len() as u32).to_le_bytes());
            for (place, voxel) in places.zip(surface.row(y, z)) {
                let flag = |of: &[bool], bit| match of.get(place) {
                    Some(true) => bit,
                    _ => 0,
                };
                bytes.extend(voxel.x.to_le_bytes());
                bytes.push(voxel.code.to_byte());
                bytes.push(voxel.offset as u8);
                bytes.extend(voxel.normal.to_bytes());
                bytes.push(flag(&self.seen, SEEN) | flag(&self.moved, MOVED));
            }
        }
        bytes
    }

    /// The skin that [`SeenSkin::to_bytes`] gave, on the same grid; none where they are not such bytes.
    pub fn from_bytes(grid: &Grid, mut bytes: &[u8]) -> Option<Self> {
        let mut take = |count: usize| -> Option<&[u8]> {
            let (taken, rest) = bytes.split_at_checked(count)?;
            bytes = rest;
            Some(taken)
        };
        let number = |bytes: &[u8]| Some(u32::from_le_bytes(bytes.try_into().ok()?) as usize);
        if take(8)? != MAGIC {
            return None;
        }
        let mut three = || {
            let mut three = [0; 3];
            for place in &mut three {
                *place = number(take(4)?)?;
            }
            Some(three)
        };
        let [nx, ny, nz] = grid.dims();
        let (dims, first, last) = (three()?, three()?, three()?);
        let is_within = (0..3).all(|axis| first[axis] <= last[axis] && last[axis] < dims[axis]);
        if dims != [nx, ny, nz] || !is_within {
            return None;
        }
        let mut rows: Vec<u32> = vec![0];
        let (mut voxels, mut seen, mut moved) = (Vec::new(), Vec::new(), Vec::new());
        while let Some(row) = take(4) {
            let (row, count) = (number(row)?, number(take(4)?)?);
            if row >= ny * nz || row + 1 < rows.len() || count > nx {
                return None;
            }
            rows.resize(row + 1, u32::try_from(voxels.len()).ok()?);
            let mut last = None;
            for voxel in take(count * VOXEL)?.chunks_exact(VOXEL) {
                let &[x0, x1, code, offset, n0, n1, n2, n3, flags] = voxel else {
                    return None;
                };
                let x = u16::from_le_bytes([x0, x1]);
                if usize::from(x) >= nx || last.is_some_and(|last| last >= x) {
                    return None;
                }
                last = Some(x);
                voxels.push(BoundaryVoxel {
                    x,
                    code: NeighbourCode::from_byte(code),
                    offset: offset as i8,
                    normal: PackedNormal::from_bytes([n0, n1, n2, n3]),
                });
                seen.push(flags & SEEN != 0);
                moved.push(flags & MOVED != 0);
            }
        }
        rows.resize(ny * nz + 1, u32::try_from(voxels.len()).ok()?);
        Some(Self {
            surface: SemiBoundary {
                grid: grid.clone(),
                region: Region::whole(grid),
                rows,
                voxels,
            },
            region: Region { first, last },
            seen,
            moved,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::difference::tests::{between, seen, skin};
    use glam::DVec3;

    fn ball(radius: f64, before: f64) -> SeenSkin {
        let of = |radius: f64| skin(|at| radius - (at - DVec3::new(12.0, 16.0, 16.0)).length());
        seen(&of(radius), &of(before))
    }

    #[test]
    fn a_skin_that_was_kept_is_the_same() {
        let (one, other) = (ball(9.0, 8.0), ball(8.5, 8.0));
        let again = SeenSkin::from_bytes(one.surface.grid(), &one.to_bytes()).unwrap();
        assert_eq!(again.surface, one.surface);
        assert_eq!((&again.seen, &again.moved), (&one.seen, &one.moved));
        assert_eq!(again.region, one.region);
        let found = between(&one, &other);
        assert!(found.max_mm > 0.3, "{found:?}");
        assert_eq!(between(&again, &other), found);
    }

    #[test]
    fn other_bytes_are_none() {
        let skin = ball(9.0, 8.0);
        let bytes = skin.to_bytes();
        let grid = skin.surface.grid();
        for cut in [0, 7, 19, 43, 50, bytes.len() - 1] {
            assert!(SeenSkin::from_bytes(grid, &bytes[..cut]).is_none(), "{cut}");
        }
        // The magic, a size, a region that begins behind its end and one beyond the grid, a row beyond the grid, more
        // voxels than a row holds, an x beyond the row.
        for at in [0, 9, 21, 33, 47, 51, 53] {
            let mut wrong = bytes.clone();
            wrong[at] = 0xff;
            assert!(SeenSkin::from_bytes(grid, &wrong).is_none(), "{at}");
        }
    }
}
