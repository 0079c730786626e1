//! A volume sampled through a field.

use std::marker::PhantomData;

use ndarray::ArrayViewMut3;
use rayon::prelude::*;

use super::LANES;
use super::field::{Field, Scratch};
use super::tile::{Tile, split_into_tiles};
use crate::simd::{Kernel, Real, Simd};
use crate::volume::{Sample, Spares, Trilinear, Volume};

/// The volume whose every voxel takes the value that `source` has at the position that `field` gives it.
///
/// Trilinear; outside `source`, the nearest edge voxel; integers rounded half away from zero
/// (method section 3). A voxel that is not moved keeps its sample bit for bit. The field's lattice
/// must be the volume's.
pub fn warp<T: Sample>(source: &Volume<T>, field: &Field<'_>) -> Volume<T> {
    warp_with(source, field, &Spares::default())
}

/// As [`warp`], in memory that is at hand where there is any.
pub fn warp_with<T: Sample>(source: &Volume<T>, field: &Field<'_>, spares: &Spares) -> Volume<T> {
    debug_assert_eq!(source.grid().dims(), field.lattice().dims());
    // Where all of it is sampled, and nothing asks for what was there, nothing has to be there.
    let all = T::BLENDS_EXACTLY && field.support().dims() == source.grid().dims();
    let anything = || Volume::any_samples(source.grid().clone(), source.rescale(), spares).ok();
    let anything = all.then(anything).flatten();
    let target = anything.unwrap_or_else(|| source.par_clone(spares));
    warp_onto(target, source, field)
}

/// As [`warp`], put onto a volume of the same size: all of the field's support is written, nothing else. Where
/// samples are not blended exactly, what does not move is left as it is there.
pub fn warp_onto<T: Sample>(
    mut warped: Volume<T>,
    source: &Volume<T>,
    field: &Field<'_>,
) -> Volume<T> {
    let sampler = Trilinear::new(source);
    let rough = T::IS_SHORT && field.is_rough() && u32::try_from(source.grid().len()).is_ok();
    split_into_tiles(warped.samples_mut(), field.support())
        .into_par_iter()
        .for_each_init(
            || (Scratch::new(), Tile::new()),
            |(scratch, tile), (voxels, to)| {
                field.fill(voxels, scratch, tile);
                // Taking loaded pairs apart costs wider vectors more than it gains.
                let simd = Simd::widest().narrow();
                match rough {
                    true => simd.run(SampleTile::<T, f32>::new(&sampler, tile, to)),
                    false => simd.run(SampleTile::<T, f64>::new(&sampler, tile, to)),
                }
            },
        );
    warped
}

/// One tile of a volume, sampled at its source positions in a precision.
struct SampleTile<'a, T, F> {
    sampler: &'a Trilinear<'a, T>,
    tile: &'a Tile,
    to: ArrayViewMut3<'a, T>,
    precision: PhantomData<F>,
}

impl<'a, T, F> SampleTile<'a, T, F> {
    fn new(sampler: &'a Trilinear<'a, T>, tile: &'a Tile, to: ArrayViewMut3<'a, T>) -> Self {
        Self {
            sampler,
            tile,
            to,
            precision: PhantomData,
        }
    }
}

impl<T: Sample, F: Real> Kernel for SampleTile<'_, T, F> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let [x0, y0, z0] = self.tile.voxels().start;
        // Rounding takes a position between corners no further than a fraction of the voxel that they are from the rim.
        let corners = self.tile.corners();
        let is_inside = corners.is_some_and(|at| at.iter().all(|&at| self.sampler.holds(at)));
        let mut home = [F::of(0.0); LANES];
        for (lane, home) in home.iter_mut().enumerate() {
            *home = F::of((x0 + lane) as f64);
        }
        for (z, mut plane) in self.to.outer_iter_mut().enumerate() {
            let positions = self.tile.plane::<F>(z);
            for (y, to) in plane.outer_iter_mut().enumerate() {
                let (Some(from), Some(to)) = (positions.row(y), to.into_slice()) else {
                    continue;
                };
                let values = if is_inside {
                    self.sampler.row_inside(&from.x, &from.y, &from.z)
                } else {
                    self.sampler.row(&from.x, &from.y, &from.z)
                };
                let mut row = [T::default(); LANES];
                for lane in 0..LANES {
                    row[lane] = T::from_real(values[lane]);
                }
                if T::BLENDS_EXACTLY {
                    match <&mut [T; LANES]>::try_from(&mut *to) {
                        Ok(all) => *all = row,
                        Err(_) => to.copy_from_slice(&row[..to.len().min(LANES)]),
                    }
                    continue;
                }
                let (home_y, home_z) = (F::of((y0 + y) as f64), F::of((z0 + z) as f64));
                for (lane, to) in to.iter_mut().enumerate() {
                    let unmoved = (from.x[lane] == home[lane])
                        & (from.y[lane] == home_y)
                        & (from.z[lane] == home_z);
                    *to = if unmoved { *to } else { row[lane] };
                }
            }
        }
    }
}
