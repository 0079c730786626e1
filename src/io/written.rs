//! Volumes that this program wrote, as bytes: what their headers say of the samples, and the samples as they come.
//!
//! For telling two such files apart without their compression, of which the same samples may have any. What is to be
//! computed with is read by [`super::nifti`] and [`super::nrrd`].

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;
use sha2::{Digest, Sha256};

use super::digest::{hex, sha256_hex};
use super::nifti::FIRST_OFFSET;

/// What of a NIfTI-1 header says how many samples there are, of which type, how scaled and where: the header's
/// length (and so the byte order), `dim`, `intent_code`, `datatype`, `bitpix`, `pixdim`, `scl_slope`, `scl_inter`,
/// `xyzt_units`, and the qform and the sform.
const LAYOUT: [std::ops::Range<usize>; 6] = [0..4, 40..56, 68..74, 76..120, 123..124, 252..328];

/// A longer header is none that this program writes, bytes.
const MAX_HEADER: u64 = 64 << 10;

/// Samples taken at once, bytes.
const PIECE: usize = 1 << 18;

/// A file, open at its first sample.
pub struct Written {
    layout: Vec<u8>,
    samples: MultiGzDecoder<BufReader<File>>,
}

impl Written {
    /// Opens a gzip-compressed NIfTI-1 file with its samples right behind the header, or a NRRD file of the encoding
    /// `gzip`.
    ///
    /// # Errors
    /// Those of reading, and `InvalidData` where it is neither.
    pub fn open(path: &Path) -> io::Result<Self> {
        let mut file = BufReader::new(File::open(path)?);
        if file.fill_buf()?.starts_with(b"NRRD") {
            let layout = nrrd_header(&mut file)?;
            return Ok(Self {
                layout,
                samples: MultiGzDecoder::new(file),
            });
        }
        let mut samples = MultiGzDecoder::new(file);
        let mut header = [0; FIRST_OFFSET];
        samples.read_exact(&mut header)?;
        if header.get(344..348) != Some(b"n+1\0") {
            return Err(not_written("it is no NIfTI-1 file"));
        }
        let parts = LAYOUT.into_iter().filter_map(|part| header.get(part));
        Ok(Self {
            layout: parts.flatten().copied().collect(),
            samples,
        })
    }

    /// The SHA-256 of what the header says of the samples, in hexadecimal. Free text is not in it.
    pub fn layout_sha256(&self) -> String {
        sha256_hex(&self.layout)
    }

    /// The SHA-256 of the samples as stored, in hexadecimal.
    ///
    /// # Errors
    /// Those of reading.
    pub fn samples_sha256(mut self) -> io::Result<String> {
        let mut hasher = Sha256::new();
        loop {
            let piece = self.piece()?;
            if piece.is_empty() {
                return Ok(hex(&hasher.finalize()));
            }
            hasher.update(&piece);
        }
    }

    /// The next samples of a NIfTI-1 file of 32-bit floats; none at its end.
    ///
    /// # Errors
    /// Those of reading, and `InvalidData` where the file ends within a sample.
    pub fn floats(&mut self) -> io::Result<Vec<f32>> {
        let little = self.layout.starts_with(&348_i32.to_le_bytes());
        let bytes = self.piece()?;
        let (samples, rest) = bytes.as_chunks::<4>();
        if !rest.is_empty() {
            return Err(not_written("it ends within a sample"));
        }
        let value = |bytes: &[u8; 4]| {
            if little {
                f32::from_le_bytes(*bytes)
            } else {
                f32::from_be_bytes(*bytes)
            }
        };
        Ok(samples.iter().map(value).collect())
    }

    fn piece(&mut self) -> io::Result<Vec<u8>> {
        let mut piece = Vec::with_capacity(PIECE);
        let mut limited = Read::by_ref(&mut self.samples).take(PIECE as u64);
        limited.read_to_end(&mut piece)?;
        Ok(piece)
    }
}

/// Up to and with the empty line.
fn nrrd_header(file: &mut impl BufRead) -> io::Result<Vec<u8>> {
    let mut header = Vec::new();
    let mut limited = file.take(MAX_HEADER);
    loop {
        let before = header.len();
        limited.read_until(b'\n', &mut header)?;
        match header.get(before..) {
            Some(b"\n") => return Ok(header),
            Some([]) | None => return Err(not_written("its header has no end")),
            Some(_) => {}
        }
    }
}

fn not_written(problem: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, problem)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;
    use crate::io::gzip::GzipWriter;

    fn file(header: &[u8], packed: &[u8]) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(header).unwrap();
        let mut gzip = GzipWriter::new(Vec::new());
        gzip.write_all(packed).unwrap();
        file.write_all(&gzip.finish().unwrap()).unwrap();
        file
    }

    fn nifti(change: impl Fn(&mut Vec<u8>)) -> tempfile::NamedTempFile {
        let mut bytes = vec![0; 352];
        bytes[..4].copy_from_slice(&348_i32.to_le_bytes());
        bytes[344..348].copy_from_slice(b"n+1\0");
        bytes.extend([1.5_f32, -2.0].map(f32::to_le_bytes).concat());
        change(&mut bytes);
        file(&[], &bytes)
    }

    fn digests(file: &tempfile::NamedTempFile) -> (String, String) {
        let written = Written::open(file.path()).unwrap();
        (written.layout_sha256(), written.samples_sha256().unwrap())
    }

    #[test]
    fn samples_and_what_is_said_of_them_are_told_apart() {
        let (layout, samples) = digests(&nifti(|_| {}));
        let floats = [1.5_f32, -2.0].map(f32::to_le_bytes).concat();
        assert_eq!(samples, sha256_hex(&floats));
        // Free text says nothing of the samples.
        let named = nifti(|bytes| bytes[148..156].copy_from_slice(b"Jane Doe"));
        assert_eq!(digests(&named), (layout.clone(), samples.clone()));
        for at in [42, 70, 80, 112, 123, 254, 320] {
            let (other, same) = digests(&nifti(|bytes| bytes[at] = 9));
            assert!(other != layout && same == samples, "{at}");
        }
        let (same, other) = digests(&nifti(|bytes| bytes[352] = 9));
        assert!(same == layout && other != samples);
    }

    #[test]
    fn floats_come_in_both_byte_orders() {
        let little = nifti(|_| {});
        let mut written = Written::open(little.path()).unwrap();
        assert_eq!(written.floats().unwrap(), [1.5, -2.0]);
        assert!(written.floats().unwrap().is_empty());
        let big = nifti(|bytes| {
            bytes[..4].reverse();
            bytes[352..356].reverse();
            bytes[356..360].reverse();
        });
        let mut written = Written::open(big.path()).unwrap();
        assert_eq!(written.floats().unwrap(), [1.5, -2.0]);
        let cut = nifti(|bytes| bytes.truncate(358));
        assert!(Written::open(cut.path()).unwrap().floats().is_err());
    }

    #[test]
    fn nrrd_has_its_header_in_front() {
        let header = b"NRRD0004\ntype: short\nencoding: gzip\n\n";
        let written = Written::open(file(header, b"samples").path()).unwrap();
        assert_eq!(written.layout_sha256(), sha256_hex(header));
        assert_eq!(written.samples_sha256().unwrap(), sha256_hex(b"samples"));
    }

    #[test]
    fn what_was_not_written_here_is_refused() {
        let endless = b"NRRD0004\n".repeat(10_000);
        let cut = nifti(|bytes| bytes.truncate(300));
        let other = nifti(|bytes| bytes[344] = b'x');
        let short = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(short.path(), b"NRRD0004\n").unwrap();
        for file in [file(&endless, b""), short, cut, other] {
            assert!(Written::open(file.path()).is_err());
        }
    }
}
