//! What finished runs left of their candidates, and what cannot be had of it.

use std::cell::OnceCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::MOST_COMPARED;
use super::finished::{CandidateRead, FinishedRun};
use crate::exec::error::RunError;
use crate::exec::kept::{Beside, Expected, Lacks, Left};
use crate::report::comparison::ComparisonRecord;

/// The most names that one warning lists.
const MOST_NAMED: usize = 3;

/// A finished run.
pub(super) struct RunAtHand<'a> {
    pub read: &'a FinishedRun,
    pub name: &'a str,
    expected: Expected,
    start: OnceCell<Result<(Left, &'a Path), Lacks>>,
}

/// A candidate of a finished run.
pub(super) struct CandidateAtHand<'a> {
    /// The place of its run.
    pub run: usize,
    pub read: &'a CandidateRead,
    /// As the comparison calls it.
    pub name: &'a str,
    left: OnceCell<Result<Left, Lacks>>,
}

/// What runs left, read when it is asked for.
pub(super) struct AtHand<'a> {
    pub runs: Vec<RunAtHand<'a>>,
    /// Of all runs, in the order of the comparison.
    pub candidates: Vec<CandidateAtHand<'a>>,
}

impl<'a> AtHand<'a> {
    /// Of runs, and the comparison of them.
    pub fn new(runs: &'a [FinishedRun], record: &'a ComparisonRecord) -> Result<Self, RunError> {
        let at_hand = runs.iter().zip(&record.runs).map(|(read, compared)| {
            Ok(RunAtHand {
                read,
                name: &compared.name,
                expected: read.expected()?,
                start: OnceCell::new(),
            })
        });
        let of_run = |(run, read): (usize, &'a FinishedRun)| {
            let candidates = read.candidates.iter();
            candidates.map(move |candidate| (run, candidate))
        };
        let candidates = runs.iter().enumerate().flat_map(of_run);
        let candidates = candidates
            .zip(&record.candidates)
            .map(|((run, read), compared)| CandidateAtHand {
                run,
                read,
                name: &compared.name,
                left: OnceCell::new(),
            });
        Ok(Self {
            runs: at_hand.collect::<Result<_, RunError>>()?,
            candidates: candidates.collect(),
        })
    }

    /// The candidates of a run.
    pub fn of_run(&self, run: usize) -> impl Iterator<Item = &CandidateAtHand<'a>> {
        let all = self.candidates.iter();
        all.filter(move |candidate| candidate.run == run)
    }

    /// The run of a candidate.
    pub fn run_of(&self, candidate: &CandidateAtHand<'_>) -> Option<&RunAtHand<'a>> {
        self.runs.get(candidate.run)
    }

    /// What is kept of a candidate's last stage.
    pub fn left<'s>(&'s self, candidate: &'s CandidateAtHand<'a>) -> Result<&'s Left, Lacks> {
        let read = || {
            let run = self.run_of(candidate).ok_or(Lacks::Note)?;
            let stages = &candidate.read.stages;
            // The first of them is the nose as it is.
            let place = stages.len().checked_sub(2).ok_or(Lacks::Note)?;
            let last = stages.last().ok_or(Lacks::Note)?;
            Left::of_stage(
                &candidate.read.folder,
                &run.expected,
                (&candidate.read.name, place, &last.name),
                (&last.measures, &last.warp),
            )
        };
        candidate
            .left
            .get_or_init(read)
            .as_ref()
            .map_err(|&why| why)
    }

    /// What is kept beside that.
    pub fn beside(&self, candidate: &CandidateAtHand<'a>, kind: Beside) -> Result<Vec<u8>, Lacks> {
        self.left(candidate)?.beside(&candidate.read.folder, kind)
    }
}

impl<'a> RunAtHand<'a> {
    /// What is kept of the nose as it is, and the folder that it is in: the same in all parts of a plan.
    pub fn start(&self) -> Result<(&Left, &'a Path), Lacks> {
        let read = || {
            let stages = self.read.candidates.first().map(|first| &first.stages);
            let start = stages.and_then(|stages| stages.first());
            let measures = &start.ok_or(Lacks::Note)?.measures;
            let mut lacks = Lacks::Note;
            for folder in &self.read.folders {
                match Left::of_start(folder, &self.expected, measures) {
                    Ok(left) => return Ok((left, folder.as_path())),
                    Err(why) => lacks = why,
                }
            }
            Err(lacks)
        };
        let start = self.start.get_or_init(read).as_ref();
        start
            .map(|(left, folder)| (left, *folder))
            .map_err(|&why| why)
    }

    /// Why there is nothing that compares its candidates, where its plan asked for nothing of that.
    pub fn compares_none(&self) -> Option<Why> {
        (self.read.planned() < 2).then_some(Why::Single)
    }
}

/// What is made of what runs left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum What {
    Distances,
    Sheet,
    Profile,
}

/// Why something of a run is not in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Why {
    Lacks(Lacks),
    /// The plan has one candidate.
    Single,
    /// The plan has more than [`MOST_COMPARED`].
    Many,
    /// No skins are compared on its grid.
    Grid,
    NoViews,
    NoCharts,
}

impl Why {
    fn words(self) -> String {
        let kept = "the run kept of it in `.rhinoplan.kept`";
        match self {
            Self::Lacks(Lacks::Note) => {
                format!("what {kept} is missing or damaged; run the plan again to have it")
            }
            Self::Lacks(Lacks::Version) => {
                format!("what {kept} is of another version of rhinoplan; run the plan again")
            }
            Self::Lacks(Lacks::Record) => {
                format!("what {kept} is not of the `run.json` beside it; run the plan again")
            }
            Self::Lacks(Lacks::File) => {
                format!("a file that {kept} is missing or was altered; run the plan again to have it")
            }
            Self::Single => "the run of a plan with a single candidate keeps neither skin nor small pictures; a plan with all candidates does".to_owned(),
            Self::Many => format!("the run of a plan with more than {MOST_COMPARED} candidates keeps no skins"),
            Self::Grid => "skins are not compared on a grid of this size and spacing".to_owned(),
            Self::NoViews => "its plan draws no \"views\"".to_owned(),
            Self::NoCharts => "its plan draws no \"charts\"".to_owned(),
        }
    }
}

/// What could not be had of the runs: one warning for each.
#[derive(Debug, Default)]
pub(super) struct Gaps(BTreeMap<usize, OfRun>);

#[derive(Debug, Default)]
struct OfRun {
    what: BTreeSet<What>,
    why: BTreeMap<Why, Vec<String>>,
}

impl Gaps {
    /// Something of a run is not there, by its name.
    pub fn add(&mut self, run: usize, what: What, why: Why, name: &str) {
        let of_run = self.0.entry(run).or_default();
        of_run.what.insert(what);
        let names = of_run.why.entry(why).or_default();
        if !names.iter().any(|known| known == name) {
            names.push(name.to_owned());
        }
    }

    /// In words, in the order of the runs.
    pub fn warnings(&self) -> Vec<String> {
        self.0.values().map(OfRun::words).collect()
    }
}

impl OfRun {
    fn words(&self) -> String {
        let what = self.what.iter().map(|what| match what {
            What::Distances => "the distances between skins",
            What::Sheet => "the contact sheet",
            What::Profile => "the profile",
        });
        let what: Vec<&str> = what.collect();
        let verb = match self.what.first() {
            Some(What::Sheet | What::Profile) if self.what.len() == 1 => "is",
            _ => "are",
        };
        let why = self.why.iter().map(|(why, names)| {
            let shown: Vec<String> = names
                .iter()
                .take(MOST_NAMED)
                .map(|name| format!("`{name}`"))
                .collect();
            let more = match names.len().saturating_sub(MOST_NAMED) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            format!("{}{more}: {}", shown.join(", "), why.words())
        });
        let why: Vec<String> = why.collect();
        format!("{} {verb} without {}", and(&what), why.join("; without "))
    }
}

/// As in "a, b and c".
pub(super) fn and(words: &[&str]) -> String {
    match words.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => words.concat(),
    }
}
