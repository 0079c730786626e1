//! Landmarks and f1: in the volume, and each on its side of the others.

use glam::DVec3;

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
/// Grid millimetres.
type Points = Landmarks<Option<Located<DVec3>>>;

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
    for fault in misplaced(&indices, grid) {
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

/// A rule on which of two landmarks has the greater position along an axis, and how it is said.
struct Side {
    greater: Landmark,
    lesser: Landmark,
    axis: usize,
    letter: &'static str,
    relation: &'static str,
    hint: &'static str,
}

const SIDES: [Side; 3] = [
    Side {
        greater: Landmark::AlareLeft,
        lesser: Landmark::AlareRight,
        axis: 0,
        letter: "x",
        relation: "to the patient's left of",
        hint: "swap `alare_left` and `alare_right`: left is the patient's left",
    },
    Side {
        greater: Landmark::NasalBones,
        lesser: Landmark::Lip,
        axis: 2,
        letter: "z",
        relation: "above",
        hint: "either the two points are swapped, or the head is upside-down in the volume: the CT's header gives wrong axes, or voxels were not counted from the lowest slice",
    },
    Side {
        greater: Landmark::Maxilla,
        lesser: Landmark::Tip,
        axis: 1,
        letter: "y",
        relation: "behind",
        hint: "y grows to posterior: the tip of the nose has the smaller y",
    },
];

/// Where several pairs are the wrong way round, swapping points is not the remedy.
const TURNED_HINT: &str = "several pairs are the wrong way round, so the whole head is turned: either the header of the CT gives wrong axes, or the points were counted along other axes than left, posterior and superior (`rhinoplan info` shows the CT's)";

/// The pairs that are the wrong way round. Every comparison is of voxel positions, where x grows to the
/// patient's left, y to posterior and z to superior in every plan.
fn wrong_sides(indices: &Indices) -> Vec<Fault> {
    let wrong = |side: &&Side| {
        let (Some(high), Some(low)) = (indices.get(side.greater), indices.get(side.lesser)) else {
            return false;
        };
        high.value.0[side.axis] <= low.value.0[side.axis]
    };
    let wrong: Vec<&Side> = SIDES.iter().filter(wrong).collect();
    let several = wrong.len() > 1;
    let fault = |side: &Side| {
        let (greater, lesser) = (side.greater, side.lesser);
        let (high, low) = (
            indices.get(greater).as_ref()?,
            indices.get(lesser).as_ref()?,
        );
        let relation = side.relation;
        let message = format!("`{greater}` is not {relation} `{lesser}`");
        let found = format!(
            "voxel {} = {} of `{greater}` and {} of `{lesser}`",
            side.letter,
            show_number(high.value.0[side.axis]),
            show_number(low.value.0[side.axis])
        );
        let expected = format!(
            "`{greater}` {relation} `{lesser}`: a greater voxel {}",
            side.letter
        );
        let hint = if several { TURNED_HINT } else { side.hint };
        let fault = Fault::new(Code::WrongSide, later(high, low), message);
        Some(fault.found(found).expected(expected).hint(hint.to_owned()))
    };
    wrong.into_iter().filter_map(fault).collect()
}

/// The place of two points that a fault of both is shown at: that which the reader meets knowing the other.
fn later<T, U>(one: &Located<T>, other: &Located<U>) -> Span {
    if one.span.start > other.span.start {
        one.span
    } else {
        other.span
    }
}

/// What is wrong with where the landmarks are to each other: pairs that are the wrong way round, or else a
/// head that lies in no way that a patient's does, or else a tip where no face has it.
fn misplaced(indices: &Indices, grid: &Grid) -> Vec<Fault> {
    let faults = wrong_sides(indices);
    if !faults.is_empty() {
        return faults;
    }
    let points = indices.clone().map(|index| {
        let Located { value, span } = index?;
        Some(Located {
            value: grid.index_to_grid(value).0,
            span,
        })
    });
    let faults = turned(&points);
    if !faults.is_empty() {
        return faults;
    }
    off_the_face(&points).into_iter().collect()
}

/// How far the head may be turned from the axes of the grid, degrees. Decided: patients lie with the head
/// bent or turned by up to some 40°, and the line from the nasal bones to the lip leans by 10 to 15° more. Two
/// axes of the head taken for each other, as from a wrong header, are 75° or more.
const MAX_TURN_DEG: f64 = 60.0;

/// The lines of the face that are further than [`MAX_TURN_DEG`] from where they point in a patient, in the
/// millimetres of the grid.
fn turned(points: &Points) -> Vec<Fault> {
    use Landmark::{AlareLeft, AlareRight, Lip, NasalBones};
    let lines = [
        (NasalBones, Lip, DVec3::NEG_Z, "downwards"),
        (AlareRight, AlareLeft, DVec3::X, "to the patient's left"),
    ];
    let fault = |(from, to, axis, way): (Landmark, Landmark, DVec3, &str)| {
        let (start, end) = (points.get(from).as_ref()?, points.get(to).as_ref()?);
        let along = (end.value - start.value).try_normalize()?.dot(axis);
        let angle = libm::acos(along.clamp(-1.0, 1.0)).to_degrees();
        if angle <= MAX_TURN_DEG {
            return None;
        }
        let message = format!("the line from `{from}` to `{to}` does not point {way}");
        let fault = Fault::new(Code::Orientation, later(start, end), message);
        let fault = fault.found(format!("a line {angle:.0}° off that direction"));
        let fault = fault.expected(format!("at most {MAX_TURN_DEG}°, however the patient lies"));
        Some(fault.hint(
            "either a point is not where its name says, or the header of the CT gives wrong axes (`rhinoplan info` shows them)"
                .to_owned(),
        ))
    };
    lines.into_iter().filter_map(fault).collect()
}

/// How far beside the nose its middle line may be, in its widths: more than any deviated nose or lip.
const BESIDE: f64 = 0.5;

/// What is not where every face has it, as the face itself is turned: the points of the middle line not far
/// beside the nose; the tip, and the middle of the alare points, between the nasal bones and the lip; the tip
/// in front of the line between those.
fn off_the_face(points: &Points) -> Option<Fault> {
    let (top, lip) = (points.nasal_bones.as_ref()?, points.lip.as_ref()?);
    let (right, left) = (points.alare_right.as_ref()?, points.alare_left.as_ref()?);
    let tip = points.tip.as_ref()?;
    let line = lip.value - top.value;
    let wings = left.value - right.value;
    let (down, across) = (line.try_normalize()?, wings.try_normalize()?);
    let front = down.cross(across).try_normalize()?;
    let fault = |span: Span, message: String, found: String, expected: &str| {
        let hint = "no face is like this; check that no two landmarks are exchanged";
        let fault = Fault::new(Code::WrongSide, span, message).found(found);
        Some(fault.expected(expected).hint(hint.to_owned()))
    };

    let middle = (right.value + left.value) / 2.0;
    for (landmark, point) in [
        (Landmark::NasalBones, top),
        (Landmark::Lip, lip),
        (Landmark::Tip, tip),
    ] {
        let off = (point.value - middle).dot(across).abs() - wings.length() / 2.0;
        if off > BESIDE * wings.length() {
            return fault(
                point.span,
                format!("`{landmark}` is far beside the nose"),
                format!("it {off:.1} mm beside the nearer alare point, across the face"),
                "at most half the distance of `alare_right` and `alare_left`",
            );
        }
    }

    let place = later(right, left);
    for (what, at, span) in [
        ("`tip`", tip.value, tip.span),
        (
            "the middle of `alare_right` and `alare_left`",
            middle,
            place,
        ),
    ] {
        let below = (at - top.value).dot(down);
        let (side, mm) = if below < 0.0 {
            ("above `nasal_bones`", -below)
        } else if below > line.length() {
            ("below `lip`", below - line.length())
        } else {
            continue;
        };
        return fault(
            span,
            format!("{what} is {side}"),
            format!("it {mm:.1} mm further, along the face"),
            "the nose between `nasal_bones` and `lip`",
        );
    }

    let before = (tip.value - top.value).dot(front);
    if before > 0.0 {
        return None;
    }
    fault(
        tip.span,
        "`tip` is not in front of the line from `nasal_bones` to `lip`".to_owned(),
        format!("it {:.1} mm behind, as the face looks", -before),
        "the tip in front of the face",
    )
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
        root_inside && all_inside && misplaced(&indices, grid).is_empty()
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

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    /// Landmarks in grid mm: nasal_bones, lip, alare_right, alare_left, tip, maxilla.
    type Head = [DVec3; 6];

    /// Those of an adult and of a head phantom, read by eye, and of the built-in head.
    fn heads() -> [Head; 3] {
        let of = |voxels: [[f64; 3]; 6], spacing: [f64; 3]| {
            voxels.map(|voxel| DVec3::from_array(voxel) * DVec3::from_array(spacing))
        };
        [
            of(
                [
                    [129.0, 39.0, 46.0],
                    [130.0, 26.0, 4.0],
                    [111.0, 33.0, 19.0],
                    [148.0, 33.0, 19.0],
                    [128.0, 12.0, 24.0],
                    [111.0, 41.0, 18.0],
                ],
                [0.957, 0.957, 1.5],
            ),
            of(
                [
                    [118.0, 44.0, 77.0],
                    [117.0, 25.0, 38.0],
                    [98.0, 36.0, 50.0],
                    [138.0, 36.0, 50.0],
                    [117.0, 15.0, 53.0],
                    [96.0, 40.0, 49.0],
                ],
                [0.977, 0.977, 2.0],
            ),
            of(
                [
                    [141.089, 71.61, 78.882],
                    [141.089, 67.61, 53.121],
                    [96.0, 60.0, 60.0],
                    [186.0, 60.0, 60.0],
                    [129.0, 33.0, 61.0],
                    [141.089, 83.61, 60.0],
                ],
                [0.442, 0.442, 1.0],
            ),
        ]
    }

    /// The codes and messages of what is wrong with a head, on a grid of 1 mm.
    fn faults(head: Head) -> Vec<(Code, String)> {
        let grid = Grid::axis_aligned([400; 3], [1.0; 3]).unwrap();
        let at = |place: usize| {
            Some(Located {
                value: ContinuousIndex(head[place]),
                span: Span {
                    start: place,
                    end: place + 1,
                },
            })
        };
        let indices = Landmarks {
            nasal_bones: at(0),
            lip: at(1),
            alare_right: at(2),
            alare_left: at(3),
            tip: at(4),
            maxilla: at(5),
        };
        let faults = misplaced(&indices, &grid);
        assert!(faults.iter().all(|fault| fault.found.is_some()
            && fault.expected.is_some()
            && fault.hint.is_some()));
        faults
            .into_iter()
            .map(|fault| (fault.code, fault.message))
            .collect()
    }

    fn turned_by(head: Head, axis: DVec3, degrees: f64) -> Head {
        let (sine, cosine) = libm::sincos(degrees.to_radians());
        let rotate =
            |v: DVec3| v * cosine + axis.cross(v) * sine + axis * (axis.dot(v) * (1.0 - cosine));
        head.map(rotate)
    }

    #[test]
    fn a_head_that_is_bent_or_turned_is_a_head() {
        for head in heads() {
            assert_eq!(faults(head), []);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                for degrees in [-45.0, -30.0, 30.0, 45.0] {
                    let found = faults(turned_by(head, axis, degrees));
                    assert_eq!(found, [], "{axis}, {degrees}°");
                }
            }
        }
    }

    #[test]
    fn no_patient_lies_like_this() {
        for head in heads() {
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                for degrees in [-90.0, 90.0, 180.0] {
                    let found = faults(turned_by(head, axis, degrees));
                    assert!(!found.is_empty(), "{axis}, {degrees}°");
                }
            }
            // Axes taken for each other or the wrong way round, as by a wrong header: all but the right one.
            let units = [DVec3::X, DVec3::Y, DVec3::Z];
            for [x, y, z] in [
                [0, 1, 2],
                [0, 2, 1],
                [1, 0, 2],
                [1, 2, 0],
                [2, 0, 1],
                [2, 1, 0],
            ] {
                for signs in 0..8 {
                    let sign = |bit: u32| if signs >> bit & 1 == 0 { 1.0 } else { -1.0 };
                    let axes = DMat3::from_cols(
                        units[x] * sign(0),
                        units[y] * sign(1),
                        units[z] * sign(2),
                    );
                    let found = faults(head.map(|point| axes * point));
                    assert_eq!(found.is_empty(), axes == DMat3::IDENTITY, "{axes}");
                }
            }
        }
    }

    #[test]
    fn points_exchanged() {
        // What is known of a face does not tell a maxilla from other points behind the tip.
        let undetected = [(0, 5), (1, 5), (2, 5), (3, 5)];
        for head in heads() {
            for one in 0..6 {
                for other in one + 1..6 {
                    let mut exchanged = head;
                    exchanged.swap(one, other);
                    let found = faults(exchanged);
                    assert!(
                        !found.is_empty() || undetected.contains(&(one, other)),
                        "{one} and {other}"
                    );
                }
            }
        }
    }

    #[test]
    fn each_fault_names_what_it_is_about() {
        let [head, ..] = heads();
        let with = |change: &dyn Fn(&mut Head)| {
            let mut head = head;
            change(&mut head);
            faults(head)
        };
        let found = with(&|head| head.swap(2, 3));
        let swapped = "`alare_left` is not to the patient's left of `alare_right`";
        assert_eq!(found, [(Code::WrongSide, swapped.to_owned())]);
        let found = with(&|head| head.swap(0, 4));
        assert_eq!(
            found,
            [(Code::WrongSide, "`tip` is above `nasal_bones`".to_owned())]
        );
        let found = with(&|head| head.swap(1, 4));
        assert_eq!(
            found,
            [(Code::WrongSide, "`tip` is below `lip`".to_owned())]
        );
        let found = with(&|head| head.swap(1, 2));
        assert_eq!(found[0].0, Code::WrongSide);
        assert!(found[0].1.contains("far beside the nose"), "{found:?}");
        let found = with(&|head| {
            head[2].z = 0.0;
            head[3].z = 0.0;
        });
        assert!(found[0].1.contains("middle of `alare_right`"), "{found:?}");
        let found = with(&|head| head[4].y = 40.0 * 0.957);
        assert!(found[0].1.contains("not in front of"), "{found:?}");
        let found = faults(turned_by(head, DVec3::X, 90.0));
        let turned = "the line from `nasal_bones` to `lip` does not point downwards";
        assert!(
            found.contains(&(Code::Orientation, turned.to_owned())),
            "{found:?}"
        );
    }

    #[test]
    fn several_pairs_have_one_cause() {
        let [head, ..] = heads();
        let grid = Grid::axis_aligned([400; 3], [1.0; 3]).unwrap();
        let upside_down = turned_by(head, DVec3::Y, 180.0);
        let mut found = Landmarks::none();
        for (place, landmark) in Landmark::ALL.into_iter().enumerate() {
            *found.get_mut(landmark) = Some(Located {
                value: ContinuousIndex(upside_down[place]),
                span: Span::default(),
            });
        }
        let faults = misplaced(&found, &grid);
        assert_eq!(faults.len(), 2);
        for fault in faults {
            assert_eq!(fault.hint.as_deref(), Some(TURNED_HINT));
        }
    }
}
