//! What can be compared and limited: the measures of a stage, by their names in `measurements.csv`.

use crate::measure::REGIONS;

/// What a number that stands alone limits in a plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BareNumber {
    /// The least that is allowed: of a measure that is itself the smallest of something.
    Least,
    /// The most that is allowed: of a measure that is itself the largest of something.
    Most,
    /// Nothing: which of the two is meant cannot be told.
    Nothing,
}

/// A measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Measure {
    /// Its name in `measurements.csv`.
    pub name: &'static str,
    /// Its unit there.
    pub unit: &'static str,
    /// What it is, with its unit, in a sentence.
    pub about: &'static str,
    /// What a number that stands alone limits.
    pub bare: BareNumber,
    /// Whether a change of it in percent means something: it has a zero that is nothing, and before the
    /// first stage it is something. A position has no such zero, and a movement is 0 at the start.
    pub has_percent: bool,
}

const VOLUMES: [&str; REGIONS] = [
    "volume_A", "volume_B", "volume_C", "volume_D", "volume_E", "volume_F", "volume_G", "volume_H",
    "volume_I", "volume_J", "volume_K",
];

/// How many measures there are.
pub(crate) const COUNT: usize = REGIONS + 12;

/// Every measure, in the order of `measurements.csv`.
pub const MEASURES: [Measure; COUNT] = measures();

/// The measure of a name.
pub fn measure(name: &str) -> Option<&'static Measure> {
    MEASURES.iter().find(|measure| measure.name == name)
}

const fn sized(name: &'static str, unit: &'static str, about: &'static str) -> Measure {
    Measure {
        name,
        unit,
        about,
        bare: BareNumber::Nothing,
        has_percent: true,
    }
}

const fn placed(name: &'static str, about: &'static str) -> Measure {
    Measure {
        name,
        unit: "voxel",
        about,
        bare: BareNumber::Nothing,
        has_percent: false,
    }
}

const fn extreme(
    name: &'static str,
    unit: &'static str,
    bare: BareNumber,
    about: &'static str,
) -> Measure {
    Measure {
        name,
        unit,
        about,
        bare,
        has_percent: false,
    }
}

const TOTAL: Measure = sized("volume_total", "mm3", "Tissue of all regions, mm3.");

const fn measures() -> [Measure; COUNT] {
    let mut all = [TOTAL; COUNT];
    let mut place = 0;
    while place < REGIONS {
        all[place] = sized(VOLUMES[place], "mm3", "Tissue of the region, mm3.");
        place += 1;
    }
    let others = [
        TOTAL,
        sized("gamma", "deg", "The angle at the tip, degrees."),
        sized("height", "mm", "From the tip to the base plane, mm."),
        placed("tip_x", "Where the tip is, voxels, to the left."),
        placed("tip_y", "Where the tip is, voxels, to the back."),
        placed("tip_z", "Where the tip is, voxels, upwards."),
        placed(
            "move_x",
            "How far the last stage moved the tip, voxels, to the left.",
        ),
        placed(
            "move_y",
            "How far the last stage moved the tip, voxels, to the back.",
        ),
        placed(
            "move_z",
            "How far the last stage moved the tip, voxels, upwards.",
        ),
        extreme(
            "jacobian_min",
            "1",
            BareNumber::Least,
            "The smallest Jacobian determinant of the map since the nose as it is.",
        ),
        extreme(
            "displacement_max",
            "mm",
            BareNumber::Most,
            "The largest displacement since the nose as it is, mm.",
        ),
        extreme(
            "displacement_max_outside",
            "mm",
            BareNumber::Most,
            "The largest displacement outside the nose's box, mm.",
        ),
    ];
    while place < COUNT {
        all[place] = others[place - REGIONS];
        place += 1;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::REGION_NAMES;

    #[test]
    fn every_region_has_its_volume_and_no_name_is_there_twice() {
        for (name, region) in VOLUMES.iter().zip(REGION_NAMES) {
            assert_eq!(*name, format!("volume_{region}"));
        }
        for (place, one) in MEASURES.iter().enumerate() {
            assert_eq!(measure(one.name), Some(&MEASURES[place]));
        }
        assert_eq!(measure("volume_L"), None);
    }
}
