//! A skin threshold that is left to the CT.

use crate::head::{CANDIDATES, constant, nifti, plan, plan_head};
use crate::process::Desk;

const OTSU: &str = "[segment]\nskin_hu = \"otsu\"\n";

#[test]
fn the_threshold_found_is_recorded_and_used() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("found.toml", plan("found", "ct.nii") + OTSU);
    desk.run(&["run", "found.toml"]).expect(0);
    let read = |name: &str| std::fs::read_to_string(desk.path().join(name)).unwrap();
    let record: serde_json::Value = serde_json::from_str(&read("out/found/run.json")).unwrap();
    let segment = &record["plan"]["segment"];
    assert_eq!(segment["skin_hu_from"], "otsu");
    // The air is at -1000 and the darkest tissue at 40: the middle of the thresholds -999 to 40 that part them.
    assert_eq!(segment["skin_hu"], -479.5);
    assert!(read("out/found/table.md").contains("skin at -479.5 HU (Otsu)"));

    let given = plan("given", "ct.nii") + "[segment]\nskin_hu = -479.5\n";
    desk.write("given.toml", given);
    desk.run(&["run", "given.toml"]).expect(0);
    let measured = read("out/given/measurements.csv");
    assert_eq!(read("out/found/measurements.csv"), measured);
    assert!(read("out/given/table.md").contains("skin at -479.5 HU. "));
    let default = plan("default", "ct.nii");
    desk.write("default.toml", default);
    desk.run(&["run", "default.toml"]).expect(0);
    assert_ne!(read("out/default/measurements.csv"), measured);
}

#[test]
fn a_ct_that_gives_no_threshold_ends_the_run() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("air.nii", constant(-1000));
    for (ct, segment, message) in [
        ("air.nii", OTSU.to_owned(), "finds nothing to separate"),
        (
            "ct.nii",
            format!("{OTSU}bone_hu = -490\n"),
            "finds -479.5 HU, which is not below bone_hu = -490",
        ),
    ] {
        let text = plan_head("none", ct) + &segment + CANDIDATES;
        desk.write("plan.toml", text);
        let ran = desk.run(&["run", "plan.toml"]).expect(3);
        assert!(ran.err.contains(message), "{ran:?}");
        assert!(!desk.path().join("out").exists());
    }
}
