//! The plan as written: every value decoded, none resolved.
//!
//! Decoding needs no CT. What is absent or wrong is `None` here, and its fault is noted; defaults and
//! frames are the next step's.

mod accept;
mod candidates;
mod settings;
mod sweeps;
mod views;

use std::path::PathBuf;

use toml::de::DeTable;

use super::decode::{Faults, Table, Value, describe, quote, small_integer};
use super::diagnostic::{Code, Fault};
use super::format::{self, FORMAT, MAX_NAME, MAX_TITLE, MAX_UID};
use super::resolved::{Enhance, MeshSettings, Morph, Outputs, Phantom, Segment, Views};
use super::source::{Located, Span};
use crate::compare::Accept;
use crate::feature::{FeatureKind, Landmark, Landmarks};

pub(super) use candidates::{LINE_EDITS, RawCandidate, RawEdit, RawStage, RawVector};
pub(super) use settings::RawLength;
pub(super) use sweeps::{RawSweep, RawVary};

/// A plan as written.
#[derive(Debug, Clone)]
pub(super) struct RawPlan {
    pub name: Option<Located<String>>,
    pub title: Option<String>,
    pub ct: Option<RawCt>,
    /// Where faults of the CT are shown: the path or the name that was given, else what should have
    /// given it.
    pub ct_place: Span,
    pub landmarks: RawLandmarks,
    pub cage_depth: Option<RawLength>,
    pub f1_root: Option<Located<[f64; 3]>>,
    pub f1_kind: FeatureKind,
    pub enhance: Enhance,
    pub segment: Segment,
    pub morph: Morph,
    /// Those of the sweeps included.
    pub candidates: Vec<RawCandidate>,
    pub sweeps: Vec<RawSweep>,
    pub outputs: Outputs,
    pub views: Option<Views>,
    pub mesh: Option<MeshSettings>,
    pub accept: Option<Accept>,
}

/// Where the voxels come from, paths as written.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum RawCt {
    File {
        path: PathBuf,
        sha256: Option<String>,
        series: Option<String>,
    },
    Phantom(Phantom),
}

/// What the numbers of a landmark mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Frame {
    /// LPS-ordered, 0-based continuous voxel index.
    Voxel,
    /// Patient mm, DICOM and ITK.
    Lps,
    /// Patient mm, NIfTI.
    Ras,
}

impl Frame {
    /// The word that plans use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Voxel => "voxel",
            Self::Lps => "lps",
            Self::Ras => "ras",
        }
    }
}

/// The landmarks in the frame in which they are written.
#[derive(Debug, Clone)]
pub(super) struct RawLandmarks {
    /// The file that gives frame and points, its path as written.
    pub file: Option<Located<PathBuf>>,
    pub frame: Option<Frame>,
    pub points: Landmarks<Option<Located<[f64; 3]>>>,
    /// How far the landmarks of the skin may be from it to be moved onto it, mm.
    pub snap_mm: Option<f64>,
}

/// A point, as messages ask for it.
const POINT: &str = "three numbers in the landmarks' frame, [x, y, z]";

impl RawPlan {
    /// Decodes a document. None where it is of a version whose keys may mean something else.
    pub fn decode(document: &DeTable<'_>, faults: &mut Faults) -> Option<Self> {
        // A missing key has no place; the first key of the file stands for the file.
        let first = document
            .keys()
            .map(|key| key.span())
            .min_by_key(|span| span.start);
        let span = first.map_or(Span::default(), Span::from);
        if document
            .get("plan")
            .is_some_and(|version| !is_supported(version, faults))
        {
            return None;
        }
        let table = faults.entries(document, span, format::PLAN.name, &format::PLAN.names());
        if table.get("plan").is_none() {
            let expected = format!("`plan = {FORMAT}`, the version of the format");
            faults.missing(&table, "plan", &expected);
        }
        let name = name(&table, "`name`", faults);
        let title = title(&table, "`title`", faults);
        let (ct, ct_place) = ct(&table, faults);
        let (f1_root, f1_kind) = f1(&table, faults);
        let outputs = settings::outputs(&table, faults);
        // Last, so that faults come in the order of the keys.
        let mut candidates;
        Some(Self {
            name,
            title,
            ct,
            ct_place,
            landmarks: landmarks(&table, faults),
            cage_depth: settings::cage_depth(&table, faults),
            f1_root,
            f1_kind: f1_kind.unwrap_or_default(),
            enhance: settings::enhance(&table, faults),
            segment: settings::segment(&table, faults),
            morph: settings::morph(&table, faults),
            outputs: outputs.unwrap_or_default(),
            views: views::views(&table, outputs, faults),
            mesh: settings::mesh(&table, outputs, faults),
            sweeps: {
                candidates = candidates::candidates(&table, faults);
                sweeps::sweeps(&table, &mut candidates, faults)
            },
            accept: accept::accept(&table, faults),
            candidates,
        })
    }
}

fn is_supported(version: &Value<'_>, faults: &mut Faults) -> bool {
    let expected = format!("`plan = {FORMAT}`, the version of the format");
    let Some(integer) = version.get_ref().as_integer() else {
        faults.wrong_type(version, "`plan`", &expected, None);
        return true;
    };
    if small_integer(integer.as_str(), integer.radix()) == Some(FORMAT) {
        return true;
    }
    let fault = Fault::new(
        Code::BadValue,
        version.span().into(),
        "this version of rhinoplan does not read plans of this format version",
    );
    let hint = "nothing else of this plan was checked".to_owned();
    faults.push(fault.found(describe(version)).expected(expected).hint(hint));
    false
}

/// A name that becomes a file or folder: required.
fn name(table: &Table<'_, '_>, what: &str, faults: &mut Faults) -> Option<Located<String>> {
    let expected = format!(
        "at most {MAX_NAME} lower-case letters, digits and hyphens, not beginning with a hyphen"
    );
    let Some(value) = table.get("name") else {
        faults.missing(table, "name", &expected);
        return None;
    };
    let written = faults.string(value, what, &expected)?;
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let valid = !written.is_empty()
        && written.len() <= MAX_NAME
        && !written.starts_with('-')
        && written.chars().all(allowed);
    if !valid {
        let fault = Fault::new(
            Code::BadValue,
            value.span().into(),
            format!("{what} cannot name a file or folder"),
        );
        let hint = slug(written).map(|slug| format!("for example \"{slug}\""));
        faults.push(fault.found(describe(value)).expected(expected).hint(hint));
        return None;
    }
    Some(Located {
        value: written.to_owned(),
        span: value.span().into(),
    })
}

/// The nearest name that is allowed.
fn slug(written: &str) -> Option<String> {
    let mut slug = String::new();
    for character in written.chars().take(MAX_NAME) {
        let character = character.to_ascii_lowercase();
        if character.is_ascii_alphanumeric() {
            slug.push(character);
        } else if !slug.is_empty() && !slug.ends_with('-') {
            slug.push('-');
        }
    }
    let slug = slug.trim_end_matches('-');
    (!slug.is_empty()).then(|| slug.to_owned())
}

/// Free text: optional.
fn title(table: &Table<'_, '_>, what: &str, faults: &mut Faults) -> Option<String> {
    let value = table.get("title")?;
    let expected = format!("one line of text, at most {MAX_TITLE} characters");
    let written = faults.string(value, what, &expected)?;
    let length = written.chars().count();
    if length > MAX_TITLE {
        let problem = format!("is {length} characters long");
        faults.bad_value(value, what, &problem, &expected);
        return None;
    }
    if written.chars().any(char::is_control) {
        let problem = "holds a line break or another control character";
        faults.bad_value(value, what, problem, &expected);
        return None;
    }
    Some(written.to_owned())
}

fn ct(plan: &Table<'_, '_>, faults: &mut Faults) -> (Option<RawCt>, Span) {
    let expected =
        "[ct] with `path`, a volume file or a folder of DICOM slices, or `phantom = \"lee2001\"`";
    let Some(value) = plan.get("ct") else {
        faults.missing(plan, "ct", expected);
        return (None, plan.span);
    };
    let Some(table) = faults.table(value, &format::CT) else {
        return (None, value.span().into());
    };
    let sha256 = table.get("sha256").and_then(|value| sha256(value, faults));
    let series = table.get("series").and_then(|value| series(value, faults));
    match (table.get("path"), table.get("phantom")) {
        (None, None) => {
            faults.missing(&table, "path", expected);
            (None, table.span)
        }
        (Some(_), Some(phantom)) => {
            let place = table.key_place("phantom");
            let message = "[ct] gives both `path` and `phantom`";
            let fault = Fault::new(Code::Conflict, place, message);
            faults.push(fault.found("a second source").expected("one of them"));
            (None, phantom.span().into())
        }
        (Some(path), None) => {
            let expected =
                "the path of a volume file or a folder of DICOM slices, relative to the plan file";
            let path_given = path_of(path, "`ct.path`", expected, faults).map(|path| RawCt::File {
                path,
                sha256,
                series,
            });
            (path_given, path.span().into())
        }
        (None, Some(phantom)) => {
            for (key, message) in [
                (
                    "sha256",
                    "`ct.sha256` pins a file's content; the phantom is built in",
                ),
                (
                    "series",
                    "`ct.series` chooses among DICOM slices; the phantom is built in",
                ),
            ] {
                if table.get(key).is_some() {
                    let fault = Fault::new(Code::Conflict, table.key_place(key), message);
                    let fault = fault.found(format!("`{key}` with `phantom`"));
                    let hint = "remove this key".to_owned();
                    faults.push(fault.expected(format!("no `{key}`")).hint(hint));
                }
            }
            let word = faults.word(phantom, "`ct.phantom`", &format::PHANTOMS);
            (word.map(RawCt::Phantom), phantom.span().into())
        }
    }
}

fn path_of(value: &Value<'_>, what: &str, expected: &str, faults: &mut Faults) -> Option<PathBuf> {
    let path = faults.string(value, what, expected)?;
    if path.is_empty() || path.contains('\0') {
        faults.bad_value(value, what, "is not a path", expected);
        return None;
    }
    Some(PathBuf::from(path))
}

fn sha256(value: &Value<'_>, faults: &mut Faults) -> Option<String> {
    let expected = "64 hexadecimal digits, the SHA-256 of the file's content";
    let digits = faults.string(value, "`ct.sha256`", expected)?;
    if digits.len() != 64 || !digits.chars().all(|digit| digit.is_ascii_hexdigit()) {
        let problem = match digits.chars().count() {
            64 => "holds something else than hexadecimal digits".to_owned(),
            n => format!("is {n} characters long"),
        };
        faults.bad_value(value, "`ct.sha256`", &problem, expected);
        return None;
    }
    Some(digits.to_ascii_lowercase())
}

fn series(value: &Value<'_>, faults: &mut Faults) -> Option<String> {
    let expected =
        format!("the SeriesInstanceUID that `rhinoplan info` shows, at most {MAX_UID} characters");
    let uid = faults.string(value, "`ct.series`", &expected)?;
    // As the standard has it, digits and points; some programs that hide names write other characters.
    if uid.is_empty() || uid.len() > MAX_UID || !uid.chars().all(|c| c.is_ascii_graphic()) {
        faults.bad_value(value, "`ct.series`", "is not a UID", &expected);
        return None;
    }
    Some(uid.to_owned())
}

fn landmarks(plan: &Table<'_, '_>, faults: &mut Faults) -> RawLandmarks {
    let none = || RawLandmarks {
        file: None,
        frame: None,
        points: Landmarks::none(),
        snap_mm: None,
    };
    let names = Landmark::ALL.map(Landmark::name);
    let Some(value) = plan.get("landmarks") else {
        let expected = format!(
            "[landmarks] with `frame` and {}, or with `file`",
            listed(&names)
        );
        faults.missing(plan, "landmarks", &expected);
        return none();
    };
    let Some(table) = faults.table(value, &format::LANDMARKS) else {
        return none();
    };
    let snap_mm = settings::snap(&table, faults);
    if let Some(value) = table.get("file") {
        return RawLandmarks {
            file: landmark_file(value, &table, faults),
            snap_mm,
            ..none()
        };
    }
    let frame = match table.get("frame") {
        Some(frame) => faults.word(frame, "`landmarks.frame`", &format::FRAMES),
        None => {
            let expected = "\"voxel\" (LPS order, from 0), \"lps\" or \"ras\" (mm)";
            faults.missing(&table, "frame", expected);
            None
        }
    };
    let mut points = none().points;
    for landmark in Landmark::ALL {
        if let Some(value) = table.get(landmark.name()) {
            let what = format!("`landmarks.{landmark}`");
            *points.get_mut(landmark) = faults.triple(value, &what, POINT);
        }
    }
    let absent = |name: &&str| table.get(name).is_none();
    let missing: Vec<&str> = names.into_iter().filter(absent).collect();
    if !missing.is_empty() {
        let message = format!("[landmarks] does not give {}", listed(&missing));
        let fault = Fault::new(Code::MissingKey, table.span, message);
        faults.push(fault.expected(format!("for each, {POINT}")));
    }
    RawLandmarks {
        file: None,
        frame,
        points,
        snap_mm,
    }
}

/// The file that gives the landmarks. Whatever else says where they are is a fault.
fn landmark_file(
    value: &Value<'_>,
    table: &Table<'_, '_>,
    faults: &mut Faults,
) -> Option<Located<PathBuf>> {
    let others: Vec<&str> = ["frame"]
        .into_iter()
        .chain(Landmark::ALL.map(Landmark::name))
        .filter(|key| table.get(key).is_some())
        .collect();
    if let Some(first) = others.first() {
        let message = "`landmarks.file` stands in place of the frame and the points";
        let fault = Fault::new(Code::Conflict, table.key_place(first), message);
        let hint = "remove `file`, or all of the others".to_owned();
        let fault = fault.found(format!("{} beside `file`", listed(&others)));
        faults.push(fault.expected("one or the other").hint(hint));
    }
    let expected = "the path of a 3D Slicer markups file, relative to the plan file";
    let path = path_of(value, "`landmarks.file`", expected, faults)?;
    Some(Located {
        value: path,
        span: value.span().into(),
    })
}

/// "`a`, `b` and `c`".
fn listed(names: &[&str]) -> String {
    let marked: Vec<String> = names.iter().map(|name| quote(name, '`')).collect();
    match marked.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
        None => String::new(),
    }
}

/// Root and kind of the line, as far as the plan gives them.
fn f1(
    plan: &Table<'_, '_>,
    faults: &mut Faults,
) -> (Option<Located<[f64; 3]>>, Option<FeatureKind>) {
    let table = plan.get("f1");
    let Some(table) = table.and_then(|value| faults.table(value, &format::F1)) else {
        return (None, None);
    };
    let root = table.get("root");
    let root = root.and_then(|value| faults.triple(value, "`f1.root`", POINT));
    (root, kind(&table, "`f1.kind`", faults))
}

/// What of f1 is the feature, where the table says so.
fn kind(table: &Table<'_, '_>, what: &str, faults: &mut Faults) -> Option<FeatureKind> {
    faults.word(table.get("kind")?, what, &format::KINDS)
}
