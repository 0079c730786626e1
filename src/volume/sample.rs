//! The number types that a volume can be stored in.

use std::fmt;

use bytemuck::Pod;
use serde::Serialize;

use super::{AnyVolume, Volume};
use crate::simd::{Real, round_within};

/// The name of a sample type.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "each variant is its sample type")]
pub enum SampleType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl SampleType {
    /// Bytes that a sample takes.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

impl fmt::Display for SampleType {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::U64 => "u64",
            Self::I64 => "i64",
            Self::F32 => "f32",
            Self::F64 => "f64",
        })
    }
}

/// A number that a voxel can be.
pub trait Sample: Pod + Default + PartialOrd + Send + Sync + fmt::Debug {
    /// Which one this is.
    const TYPE: SampleType;

    /// A float that holds means of a few samples without a loss that shows: `f32` for what has 24 bits or
    /// fewer.
    type Mean: Sample;

    /// Whether a blend of samples that gives all weight to one of them is that one, to the bit: not where others can be
    /// infinite or none, and not beyond 53 bits.
    const BLENDS_EXACTLY: bool;

    /// Whether it is an integer of at most 16 bits, of which single precision blends some to a ten-thousandth.
    const IS_SHORT: bool;

    /// The value, to compute with. Integers beyond 2⁵³ are rounded to the nearest `f64`.
    fn to_f64(self) -> f64;

    /// The nearest value of this type: integers are rounded half away from zero and clamped to the
    /// type's range, floats are kept.
    fn from_interpolated(value: f64) -> Self;

    /// The same of a value in any precision, which is rounded in that where it holds all values of this type.
    #[inline(always)]
    fn from_real<F: Real>(value: F) -> Self {
        Self::from_interpolated(value.to_f64())
    }

    /// The value as stored, little endian.
    fn le_bytes(self) -> impl AsRef<[u8]> + AsMut<[u8]>;

    /// Wraps a volume of this type.
    fn wrap(volume: Volume<Self>) -> AnyVolume;
}

macro_rules! sample_type {
    ($type:ty, $variant:ident, $mean:ty, $exact:literal, $value:ident => $from:expr $(, $short:ty)?) => {
        impl Sample for $type {
            const TYPE: SampleType = SampleType::$variant;
            const BLENDS_EXACTLY: bool = $exact;
            const IS_SHORT: bool = $exact && size_of::<Self>() <= 2;
            type Mean = $mean;

            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }

            #[inline(always)]
            fn from_interpolated($value: f64) -> Self {
                $from
            }

            #[inline]
            fn le_bytes(self) -> impl AsRef<[u8]> + AsMut<[u8]> {
                self.to_le_bytes()
            }

            fn wrap(volume: Volume<Self>) -> AnyVolume {
                AnyVolume::$variant(volume)
            }

            $(
                #[inline(always)]
                fn from_real<F: Real>(value: F) -> Self {
                    round_within::<F, { <$short>::MIN as i32 }, { <$short>::MAX as i32 }>(value) as Self
                }
            )?
        }
    };
}

/// 1.5 · 2⁵²: the sum of this and a number of at most 32 bits is a whole number, rounded to nearest, whose low bits are
/// that number.
const WHOLE: f64 = 6_755_399_441_055_744.0;

/// The nearest integer of a type of at most 32 bits, halves away from zero, clamped: `f64::round` and `as`, in steps
/// that a compiler takes for many numbers at once.
macro_rules! round_by {
    ($value:expr, $type:ty) => {{
        let value: f64 = $value;
        let (least, most) = (<$type>::MIN as f64, <$type>::MAX as f64);
        // Not a number becomes 0.
        let value = if value == value { value } else { 0.0 };
        let value = if value > least { value } else { least };
        let value = if value < most { value } else { most };
        let whole = value + WHOLE;
        // The sum rounded a half to even.
        let rest = value - (whole - WHOLE);
        let up = if (rest >= 0.5) & (value > 0.0) {
            1.0
        } else {
            0.0
        };
        let down = if (rest <= -0.5) & (value < 0.0) {
            1.0
        } else {
            0.0
        };
        (whole + up - down).to_bits() as $type
    }};
}

sample_type!(u8, U8, f32, true, value => Self::from_real(value), u8);
sample_type!(i8, I8, f32, true, value => Self::from_real(value), i8);
sample_type!(u16, U16, f32, true, value => Self::from_real(value), u16);
sample_type!(i16, I16, f32, true, value => Self::from_real(value), i16);
sample_type!(u32, U32, f64, true, value => round_by!(value, u32));
sample_type!(i32, I32, f64, true, value => round_by!(value, i32));
sample_type!(u64, U64, f64, false, value => value.round() as Self);
sample_type!(i64, I64, f64, false, value => value.round() as Self);
sample_type!(f32, F32, f32, false, value => value as Self);
sample_type!(f64, F64, f64, false, value => value);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_that_of_the_standard_library() {
        let near = [
            0.0,
            0.49999999999999994,
            0.5,
            1.5,
            2.5,
            0.1,
            0.9,
            1e9,
            4503599627370497.5,
        ];
        let odd = [f64::INFINITY, 1e300];
        let steps = (0..4000).map(|n| n as f64 * 0.125);
        for value in near.into_iter().chain(odd).chain(steps) {
            for value in [value, -value] {
                assert_eq!(u8::from_interpolated(value), value.round() as u8, "{value}");
                assert_eq!(
                    i16::from_interpolated(value),
                    value.round() as i16,
                    "{value}"
                );
                assert_eq!(
                    u16::from_interpolated(value),
                    value.round() as u16,
                    "{value}"
                );
                assert_eq!(
                    i32::from_interpolated(value),
                    value.round() as i32,
                    "{value}"
                );
                assert_eq!(
                    u32::from_interpolated(value),
                    value.round() as u32,
                    "{value}"
                );
            }
        }
    }

    #[test]
    fn halves_round_away_from_zero_and_the_range_clamps() {
        assert_eq!(i16::from_interpolated(2.5), 3);
        assert_eq!(i16::from_interpolated(-2.5), -3);
        assert_eq!(i16::from_interpolated(-2.4999), -2);
        assert_eq!(i16::from_interpolated(1e9), i16::MAX);
        assert_eq!(u8::from_interpolated(-1.0), 0);
        assert_eq!(f32::from_interpolated(0.5), 0.5);
    }
}
