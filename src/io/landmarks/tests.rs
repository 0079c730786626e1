use super::*;

/// Where the points of these files are, in their own numbers, in the order of [`Landmark::ALL`].
const AT: [[f64; 3]; 6] = [
    [1.5, -84.25, -11.0],
    [2.5, -97.0, -74.25],
    [-15.75, -90.5, -51.75],
    [19.625, -90.5, -51.75],
    [0.5, -110.5, -44.25],
    [-15.75, -82.75, -53.25],
];

fn point(label: &str, position: &str, rest: &str) -> String {
    format!("{{ \"label\": \"{label}\", \"position\": {position}{rest} }}")
}

fn points() -> Vec<String> {
    let all = Landmark::ALL.iter().zip(AT);
    all.map(|(landmark, at)| point(landmark.name(), &format!("{at:?}"), ""))
        .collect()
}

fn json_of(head: &str, points: &[String]) -> String {
    format!(
        "{{\n\"markups\": [{{\n\"type\": \"Fiducial\", {head}\n\"controlPoints\": [\n{}\n]}}]}}\n",
        points.join(",\n")
    )
}

fn json() -> String {
    json_of("\"coordinateSystem\": \"LPS\",", &points())
}

fn fcsv_of(system: &str, tail: &str) -> String {
    let mut text = format!(
        "# Markups fiducial file version = 4.11\n{system}\
         # columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
    );
    for (n, (landmark, [x, y, z])) in Landmark::ALL.iter().zip(AT).enumerate() {
        text += &format!("{n},{x},{y},{z},0,0,0,1,1,1,0,{landmark},\"a, b\",{tail}\n");
    }
    text
}

fn fcsv(system: &str) -> String {
    fcsv_of(&format!("# CoordinateSystem = {system}\n"), "")
}

#[track_caller]
fn assert_reads(text: impl AsRef<[u8]>, system: CoordinateSystem) {
    let file = parse(text.as_ref()).unwrap();
    assert_eq!(file.system, system);
    let found = Landmark::ALL.map(|landmark| *file.points.get(landmark));
    assert_eq!(found, AT);
}

#[track_caller]
fn assert_refused(text: impl AsRef<[u8]>, words: &[&str]) {
    let message = parse(text.as_ref()).unwrap_err().to_string();
    for word in words {
        assert!(message.contains(word), "{word} is not in: {message}");
    }
    assert!(!message.chars().any(char::is_control), "{message:?}");
}

#[test]
fn json_in_every_dress() {
    use CoordinateSystem::{Lps, Ras};
    assert_reads(json(), Lps);
    assert_reads(json().replace("LPS", "RAS"), Ras);
    assert_reads(json_of("", &points()), Lps);
    assert_reads(format!("\u{feff}{}", json().replace('\n', "\r\n")), Lps);
    for units in ["\"mm\"", "[\"mm\", \"UCUM\", \"millimeter\"]"] {
        assert_reads(
            json_of(&format!("\"coordinateUnits\": {units},"), &points()),
            Lps,
        );
    }
    // Another order, whole numbers' exponents, spaces around a label, and a second, empty, markup.
    let mut mixed = points();
    mixed.reverse();
    mixed[0] = mixed[0].replace("\"maxilla\"", "\" maxilla \"");
    mixed[5] = mixed[5].replace("1.5", "15e-1");
    assert_reads(
        json_of("", &mixed).replace("\"markups\": [", "\"markups\": [{},"),
        Lps,
    );
    // A list in two parts.
    let split = json_of("", &points()).replace(
        "},\n{ \"label\": \"tip\"",
        "}]}, {\"controlPoints\": [\n{ \"label\": \"tip\"",
    );
    assert!(split.matches("controlPoints").count() == 2);
    assert_reads(split, Lps);
}

#[test]
fn fcsv_in_every_dress() {
    use CoordinateSystem::{Lps, Ras};
    for (written, system) in [("LPS", Lps), ("1", Lps), ("RAS", Ras), ("0", Ras)] {
        assert_reads(fcsv(written), system);
    }
    let windows = format!("\u{feff}{}\r\n", fcsv("LPS").replace('\n', "\r\n"));
    assert_reads(windows, Lps);
    assert_reads(fcsv_of("# CoordinateSystem = LPS\n", ",2,0"), Lps);
    // Columns in another order, and none named.
    let named: Vec<String> = Landmark::ALL
        .iter()
        .zip(AT)
        .map(|(landmark, [x, y, z])| format!("{landmark},{z},{y},{x}\n"))
        .collect();
    let named = named.concat();
    assert_reads(
        format!("# CoordinateSystem = RAS\n# columns = label,z,y,x\n{named}"),
        Ras,
    );
    let unnamed = fcsv("LPS").replace("# columns", "# nothing");
    assert_reads(unnamed, Lps);
}

#[test]
fn lps_is_lps_and_ras_is_turned() {
    let tip = |text: &str| parse(text.as_bytes()).unwrap().lps().tip;
    assert_eq!(tip(&fcsv("1")), LpsPoint::new(0.5, -110.5, -44.25));
    assert_eq!(tip(&fcsv("0")), LpsPoint::new(-0.5, 110.5, -44.25));
}

#[test]
fn a_point_without_a_position_is_not_there() {
    for status in ["undefined", "preview", "missing"] {
        let rest = format!(", \"positionStatus\": \"{status}\"");
        let mut list = points();
        // A placeholder under its own name is no fault.
        list.push(point("F-7", "[0, 0, 0]", &rest));
        list.push(point("tip", "\"\"", &rest));
        assert_reads(json_of("", &list), CoordinateSystem::Lps);
        list.remove(4);
        assert_refused(
            json_of("", &list),
            &[&format!("has no `tip` (its position is {status})")],
        );
    }
    let mut list = points();
    list[4] = "{ \"label\": \"tip\" }".to_owned();
    assert_refused(
        json_of("", &list),
        &["has no `tip` (its position is not given)"],
    );
    list[4] = point(
        "tip",
        &format!("{:?}", AT[4]),
        ", \"positionStatus\": \"defined\"",
    );
    assert_reads(json_of("", &list), CoordinateSystem::Lps);
    let table = fcsv_of("# CoordinateSystem = LPS\n", ",2,0");
    let unset = table.replace("tip,\"a, b\",,2,0", "tip,\"a, b\",,0,0");
    assert_ne!(table, unset);
    assert_refused(unset, &["has no `tip` (its position is undefined)"]);
}

#[test]
fn everything_wrong_with_the_points_is_said_at_once() {
    let mut list = points();
    list[0] = list[0].replace("nasal_bones", "Nasal-Bone");
    list[1] = list[1].replace("lip", "F-2");
    list[2] = list[2].replace("-90.5", "\"left\"");
    list.push(list[4].clone());
    list.push(list[4].clone());
    list.push(point("", "[1, 2, 3]", ""));
    let expected = [
        "has no `nasal_bones` and no `lip`",
        "has more than one `tip`",
        "`Nasal-Bone` (did you mean `nasal_bones`?), `F-2`, a point without a label",
        "gives `alare_right` the position [-15.75,\"left\",-51.75]",
    ];
    assert_refused(json_of("", &list), &expected);
    let bad = |from: &str, to: &str| fcsv("LPS").replace(from, to);
    assert_refused(
        bad("0.5,-110.5,", "nan,-110.5,"),
        &["`tip` the position (nan, -110.5, -44.25)"],
    );
    assert_refused(bad("0.5,-110.5,", "1e999,-110.5,"), &["`tip`", "1e999"]);
    assert_refused(bad("0.5,-110.5,", ",-110.5,"), &["`tip`", "(, -110.5"]);
    assert_refused(
        bad(",tip,", ",tpi,"),
        &["has no `tip`", "`tpi` (did you mean `tip`?)"],
    );
    let many: Vec<String> = (0..100)
        .map(|n| point(&format!("\\n{n}"), "[0, 0, 0]", ""))
        .collect();
    assert_refused(json_of("", &many), &["has no `nasal_bones`", "and 90 more"]);
    let empty = "{\"markups\": []}";
    assert_refused(
        empty,
        &["has no `nasal_bones` and no `lip` and no `alare_right`"],
    );
}

#[test]
fn what_is_no_file_of_landmarks_is_refused() {
    assert_refused("", &["is empty"]);
    assert_refused("\u{feff} \r\n", &["is empty"]);
    assert_refused("x,y,z\n1,2,3\n", &["neither markups JSON", ".fcsv"]);
    assert_refused(b"{\"markups\": \"\xff\"}", &["UTF-8", "byte 13"]);
    assert_refused(
        "{\n  \"markups\": [\n",
        &["not markups JSON", "line 3 column 0"],
    );
    assert_refused("{}", &["missing field `markups`", "line 1 column 2"]);
    assert_refused(
        json().replace("\"tip\"", "7"),
        &["invalid type: integer `7`", "line 9 column"],
    );
    assert_refused(
        json().replace("-110.5", "1e999"),
        &["number out of range", "line 9 column"],
    );
    assert_refused(json().replace("-110.5", "NaN"), &["line 9 column"]);
    // A megabyte of text in the place of a list is not repeated.
    let long = format!("{{\"markups\": \"{}\"}}", "\\u001bx".repeat(100_000));
    let message = parse(long.as_bytes()).unwrap_err().to_string();
    assert!(message.len() < 300, "{} bytes", message.len());
    assert!(
        message.contains("…") && message.contains("expected a sequence"),
        "{message}"
    );
    assert!(message.contains("at line 1 column"), "{message}");
    assert_refused("{\"a\":".repeat(100_000), &["not markups JSON"]);
    assert_refused(
        json().replace("LPS", "lps"),
        &["`coordinateSystem` as `lps`", "`LPS` or `RAS`"],
    );
    for (units, shown) in [
        ("\"um\"", "`um`"),
        ("[\"cm\", \"UCUM\"]", "`cm`"),
        ("7", "`7`"),
    ] {
        let text = json_of(&format!("\"coordinateUnits\": {units},"), &points());
        assert_refused(text, &[shown, "expected `mm`"]);
    }
    let two = json().replace(
        "},\n{ \"label\": \"tip\"",
        "}]}, {\"coordinateSystem\": \"RAS\", \"controlPoints\": [\n{ \"label\": \"tip\"",
    );
    assert_refused(two, &["in LPS and in RAS"]);
}

#[test]
fn tables_that_are_not_fcsv_are_refused() {
    assert_refused(fcsv_of("", ""), &["no line `# CoordinateSystem"]);
    for system in ["2", "IJK", "lps", ""] {
        assert_refused(fcsv(system), &[&format!("as `{system}`")]);
    }
    assert_refused(
        fcsv("LPS").replace("label", "name"),
        &["`# columns` names no"],
    );
    assert_refused(
        fcsv("LPS") + "7,1,2\n",
        &["line 10", "3 values, too few for a point"],
    );
}

#[test]
fn files_that_are_none_do_not_block() {
    let folder = tempfile::tempdir().unwrap();
    let message = |path: &Path| read(path).unwrap_err().to_string();
    assert!(message(folder.path()).contains("is a folder, not a file"));
    assert!(message(&folder.path().join("none")).contains("cannot be read"));
    let large = folder.path().join("large");
    fs::write(&large, vec![b' '; MAX_LANDMARK_BYTES as usize + 1]).unwrap();
    assert!(message(&large).contains("larger than 1048576 bytes"));
    fs::write(&large, vec![b' '; MAX_LANDMARK_BYTES as usize]).unwrap();
    assert!(message(&large).contains("is empty"));
    #[cfg(unix)]
    {
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if made.is_ok_and(|status| status.success()) {
            assert!(message(&pipe).contains("is a pipe or a device"));
        }
        assert!(message(Path::new("/dev/zero")).contains("is a pipe or a device"));
    }
}
