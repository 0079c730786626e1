//! Memory of volumes that are not needed any more, for those to come.

use std::any::Any;
use std::fmt;
use std::sync::{Mutex, PoisonError};

use super::Sample;

/// Lists of samples of no further use. Their pages have been touched, which for a list of a volume's size takes as
/// long as filling it does several times over: so the next volume of the same type and size is made in one of them.
#[derive(Default)]
pub struct Spares(Mutex<Vec<Box<dyn Any + Send>>>);

impl Spares {
    /// Keeps a list for later.
    pub fn give<T: Sample>(&self, samples: Vec<T>) {
        self.lists().push(Box::new(samples));
    }

    /// A list of `len` samples, whatever they are; none where there is none that is as long, or not much longer.
    pub fn take<T: Sample>(&self, len: usize) -> Option<Vec<T>> {
        let mut lists = self.lists();
        let most = len.saturating_add(len / 8).saturating_add(4096);
        let place = lists.iter().position(|list| {
            let list = list.downcast_ref::<Vec<T>>();
            list.is_some_and(|list| (len..=most).contains(&list.len()))
        })?;
        let mut samples = *lists.swap_remove(place).downcast::<Vec<T>>().ok()?;
        samples.truncate(len);
        Some(samples)
    }

    fn lists(&self) -> std::sync::MutexGuard<'_, Vec<Box<dyn Any + Send>>> {
        // A panic elsewhere leaves the lists whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for Spares {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "Spares({})", self.lists().len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_is_taken_once_by_type_and_size() {
        let spares = Spares::default();
        spares.give(vec![7_i16; 100_010]);
        let memory = |samples: &Vec<i16>| samples.as_ptr();
        assert!(spares.take::<u16>(100_000).is_none(), "another type");
        assert!(spares.take::<i16>(100_011).is_none(), "too short");
        assert!(spares.take::<i16>(10_000).is_none(), "far too long");
        spares.give(vec![8_i16; 100]);
        let taken = spares.take::<i16>(100_000).unwrap();
        assert_eq!((taken.len(), taken[0]), (100_000, 7));
        assert!(spares.take::<i16>(100_000).is_none(), "taken already");
        let was = memory(&taken);
        spares.give(taken);
        assert_eq!(
            spares.take::<i16>(100_000).map(|again| memory(&again)),
            Some(was)
        );
    }
}
