//! What is named where a file should be, and is none, or cannot be opened, or has an odd name.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use crate::bounded::{Bench, Expect, Role, as_nobody, lock, open};
use crate::dicom_builder::{head_slices, stack};
use crate::noise::tell;
use crate::{fcsv, head, json, nrrd};

const PIPE: Expect = Expect::Refused(&["a pipe or a device"]);
const LOOP: Expect = Expect::Refused(&["Too many levels of symbolic links"]);

/// A name for each format, what the program takes it for, and a sound file.
fn formats() -> [(&'static str, Role, Vec<u8>); 5] {
    [
        ("hostile.nii", Role::Ct, head::nifti()),
        ("hostile.nrrd", Role::Ct, nrrd::head_file()),
        ("hostile.mrk.json", Role::Landmarks, json::sound().into()),
        ("hostile.fcsv", Role::Landmarks, fcsv::sound().into()),
        (
            "hostile-plan.toml",
            Role::Plan,
            head::plan("good", "ct.nii").into(),
        ),
    ]
}

fn make_pipe(path: &Path) {
    let made = Command::new("mkfifo").arg(path).status().unwrap();
    assert!(made.success());
}

#[test]
fn paths_that_are_no_files() {
    for (name, role, _) in formats() {
        let bench = Bench::new();
        let path = bench.path().join(name);
        let missing: &[&str] = match role {
            Role::Plan => &["there is no plan file"],
            Role::Ct | Role::Landmarks => &["cannot be read", "No such file"],
        };
        bench.expect(role, name, &Expect::Refused(missing));

        fs::create_dir(&path).unwrap();
        let folder: &[&str] = match role {
            // A folder is one of DICOM slices.
            Role::Ct => &["holds no CT series: it is empty"],
            Role::Landmarks | Role::Plan => &["is a folder"],
        };
        bench.expect(role, name, &Expect::Refused(folder));
        fs::remove_dir(&path).unwrap();

        make_pipe(&path);
        bench.expect(role, name, &PIPE);
        fs::remove_file(&path).unwrap();

        if cfg!(target_os = "linux") {
            symlink("/dev/zero", &path).unwrap();
            bench.expect(role, name, &PIPE);
            fs::remove_file(&path).unwrap();
        }

        symlink("nowhere", &path).unwrap();
        bench.expect(role, name, &Expect::Refused(missing));
        fs::remove_file(&path).unwrap();

        symlink(name, &path).unwrap();
        bench.expect(role, name, &LOOP);
        fs::remove_file(&path).unwrap();

        bench.desk.write(name, "");
        // An empty plan is one that gives nothing.
        let empty: &[&str] = match role {
            Role::Plan => &["missing", "`plan`"],
            Role::Ct | Role::Landmarks => &["is empty"],
        };
        bench.expect(role, name, &Expect::Refused(empty));
    }
}

#[test]
fn files_that_may_not_be_read() {
    let probe = Bench::new();
    let Some(user) = as_nobody(&probe) else {
        return;
    };
    for (name, role, bytes) in formats() {
        let bench = Bench::new();
        open(bench.path());
        lock(&bench.desk.write(name, bytes));
        bench.desk.write("points.toml", head::plan("good", name));
        let args: &[&str] = match role {
            Role::Ct => &["info", name],
            Role::Landmarks => &["landmarks", name, "--ct", "ct.nii"],
            Role::Plan => &["check", name],
        };
        let args: Vec<&OsStr> = args.iter().map(OsStr::new).collect();
        let ended = bench.run_as(&user, 200 << 10, &args);
        let code = if role == Role::Ct { 3 } else { 2 };
        assert_eq!(ended.code, code, "{ended:?}");
        assert!(ended.err.contains("Permission denied"), "{ended:?}");
        assert!(ended.err.contains(name), "{ended:?}");
        bench.assert_unharmed(name);
    }
    // A slice of a series, and the folder of one.
    let bench = Bench::new();
    open(bench.path());
    for (index, slice) in stack(3).iter().enumerate() {
        bench
            .desk
            .write(&format!("series/{index}.dcm"), slice.bytes());
    }
    let folder = bench.path().join("series");
    open(&folder);
    lock(&folder.join("1.dcm"));
    for (name, shown) in [("series", "`1.dcm`"), ("series/1.dcm", "1.dcm")] {
        let ended = bench.run_as(&user, 200 << 10, &["info", name].map(OsStr::new));
        assert_eq!(ended.code, 3, "{ended:?}");
        assert!(ended.err.contains("Permission denied"), "{ended:?}");
        assert!(ended.err.contains(shown), "{ended:?}");
    }
    lock(&folder);
    let ended = bench.run_as(&user, 200 << 10, &["info", "series"].map(OsStr::new));
    assert_eq!(ended.code, 3, "{ended:?}");
    assert!(ended.err.contains("Permission denied"), "{ended:?}");
    open(&folder);
}

/// Names in Latin-1, with a line break, with what a terminal obeys, beginning like an option: read, and shown
/// without harm.
#[test]
fn names_that_are_odd() {
    let odd: [&[u8]; 4] = [
        b"Nase-gek\xfcrzt",
        b"two\nlines",
        b"\x1b[31mred\x07",
        "Größe 大 (1)".as_bytes(),
    ];
    for (name, role, bytes) in formats() {
        for odd in odd {
            let bench = Bench::new();
            let file = OsStr::from_bytes(odd);
            if fs::write(bench.path().join(file), &bytes).is_err() {
                tell(&format!("skipped: this disk has no name {file:?}"));
                continue;
            }
            let expect = if role == Role::Ct { "info" } else { "check" };
            let args: Vec<OsString> = match role {
                Role::Landmarks => vec![
                    "landmarks".into(),
                    file.into(),
                    "--ct".into(),
                    "ct.nii".into(),
                ],
                _ => vec![expect.into(), file.into()],
            };
            let args: Vec<&OsStr> = args.iter().map(OsString::as_os_str).collect();
            let ended = bench.run(&args);
            assert_eq!(ended.code, 0, "{name} as {file:?}: {ended:?}");
            assert_printable(&ended.err);
            // Damaged, the name is part of the error.
            fs::write(bench.path().join(file), b"\x00").unwrap();
            let ended = bench.run(&args);
            assert!([2, 3].contains(&ended.code), "{name}: {ended:?}");
            let errors = ended.document["errors"].as_array().unwrap();
            assert!(!errors.is_empty(), "{ended:?}");
            assert_printable(&ended.err);
        }
    }
}

fn assert_printable(text: &str) {
    assert!(
        !text.contains(|c: char| c.is_control() && c != '\n'),
        "{text:?}"
    );
}

/// Slices are opened by the names that the system gives, whatever they are.
#[test]
fn a_series_in_files_and_a_folder_of_odd_names() {
    let bench = Bench::new();
    let folder = bench.path().join(OsStr::from_bytes(b"Serie \xe4\x1b[2J"));
    fs::create_dir(&folder).unwrap();
    let slices = head_slices();
    for (index, slice) in slices.iter().enumerate() {
        let mut name = b"\xff\xfe\x07 ".to_vec();
        name.extend(index.to_string().bytes());
        fs::write(folder.join(OsStr::from_bytes(&name)), slice.bytes()).unwrap();
    }
    fs::write(folder.join(OsStr::from_bytes(b"\xfc\x1b[31m")), "hello").unwrap();
    make_pipe(&folder.join("pipe"));
    symlink("round", folder.join("round")).unwrap();
    let ended = bench.run(&[OsStr::new("info"), folder.as_os_str()]);
    assert_eq!(ended.code, 0, "{ended:?}");
    assert_printable(&ended.err);
    assert_eq!(ended.document["series"][0]["files"], slices.len());
    let others = ended.document["other_files"].to_string();
    for what in ["a pipe", "a link that leads nowhere", "no DICOM file"] {
        assert!(others.contains(what), "{others}");
    }
    // One slice stands for its series.
    let one = folder.join(OsStr::from_bytes(b"\xff\xfe\x07 7"));
    let ended = bench.run(&[OsStr::new("info"), one.as_os_str()]);
    assert_eq!(ended.code, 0, "{ended:?}");
    // Damaged, it is named.
    fs::write(&one, &slices[7].bytes()[..400]).unwrap();
    let ended = bench.run(&[OsStr::new("info"), folder.as_os_str()]);
    assert_eq!(ended.code, 3, "{ended:?}");
    assert!(
        ended.err.contains("file `\u{fffd}\u{fffd}\\u{7} 7`"),
        "{ended:?}"
    );
    assert_printable(&ended.err);
}

/// An output folder with a name that is no text is written to, and told of.
#[test]
fn an_output_folder_with_an_odd_name() {
    let bench = Bench::new();
    let out = OsStr::from_bytes(b"Ausgabe \xfc\x1b[31m");
    if fs::create_dir(bench.path().join(out)).is_err() {
        tell(&format!("skipped: this disk has no name {out:?}"));
        return;
    }
    let ended = bench.run(
        &["run", "good.toml", "--out"]
            .map(OsStr::new)
            .iter()
            .copied()
            .chain([out])
            .collect::<Vec<_>>(),
    );
    assert_eq!(ended.code, 0, "{ended:?}");
    assert!(bench.path().join(out).join("good/run.json").exists());
    assert_eq!(ended.document["runs"].as_array().map(Vec::len), Some(1));
    assert_printable(&ended.err);
}

/// What a header or a plan points to is held to the same.
#[test]
fn files_that_other_files_name() {
    let bench = Bench::new();
    make_pipe(&bench.path().join("pipe.raw"));
    symlink("round.raw", bench.path().join("round.raw")).unwrap();
    for (data, words) in [
        ("pipe.raw", "is a pipe or a device"),
        ("round.raw", "Too many levels of symbolic links"),
        (
            "none\r\u{1b}[31m",
            "data file `none\\r\\u{1b}[31m` cannot be read",
        ),
        ("../ct.nii", "one file in the header's own folder"),
        ("/dev/zero", "one file in the header's own folder"),
    ] {
        let header = nrrd::detached(data);
        bench.desk.write("hostile.nhdr", header);
        let words: &'static [&'static str] = Box::leak(Box::new([words]));
        bench.expect(Role::Ct, "hostile.nhdr", &Expect::Refused(words));
    }
}
