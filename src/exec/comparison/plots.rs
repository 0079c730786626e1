//! Plots of measures against what a sweep varied.

use std::collections::{HashMap, HashSet};

use crate::compare::{Accept, Sweep, SweptCandidate, SweptNumber};
use crate::picture::{PictureError, SweepPanel, SweepPlot, SweepSeries};
use crate::report::comparison::ComparedCandidate;

/// What is plotted: measures by their names, with what they are called and the shortest axis; and the tip's move.
const PANELS: [(&str, &str, f64); 3] = [
    ("gamma", "angle γ, °", 0.5),
    ("height", "height h, mm", 0.2),
    ("volume_total", "volume of the regions A to K, mm³", 20.0),
];
const TIP_PANEL: (&str, f64) = ("move of the tip since before the first stage, mm", 0.2);

/// What the plots of a comparison are made of.
pub(in crate::exec) struct SweepPlots<'a> {
    /// The title of the plan, or of all.
    pub title: &'a str,
    /// Whether sweeps of several runs are among them.
    pub several_runs: bool,
    pub candidates: &'a [ComparedCandidate],
    pub sweeps: &'a [Sweep],
    /// The limits of each run, by its name.
    pub accept: HashMap<&'a str, &'a Accept>,
}

impl SweepPlots<'_> {
    /// A plot for each sweep of two candidates or more, as SVG, with the name of its file without an ending: `sweep`
    /// where there is one, `sweep-<name>` where there are several.
    pub fn draw(&self) -> Result<Vec<(String, String)>, PictureError> {
        let drawn = self
            .sweeps
            .iter()
            .filter(|sweep| sweep.candidates.len() > 1);
        let drawn: Vec<&Sweep> = drawn.collect();
        let mut taken = HashSet::new();
        let mut plots = Vec::with_capacity(drawn.len());
        for sweep in &drawn {
            let name = if drawn.len() == 1 {
                "sweep".to_owned()
            } else {
                self.file(sweep, &mut taken)
            };
            plots.push((name, self.plot(sweep)?));
        }
        Ok(plots)
    }

    /// A name that no other file has: sweeps of one name can vary different numbers.
    fn file(&self, sweep: &Sweep, taken: &mut HashSet<String>) -> String {
        let base = if self.several_runs {
            format!("sweep-{}-{}", sweep.run.replace('#', "-"), sweep.name)
        } else {
            format!("sweep-{}", sweep.name)
        };
        let mut name = base.clone();
        let mut number = 2;
        while !taken.insert(name.clone()) {
            name = format!("{base}-{number}");
            number += 1;
        }
        name
    }

    fn plot(&self, sweep: &Sweep) -> Result<String, PictureError> {
        let candidates: HashMap<&str, &ComparedCandidate> = self
            .candidates
            .iter()
            .map(|of| (of.name.as_str(), of))
            .collect();
        let of = |place: usize| {
            let swept: Option<&SweptCandidate> = sweep.candidates.get(place);
            swept.and_then(|of| candidates.get(of.name.as_str()).copied())
        };
        let drawn = sweep.lines();
        let series: Vec<SweepSeries> = drawn
            .lines
            .iter()
            .map(|line| {
                let values = sweep
                    .candidates
                    .get(line.candidate)
                    .map(|of| &of.values[..]);
                let values = values.unwrap_or_default();
                let second = drawn.second.and_then(|second| values.get(second).copied());
                let broken = |&(_, place): &(f64, usize)| {
                    of(place).is_some_and(|of| of.accepted == Some(false))
                };
                SweepSeries {
                    label: words(sweep, values, drawn.axis),
                    second: second.unwrap_or_default(),
                    x: line.points.iter().map(|&(x, _)| x).collect(),
                    broken: line.points.iter().map(broken).collect(),
                }
            })
            .collect();
        let values = |value: &dyn Fn(&ComparedCandidate) -> f64| -> Vec<Vec<f64>> {
            let lines = drawn.lines.iter();
            let points = lines.map(|line| line.points.iter());
            points
                .map(|points| {
                    points
                        .map(|&(_, place)| of(place).map_or(f64::NAN, value))
                        .collect()
                })
                .collect()
        };
        let accept = self.accept.get(sweep.run.as_str());
        let before = |measure: &str| Some(of(0)?.change(measure)?.before);
        let mut panels: Vec<SweepPanel> = PANELS
            .into_iter()
            .map(|(measure, title, least_span)| {
                let limits = accept.into_iter().flat_map(|accept| accept.of(measure));
                let limits: Vec<String> = limits.map(|limit| limit.shown()).collect();
                SweepPanel {
                    title: title.to_owned(),
                    values: values(&|of| {
                        of.change(measure).map_or(f64::NAN, |change| change.value)
                    }),
                    allowed: accept.and_then(|accept| accept.range(measure, before(measure)?)),
                    limits: limits.join("; ").replace('-', "−"),
                    least_span,
                }
            })
            .collect();
        panels.push(SweepPanel {
            title: TIP_PANEL.0.to_owned(),
            values: values(&ComparedCandidate::tip_distance_mm),
            allowed: None,
            limits: String::new(),
            least_span: TIP_PANEL.1,
        });
        let title = |number: Option<usize>| {
            let number = number.and_then(|number| sweep.numbers.get(number));
            number.map_or(String::new(), |number| named(number, true))
        };
        let mut subtitle = format!("sweep {}", sweep.name);
        if self.several_runs {
            subtitle.push_str(&format!(" of {}", sweep.run));
        }
        subtitle.push_str(", after the last stage");
        let further = (0..sweep.numbers.len()).filter(|&at| {
            at != drawn.axis && Some(at) != drawn.second && sweep.values(at).len() > 1
        });
        let further: Vec<String> = further
            .filter_map(|at| Some(named(sweep.numbers.get(at)?, false)))
            .collect();
        if !further.is_empty() {
            subtitle.push_str(&format!("; lines also differ in {}", further.join(", ")));
        }
        let plot = SweepPlot {
            title: self.title,
            subtitle: &subtitle,
            x: &title(Some(drawn.axis)),
            second: &title(drawn.second),
            lines: &series,
            panels: &panels,
        };
        plot.svg()
    }
}

/// What a number is, as in "refine: move tip y (mm)".
fn named(number: &SweptNumber, with_unit: bool) -> String {
    let name = format!("{}: {}", number.stage, number.edit.replace('_', " "));
    match number.unit {
        "1" => name,
        _ if !with_unit => name,
        "deg" => name + " (°)",
        "voxel" => name + " (voxels)",
        unit => format!("{name} ({unit})"),
    }
}

/// The values of a line in words, of all numbers but that along the axis.
fn words(sweep: &Sweep, values: &[f64], axis: usize) -> String {
    let numbers = sweep.numbers.iter().zip(values).enumerate();
    let words = numbers
        .filter(|(at, _)| *at != axis)
        .map(|(_, (number, value))| {
            let same = sweep
                .numbers
                .iter()
                .filter(|other| other.edit == number.edit);
            let edit = number.edit.replace('_', " ");
            let edit = match same.count() {
                1 => edit,
                _ => format!("{} {edit}", number.stage),
            };
            let value = value.to_string().replace('-', "−");
            match number.unit {
                "1" => format!("{edit} {value}"),
                "deg" => format!("{edit} {value}°"),
                "voxel" => format!("{edit} {value} voxels"),
                unit => format!("{edit} {value} {unit}"),
            }
        });
    words.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::{Change, Swept};

    fn candidate(name: &str, sweep: &str, numbers: &[(&str, f64)]) -> ComparedCandidate {
        let swept = numbers.iter().map(|&(edit, value)| Swept {
            stage: "refine".to_owned(),
            edit: edit.to_owned(),
            value,
            unit: "mm",
        });
        ComparedCandidate {
            name: name.to_owned(),
            title: None,
            stage: "refine".to_owned(),
            accepted: None,
            swept: swept.collect(),
            sweep: Some(sweep.to_owned()),
            tip_move_mm: [0.0, 3.0, 4.0],
            measures: vec![Change::new("height".to_owned(), "mm", 20.0, 15.0)],
        }
    }

    fn plots(candidates: &[ComparedCandidate], several_runs: bool) -> Vec<(String, String)> {
        let given = candidates
            .iter()
            .map(|of| (of.name.as_str(), of.sweep.as_deref(), &of.swept[..]));
        let plots = SweepPlots {
            title: "plan",
            several_runs,
            candidates,
            sweeps: &Sweep::find("run#2", given),
            accept: HashMap::new(),
        };
        plots.draw().unwrap()
    }

    #[test]
    fn every_sweep_has_a_file_of_its_own() {
        let given: Vec<_> = [
            ("a", "s", "project"),
            ("b", "s", "project"),
            ("c", "s", "deviate"),
            ("d", "s", "deviate"),
            ("e", "s-2", "deviate"),
            ("f", "s-2", "deviate"),
            ("alone", "t", "deviate"),
        ]
        .iter()
        .zip(0..)
        .map(|((name, sweep, edit), n)| candidate(name, sweep, &[(edit, f64::from(n))]))
        .collect();
        let names = |plots: &[(String, String)]| -> Vec<String> {
            plots.iter().map(|(name, _)| name.clone()).collect()
        };
        assert_eq!(names(&plots(&given[..2], false)), ["sweep"]);
        assert_eq!(
            names(&plots(&given, false)),
            ["sweep-s", "sweep-s-2", "sweep-s-2-2"]
        );
        assert_eq!(names(&plots(&given[2..6], true))[0], "sweep-run-2-s");
    }

    #[test]
    fn lines_say_what_they_share() {
        let given: Vec<_> = [(0.0, 1.0), (0.0, 2.0), (-2.5, 1.0), (-2.5, 2.0)]
            .iter()
            .zip(["a", "b", "c", "d"])
            .map(|(&(x, y), name)| candidate(name, "s", &[("move_tip y", x), ("project", y)]))
            .collect();
        let (_, svg) = &plots(&given, false)[0];
        for text in [
            ">project 1 mm<",
            ">project 2 mm<",
            ">refine: move tip y (mm)<",
            "sweep s, after",
        ] {
            assert!(svg.contains(text), "{text}");
        }
    }
}
