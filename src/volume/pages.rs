//! Memory for long lists, in pages as large as the machine has them.
//!
//! A page is handed out when it is first touched, which takes longer than filling it: a list of a volume's size is
//! thousands of pages of 4 KiB, but a few of 2 MiB. Linux gives those where it is asked to (transparent huge pages,
//! `madvise(2)`); where it has none, or another system runs, pages are of the usual size.

use std::collections::TryReserveError;

use bytemuck::Zeroable;
use bytemuck::allocation::try_zeroed_vec;

/// An empty list with room for exactly `len` elements.
///
/// # Errors
/// Where the machine has no memory for it.
pub fn room<T>(len: usize) -> Result<Vec<T>, TryReserveError> {
    let mut list = Vec::new();
    list.try_reserve_exact(len)?;
    ask_for_huge_pages(list.spare_capacity_mut());
    Ok(list)
}

/// A list of `len` zeros, the pages of which are touched only where it is written to; none where the machine has no memory
/// for it.
pub fn untouched_zeros<T: Zeroable>(len: usize) -> Option<Vec<T>> {
    let mut list = try_zeroed_vec(len).ok()?;
    ask_for_huge_pages(&mut list);
    Some(list)
}

#[cfg(target_os = "linux")]
#[allow(
    unsafe_code,
    reason = "advice to the system on memory that the caller holds"
)]
fn ask_for_huge_pages<T>(memory: &mut [T]) {
    use rustix::mm::{Advice, madvise};

    // On x86-64, and on most others with pages of 4 KiB. Where huge pages are larger, advice on a part of one is of no
    // use, and does no harm.
    const HUGE_PAGE: usize = 2 << 20;

    let bytes = size_of_val(memory);
    let begin: *mut u8 = memory.as_mut_ptr().cast();
    // The huge pages that lie within it.
    let before = begin.align_offset(HUGE_PAGE);
    let inside = bytes.saturating_sub(before);
    let whole = inside - inside % HUGE_PAGE;
    if whole > 0 {
        // SAFETY: the range is within one allocation, which `memory` borrows alone. This advice changes what pages the
        // system backs it with, never what is read from it or whether it may be accessed.
        let _ = unsafe {
            madvise(
                begin.wrapping_add(before).cast(),
                whole,
                Advice::LinuxHugepage,
            )
        };
    }
}

#[cfg(not(target_os = "linux"))]
fn ask_for_huge_pages<T>(_: &mut [T]) {}

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTHS: [usize; 4] = [0, 1, 1000, (5 << 20) + 3];

    #[test]
    fn there_is_room_for_as_many_as_asked_for() {
        for len in LENGTHS {
            let mut list = room::<u16>(len).unwrap();
            assert!(list.is_empty() && list.capacity() >= len);
            let first = list.as_ptr();
            list.extend((0..len).map(|at| at as u16));
            assert!(list.as_ptr() == first, "{len} did not fit");
            let mut all = list.iter().enumerate();
            assert!(all.all(|(at, value)| *value == at as u16));
        }
    }

    #[test]
    fn zeros_are_zero_and_can_be_written() {
        for len in LENGTHS {
            let mut list = untouched_zeros::<i16>(len).unwrap();
            assert!(list.len() == len && list.iter().all(|&value| value == 0));
            list.fill(-7);
            assert!(list.iter().all(|&value| value == -7));
        }
    }

    #[test]
    fn more_than_there_can_be_is_an_error() {
        assert!(room::<u64>(usize::MAX / 4).is_err());
        assert!(untouched_zeros::<u64>(usize::MAX / 4).is_none());
    }
}
