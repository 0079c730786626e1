//! From slices in any order to a regular stack, or everything that is irregular about it.
//!
//! Positions alone count: not names, not InstanceNumber, not SliceThickness, not SliceLocation.

use std::fmt;

use glam::{DMat3, DVec3};

use super::error::DicomProblem;
use super::slice::Slice;
use crate::io::axes::{StoredAxes, place};
use crate::space::{Grid, LpsPoint};

/// How far, in mm, a slice may be from where a regular stack would have it. Some scanners round positions to
/// 0.1 mm; the map's own tolerance is half of this, and no voxel is as small.
const STRAY_MM: f64 = 0.1;

/// The same as a part of the spacing, so that thin slices are not taken for regular when they are not.
const STRAY_PART: f64 = 0.1;

/// Two positions closer than this, in mm, are one: a millionth of it would do for equal numbers, and scanners
/// do not step by less than ten times as much.
const SAME_POSITION_MM: f64 = 0.01;

/// The largest tangent of a gantry's tilt: 0.06°, the shear that a grid lets pass, and 0.3 mm over a head. The
/// stack's own direction is kept, so that nothing is lost.
const TILT: f64 = 1e-3;

/// The largest coordinate, mm: a scanner's table is shorter, and a NIfTI header keeps it to 3e-4 mm.
const MAX_COORDINATE_MM: f64 = 4096.0;

/// How many gaps or positions a message lists.
const LISTED: usize = 6;

/// What is irregular about a stack.
#[derive(Debug, Clone, PartialEq)]
pub enum GeometryFault {
    /// A single slice.
    Alone,
    /// The stack leans.
    Tilt {
        /// Between the stack's direction and the slices' normal, degrees.
        angle_deg: f64,
    },
    /// Slices lie in the same place.
    Duplicates {
        /// How many are too many.
        count: usize,
        /// Where, mm along the normal, from the first slice.
        at_mm: Vec<f64>,
    },
    /// Steps of several spacings.
    Missing {
        /// The spacing of the others, mm.
        spacing_mm: f64,
        /// After where, mm along the normal from the first slice, and how many slices are not there.
        holes: Vec<(f64, usize)>,
    },
    /// Steps of several lengths.
    Uneven {
        /// Each length, the most frequent first.
        gaps: Vec<Gap>,
    },
    /// Slices are displaced within their planes.
    Stray {
        /// The largest displacement, mm.
        by_mm: f64,
        /// Where, mm along the normal from the first slice.
        at_mm: f64,
    },
}

/// Steps of one length in an uneven stack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// The length, mm, to a hundredth.
    pub mm: f64,
    /// How often it is stepped.
    pub times: usize,
    /// After where it is first, mm along the normal from the first slice.
    pub after_mm: f64,
}

impl fmt::Display for GeometryFault {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |items: Vec<String>, all: usize| {
            let more = all - items.len();
            let and = if more > 0 {
                format!(" and {more} more")
            } else {
                String::new()
            };
            items.join(", ") + &and
        };
        match self {
            Self::Alone => to.write_str("one slice has no spacing"),
            Self::Tilt { angle_deg } => write!(
                to,
                "the gantry was tilted by {angle_deg:.1}° (each slice is displaced within its plane)"
            ),
            Self::Duplicates { count, at_mm } => {
                let places = at_mm.iter().take(LISTED);
                let places = places.map(|mm| format!("{} mm", shown(*mm))).collect();
                write!(
                    to,
                    "{count} of them lie where another one lies, at {} from the first",
                    list(places, at_mm.len())
                )
            }
            Self::Missing { spacing_mm, holes } => {
                let places = holes.iter().take(LISTED);
                let places = places
                    .map(|(after, count)| format!("{count} after {} mm", shown(*after)))
                    .collect();
                write!(
                    to,
                    "slices are missing from a spacing of {} mm: {}, from the first",
                    shown(*spacing_mm),
                    list(places, holes.len())
                )
            }
            Self::Uneven { gaps } => {
                let lengths = gaps.iter().take(LISTED);
                let lengths = lengths
                    .map(|gap| {
                        let first = if gap.times > 1 { "first " } else { "" };
                        let (mm, after) = (shown(gap.mm), shown(gap.after_mm));
                        format!("{mm} mm ({}×, {first}after {after} mm)", gap.times)
                    })
                    .collect();
                let lengths = list(lengths, gaps.len());
                write!(to, "they are {lengths} apart, places from the first slice")
            }
            Self::Stray { by_mm, at_mm } => write!(
                to,
                "some are displaced within their planes, by up to {} mm, most at {} mm from the first",
                shown(*by_mm),
                shown(*at_mm)
            ),
        }
    }
}

/// A length to a hundredth of a mm, without zeros at its end.
fn shown(mm: f64) -> f64 {
    (mm * 100.0).round() / 100.0
}

/// A regular stack.
#[derive(Debug, Clone)]
pub(super) struct Stack {
    /// The numbers of the slices given, in the order in which they lie.
    pub(super) order: Vec<usize>,
    pub(super) grid: Grid,
    pub(super) axes: StoredAxes,
    /// Between slices, mm.
    pub(super) spacing: f64,
}

impl Stack {
    /// The stack of slices of one orientation, size and pixel spacing.
    pub(super) fn new(slices: &[&Slice]) -> Result<Self, DicomProblem> {
        let irregular = |faults: Vec<GeometryFault>| DicomProblem::Geometry {
            slices: slices.len(),
            remedy: remedy(&faults),
            faults,
        };
        let Some(first) = slices.first() else {
            return Err(irregular(vec![GeometryFault::Alone]));
        };
        let normal = first.normal();
        let along = |index: &usize| slices[*index].position.dot(normal);
        let mut order: Vec<usize> = (0..slices.len()).collect();
        order.sort_by(|a, b| along(a).total_cmp(&along(b)));
        let positions: Vec<DVec3> = order.iter().map(|&index| slices[index].position).collect();
        let step = match examine(&positions, normal) {
            Ok(step) => step,
            Err(faults) => return Err(irregular(faults)),
        };
        let [between_columns, between_rows] = first.spacing;
        let columns = DMat3::from_cols(
            first.along_row * between_columns,
            first.along_column * between_rows,
            step,
        );
        let stored = [first.format.columns, first.format.rows, slices.len()];
        let origin = positions.first().copied().unwrap_or_default();
        let (grid, axes) = place(stored, columns, LpsPoint(origin))?;
        check_extent(&grid)?;
        Ok(Self {
            order,
            grid,
            axes,
            spacing: step.length(),
        })
    }
}

fn check_extent(grid: &Grid) -> Result<(), DicomProblem> {
    let last = grid.last_index() * grid.spacing();
    let mut found: f64 = 0.0;
    for corner in 0..8 {
        let end = |axis: usize| {
            if corner >> axis & 1 == 1 {
                last[axis]
            } else {
                0.0
            }
        };
        let at = crate::space::GridPoint::new(end(0), end(1), end(2));
        found = found.max(grid.grid_to_lps(at).0.abs().max_element());
    }
    // Not `>`: an overflow is no number.
    if found <= MAX_COORDINATE_MM {
        Ok(())
    } else {
        let limit = MAX_COORDINATE_MM;
        Err(DicomProblem::FarAway { found, limit })
    }
}

/// The step from slice to slice of positions sorted along the normal, or all that is wrong with them.
fn examine(positions: &[DVec3], normal: DVec3) -> Result<DVec3, Vec<GeometryFault>> {
    let (Some(&first), Some(&last)) = (positions.first(), positions.last()) else {
        return Err(vec![GeometryFault::Alone]);
    };
    if positions.len() < 2 {
        return Err(vec![GeometryFault::Alone]);
    }
    let mut faults = Vec::new();
    let along: Vec<f64> = positions.iter().map(|p| (*p - first).dot(normal)).collect();
    let gaps: Vec<f64> = along.windows(2).map(|pair| pair[1] - pair[0]).collect();

    let duplicates: Vec<f64> = gaps
        .iter()
        .zip(&along)
        .filter(|(gap, _)| **gap <= SAME_POSITION_MM)
        .map(|(_, at)| *at)
        .collect();
    if !duplicates.is_empty() {
        let count = duplicates.len();
        let mut at_mm = duplicates;
        at_mm.dedup_by(|a, b| (*a - *b).abs() <= SAME_POSITION_MM);
        faults.push(GeometryFault::Duplicates { count, at_mm });
    }

    let whole = last - first;
    let reach = whole.dot(normal);
    let aside = (whole - normal * reach).length();
    let tilted = reach > SAME_POSITION_MM && aside > TILT * reach + SAME_POSITION_MM;
    if tilted {
        let angle_deg = libm::atan2(aside, reach).to_degrees();
        faults.push(GeometryFault::Tilt { angle_deg });
    }

    let step = whole / (positions.len() - 1) as f64;
    let spacing = step.dot(normal);
    let tolerance = STRAY_MM.min(STRAY_PART * spacing);
    // The furthest astray, and where.
    let strays = |direction: &dyn Fn(DVec3) -> f64| {
        positions
            .iter()
            .zip(&along)
            .enumerate()
            .map(|(index, (p, at))| (direction(*p - first - step * index as f64), *at))
            .fold(
                (0.0, 0.0),
                |most, next| if next.0 > most.0 { next } else { most },
            )
    };
    let (astray, _) = strays(&|by| by.dot(normal).abs());
    if duplicates_free(&faults) && astray > tolerance {
        faults.push(uneven(&gaps, &along));
    }
    // Beside a tilted stack that is uneven, the line through its ends is no measure of what is aside.
    let (by_mm, at_mm) = strays(&|by| (by - normal * by.dot(normal)).length());
    if faults.is_empty() && by_mm > tolerance {
        faults.push(GeometryFault::Stray { by_mm, at_mm });
    }
    if faults.is_empty() {
        Ok(step)
    } else {
        Err(faults)
    }
}

fn duplicates_free(faults: &[GeometryFault]) -> bool {
    !faults
        .iter()
        .any(|fault| matches!(fault, GeometryFault::Duplicates { .. }))
}

/// Missing slices, where all gaps are multiples of the smallest; else uneven ones.
fn uneven(gaps: &[f64], along: &[f64]) -> GeometryFault {
    let smallest = gaps.iter().copied().fold(f64::INFINITY, f64::min);
    let tolerance = STRAY_MM.min(STRAY_PART * smallest);
    let steps: Vec<f64> = gaps.iter().map(|gap| (gap / smallest).round()).collect();
    let multiples = gaps
        .iter()
        .zip(&steps)
        .all(|(gap, steps)| (gap - steps * smallest).abs() <= tolerance * steps.min(2.0));
    let single = steps.iter().filter(|&&steps| steps == 1.0).count();
    // Steps that are all single drift; more holes than slices in a row are no holes: the spacing changes.
    if multiples && single < gaps.len() && 2 * single > gaps.len() {
        let holes = steps
            .iter()
            .zip(along)
            .filter(|(steps, _)| **steps > 1.0)
            .map(|(steps, at)| (*at, *steps as usize - 1))
            .collect();
        return GeometryFault::Missing {
            spacing_mm: smallest,
            holes,
        };
    }
    let mut lengths: Vec<Gap> = Vec::new();
    for (gap, &after_mm) in gaps.iter().zip(along) {
        let mm = shown(*gap);
        match lengths.iter_mut().find(|gap| gap.mm == mm) {
            Some(gap) => gap.times += 1,
            None => lengths.push(Gap {
                mm,
                times: 1,
                after_mm,
            }),
        }
    }
    // Most frequent first, then as they come along the normal.
    lengths.sort_by_key(|gap| std::cmp::Reverse(gap.times));
    GeometryFault::Uneven { gaps: lengths }
}

fn remedy(faults: &[GeometryFault]) -> &'static str {
    let has = |what: fn(&GeometryFault) -> bool| faults.iter().any(what);
    if has(|fault| matches!(fault, GeometryFault::Alone)) {
        "copy the whole series"
    } else if has(|fault| matches!(fault, GeometryFault::Duplicates { .. })) {
        "keep one of the repeated scans in the folder"
    } else if has(|fault| matches!(fault, GeometryFault::Tilt { .. })) {
        "use an untilted reconstruction, or resample to a rectangular grid (dcm2niix does) and check \
         landmarks on the result"
    } else if has(|fault| matches!(fault, GeometryFault::Missing { .. })) {
        "copy the missing files"
    } else {
        "use a reconstruction of even spacing"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(steps: &[f64]) -> Vec<DVec3> {
        steps.iter().map(|z| DVec3::new(-100.0, 20.0, *z)).collect()
    }

    fn fault(steps: &[f64]) -> GeometryFault {
        let mut faults = examine(&line(steps), DVec3::Z).unwrap_err();
        assert_eq!(faults.len(), 1, "{faults:?}");
        faults.remove(0)
    }

    #[test]
    fn positions_rounded_to_a_tenth_are_regular() {
        let rounded: Vec<f64> = (0..200).map(|i| f64::from(i) * 1.25).collect();
        let rounded: Vec<f64> = rounded.iter().map(|z| (z * 10.0).round() / 10.0).collect();
        let step = examine(&line(&rounded), DVec3::Z).unwrap();
        assert!((step.z - 1.25).abs() < 1e-3 && step.x == 0.0, "{step}");
    }

    #[test]
    fn a_slow_drift_is_not_regular() {
        let drifting: Vec<f64> = (0..100)
            .map(f64::from)
            .map(|i| i + 0.0001 * i * i)
            .collect();
        assert!(matches!(fault(&drifting), GeometryFault::Uneven { .. }));
    }

    #[test]
    fn holes_are_told_from_uneven_steps() {
        assert_eq!(
            fault(&[0.0, 1.5, 3.0, 7.5, 9.0]),
            GeometryFault::Missing {
                spacing_mm: 1.5,
                holes: vec![(3.0, 2)]
            }
        );
        assert_eq!(
            fault(&[0.0, 1.0, 2.0, 4.0, 6.0, 8.0]),
            GeometryFault::Uneven {
                gaps: vec![
                    Gap {
                        mm: 2.0,
                        times: 3,
                        after_mm: 2.0
                    },
                    Gap {
                        mm: 1.0,
                        times: 2,
                        after_mm: 0.0
                    }
                ]
            },
            "the spacing changes"
        );
        assert_eq!(
            fault(&[0.0, 1.0, 2.5, 4.0]).to_string(),
            "they are 1.5 mm (2×, first after 1 mm), 1 mm (1×, after 0 mm) apart, places from the first slice"
        );
    }

    #[test]
    fn one_hole_in_a_thousand_slices_is_seen() {
        let holed: Vec<f64> = (0..1000).filter(|i| *i != 998).map(f64::from).collect();
        assert_eq!(
            fault(&holed),
            GeometryFault::Missing {
                spacing_mm: 1.0,
                holes: vec![(997.0, 1)]
            }
        );
    }

    #[test]
    fn duplicates_are_told_with_their_places() {
        assert_eq!(
            fault(&[0.0, 2.0, 2.0, 2.001, 4.0]),
            GeometryFault::Duplicates {
                count: 2,
                at_mm: vec![2.0]
            }
        );
    }

    #[test]
    fn a_tilt_is_told_with_its_angle_and_a_small_one_is_kept() {
        let leaning = |tangent: f64| -> Vec<DVec3> {
            (0..30)
                .map(|i| DVec3::new(0.0, f64::from(i) * 2.0 * tangent, f64::from(i) * 2.0))
                .collect()
        };
        let tangent = libm::tan(18.5_f64.to_radians());
        let faults = examine(&leaning(tangent), DVec3::Z).unwrap_err();
        assert!(
            faults[0].to_string().contains("tilted by 18.5°"),
            "{faults:?}"
        );
        assert_eq!(faults.len(), 1);
        let step = examine(&leaning(0.5e-3), DVec3::Z).unwrap();
        assert!((step.y - 1e-3).abs() < 1e-12, "{step}");
    }

    #[test]
    fn slices_that_jump_aside_are_refused() {
        let mut positions = line(&[0.0, 1.0, 2.0, 3.0]);
        positions[1].x += 0.4;
        let faults = examine(&positions, DVec3::Z).unwrap_err();
        let [GeometryFault::Stray { by_mm, at_mm }] = faults[..] else {
            panic!("{faults:?}");
        };
        assert_eq!(at_mm, 1.0);
        assert!((by_mm - 0.4).abs() < 1e-9, "{by_mm}");
    }
}
