//! The skins of a run's candidates, held until all are there.
//!
//! A skin is kept only around the nose: some hundred kilobytes, not a volume. It is that of the volume that is
//! measured and written, not enhanced for pictures.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::compare::SurfaceDifference;
use crate::exec::error::RunError;
use crate::exec::operation::Operation;
use crate::feature::NoseBox;
use crate::morph::chain::VoxelBox;
use crate::plan::{Model, Plan};
use crate::segment::Segmented;
use crate::space::Grid;
use crate::surface::{
    ComparedSkin, Region, SeenSkin, SemiBoundary, SkinBefore, semi_boundary_in, skin_difference,
};
use crate::volume::{Mask, Sample, Volume};

/// How far around the noses of all candidates skins are compared, mm, where the model is global. That of model
/// `local` ends where its margin does.
pub const MARGIN_MM: f64 = 20.0;
/// How far further skins are kept, mm: what lies at the rim has its neighbours on the other skin there.
const RIM_MM: f64 = 10.0;
/// The most candidates of which each two are compared: 496 pairs.
pub const MOST_COMPARED: usize = 32;

/// Finds the skins of candidates, beside that before the first stage.
pub(in crate::exec) struct Skins<'a> {
    finder: Finder,
    head: &'a Segmented,
    before: SkinBefore,
}

/// Where skin is looked for: the same for all.
struct Finder {
    skin_hu: f64,
    compared: Region,
    kept: Region,
}

impl<'a> Skins<'a> {
    /// Whether the candidates of a plan are compared.
    pub(in crate::exec) fn are_wanted(plan: &Plan) -> bool {
        (2..=MOST_COMPARED).contains(&plan.candidates.len())
    }

    /// Where the volumes whose skins are compared differ from the preoperative one: a part of all voxels along x, y and z,
    /// where they do so in no more, and are compared.
    pub(in crate::exec) fn changed_part(plan: &Plan, grid: &Grid) -> Option<[Range<usize>; 3]> {
        if !Self::are_wanted(plan) || plan.morph.model == Model::Lee2001 {
            return None;
        }
        let mut all = VoxelBox::EMPTY;
        for candidate in &plan.candidates {
            let last = candidate.stages.len().checked_sub(1)?;
            // A candidate that cannot be computed says so when it is its turn.
            let operation = Operation::new(plan, candidate, last, grid).ok()?;
            all = all.union(&operation.support());
        }
        Some(all.ranges())
    }

    /// Finds the skin of the nose as it is, on its head. What the skins of candidates are found with has to hold in
    /// [`Skins::changed_part`].
    pub(in crate::exec) fn new<T: Sample>(
        plan: &Plan,
        skin_hu: f64,
        preoperative: &Volume<T>,
        head: &'a Segmented,
    ) -> Result<Self, RunError> {
        let margin = match plan.morph.model {
            Model::Local { margin_mm } => margin_mm,
            Model::Lee2001 => MARGIN_MM,
        };
        let start = NoseBox::new(&plan.landmarks, &plan.f1, &plan.f1);
        let stages = plan
            .candidates
            .iter()
            .flat_map(|candidate| &candidate.stages);
        let nose = stages
            .map(|stage| NoseBox::new(&plan.landmarks, &stage.source, &stage.target))
            .fold(start, |all, one| all.union(&one));
        let grid = preoperative.grid();
        let finder = Finder {
            skin_hu,
            compared: around(&nose, margin, grid),
            kept: around(&nose, margin + RIM_MM, grid),
        };
        let before = SkinBefore::new(finder.surface(preoperative, head.object())?);
        Ok(Self {
            finder,
            head,
            before,
        })
    }

    /// The skin of the nose that a candidate ends with.
    pub(in crate::exec) fn find<T: Sample>(
        &self,
        volume: &Volume<T>,
    ) -> Result<SeenSkin, RunError> {
        let mask = self.head.again(volume)?;
        let surface = self.finder.surface(volume, &mask)?;
        Ok(SeenSkin::new(
            surface,
            &mask,
            self.finder.compared,
            &self.before,
        ))
    }
}

/// How far the skins of every two candidates are apart that are wanted by their places, in the order of the candidates.
pub(in crate::exec) fn differences(
    skins: &[(&str, &SeenSkin)],
    wanted: impl Fn(usize, usize) -> bool,
) -> Vec<SurfaceDifference> {
    let skins = skins
        .par_iter()
        .map(|&(name, skin)| (name, ComparedSkin::new(skin)));
    let skins: Vec<(&str, ComparedSkin<'_>)> = skins.collect();
    let mut pairs = Vec::new();
    for (place, one) in skins.iter().enumerate() {
        let others = skins.iter().enumerate().skip(place + 1);
        let others = others.filter(|(other, _)| wanted(place, *other));
        pairs.extend(others.map(|(_, other)| (one, other)));
    }
    let differences = pairs
        .into_par_iter()
        .map(|((one, skin), (other, other_skin))| {
            let found = skin_difference(skin, other_skin);
            SurfaceDifference {
                candidates: [*one, *other].map(str::to_owned),
                mean_mm: found.mean_mm,
                p95_mm: found.p95_mm,
                max_mm: found.max_mm,
                area_mm2: found.area_mm2,
            }
        });
    differences.collect()
}

impl Finder {
    fn surface<T: Sample>(
        &self,
        volume: &Volume<T>,
        head: &Mask,
    ) -> Result<SemiBoundary, RunError> {
        Ok(semi_boundary_in(volume, head, self.skin_hu, self.kept)?)
    }
}

/// The voxels no further than `margin_mm` from the box along any axis.
fn around(nose: &NoseBox, margin_mm: f64, grid: &Grid) -> Region {
    let voxel = |point: DVec3| {
        let index = (point / grid.spacing()).clamp(DVec3::ZERO, grid.last_index());
        // In range: it lies between the grid's first and last voxels.
        index.to_array().map(|at| at.round() as usize)
    };
    Region {
        first: voxel(nose.min.0 - margin_mm),
        last: voxel(nose.max.0 + margin_mm),
    }
}
