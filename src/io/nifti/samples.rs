//! Samples from a stream into LPS order, a few rows at a time.
//!
//! Each piece goes through the `nifti` crate's decoder with the scaling left out, so values are what the
//! file stores: the crate's conversion from a type to itself changes no bit, 64-bit integers included
//! (its scaling would go through floats, and truncate). In pieces, because the decoder allocates without
//! asking; so beside the samples themselves only a piece or two is held.

use ndarray::parallel::prelude::*;
use ndarray::{Array3, ArrayView2, ArrayView3, ArrayViewMut3, Axis, Slice};
use nifti::{DataElement, InMemNiftiVolume, IntoNdArray};

use super::error::NiftiProblem;
use super::header::Header;
use super::source::{Content, Source};
use super::template::Template;
use crate::volume::{AnyVolume, Rescale, Sample, SampleType, Spares, Volume, VolumeError, zeroed};

/// Bytes decoded at once.
const PIECE: usize = 1 << 20;

/// The samples of an open file, and the SHA-256 of all its bytes.
pub(super) fn read(
    mut source: Source,
    header: &Header,
    template: &Template,
    spares: &Spares,
) -> Result<(AnyVolume, [u8; 32]), NiftiProblem> {
    source.check_claim(header.needed())?;
    match header.sample_type {
        SampleType::U8 => typed::<u8>(source, header, template, spares),
        SampleType::I8 => typed::<i8>(source, header, template, spares),
        SampleType::U16 => typed::<u16>(source, header, template, spares),
        SampleType::I16 => typed::<i16>(source, header, template, spares),
        SampleType::U32 => typed::<u32>(source, header, template, spares),
        SampleType::I32 => typed::<i32>(source, header, template, spares),
        SampleType::U64 => typed::<u64>(source, header, template, spares),
        SampleType::I64 => typed::<i64>(source, header, template, spares),
        SampleType::F32 => typed::<f32>(source, header, template, spares),
        SampleType::F64 => typed::<f64>(source, header, template, spares),
    }
}

fn typed<T: Sample + DataElement>(
    mut source: Source,
    header: &Header,
    template: &Template,
    spares: &Spares,
) -> Result<(AnyVolume, [u8; 32]), NiftiProblem> {
    let grid = template.grid().clone();
    let [nx, ny, nz] = grid.dims();
    let memory = |_| NiftiProblem::Memory {
        bytes: header.sample_bytes(),
    };
    // Before there are samples, while the packed file is held.
    let whole = header
        .order
        .is_native()
        .then(|| source.whole::<T>(header.needed()));
    let samples = zeroed::<T>(grid.len()).map_err(memory)?;
    let mut samples = Array3::from_shape_vec((nz, ny, nx), samples).map_err(decode)?;
    let stored = template.orientation().stored_view(samples.view_mut());
    let mut odd = NotNumbers::default();
    let sha256 = match whole.flatten() {
        Some((numbers, sha256)) => {
            odd = place(&numbers, header, stored)?;
            spares.give(numbers);
            sha256
        }
        None => stream(source.content()?, header, stored, &mut odd)?,
    };
    odd.verdict(grid.len())?;
    let volume =
        Volume::new(grid, header.rescale, samples).map_err(|error: VolumeError| decode(error))?;
    Ok((T::wrap(volume), sha256))
}

/// Puts the samples of a file, of which all bytes are given as numbers, into an array as they are stored.
fn place<T: Sample>(
    numbers: &[T],
    header: &Header,
    mut stored: ArrayViewMut3<'_, T>,
) -> Result<NotNumbers, NiftiProblem> {
    let [ni, nj, nk] = header.dims;
    let begin = usize::try_from(header.vox_offset).map_err(decode)? / size_of::<T>();
    let numbers = numbers.get(begin..).unwrap_or_default();
    let numbers = ArrayView3::from_shape((nk, nj, ni), numbers).map_err(decode)?;
    let planes = stored.axis_iter_mut(Axis(0)).into_par_iter();
    let planes = planes.zip(numbers.axis_iter(Axis(0)).into_par_iter());
    let odd = planes.enumerate().map(|(k, (mut to, from))| {
        to.assign(&from);
        let mut odd = NotNumbers::default();
        odd.look(
            from.as_slice().unwrap_or_default(),
            header.rescale,
            [ni, 0, k],
        );
        odd
    });
    let odd: Vec<NotNumbers> = odd.collect();
    Ok(odd.into_iter().fold(NotNumbers::default(), NotNumbers::and))
}

/// Puts the samples of a stream into an array as they are stored; returns the SHA-256 of the file.
fn stream<T: Sample + DataElement>(
    mut content: Content,
    header: &Header,
    mut stored: ArrayViewMut3<'_, T>,
    odd: &mut NotNumbers,
) -> Result<[u8; 32], NiftiProblem> {
    content.skip(header.vox_offset)?;
    let [ni, nj, nk] = header.dims;
    let rows_at_once = (PIECE / (ni * size_of::<T>())).clamp(1, nj);
    for k in 0..nk {
        for j in (0..nj).step_by(rows_at_once) {
            let rows = rows_at_once.min(nj - j);
            let piece = piece::<T>(&mut content, header, rows)?;
            odd.look(&piece, header.rescale, [ni, j, k]);
            let piece = ArrayView2::from_shape((rows, ni), &piece).map_err(decode)?;
            let mut plane = stored.index_axis_mut(Axis(0), k);
            plane
                .slice_axis_mut(Axis(0), Slice::from(j..j + rows))
                .assign(&piece);
        }
    }
    content.finish()
}

fn decode(error: impl ToString) -> NiftiProblem {
    NiftiProblem::Decode(error.to_string())
}

/// The next `rows` stored rows, i fastest.
fn piece<T: DataElement>(
    content: &mut Content,
    header: &Header,
    rows: usize,
) -> Result<Vec<T>, NiftiProblem> {
    let [ni, ..] = header.dims;
    let wanted = ni * rows * size_of::<T>();
    let bytes = content.read(wanted)?;
    if bytes.len() < wanted {
        let needed = header.needed();
        return Err(NiftiProblem::Truncated {
            needed,
            missing: needed - content.position(),
        });
    }
    let [ni, rows] = [ni, rows].map(|n| u16::try_from(n).unwrap_or_default());
    let dim = [2, ni, rows, 1, 1, 1, 1, 1];
    // A slope of zero is the crate's "no scaling".
    let (slope, intercept) = (0.0, 0.0);
    let order = header.order.endianness();
    let array =
        InMemNiftiVolume::from_raw_fields(dim, T::DATA_TYPE, slope, intercept, bytes, order)
            .and_then(|volume| volume.into_ndarray::<T>())
            .map_err(decode)?;
    // The crate's arrays are in Fortran order, which is the file's.
    Ok(array.into_raw_vec_and_offset().0)
}

/// NaN, infinity, and what is beyond the `f32` that Hounsfield units are drawn and meshed in, counted.
#[derive(Debug, Default)]
pub(in crate::io) struct NotNumbers {
    count: u64,
    first: Option<([usize; 3], f64)>,
}

impl NotNumbers {
    /// Looks through whole rows of `ni` samples, the first of them row `j` of plane `k`.
    ///
    /// Integers need no look: a header's rescale is bounded so that all of them are Hounsfield units.
    pub(in crate::io) fn look<T: Sample>(
        &mut self,
        piece: &[T],
        rescale: Rescale,
        [ni, j, k]: [usize; 3],
    ) {
        if !matches!(T::TYPE, SampleType::F32 | SampleType::F64) {
            return;
        }
        for (index, sample) in piece.iter().enumerate() {
            let value = sample.to_f64();
            if !(rescale.to_hu(value) as f32).is_finite() {
                self.count += 1;
                self.first
                    .get_or_insert(([index % ni, j + index / ni, k], value));
            }
        }
    }

    /// Of these samples and those that come after.
    fn and(self, after: Self) -> Self {
        Self {
            count: self.count + after.count,
            first: self.first.or(after.first),
        }
    }

    pub(in crate::io) fn verdict(self, total: usize) -> Result<(), NiftiProblem> {
        match self.first {
            None => Ok(()),
            Some((first, value)) => Err(NiftiProblem::NotFinite {
                count: self.count,
                total: total as u64,
                first,
                value,
            }),
        }
    }
}
