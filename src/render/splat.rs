//! What one boundary voxel draws: a disc in the plane of its surface, as an ellipse on the picture.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over vector lanes index several arrays alike"
)]

use std::mem;
use std::ops::Range;

use glam::{DVec3, Vec3};

use super::camera::Camera;
use super::span::WIDE;
use crate::surface::{BoundaryVoxel, NeighbourCode, SemiBoundary};

/// Set in the place of a voxel where its flat end is meant, and not its surface.
pub(super) const FLAT: u32 = 1 << 31;
/// Pixels that are drawn at once.
pub(super) const QUAD: usize = 4;
/// Radius of a disc in voxels: the discs of neighbouring voxels overlap on a plane of any orientation. A
/// plane across a body diagonal needs most: there the discs' centres form triangles of side √2 voxels
/// whose middle is 0.82 voxels from them.
const RADIUS: f32 = 1.1;
/// The same for voxels of a flat end, which form a square lattice (0.71 voxels suffice) and shall not
/// overhang it.
const FLAT_RADIUS: f32 = 0.8;
/// Radius of the disc in the middle of a voxel of something thin: that of the ball around a voxel.
const CORE_RADIUS: f32 = 0.87;
/// Added to the size of a disc, pixels squared, so that one that is smaller than a pixel, or seen edge on,
/// still covers the pixel that it is in.
const LOW_PASS: f32 = 0.55;
/// The least cosine between a disc's normal and the direction to the viewer: what is flatter is tilted
/// up to this.
const LEAST_FACING: f32 = 0.05;

/// A camera, made ready for the rows of one grid. In single precision: pictures have fewer than 2¹³ pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eye {
    right: Vec3,
    up: Vec3,
    toward: Vec3,
    /// On the picture (pixels right, pixels down, mm towards the viewer): voxel (0, 0, 0), and one voxel
    /// along each axis.
    origin: DVec3,
    steps: [DVec3; 3],
    pixels_per_mm: f32,
    mm_per_pixel: f32,
    offset_step: f32,
    /// Of a disc, along the axis in which voxels are furthest apart, mm.
    longest_radius: f32,
    metric: Metric,
    /// The faces that may belong to a surface that the viewer sees.
    not_away: u8,
    /// The faces that look at the viewer.
    looking: u8,
    ends: Ends,
}

/// Where the grid's part that is drawn ends, half a voxel beyond its last voxels, in grid mm.
#[derive(Debug, Clone, Copy)]
struct Ends {
    first: [usize; 3],
    last: [usize; 3],
    spacing: Vec3,
}

/// Products of a step of one pixel to the right (r), down (d) and one mm towards the viewer (t), in voxels:
/// discs are as long as voxels are apart.
#[derive(Debug, Clone, Copy)]
struct Metric {
    rr: f32,
    dd: f32,
    tt: f32,
    rd: f32,
    rt: f32,
    dt: f32,
}

/// Half-planes of the picture, as (k, kx, ky): what is kept has k + kx dx + ky dy at least 0 in each.
pub(super) type Clips = [[f32; 3]; 3];

/// A half-plane that clips nothing.
const ALL: [f32; 3] = [f32::INFINITY, 0.0, 0.0];

/// An ellipse of a plane on the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Splat {
    /// The middle, pixels.
    pub x: f32,
    pub y: f32,
    /// Depth of the middle, mm.
    pub z: f32,
    /// Depth for each pixel right and down, mm.
    pub zx: f32,
    pub zy: f32,
    /// Q = a dx² + 2 b dx dy + c dy² is 0 in the middle and 1 on the rim.
    pub a: f32,
    pub b: f32,
    pub c: f32,
    /// How far the ellipse reaches from its middle to either side, and up and down, pixels.
    pub half_width: f32,
    pub half_height: f32,
    /// Share of the ellipse's area that is the disc's: what the low pass adds is spread thinner (Zwicker et
    /// al. 2002, doi:10.1109/TVCG.2002.1021576).
    pub strength: f32,
    /// Place in the semi-boundary.
    pub place: u32,
    /// Unit normal: right, up, towards the viewer.
    pub normal: Vec3,
    /// Where the disc is cut off: its number among [`Splats::clips`], or [`UNCLIPPED`].
    pub clips: u32,
}

/// Of a disc that is not cut off.
const UNCLIPPED: u32 = u32::MAX;

/// Discs in the order in which they are drawn. Made once by a worker and used for all of its bands.
#[derive(Debug, Default)]
pub(super) struct Splats {
    pub all: Vec<Splat>,
    /// Few discs are cut off.
    pub clips: Vec<Clips>,
    /// The rows that are drawn: others' discs are left out.
    rows: Range<isize>,
    waiting: Waiting,
}

/// Voxels that draw one disc each, until there are enough of them to be computed at once.
#[derive(Debug, Default)]
struct Waiting {
    count: usize,
    voxels: [BoundaryVoxel; WIDE],
    /// Where they are on the picture.
    at: Three<WIDE>,
    places: [u32; WIDE],
}

impl Splats {
    pub(super) fn clear(&mut self, rows: Range<isize>) {
        self.all.clear();
        self.clips.clear();
        self.rows = rows;
        self.waiting.count = 0;
    }

    #[inline(always)]
    fn push(&mut self, splat: Splat) {
        let (begin, end) = splat.rows();
        if begin < self.rows.end && end > self.rows.start {
            self.all.push(splat);
        }
    }

    fn push_clipped(&mut self, mut splat: Splat, clips: Clips) {
        splat.clips = self.clips.len() as u32;
        self.clips.push(clips);
        self.push(splat);
    }
}

/// Some vectors, by component.
#[derive(Debug, Clone, Copy)]
struct Three<const N: usize> {
    x: [f32; N],
    y: [f32; N],
    z: [f32; N],
}

impl Eye {
    pub(super) fn new(camera: &Camera, surface: &SemiBoundary) -> Self {
        let spacing = surface.grid().spacing();
        let mm = camera.mm_per_pixel();
        let on_picture = |vector: DVec3| {
            DVec3::new(
                vector.dot(camera.right) / mm,
                -vector.dot(camera.up) / mm,
                vector.dot(camera.toward),
            )
        };
        let middle = camera.size() as f64 / 2.0;
        let r = camera.right * mm / spacing;
        let d = -camera.up * mm / spacing;
        let t = camera.toward / spacing;
        Self {
            right: camera.right.as_vec3(),
            up: camera.up.as_vec3(),
            toward: camera.toward.as_vec3(),
            origin: on_picture(-camera.centre.0) + DVec3::new(middle, middle, 0.0),
            steps: [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| on_picture(axis * spacing)),
            pixels_per_mm: (1.0 / mm) as f32,
            mm_per_pixel: mm as f32,
            offset_step: surface.offset_step() as f32,
            longest_radius: RADIUS * spacing.max_element() as f32,
            metric: Metric {
                rr: r.length_squared() as f32,
                dd: d.length_squared() as f32,
                tt: t.length_squared() as f32,
                rd: r.dot(d) as f32,
                rt: r.dot(t) as f32,
                dt: d.dot(t) as f32,
            },
            not_away: NeighbourCode::of_surfaces_looking(camera.toward, spacing),
            looking: NeighbourCode::looking(camera.toward),
            ends: Ends {
                first: surface.region().first,
                last: surface.region().last,
                spacing: spacing.as_vec3(),
            },
        }
    }

    /// On the picture: the voxel of a row at x = 0. The row goes on in steps of [`Eye::along_row`].
    pub(super) fn row(&self, y: usize, z: usize) -> Vec3 {
        (self.origin + self.steps[1] * y as f64 + self.steps[2] * z as f64).as_vec3()
    }

    /// One voxel along x, on the picture.
    pub(super) fn along_row(&self) -> Vec3 {
        self.steps[0].as_vec3()
    }

    /// The order in which an axis is gone through so that what is near the viewer comes first: whether
    /// from its last voxel to its first.
    pub(super) fn reversed(&self) -> [bool; 3] {
        self.steps.map(|step| step.z > 0.0)
    }

    /// How far from its voxel's centre a disc can reach on the picture, pixels.
    pub(super) fn reach(&self, surface: &SemiBoundary) -> f32 {
        let voxel = surface.grid().spacing().max_element() as f32;
        // An offset is at most 127 steps of a hundredth of a voxel; the low pass adds less than a pixel.
        (RADIUS + 1.28) * voxel * self.pixels_per_mm + 2.0
    }

    /// How far from its centre what a voxel draws can reach on the picture, pixels.
    #[inline(always)]
    pub(super) fn disc_reach(&self, voxel: BoundaryVoxel) -> f32 {
        // A flat end is half a voxel away.
        let offset = (voxel.offset_steps() * self.offset_step).max(self.longest_radius / 2.0);
        (offset + self.longest_radius) * self.pixels_per_mm + 1.0
    }

    /// What a voxel draws, its centre at `at` on the picture. Of most it is drawn a little later, in the same order: not
    /// after [`Eye::flush`].
    #[inline(always)]
    pub(super) fn splats(
        &self,
        voxel: BoundaryVoxel,
        index: [usize; 3],
        at: Vec3,
        place: u32,
        to: &mut Splats,
    ) {
        let code = voxel.code();
        if code.faces() & self.not_away == 0 {
            return;
        }
        let near_end = self.ends.near(index);
        if near_end | code.is_cut() | code.is_thin() {
            self.flush(to);
            self.special(voxel, index, at, place, to);
            return;
        }
        let waiting = &mut to.waiting;
        let lane = waiting.count % WIDE;
        waiting.voxels[lane] = voxel;
        (waiting.at.x[lane], waiting.at.y[lane], waiting.at.z[lane]) = at.into();
        waiting.places[lane] = place;
        waiting.count = lane + 1;
        if waiting.count == WIDE {
            self.flush(to);
        }
    }

    /// Draws the voxels that wait.
    #[inline(always)]
    pub(super) fn flush(&self, to: &mut Splats) {
        let count = mem::take(&mut to.waiting.count);
        if count == 0 {
            return;
        }
        let Waiting {
            voxels, at, places, ..
        } = to.waiting;
        let mut offsets = [0.0; WIDE];
        for lane in 0..WIDE {
            offsets[lane] = voxels[lane].offset_steps() * self.offset_step;
        }
        let [x, y, z] = BoundaryVoxel::normals(&voxels);
        let seen = self.seen(&Three { x, y, z });
        let discs = self.discs(&seen, &offsets, RADIUS, &at);
        for lane in 0..count.min(WIDE) {
            if seen.z[lane] >= 0.0 {
                to.push(discs.splat(lane, places[lane]));
            }
        }
    }

    /// What a voxel draws that something thin or the end of what is drawn passes through.
    fn special(
        &self,
        voxel: BoundaryVoxel,
        index: [usize; 3],
        at: Vec3,
        place: u32,
        to: &mut Splats,
    ) {
        let near_end = self.ends.near(index);
        let normal = voxel.normal();
        if near_end {
            self.flat_ends(voxel, index, at, place, to);
        }
        if voxel.code().is_cut() {
            return;
        }
        let seen = self.seen_one(normal);
        let offset = voxel.offset_steps() * self.offset_step;
        if voxel.code().is_thin() {
            let (core, mut clips) = self.core(normal, seen, offset, at, place);
            if near_end {
                let [first, second, _] = self.clips(index, Vec3::ZERO, 0.0, 0.0);
                (clips[0], clips[1]) = (first, second);
            }
            to.push_clipped(core, clips);
        }
        if seen.z < 0.0 {
            return;
        }
        let splat = self.disc(seen, offset, RADIUS, at, place);
        if near_end {
            let clips = self.clips(index, normal * offset, splat.zx, splat.zy);
            to.push_clipped(splat, clips);
        } else {
            to.push(splat);
        }
    }

    /// Something a voxel thick has two surfaces, of which one normal tells one, or turns within a voxel by
    /// more than discs bridge. So its middle is drawn as well: a disc that faces the viewer, up to where the
    /// surface is known to be.
    fn core(&self, normal: Vec3, seen: Vec3, offset: f32, at: Vec3, place: u32) -> (Splat, Clips) {
        let mut splat = self.disc(Vec3::Z, 0.0, CORE_RADIUS, at, place);
        // Of the side that is not known, the mirror image is taken.
        splat.normal = Vec3::new(seen.x, seen.y, seen.z.abs());
        let right = -self.mm_per_pixel * self.right.dot(normal);
        let down = self.mm_per_pixel * self.up.dot(normal);
        // Where nothing is known of the surface, half a voxel or so.
        let room = offset.max(0.4 * self.ends.spacing.min_element());
        (splat, [ALL, ALL, [room, right, down]])
    }

    /// Vectors of the grid, as the viewer sees them: right, up, towards the viewer.
    #[inline(always)]
    fn seen<const N: usize>(&self, of: &Three<N>) -> Three<N> {
        let along = |axis: Vec3| {
            let mut found = [0.0; N];
            for lane in 0..N {
                found[lane] = of.x[lane] * axis.x + of.y[lane] * axis.y + of.z[lane] * axis.z;
            }
            found
        };
        Three {
            x: along(self.right),
            y: along(self.up),
            z: along(self.toward),
        }
    }

    fn seen_one(&self, vector: Vec3) -> Vec3 {
        self.seen(&Three::<1>::one(vector)).get(0)
    }

    /// The disc across a normal, `offset` mm along it from a voxel's centre.
    fn disc(&self, seen: Vec3, offset: f32, radius: f32, at: Vec3, place: u32) -> Splat {
        let discs = self.discs::<1>(&Three::one(seen), &[offset], radius, &Three::one(at));
        discs.splat(0, place)
    }

    /// The discs across normals, `offsets` mm along them from voxels' centres.
    #[inline(always)]
    fn discs<const N: usize>(
        &self,
        seen: &Three<N>,
        offsets: &[f32; N],
        radius: f32,
        at: &Three<N>,
    ) -> Discs<N> {
        let m = &self.metric;
        let mut discs = Discs::new(*at, *seen);
        for lane in 0..N {
            let offset = offsets[lane];
            let seen = seen.get(lane);
            let facing = if seen.z > LEAST_FACING {
                seen.z
            } else {
                LEAST_FACING
            };
            discs.centre.x[lane] += offset * seen.x * self.pixels_per_mm;
            discs.centre.y[lane] += -offset * seen.y * self.pixels_per_mm;
            discs.centre.z[lane] += offset * seen.z;
            let zx = -seen.x / facing * self.mm_per_pixel;
            let zy = seen.y / facing * self.mm_per_pixel;
            let a = m.rr + 2.0 * zx * m.rt + zx * zx * m.tt;
            let b = m.rd + zx * m.dt + zy * m.rt + zx * zy * m.tt;
            let c = m.dd + 2.0 * zy * m.dt + zy * zy * m.tt;
            // Widened by the low pass, as a covariance.
            let scale = radius * radius / (a * c - b * b);
            let (xx, xy, yy) = (c * scale, -b * scale, a * scale);
            // How depth goes with what lies on the picture, as covariances.
            let (xz, yz) = (zx * xx + zy * xy, zx * xy + zy * yy);
            let (xx, yy) = (xx + LOW_PASS, yy + LOW_PASS);
            let narrow = (xx - LOW_PASS) * (yy - LOW_PASS) - xy * xy;
            let det = xx * yy - xy * xy;
            let (a, b, c) = (yy / det, -xy / det, xx / det);
            // A disc that is seen edge on is as deep as its middle is wherever only the low pass has it reach: on
            // with its own slope it would stand out far before what is there.
            discs.zx[lane] = a * xz + b * yz;
            discs.zy[lane] = b * xz + c * yz;
            (discs.a[lane], discs.b[lane], discs.c[lane]) = (a, b, c);
            discs.half_width[lane] = xx.sqrt();
            discs.half_height[lane] = yy.sqrt();
            let share = narrow / det;
            discs.strength[lane] = if share > 0.0 { share } else { 0.0 }.sqrt();
        }
        discs
    }

    /// The flat faces of a voxel at the end of what is drawn. Where the surface passes through the voxel as
    /// well, they end at it.
    fn flat_ends(
        &self,
        voxel: BoundaryVoxel,
        index: [usize; 3],
        at: Vec3,
        place: u32,
        to: &mut Splats,
    ) {
        for (face, outward) in NeighbourCode::FACES.iter().enumerate() {
            let axis = face / 2;
            let end = if face % 2 == 0 {
                self.ends.first[axis]
            } else {
                self.ends.last[axis]
            };
            let exposed = voxel.code().faces() & self.looking & 1 << face != 0;
            if !exposed || index[axis] != end {
                continue;
            }
            let outward = Vec3::from_array(outward.map(f32::from));
            let offset = self.ends.spacing[axis] / 2.0;
            let rim = !voxel.code().is_cut();
            let radius = if rim { RADIUS } else { FLAT_RADIUS };
            let splat = self.disc(self.seen_one(outward), offset, radius, at, place | FLAT);
            if rim {
                let normal = voxel.normal();
                let surface = voxel.offset_steps() * self.offset_step;
                let along = |step: Vec3| -step.dot(normal);
                let right = self.right * self.mm_per_pixel + self.toward * splat.zx;
                let down = -self.up * self.mm_per_pixel + self.toward * splat.zy;
                let room = surface - (outward * offset).dot(normal);
                to.push_clipped(splat, [ALL, ALL, [room, along(right), along(down)]]);
            } else {
                to.push(splat);
            }
        }
    }

    /// Where the disc of a voxel near the end of what is drawn reaches beyond it. `from_centre` is the way
    /// from the voxel's centre to the disc's.
    #[inline(always)]
    fn clips(&self, index: [usize; 3], from_centre: Vec3, zx: f32, zy: f32) -> Clips {
        let Ends { first, last, .. } = self.ends;
        let mut clips = [ALL; 3];
        let mut used = clips.iter_mut().take(2);
        for axis in 0..3 {
            let spacing = self.ends.spacing[axis];
            let along_x = self.right[axis] * self.mm_per_pixel + zx * self.toward[axis];
            let along_y = -self.up[axis] * self.mm_per_pixel + zy * self.toward[axis];
            let below = index[axis].saturating_sub(first[axis]);
            let above = last[axis].saturating_sub(index[axis]);
            let (voxels, sign) = if below <= above {
                (below, 1.0)
            } else {
                (above, -1.0)
            };
            if voxels > 1 {
                continue;
            }
            // A little more, for the discs that lie in the end itself.
            let room = (voxels as f32 + 0.55) * spacing + sign * from_centre[axis];
            if let Some(clip) = used.next() {
                *clip = [room, sign * along_x, sign * along_y];
            }
        }
        clips
    }
}

impl Ends {
    /// Whether the disc of a voxel can reach beyond an end.
    #[inline(always)]
    fn near(&self, index: [usize; 3]) -> bool {
        (0..3).any(|axis| index[axis] <= self.first[axis] + 1 || index[axis] + 1 >= self.last[axis])
    }
}

impl<const N: usize> Three<N> {
    fn one(vector: Vec3) -> Self {
        Self {
            x: [vector.x; N],
            y: [vector.y; N],
            z: [vector.z; N],
        }
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }
}

impl<const N: usize> Default for Three<N> {
    fn default() -> Self {
        Self::one(Vec3::ZERO)
    }
}

/// Some [`Splat`]s, by component.
struct Discs<const N: usize> {
    centre: Three<N>,
    normal: Three<N>,
    zx: [f32; N],
    zy: [f32; N],
    a: [f32; N],
    b: [f32; N],
    c: [f32; N],
    half_width: [f32; N],
    half_height: [f32; N],
    strength: [f32; N],
}

impl<const N: usize> Discs<N> {
    #[inline(always)]
    fn new(centre: Three<N>, normal: Three<N>) -> Self {
        Self {
            centre,
            normal,
            zx: [0.0; N],
            zy: [0.0; N],
            a: [0.0; N],
            b: [0.0; N],
            c: [0.0; N],
            half_width: [0.0; N],
            half_height: [0.0; N],
            strength: [0.0; N],
        }
    }

    #[inline(always)]
    fn splat(&self, lane: usize, place: u32) -> Splat {
        Splat {
            x: self.centre.x[lane],
            y: self.centre.y[lane],
            z: self.centre.z[lane],
            zx: self.zx[lane],
            zy: self.zy[lane],
            a: self.a[lane],
            b: self.b[lane],
            c: self.c[lane],
            half_width: self.half_width[lane],
            half_height: self.half_height[lane],
            strength: self.strength[lane],
            place,
            normal: self.normal.get(lane),
            clips: UNCLIPPED,
        }
    }
}

impl Splat {
    /// First row, and one after the last, that the ellipse reaches into.
    #[inline(always)]
    pub(super) fn rows(&self) -> (isize, isize) {
        let begin = below(self.y - self.half_height);
        let end = below(self.y + self.half_height) + 1;
        (begin, end)
    }
}

/// The next whole number below, for what is more than -2¹⁶: without the call that `floor` is on a
/// processor that nothing more is known of.
#[inline(always)]
fn below(value: f32) -> isize {
    const LIFT: i32 = 1 << 16;
    ((value + LIFT as f32) as i32 - LIFT) as isize
}
