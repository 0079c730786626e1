//! `[cage]`, `[enhance]`, `[segment]`, `[morph]`, `[outputs]` and `[mesh]`.

use super::super::decode::{Faults, Table, Value, describe, one_of};
use super::super::diagnostic::{Code, Fault};
use super::super::format::{
    self, HU, LENGTH, MEDIAN, METHODS, MODELS, MethodWord, ModelWord, OUTPUT_WORDS, Output, Range,
    SCALES, SIGMA_MM, SNAP_MM, THRESHOLDS, TRIANGLES,
};
use super::super::resolved::{
    DEFAULT_BONE_HU, DEFAULT_MARGIN_MM, DEFAULT_SKIN_HU, DEFAULT_TOLERANCE, Enhance, MeshSettings,
    Method, Model, Morph, Outputs, Scale, Segment, SkinThreshold, Tolerance,
};

/// A length in the unit in which it is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) enum RawLength {
    Mm(f64),
    Voxels(f64),
}

/// A positive length, `{ mm = … }` or, where `units` has it, `{ voxels = … }`.
fn length(
    value: &Value<'_>,
    what: &'static str,
    units: &[&'static str],
    faults: &mut Faults,
) -> Option<RawLength> {
    let expected = format!("a number {LENGTH}");
    let (unit, number) = measured(value, what, units, &expected, LENGTH, faults)?;
    Some(match unit {
        "voxels" => RawLength::Voxels(number),
        _ => RawLength::Mm(number),
    })
}

/// A number with its unit, one of `units`.
pub(super) fn measured(
    value: &Value<'_>,
    what: &'static str,
    units: &[&'static str],
    expected: &str,
    range: Range,
    faults: &mut Faults,
) -> Option<(&'static str, f64)> {
    let forms: Vec<String> = units
        .iter()
        .map(|unit| format!("{{ {unit} = … }}"))
        .collect();
    let forms = forms.join(" or ");
    let number = describe(value);
    let bare = value.get_ref().is_float() || value.get_ref().is_integer();
    let hint = bare.then(|| format!("say the unit: {}", forms.replace('…', &number)));
    let (unit, number) = faults.choice(value, what, units, &forms, hint)?;
    let number = faults.number_in(number, what, expected, range)?;
    Some((unit, number))
}

/// `landmarks.snap`, mm.
pub(super) fn snap(landmarks: &Table<'_, '_>, faults: &mut Faults) -> Option<f64> {
    let value = landmarks.get("snap")?;
    let expected = format!("a number {SNAP_MM} mm");
    let snap = measured(
        value,
        "`landmarks.snap`",
        &["mm"],
        &expected,
        SNAP_MM,
        faults,
    );
    snap.map(|(_, mm)| mm)
}

pub(super) fn cage_depth(plan: &Table<'_, '_>, faults: &mut Faults) -> Option<RawLength> {
    let table = faults.table(plan.get("cage")?, &format::CAGE)?;
    length(
        table.get("depth")?,
        "`cage.depth`",
        &["mm", "voxels"],
        faults,
    )
}

pub(super) fn enhance(plan: &Table<'_, '_>, faults: &mut Faults) -> Enhance {
    let mut enhance = Enhance::default();
    let table = plan.get("enhance");
    let Some(table) = table.and_then(|value| faults.table(value, &format::ENHANCE)) else {
        return enhance;
    };
    if let Some(value) = table.get("median") {
        let expected = format!("{MEDIAN}, the side of the window in voxels");
        let side = faults.integer_in(value, "`enhance.median`", &expected, MEDIAN);
        enhance.median = side.and_then(|side| usize::try_from(side).ok());
    }
    if let Some(value) = table.get("smooth") {
        let expected = format!("a sigma {SIGMA_MM} mm");
        let what = "`enhance.smooth`";
        let sigma = measured(value, what, &["mm"], &expected, SIGMA_MM, faults);
        enhance.smooth_mm = sigma.map(|(_, sigma)| sigma);
    }
    enhance
}

pub(super) fn segment(plan: &Table<'_, '_>, faults: &mut Faults) -> Segment {
    let defaults = Segment {
        skin_hu: SkinThreshold::Hu(DEFAULT_SKIN_HU),
        bone_hu: DEFAULT_BONE_HU,
        keep_largest: true,
    };
    let table = plan.get("segment");
    let Some(table) = table.and_then(|value| faults.table(value, &format::SEGMENT)) else {
        return defaults;
    };
    let keep_largest = table.get("keep_largest");
    let keep_largest =
        keep_largest.and_then(|value| faults.boolean(value, "`segment.keep_largest`"));
    let skin = match table.get("skin_hu") {
        Some(value) => skin(value, faults),
        None => Some(defaults.skin_hu),
    };
    let bone = match table.get("bone_hu") {
        Some(value) => {
            let expected = format!("a number of HU {HU}");
            faults.number_in(value, "`segment.bone_hu`", &expected, HU)
        }
        None => Some(defaults.bone_hu),
    };
    let (Some(skin_hu), Some(bone_hu)) = (skin, bone) else {
        return defaults;
    };
    if let SkinThreshold::Hu(skin_hu) = skin_hu
        && bone_hu <= skin_hu
    {
        let key = match table.get("bone_hu") {
            Some(_) => "bone_hu",
            None => "skin_hu",
        };
        let fault = Fault::new(
            Code::BadValue,
            table.place(key),
            "the bone threshold is not above the skin threshold",
        );
        let found = format!("skin_hu = {skin_hu}, bone_hu = {bone_hu}");
        let expected = "`bone_hu` above `skin_hu`";
        faults.push(fault.found(found).expected(expected));
    }
    Segment {
        skin_hu,
        bone_hu,
        keep_largest: keep_largest.unwrap_or(defaults.keep_largest),
    }
}

/// A number of HU, or the word for the method that finds one.
fn skin(value: &Value<'_>, faults: &mut Faults) -> Option<SkinThreshold> {
    let what = "`segment.skin_hu`";
    let word = SkinThreshold::OTSU;
    let expected = format!("a number of HU {HU}, or \"{word}\"");
    if value.get_ref().is_str() {
        return faults.word_or(value, what, &THRESHOLDS, &expected);
    }
    let hu = faults.number_in(value, what, &expected, HU)?;
    Some(SkinThreshold::Hu(hu))
}

pub(super) fn morph(plan: &Table<'_, '_>, faults: &mut Faults) -> Morph {
    let defaults = Morph {
        model: Model::Local {
            margin_mm: DEFAULT_MARGIN_MM,
        },
        scale: Scale::Full,
        method: Method::Adaptive {
            tolerance: DEFAULT_TOLERANCE,
        },
        compare_exact: false,
    };
    let table = plan.get("morph");
    let Some(table) = table.and_then(|value| faults.table(value, &format::MORPH)) else {
        return defaults;
    };
    let scale = table.get("scale");
    let scale = scale.and_then(|value| faults.word(value, "`morph.scale`", &SCALES));
    let compare = table.get("compare_exact");
    let compare = compare.and_then(|value| faults.boolean(value, "`morph.compare_exact`"));
    Morph {
        model: model(&table, faults).unwrap_or(defaults.model),
        scale: scale.unwrap_or(defaults.scale),
        method: method(&table, faults).unwrap_or(defaults.method),
        compare_exact: compare.unwrap_or(defaults.compare_exact),
    }
}

fn model(table: &Table<'_, '_>, faults: &mut Faults) -> Option<Model> {
    let word = match table.get("model") {
        Some(value) => faults.word(value, "`morph.model`", &MODELS),
        None => Some(ModelWord::Local),
    };
    let margin_mm = match table.get("margin") {
        Some(value) => match length(value, "`morph.margin`", &["mm"], faults) {
            Some(RawLength::Mm(mm) | RawLength::Voxels(mm)) => mm,
            None => DEFAULT_MARGIN_MM,
        },
        None => DEFAULT_MARGIN_MM,
    };
    if word == Some(ModelWord::Lee2001) && table.get("margin").is_some() {
        let message = "`morph.margin` belongs to model \"local\"; \"lee2001\" is global";
        let fault = Fault::new(Code::Conflict, table.key_place("margin"), message);
        let fault = fault.found("`margin` with `model = \"lee2001\"`");
        let hint = "remove `margin`, or write `model = \"local\"`".to_owned();
        faults.push(fault.expected("no `margin`").hint(hint));
    }
    Some(match word? {
        ModelWord::Local => Model::Local { margin_mm },
        ModelWord::Lee2001 => Model::Lee2001,
    })
}

fn method(table: &Table<'_, '_>, faults: &mut Faults) -> Option<Method> {
    let word = match table.get("method") {
        Some(value) => faults.word(value, "`morph.method`", &METHODS),
        None => Some(MethodWord::Adaptive),
    };
    let tolerance = match table.get("tolerance") {
        Some(value) => match length(value, "`morph.tolerance`", &["mm", "voxels"], faults) {
            Some(RawLength::Mm(mm)) => Tolerance::Mm(mm),
            Some(RawLength::Voxels(voxels)) => Tolerance::Voxels(voxels),
            None => DEFAULT_TOLERANCE,
        },
        None => DEFAULT_TOLERANCE,
    };
    if word == Some(MethodWord::Exact) {
        for (key, why) in [
            ("tolerance", "\"exact\" approximates nothing"),
            ("compare_exact", "\"exact\" is what it compares with"),
        ] {
            if table.get(key).is_some() {
                let message = format!("`morph.{key}` belongs to method \"adaptive\"; {why}");
                let fault = Fault::new(Code::Conflict, table.key_place(key), message);
                let fault = fault.found(format!("`{key}` with `method = \"exact\"`"));
                let hint = format!("remove `{key}`, or write `method = \"adaptive\"`");
                faults.push(fault.expected(format!("no `{key}`")).hint(hint));
            }
        }
    }
    Some(match word? {
        MethodWord::Adaptive => Method::Adaptive { tolerance },
        MethodWord::Exact => Method::Exact,
    })
}

/// What is to be written; none where that is at fault.
pub(super) fn outputs(plan: &Table<'_, '_>, faults: &mut Faults) -> Option<Outputs> {
    let mut outputs = Outputs::default();
    let Some(value) = plan.get("outputs") else {
        return Some(outputs);
    };
    let table = faults.table(value, &format::OUTPUTS)?;
    let Some(value) = table.get("write") else {
        return Some(outputs);
    };
    let what = "`outputs.write`";
    let available = one_of(&OUTPUT_WORDS.map(|(word, _)| word), '"');
    let expected = format!("an array of {available}; without [outputs], only tables are written");
    let mut sound = true;
    for item in faults.array(value, what, &expected)? {
        let Some(output) = faults.word(item, what, &OUTPUT_WORDS) else {
            sound = false;
            continue;
        };
        let asked = match output {
            Output::Volume => &mut outputs.volume,
            Output::Nrrd => &mut outputs.nrrd,
            Output::Displacement => &mut outputs.displacement,
            Output::Views => &mut outputs.views,
            Output::Slices => &mut outputs.slices,
            Output::Charts => &mut outputs.charts,
            Output::Mesh => &mut outputs.mesh,
            Output::Solids => &mut outputs.solids,
            Output::Inverse => &mut outputs.inverse,
        };
        sound &= note_twice(item, what, *asked, "output", faults);
        *asked = true;
    }
    sound.then_some(outputs)
}

/// How meshes are made; none where there are none. `outputs` is none where it is at fault.
pub(super) fn mesh(
    plan: &Table<'_, '_>,
    outputs: Option<Outputs>,
    faults: &mut Faults,
) -> Option<MeshSettings> {
    let asked = outputs.is_some_and(|outputs| outputs.mesh);
    let Some(value) = plan.get("mesh") else {
        return asked.then(MeshSettings::default);
    };
    if outputs.is_some() && !asked {
        let message = "[mesh] is given, but no meshes are written";
        let fault = Fault::new(Code::Conflict, plan.key_place("mesh"), message);
        let hint = "add \"mesh\" to `outputs.write`, or remove [mesh]".to_owned();
        let fault = fault.found("[mesh] without the output \"mesh\"");
        faults.push(
            fault
                .expected("\"mesh\" in `outputs.write` of [outputs]")
                .hint(hint),
        );
    }
    let table = faults.table(value, &format::MESH)?;
    let triangles = table.get("triangles").and_then(|value| {
        let expected = format!("an integer {TRIANGLES}");
        faults.integer_in(value, "`mesh.triangles`", &expected, TRIANGLES)
    });
    Some(MeshSettings {
        triangles: triangles.and_then(|triangles| usize::try_from(triangles).ok()),
    })
}

/// Notes an item of an array that is there already; whether it is the first of its kind.
pub(super) fn note_twice(
    item: &Value<'_>,
    what: &str,
    is_there: bool,
    kind: &str,
    faults: &mut Faults,
) -> bool {
    if is_there {
        let message = format!("{what} names {} twice", describe(item));
        let fault = Fault::new(Code::DuplicateName, item.span().into(), message);
        faults.push(
            fault
                .found(describe(item))
                .expected(format!("each {kind} once")),
        );
    }
    !is_there
}
