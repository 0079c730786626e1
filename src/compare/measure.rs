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

const COUNT: usize = REGIONS + 12;

/// Every measure, in the order of `measurements.csv`.
pub const MEASURES: [Measure; COUNT] = measures();

/// The measure of a name.
pub fn measure(name: &str) -> Option<&'static Measure> {
    MEASURES.iter().find(|measure| measure.name == name)
}

const fn sized(name: &'static str, unit: &'static str) -> Measure {
    Measure {
        name,
        unit,
        bare: BareNumber::Nothing,
        has_percent: true,
    }
}

const fn placed(name: &'static str) -> Measure {
    Measure {
        name,
        unit: "voxel",
        bare: BareNumber::Nothing,
        has_percent: false,
    }
}

const fn extreme(name: &'static str, unit: &'static str, bare: BareNumber) -> Measure {
    Measure {
        name,
        unit,
        bare,
        has_percent: false,
    }
}

const fn measures() -> [Measure; COUNT] {
    let mut all = [sized("volume_total", "mm3"); COUNT];
    let mut place = 0;
    while place < REGIONS {
        all[place] = sized(VOLUMES[place], "mm3");
        place += 1;
    }
    let others = [
        sized("volume_total", "mm3"),
        sized("gamma", "deg"),
        sized("height", "mm"),
        placed("tip_x"),
        placed("tip_y"),
        placed("tip_z"),
        placed("move_x"),
        placed("move_y"),
        placed("move_z"),
        extreme("jacobian_min", "1", BareNumber::Least),
        extreme("displacement_max", "mm", BareNumber::Most),
        extreme("displacement_max_outside", "mm", BareNumber::Most),
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
