//! Golden folders that anyone may have filled: a message, exit code 2, and nothing outside them is read.

use std::fs;

use super::{blessed, verify, with_all, with_volumes};
use crate::process::Desk;

const VIEW: &str = "golden/good/both/01-move/view-frontal.png";

/// Exit code 2, with these words, and without a report.
fn assert_refused(desk: &Desk, words: &str) {
    let ran = verify(desk, &[]).expect(2);
    assert!(
        ran.err.starts_with("error: ") && ran.err.contains(words),
        "{words}: {ran:?}"
    );
    assert_eq!(ran.out, "");
    assert!(!desk.path().join("golden-report").exists());
}

#[test]
fn golden_json() {
    let desk = blessed(&with_all("good"));
    let good = fs::read_to_string(desk.path().join("golden/good/golden.json")).unwrap();
    let write = |text: &[u8]| desk.write("golden/good/golden.json", text);
    for (text, words) in [
        (String::new(), "EOF"),
        ("[".repeat(100_000), "golden.json"),
        (good[..good.len() / 2].to_owned(), "EOF"),
        (good.replace("\"format\": 1", "\"format\": 9"), "layout 9"),
        (
            good.replace("both/01-move/view", "../../../etc/view"),
            "no name of a picture",
        ),
        (
            good.replace("\"both/01-move/view", "\"/etc/view"),
            "no name of a picture",
        ),
        (
            good.replace("\"side\": 256", "\"side\": 4294967295"),
            "`side` is 4294967295",
        ),
        (good.replace("move_x", "move\\u001b[2J"), "names no number"),
        (
            good.replace("\"value\":", "\"value\":1e999,\"x\":"),
            "out of range",
        ),
    ] {
        write(text.as_bytes());
        assert_refused(&desk, words);
    }
    write(b"\xff\xfe\x00");
    assert_refused(&desk, "golden.json");
    // A hole that claims to be far more than is read.
    let file = fs::File::create(desk.path().join("golden/good/golden.json")).unwrap();
    file.set_len(1 << 40).unwrap();
    assert_refused(&desk, "larger than 67108864 bytes");
    // `bless` heals it.
    super::bless(&desk).expect(0);
    verify(&desk, &[]).expect(0);
}

#[test]
fn numbers_that_were_changed_by_hand_are_differences() {
    let desk = blessed(&with_volumes("good"));
    let path = desk.path().join("golden/good/golden.json");
    let good = fs::read_to_string(&path).unwrap();
    let tip = "\"measure\":\"tip_x\",\"unit\":\"voxel\",\"value\":";
    let place = good.find(tip).unwrap() + tip.len();
    let end = place + good[place..].find('}').unwrap();
    fs::write(&path, format!("{}null{}", &good[..place], &good[end..])).unwrap();
    let found = super::differences(&desk);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0]["expected"], "not a number");
    assert_eq!(found[0]["found"], 32.0);
}

#[test]
fn pictures() {
    let desk = blessed(&with_all("good"));
    let good = fs::read(desk.path().join(VIEW)).unwrap();
    // The size of the picture, in its header: more than there can be.
    let mut huge = good.clone();
    huge[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    let mut flipped = good.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0x55;
    for bytes in [
        Vec::new(),
        b"no picture".to_vec(),
        good[..good.len() / 2].to_vec(),
        huge,
        flipped,
    ] {
        desk.write(VIEW, bytes);
        assert_refused(&desk, "view-frontal.png`: ");
    }
    fs::remove_file(desk.path().join(VIEW)).unwrap();
    assert_refused(
        &desk,
        "view-frontal.png`: it is not there; restore it, or `bless` again",
    );
    fs::create_dir(desk.path().join(VIEW)).unwrap();
    assert_refused(&desk, "it is no file");
}

#[test]
fn golden_toml() {
    let desk = blessed(&with_volumes("good"));
    for (text, words) in [
        (
            "[numbers]\nmn = { absolute = 1 }\n",
            "line 2: unknown field `mn`",
        ),
        ("[volumes]\nhu = -1\n", "`volumes.hu` is -1"),
        ("[volumes]\ncompare = 7\n", "line 2: "),
        ("[pictures\n", "line 1: "),
    ] {
        desk.write("golden/golden.toml", text);
        assert_refused(&desk, words);
        assert_refused(&desk, "`golden/golden.toml`");
        assert_refused(&desk, "correct it");
        let ran = super::bless(&desk).expect(2);
        assert!(ran.err.contains(words), "{ran:?}");
    }
    for nested in ["[", "{a="] {
        let text = format!("numbers = {}", nested.repeat(20_000));
        desk.write("golden/golden.toml", text);
        assert_refused(&desk, "line 1: ");
    }
    desk.write("golden/golden.toml", b"# \xff\n");
    assert_refused(&desk, "utf-8");
    desk.write("golden/golden.toml", "#".repeat(100_000));
    assert_refused(&desk, "larger than 65536 bytes");
}

#[test]
fn a_volume_that_is_kept_and_damaged() {
    let desk = Desk::new();
    desk.write("ct.nii.gz", crate::head::gzip(&crate::head::nifti()));
    let text = with_volumes("good").replace("\"nrrd\"", "\"nrrd\", \"displacement\"");
    desk.write("plan.toml", &text);
    desk.write("golden/golden.toml", "[volumes]\ncompare = \"voxels\"\n");
    super::bless(&desk).expect(0);
    // Otherwise they are the same by their hash, and not looked at.
    desk.write("plan.toml", text.replace("[2, 0, 0]", "[3, 0, 0]"));
    for name in ["volume.nii.gz", "volume.nrrd", "displacement.nii.gz"] {
        let name = format!("golden/good/both/01-move/{name}");
        let good = fs::read(desk.path().join(&name)).unwrap();
        for bytes in [
            Vec::new(),
            good[..good.len() / 2].to_vec(),
            vec![0x1f; 4000],
        ] {
            desk.write(&name, bytes);
            let ran = verify(&desk, &[]).expect(2);
            assert!(ran.err.contains(&name), "{name}: {ran:?}");
        }
        desk.write(&name, good);
    }
    verify(&desk, &[]).expect(5);
}

#[test]
#[cfg(unix)]
fn links_lead_nowhere() {
    use std::os::unix::fs::symlink;

    let desk = blessed(&with_all("good"));
    // A picture of somebody's, that would come into the report.
    let view = desk.path().join(VIEW);
    let private = desk.path().join("private.png");
    fs::rename(&view, &private).unwrap();
    symlink(&private, &view).unwrap();
    assert_refused(&desk, "view-frontal.png`: it is a link");
    fs::remove_file(&view).unwrap();
    fs::rename(&private, &view).unwrap();
    // A folder of somebody's, that would be written into.
    let plan = desk.path().join("golden/good");
    let elsewhere = desk.path().join("elsewhere");
    fs::rename(&plan, &elsewhere).unwrap();
    symlink(&elsewhere, &plan).unwrap();
    let before = desk.files("elsewhere");
    assert_refused(&desk, "`golden/good`: it is a link");
    let ran = super::bless(&desk).expect(2);
    assert!(ran.err.contains("`golden/good`: it is a link"), "{ran:?}");
    fs::remove_file(&plan).unwrap();
    fs::rename(&elsewhere, &plan).unwrap();
    let stage = desk.path().join("golden/good/both/01-move");
    fs::rename(&stage, &elsewhere).unwrap();
    symlink(&elsewhere, &stage).unwrap();
    let inside = desk.files("elsewhere");
    super::bless(&desk).expect(2);
    assert!(inside == desk.files("elsewhere") && inside.len() < before.len());
}
