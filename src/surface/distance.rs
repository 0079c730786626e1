//! How far one surface lies outside or inside another.

use glam::DVec3;
use rayon::prelude::*;

use super::boundary::{BoundaryVoxel, SemiBoundary, surface_point};
use super::points::{Found, PointIndex};
use crate::space::GridPoint;

/// Looks up the nearest point of a surface.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceDistance<'a> {
    surface: &'a SemiBoundary,
    reach_mm: f64,
    spacing: DVec3,
    /// That of the surface: asked for at every voxel.
    offset_step: f64,
    /// How far a surface point can be from the centre of its voxel, mm.
    slack: f64,
}

/// A point of a surface, with its squared distance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    pub(super) point: DVec3,
    pub(super) normal: DVec3,
    pub(super) squared: f64,
}

impl Nearest {
    #[inline]
    pub(super) fn of(point: DVec3, normal: DVec3, from: DVec3) -> Self {
        Self {
            point,
            normal,
            squared: (point - from).length_squared(),
        }
    }
}

impl<'a> SurfaceDistance<'a> {
    /// Distances to `surface`, up to `reach_mm`.
    pub fn new(surface: &'a SemiBoundary, reach_mm: f64) -> Self {
        Self {
            surface,
            reach_mm,
            spacing: surface.grid().spacing(),
            offset_step: surface.offset_step(),
            // As far as a stored offset reaches: 127 steps of a hundredth of this.
            slack: 1.27 * surface.grid().spacing().max_element(),
        }
    }

    /// As [`SurfaceDistance::signed`], to the nearest surface point whose normal is less than 90° from the one given;
    /// for point after point, each near the one before: what was nearest to that one is where the search begins, or
    /// a point of the surface that is given with it, with its normal. `points` are those of the surface.
    pub(super) fn facing_in_order(
        &self,
        points: &PointIndex,
    ) -> impl FnMut(DVec3, DVec3, Option<(DVec3, DVec3)>) -> Option<f64> {
        let mut last: Option<Nearest> = None;
        move |from, normal, near| {
            let faces = |nearest: &Nearest| nearest.normal.dot(normal) > 0.0;
            let before = last.map(|last| Nearest::of(last.point, last.normal, from));
            let before = before.filter(faces);
            let near = near.map(|(point, normal)| Nearest::of(point, normal, from));
            let guess = match (before, near.filter(faces)) {
                (Some(before), Some(near)) if before.squared <= near.squared => Some(before),
                (before, near) => near.or(before),
            };
            last = match points.nearest(from, normal, self.reach_mm, guess) {
                Found::One(nearest) => nearest,
                // Which of them it is depends on the order in which they are met.
                Found::Several => self.nearest(from, Some(normal), before),
            };
            last.as_ref().map(|nearest| self.sign(from, nearest))
        }
    }

    /// How far a point lies outside (positive) or inside the surface, mm; `None` where the surface is
    /// further than the reach.
    ///
    /// Where the nearest surface point is square below, this is the distance to the plane through it,
    /// which knows the surface between voxels; else the distance to the point.
    pub fn signed(&self, point: GridPoint) -> Option<f64> {
        let nearest = self.nearest(point.0, None, None)?;
        Some(self.sign(point.0, &nearest))
    }

    /// The nearest surface point; `None` where the surface is further than the reach.
    pub fn nearest_point(&self, point: GridPoint) -> Option<GridPoint> {
        self.nearest(point.0, None, None)
            .map(|nearest| GridPoint(nearest.point))
    }

    pub(super) fn sign(&self, point: DVec3, nearest: &Nearest) -> f64 {
        let from = point - nearest.point;
        let along = from.dot(nearest.normal);
        let across = (from.length_squared() - along * along).max(0.0).sqrt();
        if across <= self.spacing.max_element() {
            along
        } else {
            nearest.squared.sqrt().copysign(along)
        }
    }

    fn candidate(&self, voxel: BoundaryVoxel, index: [usize; 3], from: DVec3) -> Nearest {
        let normal = voxel.normal().as_dvec3();
        let point = surface_point(index, voxel.offset, normal, self.spacing, self.offset_step);
        Nearest::of(point, normal, from)
    }

    /// Rows are visited in square rings around the point's own, until no further ring can hold a nearer
    /// point. Where `facing` is given, points that face away from it do not count. `guess` is a point that counts,
    /// known to be near.
    pub(super) fn nearest(
        &self,
        from: DVec3,
        facing: Option<DVec3>,
        guess: Option<Nearest>,
    ) -> Option<Nearest> {
        let [_, ny, nz] = self.surface.grid().dims();
        let centre = (from / self.spacing).round();
        let (cy, cz) = (centre.y as isize, centre.z as isize);
        let least = self.spacing.y.min(self.spacing.z);
        let rings = ny.max(nz) as isize;
        let mut search = Search::new(self, from, facing, guess);
        for ring in 0..=rings {
            // The nearest that a row of this ring can be, half a voxel of rounding allowed for.
            if (ring as f64 - 0.5) * least > search.limit + self.slack {
                break;
            }
            for dz in -ring..=ring {
                let edge = dz.abs() == ring;
                let step = if edge || ring == 0 { 1 } else { 2 * ring };
                let mut dy = -ring;
                while dy <= ring {
                    let (y, z) = (cy + dy, cz + dz);
                    dy += step;
                    if let (Ok(y), Ok(z)) = (usize::try_from(y), usize::try_from(z)) {
                        search.row(y, z);
                    }
                }
            }
        }
        let reach2 = self.reach_mm * self.reach_mm;
        search.best.filter(|best| best.squared <= reach2)
    }
}

/// The nearest point so far.
struct Search<'a> {
    on: &'a SurfaceDistance<'a>,
    from: DVec3,
    /// Along x, in voxels.
    x: f64,
    facing: Option<DVec3>,
    best: Option<Nearest>,
    /// How far it is, or the reach; and that with what a surface point can be from its voxel's centre, squared.
    limit: f64,
    window: f64,
}

impl<'a> Search<'a> {
    fn new(
        on: &'a SurfaceDistance<'a>,
        from: DVec3,
        facing: Option<DVec3>,
        best: Option<Nearest>,
    ) -> Self {
        let mut search = Self {
            on,
            from,
            x: from.x / on.spacing.x,
            facing,
            best,
            limit: 0.0,
            window: 0.0,
        };
        search.limit_to(best.map_or(on.reach_mm, |best| best.squared.sqrt()));
        search
    }

    fn limit_to(&mut self, mm: f64) {
        self.limit = mm;
        self.window = (mm + self.on.slack) * (mm + self.on.slack);
    }

    /// Looks at the voxels of a row, from the one next to the point outwards.
    #[inline]
    fn row(&mut self, y: usize, z: usize) {
        let spacing = self.on.spacing;
        let (dy, dz) = (
            y as f64 * spacing.y - self.from.y,
            z as f64 * spacing.z - self.from.z,
        );
        let across = dy * dy + dz * dz;
        if across > self.window {
            return;
        }
        let row = self.on.surface.row(y, z);
        let begin = row.partition_point(|voxel| (voxel.x() as f64) < self.x);
        let (left, right) = row.split_at(begin);
        for &voxel in left.iter().rev() {
            if !self.voxel(voxel, y, z, across) {
                break;
            }
        }
        for &voxel in right {
            if !self.voxel(voxel, y, z, across) {
                break;
            }
        }
    }

    /// Looks at a voxel; whether one beyond it can still be nearer than the best.
    #[inline]
    fn voxel(&mut self, voxel: BoundaryVoxel, y: usize, z: usize, across: f64) -> bool {
        let dx = voxel.x() as f64 * self.on.spacing.x - self.from.x;
        let centre = dx * dx + across;
        if centre > self.window {
            return false;
        }
        // So far at most is its own surface point from its centre; a step more for rounding.
        let offset = f64::from(voxel.offset.unsigned_abs()) + 1.0;
        let reach = self.limit + offset * self.on.offset_step;
        if centre > reach * reach {
            return true;
        }
        let found = self.on.candidate(voxel, [voxel.x(), y, z], self.from);
        // What the end of the scan lays open faces nowhere.
        let faces = |facing| !voxel.code().is_cut() && found.normal.dot(facing) > 0.0;
        let counts = self.facing.is_none_or(faces);
        if counts && self.best.is_none_or(|best| found.squared < best.squared) {
            self.best = Some(found);
            self.limit_to(found.squared.sqrt());
        }
        true
    }
}

/// For every boundary voxel of `after`, how far its surface point lies outside (positive: tissue was added)
/// or inside `before`, mm. NaN where `before` is further than `reach_mm`. Exactly 0 where the two surfaces
/// hold the same voxel.
pub fn signed_distances(after: &SemiBoundary, before: &SemiBoundary, reach_mm: f64) -> Vec<f32> {
    let [_, ny, nz] = after.grid().dims();
    let distance = SurfaceDistance::new(before, reach_mm);
    let same_grid = after.grid().dims() == before.grid().dims();
    let rows = (0..ny * nz).into_par_iter().map(|row| {
        let (y, z) = (row % ny, row / ny);
        let twin = if same_grid { before.row(y, z) } else { &[] };
        // The nearest point of the voxel before is a good first guess for this one.
        let mut guess: Option<Nearest> = None;
        let voxels = after.row(y, z).iter().map(|&voxel| {
            let same = twin
                .binary_search_by_key(&voxel.x(), |twin| twin.x())
                .is_ok_and(|place| twin[place] == voxel);
            if same {
                return 0.0;
            }
            let point = after.surface_point(voxel, y, z).0;
            let from_guess = guess.map(|guess| Nearest {
                squared: (guess.point - point).length_squared(),
                ..guess
            });
            guess = distance.nearest(point, None, from_guess);
            guess.map_or(f32::NAN, |nearest| distance.sign(point, &nearest) as f32)
        });
        voxels.collect::<Vec<f32>>()
    });
    rows.collect::<Vec<_>>().concat()
}
