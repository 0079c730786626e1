//! JPEG XL (ISO/IEC 18181-1), and JPEG that is packed once more in it (18181-2).
//!
//! Read is what is the same numbers on every machine: images whose samples are coded as integers, which all lossless
//! ones are, and JPEG, which is unpacked bit for bit and decoded as such. Images coded as cosine transforms or in the
//! colour space XYB are decoded in floating point, with other instructions on other processors; and they are lossy.

use jxl_bitstream::container::ContainerBoxType;
use jxl_bitstream::{Bitstream, ContainerParser, ParseEvent};
use jxl_oxide::frame::{Encoding, FrameType};
use jxl_oxide::image::BitDepth;
use jxl_oxide::jpeg_bitstream::{JpegBitstreamData, JpegBitstreamHeader};
use jxl_oxide::{
    AllocTracker, FrameHeader, ImageHeader, InitializeResult, JxlImage, JxlThreadPool,
};
use jxl_oxide_common::Bundle;

use super::error::SliceProblem;
use super::packed::{Packed, check_sign, check_size};
use super::panics::caught;
use super::slice::Format;
use super::syntax::Syntax;

/// What the decoder may hold beside what it holds for each pixel: tables and trees.
const MEMORY_BYTES: usize = 4 << 20;

/// What it may hold for each pixel: some planes of 32-bit numbers, and before they are rendered the packed ones.
const MEMORY_BYTES_PER_PIXEL: usize = 24;

/// The longest that the texts within a packed JPEG may be, unpacked.
const MAX_JPEG_TEXT_BYTES: u64 = 1 << 20;

/// What an image becomes.
pub(super) enum Decoded {
    /// Its samples as little-endian bytes.
    Samples(Vec<u8>),
    /// The JPEG that it was made of.
    Jpeg(Vec<u8>),
}

/// Takes an image apart.
///
/// # Errors
/// [`SliceProblem`] where the image is not the one that the file describes, is coded in floating point, or is
/// damaged.
pub(super) fn decode(
    format: Format,
    syntax: &Syntax,
    image: &[u8],
) -> Result<Decoded, SliceProblem> {
    let failed = |message: &str| SliceProblem::Decode {
        syntax: syntax.to_string(),
        message: message.to_owned(),
    };
    let decoded = caught(|| {
        let parts = Parts::of(image).ok_or(Fault::Damaged)?;
        let header = parts.header().ok_or(Fault::Damaged)?;
        let found = check_header(&header, format)?;
        let image = parts.load(format)?;
        check_frames(&image, format)?;
        if let Some(jpeg) = &parts.jpeg {
            return match syntax.is_lossless() {
                true => Err(Fault::Lossy),
                false => Ok(Decoded::Jpeg(reconstruct(&image, jpeg)?)),
            };
        }
        if frames(&image).any(is_in_floating_point) || header.metadata.xyb_encoded {
            return Err(Fault::FloatingPoint);
        }
        Ok(Decoded::Samples(render(&image, found, format)?))
    });
    decoded.unwrap_or(Err(Fault::Damaged)).map_err(|fault| match fault {
        Fault::Damaged => failed("it is damaged"),
        Fault::Other(error) => failed(&error),
        Fault::Unlike(problem) => problem,
        Fault::Lossy => SliceProblem::Packed {
            found: "lossy JPEG".to_owned(),
            expected: "lossless JPEG XL".to_owned(),
        },
        Fault::FloatingPoint => failed(
            "it is coded in floating point (VarDCT or XYB), which gives other values on other machines",
        ),
    })
}

enum Fault {
    Damaged,
    /// The decoder's words.
    Other(String),
    Unlike(SliceProblem),
    Lossy,
    FloatingPoint,
}

impl From<SliceProblem> for Fault {
    fn from(problem: SliceProblem) -> Self {
        Self::Unlike(problem)
    }
}

impl From<Box<dyn std::error::Error + Send + Sync>> for Fault {
    fn from(error: Box<dyn std::error::Error + Send + Sync>) -> Self {
        Self::Other(error.to_string())
    }
}

/// What matters of a codestream or the container of one. Other boxes are left out: they may inflate to anything.
struct Parts {
    codestream: Vec<u8>,
    /// What, with the codestream, makes a JPEG.
    jpeg: Option<Vec<u8>>,
}

impl Parts {
    fn of(image: &[u8]) -> Option<Self> {
        let mut parts = Self {
            codestream: Vec::new(),
            jpeg: None,
        };
        let mut parser = ContainerParser::new();
        for event in parser.feed_bytes(image) {
            match event.ok()? {
                ParseEvent::Codestream(bytes) => parts.codestream.extend_from_slice(bytes),
                ParseEvent::AuxBoxData(ty, bytes)
                    if ty == ContainerBoxType::JPEG_RECONSTRUCTION =>
                {
                    let jpeg = parts.jpeg.get_or_insert_default();
                    jpeg.extend_from_slice(bytes);
                }
                _ => {}
            }
        }
        Some(parts)
    }

    fn header(&self) -> Option<ImageHeader> {
        ImageHeader::parse(&mut Bitstream::new(&self.codestream), ()).ok()
    }

    /// Reads the headers of all frames, and nothing of what is in them.
    fn load(&self, format: Format) -> Result<JxlImage, Fault> {
        let pixels = format.rows.saturating_mul(format.columns);
        let memory = pixels.saturating_mul(MEMORY_BYTES_PER_PIXEL);
        let mut image = JxlImage::builder()
            .pool(JxlThreadPool::none())
            .alloc_tracker(AllocTracker::with_limit(
                memory.saturating_add(MEMORY_BYTES),
            ))
            // Whether 16 bits suffice is for the file to say, and so not to be relied on.
            .force_wide_buffers(true)
            .build_uninit();
        image.feed_bytes(&self.codestream)?;
        match image.try_init()? {
            InitializeResult::Initialized(image) => Ok(image),
            InitializeResult::NeedMoreData(_) => Err(Fault::Damaged),
        }
    }
}

/// Whether the image is the one that the file describes, and how many bits its samples have.
fn check_header(header: &ImageHeader, format: Format) -> Result<u16, Fault> {
    let metadata = &header.metadata;
    let BitDepth::IntegerSample { bits_per_sample } = metadata.bit_depth else {
        return Err(Fault::FloatingPoint);
    };
    let bits = u16::try_from(bits_per_sample).unwrap_or(u16::MAX);
    let colours = if metadata.grayscale() { 1 } else { 3 };
    let packed = Packed {
        columns: header.size.width.into(),
        rows: header.size.height.into(),
        components: colours + metadata.ec_info.len() as u64,
        bits,
    };
    check_size(Some(packed), format)?;
    check_sign(bits, format)?;
    let unwanted = [
        (metadata.orientation != 1, "turned"),
        (metadata.preview.is_some(), "with a preview"),
        (metadata.animation.is_some(), "animated"),
        (metadata.colour_encoding.want_icc(), "with a colour profile"),
    ];
    match unwanted.iter().find(|(found, _)| *found) {
        Some((_, found)) => Err(Fault::Unlike(SliceProblem::Packed {
            found: format!("JPEG XL {found}"),
            expected: "one without".to_owned(),
        })),
        None => Ok(bits),
    }
}

fn frames(image: &JxlImage) -> impl Iterator<Item = &FrameHeader> {
    let count = image.num_loaded_frames();
    (0..count).filter_map(|index| image.frame(index).map(|frame| frame.header()))
}

/// Whether there is one frame, whole, of the image's own size. Several make layers and patches, of which a small
/// file may hold more than can be rendered in a day.
fn check_frames(image: &JxlImage, format: Format) -> Result<(), Fault> {
    if !image.is_loading_done() {
        return Err(Fault::Damaged);
    }
    let whole = |frame: &FrameHeader| {
        frame.frame_type == FrameType::RegularFrame
            && (frame.x0, frame.y0) == (0, 0)
            && (frame.width as usize, frame.height as usize) == (format.columns, format.rows)
            && frame.upsampling == 1
            && !frame.flags.patches()
            && !frame.flags.use_lf_frame()
    };
    if frames(image).count() == 1 && frames(image).all(whole) {
        return Ok(());
    }
    Err(Fault::Unlike(SliceProblem::Packed {
        found: "JPEG XL of several layers or patches".to_owned(),
        expected: "one of one".to_owned(),
    }))
}

fn is_in_floating_point(frame: &FrameHeader) -> bool {
    let filter = &frame.restoration_filter;
    frame.encoding != Encoding::Modular
        || frame.flags.noise()
        || frame.flags.splines()
        || filter.gab.enabled()
        || filter.epf.enabled()
}

fn render(image: &JxlImage, bits: u16, format: Format) -> Result<Vec<u8>, Fault> {
    let render = image.render_frame(0)?;
    let mut stream = render.stream();
    let size = (stream.width() as usize, stream.height() as usize);
    if size != (format.columns, format.rows) || stream.channels() != 1 {
        return Err(Fault::Damaged);
    }
    // Fractions of the largest sample, a row at a time: of up to 16 bits, the nearest number is the sample.
    let largest = f32::from(u16::MAX >> (16 - bits.clamp(1, 16)));
    let mut row = vec![0.0_f32; format.columns];
    let mut bytes = Vec::with_capacity(format.rows * format.columns * format.sample_bytes());
    for _ in 0..format.rows {
        stream.write_to_buffer(&mut row);
        for fraction in &row {
            let sample = (fraction * largest + 0.5).clamp(0.0, largest) as u16;
            match format.sample_bytes() {
                1 => bytes.push(sample as u8),
                _ => bytes.extend(sample.to_le_bytes()),
            }
        }
    }
    Ok(bytes)
}

/// The JPEG that an image was made of, to the bit.
fn reconstruct(image: &JxlImage, data: &[u8]) -> Result<Vec<u8>, Fault> {
    let damaged = |_| Fault::Damaged;
    let frame = image.frame(0).ok_or(Fault::Damaged)?;
    // Texts behind the header are unpacked whatever their length, so that is looked at first.
    let mut bitstream = Bitstream::new(data);
    JpegBitstreamHeader::parse(&mut bitstream, ()).map_err(damaged)?;
    let texts = data.get(bitstream.num_read_bits().div_ceil(8)..);
    check_texts(texts.unwrap_or_default())?;
    let mut data = JpegBitstreamData::try_parse(data)
        .map_err(|error| Fault::Other(error.to_string()))?
        .ok_or(Fault::Damaged)?;
    data.finalize()
        .map_err(|error| Fault::Other(error.to_string()))?;
    let mut jpeg = Vec::new();
    data.reconstruct(frame, &[], &[], &[], &JxlThreadPool::none())
        .and_then(|jpeg_of| jpeg_of.write(&mut jpeg))
        .map_err(|error| Fault::Other(error.to_string()))?;
    Ok(jpeg)
}

fn check_texts(packed: &[u8]) -> Result<(), Fault> {
    use std::io::Read;
    let mut texts = brotli_decompressor::Decompressor::new(packed, 4096);
    let mut unpacked = texts.by_ref().take(MAX_JPEG_TEXT_BYTES + 1);
    match std::io::copy(&mut unpacked, &mut std::io::sink()) {
        Ok(length) if length <= MAX_JPEG_TEXT_BYTES => Ok(()),
        Ok(_) => Err(Fault::Other(
            "it holds more text than a JPEG of a CT".to_owned(),
        )),
        Err(_) => Err(Fault::Damaged),
    }
}
