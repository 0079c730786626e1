//! The landmarks of a markups file on the grid of a CT, as a plan writes them.

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;
use thiserror::Error;

use super::ct::{self, CtError, CtHeader};
use super::error::ExitCode;
use crate::feature::{Landmark, Landmarks};
use crate::io::landmarks::{self, LandmarkFileError};
use crate::plan::CtSource;
use crate::space::{ContinuousIndex, LpsPoint};

/// Six landmarks and where they are on a CT.
#[derive(Debug, Clone, Serialize)]
pub struct LandmarksOnCt {
    /// What the file's numbers mean: `LPS` or `RAS`.
    pub coordinate_system: &'static str,
    /// SHA-256 of the file's bytes, hexadecimal.
    pub sha256: String,
    /// Positions on the voxel lattice, in LPS order.
    pub voxel: Landmarks<ContinuousIndex>,
    /// Positions in the patient's frame, mm.
    pub lps_mm: Landmarks<LpsPoint>,
    #[serde(skip)]
    ct: CtHeader,
}

/// Why there are no landmarks on a CT.
#[derive(Debug, Error)]
pub enum LandmarksError {
    /// The file of landmarks cannot be used.
    #[error(transparent)]
    File(#[from] LandmarkFileError),
    /// The CT cannot be used.
    #[error(transparent)]
    Ct(#[from] CtError),
    /// Some are not in the CT.
    #[error(
        "not in the CT: {found}; it has voxels (0, 0, 0) to ({}, {}, {}): is this the CT that the landmarks were placed on?",
        last[0], last[1], last[2]
    )]
    Outside {
        /// Their names and voxels.
        found: String,
        /// The CT's last voxel.
        last: [usize; 3],
    },
}

impl LandmarksError {
    /// What the process ends with.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Ct(_) => ExitCode::Input,
            Self::File(_) | Self::Outside { .. } => ExitCode::Usage,
        }
    }
}

/// Decimals of a printed voxel position: a micrometre or less.
const DECIMALS: f64 = 1000.0;

impl LandmarksOnCt {
    /// Reads the landmarks and the header of the CT. Voxel positions are rounded to three decimals, those
    /// that a plan made from them has. `series` chooses among those of a folder.
    ///
    /// # Errors
    /// [`LandmarksError`] where either cannot be used, or a landmark is not in the CT.
    pub fn read(file: &Path, ct: &Path, series: Option<&str>) -> Result<Self, LandmarksError> {
        let source = CtSource::File {
            path: ct.to_owned(),
            sha256: None,
            series: series.map(str::to_owned),
        };
        let ct = ct::header(&source)?;
        let file = landmarks::read(file)?;
        let grid = &ct.grid;
        let lps_mm = file.lps();
        let voxel = lps_mm.map(|point| {
            let index = grid.grid_to_index(grid.lps_to_grid(point));
            // Without a negative zero, which would be printed.
            ContinuousIndex((index.0 * DECIMALS).round() / DECIMALS + 0.0)
        });
        let outside: Vec<String> = Landmark::ALL
            .into_iter()
            .filter(|&landmark| !grid.contains(*voxel.get(landmark)))
            .map(|landmark| {
                let [x, y, z] = voxel.get(landmark).to_array();
                format!("`{landmark}` at voxel ({x:.1}, {y:.1}, {z:.1})")
            })
            .collect();
        if !outside.is_empty() {
            return Err(LandmarksError::Outside {
                found: outside.join(", "),
                last: grid.dims().map(|n| n - 1),
            });
        }
        Ok(Self {
            coordinate_system: file.system.name(),
            sha256: file.sha256,
            voxel,
            lps_mm,
            ct,
        })
    }

    /// What the user should know of the CT.
    pub fn warning(&self) -> Option<String> {
        self.ct.warning()
    }

    /// The `[landmarks]` of a plan on this CT, each point with its LPS mm as a comment.
    pub fn plan_text(&self) -> String {
        let rows = Landmark::ALL.map(|landmark| {
            let [x, y, z] = self.voxel.get(landmark).to_array();
            let point = format!("[{x:.3}, {y:.3}, {z:.3}]");
            (landmark, point)
        });
        let width = rows.iter().map(|(_, point)| point.len()).max();
        let width = width.unwrap_or_default();
        let mut text = "[landmarks]\nframe = \"voxel\"\n".to_owned();
        for (landmark, point) in rows {
            let [x, y, z] = self.lps_mm.get(landmark).to_array();
            // Writing to a string does not fail.
            let _ = writeln!(
                text,
                "{:<11} = {point:<width$}  # LPS mm: {x:.3}, {y:.3}, {z:.3}",
                landmark.name()
            );
        }
        text
    }
}
