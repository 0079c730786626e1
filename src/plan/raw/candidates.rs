//! `[[candidate]]`, its stages and their edits.

use std::collections::HashSet;

use super::super::decode::{Faults, Table, Value, describe};
use super::super::diagnostic::{Code, Fault};
use super::super::format::{
    self, MAX_CANDIDATES, MAX_EDITS, MAX_STAGES, PREOPERATIVE, ROTATION_DEG, WIDTH,
};

use super::super::source::{Located, Span};
use super::{POINT, kind, name, title};
use crate::compare::Swept;
use crate::feature::{Edit, FeatureKind};

/// A candidate whose name or stages may be wanting.
#[derive(Debug, Clone)]
pub(in super::super) struct RawCandidate {
    pub name: Option<String>,
    pub title: Option<String>,
    pub stages: Vec<RawStage>,
    /// The numbers that a sweep gave it.
    pub swept: Vec<Swept>,
    /// The name of that sweep.
    pub sweep: Option<String>,
}

/// A stage as written.
#[derive(Debug, Clone)]
pub(in super::super) struct RawStage {
    pub name: Option<String>,
    /// Where it is not the plan's.
    pub kind: Option<FeatureKind>,
    /// None for an edit that could not be read: the line after it is not known.
    pub edits: Vec<Option<Located<RawEdit>>>,
}

/// An edit in the unit and frame in which it is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) enum RawEdit {
    MoveTip(RawVector),
    MoveRoot(RawVector),
    /// In the landmarks' frame.
    TipTo([f64; 3]),
    /// In the landmarks' frame.
    RootTo([f64; 3]),
    /// An edit that needs no frame.
    Word(Edit),
}

/// The names of the edits that a line has and a point has not.
pub(in super::super) const LINE_EDITS: [&str; 3] = ["move_root", "root_to", "width"];

impl RawEdit {
    /// Its name in a plan.
    pub fn word(&self) -> &'static str {
        match self {
            Self::MoveTip(_) => "move_tip",
            Self::MoveRoot(_) => "move_root",
            Self::TipTo(_) | Self::Word(Edit::TipTo(_)) => "tip_to",
            Self::RootTo(_) | Self::Word(Edit::RootTo(_)) => "root_to",
            Self::Word(Edit::MoveTip(_)) => "move_tip",
            Self::Word(Edit::MoveRoot(_)) => "move_root",
            Self::Word(Edit::Project(_)) => "project",
            Self::Word(Edit::Rotate(_)) => "rotate",
            Self::Word(Edit::Lengthen(_)) => "lengthen",
            Self::Word(Edit::Deviate(_)) => "deviate",
            Self::Word(Edit::Width(_)) => "width",
        }
    }

    /// Its name, where it is one of [`LINE_EDITS`].
    pub fn name_if_of_a_line(&self) -> Option<&'static str> {
        let [move_root, root_to, width] = LINE_EDITS;
        match self {
            Self::MoveRoot(_) => Some(move_root),
            Self::RootTo(_) => Some(root_to),
            Self::Word(Edit::Width(_)) => Some(width),
            _ => None,
        }
    }
}

/// A displacement in the unit in which it is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) enum RawVector {
    /// Along the patient's axes, LPS, mm.
    Mm([f64; 3]),
    /// Along the LPS-ordered axes of the grid, voxels.
    Voxels([f64; 3]),
}

pub(super) fn candidates(plan: &Table<'_, '_>, faults: &mut Faults) -> Vec<RawCandidate> {
    let expected = "at least one [[candidate]]";
    let Some(value) = plan.get("candidate") else {
        faults.missing(plan, "candidate", expected);
        return Vec::new();
    };
    let mut names = HashSet::new();
    tables(value, "[[candidate]]", MAX_CANDIDATES, faults)
        .iter()
        .filter_map(|item| {
            let table = faults.table(item, &format::CANDIDATE)?;
            let name = name(&table, "`candidate.name`", faults);
            Some(RawCandidate {
                name: unique(name, "candidate", &mut names, faults),
                title: title(&table, "`candidate.title`", faults),
                stages: stages(&table, faults),
                swept: Vec::new(),
                sweep: None,
            })
        })
        .collect()
}

fn stages(candidate: &Table<'_, '_>, faults: &mut Faults) -> Vec<RawStage> {
    let Some(value) = candidate.get("stage") else {
        let expected = "at least one [[candidate.stage]] below each [[candidate]]";
        faults.missing(candidate, "stage", expected);
        return Vec::new();
    };
    let mut names = HashSet::new();
    tables(value, "[[candidate.stage]]", MAX_STAGES, faults)
        .iter()
        .filter_map(|item| {
            let table = faults.table(item, &format::STAGE)?;
            let mut name = name(&table, "`candidate.stage.name`", faults);
            if let Some(reserved) = name.take_if(|name| name.value == PREOPERATIVE) {
                let message = format!(
                    "\"{PREOPERATIVE}\" cannot name a stage: tables call the nose before the first stage so"
                );
                let fault = Fault::new(Code::DuplicateName, reserved.span, message);
                let found = format!("\"{PREOPERATIVE}\"");
                faults.push(fault.found(found).expected("another name"));
            }
            Some(RawStage {
                name: unique(name, "stage of this candidate", &mut names, faults),
                kind: kind(&table, "`candidate.stage.kind`", faults),
                edits: edits(&table, faults),
            })
        })
        .collect()
}

/// The tables of an array of tables, at most `most`.
pub(super) fn tables<'a, 'i>(
    value: &'a Value<'i>,
    header: &str,
    most: usize,
    faults: &mut Faults,
) -> &'a [Value<'i>] {
    let expected = format!("one or more tables, {header}");
    if value.get_ref().is_table() {
        let hint = format!("write the header with two brackets: {header}");
        faults.wrong_type(value, header, &expected, Some(hint));
        return &[];
    }
    let Some(items) = faults.array(value, header, &expected) else {
        return &[];
    };
    at_most(items, header, most, faults)
}

/// The first `most` items; notes where there are more.
fn at_most<'a, 'i>(
    items: &'a [Value<'i>],
    what: &str,
    most: usize,
    faults: &mut Faults,
) -> &'a [Value<'i>] {
    let Some((kept, [first, ..])) = items.split_at_checked(most) else {
        return items;
    };
    let place = Span::from(first.span());
    let fault = Fault::new(Code::TooMany, place, format!("too many {what}"));
    faults.push(
        fault
            .found(format!("{} of them", items.len()))
            .expected(format!("at most {most}")),
    );
    kept
}

/// A name that none of its siblings has.
pub(super) fn unique(
    name: Option<Located<String>>,
    what: &str,
    names: &mut HashSet<String>,
    faults: &mut Faults,
) -> Option<String> {
    let name = name?;
    if names.insert(name.value.clone()) {
        return Some(name.value);
    }
    let message = format!("another {what} is named \"{}\" already", name.value);
    let fault = Fault::new(Code::DuplicateName, name.span, message);
    let found = format!("\"{}\"", name.value);
    faults.push(fault.found(found).expected("a name of its own"));
    None
}

fn edits(stage: &Table<'_, '_>, faults: &mut Faults) -> Vec<Option<Located<RawEdit>>> {
    let what = "`candidate.stage.f1`";
    let expected = "an array of edits, such as [{ project = -2.0 }]";
    let Some(value) = stage.get("f1") else {
        faults.missing(stage, "f1", expected);
        return Vec::new();
    };
    if value.get_ref().is_table() {
        let hint = "put the edit in brackets: [{ … }]".to_owned();
        faults.wrong_type(value, what, expected, Some(hint));
        return Vec::new();
    }
    let Some(items) = faults.array(value, what, expected) else {
        return Vec::new();
    };
    let items = at_most(items, "edits in a stage", MAX_EDITS, faults);
    items.iter().map(|item| edit(item, faults)).collect()
}

fn edit(value: &Value<'_>, faults: &mut Faults) -> Option<Located<RawEdit>> {
    let expected = "an edit, such as { project = -2.0 }; several edits are several tables";
    let format = &format::EDIT;
    let (name, given) = faults.choice(value, format.name, &format.names(), expected, None)?;
    let edit = match name {
        "move_tip" => RawEdit::MoveTip(vector(given, "`move_tip`", faults)?),
        "move_root" => RawEdit::MoveRoot(vector(given, "`move_root`", faults)?),
        "tip_to" => RawEdit::TipTo(faults.triple(given, "`tip_to`", POINT)?.value),
        "root_to" => RawEdit::RootTo(faults.triple(given, "`root_to`", POINT)?.value),
        word => {
            let number = number_of(word, given, &format!("`{word}`"), faults)?;
            RawEdit::Word(word_edit(word, number))
        }
    };
    Some(Located {
        value: edit,
        span: value.span().into(),
    })
}

/// A number that an edit of this name takes: of one of its components, where it has several.
pub(super) fn number_of(
    word: &str,
    given: &Value<'_>,
    what: &str,
    faults: &mut Faults,
) -> Option<f64> {
    match word {
        "rotate" => {
            let expected = format!("a number of degrees {ROTATION_DEG}");
            faults.number_in(given, what, &expected, ROTATION_DEG)
        }
        "width" => {
            let expected = format!("a factor {WIDTH}; 1 changes nothing");
            faults.number_in(given, what, &expected, WIDTH)
        }
        "move_tip" | "move_root" => faults.number(given, what, "a number, of either sign"),
        _ => faults.number(given, what, "a number of mm, of either sign"),
    }
}

/// The edit of this name that one number describes.
pub(super) fn word_edit(word: &str, number: f64) -> Edit {
    match word {
        "project" => Edit::Project(number),
        "lengthen" => Edit::Lengthen(number),
        "deviate" => Edit::Deviate(number),
        "rotate" => Edit::Rotate(number),
        _ => Edit::Width(number),
    }
}

fn vector(value: &Value<'_>, what: &'static str, faults: &mut Faults) -> Option<RawVector> {
    let expected = "{ mm = [x, y, z] } in LPS, or { voxels = [x, y, z] } along the grid";
    let bare = value.get_ref().is_array();
    let hint = bare.then(|| {
        let array = describe_array(value);
        format!("say the unit: {{ mm = {array} }} or {{ voxels = {array} }}")
    });
    let (unit, given) = faults.choice(value, what, &["mm", "voxels"], expected, hint)?;
    let components = faults
        .triple(given, what, "three numbers, [x, y, z]")?
        .value;
    Some(match unit {
        "voxels" => RawVector::Voxels(components),
        _ => RawVector::Mm(components),
    })
}

/// A short array as it could be written.
fn describe_array(value: &Value<'_>) -> String {
    let items: Vec<String> = value
        .get_ref()
        .as_array()
        .map(|array| array.iter().take(3).map(describe).collect())
        .unwrap_or_default();
    format!("[{}]", items.join(", "))
}
