//! Volumes and displacement fields, written as their template is stored.

use std::io::{self, Write};
use std::path::Path;

use bytemuck::cast_slice;
use ndarray::{Array3, ArrayView1, ArrayView3, ArrayViewMut3, Axis, Slice};
use rayon::prelude::*;

use super::error::WriteError;
use super::header::{ByteOrder, FIRST_OFFSET, HEADER_LEN, at};
use super::template::{RawHeader, Template};
use crate::io::artifact::Artifact;
use crate::io::axes::StoredAxes;
use crate::io::gzip::{GzipWriter, pack_whole};
use crate::space::{ContinuousIndex, Grid};
use crate::volume::{Rescale, Sample, SampleType, Volume, zeroed};

/// Bytes of rows made together, in parallel, before they are written.
const BATCH: usize = 4 << 20;

/// Planes of a displacement field made together.
pub const SLAB: usize = 16;

/// Some planes of a grid: a box of voxels that reaches right across it along two axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GridSlab {
    /// Its first voxel (x, y, z) in LPS order.
    pub start: [usize; 3],
    /// Its voxels along x, y and z.
    pub dims: [usize; 3],
}

/// `NIFTI_INTENT_VECTOR`: the voxels are vectors. ITK takes their components as they are, in LPS;
/// those of intent 1006 (displacement) it takes as RAS, and turns (ITK 5.4).
const INTENT_VECTOR: i16 = 1007;

/// How far apart, in mm, two grids may hold the same voxel and count as the same. A header's `f32` keeps
/// a position of 500 mm to 3e-5.
const SAME_PLACE_MM: f64 = 1e-3;

impl Template {
    /// Writes a volume on this template's grid, uncompressed. The header is the template's own, but for
    /// free text and extensions, which are left out, and `vox_offset`, which is 352. A volume that was
    /// read and not changed gives the samples of its file, byte for byte.
    ///
    /// # Errors
    /// [`WriteError::Mismatch`] where type, grid or scaling are not the template's;
    /// [`WriteError::Io`] of `to`.
    pub fn write_volume<T: Sample>(
        &self,
        mut to: impl Write,
        volume: &Volume<T>,
    ) -> Result<(), WriteError> {
        self.check(T::TYPE, volume.grid(), volume.rescale())?;
        to.write_all(&start(&self.header))?;
        let memory = &mut Vec::new();
        write_rows(
            &mut to,
            self.stored,
            size_of::<T>(),
            memory,
            self.encoding(volume),
        )?;
        to.flush()?;
        Ok(())
    }

    /// [`Template::write_volume`] as gzip, in one piece: a third of the work of a stream, on one core.
    ///
    /// # Errors
    /// As [`Template::write_volume`], and [`WriteError::Io`] where there is no memory for it.
    fn packed<T: Sample>(&self, volume: &Volume<T>) -> Result<Vec<u8>, WriteError> {
        self.check(T::TYPE, volume.grid(), volume.rescale())?;
        let start = start(&self.header);
        if self.orientation() == StoredAxes::LPS && self.header.order.is_native() {
            // As it lies in memory.
            return Ok(pack_whole(&start, cast_slice(volume.as_slice()))?);
        }
        let no_memory = |_| WriteError::Io(io::ErrorKind::OutOfMemory.into());
        let mut stored = zeroed(volume.grid().len() * size_of::<T>()).map_err(no_memory)?;
        fill_rows(
            &mut stored,
            self.stored[0] * size_of::<T>(),
            0,
            self.encoding(volume),
        );
        Ok(pack_whole(&start, &stored)?)
    }

    /// Puts a row of a volume by its number into the row's bytes as they are stored.
    fn encoding<T: Sample>(&self, volume: &Volume<T>) -> impl Fn(usize, &mut [u8]) + Sync {
        let stored = self.orientation().stored_view(volume.samples());
        let [_, nj, _] = self.stored;
        let order = self.header.order;
        move |row, bytes| encode(row_of(stored, row, nj), order, bytes)
    }

    /// Writes a displacement field on this template's grid, uncompressed, as ITK does: five axes
    /// (x, y, z, 1, 3), `f32`, intent 1007, the components x, y, z in **LPS mm**, one after the other (mm
    /// even where the header counts in metres, as ITK turns those into mm).
    ///
    /// `fill` is called for each component (0 x, 1 y, 2 z) and each [`GridSlab`], and fills the
    /// displacements of the slab's voxels along that component. So no more of the field than a slab need
    /// exist. A slab is [`SLAB`] planes thick across the axis that the file stores slowest, and begins at a
    /// multiple of that.
    ///
    /// # Errors
    /// Those of `to`.
    pub fn write_displacement(
        &self,
        mut to: impl Write,
        mut fill: impl FnMut(usize, GridSlab, ArrayViewMut3<'_, f32>),
    ) -> Result<(), WriteError> {
        to.write_all(&start(&self.displacement_header()))?;
        let axes = self.orientation();
        let order = self.header.order;
        let across = axes.lps[2];
        let dims = self.grid().dims();
        let mut starts: Vec<usize> = (0..dims[across]).step_by(SLAB).collect();
        if axes.flipped[2] {
            starts.reverse();
        }
        // One buffer for all slabs, as large as the thickest.
        let mut largest = dims;
        largest[across] = SLAB.min(dims[across]);
        let mut values = Array3::<f32>::zeros((largest[2], largest[1], largest[0]));
        let mut bytes = Vec::new();
        for component in 0..3 {
            for &start in &starts {
                let mut slab = GridSlab {
                    start: [0; 3],
                    dims,
                };
                slab.start[across] = start;
                slab.dims[across] = SLAB.min(dims[across] - start);
                let thickness = Slice::from(..slab.dims[across]);
                let mut view = values.slice_axis_mut(Axis(2 - across), thickness);
                view.fill(0.0);
                fill(component, slab, view.view_mut());
                let stored = axes.stored_view(view.view());
                let (nk, nj, ni) = stored.dim();
                let stored_dims = [ni, nj, nk];
                write_rows(
                    &mut to,
                    stored_dims,
                    size_of::<f32>(),
                    &mut bytes,
                    |row, bytes| {
                        encode(row_of(stored, row, nj), order, bytes);
                    },
                )?;
            }
        }
        to.flush()?;
        Ok(())
    }

    fn check(&self, found: SampleType, grid: &Grid, rescale: Rescale) -> Result<(), WriteError> {
        let mismatch = |what, found: String, expected: String| {
            Err(WriteError::Mismatch {
                what,
                found,
                expected,
            })
        };
        if found != self.sample_type() {
            return mismatch(
                "sample type",
                found.to_string(),
                self.sample_type().to_string(),
            );
        }
        if !same_place(grid, self.grid()) {
            return mismatch("grid", describe(grid), describe(self.grid()));
        }
        let stored = |rescale: Rescale| [rescale.slope as f32, rescale.intercept as f32];
        if stored(rescale) != stored(self.rescale()) {
            return mismatch(
                "rescale",
                format!("{rescale:?}"),
                format!("{:?}", self.rescale()),
            );
        }
        Ok(())
    }

    fn displacement_header(&self) -> RawHeader {
        let mut header = self.header.clone();
        let [ni, nj, nk] = self.stored.map(|n| i16::try_from(n).unwrap_or(i16::MAX));
        header.put_i16s(at::DIM, &[5, ni, nj, nk, 1, 3, 1, 1]);
        header.put_type(SampleType::F32);
        header.put_i16s(at::INTENT_CODE, &[INTENT_VECTOR]);
        header.put_i16s(at::SLICE_START, &[0]);
        header.put_i16s(at::SLICE_END, &[0]);
        header.bytes[at::SLICE_CODE] = 0;
        header.put_f32(at::SCL_SLOPE, 1.0);
        for zero in [at::SCL_INTER, at::CAL_MAX, at::CAL_MIN] {
            header.put_f32(zero, 0.0);
        }
        for parameter in 0..3 {
            header.put_f32(at::INTENT_P1 + 4 * parameter, 0.0);
        }
        for axis in 4..8 {
            header.put_f32(at::PIXDIM + 4 * axis, 1.0);
        }
        // The unit of space stays; there is no time.
        header.bytes[at::XYZT_UNITS] &= 7;
        header
    }
}

/// Writes a volume as a file that appears whole or not at all, gzipped where its name ends in `.gz`.
///
/// # Errors
/// As [`Template::write_volume`], the file named.
pub fn save_volume<T: Sample>(
    path: &Path,
    template: &Template,
    volume: &Volume<T>,
) -> Result<(), WriteError> {
    let mut artifact = Artifact::create(path)?;
    let written = if is_gzip(path) {
        template
            .packed(volume)
            .and_then(|packed| Ok(artifact.write_all(&packed)?))
    } else {
        template.write_volume(&mut artifact, volume)
    };
    finish(artifact, written)
}

/// Writes a displacement field as a file that appears whole or not at all, gzipped where its name ends in
/// `.gz`. For `fill` see [`Template::write_displacement`].
///
/// # Errors
/// As [`Template::write_displacement`], the file named.
pub fn save_displacement(
    path: &Path,
    template: &Template,
    fill: impl FnMut(usize, GridSlab, ArrayViewMut3<'_, f32>),
) -> Result<(), WriteError> {
    let mut artifact = Artifact::create(path)?;
    let written = if is_gzip(path) {
        let mut gzip = GzipWriter::new(&mut artifact);
        template
            .write_displacement(&mut gzip, fill)
            .and_then(|()| Ok(gzip.finish().map(|_| ())?))
    } else {
        template.write_displacement(&mut artifact, fill)
    };
    finish(artifact, written)
}

fn is_gzip(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("gz"))
}

/// Puts a file in place, of which all was written.
fn finish(artifact: Artifact, written: Result<(), WriteError>) -> Result<(), WriteError> {
    match written {
        Ok(()) => Ok(artifact.commit()?),
        Err(WriteError::Io(error)) => Err(artifact.failed(error).into()),
        Err(other) => Err(other),
    }
}

/// What a file begins with: the header, and that no extension follows.
fn start(header: &RawHeader) -> [u8; FIRST_OFFSET] {
    let mut start = [0; FIRST_OFFSET];
    start[..HEADER_LEN].copy_from_slice(&header.bytes);
    start
}

/// Makes the rows of a volume in stored order, many at a time and in parallel, and writes them.
/// `fill` gets the row's number (j + k · nj) and the row's bytes. `bytes` is memory to work in.
pub(in crate::io) fn write_rows(
    to: &mut impl Write,
    stored: [usize; 3],
    sample_bytes: usize,
    bytes: &mut Vec<u8>,
    fill: impl Fn(usize, &mut [u8]) + Sync,
) -> io::Result<()> {
    let [ni, nj, nk] = stored;
    let row_bytes = ni * sample_bytes;
    let rows = nj * nk;
    let batch = (BATCH / row_bytes).clamp(1, rows);
    bytes.resize(batch * row_bytes, 0);
    for first in (0..rows).step_by(batch) {
        let rows = batch.min(rows - first);
        let bytes = &mut bytes[..rows * row_bytes];
        fill_rows(bytes, row_bytes, first, &fill);
        to.write_all(bytes)?;
    }
    Ok(())
}

/// Fills rows of bytes in parallel, each by its number, counted on from `first`.
fn fill_rows(
    bytes: &mut [u8],
    row_bytes: usize,
    first: usize,
    fill: impl Fn(usize, &mut [u8]) + Sync,
) {
    // Short rows are handed out several at a time.
    let share = ((64 << 10) / row_bytes).max(1);
    bytes
        .par_chunks_mut(row_bytes)
        .with_min_len(share)
        .enumerate()
        .for_each(|(row, bytes)| fill(first + row, bytes));
}

/// A row by its number, of an array indexed `[k, j, i]`.
pub(in crate::io) fn row_of<T>(
    stored: ArrayView3<'_, T>,
    row: usize,
    nj: usize,
) -> ArrayView1<'_, T> {
    stored
        .index_axis_move(Axis(0), row / nj)
        .index_axis_move(Axis(0), row % nj)
}

fn encode<T: Sample>(samples: ArrayView1<'_, T>, order: ByteOrder, bytes: &mut [u8]) {
    let slots = bytes.chunks_exact_mut(size_of::<T>());
    for (slot, sample) in slots.zip(samples) {
        let mut stored = sample.le_bytes();
        if order == ByteOrder::Big {
            stored.as_mut().reverse();
        }
        slot.copy_from_slice(stored.as_ref());
    }
}

/// Whether two grids hold every voxel at the same place: as they are affine, it is enough to look at
/// the first voxel and the ends of the three axes.
fn same_place(a: &Grid, b: &Grid) -> bool {
    let [x, y, z] = a.last_index().to_array();
    let corners = [[0.0; 3], [x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]];
    a.dims() == b.dims()
        && corners.into_iter().all(|corner| {
            let at =
                |grid: &Grid| grid.grid_to_lps(grid.index_to_grid(ContinuousIndex::from(corner)));
            (at(a) - at(b)).0.length() <= SAME_PLACE_MM
        })
}

fn describe(grid: &Grid) -> String {
    let ([nx, ny, nz], spacing, origin) = (grid.dims(), grid.spacing(), grid.origin().0);
    format!("{nx}×{ny}×{nz} voxels of {spacing} mm from {origin} (LPS)")
}
