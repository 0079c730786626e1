//! Headers made by hand, every type and order of axes, and files that are wrong.

use std::io::Write;
use std::path::PathBuf;

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::{DMat3, DQuat, DVec3};
use ndarray::Array3;

use super::*;
use crate::io::nifti;
use crate::space::{ContinuousIndex, LpsPoint};
use crate::volume::{AnyVolume, Rescale, Sample, SampleType, Volume};
use crate::with_volume;

const SIZES: [usize; 3] = [4, 3, 2];

/// The samples of these files, in stored order: no two alike, and none the same in the other byte order.
fn samples() -> Vec<i16> {
    (0..24).map(|n| n * 37 - 300).collect()
}

fn little() -> Vec<u8> {
    samples().iter().flat_map(|s| s.to_le_bytes()).collect()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::new(6));
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

const HEADER: &str = "NRRD0004\n\
    # made by hand\n\
    type: short\n\
    dimension: 3\n\
    space: left-posterior-superior\n\
    sizes: 4 3 2\n\
    space directions: (0.5,0,0) (0,0.75,0) (0,0,2)\n\
    kinds: domain domain domain\n\
    endian: little\n\
    encoding: raw\n\
    space origin: (-10,20.5,-300)\n\
    DICOM.PatientName:=Jane Doe\n";

fn file(header: &str, data: &[u8]) -> Vec<u8> {
    [header.as_bytes(), b"\n", data].concat()
}

/// A folder that goes away with the test.
struct Desk(tempfile::TempDir);

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn read(&self, bytes: &[u8]) -> Result<Scan, NrrdError> {
        let path = self.write("volume.nrrd", bytes);
        assert!(is_nrrd(&path) == bytes.starts_with(b"NRRD000"));
        let (header, scan) = (read_header(&path), read(&path));
        // A header that is refused is refused in the same words, whoever asks.
        match (&header, &scan) {
            (Ok(header), Ok(scan)) => {
                assert_eq!(Some(header.grid()), Some(grid_of(scan)));
            }
            (Err(header), Err(scan)) => assert_eq!(header.to_string(), scan.to_string()),
            (Ok(_), Err(_)) => {}
            (Err(header), Ok(_)) => panic!("read all the same: {header}"),
        }
        scan
    }
}

fn grid_of(scan: &Scan) -> &Grid {
    with_volume!(&scan.volume, volume => volume.grid())
}

fn i16s(scan: &Scan) -> &[i16] {
    match &scan.volume {
        AnyVolume::I16(volume) => volume.as_slice(),
        other => panic!("{}", other.sample_type()),
    }
}

#[track_caller]
fn assert_reads(scan: Result<Scan, NrrdError>) {
    let scan = scan.unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(i16s(&scan), samples());
    let grid = grid_of(&scan);
    assert_eq!(grid.dims(), SIZES);
    assert_eq!(grid.spacing(), DVec3::new(0.5, 0.75, 2.0));
    assert_eq!(grid.origin(), LpsPoint::new(-10.0, 20.5, -300.0));
    assert_eq!(scan.template.orientation().to_string(), "LPS");
}

#[test]
fn a_header_in_every_dress() {
    let desk = Desk::new();
    assert_reads(desk.read(&file(HEADER, &little())));
    let packed = gzip(&little());
    for (from, to) in [
        ("encoding: raw", "encoding: gzip"),
        ("encoding: raw", "encoding: gz"),
    ] {
        assert_reads(desk.read(&file(&HEADER.replace(from, to), &packed)));
    }
    for (from, to) in [
        ("NRRD0004", "NRRD0001"),
        ("NRRD0004", "NRRD0005"),
        ("type: short", "type: int16_t"),
        ("type: short", "type: signed short int"),
        ("type: short", "type:short"),
        ("left-posterior-superior", "LPS"),
        ("left-posterior-superior", "Left-Posterior-Superior"),
        ("(0.5,0,0) (0,0.75,0)", "( 0.5, 0, 0 )(0,7.5e-1,0)"),
        ("kinds:", "space units: \"mm\" \"mm\" \"mm\"\nkinds:"),
        ("kinds:", "content: Jane Doe: head\nkinds:"),
        ("endian:", "Endian:"),
        ("\n", "\r\n"),
    ] {
        let header = HEADER.replace(from, to);
        let end = if to == "\r\n" { "\r\n" } else { "" };
        let header = header + end;
        let mut bytes = header.into_bytes();
        if end.is_empty() {
            bytes.push(b'\n');
        }
        bytes.extend(little());
        assert_reads(desk.read(&bytes));
    }
    // Text in another encoding, and bytes behind the samples.
    let mut latin = HEADER.as_bytes().to_vec();
    latin.extend(b"key:=M\xfcller\n\n");
    latin.extend(little());
    latin.extend([7; 100]);
    assert_reads(desk.read(&latin));
    // Another space is another sign.
    for (space, direction, origin) in [
        (
            "right-anterior-superior",
            "(-0.5,0,0) (0,-0.75,0)",
            "(10,-20.5,",
        ),
        ("RAS", "(-0.5,0,0) (0,-0.75,0)", "(10,-20.5,"),
        (
            "left-anterior-superior",
            "(0.5,0,0) (0,-0.75,0)",
            "(-10,-20.5,",
        ),
        ("las", "(0.5,0,0) (0,-0.75,0)", "(-10,-20.5,"),
    ] {
        let header = HEADER
            .replace("left-posterior-superior", space)
            .replace("(0.5,0,0) (0,0.75,0)", direction)
            .replace("(-10,20.5,", origin);
        assert_reads(desk.read(&file(&header, &little())));
    }
}

#[test]
fn lines_and_bytes_are_skipped() {
    let desk = Desk::new();
    let skips = |fields: &str, encoding: &str| {
        HEADER.replace(
            "encoding: raw\n",
            &format!("encoding: {encoding}\n{fields}"),
        )
    };
    let before = |head: &[u8], data: Vec<u8>| [head, &data].concat();
    let raw = skips("line skip: 2\nbyte skip: 3\n", "raw");
    let data = before(b"one\ntwo\n\nxx", little());
    assert_reads(desk.read(&file(&raw, &data)));
    // Lines before the compressed bytes, bytes within them.
    let packed = skips("lineskip: 2\nbyteskip: 3\n", "gzip");
    let data = before(b"one\ntwo\n", gzip(&before(b"\nxx", little())));
    assert_reads(desk.read(&file(&packed, &data)));
    let from_end = skips("byte skip: -1\n", "raw");
    assert_reads(desk.read(&file(&from_end, &before(&[9; 77], little()))));
    assert_reads(desk.read(&file(&from_end, &little())));
}

#[test]
fn data_may_be_in_a_file_beside_the_header() {
    let desk = Desk::new();
    for (encoding, data) in [("raw", little()), ("gzip", gzip(&little()))] {
        desk.write("head.raw.gz", &data);
        for name in ["head.raw.gz", "./head.raw.gz"] {
            for end in ["", "\n"] {
                let header = HEADER.replace("encoding: raw", &format!("encoding: {encoding}"));
                let header = format!("{header}data file: {name}\n{end}");
                assert_reads(desk.read(header.as_bytes()));
            }
        }
    }
    let refused = |name: &str, words: &str| {
        let header = format!("{HEADER}data file: {name}\n");
        let message = desk.read(header.as_bytes()).unwrap_err().to_string();
        assert!(message.contains(words), "{name}: {message}");
    };
    refused("nothing.raw", "data file `nothing.raw` cannot be read");
    let one = "the name of one file in the header's own folder";
    for name in [
        "../head.raw.gz",
        "/etc/passwd",
        "a/b.raw",
        "a\\b.raw",
        "..",
        ".",
        "",
        "LIST",
        "LIST 2",
        "slice%03d.raw 1 9 1",
    ] {
        refused(name, one);
    }
    std::fs::create_dir(desk.0.path().join("folder")).unwrap();
    refused("folder", "is a folder, not a file");
}

/// Stores a volume by hand, and says which LPS position each sample has.
#[test]
fn every_order_and_turn_of_axes_keeps_each_sample_in_its_place() {
    let desk = Desk::new();
    let turn = DMat3::from_quat(DQuat::from_rotation_z(0.3) * DQuat::from_rotation_x(-0.2));
    let spacing = DVec3::new(0.5, 0.75, 2.0);
    let origin = DVec3::new(-10.0, 20.5, -300.0);
    let mut orientations = std::collections::BTreeSet::new();
    for turn in [DMat3::IDENTITY, turn] {
        for order in [
            [0, 1, 2],
            [1, 0, 2],
            [2, 1, 0],
            [0, 2, 1],
            [1, 2, 0],
            [2, 0, 1],
        ] {
            for flips in 0..8 {
                let columns: [DVec3; 3] = std::array::from_fn(|stored| {
                    let sign = if flips >> stored & 1 == 1 { -1.0 } else { 1.0 };
                    turn.col(order[stored]) * spacing[order[stored]] * sign
                });
                let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
                let header = HEADER
                    .replace(
                        "(0.5,0,0) (0,0.75,0) (0,0,2)",
                        &columns.map(vector).join(" "),
                    )
                    .replace("(-10,20.5,-300)", &vector(origin));
                let scan = desk.read(&file(&header, &little())).unwrap();
                orientations.insert(scan.template.orientation().to_string());
                let grid = grid_of(&scan);
                for (place, sample) in samples().into_iter().enumerate() {
                    let [ni, nj, _] = SIZES;
                    let index = [place % ni, place / ni % nj, place / ni / nj];
                    let at =
                        (0..3).fold(origin, |at, axis| at + columns[axis] * index[axis] as f64);
                    let voxel = grid.grid_to_index(grid.lps_to_grid(LpsPoint(at))).0;
                    assert!((voxel - voxel.round()).length() < 1e-9, "{voxel}");
                    let [x, y, z] = voxel.round().to_array().map(|n| n as usize);
                    let [nx, ny, _] = grid.dims();
                    assert_eq!(i16s(&scan)[(z * ny + y) * nx + x], sample);
                }
                // Written again, it is stored as it was.
                let path = desk.0.path().join("again.nrrd");
                let AnyVolume::I16(volume) = &scan.volume else {
                    panic!("i16 is i16");
                };
                save_volume(&path, &scan.template, volume, OutputType::AsStored).unwrap();
                let again = read(&path).unwrap();
                assert_eq!(again.template.orientation(), scan.template.orientation());
                assert_eq!(i16s(&again), i16s(&scan));
                assert_same_place(grid_of(&again), grid);
                // And as NIfTI, which holds single precision.
                let path = desk.0.path().join("again.nii");
                nifti::save_volume(&path, &scan.template, volume).unwrap();
                let again = nifti::read(&path).unwrap();
                assert_eq!(again.template.orientation(), scan.template.orientation());
                assert_eq!(i16s(&again), i16s(&scan));
            }
        }
    }
    assert_eq!(orientations.len(), 48);
}

#[track_caller]
fn assert_same_place(found: &Grid, expected: &Grid) {
    assert_eq!(found.dims(), expected.dims());
    let last = ContinuousIndex(expected.last_index());
    for index in [ContinuousIndex::new(0.0, 0.0, 0.0), last] {
        let at = |grid: &Grid| grid.grid_to_lps(grid.index_to_grid(index)).0;
        assert!((at(found) - at(expected)).length() < 1e-9);
    }
}

/// Random bytes of a type, finite where they are floats, that every type and byte order brings back.
fn round_trip<T: Sample>(name: &str) {
    let mut state = 7_u64;
    let values: Vec<T> = (0..24)
        .map(|_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            T::from_interpolated((state >> 11) as f64 / 1e3 - 4e12)
        })
        .collect();
    let header = HEADER.replace("type: short", &format!("type: {name}"));
    let desk = Desk::new();
    for order in ["little", "big"] {
        let mut bytes = Vec::new();
        for value in &values {
            let mut sample = value.le_bytes().as_ref().to_vec();
            if order == "big" {
                sample.reverse();
            }
            bytes.extend(sample);
        }
        let header = header.replace("endian: little", &format!("endian: {order}"));
        let packed = header.replace("encoding: raw", "encoding: gzip");
        for file in [file(&header, &bytes), file(&packed, &gzip(&bytes))] {
            let scan = desk.read(&file).unwrap();
            assert_eq!(scan.volume.sample_type(), T::TYPE);
            let path = desk.0.path().join("again.nrrd");
            with_volume!(&scan.volume, volume => {
                save_volume(&path, &scan.template, volume, OutputType::AsStored)
            })
            .unwrap();
            let again = read(&path).unwrap();
            assert_eq!(again.volume, scan.volume);
            let grid = grid_of(&scan).clone();
            let array = Array3::from_shape_vec((2, 3, 4), values.clone()).unwrap();
            let expected = T::wrap(Volume::new(grid, Rescale::NONE, array).unwrap());
            assert_eq!(scan.volume, expected);
        }
    }
}

#[test]
fn every_type_and_byte_order_keeps_every_bit() {
    round_trip::<u8>("unsigned char");
    round_trip::<i8>("signed char");
    round_trip::<u16>("ushort");
    round_trip::<i16>("int16");
    round_trip::<u32>("unsigned int");
    round_trip::<i32>("int32_t");
    round_trip::<u64>("uint64");
    round_trip::<i64>("long long int");
    round_trip::<f32>("float");
    round_trip::<f64>("double");
}

#[test]
fn without_a_space_left_and_right_are_assumed() {
    let desk = Desk::new();
    let text = "NRRD0001\ntype: short\ndimension: 3\nsizes: 4 3 2\nspacings: 0.5 0.75 2\n\
                endian: little\nencoding: raw\n";
    let path = desk.write("plain.nrrd", &file(text, &little()));
    let header = read_header(&path).unwrap();
    assert!(!header.is_placed());
    let scan = read(&path).unwrap();
    assert_eq!(i16s(&scan), samples());
    let grid = grid_of(&scan);
    assert_eq!(grid.spacing(), DVec3::new(0.5, 0.75, 2.0));
    assert_eq!(grid.origin(), LpsPoint::new(0.0, 0.0, 0.0));
    let path = desk.write("placed.nrrd", &file(HEADER, &little()));
    assert!(read_header(&path).unwrap().is_placed());
}

#[test]
fn a_rescale_is_applied_where_samples_are_not_hounsfield_units() {
    use SampleType::{F32, F64, I8, I16, I32, U8, U16};
    let rescale = |slope, intercept| Rescale { slope, intercept };
    let table = [
        (I16, 1.0, 0.0, [-1024.0, 3071.0], OutputType::AsStored),
        (U16, 1.0, -1024.0, [-1024.0, 3071.0], OutputType::Hu(I16)),
        (I32, 2.0, -1024.0, [-1024.0, 3072.0], OutputType::Hu(I16)),
        (U16, 1.0, -1024.0, [-1024.0, 64511.0], OutputType::Hu(F32)),
        (U16, 1.0, -40000.0, [-40000.0, 0.0], OutputType::Hu(F32)),
        (U8, 0.5, 0.0, [0.0, 127.5], OutputType::Hu(F32)),
        (I8, 1.0, 0.5, [-100.0, 100.0], OutputType::Hu(F32)),
        (F32, 2.0, 0.0, [-100.0, 100.0], OutputType::Hu(F32)),
        (I32, 0.5, 0.0, [-100.0, 100.0], OutputType::Hu(F64)),
        (F64, 2.0, 0.0, [-100.0, 100.0], OutputType::Hu(F64)),
    ];
    for (sample_type, slope, intercept, range, expected) in table {
        let found = OutputType::choose(sample_type, rescale(slope, intercept), range);
        assert_eq!(found, expected, "{sample_type} {slope} {intercept}");
    }
    let desk = Desk::new();
    let grid = Grid::axis_aligned(SIZES, [1.0, 2.0, 3.0]).unwrap();
    for (slope, intercept) in [(1.0, -1024.0), (0.25, 0.0)] {
        let stored: Vec<u16> = (0..24).map(|n| n * 100).collect();
        let array = Array3::from_shape_vec((2, 3, 4), stored.clone()).unwrap();
        let rescale = rescale(slope, intercept);
        let volume = Volume::new(grid.clone(), rescale, array).unwrap();
        let template = Template::for_grid(&grid, U16, rescale).unwrap();
        let (low, high) = volume.hu_range();
        let output = OutputType::choose(U16, rescale, [low, high]);
        let path = desk.0.path().join("hu.nrrd");
        save_volume(&path, &template, &volume, output).unwrap();
        let again = read(&path).unwrap();
        let hu: Vec<f64> = stored.iter().map(|&s| rescale.to_hu(s.into())).collect();
        let found: Vec<f64> = with_volume!(&again.volume, volume => {
            volume.as_slice().iter().map(|sample| sample.to_f64()).collect()
        });
        assert_eq!(found, hu);
    }
}

#[test]
fn nothing_of_a_header_but_its_geometry_is_written() {
    let desk = Desk::new();
    let scan = desk.read(&file(HEADER, &little())).unwrap();
    let path = desk.0.path().join("again.nrrd");
    let AnyVolume::I16(volume) = &scan.volume else {
        panic!("i16 is i16");
    };
    save_volume(&path, &scan.template, volume, OutputType::AsStored).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let end = header::end_of_header(&bytes).unwrap();
    assert_eq!(
        std::str::from_utf8(&bytes[..end]).unwrap(),
        "NRRD0004\n\
         # https://teem.sourceforge.net/nrrd/format.html\n\
         type: short\n\
         dimension: 3\n\
         space: left-posterior-superior\n\
         sizes: 4 3 2\n\
         space directions: (0.5,0,0) (0,0.75,0) (0,0,2)\n\
         kinds: domain domain domain\n\
         endian: little\n\
         encoding: gzip\n\
         space origin: (-10,20.5,-300)\n\n"
    );
}

/// A change of a sound header, and words that the message must hold.
const HOSTILE: &[(&str, &str, &[&str])] = &[
    (
        "NRRD0004",
        "NRRD0006",
        &["begins with `NRRD0006`", "NRRD0005"],
    ),
    ("NRRD0004", "NRRD0000", &["NRRD0000"]),
    ("NRRD0004", "NRRD00041", &["NRRD00041"]),
    (
        "# made by hand",
        "made by hand",
        &["line 2", "`made by hand`"],
    ),
    ("type: short\n", "", &["no field `type`"]),
    ("type: short", "type: block", &["`type` is `block`"]),
    ("type: short", "type: char", &["`type` is `char`"]),
    ("type: short", "type: short\ntype: int", &["`type` twice"]),
    (
        "kinds:",
        "datafile: a\ndata file: b\nkinds:",
        &["`data file` twice"],
    ),
    (
        "dimension: 3",
        "dimension: 4",
        &["`dimension` is `4`", "expected 3"],
    ),
    ("dimension: 3\n", "", &["no field `dimension`"]),
    (
        "sizes: 4 3 2",
        "sizes: 4 3",
        &["`sizes` is `4 3`", "three lengths"],
    ),
    ("sizes: 4 3 2", "sizes: 4 3 2 1", &["`sizes`"]),
    ("sizes: 4 3 2", "sizes: 4 0 2", &["`sizes`"]),
    ("sizes: 4 3 2", "sizes: 4 -3 2", &["`sizes`"]),
    ("sizes: 4 3 2", "sizes: 4 3 32768", &["`sizes`", "32767"]),
    (
        "sizes: 4 3 2",
        "sizes: 4 3 99999999999999999999",
        &["`sizes`"],
    ),
    (
        "sizes: 4 3 2",
        "sizes: 32767 32767 32767",
        &["cut short", "missing"],
    ),
    (
        "sizes: 4 3 2",
        "sizes: 4 3 3",
        &["cut short", "24 are missing"],
    ),
    ("endian: little\n", "", &["no field `endian`"]),
    (
        "endian: little",
        "endian: middle",
        &["`endian` is `middle`"],
    ),
    ("encoding: raw\n", "", &["no field `encoding`"]),
    (
        "encoding: raw",
        "encoding: bzip2",
        &["`encoding` is `bzip2`", "`gzip`"],
    ),
    (
        "encoding: raw",
        "encoding: ascii",
        &["`encoding` is `ascii`"],
    ),
    (
        "encoding: raw",
        "encoding: gzip",
        &["gzip stream is damaged"],
    ),
    (
        "encoding: raw",
        "encoding: raw\nbyte skip: 1",
        &["cut short", "1 are missing"],
    ),
    (
        "encoding: raw",
        "encoding: raw\nbyte skip: -2",
        &["`byte skip` is `-2`"],
    ),
    (
        "encoding: raw",
        "encoding: gzip\nbyte skip: -1",
        &["`byte skip` is `-1`"],
    ),
    (
        "encoding: raw",
        "encoding: raw\nbyte skip: 18446744073709551615",
        &["cut short"],
    ),
    (
        "encoding: raw",
        "encoding: raw\nline skip: 9999",
        &["`line skip` is `9999`"],
    ),
    (
        "encoding: raw",
        "encoding: raw\nline skip: -1",
        &["`line skip` is `-1`"],
    ),
    (
        "left-posterior-superior",
        "scanner-xyz",
        &["`space` is `scanner-xyz`"],
    ),
    (
        "left-posterior-superior",
        "3D-right-handed",
        &["`space` is"],
    ),
    (
        "left-posterior-superior",
        "right-posterior-superior",
        &["`space` is"],
    ),
    (
        "space: left-posterior-superior\n",
        "",
        &["no field `space`"],
    ),
    (
        "space: left-posterior-superior",
        "space dimension: 3",
        &["no field `space`", "left from right"],
    ),
    ("(0,0.75,0)", "(0,nan,0)", &["`space directions`", "finite"]),
    ("(0,0.75,0)", "(0,1e999,0)", &["`space directions`"]),
    ("(0,0.75,0)", "none", &["`space directions`"]),
    ("(0,0.75,0)", "(0,0.75)", &["`space directions`"]),
    ("(0,0.75,0)", "(0,0.75,0", &["`space directions`"]),
    ("(0,0.75,0)", "(0,0.75,0) (0,0,1)", &["`space directions`"]),
    (
        "(0,0.75,0)",
        "(0,0,0)",
        &["`space directions` cannot be used"],
    ),
    (
        "(0,0.75,0)",
        "(0.5,0,0)",
        &["`space directions` cannot be used"],
    ),
    ("(0,0.75,0)", "(0.1,0.75,0)", &["sheared", "82."]),
    ("(0,0.75,0)", "(0,1e-300,0)", &["cannot be"]),
    (
        "space directions:",
        "spaced directions:",
        &["no field `space directions`"],
    ),
    ("(-10,20.5,-300)", "(-10,20.5,inf)", &["`space origin`"]),
    ("(-10,20.5,-300)", "(-10,20.5)", &["`space origin`"]),
    (
        "(-10,20.5,-300)",
        "(-10,20.5,1e300)",
        &["position cannot be written"],
    ),
    (
        "space origin:",
        "space origins:",
        &["no field `space origin`"],
    ),
    (
        "kinds:",
        "space units: \"mm\" \"mm\" \"um\"\nkinds:",
        &["`space units`", "`mm` for every axis"],
    ),
];

#[test]
fn wrong_headers_are_refused_by_name() {
    let desk = Desk::new();
    for (from, to, words) in HOSTILE {
        assert_eq!(HEADER.matches(from).count(), 1, "{from}");
        let header = HEADER.replace(from, to);
        let error = desk.read(&file(&header, &little()));
        let message = match error {
            Ok(_) => panic!("{from} -> {to} was read"),
            Err(error) => error.to_string(),
        };
        for word in *words {
            assert!(message.contains(word), "{to}: {word} is not in: {message}");
        }
        assert!(!message.chars().any(char::is_control), "{message:?}");
    }
    let refused = |bytes: &[u8], words: &str| {
        let message = desk.read(bytes).unwrap_err().to_string();
        assert!(message.contains(words), "{words} is not in: {message}");
    };
    // A spacing of nothing, without a space.
    for spacing in ["0 1 1", "-1 1 1", "nan 1 1", "1 1", "1 1 1 1", ""] {
        let text = HEADER.replace("space: left-posterior-superior\n", "");
        let (before, behind) = text.split_once("space directions").unwrap();
        let (_, behind) = behind.split_once('\n').unwrap();
        let text = format!("{before}spacings: {spacing}\n{behind}");
        refused(&file(&text, &little()), "`spacings`");
    }
    refused(b"NRRD0004\n\n", "no field `type`");
    refused(b"NRRD0004", "no field `type`");
    let mut long = HEADER.replace("kinds", "# ").into_bytes();
    long.extend("#\n".repeat(header::MAX_HEADER).into_bytes());
    refused(&long, "no empty line within");
    refused(b"", "is not an NRRD file");
    refused(b"\x00\xff\x1f", "is not an NRRD file");
}

#[test]
fn damaged_and_swollen_gzip_is_refused() {
    let desk = Desk::new();
    let header = HEADER.replace("encoding: raw", "encoding: gzip");
    let packed = gzip(&little());
    let refused = |data: &[u8], words: &str| {
        let message = desk.read(&file(&header, data)).unwrap_err().to_string();
        assert!(message.contains(words), "{words} is not in: {message}");
    };
    for cut in [0, 5, 12, packed.len() - 9, packed.len() - 1] {
        let message = desk.read(&file(&header, &packed[..cut])).unwrap_err();
        let message = message.to_string();
        let expected = ["damaged", "more than 0 bytes of gzip"];
        assert!(
            expected.iter().any(|e| message.contains(e)),
            "{cut}: {message}"
        );
    }
    // The checksum, the length, and garbage behind the member.
    for at in [packed.len() - 8, packed.len() - 1] {
        let mut bent = packed.clone();
        bent[at] ^= 1;
        refused(&bent, "damaged");
    }
    refused(&[&packed[..], b"garbage"].concat(), "damaged");
    refused(&gzip(&little()[..40]), "8 are missing");
    refused(
        &gzip(&[little(), vec![0; 17 << 20]].concat()),
        "follow the samples",
    );
    // Far more than the bytes could hold is refused before memory is asked for.
    let huge = header.replace("4 3 2", "32767 32767 32767");
    let message = desk.read(&file(&huge, &packed)).unwrap_err().to_string();
    assert!(message.contains("bytes of gzip can hold"), "{message}");
}

#[test]
fn values_that_are_no_numbers_are_refused() {
    let desk = Desk::new();
    let header = HEADER.replace("type: short", "type: float");
    let mut values = [1.0_f32; 24];
    values[13] = f32::NAN;
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let message = desk.read(&file(&header, &bytes)).unwrap_err().to_string();
    let expected = "1 of 24 voxels are not numbers; the first is NaN at stored index (1, 0, 1)";
    assert!(message.contains(expected), "{message}");
}

/// Every file that is cut short, and every bit of a header turned over: refused or read, never a panic.
#[test]
fn nothing_panics() {
    let desk = Desk::new();
    let sound = file(HEADER, &little());
    let (mut refused, mut accepted) = (0, 0);
    let mut tried = |bytes: &[u8]| match desk.read(bytes) {
        Ok(_) => accepted += 1,
        Err(_) => refused += 1,
    };
    for len in (0..sound.len()).step_by(3) {
        tried(&sound[..len]);
    }
    for at in 0..HEADER.len() {
        let mut bent = sound.clone();
        bent[at] ^= 1 << (at % 7);
        tried(&bent);
    }
    assert!(refused > 200 && accepted > 20, "{refused} {accepted}");
}

#[test]
fn what_is_no_file_does_not_block() {
    let desk = Desk::new();
    assert!(!is_nrrd(desk.0.path()));
    assert!(!is_nrrd(&desk.0.path().join("nothing")));
    assert!(!is_nrrd(Path::new("/dev/zero")));
    #[cfg(unix)]
    {
        let pipe = desk.0.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if made.is_ok_and(|status| status.success()) {
            assert!(!is_nrrd(&pipe));
            let message = read(&pipe).unwrap_err().to_string();
            assert!(message.contains("is a pipe or a device"), "{message}");
        }
    }
}
