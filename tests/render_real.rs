//! What is drawn of two real scans, and which voxel is at a pixel.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test stops where something is wrong"
)]

mod real_data;

use rhinoplan::io::nifti;
use rhinoplan::render::{BACKGROUND, Camera, Direction, Frame, Object, Paint, SKIN, render};
use rhinoplan::segment::segment;
use rhinoplan::space::{ContinuousIndex, GridPoint};
use rhinoplan::surface::{Region, SemiBoundary, semi_boundary};
use rhinoplan::volume::{AnyVolume, Volume};

const SKIN_HU: f64 = -500.0;
const SIZE: usize = 512;

/// A scan of the real data, if it is there. Both hold 16-bit integers.
fn scan(name: &str) -> Option<Volume<i16>> {
    let path = real_data::path(name)?;
    let AnyVolume::I16(volume) = nifti::read(&path).unwrap().volume else {
        panic!("{name} does not hold 16-bit integers");
    };
    Some(volume)
}

fn skin(volume: &Volume<i16>, keep_largest: bool) -> SemiBoundary {
    let mask = segment(volume, SKIN_HU, keep_largest).unwrap();
    semi_boundary(volume, &mask, SKIN_HU, Region::whole(volume.grid())).unwrap()
}

/// The middle of the scan, or a point of it, within a square of `field_mm`.
fn camera(azimuth_deg: f64, centre: GridPoint, field_mm: f64) -> Camera {
    let from = Direction {
        azimuth_deg,
        elevation_deg: 0.0,
    };
    Camera::new(from, centre, field_mm, SIZE).unwrap()
}

fn middle(volume: &Volume<i16>) -> GridPoint {
    let last = volume.grid().last_index();
    volume.grid().index_to_grid(ContinuousIndex(last / 2.0))
}

fn drawn<'a>(surface: &'a SemiBoundary, camera: &Camera) -> Frame<'a> {
    let object = Object {
        surface,
        paint: Paint::Plain(SKIN),
        opacity: 1.0,
    };
    render(&[object], camera)
}

/// From the left, pixels that show something right of where plane `y` is seen: behind it.
fn behind(frame: &Frame<'_>, camera: &Camera, y: f64) -> usize {
    let plane = camera.project(GridPoint::new(0.0, y, 0.0)).x.ceil() as usize;
    let pixels = frame.pixels().iter().enumerate();
    let seen = pixels.filter(|(place, pixel)| place % SIZE >= plane && **pixel != BACKGROUND);
    seen.count()
}

#[test]
fn the_head_holder_of_cranium_does_not_show() {
    let Some(volume) = scan("cranium.nii.gz") else {
        return;
    };
    let spacing = volume.grid().spacing();
    // The occiput ends before plane 245; behind it is nothing but the holder (tests/segment_real.rs).
    let occiput = 245.5 * spacing.y;
    let side = camera(90.0, middle(&volume), 260.0);
    let front = camera(0.0, middle(&volume), 260.0);
    let [head, all] = [true, false].map(|keep_largest| skin(&volume, keep_largest));
    let [head_seen, all_seen] = [&head, &all].map(|surface| drawn(surface, &side));

    // Of the ten or so planes behind the head at least eight, in 100 of 108 slices.
    let pixel_mm2 = side.mm_per_pixel() * side.mm_per_pixel();
    let least = (8.0 * spacing.y * 100.0 * spacing.z / pixel_mm2) as usize;
    let shown = behind(&all_seen, &side, occiput);
    assert!(shown > least, "{shown} pixels of the holder, of {least}");
    assert_eq!(behind(&head_seen, &side, occiput), 0);
    // A third of the picture is head, all the same.
    assert!(head_seen.covered() > SIZE * SIZE / 3);

    // The holder is wider than the head where it lies beside it; from the front this is seen on either side.
    let [head_seen, all_seen] = [&head, &all].map(|surface| drawn(surface, &front));
    let pixels = head_seen.pixels().iter().zip(all_seen.pixels());
    let lost = pixels
        .clone()
        .filter(|(head, all)| **head == BACKGROUND && **all != BACKGROUND);
    let gained = pixels.filter(|(head, all)| **head != BACKGROUND && **all == BACKGROUND);
    let (lost, gained) = (lost.count(), gained.count());
    println!("from the front {lost} pixels show the holder or specks alone");
    assert!(lost > 20_000, "{lost}");
    assert_eq!(gained, 0);
}

/// The voxel at the pixel of a landmark is the landmark's, within this many voxels: they were set by eye, to
/// a voxel or so, and a tip may lie under the skin or in front of it.
const TIP_VOXELS: f64 = 2.0;

fn the_tip_is_picked(name: &str, tip: [f64; 3]) {
    let Some(volume) = scan(name) else {
        return;
    };
    let at = volume.grid().index_to_grid(ContinuousIndex::from(tip));
    let surface = skin(&volume, true);
    // From the front, half from either side, and from a little above: the tip faces all of them.
    for azimuth in [0.0, 45.0, -45.0, 20.0] {
        // Not in the middle of the picture, where a wrong scale would not be seen.
        let aside = GridPoint(at.0 + glam::DVec3::new(17.0, 5.0, 31.0));
        let camera = camera(azimuth, aside, 180.0);
        let pixel = camera.project(at);
        let frame = drawn(&surface, &camera);
        let hit = frame.pick(pixel.x as usize, pixel.y as usize);
        let hit = hit.unwrap_or_else(|| panic!("{name}, {azimuth}°: nothing at the tip"));
        let voxel = glam::DVec3::from_array(hit.voxel.map(|at| at as f64));
        let off = (voxel - glam::DVec3::from_array(tip)).length();
        println!(
            "{name}, {azimuth}°: {:?}, {off:.2} voxels from the tip",
            hit.voxel
        );
        assert!(off <= TIP_VOXELS, "{name}, {azimuth}°: {:?}", hit.voxel);
        assert_eq!(surface.index(hit.place), Some(hit.voxel));
    }
}

#[test]
fn the_tip_of_cranium_is_picked() {
    the_tip_is_picked("cranium.nii.gz", [128.0, 12.0, 24.0]);
}

#[test]
fn the_tip_of_headphantom_is_picked() {
    the_tip_is_picked("headphantom.nii.gz", [117.0, 15.0, 53.0]);
}
