//! One plan, computed from its CT to its tables.

use std::path::{Path, PathBuf};

use image::RgbImage;
use serde::{Serialize, Serializer};

use super::batch::{self, Part, selected};
use super::candidate::{Bench, Finished};
use super::comparison::{self, Skins, differences, sweep_plots};
use super::ct::{self, Ct};
use super::error::{ExitCode, RunError};
use super::events::{Event, Observer, Phase, Silent};
use super::kept::{self, Beside, JointNote, Keys, Outlook, Reasons, StageNote};
use super::nose::{nose_exists, regions_hold_a_nose, skin_exists};
use super::pictures::{
    CandidateProfiles, PREOPERATIVE_FOLDER, PicturesError, SheetStart, Sheets, write_bytes,
    write_charts, write_drawing,
};
use super::preflight::{Ready, output_folder};
use super::skin::skin_hu;
use super::skin_landmarks::{SkinLandmark, moved, skin_landmarks};
use super::steps::{phases_of_all, phases_of_start, steps};
use super::surfaces::{self, StageSurfaces, Surfaces};
use super::timings::{Clock, Timings};
use crate::compare::SurfaceDifference;
use crate::feature::FeatureLine;
use crate::io::artifact::save;
use crate::io::nrrd::OutputType;
use crate::io::staging::{Earlier, Staging};
use crate::measure::{MeasureError, NoseGeometry, RegionVolumes, Slabs, region_volumes};
use crate::picture::{decode_png, encode_png};
use crate::plan::{Candidate, Found, Plan};
use crate::report::record::{
    CandidateRecord, FORMAT, FailedRecord, Inputs, Measures, PREOPERATIVE, PlanRecord, Program,
    RunRecord, SnapRecord, SnappedLandmark,
};
use crate::report::{csv, markdown};
use crate::segment::Segmented;
use crate::space::{Grid, GridPoint};
use crate::volume::{Copies, Rescale, Sample, Spares, Volume};
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
    /// What became of each candidate, in the order of the plan.
    pub candidates: Vec<CandidateOutcome>,
    /// What the process ends with for candidates that failed.
    #[serde(skip)]
    pub code: ExitCode,
}

/// What became of a candidate.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct CandidateOutcome {
    /// Its name.
    pub name: String,
    /// Stages that were computed.
    pub computed: usize,
    /// Stages that were kept of an earlier run.
    pub kept: usize,
    /// Why there is nothing of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

impl CandidateOutcome {
    fn finished(candidate: &Candidate, finished: &Finished) -> Self {
        Self {
            name: candidate.name.clone(),
            computed: candidate.stages.len() - finished.kept,
            kept: finished.kept,
            error: None,
        }
    }

    fn failed(candidate: &Candidate, error: &RunError) -> Self {
        Self {
            name: candidate.name.clone(),
            computed: 0,
            kept: 0,
            error: Some(error.to_string()),
        }
    }
}

/// A path need not be Unicode, a document must be.
fn shown<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
    to.collect_str(&path.display())
}

/// How a run is done. None of it changes what comes out.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunOptions {
    /// Compute everything, whatever earlier runs left.
    pub force: bool,
    /// End a plan with its first candidate that cannot be computed.
    pub fail_fast: bool,
    /// How much memory candidates that are computed beside each other may take, bytes; what the machine has free
    /// where it is not given.
    pub memory: Option<u64>,
    /// Which part of the candidates is computed: all where it is not given.
    pub part: Option<Part>,
}

/// Computes candidates of a plan and puts the outputs into `out`, in a folder of the plan's name: all of them at the
/// end, or none. Results of earlier runs that still hold are kept. A candidate that cannot be computed is left out,
/// with the reason in the record, where another can be.
///
/// # Errors
/// [`RunError`]; what earlier runs wrote is then as it was.
pub fn run(
    ready: &Ready,
    out: &Path,
    options: &RunOptions,
    observer: &dyn Observer,
) -> Result<RunReport, RunError> {
    let plan = &ready.plan;
    let folder = output_folder(out, plan, options.part.as_ref());
    let selected = selected(plan, options.part.as_ref());
    let mut clock = Clock::new(observer);
    clock.tell(&Event::PlanStarted {
        plan: &plan.name,
        phases: steps(plan, &selected)
            .iter()
            .map(|(_, phases)| phases.len())
            .sum(),
    });
    let staging = Staging::new(&folder)?;
    let earlier = staging.earlier();
    // Of this disk: told, but not part of the record.
    let mut warnings: Vec<String> = staging.warning().into_iter().collect();
    for warning in &warnings {
        clock.tell(&Event::Warning(warning.clone()));
    }
    let input = Input::read(ready, &mut clock)?;
    let plan = input.plan(ready);
    let keys = Keys::new(plan, input.skin_hu, &input.ct.record, &selected)?;
    let outlook = Outlook::new(plan, &keys, &selected, &earlier, options.force);
    outlook.keep(&earlier, &staging)?;
    let of_ct = ready.ct.warning();
    let of_landmarks = input.found.iter().map(|of| of.warning(plan.snap_mm));
    let mut of_input: Vec<String> = of_ct.into_iter().chain(of_landmarks.flatten()).collect();
    for warning in &of_input {
        clock.tell(&Event::Warning(warning.clone()));
    }
    let computed = {
        let to = To {
            staging: &staging,
            keys: &keys,
            outlook: &outlook,
            options,
        };
        with_volume!(&input.ct.volume, volume => compute(plan, &input, volume, &to, &mut clock))
    };
    let computed = match computed {
        Ok(computed) => computed,
        Err(Failure { error, leaves }) => {
            if leaves {
                // What others came to is there for the next run.
                staging.leave();
            }
            return Err(error);
        }
    };
    of_input.extend(computed.of_start);
    warnings.extend(of_input.iter().cloned());
    warnings.extend(computed.warnings);
    let record = RunRecord {
        format: FORMAT,
        program: Program::THIS,
        inputs: Inputs {
            plan_sha256: ready.sha256.clone(),
            landmarks_sha256: ready.landmarks_sha256.clone(),
            ct: input.ct.record.clone(),
        },
        plan: PlanRecord::new(
            plan,
            input.skin_hu,
            input.ct.volume.grid(),
            snap_record(plan, &input.found, input.ct.volume.grid()),
        ),
        part: options.part.as_ref().map(|part| part.record(plan)),
        warnings: of_input,
        candidates: computed.candidates,
        failed: computed.failed,
        surface_differences: computed.surface_differences,
    };
    let effective = ready.source.effective(
        plan,
        Found {
            grid: input.ct.volume.grid(),
            ct_sha256: &record.inputs.ct.sha256,
            skin_hu: input.skin_hu,
        },
    );
    drop::<Input>(input);
    clock.time(Phase::Publish, None, || {
        write_tables(&staging, &record)?;
        if let Some(text) = effective {
            let path = staging.begin_unlisted("plan.effective.toml")?;
            save(&path, text.as_bytes())?;
        }
        staging.digest(Path::new(""))?;
        Ok::<_, RunError>(())
    })?;
    let timings = clock.timings(&record.plan.name);
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
        candidates: computed.outcomes,
        code: computed.code,
    })
}

/// What a run reads before it computes.
struct Input {
    ct: Ct,
    /// Memory that was needed to read it.
    spares: Spares,
    skin_hu: f64,
    /// What is tissue of it.
    head: Segmented,
    found: Vec<SkinLandmark>,
    /// The plan, resolved once more where its landmarks are moved.
    moved: Option<Plan>,
}

impl Input {
    fn read(ready: &Ready, clock: &mut Clock<'_>) -> Result<Self, RunError> {
        let spares = Spares::default();
        let (ct, skin_hu) = clock.time(Phase::Read, None, || {
            let ct = ct::load_with(&ready.plan.ct, &spares)?;
            let skin_hu = skin_hu(&ready.plan.segment, &ct.volume)?;
            Ok::<_, RunError>((ct, skin_hu))
        })?;
        let (head, found, moved) = clock.time(Phase::Landmarks, None, || {
            let range = ct.record.hu_range;
            with_volume!(&ct.volume, volume => look_at_landmarks(ready, skin_hu, volume, range))
        })?;
        Ok(Self {
            ct,
            spares,
            skin_hu,
            head,
            found,
            moved,
        })
    }

    fn plan<'a>(&'a self, ready: &'a Ready) -> &'a Plan {
        self.moved.as_ref().unwrap_or(&ready.plan)
    }
}

/// Why each step of a plan would run or not: what `run` would find in its folder now. The CT is read, where there is
/// anything to hold it against.
///
/// # Errors
/// [`RunError`] where the CT cannot be used.
pub fn reasons(ready: &Ready, out: &Path, options: &RunOptions) -> Result<Reasons, RunError> {
    let selected = selected(&ready.plan, options.part.as_ref());
    let earlier = Earlier::of(&output_folder(out, &ready.plan, options.part.as_ref()));
    if earlier.is_empty() {
        return Ok(Reasons::all_new(&ready.plan, &selected));
    }
    let input = Input::read(ready, &mut Clock::new(&Silent))?;
    let plan = input.plan(ready);
    let keys = Keys::new(plan, input.skin_hu, &input.ct.record, &selected)?;
    let outlook = Outlook::new(plan, &keys, &selected, &earlier, options.force);
    Ok(outlook.reasons(plan))
}

/// Where a run writes to, and what it keeps.
struct To<'a> {
    staging: &'a Staging,
    keys: &'a Keys,
    outlook: &'a Outlook,
    options: &'a RunOptions,
}

/// Why nothing came out.
struct Failure {
    error: RunError,
    /// Whether there are results of candidates that the next run can keep.
    leaves: bool,
}

impl<E: Into<RunError>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self {
            error: error.into(),
            leaves: false,
        }
    }
}

/// What came out of all candidates.
struct ComputedRun {
    /// What the user should know of the nose as it is.
    of_start: Vec<String>,
    warnings: Vec<String>,
    candidates: Vec<CandidateRecord>,
    failed: Vec<FailedRecord>,
    surface_differences: Vec<SurfaceDifference>,
    outcomes: Vec<CandidateOutcome>,
    /// Of the candidates that failed.
    code: ExitCode,
}

fn compute<T: Sample>(
    plan: &Plan,
    input: &Input,
    preoperative: &Volume<T>,
    to: &To<'_>,
    clock: &mut Clock<'_>,
) -> Result<ComputedRun, Failure> {
    let record = &input.ct.record;
    let Begun {
        note: start,
        tiles,
        surfaces,
    } = begin(plan, input.skin_hu, preoperative, to, clock)?;
    let compares = to.outlook.joint.is_err();
    let mut skins = None;
    if Skins::are_wanted(plan) && compares && !to.outlook.has_skins(to.keys) {
        let find = || Skins::new(plan, input.skin_hu, preoperative, &input.head);
        skins = Some(clock.time(Phase::Skins, None, find)?);
    }
    let bench = Bench {
        plan,
        keys: to.keys,
        skin_hu: input.skin_hu,
        template: &input.ct.template,
        nrrd: OutputType::choose(
            record.sample_type,
            Rescale {
                slope: record.slope,
                intercept: record.intercept,
            },
            record.hu_range,
        ),
        staging: to.staging,
        copies: Copies::new(preoperative, &input.spares),
        start: start.record(PREOPERATIVE, None),
        surfaces,
        skins,
        compares,
    };
    let run = |at: usize, outlook: &[_], clock: &mut Clock<'_>| bench.candidate(at, outlook, clock);
    let workers = batch::workers(plan, preoperative, to.options.memory);
    let results = batch::run(
        &to.outlook.candidates,
        workers,
        to.options.fail_fast,
        clock,
        run,
    );
    let mut all = ComputedRun {
        of_start: start.warnings.clone(),
        warnings: Vec::new(),
        candidates: Vec::new(),
        failed: Vec::new(),
        surface_differences: Vec::new(),
        outcomes: Vec::new(),
        code: ExitCode::Done,
    };
    let mut finished = Vec::new();
    let mut first_error = None;
    let (mut stopped, mut fatal) = (false, None);
    for ((at, _), result) in to.outlook.candidates.iter().zip(results) {
        let candidate = &plan.candidates[*at];
        match result {
            Some(Ok(one)) => {
                all.outcomes
                    .push(CandidateOutcome::finished(candidate, &one));
                finished.push((*at, one));
            }
            Some(Err(error)) if !error.is_of_one_candidate() => fatal = fatal.or(Some(error)),
            Some(Err(error)) => {
                to.staging.forget(Path::new(&candidate.name));
                all.outcomes
                    .push(CandidateOutcome::failed(candidate, &error));
                all.failed.push(FailedRecord {
                    candidate: candidate.name.clone(),
                    error: error.to_string(),
                });
                all.code = all.code.worse(error.exit_code());
                first_error = first_error.or(Some(error));
            }
            None => stopped = true,
        }
    }
    if let Some(error) = fatal {
        return Err(error.into());
    }
    if let Some(error) = first_error
        && (stopped || to.options.fail_fast || finished.is_empty())
    {
        let error = match all.failed.len() {
            0 | 1 => error,
            others => RunError::Candidates {
                first: Box::new(error),
                others: others - 1,
            },
        };
        let leaves = !finished.is_empty();
        return Err(Failure { error, leaves });
    }
    all.surface_differences = finish(&bench, to, (&start, tiles.as_deref()), &finished, clock)?;
    for (_, one) in finished {
        all.warnings.extend(one.warnings);
        all.candidates.push(one.record);
    }
    Ok(all)
}

/// The nose as it is, and what is made of it for candidates.
struct Begun<'a> {
    note: StageNote,
    /// Its pictures on the contact sheet, as PNG, where it was drawn.
    tiles: Option<Vec<u8>>,
    surfaces: Option<Surfaces<'a>>,
}

/// The nose as it is: measured, drawn and meshed, or kept.
fn begin<'a, T: Sample>(
    plan: &'a Plan,
    skin_hu: f64,
    preoperative: &Volume<T>,
    to: &To<'_>,
    clock: &mut Clock<'_>,
) -> Result<Begun<'a>, RunError> {
    if let Ok(hit) = &to.outlook.start {
        clock.tell(&Event::Kept(phases_of_start(plan).len()));
        let note = hit.found().clone();
        for warning in &note.warnings {
            clock.tell(&Event::Warning(warning.clone()));
        }
        return Ok(Begun {
            note,
            tiles: None,
            surfaces: None,
        });
    }
    let measures = clock
        .time(Phase::Measure, None, || {
            measure(plan, skin_hu, preoperative, plan.f1, plan.f1)
        })
        .map_err(RunError::Preoperative)?;
    let slabs = Slabs::new(&plan.landmarks).map_err(RunError::Preoperative)?;
    let volumes = RegionVolumes(measures.volume_mm3);
    let warning = regions_hold_a_nose(&volumes, &slabs, plan.f1.tip)?;
    if let Some(warning) = &warning {
        clock.tell(&Event::Warning(warning.clone()));
    }
    let (mut surfaces, mut drawn) = (None, StageSurfaces::default());
    if surfaces::wanted(plan) {
        let hu = preoperative.to_hu()?;
        let (made, found) = Surfaces::begin(plan, skin_hu, hu, to.staging, clock)?;
        (surfaces, drawn) = (Some(made), found);
    }
    let note = StageNote {
        warnings: warning.into_iter().collect(),
        profile: drawn.profile,
        meshes: drawn.meshes.meshes,
        ..StageNote::unmoved(measures)
    };
    let png = drawn.tiles.as_ref().map(encode_png).transpose();
    let tiles = png.map_err(PicturesError::from)?;
    let files = to.staging.digest(Path::new(PREOPERATIVE_FOLDER))?;
    let (name, key) = (kept::start_name(), &to.keys.start);
    let beside: Vec<_> = tiles.iter().map(|png| (Beside::Tiles, &png[..])).collect();
    kept::note(to.staging, &name, key, &note, files, &beside)?;
    Ok(Begun {
        note,
        tiles,
        surfaces,
    })
}

/// What compares stages and candidates: charts, contact sheets, distances between skins.
fn finish<T: Sample>(
    bench: &Bench<'_, T>,
    to: &To<'_>,
    (start, tiles): (&StageNote, Option<&[u8]>),
    finished: &[(usize, Finished)],
    clock: &mut Clock<'_>,
) -> Result<Vec<SurfaceDifference>, RunError> {
    let (plan, staging) = (bench.plan, to.staging);
    if let Ok(hit) = &to.outlook.joint {
        clock.tell(&Event::Kept(phases_of_all(plan).len()));
        return Ok(hit.found().surface_differences.clone());
    }
    let before = staging.digest(Path::new(""))?;
    if plan.views.is_some() && plan.candidates.len() > 1 {
        clock.time(Phase::Sheet, None, || {
            write_contact_sheets(plan, staging, tiles, finished)
        })?;
    }
    if plan.outputs.charts {
        let candidates: Vec<CandidateProfiles<'_>> = finished
            .iter()
            .map(|(_, one)| {
                let first = std::iter::once(&start.profile);
                let profiles = first.chain(&one.profiles);
                CandidateProfiles {
                    record: &one.record,
                    profiles: profiles
                        .map(|profile| profile.as_deref().unwrap_or_default())
                        .collect(),
                }
            })
            .collect();
        let grid = bench.preoperative().grid();
        clock.time(Phase::Charts, None, || {
            write_charts(staging, plan, grid, &candidates)?;
            let records: Vec<&CandidateRecord> = candidates.iter().map(|of| of.record).collect();
            for (name, svg) in sweep_plots(plan, &records).map_err(PicturesError::from)? {
                // Names have no dot.
                write_drawing(staging, Path::new(&name), &svg)?;
            }
            Ok::<_, RunError>(())
        })?;
    }
    let mut surface_differences = Vec::new();
    if Skins::are_wanted(plan) {
        let skins = finished
            .iter()
            .filter_map(|(_, one)| Some((one.record.name.as_str(), one.skin.as_ref()?)));
        let skins: Vec<_> = skins.collect();
        surface_differences = clock.time(Phase::Skins, None, || differences(&skins, |_, _| true));
    }
    // Of all candidates only.
    if finished.len() == to.outlook.candidates.len() {
        let mut files = staging.digest(Path::new(""))?;
        files.retain(|file| !before.contains(file));
        let found = JointNote {
            surface_differences: surface_differences.clone(),
        };
        let (name, key) = (kept::joint_name(), &to.keys.joint);
        kept::note(staging, &name, key, &found, files, &[])?;
    }
    Ok(surface_differences)
}

/// Of what was drawn in this run the pictures are at hand, of the rest beside the notes.
fn write_contact_sheets(
    plan: &Plan,
    staging: &Staging,
    start: Option<&[u8]>,
    finished: &[(usize, Finished)],
) -> Result<(), RunError> {
    let picture = |png: Option<&[u8]>, note: &Path| {
        let kept = match png {
            Some(_) => Vec::new(),
            None => kept::read_beside(staging, note, Beside::Tiles)?,
        };
        // What this run drew, or what was kept by its SHA-256.
        Ok::<_, RunError>(decode_png(png.unwrap_or(&kept)).unwrap_or_default())
    };
    let start = SheetStart {
        label: PREOPERATIVE,
        picture: &picture(start, &kept::start_name())?,
    };
    let cameras = plan.views.iter().flat_map(|views| &views.cameras);
    let columns: Vec<&str> = cameras.map(|camera| camera.name.as_str()).collect();
    let rows = finished.iter().map(|(_, one)| (&one.record.name[..], 0));
    let sheets = Sheets {
        title: plan.title.as_deref().unwrap_or(&plan.name),
        columns: &columns,
        starts: &[start],
        rows: &rows.collect::<Vec<_>>(),
    };
    let of_candidate = |place: usize| {
        let Some((at, one)) = finished.get(place) else {
            return Ok(RgbImage::default());
        };
        let candidate = &plan.candidates[*at];
        let note = kept::stage_name(candidate, candidate.stages.len() - 1);
        picture(one.tiles.as_deref(), &note)
    };
    sheets.draw(of_candidate, |name, png| {
        write_bytes(staging, Path::new(name), png)
    })
}

/// The head, how far the landmarks of the skin are from it, and the plan with those moved that it asks to be moved:
/// resolved anew, so that f1, the cage and every edit follow. Refused where they are on no nose.
fn look_at_landmarks<T: Sample>(
    ready: &Ready,
    skin_hu: f64,
    volume: &Volume<T>,
    hu_range: [f64; 2],
) -> Result<(Segmented, Vec<SkinLandmark>, Option<Plan>), RunError> {
    let landmarks = &ready.plan.landmarks;
    let segmented = |changes: Option<_>| {
        let largest = ready.plan.segment.keep_largest;
        Segmented::new(volume, skin_hu, largest, changes)
    };
    let part = Skins::changed_part(&ready.plan, volume.grid());
    let head = segmented(part.clone())?;
    skin_exists(head.object(), skin_hu, hu_range)?;
    let found = skin_landmarks(landmarks, skin_hu, volume, head.object())?;
    nose_exists(&found, landmarks, head.object(), volume.grid())?;
    let Some(snap_mm) = ready.plan.snap_mm else {
        return Ok((head, found, None));
    };
    let moved = moved(&found, snap_mm);
    let plan = ready.source.resolve_moved(&ready.ct.grid, &moved);
    let plan = plan.map_err(RunError::Snapped)?;
    // The same object, with another part around landmarks that were moved.
    let moved_part = Skins::changed_part(&plan, volume.grid());
    let head = if moved_part == part {
        head
    } else {
        segmented(moved_part)?
    };
    Ok((head, found, Some(plan)))
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

/// The folder of a stage's own outputs within the plan's: `<candidate>/<NN>-<stage>`.
pub fn stage_folder(candidate: &Candidate, place: usize) -> PathBuf {
    let stage = candidate.stages.get(place);
    let name = stage.map_or("", |stage| stage.name.as_str());
    Path::new(&candidate.name).join(numbered(place, name))
}

/// The last part of [`stage_folder`], of a stage by its place from 0 and its name.
pub(super) fn numbered(place: usize, stage: &str) -> String {
    format!("{:02}-{stage}", place + 1)
}

/// The measures of a volume whose f1 ends at `after`'s tip and ended at `before`'s.
pub(super) fn measure<T: Sample>(
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

fn write_tables(staging: &Staging, record: &RunRecord) -> Result<(), RunError> {
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
