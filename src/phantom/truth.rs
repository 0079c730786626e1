//! The true regional volumes, from the analytic surface and without voxels.

use rayon::prelude::*;

use super::shape::{BASE_Y, LIP_Z, MIDLINE, TOP_Z, tissue};

/// Number of regions, A to K.
pub const REGIONS: usize = 11;

/// Rows of columns in one region: 0.073 mm apart, and as far apart along x. Half of that changes no
/// region by more than 0.02 % (a test).
pub(super) const CELLS_PER_REGION: usize = 32;

/// Half the width of what is searched for tissue in front of the base plane, mm.
const HALF_SPAN: f64 = 40.0;
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
    /// A share of the field's value that cannot step over a surface: no field is steeper than 2.
    const SAFE_SHARE: f64 = 0.5;
    /// Smallest step, mm; no wall or channel is thinner.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Table I of the paper, before surgery, mm³.
    const TABLE_1: [f64; REGIONS] = [
        1168.0, 1242.0, 1947.0, 3058.0, 5374.0, 8823.0, 10651.0, 10321.0, 5109.0, 826.0, 820.0,
    ];

    #[test]
    fn half_the_step_changes_no_region() {
        const CONVERGED: f64 = 2e-4;
        let coarse = region_volumes(CELLS_PER_REGION);
        let fine = region_volumes(2 * CELLS_PER_REGION);
        for (region, (c, f)) in coarse.iter().zip(fine).enumerate() {
            assert!((c / f - 1.0).abs() < CONVERGED, "region {region}: {c}, {f}");
        }
    }

    #[test]
    fn the_regions_have_the_shape_of_table_one() {
        // Sizes rise to the tip and fall beneath it; docs/phantom.md says why they are nearer each other
        // than in the paper.
        let found = region_volumes(CELLS_PER_REGION);
        for volumes in [found, TABLE_1] {
            let [a, .., f, g, h, i, j, k] = volumes;
            assert!(volumes[..6].is_sorted() && f < h.min(g));
            let largest = g.max(h);
            assert!(h > 0.9 * largest && g > 0.9 * largest);
            assert!(a < 0.3 * largest);
            assert!(i > j.max(k) && i < 0.6 * largest);
            assert!(j.max(k) < 0.5 * largest);
        }
        let factor = found.iter().sum::<f64>() / TABLE_1.iter().sum::<f64>();
        assert!((0.24..0.26).contains(&factor), "factor {factor}");
    }

    #[test]
    fn counting_points_gives_the_same_volumes() {
        // A lattice of 0.25×0.25×0.195 mm, 12 planes in a region, on the sign of the field alone.
        const SPACING: f64 = 0.25;
        const PLANES: usize = 12;
        const TOLERANCE: f64 = 5e-3;
        let dz = (TOP_Z - LIP_Z) / (REGIONS * PLANES) as f64;
        // Planes of points end at the base plane, so that no cell crosses it.
        let rows = ((BASE_Y - FRONT_Y) / SPACING) as usize;
        let counted: Vec<f64> = (0..REGIONS)
            .into_par_iter()
            .map(|region| {
                let mut count = 0u32;
                for plane in 0..PLANES {
                    let z = TOP_Z - ((region * PLANES + plane) as f64 + 0.5) * dz;
                    for x in (0..480).map(|n| f64::from(n - 240) * SPACING + MIDLINE + 0.1) {
                        for row in 0..rows {
                            let y = BASE_Y - (row as f64 + 0.5) * SPACING;
                            count += u32::from(tissue([x, y, z]) < 0.0);
                        }
                    }
                }
                f64::from(count) * SPACING * SPACING * dz
            })
            .collect();
        let volumes = region_volumes(CELLS_PER_REGION);
        for (region, (count, volume)) in counted.iter().zip(volumes).enumerate() {
            let off = count / volume - 1.0;
            assert!(off.abs() < TOLERANCE, "region {region}: {count}, {volume}");
        }
    }

    #[test]
    fn a_column_through_a_nostril_leaves_its_air_out() {
        // Find columns that enter tissue, leave it and enter again.
        let (z, mut through) = (60.5, 0);
        for x in (400..850).map(|n| f64::from(n) * 0.1) {
            const STEP: f64 = 0.01;
            let steps = ((BASE_Y - FRONT_Y) / STEP) as usize;
            let inside: Vec<bool> = (0..steps)
                .map(|n| tissue([x, BASE_Y - (n as f64 + 0.5) * STEP, z]) < 0.0)
                .collect();
            let entries = inside.windows(2).filter(|w| w[0] && !w[1]).count();
            through += usize::from(entries > 1);
            let counted = inside.iter().filter(|&&i| i).count() as f64 * STEP;
            // A whole step may be lost or gained at each crossing.
            let off = (tissue_length(x, z) - counted).abs();
            assert!(off < STEP * (2 * entries + 1) as f64, "x {x}: {off}");
        }
        assert!(through > 20, "only {through} columns cross a nostril");
    }
}
