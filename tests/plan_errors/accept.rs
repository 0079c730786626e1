//! Faults of the limits that a plan sets.

use super::Change::Replace;
use super::check;

/// Put in front of what the plan ends with.
const OUTPUTS: &str = "[outputs]";

#[test]
fn accept() {
    check(
        "accept",
        &[
            ("no limit", 1, &[Replace(OUTPUTS, "[accept]\n[outputs]\n")]),
            (
                "a measure that is none, and one with a slip",
                2,
                &[Replace(
                    OUTPUTS,
                    "[accept]\nbeauty = 1\nvolume_totl = [1, 2]\n[outputs]\n",
                )],
            ),
            (
                "a number that may be the least or the most",
                1,
                &[Replace(OUTPUTS, "[accept]\nheight = 20\n[outputs]\n")],
            ),
            (
                "words, three numbers, and an end below the beginning",
                4,
                &[Replace(
                    OUTPUTS,
                    "[accept]\ngamma = \"70\"\nheight = [1, 2, 3]\nvolume_A = [2, 1]\n\
                     jacobian_min = \"0.2\"\n[outputs]\n",
                )],
            ),
            (
                "tables of nothing, of other keys, and that allow nothing",
                4,
                &[Replace(
                    OUTPUTS,
                    "[accept]\ngamma = {}\nheight = { least = 1 }\nvolume_A = { min = 2, max = 1 }\n\
                     volume_B = { change = [1, -1] }\n[outputs]\n",
                )],
            ),
            (
                "ends that are no numbers",
                3,
                &[Replace(
                    OUTPUTS,
                    "[accept]\ngamma = [nan, 1]\nheight = { max = inf }\nvolume_A = { change_percent = -5 }\n\
                     [outputs]\n",
                )],
            ),
            (
                "percent of a position and of a movement",
                2,
                &[Replace(
                    OUTPUTS,
                    "[accept]\ntip_x = { change_percent = [0, 1] }\n\
                     displacement_max = { change_percent = [0, 1], max = 5 }\n[outputs]\n",
                )],
            ),
            (
                "a limit in another table",
                1,
                &[Replace("[cage]", "[cage]\ngamma = [70, 110]\n")],
            ),
            (
                "[accept] is a number",
                1,
                &[Replace("plan = 1", "plan = 1\naccept = 0.2")],
            ),
        ],
    );
}
