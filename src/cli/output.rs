//! Where text goes: results to stdout, the rest to stderr, and one JSON document instead of either.

use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, PoisonError};

use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::exec::ExitCode;
use crate::plan::Diagnostic;
use crate::text::printable;

/// Collects the document where there is to be one, and prints the rest.
pub(super) struct Output {
    json: bool,
    quiet: bool,
    document: Mutex<Map<String, Value>>,
}

impl Output {
    pub fn new(json: bool, quiet: bool) -> Self {
        // Scripts can rely on these two being there.
        let lists = ["warnings", "errors"].map(|key| (key.to_owned(), json!([])));
        Self {
            json,
            quiet,
            document: Mutex::new(Map::from_iter(lists)),
        }
    }

    /// Whether progress may be drawn.
    pub fn shows_progress(&self) -> bool {
        !self.quiet && io::stderr().is_terminal()
    }

    /// What the user asked for: stdout, or stderr where stdout is for the document.
    pub fn result(&self, text: &str) {
        if self.json {
            self.note(text);
        } else {
            print_message(io::stdout(), text);
        }
    }

    /// What the user may want to know.
    pub fn note(&self, text: &str) {
        if !self.quiet {
            print_message(io::stderr(), text);
        }
    }

    /// What the user should know.
    pub fn warning(&self, text: &str) {
        self.note(&format!("warning: {text}"));
        self.push("warnings", text);
    }

    /// Why something was not done.
    pub fn error(&self, text: &str) {
        print_message(io::stderr(), &format!("error: {text}"));
        self.record_error(text);
    }

    /// The same where it is already printed.
    pub fn record_error(&self, text: &str) {
        self.push("errors", json!({ "message": text }));
    }

    /// A fault at its place in a plan.
    pub fn fault(&self, fault: &Diagnostic) {
        print_line(
            io::stderr(),
            &format!("{}\n", fault.render(io::stderr().is_terminal())),
        );
        self.push("errors", fault);
    }

    /// Adds to a list of the document.
    pub fn push(&self, list: &str, item: impl Serialize) {
        let item = serde_json::to_value(item).unwrap_or(Value::Null);
        self.with_document(|document| {
            let list = document
                .entry(list)
                .or_insert_with(|| Value::Array(Vec::new()));
            if let Value::Array(items) = list {
                items.push(item);
            }
        });
    }

    /// Sets a value of the document.
    pub fn set(&self, key: &str, item: impl Serialize) {
        let item = serde_json::to_value(item).unwrap_or(Value::Null);
        self.with_document(|document| {
            document.insert(key.to_owned(), item);
        });
    }

    /// Prints the document, where there is to be one.
    pub fn finish(&self, code: ExitCode) -> ExitCode {
        if self.json {
            self.set("exit_code", code as u8);
            self.with_document(|document| {
                let text = serde_json::to_string_pretty(document).unwrap_or_default();
                print_line(io::stdout(), &text);
            });
        }
        code
    }

    fn with_document(&self, work: impl FnOnce(&mut Map<String, Value>)) {
        let mut document = self.document.lock().unwrap_or_else(PoisonError::into_inner);
        work(&mut document);
    }
}

/// A reader that closed its end (`| head`) is no error.
fn print_line(mut to: impl Write, text: &str) {
    let _ = writeln!(to, "{text}");
}

/// As [`print_line`], of text that may hold the names of files.
fn print_message(to: impl Write, text: &str) {
    print_line(to, &printable(text));
}
