//! NRRD volumes, in and out.

use rhinoplan::io::{nifti, nrrd};
use rhinoplan::volume::AnyVolume;
use serde_json::Value;

use crate::head::{CANDIDATES, DIMS, SPACING, nifti as head, plan, plan_head, put_f32s};
use crate::process::Desk;

/// The small head as NRRD, without compression; `head` gives its fields on space.
fn as_nrrd(fields: &str) -> Vec<u8> {
    let [nx, ny, nz] = DIMS;
    let header = format!(
        "NRRD0004\ntype: short\ndimension: 3\nsizes: {nx} {ny} {nz}\nendian: little\nencoding: raw\n{fields}\
         name:=Jane Doe\n\n"
    );
    [header.as_bytes(), &head()[352..]].concat()
}

fn placed() -> String {
    format!(
        "space: left-posterior-superior\nspace directions: ({SPACING},0,0) (0,{SPACING},0) (0,0,{SPACING})\n\
         space origin: (-48,-48,-36)\n"
    )
}

fn i16s(volume: &AnyVolume) -> &[i16] {
    match volume {
        AnyVolume::I16(volume) => volume.as_slice(),
        other => panic!("{}", other.sample_type()),
    }
}

/// The same head from both formats gives the same numbers and, in both formats, the same volumes.
#[test]
fn nrrd_is_as_good_as_nifti() {
    let desk = Desk::new();
    desk.write("ct.nii", head());
    // Content decides, not the name.
    desk.write("ct.nii.gz", as_nrrd(&placed()));
    let every = |text: String| text.replace("\"displacement\"", "\"displacement\", \"nrrd\"");
    desk.write("nifti.toml", every(plan("nifti", "ct.nii")));
    desk.write("nrrd.toml", every(plan("nrrd", "ct.nii.gz")));
    let ran = desk.run(&["run", "nifti.toml", "nrrd.toml"]).expect(0);
    assert_eq!(ran.err, "");
    let strip = |name: &str| {
        let mut record = desk.json(&format!("out/{name}/run.json"));
        let inputs = record["inputs"].as_object_mut().unwrap();
        inputs.remove("plan_sha256");
        let ct = inputs["ct"].as_object_mut().unwrap();
        let source = ct.remove("source").unwrap();
        ct.remove("sha256");
        record["plan"]["name"] = Value::Null;
        assert_eq!(record["plan"]["outputs"]["nrrd"], true);
        (record, source)
    };
    let (from_nifti, from_nrrd) = (strip("nifti"), strip("nrrd"));
    assert_eq!(from_nifti.0, from_nrrd.0);
    assert_eq!((from_nifti.1, from_nrrd.1), ("nifti".into(), "nrrd".into()));
    let before = nifti::read(&desk.path().join("ct.nii")).unwrap();
    for stage in ["both/01-move", "both/02-reduce", "up/01-rotate"] {
        let [a, b] = ["nifti", "nrrd"].map(|name| desk.path().join("out").join(name).join(stage));
        let volume = nifti::read(&a.join("volume.nii.gz")).unwrap().volume;
        assert_ne!(volume, before.volume, "the stage does something");
        for folder in [&a, &b] {
            let packed = nrrd::read(&folder.join("volume.nrrd")).unwrap().volume;
            assert_eq!(packed, volume, "{}", folder.display());
        }
        assert_eq!(
            nifti::read(&b.join("volume.nii.gz")).unwrap().volume,
            volume
        );
        for name in ["volume.nrrd", "volume.nii.gz", "displacement.nii.gz"] {
            let bytes = [&a, &b].map(|folder| std::fs::read(folder.join(name)).unwrap());
            assert!(
                !String::from_utf8_lossy(&bytes[1]).contains("Jane"),
                "{name}"
            );
            if name == "volume.nrrd" {
                assert!(
                    bytes[0] == bytes[1],
                    "{stage}: the same volume, byte for byte"
                );
            }
        }
    }
    let info = desk.run(&["info", "ct.nii.gz"]).expect(0);
    assert!(
        info.out.contains("position     from space directions"),
        "{info:?}"
    );
    let dry = desk
        .run(&["run", "--dry-run", "--force", "nrrd.toml"])
        .expect(0);
    assert_eq!(dry.out.matches("writing the volume as NRRD").count(), 3);
}

/// NRRD has no rescale: Hounsfield units are written.
#[test]
fn a_rescale_is_applied() {
    let desk = Desk::new();
    let mut file = head();
    // Stored from 24 on, with an intercept of -1024.
    put_f32s(&mut file, 112, &[1.0, -1024.0]);
    for sample in file[352..].chunks_exact_mut(2) {
        let hu = i16::from_le_bytes([sample[0], sample[1]]);
        sample.copy_from_slice(&(hu + 1024).to_le_bytes());
    }
    desk.write("ct.nii", head());
    desk.write("shifted.nii", file);
    for (name, ct) in [("plain", "ct.nii"), ("shifted", "shifted.nii")] {
        let text = plan_head(name, ct) + CANDIDATES;
        desk.write("plan.toml", text.replace("\"displacement\"", "\"nrrd\""));
        desk.run(&["run", "plan.toml"]).expect(0);
    }
    let [plain, shifted] = ["plain", "shifted"].map(|name| {
        let path = desk.path().join("out").join(name);
        nrrd::read(&path.join("both/01-move/volume.nrrd")).unwrap()
    });
    assert_eq!(i16s(&plain.volume), i16s(&shifted.volume));
}

#[test]
fn nrrd_that_cannot_be_used_is_named_and_an_assumed_position_is_a_warning() {
    let desk = Desk::new();
    desk.write("plan.toml", plan("a", "ct.nrrd"));
    desk.write("ct.nrrd", as_nrrd(&placed().replace("left-", "up-")));
    for args in [
        &["check", "plan.toml"][..],
        &["run", "plan.toml"],
        &["info", "ct.nrrd"],
    ] {
        let ran = desk.run(args).expect(3);
        assert!(
            ran.err.contains("`space` is `up-posterior-superior`"),
            "{ran:?}"
        );
    }
    desk.write(
        "ct.nrrd",
        as_nrrd(&format!("spacings: {SPACING} {SPACING} {SPACING}\n")),
    );
    for args in [
        &["check", "plan.toml"][..],
        &["run", "plan.toml"],
        &["info", "ct.nrrd"],
    ] {
        let ran = desk.run(args).expect(0);
        assert!(
            ran.err.contains("gives no position (no `space`)"),
            "{ran:?}"
        );
    }
}
