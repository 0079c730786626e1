//! A plan file: read, decoded, and resolved once the grid of its CT is known.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use thiserror::Error;
use toml::de::DeTable;

use super::decode::{Faults, quote};
use super::diagnostic::{Code, Diagnostic, Diagnostics, Fault};
use super::duplicates;
use super::effective::{self, Found};
use super::raw::{Frame, RawPlan};
use super::resolve;
use super::resolved::{CtSource, Plan};
use super::source::{Located, Source, Span};
use crate::feature::{Landmark, Landmarks};
use crate::io::digest::sha256_hex;
use crate::io::landmarks::{self, CoordinateSystem};
use crate::space::{Grid, GridPoint};
use crate::text::shown_name;

/// The largest plan file, bytes: some two thousand candidates. Parsed, a text can take six hundred times its length
/// (tables in tables), so that this is also a bound of 150 MiB and of half a second.
pub const MAX_PLAN_BYTES: u64 = 256 << 10;

/// How many duplicate keys are traced to where they are given first.
const MAX_TRACED: usize = 50;

/// A plan as written: decoded, its faults noted, not yet resolved against a CT.
#[derive(Debug, Clone)]
pub struct PlanFile {
    source: Source,
    folder: PathBuf,
    sha256: String,
    /// Of the file that gives the landmarks, where there is one.
    landmarks_sha256: Option<String>,
    /// None where the text is not TOML, or of another version of the format.
    raw: Option<RawPlan>,
    /// The faults that can be told without the CT.
    faults: Faults,
}

/// Why a plan file cannot be read.
#[derive(Debug, Error)]
pub enum PlanReadError {
    /// There is no such file.
    #[error("there is no plan file {}", path.display())]
    Missing {
        /// The path given.
        path: PathBuf,
    },
    /// The path is a folder's.
    #[error("{} is a folder; a plan is a TOML file", path.display())]
    Folder {
        /// The path given.
        path: PathBuf,
    },
    /// The path is of a pipe or a device, which might never end.
    #[error("{} is a pipe or a device; write the plan to a file first", path.display())]
    NotAFile {
        /// The path given.
        path: PathBuf,
    },
    /// The system refuses.
    #[error("cannot read the plan file {}: {source}", path.display())]
    Unreadable {
        /// The path given.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// It is not a text file.
    #[error(
        "the plan file {} is not UTF-8 text: byte {offset} (counted from 0) belongs to no character; save it as UTF-8", path.display()
    )]
    NotUtf8 {
        /// The path given.
        path: PathBuf,
        /// The first byte that is not UTF-8, from 0.
        offset: usize,
    },
    /// It is far larger than any plan.
    #[error(
        "the plan file {} is larger than {MAX_PLAN_BYTES} bytes; is it a plan?", path.display()
    )]
    TooLarge {
        /// The path given.
        path: PathBuf,
    },
}

impl PlanFile {
    /// Reads and decodes a plan. Faults of the plan itself are not errors here: they are reported
    /// together by [`PlanFile::resolve`] or [`PlanFile::faults`].
    ///
    /// # Errors
    /// [`PlanReadError`] where there is no text to decode.
    pub fn read(path: &Path) -> Result<Self, PlanReadError> {
        let given = || path.to_owned();
        let unreadable = |source: io::Error| match source.kind() {
            io::ErrorKind::NotFound => PlanReadError::Missing { path: given() },
            io::ErrorKind::IsADirectory => PlanReadError::Folder { path: given() },
            _ => PlanReadError::Unreadable {
                path: given(),
                source,
            },
        };
        // Asked before opening: opening a pipe would wait for someone to write to it.
        let metadata = fs::metadata(path).map_err(unreadable)?;
        if metadata.is_dir() {
            return Err(PlanReadError::Folder { path: given() });
        }
        if !metadata.is_file() {
            return Err(PlanReadError::NotAFile { path: given() });
        }
        let file = File::open(path).map_err(unreadable)?;
        let mut bytes = Vec::new();
        let mut limited = file.take(MAX_PLAN_BYTES + 1);
        limited.read_to_end(&mut bytes).map_err(unreadable)?;
        if bytes.len() as u64 > MAX_PLAN_BYTES {
            return Err(PlanReadError::TooLarge { path: given() });
        }
        let text = std::str::from_utf8(&bytes).map_err(|error| PlanReadError::NotUtf8 {
            path: given(),
            offset: error.valid_up_to(),
        })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Ok(Self::from_text(shown_name(path.as_os_str()), folder, text))
    }

    /// Decodes the text of a plan, and reads the file of landmarks that it may name. `shown_name` names it
    /// in messages; paths in it are relative to `folder`.
    pub fn from_text(shown_name: impl Into<String>, folder: &Path, text: &str) -> Self {
        let sha256 = sha256_hex(text.as_bytes());
        let source = Source::new(shown_name.into(), text);
        let mut faults = Faults::default();
        let mut raw = decode(source.text(), &mut faults);
        let mut landmarks_sha256 = None;
        if let Some(raw) = &mut raw {
            resolve::misfits(raw, &mut faults);
            landmarks_sha256 = read_landmarks(raw, folder, &mut faults);
        }
        Self {
            source,
            folder: folder.to_owned(),
            sha256,
            landmarks_sha256,
            raw,
            faults,
        }
    }

    /// The name of the file, as the user gave it.
    pub fn shown_name(&self) -> &str {
        self.source.name()
    }

    /// SHA-256 of the file's bytes, hexadecimal.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// SHA-256 of the bytes of the file that gives the landmarks, hexadecimal; none where the plan itself
    /// does.
    pub fn landmarks_sha256(&self) -> Option<&str> {
        self.landmarks_sha256.as_deref()
    }

    /// The name of the plan, where it gives a valid one.
    pub fn name(&self) -> Option<&str> {
        Some(&self.raw.as_ref()?.name.as_ref()?.value)
    }

    /// Where the CT is, where the plan says so validly; the path is relative to the working folder.
    pub fn ct(&self) -> Option<CtSource> {
        let ct = self.raw.as_ref()?.ct.as_ref()?;
        Some(resolve::ct(ct, &self.folder))
    }

    /// The plan as it runs on a CT of this grid.
    ///
    /// # Errors
    /// Every fault of the plan, in the order of the file.
    pub fn resolve(&self, grid: &Grid) -> Result<Plan, Diagnostics> {
        self.resolve_raw(self.raw.as_ref(), grid)
    }

    /// The plan as it runs on a CT of this grid with some landmarks elsewhere: those that have a position
    /// here.
    ///
    /// # Errors
    /// As [`PlanFile::resolve`].
    pub fn resolve_moved(
        &self,
        grid: &Grid,
        moved: &Landmarks<Option<GridPoint>>,
    ) -> Result<Plan, Diagnostics> {
        let raw = self.raw.as_ref();
        let raw = raw.map(|raw| resolve::with_moved(raw, grid, moved));
        self.resolve_raw(raw.as_ref(), grid)
    }

    /// The plan with every value that a run of it used, as the text of a plan that gives the same results. `ran` is
    /// this plan, resolved, with its landmarks where the run moved them. The path of the CT stands as the plan gives
    /// it, without its folders where it is absolute; the points of a file of landmarks stand in its place.
    ///
    /// None where this is no plan that can run.
    pub fn effective(&self, ran: &Plan, found: Found<'_>) -> Option<String> {
        effective::plan(self.raw.as_ref()?, ran, found)
    }

    fn resolve_raw(&self, raw: Option<&RawPlan>, grid: &Grid) -> Result<Plan, Diagnostics> {
        let mut faults = self.faults.clone();
        let plan = raw.and_then(|raw| resolve::plan(raw, &self.folder, grid, &mut faults));
        plan.ok_or_else(|| Diagnostics::new(&self.source, faults))
    }

    /// The faults that can be told without the CT: all but those of positions in it.
    pub fn faults(&self) -> Diagnostics {
        let mut faults = self.faults.clone();
        if let Some(raw) = &self.raw {
            resolve::sides_of_voxels(&raw.landmarks, &mut faults);
        }
        Diagnostics::new(&self.source, faults)
    }

    /// A fault of the plan's name among other plans, at the line that gives it.
    pub fn name_fault(&self, message: impl Into<String>, hint: String) -> Diagnostic {
        let name = self.raw.as_ref().and_then(|raw| raw.name.as_ref());
        let place = name.map(|name| name.span).unwrap_or_default();
        let fault = Fault::new(Code::DuplicateName, place, message).hint(hint);
        Diagnostic::new(&self.source, fault)
    }

    /// A fault of the CT itself, at the line of the plan that names it.
    pub fn ct_fault(&self, message: impl Into<String>, hint: Option<String>) -> Diagnostic {
        let place = self.raw.as_ref().map(|raw| raw.ct_place);
        let fault = Fault::new(Code::Ct, place.unwrap_or_default(), message);
        Diagnostic::new(&self.source, fault.hint(hint))
    }
}

/// The plan as far as it can be decoded; none where nothing else can be said about the text than the
/// faults noted.
fn decode(text: &str, faults: &mut Faults) -> Option<RawPlan> {
    let (document, errors) = DeTable::parse_recoverable(text);
    let document = document.get_ref();
    // The parser goes on behind a syntax error, but guesses: only the first message is true.
    let (duplicates, syntax): (Vec<_>, Vec<_>) = errors
        .iter()
        .partition(|error| error.message() == duplicates::MESSAGE);
    if let Some(error) = syntax.first() {
        let span = error.span().map_or(Span::default(), Span::from);
        faults.push(syntax_fault(error.message(), text, span));
        return None;
    }
    for error in duplicates {
        let span = error.span().map_or(Span::default(), Span::from);
        let first = || duplicates::first_given(document, text, span);
        // Finding the first walks the document: not for every key of a file that is no plan.
        let first = (faults.list.len() < MAX_TRACED).then(first).flatten();
        faults.push(duplicates::fault(text, span, first));
    }
    RawPlan::decode(document, faults)
}

/// Puts the points of the landmark file, and their frame, where the plan's own would be: their place is
/// that of the path. Returns the SHA-256 of the file.
fn read_landmarks(raw: &mut RawPlan, folder: &Path, faults: &mut Faults) -> Option<String> {
    let Located { value: path, span } = raw.landmarks.file.clone()?;
    let file = match landmarks::read(&folder.join(&path)) {
        Ok(file) => file,
        Err(error) => {
            let found = quote(&path.to_string_lossy(), '"');
            let names = Landmark::ALL.map(|landmark| format!("`{landmark}`"));
            let expected = format!(
                "3D Slicer markups (.mrk.json or .fcsv) with points labelled {}",
                names.join(", ")
            );
            let fault = Fault::new(Code::LandmarkFile, span, error.to_string());
            faults.push(fault.found(found).expected(expected));
            return None;
        }
    };
    raw.landmarks.frame = Some(match file.system {
        CoordinateSystem::Lps => Frame::Lps,
        CoordinateSystem::Ras => Frame::Ras,
    });
    raw.landmarks.points = file.points.map(|value| Some(Located { value, span }));
    Some(file.sha256)
}

/// The first syntax error. The parser guesses by its first letter what a word without quotes should have
/// been, and takes nothing for such a word: both are put more plainly here.
fn syntax_fault(message: &str, text: &str, span: Span) -> Fault {
    let values = "text in double quotes, a number, `true` or `false`, an array or a table";
    let written = text.get(span.start..span.end).unwrap_or_default().trim();
    let before = text.get(..span.start).unwrap_or_default().trim_end();
    let is_value = before.ends_with(['=', '[', ',']);
    if is_value && written.is_empty() && message.starts_with("string values must be quoted") {
        let message = "this is not TOML: a value is missing";
        return Fault::new(Code::Syntax, span, message).expected(values);
    }
    let is_word = written.starts_with(|c: char| c.is_ascii_alphabetic())
        && written
            .chars()
            .all(|c| c.is_alphanumeric() || "_-./".contains(c));
    if is_value && is_word {
        let message = "this is not TOML: a word without quotes";
        let lower = written.to_ascii_lowercase();
        let hint = if ["true", "false"].contains(&lower.as_str()) {
            format!("write `{lower}`")
        } else {
            format!("write {}", quote(written, '"'))
        };
        let fault = Fault::new(Code::Syntax, span, message).found(quote(written, '`'));
        return fault.expected(values).hint(hint);
    }
    Fault::new(Code::Syntax, span, format!("this is not TOML: {message}"))
}
