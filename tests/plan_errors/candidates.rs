//! Faults of candidates, stages and edits.

use std::fmt::Write as _;

use super::Change::{Remove, Replace, Whole};
use super::{changed, check};

#[test]
fn candidates() {
    check(
        "candidates",
        &[
            ("no candidate", 1, &[Remove("[[candidate]]", "[outputs]")]),
            ("one bracket", 1, &[Replace("[[candidate]]", "[candidate]")]),
            (
                "an empty array of candidates",
                1,
                &[
                    Remove("[[candidate]]", "[outputs]"),
                    Replace("title = ", "candidate = []\ntitle = "),
                ],
            ),
            (
                "candidates that are no tables",
                2,
                &[
                    Remove("[[candidate]]", "[outputs]"),
                    Replace("title = ", "candidate = [1, \"a\"]\ntitle = "),
                ],
            ),
            (
                "a candidate without a stage, and its name again",
                2,
                &[Replace(
                    "[outputs] ",
                    "[[candidate]]\nname = \"smaller\"\n[outputs] ",
                )],
            ),
            (
                "a stage without anything",
                2,
                &[Replace("[outputs] ", "[[candidate.stage]]\n[outputs] ")],
            ),
            (
                "an edit outside its stage",
                1,
                &[Replace(
                    "title = \"Straight and",
                    "width = 2\ntitle = \"Straight and",
                )],
            ),
            (
                "a stage of a reserved name, and one named twice",
                2,
                &[
                    Replace("\"straighten\"", "\"preoperative\""),
                    Replace(
                        "[outputs] ",
                        "[[candidate.stage]]\nname = \"reduce\"\nf1 = [{ width = 1.1 }]\n[outputs] ",
                    ),
                ],
            ),
            (
                "an empty stage",
                1,
                &[Replace("[{ move_tip = { voxels = [20, 0, 0] } }]", "[]")],
            ),
            (
                "an edit without brackets",
                1,
                &[Replace(
                    "[{ move_tip = { voxels = [20, 0, 0] } }]",
                    "{ move_tip = { voxels = [20, 0, 0] } }",
                )],
            ),
            (
                "edits that are no edits",
                4,
                &[Replace(
                    "[{ move_tip = { voxels",
                    "[{}, 3, { widht = 1 }, { project = 1, rotate = 2 }, { move_tip = { voxels",
                )],
            ),
            (
                "values of edits",
                11,
                &[Replace(
                    "[{ move_tip = { voxels = [20, 0, 0] } }]",
                    "[{ move_tip = [20, 0, 0] },\n{ move_tip = { voxel = [20, 0, 0] } },\n{ move_root = { mm = [20, 0] } },\n{ tip_to = { mm = [20, 0, 0] } },\n{ root_to = [1, 2, inf] },\n{ project = nan },\n{ rotate = 180 },\n{ lengthen = \"2 mm\" },\n{ deviate = 99999999999999999999 },\n{ width = 0 },\n{ width = 10.1 }]",
                )],
            ),
            (
                "more edits, stages and candidates than a plan may hold",
                3,
                &[Whole(crowd())],
            ),
        ],
    );
}

#[test]
fn kinds() {
    let first = "f1 = [{ move_tip = { voxels = [20, 0, 0] } }]";
    check(
        "kinds",
        &[
            (
                "unknown kinds",
                2,
                &[
                    Replace("root = [141.0", "kind = \"points\"\nroot = [141.0"),
                    Replace("name = \"reduce\"", "name = \"reduce\"\n  kind = 1"),
                ],
            ),
            (
                "edits of a line in a plan of points",
                3,
                &[
                    Replace("root = [141.0", "kind = \"point\"\nroot = [141.0"),
                    Replace(
                        first,
                        "f1 = [{ deviate = 1 },\n{ move_root = { mm = [0, 1, 0] } },\n{ root_to = [141.0, 70.0, 83.0] }]",
                    ),
                ],
            ),
            (
                "edits of a line in a stage of a point",
                1,
                &[Replace(
                    "name = \"reduce\"",
                    "name = \"reduce\"\n  kind = \"point\"",
                )],
            ),
            (
                "a width that neither the feature nor the model has",
                2,
                &[
                    Replace("name = \"reduce\"", "name = \"reduce\"\n  kind = \"point\""),
                    Replace("model = \"local\"", "model = \"lee2001\""),
                ],
            ),
            (
                "a tip at the root leaves nothing for a next stage",
                1,
                &[
                    Replace(
                        "name = \"straighten\"",
                        "name = \"straighten\"\n  kind = \"point\"",
                    ),
                    Replace(first, "f1 = [{ tip_to = [141.0, 70.0, 84.0] }]"),
                ],
            ),
            (
                "a kind of a candidate",
                1,
                &[Replace(
                    "title = \"Straight and",
                    "kind = \"point\"\ntitle = \"Straight and",
                )],
            ),
        ],
    );
}

/// A plan of one candidate, stage and edit too many.
fn crowd() -> String {
    let mut text = changed(&[
        Remove("[[candidate]]", "[outputs]"),
        Remove("[outputs]", ""),
    ]);
    for candidate in 0..1001 {
        writeln!(text, "[[candidate]]\nname = \"c{candidate}\"").unwrap();
        let stages = if candidate == 7 { 101 } else { 1 };
        for stage in 0..stages {
            let edits = if stage == 50 { 101 } else { 1 };
            let edits = "{ width = 1 },".repeat(edits);
            writeln!(
                text,
                "[[candidate.stage]]\nname = \"s{stage}\"\nf1 = [{edits}]"
            )
            .unwrap();
        }
    }
    text
}

#[test]
fn edits_that_leave_no_nose() {
    let stage = "[{ move_tip = { voxels = [20, 0, 0] } }]";
    check(
        "edits",
        &[
            (
                "the tip leaves the volume",
                1,
                &[Replace(
                    stage,
                    "[{ width = 1.1 }, { deviate = 200 }, { width = 0.9 }]",
                )],
            ),
            (
                "the tip goes behind the base plane",
                1,
                &[Replace(stage, "[{ project = -22.5 }]")],
            ),
            (
                "the second stage goes too far",
                1,
                &[Replace("mm = [0, 8.84, 0]", "mm = [0, 22.5, 0]")],
            ),
            (
                "the root leaves the volume",
                1,
                &[Replace(stage, "[{ move_root = { voxels = [0, 0, 70] } }]")],
            ),
            (
                "the tip comes to the root",
                1,
                &[Replace(
                    stage,
                    "[{ deviate = 1 }, { tip_to = [141.0, 70.0, 84.0] }]",
                )],
            ),
            (
                "the line is shortened to nothing",
                1,
                &[Replace(stage, "[{ lengthen = -1e3 }]")],
            ),
            (
                "the tip is moved past all numbers",
                1,
                &[Replace(
                    stage,
                    "[{ move_tip = { mm = [1e308, 1e308, 0] } }, { lengthen = 1e308 }]",
                )],
            ),
            (
                "widths multiply out of range",
                1,
                &[Replace(
                    stage,
                    "[{ width = 9 }, { width = 8 }, { deviate = 1 }]",
                )],
            ),
            (
                "every candidate is judged",
                2,
                &[
                    Replace(stage, "[{ deviate = 200 }]"),
                    Replace(
                        "[outputs] ",
                        "[[candidate]]\nname = \"d\"\n[[candidate.stage]]\nname = \"s\"\nf1 = [{ deviate = -200 }]\n[outputs] ",
                    ),
                ],
            ),
        ],
    );
}
