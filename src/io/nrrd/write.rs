//! Volumes as NRRD files: one file, gzip, little endian, LPS.

use std::io::Write;
use std::path::Path;

use crate::io::artifact::Artifact;
use crate::io::gzip::GzipWriter;
use crate::io::nifti::{Template, WriteError, row_of, write_rows};
use crate::volume::{Rescale, Sample, SampleType, Volume};

/// How the samples of a volume are written. NRRD has no rescale: where the samples are not Hounsfield units
/// already, those are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputType {
    /// The samples as they are.
    AsStored,
    /// Hounsfield units in this type.
    Hu(SampleType),
}

impl OutputType {
    /// For samples of a type, a rescale, and Hounsfield units from `hu_range[0]` to `hu_range[1]`: as they
    /// are where they are Hounsfield units; else `i16` where that holds all of them exactly; else a float
    /// of 32 bits, or of 64 where the samples have 32 or more.
    pub fn choose(sample_type: SampleType, rescale: Rescale, hu_range: [f64; 2]) -> Self {
        use SampleType::{F32, F64, I8, I16, U8, U16};
        if rescale == Rescale::NONE {
            return Self::AsStored;
        }
        let is_integer = !matches!(sample_type, F32 | F64);
        let is_whole = [rescale.slope, rescale.intercept]
            .iter()
            .all(|number| number.fract() == 0.0);
        let [low, high] = hu_range;
        let fits = low >= i16::MIN.into() && high <= i16::MAX.into();
        Self::Hu(match sample_type {
            _ if is_integer && is_whole && fits => I16,
            U8 | I8 | U16 | I16 | F32 => F32,
            _ => F64,
        })
    }
}

/// Writes a volume as a file that appears whole or not at all. Its axes are stored as `template` stores them;
/// its position is that of its grid.
///
/// # Errors
/// [`WriteError::Mismatch`] where the volume's size is not the template's; else the file named.
pub fn save_volume<T: Sample>(
    path: &Path,
    template: &Template,
    volume: &Volume<T>,
    output: OutputType,
) -> Result<(), WriteError> {
    let (found, expected) = (volume.grid().dims(), template.grid().dims());
    if found != expected {
        return Err(WriteError::Mismatch {
            what: "grid",
            found: format!("{found:?}"),
            expected: format!("{expected:?}"),
        });
    }
    let mut artifact = Artifact::create(path)?;
    let written = write(&mut artifact, template, volume, output);
    match written {
        Ok(()) => Ok(artifact.commit()?),
        Err(error) => Err(artifact.failed(error).into()),
    }
}

fn write<T: Sample>(
    to: &mut impl Write,
    template: &Template,
    volume: &Volume<T>,
    output: OutputType,
) -> std::io::Result<()> {
    to.write_all(header(template, volume, output).as_bytes())?;
    let mut gzip = GzipWriter::new(to);
    let rescale = volume.rescale();
    let hu = |sample: T| rescale.to_hu(sample.to_f64());
    match output {
        OutputType::AsStored => rows(&mut gzip, template, volume, |sample| sample)?,
        OutputType::Hu(SampleType::I16) => rows(&mut gzip, template, volume, |sample| {
            i16::from_interpolated(hu(sample))
        })?,
        OutputType::Hu(SampleType::F32) => {
            rows(&mut gzip, template, volume, |sample| hu(sample) as f32)?;
        }
        OutputType::Hu(_) => rows(&mut gzip, template, volume, hu)?,
    }
    gzip.finish()?.flush()
}

/// All samples in stored order, each turned into what is written.
fn rows<T: Sample, U: Sample>(
    to: &mut impl Write,
    template: &Template,
    volume: &Volume<T>,
    convert: impl Fn(T) -> U + Sync,
) -> std::io::Result<()> {
    let stored = template.orientation().stored_view(volume.samples());
    let dims = template.stored_dims();
    let [_, nj, _] = dims;
    let memory = &mut Vec::new();
    write_rows(to, dims, size_of::<U>(), memory, |row, bytes| {
        let slots = bytes.chunks_exact_mut(size_of::<U>());
        for (slot, &sample) in slots.zip(row_of(stored, row, nj)) {
            slot.copy_from_slice(convert(sample).le_bytes().as_ref());
        }
    })
}

fn header<T: Sample>(template: &Template, volume: &Volume<T>, output: OutputType) -> String {
    let sample_type = match output {
        OutputType::AsStored => T::TYPE,
        OutputType::Hu(hu) => hu,
    };
    let (columns, origin) = template.orientation().placed(volume.grid());
    // Numbers are written with as many digits as bring them back; there is no negative zero.
    let vector = |v: glam::DVec3| {
        let [x, y, z] = (v + 0.0).to_array();
        format!("({x},{y},{z})")
    };
    let [i, j, k] = [columns.x_axis, columns.y_axis, columns.z_axis].map(vector);
    let [ni, nj, nk] = template.stored_dims();
    format!(
        "NRRD0004\n\
         # https://teem.sourceforge.net/nrrd/format.html\n\
         type: {}\n\
         dimension: 3\n\
         space: left-posterior-superior\n\
         sizes: {ni} {nj} {nk}\n\
         space directions: {i} {j} {k}\n\
         kinds: domain domain domain\n\
         endian: little\n\
         encoding: gzip\n\
         space origin: {}\n\
         \n",
        type_name(sample_type),
        vector(origin.0),
    )
}

/// The names that every reader knows.
fn type_name(sample_type: SampleType) -> &'static str {
    match sample_type {
        SampleType::U8 => "unsigned char",
        SampleType::I8 => "signed char",
        SampleType::U16 => "unsigned short",
        SampleType::I16 => "short",
        SampleType::U32 => "unsigned int",
        SampleType::I32 => "int",
        SampleType::U64 => "unsigned long long int",
        SampleType::I64 => "long long int",
        SampleType::F32 => "float",
        SampleType::F64 => "double",
    }
}
