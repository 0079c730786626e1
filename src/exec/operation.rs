//! One stage of a candidate, turned into maps and fields.

use glam::DVec3;

use super::error::{At, RunError};
use super::events::{Phase, Place};
use super::timings::Clock;
use crate::feature::{Cage, LineError, NoseBox};
use crate::morph::audit::{FieldDifference, WarpAudit};
use crate::morph::chain::{Chain, Lattice, VoxelBox};
use crate::morph::field::{Evaluation, Field};
use crate::morph::halfscale::CoarseDisplacement;
use crate::morph::inverse::{ClosedForm, Inverse, Sampled};
use crate::morph::stage::{StageLines, StageMap, Taper};
use crate::morph::warp::{warp, warp_onto, warp_with};
use crate::plan::{Candidate, Method, Model, Morph, Plan, Scale, Stage, Tolerance};
use crate::resample::gaussian::upsample_with;
use crate::resample::half;
use crate::resample::half::HalfError;
use crate::space::Grid;
use crate::volume::{Copies, Sample, Volume, VolumeError};

/// What a stage needs: the map of all stages so far, on the full lattice and, at half scale, on the half
/// one; and for `lee2001`, which resamples stage by stage, the map of this stage alone.
pub(super) struct Operation {
    morph: Morph,
    full: Lattice,
    half: Lattice,
    composed: Chain,
    composed_half: Chain,
    /// On the lattice that volumes are warped on.
    own: Chain,
    nose: NoseBox,
}

impl Operation {
    /// The stage at `place` of a candidate.
    pub(super) fn new(
        plan: &Plan,
        candidate: &Candidate,
        place: usize,
        grid: &Grid,
    ) -> Result<Self, RunError> {
        let (full, half) = (Lattice::full(grid), Lattice::half(grid));
        let units = match plan.morph.scale {
            Scale::Full => full,
            Scale::Half => {
                // A grid of a single plane has no half, and a field on none would move nothing.
                half::half_grid(grid).map_err(HalfError::from)?;
                half
            }
        };
        let stages = candidate.stages.get(..=place).unwrap_or_default();
        let chain = |stages: &[Stage], on: &Lattice| -> Result<Chain, RunError> {
            let maps = stages.iter().map(|stage| {
                stage_map(plan, stage, &units, on).map_err(|source| RunError::Line {
                    at: At {
                        candidate: candidate.name.clone(),
                        stage: stage.name.clone(),
                    },
                    source,
                })
            });
            Ok(Chain::new(maps.collect::<Result<_, _>>()?))
        };
        let nose = stages
            .iter()
            .map(|stage| NoseBox::new(&plan.landmarks, &stage.source, &stage.target))
            .reduce(|all, one| all.union(&one))
            .unwrap_or_else(|| NoseBox::new(&plan.landmarks, &plan.f1, &plan.f1));
        Ok(Self {
            morph: plan.morph,
            full,
            half,
            composed: chain(stages, &full)?,
            composed_half: chain(stages, &half)?,
            own: chain(stages.get(place..).unwrap_or_default(), &units)?,
            nose,
        })
    }

    /// The volume after the stage: of the preoperative one, of which there are copies, or of the one before.
    pub(super) fn volume<T: Sample>(
        &self,
        before: &Volume<T>,
        copies: &Copies<'_, T>,
        place: Place<'_>,
        clock: &mut Clock<'_>,
    ) -> Result<Volume<T>, RunError> {
        let at = Some(place);
        match (self.morph.model, self.morph.scale) {
            (Model::Local { .. }, Scale::Full) => Ok(clock.time(Phase::Morph, at, || {
                let evaluation = self.evaluation(&self.full);
                let field = self.evaluated(evaluation);
                warp_onto(copies.take(), copies.original(), &field)
            })),
            (Model::Local { .. }, Scale::Half) => clock.time(Phase::Morph, at, || {
                let field = self.upsampled(self.evaluation(&self.half))?;
                Ok(warp_onto(copies.take(), copies.original(), &field))
            }),
            (Model::Lee2001, Scale::Full) => Ok(clock.time(Phase::Morph, at, || {
                let evaluation = self.evaluation(&self.full);
                let field = Field::evaluated(self.full, &self.own, evaluation);
                warp_with(before, &field, copies.spares())
            })),
            (Model::Lee2001, Scale::Half) => {
                let coarse = clock.time(Phase::Half, at, || half::half(before))?;
                let warped = clock.time(Phase::Morph, at, || {
                    let evaluation = self.evaluation(&self.half);
                    warp(&coarse, &Field::evaluated(self.half, &self.own, evaluation))
                });
                drop(coarse);
                let full = clock.time(Phase::Upsample, at, || {
                    let (grid, rescale) = (before.grid(), before.rescale());
                    upsample_with::<T>(&warped, grid, rescale, copies.spares())
                })?;
                Ok(full)
            }
        }
    }

    /// Gives back a volume of [`Operation::volume`] that is of no further use.
    pub(super) fn give_back<T: Sample>(&self, volume: Volume<T>, copies: &Copies<'_, T>) {
        match self.morph.model {
            Model::Local { .. } => {
                copies.give(volume, self.support().ranges());
            }
            Model::Lee2001 => volume.spare(copies.spares()),
        }
    }

    /// The voxels outside which the volume is the preoperative one, where the model is `local`.
    pub(super) fn support(&self) -> VoxelBox {
        self.composed.support(&self.full)
    }

    /// The displacement from this stage's voxels to the preoperative CT, as it is written.
    pub(super) fn displacement(&self) -> Result<Field<'_>, VolumeError> {
        match self.morph.scale {
            Scale::Full => Ok(self.evaluated(self.evaluation(&self.full))),
            Scale::Half => self.upsampled(self.evaluation(&self.half)),
        }
    }

    /// The way back, from the preoperative CT's voxels to this stage: of the map in closed form at full scale, of
    /// [`Operation::displacement`], given as `field`, at half scale.
    pub(super) fn inverse(&self, field: &Field<'_>) -> Result<Inverse, VolumeError> {
        match self.morph.scale {
            Scale::Full => Inverse::new(&ClosedForm {
                chain: &self.composed,
                lattice: &self.full,
            }),
            Scale::Half => Inverse::new(&Sampled::new(field)?),
        }
    }

    /// How the map of all stages so far behaves: in closed form at full scale, by differences of
    /// [`Operation::displacement`], given as `field`, at half scale.
    pub(super) fn audit(&self, field: &Field<'_>) -> WarpAudit {
        match self.morph.scale {
            Scale::Full => WarpAudit::new(&self.composed, &self.full, &self.nose),
            Scale::Half => WarpAudit::of_field(field, &self.nose),
        }
    }

    /// How far the adaptive evaluation is from the exact one, in what is sampled: the preoperative CT for
    /// `local`, the volume before the stage for `lee2001`.
    pub(super) fn adaptive_error<T: Sample>(
        &self,
        preoperative: &Volume<T>,
        before: &Volume<T>,
    ) -> Result<FieldDifference, RunError> {
        let exact = Evaluation::Exact;
        match (self.morph.model, self.morph.scale) {
            (Model::Local { .. }, Scale::Full) => {
                let adaptive = self.evaluated(self.evaluation(&self.full));
                let exact = self.evaluated(exact);
                Ok(FieldDifference::new(preoperative, &exact, &adaptive))
            }
            (Model::Local { .. }, Scale::Half) => {
                let adaptive = self.upsampled(self.evaluation(&self.half))?;
                let exact = self.upsampled(exact)?;
                Ok(FieldDifference::new(preoperative, &exact, &adaptive))
            }
            (Model::Lee2001, Scale::Full) => Ok(self.own_error(&self.full, before)),
            (Model::Lee2001, Scale::Half) => {
                let mut difference = self.own_error(&self.half, &half::half(before)?);
                // In voxels of the full grid, as at full scale.
                difference.position_max_voxels *= 2.0;
                Ok(difference)
            }
        }
    }

    fn own_error<T: Sample>(&self, on: &Lattice, source: &Volume<T>) -> FieldDifference {
        let field = |evaluation| Field::evaluated(*on, &self.own, evaluation);
        FieldDifference::new(
            source,
            &field(Evaluation::Exact),
            &field(self.evaluation(on)),
        )
    }

    fn evaluated(&self, evaluation: Evaluation) -> Field<'_> {
        Field::evaluated(self.full, &self.composed, evaluation)
    }

    fn upsampled(&self, evaluation: Evaluation) -> Result<Field<'_>, VolumeError> {
        let coarse = CoarseDisplacement::new(self.half, &self.composed_half, evaluation)?;
        Ok(Field::upsampled(self.full, &self.composed, coarse))
    }

    fn evaluation(&self, on: &Lattice) -> Evaluation {
        match self.morph.method {
            Method::Exact => Evaluation::Exact,
            Method::Adaptive { tolerance } => {
                let (tolerance, metric): (f64, DVec3) = match tolerance {
                    Tolerance::Mm(mm) => (mm, on.spacing()),
                    // Voxels of the full grid, whatever the lattice.
                    Tolerance::Voxels(voxels) => (voxels, on.spacing() / self.full.spacing()),
                };
                Evaluation::Adaptive { tolerance, metric }
            }
        }
    }
}

fn stage_map(
    plan: &Plan,
    stage: &Stage,
    units: &Lattice,
    on: &Lattice,
) -> Result<StageMap, LineError> {
    let lines = StageLines {
        kind: stage.kind,
        source: stage.source,
        target: stage.target,
        cage: Cage::new(&plan.landmarks, plan.cage_depth_mm),
    };
    match plan.morph.model {
        Model::Lee2001 => StageMap::lee2001(&lines, units, on),
        Model::Local { margin_mm } => {
            let nose = NoseBox::new(&plan.landmarks, &stage.source, &stage.target);
            StageMap::local(&lines, stage.width, Taper { nose, margin_mm }, on)
        }
    }
}
