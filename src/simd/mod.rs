//! The vector instructions of the processor, chosen when the program runs.
//!
//! A [`Kernel`] is a hot loop, written once and in plain Rust. It is compiled several times: for what every x86-64
//! processor has, and for AVX2 and AVX-512, with which the compiler treats four and eight numbers at once instead of two.
//! [`Simd::run`] runs the copy for the widest instructions that there are.
//!
//! All copies give the same bits: they differ in how many numbers are treated at once, not in what is done to each. The
//! compiler neither reorders sums of floats nor fuses a multiplication with an addition, unless it is told to. What
//! could differ is the sign of a zero from `f64::max` and `f64::min`; kernels compare instead.
//!
//! The environment variable `RHINOPLAN_SIMD` chooses fewer instructions: `off`, `avx2`, `avx512`.

// The only module with `unsafe` code, but for one call in `volume/pages.rs`. Each block says why it is sound.
#![allow(
    unsafe_code,
    reason = "instructions that not every processor has are not safe to call; loads that are checked once for many; conversions of what was clamped"
)]

mod load;
mod real;
mod round;

use std::env;
use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use crate::text::shown;
pub use load::pairs;
pub use real::{Real, Vector, larger, size, smaller};
pub use round::round_within;

/// Which of all instructions are tried, counted from 1; 0 where none are.
static TRIED: AtomicUsize = AtomicUsize::new(0);

/// Names the instructions that may be used at most.
pub const VARIABLE: &str = "RHINOPLAN_SIMD";

/// A loop that is worth compiling for several instruction sets.
///
/// `run` and what it calls have to be `#[inline(always)]`, or small enough to be inlined: what is not is compiled once,
/// for every processor.
pub trait Kernel {
    /// What comes out.
    type Output;

    /// Runs the loop.
    fn run(self) -> Self::Output;
}

/// Which instructions are used. There is no value of this type for instructions that the processor lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Simd(Level);

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    /// What every x86-64 processor has, or every processor of another kind.
    Off,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Simd {
    /// Without instructions that only some processors have.
    pub const OFF: Self = Self(Level::Off);

    /// Looks at `RHINOPLAN_SIMD`, whose value may be missing or empty.
    ///
    /// # Errors
    /// What is wrong with it, and what it can be. [`Simd::widest`] takes such a value for none.
    pub fn check_variable() -> Result<(), String> {
        let value = env::var_os(VARIABLE).unwrap_or_default();
        match value.to_str() {
            Some("" | "off" | "avx2" | "avx512") => Ok(()),
            _ => Err(format!(
                "{VARIABLE} is `{}`; it can be `off`, `avx2` or `avx512`, or not be set",
                shown(&value.to_string_lossy(), 20)
            )),
        }
    }

    /// What is used: the widest that the processor has, or what `RHINOPLAN_SIMD` allows of it, or what
    /// [`Simd::compare`] is trying.
    pub fn widest() -> Self {
        static WIDEST: OnceLock<Simd> = OnceLock::new();
        let tried = TRIED.load(Ordering::Relaxed);
        if tried > 0 {
            return Self::all_once()
                .get(tried - 1)
                .copied()
                .unwrap_or(Self::OFF);
        }
        *WIDEST.get_or_init(|| {
            let most = env::var(VARIABLE).unwrap_or_default();
            let allowed = |simd: &&Self| match most.as_str() {
                "off" => simd.0 == Level::Off,
                "avx2" => simd.narrow() == **simd,
                _ => true,
            };
            let widest = Self::all_once().iter().rev().find(allowed);
            widest.copied().unwrap_or(Self::OFF)
        })
    }

    /// What `work` gives with all instructions that the processor has, one after the other, [`Simd::OFF`] first: all the
    /// same. For tests and benchmarks: meanwhile everything in this process uses them.
    pub fn compare<R>(mut work: impl FnMut(Self) -> R) -> Vec<(Self, R)> {
        static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
        /// Also where `work` panics.
        struct Reset;
        impl Drop for Reset {
            fn drop(&mut self) {
                TRIED.store(0, Ordering::Relaxed);
            }
        }
        let _one = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let _reset = Reset;
        let all = Self::all_once().iter().enumerate();
        all.map(|(place, &simd)| {
            TRIED.store(place + 1, Ordering::Relaxed);
            (simd, work(simd))
        })
        .collect()
    }

    fn all_once() -> &'static [Self] {
        static ALL: OnceLock<Vec<Simd>> = OnceLock::new();
        ALL.get_or_init(Self::all)
    }

    /// All that the processor has, [`Simd::OFF`] first, the widest last.
    pub fn all() -> Vec<Self> {
        #[allow(unused_mut, reason = "other processors have the one")]
        let mut all = vec![Self::OFF];
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("popcnt");
            if avx2 {
                all.push(Self(Level::Avx2));
            }
            if avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                all.push(Self(Level::Avx512));
            }
        }
        all
    }

    /// These, but none wider than AVX2: for loops that mostly wait for memory, or take apart what they load, which wider
    /// vectors do not speed up.
    #[must_use]
    pub fn narrow(self) -> Self {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            // Whoever has AVX-512 has AVX2: `Simd::all` asks for both.
            Level::Avx512 => Self(Level::Avx2),
            _ => self,
        }
    }

    /// Runs a kernel with these instructions.
    #[inline]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self.0 {
            Level::Off => kernel.run(),
            // SAFETY: `Simd::all` alone makes this value, where the processor has the instructions that `avx2` is
            // compiled for; nothing else is asked of its caller.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe { avx2(kernel) },
            // SAFETY: as above, for `avx512`.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe { avx512(kernel) },
        }
    }
}

impl fmt::Display for Simd {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self.0 {
            Level::Off => "off",
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => "avx512",
        })
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,popcnt")]
fn avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,popcnt,avx512f,avx512bw,avx512dq,avx512vl")]
fn avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f64]);

    impl Kernel for Sum<'_> {
        type Output = f64;

        #[inline(always)]
        fn run(self) -> f64 {
            self.0.iter().map(|value| value.sqrt()).sum()
        }
    }

    #[test]
    fn a_kernel_gives_the_same_bits_whatever_is_used() {
        let values: Vec<f64> = (0..1000).map(|n| f64::from(n) * 0.37).collect();
        let found = Simd::compare(|simd| {
            assert_eq!(Simd::widest(), simd);
            (simd.run(Sum(&values)), simd.narrow().run(Sum(&values)))
        });
        assert_eq!(found[0].0, Simd::OFF);
        for (simd, sums) in &found {
            assert_eq!(sums, &found[0].1, "{simd}");
        }
    }

    #[test]
    fn narrow_is_never_wider() {
        for simd in Simd::all() {
            assert_ne!(simd.narrow().to_string(), "avx512");
            assert_eq!(simd.narrow() == Simd::OFF, simd == Simd::OFF);
        }
    }
}
