//! Displacement fields as ITK reads them.

use ndarray::ArrayViewMut3;
use rhinoplan::io::nifti::{GridSlab, save_displacement};

use crate::builder::{Folder, Nifti, Noise};

/// A component at a voxel (x, y, z) of the LPS grid: no two alike.
fn value(component: usize, [x, y, z]: [usize; 3]) -> f32 {
    (component * 100_000 + x * 2_000 + y * 50 + z) as f32 - 7.5
}

fn fill(component: usize, slab: GridSlab, mut out: ArrayViewMut3<'_, f32>) {
    let [nx, ny, nz] = slab.dims;
    assert_eq!(out.dim(), (nz, ny, nx));
    let [x0, y0, z0] = slab.start;
    for ((z, y, x), out) in out.indexed_iter_mut() {
        *out = value(component, [x0 + x, y0 + y, z0 + z]);
    }
}

/// The file's floats, checked against its own affine: each stored voxel holds the components of the
/// LPS voxel at the same place.
fn assert_field(
    bytes: &[u8],
    stored: [usize; 3],
    lps_of: impl Fn([usize; 3]) -> [usize; 3],
    big: bool,
) {
    let [ni, nj, nk] = stored;
    let mut floats = bytes[352..].chunks_exact(4).map(|four| {
        let four: [u8; 4] = four.try_into().unwrap();
        if big {
            f32::from_be_bytes(four)
        } else {
            f32::from_le_bytes(four)
        }
    });
    for component in 0..3 {
        for k in 0..nk {
            for j in 0..nj {
                for i in 0..ni {
                    let expected = value(component, lps_of([i, j, k]));
                    assert_eq!(floats.next(), Some(expected), "{component} at {i} {j} {k}");
                }
            }
        }
    }
    assert_eq!(floats.next(), None);
}

#[test]
fn every_axis_order_and_flip_holds_the_vectors_of_its_voxels() {
    let folder = Folder::new();
    // Long enough for several slabs, along whichever axis is the slowest.
    let dims: [usize; 3] = [7, 5, 35];
    for order in [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ] {
        for signs in 0..8 {
            for big in [false, true] {
                let mut file = Nifti::new(dims.map(|n| n as i16), 4, 2, big, vec![0; 2 * 1225]);
                let mut rows = [[0.0; 4]; 3];
                // In RAS, so an axis that grows to the left or to posterior has a negative entry.
                let grows_to_lps = [0, 1, 2].map(|stored| signs >> stored & 1 == 0);
                for (stored, world) in order.into_iter().enumerate() {
                    let lps = if world == 2 { 1.0 } else { -1.0 };
                    rows[world][stored] = if grows_to_lps[stored] { lps } else { -lps };
                }
                file.sform(rows);
                let template = folder.read(&file.bytes()).unwrap().template;
                let mut bytes = Vec::new();
                template.write_displacement(&mut bytes, fill).unwrap();
                let lps_of = |stored: [usize; 3]| {
                    let mut lps = [0; 3];
                    for axis in 0..3 {
                        lps[order[axis]] = if grows_to_lps[axis] {
                            stored[axis]
                        } else {
                            dims[axis] - 1 - stored[axis]
                        };
                    }
                    lps
                };
                assert_field(&bytes, dims, lps_of, big);
                // The position is the input's, byte for byte.
                assert_eq!(bytes[252..328], file.header[252..328]);
            }
        }
    }
}

#[test]
fn the_header_is_that_of_an_itk_vector_image() {
    let folder = Folder::new();
    let mut file = Nifti::small();
    file.f32s(112, &[2.0, -1024.0])
        .f32s(124, &[3000.0, -1000.0])
        .text(148, "Jane Doe");
    let template = folder.read(&file.bytes()).unwrap().template;
    let path = folder.path().join("displacement.nii.gz");
    save_displacement(&path, &template, fill).unwrap();
    let mut bytes = Vec::new();
    template.write_displacement(&mut bytes, fill).unwrap();
    let i16s = |at: usize, count: usize| -> Vec<i16> {
        bytes[at..at + 2 * count]
            .chunks_exact(2)
            .map(|two| i16::from_le_bytes(two.try_into().unwrap()))
            .collect()
    };
    let f32s = |at: usize, count: usize| -> Vec<f32> {
        bytes[at..at + 4 * count]
            .chunks_exact(4)
            .map(|four| f32::from_le_bytes(four.try_into().unwrap()))
            .collect()
    };
    assert_eq!(i16s(40, 8), [5, 5, 4, 3, 1, 3, 1, 1]);
    assert_eq!(i16s(68, 3), [1007, 16, 32]);
    assert_eq!(f32s(76, 4), [1.0, 1.0, 1.5, 2.0]);
    assert_eq!(f32s(108, 3), [352.0, 1.0, 0.0]);
    assert_eq!(f32s(124, 2), [0.0, 0.0]);
    assert!(bytes[148..252].iter().all(|&byte| byte == 0));
    assert_eq!(&bytes[344..352], b"n+1\0\0\0\0\0");
    let mut unpacked = Vec::new();
    let packed = std::fs::read(&path).unwrap();
    std::io::Read::read_to_end(
        &mut flate2::read::GzDecoder::new(&packed[..]),
        &mut unpacked,
    )
    .unwrap();
    assert!(unpacked == bytes);
}

#[test]
fn threads_do_not_change_a_byte() {
    let folder = Folder::new();
    let mut noise = Noise::new(3);
    let samples = (0..2 * 90 * 80 * 70).map(|_| noise.next() as u8).collect();
    let file = Nifti::new([90, 80, 70], 4, 2, false, samples);
    let template = folder.read(&file.bytes()).unwrap().template;
    let write = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let path = folder.path().join(format!("{threads}.nii.gz"));
        pool.install(|| save_displacement(&path, &template, fill))
            .unwrap();
        std::fs::read(path).unwrap()
    };
    let one = write(1);
    assert!(one == write(2) && one == write(5));
}
