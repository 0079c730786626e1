//! Slices of bodies whose edges are known.

use ndarray::Array3;

use super::*;
use crate::space::Grid;
use crate::volume::Rescale;

const SPACING: [f64; 3] = [0.8, 1.1, 2.0];

/// Tissue of 40 HU behind the plane y = `front` mm, as a linear ramp 2 mm wide.
fn wall(front: f64) -> Volume<i16> {
    let grid = Grid::axis_aligned([100, 80, 50], SPACING).unwrap();
    let samples = Array3::from_shape_fn((50, 80, 100), |(_, y, _)| {
        let depth = y as f64 * SPACING[1] - front;
        ((depth / 4.4 + 0.5).clamp(0.0, 1.0) * 1040.0 - 1000.0).round() as i16
    });
    Volume::new(grid, Rescale::NONE, samples).unwrap()
}

fn view(plane: Plane) -> SliceView<'static> {
    SliceView {
        plane,
        tip: GridPoint::new(40.0, 30.0, 50.0),
        offset_mm: 0.0,
        nose: NoseBox {
            min: GridPoint::new(25.0, 25.0, 35.0),
            max: GridPoint::new(55.0, 55.0, 65.0),
        },
        skin_hu: -480.0,
        title: "smaller: reduce",
    }
}

/// Where the panels begin and how large they are.
fn layout(plane: Plane) -> (Frame, [u32; 2]) {
    let settings = SliceSettings::default();
    let frame = Frame::new(wall(30.0).grid(), &view(plane), &settings).unwrap();
    let content = 2 * (NUMBERS + frame.columns) + GAP + RIGHT;
    let start = (content.max(LEAST_WIDTH) - content) / 2 + NUMBERS;
    (frame, [start, start + frame.columns + GAP + NUMBERS])
}

#[test]
fn tissue_is_grey_air_is_black_and_the_skin_is_where_it_is() {
    let (before, after) = (wall(30.0), wall(36.0));
    let picture = slice(
        &before,
        &after,
        &view(Plane::Sagittal),
        &SliceSettings::default(),
    )
    .unwrap();
    let (frame, starts) = layout(Plane::Sagittal);
    // A row free of letters, box and tip.
    let row = HEADER + frame.place(GridPoint::new(40.0, 0.0, 70.0))[1] as u32;
    let column = |panel: usize, y_mm: f64| {
        let [x, _] = frame.place(GridPoint::new(40.0, y_mm, 70.0));
        starts[panel] + x as u32
    };
    let at = |panel, y_mm| picture.get_pixel(column(panel, y_mm), row).0;
    for panel in [0, 1] {
        assert_eq!(at(panel, 10.0), [0; 3], "air");
        // 40 HU is the middle of the window.
        assert_eq!(at(panel, 60.0), [128; 3], "tissue");
        assert!(is(at(panel, 30.0), BEFORE), "{:?}", at(panel, 30.0));
        assert!(is(at(panel, 36.0), AFTER), "{:?}", at(panel, 36.0));
        // Contours are lines: a millimetre beside them there is none.
        for y in [29.0, 31.0, 35.0, 37.0] {
            let [red, green, blue] = at(panel, y);
            assert!(red == green && green == blue, "{y}");
        }
    }
}

/// Whether a pixel is mostly of a colour: its centre may be half a pixel off the line.
fn is(pixel: [u8; 3], colour: Colour) -> bool {
    let off = |(a, b): (u8, u8)| a.abs_diff(b) <= 45;
    pixel.into_iter().zip(colour).all(off)
}

#[test]
fn a_contour_has_the_width_that_it_should() {
    let (frame, _) = layout(Plane::Sagittal);
    let contour = Panel::new(&wall(30.0), &frame).contour(-480.0);
    let mut picture = RgbImage::new(frame.columns, frame.rows);
    panel::blend(&mut picture, &contour, [255; 3]);
    let covered: f64 = (0..frame.columns)
        .map(|x| f64::from(picture.get_pixel(x, 100).0[0]) / 255.0)
        .sum();
    assert!((covered - 1.7).abs() < 0.05, "{covered}");
}

#[test]
fn a_millimetre_is_as_long_down_as_across_and_sides_are_where_they_should_be() {
    for plane in [Plane::Sagittal, Plane::Coronal, Plane::Axial] {
        let (frame, _) = layout(plane);
        let [x, y] = frame.place(view(plane).tip);
        let steps = [[10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]].map(|step| {
            let [to_x, to_y] = frame.place(view(plane).tip + GridVector::from(step));
            [to_x - x, to_y - y]
        });
        let long = steps.iter().flatten().fold(0.0_f64, |a, b| a.max(b.abs()));
        let expected = match plane {
            Plane::Sagittal => [[0.0, 0.0], [long, 0.0], [0.0, -long]],
            Plane::Coronal => [[long, 0.0], [0.0, 0.0], [0.0, -long]],
            Plane::Axial => [[long, 0.0], [0.0, long], [0.0, 0.0]],
        };
        for (found, expected) in steps.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - expected).abs() < 1e-9, "{plane:?}: {steps:?}");
        }
        assert_eq!(frame.columns.max(frame.rows), 520);
    }
}

#[test]
fn the_same_bytes_again_and_no_markup_from_a_title() {
    let (before, after) = (wall(30.0), wall(36.0));
    let mut view = view(Plane::Axial);
    view.title = "<script>&\"</script>\0 and a title that goes on and on and on and on and on and on, and on";
    let make = || slice(&before, &after, &view, &SliceSettings::default()).unwrap();
    assert_eq!(make(), make());
}

#[test]
fn what_cannot_be_shown_is_an_error() {
    let volume = wall(30.0);
    let good = (view(Plane::Sagittal), SliceSettings::default());
    let fails = |change: &dyn Fn(&mut SliceView<'_>, &mut SliceSettings)| {
        let (mut view, mut settings) = good;
        change(&mut view, &mut settings);
        slice(&volume, &volume, &view, &settings).unwrap_err()
    };
    fails(&|view, _| view.tip.0.x = -1.0);
    fails(&|view, _| view.tip.0.x = 80.0);
    fails(&|view, _| view.offset_mm = 60.0);
    fails(&|view, _| view.offset_mm = f64::NAN);
    fails(&|view, _| view.tip.0.z = f64::NAN);
    fails(&|view, _| view.skin_hu = f64::INFINITY);
    fails(&|view, _| view.nose.max.0.y = f64::NAN);
    fails(&|_, settings| settings.width_hu = 0.0);
    fails(&|_, settings| settings.level_hu = f64::NAN);
    fails(&|_, settings| settings.margin_mm = -1.0);
    fails(&|_, settings| settings.panel_pixels = 0);
    fails(&|_, settings| settings.panel_pixels = u32::MAX);
    let away = fails(&|view, _| {
        view.nose.min.0.z = 5000.0;
        view.nose.max.0.z = 5050.0;
    });
    assert!(matches!(away, PictureError::Empty { .. }));
    let other = Volume::<i16>::zeros(
        Grid::axis_aligned([100, 80, 51], SPACING).unwrap(),
        Rescale::NONE,
    );
    let error = slice(&volume, &other.unwrap(), &good.0, &good.1).unwrap_err();
    assert!(matches!(error, PictureError::Grids));
}

#[test]
fn values_that_are_no_numbers_are_black_and_far_tips_do_no_harm() {
    let grid = Grid::axis_aligned([3, 3, 3], [10.0; 3]).unwrap();
    let nothing = Array3::from_elem((3, 3, 3), f64::NAN);
    let volume = Volume::new(grid, Rescale::NONE, nothing).unwrap();
    let mut view = view(Plane::Coronal);
    view.tip = GridPoint::new(1e15, 10.0, -1e300);
    view.nose.min = GridPoint::new(-1e300, 0.0, 0.0);
    let picture = slice(&volume, &volume, &view, &SliceSettings::default()).unwrap();
    assert_eq!(picture.get_pixel(200, HEADER + 100).0, [0; 3]);
}
