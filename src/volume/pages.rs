//! Room for long lists, in pages as large as the machine has them.

use std::collections::TryReserveError;

/// An empty list with room for exactly `len` elements.
///
/// A page is handed out when it is first touched, which takes longer than filling it: a list of a volume's size is
/// thousands of pages of 4 KiB, but a few of 2 MiB. Linux gives those where it is asked to (transparent huge pages,
/// `madvise(2)`); where it has none, or another system runs, pages are of the usual size.
///
/// # Errors
/// Where the machine has no memory for it.
pub fn room<T>(len: usize) -> Result<Vec<T>, TryReserveError> {
    let mut list = Vec::new();
    list.try_reserve_exact(len)?;
    #[cfg(target_os = "linux")]
    linux::ask_for_huge_pages(&mut list);
    Ok(list)
}

#[cfg(target_os = "linux")]
mod linux {
    // Beside `simd/`, the only `unsafe` code.
    #![allow(
        unsafe_code,
        reason = "advice to the system on memory that a list holds"
    )]

    use rustix::mm::{Advice, madvise};

    /// On x86-64, and on most others with pages of 4 KiB. Where huge pages are larger, advice on a part of one is of no use,
    /// and does no harm.
    const HUGE_PAGE: usize = 2 << 20;

    /// Of the huge pages that lie within the room of an empty list.
    pub(super) fn ask_for_huge_pages<T>(list: &mut Vec<T>) {
        let room = list.spare_capacity_mut();
        let bytes = size_of_val(room);
        let begin: *mut u8 = room.as_mut_ptr().cast();
        let before = begin.align_offset(HUGE_PAGE);
        let Some(inside) = bytes.checked_sub(before) else {
            return;
        };
        let whole = inside - inside % HUGE_PAGE;
        if whole == 0 {
            return;
        }
        // SAFETY: the range is within one allocation, which `list` holds alone. This advice changes what pages the
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_room_for_as_many_as_asked_for() {
        for len in [0, 1, 1000, (5 << 20) + 3] {
            let mut list = room::<u16>(len).unwrap();
            assert!(list.is_empty() && list.capacity() >= len);
            let first = list.as_ptr();
            list.extend((0..len).map(|at| at as u16));
            assert!(
                list.capacity() == 0 || list.as_ptr() == first,
                "{len} did not fit"
            );
            assert!(
                list.iter()
                    .enumerate()
                    .all(|(at, value)| *value == at as u16)
            );
        }
    }

    #[test]
    fn more_than_there_can_be_is_an_error() {
        assert!(room::<u64>(usize::MAX / 4).is_err());
    }
}
