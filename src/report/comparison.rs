//! `compare.json`, `compare.csv` and `compare.md`: candidates beside each other.

use std::fmt::{self, Write as _};
use std::io::Write;

use serde::Serialize;

use super::markdown::plain;
use super::record::{FailedRecord, Program};
use super::sweep;
use crate::compare::{Accept, Change, SurfaceDifference, Sweep, Swept};

/// The version of this record's layout.
pub const FORMAT: u32 = 1;

/// How many candidates share a table of `compare.md`; more would not fit a page.
const COLUMNS: usize = 6;

/// Candidates of one run or of several, compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparisonRecord {
    /// [`FORMAT`].
    pub format: u32,
    /// What compared them.
    pub program: Program,
    /// The runs that they are from.
    pub runs: Vec<ComparedRun>,
    /// What keeps the numbers of these runs from being held against each other without a thought.
    pub warnings: Vec<String>,
    /// Every candidate, in the order of the runs and their plans.
    pub candidates: Vec<ComparedCandidate>,
    /// Candidates that could not be computed, and why; not there where all could.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<FailedRecord>,
    /// Which candidates are of which sweep; not there where none is of any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sweeps: Vec<Sweep>,
    /// How far the skins of each two are apart.
    pub surface_differences: Vec<SurfaceDifference>,
}

/// A run that is compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparedRun {
    /// The plan's name, with a number behind it where two runs are of plans of one name.
    pub name: String,
    /// The plan's title.
    pub title: Option<String>,
    /// The version of the program that made it.
    pub version: String,
    /// SHA-256 of the CT, as in its `run.json`.
    pub ct_sha256: String,
    /// Which parts of the plan it is, where candidates were shared out and not all parts are here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parts: Option<ComparedParts>,
    /// The limits of the plan, where it sets any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accept: Option<Accept>,
}

/// The parts of a plan that are compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ComparedParts {
    /// Their numbers, from 1, in order.
    pub given: Vec<u32>,
    /// How many parts there are.
    pub of: u32,
}

/// A candidate: its last stage beside the nose as it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparedCandidate {
    /// Its name in the plan; where several runs are compared, with the run's in front: `run/candidate`.
    pub name: String,
    /// Its title in the plan.
    pub title: Option<String>,
    /// Its last stage.
    pub stage: String,
    /// Whether it keeps the limits of its plan, where that sets any.
    pub accepted: Option<bool>,
    /// The numbers that a sweep gave it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub swept: Vec<Swept>,
    /// The name of that sweep.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sweep: Option<String>,
    /// How far all stages together moved the tip, grid mm.
    pub tip_move_mm: [f64; 3],
    /// Every measure, in the order of `measurements.csv`.
    pub measures: Vec<Change>,
}

impl ComparedCandidate {
    /// The measure of a name.
    pub fn change(&self, measure: &str) -> Option<&Change> {
        self.measures.iter().find(|of| of.measure == measure)
    }

    /// How far all stages together moved the tip, mm.
    pub fn tip_distance_mm(&self) -> f64 {
        let [x, y, z] = self.tip_move_mm;
        (x * x + y * y + z * z).sqrt()
    }
}

/// Writes `compare.csv`: candidate, against, measure, value, unit, before, change, change_percent. Against the
/// nose as it is one row for each measure; against another candidate three rows, for the distance between skins.
///
/// # Errors
/// Those of `to`.
pub fn write_csv(to: impl Write, comparison: &ComparisonRecord) -> Result<(), csv::Error> {
    let mut table = csv::Writer::from_writer(to);
    table.write_record([
        "candidate",
        "against",
        "measure",
        "value",
        "unit",
        "before",
        "change",
        "change_percent",
    ])?;
    for candidate in &comparison.candidates {
        for change in &candidate.measures {
            let percent = change.change_percent;
            table.write_record([
                candidate.name.as_str(),
                super::record::PREOPERATIVE,
                &change.measure,
                &change.value.to_string(),
                change.unit,
                &change.before.to_string(),
                &change.change.to_string(),
                &percent.map_or(String::new(), |percent| percent.to_string()),
            ])?;
        }
    }
    for pair in &comparison.surface_differences {
        let [one, other] = &pair.candidates;
        for (measure, mm) in [
            ("surface_mean", pair.mean_mm),
            ("surface_p95", pair.p95_mm),
            ("surface_max", pair.max_mm),
        ] {
            table.write_record([one, other, measure, &mm.to_string(), "mm", "", "", ""])?;
        }
    }
    table.flush()?;
    Ok(())
}

/// `compare.md`.
pub fn markdown(comparison: &ComparisonRecord) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = write_markdown(&mut text, comparison);
    text
}

fn write_markdown(to: &mut String, comparison: &ComparisonRecord) -> fmt::Result {
    let program = &comparison.program;
    match comparison.runs.as_slice() {
        [run] => {
            let title = run.title.as_deref().map_or(run.name.clone(), plain);
            writeln!(to, "# {title}: comparison\n")?;
            writeln!(
                to,
                "Plan `{}`{}. {} {}.",
                run.name,
                parts(run),
                program.name,
                program.version
            )?;
        }
        runs => {
            writeln!(to, "# Comparison of {} runs\n", runs.len())?;
            for run in runs {
                let title = run
                    .title
                    .as_deref()
                    .map_or(String::new(), |title| format!(" {}", plain(title)));
                writeln!(
                    to,
                    "- `{}`{}{title} (version {})",
                    run.name,
                    parts(run),
                    plain(&run.version)
                )?;
            }
            writeln!(to, "\n{} {}.", program.name, program.version)?;
        }
    }
    writeln!(
        to,
        "\nA planning aid, not a prediction of a surgical result."
    )?;
    for warning in &comparison.warnings {
        writeln!(to, "\n**Warning:** {warning}.")?;
    }
    write_failed(to, &comparison.failed)?;
    sweep::write_markdown(to, comparison)?;
    writeln!(
        to,
        "\n## Measures after the last stage\n\nIn parentheses: the change since before the first stage, absolute \
         and in percent."
    )?;
    for some in comparison.candidates.chunks(COLUMNS) {
        writeln!(to)?;
        write_measures(to, some)?;
    }
    write_differences(to, comparison)
}

/// Which parts of a plan a run is, as in ", parts 1 and 3 of 3".
fn parts(run: &ComparedRun) -> String {
    let Some(ComparedParts { given, of }) = &run.parts else {
        return String::new();
    };
    let noun = if given.len() == 1 { "part" } else { "parts" };
    format!(", {noun} {} of {of}", listed(given))
}

/// Numbers as in "1, 2 and 4".
pub(crate) fn listed(numbers: &[u32]) -> String {
    let shown: Vec<String> = numbers.iter().map(u32::to_string).collect();
    match shown.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => shown.concat(),
    }
}

/// What could not be computed.
fn write_failed(to: &mut String, failed: &[FailedRecord]) -> fmt::Result {
    if failed.is_empty() {
        return Ok(());
    }
    writeln!(to, "\n## Candidates that could not be computed\n")?;
    writeln!(to, "| | why |\n|---|---|")?;
    for FailedRecord { candidate, error } in failed {
        // A table's row is one line.
        let error = plain(&error.split_whitespace().collect::<Vec<_>>().join(" "));
        writeln!(to, "| `{candidate}` | {error} |")?;
    }
    Ok(())
}

/// One table: a row for each measure, a column for each candidate.
fn write_measures(to: &mut String, candidates: &[ComparedCandidate]) -> fmt::Result {
    let Some((first, others)) = candidates.split_first() else {
        return Ok(());
    };
    let before = |candidate: &ComparedCandidate, place: usize| {
        candidate.measures.get(place).map(|change| change.before)
    };
    let is_shared = others.iter().all(|other| {
        (0..first.measures.len()).all(|place| before(other, place) == before(first, place))
    });
    let names = candidates
        .iter()
        .map(|candidate| format!("`{}`", candidate.name));
    let names: Vec<String> = names.collect();
    let start = if is_shared { " before |" } else { "" };
    writeln!(to, "| |{start} {} |", names.join(" | "))?;
    let columns = names.len() + usize::from(is_shared);
    writeln!(to, "|---|{}", "---:|".repeat(columns))?;
    for (place, measure) in first.measures.iter().enumerate() {
        write!(
            to,
            "| `{}` ({}) |",
            measure.measure,
            shown_unit(measure.unit)
        )?;
        if is_shared {
            write!(to, " {} |", number(measure.before, measure.unit))?;
        }
        for candidate in candidates {
            let Some(change) = candidate.measures.get(place) else {
                write!(to, " – |")?;
                continue;
            };
            if !is_shared {
                write!(to, " {} →", number(change.before, change.unit))?;
            }
            let percent = change.change_percent.map_or(String::new(), |percent| {
                format!(", {} %", signed(percent, 1))
            });
            let value = number(change.value, change.unit);
            let by = signed(change.change, digits(change.unit));
            write!(to, " {value} ({by}{percent}) |")?;
        }
        writeln!(to)?;
    }
    if candidates
        .iter()
        .any(|candidate| candidate.accepted.is_some())
    {
        write!(to, "| accepted |{}", if is_shared { " |" } else { "" })?;
        for candidate in candidates {
            let word = match candidate.accepted {
                Some(true) => "yes",
                Some(false) => "**no**",
                None => "–",
            };
            write!(to, " {word} |")?;
        }
        writeln!(to)?;
    }
    Ok(())
}

fn write_differences(to: &mut String, comparison: &ComparisonRecord) -> fmt::Result {
    if comparison.surface_differences.is_empty() {
        return Ok(());
    }
    writeln!(
        to,
        "\n## Distance between skins\n\nBetween the skins of two candidates after their last stages, where at least one \
         of them moved by more than 0.1 mm; what six views from outside see of the nose and its margin.\n"
    )?;
    writeln!(
        to,
        "| | | mean (mm) | 95th percentile (mm) | largest (mm) | area (mm²) |"
    )?;
    writeln!(to, "|---|---|---:|---:|---:|---:|")?;
    for pair in &comparison.surface_differences {
        let [one, other] = &pair.candidates;
        writeln!(
            to,
            "| `{one}` | `{other}` | {:.2} | {:.2} | {:.2} | {:.0} |",
            pair.mean_mm, pair.p95_mm, pair.max_mm, pair.area_mm2
        )?;
    }
    Ok(())
}

fn digits(unit: &str) -> usize {
    match unit {
        "mm3" => 1,
        "1" => 3,
        _ => 2,
    }
}

pub(super) fn number(value: f64, unit: &str) -> String {
    let digits = digits(unit);
    // Adding zero turns -0 into 0, but not one that rounding makes.
    let shown = format!("{:.digits$}", value + 0.0);
    unsigned_zero(shown)
}

fn signed(value: f64, digits: usize) -> String {
    let shown = unsigned_zero(format!("{:.digits$}", value + 0.0));
    let is_zero = shown.chars().all(|c| c == '0' || c == '.');
    if is_zero || shown.starts_with('-') {
        shown
    } else {
        format!("+{shown}")
    }
}

/// A number that rounds to nothing has no sign.
fn unsigned_zero(shown: String) -> String {
    match shown.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
        _ => shown,
    }
}

pub(super) fn shown_unit(unit: &str) -> &str {
    match unit {
        "mm3" => "mm³",
        "deg" => "°",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(name: &str, before: f64, after: f64) -> ComparedCandidate {
        ComparedCandidate {
            name: name.to_owned(),
            title: None,
            stage: "last".to_owned(),
            accepted: None,
            swept: Vec::new(),
            sweep: None,
            tip_move_mm: [0.0; 3],
            measures: vec![
                Change::new("height".to_owned(), "mm", before, after),
                Change::new("tip_x".to_owned(), "voxel", 1.0, 0.999),
            ],
        }
    }

    fn comparison(candidates: Vec<ComparedCandidate>) -> ComparisonRecord {
        let run = |name: &str| ComparedRun {
            name: name.to_owned(),
            title: Some("a | b".to_owned()),
            version: "1".to_owned(),
            ct_sha256: String::new(),
            parts: None,
            accept: None,
        };
        ComparisonRecord {
            format: FORMAT,
            program: Program::THIS,
            runs: vec![run("one")],
            warnings: Vec::new(),
            candidates,
            failed: Vec::new(),
            sweeps: Vec::new(),
            surface_differences: vec![SurfaceDifference {
                candidates: ["a".to_owned(), "b".to_owned()],
                mean_mm: 0.5,
                p95_mm: 1.25,
                max_mm: 2.0,
                area_mm2: 300.0,
            }],
        }
    }

    #[test]
    fn a_table_has_a_column_for_each_candidate_and_one_for_what_was_before() {
        let mut two = comparison(vec![candidate("a", 20.0, 15.0), candidate("b", 20.0, 22.0)]);
        two.candidates[1].accepted = Some(false);
        let text = markdown(&two);
        assert!(text.contains("# a \\| b: comparison"), "{text}");
        for line in [
            "| | before | `a` | `b` |",
            "| `height` (mm) | 20.00 | 15.00 (-5.00, -25.0 %) | 22.00 (+2.00, +10.0 %) |",
            "| `tip_x` (voxel) | 1.00 | 1.00 (0.00) | 1.00 (0.00) |",
            "| accepted | | – | **no** |",
            "| `a` | `b` | 0.50 | 1.25 | 2.00 | 300 |",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
    }

    #[test]
    fn noses_that_began_differently_each_say_how() {
        let text = markdown(&comparison(vec![
            candidate("a", 20.0, 15.0),
            candidate("b", 10.0, 15.0),
        ]));
        let line =
            "| `height` (mm) | 20.00 → 15.00 (-5.00, -25.0 %) | 10.00 → 15.00 (+5.00, +50.0 %) |";
        assert!(text.lines().any(|found| found == line), "{text}");
    }

    #[test]
    fn many_candidates_are_several_tables() {
        let many = (0..13)
            .map(|n| candidate(&format!("c{n}"), 1.0, 2.0))
            .collect();
        let text = markdown(&comparison(many));
        assert_eq!(text.matches("| `height` (mm) |").count(), 3);
        assert_eq!(text.matches("`c12`").count(), 1);
    }

    #[test]
    fn the_csv_says_against_what() {
        let mut bytes = Vec::new();
        write_csv(&mut bytes, &comparison(vec![candidate("a", 20.0, 15.0)])).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(
            lines,
            [
                "candidate,against,measure,value,unit,before,change,change_percent",
                "a,preoperative,height,15,mm,20,-5,-25",
                "a,preoperative,tip_x,0.999,voxel,1,-0.0010000000000000009,",
                "a,b,surface_mean,0.5,mm,,,",
                "a,b,surface_p95,1.25,mm,,,",
                "a,b,surface_max,2,mm,,,",
            ]
        );
    }
}
