//! Progress on a terminal: a bar for each plan and a line for the phase at work.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use super::output::Output;
use crate::exec::{Event, Observer, Phase, Place};

/// Draws events, or only passes warnings on where there is no terminal.
pub(super) struct Progress<'a> {
    output: &'a Output,
    bars: MultiProgress,
    current: Mutex<Option<Bars>>,
}

struct Bars {
    plan: ProgressBar,
    phase: ProgressBar,
}

impl<'a> Progress<'a> {
    pub fn new(output: &'a Output) -> Self {
        Self {
            output,
            bars: MultiProgress::new(),
            current: Mutex::new(None),
        }
    }

    fn start(&self, plan: &str, phases: usize) {
        if !self.output.shows_progress() {
            return;
        }
        let bar = self.bars.add(ProgressBar::new(phases as u64));
        bar.set_style(style(
            "{prefix:.bold} [{bar:30}] {pos}/{len} {elapsed}",
            "=> ",
        ));
        bar.set_prefix(plan.to_owned());
        let phase = self.bars.add(ProgressBar::new_spinner());
        phase.set_style(style("  {spinner} {msg}", ""));
        phase.enable_steady_tick(Duration::from_millis(120));
        *self.current() = Some(Bars { plan: bar, phase });
    }

    fn current(&self) -> MutexGuard<'_, Option<Bars>> {
        self.current.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn with_bars(&self, work: impl FnOnce(&Bars)) {
        if let Some(bars) = &*self.current() {
            work(bars);
        }
    }
}

impl Observer for Progress<'_> {
    fn on(&self, event: &Event<'_>) {
        match event {
            Event::PlanStarted { plan, phases } => self.start(plan, *phases),
            Event::PhaseStarted(phase, place) => {
                self.with_bars(|bars| bars.phase.set_message(describe(*phase, *place)));
            }
            Event::PhaseFinished(..) => self.with_bars(|bars| bars.plan.inc(1)),
            Event::Kept(phases) => self.with_bars(|bars| bars.plan.inc(*phases as u64)),
            Event::Warning(text) => self.bars.suspend(|| self.output.warning(text)),
            Event::PlanFinished => {
                if let Some(bars) = self.current().take() {
                    bars.phase.finish_and_clear();
                    bars.plan.finish_and_clear();
                }
            }
        }
    }
}

impl Drop for Progress<'_> {
    fn drop(&mut self) {
        if let Some(bars) = self.current().take() {
            bars.phase.finish_and_clear();
            bars.plan.finish_and_clear();
        }
    }
}

fn describe(phase: Phase, place: Option<Place<'_>>) -> String {
    match place {
        None => phase.describe().to_owned(),
        Some(place) => format!(
            "{} / {}: {}",
            place.candidate,
            place.stage,
            phase.describe()
        ),
    }
}

/// A template that does not parse is drawn in the plain style.
fn style(template: &str, bar: &str) -> ProgressStyle {
    let style =
        ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    if bar.is_empty() {
        style
    } else {
        style.progress_chars(bar)
    }
}
