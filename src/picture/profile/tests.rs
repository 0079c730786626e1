//! Profiles of noses made up.

use super::*;
use crate::picture::rasterize;

const P1: GridPoint = GridPoint::new(60.0, 35.0, 80.0);
const P2: GridPoint = GridPoint::new(62.0, 30.0, 40.0);

fn nose(tip: [f64; 3]) -> NoseGeometry {
    NoseGeometry {
        tip: GridPoint::from(tip),
        gamma_deg: 101.25,
        height_mm: 38.0 - tip[1],
    }
}

/// A straight nose from P1 over a tip to P2.
fn skin(tip: [f64; 3]) -> Vec<GridPoint> {
    (0..=160)
        .map(|n| {
            let z = 40.0 + 0.25 * f64::from(n);
            let (end, from) = if z > tip[2] { (P1, tip) } else { (P2, tip) };
            let share = (z - from[2]) / (end.0.z - from[2]);
            GridPoint::new(61.0, from[1] + (end.0.y - from[1]) * share, z)
        })
        .collect()
}

fn plot<'a>(stages: &'a [ProfileStage<'a>]) -> ProfilePlot<'a> {
    ProfilePlot {
        title: "<script>&\"'</script>",
        nasal_bones: P1,
        lip: P2,
        base_y: 38.0,
        plane_x: ProfilePlot::middle_plane(P1, P2),
        stages,
    }
}

/// Values of attributes of the lines that begin with a tag.
fn attributes<const N: usize>(svg: &str, tag: &str, names: [&str; N]) -> Vec<[f64; N]> {
    let value = |line: &str, name: &str| -> Option<f64> {
        let start = line.find(&format!(" {name}=\""))? + name.len() + 3;
        let rest = line.get(start..)?;
        rest.get(..rest.find('"')?)?.parse().ok()
    };
    let lines = svg.lines().filter(|line| line.starts_with(tag));
    lines
        .filter_map(|line| {
            let values: Option<Vec<f64>> = names.iter().map(|name| value(line, name)).collect();
            values?.try_into().ok()
        })
        .collect()
}

#[test]
fn a_millimetre_is_as_long_across_as_up_and_anterior_is_left() {
    let tip = [61.0, 12.0, 52.0];
    let skin = skin(tip);
    let stages = [ProfileStage {
        name: "preoperative",
        skin: &skin,
        nose: nose(tip),
    }];
    let svg = plot(&stages).svg().unwrap();
    let circles = attributes(&svg, "<circle", ["cx", "cy"]);
    let [p1, p2, p5] = [circles[0], circles[1], circles[2]];
    let up = (p2[1] - p1[1]) / (P1.0.z - P2.0.z);
    let across = (p2[0] - p5[0]) / (P2.0.y - tip[1]);
    // The library puts points on quarters of a pixel, 500 pixels apart.
    assert!((up / across - 1.0).abs() < 1.5e-3, "{up} {across}");
    assert!(p5[0] < p2[0] && p2[0] < p1[0], "anterior to the left");
    // And so it is for the numbers along the axes: h is where the base plane's 0 and the tip's numbers are.
    let base = attributes(&svg, "<line", ["x1", "stroke-dasharray"]);
    assert!(base.is_empty(), "two numbers are no number");
    let scale = across;
    let dashed = svg.lines().find(|line| line.contains("dasharray")).unwrap();
    let x1 = attributes(dashed, "<line", ["x1"])[0][0];
    assert!(((x1 - p5[0]) / scale - stages[0].nose.height_mm).abs() < 0.05);
}

#[test]
fn the_axes_numbers_stand_where_they_say() {
    let tip = [61.0, 12.0, 52.0];
    let stages = [ProfileStage {
        name: "preoperative",
        skin: &[],
        nose: nose(tip),
    }];
    let svg = plot(&stages).svg().unwrap();
    let lines: Vec<&str> = svg.lines().collect();
    // Numbers are text with the library's marks, each followed by its content.
    let number = |wanted: &str, axis: &str| {
        let mut place = lines
            .windows(2)
            .filter(|pair| pair[0].starts_with("<text") && pair[1] == wanted)
            .filter(|pair| pair[0].contains(if axis == "x" { "middle" } else { "\"end\"" }))
            .map(|pair| attributes(pair[0], "<text", [axis])[0][0] / f64::from(FINE));
        place.next_back().unwrap()
    };
    let circles = attributes(&svg, "<circle", ["cx", "cy"]);
    let [p1, p2, p5] = [circles[0], circles[1], circles[2]];
    let scale = (p2[1] - p1[1]) / 40.0;
    // 0 mm above P2 and 20 mm in front of the base plane, 6 mm behind the tip; half a pixel.
    assert!((number("0", "y") - p2[1]).abs() <= 0.5);
    assert!((number("40", "y") - p1[1]).abs() <= 0.5);
    assert!((number("20", "x") - (p5[0] + 6.0 * scale)).abs() <= 0.6);
}

#[test]
fn one_or_many_stages_and_any_names() {
    let tips: Vec<[f64; 3]> = (0..40)
        .map(|n| [61.0 + f64::from(n), 12.0 + 0.3 * f64::from(n), 52.0])
        .collect();
    let skins: Vec<Vec<GridPoint>> = tips.iter().map(|&tip| skin(tip)).collect();
    let stages: Vec<ProfileStage<'_>> = tips
        .iter()
        .zip(&skins)
        .map(|(&tip, skin)| ProfileStage {
            name: "a stage & its very long <name>, which is cut somewhere",
            skin,
            nose: nose(tip),
        })
        .collect();
    for count in [1, 2, 12, 24, 25, 40] {
        let svg = plot(&stages[..count]).svg().unwrap();
        assert_eq!(svg, plot(&stages[..count]).svg().unwrap());
        assert!(
            svg.contains("&lt;script&gt;") && !svg.contains("<script") && !svg.contains("<name")
        );
        assert!(rasterize(&svg, 0.5).is_ok());
    }
    assert!(matches!(plot(&[]).svg(), Err(PictureError::Empty { .. })));
}

#[test]
fn gaps_are_not_bridged_and_what_is_no_number_is_left_out() {
    let tip = [61.0, 12.0, 52.0];
    let mut points = skin(tip);
    points.drain(40..60);
    points[100].0.y = f64::NAN;
    let stages = [ProfileStage {
        name: "one",
        skin: &points,
        nose: nose(tip),
    }];
    let plot = plot(&stages);
    let frame = Frame::new(&plot, &stages).unwrap();
    let runs = frame.runs(&points);
    let lengths: Vec<usize> = runs.iter().map(Vec::len).collect();
    assert_eq!(lengths, [40, 60, 40]);
    assert!(!plot.svg().unwrap().contains("NaN"));
}

#[test]
fn positions_that_are_none_are_errors_and_odd_ones_are_drawn() {
    let draw = |tip: [f64; 3], base_y: f64| {
        let stages = [ProfileStage {
            name: "one",
            skin: &[],
            nose: nose(tip),
        }];
        let svg = ProfilePlot {
            base_y,
            ..plot(&stages)
        }
        .svg();
        svg.map(|svg| assert!(rasterize(&svg, 0.5).is_ok() && !svg.contains("NaN")))
    };
    assert!(draw([61.0, f64::NAN, 50.0], 38.0).is_err());
    assert!(draw([61.0, 12.0, 1e9], 38.0).is_err());
    assert!(draw([61.0, 12.0, 50.0], f64::INFINITY).is_err());
    // Behind the base plane, on P1, a kilometre... well, metres away.
    for tip in [
        [61.0, 60.0, 50.0],
        [60.0, 35.0, 80.0],
        [61.0, -9000.0, 9000.0],
    ] {
        draw(tip, 38.0).unwrap();
    }
}

#[test]
fn the_arc_runs_from_one_side_to_the_other() {
    let arc = layout::arc((0.0, 0.0), (10.0, 10.0), (10.0, -10.0));
    let (first, middle, last) = (arc[0], arc[arc.len() / 2], arc[arc.len() - 1]);
    let radius = 0.22 * 200.0_f64.sqrt();
    assert!((first.0 - first.1).abs() < 1e-12 && (last.0 + last.1).abs() < 1e-12);
    assert!((middle.0 - radius).abs() < 1e-12 && middle.1.abs() < 1e-12);
    assert!(layout::arc((0.0, 0.0), (0.0, 0.0), (1.0, 0.0)).is_empty());
}
