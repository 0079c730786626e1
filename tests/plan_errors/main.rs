//! Plans that are wrong: what users read about each fault.
//!
//! Every case is a small change of a plan that is right, and the number of faults that it makes; the
//! snapshots hold the messages.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

mod accept;
mod candidates;
mod pictures;
mod sweeps;
#[path = "../plan_schema/validator.rs"]
mod validator;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rhinoplan::plan::{Code, Diagnostics, MAX_PLAN_BYTES, PlanFile, PlanReadError};
use rhinoplan::space::Grid;

const RIGHT: &str = include_str!("../plans/example.toml");

/// The grid of the paper's CT.
fn grid() -> Grid {
    Grid::axis_aligned([320, 320, 151], [0.442, 0.442, 1.0]).unwrap()
}

fn faults_of(text: &str) -> Diagnostics {
    let file = PlanFile::from_text("plan.toml", Path::new("."), text);
    match file.resolve(&grid()) {
        Ok(_) => panic!("nothing is wrong with\n{text}"),
        Err(faults) => faults,
    }
}

/// What a case does to the plan that is right.
enum Change {
    /// Replaces a text that occurs once.
    Replace(&'static str, &'static str),
    /// Removes every line between two texts, the second excluded.
    Remove(&'static str, &'static str),
    /// Is another plan.
    Whole(String),
}
use Change::{Remove, Replace, Whole};

fn changed(changes: &[Change]) -> String {
    changed_from(RIGHT, changes)
}

fn changed_from(right: &str, changes: &[Change]) -> String {
    let mut text = right.to_owned();
    for change in changes {
        match change {
            Replace(from, to) => {
                assert_eq!(text.matches(from).count(), 1, "{from} is not there once");
                text = text.replace(from, to);
            }
            Remove(from, until) => {
                let start = text.find(from).unwrap();
                let end = until.is_empty().then_some(text.len());
                let end = end.or_else(|| text.find(until)).unwrap();
                text.replace_range(start..end, "");
            }
            Whole(other) => text.clone_from(other),
        }
    }
    text
}

/// A change of a plan that is right: its title, the number of faults that it makes, and what it does.
type Case<'a> = (&'a str, usize, &'a [Change]);

/// Checks the cases of one part of the plan against one snapshot.
fn check(part: &str, cases: &[Case<'_>]) {
    check_changes(part, RIGHT, cases);
}

/// As [`check`], of changes of another plan that is right.
fn check_changes(part: &str, right: &str, cases: &[Case<'_>]) {
    let mut shown = String::new();
    for (title, number, changes) in cases {
        let text = changed_from(right, changes);
        let faults = faults_of(&text);
        let rendered = faults.render(false);
        assert_eq!(faults.len(), *number, "{title}:\n{rendered}");
        assert!(
            faults.iter().is_sorted_by_key(|f| (f.line, f.column)),
            "{title}:\n{rendered}"
        );
        for fault in &faults {
            let place = format!("plan.toml:{}:{}\n", fault.line, fault.column);
            assert!(rendered.contains(&place), "{title}: {place}\n{rendered}");
            // What is absent, and what cannot be parsed, was not found.
            let absent = [Code::MissingKey, Code::Syntax].contains(&fault.code);
            assert!(absent || fault.expected.is_some(), "{title}:\n{rendered}");
            assert!(absent || fault.found.is_some(), "{title}:\n{rendered}");
        }
        // The schema refuses what a schema can: all but what `beyond_a_schema` gives a reason for, and what is no
        // TOML, which no schema gets to see.
        if let Some(errors) = validator::errors_of_text(&text) {
            let is_beyond = |fault| validator::beyond_a_schema(fault).is_some();
            let all_are_beyond = faults.iter().all(is_beyond);
            assert_eq!(errors.is_empty(), all_are_beyond, "{title}: {errors:#?}");
        }
        writeln!(shown, "===== {title}\n\n{rendered}").unwrap();
    }
    insta::assert_snapshot!(part, shown.trim_end());
}

#[test]
fn text() {
    check(
        "text",
        &[
            ("an empty file", 5, &[Whole(String::new())]),
            (
                "a value is missing; nothing behind it is judged",
                1,
                &[
                    Replace("depth = { mm = 11.0 }", "depth ="),
                    Replace("scale = \"full\"", "scale = 1"),
                ],
            ),
            (
                "a string has no quotes",
                1,
                &[Replace("scale = \"full\"", "scale = full")],
            ),
            (
                "another string has no quotes",
                1,
                &[Replace(
                    "path = \"patient.nii.gz\"",
                    "path = ct/patient.nii.gz",
                )],
            ),
            (
                "a boolean of another language",
                1,
                &[Replace("scale = ", "compare_exact = True\nscale = ")],
            ),
            (
                "a string is not closed",
                1,
                &[Replace("name = \"smaller\"", "name = \"smaller")],
            ),
            (
                "an array is not closed at the end",
                1,
                &[Replace("\"displacement\"]", "\"displacement\"")],
            ),
            (
                "another language",
                1,
                &[Whole("{ \"plan\": 1, \"name\": \"a\" }\n".to_owned())],
            ),
            (
                "a hundred thousand brackets",
                1,
                &[Whole(format!("plan = {}", "[".repeat(100_000)))],
            ),
            (
                "a key twice, and a fault behind it",
                2,
                &[
                    Replace("skin_hu = -500.0", "skin_hu = -500.0\nskin_hu = -300.0"),
                    Replace("scale = \"full\"", "scale = \"ful\""),
                ],
            ),
            (
                "a key twice in an inline table",
                1,
                &[Replace("{ width = 0.95 }", "{ width = 0.95, width = 1.1 }")],
            ),
            (
                "a table twice",
                1,
                &[Replace("[outputs] ", "[cage]\n\n[outputs] ")],
            ),
        ],
    );
}

#[test]
fn head() {
    check(
        "head",
        &[
            ("no version", 1, &[Remove("plan = 1", "name")]),
            (
                "a later version: its keys may mean anything",
                1,
                &[
                    Replace("plan = 1 ", "plan = 2 "),
                    Replace("[f1]", "[feature_line]"),
                ],
            ),
            (
                "a version of another type",
                1,
                &[Replace("plan = 1 ", "plan = \"1\" ")],
            ),
            ("no name", 1, &[Remove("name = ", "title")]),
            (
                "a name that leaves the output folder",
                1,
                &[Replace("\"two-operations\"", "\"../../etc\"")],
            ),
            (
                "a name with capitals and spaces",
                1,
                &[Replace("\"two-operations\"", "\"Two Operations (new)\"")],
            ),
            ("an empty name", 1, &[Replace("\"two-operations\"", "\"\"")]),
            (
                "a name that is a number",
                1,
                &[Replace("\"two-operations\"", "2")],
            ),
            (
                "a title of two lines",
                1,
                &[Replace("\"Straighten, then", "\"Straighten,\\n then")],
            ),
            (
                "a long title",
                1,
                &[Whole(
                    RIGHT.replace("Straighten, ", &"Straighten, ".repeat(17)),
                )],
            ),
            (
                "unknown keys",
                3,
                &[
                    Replace("title = \"Straighten", "titel = \"Straighten"),
                    Replace("[segment]", "\"seg\\u001bment\".a = 1\n[segment]"),
                    Replace("[outputs] ", "[output] "),
                ],
            ),
        ],
    );
}

#[test]
fn ct() {
    check(
        "ct",
        &[
            ("no [ct]", 1, &[Remove("[ct]", "[landmarks]")]),
            ("an empty [ct]", 1, &[Remove("path =", "[landmarks]")]),
            (
                "both sources",
                1,
                &[Replace("path =", "phantom = \"lee2001\"\npath =")],
            ),
            (
                "[ct] is a string",
                2,
                &[
                    Remove("[ct]", "[landmarks]"),
                    Replace(
                        "title = \"Straighten",
                        "ct = \"a.nii\"\ntitel = \"Straighten",
                    ),
                ],
            ),
            ("an empty path", 1, &[Replace("\"patient.nii.gz\"", "\"\"")]),
            (
                "a path with a NUL",
                1,
                &[Replace("patient.nii.gz", "a\\u0000.nii")],
            ),
            (
                "an unknown phantom",
                1,
                &[Replace(
                    "path = \"patient.nii.gz\"",
                    "phantom = \"lee-2001\"",
                )],
            ),
            (
                "a pinned phantom",
                1,
                &[Replace(
                    "path = \"patient.nii.gz\"",
                    "phantom = \"lee2001\"\nsha256 = \"e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855\"",
                )],
            ),
            (
                "a series of the phantom",
                1,
                &[Replace(
                    "path = \"patient.nii.gz\"",
                    "phantom = \"lee2001\"\nseries = \"1.2.3\"",
                )],
            ),
            (
                "a series that is no UID",
                1,
                &[Replace("[landmarks]", "series = \"1.2 3\"\n[landmarks]")],
            ),
            (
                "a series that is a number",
                1,
                &[Replace("[landmarks]", "series = 4\n[landmarks]")],
            ),
            (
                "a short pin",
                1,
                &[Replace("[landmarks]", "sha256 = \"e3b0c4\"\n[landmarks]")],
            ),
            (
                "a pin that is not hexadecimal",
                1,
                &[Replace(
                    "[landmarks]",
                    "sha256 = \"g3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855\"\n[landmarks]",
                )],
            ),
        ],
    );
}

#[test]
fn landmarks() {
    check(
        "landmarks",
        &[
            ("no [landmarks]", 1, &[Remove("[landmarks]", "[cage]")]),
            ("no frame", 1, &[Remove("frame = ", "nasal_bones")]),
            (
                "two points are missing",
                1,
                &[Remove("alare_left ", "maxilla")],
            ),
            (
                "an unknown frame",
                1,
                &[Replace("frame = \"voxel\"", "frame = \"RSA\"")],
            ),
            (
                "a frame in capitals",
                1,
                &[Replace("frame = \"voxel\"", "frame = \"Voxel\"")],
            ),
            (
                "a landmark file",
                1,
                &[
                    Remove("frame = ", "[cage]"),
                    Replace("[cage]", "file = \"patient.mrk.json\"\n[cage]"),
                ],
            ),
            (
                "a landmark file beside points",
                2,
                &[Replace("[cage]", "file = \"none/patient.fcsv\"\n[cage]")],
            ),
            (
                "a landmark file without a name",
                1,
                &[
                    Remove("frame = ", "[cage]"),
                    Replace("[cage]", "file = \"\"\n[cage]"),
                ],
            ),
            (
                "points that are no points",
                6,
                &[
                    Replace("[141.1, 71.6, 78.9]", "[141.1, 71.6]"),
                    Replace("[141.1, 67.6, 53.1]", "[141.1, nan, -inf]"),
                    Replace("[96.0, 60.0, 60.0]", "\"96, 60, 60\""),
                    Replace("[129.0, 33.0, 61.0]", "[129.0, 33.0, 1e999]"),
                    Replace("[141.0, 83.6, 60.0]", "[141.0, 83.6, 99999999999999999999]"),
                ],
            ),
            (
                "a misspelt landmark",
                2,
                &[Replace("alare_right", "alare_rigth")],
            ),
            (
                "alare points swapped",
                1,
                &[
                    Replace("alare_right", "alare_x"),
                    Replace("alare_left ", "alare_right"),
                    Replace("alare_x", "alare_left"),
                ],
            ),
            (
                "upside-down",
                1,
                &[
                    Replace("71.6, 78.9]", "71.6, 53.1]"),
                    Replace("67.6, 53.1]", "67.6, 78.9]"),
                ],
            ),
            (
                "lip and nasal bones at one height",
                1,
                &[Replace("71.6, 78.9]", "71.6, 53.1]")],
            ),
            (
                "the tip behind the base plane",
                1,
                &[Replace("[129.0, 33.0, 61.0]", "[129.0, 90.0, 61.0]")],
            ),
            (
                "a head that is upside-down with its left and right",
                2,
                &[
                    Replace("71.6, 78.9]", "71.6, 53.1]"),
                    Replace("67.6, 53.1]", "67.6, 78.9]"),
                    Replace("alare_right", "alare_x"),
                    Replace("alare_left ", "alare_right"),
                    Replace("alare_x", "alare_left"),
                ],
            ),
            (
                "a head that looks down",
                1,
                &[
                    Replace("[141.1, 71.6, 78.9]", "[141.1, 40.0, 60.0]"),
                    Replace("[141.1, 67.6, 53.1]", "[141.1, 70.0, 58.0]"),
                ],
            ),
            (
                "lip and tip exchanged",
                1,
                &[
                    Replace(
                        "tip         = [129.0, 33.0, 61.0]",
                        "tip = [141.1, 67.6, 53.1]",
                    ),
                    Replace(
                        "lip         = [141.1, 67.6, 53.1]",
                        "lip = [129.0, 33.0, 61.0]",
                    ),
                ],
            ),
            (
                "nasal bones and tip exchanged",
                1,
                &[
                    Replace(
                        "tip         = [129.0, 33.0, 61.0]",
                        "tip = [141.1, 67.0, 79.0]",
                    ),
                    Replace(
                        "nasal_bones = [141.1, 71.6, 78.9]",
                        "nasal_bones = [129.0, 60.0, 61.0]",
                    ),
                ],
            ),
            (
                "a landmark outside the volume",
                1,
                &[Replace("[141.1, 71.6, 78.9]", "[141.1, 71.6, 150.2]")],
            ),
            (
                "the root outside the volume",
                1,
                &[Replace("root = [141.0,", "root = [-141.0,")],
            ),
            (
                "the root at the tip",
                1,
                &[Replace("[141.0, 70.0, 84.0]", "[129.0, 33, 61]")],
            ),
        ],
    );
}

/// A plan whose landmarks are in a file of this content, and what is wrong with it.
fn faults_with_file(name: &str, content: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), content).unwrap();
    let file = format!("file = \"{name}\"\n\n[cage]");
    let mut text = changed(&[Remove("frame = ", "[cage]")]);
    text = text.replace("[cage]", &file);
    let plan = PlanFile::from_text("plan.toml", folder.path(), &text);
    let faults = match plan.resolve(&grid()) {
        Ok(_) => panic!("nothing is wrong with\n{content}"),
        Err(faults) => faults,
    };
    let folder = folder.path().display().to_string();
    faults.render(false).replace(&folder, "FOLDER")
}

/// Faults of a file of landmarks, at the line of the plan that names it.
#[test]
fn landmark_files() {
    let point =
        |label: &str, at: [f64; 3]| format!("{{\"label\": \"{label}\", \"position\": {at:?}}}");
    let json = |system: &str, points: &[String]| {
        format!(
            "{{\"markups\": [{{\"coordinateSystem\": \"{system}\", \"controlPoints\": [\n{}]}}]}}",
            points.join(",\n")
        )
    };
    // The example's landmarks in LPS mm on the grid of these tests.
    let mm = |[x, y, z]: [f64; 3]| [x * 0.442, y * 0.442, z];
    let points = [
        point("nasal_bones", mm([141.1, 71.6, 78.9])),
        point("lip", mm([141.1, 67.6, 53.1])),
        point("alare_right", mm([96.0, 60.0, 60.0])),
        point("alare_left", mm([186.0, 60.0, 60.0])),
        point("tip", mm([129.0, 33.0, 61.0])),
        point("maxilla", mm([141.0, 83.6, 60.0])),
    ];
    let mut misnamed = points.clone();
    misnamed[4] = point("Nose-Tip", [1.0, 2.0, 3.0]);
    misnamed[1] = point("maxila", [1.0, 2.0, 3.0]);
    let shown = [
        (
            "not JSON",
            faults_with_file("a.mrk.json", "{\n \"markups\": [,\n"),
        ),
        (
            "labels",
            faults_with_file("a.mrk.json", &json("LPS", &misnamed)),
        ),
        (
            "the other frame",
            faults_with_file("a.mrk.json", &json("RAS", &points)),
        ),
        ("a table", faults_with_file("a.fcsv", "# columns = x\n")),
    ];
    let shown: Vec<String> = shown
        .iter()
        .map(|(title, faults)| format!("===== {title}\n\n{faults}"))
        .collect();
    insta::assert_snapshot!("landmark_files", shown.join("\n").trim_end());
}

/// The landmarks of the plan that is right in LPS mm on the grid of these tests, in a plan that calls
/// them RAS.
#[test]
fn a_wrong_frame_is_recognised() {
    let mm = |x: f64, y: f64, z: f64| format!("[{:.3}, {:.3}, {z:.3}]", x * 0.442, y * 0.442);
    let text = RIGHT
        .replace("[141.1, 71.6, 78.9]", &mm(141.1, 71.6, 78.9))
        .replace("[141.1, 67.6, 53.1]", &mm(141.1, 67.6, 53.1))
        .replace("[96.0, 60.0, 60.0]", &mm(96.0, 60.0, 60.0))
        .replace("[186.0, 60.0, 60.0]", &mm(186.0, 60.0, 60.0))
        .replace("[129.0, 33.0, 61.0]", &mm(129.0, 33.0, 61.0))
        .replace("[141.0, 83.6, 60.0]", &mm(141.0, 83.6, 60.0))
        .replace("[141.0, 70.0, 84.0]", &mm(141.0, 70.0, 84.0));
    let ras = text.replace("frame = \"voxel\"", "frame = \"ras\"");
    check("frame", &[("LPS called RAS", 9, &[Whole(ras.clone())])]);
    let hint = "with `frame = \"lps\"` every landmark would be in the volume and on its side";
    for fault in &faults_of(&ras) {
        assert_eq!(fault.hint.as_deref(), Some(hint));
    }
    let lps = text.replace("frame = \"voxel\"", "frame = \"lps\"");
    let file = PlanFile::from_text("plan.toml", Path::new("."), &lps);
    assert!(file.resolve(&grid()).is_ok());
}

#[test]
fn settings() {
    check(
        "settings",
        &[
            (
                "a length without a unit",
                1,
                &[Replace("depth = { mm = 11.0 }", "depth = 11")],
            ),
            (
                "a length of another unit",
                1,
                &[Replace("depth = { mm = 11.0 }", "depth = { cm = 1.1 }")],
            ),
            (
                "a length in two units",
                1,
                &[Replace("{ mm = 11.0 }", "{ mm = 11.0, voxels = 25 }")],
            ),
            (
                "a length of nothing",
                1,
                &[Replace("depth = { mm = 11.0 }", "depth = {}")],
            ),
            (
                "lengths out of range",
                3,
                &[
                    Replace("{ mm = 11.0 }", "{ mm = 0 }"),
                    Replace("{ mm = 0.05 }", "{ voxels = -0.1 }"),
                    Replace("{ mm = 20.0 }", "{ mm = 1e4 }"),
                ],
            ),
            (
                "a margin in voxels",
                1,
                &[Replace("{ mm = 20.0 }", "{ voxels = 20.0 }")],
            ),
            (
                "bone not above skin",
                1,
                &[Replace("bone_hu = 300.0", "bone_hu = -500")],
            ),
            (
                "skin above the default bone",
                1,
                &[
                    Remove("bone_hu = ", "[morph]"),
                    Replace("skin_hu = -500.0", "skin_hu = 301"),
                ],
            ),
            (
                "thresholds that are no numbers of HU",
                2,
                &[
                    Replace("skin_hu = -500.0", "skin_hu = true"),
                    Replace("bone_hu = 300.0", "bone_hu = 40000"),
                ],
            ),
            (
                "unknown words",
                3,
                &[
                    Replace("model = \"local\"", "model = \"locale\""),
                    Replace("scale = \"full\"", "scale = 0.5"),
                    Replace("method = \"adaptive\"", "method = \"octree\""),
                ],
            ),
            (
                "a margin of the wrong model, and a width",
                2,
                &[Replace("model = \"local\"", "model = \"lee2001\"")],
            ),
            (
                "keys of the wrong method",
                2,
                &[Replace(
                    "method = \"adaptive\"",
                    "compare_exact = false\nmethod = \"exact\"",
                )],
            ),
            (
                "a comparison that is no boolean",
                1,
                &[Replace("scale = ", "compare_exact = \"yes\"\nscale = ")],
            ),
            (
                "keys of other tables",
                2,
                &[
                    Replace("depth = ", "tip = 1\ndepth = "),
                    Replace("skin_hu = ", "width = 1\nskin_hu = "),
                ],
            ),
            (
                "[mesh] without the output",
                1,
                &[Replace(
                    "[outputs]",
                    "[mesh]\ntriangles = 200000\n[outputs]",
                )],
            ),
            (
                "meshes of too few triangles, and a key of another table",
                2,
                &[Replace(
                    "\"displacement\"]",
                    "\"mesh\"]\n[mesh]\ntriangles = 999\nsize = 1024",
                )],
            ),
            (
                "a number of triangles that is not whole",
                1,
                &[Replace(
                    "\"displacement\"]",
                    "\"solids\", \"mesh\", \"inverse\"]\n[mesh]\ntriangles = 2e5",
                )],
            ),
            (
                "outputs unknown and twice",
                3,
                &[Replace("\"displacement\"]", "\"volume\", \"volumes\", 3]")],
            ),
            (
                "no outputs",
                1,
                &[Replace("[\"volume\", \"displacement\"]", "[]")],
            ),
            (
                "an output that is no array",
                1,
                &[Replace("[\"volume\", \"displacement\"]", "\"volume\"")],
            ),
        ],
    );
}

/// One plan with faults of every kind: all are reported, in the order of the file.
#[test]
fn kitchen_sink() {
    let text = include_str!("../plans/kitchen-sink.toml");
    let faults = faults_of(text);
    check(
        "kitchen_sink",
        &[(
            "faults of every kind",
            faults.len(),
            &[Whole(text.to_owned())],
        )],
    );
    let lines: Vec<usize> = faults.iter().map(|fault| fault.line).collect();
    // Every line of that plan that is wrong says so.
    let marked = (1..)
        .zip(text.lines())
        .filter(|(_, line)| line.contains("# wrong"));
    let marked: Vec<usize> = marked.map(|(number, _)| number).collect();
    assert!(marked.len() >= 15, "{marked:?}");
    assert_eq!(lines, marked);
}

#[test]
fn faults_serialise_for_scripts() {
    let faults = faults_of(&changed(&[
        Replace("scale = \"full\"", "scale = \"ful\""),
        Remove("path =", "[landmarks]"),
    ]));
    insta::assert_json_snapshot!("json", faults);
}

/// Without the grid, all but the positions in the volume are judged.
#[test]
fn faults_without_the_ct() {
    let text = changed(&[
        Replace("scale = \"full\"", "scale = \"ful\""),
        Replace("[129.0, 33.0, 61.0]", "[129.0, 90.0, 61.0]"),
        Replace("[96.0, 60.0, 60.0]", "[96.0, 60.0, 999.0]"),
    ]);
    let file = PlanFile::from_text("plan.toml", Path::new("."), &text);
    let codes = |faults: Diagnostics| faults.iter().map(|f| f.code).collect::<Vec<_>>();
    assert_eq!(codes(file.faults()), [Code::WrongSide, Code::BadValue]);
    let all = file.resolve(&grid()).unwrap_err();
    let expected = [Code::OutsideVolume, Code::WrongSide, Code::BadValue];
    assert_eq!(codes(all), expected);
    // In mm, sides are not known before the axes are.
    let text = text.replace("frame = \"voxel\"", "frame = \"lps\"");
    let file = PlanFile::from_text("plan.toml", Path::new("."), &text);
    assert_eq!(codes(file.faults()), [Code::BadValue]);
}

#[test]
fn faults_of_the_ct_are_placed_at_its_path() {
    let file = PlanFile::from_text("plan.toml", Path::new("."), RIGHT);
    assert_eq!(file.name(), Some("two-operations"));
    assert_eq!(file.shown_name(), "plan.toml");
    let hint = Some("check the path".to_owned());
    let fault = file.ct_fault("there is no file ./patient.nii.gz", hint);
    insta::assert_snapshot!("ct_fault", fault.render(false));
    let place = |text: &str| {
        let fault = PlanFile::from_text("p", Path::new("."), text).ct_fault("gone", None);
        (fault.line, fault.column)
    };
    assert_eq!(place("plan = 1\n[ct]\nphantom = \"lee2001\"\n"), (3, 11));
    assert_eq!(place("plan = 1\n[ct]\n"), (2, 1));
    assert_eq!(place("not toml"), (1, 1));
}

#[test]
fn files_that_cannot_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let read = |path: &PathBuf| PlanFile::read(path).map(|_| ());

    let missing = path("missing.toml");
    let error = read(&missing).unwrap_err();
    assert!(matches!(&error, PlanReadError::Missing { path } if *path == missing));
    assert!(error.to_string().contains("missing.toml"));

    let error = read(&folder.path().to_owned()).unwrap_err();
    assert!(matches!(error, PlanReadError::Folder { .. }), "{error}");

    let latin = path("latin.toml");
    std::fs::write(&latin, b"title = \"\xe9\"").unwrap();
    let error = read(&latin).unwrap_err();
    assert!(
        matches!(error, PlanReadError::NotUtf8 { offset: 9, .. }),
        "{error}"
    );

    let large = path("large.toml");
    let limit = usize::try_from(MAX_PLAN_BYTES).unwrap();
    std::fs::write(&large, vec![b'#'; limit + 1]).unwrap();
    let error = read(&large).unwrap_err();
    assert!(matches!(error, PlanReadError::TooLarge { .. }), "{error}");
    std::fs::write(&large, vec![b'#'; limit]).unwrap();
    assert!(read(&large).is_ok());
}

#[test]
fn a_file_is_shown_as_the_user_named_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("my plan.toml");
    std::fs::write(
        &path,
        changed(&[Replace("scale = \"full\"", "scale = \"ful\"")]),
    )
    .unwrap();
    let file = PlanFile::read(&path).unwrap();
    let faults = file.faults();
    let fault = faults.iter().next().unwrap();
    assert_eq!(fault.file, path.display().to_string());
    let Some(rhinoplan::plan::CtSource::File { path: ct, .. }) = file.ct() else {
        panic!("the CT is given");
    };
    assert_eq!(ct, folder.path().join("patient.nii.gz"));
}
