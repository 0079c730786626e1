//! Loads from places that were computed, checked once for many of them.

/// For each place, and each of `offsets` added to it, the sample there and the one after it; `None` where one of them is
/// not in `samples`.
#[inline(always)]
pub fn pairs<T: Copy + Default, const N: usize, const K: usize>(
    samples: &[T],
    places: &[u64; N],
    offsets: [usize; K],
) -> Option<[[[T; 2]; N]; K]> {
    let reach = offsets
        .iter()
        .fold(0, |most, &at| if at > most { at } else { most });
    // The last place of which the farthest pair is still there. No slice is as long as 2⁶³.
    let last = samples.len().checked_sub(2)?.checked_sub(reach)? as u64;
    // Above it are the places whose highest bit is set, and, of the rest, those that give it to the difference: a few
    // instructions for all places, where finding the largest takes one after another.
    let mut beyond = 0;
    for &place in places {
        beyond |= place | last.wrapping_sub(place);
    }
    if beyond >> 63 != 0 {
        return None;
    }
    let mut found = [[[T::default(); 2]; N]; K];
    for lane in 0..N {
        for row in 0..K {
            let first = samples
                .as_ptr()
                .wrapping_add(places[lane] as usize + offsets[row]);
            // SAFETY: `place` is at most `last` and `offset` at most `reach`, so this sample and the next are within
            // `samples`. Two samples have the layout of an array of two, which is read wherever it lies.
            found[row][lane] = unsafe { first.cast::<[T; 2]>().read_unaligned() };
        }
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_and_the_next() {
        let samples: Vec<i16> = (0..100).collect();
        let found = pairs(&samples, &[0, 7, 41], [0, 10, 57]).unwrap();
        assert_eq!(found[0], [[0, 1], [7, 8], [41, 42]]);
        assert_eq!(found[1], [[10, 11], [17, 18], [51, 52]]);
        assert_eq!(found[2], [[57, 58], [64, 65], [98, 99]]);
    }

    #[test]
    fn what_reaches_beyond_the_end_is_refused() {
        let samples = [0.0_f32; 100];
        assert!(pairs(&samples, &[98], [0]).is_some());
        assert!(pairs(&samples, &[99], [0]).is_none());
        assert!(pairs(&samples, &[90], [0, 9]).is_none());
        assert!(pairs(&samples, &[u64::MAX], [0]).is_none());
        assert!(pairs(&samples, &[u64::MAX - 1], [usize::MAX]).is_none());
        assert!(pairs::<f32, 1, 1>(&[], &[0], [0]).is_none());
    }
}
