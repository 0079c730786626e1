//! `check` knows everything that can be known without voxels, and at once.

use std::fs::File;
use std::time::{Duration, Instant};

use crate::head::{gzip, nifti, plan, put_i16s};
use crate::process::Desk;

/// Start to end of a process. The aim is 50 ms; a busy machine may take longer, reading a volume takes
/// longer still.
const BOUND: Duration = Duration::from_millis(250);

fn median(desk: &Desk, args: &[&str], code: i32) -> Duration {
    let mut times: Vec<_> = (0..9)
        .map(|_| {
            let start = Instant::now();
            desk.run(args).expect(code);
            start.elapsed()
        })
        .collect();
    times.sort();
    println!("{args:?}: {:.1} ms", times[4].as_secs_f64() * 1e3);
    times[4]
}

#[test]
fn a_bad_plan_is_answered_at_once() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    let text = plan("bad", "ct.nii")
        .replace("rotate = 5", "turn = 5")
        .replace("[22, 28, 20]", "[99, 28, 20]");
    desk.write("plan.toml", text);
    let ran = desk.run(&["check", "plan.toml"]).expect(2);
    assert!(ran.err.contains("3 faults"), "{ran:?}");
    assert!(median(&desk, &["check", "plan.toml"], 2) < BOUND);
}

#[test]
fn a_large_ct_takes_no_longer() {
    let desk = Desk::new();
    let mut header = nifti()[..352].to_vec();
    put_i16s(&mut header, 40, &[3, 512, 512, 400]);
    let path = desk.write("large.nii", &header);
    // A hole: there is nothing to read but the header.
    let file = File::options().write(true).open(path).unwrap();
    file.set_len(352 + 512 * 512 * 400 * 2).unwrap();
    desk.write("plan.toml", plan("large", "large.nii"));
    let ran = desk.run(&["check", "plan.toml"]).expect(0);
    assert!(
        ran.out.contains("512×512×400 voxels of 1.5×1.5×1.5 mm"),
        "{ran:?}"
    );
    assert!(median(&desk, &["check", "plan.toml"], 0) < BOUND);
}

#[test]
fn voxels_are_not_read() {
    let desk = Desk::new();
    desk.write("plan.toml", plan("good", "ct.nii.gz"));
    let mut packed = gzip(&nifti());
    desk.write("ct.nii.gz", &packed);
    desk.run(&["run", "plan.toml"]).expect(0);
    let half = packed.len() / 2;
    packed[half..].fill(0xff);
    desk.write("ct.nii.gz", &packed);
    for command in [&["check"][..], &["run", "--dry-run", "--out", "new"]] {
        let ran = desk.run(&[command, &["plan.toml"]].concat()).expect(0);
        assert_eq!(ran.err, "");
    }
    // Where there are results to hold against it, it is read.
    for command in [&["run"][..], &["run", "--dry-run"]] {
        let ran = desk.run(&[command, &["plan.toml"]].concat()).expect(3);
        assert!(ran.err.contains("gzip stream is damaged"), "{ran:?}");
    }
}

#[test]
fn several_plans_are_each_told_of() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("a.toml", plan("a", "ct.nii"));
    desk.write("b.toml", plan("b", "ct.nii"));
    let ran = desk.run(&["check", "b.toml", "a.toml"]).expect(0);
    assert_eq!(
        ran.out,
        "b.toml: ok (2 candidates, 3 stages on a CT of 64×64×48 voxels of 1.5×1.5×1.5 mm)\n\
         a.toml: ok (2 candidates, 3 stages on a CT of 64×64×48 voxels of 1.5×1.5×1.5 mm)\n"
    );
}

#[test]
fn a_ct_without_a_position_is_warned_of() {
    let desk = Desk::new();
    let mut lost = nifti();
    put_i16s(&mut lost, 252, &[0, 0]);
    desk.write("ct.nii", lost);
    // Method 1 takes the axes for right, anterior, superior: x and y are turned round.
    let text = plan("lost", "ct.nii")
        .replace("[22, 28, 20]", "[21, 28, 20]")
        .replace("[42, 28, 20]", "[41, 28, 20]");
    desk.write("plan.toml", text);
    for command in [&["check"][..], &["run", "--dry-run"]] {
        let args = [command, &["plan.toml"]].concat();
        let ran = desk.run(&args).expect(0);
        assert!(
            ran.err
                .starts_with("warning: plan.toml: the CT's header gives no position"),
            "{ran:?}"
        );
        assert_eq!(desk.run(&[&args[..], &["-q"]].concat()).expect(0).err, "");
        let document = desk
            .run(&[&args[..], &["--json"]].concat())
            .expect(0)
            .document();
        assert_eq!(document["warnings"].as_array().unwrap().len(), 1);
    }
}
