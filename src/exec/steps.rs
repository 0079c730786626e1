//! The steps and phases that a plan takes, before any is taken.

use super::comparison::Skins;
use super::events::{Phase, Place};
use crate::plan::{Candidate, Method, Model, Plan, Scale};

/// What some phases of a plan are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step<'a> {
    /// Reading, and writing what every run writes.
    Always,
    /// The nose as it is.
    Start,
    /// A stage of a candidate.
    Stage(Place<'a>),
    /// What compares candidates.
    Joint,
}

/// The steps that a plan takes, in order, of the candidates at these places, each with its phases.
pub fn steps<'a>(plan: &'a Plan, selected: &[usize]) -> Vec<(Step<'a>, Vec<Phase>)> {
    let mut steps = vec![
        (Step::Always, vec![Phase::Read, Phase::Landmarks]),
        (Step::Start, phases_of_start(plan)),
    ];
    let selected = selected.iter().filter_map(|&at| plan.candidates.get(at));
    for candidate in selected {
        for (number, stage) in candidate.stages.iter().enumerate() {
            let place = Place {
                candidate: &candidate.name,
                stage: &stage.name,
            };
            let phases = phases_of_stage(plan, candidate, number);
            steps.push((Step::Stage(place), phases));
        }
    }
    steps.push((Step::Joint, phases_of_all(plan)));
    steps.push((Step::Always, vec![Phase::Publish]));
    steps
}

fn wanted<const N: usize>(phases: [(Phase, bool); N]) -> Vec<Phase> {
    let wanted = phases.into_iter().filter(|(_, wanted)| *wanted);
    wanted.map(|(phase, _)| phase).collect()
}

/// The phases of the nose as it is.
pub(super) fn phases_of_start(plan: &Plan) -> Vec<Phase> {
    let outputs = plan.outputs;
    wanted([
        (Phase::Measure, true),
        (Phase::Profile, outputs.charts),
        (Phase::Surface, outputs.views),
        (Phase::Views, outputs.views),
        (Phase::Meshes, outputs.mesh || outputs.solids),
        (Phase::Skins, Skins::are_wanted(plan)),
    ])
}

/// The phases of a stage.
pub(super) fn phases_of_stage(plan: &Plan, candidate: &Candidate, place: usize) -> Vec<Phase> {
    let outputs = plan.outputs;
    let is_last = place + 1 == candidate.stages.len();
    let halves = plan.morph.model == Model::Lee2001 && plan.morph.scale == Scale::Half;
    wanted([
        (Phase::Half, halves),
        (Phase::Morph, true),
        (Phase::Upsample, halves),
        (Phase::Compare, compares(plan)),
        (Phase::Audit, true),
        (Phase::Measure, true),
        (Phase::WriteVolume, outputs.volume),
        (Phase::WriteNrrd, outputs.nrrd),
        (Phase::WriteDisplacement, outputs.displacement),
        (Phase::Surface, outputs.views),
        (Phase::Views, outputs.views),
        (
            Phase::Sheet,
            outputs.views && is_last && plan.candidates.len() > 1,
        ),
        (Phase::Slices, outputs.slices),
        (Phase::Profile, outputs.charts),
        (Phase::Meshes, outputs.mesh || outputs.solids),
        (Phase::Inverse, outputs.inverse),
        (Phase::Skins, is_last && Skins::are_wanted(plan)),
    ])
}

/// The phases that compare candidates.
pub(super) fn phases_of_all(plan: &Plan) -> Vec<Phase> {
    wanted([
        (
            Phase::Sheet,
            plan.outputs.views && plan.candidates.len() > 1,
        ),
        (Phase::Charts, plan.outputs.charts),
        (Phase::Skins, Skins::are_wanted(plan)),
    ])
}

pub(super) fn compares(plan: &Plan) -> bool {
    plan.morph.compare_exact && plan.morph.method != Method::Exact
}
