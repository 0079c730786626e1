//! Finished runs compared by what they left of their candidates: skins, small pictures, profiles.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::head::{gzip, nifti, picture_plan, plan, plan_head};
use crate::process::{Desk, names};

const UP: &str = "[[candidate]]\nname = \"up\"\n\n[[candidate.stage]]\nname = \"rotate\"\nf1 = [{ rotate = 5 }]\n\n";
const DOWN: &str = "[[candidate]]\nname = \"down\"\n\n[[candidate.stage]]\nname = \"rotate\"\nf1 = [{ rotate = -4 }]\n\n";
const OUT: &str = "[[candidate]]\nname = \"out\"\n\n[[candidate.stage]]\nname = \"project\"\nf1 = [{ project = 3 }]\n\n";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("ct.nii.gz", gzip(&nifti()));
    desk
}

/// What a run writes that compares its candidates.
fn of_all(desk: &Desk, folder: &str) -> BTreeMap<String, Vec<u8>> {
    let mut files = desk.files(folder);
    let begins = ["compare.", "contact-sheet", "profile.", "volumes.", "sweep"];
    files.retain(|name, _| begins.iter().any(|begin| name.starts_with(begin)));
    files
}

fn compare(desk: &Desk, folders: &[&str]) -> (Value, Vec<String>) {
    let _ = fs::remove_dir_all(desk.path().join("compare"));
    let ran = desk
        .run(&[&["compare", "--json"], folders].concat())
        .expect(0);
    let warnings = ran.document()["warnings"].as_array().unwrap().clone();
    let warnings = warnings
        .iter()
        .map(|text| text.as_str().unwrap().to_owned());
    (desk.json("compare/compare.json"), warnings.collect())
}

/// The pairs of a comparison, without their numbers.
fn pairs(compared: &Value) -> Vec<[&str; 2]> {
    let pairs = compared["surface_differences"].as_array().unwrap().iter();
    let name =
        |pair: &'_ Value, place: usize| pair["candidates"][place].as_str().unwrap().to_owned();
    pairs
        .map(|pair| [0, 1].map(|place| &*name(pair, place).leak()))
        .collect()
}

fn pair<'a>(compared: &'a Value, candidates: [&str; 2]) -> &'a Value {
    let pairs = compared["surface_differences"].as_array().unwrap();
    let is_it = |pair: &&Value| pair["candidates"] == json!(candidates);
    pairs
        .iter()
        .find(is_it)
        .unwrap_or_else(|| panic!("{candidates:?}: {pairs:?}"))
}

fn numbers(pair: &Value) -> [f64; 4] {
    ["mean_mm", "p95_mm", "max_mm", "area_mm2"].map(|key| pair[key].as_f64().unwrap())
}

/// Every part has one candidate, which its run compares with none.
#[test]
fn parts_of_a_plan_that_draws_are_the_run_in_one_go() {
    let desk = desk();
    let three = picture_plan("good", "ct.nii.gz").replace("[outputs]", &format!("{DOWN}[outputs]"));
    desk.write("plan.toml", three);
    desk.run(&["run", "plan.toml"]).expect(0);
    let parts = ["out/good.1-of-3", "out/good.2-of-3", "out/good.3-of-3"];
    for part in ["1/3", "2/3", "3/3"] {
        desk.run(&["run", "plan.toml", "--shard", part]).expect(0);
    }
    let before = desk.everything("out");
    let (compared, warnings) = compare(&desk, &[parts[2], parts[0], parts[1]]);
    assert_eq!(warnings, [""; 0]);
    let whole = of_all(&desk, "out/good");
    let expected = [
        "compare.csv",
        "compare.json",
        "compare.md",
        "contact-sheet.png",
        "profile.png",
        "profile.svg",
        "volumes.png",
        "volumes.svg",
    ];
    assert_eq!(names(&whole), expected);
    assert_eq!(
        pairs(&compared),
        [["both", "up"], ["both", "down"], ["up", "down"]]
    );
    let joined = desk.files("compare");
    assert_eq!(names(&joined), expected);
    for (name, bytes) in &joined {
        assert!(*bytes == whole[name], "{name} is not that of the whole run");
    }
    // A run alone is what it wrote itself, and a part that was kept is what it was.
    compare(&desk, &["out/good"]);
    assert!(desk.files("compare") == whole);
    desk.run(&["run", "plan.toml", "--shard", "2/3"]).expect(0);
    compare(&desk, &parts);
    assert!(desk.files("compare") == whole);
    let mut after = desk.everything("out");
    for part in parts {
        // What is never the same twice.
        let name = format!("{}/timings.json", part.trim_start_matches("out/"));
        after.insert(name.clone(), before[&name].clone());
    }
    assert!(after == before, "runs are left alone");

    // Two of three parts.
    let (compared, warnings) = compare(&desk, &parts[..2]);
    assert!(
        warnings.len() == 1 && warnings[0].contains("part 3 of 3"),
        "{warnings:?}"
    );
    assert_eq!(pairs(&compared), [["both", "up"]]);
    assert!(desk.path().join("compare/contact-sheet.png").exists());
}

#[test]
fn skins_across_runs_are_as_far_apart_as_those_of_one_plan() {
    let desk = desk();
    desk.write("good.toml", plan("good", "ct.nii.gz"));
    desk.write("again.toml", plan("again", "ct.nii.gz"));
    desk.write("less.toml", plan_head("less", "ct.nii.gz") + UP + DOWN);
    let all = plan("all", "ct.nii.gz").replace("[outputs]", &format!("{DOWN}[outputs]"));
    desk.write("all.toml", all);
    desk.run(&["run", "good.toml", "again.toml", "less.toml", "all.toml"])
        .expect(0);
    let (compared, warnings) = compare(&desk, &["out/good", "out/again"]);
    assert_eq!(warnings, [""; 0]);
    assert_eq!(
        pairs(&compared),
        [
            ["good/both", "good/up"],
            ["good/both", "again/both"],
            ["good/both", "again/up"],
            ["good/up", "again/both"],
            ["good/up", "again/up"],
            ["again/both", "again/up"],
        ]
    );
    let of_one = numbers(pair(&compared, ["good/both", "good/up"]));
    assert!(of_one[0] > 0.5, "{of_one:?}");
    assert_eq!(numbers(pair(&compared, ["good/both", "again/up"])), of_one);
    let twins = numbers(pair(&compared, ["good/up", "again/up"]));
    assert_eq!(twins[..3], [0.0; 3]);
    assert!(twins[3] > 100.0, "what moved alike is compared: {twins:?}");

    // The box around the noses of one plan is not that of the other: what both have is compared.
    let (compared, warnings) = compare(&desk, &["out/good", "out/less"]);
    assert_eq!(warnings, [""; 0]);
    let whole = desk.json("out/all/compare.json");
    for [one, other] in [["both", "down"], ["up", "down"]] {
        let names = [format!("good/{one}"), format!("less/{other}")];
        let found = numbers(pair(&compared, names.each_ref().map(String::as_str)));
        let expected = numbers(pair(&whole, [one, other]));
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
        }
    }
}

#[test]
fn what_keeps_runs_from_being_compared_is_told() {
    let desk = desk();
    desk.write("good.toml", picture_plan("good", "ct.nii.gz"));
    let mut other = nifti();
    // One voxel of air, a little denser.
    other[352] = other[352].wrapping_add(1);
    desk.write("other.nii", other);
    desk.write("more.toml", picture_plan("more", "other.nii"));
    let views = picture_plan("views", "ct.nii.gz");
    let views = views.replace("size = 256", "size = 300") + "\n[enhance]\nsmooth = { mm = 0.5 }\n";
    desk.write("views.toml", views.replace("skin = 0.5", "skin = 0.4"));
    desk.write("single.toml", plan_head("single", "ct.nii.gz") + UP);
    desk.write(
        "skin.toml",
        plan("skin", "ct.nii.gz") + "\n[segment]\nskin_hu = -400\n",
    );
    for name in ["good", "more", "views", "single", "skin"] {
        desk.run(&["run", &format!("{name}.toml")]).expect(0);
    }
    let (compared, warnings) = compare(&desk, &["out/good", "out/more"]);
    assert_eq!(
        warnings,
        [
            "the voxels of the CT of `more` differ from those of `good`",
            "there are no distances between the skins of `more` and those of `good`: the voxels of the CT differ",
            "there is no contact sheet: `good` and `more` were drawn differently (the CT)",
            "there is no profile: the voxels of the CT of `more` are not those of `good`",
        ]
    );
    assert_eq!(
        pairs(&compared),
        [["good/both", "good/up"], ["more/both", "more/up"]]
    );
    let page = fs::read_to_string(desk.path().join("compare/compare.md")).unwrap();
    for warning in &warnings {
        assert!(page.contains(warning.as_str()), "{page}");
    }
    // The regions have the same volumes, and one start.
    let files = desk.files("compare");
    assert_eq!(
        names(&files),
        [
            "compare.csv",
            "compare.json",
            "compare.md",
            "volumes.png",
            "volumes.svg"
        ]
    );
    let chart = String::from_utf8(files["volumes.svg"].clone()).unwrap();
    assert!(chart.contains("preoperative") && chart.contains("more/up"));

    let (_, warnings) = compare(&desk, &["out/good", "out/views"]);
    assert_eq!(
        warnings,
        [
            "there is no contact sheet: `good` and `views` were drawn differently ([enhance] and [views])"
        ]
    );
    assert!(desk.path().join("compare/profile.svg").exists());

    let (compared, warnings) = compare(&desk, &["out/good", "out/single"]);
    assert_eq!(pairs(&compared), [["good/both", "good/up"]]);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(
        warnings[0].starts_with(
            "the distances between skins, the contact sheet and the profile are without `single"
        ),
        "{warnings:?}"
    );
    assert!(
        warnings[0].contains("a single candidate keeps neither skin"),
        "{warnings:?}"
    );

    let (compared, warnings) = compare(&desk, &["out/good", "out/skin"]);
    assert_eq!(
        pairs(&compared),
        [["good/both", "good/up"], ["skin/both", "skin/up"]]
    );
    let warning = "there are no distances between the skins of `skin` and those of `good`: the skin thresholds differ";
    assert!(
        warnings.iter().any(|found| found == warning),
        "{warnings:?}"
    );
}

#[test]
fn more_candidates_than_are_compared_are_told_of() {
    let desk = desk();
    desk.write("good.toml", plan("good", "ct.nii.gz"));
    let values: Vec<String> = (0..33)
        .map(|n| format!("{}", f64::from(n) / 10.0))
        .collect();
    let sweep = format!(
        "[[sweep]]\ncandidate = \"up\"\n\n[[sweep.vary]]\nstage = \"rotate\"\nedit = \"rotate\"\nvalues = [{}]\n",
        values.join(", ")
    );
    desk.write("many.toml", plan_head("many", "ct.nii.gz") + UP + &sweep);
    desk.run(&["run", "good.toml", "many.toml"]).expect(0);
    let (compared, warnings) = compare(&desk, &["out/good", "out/many"]);
    assert_eq!(pairs(&compared), [["good/both", "good/up"]]);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(
        warnings[0].starts_with("distances between skins are those within each run"),
        "{warnings:?}"
    );

    desk.run(&["run", "many.toml", "--shard", "1/9"]).expect(0);
    let (compared, warnings) = compare(&desk, &["out/many.1-of-9", "out/good"]);
    assert_eq!(pairs(&compared), [["good/both", "good/up"]]);
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert!(
        warnings[1].contains("of a plan with more than 32 candidates keeps no skins"),
        "{warnings:?}"
    );
    assert!(
        warnings[1].contains(" and 1 more: "),
        "three are named: {warnings:?}"
    );

    // Parts of it are as the whole, which compares none.
    for part in 2..=9 {
        desk.run(&["run", "many.toml", "--shard", &format!("{part}/9")])
            .expect(0);
    }
    let parts: Vec<String> = (1..=9)
        .map(|part| format!("out/many.{part}-of-9"))
        .collect();
    let (_, warnings) = compare(&desk, &parts.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(warnings, [""; 0]);
    assert!(desk.files("compare") == of_all(&desk, "out/many"));
}

/// Noses of one run reach further: its cameras stand elsewhere.
#[test]
fn runs_in_frames_of_their_own_begin_with_their_own_nose() {
    let desk = desk();
    desk.write("good.toml", picture_plan("good", "ct.nii.gz"));
    desk.write("again.toml", picture_plan("again", "ct.nii.gz"));
    let far =
        picture_plan("far", "ct.nii.gz").replace("[outputs]", &format!("{OUT}{DOWN}[outputs]"));
    desk.write("far.toml", far + "\n");
    desk.run(&["run", "good.toml", "again.toml", "far.toml"])
        .expect(0);
    let size = |folders: &[&str]| {
        let (_, warnings) = compare(&desk, folders);
        let sheet = image::open(desk.path().join("compare/contact-sheet.png")).unwrap();
        (sheet.height(), warnings)
    };
    // A title and names, and rows of 260 pixels: one nose as it is for both.
    assert_eq!(size(&["out/good", "out/again"]), (60 + 5 * 260, Vec::new()));
    let (height, warnings) = size(&["out/good", "out/far"]);
    assert_eq!(height, 60 + (3 + 5) * 260);
    assert_eq!(
        warnings,
        [
            "on the contact sheet `far` is not framed as `good` is, because its noses or landmarks lie elsewhere; each frame begins with the nose as it is"
        ]
    );
}

/// A note with another text, sealed again: whoever can write it can forge it.
fn reseal(path: &Path, change: impl Fn(&mut Value)) {
    let bytes = fs::read(path).unwrap();
    let mut note: Value = serde_json::from_slice(&bytes[65..]).unwrap();
    change(&mut note);
    let text = serde_json::to_vec(&note).unwrap();
    let seal = blake3::hash(&text).to_hex();
    fs::write(path, [seal.as_bytes(), b"\n", &text].concat()).unwrap();
}

#[test]
fn what_is_missing_altered_or_forged_is_left_out_with_one_warning() {
    let desk = desk();
    desk.write("plan.toml", picture_plan("good", "ct.nii.gz"));
    for part in ["1/2", "2/2"] {
        desk.run(&["run", "plan.toml", "--shard", part]).expect(0);
    }
    let parts = ["out/good.1-of-2", "out/good.2-of-2"];
    let (compared, _) = compare(&desk, &parts);
    let sound = desk.files("compare");
    let kept = desk.path().join(parts[0]).join(".rhinoplan.kept");
    let away = desk.path().join("away");
    let other = desk.path().join(parts[1]).join(".rhinoplan.kept/up");
    let [note, skin, tiles] =
        ["json", "skin", "png"].map(|ending| kept.join(format!("both/02-reduce.{ending}")));
    let bytes = [&note, &skin, &tiles].map(|path| fs::read(path).unwrap());
    let digest = |path: &Path| rhinoplan::io::digest::sha256_hex(&fs::read(path).unwrap());
    let named = |note: &mut Value, ending: &str, sha256: String| {
        for file in note["beside"].as_array_mut().unwrap() {
            if file[0] == ending {
                file[1] = json!(sha256);
            }
        }
    };
    let damaged = "is missing or damaged";
    let altered = "is missing or was altered";
    let elsewhere = "is not of the `run.json`";
    type Spoil<'a> = Box<dyn Fn() + 'a>;
    let mut cases: Vec<(&str, Spoil<'_>, &str, [bool; 3])> = vec![
        (
            "no notes",
            Box::new(|| fs::rename(&kept, &away).unwrap()),
            damaged,
            [false; 3],
        ),
        (
            "no note",
            Box::new(|| fs::remove_file(&note).unwrap()),
            damaged,
            [false; 3],
        ),
        (
            "a torn note",
            Box::new(|| fs::write(&note, &bytes[0][..500]).unwrap()),
            damaged,
            [false; 3],
        ),
        (
            "a note that is huge",
            Box::new(|| {
                fs::File::options()
                    .write(true)
                    .open(&note)
                    .unwrap()
                    .set_len(1 << 30)
                    .unwrap()
            }),
            damaged,
            [false; 3],
        ),
        (
            "another version",
            Box::new(|| {
                reseal(&note, |note| {
                    note["key"]["the program's version"] = json!("0".repeat(64))
                })
            }),
            "is of another version",
            [false; 3],
        ),
        (
            "another CT",
            Box::new(|| reseal(&note, |note| note["key"]["the CT"] = json!("0".repeat(64)))),
            elsewhere,
            [false; 3],
        ),
        (
            "another result",
            Box::new(|| {
                reseal(&note, |note| {
                    note["found"]["measures"]["height_mm"] = json!(1.0)
                })
            }),
            elsewhere,
            [false; 3],
        ),
        (
            "another candidate",
            Box::new(|| fs::write(&note, fs::read(other.join("01-rotate.json")).unwrap()).unwrap()),
            elsewhere,
            [false; 3],
        ),
        (
            "a profile that is nowhere",
            Box::new(|| reseal(&note, |note| note["found"]["profile"][0][1] = json!(1e300))),
            damaged,
            [false; 3],
        ),
        (
            "no skin",
            Box::new(|| fs::remove_file(&skin).unwrap()),
            altered,
            [false, true, true],
        ),
        (
            "another skin",
            Box::new(|| fs::write(&skin, fs::read(other.join("01-rotate.skin")).unwrap()).unwrap()),
            altered,
            [false, true, true],
        ),
        (
            "a forged skin",
            Box::new(|| {
                let mut forged = bytes[1].clone();
                // The region: beyond the grid.
                forged[32..36].copy_from_slice(&u32::MAX.to_le_bytes());
                fs::write(&skin, forged).unwrap();
                reseal(&note, |note| named(note, "skin", digest(&skin)));
            }),
            altered,
            [false, true, true],
        ),
        (
            "torn pictures",
            Box::new(|| fs::write(&tiles, &bytes[2][..999]).unwrap()),
            altered,
            [true, false, true],
        ),
        (
            "forged pictures",
            Box::new(|| {
                image::RgbImage::new(99, 7).save(&tiles).unwrap();
                reseal(&note, |note| named(note, "png", digest(&tiles)));
            }),
            altered,
            [true, false, true],
        ),
        (
            "no profile",
            Box::new(|| reseal(&note, |note| note["found"]["profile"] = Value::Null)),
            damaged,
            [true, true, false],
        ),
    ];
    #[cfg(unix)]
    cases.extend([
        (
            "a link",
            Box::new(|| {
                fs::rename(&kept, &away).unwrap();
                std::os::unix::fs::symlink(&away, &kept).unwrap();
            }) as Spoil<'_>,
            damaged,
            [false; 3],
        ),
        (
            "a pipe",
            Box::new(|| {
                fs::remove_file(&note).unwrap();
                let made = std::process::Command::new("mkfifo").arg(&note).status();
                assert!(made.unwrap().success());
            }),
            damaged,
            [false; 3],
        ),
    ]);
    for (what, spoil, message, [has_pair, on_sheet, in_profile]) in cases {
        spoil();
        let (found, warnings) = compare(&desk, &parts);
        assert_eq!(warnings.len(), 1, "{what}: {warnings:?}");
        assert!(
            warnings[0].contains(message) && warnings[0].contains("`both`"),
            "{what}: {warnings:?}"
        );
        assert_eq!(found["candidates"], compared["candidates"], "{what}");
        assert_eq!(pairs(&found).len(), usize::from(has_pair), "{what}");
        let files = desk.files("compare");
        let is_sound = |name: &str| files.get(name) == sound.get(name);
        assert_eq!(is_sound("contact-sheet.png"), on_sheet, "{what}");
        assert_eq!(is_sound("profile.svg"), in_profile, "{what}");
        assert!(is_sound("volumes.svg"), "{what}");
        // The next case begins with what was there.
        if away.exists() {
            let _ = fs::remove_file(&kept);
            fs::rename(&away, &kept).unwrap();
        }
        for (path, bytes) in [&note, &skin, &tiles].into_iter().zip(&bytes) {
            let _ = fs::remove_file(path);
            fs::write(path, bytes).unwrap();
        }
    }
    compare(&desk, &parts);
    assert!(desk.files("compare") == sound);
}
