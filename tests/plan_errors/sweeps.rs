//! Faults of sweeps.

use super::Change::Replace;
use super::{changed, check};

/// A sweep of the example's second stage, with these keys in place of a number to vary.
fn sweep(vary: &str) -> String {
    with(&format!("candidate = \"smaller\"\n[[sweep.vary]]\n{vary}"))
}

fn with(sweep: &str) -> String {
    changed(&[Replace("[outputs] ", "@@")])
        .replace("@@", &format!("[[sweep]]\n{sweep}\n[outputs] "))
}

#[test]
fn sweeps() {
    let of = |text: String| [super::Change::Whole(text)];
    let move_tip = "stage = \"reduce\"\nedit = \"move_tip\"\naxis = \"y\"\n";
    check(
        "sweeps",
        &[
            ("no candidate, nothing varied", 2, &of(with("name = \"s\""))),
            (
                "a candidate that is not there",
                1,
                &of(with(
                    "candidate = \"small\"\nvary = [{ stage = \"reduce\", edit = \"project\", values = [1] }]",
                )),
            ),
            ("nothing varied", 1, &of(with("candidate = \"smaller\""))),
            (
                "an empty list of what is varied",
                1,
                &of(with("candidate = \"smaller\"\nvary = []")),
            ),
            ("no stage", 3, &of(sweep("edit = \"move_tip\""))),
            (
                "a stage that is not there",
                1,
                &of(sweep(
                    "stage = \"rotate\"\nedit = \"project\"\nvalues = [1]",
                )),
            ),
            (
                "an edit that the stage has not",
                1,
                &of(sweep("stage = \"reduce\"\nedit = \"rotate\"\nvalues = [1]")),
            ),
            (
                "a point is not varied",
                1,
                &of(sweep("stage = \"reduce\"\nedit = \"tip_to\"\nvalues = [1]")),
            ),
            (
                "no axis",
                1,
                &of(sweep(
                    "stage = \"reduce\"\nedit = \"move_tip\"\nvalues = [1]",
                )),
            ),
            ("no values", 1, &of(sweep(move_tip))),
            (
                "half a range",
                1,
                &of(sweep(&format!("{move_tip}from = 1\nsteps = 3"))),
            ),
            (
                "values and a range",
                1,
                &of(sweep(&format!("{move_tip}values = [1, 2]\nto = 3"))),
            ),
            (
                "a range of one step",
                1,
                &of(sweep(&format!("{move_tip}from = 1\nto = 3\nsteps = 1"))),
            ),
            (
                "a range of no length",
                1,
                &of(sweep(&format!("{move_tip}from = 3\nto = 3\nsteps = 4"))),
            ),
            (
                "a value twice",
                1,
                &of(sweep(&format!("{move_tip}values = [1, 2, 1.0]"))),
            ),
            (
                "a value that is none",
                1,
                &of(sweep(&format!("{move_tip}values = [1, nan]"))),
            ),
            (
                "too many",
                1,
                &of(sweep(&format!(
                    "{move_tip}from = 0\nto = 1\nsteps = 100\n[[sweep.vary]]\nstage = \"straighten\"\nedit = \"move_tip\"\naxis = \"x\"\nfrom = 0\nto = 1\nsteps = 100"
                ))),
            ),
            (
                "a number varied twice",
                1,
                &of(sweep(&format!(
                    "{move_tip}values = [1]\n[[sweep.vary]]\n{move_tip}values = [2]"
                ))),
            ),
            (
                "two sweeps of the same names",
                1,
                &of(sweep(&format!(
                    "{move_tip}values = [1, 2]\n[[sweep]]\ncandidate = \"smaller\"\n[[sweep.vary]]\n{move_tip}values = [2, 3]"
                ))),
            ),
            (
                "names that are too long",
                1,
                &of(with(&format!(
                    "candidate = \"smaller\"\nname = \"{}\"\n[[sweep.vary]]\n{move_tip}values = [1.25]",
                    "s".repeat(60)
                ))),
            ),
            (
                "a value that leaves no usable nose",
                1,
                &of(sweep(&format!("{move_tip}values = [20, 2000]"))),
            ),
        ],
    );
}
