//! The program started in a folder of its own.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use serde_json::Value;

/// How a process ended and what it printed.
#[derive(Debug)]
pub struct Ran {
    pub code: i32,
    pub out: String,
    pub err: String,
}

impl Ran {
    /// The one JSON document on stdout.
    pub fn document(&self) -> Value {
        let document: Value = serde_json::from_str(&self.out)
            .unwrap_or_else(|error| panic!("not one JSON document: {error}\n{self:?}"));
        assert_eq!(document["exit_code"], self.code, "{self:?}");
        assert!(document["errors"].is_array(), "{self:?}");
        document
    }

    #[track_caller]
    pub fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, code, "{self:?}");
        self
    }
}

/// A working folder that goes away with the test.
pub struct Desk(tempfile::TempDir);

impl Desk {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, content).unwrap();
        path
    }

    /// The program, here, with its streams caught: never a terminal.
    pub fn run(&self, args: &[&str]) -> Ran {
        self.start(args).end()
    }

    /// The same, with the environment variable CI set to `value`.
    pub fn run_in_ci(&self, value: &str, args: &[&str]) -> Ran {
        self.run_with("CI", value, args)
    }

    /// The same, with an environment variable.
    pub fn run_with(&self, variable: &str, value: &str, args: &[&str]) -> Ran {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rhinoplan"));
        self.spawn(command.args(args).env(variable, value)).end()
    }

    /// The same, while it runs.
    pub fn start(&self, args: &[&str]) -> Started {
        self.spawn(Command::new(env!("CARGO_BIN_EXE_rhinoplan")).args(args))
    }

    /// The program in a shell that has run `before`.
    #[cfg(unix)]
    pub fn run_after(&self, before: &str, args: &[&str]) -> Ran {
        let script = format!("{before}; exec \"$0\" \"$@\"");
        let mut shell = Command::new("sh");
        shell.args(["-c", &script, env!("CARGO_BIN_EXE_rhinoplan")]);
        self.spawn(shell.args(args)).end()
    }

    fn spawn(&self, command: &mut Command) -> Started {
        let command = command.current_dir(self.path()).stdin(Stdio::null());
        // These tests may run where it is set, and it changes what the program does: `run_in_ci` sets it.
        let command = if command.get_envs().any(|(name, _)| name == "CI") {
            command
        } else {
            command.env_remove("CI")
        };
        let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
        Started(command.spawn().unwrap())
    }

    /// As [`Desk::everything`], without what a run notes for the next.
    pub fn files(&self, folder: &str) -> BTreeMap<String, Vec<u8>> {
        let mut files = self.everything(folder);
        files.retain(|name, _| !name.contains(".rhinoplan.kept/"));
        files
    }

    /// Every file in a folder, hidden ones too, by its path there; of a folder without files, its name.
    pub fn everything(&self, folder: &str) -> BTreeMap<String, Vec<u8>> {
        let mut files = BTreeMap::new();
        let root = self.path().join(folder);
        let mut open = vec![root.clone()];
        while let Some(folder) = open.pop() {
            let entries: Vec<_> = fs::read_dir(&folder)
                .unwrap()
                .map(|e| e.unwrap().path())
                .collect();
            if entries.is_empty() && folder != root {
                files.insert(format!("{}/", name(&root, &folder)), Vec::new());
            }
            for entry in entries {
                if entry.is_dir() {
                    open.push(entry);
                } else {
                    files.insert(name(&root, &entry), fs::read(&entry).unwrap());
                }
            }
        }
        files
    }

    /// As [`Desk::files`], without the one file that is never the same twice.
    pub fn results(&self, folder: &str) -> BTreeMap<String, Vec<u8>> {
        let mut files = self.files(folder);
        assert!(files.remove("timings.json").is_some());
        files
    }

    /// As [`Desk::everything`], without the one file that is never the same twice.
    pub fn results_and_notes(&self, folder: &str) -> BTreeMap<String, Vec<u8>> {
        let mut files = self.everything(folder);
        assert!(files.remove("timings.json").is_some());
        files
    }

    pub fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path().join(name)).unwrap()).unwrap()
    }
}

fn name(root: &Path, path: &Path) -> String {
    path.strip_prefix(root)
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned()
}

/// The program at work.
pub struct Started(Child);

impl Started {
    pub fn id(&self) -> u32 {
        self.0.id()
    }

    pub fn has_ended(&mut self) -> bool {
        self.0.try_wait().unwrap().is_some()
    }

    /// As `kill -9` does; nothing where it has ended.
    pub fn kill(&mut self) {
        self.0.kill().unwrap();
    }

    /// Waits for its end.
    pub fn end(self) -> Ran {
        let output = self.0.wait_with_output().unwrap();
        let ran = Ran {
            code: output.status.code().unwrap_or(-1),
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        };
        for text in [&ran.out, &ran.err] {
            assert!(
                !text.contains(['\u{1b}', '\r']),
                "made for a terminal: {ran:?}"
            );
        }
        ran
    }
}

/// The names alone.
pub fn names(files: &BTreeMap<String, Vec<u8>>) -> Vec<&str> {
    files.keys().map(String::as_str).collect()
}
