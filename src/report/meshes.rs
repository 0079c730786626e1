//! What the record says of meshes.

use serde::{Deserialize, Serialize};

use crate::mesh::Topology;
use crate::mesh::solid::SolidRecord;

/// The meshes of one nose. An object of which there is nothing has no file, and none here.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeshesRecord {
    /// `skin.stl` and, after an operation, `skin.ply`.
    pub skin: Option<MeshRecord>,
    /// `bone.stl`.
    pub bone: Option<MeshRecord>,
    /// What `skin.ply` holds; nothing before the first operation.
    pub change: Option<ChangeRecord>,
}

/// One mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeshRecord {
    /// Triangles.
    pub triangles: usize,
    /// What it encloses, mm³, by the divergence theorem.
    pub volume_mm3: f64,
    /// Area, mm².
    pub area_mm2: f64,
    /// By what share smoothing changed the volume.
    pub smoothing_volume_change: f64,
    /// By what share decimation changed the volume; nothing where there was none.
    pub decimation_volume_change: Option<f64>,
    /// What keeps it from being a closed 2-manifold: all zero.
    pub topology: Topology,
}

/// How far the points of the skin's mesh are from the skin before the first operation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChangeRecord {
    /// The furthest inward, mm; at most 0.
    pub inward_max_mm: f64,
    /// The furthest outward, mm; at least 0.
    pub outward_max_mm: f64,
    /// Points that have no skin before in reach; their `change_mm` is not a number.
    pub unknown: usize,
}

/// The skin-difference solids of a stage: no design of an implant, nor of a resection.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SolidsRecord {
    /// What was added: `augmentation.stl`, where there is any.
    pub augmentation: SolidRecord,
    /// What was taken away: `resection.stl`, where there is any.
    pub resection: SolidRecord,
}

impl ChangeRecord {
    /// Of the changes of a mesh's points, mm.
    pub fn of(change_mm: &[f32]) -> Self {
        let known = change_mm.iter().filter(|change| !change.is_nan());
        let (low, high) = known.fold((0.0_f32, 0.0_f32), |(low, high), &change| {
            (low.min(change), high.max(change))
        });
        Self {
            inward_max_mm: f64::from(low),
            outward_max_mm: f64::from(high),
            unknown: change_mm.iter().filter(|change| change.is_nan()).count(),
        }
    }
}
