//! The lines of a header, checked before anything is allocated.

use glam::{DMat3, DVec3};

use super::error::NrrdProblem;
use super::{Header, MAGIC};
use crate::io::axes::place;
use crate::io::nifti::{ByteOrder, Template};
use crate::space::{LpsPoint, MAX_AXIS_LENGTH};
use crate::volume::{Rescale, SampleType};

/// The longest header, bytes. 3D Slicer's, with all the key/value pairs of a DICOM import, are a tenth of it.
pub(super) const MAX_HEADER: usize = 256 << 10;

/// Characters of the file's text that a message repeats.
const MAX_SHOWN: usize = 60;

/// How samples are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Raw,
    Gzip,
}

/// Where in the (inflated) bytes the samples begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Skip {
    Bytes(u64),
    /// So that they end where the file does.
    FromEnd,
}

/// A header whose every field that matters has been checked, the geometry excepted.
#[derive(Debug, Clone)]
pub(super) struct Fields {
    /// Lengths by stored axis.
    pub sizes: [usize; 3],
    pub sample_type: SampleType,
    pub order: ByteOrder,
    pub encoding: Encoding,
    pub line_skip: u64,
    pub byte_skip: Skip,
    /// The name of the data file; none where the samples follow the header.
    pub data_file: Option<String>,
    geometry: Geometry,
}

#[derive(Debug, Clone, Copy)]
struct Geometry {
    /// Stored axes, LPS mm.
    columns: DMat3,
    origin: LpsPoint,
    is_placed: bool,
}

/// The fields that matter, under the names by which messages call them.
const KNOWN: [&str; 14] = [
    "type",
    "dimension",
    "sizes",
    "encoding",
    "endian",
    "space",
    "space dimension",
    "space directions",
    "space origin",
    "space units",
    "spacings",
    "line skip",
    "byte skip",
    "data file",
];

/// The lines of a header as they are written.
struct Lines<'a> {
    values: [Option<&'a str>; KNOWN.len()],
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Result<Self, NrrdProblem> {
        let mut values = [None; KNOWN.len()];
        for (number, line) in text.lines().enumerate().skip(1) {
            let line = line.trim_end();
            // The empty line is the last.
            if line.is_empty() {
                break;
            }
            // Comments, and key/value pairs, which are anyone's.
            if line.starts_with('#') || line.contains(":=") {
                continue;
            }
            let Some((name, value)) = line.split_once(':') else {
                return Err(NrrdProblem::Line {
                    line: number + 1,
                    found: shown(line),
                });
            };
            // `datafile` is `data file`, and so on.
            let folded = |name: &str| name.to_ascii_lowercase().replace([' ', '\t'], "");
            let name = folded(name);
            if let Some(at) = KNOWN.iter().position(|known| folded(known) == name)
                && let Some(slot) = values.get_mut(at)
                && slot.replace(value.trim()).is_some()
            {
                return Err(NrrdProblem::Twice { field: KNOWN[at] });
            }
        }
        Ok(Self { values })
    }

    fn get(&self, field: &str) -> Option<&'a str> {
        let at = KNOWN.iter().position(|known| *known == field)?;
        *self.values.get(at)?
    }

    fn need(&self, field: &'static str, remedy: &'static str) -> Result<&'a str, NrrdProblem> {
        self.get(field)
            .ok_or(NrrdProblem::Missing { field, remedy })
    }
}

const EXPORT: &str = "export the volume again";

fn bad(field: &'static str, found: &str, expected: impl Into<String>) -> NrrdProblem {
    NrrdProblem::Field {
        field,
        found: shown(found),
        expected: expected.into(),
    }
}

/// The file's text for a message: control characters escaped, shortened where it is long.
pub(super) fn shown(text: &str) -> String {
    crate::text::shown(text, MAX_SHOWN)
}

/// Where the header ends: the offset of the first byte after its empty line; none where there is none.
pub(super) fn end_of_header(start: &[u8]) -> Option<usize> {
    let mut line = 0;
    for (at, _) in start.iter().enumerate().filter(|(_, byte)| **byte == b'\n') {
        if matches!(start.get(line..at), Some(b"" | b"\r")) {
            return Some(at + 1);
        }
        line = at + 1;
    }
    None
}

impl Fields {
    /// Takes apart the bytes of a header.
    pub fn parse(bytes: &[u8]) -> Result<Self, NrrdProblem> {
        // Comments and values of keys may be in any encoding; fields are ASCII.
        let text = String::from_utf8_lossy(bytes);
        let magic = text.lines().next().unwrap_or_default().trim_end();
        let version = magic.as_bytes().strip_prefix(MAGIC);
        if !matches!(version, Some([b'1'..=b'5'])) {
            return Err(NrrdProblem::Magic {
                found: shown(magic),
            });
        }
        let lines = Lines::new(&text)?;
        let sample_type = sample_type(lines.need("type", EXPORT)?)?;
        let dimension = lines.need("dimension", EXPORT)?;
        if dimension != "3" {
            return Err(bad("dimension", dimension, "3, as a CT has three axes"));
        }
        let sizes = sizes(lines.need("sizes", EXPORT)?)?;
        let encoding = encoding(lines.need("encoding", EXPORT)?)?;
        let order = match lines.get("endian") {
            Some("little") => ByteOrder::Little,
            Some("big") => ByteOrder::Big,
            Some(other) => return Err(bad("endian", other, "`little` or `big`")),
            None if sample_type.bytes() == 1 => ByteOrder::Little,
            None => {
                return Err(NrrdProblem::Missing {
                    field: "endian",
                    remedy: "without it samples of several bytes mean nothing",
                });
            }
        };
        let line_skip = match lines.get("line skip") {
            None => 0,
            Some(text) => text
                .parse()
                .map_err(|_| bad("line skip", text, "a number of lines"))?,
        };
        let byte_skip = match lines.get("byte skip") {
            None => Skip::Bytes(0),
            Some("-1") if encoding == Encoding::Raw => Skip::FromEnd,
            Some(text) => Skip::Bytes(text.parse().map_err(|_| {
                let expected = "a number of bytes, or -1 where the encoding is `raw`";
                bad("byte skip", text, expected)
            })?),
        };
        Ok(Self {
            sizes,
            sample_type,
            order,
            encoding,
            line_skip,
            byte_skip,
            data_file: lines.get("data file").map(data_file).transpose()?,
            geometry: geometry(&lines)?,
        })
    }

    /// Bytes of the samples: at most 32767³ × 8, which fits.
    pub fn sample_bytes(&self) -> u64 {
        let voxels: u64 = self.sizes.iter().map(|&n| n as u64).product();
        voxels * self.sample_type.bytes() as u64
    }

    /// The grid in LPS order, and how to write files that overlay it.
    pub fn placed(&self) -> Result<Header, NrrdProblem> {
        let Geometry {
            columns,
            origin,
            is_placed,
        } = self.geometry;
        let (grid, axes) = place(self.sizes, columns, origin)?;
        let template = Template::for_stored(&grid, axes, self.sample_type, Rescale::NONE)
            .map_err(NrrdProblem::Position)?;
        Ok(Header {
            grid,
            template,
            is_placed,
        })
    }
}

fn sample_type(text: &str) -> Result<SampleType, NrrdProblem> {
    Ok(match text {
        "signed char" | "int8" | "int8_t" => SampleType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => SampleType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            SampleType::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
            SampleType::U16
        }
        "int" | "signed int" | "int32" | "int32_t" => SampleType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => SampleType::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => SampleType::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            SampleType::U64
        }
        "float" => SampleType::F32,
        "double" => SampleType::F64,
        other => {
            let expected = "an integer of 8 to 64 bits, `float` or `double`";
            return Err(bad("type", other, expected));
        }
    })
}

fn sizes(text: &str) -> Result<[usize; 3], NrrdProblem> {
    let expected = || {
        let expected = format!("three lengths from 1 to {MAX_AXIS_LENGTH}");
        bad("sizes", text, expected)
    };
    let lengths: Option<Vec<usize>> = text
        .split_whitespace()
        .take(4)
        .map(|length| length.parse().ok())
        .collect();
    match lengths.as_deref() {
        Some(&[i, j, k]) if [i, j, k].iter().all(|n| (1..=MAX_AXIS_LENGTH).contains(n)) => {
            Ok([i, j, k])
        }
        _ => Err(expected()),
    }
}

fn encoding(text: &str) -> Result<Encoding, NrrdProblem> {
    match text {
        "raw" => Ok(Encoding::Raw),
        "gzip" | "gz" => Ok(Encoding::Gzip),
        other => Err(bad("encoding", other, "`raw` or `gzip`")),
    }
}

/// One file in the folder of the header: no path, list or pattern.
fn data_file(text: &str) -> Result<String, NrrdProblem> {
    let name = text.strip_prefix("./").unwrap_or(text);
    let is_list = name == "LIST" || name.starts_with("LIST ") || name.contains('%');
    let is_path = name.contains(['/', '\\', '\0']) || [".", "..", ""].contains(&name);
    if is_list || is_path {
        let expected = "the name of one file in the header's own folder";
        return Err(bad("data file", text, expected));
    }
    Ok(name.to_owned())
}

fn geometry(lines: &Lines<'_>) -> Result<Geometry, NrrdProblem> {
    let units = lines.get("space units").unwrap_or_default();
    if units.split(['"', ' ']).any(|u| !["", "mm"].contains(&u)) {
        return Err(bad("space units", units, "`mm` for every axis"));
    }
    let Some(space) = lines.get("space") else {
        if lines.get("space dimension").is_some() || lines.get("space directions").is_some() {
            return Err(NrrdProblem::Missing {
                field: "space",
                remedy: "without it nothing tells left from right",
            });
        }
        let text = lines.need("spacings", "without it nothing has a size")?;
        let spacing = numbers(text.split_whitespace())
            .filter(|spacing| spacing.cmpgt(DVec3::ZERO).all())
            .ok_or_else(|| bad("spacings", text, "three numbers above 0, mm"))?;
        return Ok(Geometry {
            columns: DMat3::from_diagonal(spacing),
            origin: LpsPoint(DVec3::ZERO),
            is_placed: false,
        });
    };
    let to_lps = match space.to_ascii_lowercase().as_str() {
        "left-posterior-superior" | "lps" => DVec3::new(1.0, 1.0, 1.0),
        "right-anterior-superior" | "ras" => DVec3::new(-1.0, -1.0, 1.0),
        "left-anterior-superior" | "las" => DVec3::new(1.0, -1.0, 1.0),
        _ => {
            let expected = "`left-posterior-superior`, `right-anterior-superior` or \
                            `left-anterior-superior`";
            return Err(bad("space", space, expected));
        }
    };
    let directions = lines.need("space directions", "without it nothing has a size")?;
    let columns = match vectors(directions).as_deref() {
        Some(&[i, j, k]) => DMat3::from_cols(i * to_lps, j * to_lps, k * to_lps),
        _ => {
            let expected = "three vectors of three finite numbers";
            return Err(bad("space directions", directions, expected));
        }
    };
    let origin = lines.need(
        "space origin",
        "without it nobody knows where the volume is",
    )?;
    let Some(&[at]) = vectors(origin).as_deref() else {
        let expected = "a vector of three finite numbers";
        return Err(bad("space origin", origin, expected));
    };
    Ok(Geometry {
        columns,
        origin: LpsPoint(at * to_lps),
        is_placed: true,
    })
}

/// `(a,b,c) (d,e,f) …`; none where anything else is in the text, `none` included.
fn vectors(text: &str) -> Option<Vec<DVec3>> {
    let mut vectors = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        let (vector, behind) = rest.strip_prefix('(')?.split_once(')')?;
        vectors.push(numbers(vector.split(',').map(str::trim))?);
        rest = behind.trim_start();
    }
    Some(vectors)
}

/// Three finite numbers.
fn numbers<'a>(texts: impl Iterator<Item = &'a str>) -> Option<DVec3> {
    let numbers: Option<Vec<f64>> = texts.take(4).map(|text| text.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Some(DVec3::new(x, y, z)).filter(|v| v.is_finite()),
        _ => None,
    }
}
