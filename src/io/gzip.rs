//! Gzip of one member (RFC 1952), which every reader understands, the same bytes for any number of threads.
//!
//! What is made bit by bit is written by a [`GzipWriter`]. The input is cut into blocks of 1 MiB which are deflated
//! apart, on every core, none seeing another's text. A block but the last ends with a sync flush, that is on a byte
//! boundary, so the blocks joined are one deflate stream (RFC 1951, 3.2.4). Where a block ends depends on the input alone.
//!
//! What is in memory as a whole is packed and inflated in one piece, on one core, with a third of the work
//! (E. Biggers, libdeflate).

use std::io::{self, Write};

use crc32fast::Hasher;
use flate2::{Compress, Compression, FlushCompress, Status};
use libdeflater::{CompressionLvl, Compressor, Decompressor};
use rayon::prelude::*;

use crate::volume::untouched_zeros;

/// Input bytes deflated as one piece.
const BLOCK: usize = 1 << 20;

/// At 6 a CT becomes less than 1 % smaller than at 3, and takes a quarter longer.
const LEVEL: u32 = 3;

/// Of libdeflate: gives a CT the size that [`LEVEL`] does.
const WHOLE_LEVEL: i32 = 1;

/// Blocks held for each thread before they are compressed together: two keep a thread busy while
/// another finishes a harder block.
const BLOCKS_PER_THREAD: usize = 2;

/// Magic, deflate, no flags, no time, no extra flags, operating system unknown: nothing that differs
/// between runs or machines.
const HEADER: [u8; 10] = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255];

/// Compresses what is written to it. Call [`GzipWriter::finish`]: without it the member has no end and
/// readers call the file damaged.
#[derive(Debug)]
pub struct GzipWriter<W> {
    to: W,
    pending: Vec<u8>,
    batch: usize,
    crc: Hasher,
    started: bool,
}

impl<W: Write> GzipWriter<W> {
    /// A writer that holds at most two blocks of 1 MiB for each thread of the current pool.
    pub fn new(to: W) -> Self {
        Self {
            to,
            pending: Vec::new(),
            batch: BLOCK * BLOCKS_PER_THREAD * rayon::current_num_threads().max(1),
            crc: Hasher::new(),
            started: false,
        }
    }

    /// Compresses the rest, writes the trailer, flushes, and returns what was written to.
    ///
    /// # Errors
    /// Those of the writer below.
    pub fn finish(mut self) -> io::Result<W> {
        self.compress_pending(FlushCompress::Finish)?;
        self.to
            .write_all(&self.crc.clone().finalize().to_le_bytes())?;
        // RFC 1952: the length of the input modulo 2³².
        self.to
            .write_all(&(self.crc.total_len() as u32).to_le_bytes())?;
        self.to.flush()?;
        Ok(self.to)
    }

    /// Deflates what is pending, whole blocks unless `end` is `Finish`, and writes it.
    fn compress_pending(&mut self, end: FlushCompress) -> io::Result<()> {
        if !self.started {
            self.to.write_all(&HEADER)?;
            self.started = true;
        }
        let mut blocks: Vec<&[u8]> = self.pending.chunks(BLOCK).collect();
        if blocks.is_empty() {
            blocks.push(&[]);
        }
        let last = blocks.len() - 1;
        let compressed: Vec<io::Result<(Vec<u8>, Hasher)>> = blocks
            .into_par_iter()
            .enumerate()
            .map(|(index, block)| {
                let flush = if index == last {
                    end
                } else {
                    FlushCompress::Sync
                };
                let mut crc = Hasher::new();
                crc.update(block);
                Ok((deflate(block, flush)?, crc))
            })
            .collect();
        for piece in compressed {
            let (bytes, crc) = piece?;
            self.to.write_all(&bytes)?;
            self.crc.combine(&crc);
        }
        self.pending.clear();
        Ok(())
    }
}

impl<W: Write> Write for GzipWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // A full batch waits for the next byte, so that the last block is never an empty one unless
        // the whole input is.
        if self.pending.len() == self.batch && !bytes.is_empty() {
            self.compress_pending(FlushCompress::Sync)?;
        }
        let taken = bytes.len().min(self.batch - self.pending.len());
        self.pending.extend_from_slice(&bytes[..taken]);
        Ok(taken)
    }

    /// Does not cut a block short: where blocks end must depend on the bytes alone.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Gzip of a few bytes, at most 65,535, and many that follow them.
///
/// The few are kept as they are, so that the many need not be copied to stand behind them.
///
/// # Errors
/// Where there is no memory for it, or `head` is longer.
pub(in crate::io) fn pack_whole(head: &[u8], body: &[u8]) -> io::Result<Vec<u8>> {
    let too_long = |_| io::Error::from(io::ErrorKind::InvalidInput);
    let level = CompressionLvl::new(WHOLE_LEVEL)
        .map_err(|_| io::Error::from(io::ErrorKind::InvalidInput))?;
    let mut deflater = Compressor::new(level);
    // A block that is stored (RFC 1951, 3.2.4), and not the last: three bits of 0, the rest of the byte, its length, and
    // that with all bits turned. It ends on a byte boundary, as the next begins.
    let stored = u16::try_from(head.len()).map_err(too_long)?;
    let mut start = Vec::with_capacity(HEADER.len() + 5 + head.len());
    start.extend(HEADER);
    start.push(0);
    start.extend(stored.to_le_bytes());
    start.extend((!stored).to_le_bytes());
    start.extend(head);
    const TRAILER: usize = 8;
    let most = start.len() + deflater.deflate_compress_bound(body.len()) + TRAILER;
    let mut packed = untouched_zeros(most).ok_or(io::ErrorKind::OutOfMemory)?;
    let (before, rest) = packed.split_at_mut(start.len());
    before.copy_from_slice(&start);
    let deflated = deflater
        .deflate_compress(body, rest)
        .map_err(io::Error::other)?;
    packed.truncate(start.len() + deflated);
    let mut crc = Hasher::new();
    crc.update(head);
    crc.update(body);
    // RFC 1952: the length of the input modulo 2³².
    let len = (head.len() as u64 + body.len() as u64) as u32;
    packed.extend(crc.finalize().to_le_bytes());
    packed.extend(len.to_le_bytes());
    Ok(packed)
}

/// How many bytes a file of gzip says that it holds, modulo 2³²: of the last member, where there are several.
pub(in crate::io) fn claimed_len(packed: &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(*packed.last_chunk()?))
}

/// Inflates gzip into room for exactly what it holds, checksum and all; in half the time that a stream takes. Not
/// where it is damaged, or holds more or less: a stream can say how, and take several members.
pub(in crate::io) fn inflate_whole(packed: &[u8], to: &mut [u8]) -> bool {
    let room = to.len();
    let inflated = Decompressor::new().gzip_decompress(packed, to);
    inflated.is_ok_and(|count| count == room)
}

/// One block as raw deflate, ended by `end` (`Sync` or `Finish`).
fn deflate(block: &[u8], end: FlushCompress) -> io::Result<Vec<u8>> {
    let mut deflater = Compress::new(Compression::new(LEVEL), false);
    let mut out = Vec::with_capacity(block.len() / 2 + 4096);
    loop {
        let taken = usize::try_from(deflater.total_in()).unwrap_or(block.len());
        let rest = block.get(taken..).unwrap_or_default();
        let status = deflater
            .compress_vec(rest, &mut out, end)
            .map_err(io::Error::other)?;
        // A sync flush is complete once it leaves room in the output (zlib's manual, `deflate`).
        let complete = match end {
            FlushCompress::Finish => matches!(status, Status::StreamEnd),
            _ => deflater.total_in() == block.len() as u64 && out.len() < out.capacity(),
        };
        if complete {
            return Ok(out);
        }
        out.reserve(64 << 10);
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::bufread::GzDecoder;

    use super::*;

    /// Bytes that compress in part, so that blocks differ in size.
    fn text(len: usize) -> Vec<u8> {
        let mut state = 0x9e37_79b9_u32;
        (0..len)
            .map(|index| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                if index / 5000 % 2 == 0 {
                    (state >> 24) as u8
                } else {
                    (index % 7) as u8
                }
            })
            .collect()
    }

    /// Bytes that do not compress.
    fn noise(len: usize) -> Vec<u8> {
        let mut state = 1_u64;
        let bytes = (0..len).map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state as u8
        });
        bytes.collect()
    }

    fn gzip(bytes: &[u8], piece: usize) -> Vec<u8> {
        let mut to = GzipWriter::new(Vec::new());
        for part in bytes.chunks(piece) {
            to.write_all(part).unwrap();
            to.flush().unwrap();
        }
        to.finish().unwrap()
    }

    /// `bufread::GzDecoder` stops after one member: equality shows that there is only one.
    fn gunzip(bytes: &[u8]) -> Vec<u8> {
        let mut decoder = GzDecoder::new(bytes);
        let mut out = Vec::new();
        decoder.read_to_end(&mut out).unwrap();
        assert!(decoder.into_inner().is_empty(), "bytes after the member");
        out
    }

    #[test]
    fn every_length_around_a_block_comes_back() {
        for len in [
            0,
            1,
            17,
            BLOCK - 1,
            BLOCK,
            BLOCK + 1,
            4 * BLOCK,
            9 * BLOCK + 333,
        ] {
            let bytes = text(len);
            let packed = gzip(&bytes, 700_001);
            assert!(gunzip(&packed) == bytes, "{len} bytes differ");
            assert_eq!(packed[..10], HEADER);
        }
    }

    #[test]
    fn noise_that_does_not_shrink_comes_back() {
        let bytes = noise(3 * BLOCK);
        assert!(gunzip(&gzip(&bytes, BLOCK)) == bytes);
    }

    #[test]
    fn threads_and_write_sizes_do_not_change_a_byte() {
        let bytes = text(9 * BLOCK + 12_345);
        let expected = gzip(&bytes, bytes.len());
        assert!(expected.len() < bytes.len());
        for threads in [1, 2, 3, 7] {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            for piece in [1_000, BLOCK, 5_000_011] {
                let packed = pool.install(|| gzip(&bytes, piece));
                assert!(
                    packed == expected,
                    "{threads} threads, {piece} bytes a write"
                );
            }
        }
    }

    #[test]
    fn what_is_whole_and_of_the_size_asked_for_is_inflated_at_once() {
        let bytes = text(3 * BLOCK + 77);
        let packed = gzip(&bytes, BLOCK);
        assert_eq!(claimed_len(&packed), Some(bytes.len() as u32));
        let inflate = |packed: &[u8], room: usize| {
            let mut to = vec![0xaa; room];
            inflate_whole(packed, &mut to).then_some(to)
        };
        assert!(inflate(&packed, bytes.len()) == Some(bytes.clone()));
        for room in [0, bytes.len() - 1, bytes.len() + 1] {
            assert!(inflate(&packed, room).is_none(), "{room}");
        }
        for cut in [0, 3, 17, packed.len() / 2, packed.len() - 1] {
            assert!(inflate(&packed[..cut], bytes.len()).is_none(), "{cut}");
        }
        assert_eq!(claimed_len(&packed[..3]), None);
        let mut wrong_sum = packed.clone();
        let at = wrong_sum.len() - 6;
        wrong_sum[at] ^= 1;
        assert!(inflate(&wrong_sum, bytes.len()).is_none());
    }

    #[test]
    fn what_is_packed_at_once_comes_back() {
        for (head, body) in [
            (0, 0),
            (0, 5),
            (352, 0),
            (352, 1),
            (352, 3 * BLOCK + 1),
            (65_535, 99),
        ] {
            let bytes = text(head + body);
            let packed = pack_whole(&bytes[..head], &bytes[head..]).unwrap();
            assert!(gunzip(&packed) == bytes, "{head}, {body}");
            assert_eq!(packed[..10], HEADER);
            let mut room = vec![0; bytes.len()];
            assert!(inflate_whole(&packed, &mut room) && room == bytes);
        }
        let bytes = text(9 * BLOCK);
        let packed = pack_whole(&bytes[..352], &bytes[352..]).unwrap();
        assert!(packed.len() < gzip(&bytes, BLOCK).len() * 11 / 10);
        assert!(pack_whole(&[0; 65_536], &[]).is_err());
    }

    #[test]
    fn noise_is_packed_at_once_into_little_more() {
        let bytes = noise(BLOCK);
        let packed = pack_whole(&bytes[..300], &bytes[300..]).unwrap();
        assert!(gunzip(&packed) == bytes && packed.len() < bytes.len() + 1000);
    }

    #[test]
    fn a_full_disk_is_an_error() {
        struct Full(usize);
        impl Write for Full {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                if self.0 < bytes.len() {
                    return Err(io::ErrorKind::StorageFull.into());
                }
                self.0 -= bytes.len();
                Ok(bytes.len())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let bytes = text(1000);
        let whole = gzip(&bytes, 1000).len();
        for room in [0, 5, 10, whole - 1] {
            let mut to = GzipWriter::new(Full(room));
            to.write_all(&bytes).unwrap();
            let error = to.finish().map(|_| ()).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::StorageFull);
        }
        let mut to = GzipWriter::new(Full(whole));
        to.write_all(&bytes).unwrap();
        assert!(to.finish().is_ok());
    }
}
