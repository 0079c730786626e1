//! What a run draws and meshes: everything that is made of surfaces and not of samples.
//!
//! It sees volumes in Hounsfield units, whatever type a CT is stored in, so that this half of the program is
//! there once and not once for each type.

use std::path::Path;

use super::error::RunError;
use super::events::{Phase, Place};
use super::meshes::{StageMeshes, Workshop};
use super::pictures::{Gallery, Profiles, write_charts, write_slices};
use super::timings::Clock;
use crate::io::staging::Staging;
use crate::plan::{Candidate, Plan, Stage};
use crate::report::meshes::MeshesRecord;
use crate::report::record::{CandidateRecord, SurfaceChange};
use crate::volume::Volume;

/// The nose as it is, ready for stages to be drawn beside it.
pub(super) struct Surfaces<'a> {
    plan: &'a Plan,
    skin_hu: f64,
    preoperative: Volume<f32>,
    /// Where views are asked for.
    gallery: Option<Gallery<'a>>,
    /// Filled where charts are asked for.
    profiles: Profiles,
    /// Where meshes or solids are asked for.
    workshop: Option<Workshop<'a>>,
}

/// What the record of a stage says of its surfaces.
#[derive(Debug, Default)]
pub(super) struct StageSurfaces {
    pub change: Option<SurfaceChange>,
    pub meshes: StageMeshes,
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
        staging: &mut Staging,
        clock: &mut Clock<'_>,
    ) -> Result<(Self, Option<MeshesRecord>), RunError> {
        let profiles = if plan.outputs.charts {
            let find = || Profiles::preoperative(plan, skin_hu, &preoperative);
            clock
                .time(Phase::Profile, None, find)
                .map_err(RunError::Preoperative)?
        } else {
            Profiles::default()
        };
        let gallery = match &plan.views {
            None => None,
            Some(views) => {
                let find = || Gallery::new(plan, views, skin_hu, &preoperative);
                let mut gallery = clock.time(Phase::Surface, None, find)?;
                clock.time(Phase::Views, None, || gallery.preoperative(staging))?;
                Some(gallery)
            }
        };
        let mut meshes = None;
        let mut workshop = None;
        if plan.outputs.mesh || plan.outputs.solids {
            let begin = || Workshop::begin(plan, skin_hu, &preoperative, staging);
            let (made, record) = clock.time(Phase::Meshes, None, begin)?;
            workshop = Some(made);
            meshes = record;
        }
        let surfaces = Self {
            plan,
            skin_hu,
            preoperative,
            gallery,
            profiles,
            workshop,
        };
        Ok((surfaces, meshes))
    }

    /// Draws and meshes a stage, whose volume this is, into its folder.
    pub(super) fn stage(
        &mut self,
        volume: &Volume<f32>,
        stage: &Stage,
        folder: &Path,
        at: Place<'_>,
        (staging, clock): (&mut Staging, &mut Clock<'_>),
    ) -> Result<StageSurfaces, RunError> {
        let (plan, skin_hu) = (self.plan, self.skin_hu);
        let caption = format!("{}, {}", at.candidate, at.stage);
        let mut found = StageSurfaces::default();
        if let Some(gallery) = &mut self.gallery {
            let find = || gallery.surfaces(volume);
            let surfaces = clock.time(Phase::Surface, Some(at), find)?;
            let draw = || gallery.stage(staging, folder, &caption, &surfaces);
            found.change = clock.time(Phase::Views, Some(at), draw)?;
            if is_last(plan, at) {
                let add = || gallery.add_to_sheet(staging, at.candidate, &surfaces);
                clock.time(Phase::Sheet, Some(at), add)?;
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
            let add = || self.profiles.add(plan, skin_hu, volume);
            let added = clock.time(Phase::Profile, Some(at), add);
            added.map_err(|source| RunError::Measure {
                at: at.into(),
                source,
            })?;
        }
        if let Some(workshop) = &self.workshop {
            found.meshes = clock.time(Phase::Meshes, Some(at), || {
                workshop.stage(staging, folder, &self.preoperative, volume)
            })?;
        }
        Ok(found)
    }

    /// Draws what compares stages and candidates.
    pub(super) fn finish(
        &self,
        candidates: &[CandidateRecord],
        staging: &mut Staging,
        clock: &mut Clock<'_>,
    ) -> Result<(), RunError> {
        if !self.plan.outputs.charts {
            return Ok(());
        }
        let grid = self.preoperative.grid();
        clock.time(Phase::Charts, None, || {
            write_charts(staging, self.plan, grid, candidates, &self.profiles)
        })
    }
}
