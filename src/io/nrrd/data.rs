//! Samples from a file into LPS order, a few rows at a time.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use ndarray::{Array3, ArrayView2, Axis, Slice};
use sha2::{Digest, Sha256};

use super::error::NrrdProblem;
use super::header::{Encoding, Fields, MAX_HEADER, Skip, end_of_header, shown};
use crate::io::nifti::{
    ByteOrder, Content, LARGEST_RATIO, NiftiProblem, NotNumbers, Scan, check_claim,
};
use crate::volume::{AnyVolume, Rescale, Sample, SampleType, Volume, zeroed};

/// Bytes decoded at once.
const PIECE: usize = 1 << 20;

/// The most bytes that lines before the samples may have.
const MAX_SKIPPED_LINES: u64 = 1 << 20;

/// A checked header, and the file that holds the samples.
#[derive(Debug)]
pub(super) struct Opened {
    pub header: Fields,
    /// At the first byte that the encoding is of.
    file: File,
    /// Of all bytes before that.
    sha256: Sha256,
    /// Where that is.
    begin: u64,
    /// Bytes from there to the end of the file.
    left: u64,
    /// Passed over, once inflated, to reach the samples.
    skip: u64,
}

/// Opens a file, and finds that it promises no more samples than it can hold.
pub(super) fn open(path: &Path) -> Result<Opened, NrrdProblem> {
    let (mut file, len) = open_file(path)?;
    let mut start = Vec::new();
    let limit = MAX_HEADER as u64 + 1;
    Read::by_ref(&mut file)
        .take(limit)
        .read_to_end(&mut start)
        .map_err(NiftiProblem::Io)?;
    let end = match end_of_header(&start) {
        Some(end) => end,
        None if start.len() > MAX_HEADER => return Err(NrrdProblem::HeaderTooLong),
        None => start.len(),
    };
    let before = start.get(..end).unwrap_or_default();
    let header = Fields::parse(before)?;
    let mut sha256 = Sha256::new();
    let (mut file, len, begin) = match &header.data_file {
        None => {
            sha256.update(before);
            (file, len, end as u64)
        }
        Some(name) => {
            // The whole header file, which nothing but a header should be in.
            sha256.update(&start);
            let folder = path.parent().unwrap_or(Path::new(""));
            let (file, len) = open_file(&folder.join(name)).map_err(|problem| match problem {
                NiftiProblem::Io(error) => NrrdProblem::DataFile {
                    name: shown(name),
                    error,
                },
                other => other.into(),
            })?;
            (file, len, 0)
        }
    };
    file.seek(SeekFrom::Start(begin))
        .map_err(NiftiProblem::Io)?;
    let begin = begin + skip_lines(&mut file, begin, header.line_skip, &mut sha256)?;
    let left = len.saturating_sub(begin);
    let samples = header.sample_bytes();
    let skip = match header.byte_skip {
        Skip::Bytes(skip) => skip,
        Skip::FromEnd => left.saturating_sub(samples),
    };
    let needed = samples.saturating_add(skip);
    match header.encoding {
        Encoding::Raw if needed > left => Err(NiftiProblem::Truncated {
            needed: begin.saturating_add(needed),
            missing: needed - left,
        }
        .into()),
        Encoding::Gzip if needed > left.saturating_mul(LARGEST_RATIO) => {
            Err(NiftiProblem::Implausible {
                needed,
                compressed: left,
            }
            .into())
        }
        _ => Ok(Opened {
            header,
            file,
            sha256,
            begin,
            left,
            skip,
        }),
    }
}

/// A file and its length. Asked for what it is before it is opened: a pipe would wait for someone to write.
fn open_file(path: &Path) -> Result<(File, u64), NiftiProblem> {
    let metadata = fs::metadata(path).map_err(NiftiProblem::Io)?;
    if !metadata.is_file() {
        return Err(NiftiProblem::NotAFile {
            found: if metadata.is_dir() {
                "a folder"
            } else {
                "a pipe or a device"
            },
        });
    }
    let file = File::open(path).map_err(NiftiProblem::Io)?;
    Ok((file, metadata.len()))
}

/// Passes over some lines, which begin at `begin`, and hashes them; returns their length. The file is then
/// behind them.
fn skip_lines(
    file: &mut File,
    begin: u64,
    lines: u64,
    sha256: &mut Sha256,
) -> Result<u64, NrrdProblem> {
    if lines == 0 {
        return Ok(0);
    }
    let mut reader = BufReader::new(Read::by_ref(file).take(MAX_SKIPPED_LINES));
    let mut skipped = 0;
    let mut line = Vec::new();
    for _ in 0..lines {
        line.clear();
        skipped += reader
            .read_until(b'\n', &mut line)
            .map_err(NiftiProblem::Io)? as u64;
        sha256.update(&line);
        if !line.ends_with(b"\n") {
            return Err(NrrdProblem::Field {
                field: "line skip",
                found: lines.to_string(),
                expected: format!("lines of at most {MAX_SKIPPED_LINES} bytes in all"),
            });
        }
    }
    drop(reader);
    file.seek(SeekFrom::Start(begin + skipped))
        .map_err(NiftiProblem::Io)?;
    Ok(skipped)
}

/// The samples of an open file.
pub(super) fn read(file: Opened) -> Result<Scan, NrrdProblem> {
    match file.header.sample_type {
        SampleType::U8 => typed::<u8>(file),
        SampleType::I8 => typed::<i8>(file),
        SampleType::U16 => typed::<u16>(file),
        SampleType::I16 => typed::<i16>(file),
        SampleType::U32 => typed::<u32>(file),
        SampleType::I32 => typed::<i32>(file),
        SampleType::U64 => typed::<u64>(file),
        SampleType::I64 => typed::<i64>(file),
        SampleType::F32 => typed::<f32>(file),
        SampleType::F64 => typed::<f64>(file),
    }
}

fn typed<T: Sample + Decode>(file: Opened) -> Result<Scan, NrrdProblem> {
    let Opened {
        header,
        mut file,
        sha256,
        begin,
        left,
        skip,
    } = file;
    let placed = header.placed()?;
    let (grid, template) = (placed.grid, placed.template);
    let [nx, ny, nz] = grid.dims();
    let memory = |_| NiftiProblem::Memory {
        bytes: header.sample_bytes(),
    };
    if header.encoding == Encoding::Gzip {
        check_claim(&file, skip.saturating_add(header.sample_bytes()), left)?;
        file.seek(SeekFrom::Start(begin))
            .map_err(NiftiProblem::Io)?;
    }
    let samples = zeroed::<T>(grid.len()).map_err(memory)?;
    let mut samples = Array3::from_shape_vec((nz, ny, nx), samples).map_err(decode)?;

    let mut content = Content::new(file, header.encoding == Encoding::Gzip, sha256);
    content.skip(skip)?;
    let mut stored = template.orientation().stored_view(samples.view_mut());
    let mut odd = NotNumbers::default();
    let [ni, nj, nk] = header.sizes;
    let rows_at_once = (PIECE / (ni * size_of::<T>())).clamp(1, nj);
    for k in 0..nk {
        for j in (0..nj).step_by(rows_at_once) {
            let rows = rows_at_once.min(nj - j);
            let wanted = ni * rows * size_of::<T>();
            let bytes = content.read(wanted)?;
            if bytes.len() < wanted {
                let needed = skip.saturating_add(header.sample_bytes());
                return Err(NiftiProblem::Truncated {
                    needed,
                    missing: needed.saturating_sub(content.position()),
                }
                .into());
            }
            let piece: Vec<T> = bytes
                .chunks_exact(size_of::<T>())
                .map(|sample| T::decode(sample, header.order))
                .collect();
            odd.look(&piece, Rescale::NONE, [ni, j, k]);
            let piece = ArrayView2::from_shape((rows, ni), &piece).map_err(decode)?;
            let mut plane = stored.index_axis_mut(Axis(0), k);
            plane
                .slice_axis_mut(Axis(0), Slice::from(j..j + rows))
                .assign(&piece);
        }
    }
    let sha256 = content.finish()?;
    odd.verdict(grid.len())?;
    let volume: Volume<T> = Volume::new(grid, Rescale::NONE, samples).map_err(decode)?;
    let volume: AnyVolume = T::wrap(volume);
    Ok(Scan {
        volume,
        template,
        sha256,
    })
}

fn decode(error: impl ToString) -> NiftiProblem {
    NiftiProblem::Decode(error.to_string())
}

/// A sample from its bytes.
trait Decode {
    /// Zero where there are not as many bytes as it has.
    fn decode(bytes: &[u8], order: ByteOrder) -> Self;
}

macro_rules! decode {
    ($($type:ty),*) => {$(
        impl Decode for $type {
            #[inline]
            fn decode(bytes: &[u8], order: ByteOrder) -> Self {
                let bytes = bytes.try_into().unwrap_or_default();
                match order {
                    ByteOrder::Little => Self::from_le_bytes(bytes),
                    ByteOrder::Big => Self::from_be_bytes(bytes),
                }
            }
        }
    )*};
}
decode!(u8, i8, u16, i16, u32, i32, u64, i64, f32, f64);
