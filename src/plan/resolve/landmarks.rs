//! Landmarks and f1: in the volume, and each on its side of the others.

use super::super::decode::Faults;
use super::super::diagnostic::{Code, Fault};
use super::super::raw::{Frame, RawLandmarks, RawPlan};
use super::super::source::{Located, Span};
use super::{is_inside, show_index, show_line_error, show_number, show_range, to_grid, to_index};
use crate::feature::{FeatureLine, Landmark, Landmarks};
use crate::space::{ContinuousIndex, Grid, GridPoint};

/// What the landmarks give to the stages; none for what is absent or at fault.
pub(super) struct Placed {
    pub landmarks: Option<Landmarks<GridPoint>>,
    pub f1: Option<FeatureLine>,
    /// y of the base plane, grid mm.
    pub base_plane: Option<f64>,
}

type Indices = Landmarks<Option<Located<ContinuousIndex>>>;

/// The landmarks and the preoperative line in grid millimetres.
pub(super) fn place(raw: &RawPlan, grid: &Grid, faults: &mut Faults) -> Placed {
    let Some(frame) = raw.landmarks.frame else {
        return Placed {
            landmarks: None,
            f1: None,
            base_plane: None,
        };
    };
    let before = faults.list.len();
    let indices = in_voxels(&raw.landmarks, |point| to_index(point, frame, grid));
    let is_file = raw.landmarks.file.is_some();
    let hint = better_frame(raw, frame, grid).and_then(|frame| frame_hint(frame, is_file));
    for landmark in Landmark::ALL {
        if let Some(index) = indices.get(landmark) {
            let what = format!("landmark `{landmark}`");
            note_outside(index, &what, hint.clone(), grid, faults);
        }
    }
    if let Some(root) = &raw.f1_root {
        let root = Located {
            value: to_index(root.value, frame, grid),
            span: root.span,
        };
        note_outside(&root, "`f1.root`", hint.clone(), grid, faults);
    }
    for fault in wrong_sides(&indices) {
        let fault_hint = hint.clone().or(fault.hint.clone());
        faults.push(fault.hint(fault_hint));
    }

    let at = |landmark: Landmark| {
        let point = raw.landmarks.points.get(landmark).as_ref()?;
        Some(to_grid(point.value, frame, grid))
    };
    let landmarks = || {
        Some(Landmarks {
            nasal_bones: at(Landmark::NasalBones)?,
            lip: at(Landmark::Lip)?,
            alare_right: at(Landmark::AlareRight)?,
            alare_left: at(Landmark::AlareLeft)?,
            tip: at(Landmark::Tip)?,
            maxilla: at(Landmark::Maxilla)?,
        })
    };
    let root = match &raw.f1_root {
        Some(root) => Some(to_grid(root.value, frame, grid)),
        None => at(Landmark::NasalBones),
    };
    let f1 =
        root.zip(at(Landmark::Tip))
            .and_then(|(root, tip)| match FeatureLine::new(root, tip) {
                Ok(line) => Some(line),
                Err(error) => {
                    let tip = raw.landmarks.points.tip.as_ref();
                    let place = raw.f1_root.as_ref().or(tip);
                    let span = place.map_or(Span::default(), |place| place.span);
                    let fault = Fault::new(Code::BadValue, span, "f1 has no direction");
                    let fault = fault.found(show_line_error(error));
                    faults.push(
                        fault.expected("a root away from the tip, near the nasofrontal angle"),
                    );
                    None
                }
            });
    // Where a point is wrong, every stage would only repeat it.
    let f1 = f1.filter(|_| faults.list.len() == before);
    Placed {
        landmarks: landmarks(),
        f1,
        base_plane: at(Landmark::Maxilla).map(|maxilla| maxilla.0.y),
    }
}

/// Notes landmarks on the wrong side of each other, as far as that can be told without a grid: in voxels.
pub(in super::super) fn sides_of_voxels(raw: &RawLandmarks, faults: &mut Faults) {
    if raw.frame == Some(Frame::Voxel) {
        for fault in wrong_sides(&in_voxels(raw, ContinuousIndex::from)) {
            faults.push(fault);
        }
    }
}

fn in_voxels(raw: &RawLandmarks, convert: impl Fn([f64; 3]) -> ContinuousIndex) -> Indices {
    raw.points.clone().map(|point| {
        let Located { value, span } = point?;
        Some(Located {
            value: convert(value),
            span,
        })
    })
}

fn note_outside(
    index: &Located<ContinuousIndex>,
    what: &str,
    hint: Option<String>,
    grid: &Grid,
    faults: &mut Faults,
) {
    if !is_inside(index.value, grid) {
        let message = format!("{what} is outside the volume");
        let fault = Fault::new(Code::OutsideVolume, index.span, message);
        let fault = fault.found(show_index(index.value));
        faults.push(fault.expected(show_range(grid)).hint(hint));
    }
}

/// The pairs that are the wrong way round. Every comparison is of voxel positions, where x grows to the
/// patient's left, y to posterior and z to superior in every plan.
fn wrong_sides(indices: &Indices) -> Vec<Fault> {
    use Landmark::{AlareLeft, AlareRight, Lip, Maxilla, NasalBones, Tip};
    let rules = [
        (
            (AlareLeft, AlareRight, 0, "x"),
            "to the patient's left of",
            "swap `alare_left` and `alare_right`: left is the patient's left",
        ),
        (
            (NasalBones, Lip, 2, "z"),
            "above",
            "either the two points are swapped, or the head is upside-down in the volume",
        ),
        (
            (Maxilla, Tip, 1, "y"),
            "behind",
            "y grows to posterior: the tip of the nose has the smaller y",
        ),
    ];
    let mut faults = Vec::new();
    for ((greater, lesser, axis, letter), relation, hint) in rules {
        let (Some(high), Some(low)) = (indices.get(greater), indices.get(lesser)) else {
            continue;
        };
        let of = |index: &Located<ContinuousIndex>| index.value.0[axis];
        if of(high) > of(low) {
            continue;
        }
        let message = format!("`{greater}` is not {relation} `{lesser}`");
        // The place is the later of the two, which the reader meets knowing the other.
        let span = if high.span.start > low.span.start {
            high.span
        } else {
            low.span
        };
        let found = format!(
            "voxel {letter} = {} of `{greater}` and {} of `{lesser}`",
            show_number(of(high)),
            show_number(of(low))
        );
        let expected = format!("`{greater}` {relation} `{lesser}`: a greater voxel {letter}");
        let fault = Fault::new(Code::WrongSide, span, message);
        faults.push(fault.found(found).expected(expected).hint(hint.to_owned()));
    }
    faults
}

/// The frame in which every point would be in the volume and on its side, where the plan's is not such
/// a frame.
fn better_frame(raw: &RawPlan, frame: Frame, grid: &Grid) -> Option<Frame> {
    let fits = |frame: Frame| {
        let indices = in_voxels(&raw.landmarks, |point| to_index(point, frame, grid));
        let root = raw.f1_root.as_ref();
        let root_inside =
            root.is_none_or(|root| is_inside(to_index(root.value, frame, grid), grid));
        let all_inside = Landmark::ALL.iter().all(|landmark| {
            let index = indices.get(*landmark).as_ref();
            index.is_some_and(|index| is_inside(index.value, grid))
        });
        root_inside && all_inside && wrong_sides(&indices).is_empty()
    };
    if fits(frame) {
        return None;
    }
    [Frame::Ras, Frame::Lps, Frame::Voxel]
        .into_iter()
        .find(|&other| other != frame && fits(other))
}

/// None where a file cannot be in that frame.
fn frame_hint(frame: Frame, is_file: bool) -> Option<String> {
    let given = match frame {
        Frame::Voxel if is_file => return None,
        _ if is_file => format!(
            "if the file's numbers were in {}",
            frame.name().to_uppercase()
        ),
        _ => format!("with `frame = \"{}\"`", frame.name()),
    };
    Some(format!(
        "{given} every landmark would be in the volume and on its side"
    ))
}
