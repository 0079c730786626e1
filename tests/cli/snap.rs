//! Landmarks that are off the skin: warned of, or moved onto it.

use std::fs;

use serde_json::Value;

use crate::head::{CANDIDATES, SPACING, nifti, plan, plan_head};
use crate::process::Desk;
use crate::real_data;

/// The tip of the small head's plans.
const TIP: &str = "tip = [32, 16, 22]";

/// A candidate that does little, wherever the tip is.
const MILD: &str =
    "[[candidate]]\nname = \"c\"\n[[candidate.stage]]\nname = \"s\"\nf1 = [{ deviate = 1 }]\n";

fn numbers(value: &Value) -> [f64; 3] {
    let of = |axis: usize| value[axis].as_f64().unwrap();
    [of(0), of(1), of(2)]
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let square = |axis: usize| (a[axis] - b[axis]) * (a[axis] - b[axis]);
    (square(0) + square(1) + square(2)).sqrt()
}

#[test]
fn a_point_far_from_the_skin_is_a_warning_with_its_distance() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("good.toml", plan("good", "ct.nii"));
    assert_eq!(desk.run(&["run", "good.toml"]).expect(0).err, "");
    // The nose ends at about y = 16.3 where z is 22.
    for (y, shown) in [(11, "7."), (10, "8.8")] {
        let text = plan_head("far", "ct.nii") + MILD;
        desk.write(
            "far.toml",
            text.replace(TIP, &format!("tip = [32, {y}, 22]")),
        );
        let ran = desk.run(&["run", "far.toml", "--json"]).expect(0);
        let document = ran.document();
        let warnings: Vec<&str> = document["warnings"]
            .as_array()
            .unwrap()
            .iter()
            .map(|warning| warning.as_str().unwrap())
            .collect();
        let about_tip = warnings.iter().find(|w| w.contains("landmark `tip`"));
        let about_tip = about_tip.unwrap_or_else(|| panic!("{warnings:?}"));
        assert!(
            about_tip.contains(&format!("`tip` is {shown}")),
            "{about_tip}"
        );
        assert!(about_tip.contains("mm from the skin; check"), "{about_tip}");
        assert!(
            !warnings.iter().any(|w| w.contains("`lip`")),
            "{warnings:?}"
        );
    }
}

/// Of a position that goes through a frame and back, in voxels and in mm.
const ROUNDING: f64 = 1e-9;

#[test]
fn points_are_moved_onto_the_skin_and_everything_follows() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    let snap = "[landmarks]\nsnap = { mm = 3 }";
    let off = plan("off", "ct.nii")
        .replace("[landmarks]", snap)
        .replace(TIP, "tip = [32.5, 15, 22.5]");
    desk.write("off.toml", &off);
    let ran = desk.run(&["run", "off.toml"]).expect(0);
    assert_eq!(ran.err, "");
    let record = desk.json("out/off/run.json");
    let snap = &record["plan"]["snap"];
    assert_eq!(snap["mm"], 3.0);
    let moved = snap["moved"].as_array().unwrap();
    let names: Vec<&str> = moved.iter().map(|m| m["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["lip", "alare_right", "alare_left", "tip"]);
    let mut given = off
        .replace("snap = { mm = 3 }\n", "")
        .replace("\"off\"", "\"given\"");
    for of in moved {
        let name = of["name"].as_str().unwrap();
        let (from, to) = (numbers(&of["from_voxel"]), numbers(&of["to_voxel"]));
        let mm = of["distance_mm"].as_f64().unwrap();
        assert!((distance(from, to) * SPACING - mm).abs() < ROUNDING, "{of}");
        assert!(mm <= 3.0, "{of}");
        let used = numbers(&record["plan"]["landmarks_voxel"][name]);
        assert!(distance(used, to) < ROUNDING, "{of}");
        let line = given
            .lines()
            .find(|line| line.starts_with(&format!("{name} =")))
            .unwrap();
        given = given.replace(line, &format!("{name} = {to:?}"));
    }
    let tip = moved.last().unwrap();
    assert!(distance(numbers(&tip["from_voxel"]), [32.5, 15.0, 22.5]) < ROUNDING);
    // The blunt end of the nose: behind the point, in front of the first tissue.
    let [_, y, _] = numbers(&tip["to_voxel"]);
    assert!((15.5..17.0).contains(&y), "{tip}");
    assert!(
        distance(
            numbers(&record["plan"]["f1_mm"]["tip"]),
            numbers(&tip["to_voxel"]).map(|v| v * SPACING)
        ) < ROUNDING
    );

    // A plan that gives the moved points measures the same.
    desk.write("given.toml", given);
    desk.run(&["run", "given.toml"]).expect(0);
    let rows = |name: &str| {
        let path = desk.path().join("out").join(name).join("measurements.csv");
        fs::read_to_string(path).unwrap()
    };
    let (off, given) = (rows("off"), rows("given"));
    assert_eq!(off.lines().count(), given.lines().count());
    for (a, b) in off.lines().zip(given.lines()).skip(1) {
        let number = |row: &str| row.split(',').nth(3).unwrap().parse::<f64>().unwrap();
        let (a_is, b_is) = (number(a), number(b));
        assert!(
            (a_is - b_is).abs() <= 1e-6 * a_is.abs().max(1.0),
            "{a}\n{b}"
        );
    }
    assert_eq!(desk.json("out/given/run.json")["plan"].get("snap"), None);
}

#[test]
fn points_further_than_the_limit_stay_and_are_warned_of() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    let text = plan("off", "ct.nii")
        .replace("[landmarks]", "[landmarks]\nsnap = { mm = 1 }")
        .replace(TIP, "tip = [32, 14, 22]");
    desk.write("off.toml", text);
    let ran = desk.run(&["run", "off.toml"]).expect(0);
    assert!(
        ran.err
            .contains("further than the 1 mm of `snap`, and is not moved"),
        "{ran:?}"
    );
    let record = desk.json("out/off/run.json");
    let moved = record["plan"]["snap"]["moved"].as_array().unwrap();
    assert!(moved.iter().all(|of| of["name"] != "tip"), "{moved:?}");
    assert_eq!(
        numbers(&record["plan"]["landmarks_voxel"]["tip"]),
        [32.0, 14.0, 22.0]
    );
}

/// A point that moving brings to where the plan has a fault: said, and nothing is written.
#[test]
fn a_plan_that_moving_breaks_is_refused() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    // The maxilla so far in front that only the unmoved tip is before it.
    let text = plan_head("broken", "ct.nii")
        .replace("[landmarks]", "[landmarks]\nsnap = { mm = 10 }")
        .replace(TIP, "tip = [32, 12, 22]")
        .replace("maxilla = [32, 32, 20]", "maxilla = [32, 14, 20]");
    desk.write("plan.toml", text + CANDIDATES);
    desk.run(&["check", "plan.toml"]).expect(2);
    let text = fs::read_to_string(desk.path().join("plan.toml")).unwrap();
    let (head, _) = text.split_once("[[candidate]]").unwrap();
    desk.write("plan.toml", format!("{head}{MILD}"));
    desk.run(&["check", "plan.toml"]).expect(0);
    let ran = desk.run(&["run", "plan.toml"]).expect(2);
    assert!(ran.err.contains("moved onto the skin"), "{ran:?}");
    assert!(ran.err.contains("`maxilla` is not behind `tip`"), "{ran:?}");
    assert!(!desk.path().join("out").exists());
}

/// Real landmarks were read by eye, to about a voxel: none is far from the skin.
#[test]
fn real_landmarks_are_near_the_skin() {
    for name in ["cranium", "headphantom"] {
        let [file, ct] =
            ["mrk.json", "nii.gz"].map(|end| real_data::path(&format!("{name}.{end}")));
        let (Some(file), Some(ct)) = (file, ct) else {
            continue;
        };
        let desk = Desk::new();
        let text = format!(
            "plan = 1\nname = \"real\"\n[ct]\npath = \"{}\"\n[landmarks]\nfile = \"{}\"\nsnap = {{ mm = 5 }}\n\
             [[candidate]]\nname = \"c\"\n[[candidate.stage]]\nname = \"s\"\nf1 = [{{ project = -1 }}]\n",
            ct.display(),
            file.display(),
        );
        desk.write("plan.toml", text);
        let ran = desk.run(&["run", "plan.toml"]).expect(0);
        assert_eq!(ran.err, "", "{name}");
        let record = desk.json("out/real/run.json");
        let moved = record["plan"]["snap"]["moved"].as_array().unwrap();
        assert_eq!(moved.len(), 4, "{name}: {moved:?}");
    }
}
