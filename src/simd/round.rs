//! Rounding as `f64::round` and `as` do it, in a few instructions for many numbers at once.

/// The largest number below ½. What is added to a number before its fraction is cut off: with ½ itself, this number
/// would become 1.
const NEARLY_HALF: f64 = 0.5_f64.next_down();

/// The nearest whole number, halves away from zero, of a value that is first clamped to LEAST..=MOST. Not a number
/// gives LEAST.
#[inline(always)]
pub fn round_within<const LEAST: i32, const MOST: i32>(value: f64) -> i32 {
    const { assert!(LEAST <= MOST) };
    let (least, most) = (f64::from(LEAST), f64::from(MOST));
    // Comparisons that NaN fails: one instruction each, unlike `f64::max`.
    let value = if value > least { value } else { least };
    let value = if value < most { value } else { most };
    let further = value + NEARLY_HALF.copysign(value);
    // SAFETY: a number, and no further than ½ beyond two of type `i32`, so that without its fraction it is one.
    unsafe { further.to_int_unchecked::<i32>() }
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
                round_within::<-32768, 32767>(value),
                i32::from(short),
                "{value:e}"
            );
            assert_eq!(round_within::<0, 255>(value), i32::from(byte), "{value:e}");
        }
        assert_eq!(round_within::<-3, 7>(f64::NAN), -3);
        let all = round_within::<{ i32::MIN }, { i32::MAX }>;
        assert_eq!([all(f64::INFINITY), all(-1e300)], [i32::MAX, i32::MIN]);
        assert_eq!(
            [all(2_147_483_646.5), all(-2_147_483_647.5)],
            [i32::MAX, i32::MIN]
        );
    }
}
