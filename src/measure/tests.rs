//! Volumes against bodies whose volumes are known without voxels.

use std::time::Instant;

use super::regions::measure;
use super::*;
use crate::phantom::{DIMS, Phantom, SPACING};
use crate::space::Grid;

#[test]
fn experiment() {
    let truth = Phantom::lee2001().true_region_volumes();
    let slabs = Slabs::new(&Phantom::lee2001().landmarks_mm()).unwrap();
    println!(
        "truth {:?} {}",
        truth.map(|v| v.round()),
        truth.iter().sum::<f64>()
    );
    for spacing in [SPACING, [0.5; 3], [0.7; 3], [1.0; 3], [0.9, 0.9, 1.5]] {
        let dims = std::array::from_fn(|n| ([142.0, 42.0, 84.0][n] / spacing[n]) as usize);
        let grid = if spacing == SPACING {
            Grid::axis_aligned([DIMS[0], 100, 90], spacing).unwrap()
        } else {
            Grid::axis_aligned(dims, spacing).unwrap()
        };
        let start = Instant::now();
        let volume = Phantom::lee2001().render(&grid).unwrap();
        println!("{spacing:?} rendered {:?}", start.elapsed());
        for lines in [2, 3, 4, 6, 8, 16] {
            let start = Instant::now();
            let found = measure(&volume, &slabs, -500.0, lines).unwrap();
            let time = start.elapsed();
            let percent: Vec<String> = found
                .0
                .iter()
                .zip(truth)
                .map(|(f, t)| format!("{:+.3}", 100.0 * (f / t - 1.0)))
                .collect();
            println!(
                "  {lines}: {} total {:+.4} {time:?}",
                percent.join(" "),
                100.0 * (found.total() / truth.iter().sum::<f64>() - 1.0)
            );
        }
    }
}
