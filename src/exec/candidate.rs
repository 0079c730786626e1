//! One candidate of a plan, computed stage by stage, or kept from an earlier run.

use std::path::Path;

use image::RgbImage;

use super::comparison::{self, Skins};
use super::error::RunError;
use super::events::{Event, Phase, Place};
use super::kept::{self, Because, Beside, Hit, Keys, StageNote, note, stage_name};
use super::operation::Operation;
use super::pictures::PicturesError;
use super::run::{measure, stage_folder};
use super::steps::{compares, phases_of_stage};
use super::surfaces::{StageSurfaces, Surfaces};
use super::timings::Clock;
use crate::io::nifti::{Template, save_displacement, save_volume};
use crate::io::nrrd::{self, OutputType};
use crate::io::staging::Staging;
use crate::morph::audit::WarpAudit;
use crate::morph::displacement::fill_component;
use crate::morph::field::Field;
use crate::morph::inverse::InverseAudit;
use crate::picture::encode_png;
use crate::plan::{Candidate, Model, Plan, Stage};
use crate::report::record::{CandidateRecord, Measures, OperationRecord, StageRecord};
use crate::space::{Grid, GridPoint};
use crate::surface::SeenSkin;
use crate::volume::{Copies, Sample, Volume};

/// What all candidates of a run share.
pub(super) struct Bench<'a, T> {
    pub plan: &'a Plan,
    pub keys: &'a Keys,
    /// Where tissue begins: the plan's threshold, or what the CT gave for it.
    pub skin_hu: f64,
    pub template: &'a Template,
    /// How samples are written as NRRD: the same at every stage, whose values lie among the CT's.
    pub nrrd: OutputType,
    pub staging: &'a Staging,
    /// Copies of the preoperative volume, and memory for others.
    pub copies: Copies<'a, T>,
    /// The record of the nose as it is.
    pub start: StageRecord,
    /// Where anything is computed that is drawn or meshed.
    pub surfaces: Option<Surfaces<'a>>,
    /// Where skins are compared, and not all of them are kept.
    pub skins: Option<Skins<'a>>,
    /// Whether what compares candidates is made, and not kept.
    pub compares: bool,
}

/// A candidate that was computed, or kept.
pub(super) struct Finished {
    pub record: CandidateRecord,
    pub warnings: Vec<String>,
    /// The skin of every stage in the midplane, where charts are drawn.
    pub profiles: Vec<Option<Vec<GridPoint>>>,
    /// The skin that it ends with, where skins are compared.
    pub skin: Option<SeenSkin>,
    /// Its pictures on the contact sheet, as PNG, where it was drawn.
    pub tiles: Option<Vec<u8>>,
    /// Stages that were kept.
    pub kept: usize,
}

/// A stage that was computed.
struct Computed<T> {
    operation: Operation,
    volume: Volume<T>,
    note: StageNote,
    tiles: Option<RgbImage>,
}

/// What a stage did to a volume.
struct Examined<'a> {
    field: Field<'a>,
    warp: WarpAudit,
    measures: Measures,
    drawn: StageSurfaces,
}

impl<T: Sample> Bench<'_, T> {
    /// The volume that candidates are made of.
    pub(super) fn preoperative(&self) -> &Volume<T> {
        self.copies.original()
    }

    /// Computes or keeps a candidate of the plan, by its place in it.
    pub(super) fn candidate(
        &self,
        at: usize,
        outlook: &[Result<Hit<StageNote>, Because>],
        clock: &mut Clock<'_>,
    ) -> Result<Finished, RunError> {
        let candidate = &self.plan.candidates[at];
        let keys = &self.keys.stages[at];
        let mut finished = Finished {
            record: CandidateRecord {
                name: candidate.name.clone(),
                title: candidate.title.clone(),
                swept: candidate.swept.clone(),
                sweep: candidate.sweep.clone(),
                stages: vec![self.start.clone()],
                accept: None,
            },
            warnings: Vec::new(),
            profiles: Vec::new(),
            skin: None,
            tiles: None,
            kept: 0,
        };
        let mut before: Option<Volume<T>> = None;
        for (place, stage) in candidate.stages.iter().enumerate() {
            let is_last = place + 1 == candidate.stages.len();
            let name = stage_name(candidate, place);
            let found = match outlook.get(place) {
                Some(Ok(hit)) => {
                    let count = phases_of_stage(self.plan, candidate, place).len();
                    clock.tell(&Event::Kept(count));
                    for warning in &hit.found().warnings {
                        clock.tell(&Event::Warning(warning.clone()));
                    }
                    finished.kept += 1;
                    if is_last && self.compares && self.keys.skins.is_some() {
                        finished.skin = self.kept_skin(candidate, hit, clock)?;
                    }
                    before = None;
                    hit.found().clone()
                }
                _ => {
                    let source = match before.take() {
                        None => self.volume_before(candidate, place, clock)?,
                        before => before,
                    };
                    let mut computed = self.stage(candidate, place, source, clock)?;
                    if is_last {
                        finished.skin = self.skin(&computed.volume, candidate, stage, clock)?;
                        computed.note.skin.clone_from(&self.keys.skins);
                    }
                    let png = computed.tiles.as_ref().map(encode_png).transpose();
                    finished.tiles = png.map_err(PicturesError::from)?;
                    let skin = finished.skin.as_ref().map(SeenSkin::to_bytes);
                    let skin = skin.iter().map(|bytes| (Beside::Skin, &bytes[..]));
                    let tiles = finished.tiles.iter();
                    let tiles = tiles.map(|bytes| (Beside::Tiles, &bytes[..]));
                    let beside: Vec<_> = skin.chain(tiles).collect();
                    let files = kept::files_of_stage(self.staging, candidate, place)?;
                    let key = &keys[place];
                    note(self.staging, &name, key, &computed.note, files, &beside)?;
                    // Only `lee2001` samples the volume of the stage before.
                    if self.plan.morph.model == Model::Lee2001 && !is_last {
                        before = Some(computed.volume);
                    } else {
                        computed.operation.give_back(computed.volume, &self.copies);
                    }
                    computed.note
                }
            };
            finished.add(stage, found);
        }
        let accept = self.plan.accept.as_ref();
        let changes = || comparison::changes(&finished.record);
        finished.record.accept = accept.map(|accept| accept.verdict(&changes()));
        Ok(finished)
    }

    /// The volume that a stage begins with, where those before it were kept; none where that is the preoperative
    /// one, or the stage does not sample it.
    fn volume_before(
        &self,
        candidate: &Candidate,
        place: usize,
        clock: &mut Clock<'_>,
    ) -> Result<Option<Volume<T>>, RunError> {
        let mut before: Option<Volume<T>> = None;
        if self.plan.morph.model != Model::Lee2001 {
            return Ok(None);
        }
        for earlier in 0..place {
            let at = place_of(candidate, &candidate.stages[earlier]);
            let grid = self.preoperative().grid();
            let operation = Operation::new(self.plan, candidate, earlier, grid)?;
            let source = before.as_ref().unwrap_or(self.preoperative());
            before = Some(operation.volume(source, &self.copies, at, clock)?);
        }
        Ok(before)
    }

    /// The skin of a candidate of which the last stage is kept. Where it is kept for another box, as that depends on
    /// all candidates, it is found again.
    fn kept_skin(
        &self,
        candidate: &Candidate,
        hit: &Hit<StageNote>,
        clock: &mut Clock<'_>,
    ) -> Result<Option<SeenSkin>, RunError> {
        let last = candidate.stages.len() - 1;
        let name = stage_name(candidate, last);
        if hit.found().skin == self.keys.skins {
            let bytes = kept::read_beside(self.staging, &name, Beside::Skin)?;
            return Ok(SeenSkin::from_bytes(self.preoperative().grid(), &bytes));
        }
        let stage = &candidate.stages[last];
        let before = self.volume_before(candidate, last, clock)?;
        let operation = Operation::new(self.plan, candidate, last, self.preoperative().grid())?;
        let source = before.as_ref().unwrap_or(self.preoperative());
        let at = place_of(candidate, stage);
        let volume = operation.volume(source, &self.copies, at, clock)?;
        drop(before);
        let skin = self.skin(&volume, candidate, stage, clock)?;
        operation.give_back(volume, &self.copies);
        if let Some(skin) = &skin {
            let depends_on = self.keys.skins.clone();
            hit.with_skin(self.staging, &skin.to_bytes(), depends_on)?;
        }
        Ok(skin)
    }

    /// The skin that a candidate ends with, where skins are compared.
    fn skin(
        &self,
        volume: &Volume<T>,
        candidate: &Candidate,
        stage: &Stage,
        clock: &mut Clock<'_>,
    ) -> Result<Option<SeenSkin>, RunError> {
        let Some(skins) = &self.skins else {
            return Ok(None);
        };
        let at = place_of(candidate, stage);
        let skin = clock.time(Phase::Skins, Some(at), || skins.find(volume))?;
        Ok(Some(skin))
    }

    fn stage(
        &self,
        candidate: &Candidate,
        place: usize,
        before: Option<Volume<T>>,
        clock: &mut Clock<'_>,
    ) -> Result<Computed<T>, RunError> {
        let (plan, preoperative) = (self.plan, self.preoperative());
        let stage = &candidate.stages[place];
        let at = place_of(candidate, stage);
        let mut warnings = Vec::new();
        let operation = Operation::new(plan, candidate, place, preoperative.grid())?;
        let source = before.as_ref().unwrap_or(preoperative);
        let volume = operation.volume(source, &self.copies, at, clock)?;
        let adaptive_error = if compares(plan) {
            let compare = || operation.adaptive_error(preoperative, source);
            Some(clock.time(Phase::Compare, Some(at), compare)?)
        } else {
            None
        };
        // A volume less in memory while the rest is done.
        drop(before);
        let folder = stage_folder(candidate, place);
        let mut writing = clock.beside();
        let write = || self.write_volume(&volume, &folder, at, &mut writing);
        let mut examine = || self.examine(&operation, &volume, stage, &folder, at, clock);
        let outputs = plan.outputs;
        let (written, examined) = if outputs.volume || outputs.nrrd {
            // A volume is deflated on one core: the others go on.
            rayon::join(write, examine)
        } else {
            (Ok(()), examine())
        };
        let Examined {
            field,
            warp,
            measures,
            drawn,
        } = examined?;
        written?;
        clock.join(writing);
        let folded = warp.jacobian_min <= 0.0;
        if folded {
            let warning = format!(
                "candidate `{}`, stage `{}`: the map is folded (smallest Jacobian determinant {:.3})",
                at.candidate, at.stage, warp.jacobian_min
            );
            clock.tell(&Event::Warning(warning.clone()));
            warnings.push(warning);
        }
        self.write_displacement(&field, volume.grid(), &folder, at, clock)?;
        let inverse = self.inverse(&operation, &field, &folder, at, clock)?;
        if let Some(warning) = inverse.as_ref().and_then(|audit| not_inverted(audit, at)) {
            clock.tell(&Event::Warning(warning.clone()));
            warnings.push(warning);
        }
        drop(field);
        let note = StageNote {
            measures,
            warp,
            folded,
            adaptive_error,
            surface_change: drawn.change,
            meshes: drawn.meshes.meshes,
            solids: drawn.meshes.solids,
            inverse,
            warnings,
            profile: drawn.profile,
            skin: None,
        };
        Ok(Computed {
            operation,
            volume,
            note,
            tiles: drawn.tiles,
        })
    }

    /// What a stage did to the volume: the map's audit, the measures, and what is drawn.
    fn examine<'o>(
        &self,
        operation: &'o Operation,
        volume: &Volume<T>,
        stage: &Stage,
        folder: &Path,
        at: Place<'_>,
        clock: &mut Clock<'_>,
    ) -> Result<Examined<'o>, RunError> {
        // At half scale this evaluates the map: once, for the audit and for what is written.
        let (field, warp) = clock.time(Phase::Audit, Some(at), || {
            let field = operation.displacement()?;
            let warp = operation.audit(&field);
            Ok::<_, RunError>((field, warp))
        })?;
        let measures = clock
            .time(Phase::Measure, Some(at), || {
                measure(self.plan, self.skin_hu, volume, stage.source, stage.target)
            })
            .map_err(|source| RunError::Measure {
                at: at.into(),
                source,
            })?;
        let drawn = match &self.surfaces {
            None => StageSurfaces::default(),
            Some(surfaces) => {
                surfaces.stage(&volume.to_hu()?, stage, folder, at, (self.staging, clock))?
            }
        };
        Ok(Examined {
            field,
            warp,
            measures,
            drawn,
        })
    }

    /// The way back, where it is asked for.
    fn inverse(
        &self,
        operation: &Operation,
        field: &Field<'_>,
        folder: &Path,
        at: Place<'_>,
        clock: &mut Clock<'_>,
    ) -> Result<Option<InverseAudit>, RunError> {
        if !self.plan.outputs.inverse {
            return Ok(None);
        }
        let path = self
            .staging
            .begin(folder.join("displacement-inverse.nii.gz"))?;
        let template = self.template;
        let audit = clock.time(Phase::Inverse, Some(at), || {
            let inverse = operation.inverse(field)?;
            save_displacement(&path, template, |component, slab, to| {
                inverse.fill_component(template.grid(), component, slab.start, to);
            })?;
            Ok::<_, RunError>(inverse.audit())
        })?;
        Ok(Some(audit))
    }

    fn write_volume(
        &self,
        volume: &Volume<T>,
        folder: &Path,
        at: Place<'_>,
        clock: &mut Clock<'_>,
    ) -> Result<(), RunError> {
        let outputs = self.plan.outputs;
        if outputs.volume {
            let path = self.staging.begin(folder.join("volume.nii.gz"))?;
            clock.time(Phase::WriteVolume, Some(at), || {
                save_volume(&path, self.template, volume)
            })?;
        }
        if outputs.nrrd {
            let path = self.staging.begin(folder.join("volume.nrrd"))?;
            clock.time(Phase::WriteNrrd, Some(at), || {
                nrrd::save_volume(&path, self.template, volume, self.nrrd)
            })?;
        }
        Ok(())
    }

    fn write_displacement(
        &self,
        field: &Field<'_>,
        grid: &Grid,
        folder: &Path,
        at: Place<'_>,
        clock: &mut Clock<'_>,
    ) -> Result<(), RunError> {
        if self.plan.outputs.displacement {
            let path = self.staging.begin(folder.join("displacement.nii.gz"))?;
            clock.time(Phase::WriteDisplacement, Some(at), || {
                save_displacement(&path, self.template, |component, slab, to| {
                    fill_component(field, grid, component, slab.start, to);
                })
            })?;
        }
        Ok(())
    }
}

impl Finished {
    /// Adds a stage to the record.
    fn add(&mut self, stage: &Stage, found: StageNote) {
        let operation = OperationRecord {
            kind: stage.kind,
            edits: stage.edits.clone(),
            source_mm: stage.source,
            target_mm: stage.target,
            width: stage.width,
        };
        self.record
            .stages
            .push(found.record(&stage.name, Some(operation)));
        self.warnings.extend(found.warnings);
        self.profiles.push(found.profile);
    }
}

fn place_of<'a>(candidate: &'a Candidate, stage: &'a Stage) -> Place<'a> {
    Place {
        candidate: &candidate.name,
        stage: &stage.name,
    }
}

/// What the user should know of a map that has no inverse everywhere.
fn not_inverted(audit: &InverseAudit, at: Place<'_>) -> Option<String> {
    (audit.not_converged > 0).then(|| {
        format!(
            "candidate `{}`, stage `{}`: the map has no inverse within {} voxels at {} of the CT's voxels; the nearest found is up to {:.3} mm off",
            at.candidate,
            at.stage,
            audit.tolerance_voxels,
            audit.not_converged,
            audit.residual_max_mm
        )
    })
}
