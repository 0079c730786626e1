//! What a run tells while it works.

use serde::Serialize;

/// A kind of work. The names are those of `timings.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Reading or making the CT.
    Read,
    /// Finding the skin at the landmarks.
    Landmarks,
    /// To half scale (paper Table III, row 1).
    Half,
    /// Morphing (row 2).
    Morph,
    /// Back to full scale (row 5).
    Upsample,
    /// Jacobian determinant and displacement at every voxel.
    Audit,
    /// The adaptive evaluation against the exact one.
    Compare,
    /// Regions, angle, height (row 6).
    Measure,
    /// Writing `volume.nii.gz`.
    WriteVolume,
    /// Writing `volume.nrrd`.
    WriteNrrd,
    /// Writing `displacement.nii.gz`.
    WriteDisplacement,
    /// Enhancement, segmentation and the semi-boundary (row 3).
    Surface,
    /// Rendering views, and writing them (row 4).
    Views,
    /// A row of the contact sheet.
    Sheet,
    /// Drawing and writing slices.
    Slices,
    /// Finding the profile of the skin in the midplane.
    Profile,
    /// Profiles and bar charts.
    Charts,
    /// Meshes and solids, from the volume to the files.
    Meshes,
    /// The inverse displacement, computed and written.
    Inverse,
    /// Finding the skins of candidates, and how far they are apart.
    Skins,
    /// Writing records and tables, and putting every file in place.
    Publish,
}

impl Phase {
    /// What it is doing, for people.
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Read => "reading the CT",
            Self::Landmarks => "checking the landmarks",
            Self::Half => "halving",
            Self::Morph => "morphing",
            Self::Upsample => "back to full scale",
            Self::Audit => "checking the map",
            Self::Compare => "comparing with exact",
            Self::Measure => "measuring",
            Self::WriteVolume => "writing the volume",
            Self::WriteNrrd => "writing the volume as NRRD",
            Self::WriteDisplacement => "writing the displacement field",
            Self::Surface => "finding the surface",
            Self::Views => "drawing views",
            Self::Sheet => "filling the contact sheet",
            Self::Slices => "drawing slices",
            Self::Profile => "finding the profile",
            Self::Charts => "drawing charts",
            Self::Meshes => "making meshes",
            Self::Inverse => "inverting the displacement field",
            Self::Skins => "comparing skins",
            Self::Publish => "writing tables",
        }
    }
}

/// Which nose the work is for; none where it is for all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Place<'a> {
    /// The candidate's name.
    pub candidate: &'a str,
    /// The stage's name.
    pub stage: &'a str,
}

/// Something happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Event<'a> {
    /// A plan begins, which will take this many phases.
    PlanStarted {
        /// Its name.
        plan: &'a str,
        /// Phases to come.
        phases: usize,
    },
    /// A phase begins.
    PhaseStarted(Phase, Option<Place<'a>>),
    /// The phase that began last is over.
    PhaseFinished(Phase, Option<Place<'a>>),
    /// Results of an earlier run are kept, and so many phases need not run.
    Kept(usize),
    /// Something that the user should know, and that does not stop the run.
    Warning(String),
    /// The plan is finished.
    PlanFinished,
}

/// Hears of events. Those of one candidate come in order; candidates can be computed beside each other.
pub trait Observer: Sync {
    /// Called for each event, on the thread where it happens.
    fn on(&self, event: &Event<'_>);
}

/// Hears and says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {
    fn on(&self, _: &Event<'_>) {}
}
