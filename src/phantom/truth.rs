//! The true regional volumes, from the analytic surface and without voxels.

use rayon::prelude::*;

use super::shape::{BASE_Y, LIP_Z, MIDLINE, TOP_Z, tissue};

/// Number of regions, A to K.
pub const REGIONS: usize = 11;

/// Rows of columns in one region: 0.098 mm apart, and as far apart along x. Half of that changes no
/// region by more than 0.02 % (a test).
pub(super) const CELLS_PER_REGION: usize = 24;

/// Half the width of what is searched for tissue in front of the base plane, mm.
const HALF_SPAN: f64 = 60.0;
/// Nothing of the head is in front of this, y in mm.
const FRONT_Y: f64 = 5.0;

/// Volumes of A..K in mm³: midpoint rule over columns along y, `cells` rows of them in a region.
pub(super) fn region_volumes(cells: usize) -> [f64; REGIONS] {
    let step = (TOP_Z - LIP_Z) / (REGIONS * cells) as f64;
    let columns = (2.0 * HALF_SPAN / step).ceil() as usize;
    let rows: Vec<f64> = (0..REGIONS * cells)
        .into_par_iter()
        .map(|row| {
            let z = TOP_Z - (row as f64 + 0.5) * step;
            (0..columns)
                .map(|column| {
                    let x = MIDLINE + (column as f64 + 0.5 - columns as f64 / 2.0) * step;
                    tissue_length(x, z)
                })
                .sum()
        })
        .collect();
    let mut volumes = [0.0; REGIONS];
    for (volume, rows) in volumes.iter_mut().zip(rows.chunks(cells)) {
        *volume = rows.iter().sum::<f64>() * step * step;
    }
    volumes
}

/// Tissue in front of the base plane on the line (x, z), mm: every crossing is found, so airways on the
/// way do not count.
fn tissue_length(x: f64, z: f64) -> f64 {
    /// A share of the field's value that cannot step over a surface.
    const SAFE_SHARE: f64 = 0.6;
    /// Smallest step, mm.
    const LEAST_STEP: f64 = 0.25;
    let field = |y: f64| tissue([x, y, z]);
    let mut length = 0.0;
    let (mut y, mut value) = (FRONT_Y, field(FRONT_Y));
    while y < BASE_Y {
        let next = (y + (SAFE_SHARE * value.abs()).max(LEAST_STEP)).min(BASE_Y);
        let next_value = field(next);
        match (value < 0.0, next_value < 0.0) {
            (true, true) => length += next - y,
            (true, false) => length += crossing(&field, (y, value), (next, next_value)) - y,
            (false, true) => length += next - crossing(&field, (y, value), (next, next_value)),
            (false, false) => {}
        }
        (y, value) = (next, next_value);
    }
    length
}

/// Where the field is 0 between two positions at which its signs differ (regula falsi with the Illinois
/// change of Dowell and Jarratt 1971).
fn crossing(
    field: &impl Fn(f64) -> f64,
    (mut a, mut fa): (f64, f64),
    (mut b, mut fb): (f64, f64),
) -> f64 {
    /// A field value that counts as 0, mm.
    const NEAR_ENOUGH: f64 = 1e-7;
    const MOST_STEPS: usize = 60;
    for _ in 0..MOST_STEPS {
        let middle = (a * fb - b * fa) / (fb - fa);
        let value = field(middle);
        if value.abs() < NEAR_ENOUGH {
            return middle;
        }
        if (value < 0.0) == (fb < 0.0) {
            fa *= 0.5;
        } else {
            (a, fa) = (b, fb);
        }
        (b, fb) = (middle, value);
    }
    b
}
