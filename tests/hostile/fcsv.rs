//! 3D Slicer's older tables of fiducials.

use rhinoplan::feature::Landmark;
use rhinoplan::io::landmarks::LandmarkFile;

use crate::bounded::{Bench, Expect, Role};
use crate::noise::{Noise, damage, fuzz};
use crate::points::{AT, WORDS, judged};

/// Files that are tried by default: about a second.
const TRIES: usize = 20_000;

/// Header and rows, the cells apart.
fn table() -> (Vec<String>, Vec<Vec<String>>) {
    let head = [
        "# Markups fiducial file version = 4.11",
        "# CoordinateSystem = LPS",
        "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID",
    ];
    let rows = Landmark::ALL
        .iter()
        .zip(AT)
        .enumerate()
        .map(|(n, (landmark, [x, y, z]))| {
            let row =
                format!("{n},{x},{y},{z},0,0,0,1,1,1,0,{landmark},,vtkMRMLScalarVolumeNode1,2,0");
            row.split(',').map(str::to_owned).collect()
        });
    (head.map(str::to_owned).to_vec(), rows.collect())
}

fn joined((head, rows): &(Vec<String>, Vec<Vec<String>>), separator: &str, end: &str) -> String {
    let rows = rows.iter().map(|row| row.join(separator));
    head.iter()
        .cloned()
        .chain(rows)
        .map(|line| line + end)
        .collect()
}

pub fn sound() -> String {
    joined(&table(), ",", "\n")
}

#[test]
fn the_corpus() {
    let bench = Bench::new();
    let sound = sound();
    let with = |from: &str, to: &str| {
        assert!(sound.contains(from), "{from}");
        sound.replace(from, to).into_bytes()
    };
    let utf16: Vec<u8> = sound.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let mut flipped = sound.clone().into_bytes();
    let at = sound.find(",tip,").unwrap();
    flipped[at] ^= 0x20;
    let half = sound.find("\n3,").unwrap();
    let rows = format!("{sound}{}", "7,1,2,3,0,0,0,1,1,1,0,x,,\n".repeat(30_000));
    use Expect::{Read, Refused};
    let cases: Vec<(&str, Vec<u8>, Expect)> = vec![
        ("sound.fcsv", sound.clone().into(), Read),
        (
            "windows.fcsv",
            format!("\u{feff}{}", sound.replace('\n', "\r\n")).into(),
            Read,
        ),
        ("no-end.fcsv", sound.trim_end().into(), Read),
        ("wrong.mrk.json", sound.clone().into(), Read),
        ("wrong.csv", sound.clone().into(), Read),
        (
            "cut.fcsv",
            sound[..half].into(),
            Refused(&["has no `alare_left` and no `tip`"]),
        ),
        (
            "cut-in-row.fcsv",
            sound[..half + 5].into(),
            Refused(&["too few for a point"]),
        ),
        (
            "cut-in-header.fcsv",
            sound[..20].into(),
            Refused(&["no line `# CoordinateSystem"]),
        ),
        ("flipped.fcsv", flipped, Refused(&["no `tip`"])),
        (
            "byte.fcsv",
            [sound.as_bytes(), b"\xff"].concat(),
            Refused(&["not UTF-8", "save it as UTF-8"]),
        ),
        (
            "utf16.fcsv",
            [b"\xff\xfe", &utf16[..]].concat(),
            Refused(&["not UTF-8", "byte 0"]),
        ),
        (
            "nan.fcsv",
            with(",-24,", ",nan,"),
            Refused(&["`tip`", "(0, nan, -3)", "not three finite numbers"]),
        ),
        (
            "inf.fcsv",
            with(",-24,", ",-Infinity,"),
            Refused(&["`tip`", "not three finite numbers"]),
        ),
        (
            "vast.fcsv",
            with(",-24,", ",1e999,"),
            Refused(&["`tip`", "not three finite numbers"]),
        ),
        (
            "comma.fcsv",
            with(",-24,", ",\"-24,0\","),
            Refused(&["`tip`", "not three finite numbers"]),
        ),
        (
            "system.fcsv",
            with("= LPS", "= 7"),
            Refused(&["`CoordinateSystem` as `7`"]),
        ),
        (
            "columns.fcsv",
            with("columns = id,x,y,z", "columns = id,a,b,c"),
            Refused(&["`# columns` names no"]),
        ),
        (
            "semicolons.fcsv",
            sound.replace(',', ";").into(),
            Refused(&["`# columns` names no"]),
        ),
        (
            "quote.fcsv",
            with(",lip,", ",\"lip,"),
            Refused(&["has no `lip` and no `alare_right`"]),
        ),
        (
            "twice.fcsv",
            with(",lip,", ",tip,"),
            Refused(&["more than one `tip`"]),
        ),
        (
            "zero.fcsv",
            with(",lip,", ",l\u{0}p,"),
            Refused(&["no `lip`"]),
        ),
        ("rows.fcsv", rows.into(), Refused(&["and 29990 more"])),
        (
            "long.fcsv",
            (sound.clone() + &"#".repeat(2 << 20)).into(),
            Refused(&["larger than 1048576 bytes"]),
        ),
        (
            "cells.fcsv",
            (sound.clone() + &",".repeat(1 << 19)).into(),
            Read,
        ),
        (
            "comments.fcsv",
            (sound.clone() + &"# a = b\n".repeat(1 << 16)).into(),
            Read,
        ),
        (
            "labels.fcsv",
            with(",lip,", &format!(",\u{1b}[31m{},", "x".repeat(1 << 18))),
            Refused(&["no `lip`", "\\u{1b}[31m", "…"]),
        ),
        (
            "spaces.fcsv",
            b"\xef\xbb\xbf \r\n\t".to_vec(),
            Refused(&["is empty"]),
        ),
    ];
    for (name, bytes, expect) in cases {
        bench.try_bytes(Role::Landmarks, name, bytes, &expect);
    }
}

fn change((head, rows): &mut (Vec<String>, Vec<Vec<String>>), noise: &mut Noise) {
    let row = noise.below(rows.len());
    match noise.below(9) {
        0..=2 => {
            let cell = noise.below(rows[row].len());
            rows[row][cell] = noise.one_of(&WORDS).to_owned();
        }
        3 => {
            let cell = noise.below(rows[row].len());
            rows[row][cell] = format!("{:?}", noise.unit() * 1e3);
        }
        4 => {
            let len = rows[row].len();
            rows[row].truncate(1 + noise.below(len));
        }
        5 => {
            let doubled = rows[row].clone();
            rows.insert(noise.below(rows.len()), doubled);
        }
        6 if rows.len() > 1 => drop(rows.remove(row)),
        7 => {
            let system = noise.one_of(&["LPS", "RAS", "0", "1", "2", "lps", "", "LPS,RAS"]);
            head[1] = format!("# CoordinateSystem = {system}");
        }
        _ => {
            let columns = noise.one_of(&[
                "# columns = label,x,y,z",
                "# columns = id,z,y,x,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID",
                "# columns = x,y,label",
                "# columns = ",
                "# nothing",
                "",
            ]);
            head[2] = columns.to_owned();
        }
    }
}

/// Where no quotes join cells, some line holds a landmark's name and its three numbers.
fn assert_found(text: &str, file: &LandmarkFile) {
    if text.contains('"') {
        return;
    }
    let lines: Vec<Vec<&str>> = text
        .split(['\n', '\r'])
        .map(|line| line.split(',').map(str::trim).collect())
        .collect();
    for landmark in Landmark::ALL {
        let at = *file.points.get(landmark);
        let found = lines.iter().any(|cells| {
            let number = |mm: f64| cells.iter().any(|cell| cell.parse() == Ok(mm));
            cells.contains(&landmark.name()) && at.into_iter().all(number)
        });
        assert!(found, "{landmark} is not at {at:?}:\n{text}");
    }
}

#[test]
fn changed_at_random() {
    fuzz("fcsv::changed_at_random", "fcsv", TRIES, |index, noise| {
        let mut table = table();
        let mut changes = noise.below(3);
        for _ in 0..changes {
            change(&mut table, noise);
        }
        let separator = match noise.below(12) {
            0 => noise.one_of(&[";", "\t", ", ", " ,", "\",\""]),
            _ => ",",
        };
        changes += usize::from(separator != ",");
        let mut text = joined(&table, separator, noise.one_of(&["\n", "\n", "\r\n"]));
        if noise.one_in(4) {
            text.insert(0, '\u{feff}');
        }
        let mut bytes = text.into_bytes();
        if noise.one_in(4) {
            changes += 1;
            damage(&mut bytes, 0, noise);
        }
        judged(&bytes, changes > 0, index, assert_found)
    });
}
