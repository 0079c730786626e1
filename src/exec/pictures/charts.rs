//! Profiles and bar charts, of each candidate and of all.

use std::path::Path;

use super::{PicturesError, write_drawing};
use crate::exec::error::RunError;
use crate::feature::Landmarks;
use crate::io::staging::Staging;
use crate::measure::{MeasureError, NoseGeometry, skin_profile};
use crate::picture::{PictureError, ProfilePlot, ProfileStage, Series, VolumeChart};
use crate::plan::Plan;
use crate::report::record::{CandidateRecord, Measures};
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

/// A stage in a chart: what it is called, what was measured, its skin in the midplane.
#[derive(Clone, Copy)]
pub(in crate::exec) struct Charted<'a> {
    pub name: &'a str,
    pub measures: &'a Measures,
    pub skin: &'a [GridPoint],
}

/// What is in charts.
pub(in crate::exec) struct Charts<'a> {
    pub title: &'a str,
    pub landmarks: &'a Landmarks<GridPoint>,
    pub grid: &'a Grid,
    /// The nose as it is first.
    pub stages: &'a [Charted<'a>],
}

impl Charts<'_> {
    /// Their profiles in one plot, as SVG.
    ///
    /// # Errors
    /// Those of [`ProfilePlot::svg`].
    pub(in crate::exec) fn profile(&self) -> Result<String, PictureError> {
        let marks = self.landmarks;
        let stages = self.stages.iter().map(|stage| ProfileStage {
            name: stage.name,
            skin: stage.skin,
            nose: NoseGeometry {
                tip: self.grid.index_to_grid(stage.measures.tip_voxel),
                gamma_deg: stage.measures.gamma_deg,
                height_mm: stage.measures.height_mm,
            },
        });
        let plot = ProfilePlot {
            title: self.title,
            nasal_bones: marks.nasal_bones,
            lip: marks.lip,
            base_y: marks.maxilla.0.y,
            plane_x: ProfilePlot::middle_plane(marks.nasal_bones, marks.lip),
            stages: &stages.collect::<Vec<_>>(),
        };
        plot.svg()
    }

    /// The volumes of their regions in one chart, as SVG.
    ///
    /// # Errors
    /// Those of [`VolumeChart::svg`].
    pub(in crate::exec) fn volumes(&self) -> Result<String, PictureError> {
        let series = self.stages.iter().map(|stage| Series {
            label: stage.name.to_owned(),
            values: stage.measures.volume_mm3,
        });
        let chart = VolumeChart {
            title: self.title,
            subtitle: "volumes of the regions A to K",
            series: &series.collect::<Vec<_>>(),
        };
        chart.svg()
    }

    fn write(&self, staging: &Staging, folder: &Path) -> Result<(), RunError> {
        let profile = self.profile().map_err(PicturesError::from)?;
        write_drawing(staging, &folder.join("profile"), &profile)?;
        let volumes = self.volumes().map_err(PicturesError::from)?;
        write_drawing(staging, &folder.join("volumes"), &volumes)
    }
}

/// Writes `profile` and `volumes`, each as SVG and PNG: in each candidate's folder those of its stages, and
/// for the whole plan those of every candidate's last stage.
pub(in crate::exec) fn write_charts(
    staging: &Staging,
    plan: &Plan,
    grid: &Grid,
    candidates: &[CandidateProfiles<'_>],
) -> Result<(), RunError> {
    let write = |folder: &str, title: &str, stages: &[Charted<'_>]| {
        let charts = Charts {
            title,
            landmarks: &plan.landmarks,
            grid,
            stages,
        };
        charts.write(staging, Path::new(folder))
    };
    let mut last: Vec<Charted<'_>> = Vec::new();
    for CandidateProfiles {
        record: candidate,
        profiles,
    } in candidates
    {
        let stages = candidate.stages.iter().zip(profiles);
        let charted = stages.map(|(record, skin)| Charted {
            name: &record.name,
            measures: &record.measures,
            skin,
        });
        let charted: Vec<Charted<'_>> = charted.collect();
        let title = candidate.title.as_deref().unwrap_or(&candidate.name);
        write(&candidate.name, title, &charted)?;
        if last.is_empty() {
            last.extend(charted.first());
        }
        last.extend(charted.last().map(|stage| Charted {
            name: &candidate.name,
            ..*stage
        }));
    }
    write("", plan.title.as_deref().unwrap_or(&plan.name), &last)
}
