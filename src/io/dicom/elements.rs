//! The elements of a file that a CT slice is made of, and no others.
//!
//! The `dicom-parser` crate tells one element from the next; values are taken here, as bytes, and only those
//! of [`WANTED`]: who the patient is, is passed over unread. Values do not come through the crate, because it
//! allocates what an element claims to be long; nor is an object built with `dicom-object`, which recurses
//! into nested sequences as deep as a file likes.

use std::collections::BTreeMap;
use std::io::{self, Read};

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_encoding::Endianness;
use dicom_parser::DynStatefulDecoder;
use dicom_parser::StatefulDecode;
use dicom_parser::dataset::LazyDataToken;
use dicom_parser::dataset::lazy_read::LazyDataSetReader;
use flate2::read::DeflateDecoder;

use super::error::{SliceProblem, with_sources};
use super::syntax::{Packing, Syntax};

/// An element of the standard, under the name that messages use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Attribute {
    pub(super) tag: Tag,
    pub(super) name: &'static str,
}

macro_rules! attributes {
    ($($constant:ident $name:literal,)*) => {
        $(pub(super) const $constant: Attribute = Attribute { tag: tags::$constant, name: $name };)*
        /// All that is ever kept of a file but its pixels.
        const WANTED: &[Tag] = &[$(tags::$constant),*];
    };
}

attributes! {
    IMAGE_TYPE "ImageType (0008,0008)",
    SOP_CLASS_UID "SOPClassUID (0008,0016)",
    MODALITY "Modality (0008,0060)",
    SERIES_INSTANCE_UID "SeriesInstanceUID (0020,000E)",
    SERIES_NUMBER "SeriesNumber (0020,0011)",
    IMAGE_POSITION_PATIENT "ImagePositionPatient (0020,0032)",
    IMAGE_ORIENTATION_PATIENT "ImageOrientationPatient (0020,0037)",
    SAMPLES_PER_PIXEL "SamplesPerPixel (0028,0002)",
    PHOTOMETRIC_INTERPRETATION "PhotometricInterpretation (0028,0004)",
    NUMBER_OF_FRAMES "NumberOfFrames (0028,0008)",
    ROWS "Rows (0028,0010)",
    COLUMNS "Columns (0028,0011)",
    PIXEL_SPACING "PixelSpacing (0028,0030)",
    BITS_ALLOCATED "BitsAllocated (0028,0100)",
    BITS_STORED "BitsStored (0028,0101)",
    HIGH_BIT "HighBit (0028,0102)",
    PIXEL_REPRESENTATION "PixelRepresentation (0028,0103)",
    PIXEL_PADDING_VALUE "PixelPaddingValue (0028,0120)",
    PIXEL_PADDING_RANGE_LIMIT "PixelPaddingRangeLimit (0028,0121)",
    RESCALE_INTERCEPT "RescaleIntercept (0028,1052)",
    RESCALE_SLOPE "RescaleSlope (0028,1053)",
    RESCALE_TYPE "RescaleType (0028,1054)",
    LOSSY_IMAGE_COMPRESSION "LossyImageCompression (0028,2110)",
}

/// Where the bytes of a file that is DICOM begin to say so, and what they say.
const MAGIC_AT: usize = 128;
const MAGIC: &[u8] = b"DICM";

/// The longest value that is kept, in bytes: nothing in [`WANTED`] needs a tenth of it.
const MAX_VALUE: u32 = 1024;

/// How far into a data set its pixels may begin, in bytes. Private elements of scanners take up to some
/// hundreds of kilobytes.
const MAX_HEADER: u64 = 16 << 20;

/// How deep sequences may lie in one another.
const MAX_DEPTH: usize = 64;

/// The meta information is some hundreds of bytes long.
const MAX_META: u64 = 64 << 10;

/// The data set of a file as it is read, up to its pixels.
pub(super) struct DataSet<'a> {
    tokens: LazyDataSetReader<DynStatefulDecoder<Box<dyn Read + 'a>>>,
    pub(super) syntax: Syntax,
    /// What the meta information calls the file's class, which is all that a DICOMDIR has.
    pub(super) media_class: String,
    values: BTreeMap<Tag, Vec<u8>>,
    big_endian: bool,
    pub(super) pixels: Pixels,
}

/// What stands where the pixels are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pixels {
    /// Nothing.
    Absent,
    /// So many bytes.
    Native {
        len: u32,
        /// Whether they are 16-bit words, whose bytes a big-endian syntax swaps.
        words: bool,
        /// Where in the file they begin; in a deflated data set nothing is known of that.
        offset: Option<u64>,
    },
    /// Fragments.
    Encapsulated,
}

impl<'a> DataSet<'a> {
    /// Reads what stands before the pixels. `source` is a file from its first byte, or a part of one that
    /// reaches to the pixels.
    ///
    /// # Errors
    /// [`SliceProblem::NotDicom`], or what keeps elements from being told apart.
    pub(super) fn open(mut source: impl Read + 'a) -> Result<Self, SliceProblem> {
        let meta = Meta::read(&mut source)?;
        let syntax = Syntax::new(meta.syntax);
        let deflated = syntax.packing == Packing::Deflated;
        // The two bytes that told the end of the meta information begin the data set.
        let rest = io::Cursor::new(meta.ahead).chain(source);
        let rest: Box<dyn Read + 'a> = if deflated {
            Box::new(DeflateDecoder::new(rest))
        } else {
            Box::new(rest)
        };
        let elements = syntax.elements().ok_or(SliceProblem::NoSyntax)?;
        let decoder = DynStatefulDecoder::new_with_ts(rest, elements, 0).map_err(damaged)?;
        let mut data_set = Self {
            tokens: LazyDataSetReader::new(decoder),
            big_endian: elements.endianness() == Endianness::Big,
            syntax,
            media_class: meta.class,
            values: BTreeMap::new(),
            pixels: Pixels::Absent,
        };
        let position = data_set.read_to_pixels()?;
        if let Pixels::Native { offset, .. } = &mut data_set.pixels {
            *offset = (!deflated).then_some(meta.len + position);
        }
        Ok(data_set)
    }

    /// Where in the data set the pixels begin.
    fn read_to_pixels(&mut self) -> Result<u64, SliceProblem> {
        let mut depth = 0_usize;
        let mut position = 0;
        while let Some(token) = self.tokens.advance() {
            match token.map_err(damaged)? {
                LazyDataToken::PixelSequenceStart if depth == 0 => {
                    self.pixels = Pixels::Encapsulated;
                    return Ok(position);
                }
                LazyDataToken::SequenceStart { .. } | LazyDataToken::PixelSequenceStart => {
                    depth += 1;
                    if depth > MAX_DEPTH {
                        return Err(SliceProblem::Damaged(format!(
                            "sequences lie in one another more than {MAX_DEPTH} deep"
                        )));
                    }
                }
                LazyDataToken::SequenceEnd => depth = depth.saturating_sub(1),
                LazyDataToken::LazyValue { header, decoder } => {
                    let len = header.len.0;
                    position = decoder.position();
                    if depth == 0 && header.tag == tags::PIXEL_DATA {
                        let words = header.vr == dicom_core::VR::OW;
                        self.pixels = Pixels::Native {
                            len,
                            words,
                            offset: None,
                        };
                        // The reader goes on behind a value that is not taken; so it is not asked again.
                        return Ok(position);
                    }
                    if depth == 0 && header.tag > tags::PIXEL_DATA {
                        return Ok(position);
                    }
                    let wanted = depth == 0 && WANTED.contains(&header.tag) && len <= MAX_VALUE;
                    if wanted {
                        let mut value = Vec::new();
                        decoder.read_to(len, &mut value).map_err(damaged)?;
                        if value.len() as u64 != u64::from(len) {
                            return Err(SliceProblem::HeaderCut);
                        }
                        self.values.entry(header.tag).or_insert(value);
                    } else {
                        decoder.skip_bytes(len).map_err(damaged)?;
                    }
                    position += u64::from(len);
                }
                value @ LazyDataToken::LazyItemValue { .. } => value.skip().map_err(damaged)?,
                _ => {}
            }
            if position > MAX_HEADER {
                return Err(SliceProblem::HeaderTooLong { limit: MAX_HEADER });
            }
        }
        Ok(position)
    }

    /// The pixels of a native data set, as far as they are there, but no more than `limit` bytes.
    ///
    /// # Errors
    /// Those of the source.
    pub(super) fn into_native(self, limit: u64) -> Result<Vec<u8>, SliceProblem> {
        let Pixels::Native { len, .. } = self.pixels else {
            return Ok(Vec::new());
        };
        let mut bytes = Vec::new();
        let len = len.min(u32::try_from(limit).unwrap_or(u32::MAX));
        // Copied piece by piece: what is allocated is what is there.
        let mut decoder = self.tokens.into_decoder();
        decoder.read_to(len, &mut bytes).map_err(damaged)?;
        Ok(bytes)
    }

    /// The fragments of packed pixels, without the table of offsets in front of them.
    ///
    /// # Errors
    /// [`SliceProblem`] where they end early.
    pub(super) fn into_fragments(mut self) -> Result<Vec<Vec<u8>>, SliceProblem> {
        let mut items: Vec<Vec<u8>> = Vec::new();
        loop {
            let Some(token) = self.tokens.advance() else {
                return Err(SliceProblem::FragmentsCut);
            };
            match token.map_err(|_| SliceProblem::FragmentsCut)? {
                LazyDataToken::ItemStart { .. } => items.push(Vec::new()),
                LazyDataToken::LazyItemValue { len, decoder } => {
                    let mut value = Vec::new();
                    decoder.read_to(len, &mut value).map_err(damaged)?;
                    if value.len() as u64 != u64::from(len) {
                        return Err(SliceProblem::FragmentsCut);
                    }
                    if let Some(item) = items.last_mut() {
                        *item = value;
                    }
                }
                LazyDataToken::SequenceEnd => break,
                _ => {}
            }
        }
        Ok(items.split_off(1.min(items.len())))
    }

    /// Whether words are stored with their high byte first.
    pub(super) fn is_big_endian(&self) -> bool {
        self.big_endian
    }

    /// The text of an element, without what pads it; none where it is absent or empty.
    ///
    /// # Errors
    /// [`SliceProblem::Element`] where it is no text of the default repertoire.
    pub(super) fn text(&self, of: Attribute) -> Result<Option<&str>, SliceProblem> {
        let Some(bytes) = self.values.get(&of.tag) else {
            return Ok(None);
        };
        let text = std::str::from_utf8(bytes)
            .ok()
            .filter(|text| text.is_ascii());
        let Some(text) = text else {
            return Err(of.refuse(bytes.escape_ascii(), "plain text"));
        };
        let text = text.trim_matches([' ', '\0']);
        Ok((!text.is_empty()).then_some(text))
    }

    /// The numbers of an element of `N` decimal strings.
    ///
    /// # Errors
    /// [`SliceProblem::Element`] where they are others, or not finite.
    pub(super) fn decimals<const N: usize>(
        &self,
        of: Attribute,
    ) -> Result<Option<[f64; N]>, SliceProblem> {
        let Some(text) = self.text(of)? else {
            return Ok(None);
        };
        let mut numbers = [0.0; N];
        let mut parts = text.split('\\');
        for number in &mut numbers {
            let part = parts.next().and_then(|part| part.trim().parse().ok());
            match part.filter(|number: &f64| number.is_finite()) {
                Some(part) => *number = part,
                None => return Err(of.refuse(text, numbers_expected(N))),
            }
        }
        match parts.next() {
            None => Ok(Some(numbers)),
            Some(_) => Err(of.refuse(text, numbers_expected(N))),
        }
    }

    /// An element of one 16-bit word.
    ///
    /// # Errors
    /// [`SliceProblem::Element`] where it has another length.
    pub(super) fn word(&self, of: Attribute) -> Result<Option<u16>, SliceProblem> {
        let Some(bytes) = self.values.get(&of.tag) else {
            return Ok(None);
        };
        match <[u8; 2]>::try_from(bytes.as_slice()) {
            Ok(word) if self.big_endian => Ok(Some(u16::from_be_bytes(word))),
            Ok(word) => Ok(Some(u16::from_le_bytes(word))),
            Err(_) if bytes.is_empty() => Ok(None),
            Err(_) => Err(of.refuse(format!("{} bytes long", bytes.len()), "one 16-bit number")),
        }
    }
}

fn numbers_expected(count: usize) -> String {
    match count {
        1 => "a finite number".to_owned(),
        n => format!("{n} finite numbers"),
    }
}

impl Attribute {
    /// The error of a value that cannot be used.
    pub(super) fn refuse(self, found: impl ToString, expected: impl Into<String>) -> SliceProblem {
        let found: String = found.to_string().escape_default().take(80).collect();
        SliceProblem::Element {
            element: self.name,
            found,
            expected: expected.into(),
        }
    }

    /// The error of an element that is not there.
    pub(super) fn missing(self) -> SliceProblem {
        SliceProblem::Missing { element: self.name }
    }
}

fn damaged(error: impl std::error::Error) -> SliceProblem {
    SliceProblem::Damaged(with_sources(&error))
}

/// What the meta information says: always explicit and little endian (PS3.10, 7.1).
struct Meta {
    syntax: String,
    class: String,
    /// Bytes of the file that it takes.
    len: u64,
    /// The group number behind it.
    ahead: Vec<u8>,
}

impl Meta {
    fn read(source: &mut impl Read) -> Result<Self, SliceProblem> {
        let start = take(source, MAGIC_AT + MAGIC.len())?;
        if start.get(MAGIC_AT..) != Some(MAGIC) {
            return Err(SliceProblem::NotDicom);
        }
        let mut meta = Self {
            syntax: String::new(),
            class: String::new(),
            len: start.len() as u64,
            ahead: Vec::new(),
        };
        loop {
            let group = take(source, 2)?;
            if group != [2, 0] || meta.len > MAX_META {
                meta.ahead = group;
                break;
            }
            meta.element(source)?;
        }
        if meta.syntax.is_empty() {
            return Err(SliceProblem::NoSyntax);
        }
        Ok(meta)
    }

    /// One element, behind the number of its group.
    fn element(&mut self, source: &mut impl Read) -> Result<(), SliceProblem> {
        let header = take(source, 6)?;
        let &[a, b, v, r, x, y] = header.as_slice() else {
            return Err(SliceProblem::HeaderCut);
        };
        self.len += 8;
        // Of these the length follows in four bytes; nothing longer belongs here.
        let long = matches!(&[v, r], b"OB" | b"OW" | b"UN" | b"UT" | b"SQ");
        let len = if long {
            self.len += 4;
            match take(source, 4)?.as_slice() {
                &[a, b, c, d] => u32::from_le_bytes([a, b, c, d]).into(),
                _ => return Err(SliceProblem::HeaderCut),
            }
        } else {
            u64::from(u16::from_le_bytes([x, y]))
        };
        if len > MAX_META {
            return Err(SliceProblem::Damaged(format!(
                "an element of its meta information claims {len} bytes"
            )));
        }
        let value = take(source, usize::try_from(len).unwrap_or(usize::MAX))?;
        if value.len() as u64 != len {
            return Err(SliceProblem::HeaderCut);
        }
        self.len += len;
        let text = || {
            String::from_utf8_lossy(&value)
                .trim_matches([' ', '\0'])
                .to_owned()
        };
        match u16::from_le_bytes([a, b]) {
            0x0002 => self.class = text(),
            0x0010 => self.syntax = text(),
            _ => {}
        }
        Ok(())
    }
}

/// Up to `count` bytes, fewer only at the end.
fn take(source: &mut impl Read, count: usize) -> Result<Vec<u8>, SliceProblem> {
    let mut bytes = Vec::new();
    source
        .take(count as u64)
        .read_to_end(&mut bytes)
        .map_err(SliceProblem::Io)?;
    Ok(bytes)
}

/// Whether a file says that it is DICOM.
pub(super) fn has_magic(source: &mut impl Read) -> bool {
    take(source, MAGIC_AT + MAGIC.len()).is_ok_and(|start| start.get(MAGIC_AT..) == Some(MAGIC))
}
