//! 3D Slicer's markups JSON.

use rhinoplan::feature::Landmark;
use rhinoplan::io::landmarks::LandmarkFile;
use serde_json::{Value, json};

use crate::bounded::{Bench, Expect, Role};
use crate::noise::{Noise, damage, fuzz};
use crate::points::{AT, WORDS, judged};

/// Files that are tried by default: about a second.
const TRIES: usize = 20_000;

fn document() -> Value {
    let points: Vec<Value> = Landmark::ALL
        .iter()
        .zip(AT)
        .enumerate()
        .map(|(n, (landmark, at))| {
            json!({
                "id": n.to_string(), "label": landmark.name(), "description": "", "position": at,
                "orientation": [-1.0, 0.0, 0.0], "selected": true, "positionStatus": "defined",
            })
        })
        .collect();
    json!({
        "@schema": "https://raw.githubusercontent.com/slicer/slicer/master/markups-schema-v1.0.3.json#",
        "markups": [{
            "type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm", "locked": false,
            "controlPoints": points, "measurements": [], "display": { "visibility": true, "opacity": 1.0 },
        }],
    })
}

pub fn sound() -> String {
    serde_json::to_string_pretty(&document()).unwrap()
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
    let windows = format!("\u{feff}{}", sound.replace('\n', "\r\n"));
    let mut flipped = sound.clone().into_bytes();
    let at = sound.find(':').unwrap();
    flipped[at] ^= 1;
    let point = "{\"label\":\"x\",\"position\":[1,2,3]}";
    let many = [point; 30_000].join(",");
    let many = format!("{{\"markups\":[{{\"controlPoints\":[{many}]}}]}}");
    use Expect::{Read, Refused};
    let cases: Vec<(&str, Vec<u8>, Expect)> = vec![
        ("sound.mrk.json", sound.clone().into(), Read),
        ("windows.mrk.json", windows.into(), Read),
        ("wrong.fcsv", sound.clone().into(), Read),
        ("wrong.nii.gz", sound.clone().into(), Read),
        ("table.mrk.json", crate::fcsv::sound().into(), Read),
        (
            "cut.mrk.json",
            sound[..sound.len() / 2].into(),
            Refused(&["not markups JSON", "line"]),
        ),
        (
            "cut-late.mrk.json",
            sound[..sound.len() - 2].into(),
            Refused(&["not markups JSON", "line"]),
        ),
        (
            "flipped.mrk.json",
            flipped,
            Refused(&["not markups JSON", "line 2 column"]),
        ),
        (
            "byte.mrk.json",
            [sound.as_bytes(), b"\xff"].concat(),
            Refused(&["not UTF-8", "save it as UTF-8"]),
        ),
        (
            "utf16.mrk.json",
            [b"\xff\xfe", &utf16[..]].concat(),
            Refused(&["not UTF-8", "byte 0"]),
        ),
        (
            "nan.mrk.json",
            with("-24.0", "NaN"),
            Refused(&["not markups JSON", "line"]),
        ),
        (
            "inf.mrk.json",
            with("-24.0", "1e999"),
            Refused(&["number out of range", "line"]),
        ),
        (
            "text.mrk.json",
            with("-24.0", "\"-24.0\""),
            Refused(&["`tip`", "not three finite numbers"]),
        ),
        (
            "null.mrk.json",
            with("-24.0", "null"),
            Refused(&["`tip`", "not three finite numbers"]),
        ),
        (
            "system.mrk.json",
            with("\"LPS\"", "\"XYZ\""),
            Refused(&["`XYZ`", "`LPS` or `RAS`"]),
        ),
        (
            "units.mrk.json",
            with("\"mm\"", "\"inch\""),
            Refused(&["`inch`"]),
        ),
        (
            "twice.mrk.json",
            with("\"lip\"", "\"tip\""),
            Refused(&["more than one `tip`", "no `lip`"]),
        ),
        (
            "deep.mrk.json",
            "{\"markups\":".repeat(80_000).into(),
            Refused(&["not markups JSON"]),
        ),
        (
            "brackets.mrk.json",
            format!("{{\"markups\":{}", "[".repeat(900_000)).into(),
            Refused(&["not markups JSON"]),
        ),
        ("many.mrk.json", many.into(), Refused(&["and 29990 more"])),
        (
            "long.mrk.json",
            with("\"Fiducial\"", &format!("\"{}\"", "x".repeat(2 << 20))),
            Refused(&["larger than 1048576 bytes"]),
        ),
        (
            "objects.mrk.json",
            with("-24.0", &format!("[{}0]", "{\"\":0},".repeat(120_000))),
            Refused(&["`tip`", "not three finite numbers", "…"]),
        ),
        (
            "wordy.mrk.json",
            format!("{{\"markups\":\"{}\"}}", "x".repeat(1 << 19)).into(),
            Refused(&["not markups JSON", "expected a sequence"]),
        ),
        (
            "label.mrk.json",
            with(
                "\"lip\"",
                &format!("\"\\u001b[31m{}\"", "x".repeat(1 << 18)),
            ),
            Refused(&["no `lip`", "\\u{1b}[31m", "…"]),
        ),
        (
            "zeros.mrk.json",
            vec![0; 5000],
            Refused(&["neither markups JSON"]),
        ),
        (
            "spaces.mrk.json",
            b"\xef\xbb\xbf \r\n\t".to_vec(),
            Refused(&["is empty"]),
        ),
    ];
    for (name, bytes, expect) in cases {
        bench.try_bytes(Role::Landmarks, name, bytes, &expect);
    }
}

/// Every value of a document, by its path.
fn paths(value: &Value, path: String, all: &mut Vec<String>) {
    match value {
        Value::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                paths(item, format!("{path}/{index}"), all);
            }
        }
        Value::Object(members) => {
            for (key, member) in members {
                let key = key.replace('~', "~0").replace('/', "~1");
                paths(member, format!("{path}/{key}"), all);
            }
        }
        _ => {}
    }
    all.push(path);
}

fn any_value(noise: &mut Noise) -> Value {
    match noise.below(10) {
        0 => Value::Null,
        1 => json!(noise.one_in(2)),
        2 => json!([]),
        3 => json!({}),
        4 => json!(noise.unit() * 200.0),
        5 => json!(noise.one_of(&[0.0, -0.0, 1e308, -1e308, 1e-320])),
        6 => json!(noise.one_of(&[i64::MIN, -1, 0, 1, i64::MAX])),
        7 => json!([noise.unit(), noise.unit(), noise.unit()]),
        8 => json!(noise.one_of(&["undefined", "preview", "defined", "missing"])),
        _ => json!(noise.one_of(&WORDS)),
    }
}

/// Changes a member, or an item: another value, gone, doubled, under another key.
fn change_value(document: &mut Value, noise: &mut Noise) {
    let mut all = Vec::new();
    paths(document, String::new(), &mut all);
    let path = all[noise.below(all.len())].clone();
    let Some((above, key)) = path.rsplit_once('/') else {
        return;
    };
    let key = key.replace("~1", "/").replace("~0", "~");
    match (noise.below(5), document.pointer_mut(above).unwrap()) {
        (0, Value::Object(members)) => drop(members.remove(&key)),
        (0, Value::Array(items)) => drop(items.remove(key.parse().unwrap())),
        (1, Value::Object(members)) => {
            let value = members.remove(&key).unwrap();
            let other = noise.one_of(&[
                "label",
                "position",
                "controlPoints",
                "coordinateSystem",
                "x",
            ]);
            members.insert(other.to_owned(), value);
        }
        (1, Value::Array(items)) => {
            let item = items[key.parse::<usize>().unwrap()].clone();
            items.push(item);
        }
        (_, above) => {
            let value = any_value(noise);
            match above {
                Value::Object(members) => drop(members.insert(key, value)),
                Value::Array(items) => items[key.parse::<usize>().unwrap()] = value,
                _ => {}
            }
        }
    }
}

/// Changes the text: a number or a word becomes another, or what no program writes is put in.
fn change_text(text: &mut String, noise: &mut Noise) {
    let place = |text: &str, noise: &mut Noise| {
        let mut at = noise.below(text.len() + 1);
        while !text.is_char_boundary(at) {
            at -= 1;
        }
        at
    };
    let at = place(text, noise);
    match noise.below(4) {
        0 => {
            let start = text[..at]
                .rfind(['[', ',', ':', ' '])
                .map_or(0, |at| at + 1);
            let end = text[at..]
                .find([']', ',', '}', '\n'])
                .map_or(text.len(), |end| at + end);
            if start <= end {
                text.replace_range(start..end, noise.one_of(&WORDS));
            }
        }
        1 => text.insert_str(at, noise.one_of(&WORDS)),
        2 => text.insert_str(
            at,
            noise.one_of(&[
                "{", "}", "[", "]", ",", ":", "\"", "\\u0000", "\\ud800", "/*x*/",
            ]),
        ),
        _ => {
            let to = place(text, noise);
            let piece = text[at.min(to)..at.max(to)]
                .chars()
                .take(60)
                .collect::<String>();
            text.insert_str(at, &piece);
        }
    }
}

/// Another reader of the same text finds each landmark at the same place.
fn assert_found(text: &str, file: &LandmarkFile) {
    // Text and numbers that are passed over may be what this reader refuses: half a surrogate pair, 1e999.
    let Ok(document) = serde_json::from_str::<Value>(text.trim_start_matches('\u{feff}')) else {
        return;
    };
    let markups = document["markups"].as_array().unwrap();
    let points: Vec<&Value> = markups
        .iter()
        .filter_map(|markup| markup["controlPoints"].as_array())
        .flatten()
        .collect();
    for landmark in Landmark::ALL {
        let [x, y, z] = *file.points.get(landmark);
        let found = points.iter().any(|point| {
            let label = point["label"].as_str().unwrap_or_default().trim();
            let [a, b, c] = [0, 1, 2].map(|axis| point["position"][axis].as_f64());
            label == landmark.name() && [a, b, c] == [Some(x), Some(y), Some(z)]
        });
        assert!(found, "{landmark} is not at {:?}:\n{text}", [x, y, z]);
    }
}

#[test]
fn changed_at_random() {
    fuzz(
        "json::changed_at_random",
        "mrk.json",
        TRIES,
        |index, noise| {
            let mut document = document();
            let mut changes = noise.below(3);
            for _ in 0..changes {
                change_value(&mut document, noise);
            }
            let mut text = match noise.below(2) {
                0 => document.to_string(),
                _ => serde_json::to_string_pretty(&document).unwrap(),
            };
            if noise.one_in(4) {
                changes += 1;
                change_text(&mut text, noise);
            }
            if noise.one_in(4) {
                text = format!("\u{feff}{}", text.replace('\n', "\r\n"));
            }
            let mut bytes = text.into_bytes();
            if noise.one_in(5) {
                changes += 1;
                damage(&mut bytes, 0, noise);
            }
            judged(&bytes, changes > 0, index, assert_found)
        },
    );
}
