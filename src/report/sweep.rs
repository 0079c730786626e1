//! `sweep.csv`, and the tables of swept candidates in `compare.md`.

use std::collections::HashMap;
use std::fmt::{self, Write as _};
use std::io::Write;

use super::comparison::{ComparedCandidate, ComparisonRecord, number, shown_unit};
use crate::compare::{Sweep, SweptNumber};

/// Measures that come first in `sweep.csv`, and that `compare.md` has.
const MAIN: [&str; 3] = ["gamma", "height", "volume_total"];
/// Columns of the movement of the tip, mm.
const TIP_MOVE: [&str; 4] = [
    "tip_move (mm)",
    "tip_move_x (mm)",
    "tip_move_y (mm)",
    "tip_move_z (mm)",
];

/// Writes `sweep.csv`: a row for each candidate, with its name, that of its sweep, a column for each number that a
/// sweep varies, whether it keeps the limits of its plan, and its measures. Cells are empty where a candidate has no
/// such number.
///
/// # Errors
/// Those of `to`.
pub fn write_csv(to: impl Write, comparison: &ComparisonRecord) -> Result<(), csv::Error> {
    let mut numbers: Vec<&SweptNumber> = Vec::new();
    for number in comparison.sweeps.iter().flat_map(|sweep| &sweep.numbers) {
        if !numbers.contains(&number) {
            numbers.push(number);
        }
    }
    let measures = order(comparison);
    let first = comparison.candidates.first();
    let titles = measures.iter().filter_map(|&place| {
        let measure = first?.measures.get(place)?;
        Some(match measure.unit {
            "1" => measure.measure.clone(),
            unit => format!("{} ({unit})", measure.measure),
        })
    });
    let mut header = vec!["candidate".to_owned(), "sweep".to_owned()];
    header.extend(numbers.iter().map(|number| number.column()));
    header.push("accepted".to_owned());
    let (main, others): (Vec<_>, Vec<_>) = titles.enumerate().partition(|(at, _)| *at < MAIN.len());
    header.extend(main.into_iter().map(|(_, title)| title));
    header.extend(TIP_MOVE.map(str::to_owned));
    header.extend(others.into_iter().map(|(_, title)| title));
    let mut table = csv::Writer::from_writer(to);
    table.write_record(&header)?;
    for candidate in &comparison.candidates {
        let swept = |number: &&SweptNumber| {
            let found = candidate.swept.iter().find(|of| {
                (of.stage.as_str(), of.edit.as_str(), of.unit)
                    == (number.stage.as_str(), number.edit.as_str(), number.unit)
            });
            found.map_or(String::new(), |of| (of.value + 0.0).to_string())
        };
        let measure = |place: &usize| {
            let found = candidate.measures.get(*place);
            found.map_or(String::new(), |change| change.value.to_string())
        };
        let mut row = vec![
            candidate.name.clone(),
            candidate.sweep.clone().unwrap_or_default(),
        ];
        row.extend(numbers.iter().map(swept));
        let accepted = candidate
            .accepted
            .map(|accepted| if accepted { "yes" } else { "no" });
        row.push(accepted.unwrap_or_default().to_owned());
        row.extend(measures.iter().take(MAIN.len()).map(measure));
        let [x, y, z] = candidate.tip_move_mm;
        row.extend([candidate.tip_distance_mm(), x, y, z].map(|mm| mm.to_string()));
        row.extend(measures.iter().skip(MAIN.len()).map(measure));
        table.write_record(&row)?;
    }
    table.flush()?;
    Ok(())
}

/// The places of all measures: the main ones first, the rest in their order.
fn order(comparison: &ComparisonRecord) -> Vec<usize> {
    let Some(first) = comparison.candidates.first() else {
        return Vec::new();
    };
    let place = |name: &str| first.measures.iter().position(|of| of.measure == name);
    let main: Vec<usize> = MAIN.into_iter().filter_map(place).collect();
    let others = (0..first.measures.len()).filter(|place| !main.contains(place));
    main.iter().copied().chain(others).collect()
}

/// A table for each sweep: its candidates with their numbers and their main measures.
pub(super) fn write_markdown(to: &mut String, comparison: &ComparisonRecord) -> fmt::Result {
    if comparison.sweeps.is_empty() {
        return Ok(());
    }
    let candidates = comparison.candidates.iter();
    let candidates: HashMap<&str, &ComparedCandidate> =
        candidates.map(|of| (of.name.as_str(), of)).collect();
    writeln!(
        to,
        "\n## Swept numbers\n\nMeasures after the last stage; the tip's move is since before the first."
    )?;
    for sweep in &comparison.sweeps {
        if comparison.runs.len() > 1 {
            writeln!(to, "\nSweep `{}` of `{}`:\n", sweep.name, sweep.run)?;
        } else {
            writeln!(to, "\nSweep `{}`:\n", sweep.name)?;
        }
        write_sweep(to, sweep, &candidates)?;
    }
    Ok(())
}

fn write_sweep(
    to: &mut String,
    sweep: &Sweep,
    candidates: &HashMap<&str, &ComparedCandidate>,
) -> fmt::Result {
    let has_limits = sweep.candidates.iter().any(|of| {
        candidates
            .get(of.name.as_str())
            .is_some_and(|of| of.accepted.is_some())
    });
    write!(to, "| |")?;
    for of in &sweep.numbers {
        let unit = match of.unit {
            "1" => String::new(),
            unit => format!(" ({})", shown_unit(unit)),
        };
        write!(
            to,
            " `{}` {}{unit} |",
            of.stage,
            of.edit.replace('_', "\\_")
        )?;
    }
    write!(to, " γ (°) | h (mm) | volume A–K (mm³) | tip moved (mm) |")?;
    writeln!(to, "{}", if has_limits { " accepted |" } else { "" })?;
    write!(to, "|---|{}", "---:|".repeat(sweep.numbers.len() + 4))?;
    writeln!(to, "{}", if has_limits { "---|" } else { "" })?;
    for swept in &sweep.candidates {
        let Some(candidate) = candidates.get(swept.name.as_str()) else {
            continue;
        };
        write!(to, "| `{}` |", swept.name)?;
        for value in &swept.values {
            write!(to, " {value} |")?;
        }
        for name in MAIN {
            match candidate.change(name) {
                Some(change) => write!(to, " {} |", number(change.value, change.unit))?,
                None => write!(to, " – |")?,
            }
        }
        write!(to, " {} |", number(candidate.tip_distance_mm(), "mm"))?;
        match candidate.accepted {
            _ if !has_limits => {}
            Some(true) => write!(to, " yes |")?,
            Some(false) => write!(to, " **no** |")?,
            None => write!(to, " – |")?,
        }
        writeln!(to)?;
    }
    Ok(())
}
