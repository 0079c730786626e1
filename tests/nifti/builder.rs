//! Files from bytes.

use std::io::Write;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use rhinoplan::io::nifti::{NiftiError, Scan, read};

pub use crate::noise::Noise;

/// The ten sample types: name, NIfTI code, bytes.
pub const TYPES: [(&str, i16, usize); 10] = [
    ("u8", 2, 1),
    ("i16", 4, 2),
    ("i32", 8, 4),
    ("f32", 16, 4),
    ("f64", 64, 8),
    ("i8", 256, 1),
    ("u16", 512, 2),
    ("u32", 768, 4),
    ("i64", 1024, 8),
    ("u64", 1280, 8),
];

/// A NIfTI-1 file to be: the header's bytes, what stands between it and the samples, and the samples.
#[derive(Clone)]
pub struct Nifti {
    pub header: Vec<u8>,
    pub between: Vec<u8>,
    pub samples: Vec<u8>,
    pub big: bool,
}

impl Nifti {
    /// A sound volume: 1 × 1.5 × 2 mm, sform and qform code 1, stored RAS with the first voxel at
    /// RAS (-10, -20, 30). Samples are raw bytes in the file's order.
    pub fn new(dims: [i16; 3], code: i16, bytes: usize, big: bool, samples: Vec<u8>) -> Self {
        let mut file = Self {
            header: vec![0; 348],
            between: vec![0; 4],
            samples,
            big,
        };
        let [nx, ny, nz] = dims;
        file.i32(0, 348);
        file.i16s(40, &[3, nx, ny, nz, 1, 1, 1, 1]);
        file.i16s(70, &[code, 8 * bytes as i16]);
        file.f32s(76, &[1.0, 1.0, 1.5, 2.0, 0.0, 0.0, 0.0, 0.0]);
        file.f32s(108, &[352.0]);
        file.header[123] = 2;
        file.i16s(252, &[1, 1]);
        file.f32s(256, &[0.0, 0.0, 0.0, -10.0, -20.0, 30.0]);
        file.sform([
            [1.0, 0.0, 0.0, -10.0],
            [0.0, 1.5, 0.0, -20.0],
            [0.0, 0.0, 2.0, 30.0],
        ]);
        file.header[344..].copy_from_slice(b"n+1\0");
        file
    }

    /// A small `i16` volume, little endian, no two samples alike.
    pub fn small() -> Self {
        let samples = (0..5 * 4 * 3_i16)
            .flat_map(|v| (v * 37 - 900).to_le_bytes())
            .collect();
        Self::new([5, 4, 3], 4, 2, false, samples)
    }

    pub fn put<const N: usize>(&mut self, at: usize, mut little: [u8; N]) -> &mut Self {
        if self.big {
            little.reverse();
        }
        self.header[at..at + N].copy_from_slice(&little);
        self
    }

    pub fn i32(&mut self, at: usize, value: i32) -> &mut Self {
        self.put(at, value.to_le_bytes())
    }

    pub fn i16s(&mut self, at: usize, values: &[i16]) -> &mut Self {
        for (index, value) in values.iter().enumerate() {
            self.put(at + 2 * index, value.to_le_bytes());
        }
        self
    }

    pub fn f32s(&mut self, at: usize, values: &[f32]) -> &mut Self {
        for (index, value) in values.iter().enumerate() {
            self.put(at + 4 * index, value.to_le_bytes());
        }
        self
    }

    /// Rows of the matrix, RAS mm.
    pub fn sform(&mut self, rows: [[f32; 4]; 3]) -> &mut Self {
        for (index, row) in rows.iter().enumerate() {
            self.f32s(280 + 16 * index, row);
        }
        self
    }

    pub fn raw(&mut self, at: usize, bytes: &[u8]) -> &mut Self {
        self.header[at..at + bytes.len()].copy_from_slice(bytes);
        self
    }

    pub fn text(&mut self, at: usize, text: &str) -> &mut Self {
        self.raw(at, text.as_bytes())
    }

    pub fn bytes(&self) -> Vec<u8> {
        [&self.header[..], &self.between, &self.samples].concat()
    }

    pub fn gzip(&self) -> Vec<u8> {
        gzip(&self.bytes())
    }
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::new(6));
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A folder that goes away with the test.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path().join(name);
        // ext4 writes a file that is truncated and refilled to disk at once, which turns seconds
        // into half a minute over thousands of files; a new file waits.
        drop(std::fs::remove_file(&path));
        std::fs::write(&path, bytes).unwrap();
        path
    }

    pub fn read(&self, bytes: &[u8]) -> Result<Scan, NiftiError> {
        read(&self.write("volume.nii", bytes))
    }
}
