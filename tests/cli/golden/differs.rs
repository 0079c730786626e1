//! What a plan gives is not what is kept.

use super::{bless, blessed, differences, measures, verify, with_all, with_numbers};

/// The tip of candidate `both` moved by half a voxel more.
fn edited(plan: &str) -> String {
    assert!(plan.contains("[2, 0, 0]"));
    plan.replace("[2, 0, 0]", "[2.5, 0, 0]")
}

#[test]
fn a_changed_number_is_in_the_table_the_document_and_the_report() {
    let desk = blessed(&with_numbers("good"));
    desk.write("plan.toml", edited(&with_numbers("good")));
    let ran = verify(&desk, &[]).expect(5);
    let rows: Vec<Vec<&str>> = ran
        .out
        .lines()
        .map(|line| {
            line.split("  ")
                .map(str::trim)
                .filter(|cell| !cell.is_empty())
                .collect()
        })
        .collect();
    assert!(ran.out.starts_with("good: differs in "), "{ran:?}");
    assert!(
        ran.out
            .contains("(the golden has 119 numbers, 0 pictures, 0 volumes)"),
        "{ran:?}"
    );
    assert!(
        ran.out
            .contains("  the text of the plan is another: SHA-256 "),
        "{ran:?}"
    );
    let header = [
        "measure",
        "unit",
        "expected",
        "found",
        "difference",
        "tolerance",
    ];
    assert!(rows.contains(&header.to_vec()), "{rows:?}");
    let moved = ["both/move: tip_x", "voxel", "34", "34.5", "0.5", "3.4e-4"];
    assert!(rows.contains(&moved.to_vec()), "{rows:?}");
    assert!(
        ran.err.contains("the report is golden-report/report.md"),
        "{ran:?}"
    );
    let report = std::fs::read_to_string(desk.path().join("golden-report/report.md")).unwrap();
    let row = "| both/move: tip\\_x | voxel | 34 | 34.5 | 0.5 | 3.4e-4 |";
    assert!(report.contains(row), "{report}");
    // The terminal shows the first of them.
    let differing = differences(&desk);
    assert!(differing.len() > 20);
    let more = format!(
        "  … and {} more in golden-report/report.md\n",
        differing.len() - 20
    );
    assert!(ran.out.ends_with(&more), "{ran:?}");
    assert_eq!(ran.out.lines().count(), 1 + 1 + 1 + 20 + 1);
    let rows_of_report = report.lines().filter(|line| line.starts_with("| both/"));
    assert_eq!(rows_of_report.count(), differing.len());
    let row = differing
        .iter()
        .find(|row| row["measure"] == "both/move: tip_x")
        .unwrap();
    assert_eq!(row["kind"], "number");
    assert_eq!(
        (&row["unit"], &row["expected"]),
        (&"voxel".into(), &34.0.into())
    );
    assert_eq!(
        (&row["found"], &row["difference"]),
        (&34.5.into(), &0.5.into())
    );
    // Candidate `up` is as it was.
    assert!(
        differing
            .iter()
            .all(|row| !row["measure"].as_str().unwrap().starts_with("up/"))
    );
    let quiet = verify(&desk, &["--quiet"]).expect(5);
    assert_eq!((quiet.out, quiet.err.as_str()), (ran.out, ""));
}

#[test]
fn a_tolerance_holds_up_to_its_end() {
    let desk = blessed(&with_numbers("good"));
    desk.write("plan.toml", edited(&with_numbers("good")));
    let any = "{ absolute = 1e9 }";
    let tolerances = |voxel: &str| {
        let units = ["mm3", "mm2", "mm", "deg", "1"].map(|unit| format!("{unit} = {any}\n"));
        desk.write(
            "golden/golden.toml",
            format!("[numbers]\n{}voxel = {voxel}\n", units.concat()),
        );
    };
    tolerances("{ absolute = 0.5 }");
    verify(&desk, &[]).expect(0);
    tolerances("{ absolute = 0.49 }");
    let found = differences(&desk);
    let names: Vec<_> = measures(&found).into_iter().map(|(name, _)| name).collect();
    // The next stage begins where this one ends.
    assert_eq!(
        names,
        [
            "both/move: tip_x",
            "both/move: move_x",
            "both/reduce: tip_x"
        ]
    );
    assert_eq!(found[0]["tolerance"], 0.49);
    // 34 → 34.5 and 2 → 2.5.
    tolerances("{ relative = 0.25 }");
    verify(&desk, &[]).expect(0);
    tolerances("{ relative = 0.24 }");
    let found = differences(&desk);
    assert_eq!(measures(&found), [("both/move: move_x", &2.5.into())]);
    assert_eq!(found[0]["tolerance"], 0.48);
    // Back from 2.5 to 2, it is a fifth.
    bless(&desk).expect(0);
    desk.write("plan.toml", with_numbers("good"));
    tolerances("{ relative = 0.2 }");
    verify(&desk, &[]).expect(0);
    tolerances("{ relative = 0.19 }");
    assert_eq!(differences(&desk).len(), 1);
}

#[test]
fn pictures_that_differ_are_shown_beside_each_other() {
    let desk = blessed(&with_all("good"));
    desk.write(
        "golden/golden.toml",
        "[numbers]\nmm3 = { absolute = 1e9 }\n",
    );
    desk.write("plan.toml", edited(&with_all("good")));
    let found = differences(&desk);
    let view = "both/01-move/view-frontal.png";
    let row = found.iter().find(|row| row["measure"] == view).unwrap();
    assert_eq!(row["kind"], "picture");
    assert_eq!(row["unit"], "pixels off by more than 8 of 255");
    let off = row["found"].as_f64().unwrap();
    assert!(off > row["tolerance"].as_f64().unwrap(), "{row}");
    assert!(
        row["difference"].as_str().unwrap().starts_with("up to "),
        "{row}"
    );
    // The nose as it is and the other candidate are as they were, and so are their pictures.
    let of = |name: &str| found.iter().any(|row| row["measure"] == name);
    assert!(!of("preoperative/view-frontal.png") && !of("up/01-rotate/view-frontal.png"));
    let files = desk.files("golden-report");
    let picture = &files["good/both.01-move.view-frontal.png"];
    let picture = image::load_from_memory(picture).unwrap().to_rgb8();
    let kept = &desk.files("golden/good")[view];
    let kept = image::load_from_memory(kept).unwrap().to_rgb8();
    let (width, height) = kept.dimensions();
    assert!(width.max(height) <= 256);
    assert_eq!(picture.dimensions(), (3 * width + 8, height));
    let expected = image::imageops::crop_imm(&picture, 0, 0, width, height);
    assert_eq!(expected.to_image(), kept);
    let red = |place: u32| {
        let part = image::imageops::crop_imm(&picture, place * (width + 4), 0, width, height);
        let part = part.to_image();
        part.pixels()
            .filter(|pixel| pixel.0 == [255, 40, 40])
            .count()
    };
    assert_eq!([red(0), red(1), red(2)], [0, 0, off as usize]);
    let report = String::from_utf8(files["report.md"].clone()).unwrap();
    let shown = format!("![{view}](good/both.01-move.view-frontal.png)");
    assert!(report.contains(&shown), "{report}");
    // Anything goes.
    let lax = "[pictures]\nchannel = 255\n";
    desk.write("golden/golden.toml", lax);
    assert!(
        differences(&desk)
            .iter()
            .all(|row| row["kind"] != "picture")
    );
    assert!(
        !desk
            .files("golden-report")
            .keys()
            .any(|name| name.ends_with(".png"))
    );
}

#[test]
fn what_is_gone_and_what_is_new_is_a_difference() {
    let desk = blessed(&with_all("good"));
    let fewer = with_all("good")
        .replace("\"slices\", ", "")
        .replace("\"nrrd\", ", "")
        .replace("name = \"rotate\"", "name = \"turn\"");
    desk.write("plan.toml", &fewer);
    let gone = differences(&desk);
    let of = |rows: &[serde_json::Value], kind: &str, column: &str, said: &str| {
        let all = rows
            .iter()
            .filter(|row| row["kind"] == kind && row[column] == said);
        all.map(|row| row["measure"].as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    let volumes = of(&gone, "volume", "found", "not found");
    assert!(
        volumes.contains(&"both/01-move/volume.nrrd".to_owned()),
        "{volumes:?}"
    );
    assert!(
        volumes.contains(&"up/01-rotate/volume.nii.gz".to_owned()),
        "{volumes:?}"
    );
    assert_eq!(volumes.len(), 5);
    let new = of(&gone, "volume", "expected", "not expected");
    assert_eq!(
        new,
        ["up/01-turn/displacement.nii.gz", "up/01-turn/volume.nii.gz"]
    );
    assert!(
        of(&gone, "picture", "found", "not found")
            .contains(&"both/02-reduce/slice-axial.png".to_owned())
    );
    assert!(
        of(&gone, "picture", "expected", "not expected")
            .contains(&"up/01-turn/view-frontal.png".to_owned())
    );
    let numbers = of(&gone, "number", "found", "not found");
    assert_eq!(
        numbers.len(),
        of(&gone, "number", "expected", "not expected").len()
    );
    assert!(
        numbers.contains(&"up/rotate: gamma".to_owned()),
        "{numbers:?}"
    );
    // What is not there on one side is shown on the other.
    let report = desk.files("golden-report");
    for file in [
        "good/both.02-reduce.slice-axial.png",
        "good/up.01-turn.view-frontal.png",
    ] {
        assert!(image::load_from_memory(&report[file]).is_ok(), "{file}");
    }
    // And the other way round.
    bless(&desk).expect(0);
    verify(&desk, &[]).expect(0);
    desk.write("plan.toml", with_all("good"));
    let back = differences(&desk);
    assert_eq!(of(&back, "volume", "expected", "not expected"), volumes);
    assert_eq!(of(&back, "volume", "found", "not found"), new);
}
