//! Real heads, where they are at hand.

use glam::DVec3;
use rhinoplan::io::nifti::read;
use rhinoplan::volume::AnyVolume;
use serde_json::Value;

use crate::process::Desk;
use crate::real_data;

/// A head and its landmarks: nasal_bones, lip, alare_right, alare_left, tip, maxilla, in voxels.
struct Head {
    file: &'static str,
    landmarks: [[f64; 3]; 6],
}

const HEADS: [Head; 2] = [
    Head {
        file: "cranium.nii.gz",
        landmarks: [
            [129.0, 39.0, 46.0],
            [130.0, 26.0, 4.0],
            [111.0, 33.0, 19.0],
            [148.0, 33.0, 19.0],
            [128.0, 12.0, 24.0],
            [111.0, 41.0, 18.0],
        ],
    },
    Head {
        file: "headphantom.nii.gz",
        landmarks: [
            [118.0, 44.0, 77.0],
            [117.0, 25.0, 38.0],
            [98.0, 36.0, 50.0],
            [138.0, 36.0, 50.0],
            [117.0, 15.0, 53.0],
            [96.0, 40.0, 49.0],
        ],
    },
];

const NAMES: [&str; 6] = [
    "nasal_bones",
    "lip",
    "alare_right",
    "alare_left",
    "tip",
    "maxilla",
];

/// Of sums and products of numbers below 1000.
const ROUNDING: f64 = 1e-9;
const MARGIN_MM: f64 = 20.0;

fn plan(head: &Head, path: &std::path::Path, name: &str, rest: &str) -> String {
    let mut text = format!(
        "plan = 1\nname = \"{name}\"\n[ct]\npath = \"{}\"\n[landmarks]\nframe = \"voxel\"\n",
        path.display()
    );
    for (name, point) in NAMES.iter().zip(head.landmarks) {
        text += &format!("{name} = {point:?}\n");
    }
    text + rest + "[outputs]\nwrite = [\"volume\"]\n"
}

fn close(found: &Value, expected: f64) {
    let found = found.as_f64().unwrap();
    assert!(
        (found - expected).abs() < ROUNDING,
        "{found}, expected {expected}"
    );
}

/// The measures of a stage against the formulas, for landmarks and a tip in grid mm.
fn assert_measures(stage: &Value, marks: &[DVec3; 6], tip: DVec3, spacing: DVec3) {
    let measures = &stage["measures"];
    let (up, down) = (marks[0] - tip, marks[1] - tip);
    let gamma = libm::acos(up.dot(down) / (up.length() * down.length()));
    close(&measures["gamma_deg"], gamma.to_degrees());
    close(&measures["height_mm"], marks[5].y - tip.y);
    for (axis, expected) in (tip / spacing).to_array().into_iter().enumerate() {
        close(&measures["tip_voxel"][axis], expected);
    }
    let volumes = measures["volume_mm3"].as_array().unwrap();
    assert_eq!(volumes.len(), 11);
    // Region A of a nose without a dip at its root can be empty.
    for volume in volumes {
        let volume = volume.as_f64().unwrap();
        assert!((0.0..20_000.0).contains(&volume), "{volume} mm³");
    }
    let total = measures["volume_total_mm3"].as_f64().unwrap();
    assert!((5_000.0..100_000.0).contains(&total), "{total} mm³");
    let jacobian = stage["warp"]["jacobian_min"].as_f64().unwrap();
    assert!(0.0 < jacobian && jacobian <= 1.0, "{jacobian}");
}

fn i16s(volume: &AnyVolume) -> &[i16] {
    let AnyVolume::I16(volume) = volume else {
        panic!("both heads are int16");
    };
    volume.as_slice()
}

#[test]
fn two_stages_of_model_local() {
    for head in &HEADS {
        let Some(path) = real_data::path(head.file) else {
            continue;
        };
        let desk = Desk::new();
        let stages = "[[candidate]]\nname = \"c\"\n\
            [[candidate.stage]]\nname = \"reduce\"\nf1 = [{ project = -3.0 }]\n\
            [[candidate.stage]]\nname = \"shift\"\nf1 = [{ deviate = 2.0 }, { width = 0.95 }]\n";
        desk.write("plan.toml", plan(head, &path, "local", stages));
        let ran = desk.run(&["run", "plan.toml"]).expect(0);
        assert_eq!(ran.err, "");
        let ct = read(&path).unwrap();
        let spacing = ct.volume.grid().spacing();
        let marks = head
            .landmarks
            .map(|point| DVec3::from_array(point) * spacing);
        let tips = [
            DVec3::ZERO,
            DVec3::new(0.0, 3.0, 0.0),
            DVec3::new(2.0, 3.0, 0.0),
        ]
        .map(|by| marks[4] + by);
        let record = desk.json("out/local/run.json");
        let stages = record["candidates"][0]["stages"].as_array().unwrap();
        assert_eq!(stages.len(), 3);
        for (stage, tip) in stages.iter().zip(tips) {
            assert_measures(stage, &marks, tip, spacing);
        }
        let total = |stage: usize| {
            stages[stage]["measures"]["volume_total_mm3"]
                .as_f64()
                .unwrap()
        };
        assert!(
            total(1) < total(0) && total(2) < total(1),
            "smaller, then narrower"
        );

        // The box of method section 3, of both stages.
        let [nasal_bones, lip, right, left, tip, maxilla] = marks;
        let mut low = DVec3::new(right.x, tip.y - 5.0, lip.z);
        let mut high = DVec3::new(left.x, maxilla.y, nasal_bones.z);
        for end in tips.iter().chain([&nasal_bones]) {
            (low, high) = (low.min(*end), high.max(*end));
        }
        let before = i16s(&ct.volume);
        let [nx, ny, nz] = ct.volume.grid().dims();
        for folder in ["01-reduce", "02-shift"] {
            let after = read(
                &desk
                    .path()
                    .join("out/local/c")
                    .join(folder)
                    .join("volume.nii.gz"),
            )
            .unwrap();
            assert_eq!(after.volume.grid(), ct.volume.grid());
            let (mut outside, mut moved) = (0, 0);
            let mut samples = before.iter().zip(i16s(&after.volume));
            for z in 0..nz {
                for y in 0..ny {
                    for x in 0..nx {
                        let at = DVec3::new(x as f64, y as f64, z as f64) * spacing;
                        let distance = (low - at).max(at - high).max(DVec3::ZERO).length();
                        let (a, b) = samples.next().unwrap();
                        if distance >= MARGIN_MM + ROUNDING {
                            assert_eq!(a, b, "({x}, {y}, {z}), {distance} mm outside");
                            outside += 1;
                        } else {
                            moved += usize::from(a != b);
                        }
                    }
                }
            }
            assert!(
                moved > 10_000 && outside > nx * ny * nz / 2,
                "{moved} {outside}"
            );
        }
    }
}

#[test]
fn one_stage_of_model_lee2001() {
    for head in &HEADS {
        let Some(path) = real_data::path(head.file) else {
            continue;
        };
        let desk = Desk::new();
        let stage = "[morph]\nmodel = \"lee2001\"\n[[candidate]]\nname = \"c\"\n\
            [[candidate.stage]]\nname = \"move\"\nf1 = [{ move_tip = { voxels = [1, 2, 1] } }]\n";
        desk.write("plan.toml", plan(head, &path, "global", stage));
        desk.run(&["run", "plan.toml"]).expect(0);
        let ct = read(&path).unwrap();
        let spacing = ct.volume.grid().spacing();
        let marks = head
            .landmarks
            .map(|point| DVec3::from_array(point) * spacing);
        let record = desk.json("out/global/run.json");
        let stages = &record["candidates"][0]["stages"];
        let tip = marks[4] + DVec3::new(1.0, 2.0, 1.0) * spacing;
        assert_measures(&stages[0], &marks, marks[4], spacing);
        assert_measures(&stages[1], &marks, tip, spacing);
        assert_eq!(
            stages[1]["measures"]["move_voxel"]
                .as_array()
                .unwrap()
                .len(),
            3
        );
        let after = read(&desk.path().join("out/global/c/01-move/volume.nii.gz")).unwrap();
        assert_eq!(after.volume.grid(), ct.volume.grid());
        assert!(i16s(&after.volume) != i16s(&ct.volume));
    }
}
