//! Which candidates run, and how many beside each other.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;

use super::error::RunError;
use super::timings::Clock;
use crate::plan::{Model, Plan};
use crate::report::record::PartRecord;
use crate::volume::{Sample, Volume};

/// A part of the candidates of all plans that are given, so that several machines can share them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// Which of the parts, from 1.
    pub number: u32,
    /// How many parts there are.
    pub of: u32,
    /// How many candidates the plans before this one have.
    pub before: usize,
}

impl Part {
    /// As the record and the folder name it.
    pub(super) fn record(&self, plan: &Plan) -> PartRecord {
        let places = selected(plan, Some(self)).into_iter();
        let named =
            places.filter_map(|place| Some((plan.candidates.get(place)?.name.clone(), place)));
        PartRecord {
            number: self.number,
            of: self.of,
            candidates: plan.candidates.len(),
            places: named.collect(),
        }
    }

    /// Whether the candidate at a place of the plan is in this part. They are dealt out one by one, so that parts
    /// differ by one candidate at most.
    pub(super) fn has(&self, place: usize) -> bool {
        (self.before + place) % self.of.max(1) as usize + 1 == self.number as usize
    }
}

/// The places of the candidates that run.
pub fn selected(plan: &Plan, part: Option<&Part>) -> Vec<usize> {
    let places = 0..plan.candidates.len();
    places
        .filter(|&place| part.is_none_or(|part| part.has(place)))
        .collect()
}

/// How many candidates are computed beside each other: no more than there are processors, and no more than the
/// memory holds, but one.
pub(super) fn workers<T: Sample>(
    plan: &Plan,
    preoperative: &Volume<T>,
    memory: Option<u64>,
) -> usize {
    let memory = memory.unwrap_or_else(free_memory);
    let fit = memory / of_one(plan, preoperative).max(1);
    let processors = rayon::current_num_threads();
    usize::try_from(fit).map_or(processors, |fit| fit.clamp(1, processors))
}

/// What one candidate takes beside what all share, bytes: an estimate, above what a second candidate added on a head of
/// 7 million voxels with each kind of output and either model.
fn of_one<T: Sample>(plan: &Plan, preoperative: &Volume<T>) -> u64 {
    let voxels = preoperative.grid().len() as u64;
    let sample = size_of::<T>() as u64;
    let outputs = plan.outputs;
    let mut bytes = voxels * sample;
    if plan.morph.model == Model::Lee2001 {
        // The volume before, and at half scale the coarse ones and their field.
        bytes += voxels * (sample + 4);
    }
    if outputs.volume {
        // Packed, and in the order of the file.
        bytes += voxels * sample * 2;
    }
    if outputs.views || outputs.slices || outputs.charts || outputs.mesh || outputs.solids {
        // In Hounsfield units, enhanced, and masks.
        bytes += voxels * 9;
    }
    if outputs.views {
        let size = plan.views.as_ref().map_or(0, |views| u64::from(views.size));
        bytes += 64 * size * size;
    }
    if outputs.mesh || outputs.solids {
        bytes += 256 << 20;
    }
    if outputs.inverse {
        bytes += voxels * 16;
    }
    bytes + (32 << 20)
}

/// What the machine, or the container that this runs in, has free.
fn free_memory() -> u64 {
    let mut system = sysinfo::System::new();
    system.refresh_memory();
    let free = system.available_memory();
    match system.cgroup_limits() {
        Some(limits) if limits.total_memory > 0 => free.min(limits.free_memory),
        _ => free,
    }
}

/// Runs candidates, so many beside each other. The results are in the order of the candidates; of one that was not
/// begun, because another failed before, there is none. The clock gets the times in the same order.
pub(super) fn run<C: Sync, R: Send>(
    candidates: &[(usize, Vec<C>)],
    workers: usize,
    fail_fast: bool,
    clock: &mut Clock<'_>,
    work: impl Fn(usize, &[C], &mut Clock<'_>) -> Result<R, RunError> + Sync,
) -> Vec<Option<Result<R, RunError>>> {
    let (next, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
    let results = Mutex::new(Vec::with_capacity(candidates.len()));
    let parent: &Clock<'_> = clock;
    let worker = || {
        while !stop.load(Ordering::Relaxed) {
            let place = next.fetch_add(1, Ordering::Relaxed);
            let Some((at, outlook)) = candidates.get(place) else {
                return;
            };
            let mut clock = parent.beside();
            let result = work(*at, outlook, &mut clock);
            // A disk that is full, or another that is fatal, stops all.
            let fatal = |error: &RunError| fail_fast || !error.is_of_one_candidate();
            if result.as_ref().err().is_some_and(fatal) {
                stop.store(true, Ordering::Relaxed);
            }
            let mut results = results.lock().unwrap_or_else(PoisonError::into_inner);
            results.push((place, result, clock));
        }
    };
    if workers <= 1 || candidates.len() <= 1 {
        worker();
    } else {
        thread::scope(|scope| {
            for _ in 0..workers.min(candidates.len()) {
                scope.spawn(worker);
            }
        });
    }
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(place, _, _)| *place);
    let mut all: Vec<Option<Result<R, RunError>>> = Vec::new();
    all.resize_with(candidates.len(), || None);
    for (place, result, of_one) in results {
        clock.join(of_one);
        if let Some(slot) = all.get_mut(place) {
            *slot = Some(result);
        }
    }
    all
}
