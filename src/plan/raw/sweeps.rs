//! `[[sweep]]`: candidates that differ from another in numbers of its edits.

use std::collections::HashSet;

use super::super::decode::{Faults, Table, Value};
use super::super::diagnostic::{Code, Fault};
use super::super::format::{
    self, AXES, MAX_CANDIDATES, MAX_NAME, MAX_SWEEPS, MAX_VALUES, MAX_VARIED, STEPS, SWEPT_EDITS,
};
use super::super::source::{Located, Span};
use super::candidates::{RawCandidate, RawEdit, RawStage, RawVector, number_of, tables, word_edit};
use super::name;
use crate::compare::Swept;
use crate::feature::Edit;

/// A number of an edit, and the values that it takes.
struct Varied {
    stage: usize,
    edit: usize,
    word: &'static str,
    axis: Option<usize>,
    values: Vec<Located<f64>>,
}

/// A sweep as it is written, its ranges as lists.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct RawSweep {
    pub candidate: String,
    /// What the names begin with.
    pub name: String,
    pub vary: Vec<RawVary>,
}

/// A number that a sweep varies.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct RawVary {
    pub stage: String,
    pub edit: &'static str,
    pub axis: Option<&'static str>,
    pub values: Vec<f64>,
}

/// Adds the candidates of every sweep to those that the plan gives.
pub(super) fn sweeps(
    plan: &Table<'_, '_>,
    candidates: &mut Vec<RawCandidate>,
    faults: &mut Faults,
) -> Vec<RawSweep> {
    let mut sweeps = Vec::new();
    let Some(value) = plan.get("sweep") else {
        return sweeps;
    };
    let given = candidates.clone();
    let mut names: HashSet<String> = given.iter().filter_map(|of| of.name.clone()).collect();
    for item in tables(value, "[[sweep]]", MAX_SWEEPS, faults) {
        let Some(table) = faults.table(item, &format::SWEEP) else {
            continue;
        };
        let Some((sweep, swept)) = sweep(&table, &given, faults) else {
            continue;
        };
        sweeps.push(sweep);
        if candidates.len() + swept.len() > MAX_CANDIDATES {
            let message = "this sweep makes too many candidates";
            let fault = Fault::new(Code::TooMany, table.span, message);
            let found = format!("{} and {} before it", swept.len(), candidates.len());
            faults.push(
                fault
                    .found(found)
                    .expected(format!("at most {MAX_CANDIDATES} in a plan")),
            );
            return sweeps;
        }
        for candidate in swept {
            let name = candidate.name.clone().unwrap_or_default();
            if names.insert(name.clone()) {
                candidates.push(candidate);
                continue;
            }
            let message = format!("another candidate is named \"{name}\" already");
            let fault = Fault::new(Code::DuplicateName, table.span, message);
            let hint = "give this sweep a `name`, which its candidates' begin with".to_owned();
            let fault = fault.found(format!("\"{name}\"")).hint(hint);
            faults.push(fault.expected("names of their own"));
            break;
        }
    }
    sweeps
}

/// The candidates of a sweep; none after a fault.
fn sweep(
    table: &Table<'_, '_>,
    given: &[RawCandidate],
    faults: &mut Faults,
) -> Option<(RawSweep, Vec<RawCandidate>)> {
    // Faults do not hide each other.
    let prefix = table
        .get("name")
        .map(|_| name(table, "`sweep.name`", faults));
    let base = match table.get("candidate") {
        None => {
            let expected = "the name of the candidate that is varied";
            faults.missing(table, "candidate", expected);
            None
        }
        Some(value) => {
            let known = given
                .iter()
                .filter_map(|of| Some((of.name.as_deref()?, of)));
            faults.word(value, "`sweep.candidate`", &known.collect::<Vec<_>>())
        }
    };
    let expected = "at least one [[sweep.vary]] below each [[sweep]]";
    let Some(vary) = table.get("vary") else {
        faults.missing(table, "vary", expected);
        return None;
    };
    let items = tables(vary, "[[sweep.vary]]", MAX_VARIED, faults);
    if items.is_empty() {
        // Noted.
        return None;
    }
    let varied: Vec<Option<Varied>> = items
        .iter()
        .map(|item| varied(item, base, faults))
        .collect();
    let varied = varied.into_iter().collect::<Option<Vec<Varied>>>()?;
    let base = base?;
    let prefix = match prefix {
        None => None,
        Some(prefix) => Some(prefix?),
    };
    for (at, one) in varied.iter().enumerate() {
        let same = |other: &&Varied| {
            (other.stage, other.edit, other.axis) == (one.stage, one.edit, one.axis)
        };
        if varied.iter().take(at).any(|other| same(&other)) {
            let span = items.get(at).map_or(table.span, |item| item.span().into());
            let message = "this number is varied twice";
            let fault = Fault::new(Code::Conflict, span, message);
            faults.push(fault.found(label(one)).expected("each number once"));
            return None;
        }
    }
    let total = varied
        .iter()
        .try_fold(1_usize, |total, one| total.checked_mul(one.values.len()));
    let Some(total) = total.filter(|&total| total <= MAX_CANDIDATES) else {
        let message = "this sweep makes too many candidates";
        let fault = Fault::new(Code::TooMany, table.span, message);
        let counts: Vec<String> = varied
            .iter()
            .map(|of| of.values.len().to_string())
            .collect();
        let found = format!("{} of them", counts.join(" × "));
        faults.push(
            fault
                .found(found)
                .expected(format!("at most {MAX_CANDIDATES}")),
        );
        return None;
    };
    let prefix = prefix.map_or_else(|| base.name.clone(), |prefix| Some(prefix.value))?;
    let made = (0..total).map(|number| made(number, &prefix, base, &varied));
    let made: Vec<RawCandidate> = made.collect();
    let longest = made
        .iter()
        .filter_map(|of| of.name.as_ref())
        .max_by_key(|name| name.len());
    if let Some(longest) = longest.filter(|name| name.len() > MAX_NAME) {
        let message = "the candidates of this sweep get names that are too long";
        let fault = Fault::new(Code::BadValue, table.span, message);
        let hint = "give the sweep a short `name`, which its candidates' begin with".to_owned();
        let fault = fault.found(format!("\"{longest}\"")).hint(hint);
        faults.push(fault.expected(format!("at most {MAX_NAME} characters")));
        return None;
    }
    let vary = varied.iter().map(|one| RawVary {
        stage: stage_name(one, base),
        edit: one.word,
        axis: axis_name(one),
        values: one.values.iter().map(|value| value.value).collect(),
    });
    let sweep = RawSweep {
        candidate: base.name.clone()?,
        name: prefix,
        vary: vary.collect(),
    };
    Some((sweep, made))
}

fn stage_name(of: &Varied, base: &RawCandidate) -> String {
    let stage = base.stages.get(of.stage);
    stage
        .and_then(|stage| stage.name.clone())
        .unwrap_or_default()
}

fn axis_name(of: &Varied) -> Option<&'static str> {
    let (name, _) = AXES.get(of.axis?)?;
    Some(name)
}

/// What is varied, of the candidate `base` where that is known.
fn varied(item: &Value<'_>, base: Option<&RawCandidate>, faults: &mut Faults) -> Option<Varied> {
    let table = faults.table(item, &format::VARY)?;
    let stage = stage_of(&table, base, faults);
    let word = word_of(&table, faults);
    let edit = match (base, stage, word, table.get("edit")) {
        (Some(base), Some(stage), Some(word), Some(value)) => base
            .stages
            .get(stage)
            .and_then(|stage| the_edit(stage, word, value.span().into(), faults)),
        _ => None,
    };
    let axis = word.and_then(|word| axis_of(&table, word, faults));
    let values = values(&table, word.unwrap_or_default(), faults);
    Some(Varied {
        stage: stage?,
        edit: edit?,
        word: word?,
        axis: axis?,
        values: values?,
    })
}

/// The place of the stage that is named.
fn stage_of(
    table: &Table<'_, '_>,
    base: Option<&RawCandidate>,
    faults: &mut Faults,
) -> Option<usize> {
    let expected = "the name of a stage of the candidate";
    let Some(value) = table.get("stage") else {
        faults.missing(table, "stage", expected);
        return None;
    };
    let what = "`sweep.vary.stage`";
    let Some(base) = base else {
        faults.string(value, what, expected)?;
        return None;
    };
    let stages = base.stages.iter().enumerate();
    let stages = stages.filter_map(|(at, stage)| Some((stage.name.as_deref()?, at)));
    faults.word(value, what, &stages.collect::<Vec<_>>())
}

fn word_of(table: &Table<'_, '_>, faults: &mut Faults) -> Option<&'static str> {
    let Some(value) = table.get("edit") else {
        let expected = "the name of an edit of the stage, as \"rotate\"";
        faults.missing(table, "edit", expected);
        return None;
    };
    faults.word(value, "`sweep.vary.edit`", &SWEPT_EDITS)
}

/// The component that is varied, where the edit is a vector; none after a fault.
fn axis_of(table: &Table<'_, '_>, word: &str, faults: &mut Faults) -> Option<Option<usize>> {
    let has_axes = matches!(word, "move_tip" | "move_root");
    match table.get("axis") {
        Some(value) if has_axes => faults.word(value, "`sweep.vary.axis`", &AXES).map(Some),
        None if has_axes => {
            let expected = "\"x\", \"y\" or \"z\", the component that is varied";
            faults.missing(table, "axis", expected);
            None
        }
        Some(_) => {
            let message = format!("`{word}` is one number and has no axes");
            let fault = Fault::new(Code::Conflict, table.key_place("axis"), message);
            let fault = fault.found(format!("`axis` with `edit = \"{word}\"`"));
            let hint = "remove this key".to_owned();
            faults.push(fault.expected("no `axis`").hint(hint));
            None
        }
        None => Some(None),
    }
}

/// The place of the one edit of this name in a stage.
fn the_edit(stage: &RawStage, word: &str, span: Span, faults: &mut Faults) -> Option<usize> {
    // A stage with an edit that could not be read has its own fault.
    let edits = stage
        .edits
        .iter()
        .map(Option::as_ref)
        .collect::<Option<Vec<_>>>()?;
    let of_word = |(_, edit): &(usize, &&Located<RawEdit>)| edit.value.word() == word;
    let found: Vec<usize> = edits
        .iter()
        .enumerate()
        .filter(of_word)
        .map(|(at, _)| at)
        .collect();
    if let [at] = found[..] {
        return Some(at);
    }
    let message = if found.is_empty() {
        format!("the stage has no `{word}` to vary")
    } else {
        format!("the stage has more than one `{word}`")
    };
    let fault = Fault::new(Code::Conflict, span, message);
    let found = match found.len() {
        0 => {
            let words: Vec<String> = edits
                .iter()
                .map(|edit| format!("`{}`", edit.value.word()))
                .collect();
            words.join(", ")
        }
        count => format!("{count} of them"),
    };
    let hint =
        "put the edit that is varied into a stage, once; a value that changes nothing will do"
            .to_owned();
    faults.push(
        fault
            .found(found)
            .expected(format!("one `{word}`"))
            .hint(hint),
    );
    None
}

/// `values`, or `from`, `to` and `steps`.
fn values(table: &Table<'_, '_>, word: &str, faults: &mut Faults) -> Option<Vec<Located<f64>>> {
    let expected = "`values = [...]`, or `from`, `to` and `steps`";
    let range = ["from", "to", "steps"];
    let Some(list) = table.get("values") else {
        if let Some(missing) = range.iter().find(|key| table.get(key).is_none()) {
            faults.missing(table, missing, expected);
            return None;
        }
        let from = number_of(word, table.get("from")?, "`sweep.vary.from`", faults);
        let to = number_of(word, table.get("to")?, "`sweep.vary.to`", faults);
        let wanted = format!("a whole number {STEPS}");
        let steps = table.get("steps")?;
        let steps = faults.integer_in(steps, "`sweep.vary.steps`", &wanted, STEPS)?;
        let (from, to) = (from?, to?);
        if from == to {
            faults.bad_value(
                table.get("to")?,
                "`sweep.vary.to`",
                "is where `from` is",
                "another number",
            );
            return None;
        }
        let span = table.key_place("from");
        let at = |step: i64| Located {
            value: tidy(from + (to - from) * step as f64 / (steps - 1) as f64),
            span,
        };
        return Some((0..steps).map(at).collect());
    };
    if let Some(key) = range.iter().find(|key| table.get(key).is_some()) {
        let message = "the values are given twice";
        let fault = Fault::new(Code::Conflict, table.key_place(key), message);
        faults.push(
            fault
                .found(format!("`{key}` with `values`"))
                .expected(expected),
        );
        return None;
    }
    let what = "`sweep.vary.values`";
    let items = faults.array(list, what, expected)?;
    if items.len() > MAX_VALUES {
        let problem = format!("has {} values", items.len());
        faults.bad_value(list, what, &problem, &format!("at most {MAX_VALUES}"));
        return None;
    }
    let mut values: Vec<Located<f64>> = Vec::with_capacity(items.len());
    for item in items {
        let value = number_of(word, item, what, faults)?;
        if values.iter().any(|other| other.value == value) {
            faults.bad_value(item, what, "has a value twice", "each value once");
            return None;
        }
        values.push(Located {
            value,
            span: item.span().into(),
        });
    }
    Some(values)
}

/// Without the last digits, which come of the arithmetic: they would be in names.
fn tidy(value: f64) -> f64 {
    format!("{value:.8e}").parse().unwrap_or(value)
}

/// One of the candidates: the last number changes fastest.
fn made(number: usize, prefix: &str, base: &RawCandidate, varied: &[Varied]) -> RawCandidate {
    let mut stages = base.stages.clone();
    let (mut name, mut title) = (prefix.to_owned(), Vec::new());
    let mut swept = Vec::with_capacity(varied.len());
    for (at, one) in varied.iter().enumerate() {
        let faster: usize = varied
            .iter()
            .skip(at + 1)
            .map(|of| of.values.len())
            .product();
        let Some(value) = one.values.get(number / faster % one.values.len()) else {
            continue;
        };
        let edit = stages
            .get_mut(one.stage)
            .and_then(|stage| stage.edits.get_mut(one.edit));
        if let Some(Some(edit)) = edit {
            edit.value = with_number(edit.value, one.word, one.axis, value.value);
            edit.span = value.span;
        }
        let alone = varied
            .iter()
            .filter(|other| (other.word, other.axis) == (one.word, one.axis))
            .count()
            == 1;
        let stage = stage_name(one, base);
        if !alone {
            name.push('-');
            name.push_str(&stage);
        }
        let of = label(one);
        name.push_str(&format!(
            "-{}-{}",
            of.replace(['_', ' '], "-"),
            in_name(value.value)
        ));
        let shown = match unit(base, one) {
            "voxel" => " voxels",
            "deg" => "°",
            "1" => "",
            _ => " mm",
        };
        title.push(format!("{of} {}{shown}", value.value));
        swept.push(Swept {
            stage,
            edit: of,
            value: value.value,
            unit: unit(base, one),
        });
    }
    RawCandidate {
        name: Some(name),
        title: Some(title.join(", ")),
        stages,
        swept,
        sweep: Some(prefix.to_owned()),
    }
}

/// The edit, and the component of it where it has several.
fn label(of: &Varied) -> String {
    match axis_name(of) {
        Some(axis) => format!("{} {axis}", of.word),
        None => of.word.to_owned(),
    }
}

fn unit(base: &RawCandidate, of: &Varied) -> &'static str {
    let edit = base
        .stages
        .get(of.stage)
        .and_then(|stage| stage.edits.get(of.edit));
    match edit.and_then(Option::as_ref).map(|edit| edit.value) {
        Some(RawEdit::MoveTip(RawVector::Voxels(_)) | RawEdit::MoveRoot(RawVector::Voxels(_))) => {
            "voxel"
        }
        Some(RawEdit::Word(Edit::Rotate(_))) => "deg",
        Some(RawEdit::Word(Edit::Width(_))) => "1",
        _ => "mm",
    }
}

/// A number as part of a folder's name: -2.5 is `m2p5`.
fn in_name(value: f64) -> String {
    format!("{value}").replace('-', "m").replace('.', "p")
}

fn with_number(edit: RawEdit, word: &str, axis: Option<usize>, value: f64) -> RawEdit {
    let with = |mut vector: [f64; 3]| {
        if let Some(component) = axis.and_then(|axis| vector.get_mut(axis)) {
            *component = value;
        }
        vector
    };
    let moved = |vector| match vector {
        RawVector::Mm(mm) => RawVector::Mm(with(mm)),
        RawVector::Voxels(voxels) => RawVector::Voxels(with(voxels)),
    };
    match edit {
        RawEdit::MoveTip(by) => RawEdit::MoveTip(moved(by)),
        RawEdit::MoveRoot(by) => RawEdit::MoveRoot(moved(by)),
        RawEdit::TipTo(_) | RawEdit::RootTo(_) => edit,
        RawEdit::Word(_) => RawEdit::Word(word_edit(word, value)),
    }
}
