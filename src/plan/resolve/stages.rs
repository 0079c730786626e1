//! Candidates: every edit in grid millimetres, every stage's lines.

use super::super::decode::Faults;
use super::super::diagnostic::{Code, Fault};
use super::super::format::WIDTH;
use super::super::raw::{Frame, RawCandidate, RawEdit, RawPlan, RawStage, RawVector};
use super::super::resolved::{Candidate, Model, Stage};
use super::super::source::{Located, Span};
use super::landmarks::Placed;
use super::{is_inside, show_index, show_line_error, show_range, to_grid};
use crate::feature::{Edit, FeatureKind, FeatureLine, apply_edits};
use crate::space::{Grid, GridPoint, GridVector, LpsVector};

/// What every stage is checked against.
struct Checks<'a> {
    frame: Frame,
    grid: &'a Grid,
    /// y of the base plane, grid mm.
    base_plane: f64,
}

/// The candidates; none where one is at fault, or where the preoperative line is not known.
pub(super) fn candidates(
    raw: &RawPlan,
    grid: &Grid,
    placed: &Placed,
    faults: &mut Faults,
) -> Option<Vec<Candidate>> {
    let checks = Checks {
        frame: raw.landmarks.frame?,
        grid,
        base_plane: placed.base_plane?,
    };
    let f1 = placed.f1?;
    let candidates: Vec<Option<Candidate>> = raw
        .candidates
        .iter()
        .map(|candidate| self::candidate(candidate, raw, f1, &checks, faults))
        .collect();
    candidates.into_iter().collect()
}

/// Notes edits that the stage's feature does not have, and widths where the model has none.
pub(in super::super) fn misfits(raw: &RawPlan, faults: &mut Faults) {
    let has_width = !matches!(raw.morph.model, Model::Lee2001);
    let stages = raw
        .candidates
        .iter()
        .flat_map(|candidate| &candidate.stages);
    for stage in stages {
        let is_point = kind(stage, raw) == FeatureKind::Point;
        for edit in stage.edits.iter().flatten() {
            match edit.value.name_if_of_a_line() {
                Some(name) if is_point => faults.push(misfit_of_point(name, edit.span)),
                Some("width") if !has_width => faults.push(misfit_of_model(edit.span)),
                _ => {}
            }
        }
    }
}

fn misfit_of_point(name: &str, span: Span) -> Fault {
    let has_no = if name == "width" { "width" } else { "root" };
    let message = format!("`{name}` belongs to kind \"line\"; a point has no {has_no}");
    let hint = format!(
        "remove this edit, or write `kind = \"{}\"` in its stage",
        FeatureKind::Line.name()
    );
    Fault::new(Code::Conflict, span, message)
        .found(format!(
            "`{name}` with `kind = \"{}\"`",
            FeatureKind::Point.name()
        ))
        .expected("an edit that moves the tip")
        .hint(hint)
}

fn misfit_of_model(span: Span) -> Fault {
    let message = "`width` belongs to model \"local\"; the frame of \"lee2001\" has no width";
    let hint = "remove this edit, or write `model = \"local\"` in [morph]".to_owned();
    Fault::new(Code::Conflict, span, message)
        .found("`width` with `model = \"lee2001\"`")
        .expected("no `width`")
        .hint(hint)
}

/// What of f1 is the feature of a stage.
fn kind(stage: &RawStage, raw: &RawPlan) -> FeatureKind {
    stage.kind.unwrap_or(raw.f1_kind)
}

fn candidate(
    raw: &RawCandidate,
    plan: &RawPlan,
    f1: FeatureLine,
    checks: &Checks<'_>,
    faults: &mut Faults,
) -> Option<Candidate> {
    let mut source = f1;
    let mut stages = Vec::with_capacity(raw.stages.len());
    for stage in &raw.stages {
        // After a stage that fails, the line is not known: the stages behind it cannot be judged.
        let kind = kind(stage, plan);
        let stage = self::stage(stage, kind, source, checks, faults)?;
        source = stage.target;
        stages.push(stage);
    }
    Some(Candidate {
        name: raw.name.clone()?,
        title: raw.title.clone(),
        stages,
        swept: raw.swept.clone(),
        sweep: raw.sweep.clone(),
    })
}

fn stage(
    raw: &RawStage,
    kind: FeatureKind,
    source: FeatureLine,
    checks: &Checks<'_>,
    faults: &mut Faults,
) -> Option<Stage> {
    let raw_edits: Vec<&Located<RawEdit>> = raw
        .edits
        .iter()
        .map(Option::as_ref)
        .collect::<Option<_>>()?;
    let edits: Vec<Edit> = raw_edits
        .iter()
        .map(|edit| resolve(edit.value, checks))
        .collect();
    let (target, width) = match apply_edits(&edits, source) {
        Ok(after) => after,
        Err((place, error)) => {
            let span = raw_edits
                .get(place)
                .map_or(Span::default(), |edit| edit.span);
            let fault = Fault::new(Code::BadEdit, span, "this edit leaves f1 no direction");
            let fault = fault.found(show_line_error(error));
            faults.push(fault.expected("a tip away from the root"));
            return None;
        }
    };
    let before = faults.list.len();
    let last = |matching: fn(Edit) -> bool| {
        let place = edits.iter().rposition(|&edit| matching(edit));
        let edit = place.and_then(|place| raw_edits.get(place));
        edit.map_or(Span::default(), |edit| edit.span)
    };
    if target.tip != source.tip {
        checks.tip(target.tip, last(moves_tip), faults);
    }
    if target.root != source.root {
        checks.inside(target.root, "root", last(moves_root), faults);
    }
    if !WIDTH.contains(width) {
        let message = "the width factors of this stage multiply to one that is out of range";
        let fault = Fault::new(Code::BadEdit, last(sets_width), message);
        let expected = format!("a product {WIDTH}");
        let product = if (1e-3..1e5).contains(&width) {
            format!("a product of {width:.3}")
        } else {
            format!("a product of {width:.1e}")
        };
        faults.push(fault.found(product).expected(expected));
    }
    if faults.list.len() > before {
        return None;
    }
    Some(Stage {
        name: raw.name.clone()?,
        kind,
        edits,
        source,
        target,
        width,
    })
}

impl Checks<'_> {
    /// Notes a tip that is outside the volume, or not in front of the base plane.
    fn tip(&self, tip: GridPoint, span: Span, faults: &mut Faults) {
        if !self.inside(tip, "tip", span, faults) {
            return;
        }
        let height_mm = self.base_plane - tip.0.y;
        if height_mm <= 0.0 {
            let message = "this edit leaves the tip at or behind the base plane";
            let fault = Fault::new(Code::BadEdit, span, message);
            let found = format!("a height of {height_mm:.2} mm above the base plane");
            faults.push(fault.found(found).expected("a height above 0 mm"));
        }
    }

    /// Whether an end of f1 is inside the volume; notes where it is not.
    fn inside(&self, end: GridPoint, what: &str, span: Span, faults: &mut Faults) -> bool {
        let index = self.grid.grid_to_index(end);
        let inside = is_inside(index, self.grid);
        if !inside {
            let message = format!("this edit leaves the {what} of f1 outside the volume");
            let fault = Fault::new(Code::BadEdit, span, message);
            let fault = fault.found(format!("the {what} at {}", show_index(index)));
            faults.push(fault.expected(show_range(self.grid)));
        }
        inside
    }
}

/// An edit in grid millimetres.
fn resolve(edit: RawEdit, checks: &Checks<'_>) -> Edit {
    let point = |point| to_grid(point, checks.frame, checks.grid);
    let vector = |vector| match vector {
        RawVector::Mm(mm) => checks.grid.lps_vector_to_grid(LpsVector::from(mm)),
        RawVector::Voxels(voxels) => GridVector(glam::DVec3::from(voxels) * checks.grid.spacing()),
    };
    match edit {
        RawEdit::MoveTip(by) => Edit::MoveTip(vector(by)),
        RawEdit::MoveRoot(by) => Edit::MoveRoot(vector(by)),
        RawEdit::TipTo(to) => Edit::TipTo(point(to)),
        RawEdit::RootTo(to) => Edit::RootTo(point(to)),
        RawEdit::Word(edit) => edit,
    }
}

fn moves_tip(edit: Edit) -> bool {
    !moves_root(edit) && !sets_width(edit)
}

fn moves_root(edit: Edit) -> bool {
    matches!(edit, Edit::MoveRoot(_) | Edit::RootTo(_))
}

fn sets_width(edit: Edit) -> bool {
    matches!(edit, Edit::Width(_))
}
