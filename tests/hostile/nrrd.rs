//! NRRD, with its data in the file or beside it.

use rhinoplan::io::nrrd::{OutputType, read, read_header, save_volume};
use rhinoplan::volume::{AnyVolume, Rescale, Sample};
use rhinoplan::with_volume;

use crate::bounded::{Bench, Expect, Role};
use crate::head::{self, DIMS, SPACING};
use crate::nifti_builder::{Folder, gzip};
use crate::noise::{Noise, Outcome, damage, fuzz};
use crate::volumes::agreed;

/// Files that are tried by default: about a second.
const TRIES: usize = 5000;

/// The fields of the program's head.
fn header(encoding: &str) -> String {
    let [nx, ny, nz] = DIMS;
    format!(
        "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: {nx} {ny} {nz}\n\
         space directions: ({SPACING},0,0) (0,{SPACING},0) (0,0,{SPACING})\nkinds: domain domain domain\n\
         endian: little\nencoding: {encoding}\nspace origin: (-48,-48,-36)\n"
    )
}

fn file(header: &str, data: &[u8]) -> Vec<u8> {
    [header.as_bytes(), b"\n", data].concat()
}

/// The program's head, as it is.
pub fn head_file() -> Vec<u8> {
    file(&header("raw"), &head::nifti()[352..])
}

/// A header alone, whose data is in the file named.
pub fn detached(data: &str) -> String {
    header("raw") + "data file: " + data + "\n"
}

#[test]
fn the_corpus() {
    let bench = Bench::new();
    let samples = &head::nifti()[352..];
    let packed = gzip(samples);
    let (first, second) = samples.split_at(100_000);
    let members = [gzip(first), gzip(second)].concat();
    let raw = |from: &str, to: &str| {
        let text = header("raw");
        assert!(text.contains(from));
        file(&text.replace(from, to), samples)
    };
    let in_gzip = |data: &[u8]| file(&header("gzip"), data);
    let flip = |at: usize| {
        let mut bytes = packed.clone();
        bytes[at] ^= 0x10;
        bytes
    };
    let sizes = "sizes: 64 64 48";
    let larger = header("gzip")
        .replace(sizes, "sizes: 800 800 600")
        .replace("short", "uchar");
    let turned = larger.replace(
        "(1.5,0,0) (0,1.5,0) (0,0,1.5)",
        "(0,0,1.5) (0,1.5,0) (1.5,0,0)",
    );
    assert!(larger != turned);
    let noise = {
        let mut noise = Noise::new(7);
        (0..800 * 800)
            .map(|_| noise.next() as u8)
            .collect::<Vec<_>>()
    };
    let sound = head_file();
    let float = |value: f32| {
        let mut values = vec![40.0_f32; samples.len() / 2];
        values[5000] = value;
        let data: Vec<u8> = values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        file(&header("raw").replace("short", "float"), &data)
    };
    use Expect::{Read, Refused};
    let cases: Vec<(&str, Vec<u8>, Expect)> = vec![
        ("sound.nrrd", sound.clone(), Read),
        ("packed.nrrd", in_gzip(&packed), Read),
        ("members.nrrd", in_gzip(&members), Read),
        ("wrong.nii.gz", sound.clone(), Read),
        (
            "lines.nrrd",
            [
                (header("raw") + "\n").replace('\n', "\r\n").as_bytes(),
                samples,
            ]
            .concat(),
            Read,
        ),
        (
            "cut-in-header.nrrd",
            sound[..60].to_vec(),
            Refused(&["no field"]),
        ),
        (
            "cut-in-samples.nrrd",
            sound[..9000].to_vec(),
            Refused(&["are missing at the end"]),
        ),
        (
            "cut-gzip.nrrd",
            in_gzip(&packed[..packed.len() / 2]),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "cut-trailer.nrrd",
            in_gzip(&packed[..packed.len() - 2]),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "flipped.nrrd",
            in_gzip(&flip(packed.len() / 2)),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "bad-crc.nrrd",
            in_gzip(&flip(packed.len() - 8)),
            Refused(&["gzip stream is damaged or cut"]),
        ),
        (
            "larger.nrrd",
            raw(sizes, "sizes: 64 64 49"),
            Refused(&["8192 are missing at the end"]),
        ),
        (
            "huge.nrrd",
            raw(sizes, "sizes: 32767 32767 32767"),
            Refused(&["are missing at the end"]),
        ),
        (
            "beyond.nrrd",
            raw(sizes, "sizes: 64 64 99999999999999999999"),
            Refused(&["`sizes`"]),
        ),
        (
            "huge-gzip.nrrd",
            file(
                &header("gzip").replace(sizes, "sizes: 32767 32767 32767"),
                &packed,
            ),
            Refused(&["bytes of gzip can hold"]),
        ),
        (
            "large-gzip.nrrd",
            file(&larger, &gzip(&noise)),
            Refused(&["are missing at the end"]),
        ),
        (
            "turned.nrrd",
            file(&turned, &gzip(&noise)),
            Refused(&["are missing at the end"]),
        ),
        (
            "bomb.nrrd",
            in_gzip(&gzip(&[samples, &vec![0; 64 << 20]].concat())),
            Refused(&["follow the samples"]),
        ),
        (
            "skips.nrrd",
            raw("encoding: raw", "encoding: raw\nline skip: 4000000000"),
            Refused(&["`line skip`"]),
        ),
        (
            "skip.nrrd",
            raw(
                "encoding: raw",
                "encoding: raw\nbyte skip: 9223372036854775807",
            ),
            Refused(&["missing at the end"]),
        ),
        (
            "nan-direction.nrrd",
            raw("(0,1.5,0)", "(0,nan,0)"),
            Refused(&["`space directions`"]),
        ),
        (
            "inf-origin.nrrd",
            raw("(-48,-48,-36)", "(-48,inf,-36)"),
            Refused(&["`space origin`"]),
        ),
        (
            "nan.nrrd",
            float(f32::NAN),
            Refused(&["1 of 196608 voxels are not numbers"]),
        ),
        (
            "inf.nrrd",
            float(f32::INFINITY),
            Refused(&["not numbers", "inf"]),
        ),
        (
            "mark.nrrd",
            [b"\xef\xbb\xbf", &sound[..]].concat(),
            Refused(&["not a NIfTI-1 file"]),
        ),
        (
            "version.nrrd",
            raw("NRRD0004", "NRRD0009"),
            Refused(&["NRRD0009"]),
        ),
        (
            "endless.nrrd",
            file(
                &header("raw").replace("kinds", &"# x\n".repeat(100_000)),
                samples,
            ),
            Refused(&["no empty line within"]),
        ),
    ];
    for (name, bytes, expect) in cases {
        bench.try_bytes(Role::Ct, name, bytes, &expect);
    }
    // The data file beside it is held to the same.
    bench.desk.write("data.raw", &samples[..samples.len() - 10]);
    bench.try_bytes(
        Role::Ct,
        "beside.nhdr",
        detached("data.raw"),
        &Refused(&["10 are missing at the end"]),
    );
    bench.try_bytes(
        Role::Ct,
        "nowhere.nhdr",
        detached("none.raw"),
        &Refused(&["data file `none.raw` cannot be read"]),
    );
    bench.try_bytes(
        Role::Ct,
        "itself.nhdr",
        detached("itself.nhdr"),
        &Refused(&["are missing at the end"]),
    );
}

const TYPES: [(&str, usize); 10] = [
    ("uchar", 1),
    ("int8", 1),
    ("short", 2),
    ("uint16", 2),
    ("int", 4),
    ("uint32_t", 4),
    ("float", 4),
    ("double", 8),
    ("int64", 8),
    ("unsigned long long", 8),
];

/// Values at the borders of what fields may be.
const VALUES: [&str; 26] = [
    "0",
    "1",
    "-1",
    "2",
    "3",
    "1.5",
    "1e-300",
    "1e300",
    "1e-40",
    "3e38",
    "nan",
    "inf",
    "-inf",
    "32767",
    "32768",
    "18446744073709551616",
    "(0,0,0)",
    "(1,0,0)",
    "(0,1",
    "none",
    "raw",
    "gzip",
    "big",
    "RAS",
    "double",
    "\u{fffd}",
];

/// Lines that a header may have, or should not.
const LINES: [&str; 14] = [
    "line skip: 1",
    "line skip: 2",
    "byte skip: 3",
    "byte skip: -1",
    "byte skip: 1000000000000",
    "data file: volume.nrrd",
    "data file: beside.raw",
    "datafile: LIST",
    "space units: \"mm\" \"mm\" \"mm\"",
    "spacings: 1 1 1",
    "# a comment",
    "key:=value: with a colon",
    "",
    "space: right-anterior-superior",
];

fn any_sound(noise: &mut Noise) -> (Vec<String>, Vec<u8>) {
    let (name, bytes) = noise.one_of(&TYPES);
    let sizes = [0; 3].map(|_| 1 + noise.below(5));
    let voxels: usize = sizes.iter().product();
    let data = (0..voxels)
        .flat_map(|n| match name {
            "float" => (n as f32 - 9.0).to_le_bytes().to_vec(),
            "double" => (n as f64 - 9.0).to_le_bytes().to_vec(),
            _ => (n as i64 * 3).to_le_bytes()[..bytes].to_vec(),
        })
        .collect();
    let directions = noise.one_of(&[
        "(0.5,0,0) (0,0.75,0) (0,0,2)",
        "(0,-1,0) (0,0,1) (-2,0,0)",
        "(0.6,0.8,0) (-0.8,0.6,0) (0,0,-1.25)",
    ]);
    let space = noise.one_of(&["left-posterior-superior", "RAS", "LAS"]);
    let [ni, nj, nk] = sizes;
    let lines = [
        "NRRD0004".to_owned(),
        format!("type: {name}"),
        "dimension: 3".to_owned(),
        format!("space: {space}"),
        format!("sizes: {ni} {nj} {nk}"),
        format!("space directions: {directions}"),
        "kinds: domain domain domain".to_owned(),
        "endian: little".to_owned(),
        "encoding: raw".to_owned(),
        "space origin: (-10,20.5,-300)".to_owned(),
    ];
    (lines.to_vec(), data)
}

/// Changes a line as a program or a hand would: a value, a line lost, doubled, moved or put in.
fn change_lines(lines: &mut Vec<String>, noise: &mut Noise) {
    let at = 1 + noise.below(lines.len() - 1);
    match noise.below(6) {
        0 | 1 => {
            let (name, value) = lines[at].split_once(':').unwrap_or((&lines[at], ""));
            // One word of the value, or all of it.
            let mut words: Vec<&str> = value.split(' ').filter(|word| !word.is_empty()).collect();
            let put = noise.one_of(&VALUES);
            match words.len() {
                0 => words.push(put),
                len if noise.one_in(3) => words = vec![put; len],
                len => words[noise.below(len)] = put,
            }
            lines[at] = format!("{name}: {}", words.join(" "));
        }
        2 => drop(lines.remove(at)),
        3 => {
            let line = lines[at].clone();
            lines.insert(1 + noise.below(lines.len()), line);
        }
        4 => {
            let line = noise.one_of(&LINES).to_owned();
            lines.insert(1 + noise.below(lines.len()), line);
        }
        _ => {
            let mut line = std::mem::take(&mut lines[at]).into_bytes();
            if !line.is_empty() {
                let place = noise.below(line.len());
                line[place] ^= 1 << noise.below(7);
            }
            lines[at] = String::from_utf8_lossy(&line).into_owned();
        }
    }
    if lines.len() < 2 {
        lines.push(String::new());
    }
}

#[test]
fn changed_at_random() {
    let folder = Folder::new();
    fuzz("nrrd::changed_at_random", "NRRD", TRIES, |index, noise| {
        let (mut lines, mut data) = any_sound(noise);
        let changes = noise.below(3);
        for _ in 0..changes {
            change_lines(&mut lines, noise);
        }
        if noise.one_in(2) {
            data = gzip(&data);
            for line in &mut lines {
                if line == "encoding: raw" {
                    *line = "encoding: gzip".to_owned();
                }
            }
        }
        let beside = noise.one_in(4);
        if beside {
            folder.write("beside.raw", &data);
            lines.push("data file: beside.raw".to_owned());
            data = Vec::new();
        }
        let end = noise.one_of(&["\n", "\n", "\r\n"]);
        let mut bytes = lines.join(end).into_bytes();
        bytes.extend(end.repeat(2).bytes());
        bytes.extend(data);
        let damaged = noise.one_in(3);
        if damaged {
            damage(&mut bytes, 0, noise);
        }
        let path = folder.write("volume.nrrd", &bytes);
        let both = (read_header(&path), read(&path));
        let Some(scan) = agreed(both, |header| header.grid(), damaged || changes > 0, index) else {
            return Outcome::Refused;
        };
        // What was read can be written, and is then the same. Files that appear whole take their time.
        if noise.one_in(8) {
            let (low, high) = scan.volume.hu_range();
            let output = OutputType::choose(scan.volume.sample_type(), Rescale::NONE, [low, high]);
            let path = folder.path().join("again.nrrd");
            with_volume!(&scan.volume, volume => {
                save_volume(&path, &scan.template, volume, output)
            })
            .unwrap();
            assert_eq!(samples(&read(&path).unwrap().volume), samples(&scan.volume));
        }
        Outcome::Read
    });
}

fn samples(volume: &AnyVolume) -> Vec<f64> {
    with_volume!(volume, volume => volume.as_slice().iter().map(|sample| sample.to_f64()).collect())
}
