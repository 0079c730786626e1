//! The feature line f1.

use serde::Serialize;
use thiserror::Error;

use crate::space::{GridPoint, GridVector};

/// A feature line shorter than this has no direction (method section 3).
pub const MIN_LENGTH_MM: f64 = 1e-6;

/// f1: from the root, near the nasofrontal angle, to the tip of the nose. In grid millimetres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FeatureLine {
    /// The end near the nasofrontal angle.
    pub root: GridPoint,
    /// The end at the tip of the nose (pronasale).
    pub tip: GridPoint,
}

/// What of f1 is the feature: what is mapped onto what, and from where distances are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FeatureKind {
    /// The line from root to tip.
    #[default]
    Line,
    /// The tip alone, which can be moved and neither turned nor stretched: the "augmentation operator" of the
    /// paper's earlier study \[12\], which the paper compares with the line (section III, Fig. 8).
    Point,
}

impl FeatureKind {
    /// The name that plans use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Line => "line",
            Self::Point => "point",
        }
    }
}

/// Why a feature line cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum LineError {
    /// Its ends are the same point.
    #[error(
        "the feature line f1 is {length_mm:e} mm long; its root and tip must be at least {MIN_LENGTH_MM:e} mm apart"
    )]
    Degenerate {
        /// The length found, mm.
        length_mm: f64,
    },
    /// An end is not a finite position.
    #[error("an end of the feature line f1 is not a finite position")]
    NotFinite,
}

impl FeatureLine {
    /// From root to tip.
    ///
    /// # Errors
    /// [`LineError`] where the line is too short to have a direction, or not finite.
    pub fn new(root: GridPoint, tip: GridPoint) -> Result<Self, LineError> {
        let line = Self { root, tip };
        line.validate()?;
        Ok(line)
    }

    /// Whether the line has a direction.
    ///
    /// # Errors
    /// As [`FeatureLine::new`].
    pub fn validate(&self) -> Result<(), LineError> {
        if !self.root.0.is_finite() || !self.tip.0.is_finite() {
            return Err(LineError::NotFinite);
        }
        let length_mm = self.length();
        if length_mm < MIN_LENGTH_MM {
            return Err(LineError::Degenerate { length_mm });
        }
        Ok(())
    }

    /// From root to tip, mm.
    pub fn vector(&self) -> GridVector {
        self.tip - self.root
    }

    /// Length, mm.
    pub fn length(&self) -> f64 {
        self.vector().0.length()
    }
}
