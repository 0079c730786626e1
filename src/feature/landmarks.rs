//! The six landmarks of the paper's Fig. 6.

use std::fmt;

use serde::{Deserialize, Serialize};

/// One of the six landmarks, in the paper's numbering.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Landmark {
    /// 1: the nasal bones at the top of the nose (P1, near the nasion).
    NasalBones,
    /// 2: the white line of the lip (P2).
    Lip,
    /// 3: the left alare, on the patient's left (larger x).
    AlareLeft,
    /// 4: the right alare, on the patient's right (smaller x).
    AlareRight,
    /// 5: the tip of the nose (P5, the pronasale).
    Tip,
    /// 6: the maxilla point, which places the base plane.
    Maxilla,
}

impl Landmark {
    /// All six, in the order in which plans write them.
    pub const ALL: [Self; 6] = [
        Self::NasalBones,
        Self::Lip,
        Self::AlareRight,
        Self::AlareLeft,
        Self::Tip,
        Self::Maxilla,
    ];

    /// The name that plans and landmark files use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NasalBones => "nasal_bones",
            Self::Lip => "lip",
            Self::AlareLeft => "alare_left",
            Self::AlareRight => "alare_right",
            Self::Tip => "tip",
            Self::Maxilla => "maxilla",
        }
    }
}

impl fmt::Display for Landmark {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(self.name())
    }
}

/// A value for each landmark: positions in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "named after the landmarks")]
pub struct Landmarks<P> {
    pub nasal_bones: P,
    pub lip: P,
    pub alare_right: P,
    pub alare_left: P,
    pub tip: P,
    pub maxilla: P,
}

impl<P> Landmarks<P> {
    /// The value of one landmark.
    pub fn get(&self, landmark: Landmark) -> &P {
        match landmark {
            Landmark::NasalBones => &self.nasal_bones,
            Landmark::Lip => &self.lip,
            Landmark::AlareLeft => &self.alare_left,
            Landmark::AlareRight => &self.alare_right,
            Landmark::Tip => &self.tip,
            Landmark::Maxilla => &self.maxilla,
        }
    }

    /// The place of one landmark's value.
    pub fn get_mut(&mut self, landmark: Landmark) -> &mut P {
        match landmark {
            Landmark::NasalBones => &mut self.nasal_bones,
            Landmark::Lip => &mut self.lip,
            Landmark::AlareLeft => &mut self.alare_left,
            Landmark::AlareRight => &mut self.alare_right,
            Landmark::Tip => &mut self.tip,
            Landmark::Maxilla => &mut self.maxilla,
        }
    }

    /// The landmarks in another frame.
    pub fn map<Q>(self, mut convert: impl FnMut(P) -> Q) -> Landmarks<Q> {
        Landmarks {
            nasal_bones: convert(self.nasal_bones),
            lip: convert(self.lip),
            alare_right: convert(self.alare_right),
            alare_left: convert(self.alare_left),
            tip: convert(self.tip),
            maxilla: convert(self.maxilla),
        }
    }
}

impl<P> Landmarks<Option<P>> {
    /// No landmark yet.
    pub const fn none() -> Self {
        Self {
            nasal_bones: None,
            lip: None,
            alare_right: None,
            alare_left: None,
            tip: None,
            maxilla: None,
        }
    }
}
