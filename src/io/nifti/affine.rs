//! From a header's sform, qform or spacing to a grid in LPS order.

use glam::{DMat3, DQuat, DVec3};
use nifti::NiftiHeader;

use super::error::NiftiProblem;
use super::header::{Header, Transform, field};
use crate::io::axes::{StoredAxes, place};
use crate::space::{Grid, LpsPoint, RasPoint, ras_axes_to_lps};

/// How far b² + c² + d² of a unit quaternion may exceed 1: `f32` rounding gives 4e-7. What passes is
/// normalised, which turns the volume by less than 0.001°.
const QUATERNION_TOLERANCE: f64 = 1e-5;

/// A volume's place in space.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Placement {
    pub(super) grid: Grid,
    pub(super) axes: StoredAxes,
    pub(super) transform: Transform,
}

impl Placement {
    pub(super) fn of(header: &Header) -> Result<Self, NiftiProblem> {
        let (transform, columns, origin) = affine(&header.parsed)?;
        let scale = mm_per_unit(&header.parsed)?;
        let columns = ras_axes_to_lps(columns) * scale;
        let origin = LpsPoint::from(RasPoint(origin * scale));
        place(header.dims, columns, origin)
            .map(|(grid, axes)| Self {
                grid,
                axes,
                transform,
            })
            .map_err(|error| NiftiProblem::Grid { transform, error })
    }
}

/// Columns (one stored voxel along i, j, k) and the first voxel's centre, RAS, in the file's unit.
fn affine(header: &NiftiHeader) -> Result<(Transform, DMat3, DVec3), NiftiProblem> {
    if header.sform_code > 0 {
        let (columns, origin) = sform(header)?;
        return Ok((Transform::Sform, columns, origin));
    }
    let spacing = spacing(header)?;
    if header.qform_code > 0 {
        let (columns, origin) = qform(header, spacing)?;
        return Ok((Transform::Qform, columns, origin));
    }
    Ok((Transform::None, DMat3::from_diagonal(spacing), DVec3::ZERO))
}

const RESTORE: &str = "restore the orientation in the program that wrote the file";

fn sform(header: &NiftiHeader) -> Result<(DMat3, DVec3), NiftiProblem> {
    let rows = [
        ("srow_x", header.srow_x),
        ("srow_y", header.srow_y),
        ("srow_z", header.srow_z),
    ];
    for (name, row) in rows {
        if row.iter().any(|value| !value.is_finite()) {
            return Err(field(
                name,
                format!("{row:?}"),
                "four finite numbers",
                RESTORE,
            ));
        }
    }
    let [x, y, z] = rows.map(|(_, row)| row.map(f64::from));
    let column = |index: usize| DVec3::new(x[index], y[index], z[index]);
    Ok((DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}

fn spacing(header: &NiftiHeader) -> Result<DVec3, NiftiProblem> {
    let [_, x, y, z, ..] = header.pixdim;
    for (name, value) in [("pixdim[1]", x), ("pixdim[2]", y), ("pixdim[3]", z)] {
        if !(value.is_finite() && value > 0.0) {
            // Readers differ over a negative or zero spacing, so none of their guesses is taken.
            return Err(field(
                name,
                value,
                "a positive spacing (there is no sform)",
                RESTORE,
            ));
        }
    }
    Ok(DVec3::new(x.into(), y.into(), z.into()))
}

/// Method 2 of nifti1.h: rotation of the quaternion (a, b, c, d), a ≥ 0, times the spacing, the third
/// axis reversed where `pixdim[0]` is negative. A `pixdim[0]` of 0 "should not occur" and means 1.
fn qform(header: &NiftiHeader, spacing: DVec3) -> Result<(DMat3, DVec3), NiftiProblem> {
    let imaginary = [header.quatern_b, header.quatern_c, header.quatern_d];
    let origin = [header.quatern_x, header.quatern_y, header.quatern_z];
    for (name, values) in [
        ("quatern_b, _c, _d", imaginary),
        ("qoffset_x, _y, _z", origin),
    ] {
        if values.iter().any(|value| !value.is_finite()) {
            return Err(field(
                name,
                format!("{values:?}"),
                "three finite numbers",
                RESTORE,
            ));
        }
    }
    let [factor, ..] = header.pixdim;
    if !factor.is_finite() {
        return Err(field("pixdim[0]", factor, "1 or -1 (qfac)", RESTORE));
    }
    let [b, c, d] = imaginary.map(f64::from);
    let square = b * b + c * c + d * d;
    if square > 1.0 + QUATERNION_TOLERANCE {
        let found = format!("{imaginary:?}, of length {:.6}", square.sqrt());
        return Err(field(
            "quatern_b, _c, _d",
            found,
            "a length of at most 1",
            RESTORE,
        ));
    }
    let a = (1.0 - square).max(0.0).sqrt();
    let rotation = DMat3::from_quat(DQuat::from_xyzw(b, c, d, a).normalize());
    let third = if factor < 0.0 { -1.0 } else { 1.0 };
    let scale = DMat3::from_diagonal(spacing * DVec3::new(1.0, 1.0, third));
    Ok((rotation * scale, DVec3::from_array(origin.map(f64::from))))
}

fn mm_per_unit(header: &NiftiHeader) -> Result<f64, NiftiProblem> {
    match header.xyzt_units & 7 {
        0 | 2 => Ok(1.0),
        1 => Ok(1000.0),
        3 => Ok(0.001),
        other => Err(field(
            "xyzt_units",
            format!("{} (space {other})", header.xyzt_units),
            "0 (unknown, taken as mm), 1 (m), 2 (mm) or 3 (µm)",
            "set it to 2 if the spacing is in mm",
        )),
    }
}
