//! Differences as tables: aligned for a terminal, and a report in Markdown with pictures.

use std::fmt::Write;

use super::difference::{COLUMNS, Counts, Difference, Kind, Verdict};
use crate::report::record::Program;

/// The most rows of one plan in the report: more would only be long.
const MAX_ROWS: usize = 1000;

/// Counts in words: `46 numbers, 12 pictures, 4 volumes`.
pub fn counted(counts: &Counts) -> String {
    let of = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    [
        of(counts.numbers, "number"),
        of(counts.pictures, "picture"),
        of(counts.volumes, "volume"),
    ]
    .join(", ")
}

/// How many of each kind differ.
pub fn differing(differences: &[Difference]) -> Counts {
    let of = |kind| {
        let of_kind = differences.iter().filter(|one| one.kind == kind);
        of_kind.count()
    };
    Counts {
        numbers: of(Kind::Number),
        pictures: of(Kind::Picture),
        volumes: of(Kind::Volume),
    }
}

/// The first `most` differences as an aligned table, without what is behind it.
pub fn table(differences: &[Difference], most: usize) -> String {
    let mut rows = vec![COLUMNS.map(str::to_owned)];
    rows.extend(differences.iter().take(most).map(Difference::row));
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: [usize; COLUMNS.len()] = std::array::from_fn(width);
    let mut text = String::new();
    for row in &rows {
        let mut line = String::new();
        for (place, (cell, width)) in row.iter().zip(widths).enumerate() {
            let pad = " ".repeat(width - cell.chars().count());
            // Words to the left, numbers to the right.
            let (before, after) = if place < 2 { ("", &*pad) } else { (&*pad, "") };
            let _ = write!(line, "  {before}{cell}{after}");
        }
        let _ = writeln!(text, "{}", line.trim_end());
    }
    text
}

/// The pictures of a plan that differ: the name of each, and of the file in the report that has it as expected |
/// actual | difference.
pub type Pictures = Vec<(String, String)>;

/// The whole report.
pub fn markdown(plans: &[(&Verdict, Pictures)]) -> String {
    let differing = plans.iter().filter(|(verdict, _)| !verdict.agrees).count();
    let mut text = format!(
        "# Golden comparison\n\n{differing} of {} plans differ. rhinoplan {}.\n",
        plans.len(),
        Program::THIS.version
    );
    for (verdict, pictures) in plans {
        plan(&mut text, verdict, pictures);
    }
    text
}

fn plan(text: &mut String, verdict: &Verdict, pictures: &Pictures) {
    let _ = writeln!(text, "\n## {}\n", verdict.plan);
    let expected = counted(&verdict.expected);
    if verdict.agrees {
        let _ = writeln!(text, "Agrees: {expected}.");
        return;
    }
    let found = counted(&self::differing(&verdict.differences));
    let _ = writeln!(text, "Differs in {found}; the golden has {expected}.");
    if !verdict.inputs_changed.is_empty() {
        let _ = writeln!(text, "\nWhat may explain it:\n");
    }
    for input in &verdict.inputs_changed {
        let _ = writeln!(text, "- {input}");
    }
    let _ = writeln!(
        text,
        "\n| {} |\n|---|---|---:|---:|---:|---:|",
        COLUMNS.join(" | ")
    );
    for difference in verdict.differences.iter().take(MAX_ROWS) {
        // Names are of letters, digits and a few signs, none of which means anything to a table.
        let row = difference.row().map(|cell| cell.replace('_', "\\_"));
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    let more = verdict.differences.len().saturating_sub(MAX_ROWS);
    if more > 0 {
        let _ = writeln!(text, "\n… and {more} more.");
    }
    if pictures.is_empty() {
        return;
    }
    let _ = writeln!(
        text,
        "\n### Pictures: expected, actual, difference\n\nIn the difference a pixel is the brighter the further it is off, and red where it is off by more than it may be."
    );
    for (name, file) in pictures {
        let _ = writeln!(text, "\n`{name}`\n\n![{name}]({file})");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::golden::Cell;

    fn verdict() -> Verdict {
        let height = Difference {
            kind: Kind::Number,
            measure: "straight/midline: tip_x".to_owned(),
            unit: "voxel".to_owned(),
            expected: Cell::Number(141.0),
            found: Cell::Number(142.5),
            difference: Cell::Number(1.5),
            tolerance: Cell::Number(1e-4),
        };
        let picture = Difference::missing(
            Kind::Picture,
            "straight/01-midline/view-frontal.png".to_owned(),
            "",
            Cell::text("a picture"),
        );
        Verdict {
            plan: "small".to_owned(),
            agrees: false,
            expected: Counts {
                numbers: 23,
                pictures: 1,
                volumes: 0,
            },
            inputs_changed: vec!["the plan is not the same".to_owned()],
            differences: vec![height, picture],
        }
    }

    #[test]
    fn columns_of_a_table_stand_below_each_other() {
        let text = table(&verdict().differences, 9);
        assert_eq!(
            text,
            "  measure                               unit    expected      found  difference  tolerance\n\
             \x20 straight/midline: tip_x               voxel        141      142.5         1.5       1e-4\n\
             \x20 straight/01-midline/view-frontal.png         a picture  not found\n"
        );
        assert_eq!(table(&verdict().differences, 1).lines().count(), 2);
    }

    #[test]
    fn the_report_has_everything() {
        let pictures = vec![(
            "straight/01-midline/view-frontal.png".to_owned(),
            "small/straight.01-midline.view-frontal.png".to_owned(),
        )];
        let agrees = Verdict {
            plan: "other".to_owned(),
            agrees: true,
            differences: Vec::new(),
            ..verdict()
        };
        let text = markdown(&[(&verdict(), pictures), (&agrees, Vec::new())]);
        for expected in [
            "1 of 2 plans differ",
            "## small",
            "Differs in 1 number, 1 picture, 0 volumes; the golden has 23 numbers, 1 picture, 0 volumes.",
            "- the plan is not the same",
            "| straight/midline: tip\\_x | voxel | 141 | 142.5 | 1.5 | 1e-4 |",
            "![straight/01-midline/view-frontal.png](small/straight.01-midline.view-frontal.png)",
            "## other\n\nAgrees: 23 numbers",
        ] {
            assert!(text.contains(expected), "{expected}\n{text}");
        }
    }
}
