//! Files changed at random: the same ones on every machine, as many as are asked for, each within a bound.
//!
//! `RHINOPLAN_FUZZ=20000` gives another count, `RHINOPLAN_FUZZ_SEED=7` other cases, and `RHINOPLAN_FUZZ_CASE=4711`
//! one of them alone.

use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// What one case may take. The requirement is a second; this leaves room for a machine that is busy with
/// something else, and ends a quadratic reader all the same.
pub const AT_ONCE: Duration = Duration::from_secs(5);

/// What a process may have of data (heap, and stacks of threads), KiB: the limit of the requirement. The system
/// refuses more, so that a reader which asks for it fails its test whether it uses it or not.
pub const MEMORY_KIB: u64 = 200 << 10;

/// What the process of the cases is told by.
const WITHIN: &str = "RHINOPLAN_FUZZ_WITHIN";

/// Noise that is the same on every machine (xorshift64*).
pub struct Noise(u64);

#[allow(dead_code, reason = "shared by several test crates")]
impl Noise {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// From 0 to one less than `bound`, which is at least 1.
    pub fn below(&mut self, bound: usize) -> usize {
        (self.next() >> 11) as usize % bound
    }

    /// From -1 to 1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub fn one_of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }
}

/// Damages bytes the way disks and transfers do: a bit, a byte, a cut, a piece lost, doubled or overwritten by a
/// number that lengths are bad at.
#[allow(dead_code, reason = "shared by several test crates")]
pub fn damage(bytes: &mut Vec<u8>, from: usize, noise: &mut Noise) {
    const EXTREMES: [u32; 9] = [
        0,
        1,
        0x7f,
        0xff,
        0xffff,
        0x8000_0000,
        0x7fff_ffff,
        0xffff_fffe,
        0xffff_ffff,
    ];
    if bytes.len() <= from + 8 {
        return;
    }
    let at = from + noise.below(bytes.len() - from - 4);
    let end = (at + noise.below(40)).min(bytes.len());
    match noise.below(8) {
        0 | 1 => bytes[at] ^= 1 << noise.below(8),
        2 => bytes[at] = noise.next() as u8,
        3 => bytes.truncate(at),
        4 => {
            bytes.drain(at..end);
        }
        5 => {
            let piece = bytes[at..end].to_vec();
            let to = from + noise.below(bytes.len() - from);
            bytes.splice(to..to, piece);
        }
        6 => {
            let value = noise.one_of(&EXTREMES).to_le_bytes();
            bytes[at..at + 4].copy_from_slice(&value);
        }
        _ => {
            let value = noise.one_of(&EXTREMES) as u16;
            bytes[at..at + 2].copy_from_slice(&value.to_le_bytes());
        }
    }
}

/// What became of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    Read,
    Refused,
}

fn number(variable: &str) -> Option<u64> {
    let text = std::env::var(variable).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{variable}={text}")))
}

/// How many cases are tried where `usual` are by default.
pub fn count(usual: usize) -> usize {
    number("RHINOPLAN_FUZZ").map_or(usual, |count| usize::try_from(count).unwrap())
}

/// A shell command that runs the rest of its arguments with so much memory.
pub fn limited(memory_kib: u64) -> Command {
    let mut command = Command::new("sh");
    let script = format!("ulimit -d {memory_kib}; exec \"$@\"");
    command.args(["-c", &script, "sh"]);
    command
}

/// Tries as many cases as are asked for, in a process of their own that has little memory: `test` is the name by
/// which that finds the test that calls this. Each case has noise of its own, so that it can be repeated alone; each
/// ends at once, and among them are files that are read and files that are not.
///
/// Returns whether the cases were tried in this process.
pub fn fuzz(
    test: &str,
    format: &str,
    usual: usize,
    case: impl FnMut(usize, &mut Noise) -> Outcome,
) -> bool {
    if std::env::var_os(WITHIN).is_none() {
        let child = limited(MEMORY_KIB)
            .arg(std::env::current_exe().unwrap())
            .args([test, "--exact", "--nocapture", "--test-threads", "1"])
            .env(WITHIN, "1")
            .env("RAYON_NUM_THREADS", "2")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn();
        if let Ok(child) = child {
            let ended = child.wait_with_output().unwrap();
            let said = String::from_utf8_lossy(&ended.stdout);
            assert!(ended.status.success(), "{format}: {}; {said}", ended.status);
            assert!(said.contains("1 passed"), "no test is called {test}");
            return false;
        }
        tell("without a shell, memory is not limited");
    }
    cases(format, usual, case);
    true
}

fn cases(format: &str, usual: usize, mut case: impl FnMut(usize, &mut Noise) -> Outcome) {
    let seed = number("RHINOPLAN_FUZZ_SEED").unwrap_or(2001);
    let alone = number("RHINOPLAN_FUZZ_CASE").map(|case| usize::try_from(case).unwrap());
    let cases = alone.map_or(0..count(usual), |case| case..case + 1);
    let tried = cases.len();
    let (mut read, mut refused, mut slowest) = (0, 0, (Duration::ZERO, 0));
    let begin = Instant::now();
    for index in cases {
        let mut noise = Noise::new(seed.wrapping_mul(0x0100_0000_01b3) ^ (index as u64 + 1));
        // The first numbers of neighbouring seeds are alike.
        noise.next();
        let start = Instant::now();
        let name = || {
            format!("{format}: RHINOPLAN_FUZZ_SEED={seed} RHINOPLAN_FUZZ_CASE={index} repeats this")
        };
        match catch_unwind(AssertUnwindSafe(|| case(index, &mut noise))) {
            Ok(Outcome::Read) => read += 1,
            Ok(Outcome::Refused) => refused += 1,
            Err(panic) => {
                tell(&name());
                resume_unwind(panic);
            }
        }
        let took = start.elapsed();
        assert!(took < AT_ONCE, "{took:?}; {}", name());
        slowest = slowest.max((took, index));
    }
    let memory = peak_memory();
    tell(&format!(
        "{format}: {tried} cases of seed {seed} in {:.1?}: {read} read, {refused} refused; the slowest, {}, took {:.1?}; \
         the process held at most {} MiB",
        begin.elapsed(),
        slowest.1,
        slowest.0,
        memory.map_or("?".to_owned(), |bytes| (bytes >> 20).to_string()),
    ));
    // Damage that is always fatal, or never, would test nothing behind the first check.
    let both = read > tried / 50 && refused > tried / 10;
    assert!(tried < 500 || both, "{read} read, {refused} refused");
}

/// The most memory that this process ever held, where the system tells.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib << 10)
}

/// Past the capture of passing tests, which `println!` would not get.
pub fn tell(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// A message is one that can be read: it says something, in one line, and steers no terminal.
#[allow(dead_code, reason = "shared by several test crates")]
#[track_caller]
pub fn assert_clear(message: &str) {
    assert!(!message.is_empty());
    assert!(message.len() < 1500, "{} bytes", message.len());
    assert!(!message.chars().any(char::is_control), "{message:?}");
}
