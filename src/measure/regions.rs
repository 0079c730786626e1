//! The volumes of the regions A..K (paper section IV, Fig. 10 a; method section 6).
//!
//! A sub-voxel estimate. HU become depths below the skin ([`depth`](super::profile::depth)), and the body
//! measured is where the interpolated depth is that of the threshold or more, clipped by the planes. It is
//! summed sheet by sheet: at a height z the slices around it are blended (cubically: a nose curves
//! between slices 1 mm apart), and in that plane the tissue's length is found along lines parallel to
//! y, where depth is linear and each crossing exact. No sheet stands for a layer that a slab's plane cuts, so
//! the slices there are shared in proportion.

use rayon::prelude::*;
use serde::Serialize;

use super::MeasureError;
use super::cells::cells;
use super::sheet::{Content, Sheets, Slices, Stack};
use crate::feature::Landmarks;
use crate::space::{Grid, GridPoint};
use crate::volume::{Sample, Volume};

/// Number of regions.
pub const REGIONS: usize = 11;

/// The regions' names, from the `nasal_bones` plane down.
pub const REGION_NAMES: [char; REGIONS] = ['A', 'B', 'C', 'D', 'E', 'F', 'G', 'H', 'I', 'J', 'K'];

/// Sheets for each voxel of height, and lines for each voxel of width. Doubling it changes no region of the
/// phantom by more than 0.1 % (a test).
const LINES_PER_VOXEL: usize = 6;

/// Where the regions are: eleven slabs of equal height, in front of the base plane. Grid millimetres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Slabs {
    nasal_bones_z: f64,
    lip_z: f64,
    base_y: f64,
}

impl Slabs {
    /// Between the planes through `nasal_bones` and `lip`, in front of the plane through `maxilla`.
    ///
    /// # Errors
    /// [`MeasureError::Landmark`] for a position that is not finite, [`MeasureError::NoHeight`] where
    /// `nasal_bones` is not above `lip`.
    pub fn new(landmarks: &Landmarks<GridPoint>) -> Result<Self, MeasureError> {
        let slabs = Self {
            nasal_bones_z: landmarks.nasal_bones.0.z,
            lip_z: landmarks.lip.0.z,
            base_y: landmarks.maxilla.0.y,
        };
        let Self {
            nasal_bones_z,
            lip_z,
            base_y,
        } = slabs;
        if !(nasal_bones_z.is_finite() && lip_z.is_finite() && base_y.is_finite()) {
            return Err(MeasureError::Landmark);
        }
        if nasal_bones_z <= lip_z {
            return Err(MeasureError::NoHeight {
                nasal_bones_z,
                lip_z,
            });
        }
        Ok(slabs)
    }

    /// The plane in front of which tissue counts, y in mm.
    pub fn base_y(&self) -> f64 {
        self.base_y
    }

    /// The transverse planes that bound the regions, z in mm: region n lies between planes n and n + 1.
    pub fn planes(&self) -> [f64; REGIONS + 1] {
        std::array::from_fn(|n| {
            let down = n as f64 / REGIONS as f64;
            self.nasal_bones_z * (1.0 - down) + self.lip_z * down
        })
    }
}

/// Tissue in each of the regions A..K, mm³.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(transparent)]
pub struct RegionVolumes(pub [f64; REGIONS]);

impl RegionVolumes {
    /// The regions' sum, mm³.
    pub fn total(&self) -> f64 {
        self.0.iter().sum()
    }

    /// Each region's name with its volume in mm³, from A to K.
    pub fn named(&self) -> impl Iterator<Item = (char, f64)> {
        REGION_NAMES.into_iter().zip(self.0)
    }
}

/// Tissue, that is values of at least `skin_hu`, in each of the regions.
///
/// Not bounded laterally. A voxel at the volume's rim fills its whole cell: it reaches half a voxel
/// beyond its centre. What lies outside the volume counts as nothing. The result is the same for
/// any number of threads.
///
/// # Errors
/// [`MeasureError`] where there is no such number: no tissue or no air in all of the regions, a
/// value that is not finite, or regions outside the volume. A single region without tissue is 0.
pub fn region_volumes<T: Sample>(
    volume: &Volume<T>,
    slabs: &Slabs,
    skin_hu: f64,
) -> Result<RegionVolumes, MeasureError> {
    measure(volume, slabs, skin_hu, LINES_PER_VOXEL)
}

/// As [`region_volumes`], with a choice of [`LINES_PER_VOXEL`].
pub(super) fn measure<T: Sample>(
    volume: &Volume<T>,
    slabs: &Slabs,
    skin_hu: f64,
    lines_per_voxel: usize,
) -> Result<RegionVolumes, MeasureError> {
    if !skin_hu.is_finite() {
        return Err(MeasureError::Threshold { skin_hu });
    }
    let base = slabs.base_y / volume.grid().spacing().y;
    let stacks = plan(volume.grid(), slabs, lines_per_voxel);
    let sheets = Sheets::new(volume, base, skin_hu, lines_per_voxel);
    let contents: Vec<Content> = stacks
        .par_iter()
        // Neighbours share slices.
        .with_min_len(4)
        .map_init(Slices::default, |slices, stack| {
            sheets.content(stack, slices)
        })
        .collect();
    // In the order of the stacks, whatever thread measured them.
    let mut voxels = [0.0; REGIONS];
    let (mut any_tissue, mut any_air) = (false, false);
    for (stack, content) in stacks.iter().zip(&contents) {
        if let Some((index, hu)) = content.bad {
            return Err(MeasureError::NotFinite { index, hu });
        }
        if let Some(sum) = voxels.get_mut(stack.region) {
            *sum += content.tissue;
        }
        any_tissue |= content.has_tissue;
        any_air |= content.has_air;
    }
    if any_tissue && any_air && voxels.iter().sum::<f64>() > 0.0 {
        let voxel = volume.grid().voxel_volume();
        return Ok(RegionVolumes(voxels.map(|sum| sum * voxel)));
    }
    let (lowest, highest) = sheets.hu_range(&stacks);
    Err(match (any_tissue, any_air) {
        (false, false) => MeasureError::Outside {
            base_y: slabs.base_y,
            nasal_bones_z: slabs.nasal_bones_z,
            lip_z: slabs.lip_z,
        },
        // Tissue beside the regions but none in them is none.
        (false, true) | (true, true) => MeasureError::NoTissue {
            skin_hu,
            lowest,
            highest,
        },
        (true, false) => MeasureError::NoAir {
            skin_hu,
            lowest,
            highest,
        },
    })
}

/// The sheets that measure the slabs, from A to K: `per_voxel` to a slice, evenly within each stretch that
/// neither a slab's plane nor a slice's centre cuts.
fn plan(grid: &Grid, slabs: &Slabs, per_voxel: usize) -> Vec<Stack> {
    let [_, _, slices] = grid.dims();
    let planes = slabs.planes().map(|z| z / grid.spacing().z);
    let mut stacks = Vec::new();
    for (region, ends) in planes.windows(2).enumerate() {
        let &[upper, lower] = ends else { continue };
        stacks.extend(cells(slices, lower, upper).map(|cell| Stack {
            region,
            cell,
            sheets: (cell.length() * per_voxel as f64).ceil().max(1.0) as usize,
        }));
    }
    stacks
}
