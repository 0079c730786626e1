//! Input that is no patient's nose: a clear message, and never a number that looks like a result.

use std::io::Read;

use flate2::read::GzDecoder;
use serde_json::Value;

use crate::head::{
    CANDIDATES, DIMS, SPACING, constant, nifti, plan, plan_head, put_f32s, put_i16s, put_sform,
    tissue,
};
use crate::process::Desk;
use crate::real_data;

/// A candidate that does little, wherever the tip is.
const MILD: &str =
    "[[candidate]]\nname = \"c\"\n[[candidate.stage]]\nname = \"s\"\nf1 = [{ deviate = 1 }]\n";

const OTSU: &str = "[segment]\nskin_hu = \"otsu\"\n";

/// A run that ends for its CT, says why, and leaves nothing.
#[track_caller]
fn assert_no_result(desk: &Desk, plan: &str, message: &str) {
    desk.write("plan.toml", plan);
    desk.run(&["check", "plan.toml"]).expect(0);
    let ran = desk.run(&["run", "plan.toml"]).expect(3);
    assert!(ran.err.contains(message), "{message}: {}", ran.err);
    assert_eq!(ran.out, "");
    assert!(!desk.path().join("out").exists(), "{message}");
    let document = desk
        .run(&["run", "plan.toml", "--json"])
        .expect(3)
        .document();
    let error = document["errors"][0]["message"].as_str().unwrap();
    assert!(error.contains(message), "{error}");
    assert_eq!(document.get("runs"), None, "{document}");
}

/// A plan that `check` refuses: the faults' codes and messages, as scripts read them, and what people do.
#[track_caller]
fn refused(desk: &Desk, plan: &str) -> (Vec<(String, String)>, String) {
    desk.write("plan.toml", plan);
    let ran = desk.run(&["check", "plan.toml", "--json"]).expect(2);
    let document = ran.document();
    let text = |error: &Value, key: &str| error[key].as_str().unwrap().to_owned();
    let faults = document["errors"].as_array().unwrap();
    let faults: Vec<_> = faults
        .iter()
        .map(|fault| {
            assert!(fault["line"].as_u64().unwrap() > 1, "{fault}");
            (text(fault, "code"), text(fault, "message"))
        })
        .collect();
    desk.run(&["run", "plan.toml"]).expect(2);
    assert!(!desk.path().join("out").exists());
    (faults, ran.err)
}

#[test]
fn a_volume_of_one_value() {
    let desk = Desk::new();
    for (value, message) in [
        (-1000, "the CT holds no tissue: -1000 HU in every voxel"),
        (
            40,
            "the CT holds no air, so it has no skin: 40 HU in every voxel",
        ),
        (
            0,
            "the CT holds no air, so it has no skin: 0 HU in every voxel",
        ),
    ] {
        desk.write("ct.nii", constant(value));
        assert_no_result(&desk, &plan("one", "ct.nii"), message);
        let by_otsu = plan("one", "ct.nii") + OTSU;
        assert_no_result(&desk, &by_otsu, "nothing to separate");
        let info = desk.run(&["info", "ct.nii"]).expect(0);
        let range = format!("range        {value} HU in every voxel");
        assert!(info.out.contains(&range), "{}", info.out);
    }
    let mut nan = constant(0)[..352].to_vec();
    put_i16s(&mut nan, 70, &[16, 32]);
    let voxels = DIMS.iter().product();
    nan.resize(352 + 4 * voxels, 0);
    put_f32s(&mut nan, 352, &vec![f32::NAN; voxels]);
    desk.write("ct.nii", nan);
    let message = "196608 of 196608 voxels are not numbers";
    assert_no_result(&desk, &plan("nan", "ct.nii"), message);
    let info = desk.run(&["info", "ct.nii"]).expect(3);
    assert!(info.err.contains(message), "{info:?}");
}

#[test]
fn an_empty_mask_at_the_plans_threshold() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    for (skin_hu, message) in [
        (
            290,
            "the CT holds no tissue: -1000 to 50 HU, nowhere the 290 HU",
        ),
        (
            -1000,
            "the CT holds no air, so it has no skin: -1000 to 50 HU",
        ),
    ] {
        let segment = format!("[segment]\nskin_hu = {skin_hu}\n");
        assert_no_result(&desk, &(plan("none", "ct.nii") + &segment), message);
    }
}

/// Every landmark of the small head's plans, moved along y.
fn moved(by: f64) -> String {
    let text = plan_head("moved", "ct.nii") + MILD;
    let mut moved = text.clone();
    for line in text
        .lines()
        .filter(|line| line.ends_with(']') && line.contains(" = ["))
    {
        let Some((name, point)) = line.split_once(" = ") else {
            continue;
        };
        if let Ok([x, y, z]) = serde_json::from_str::<[f64; 3]>(point) {
            moved = moved.replace(line, &format!("{name} = [{x}, {}, {z}]", y + by));
        }
    }
    assert_ne!(moved, text);
    moved
}

#[test]
fn a_volume_without_a_nose() {
    let desk = Desk::new();
    // A wall, on which the landmarks are where a nose would be.
    desk.write("ct.nii", tissue(|[_, y, _]| y >= 30.0));
    let off = "there is no nose where the landmarks are: ";
    assert_no_result(&desk, &plan("wall", "ct.nii"), off);
    // The same with the landmarks on the wall, as far as the plan lets them.
    let on_the_wall = plan("wall", "ct.nii").replace("tip = [32, 16, 22]", "tip = [32, 29, 22]");
    let flat = "no nose stands out where the landmarks are: at the tip the skin is 0.0 mm in front";
    assert_no_result(&desk, &on_the_wall, flat);
    // A bump of two voxels.
    desk.write(
        "ct.nii",
        tissue(|[x, y, z]| {
            let [x, z] = [(x - 32.0) / 9.0, (z - 24.0) / 10.0];
            y >= 30.0 - 2.0 * f64::from(u8::from(x * x + z * z <= 1.0))
        }),
    );
    let flat = "at the tip the skin is 3.0 mm in front of the cheeks beside it";
    assert_no_result(&desk, &on_the_wall, flat);

    // Landmarks in the air in front of a face, and deep in a head.
    desk.write("ct.nii", nifti());
    assert_no_result(&desk, &moved(-14.0), off);
    assert_no_result(&desk, &moved(14.0), off);
    let far =
        (plan_head("far", "ct.nii") + MILD).replace("tip = [32, 16, 22]", "tip = [32, 1, 22]");
    assert_no_result(
        &desk,
        &far,
        "`tip` is more than 20 mm from the skin, and 10 mm are the most",
    );

    // A scan that begins behind the tip.
    desk.write(
        "ct.nii",
        tissue(|[x, y, z]| {
            let r = [(x - 32.0) / 9.0, (y - 10.0) / 14.0, (z - 24.0) / 10.0];
            y >= 10.0 || r.iter().map(|d| d * d).sum::<f64>() <= 1.0
        }),
    );
    let cut = moved(-20.0).replace("tip = [32, -4, 22]", "tip = [32, 0, 22]");
    let said = "the scan cuts off the nose: at the height of the tip (voxel z = 22)";
    assert_no_result(&desk, &cut, said);
}

/// The landmarks of the small head in LPS mm.
const LPS: [(&str, [f64; 3]); 6] = [
    ("nasal_bones", [0.0, -3.0, 18.0]),
    ("lip", [0.0, -3.0, -18.0]),
    ("alare_right", [-15.0, -6.0, -6.0]),
    ("alare_left", [15.0, -6.0, -6.0]),
    ("tip", [0.0, -24.0, -3.0]),
    ("maxilla", [0.0, 0.0, -6.0]),
];

/// How a plan can give its landmarks.
const WAYS: [&str; 5] = ["voxel", "lps", "ras", "mrk.json", "fcsv"];

/// A plan of the small head with its landmarks changed in LPS mm, in one of the [`WAYS`].
fn given(desk: &Desk, way: &str, change: impl Fn(&str, [f64; 3]) -> [f64; 3]) -> String {
    let points = LPS.map(|(name, point)| (name, change(name, point)));
    let table = |frame: &str, convert: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let rows = points.map(|(name, point)| format!("{name} = {:?}\n", convert(point)));
        format!("frame = \"{frame}\"\n{}", rows.concat())
    };
    let landmarks = match way {
        "voxel" => table("voxel", &|[x, y, z]| {
            [
                (x + 48.0) / SPACING,
                (y + 48.0) / SPACING,
                (z + 36.0) / SPACING,
            ]
        }),
        "lps" => table("lps", &|point| point),
        "ras" => table("ras", &|[x, y, z]| [-x, -y, z]),
        "mrk.json" => {
            let points =
                points.map(|(name, at)| format!("{{\"label\": \"{name}\", \"position\": {at:?}}}"));
            let text = format!(
                "{{\"markups\": [{{\"coordinateSystem\": \"LPS\", \"controlPoints\": [{}]}}]}}",
                points.join(",")
            );
            desk.write("a.mrk.json", text);
            "file = \"a.mrk.json\"\n".to_owned()
        }
        _ => {
            let rows = points
                .map(|(name, [x, y, z])| format!("1,{},{},{z},0,0,0,1,1,1,0,{name},,\n", -x, -y));
            desk.write(
                "a.fcsv",
                format!("# CoordinateSystem = RAS\n{}", rows.concat()),
            );
            "file = \"a.fcsv\"\n".to_owned()
        }
    };
    format!(
        "plan = 1\nname = \"given\"\n\n[ct]\npath = \"ct.nii\"\n\n[landmarks]\n{landmarks}\n{CANDIDATES}"
    )
}

#[test]
fn a_landmark_outside_the_volume() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    for way in WAYS {
        desk.write("sound.toml", given(&desk, way, |_, point| point));
        desk.run(&["check", "sound.toml"]).expect(0);
        for (landmark, _) in LPS {
            // In front of the volume, which begins at -48 mm; what that does to the sides is not the point.
            let text = given(&desk, way, |name, [x, y, z]| {
                [x, if name == landmark { -48.1 } else { y }, z]
            });
            let (faults, shown) = refused(&desk, &text);
            let outside = format!("landmark `{landmark}` is outside the volume");
            assert!(
                faults.contains(&("outside-volume".to_owned(), outside)),
                "{way}: {faults:?}"
            );
            assert!(
                shown.contains("a voxel from (0, 0, 0) to (63, 63, 47)"),
                "{shown}"
            );
        }
    }
}

#[test]
fn left_and_right_exchanged() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    for way in WAYS {
        let exchanged = given(&desk, way, |name, [x, y, z]| {
            [if name.starts_with("alare") { -x } else { x }, y, z]
        });
        let (faults, shown) = refused(&desk, &exchanged);
        let message = "`alare_left` is not to the patient's left of `alare_right`";
        assert_eq!(
            faults,
            [("wrong-side".to_owned(), message.to_owned())],
            "{way}"
        );
        assert!(
            shown.contains("swap `alare_left` and `alare_right`"),
            "{shown}"
        );
        assert!(shown.contains("plan.toml:"), "{shown}");
    }
}

#[test]
fn landmarks_of_a_head_that_is_upside_down() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    for way in WAYS {
        // Mirrored, and turned about each axis.
        let (faults, shown) = refused(&desk, &given(&desk, way, |_, [x, y, z]| [x, y, -z]));
        let message = "`nasal_bones` is not above `lip`";
        assert_eq!(
            faults,
            [("wrong-side".to_owned(), message.to_owned())],
            "{way}"
        );
        assert!(shown.contains("the two points are swapped"), "{shown}");
        assert!(
            shown.contains("the CT's header gives wrong axes"),
            "{shown}"
        );
        for turn in [[-1.0, 1.0, -1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, 1.0]] {
            let text = given(&desk, way, |_, [x, y, z]| {
                [turn[0] * x, turn[1] * y, turn[2] * z]
            });
            let (faults, shown) = refused(&desk, &text);
            assert!(
                faults.iter().all(|(code, _)| code == "wrong-side"),
                "{faults:?}"
            );
            // Turned about z, LPS is RAS and the other way round, and that is said.
            let hints = [
                "the whole head is turned",
                "every landmark would be in the volume",
            ];
            assert!(
                hints.iter().any(|hint| shown.contains(hint)),
                "{way}: {shown}"
            );
        }
        // On its back, the nose up.
        let (faults, _) = refused(&desk, &given(&desk, way, |_, [x, y, z]| [x, z, -y]));
        assert!(!faults.is_empty());
        // Left and right as heights, about which no pair of points says anything.
        let text = given(&desk, way, |_, [x, y, z]| [x - 2.0 * z, y, z]);
        let (faults, shown) = refused(&desk, &text);
        assert_eq!(faults[0].0, "orientation", "{faults:?}");
        assert!(shown.contains("a line 63° off that direction"), "{shown}");
    }
}

/// The header says that the lowest slice is the highest: in a viewer the head is upside-down, and so are
/// the millimetres that landmarks are read in.
#[test]
fn a_header_that_puts_the_head_upside_down() {
    let desk = Desk::new();
    let mut turned = nifti();
    let s = SPACING as f32;
    put_sform(
        &mut turned,
        [
            [-s, 0.0, 0.0, 48.0],
            [0.0, -s, 0.0, 48.0],
            [0.0, 0.0, -s, 36.0],
        ],
    );
    desk.write("ct.nii", turned);
    for way in WAYS {
        let (faults, shown) = refused(&desk, &given(&desk, way, |_, [x, y, z]| [x, y, -z]));
        assert_eq!(faults[0].1, "`nasal_bones` is not above `lip`");
        assert!(
            shown.contains("the CT's header gives wrong axes"),
            "{shown}"
        );
    }
}

/// Heads with their landmarks where they belong, in headers that turn the head.
#[test]
fn real_heads_that_lie_otherwise_than_their_headers_say() {
    for name in ["cranium", "headphantom"] {
        let [file, ct] =
            ["mrk.json", "nii.gz"].map(|end| real_data::path(&format!("{name}.{end}")));
        let (Some(file), Some(ct)) = (file, ct) else {
            continue;
        };
        let desk = Desk::new();
        let (file, ct) = (file.display().to_string(), ct.display().to_string());
        let landmarks = desk.run(&["landmarks", &file, "--ct", &ct]).expect(0).out;
        let mut bytes = Vec::new();
        let packed = std::fs::read(&ct).unwrap();
        GzDecoder::new(&packed[..]).read_to_end(&mut bytes).unwrap();
        let text = format!("plan = 1\nname = \"real\"\n[ct]\npath = \"ct.nii\"\n{landmarks}{MILD}");
        let number = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let steps = [80, 84, 88].map(number);
        // As it is; upside-down; back to front; both; and a nose cut down to the face.
        for (signs, is_good) in [
            ([-1.0, -1.0, 1.0], true),
            ([-1.0, -1.0, -1.0], false),
            ([-1.0, 1.0, 1.0], false),
            ([-1.0, 1.0, -1.0], false),
        ] {
            let mut turned = bytes.clone();
            put_i16s(&mut turned, 252, &[0, 1]);
            let [x, y, z]: [f32; 3] = std::array::from_fn(|axis| signs[axis] * steps[axis]);
            put_sform(
                &mut turned,
                [[x, 0.0, 0.0, 0.0], [0.0, y, 0.0, 0.0], [0.0, 0.0, z, 0.0]],
            );
            desk.write("ct.nii", turned);
            if is_good {
                desk.write("plan.toml", &text);
                let ran = desk.run(&["run", "plan.toml"]).expect(0);
                assert_eq!(ran.err, "", "{name}");
                std::fs::remove_dir_all(desk.path().join("out")).unwrap();
            } else {
                assert_no_result(&desk, &text, "where the landmarks are");
            }
        }
        let mut cut = bytes.clone();
        let [nx, ny, nz] = [42, 44, 46]
            .map(|at| usize::from(u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap())));
        // In front of the alare points of both heads, 33 and 36.
        for (z, y) in (0..nz).flat_map(|z| (0..33).map(move |y| (z, y))) {
            put_i16s(&mut cut, 352 + 2 * (z * ny + y) * nx, &vec![-1000; nx]);
        }
        desk.write("ct.nii", cut);
        assert_no_result(
            &desk,
            &text,
            "there is no nose where the landmarks are: `tip` is",
        );
    }
}

/// A head whose nose is low on the face, so that upside-down it is elsewhere.
#[test]
fn voxels_of_a_head_that_is_upside_down_in_the_volume() {
    let low = |z: f64| {
        tissue(move |[x, y, at]| {
            let at = if z < 0.0 { 47.0 - at } else { at };
            let r = [(x - 32.0) / 9.0, (y - 30.0) / 14.0, (at - 14.0) / 10.0];
            y >= 30.0 || r.iter().map(|d| d * d).sum::<f64>() <= 1.0
        })
    };
    let text = plan("low", "ct.nii")
        .replace("nasal_bones = [32, 30, 36]", "nasal_bones = [32, 30, 26]")
        .replace("lip = [32, 30, 12]", "lip = [32, 30, 2]")
        .replace("28, 20]", "28, 10]")
        .replace("tip = [32, 16, 22]", "tip = [32, 16, 12]");
    let desk = Desk::new();
    desk.write("ct.nii", low(1.0));
    desk.write("plan.toml", &text);
    let ran = desk.run(&["run", "plan.toml"]).expect(0);
    assert_eq!(ran.err, "");
    std::fs::remove_dir_all(desk.path().join("out")).unwrap();
    desk.write("ct.nii", low(-1.0));
    assert_no_result(
        &desk,
        &text,
        "there is no nose where the landmarks are: `tip` is",
    );
}

#[test]
fn what_was_warned_of_is_in_the_record() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("good.toml", plan("good", "ct.nii"));
    desk.run(&["run", "good.toml"]).expect(0);
    assert_eq!(desk.json("out/good/run.json").get("warnings"), None);
    let off = plan("off", "ct.nii").replace("tip = [32, 16, 22]", "tip = [32, 11, 22]");
    desk.write("off.toml", off);
    let ran = desk.run(&["run", "off.toml"]).expect(0);
    let warnings = &desk.json("out/off/run.json")["warnings"];
    let warning = warnings[0].as_str().unwrap();
    assert!(warning.starts_with("landmark `tip` is 7."), "{warning}");
    assert_eq!(warnings.as_array().unwrap().len(), 1);
    assert!(ran.err.contains(warning), "{ran:?}");
    let table = std::fs::read_to_string(desk.path().join("out/off/table.md")).unwrap();
    assert!(
        table.contains(&format!("**Warning:** {warning}.")),
        "{table}"
    );
    // A base plane in front of the lip: not the whole of the face is measured.
    let thin = plan("thin", "ct.nii").replace("maxilla = [32, 32, 20]", "maxilla = [32, 29, 20]");
    desk.write("thin.toml", thin);
    let ran = desk.run(&["run", "thin.toml"]).expect(0);
    let said = "below the tip, region K has no tissue in front of the base plane";
    assert!(ran.err.contains(said), "{ran:?}");
    // So far in front that the tip stands on nothing, though there is tissue above it; and that nothing is left.
    let head =
        plan_head("none", "ct.nii").replace("maxilla = [32, 32, 20]", "maxilla = [32, 17, 20]");
    let above = head.replace("tip = [32, 16, 22]", "tip = [32, 16, 17]") + MILD;
    let said = "no nose stands in front of the base plane: region I, which holds the tip, has no";
    std::fs::remove_dir_all(desk.path().join("out")).unwrap();
    assert_no_result(&desk, &above, said);
    let nothing = head
        .replace("tip = [32, 16, 22]", "tip = [32, 11, 22]")
        .replace("maxilla = [32, 17, 20]", "maxilla = [32, 15, 20]");
    assert_no_result(&desk, &(nothing + MILD), "no tissue in the regions A..K");
}
