//! What is wrong with a plan, as users read it and as scripts do.

use std::fmt;

use annotate_snippets::{AnnotationKind, Level, Origin, Renderer, Snippet};
use serde::Serialize;

use super::decode::Faults;
use super::source::{Excerpt, Source, Span};

/// The kinds of fault, for scripts: names stay, messages may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Code {
    /// The text is not TOML.
    Syntax,
    /// A key is given twice.
    DuplicateKey,
    /// No such key here.
    UnknownKey,
    /// A key that must be given is not.
    MissingKey,
    /// Keys that exclude each other, a key of another model, method or kind, or one of what is not drawn.
    Conflict,
    /// A value of the wrong type or shape.
    WrongType,
    /// A value outside what its key allows.
    BadValue,
    /// A name that is taken.
    DuplicateName,
    /// More of something than a plan may hold.
    TooMany,
    /// Part of the format, but not available in this version.
    NotAvailable,
    /// A point that is not in the volume.
    OutsideVolume,
    /// Landmarks the wrong way round.
    WrongSide,
    /// Landmarks of a head that lies in no way that a patient's does.
    Orientation,
    /// An edit that leaves no usable nose.
    BadEdit,
    /// The file of landmarks that the plan names cannot be used.
    LandmarkFile,
    /// The CT that the plan names cannot be used.
    Ct,
}

impl Code {
    /// The name, as it is printed and serialised.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Syntax => "syntax",
            Self::DuplicateKey => "duplicate-key",
            Self::UnknownKey => "unknown-key",
            Self::MissingKey => "missing-key",
            Self::Conflict => "conflict",
            Self::WrongType => "wrong-type",
            Self::BadValue => "bad-value",
            Self::DuplicateName => "duplicate-name",
            Self::TooMany => "too-many",
            Self::NotAvailable => "not-available",
            Self::OutsideVolume => "outside-volume",
            Self::WrongSide => "wrong-side",
            Self::Orientation => "orientation",
            Self::BadEdit => "bad-edit",
            Self::LandmarkFile => "landmark-file",
            Self::Ct => "ct",
        }
    }
}

/// One fault of a plan: where it is, what is wrong, and what would be right.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diagnostic {
    /// The kind of fault.
    pub code: Code,
    /// The plan file, as the user named it.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1, in characters.
    pub column: usize,
    /// What is wrong.
    pub message: String,
    /// What was found there, where that says more than the message.
    pub found: Option<String>,
    /// What would be right.
    pub expected: Option<String>,
    /// What to do, where that is plain.
    pub hint: Option<String>,
    #[serde(skip)]
    excerpt: Option<Excerpt>,
}

impl Diagnostic {
    pub(super) fn new(source: &Source, fault: Fault) -> Self {
        let position = source.position(fault.span);
        Self {
            code: fault.code,
            file: source.name().to_owned(),
            line: position.line,
            column: position.column,
            message: fault.message,
            found: fault.found,
            expected: fault.expected,
            hint: fault.hint,
            excerpt: source.excerpt(fault.span),
        }
    }

    /// The fault in the style of rustc: message, place, the line with the place marked, what was expected
    /// and what to do. Without a newline at the end. `color` adds ANSI escapes.
    pub fn render(&self, color: bool) -> String {
        let title = Level::ERROR
            .primary_title(self.message.as_str())
            .id(self.code.name());
        let found = self.found.as_ref().map(|found| format!("found {found}"));
        let mut group = match &self.excerpt {
            Some(Excerpt { line, span }) => title.element(
                Snippet::source(line.as_str())
                    .line_start(self.line)
                    .path(self.file.as_str())
                    .annotation(
                        AnnotationKind::Primary
                            .span(span.start..span.end)
                            .label(found.clone()),
                    ),
            ),
            None => title.element(
                Origin::path(self.file.as_str())
                    .line(self.line)
                    .char_column(self.column),
            ),
        };
        if let (None, Some(found)) = (&self.excerpt, found) {
            group = group.element(Level::NOTE.message(found));
        }
        if let Some(expected) = &self.expected {
            let level = Level::NOTE.with_name("expected");
            group = group.element(level.message(expected.as_str()));
        }
        if let Some(hint) = &self.hint {
            group = group.element(Level::HELP.message(hint.as_str()));
        }
        let renderer = if color {
            Renderer::styled()
        } else {
            Renderer::plain()
        };
        renderer.render(&[group])
    }
}

/// All faults of a plan, in the order of the file. Serialises as an array.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[serde(transparent)]
pub struct Diagnostics {
    list: Vec<Diagnostic>,
}

/// How many faults are reported at most. More come from a file that is not a plan.
const MAX_REPORTED: usize = 200;

impl Diagnostics {
    /// The faults in the order of the file; the first [`MAX_REPORTED`], and a line that counts the rest.
    pub(super) fn new(source: &Source, faults: Faults) -> Self {
        let Faults { list, dropped } = faults;
        let mut faults = list;
        // Stable, so that faults of one place stay in the order in which they were found.
        faults.sort_by_key(|fault| fault.span.start);
        let rest = faults.split_off(faults.len().min(MAX_REPORTED));
        if let Some(first) = rest.first() {
            let more = rest.len() + dropped;
            let message = format!("{more} more faults follow; they are not listed");
            faults.push(Fault::new(Code::TooMany, first.span, message));
        }
        let place = |fault| Diagnostic::new(source, fault);
        Self {
            list: faults.into_iter().map(place).collect(),
        }
    }

    /// Whether nothing is wrong.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Number of faults.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// The faults in the order of the file.
    pub fn iter(&self) -> std::slice::Iter<'_, Diagnostic> {
        self.list.iter()
    }

    /// Every fault as [`Diagnostic::render`], with an empty line between two and a newline at the end.
    pub fn render(&self, color: bool) -> String {
        let mut all = String::new();
        for (place, diagnostic) in self.list.iter().enumerate() {
            if place > 0 {
                all.push('\n');
            }
            all.push_str(&diagnostic.render(color));
            all.push('\n');
        }
        all
    }
}

impl From<Diagnostic> for Diagnostics {
    fn from(diagnostic: Diagnostic) -> Self {
        Self {
            list: vec![diagnostic],
        }
    }
}

/// Adds faults at the end, whatever their place.
impl Extend<Diagnostic> for Diagnostics {
    fn extend<I: IntoIterator<Item = Diagnostic>>(&mut self, more: I) {
        self.list.extend(more);
    }
}

impl IntoIterator for Diagnostics {
    type Item = Diagnostic;
    type IntoIter = std::vec::IntoIter<Diagnostic>;

    fn into_iter(self) -> Self::IntoIter {
        self.list.into_iter()
    }
}

impl<'a> IntoIterator for &'a Diagnostics {
    type Item = &'a Diagnostic;
    type IntoIter = std::slice::Iter<'a, Diagnostic>;

    fn into_iter(self) -> Self::IntoIter {
        self.list.iter()
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(self.render(false).trim_end())
    }
}

impl std::error::Error for Diagnostics {}

/// A fault before its place is turned into line and column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fault {
    pub code: Code,
    pub span: Span,
    pub message: String,
    pub found: Option<String>,
    pub expected: Option<String>,
    pub hint: Option<String>,
}

impl Fault {
    pub fn new(code: Code, span: Span, message: impl Into<String>) -> Self {
        Self {
            code,
            span,
            message: message.into(),
            found: None,
            expected: None,
            hint: None,
        }
    }

    pub fn found(mut self, found: impl Into<String>) -> Self {
        self.found = Some(found.into());
        self
    }

    pub fn expected(mut self, expected: impl Into<String>) -> Self {
        self.expected = Some(expected.into());
        self
    }

    pub fn hint(mut self, hint: impl Into<Option<String>>) -> Self {
        self.hint = hint.into();
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str, start: usize, end: usize) -> Diagnostic {
        let source = Source::new("my plan.toml".to_owned(), text);
        let fault = Fault::new(Code::BadValue, Span { start, end }, "the message")
            .found("the finding")
            .expected("the expectation")
            .hint("the hint".to_owned());
        Diagnostic::new(&source, fault)
    }

    #[test]
    fn the_printed_place_is_the_reported_place() {
        // Tabs and wide characters before the place, a place of no width, and a place at the end.
        for (text, start, end) in [
            ("a = 1\n\tkey = 12\n", 13, 15),
            ("t = \"日本\"; x = 3", 14, 15),
            ("a = 1", 5, 5),
            ("a = 1\n", 6, 6),
            ("", 0, 0),
        ] {
            let fault = fault(text, start, end);
            let place = format!("my plan.toml:{}:{}\n", fault.line, fault.column);
            let shown = fault.render(false);
            assert!(shown.contains(&place), "{place} is not in\n{shown}");
            for part in [
                "error[bad-value]: the message",
                "found the finding",
                "expected: the expectation",
                "help: the hint",
            ] {
                assert!(shown.contains(part), "{part} is not in\n{shown}");
            }
        }
    }

    #[test]
    fn long_lines_are_placed_and_not_quoted() {
        let text = format!("a = \"{}\" b", "x".repeat(1000));
        let shown = fault(&text, 1007, 1008).render(false);
        assert!(shown.contains("my plan.toml:1:1008"), "{shown}");
        assert!(shown.contains("found the finding"), "{shown}");
        assert!(!shown.contains("xxxx"), "{shown}");
    }

    #[test]
    fn colour_is_only_there_when_asked_for() {
        let fault = fault("a = 1", 4, 5);
        assert!(!fault.render(false).contains('\u{1b}'));
        assert!(fault.render(true).contains('\u{1b}'));
    }

    #[test]
    fn faults_are_sorted_and_counted() {
        let source = Source::new("p".to_owned(), &"line\n".repeat(500));
        let faults = (0..300)
            .rev()
            .map(|n| {
                let span = Span {
                    start: n * 5,
                    end: n * 5 + 1,
                };
                Fault::new(Code::BadValue, span, format!("fault {n}"))
            })
            .collect();
        let all = Diagnostics::new(
            &source,
            Faults {
                list: faults,
                dropped: 0,
            },
        );
        assert_eq!(all.len(), MAX_REPORTED + 1);
        assert!(all.iter().is_sorted_by_key(|diagnostic| diagnostic.line));
        let last = all.iter().last().unwrap();
        assert_eq!(last.message, "100 more faults follow; they are not listed");
    }
}
