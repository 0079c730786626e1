//! Rounding as `f64::round` and `as` do it, in a few instructions for many numbers at once.

use super::real::{Real, larger, smaller};

/// A number that can be rounded.
pub trait Round: Copy {
    /// The same number, half away from zero, but for the least bit: ½ itself would make the largest number below ½ 1.
    fn nearly_half_further(self) -> Self;

    /// The number without its fraction.
    ///
    /// # Safety
    /// That has to be an `i32`.
    unsafe fn truncated(self) -> i32;
}

macro_rules! round {
    ($float:ty) => {
        impl Round for $float {
            #[inline(always)]
            fn nearly_half_further(self) -> Self {
                const NEARLY_HALF: $float = (0.5 as $float).next_down();
                self + NEARLY_HALF.copysign(self)
            }

            #[inline(always)]
            unsafe fn truncated(self) -> i32 {
                // SAFETY: what the caller has to see to.
                unsafe { self.to_int_unchecked::<i32>() }
            }
        }
    };
}

round!(f32);
round!(f64);

/// The nearest whole number, halves away from zero, of a value that is first clamped to LEAST..=MOST. Not a number
/// gives LEAST. In single precision both have at most 22 bits.
#[inline(always)]
pub fn round_within<F: Real, const LEAST: i32, const MOST: i32>(value: F) -> i32 {
    const { assert!(LEAST <= MOST) };
    const { assert!(size_of::<F>() == 8 || (LEAST >= -(1 << 22) && MOST <= 1 << 22)) };
    let (least, most) = (F::of(f64::from(LEAST)), F::of(f64::from(MOST)));
    // Comparisons that NaN fails: one instruction each, unlike `f64::max`.
    let value = smaller(larger(value, least), most);
    // SAFETY: a number, and no further than ½ beyond two of type `i32`, so that without its fraction it is one.
    unsafe { value.nearly_half_further().truncated() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_that_of_the_standard_library() {
        let mut values = vec![f64::INFINITY, 1e300, 1e9, 32766.5, 32767.5, 0.0, 5e-324];
        for half in (0..70_000).map(|n| f64::from(n) * 0.5) {
            values.extend([half, half.next_up(), half.next_down(), half + 0.25]);
        }
        for value in values.into_iter().flat_map(|value| [value, -value]) {
            let (short, byte) = (value.round() as i16, value.round() as u8);
            assert_eq!(
                round_within::<f64, -32768, 32767>(value),
                i32::from(short),
                "{value:e}"
            );
            assert_eq!(
                round_within::<f64, 0, 255>(value),
                i32::from(byte),
                "{value:e}"
            );
        }
        for half in (-140_000..140_000).map(|n| n as f32 * 0.25) {
            for value in [half, half.next_up(), half.next_down()] {
                let found = round_within::<f32, -32768, 32767>(value);
                assert_eq!(found, i32::from(value.round() as i16), "{value:e}");
            }
        }
        assert_eq!(round_within::<f32, -3, 7>(f32::NAN), -3);
        assert_eq!(round_within::<f64, -3, 7>(f64::NAN), -3);
        let all = round_within::<f64, { i32::MIN }, { i32::MAX }>;
        assert_eq!([all(f64::INFINITY), all(-1e300)], [i32::MAX, i32::MIN]);
        assert_eq!(
            [all(2_147_483_646.5), all(-2_147_483_647.5)],
            [i32::MAX, i32::MIN]
        );
    }
}
