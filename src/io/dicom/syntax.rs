//! Transfer syntaxes: which are read, and what the others are called (DICOM PS3.6, table A-1).

use std::fmt;

use dicom_transfer_syntax_registry::{TransferSyntax, TransferSyntaxIndex, TransferSyntaxRegistry};

/// How pixels are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    /// As they are.
    Native,
    /// As they are, in a data set that is deflated.
    Deflated,
    /// As they are, in fragments.
    Fragments,
    /// As they are, in fragments that are deflated.
    DeflatedFrame,
    /// Bytes run-length encoded.
    Rle,
    /// JPEG with Huffman codes, of 8 bits where lossy, up to 16 where lossless.
    Jpeg,
    /// JPEG 2000, of either kind of block coding.
    Jpeg2000,
    /// JPEG-LS, lossless or within a given error.
    JpegLs,
    /// JPEG XL, or a JPEG that is packed once more in it.
    JpegXl,
    /// In a way that nothing here decodes.
    Unknown,
}

/// A transfer syntax, as a file names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Syntax {
    uid: String,
    name: &'static str,
    pub(super) packing: Packing,
    /// Whether it always loses something.
    pub(super) lossy: bool,
}

const EXPLICIT_LITTLE_ENDIAN: &str = "1.2.840.10008.1.2.1";
const JPEG_BASELINE: &str = "1.2.840.10008.1.2.4.50";
/// Those of JPEG-LS and JPEG XL that may lose nothing.
const LOSSLESS: [&str; 2] = ["1.2.840.10008.1.2.4.80", "1.2.840.10008.1.2.4.110"];

/// What follows `1.2.840.10008.1.2` in the UID, name, packing, whether it always loses something.
const KNOWN: [(&str, &str, Packing, bool); 29] = [
    ("", "Implicit VR Little Endian", Packing::Native, false),
    (".1", "Explicit VR Little Endian", Packing::Native, false),
    (
        ".1.98",
        "Encapsulated Uncompressed",
        Packing::Fragments,
        false,
    ),
    (
        ".1.99",
        "Deflated Explicit VR Little Endian",
        Packing::Deflated,
        false,
    ),
    (".2", "Explicit VR Big Endian", Packing::Native, false),
    (".5", "RLE Lossless", Packing::Rle, false),
    (".4.50", "JPEG Baseline (Process 1)", Packing::Jpeg, true),
    (
        ".4.51",
        "JPEG Extended (Process 2 and 4)",
        Packing::Jpeg,
        true,
    ),
    (".4.57", "JPEG Lossless (Process 14)", Packing::Jpeg, false),
    (
        ".4.70",
        "JPEG Lossless, First-Order Prediction",
        Packing::Jpeg,
        false,
    ),
    (
        ".4.90",
        "JPEG 2000 (Lossless Only)",
        Packing::Jpeg2000,
        false,
    ),
    (".4.91", "JPEG 2000", Packing::Jpeg2000, false),
    (
        ".4.52",
        "JPEG Extended (Process 3 and 5)",
        Packing::Unknown,
        true,
    ),
    (
        ".4.53",
        "JPEG Spectral Selection (Process 6 and 8)",
        Packing::Jpeg,
        true,
    ),
    (
        ".4.54",
        "JPEG Spectral Selection (Process 7 and 9)",
        Packing::Unknown,
        true,
    ),
    (
        ".4.55",
        "JPEG Full Progression (Process 10 and 12)",
        Packing::Jpeg,
        true,
    ),
    (
        ".4.56",
        "JPEG Full Progression (Process 11 and 13)",
        Packing::Unknown,
        true,
    ),
    (
        ".4.58",
        "JPEG Lossless (Process 15)",
        Packing::Unknown,
        false,
    ),
    (".4.80", "JPEG-LS Lossless", Packing::JpegLs, false),
    (".4.81", "JPEG-LS Near-Lossless", Packing::JpegLs, true),
    (
        ".4.92",
        "JPEG 2000 Part 2 Multi-component (Lossless Only)",
        Packing::Unknown,
        false,
    ),
    (
        ".4.93",
        "JPEG 2000 Part 2 Multi-component",
        Packing::Unknown,
        false,
    ),
    (".4.110", "JPEG XL Lossless", Packing::JpegXl, false),
    (
        ".4.111",
        "JPEG XL JPEG Recompression",
        Packing::JpegXl,
        true,
    ),
    (".4.112", "JPEG XL", Packing::JpegXl, false),
    (
        ".4.201",
        "High-Throughput JPEG 2000 (Lossless Only)",
        Packing::Jpeg2000,
        false,
    ),
    (
        ".4.202",
        "High-Throughput JPEG 2000 with RPCL (Lossless Only)",
        Packing::Jpeg2000,
        false,
    ),
    (
        ".4.203",
        "High-Throughput JPEG 2000",
        Packing::Jpeg2000,
        false,
    ),
    (
        ".8.1",
        "Deflated Image Frame Compression",
        Packing::DeflatedFrame,
        false,
    ),
];

impl Syntax {
    pub(super) fn new(uid: String) -> Self {
        let known = uid
            .strip_prefix("1.2.840.10008.1.2")
            .and_then(|rest| KNOWN.iter().find(|(known, ..)| *known == rest));
        let (name, packing, lossy) = match known {
            Some((_, name, packing, lossy)) => (*name, *packing, *lossy),
            None => ("unknown", Packing::Unknown, false),
        };
        Self {
            uid,
            name,
            packing,
            lossy,
        }
    }

    /// One that the registry has a decoder of JPEG for.
    pub(super) fn jpeg_baseline() -> Self {
        Self::new(JPEG_BASELINE.to_owned())
    }

    pub(super) fn uid(&self) -> &str {
        &self.uid
    }

    /// Of JPEG-LS and JPEG XL, whether the syntax promises that nothing is lost.
    pub(super) fn is_lossless(&self) -> bool {
        LOSSLESS.contains(&self.uid.as_str())
    }

    /// The program that unpacks what nothing here does. DCMTK has one for each family.
    pub(super) fn unpacked_by(&self) -> &'static str {
        if self.name == "unknown" {
            "by the program that wrote it"
        } else if self.name.starts_with("JPEG 2000") {
            "gdcmconv --raw"
        } else {
            "dcmdjpeg or gdcmconv --raw"
        }
    }

    /// How elements are written: of every syntax that is not known here, explicit and little endian, as the
    /// standard has it for all that pack pixels (PS3.5, A.4).
    pub(super) fn elements(&self) -> Option<&'static TransferSyntax> {
        let registry = &TransferSyntaxRegistry;
        registry
            .get(&self.uid)
            .or_else(|| registry.get(EXPLICIT_LITTLE_ENDIAN))
    }
}

impl fmt::Display for Syntax {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "{} ({})", self.name, self.uid.escape_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_packing_that_is_read_has_a_decoder_and_big_endian_is_big() {
        for (rest, name, packing, _) in KNOWN {
            let uid = format!("1.2.840.10008.1.2{rest}");
            let syntax = Syntax::new(uid.clone());
            assert_eq!(syntax.to_string(), format!("{name} ({uid})"));
            let elements = syntax.elements().unwrap();
            // Those of retired kinds of JPEG are that of the baseline.
            let retired = [".4.53", ".4.55"].contains(&rest);
            if matches!(packing, Packing::Rle | Packing::Jpeg | Packing::Jpeg2000) && !retired {
                assert!(elements.pixel_data_reader().is_some(), "{syntax}");
            }
            let big = elements.endianness() == dicom_encoding::Endianness::Big;
            assert_eq!(big, rest == ".2", "{syntax}");
        }
        let odd = Syntax::new("1.2.3\u{1b}[31m".to_owned());
        assert_eq!(odd.packing, Packing::Unknown);
        assert_eq!(odd.to_string(), "unknown (1.2.3\\u{1b}[31m)");
    }
}
