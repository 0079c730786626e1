//! From the plan as written, and the grid of its CT, to the plan as it runs.

mod landmarks;
mod stages;

use std::path::Path;

use super::decode::Faults;
use super::diagnostic::{Code, Fault};
use super::raw::{Frame, RawCt, RawLength, RawPlan};
use super::resolved::{CtSource, DEFAULT_CAGE_DEPTH_MM, Plan};
use super::source::Span;
use crate::feature::{Landmark, Landmarks, LineError};
use crate::space::{ContinuousIndex, Grid, GridPoint, LpsPoint, RasPoint};

pub(super) use landmarks::sides_of_voxels;
pub(super) use stages::misfits;

/// Where the CT is. `folder` is the plan file's.
pub(super) fn ct(ct: &RawCt, folder: &Path) -> CtSource {
    match ct {
        RawCt::File {
            path,
            sha256,
            series,
        } => CtSource::File {
            path: folder.join(path),
            sha256: sha256.clone(),
            series: series.clone(),
        },
        RawCt::Phantom(phantom) => CtSource::Phantom(*phantom),
    }
}

/// The plan as it runs, or none where a fault of it is noted, here or before.
pub(super) fn plan(raw: &RawPlan, folder: &Path, grid: &Grid, faults: &mut Faults) -> Option<Plan> {
    let placed = landmarks::place(raw, grid, faults);
    let candidates = stages::candidates(raw, grid, &placed, faults);
    if !faults.list.is_empty() {
        return None;
    }
    let resolved = || {
        Some(Plan {
            name: raw.name.clone()?.value,
            title: raw.title.clone(),
            ct: ct(raw.ct.as_ref()?, folder),
            landmarks: placed.landmarks?,
            snap_mm: raw.landmarks.snap_mm,
            cage_depth_mm: match raw.cage_depth {
                Some(RawLength::Mm(mm)) => mm,
                Some(RawLength::Voxels(voxels)) => voxels * grid.spacing().y,
                None => DEFAULT_CAGE_DEPTH_MM,
            },
            f1: placed.f1?,
            enhance: raw.enhance,
            segment: raw.segment,
            morph: raw.morph,
            candidates: candidates?,
            outputs: raw.outputs,
            views: raw.views.clone(),
            mesh: raw.mesh,
            accept: raw.accept.clone(),
        })
    };
    let plan = resolved();
    if plan.is_none() {
        // Whatever is absent has been noted as a fault; this is for the day on which that is forgotten.
        let message =
            "this plan could not be resolved, and rhinoplan cannot say why; this is a bug";
        faults.push(Fault::new(Code::BadValue, Span::default(), message));
    }
    plan
}

/// A point of the plan on the voxel lattice.
fn to_index(point: [f64; 3], frame: Frame, grid: &Grid) -> ContinuousIndex {
    match frame {
        Frame::Voxel => ContinuousIndex::from(point),
        Frame::Lps => grid.grid_to_index(grid.lps_to_grid(LpsPoint::from(point))),
        Frame::Ras => {
            let point = LpsPoint::from(RasPoint::from(point));
            grid.grid_to_index(grid.lps_to_grid(point))
        }
    }
}

/// A point of the plan in grid millimetres.
pub(super) fn to_grid(point: [f64; 3], frame: Frame, grid: &Grid) -> GridPoint {
    match frame {
        Frame::Voxel => grid.index_to_grid(ContinuousIndex::from(point)),
        Frame::Lps => grid.lps_to_grid(LpsPoint::from(point)),
        Frame::Ras => grid.lps_to_grid(LpsPoint::from(RasPoint::from(point))),
    }
}

/// A position as a plan would write it.
pub(super) fn from_grid(point: GridPoint, frame: Frame, grid: &Grid) -> [f64; 3] {
    match frame {
        Frame::Voxel => grid.grid_to_index(point).to_array(),
        Frame::Lps => grid.grid_to_lps(point).to_array(),
        Frame::Ras => RasPoint::from(grid.grid_to_lps(point)).to_array(),
    }
}

/// The plan as if it gave these positions for the landmarks that have one.
pub(super) fn with_moved(
    raw: &RawPlan,
    grid: &Grid,
    moved: &Landmarks<Option<GridPoint>>,
) -> RawPlan {
    let mut raw = raw.clone();
    let Some(frame) = raw.landmarks.frame else {
        return raw;
    };
    for landmark in Landmark::ALL {
        let point = raw.landmarks.points.get_mut(landmark);
        if let (Some(to), Some(point)) = (moved.get(landmark), point) {
            point.value = from_grid(*to, frame, grid);
        }
    }
    raw
}

/// How far past the last voxel's centre still counts as on it, in voxels: the rounding of a conversion
/// from mm and back.
const EDGE_SLACK: f64 = 1e-6;

/// Whether a position is in the volume, rounding aside.
fn is_inside(index: ContinuousIndex, grid: &Grid) -> bool {
    let nearest = index.0.clamp(glam::DVec3::ZERO, grid.last_index());
    (index.0 - nearest).abs().max_element() <= EDGE_SLACK
}

/// A voxel position in a message.
fn show_index(index: ContinuousIndex) -> String {
    let [x, y, z] = index.to_array().map(show_number);
    format!("voxel ({x}, {y}, {z})")
}

/// A position or length in a message: to a tenth, unless it is so large that only its size matters.
fn show_number(number: f64) -> String {
    if number.abs() < 1e5 {
        format!("{number:.1}")
    } else {
        format!("{number:.1e}")
    }
}

/// What is wrong with a line, in a message.
fn show_line_error(error: LineError) -> String {
    match error {
        LineError::Degenerate { length_mm } => {
            format!("a line from root to tip of {length_mm:e} mm")
        }
        LineError::NotFinite => "an end at no finite position".to_owned(),
    }
}

/// The voxels that a grid has, in a message.
fn show_range(grid: &Grid) -> String {
    let [x, y, z] = grid.dims().map(|length| length - 1);
    format!("a voxel from (0, 0, 0) to ({x}, {y}, {z})")
}
