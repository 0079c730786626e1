//! A file's bytes: inflated where they are gzip, hashed as they pass, never more of them than asked for.

use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;
use sha2::{Digest, Sha256};

use super::error::NiftiProblem;
use super::header::{FIRST_OFFSET, Header};
use crate::io::gzip::{claimed_len, inflate_whole};
use crate::volume::{Sample, room, zeroed};

/// Deflate cannot pack more than this many bytes into one: 258 for two bits.
pub(in crate::io) const LARGEST_RATIO: u64 = 1032;

/// How many bytes one byte of gzip may claim before they are looked for. A CT packs into a half or a fifth;
/// what claims more may lie, and is inflated once for nothing before memory is asked for.
const USUAL_RATIO: u64 = 32;

/// What may follow the samples in a gzip stream. It is read to reach the checksum, so a bound keeps a
/// bomb from being inflated for hours.
const TRAILING_LIMIT: u64 = 16 << 20;

const BUFFER: usize = 128 << 10;

/// An open file and its (inflated) first bytes.
#[derive(Debug)]
pub(super) struct Source {
    file: File,
    len: u64,
    compressed: bool,
    start: Vec<u8>,
}

impl Source {
    pub(super) fn open(path: &Path) -> Result<Self, NiftiProblem> {
        // Asked before opening: opening a pipe would wait for someone to write to it.
        let metadata = fs::metadata(path).map_err(NiftiProblem::Io)?;
        if metadata.is_dir() {
            return Err(NiftiProblem::NotAFile { found: "a folder" });
        }
        if !metadata.is_file() {
            return Err(NiftiProblem::NotAFile {
                found: "a pipe or a device",
            });
        }
        let mut file = File::open(path).map_err(NiftiProblem::Io)?;
        let len = metadata.len();
        let mut start = Vec::new();
        let first = FIRST_OFFSET as u64;
        (&file)
            .take(first)
            .read_to_end(&mut start)
            .map_err(NiftiProblem::Io)?;
        let compressed = start.starts_with(&[0x1f, 0x8b]);
        if compressed {
            file.rewind().map_err(NiftiProblem::Io)?;
            start.clear();
            MultiGzDecoder::new(BufReader::new(&file))
                .take(first)
                .read_to_end(&mut start)
                .map_err(|error| NiftiProblem::Gzip { error })?;
        }
        Ok(Self {
            file,
            len,
            compressed,
            start,
        })
    }

    /// The header, checked, and found to promise no more samples than the file can hold.
    pub(super) fn header(&self) -> Result<Header, NiftiProblem> {
        let header = Header::parse(&self.start)?;
        let needed = header.needed();
        if self.compressed {
            if needed > self.len.saturating_mul(LARGEST_RATIO) {
                return Err(NiftiProblem::Implausible {
                    needed,
                    compressed: self.len,
                });
            }
        } else if needed > self.len {
            return Err(NiftiProblem::Truncated {
                needed,
                missing: needed - self.len,
            });
        }
        Ok(header)
    }

    /// Inflates a stream that claims far more than a CT packs into, to find whether it holds that much: memory
    /// for samples that are not there would be asked for, and, where axes are turned, filled.
    pub(super) fn check_claim(&mut self, needed: u64) -> Result<(), NiftiProblem> {
        if !self.compressed {
            return Ok(());
        }
        self.file.rewind().map_err(NiftiProblem::Io)?;
        check_claim(&self.file, needed, self.len)
    }

    /// All bytes of a gzip file of a single member that holds exactly what the header needs, as numbers in this
    /// machine's order, and the SHA-256 of the file; none of any other file, or a damaged one.
    ///
    /// For a moment the file itself is held beside them.
    pub(super) fn whole<T: Sample>(&mut self, needed: u64) -> Option<(Vec<T>, [u8; 32])> {
        let needed = usize::try_from(needed).ok()?;
        if !self.compressed || !needed.is_multiple_of(size_of::<T>()) {
            return None;
        }
        self.file.rewind().ok()?;
        let len = usize::try_from(self.len).ok()?;
        let mut packed = room(len).ok()?;
        (&self.file).take(self.len).read_to_end(&mut packed).ok()?;
        // A file of several members is mostly found here, before anything is inflated.
        if claimed_len(&packed)? as usize != needed {
            return None;
        }
        let inflate = || {
            let mut numbers = zeroed::<T>(needed / size_of::<T>()).ok()?;
            let bytes = bytemuck::cast_slice_mut(&mut numbers);
            inflate_whole(&packed, bytes).then_some(numbers)
        };
        let (numbers, sha256) = rayon::join(inflate, || Sha256::digest(&packed).into());
        Some((numbers?, sha256))
    }

    /// The (inflated) bytes from the first.
    pub(super) fn content(mut self) -> Result<Content, NiftiProblem> {
        self.file.rewind().map_err(NiftiProblem::Io)?;
        Ok(Content::new(self.file, self.compressed, Sha256::new()))
    }
}

/// Whether `compressed` bytes of gzip, from where the file is, hold `needed` bytes. They are inflated only
/// where that many are unusual. The file is elsewhere then.
pub(in crate::io) fn check_claim(
    file: &File,
    needed: u64,
    compressed: u64,
) -> Result<(), NiftiProblem> {
    if needed <= compressed.saturating_mul(USUAL_RATIO) {
        return Ok(());
    }
    let file = file.try_clone().map_err(NiftiProblem::Io)?;
    let held = Content::new(file, true, Sha256::new()).skip(needed)?;
    if held < needed {
        let missing = needed - held;
        return Err(NiftiProblem::Truncated { needed, missing });
    }
    Ok(())
}

/// A file's (inflated) bytes, in order.
#[derive(Debug)]
pub(in crate::io) struct Content {
    stream: Stream,
    position: u64,
}

#[derive(Debug)]
enum Stream {
    Plain(BufReader<Hashing>),
    Gzip(Box<MultiGzDecoder<BufReader<Hashing>>>),
}

impl Content {
    /// The bytes of a file from where it is; `sha256` is of those before.
    pub(in crate::io) fn new(file: File, compressed: bool, sha256: Sha256) -> Self {
        let hashing = Hashing { file, sha256 };
        let buffered = BufReader::with_capacity(BUFFER, hashing);
        Self {
            stream: if compressed {
                Stream::Gzip(Box::new(MultiGzDecoder::new(buffered)))
            } else {
                Stream::Plain(buffered)
            },
            position: 0,
        }
    }

    /// Bytes taken so far.
    pub(in crate::io) fn position(&self) -> u64 {
        self.position
    }

    /// Passes over up to `count` bytes; returns how many there were.
    pub(in crate::io) fn skip(&mut self, count: u64) -> Result<u64, NiftiProblem> {
        let copied = match &mut self.stream {
            Stream::Plain(stream) => io::copy(&mut stream.take(count), &mut io::sink()),
            Stream::Gzip(stream) => io::copy(&mut stream.take(count), &mut io::sink()),
        };
        let skipped = copied.map_err(|error| self.problem(error))?;
        self.position += skipped;
        Ok(skipped)
    }

    /// Reads up to `count` bytes, fewer only at the end.
    pub(in crate::io) fn read(&mut self, count: usize) -> Result<Vec<u8>, NiftiProblem> {
        let mut bytes = Vec::new();
        bytes
            .try_reserve_exact(count)
            .map_err(|_| NiftiProblem::Memory {
                bytes: count as u64,
            })?;
        let count = count as u64;
        let read = match &mut self.stream {
            Stream::Plain(stream) => stream.take(count).read_to_end(&mut bytes),
            Stream::Gzip(stream) => stream.take(count).read_to_end(&mut bytes),
        };
        read.map_err(|error| self.problem(error))?;
        self.position += bytes.len() as u64;
        Ok(bytes)
    }

    /// Reads what is left, so that gzip's checksum is verified and the whole file hashed; returns the
    /// SHA-256 of the file.
    pub(in crate::io) fn finish(mut self) -> Result<[u8; 32], NiftiProblem> {
        match self.stream {
            Stream::Plain(_) => {
                self.skip(u64::MAX)?;
            }
            Stream::Gzip(_) => {
                if self.skip(TRAILING_LIMIT + 1)? > TRAILING_LIMIT {
                    return Err(NiftiProblem::TooLong {
                        limit: TRAILING_LIMIT,
                    });
                }
            }
        }
        let hashing = match self.stream {
            Stream::Plain(stream) => stream.into_inner(),
            Stream::Gzip(stream) => stream.into_inner().into_inner(),
        };
        Ok(hashing.sha256.finalize().into())
    }

    fn problem(&self, error: io::Error) -> NiftiProblem {
        // An error with a number is the system's; the decompressor's have none.
        match self.stream {
            Stream::Gzip(_) if error.raw_os_error().is_none() => NiftiProblem::Gzip { error },
            _ => NiftiProblem::Io(error),
        }
    }
}

/// A file whose bytes are hashed as they are read.
#[derive(Debug)]
struct Hashing {
    file: File,
    sha256: Sha256,
}

impl Read for Hashing {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(to)?;
        self.sha256.update(to.get(..read).unwrap_or_default());
        Ok(read)
    }
}
