//! The 348 bytes: recognised, checked, and taken apart before anything is allocated.

use std::fmt;

use nifti::{Endianness, NiftiHeader};

use super::error::NiftiProblem;
use crate::space::MAX_AXIS_LENGTH;
use crate::volume::{Rescale, SampleType};

/// Bytes of a NIfTI-1 header.
pub(super) const HEADER_LEN: usize = 348;

/// Header and extension flag: where the samples of a single file begin at the earliest.
pub(in crate::io) const FIRST_OFFSET: usize = 352;

/// The largest `vox_offset`: beyond it the field, a float, no longer counts every byte.
const LAST_OFFSET: f32 = 16_777_216.0;

/// Places of header fields that are patched, in bytes from the start (nifti1.h).
pub(super) mod at {
    pub const DATA_TYPE: usize = 4;
    pub const EXTENTS: usize = 32;
    pub const REGULAR: usize = 38;
    pub const DIM: usize = 40;
    pub const INTENT_P1: usize = 56;
    pub const INTENT_CODE: usize = 68;
    /// `bitpix` follows it.
    pub const DATATYPE: usize = 70;
    pub const SLICE_START: usize = 74;
    pub const PIXDIM: usize = 76;
    pub const VOX_OFFSET: usize = 108;
    pub const SCL_SLOPE: usize = 112;
    pub const SCL_INTER: usize = 116;
    pub const SLICE_END: usize = 120;
    pub const SLICE_CODE: usize = 122;
    pub const XYZT_UNITS: usize = 123;
    pub const CAL_MAX: usize = 124;
    pub const CAL_MIN: usize = 128;
    pub const DESCRIP: usize = 148;
    /// `sform_code` follows it.
    pub const QFORM_CODE: usize = 252;
    pub const QUATERN_B: usize = 256;
    pub const QOFFSET_X: usize = 268;
    pub const SROW_X: usize = 280;
    pub const INTENT_NAME: usize = 328;
    pub const MAGIC: usize = 344;
}

/// The order of a number's bytes in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub enum ByteOrder {
    Little,
    Big,
}

impl ByteOrder {
    fn i32(self, bytes: [u8; 4]) -> i32 {
        match self {
            Self::Little => i32::from_le_bytes(bytes),
            Self::Big => i32::from_be_bytes(bytes),
        }
    }

    fn i16(self, bytes: [u8; 2]) -> i16 {
        match self {
            Self::Little => i16::from_le_bytes(bytes),
            Self::Big => i16::from_be_bytes(bytes),
        }
    }

    /// Whether it is this machine's.
    pub(super) fn is_native(self) -> bool {
        self.i32(1_i32.to_ne_bytes()) == 1
    }

    /// As the `nifti` crate calls it.
    pub(super) fn endianness(self) -> Endianness {
        match self {
            Self::Little => Endianness::Little,
            Self::Big => Endianness::Big,
        }
    }
}

impl fmt::Display for ByteOrder {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self {
            Self::Little => "little endian",
            Self::Big => "big endian",
        })
    }
}

/// Where a volume's position in space was taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transform {
    /// The matrix (`srow_x`, `srow_y`, `srow_z`).
    Sform,
    /// The quaternion.
    Qform,
    /// Neither: spacing is known, orientation and position are assumed.
    None,
}

impl fmt::Display for Transform {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self {
            Self::Sform => "sform",
            Self::Qform => "qform",
            Self::None => "pixdim (there is neither sform nor qform)",
        })
    }
}

/// A header whose every field that matters has been checked, the affine excepted.
#[derive(Debug, Clone)]
pub(super) struct Header {
    pub(super) bytes: [u8; HEADER_LEN],
    pub(super) parsed: NiftiHeader,
    pub(super) order: ByteOrder,
    /// Lengths by stored axis.
    pub(super) dims: [usize; 3],
    pub(super) sample_type: SampleType,
    pub(super) rescale: Rescale,
    pub(super) vox_offset: u64,
}

impl Header {
    /// Takes apart the first bytes of an (inflated) file: 352 of them, or all where it is shorter.
    pub(super) fn parse(start: &[u8]) -> Result<Self, NiftiProblem> {
        let order = recognise(start)?;
        let bytes: [u8; HEADER_LEN] = start
            .get(..HEADER_LEN)
            .and_then(|bytes| bytes.try_into().ok())
            .ok_or(NiftiProblem::HeaderCut { found: start.len() })?;
        // The crate tells the byte order from dim[0]; checked first, the two cannot disagree.
        let [a, b] = [bytes[at::DIM], bytes[at::DIM + 1]];
        let rank = order.i16([a, b]);
        if !(1..=7).contains(&rank) {
            return Err(field("dim[0]", rank, "the number of axes, 3 to 7", DAMAGED));
        }
        let parsed = NiftiHeader::from_reader(&bytes[..])
            .map_err(|error| NiftiProblem::Decode(error.to_string()))?;
        if parsed.endianness != order.endianness() {
            return Err(NiftiProblem::Decode(
                "sizeof_hdr and dim[0] differ in byte order".into(),
            ));
        }
        let dims = dims(&parsed, rank)?;
        let sample_type = sample_type(&parsed)?;
        let rescale = rescale(&parsed)?;
        let vox_offset = vox_offset(&parsed)?;
        Ok(Self {
            bytes,
            parsed,
            order,
            dims,
            sample_type,
            rescale,
            vox_offset,
        })
    }

    /// Bytes of the samples: at most 32767³ × 8, which fits.
    pub(super) fn sample_bytes(&self) -> u64 {
        let voxels: u64 = self.dims.iter().map(|&n| n as u64).product();
        voxels * self.sample_type.bytes() as u64
    }

    /// Bytes from the start of the file to the end of the samples.
    pub(super) fn needed(&self) -> u64 {
        self.vox_offset + self.sample_bytes()
    }
}

const DAMAGED: &str = "the header is damaged: export the file again";

pub(super) fn field(
    field: &'static str,
    found: impl ToString,
    expected: impl Into<String>,
    remedy: &'static str,
) -> NiftiProblem {
    NiftiProblem::Field {
        field,
        found: found.to_string(),
        expected: expected.into(),
        remedy,
    }
}

/// The byte order of a single-file NIfTI-1 header, or what the bytes are instead.
fn recognise(start: &[u8]) -> Result<ByteOrder, NiftiProblem> {
    let foreign = |found, remedy| Err(NiftiProblem::Foreign { found, remedy });
    let convert = "convert it to NIfTI-1 (.nii or .nii.gz)";
    if start.is_empty() {
        return Err(NiftiProblem::Empty);
    }
    if start.get(128..132) == Some(b"DICM") {
        return foreign(
            "a single DICOM file",
            "name the folder of its series, or convert it to NIfTI-1",
        );
    }
    if start.starts_with(b"NRRD") {
        return foreign("an NRRD file", convert);
    }
    if start.starts_with(b"ObjectType") || start.starts_with(b"NDims") {
        return foreign("a MetaImage file", convert);
    }
    let Some(size) = start.first_chunk::<4>() else {
        return Err(NiftiProblem::HeaderCut { found: start.len() });
    };
    let order = match (ByteOrder::Little.i32(*size), ByteOrder::Big.i32(*size)) {
        (348, _) => ByteOrder::Little,
        (_, 348) => ByteOrder::Big,
        (540, _) | (_, 540) => return foreign("a NIfTI-2 file", "convert it to NIfTI-1"),
        (found, _) => return Err(NiftiProblem::NotNifti { found }),
    };
    let Some(magic) = start.get(at::MAGIC..HEADER_LEN) else {
        return Err(NiftiProblem::HeaderCut { found: start.len() });
    };
    match magic {
        b"n+1\0" => Ok(order),
        b"ni1\0" => foreign(
            "the header of a .hdr/.img pair",
            "join the two into a single .nii file (nibabel and FSL can)",
        ),
        [0, ..] => foreign(
            "an Analyze 7.5 file, which does not tell left from right",
            convert,
        ),
        other => Err(field(
            "magic",
            format!("\"{}\"", other.escape_ascii()),
            "\"n+1\\0\" (a single NIfTI-1 file)",
            DAMAGED,
        )),
    }
}

const DIM_NAMES: [&str; 8] = [
    "dim[0]", "dim[1]", "dim[2]", "dim[3]", "dim[4]", "dim[5]", "dim[6]", "dim[7]",
];

fn dims(header: &NiftiHeader, rank: i16) -> Result<[usize; 3], NiftiProblem> {
    if rank < 3 {
        return Err(field(
            "dim[0]",
            rank,
            "3 axes",
            "one slice is not a volume: stack the slices",
        ));
    }
    let axes = DIM_NAMES.iter().zip(header.dim).enumerate().skip(1);
    for (axis, (&name, raw)) in axes.take(rank.unsigned_abs().into()) {
        // The crate reads these signed numbers as unsigned.
        let length = raw.cast_signed();
        if length < 1 {
            return Err(field(
                name,
                length,
                format!("a length of 1 to {MAX_AXIS_LENGTH}"),
                DAMAGED,
            ));
        }
        if axis > 3 && length != 1 {
            let remedy = if header.intent_code == 1007 || header.intent_code == 1006 {
                "this is a vector field, not a CT"
            } else {
                "the file holds several volumes: extract one of them"
            };
            return Err(field(name, length, "1, as a CT has three axes", remedy));
        }
    }
    let [_, x, y, z, ..] = header.dim.map(usize::from);
    Ok([x, y, z])
}

fn sample_type(header: &NiftiHeader) -> Result<SampleType, NiftiProblem> {
    use SampleType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    let refused = |name: &str| {
        let found = format!("{} ({name})", header.datatype);
        let expected = "an integer of 8 to 64 bits, or a float of 32 or 64";
        Err(field(
            "datatype",
            found,
            expected,
            "convert it to int16 Hounsfield units",
        ))
    };
    let found = match header.datatype {
        2 => U8,
        4 => I16,
        8 => I32,
        16 => F32,
        64 => F64,
        256 => I8,
        512 => U16,
        768 => U32,
        1024 => I64,
        1280 => U64,
        1 => return refused("binary, one bit a voxel"),
        32 => return refused("complex64"),
        128 => return refused("RGB24"),
        1536 => return refused("float128"),
        1792 => return refused("complex128"),
        2048 => return refused("complex256"),
        2304 => return refused("RGBA32"),
        _ => return refused("unknown"),
    };
    let bits = found.bytes() * 8;
    if usize::try_from(header.bitpix) != Ok(bits) {
        let expected = format!("{bits}, the size of datatype {} ({found})", header.datatype);
        return Err(field("bitpix", header.bitpix, expected, DAMAGED));
    }
    Ok(found)
}

/// The largest slope and intercept: the largest 64-bit integer times this is still an `f32`.
const MAX_RESCALE: f32 = 1e18;

fn rescale(header: &NiftiHeader) -> Result<Rescale, NiftiProblem> {
    let (slope, intercept) = (header.scl_slope, header.scl_inter);
    if slope == 0.0 || !slope.is_finite() {
        return Ok(Rescale::NONE);
    }
    if !intercept.is_finite() {
        let expected = "a finite intercept beside the slope";
        return Err(field(
            "scl_inter",
            intercept,
            expected,
            "correct it, or set scl_slope to 0",
        ));
    }
    for (name, value) in [("scl_slope", slope), ("scl_inter", intercept)] {
        if value.abs() > MAX_RESCALE {
            let expected = format!("at most {MAX_RESCALE:e} either way");
            return Err(field(name, value, expected, DAMAGED));
        }
    }
    Ok(Rescale {
        slope: slope.into(),
        intercept: intercept.into(),
    })
}

fn vox_offset(header: &NiftiHeader) -> Result<u64, NiftiProblem> {
    let offset = header.vox_offset;
    let fits = (FIRST_OFFSET as f32..=LAST_OFFSET).contains(&offset) && offset.fract() == 0.0;
    if !fits {
        let expected = format!("a whole number of bytes, {FIRST_OFFSET} to {LAST_OFFSET}");
        return Err(field("vox_offset", offset, expected, DAMAGED));
    }
    Ok(offset as u64)
}
