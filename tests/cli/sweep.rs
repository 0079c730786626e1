//! Swept candidates: their tables and plots, in one run and in parts of one.

use std::collections::BTreeMap;
use std::fs;

use serde_json::{Value, json};

use crate::head::{FAILS_LATE, gzip, nifti, plan_head};
use crate::process::{Desk, names};

const BASE: &str = "\
[[candidate]]
name = \"up\"

[[candidate.stage]]
name = \"refine\"
f1 = [{ rotate = 5 }, { project = 0 }]

";

const SWEEP: &str = "\
[[sweep]]
candidate = \"up\"

[[sweep.vary]]
stage = \"refine\"
edit = \"project\"
values = [0, -2]

[[sweep.vary]]
stage = \"refine\"
edit = \"rotate\"
values = [4, 0, 2]

";

const CHARTS: &str = "[outputs]\nwrite = [\"charts\"]\n";

fn desk(candidates: &str) -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii.gz", gzip(&nifti()));
    desk.write("plan.toml", swept(candidates));
    desk
}

fn swept(candidates: &str) -> String {
    plan_head("swept", "ct.nii.gz") + BASE + candidates
}

fn text(desk: &Desk, name: &str) -> String {
    fs::read_to_string(desk.path().join(name)).unwrap()
}

fn rows(desk: &Desk, name: &str) -> Vec<BTreeMap<String, String>> {
    let mut table = csv::Reader::from_path(desk.path().join(name)).unwrap();
    table.deserialize().map(Result::unwrap).collect()
}

/// The files of sweeps in a folder, not below it.
fn of_sweeps(desk: &Desk, folder: &str) -> BTreeMap<String, Vec<u8>> {
    let mut files = desk.files(folder);
    files.retain(|name, _| name.starts_with("sweep"));
    files
}

#[test]
fn a_sweep_has_a_table_and_a_plot() {
    let desk = desk(&[SWEEP, CHARTS].concat());
    desk.run(&["run", "plan.toml"]).expect(0);
    let files = of_sweeps(&desk, "out/swept");
    assert_eq!(names(&files), ["sweep.csv", "sweep.png", "sweep.svg"]);
    let record = desk.json("out/swept/run.json");
    let candidates = record["candidates"].as_array().unwrap();
    let rows = rows(&desk, "out/swept/sweep.csv");
    assert_eq!((rows.len(), candidates.len()), (7, 7));
    assert_eq!(rows[0]["refine rotate (deg)"], "", "given, not swept");
    for (row, candidate) in rows.iter().zip(candidates) {
        assert_eq!(row["candidate"], candidate["name"].as_str().unwrap());
        for swept in candidate["swept"].as_array().into_iter().flatten() {
            let [edit, unit] = ["edit", "unit"].map(|key| swept[key].as_str().unwrap());
            let number = row[&format!("refine {edit} ({unit})")].parse::<f64>();
            assert_eq!(number.unwrap(), swept["value"].as_f64().unwrap());
        }
        let last = &candidate["stages"][1]["measures"];
        for (column, key) in [
            ("gamma (deg)", "gamma_deg"),
            ("height (mm)", "height_mm"),
            ("volume_total (mm3)", "volume_total_mm3"),
        ] {
            let number = row[column].parse::<f64>().unwrap();
            assert_eq!(number, last[key].as_f64().unwrap(), "{column}");
        }
        assert!(row["volume_K (mm3)"].parse::<f64>().is_ok());
    }
    // Turned by nothing and 2 mm lower: the tip moved by as much.
    let lower = &rows[5];
    assert_eq!(
        [&lower["refine rotate (deg)"], &lower["refine project (mm)"]],
        ["0", "-2"]
    );
    let moved = lower["tip_move (mm)"].parse::<f64>().unwrap();
    assert!((moved - 2.0).abs() < 1e-9, "{moved}");

    let compared = desk.json("out/swept/compare.json");
    let sweep = &compared["sweeps"][0];
    assert_eq!([&sweep["run"], &sweep["name"]], ["swept", "up"]);
    assert_eq!(
        sweep["numbers"][1],
        json!({"stage": "refine", "edit": "rotate", "unit": "deg"})
    );
    assert_eq!(sweep["candidates"][4]["values"], json!([-2.0, 0.0]));
    assert!(compared["candidates"][0].get("swept").is_none());
    let page = text(&desk, "out/swept/compare.md");
    let line = "| | `refine` project (mm) | `refine` rotate (°) | γ (°) | h (mm) | volume A–K (mm³) | tip moved (mm) |";
    assert!(page.lines().any(|found| found == line), "{page}");
    assert!(
        page.contains("| `up-project-m2-rotate-0` | -2 | 0 |"),
        "{page}"
    );

    // Along the axis is the number with more values; the other makes the lines.
    let svg = text(&desk, "out/swept/sweep.svg");
    for shown in ["refine: rotate (°)", ">project 0 mm<", ">project −2 mm<"] {
        assert!(svg.contains(shown), "{shown}");
    }
    assert!(!svg.contains("allowed"));
    let circles = svg.matches("<circle").count();
    assert_eq!(
        circles,
        4 * 6 + 2,
        "a point for each candidate in each chart, and two in the legend"
    );

    // With limits it is drawn again, though nothing else is computed.
    let limits = "[accept]\nvolume_total = { change_percent = [-50, 0] }\n";
    desk.write("plan.toml", swept(&[SWEEP, CHARTS, limits].concat()));
    let ran = desk.run(&["run", "plan.toml", "--json"]).expect(0);
    let document = ran.document();
    let outcomes = document["runs"][0]["candidates"].as_array().unwrap();
    assert_eq!(outcomes.len(), 7);
    assert!(outcomes.iter().all(|of| of["computed"] == 0), "{document}");
    let svg = text(&desk, "out/swept/sweep.svg");
    assert!(svg.contains("allowed: change −50 to 0 %"), "{svg}");
    assert!(text(&desk, "out/swept/sweep.csv").contains(",yes,"));
    // The same bytes, computed anew.
    let before = desk.results("out/swept");
    desk.run(&[
        "run",
        "plan.toml",
        "--force",
        "--threads",
        "1",
        "--out",
        "again",
    ])
    .expect(0);
    assert!(before == desk.results("again/swept"));
}

#[test]
fn several_sweeps_have_a_plot_each_and_without_charts_there_is_none() {
    let second = "[[sweep]]\ncandidate = \"up\"\nname = \"wide\"\n\n[[sweep.vary]]\nstage = \"refine\"\n\
                  edit = \"rotate\"\nfrom = 6\nto = 8\nsteps = 2\n\n";
    let desk = desk(&[SWEEP, second, CHARTS].concat());
    desk.run(&["run", "plan.toml"]).expect(0);
    assert_eq!(
        names(&of_sweeps(&desk, "out/swept")),
        [
            "sweep-up.png",
            "sweep-up.svg",
            "sweep-wide.png",
            "sweep-wide.svg",
            "sweep.csv"
        ]
    );
    desk.write("plan.toml", swept(SWEEP));
    desk.run(&["run", "plan.toml"]).expect(0);
    assert_eq!(names(&of_sweeps(&desk, "out/swept")), ["sweep.csv"]);
    desk.write("plan.toml", swept(""));
    desk.run(&["run", "plan.toml"]).expect(0);
    assert!(of_sweeps(&desk, "out/swept").is_empty());
}

#[test]
fn joined_parts_are_what_one_run_is() {
    let desk = desk(&[SWEEP, CHARTS].concat());
    desk.run(&["run", "plan.toml"]).expect(0);
    for part in ["1/3", "2/3", "3/3"] {
        desk.run(&["run", "plan.toml", "--out", "parts", "--shard", part])
            .expect(0);
    }
    let [one, two, three] = [
        "parts/swept.1-of-3",
        "parts/swept.2-of-3",
        "parts/swept.3-of-3",
    ];
    // In any order.
    let ran = desk
        .run(&["compare", three, one, two, "--out", "joined", "--json"])
        .expect(0);
    assert_eq!(ran.document()["warnings"], json!([]));
    // Seven candidates in parts of three, two and two.
    let compared = desk.json("joined/compare.json");
    assert_eq!(compared["candidates"].as_array().unwrap().len(), 7);
    assert_eq!(
        compared["surface_differences"].as_array().unwrap().len(),
        21
    );
    let whole = desk.files("out/swept");
    let joined = desk.files("joined");
    let expected = [
        "compare.csv",
        "compare.json",
        "compare.md",
        "profile.png",
        "profile.svg",
        "sweep.csv",
        "sweep.png",
        "sweep.svg",
        "volumes.png",
        "volumes.svg",
    ];
    assert_eq!(names(&joined), expected);
    for (name, bytes) in joined {
        assert!(bytes == whole[&name], "{name} is not that of the whole run");
    }

    let ran = desk.run(&["compare", three, one]).expect(0);
    let warning = "part 2 of 3 of `swept` is missing: 2 of its 7 candidates are not here";
    assert!(ran.err.contains(warning), "{}", ran.err);
    assert!(text(&desk, "compare/compare.md").contains(warning));
    let ran = desk.run(&["compare", one, "out/swept"]).expect(0);
    let warning = "parts 2 and 3 of 3 of `swept` are missing: 4 of its 7 candidates are not here";
    assert!(ran.err.contains(warning), "{}", ran.err);

    // A folder that an earlier comparison wrote into keeps what this one does not have.
    let plain = BASE
        .replace("\"up\"", "\"down\"")
        .replace("rotate = 5", "rotate = 3");
    desk.write(
        "plain.toml",
        plan_head("plain", "ct.nii.gz") + BASE + &plain,
    );
    desk.run(&["run", "plain.toml"]).expect(0);
    let ran = desk
        .run(&["compare", "out/plain", "--out", "joined"])
        .expect(0);
    assert!(
        ran.err.contains("sweep.csv` is not of this comparison"),
        "{}",
        ran.err
    );

    // What does not belong together.
    let record = desk.json(&format!("{two}/run.json"));
    type Spoil = fn(&mut Value);
    let cases: [(Spoil, i32, &str); 9] = [
        (|_| {}, 2, "part 2 of 3 is given twice"),
        (
            |run| run["part"]["of"] = json!(4),
            2,
            "one is a part of 3, another of 4",
        ),
        (
            |run| {
                run["part"]["number"] = json!(3);
            },
            2,
            "in different ways",
        ),
        (
            |run| run["part"]["candidates"] = json!(1_000_000_000_000_u64),
            3,
            "which part of the plan it is",
        ),
        (
            |run| run["part"]["places"] = json!({}),
            3,
            "which part of the plan it is",
        ),
        (
            |run| run["candidates"][0]["swept"][0]["unit"] = json!("<b>"),
            3,
            "unknown variant",
        ),
        (
            |run| run["candidates"][0]["swept"][0]["edit"] = json!("a | b"),
            3,
            "a swept edit's name",
        ),
        (
            |run| run["candidates"][0]["sweep"] = json!("../up"),
            3,
            "a sweep's name",
        ),
        (
            |run| run["failed"] = json!([{"candidate": "a b", "error": ""}]),
            3,
            "a failed candidate's name",
        ),
    ];
    for (spoil, code, message) in cases {
        let mut run = record.clone();
        spoil(&mut run);
        desk.write("bad/run.json", run.to_string());
        let ran = desk
            .run(&["compare", "bad", two, one, "--out", "nowhere"])
            .expect(code);
        assert!(ran.err.contains(message), "{message}: {}", ran.err);
    }
    assert!(!desk.path().join("nowhere").exists());
    // Another plan file is another run.
    let mut other = record.clone();
    other["inputs"]["plan_sha256"] = json!("0");
    desk.write("bad/run.json", other.to_string());
    desk.run(&["compare", "bad", one, three, "--out", "mixed"])
        .expect(0);
    let compared = desk.json("mixed/compare.json");
    assert_eq!(compared["runs"].as_array().unwrap().len(), 2);
    assert_eq!(compared["runs"][1]["name"], "swept#2");
}

#[test]
fn what_failed_is_listed_with_its_reason() {
    let desk = desk(&[FAILS_LATE, SWEEP].concat());
    let ran = desk.run(&["run", "plan.toml"]);
    assert_ne!(ran.code, 0);
    let page = text(&desk, "out/swept/compare.md");
    let row = page
        .lines()
        .find(|line| line.starts_with("| `impossible` |"));
    assert!(row.is_some_and(|row| row.len() > 40), "{page}");
    let failed = &desk.json("out/swept/run.json")["failed"];
    assert_eq!(failed[0]["candidate"], "impossible");
    assert_eq!(&desk.json("out/swept/compare.json")["failed"], failed);
    // Read back it is the same page.
    desk.run(&["compare", "out/swept", "--out", "alone"])
        .expect(0);
    assert!(page == text(&desk, "alone/compare.md"));
    for part in ["1/2", "2/2"] {
        desk.run(&["run", "plan.toml", "--out", "parts", "--shard", part]);
    }
    let parts = ["parts/swept.1-of-2", "parts/swept.2-of-2"];
    let ran = desk.run(&["compare", parts[0], parts[1]]).expect(0);
    assert!(
        !ran.err.contains("missing"),
        "what failed is not missing: {}",
        ran.err
    );
    assert_eq!(&desk.json("compare/compare.json")["failed"], failed);
}
