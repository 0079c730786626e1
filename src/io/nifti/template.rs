//! A header to write by.

use glam::{DMat3, DVec3};

use super::affine::Placement;
use super::error::NiftiProblem;
use super::header::{ByteOrder, FIRST_OFFSET, HEADER_LEN, Header, Transform, at};
use crate::io::axes::StoredAxes;
use crate::space::{Grid, RasPoint, lps_axes_to_ras};
use crate::volume::{Rescale, SampleType};

/// What a file's header said, and how to write files that overlay it: the same grid, stored axis order
/// and flips, type, scaling and byte order.
#[derive(Debug, Clone)]
pub struct Template {
    pub(super) header: RawHeader,
    /// Lengths by stored axis.
    pub(super) stored: [usize; 3],
    placement: Placement,
    sample_type: SampleType,
    rescale: Rescale,
}

impl Template {
    pub(super) fn from_header(header: &Header) -> Result<Self, NiftiProblem> {
        let mut raw = RawHeader {
            bytes: header.bytes,
            order: header.order,
        };
        raw.clear_text();
        raw.bytes[at::MAGIC..].copy_from_slice(b"n+1\0");
        raw.put_f32(at::VOX_OFFSET, FIRST_OFFSET as f32);
        let scaling = [header.parsed.scl_slope, header.parsed.scl_inter];
        if scaling.iter().any(|value| !value.is_finite()) {
            // "No scaling", in a form that no reader turns into a volume of NaN.
            raw.put_f32(at::SCL_SLOPE, 1.0);
            raw.put_f32(at::SCL_INTER, 0.0);
        }
        Ok(Self {
            header: raw,
            stored: header.dims,
            placement: Placement::of(header)?,
            sample_type: header.sample_type,
            rescale: header.rescale,
        })
    }

    /// A header for a volume made here: stored in LPS order, little endian, sform and qform with code 1,
    /// mm. A header holds `f32`, so [`Template::grid`] and [`Template::rescale`] are what a reader will
    /// see: those given, rounded.
    ///
    /// # Errors
    /// [`NiftiProblem`] where rounding leaves nothing usable (a spacing below 1e-38 mm).
    pub fn for_grid(
        grid: &Grid,
        sample_type: SampleType,
        rescale: Rescale,
    ) -> Result<Self, NiftiProblem> {
        let mut raw = RawHeader {
            bytes: [0; HEADER_LEN],
            order: ByteOrder::Little,
        };
        raw.bytes[..4].copy_from_slice(&(HEADER_LEN as i32).to_le_bytes());
        // An unused field that readers of Analyze 7.5 want to be 'r'.
        raw.bytes[at::REGULAR] = b'r';
        let [nx, ny, nz] = grid.dims().map(|n| i16::try_from(n).unwrap_or(i16::MAX));
        raw.put_i16s(at::DIM, &[3, nx, ny, nz, 1, 1, 1, 1]);
        raw.put_type(sample_type);
        raw.put_f32(at::SCL_SLOPE, rescale.slope as f32);
        raw.put_f32(at::SCL_INTER, rescale.intercept as f32);
        raw.put_f32(at::VOX_OFFSET, FIRST_OFFSET as f32);
        raw.bytes[at::XYZT_UNITS] = 2;
        raw.bytes[at::MAGIC..].copy_from_slice(b"n+1\0");
        raw.put_position(grid);
        let header = Header::parse(&raw.bytes)?;
        Self::from_header(&header)
    }

    /// Size, spacing and position, axes in LPS order.
    pub fn grid(&self) -> &Grid {
        &self.placement.grid
    }

    /// The type that samples are stored in.
    pub fn sample_type(&self) -> SampleType {
        self.sample_type
    }

    /// What stored samples mean in Hounsfield units.
    pub fn rescale(&self) -> Rescale {
        self.rescale
    }

    /// How the file's axes lie; shown as `RAS`, `LPS` and so on.
    pub fn orientation(&self) -> StoredAxes {
        self.placement.axes
    }

    /// Where the position was taken from. After [`Transform::None`] left and right are assumed.
    pub fn transform(&self) -> Transform {
        self.placement.transform
    }

    /// Voxels along the file's own axes, fastest first.
    pub fn stored_dims(&self) -> [usize; 3] {
        self.stored
    }

    /// The order of a number's bytes.
    pub fn byte_order(&self) -> ByteOrder {
        self.header.order
    }
}

/// The bytes of a header, to be patched.
#[derive(Debug, Clone)]
pub(super) struct RawHeader {
    pub(super) bytes: [u8; HEADER_LEN],
    pub(super) order: ByteOrder,
}

impl RawHeader {
    /// Fields of free text, where a scanner or a converter may have put the patient's name.
    pub(super) fn clear_text(&mut self) {
        for field in [
            at::DATA_TYPE..at::EXTENTS,
            at::DESCRIP..at::QFORM_CODE,
            at::INTENT_NAME..at::MAGIC,
        ] {
            self.bytes[field].fill(0);
        }
    }

    fn put<const N: usize>(&mut self, at: usize, little_endian: [u8; N]) {
        let mut bytes = little_endian;
        if self.order == ByteOrder::Big {
            bytes.reverse();
        }
        self.bytes[at..at + N].copy_from_slice(&bytes);
    }

    pub(super) fn put_f32(&mut self, at: usize, value: f32) {
        self.put(at, value.to_le_bytes());
    }

    pub(super) fn put_i16s(&mut self, at: usize, values: &[i16]) {
        for (index, value) in values.iter().enumerate() {
            self.put(at + 2 * index, value.to_le_bytes());
        }
    }

    pub(super) fn put_type(&mut self, sample_type: SampleType) {
        let code = match sample_type {
            SampleType::U8 => 2,
            SampleType::I16 => 4,
            SampleType::I32 => 8,
            SampleType::F32 => 16,
            SampleType::F64 => 64,
            SampleType::I8 => 256,
            SampleType::U16 => 512,
            SampleType::U32 => 768,
            SampleType::I64 => 1024,
            SampleType::U64 => 1280,
        };
        let bits = 8 * sample_type.bytes() as i16;
        self.put_i16s(at::DATATYPE, &[code, bits]);
    }

    /// Spacing, sform and qform of a volume stored in LPS order.
    fn put_position(&mut self, grid: &Grid) {
        let spacing = grid.spacing();
        let axes = lps_axes_to_ras(grid.direction());
        let origin = RasPoint::from(grid.origin()).0;
        for axis in 0..3 {
            let row = [0, 1, 2].map(|column| axes.col(column)[axis] * spacing[column]);
            for (column, value) in row.into_iter().chain([origin[axis]]).enumerate() {
                self.put_f32(at::SROW_X + 16 * axis + 4 * column, value as f32);
            }
            self.put_f32(at::PIXDIM + 4 * (axis + 1), spacing[axis] as f32);
            self.put_f32(at::QOFFSET_X + 4 * axis, origin[axis] as f32);
        }
        let mirrored = axes.determinant() < 0.0;
        self.put_f32(at::PIXDIM, if mirrored { -1.0 } else { 1.0 });
        let third = if mirrored { -axes.z_axis } else { axes.z_axis };
        let imaginary = quaternion(DMat3::from_cols(axes.x_axis, axes.y_axis, third));
        for axis in 0..3 {
            self.put_f32(at::QUATERN_B + 4 * axis, imaginary[axis] as f32);
        }
        self.put_i16s(at::QFORM_CODE, &[1, 1]);
    }
}

/// b, c, d of a rotation's unit quaternion, in the form whose real part a is not negative (nifti1.h
/// stores no a).
fn quaternion(rotation: DMat3) -> DVec3 {
    let [x, y, z] = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
    // 4a², 4b², 4c², 4d²: the largest is the one to divide by (Shepperd 1978).
    let trace = x.x + y.y + z.z;
    let squares = [
        1.0 + trace,
        1.0 + 2.0 * x.x - trace,
        1.0 + 2.0 * y.y - trace,
        1.0 + 2.0 * z.z - trace,
    ];
    let mut largest = 0;
    for candidate in 1..4 {
        if squares[candidate] > squares[largest] {
            largest = candidate;
        }
    }
    let twice = squares[largest].max(0.0).sqrt();
    // 4ab, 4ac, 4ad and 4bc, 4bd, 4cd.
    let with_a = DVec3::new(y.z - z.y, z.x - x.z, x.y - y.x);
    let (bc, bd, cd) = (x.y + y.x, x.z + z.x, y.z + z.y);
    let square = squares[largest];
    let (real, imaginary) = match largest {
        0 => (square, with_a),
        1 => (with_a.x, DVec3::new(square, bc, bd)),
        2 => (with_a.y, DVec3::new(bc, square, cd)),
        _ => (with_a.z, DVec3::new(bd, cd, square)),
    };
    let sign = if real < 0.0 { -1.0 } else { 1.0 };
    imaginary * (sign / (2.0 * twice))
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::space::LpsPoint;

    #[test]
    fn every_rotation_has_its_quaternion() {
        let mut state = 7_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX) - 0.5
        };
        let mut turns = vec![
            DQuat::IDENTITY,
            DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0),
            DQuat::from_xyzw(0.0, 1.0, 0.0, 0.0),
            DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0),
        ];
        turns
            .extend((0..500).map(|_| DQuat::from_xyzw(next(), next(), next(), next()).normalize()));
        for turn in turns {
            let v = quaternion(DMat3::from_quat(turn));
            let a = (1.0 - v.length_squared()).max(0.0).sqrt();
            let back = DMat3::from_quat(DQuat::from_xyzw(v.x, v.y, v.z, a));
            // Near a = 0 the missing part is the root of a difference: half the digits.
            assert!(back.abs_diff_eq(DMat3::from_quat(turn), 1e-7), "{turn}");
        }
    }

    #[test]
    fn sform_and_qform_of_a_made_header_agree_with_the_grid() {
        let turn = DMat3::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.35);
        let grid = Grid::new(
            [20, 30, 40],
            [0.5, 0.75, 1.25],
            LpsPoint::new(-10.0, 20.0, 5.0),
            turn,
        )
        .unwrap();
        let rescale = Rescale {
            slope: 0.5,
            intercept: -1024.0,
        };
        let template = Template::for_grid(&grid, SampleType::U16, rescale).unwrap();
        assert_eq!(template.transform(), Transform::Sform);
        assert_eq!(template.orientation(), StoredAxes::LPS);
        assert_eq!(
            (template.sample_type(), template.rescale()),
            (SampleType::U16, rescale)
        );
        let mut qform_only = template.header.clone();
        qform_only.put_i16s(at::QFORM_CODE, &[1, 0]);
        let qform_only = Template::from_header(&Header::parse(&qform_only.bytes).unwrap()).unwrap();
        assert_eq!(qform_only.transform(), Transform::Qform);
        for found in [template.grid(), qform_only.grid()] {
            assert_eq!(found.dims(), grid.dims());
            assert!((found.spacing() - grid.spacing()).length() < 1e-6);
            assert!((found.origin().0 - grid.origin().0).length() < 1e-5);
            assert!(found.direction().abs_diff_eq(turn, 1e-6));
        }
    }
}
