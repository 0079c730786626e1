//! `table.md`: for each candidate a table of the shape of the paper's Table I, and how the map behaves.

use std::fmt::{self, Write};

use super::meshes::SolidsRecord;
use super::record::{CandidateRecord, RunRecord, StageRecord, ThresholdSource};
use crate::compare::Verdict;
use crate::measure::REGION_NAMES;
use crate::mesh::solid::SolidRecord;

/// The tables of a run, as Markdown.
pub fn tables(run: &RunRecord) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = write_tables(&mut text, run);
    text
}

fn write_tables(to: &mut String, run: &RunRecord) -> fmt::Result {
    let plan = &run.plan;
    let found = match plan.segment.skin_hu_from {
        ThresholdSource::Plan => "",
        ThresholdSource::Otsu => " (Otsu)",
    };
    writeln!(
        to,
        "# {}\n",
        plan.title.as_deref().map_or(plan.name.clone(), plain)
    )?;
    writeln!(
        to,
        "Plan `{}`, model `{}`, {} scale, {} evaluation; skin at {} HU{found}. {} {}.",
        plan.name,
        plan.morph.model.name(),
        plan.morph.scale.name(),
        plan.morph.method.name(),
        plan.segment.skin_hu,
        run.program.name,
        run.program.version,
    )?;
    writeln!(
        to,
        "\nA planning aid, not a prediction of a surgical result."
    )?;
    for warning in &run.warnings {
        writeln!(to, "\n**Warning:** {warning}.")?;
    }
    for candidate in &run.candidates {
        write_candidate(to, candidate)?;
    }
    Ok(())
}

fn write_candidate(to: &mut String, candidate: &CandidateRecord) -> fmt::Result {
    match &candidate.title {
        Some(title) => writeln!(to, "\n## {} (`{}`)\n", plain(title), candidate.name)?,
        None => writeln!(to, "\n## `{}`\n", candidate.name)?,
    }
    let stages = &candidate.stages;
    let names: Vec<_> = stages.iter().map(|stage| stage.name.clone()).collect();
    header(to, "", &names)?;
    for (place, region) in REGION_NAMES.iter().enumerate() {
        row(to, &format!("Volume {region} (mm³)"), stages, |stage| {
            format!("{:.1}", stage.measures.volume_mm3[place])
        })?;
    }
    row(to, "Volume A–K (mm³)", stages, |stage| {
        format!("{:.1}", stage.measures.volume_total_mm3)
    })?;
    row(to, "Angle γ (degree)", stages, |stage| {
        format!("{:.2}", stage.measures.gamma_deg)
    })?;
    row(to, "Height h (mm)", stages, |stage| {
        format!("{:.2}", stage.measures.height_mm)
    })?;
    row(to, "Nose tip (voxel)", stages, |stage| {
        vector(stage.measures.tip_voxel.to_array())
    })?;

    let moves: Vec<_> = stages
        .windows(2)
        .map(|pair| format!("{} → {}", pair[0].name, pair[1].name))
        .collect();
    let operated = stages.get(1..).unwrap_or_default();
    writeln!(to)?;
    header(to, "", &moves)?;
    row(to, "V (voxel)", operated, |stage| {
        vector(stage.measures.move_voxel)
    })?;
    row(to, "V (mm)", operated, |stage| {
        vector(stage.measures.move_mm.to_array())
    })?;
    row(
        to,
        "Since preoperative: smallest Jacobian determinant",
        operated,
        |stage| {
            let folded = if stage.folded { " **folded**" } else { "" };
            format!("{:.3}{folded}", stage.warp.jacobian_min)
        },
    )?;
    row(
        to,
        "Since preoperative: largest displacement (mm)",
        operated,
        |stage| format!("{:.2}", stage.warp.displacement_max_mm),
    )?;
    row(
        to,
        "… of it outside the nose box (mm)",
        operated,
        |stage| format!("{:.2}", stage.warp.displacement_max_outside_mm),
    )?;
    if operated.iter().any(|stage| stage.solids.is_some()) {
        let solid = |stage: &StageRecord, of: fn(&SolidsRecord) -> SolidRecord| {
            stage.solids.map_or("–".to_owned(), |solids| {
                let SolidRecord {
                    bodies,
                    volume_mm3,
                    between_mm3,
                    ..
                } = of(&solids);
                if bodies == 0 {
                    format!("none ({between_mm3:.1})")
                } else {
                    format!("{volume_mm3:.1} ({between_mm3:.1})")
                }
            })
        };
        row(
            to,
            "Skin-difference solid: augmentation (with what is too thin for it) (mm³)",
            operated,
            |stage| solid(stage, |solids| solids.augmentation),
        )?;
        row(
            to,
            "Skin-difference solid: resection (with what is too thin for it) (mm³)",
            operated,
            |stage| solid(stage, |solids| solids.resection),
        )?;
    }
    if operated.iter().any(|stage| stage.adaptive_error.is_some()) {
        let part = |stage: &StageRecord, mm: bool, max: bool| {
            stage
                .adaptive_error
                .map_or("–".to_owned(), |error| match (mm, max) {
                    (true, true) => format!("{:.4}", error.position_max_mm),
                    (true, false) => format!("{:.6}", error.position_mean_mm),
                    (false, true) => format!("{:.2}", error.value_max_hu),
                    (false, false) => format!("{:.4}", error.value_mean_hu),
                })
        };
        for (name, mm, max) in [
            ("Adaptive against exact, largest (mm)", true, true),
            ("Adaptive against exact, mean (mm)", true, false),
            ("Adaptive against exact, largest (HU)", false, true),
            ("Adaptive against exact, mean (HU)", false, false),
        ] {
            row(to, name, operated, |stage| part(stage, mm, max))?;
        }
    }
    if let Some(verdict) = &candidate.accept {
        write_verdict(to, verdict)?;
    }
    for stage in operated.iter().filter(|stage| stage.folded) {
        writeln!(
            to,
            "\n**Warning:** the map of stage `{}` is folded (smallest Jacobian determinant {:.3}): tissue is \
             turned inside out there. Divide the edit into smaller stages, or move the tip less.",
            stage.name, stage.warp.jacobian_min
        )?;
    }
    Ok(())
}

/// The limits of the plan, after the last stage.
fn write_verdict(to: &mut String, verdict: &Verdict) -> fmt::Result {
    let word = if verdict.accepted {
        "accepted"
    } else {
        "not accepted"
    };
    writeln!(to, "\nLimits of the plan: **{word}**.\n")?;
    writeln!(to, "| limit | allowed | found | |")?;
    writeln!(to, "|---|---:|---:|---|")?;
    for limit in &verdict.limits {
        let word = if limit.kept { "kept" } else { "**not kept**" };
        let (what, allowed, found) = (limit.what(), limit.allowed(), limit.shown());
        writeln!(to, "| {what} | {allowed} | {found} | {word} |")?;
    }
    Ok(())
}

fn header(to: &mut String, corner: &str, names: &[String]) -> fmt::Result {
    writeln!(to, "| {corner} | {} |", names.join(" | "))?;
    writeln!(to, "|---|{}", "---:|".repeat(names.len()))
}

fn row(
    to: &mut String,
    name: &str,
    stages: &[StageRecord],
    value: impl Fn(&StageRecord) -> String,
) -> fmt::Result {
    let values: Vec<_> = stages.iter().map(value).collect();
    writeln!(to, "| {name} | {} |", values.join(" | "))
}

/// Whole numbers without a fraction, others with two digits: (129, 33, 61).
fn vector(components: [f64; 3]) -> String {
    let parts = components.map(|value| {
        // Adding zero turns -0 into 0.
        let rounded = (value * 100.0).round() / 100.0 + 0.0;
        if rounded.fract() == 0.0 {
            format!("{rounded:.0}")
        } else {
            format!("{rounded:.2}")
        }
    });
    format!("({})", parts.join(", "))
}

/// Free text that means nothing to Markdown.
pub(super) fn plain(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        if "\\`*_[]<>|#&!".contains(letter) {
            escaped.push('\\');
        }
        escaped.push(letter);
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_read_as_in_table_one() {
        assert_eq!(vector([129.0, 33.0, 61.0]), "(129, 33, 61)");
        assert_eq!(vector([0.004, -0.001, 2.345]), "(0, 0, 2.35)");
        assert_eq!(vector([19.999999999, -1e-12, 0.5]), "(20, 0, 0.50)");
    }

    #[test]
    fn titles_cannot_make_markdown() {
        assert_eq!(plain("a|b *c* <d>"), "a\\|b \\*c\\* \\<d\\>");
    }
}
