//! `timings.json`: seconds for each phase and stage (the rows of the paper's Table III).

use std::time::Instant;

use serde::Serialize;

use super::events::{Event, Observer, Phase, Place};

/// How long each phase took. Not part of the record: no two runs agree on it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Timings {
    /// The plan's name.
    pub plan: String,
    /// Worker threads.
    pub threads: usize,
    /// From the first phase to the last, seconds.
    pub total_seconds: f64,
    /// In the order in which they ran.
    pub phases: Vec<PhaseTiming>,
}

/// One phase.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhaseTiming {
    /// The candidate's name, where the phase was for one.
    pub candidate: Option<String>,
    /// The stage's name, where the phase was for one.
    pub stage: Option<String>,
    /// The kind of work.
    pub phase: Phase,
    /// How long it took.
    pub seconds: f64,
}

/// Runs phases: tells the observer and keeps the time.
pub(super) struct Clock<'a> {
    observer: &'a dyn Observer,
    started: Instant,
    phases: Vec<PhaseTiming>,
}

impl<'a> Clock<'a> {
    pub(super) fn new(observer: &'a dyn Observer) -> Self {
        Self {
            observer,
            started: Instant::now(),
            phases: Vec::new(),
        }
    }

    /// A clock for work that is done beside other work, with the same observer.
    pub(super) fn beside(&self) -> Self {
        Self {
            observer: self.observer,
            started: self.started,
            phases: Vec::new(),
        }
    }

    /// Takes over the times of a clock that [`Clock::beside`] gave.
    pub(super) fn join(&mut self, other: Self) {
        self.phases.extend(other.phases);
    }

    pub(super) fn time<R>(
        &mut self,
        phase: Phase,
        place: Option<Place<'_>>,
        work: impl FnOnce() -> R,
    ) -> R {
        self.observer.on(&Event::PhaseStarted(phase, place));
        let start = Instant::now();
        let result = work();
        self.phases.push(PhaseTiming {
            candidate: place.map(|place| place.candidate.to_owned()),
            stage: place.map(|place| place.stage.to_owned()),
            phase,
            seconds: start.elapsed().as_secs_f64(),
        });
        self.observer.on(&Event::PhaseFinished(phase, place));
        result
    }

    pub(super) fn tell(&self, event: &Event<'_>) {
        self.observer.on(event);
    }

    pub(super) fn timings(&self, plan: &str) -> Timings {
        Timings {
            plan: plan.to_owned(),
            threads: rayon::current_num_threads(),
            total_seconds: self.started.elapsed().as_secs_f64(),
            phases: self.phases.clone(),
        }
    }
}
