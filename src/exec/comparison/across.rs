//! Distances between skins of candidates of different runs, or of different parts of one plan, from the skins that
//! runs leave beside their notes.

use std::collections::HashMap;

use super::at_hand::{AtHand, CandidateAtHand, Gaps, What, Why, and};
use super::finished::FinishedRun;
use super::{MOST_COMPARED, differences};
use crate::compare::SurfaceDifference;
use crate::exec::kept::{Beside, Lacks};
use crate::report::comparison::ComparisonRecord;
use crate::space::Grid;
use crate::surface::SeenSkin;

/// The most rows along x of a grid on which skins are compared: each skin has an index of them. A head has a million.
const MAX_ROWS: usize = 1 << 22;
/// Spacings of grids on which skins are compared, mm. A search goes as many voxels as there are in its reach.
const SPACINGS: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// Which pairs are compared here: those that no run knew.
struct Pairs<'s, 'a> {
    at_hand: &'s AtHand<'a>,
    /// Whether candidates of different runs are compared at all.
    across_runs: bool,
}

impl<'a> Pairs<'_, 'a> {
    fn has(&self, one: &CandidateAtHand<'a>, other: &CandidateAtHand<'a>) -> bool {
        let [a, b] = [one, other].map(|of| self.at_hand.run_of(of).map(|run| run.read));
        match (a, b) {
            // Of different parts, as a run of all of them in one go does.
            (Some(run), _) if one.run == other.run => {
                run.planned() <= MOST_COMPARED && one.read.folder != other.read.folder
            }
            (Some(a), Some(b)) => self.across_runs && differing(a, b).is_empty(),
            _ => false,
        }
    }
}

/// What keeps the skins of two runs from being compared.
fn differing(one: &FinishedRun, other: &FinishedRun) -> Vec<&'static str> {
    let [a, b] = [one, other].map(|run| &run.inputs.ct);
    let [s, t] = [one, other].map(|run| run.plan.segment);
    let mut found = Vec::new();
    if a.sha256 != b.sha256 {
        found.push("the voxels of the CT");
    }
    if !a.grid.is_like(&b.grid) {
        found.push("the grids");
    }
    if s.skin_hu != t.skin_hu {
        found.push("the skin thresholds");
    }
    if s.keep_largest != t.keep_largest {
        found.push("`keep_largest`");
    }
    found
}

/// The distances that no run found itself.
pub(super) fn across<'a>(
    at_hand: &AtHand<'a>,
    gaps: &mut Gaps,
    warnings: &mut Vec<String>,
) -> Vec<SurfaceDifference> {
    let all = &at_hand.candidates;
    let several = at_hand.runs.len() > 1;
    let across_runs = several && all.len() <= MOST_COMPARED;
    if several && !across_runs {
        warnings.push(format!(
            "distances between skins are those within each run: each two of up to {MOST_COMPARED} candidates are compared across runs, and there are {}",
            all.len()
        ));
    }
    if across_runs {
        warnings.extend(apart(at_hand));
    }
    let pairs = Pairs {
        at_hand,
        across_runs,
    };
    let mut skins: Vec<(&CandidateAtHand<'a>, SeenSkin)> = Vec::new();
    for one in all {
        if !all.iter().any(|other| pairs.has(one, other)) {
            continue;
        }
        match skin(at_hand, one) {
            Ok(skin) => skins.push((one, skin)),
            Err(why) => gaps.add(one.run, What::Distances, why, one.name),
        }
    }
    let named: Vec<(&str, &SeenSkin)> = skins.iter().map(|(of, skin)| (of.name, skin)).collect();
    differences(&named, |one, other| {
        let of = |place: usize| skins.get(place).map(|(of, _)| *of);
        matches!((of(one), of(other)), (Some(one), Some(other)) if pairs.has(one, other))
    })
}

/// Which runs' skins are not held against those of others, and why.
fn apart(at_hand: &AtHand<'_>) -> Vec<String> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let read = |run: usize| at_hand.runs.get(run).map(|run| run.read);
    for run in 0..at_hand.runs.len() {
        let is_like = |group: &&mut Vec<usize>| {
            let first = group.first().and_then(|&first| read(first));
            matches!((first, read(run)), (Some(a), Some(b)) if differing(a, b).is_empty())
        };
        match groups.iter_mut().find(is_like) {
            Some(group) => group.push(run),
            None => groups.push(vec![run]),
        }
    }
    let Some((first, others)) = groups.split_first() else {
        return Vec::new();
    };
    let names = |group: &[usize]| {
        let names = group.iter().filter_map(|&run| at_hand.runs.get(run));
        let names: Vec<String> = names.map(|run| format!("`{}`", run.name)).collect();
        and(&names.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let each = others.iter().filter_map(|group| {
        let (a, b) = (read(*first.first()?)?, read(*group.first()?)?);
        Some(format!(
            "there are no distances between the skins of {} and those of {}: {} differ",
            names(group),
            names(first),
            and(&differing(a, b))
        ))
    });
    each.collect()
}

/// The skin that the run of a candidate kept of it.
fn skin<'a>(at_hand: &AtHand<'a>, candidate: &CandidateAtHand<'a>) -> Result<SeenSkin, Why> {
    let run = at_hand.run_of(candidate).ok_or(Why::Lacks(Lacks::Note))?;
    match run.read.planned() {
        0 | 1 => return Err(Why::Single),
        planned if planned > MOST_COMPARED => return Err(Why::Many),
        _ => {}
    }
    let ct = &run.read.inputs.ct.grid;
    let grid = Grid::axis_aligned(ct.dims, ct.spacing).map_err(|_| Why::Grid)?;
    let [_, ny, nz] = ct.dims;
    if ny * nz > MAX_ROWS || !ct.spacing.iter().all(|mm| SPACINGS.contains(mm)) {
        return Err(Why::Grid);
    }
    let bytes = at_hand
        .beside(candidate, Beside::Skin)
        .map_err(Why::Lacks)?;
    SeenSkin::from_bytes(&grid, &bytes).ok_or(Why::Lacks(Lacks::File))
}

/// The distances of a comparison, with those that no run found itself, in the order of the candidates.
pub(super) fn with_found(record: &mut ComparisonRecord, found: Vec<SurfaceDifference>) {
    if found.is_empty() {
        return;
    }
    let names = record.candidates.iter().map(|of| of.name.clone());
    let places: HashMap<String, usize> = names.zip(0..).collect();
    record.surface_differences.extend(found);
    let place = |name: &String| places.get(name).copied();
    let both = |pair: &SurfaceDifference| pair.candidates.each_ref().map(place);
    record.surface_differences.sort_by_key(both);
}
