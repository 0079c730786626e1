//! `[views]` and its cameras.

use std::collections::HashSet;

use super::super::decode::{Faults, Table, Value, describe, one_of, quote};
use super::super::diagnostic::{Code, Fault};
use super::super::resolved::{
    Camera, Clip, Crop, CutPlane, DrawnObject, Object, Outputs, STANDARD_VIEWS, Side, Views,
};
use super::candidates::{tables, unique};
use super::name;
use super::settings::{measured, note_twice};

/// Sides of a picture, pixels: smaller ones show no nose, larger ones fill the memory.
const SIZES: std::ops::RangeInclusive<i64> = 256..=4096;
/// The most cameras beside the standard ones.
const MAX_CAMERAS: usize = 16;
/// Sides of the square that a picture shows, mm.
const CROP_MM: std::ops::RangeInclusive<f64> = 20.0..=1000.0;
/// The largest distance from the tip to a cut, mm.
const MAX_OFFSET_MM: f64 = 500.0;

/// What pictures show; none where there are none. `outputs` is none where it is at fault.
pub(super) fn views(
    plan: &Table<'_, '_>,
    outputs: Option<Outputs>,
    faults: &mut Faults,
) -> Option<Views> {
    let known = [
        "names", "size", "objects", "opacity", "crop", "clip", "camera",
    ];
    let Some(value) = plan.get("views") else {
        let asked = outputs.is_some_and(|outputs| outputs.views);
        return asked.then(Views::default);
    };
    if outputs.is_some_and(|outputs| !outputs.views) {
        let message = "[views] is given, but no views are written";
        let fault = Fault::new(Code::Conflict, plan.key_place("views"), message);
        let hint = "add \"views\" to `outputs.write`, or remove [views]".to_owned();
        let fault = fault.found("[views] without the output \"views\"");
        faults.push(
            fault
                .expected("\"views\" in `outputs.write` of [outputs]")
                .hint(hint),
        );
    }
    let table = faults.table(value, "[views]", &known)?;
    let defaults = Views::default();
    let mut cameras = standard(&table, faults);
    cameras.extend(own(&table, faults));
    let size = table.get("size");
    let size = size.and_then(|value| size_of(value, faults));
    Some(Views {
        cameras,
        size: size.unwrap_or(defaults.size),
        objects: objects(&table, faults),
        crop: crop(&table, faults).unwrap_or(defaults.crop),
        clip: clip(&table, faults).unwrap_or(defaults.clip),
    })
}

/// The standard views that the plan names: all where it names none.
fn standard(views: &Table<'_, '_>, faults: &mut Faults) -> Vec<Camera> {
    let Some(value) = views.get("names") else {
        return STANDARD_VIEWS.iter().map(Camera::from).collect();
    };
    let what = "`views.names`";
    let names = STANDARD_VIEWS.map(|view| view.name);
    let expected = format!(
        "an array of {}; an empty one only beside a [[views.camera]]",
        one_of(&names, '"')
    );
    // With cameras of its own a plan may do without these.
    let is_empty = value.get_ref().as_array().is_some_and(|a| a.is_empty());
    if is_empty && views.get("camera").is_some() {
        return Vec::new();
    }
    let Some(items) = faults.array(value, what, &expected) else {
        return Vec::new();
    };
    let words = STANDARD_VIEWS.each_ref().map(|view| (view.name, view));
    let mut cameras: Vec<Camera> = Vec::new();
    for item in items {
        let Some(view) = faults.word(item, what, &words) else {
            continue;
        };
        let is_there = cameras.iter().any(|camera| camera.name == view.name);
        if note_twice(item, what, is_there, "view", faults) {
            cameras.push(Camera::from(view));
        }
    }
    cameras
}

/// The plan's own cameras.
fn own(views: &Table<'_, '_>, faults: &mut Faults) -> Vec<Camera> {
    let Some(value) = views.get("camera") else {
        return Vec::new();
    };
    let header = "[[views.camera]]";
    let mut names = HashSet::new();
    tables(value, header, MAX_CAMERAS, faults)
        .iter()
        .filter_map(|item| {
            let table = faults.table(item, header, &["name", "azimuth", "elevation"])?;
            let mut name = name(&table, "`views.camera.name`", faults);
            let is_standard = |name: &str| STANDARD_VIEWS.iter().any(|view| view.name == name);
            if let Some(taken) = name.take_if(|name| is_standard(&name.value)) {
                let shown = format!("\"{}\"", taken.value);
                let message = format!("{shown} cannot name a camera: it is a standard view");
                let fault = Fault::new(Code::DuplicateName, taken.span, message);
                let hint = "a standard view is drawn where `views.names` names it".to_owned();
                faults.push(fault.found(shown).expected("another name").hint(hint));
            }
            let name = unique(name, "camera", &mut names, faults);
            let azimuth = angle(&table, "azimuth", 180.0, faults);
            let elevation = angle(&table, "elevation", 90.0, faults);
            Some(Camera {
                name: name?,
                azimuth_deg: azimuth?,
                elevation_deg: elevation?,
            })
        })
        .collect()
}

/// A required angle of a camera, at most `most` degrees on either side of 0.
fn angle(camera: &Table<'_, '_>, key: &'static str, most: f64, faults: &mut Faults) -> Option<f64> {
    let expected = format!("a number of degrees from -{most} to {most}");
    let Some(value) = camera.get(key) else {
        faults.missing(camera, key, &expected);
        return None;
    };
    let what = format!("`views.camera.{key}`");
    faults.number_where(value, &what, &expected, |degrees| degrees.abs() <= most)
}

fn size_of(value: &Value<'_>, faults: &mut Faults) -> Option<u32> {
    let (least, most) = SIZES.into_inner();
    let expected = format!("a whole number of pixels from {least} to {most}");
    let valid = |size| SIZES.contains(&size);
    let size = faults.integer_where(value, "`views.size`", &expected, valid)?;
    u32::try_from(size).ok()
}

/// What is drawn, each object with its opacity.
fn objects(views: &Table<'_, '_>, faults: &mut Faults) -> Vec<DrawnObject> {
    let mut drawn = Views::default().objects;
    let mut sound = true;
    if let Some(value) = views.get("objects") {
        drawn.clear();
        let what = "`views.objects`";
        let words = [Object::Skin, Object::Bone].map(|object| (object.name(), object));
        let expected = "an array of \"skin\" or \"bone\", each once";
        for item in faults.array(value, what, expected).unwrap_or_default() {
            let Some(object) = faults.word(item, what, &words) else {
                sound = false;
                continue;
            };
            let is_there = drawn.iter().any(|drawn| drawn.object == object);
            if note_twice(item, what, is_there, "object", faults) {
                drawn.push(DrawnObject {
                    object,
                    opacity: 1.0,
                });
            }
        }
        sound &= !drawn.is_empty();
    }
    let known = [Object::Skin, Object::Bone].map(Object::name);
    let opacity = views.get("opacity");
    let opacity = opacity.and_then(|value| faults.table(value, "`views.opacity`", &known));
    let Some(opacity) = opacity else {
        return drawn;
    };
    for object in [Object::Skin, Object::Bone] {
        let name = object.name();
        let Some(value) = opacity.get(name) else {
            continue;
        };
        let what = format!("`views.opacity.{name}`");
        let expected = "a number above 0, at most 1; 1 lets nothing through";
        let valid = |opacity: f64| opacity > 0.0 && opacity <= 1.0;
        let given = faults.number_where(value, &what, expected, valid);
        match drawn.iter_mut().find(|drawn| drawn.object == object) {
            Some(drawn) => drawn.opacity = given.unwrap_or(drawn.opacity),
            // Where the objects are at fault, it is not known which are drawn.
            None if sound => {
                let message = format!("{what} is given, but \"{name}\" is not drawn");
                let fault = Fault::new(Code::Conflict, opacity.key_place(name), message);
                let hint = format!("add \"{name}\" to `views.objects`, or remove its opacity");
                let fault = fault.found(format!("an opacity of \"{name}\""));
                let expected = "opacities of objects that `views.objects` names";
                faults.push(fault.expected(expected).hint(hint));
            }
            None => {}
        }
    }
    drawn
}

fn crop(views: &Table<'_, '_>, faults: &mut Faults) -> Option<Crop> {
    let value = views.get("crop")?;
    let what = "`views.crop`";
    let words = [
        ("face", Crop::Face),
        ("head", Crop::Head),
        ("nose", Crop::Nose),
    ];
    let names = words.map(|(name, _)| quote(name, '"'));
    let forms = format!("{} or {{ mm = … }}", names.join(", "));
    let written = value.get_ref();
    if !written.is_table() {
        if written.is_float() || written.is_integer() {
            let hint = format!("say the unit: {{ mm = {} }}", describe(value));
            faults.wrong_type(value, what, &forms, Some(hint));
            return None;
        }
        return faults.word_or(value, what, &words, &forms);
    }
    let (least, most) = CROP_MM.into_inner();
    let expected = format!("a side from {least} to {most} mm");
    let valid = |side: f64| CROP_MM.contains(&side);
    let (_, side) = measured(value, what, &["mm"], &expected, valid, faults)?;
    Some(Crop::Mm(side))
}

fn clip(views: &Table<'_, '_>, faults: &mut Faults) -> Option<Clip> {
    let value = views.get("clip")?;
    let what = "`views.clip`";
    if !value.get_ref().is_table() {
        let forms = "\"nose\" or { plane = …, keep = … }";
        return faults.word_or(value, what, &[("nose", Clip::Nose)], forms);
    }
    let table = faults.table(value, what, &["plane", "offset", "keep"])?;
    let planes = [CutPlane::Sagittal, CutPlane::Coronal, CutPlane::Axial];
    let planes = planes.map(|plane| (plane.name(), plane));
    let plane = match table.get("plane") {
        Some(value) => faults.word(value, "`views.clip.plane`", &planes),
        None => {
            let names = planes.map(|(name, _)| name);
            faults.missing(&table, "plane", &one_of(&names, '"'));
            None
        }
    };
    let offset_mm = match table.get("offset") {
        Some(value) => {
            let expected = format!("a number of mm from -{MAX_OFFSET_MM} to {MAX_OFFSET_MM}");
            let valid = |mm: f64| mm.abs() <= MAX_OFFSET_MM;
            faults.number_where(value, "`views.clip.offset`", &expected, valid)
        }
        None => Some(0.0),
    };
    let keep = keep(&table, plane, faults);
    Some(Clip::Plane {
        plane: plane?,
        offset_mm: offset_mm?,
        keep: keep?,
    })
}

/// The side of a cut that is drawn; `plane` is none where it is at fault.
fn keep(clip: &Table<'_, '_>, plane: Option<CutPlane>, faults: &mut Faults) -> Option<Side> {
    let all = [
        Side::Left,
        Side::Right,
        Side::Anterior,
        Side::Posterior,
        Side::Superior,
        Side::Inferior,
    ];
    let expected = match plane {
        Some(plane) => one_of(&plane.sides().map(Side::name), '"'),
        None => one_of(&all.map(Side::name), '"'),
    };
    let Some(value) = clip.get("keep") else {
        faults.missing(clip, "keep", &expected);
        return None;
    };
    let words = all.map(|side| (side.name(), side));
    let side = faults.word(value, "`views.clip.keep`", &words)?;
    if let Some(plane) = plane
        && !plane.sides().contains(&side)
    {
        let message = format!("a {} plane has no such side", plane.name());
        let fault = Fault::new(Code::Conflict, value.span().into(), message);
        let found = format!("{} with `plane = \"{}\"`", describe(value), plane.name());
        let hint = format!("write `keep` as {expected}, or another `plane`");
        faults.push(fault.found(found).expected(expected).hint(hint));
        return None;
    }
    Some(side)
}
