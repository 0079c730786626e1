//! One plan, computed from its CT to its tables.

use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

use super::comparison::{self, Skins};
use super::ct::{self, Ct};
use super::error::RunError;
use super::events::{Event, Observer, Phase, Place};
use super::nose::{nose_exists, regions_hold_a_nose, skin_exists};
use super::operation::Operation;
use super::preflight::{Ready, output_folder};
use super::skin::skin_hu;
use super::skin_landmarks::{SkinLandmark, moved, skin_landmarks};
use super::surfaces::{self, StageSurfaces, Surfaces};
use super::timings::{Clock, Timings};
use crate::compare::SurfaceDifference;
use crate::feature::FeatureLine;
use crate::io::artifact::save;
use crate::io::nifti::{Template, save_displacement, save_volume};
use crate::io::nrrd::{self, OutputType};
use crate::io::staging::Staging;
use crate::measure::{MeasureError, NoseGeometry, RegionVolumes, Slabs, region_volumes};
use crate::morph::audit::WarpAudit;
use crate::morph::displacement::fill_component;
use crate::morph::field::Field;
use crate::morph::inverse::InverseAudit;
use crate::plan::{Candidate, Found, Method, Model, Plan, Scale};
use crate::report::record::{
    CandidateRecord, FORMAT, Inputs, Measures, OperationRecord, PREOPERATIVE, PlanRecord, Program,
    RunRecord, SnapRecord, SnappedLandmark, StageRecord,
};
use crate::report::{csv, markdown};
use crate::segment::segment;
use crate::space::{Grid, GridPoint};
use crate::volume::{Rescale, Sample, Volume};
use crate::with_volume;

/// A finished run.
#[derive(Debug, Clone, Serialize)]
pub struct RunReport {
    /// The folder that holds its outputs.
    #[serde(serialize_with = "shown")]
    pub folder: PathBuf,
    /// What `run.json` holds.
    pub record: RunRecord,
    /// What `timings.json` holds.
    pub timings: Timings,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Files of earlier runs that this plan does not write and that were removed, by their names in the folder.
    pub removed: Vec<String>,
}

/// A path need not be Unicode, a document must be.
fn shown<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
    to.collect_str(&path.display())
}

/// Computes every candidate and stage of a plan and puts the outputs into `out`, in a folder of the plan's
/// name: all of them at the end, or none.
///
/// # Errors
/// [`RunError`]; what earlier runs wrote is then as it was.
pub fn run(ready: &Ready, out: &Path, observer: &dyn Observer) -> Result<RunReport, RunError> {
    let plan = &ready.plan;
    let folder = output_folder(out, plan);
    let mut clock = Clock::new(observer);
    let phases = phases(plan).len();
    clock.tell(&Event::PlanStarted {
        plan: &plan.name,
        phases,
    });
    let mut staging = Staging::new(&folder)?;
    // Of this disk: told, but not part of the record.
    let mut warnings: Vec<String> = staging.warning().into_iter().collect();
    for warning in &warnings {
        clock.tell(&Event::Warning(warning.clone()));
    }
    let (ct, skin_hu) = clock.time(Phase::Read, None, || {
        let ct = ct::load(&plan.ct)?;
        let skin_hu = skin_hu(&plan.segment, &ct.volume)?;
        Ok::<_, RunError>((ct, skin_hu))
    })?;
    let (found, moved) = clock.time(
        Phase::Landmarks,
        None,
        || with_volume!(&ct.volume, volume => look_at_landmarks(ready, skin_hu, volume, ct.record.hu_range)),
    )?;
    let plan = moved.as_ref().unwrap_or(plan);
    let mut session = Session {
        plan,
        skin_hu,
        template: &ct.template,
        nrrd: OutputType::choose(
            ct.record.sample_type,
            Rescale {
                slope: ct.record.slope,
                intercept: ct.record.intercept,
            },
            ct.record.hu_range,
        ),
        staging: &mut staging,
        clock: &mut clock,
        warnings: Vec::new(),
        of_input: Vec::new(),
        surfaces: None,
        skins: None,
    };
    if let Some(warning) = ready.ct.warning() {
        session.warn(warning);
    }
    for landmark in &found {
        if let Some(warning) = landmark.warning(plan.snap_mm) {
            session.warn(warning);
        }
    }
    let candidates = with_volume!(&ct.volume, volume => session.candidates(volume))?;
    let surface_differences = session.surface_differences();
    let of_input = session.of_input;
    warnings.extend(session.warnings);
    let record = RunRecord {
        format: FORMAT,
        program: Program::THIS,
        inputs: Inputs {
            plan_sha256: ready.sha256.clone(),
            landmarks_sha256: ready.landmarks_sha256.clone(),
            ct: ct.record.clone(),
        },
        plan: PlanRecord::new(
            plan,
            skin_hu,
            ct.volume.grid(),
            snap_record(plan, &found, ct.volume.grid()),
        ),
        warnings: of_input,
        candidates,
        surface_differences,
    };
    let effective = ready.source.effective(
        plan,
        Found {
            grid: ct.volume.grid(),
            ct_sha256: &ct.record.sha256,
            skin_hu,
        },
    );
    drop::<Ct>(ct);
    clock.time(Phase::Publish, None, || {
        write_tables(&mut staging, &record)?;
        if let Some(text) = effective {
            save(
                &staging.begin_unlisted("plan.effective.toml")?,
                text.as_bytes(),
            )?;
        }
        Ok::<_, RunError>(staging.digest()?)
    })?;
    let timings = clock.timings(&plan.name);
    write_json(&staging.begin_unlisted("timings.json")?, &timings)?;
    // Last, so that a folder with a record is a finished run.
    write_json(&staging.begin_unlisted("run.json")?, &record)?;
    let published = staging.publish()?;
    for name in published.kept {
        let warning = format!(
            "`{}` is of an earlier run, and this plan does not write it; it was changed since, so it was left",
            folder.join(name).display()
        );
        clock.tell(&Event::Warning(warning.clone()));
        warnings.push(warning);
    }
    clock.tell(&Event::PlanFinished);
    Ok(RunReport {
        folder,
        record,
        timings,
        warnings,
        removed: published.removed,
    })
}

/// How far the landmarks of the skin are from it, and the plan with those moved that it asks to be moved:
/// resolved anew, so that f1, the cage and every edit follow. Refused where they are on no nose.
fn look_at_landmarks<T: Sample>(
    ready: &Ready,
    skin_hu: f64,
    volume: &Volume<T>,
    hu_range: [f64; 2],
) -> Result<(Vec<SkinLandmark>, Option<Plan>), RunError> {
    let landmarks = &ready.plan.landmarks;
    let head = segment(volume, skin_hu, ready.plan.segment.keep_largest)?;
    skin_exists(&head, skin_hu, hu_range)?;
    let found = skin_landmarks(landmarks, skin_hu, volume, &head)?;
    nose_exists(&found, landmarks, &head, volume.grid())?;
    let Some(snap_mm) = ready.plan.snap_mm else {
        return Ok((found, None));
    };
    let moved = moved(&found, snap_mm);
    let plan = ready.source.resolve_moved(&ready.ct.grid, &moved);
    Ok((found, Some(plan.map_err(RunError::Snapped)?)))
}

/// What the record says of landmarks that were to be moved.
fn snap_record(plan: &Plan, found: &[SkinLandmark], grid: &Grid) -> Option<SnapRecord> {
    let mm = plan.snap_mm?;
    let moved = found.iter().filter_map(|landmark| {
        let skin = landmark.snapped(mm)?;
        Some(SnappedLandmark {
            name: landmark.landmark.name(),
            from_voxel: grid.grid_to_index(landmark.at),
            to_voxel: grid.grid_to_index(skin.point),
            distance_mm: skin.distance_mm,
        })
    });
    Some(SnapRecord {
        mm,
        moved: moved.collect(),
    })
}

/// The phases that a plan takes, in order.
pub fn phases(plan: &Plan) -> Vec<(Phase, Option<Place<'_>>)> {
    let outputs = plan.outputs;
    let at_start = [
        (Phase::Read, true),
        (Phase::Landmarks, true),
        (Phase::Measure, true),
        (Phase::Profile, outputs.charts),
        (Phase::Surface, outputs.views),
        (Phase::Views, outputs.views),
        (Phase::Meshes, outputs.mesh || outputs.solids),
        (Phase::Skins, Skins::are_wanted(plan)),
    ];
    let mut phases: Vec<(Phase, Option<Place<'_>>)> = Vec::new();
    let wanted = at_start.into_iter().filter(|(_, wanted)| *wanted);
    phases.extend(wanted.map(|(phase, _)| (phase, None)));
    for candidate in &plan.candidates {
        for (number, stage) in candidate.stages.iter().enumerate() {
            let is_last = number + 1 == candidate.stages.len();
            let place = Place {
                candidate: &candidate.name,
                stage: &stage.name,
            };
            let halves = plan.morph.model == Model::Lee2001 && plan.morph.scale == Scale::Half;
            let of_stage = [
                (Phase::Half, halves),
                (Phase::Morph, true),
                (Phase::Upsample, halves),
                (Phase::Compare, compares(plan)),
                (Phase::Audit, true),
                (Phase::Measure, true),
                (Phase::WriteVolume, outputs.volume),
                (Phase::WriteNrrd, outputs.nrrd),
                (Phase::WriteDisplacement, outputs.displacement),
                (Phase::Surface, outputs.views),
                (Phase::Views, outputs.views),
                (
                    Phase::Sheet,
                    outputs.views && surfaces::is_last(plan, place),
                ),
                (Phase::Slices, outputs.slices),
                (Phase::Profile, outputs.charts),
                (Phase::Meshes, outputs.mesh || outputs.solids),
                (Phase::Inverse, outputs.inverse),
                (Phase::Skins, is_last && Skins::are_wanted(plan)),
            ];
            let wanted = of_stage.into_iter().filter(|(_, wanted)| *wanted);
            phases.extend(wanted.map(|(phase, _)| (phase, Some(place))));
        }
    }
    if outputs.charts {
        phases.push((Phase::Charts, None));
    }
    if Skins::are_wanted(plan) {
        phases.push((Phase::Skins, None));
    }
    phases.push((Phase::Publish, None));
    phases
}

/// The folder of a stage's own outputs within the plan's: `<candidate>/<NN>-<stage>`.
pub fn stage_folder(candidate: &Candidate, place: usize) -> PathBuf {
    let name = candidate
        .stages
        .get(place)
        .map_or("", |stage| stage.name.as_str());
    Path::new(&candidate.name).join(format!("{:02}-{name}", place + 1))
}

fn compares(plan: &Plan) -> bool {
    plan.morph.compare_exact && plan.morph.method != Method::Exact
}

struct Session<'a, 'b> {
    plan: &'a Plan,
    /// Where tissue begins: the plan's threshold, or what the CT gave for it.
    skin_hu: f64,
    template: &'a Template,
    /// How samples are written as NRRD: the same at every stage, whose values lie among the CT's.
    nrrd: OutputType,
    staging: &'a mut Staging,
    clock: &'a mut Clock<'b>,
    warnings: Vec<String>,
    /// Those of the CT and its landmarks. What is told of a stage its record holds as numbers.
    of_input: Vec<String>,
    /// Set once the nose as it is was drawn, where anything is drawn or meshed.
    surfaces: Option<Surfaces<'a>>,
    /// The skins of the candidates so far, where they are compared.
    skins: Option<Skins>,
}

impl Session<'_, '_> {
    fn warn(&mut self, warning: String) {
        self.clock.tell(&Event::Warning(warning.clone()));
        self.warnings.push(warning);
    }

    fn candidates<T: Sample>(
        &mut self,
        preoperative: &Volume<T>,
    ) -> Result<Vec<CandidateRecord>, RunError> {
        let (plan, skin_hu) = (self.plan, self.skin_hu);
        let measures = self
            .clock
            .time(Phase::Measure, None, || {
                measure(plan, skin_hu, preoperative, plan.f1, plan.f1)
            })
            .map_err(RunError::Preoperative)?;
        let slabs = Slabs::new(&plan.landmarks).map_err(RunError::Preoperative)?;
        let volumes = RegionVolumes(measures.volume_mm3);
        if let Some(warning) = regions_hold_a_nose(&volumes, &slabs, plan.f1.tip)? {
            self.warn(warning);
        }
        self.of_input.clone_from(&self.warnings);
        let mut start = StageRecord {
            name: PREOPERATIVE.to_owned(),
            operation: None,
            measures,
            warp: WarpAudit::IDENTITY,
            folded: false,
            adaptive_error: None,
            surface_change: None,
            meshes: None,
            solids: None,
            inverse: None,
        };
        if surfaces::wanted(plan) {
            let hu = preoperative.to_hu()?;
            let (surfaces, meshes) = Surfaces::begin(plan, skin_hu, hu, self.staging, self.clock)?;
            self.surfaces = Some(surfaces);
            start.meshes = meshes;
        }
        if Skins::are_wanted(plan) {
            let find = || Skins::new(plan, skin_hu, preoperative);
            self.skins = Some(self.clock.time(Phase::Skins, None, find)?);
        }
        let candidates = plan.candidates.iter();
        let candidates: Vec<CandidateRecord> = candidates
            .map(|candidate| self.candidate(candidate, preoperative, start.clone()))
            .collect::<Result<_, _>>()?;
        if let Some(surfaces) = &self.surfaces {
            surfaces.finish(&candidates, self.staging, self.clock)?;
        }
        Ok(candidates)
    }

    /// How far the skins of the candidates are apart.
    fn surface_differences(&mut self) -> Vec<SurfaceDifference> {
        let Some(skins) = self.skins.take() else {
            return Vec::new();
        };
        self.clock.time(Phase::Skins, None, || skins.differences())
    }

    fn candidate<T: Sample>(
        &mut self,
        candidate: &Candidate,
        preoperative: &Volume<T>,
        start: StageRecord,
    ) -> Result<CandidateRecord, RunError> {
        let mut stages = vec![start];
        let mut before: Option<Volume<T>> = None;
        for place in 0..candidate.stages.len() {
            let (volume, record) = self.stage(candidate, place, preoperative, before)?;
            stages.push(record);
            if let (Some(skins), Some(last)) = (&mut self.skins, candidate.stages.last())
                && place + 1 == candidate.stages.len()
            {
                let at = Place {
                    candidate: &candidate.name,
                    stage: &last.name,
                };
                let add = || skins.add(&candidate.name, &volume);
                self.clock.time(Phase::Skins, Some(at), add)?;
            }
            // Only `lee2001` samples the volume of the stage before.
            before = (self.plan.morph.model == Model::Lee2001).then_some(volume);
        }
        let mut record = CandidateRecord {
            name: candidate.name.clone(),
            title: candidate.title.clone(),
            swept: candidate.swept.clone(),
            stages,
            accept: None,
        };
        let accept = self.plan.accept.as_ref();
        record.accept = accept.map(|accept| accept.verdict(&comparison::changes(&record)));
        Ok(record)
    }

    fn stage<T: Sample>(
        &mut self,
        candidate: &Candidate,
        place: usize,
        preoperative: &Volume<T>,
        before: Option<Volume<T>>,
    ) -> Result<(Volume<T>, StageRecord), RunError> {
        let (plan, skin_hu) = (self.plan, self.skin_hu);
        let stage = &candidate.stages[place];
        let at = Place {
            candidate: &candidate.name,
            stage: &stage.name,
        };
        let operation = Operation::new(plan, candidate, place, preoperative.grid())?;
        let source = before.as_ref().unwrap_or(preoperative);
        let volume = operation.volume(preoperative, source, at, self.clock)?;
        let adaptive_error = if compares(plan) {
            let compare = || operation.adaptive_error(preoperative, source);
            Some(self.clock.time(Phase::Compare, Some(at), compare)?)
        } else {
            None
        };
        // A volume less in memory while the rest is done.
        drop(before);
        // At half scale this evaluates the map: once, for the audit and for what is written.
        let (field, warp) = self.clock.time(Phase::Audit, Some(at), || {
            let field = operation.displacement()?;
            let warp = operation.audit(&field);
            Ok::<_, RunError>((field, warp))
        })?;
        let folded = warp.jacobian_min <= 0.0;
        if folded {
            self.warn(format!(
                "candidate `{}`, stage `{}`: the map is folded (smallest Jacobian determinant {:.3})",
                at.candidate, at.stage, warp.jacobian_min
            ));
        }
        let measures = self
            .clock
            .time(Phase::Measure, Some(at), || {
                measure(plan, skin_hu, &volume, stage.source, stage.target)
            })
            .map_err(|source| RunError::Measure {
                at: at.into(),
                source,
            })?;
        let folder = stage_folder(candidate, place);
        self.write(&field, &volume, &folder, at)?;
        let drawn = match &mut self.surfaces {
            None => StageSurfaces::default(),
            Some(surfaces) => {
                let to = (&mut *self.staging, &mut *self.clock);
                surfaces.stage(&volume.to_hu()?, stage, &folder, at, to)?
            }
        };
        let inverse = self.inverse(&operation, &field, &folder, at)?;
        let record = StageRecord {
            name: stage.name.clone(),
            operation: Some(OperationRecord {
                kind: stage.kind,
                edits: stage.edits.clone(),
                source_mm: stage.source,
                target_mm: stage.target,
                width: stage.width,
            }),
            measures,
            warp,
            folded,
            adaptive_error,
            surface_change: drawn.change,
            meshes: drawn.meshes.meshes,
            solids: drawn.meshes.solids,
            inverse,
        };
        Ok((volume, record))
    }

    /// The way back, where it is asked for.
    fn inverse(
        &mut self,
        operation: &Operation,
        field: &Field<'_>,
        folder: &Path,
        at: Place<'_>,
    ) -> Result<Option<InverseAudit>, RunError> {
        if !self.plan.outputs.inverse {
            return Ok(None);
        }
        let path = self
            .staging
            .begin(folder.join("displacement-inverse.nii.gz"))?;
        let template = self.template;
        let audit = self.clock.time(Phase::Inverse, Some(at), || {
            let inverse = operation.inverse(field)?;
            save_displacement(&path, template, |component, slab, to| {
                inverse.fill_component(template.grid(), component, slab.start, to);
            })?;
            Ok::<_, RunError>(inverse.audit())
        })?;
        if audit.not_converged > 0 {
            self.warn(format!(
                "candidate `{}`, stage `{}`: the map has no inverse within {} voxels at {} of the CT's voxels; the nearest found is up to {:.3} mm off",
                at.candidate,
                at.stage,
                audit.tolerance_voxels,
                audit.not_converged,
                audit.residual_max_mm
            ));
        }
        Ok(Some(audit))
    }

    fn write<T: Sample>(
        &mut self,
        field: &Field<'_>,
        volume: &Volume<T>,
        folder: &Path,
        at: Place<'_>,
    ) -> Result<(), RunError> {
        let outputs = self.plan.outputs;
        if outputs.volume {
            let path = self.staging.begin(folder.join("volume.nii.gz"))?;
            self.clock.time(Phase::WriteVolume, Some(at), || {
                save_volume(&path, self.template, volume)
            })?;
        }
        if outputs.nrrd {
            let path = self.staging.begin(folder.join("volume.nrrd"))?;
            self.clock.time(Phase::WriteNrrd, Some(at), || {
                nrrd::save_volume(&path, self.template, volume, self.nrrd)
            })?;
        }
        if outputs.displacement {
            let path = self.staging.begin(folder.join("displacement.nii.gz"))?;
            let grid: &Grid = volume.grid();
            self.clock.time(Phase::WriteDisplacement, Some(at), || {
                save_displacement(&path, self.template, |component, slab, to| {
                    fill_component(field, grid, component, slab.start, to);
                })
            })?;
        }
        Ok(())
    }
}

/// The measures of a volume whose f1 ends at `after`'s tip and ended at `before`'s.
fn measure<T: Sample>(
    plan: &Plan,
    skin_hu: f64,
    volume: &Volume<T>,
    before: FeatureLine,
    after: FeatureLine,
) -> Result<Measures, MeasureError> {
    let grid = volume.grid();
    let mut landmarks = plan.landmarks;
    landmarks.tip = after.tip;
    let geometry = NoseGeometry::new(&landmarks)?;
    let slabs = Slabs::new(&plan.landmarks)?;
    let regions = region_volumes(volume, &slabs, skin_hu)?;
    let voxel = |point: GridPoint| grid.grid_to_index(point);
    Ok(Measures {
        volume_mm3: regions.0,
        volume_total_mm3: regions.total(),
        gamma_deg: geometry.gamma_deg,
        height_mm: geometry.height_mm,
        tip_voxel: voxel(after.tip),
        move_voxel: (voxel(after.tip).0 - voxel(before.tip).0).to_array(),
        move_mm: after.tip - before.tip,
    })
}

fn write_tables(staging: &mut Staging, record: &RunRecord) -> Result<(), RunError> {
    let mut table = Vec::new();
    csv::write(&mut table, record)?;
    save(&staging.begin("measurements.csv")?, &table)?;
    let tables = markdown::tables(record);
    save(&staging.begin("table.md")?, tables.as_bytes())?;
    if let Some(comparison) = comparison::of_run(record) {
        for (name, bytes) in comparison::files(&comparison)? {
            save(&staging.begin(name)?, &bytes)?;
        }
    }
    Ok(())
}

fn write_json(path: &Path, what: &impl Serialize) -> Result<(), RunError> {
    let mut text = serde_json::to_string_pretty(what)?;
    text.push('\n');
    Ok(save(path, text.as_bytes())?)
}
