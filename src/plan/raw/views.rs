//! `[views]` and its cameras.

use std::collections::HashSet;

use super::super::decode::{Faults, Table, Value, describe, one_of, quote};
use super::super::diagnostic::{Code, Fault};
use super::super::format::{
    self, AZIMUTH_DEG, CLIPS, CROP_MM, CROPS, ELEVATION_DEG, MAX_CAMERAS, OBJECTS, OFFSET_MM,
    OPACITIES, PLANES, Range, SIDES, SIZES, VIEW_WORDS,
};
use super::super::resolved::{
    Camera, Clip, Crop, CutPlane, DrawnObject, Object, Outputs, STANDARD_VIEWS, Side, Views,
};
use super::candidates::{tables, unique};
use super::name;
use super::settings::{measured, note_twice};

/// What pictures show; none where there are none. `outputs` is none where it is at fault.
pub(super) fn views(
    plan: &Table<'_, '_>,
    outputs: Option<Outputs>,
    faults: &mut Faults,
) -> Option<Views> {
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
    let table = faults.table(value, &format::VIEWS)?;
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
    let mut cameras: Vec<Camera> = Vec::new();
    for item in items {
        let Some(view) = faults.word(item, what, &VIEW_WORDS) else {
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
    let header = format::CAMERA.name;
    let mut names = HashSet::new();
    tables(value, header, MAX_CAMERAS, faults)
        .iter()
        .filter_map(|item| {
            let table = faults.table(item, &format::CAMERA)?;
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
            let azimuth = angle(&table, "azimuth", AZIMUTH_DEG, faults);
            let elevation = angle(&table, "elevation", ELEVATION_DEG, faults);
            Some(Camera {
                name: name?,
                azimuth_deg: azimuth?,
                elevation_deg: elevation?,
            })
        })
        .collect()
}

/// A required angle of a camera, degrees.
fn angle(
    camera: &Table<'_, '_>,
    key: &'static str,
    range: Range,
    faults: &mut Faults,
) -> Option<f64> {
    let expected = format!("a number of degrees {range}");
    let Some(value) = camera.get(key) else {
        faults.missing(camera, key, &expected);
        return None;
    };
    let what = format!("`views.camera.{key}`");
    faults.number_in(value, &what, &expected, range)
}

fn size_of(value: &Value<'_>, faults: &mut Faults) -> Option<u32> {
    let expected = format!("a whole number of pixels {SIZES}");
    let size = faults.integer_in(value, "`views.size`", &expected, SIZES)?;
    u32::try_from(size).ok()
}

/// What is drawn, each object with its opacity.
fn objects(views: &Table<'_, '_>, faults: &mut Faults) -> Vec<DrawnObject> {
    let mut drawn = Views::default().objects;
    let mut sound = true;
    if let Some(value) = views.get("objects") {
        drawn.clear();
        let what = "`views.objects`";
        let expected = "an array of \"skin\" or \"bone\", each once";
        for item in faults.array(value, what, expected).unwrap_or_default() {
            let Some(object) = faults.word(item, what, &OBJECTS) else {
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
    let opacity = views.get("opacity");
    let opacity = opacity.and_then(|value| faults.table(value, &format::OPACITY));
    let Some(opacity) = opacity else {
        return drawn;
    };
    for object in [Object::Skin, Object::Bone] {
        let name = object.name();
        let Some(value) = opacity.get(name) else {
            continue;
        };
        let what = format!("`views.opacity.{name}`");
        let expected = format!("a number {OPACITIES}; 1 lets nothing through");
        let given = faults.number_in(value, &what, &expected, OPACITIES);
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
    let names = CROPS.map(|(name, _)| quote(name, '"'));
    let forms = format!("{} or {{ mm = … }}", names.join(", "));
    let written = value.get_ref();
    if !written.is_table() {
        if written.is_float() || written.is_integer() {
            let hint = format!("say the unit: {{ mm = {} }}", describe(value));
            faults.wrong_type(value, what, &forms, Some(hint));
            return None;
        }
        return faults.word_or(value, what, &CROPS, &forms);
    }
    let expected = format!("a side {CROP_MM} mm");
    let (_, side) = measured(value, what, &["mm"], &expected, CROP_MM, faults)?;
    Some(Crop::Mm(side))
}

fn clip(views: &Table<'_, '_>, faults: &mut Faults) -> Option<Clip> {
    let value = views.get("clip")?;
    let what = "`views.clip`";
    if !value.get_ref().is_table() {
        let forms = "\"nose\" or { plane = …, keep = … }";
        return faults.word_or(value, what, &CLIPS, forms);
    }
    let table = faults.table(value, &format::CLIP)?;
    let plane = match table.get("plane") {
        Some(value) => faults.word(value, "`views.clip.plane`", &PLANES),
        None => {
            let names = PLANES.map(|(name, _)| name);
            faults.missing(&table, "plane", &one_of(&names, '"'));
            None
        }
    };
    let offset_mm = match table.get("offset") {
        Some(value) => {
            let expected = format!("a number of mm {OFFSET_MM}");
            faults.number_in(value, "`views.clip.offset`", &expected, OFFSET_MM)
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
    let expected = match plane {
        Some(plane) => one_of(&plane.sides().map(Side::name), '"'),
        None => one_of(&SIDES.map(|(name, _)| name), '"'),
    };
    let Some(value) = clip.get("keep") else {
        faults.missing(clip, "keep", &expected);
        return None;
    };
    let side = faults.word(value, "`views.clip.keep`", &SIDES)?;
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
