//! What runs draw of all their candidates together, of finished runs: contact sheets, profiles, volumes.

use std::path::Path;

use image::RgbImage;

use super::at_hand::{AtHand, CandidateAtHand, Gaps, RunAtHand, What, Why, and};
use crate::exec::kept::{Beside, Lacks, Left};
use crate::exec::pictures::{Charted, Charts, PicturesError, SheetStart, Sheets};
use crate::feature::Landmark;
use crate::picture::{PictureError, TILE, decode_png};
use crate::report::record::{Measures, PREOPERATIVE};
use crate::space::{Grid, GridPoint};

/// Landmarks nearer to each other than this are the same, mm.
pub(super) const SAME_MM: f64 = 1e-6;

/// What is drawn, and what cannot be.
pub(super) struct Drawings<'s, 'a> {
    pub at_hand: &'s AtHand<'a>,
    pub title: &'s str,
    pub gaps: &'s mut Gaps,
    pub warnings: &'s mut Vec<String>,
}

/// What the nose as it is is called where runs did not begin with the same.
fn start_label(run: &RunAtHand<'_>, is_only: bool) -> String {
    if is_only {
        PREOPERATIVE.to_owned()
    } else {
        format!("{}/{PREOPERATIVE}", run.name)
    }
}

fn quoted<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<String> = names.map(|name| format!("`{name}`")).collect();
    and(&names.iter().map(String::as_str).collect::<Vec<_>>())
}

impl<'a> Drawings<'_, 'a> {
    /// Draws the contact sheets of all runs that drew views, where those agree, and gives each away as a PNG file.
    pub fn sheets<E: From<PicturesError>>(
        &mut self,
        write: impl FnMut(&str, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let at_hand = self.at_hand;
        let drew = |run: &RunAtHand<'_>| run.read.plan.views.is_some();
        if !at_hand.runs.iter().any(drew) {
            return Ok(());
        }
        let mut drawn: Vec<(usize, &Left, &Path)> = Vec::new();
        for (place, run) in at_hand.runs.iter().enumerate() {
            let start = match run.compares_none() {
                _ if !drew(run) => Err(Why::NoViews),
                Some(why) => Err(why),
                None => run.start().map_err(Why::Lacks),
            };
            match start {
                Ok((left, folder)) => drawn.push((place, left, folder)),
                Err(why) => self.gaps.add(place, What::Sheet, why, run.name),
            }
        }
        let Some(&(first, of_first, _)) = drawn.first() else {
            return Ok(());
        };
        let run_at = |place: usize| at_hand.runs.get(place);
        let columns = |place: usize| -> Vec<&'a str> {
            let views = run_at(place).and_then(|run| run.read.plan.views.as_ref());
            let cameras = views.into_iter().flat_map(|views| &views.cameras);
            cameras.map(|camera| camera.name.as_str()).collect()
        };
        let name = |place: usize| run_at(place).map_or("", |run| run.name);
        let columns_of_first = columns(first);
        for &(place, left, _) in &drawn {
            let mut parts = left.drawn_otherwise(of_first);
            if parts.is_empty() && columns(place) != columns_of_first {
                parts.push("[views]");
            }
            if !parts.is_empty() {
                self.warnings.push(format!(
                    "there is no contact sheet: `{}` and `{}` were drawn differently ({})",
                    name(first),
                    name(place),
                    and(&parts)
                ));
                return Ok(());
            }
        }
        self.framed(&drawn, &columns_of_first, write)
    }

    /// The sheets of runs of the same views, each with where it keeps the nose as it is.
    fn framed<E: From<PicturesError>>(
        &mut self,
        drawn: &[(usize, &Left, &Path)],
        columns: &[&str],
        write: impl FnMut(&str, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let at_hand = self.at_hand;
        // The same pictures of the nose as it is have the same frame.
        let mut frames: Vec<(Option<&str>, usize, RgbImage)> = Vec::new();
        let mut rows: Vec<(&CandidateAtHand<'a>, usize)> = Vec::new();
        for &(place, left, folder) in drawn {
            let known = frames
                .iter()
                .position(|(sha256, ..)| *sha256 == left.tiles());
            let frame = match known {
                Some(frame) => frame,
                None => match left
                    .beside(folder, Beside::Tiles)
                    .and_then(|png| strip(&png, columns.len()))
                {
                    Ok(picture) => {
                        frames.push((left.tiles(), place, picture));
                        frames.len() - 1
                    }
                    Err(why) => {
                        let name = at_hand.runs.get(place).map_or("", |run| run.name);
                        self.gaps.add(place, What::Sheet, Why::Lacks(why), name);
                        continue;
                    }
                },
            };
            for candidate in at_hand.of_run(place) {
                match tiles(at_hand, candidate, columns.len()) {
                    Ok(_) => rows.push((candidate, frame)),
                    Err(why) => {
                        self.gaps
                            .add(place, What::Sheet, Why::Lacks(why), candidate.name);
                    }
                }
            }
        }
        let run_of = |frame: &(Option<&str>, usize, RgbImage)| at_hand.runs.get(frame.1);
        if let [first, others @ ..] = &frames[..]
            && !others.is_empty()
        {
            let others = others.iter().filter_map(run_of).map(|run| run.name);
            self.warnings.push(format!(
                "on the contact sheet {} is not framed as `{}` is, because its noses or landmarks lie elsewhere; each frame begins with the nose as it is",
                quoted(others),
                run_of(first).map_or("", |run| run.name)
            ));
        }
        let labels = frames.iter().map(|frame| {
            run_of(frame).map_or(String::new(), |run| start_label(run, frames.len() == 1))
        });
        let labels: Vec<String> = labels.collect();
        let starts = frames.iter().zip(&labels);
        let starts: Vec<SheetStart<'_>> = starts
            .map(|((_, _, picture), label)| SheetStart { label, picture })
            .collect();
        let named: Vec<(&str, usize)> = rows.iter().map(|(of, frame)| (of.name, *frame)).collect();
        let sheets = Sheets {
            title: self.title,
            columns,
            starts: &starts,
            rows: &named,
        };
        let picture = |place: usize| {
            let row = rows.get(place);
            // What was there a moment ago: a run may have begun to replace it.
            let picture = row.and_then(|(of, _)| tiles(at_hand, of, columns.len()).ok());
            Ok(picture.unwrap_or_default())
        };
        sheets.draw(picture, write)
    }

    /// The profiles of all candidates in one plot, as SVG, of runs that drew charts of the same nose.
    pub fn profile(&mut self) -> Option<String> {
        let at_hand = self.at_hand;
        let mut drawn: Option<(&RunAtHand<'_>, &[GridPoint])> = None;
        let mut stages: Vec<Charted<'_>> = Vec::new();
        for (place, run) in at_hand.runs.iter().enumerate() {
            if !run.read.plan.outputs.charts {
                self.gaps.add(place, What::Profile, Why::NoCharts, run.name);
                continue;
            }
            let start = run.start().and_then(|(left, _)| profile_of(left));
            let start = match start {
                Ok(start) => start,
                Err(why) => {
                    self.gaps
                        .add(place, What::Profile, Why::Lacks(why), run.name);
                    continue;
                }
            };
            match drawn {
                None => {
                    stages.extend(preoperative(run).map(|measures| Charted {
                        name: PREOPERATIVE,
                        measures,
                        skin: start,
                    }));
                    drawn = Some((run, start));
                }
                Some((first, _)) => {
                    let parts = begun_otherwise(first, run);
                    if !parts.is_empty() {
                        self.warnings.push(format!(
                            "there is no profile: {} of `{}` are not those of `{}`",
                            and(&parts),
                            run.name,
                            first.name
                        ));
                        return None;
                    }
                }
            }
            for candidate in at_hand.of_run(place) {
                let skin = at_hand.left(candidate).and_then(profile_of);
                match (skin, candidate.read.stages.last()) {
                    (Ok(skin), Some(last)) => stages.push(Charted {
                        name: candidate.name,
                        measures: &last.measures,
                        skin,
                    }),
                    (found, _) => {
                        let why = Why::Lacks(found.err().unwrap_or(Lacks::Note));
                        self.gaps.add(place, What::Profile, why, candidate.name);
                    }
                }
            }
        }
        let (run, _) = drawn?;
        let svg = self.charts(run, &stages, |charts| charts.profile());
        self.drawn_or_told("profile", svg)
    }

    /// The volumes of all candidates in one chart, as SVG.
    pub fn volumes(&mut self) -> Option<String> {
        let at_hand = self.at_hand;
        // Where each of the runs begins that have another nose as it is than the one before.
        let mut starts: Vec<(usize, &Measures)> = Vec::new();
        for (place, run) in at_hand.runs.iter().enumerate() {
            if let Some(measures) = preoperative(run)
                && starts
                    .last()
                    .is_none_or(|(_, last)| last.volume_mm3 != measures.volume_mm3)
            {
                starts.push((place, measures));
            }
        }
        let labels = starts.iter().map(|(place, _)| {
            let run = at_hand.runs.get(*place);
            run.map_or(String::new(), |run| start_label(run, starts.len() == 1))
        });
        let labels: Vec<String> = labels.collect();
        let mut stages: Vec<Charted<'_>> = Vec::new();
        for place in 0..at_hand.runs.len() {
            let begins = starts.iter().zip(&labels);
            let begins = begins.filter(|((start, _), _)| *start == place);
            stages.extend(begins.map(|((_, measures), name)| Charted {
                name,
                measures,
                skin: &[],
            }));
            stages.extend(at_hand.of_run(place).filter_map(|candidate| {
                Some(Charted {
                    name: candidate.name,
                    measures: &candidate.read.stages.last()?.measures,
                    skin: &[],
                })
            }));
        }
        let svg = self.charts(at_hand.runs.first()?, &stages, |charts| charts.volumes());
        self.drawn_or_told("chart of volumes", svg)
    }

    fn charts(
        &self,
        run: &RunAtHand<'_>,
        stages: &[Charted<'_>],
        draw: impl for<'c> Fn(&Charts<'c>) -> Result<String, PictureError>,
    ) -> Option<Result<String, PictureError>> {
        let ct = &run.read.inputs.ct.grid;
        let grid = Grid::axis_aligned(ct.dims, ct.spacing).ok()?;
        Some(draw(&Charts {
            title: self.title,
            landmarks: &run.read.plan.landmarks_mm,
            grid: &grid,
            stages,
        }))
    }

    /// Numbers of a record that no run writes are no reason to write nothing.
    fn drawn_or_told(
        &mut self,
        what: &str,
        svg: Option<Result<String, PictureError>>,
    ) -> Option<String> {
        let why = match svg {
            Some(Ok(svg)) => return Some(svg),
            Some(Err(error)) => error.to_string(),
            None => "the grid in the record is none".to_owned(),
        };
        self.warnings.push(format!("there is no {what}: {why}"));
        None
    }
}

fn profile_of(left: &Left) -> Result<&[GridPoint], Lacks> {
    left.profile.as_deref().ok_or(Lacks::Note)
}

/// The measures of the nose as it is.
fn preoperative<'a>(run: &RunAtHand<'a>) -> Option<&'a Measures> {
    let first = run.read.candidates.first()?;
    Some(&first.stages.first()?.measures)
}

/// What keeps the profiles of two runs from being in one plot.
fn begun_otherwise(one: &RunAtHand<'_>, other: &RunAtHand<'_>) -> Vec<&'static str> {
    let (a, b) = (one.read, other.read);
    let apart = |landmark: Landmark| {
        let of = |landmarks: &crate::feature::Landmarks<GridPoint>| landmarks.get(landmark).0;
        (of(&a.plan.landmarks_mm) - of(&b.plan.landmarks_mm)).length() > SAME_MM
    };
    let mut found = Vec::new();
    if a.inputs.ct.sha256 != b.inputs.ct.sha256 {
        found.push("the voxels of the CT");
    }
    if !a.inputs.ct.grid.is_like(&b.inputs.ct.grid) {
        found.push("the grid");
    }
    if Landmark::ALL.into_iter().any(apart) {
        found.push("the landmarks");
    }
    if a.plan.segment.skin_hu != b.plan.segment.skin_hu {
        found.push("the skin threshold");
    }
    if found.is_empty() && preoperative(one) != preoperative(other) {
        found.push("the measures of the nose as it is");
    }
    found
}

/// The small pictures of a candidate.
fn tiles<'a>(
    at_hand: &AtHand<'a>,
    candidate: &CandidateAtHand<'a>,
    columns: usize,
) -> Result<RgbImage, Lacks> {
    strip(&at_hand.beside(candidate, Beside::Tiles)?, columns)
}

/// A row of a sheet of so many columns.
fn strip(png: &[u8], columns: usize) -> Result<RgbImage, Lacks> {
    let picture = decode_png(png).ok_or(Lacks::File)?;
    let size = (u64::from(TILE) * columns as u64, u64::from(TILE));
    let found = (u64::from(picture.width()), u64::from(picture.height()));
    (found == size).then_some(picture).ok_or(Lacks::File)
}
