//! The meshes of a run, and the solids between the skin before and after.
//!
//! The skin before the first operation is found once and kept; every stage is compared with it.

use std::borrow::Cow;
use std::io;
use std::path::Path;

use super::error::RunError;
use super::objects;
use super::pictures::{PREOPERATIVE_FOLDER, PicturesError};
use crate::io::artifact::Artifact;
use crate::io::staging::Staging;
use crate::mesh::solid::{Least, Skin, Solid, solid};
use crate::mesh::{
    ChangeFrom, Coloured, Mesh, MeshError, SMOOTHING, decimate, is_cut, isosurface, smooth,
    surface_change, write_ply, write_stl,
};
use crate::picture::diverging;
use crate::plan::Plan;
use crate::report::meshes::{ChangeRecord, MeshRecord, MeshesRecord, SolidsRecord};
use crate::space::Grid;
use crate::surface::{Region, SemiBoundary, SurfaceDistance, SurfaceError, semi_boundary};
use crate::volume::{Mask, Volume};

/// How far skin is looked for that moved, mm.
const REACH_MM: f64 = 60.0;

/// What meshes of every stage need of the nose as it is.
pub(super) struct Workshop<'a> {
    plan: &'a Plan,
    skin_hu: f64,
    /// The CT as surfaces are found in it, where that is not the CT itself.
    enhanced: Option<Volume<f32>>,
    skin: Mask,
    boundary: SemiBoundary,
}

/// What the record of a stage says of its meshes.
#[derive(Debug, Default)]
pub(super) struct StageMeshes {
    pub meshes: Option<MeshesRecord>,
    pub solids: Option<SolidsRecord>,
}

impl<'a> Workshop<'a> {
    /// Finds the skin of the nose as it is, and writes its meshes where they are asked for.
    pub(super) fn begin(
        plan: &'a Plan,
        skin_hu: f64,
        preoperative: &Volume<f32>,
        staging: &Staging,
    ) -> Result<(Self, Option<MeshesRecord>), RunError> {
        let enhanced = objects::enhanced(plan, preoperative).map_err(PicturesError::from)?;
        let skin = objects::skin(plan, skin_hu, &enhanced)?;
        let boundary = boundary(&enhanced, &skin, skin_hu)?;
        let mut meshes = None;
        if plan.outputs.mesh {
            let folder = Path::new(PREOPERATIVE_FOLDER);
            let written = write_meshes(plan, skin_hu, &enhanced, &skin, staging, folder)?;
            meshes = Some(written.record);
        }
        let enhanced = match enhanced {
            Cow::Owned(enhanced) => Some(enhanced),
            Cow::Borrowed(_) => None,
        };
        let workshop = Self {
            plan,
            skin_hu,
            enhanced,
            skin,
            boundary,
        };
        Ok((workshop, meshes))
    }

    /// Writes the meshes and solids of a stage, as far as they are asked for.
    pub(super) fn stage(
        &self,
        staging: &Staging,
        folder: &Path,
        preoperative: &Volume<f32>,
        volume: &Volume<f32>,
    ) -> Result<StageMeshes, RunError> {
        let (plan, skin_hu) = (self.plan, self.skin_hu);
        let before = self.enhanced.as_ref().unwrap_or(preoperative);
        let after = objects::enhanced(plan, volume).map_err(PicturesError::from)?;
        let after: &Volume<f32> = &after;
        let grid = after.grid();
        let skin = objects::skin(plan, skin_hu, after)?;
        let mut of_stage = StageMeshes::default();
        if plan.outputs.mesh {
            let from = ChangeFrom {
                volumes: [before, after],
                masks: [&self.skin, &skin],
                before: SurfaceDistance::new(&self.boundary, REACH_MM),
            };
            let mut written = write_meshes(plan, skin_hu, after, &skin, staging, folder)?;
            if let Some(mesh) = &written.skin {
                let change = surface_change(mesh, &from);
                let record = ChangeRecord::of(&change);
                let limit = record.outward_max_mm.max(-record.inward_max_mm);
                let data = Coloured {
                    change_mm: &change,
                    // Where nothing moved, every colour is that of 0.
                    limit_mm: if limit > 0.0 { limit } else { 1.0 },
                    colour: diverging,
                };
                write(staging, &folder.join("skin.ply"), |to| {
                    write_ply(to, mesh, grid, &data)
                })?;
                written.record.change = Some(record);
            }
            of_stage.meshes = Some(written.record);
        }
        if plan.outputs.solids {
            let boundary = boundary(after, &skin, skin_hu)?;
            let distance = |surface| SurfaceDistance::new(surface, REACH_MM);
            let skins = [
                (before, &self.skin, distance(&self.boundary)),
                (after, &skin, distance(&boundary)),
            ];
            let [before, after] = skins.map(|(volume, mask, distance)| Skin {
                volume,
                mask,
                distance,
            });
            let least = Least::default();
            let added = solid(&after, &before, skin_hu, least)?;
            write_solid(staging, &folder.join("augmentation.stl"), &added, grid)?;
            let removed = solid(&before, &after, skin_hu, least)?;
            write_solid(staging, &folder.join("resection.stl"), &removed, grid)?;
            of_stage.solids = Some(SolidsRecord {
                augmentation: added.record,
                resection: removed.record,
            });
        }
        Ok(of_stage)
    }
}

fn boundary(volume: &Volume<f32>, skin: &Mask, skin_hu: f64) -> Result<SemiBoundary, MeshError> {
    let surface: Result<_, SurfaceError> =
        semi_boundary(volume, skin, skin_hu, Region::whole(volume.grid()));
    Ok(surface?)
}

/// The skin's mesh, for what else is written of it.
struct Written {
    skin: Option<Mesh>,
    record: MeshesRecord,
}

/// Writes `skin.stl` and `bone.stl`.
fn write_meshes(
    plan: &Plan,
    skin_hu: f64,
    volume: &Volume<f32>,
    skin: &Mask,
    staging: &Staging,
    folder: &Path,
) -> Result<Written, RunError> {
    let grid = volume.grid();
    let bone_hu = plan.segment.bone_hu;
    let bone = objects::bone(plan, volume, skin)?;
    let object = |name: &str, mask: &Mask, threshold_hu: f64| {
        let made = make(plan, volume, mask, threshold_hu)?;
        if let Some((mesh, _)) = &made {
            write(staging, &folder.join(name), |to| write_stl(to, mesh, grid))?;
        }
        Ok::<_, RunError>(made)
    };
    let bone = object("bone.stl", &bone, bone_hu)?;
    let skin = object("skin.stl", skin, skin_hu)?;
    let record = |made: &Option<(Mesh, MeshRecord)>| made.as_ref().map(|(_, record)| *record);
    Ok(Written {
        record: MeshesRecord {
            skin: record(&skin),
            bone: record(&bone),
            change: None,
        },
        skin: skin.map(|(mesh, _)| mesh),
    })
}

/// The mesh of an object, smoothed, with no more triangles than the plan allows; none where there is no object.
fn make(
    plan: &Plan,
    volume: &Volume<f32>,
    mask: &Mask,
    threshold_hu: f64,
) -> Result<Option<(Mesh, MeshRecord)>, MeshError> {
    let grid = volume.grid();
    let mut mesh = isosurface(volume, mask, threshold_hu)?;
    if mesh.is_empty() {
        return Ok(None);
    }
    let found = mesh.volume();
    smooth(&mut mesh, SMOOTHING, |point| is_cut(grid, point))?;
    let smoothed = mesh.volume();
    let most = plan.mesh.and_then(|settings| settings.triangles);
    let most = most.filter(|&most| mesh.triangles().len() > most);
    if let Some(most) = most {
        decimate(&mut mesh, most)?;
    }
    let volume = mesh.volume();
    let record = MeshRecord {
        triangles: mesh.triangles().len(),
        volume_mm3: volume,
        area_mm2: mesh.area(),
        smoothing_volume_change: smoothed / found - 1.0,
        decimation_volume_change: most.map(|_| volume / smoothed - 1.0),
        topology: mesh.topology(),
    };
    Ok(Some((mesh, record)))
}

fn write_solid(staging: &Staging, name: &Path, solid: &Solid, grid: &Grid) -> Result<(), RunError> {
    if solid.mesh.is_empty() {
        return Ok(());
    }
    write(staging, name, |to| write_stl(to, &solid.mesh, grid))
}

/// Writes a file that will be published under `name`.
fn write(
    staging: &Staging,
    name: &Path,
    fill: impl FnOnce(&mut Artifact) -> io::Result<()>,
) -> Result<(), RunError> {
    let mut artifact = Artifact::create(staging.begin(name)?)?;
    fill(&mut artifact).map_err(|error| artifact.failed(error))?;
    Ok(artifact.commit()?)
}
