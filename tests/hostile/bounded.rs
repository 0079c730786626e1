//! The program on one hostile file: within 200 MiB, at once, with one clear error, and without harm to what earlier
//! runs wrote.

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::head::{CANDIDATES, nifti, plan};
use crate::noise::{AT_ONCE, MEMORY_KIB, limited, tell};
use crate::process::Desk;

/// How a file is treated.
#[derive(Debug, Clone)]
pub enum Expect {
    /// It is read, without a word.
    Read,
    /// It is refused, in these words.
    Refused(&'static [&'static str]),
}

/// What is named on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    Ct,
    Landmarks,
    Plan,
}

impl Role {
    /// The exit code for a file of this role that cannot be used.
    fn code(self) -> i32 {
        match self {
            Self::Ct => 3,
            Self::Landmarks | Self::Plan => 2,
        }
    }
}

/// How a process ended.
#[derive(Debug)]
pub struct Ended {
    pub code: i32,
    pub document: Value,
    pub err: String,
}

/// A desk with a sound CT, a plan for it, and the outputs of earlier runs.
pub struct Bench {
    pub desk: Desk,
    before: BTreeMap<String, Vec<u8>>,
    /// Where the streams go: a pipe would fill.
    streams: tempfile::TempDir,
}

impl Bench {
    pub fn new() -> Self {
        let desk = Desk::new();
        desk.write("ct.nii", nifti());
        desk.write("good.toml", plan("good", "ct.nii"));
        // Where a plan named `good` writes, and something of another's.
        for name in ["run.json", "both/01-move/volume.nii.gz", "up/mine.txt"] {
            desk.write(&format!("out/good/{name}"), format!("earlier {name}"));
        }
        let before = desk.files("out");
        Self {
            desk,
            before,
            streams: tempfile::tempdir().unwrap(),
        }
    }

    pub fn path(&self) -> &Path {
        self.desk.path()
    }

    /// Runs the program within its bounds.
    #[track_caller]
    pub fn run(&self, args: &[&OsStr]) -> Ended {
        self.run_as(&[], MEMORY_KIB, args)
    }

    /// As [`Bench::run`], through a program that starts it as someone else.
    #[track_caller]
    pub fn run_as(&self, user: &[&str], memory_kib: u64, args: &[&OsStr]) -> Ended {
        let [out, err] = ["out", "err"].map(|name| self.streams.path().join(name));
        let mut child = limited(memory_kib)
            .args(user)
            .arg(env!("CARGO_BIN_EXE_rhinoplan"))
            .args(args)
            // The stacks of a machine of a hundred processors are not what is measured.
            .args(["--json", "--threads", "2"])
            .current_dir(self.path())
            .stdin(Stdio::null())
            .stdout(File::create(&out).unwrap())
            .stderr(File::create(&err).unwrap())
            .spawn()
            .unwrap();
        let start = Instant::now();
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            if start.elapsed() > AT_ONCE {
                child.kill().unwrap();
                child.wait().unwrap();
                panic!("{args:?} did not end within {AT_ONCE:?}");
            }
            sleep(Duration::from_millis(2));
        };
        let [out, err] = [out, err].map(|path| String::from_utf8(fs::read(path).unwrap()).unwrap());
        Ended {
            code: status.code().unwrap_or(-1),
            document: serde_json::from_str(&out).unwrap_or(Value::Null),
            err,
        }
    }

    /// Every command that reads a file of this role, on `file`, a name in the desk's folder.
    #[track_caller]
    pub fn expect(&self, role: Role, file: impl AsRef<OsStr>, expect: &Expect) {
        let file = file.as_ref();
        let mut commands: Vec<Vec<OsString>> = Vec::new();
        let owned = |args: &[&str]| args.iter().map(OsString::from).collect::<Vec<_>>();
        let refused = matches!(expect, Expect::Refused(_));
        // What is read would be computed: `check` is enough then.
        let run = if refused { "run" } else { "check" };
        match role {
            Role::Ct => {
                commands.push(vec!["info".into(), file.to_owned()]);
                // A path in a plan is text.
                if let Some(name) = file.to_str() {
                    self.desk.write("hostile.toml", plan("good", name));
                    commands.push(owned(&[run, "hostile.toml"]));
                }
            }
            Role::Landmarks => {
                let [command, option, ct] = ["landmarks", "--ct", "ct.nii"].map(OsString::from);
                commands.push(vec![command, file.to_owned(), option, ct]);
                if let Some(name) = file.to_str() {
                    self.desk.write("hostile.toml", plan_with_file(name));
                    commands.push(owned(&[run, "hostile.toml"]));
                }
            }
            Role::Plan => {
                commands.push(vec!["check".into(), file.to_owned()]);
                commands.push(vec![run.into(), file.to_owned()]);
            }
        }
        for command in commands {
            let args: Vec<&OsStr> = command.iter().map(OsString::as_os_str).collect();
            let ended = self.run(&args);
            self.judge(role, file, expect, &ended);
        }
    }

    #[track_caller]
    fn judge(&self, role: Role, file: &OsStr, expect: &Expect, ended: &Ended) {
        let name = file.to_string_lossy();
        let errors = ended.document["errors"].as_array();
        let errors = errors.unwrap_or_else(|| panic!("{name}: no document: {ended:?}"));
        match expect {
            Expect::Read => {
                assert_eq!((ended.code, errors.len()), (0, 0), "{name}: {ended:?}");
            }
            Expect::Refused(words) => {
                assert_eq!(ended.code, role.code(), "{name}: {ended:?}");
                // A plan may have several faults, each at its place.
                let one = errors.len() == 1 || role == Role::Plan && !errors.is_empty();
                assert!(one, "{name}: {ended:?}");
                for words in *words {
                    assert!(ended.err.contains(words), "{words} is not in: {ended:?}");
                }
                let message = errors[0]["message"].as_str().unwrap_or_default();
                assert!(!message.is_empty(), "{ended:?}");
                assert!(ended.err.contains(&*shown(&name)), "{name}: {ended:?}");
            }
        }
        assert!(!ended.err.contains("panicked"), "{ended:?}");
        // Fifty faults of a plan at their places.
        assert!(ended.err.len() < 100_000, "{} bytes", ended.err.len());
        let steers = |c: char| c.is_control() && c != '\n';
        assert!(!ended.err.contains(steers), "{:?}", ended.err);
        self.assert_unharmed(&name);
    }

    /// What earlier runs wrote is as it was, and nothing is beside it.
    #[track_caller]
    pub fn assert_unharmed(&self, name: &str) {
        assert!(self.desk.files("out") == self.before, "outputs, {name}");
    }

    /// Bytes as a file of this name, and what becomes of them.
    #[track_caller]
    pub fn try_bytes(&self, role: Role, name: &str, bytes: impl AsRef<[u8]>, expect: &Expect) {
        self.desk.write(name, bytes);
        self.expect(role, name, expect);
        fs::remove_file(self.path().join(name)).unwrap();
    }
}

/// As the program shows a name.
fn shown(name: &str) -> String {
    let control = |c: char| c.is_control();
    if name.contains(control) {
        name.escape_default().to_string()
    } else {
        name.to_owned()
    }
}

/// A plan whose landmarks are in a file.
pub fn plan_with_file(file: &str) -> String {
    format!(
        "plan = 1\nname = \"good\"\n[ct]\npath = \"ct.nii\"\n[landmarks]\nfile = \"{file}\"\n{CANDIDATES}"
    )
}

/// What starts a program as a user who may not read everything: nothing where this user may not either, none where
/// there is no way.
pub fn as_nobody(bench: &Bench) -> Option<Vec<&'static str>> {
    let secret = bench.desk.write("secret", "x");
    lock(&secret);
    if fs::read(&secret).is_err() {
        return Some(Vec::new());
    }
    let user = [
        "setpriv",
        "--reuid=65534",
        "--regid=65534",
        "--clear-groups",
    ];
    open(bench.path());
    let started = Command::new(user[0])
        .args(&user[1..])
        .args([env!("CARGO_BIN_EXE_rhinoplan"), "--version"])
        .stdin(Stdio::null())
        .output();
    if started.is_ok_and(|output| output.status.success()) {
        return Some(user.to_vec());
    }
    tell("skipped: this user may read every file, and `setpriv` starts nothing as another");
    None
}

/// A file that nobody but root may read.
pub fn lock(path: &Path) {
    set_mode(path, 0o000);
}

/// A folder that everyone may look into.
pub fn open(path: &Path) {
    set_mode(path, 0o755);
}

#[cfg(unix)]
fn set_mode(path: &Path, mode: u32) {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
}

/// The limit is one: what needs more does not get it, and nobody calls that a bug.
#[test]
fn the_limit_of_memory_is_one() {
    let bench = Bench::new();
    let args = ["phantom", "-o", "head.nii"].map(OsStr::new);
    // The head has 31 MB.
    let ended = bench.run_as(&[], 24 << 10, &args);
    assert_ne!(ended.code, 0, "{ended:?}");
    assert!(!bench.path().join("head.nii").exists());
    let ended = bench.run_as(&[], MEMORY_KIB, &[OsStr::new("info"), OsStr::new("ct.nii")]);
    assert_eq!(ended.code, 0, "{ended:?}");
}
