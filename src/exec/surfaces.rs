//! What a run draws and meshes: everything that is made of surfaces and not of samples.
//!
//! It sees volumes in Hounsfield units, whatever type a CT is stored in, so that this half of the program is
//! there once and not once for each type.

use std::path::Path;

use image::RgbImage;

use super::error::RunError;
use super::events::{Phase, Place};
use super::meshes::{StageMeshes, Workshop};
use super::pictures::{Gallery, profile, write_slices};
use super::timings::Clock;
use crate::io::staging::Staging;
use crate::plan::{Candidate, Plan, Stage};
use crate::report::record::SurfaceChange;
use crate::space::GridPoint;
use crate::volume::Volume;

/// The nose as it is, ready for stages to be drawn beside it.
pub(super) struct Surfaces<'a> {
    plan: &'a Plan,
    skin_hu: f64,
    preoperative: Volume<f32>,
    /// Where views are asked for.
    gallery: Option<Gallery<'a>>,
    /// Where meshes or solids are asked for.
    workshop: Option<Workshop<'a>>,
}

/// What is found on the surfaces of a stage, or of the nose as it is.
#[derive(Debug, Default)]
pub(super) struct StageSurfaces {
    pub change: Option<SurfaceChange>,
    pub meshes: StageMeshes,
    /// The skin in the midplane, where charts are drawn.
    pub profile: Option<Vec<GridPoint>>,
    /// Its pictures on the contact sheet, where there is one, beside each other.
    pub tiles: Option<RgbImage>,
}

/// Whether a place is the last stage of its candidate, and the plan has several.
pub(super) fn is_last(plan: &Plan, at: Place<'_>) -> bool {
    let ends_so = |candidate: &Candidate| {
        let last = candidate.stages.last();
        candidate.name == at.candidate && last.is_some_and(|last| last.name == at.stage)
    };
    plan.candidates.len() > 1 && plan.candidates.iter().any(ends_so)
}

/// Whether a plan asks for anything that is made of surfaces.
pub(super) fn wanted(plan: &Plan) -> bool {
    let outputs = plan.outputs;
    outputs.views || outputs.slices || outputs.charts || outputs.mesh || outputs.solids
}

impl<'a> Surfaces<'a> {
    /// Draws and meshes the nose as it is.
    pub(super) fn begin(
        plan: &'a Plan,
        skin_hu: f64,
        preoperative: Volume<f32>,
        staging: &Staging,
        clock: &mut Clock<'_>,
    ) -> Result<(Self, StageSurfaces), RunError> {
        let mut found = StageSurfaces::default();
        if plan.outputs.charts {
            let find = || profile(plan, skin_hu, &preoperative);
            let skin = clock.time(Phase::Profile, None, find);
            found.profile = Some(skin.map_err(RunError::Preoperative)?);
        }
        let gallery = match &plan.views {
            None => None,
            Some(views) => {
                let find = || Gallery::new(plan, views, skin_hu, &preoperative);
                let mut gallery = clock.time(Phase::Surface, None, find)?;
                found.tiles = clock.time(Phase::Views, None, || gallery.preoperative(staging))?;
                Some(gallery)
            }
        };
        let mut workshop = None;
        if plan.outputs.mesh || plan.outputs.solids {
            let begin = || Workshop::begin(plan, skin_hu, &preoperative, staging);
            let (made, record) = clock.time(Phase::Meshes, None, begin)?;
            workshop = Some(made);
            found.meshes.meshes = record;
        }
        let surfaces = Self {
            plan,
            skin_hu,
            preoperative,
            gallery,
            workshop,
        };
        Ok((surfaces, found))
    }

    /// Draws and meshes a stage, whose volume this is, into its folder.
    pub(super) fn stage(
        &self,
        volume: &Volume<f32>,
        stage: &Stage,
        folder: &Path,
        at: Place<'_>,
        (staging, clock): (&Staging, &mut Clock<'_>),
    ) -> Result<StageSurfaces, RunError> {
        let (plan, skin_hu) = (self.plan, self.skin_hu);
        let caption = format!("{}, {}", at.candidate, at.stage);
        let mut found = StageSurfaces::default();
        if let Some(gallery) = &self.gallery {
            let find = || gallery.surfaces(volume);
            let surfaces = clock.time(Phase::Surface, Some(at), find)?;
            let draw = || gallery.stage(staging, folder, &caption, &surfaces);
            found.change = clock.time(Phase::Views, Some(at), draw)?;
            if is_last(plan, at) {
                let draw = || gallery.on_sheet(&surfaces);
                found.tiles = Some(clock.time(Phase::Sheet, Some(at), draw)?);
            }
        }
        if plan.outputs.slices {
            let volumes = [&self.preoperative, volume];
            let tip = stage.target.tip;
            clock.time(Phase::Slices, Some(at), || {
                write_slices(staging, folder, plan, skin_hu, volumes, tip, &caption)
            })?;
        }
        if plan.outputs.charts {
            let find = || profile(plan, skin_hu, volume);
            let skin = clock.time(Phase::Profile, Some(at), find);
            found.profile = Some(skin.map_err(|source| RunError::Measure {
                at: at.into(),
                source,
            })?);
        }
        if let Some(workshop) = &self.workshop {
            found.meshes = clock.time(Phase::Meshes, Some(at), || {
                workshop.stage(staging, folder, &self.preoperative, volume)
            })?;
        }
        Ok(found)
    }
}
