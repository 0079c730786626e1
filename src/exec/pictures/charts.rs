//! Profiles and bar charts, of each candidate and of all.

use std::path::Path;

use super::{PicturesError, write_drawing};
use crate::exec::error::RunError;
use crate::io::staging::Staging;
use crate::measure::{MeasureError, NoseGeometry, skin_profile};
use crate::picture::{ProfilePlot, ProfileStage, Series, VolumeChart};
use crate::plan::Plan;
use crate::report::record::{CandidateRecord, StageRecord};
use crate::space::{Grid, GridPoint};
use crate::volume::Volume;

/// How far above `nasal_bones` and below `lip` the profile goes, mm.
const BEYOND_MM: f64 = 12.0;

/// A candidate, and its skin in the mid-sagittal plane: as the nose is, then of every stage.
pub(in crate::exec) struct CandidateProfiles<'a> {
    pub record: &'a CandidateRecord,
    pub profiles: Vec<&'a [GridPoint]>,
}

/// The skin of a volume in the mid-sagittal plane.
///
/// # Errors
/// [`MeasureError`] where there is none.
pub(in crate::exec) fn profile(
    plan: &Plan,
    skin_hu: f64,
    volume: &Volume<f32>,
) -> Result<Vec<GridPoint>, MeasureError> {
    let marks = &plan.landmarks;
    let plane = ProfilePlot::middle_plane(marks.nasal_bones, marks.lip);
    let heights = [marks.lip.0.z - BEYOND_MM, marks.nasal_bones.0.z + BEYOND_MM];
    skin_profile(volume, plane, heights, skin_hu)
}

/// A stage to be drawn: what it is called, what was measured, its skin.
struct Drawn<'a> {
    name: &'a str,
    record: &'a StageRecord,
    skin: &'a [GridPoint],
}

/// Writes `profile` and `volumes`, each as SVG and PNG: in each candidate's folder those of its stages, and
/// for the whole plan those of every candidate's last stage.
pub(in crate::exec) fn write_charts(
    staging: &Staging,
    plan: &Plan,
    grid: &Grid,
    candidates: &[CandidateProfiles<'_>],
) -> Result<(), RunError> {
    let mut last: Vec<Drawn<'_>> = Vec::new();
    for CandidateProfiles {
        record: candidate,
        profiles,
    } in candidates
    {
        let stages = candidate.stages.iter().zip(profiles);
        let mut drawn: Vec<Drawn<'_>> = stages
            .map(|(record, skin)| Drawn {
                name: &record.name,
                record,
                skin,
            })
            .collect();
        let title = candidate.title.as_deref().unwrap_or(&candidate.name);
        write(
            staging,
            Path::new(&candidate.name),
            plan,
            grid,
            title,
            &drawn,
        )?;
        if last.is_empty() {
            last.extend(drawn.first().map(|first| Drawn { ..*first }));
        }
        last.extend(drawn.pop().map(|stage| Drawn {
            name: &candidate.name,
            ..stage
        }));
    }
    let title = plan.title.as_deref().unwrap_or(&plan.name);
    write(staging, Path::new(""), plan, grid, title, &last)
}

fn write(
    staging: &Staging,
    folder: &Path,
    plan: &Plan,
    grid: &Grid,
    title: &str,
    drawn: &[Drawn<'_>],
) -> Result<(), RunError> {
    let marks = &plan.landmarks;
    let stages: Vec<ProfileStage<'_>> = drawn
        .iter()
        .map(|stage| ProfileStage {
            name: stage.name,
            skin: stage.skin,
            nose: NoseGeometry {
                tip: grid.index_to_grid(stage.record.measures.tip_voxel),
                gamma_deg: stage.record.measures.gamma_deg,
                height_mm: stage.record.measures.height_mm,
            },
        })
        .collect();
    let plot = ProfilePlot {
        title,
        nasal_bones: marks.nasal_bones,
        lip: marks.lip,
        base_y: marks.maxilla.0.y,
        plane_x: ProfilePlot::middle_plane(marks.nasal_bones, marks.lip),
        stages: &stages,
    };
    let svg = plot.svg().map_err(PicturesError::from)?;
    write_drawing(staging, &folder.join("profile"), &svg)?;
    let series: Vec<Series> = drawn
        .iter()
        .map(|stage| Series {
            label: stage.name.to_owned(),
            values: stage.record.measures.volume_mm3,
        })
        .collect();
    let chart = VolumeChart {
        title,
        subtitle: "volumes of the regions A to K",
        series: &series,
    };
    let svg = chart.svg().map_err(PicturesError::from)?;
    write_drawing(staging, &folder.join("volumes"), &svg)
}
