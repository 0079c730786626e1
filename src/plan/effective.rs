//! The plan with every value that a run of it used, as a plan.
//!
//! What a plan gives stands here as it gives it, in its unit and its frame: it is read to the same bits, so a run of
//! this plan gives the same bytes. What a plan does not give is filled in. What a run only then finds out, such as
//! the millimetres of a length in voxels, stands behind the value as a comment.

use std::fmt::Write as _;
use std::path::Path;

use super::raw::{Frame, RawCt, RawEdit, RawLength, RawPlan, RawVary, RawVector};
use super::resolve;
use super::resolved::{
    Clip, Crop, MeshSettings, Method, Model, Outputs, Plan, STANDARD_VIEWS, SkinThreshold,
    Tolerance, Views,
};
use crate::compare::{Accept, Limit, Quantity};
use crate::feature::{Edit, Landmark};
use crate::space::Grid;

/// What the name of a CT can end with, by which it is read; a folder of slices and one of them have none.
const CT_ENDINGS: [&str; 3] = [".nii.gz", ".nii", ".nrrd"];

/// What a run found out that the plan does not say.
#[derive(Debug, Clone, Copy)]
pub struct Found<'a> {
    /// The grid of the CT.
    pub grid: &'a Grid,
    /// SHA-256 of the CT's content, hexadecimal.
    pub ct_sha256: &'a str,
    /// Where tissue began, HU.
    pub skin_hu: f64,
}

/// A number with the decimals that bring back all of its bits.
fn number(number: f64) -> String {
    format!("{number:?}")
}

fn text(text: &str) -> String {
    toml::Value::from(text).to_string()
}

fn triple(point: [f64; 3]) -> String {
    format!("[{}]", point.map(number).join(", "))
}

fn words<'a>(words: impl IntoIterator<Item = &'a str>) -> String {
    let words: Vec<String> = words.into_iter().map(text).collect();
    format!("[{}]", words.join(", "))
}

/// Text that grows table by table.
#[derive(Default)]
struct Document(String);

impl Document {
    fn line(&mut self, line: &str) {
        self.0.push_str(line);
        self.0.push('\n');
    }

    fn table(&mut self, header: &str) {
        // Writing into a string cannot fail.
        let _ = write!(self.0, "\n{header}\n");
    }

    fn key(&mut self, key: &str, value: impl AsRef<str>) {
        self.noted(key, value, None);
    }

    /// A key whose value has a comment.
    fn noted(&mut self, key: &str, value: impl AsRef<str>, note: Option<String>) {
        let note = note.map_or(String::new(), |note| format!(" # {note}"));
        let _ = writeln!(self.0, "{key} = {}{note}", value.as_ref());
    }

    fn optional(&mut self, key: &str, value: Option<String>) {
        if let Some(value) = value {
            self.key(key, value);
        }
    }
}

/// The text of the plan that `raw` became; none where something in it could not be decoded, which no plan that ran
/// can have. `ran` is the plan as it ran, its landmarks moved where it asks for that.
pub(super) fn plan(raw: &RawPlan, ran: &Plan, found: Found<'_>) -> Option<String> {
    let mut to = Document::default();
    to.line("# A plan with every value that its run used, defaults included.");
    to.key("plan", super::format::FORMAT.to_string());
    to.key("name", text(&ran.name));
    to.optional("title", ran.title.as_deref().map(text));
    ct(raw.ct.as_ref()?, found, &mut to);
    landmarks(raw, ran, found.grid, &mut to)?;
    cage(raw, ran, &mut to);
    to.table("[f1]");
    let nasal_bones = raw.landmarks.points.get(Landmark::NasalBones).as_ref();
    let root = raw.f1_root.as_ref().or(nasal_bones)?;
    to.key("root", triple(root.value));
    to.key("kind", text(raw.f1_kind.name()));
    settings(ran, found, &mut to);
    candidates(raw, &mut to)?;
    outputs(ran.outputs, &mut to);
    if let Some(given) = &ran.views {
        views(given, &mut to);
    }
    if let Some(MeshSettings {
        triangles: Some(most),
    }) = ran.mesh
    {
        to.table("[mesh]");
        to.key("triangles", most.to_string());
    }
    if let Some(limits) = &ran.accept {
        accept(limits, &mut to);
    }
    Some(to.0)
}

/// What the CT is called in an effective plan: its own name can be the patient's.
fn neutral_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.to_ascii_lowercase();
    let ending = CT_ENDINGS.into_iter().find(|ending| name.ends_with(ending));
    format!("ct{}", ending.unwrap_or_default())
}

fn ct(ct: &RawCt, found: Found<'_>, to: &mut Document) {
    to.table("[ct]");
    match ct {
        RawCt::File { path, series, .. } => {
            to.line("# Names are left out, as they can be a patient's: put the CT at this path, or put its own path here.");
            to.key("path", text(&neutral_name(path)));
            if series.is_some() {
                to.line("# series: the one of the plan; needed where the folder holds several.");
            }
            to.key("sha256", text(found.ct_sha256));
        }
        RawCt::Phantom(phantom) => to.key("phantom", text(phantom.name())),
    }
}

/// The points as they were before any was moved: the plan moves them again.
fn landmarks(raw: &RawPlan, ran: &Plan, grid: &Grid, to: &mut Document) -> Option<()> {
    let frame: Frame = raw.landmarks.frame?;
    to.table("[landmarks]");
    to.key("frame", text(frame.name()));
    for landmark in Landmark::ALL {
        let given = raw.landmarks.points.get(landmark).as_ref()?.value;
        let ran = *ran.landmarks.get(landmark);
        let is_moved = ran != resolve::to_grid(given, frame, grid);
        let note = is_moved.then(|| {
            let [x, y, z] = resolve::from_grid(ran, frame, grid);
            format!("moved onto the skin, to [{x:.3}, {y:.3}, {z:.3}]")
        });
        to.noted(landmark.name(), triple(given), note);
    }
    let snap = raw.landmarks.snap_mm;
    to.optional("snap", snap.map(|mm| format!("{{ mm = {} }}", number(mm))));
    Some(())
}

fn cage(raw: &RawPlan, ran: &Plan, to: &mut Document) {
    to.table("[cage]");
    match raw.cage_depth {
        Some(RawLength::Voxels(voxels)) => {
            let note = format!("{:.3} mm", ran.cage_depth_mm);
            to.noted("depth", length("voxels", voxels), Some(note));
        }
        _ => to.key("depth", length("mm", ran.cage_depth_mm)),
    }
}

fn length(unit: &str, value: f64) -> String {
    format!("{{ {unit} = {} }}", number(value))
}

/// `[enhance]`, `[segment]` and `[morph]`.
fn settings(ran: &Plan, found: Found<'_>, to: &mut Document) {
    let enhance = ran.enhance;
    if enhance.median.is_some() || enhance.smooth_mm.is_some() {
        to.table("[enhance]");
        to.optional("median", enhance.median.map(|side| side.to_string()));
        let sigma = enhance.smooth_mm.map(|sigma| length("mm", sigma));
        to.optional("smooth", sigma);
    }
    to.table("[segment]");
    match ran.segment.skin_hu {
        SkinThreshold::Hu(hu) => to.key("skin_hu", number(hu)),
        SkinThreshold::Otsu => {
            let note = format!("{} HU in this CT", number(found.skin_hu));
            to.noted("skin_hu", text(SkinThreshold::OTSU), Some(note));
        }
    }
    to.key("bone_hu", number(ran.segment.bone_hu));
    to.key("keep_largest", ran.segment.keep_largest.to_string());
    let morph = ran.morph;
    to.table("[morph]");
    to.key("model", text(morph.model.name()));
    to.key("scale", text(morph.scale.name()));
    to.key("method", text(morph.method.name()));
    if let Method::Adaptive { tolerance } = morph.method {
        let tolerance = match tolerance {
            Tolerance::Mm(mm) => length("mm", mm),
            Tolerance::Voxels(voxels) => length("voxels", voxels),
        };
        to.key("tolerance", tolerance);
        to.key("compare_exact", morph.compare_exact.to_string());
    }
    if let Model::Local { margin_mm } = morph.model {
        to.key("margin", length("mm", margin_mm));
    }
}

fn candidates(raw: &RawPlan, to: &mut Document) -> Option<()> {
    // Those of sweeps are made again.
    for candidate in raw.candidates.iter().filter(|of| of.swept.is_empty()) {
        to.table("[[candidate]]");
        to.key("name", text(candidate.name.as_deref()?));
        to.optional("title", candidate.title.as_deref().map(text));
        for stage in &candidate.stages {
            to.table("[[candidate.stage]]");
            to.key("name", text(stage.name.as_deref()?));
            to.key("kind", text(stage.kind.unwrap_or(raw.f1_kind).name()));
            let edits = stage.edits.iter();
            let edits: Vec<String> = edits
                .map(|edit| self::edit(edit.as_ref()?.value))
                .collect::<Option<_>>()?;
            to.key("f1", format!("[{}]", edits.join(", ")));
        }
    }
    for sweep in &raw.sweeps {
        to.table("[[sweep]]");
        to.key("candidate", text(&sweep.candidate));
        to.key("name", text(&sweep.name));
        for RawVary {
            stage,
            edit,
            axis,
            values,
        } in &sweep.vary
        {
            to.table("[[sweep.vary]]");
            to.key("stage", text(stage));
            to.key("edit", text(edit));
            to.optional("axis", axis.map(text));
            let values: Vec<String> = values.iter().copied().map(number).collect();
            to.key("values", format!("[{}]", values.join(", ")));
        }
    }
    Some(())
}

fn edit(edit: RawEdit) -> Option<String> {
    let vector = |vector| match vector {
        RawVector::Mm(mm) => format!("{{ mm = {} }}", triple(mm)),
        RawVector::Voxels(voxels) => format!("{{ voxels = {} }}", triple(voxels)),
    };
    let (name, value) = match edit {
        RawEdit::MoveTip(by) => ("move_tip", vector(by)),
        RawEdit::MoveRoot(by) => ("move_root", vector(by)),
        RawEdit::TipTo(at) => ("tip_to", triple(at)),
        RawEdit::RootTo(at) => ("root_to", triple(at)),
        RawEdit::Word(Edit::Project(mm)) => ("project", number(mm)),
        RawEdit::Word(Edit::Rotate(degrees)) => ("rotate", number(degrees)),
        RawEdit::Word(Edit::Lengthen(mm)) => ("lengthen", number(mm)),
        RawEdit::Word(Edit::Deviate(mm)) => ("deviate", number(mm)),
        RawEdit::Word(Edit::Width(factor)) => ("width", number(factor)),
        // In grid millimetres, which no plan writes.
        RawEdit::Word(Edit::MoveTip(_) | Edit::MoveRoot(_) | Edit::TipTo(_) | Edit::RootTo(_)) => {
            return None;
        }
    };
    Some(format!("{{ {name} = {value} }}"))
}

fn outputs(outputs: Outputs, to: &mut Document) {
    let Outputs {
        volume,
        nrrd,
        displacement,
        views,
        slices,
        charts,
        mesh,
        solids,
        inverse,
    } = outputs;
    let words_of = super::format::OUTPUT_WORDS;
    let asked = words_of.iter().filter(|(_, output)| {
        use super::format::Output;
        match output {
            Output::Volume => volume,
            Output::Nrrd => nrrd,
            Output::Displacement => displacement,
            Output::Views => views,
            Output::Slices => slices,
            Output::Charts => charts,
            Output::Mesh => mesh,
            Output::Solids => solids,
            Output::Inverse => inverse,
        }
    });
    let asked: Vec<&str> = asked.map(|(word, _)| *word).collect();
    // An empty list is a fault: tables alone are what a plan without [outputs] writes.
    if !asked.is_empty() {
        to.table("[outputs]");
        to.key("write", words(asked));
    }
}

fn views(views: &Views, to: &mut Document) {
    let is_standard = |name: &str| STANDARD_VIEWS.iter().any(|view| view.name == name);
    let (standard, own): (Vec<_>, Vec<_>) = views
        .cameras
        .iter()
        .partition(|camera| is_standard(&camera.name));
    to.table("[views]");
    to.key(
        "names",
        words(standard.iter().map(|view| view.name.as_str())),
    );
    to.key("size", views.size.to_string());
    to.key(
        "objects",
        words(views.objects.iter().map(|drawn| drawn.object.name())),
    );
    let opacities: Vec<String> = views
        .objects
        .iter()
        .map(|drawn| format!("{} = {}", drawn.object.name(), number(drawn.opacity)))
        .collect();
    to.key("opacity", format!("{{ {} }}", opacities.join(", ")));
    let word = |crop: Crop| {
        let words = super::format::CROPS;
        let word = words.iter().find(|(_, known)| *known == crop);
        word.map(|(word, _)| text(word))
    };
    to.optional(
        "crop",
        match views.crop {
            Crop::Mm(side) => Some(length("mm", side)),
            crop => word(crop),
        },
    );
    match views.clip {
        Clip::None => {}
        Clip::Nose => to.key("clip", text("nose")),
        Clip::Plane {
            plane,
            offset_mm,
            keep,
        } => to.key(
            "clip",
            format!(
                "{{ plane = {}, offset = {}, keep = {} }}",
                text(plane.name()),
                number(offset_mm),
                text(keep.name())
            ),
        ),
    }
    for camera in own {
        to.table("[[views.camera]]");
        to.key("name", text(&camera.name));
        to.key("azimuth", number(camera.azimuth_deg));
        to.key("elevation", number(camera.elevation_deg));
    }
}

fn accept(accept: &Accept, to: &mut Document) {
    to.table("[accept]");
    // Those of a measure are beside each other.
    for of_measure in accept.limits.chunk_by(|a, b| a.measure == b.measure) {
        let Some(first) = of_measure.first() else {
            continue;
        };
        let mut parts = Vec::new();
        for Limit { of, min, max, .. } in of_measure {
            let ends = [("min", *min), ("max", *max)];
            let both = ends.map(|(_, end)| end.map(number));
            match (of, both) {
                (Quantity::Value, _) => {
                    let given = ends.into_iter().filter_map(|(key, end)| Some((key, end?)));
                    parts.extend(given.map(|(key, end)| format!("{key} = {}", number(end))));
                }
                (Quantity::Change, [Some(least), Some(most)]) => {
                    parts.push(format!("change = [{least}, {most}]"));
                }
                (Quantity::ChangePercent, [Some(least), Some(most)]) => {
                    parts.push(format!("change_percent = [{least}, {most}]"));
                }
                // A change has both ends.
                _ => {}
            }
        }
        to.key(first.measure.name, format!("{{ {} }}", parts.join(", ")));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_a_ct_is_left_out_but_for_its_kind() {
        for (path, shown) in [
            ("doe-jane.nii.gz", "ct.nii.gz"),
            ("../DOE/JANE.NII", "ct.nii"),
            ("/home/someone/cts/jane.nrrd", "ct.nrrd"),
            ("Doe^Jane/", "ct"),
            ("slices/Doe^Jane.dcm", "ct"),
            ("/", "ct"),
            ("..", "ct"),
        ] {
            assert_eq!(neutral_name(Path::new(path)), shown);
        }
    }

    #[test]
    fn values_are_written_as_toml_reads_them() {
        let read = |value: &str| -> toml::Value {
            let table: toml::Table = format!("a = {value}").parse().unwrap();
            table["a"].clone()
        };
        for value in [0.1, -0.0, 1e300, 5e-324, 20.0, -1234.5678, 1e16] {
            let read = read(&number(value)).as_float().unwrap();
            assert_eq!(read.to_bits(), value.to_bits());
        }
        for value in [
            "",
            "a",
            "it's",
            "\"quoted\"",
            "it's \"both\" \\ # é",
            "a\u{7f}",
        ] {
            assert_eq!(read(&text(value)).as_str(), Some(value));
        }
    }
}
