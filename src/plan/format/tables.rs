//! The tables of a plan, from the inside out.

use super::super::resolved::{
    DEFAULT_BONE_HU, DEFAULT_CAGE_DEPTH_MM, DEFAULT_MARGIN_MM, DEFAULT_SKIN_HU,
    DEFAULT_TOLERANCE_MM, DEFAULT_VIEW_SIZE,
};
use super::words::names;
use super::{
    AXES, AZIMUTH_DEG, CLIPS, CROP_MM, CROPS, ELEVATION_DEG, FRAMES, Given, HU, KINDS, Key, Kind,
    LENGTH, MAX_CAMERAS, MAX_CANDIDATES, MAX_EDITS, MAX_STAGES, MAX_SWEEPS, MAX_VALUES, MAX_VARIED,
    MEDIAN, METHODS, MODELS, OBJECTS, OFFSET_MM, OPACITIES, OUTPUT_WORDS, PHANTOMS, PLANES,
    PREOPERATIVE, ROTATION_DEG, SCALES, SIDES, SIGMA_MM, SIZES, SNAP_MM, STEPS, SWEPT_EDITS,
    THRESHOLDS, TRIANGLES, TableFormat, VIEW_WORDS, WIDTH,
};
use crate::compare::{BareNumber, COUNT, MEASURES, Measure};
use crate::feature::Landmark;

const PHANTOM_NAMES: [&str; 1] = names(&PHANTOMS);
const FRAME_NAMES: [&str; 3] = names(&FRAMES);
const KIND_NAMES: [&str; 2] = names(&KINDS);
const THRESHOLD_NAMES: [&str; 1] = names(&THRESHOLDS);
const MODEL_NAMES: [&str; 2] = names(&MODELS);
const SCALE_NAMES: [&str; 2] = names(&SCALES);
const METHOD_NAMES: [&str; 2] = names(&METHODS);
const OUTPUT_NAMES: [&str; 9] = names(&OUTPUT_WORDS);
const VIEW_NAMES: [&str; 6] = names(&VIEW_WORDS);
const OBJECT_NAMES: [&str; 2] = names(&OBJECTS);
const CROP_NAMES: [&str; 3] = names(&CROPS);
const CLIP_NAMES: [&str; 1] = names(&CLIPS);
const PLANE_NAMES: [&str; 3] = names(&PLANES);
const SIDE_NAMES: [&str; 6] = names(&SIDES);
const SWEPT_EDIT_NAMES: [&str; 7] = names(&SWEPT_EDITS);
const AXIS_NAMES: [&str; 3] = names(&AXES);

const MM: &[&str] = &["mm"];
const MM_OR_VOXELS: &[&str] = &["mm", "voxels"];

const fn key(name: &'static str, kind: Kind, given: Given, about: &'static str) -> Key {
    Key {
        name,
        kind,
        given,
        about,
    }
}

const fn point(landmark: Landmark, about: &'static str) -> Key {
    key(landmark.name(), Kind::Point, Given::Optional, about)
}

/// The plan itself.
pub(in super::super) static PLAN: TableFormat = TableFormat {
    name: "the plan",
    about: "A plan of rhinoplan: a CT, six landmarks on it, and the noses to compute.",
    keys: &[
        key(
            "plan",
            Kind::Version,
            Given::Required,
            "Version of the format: 1.",
        ),
        key(
            "name",
            Kind::Name(&[]),
            Given::Required,
            "Names the output folder: a-z, 0-9 and -, not beginning with -, at most 64 characters.",
        ),
        key(
            "title",
            Kind::Title,
            Given::Optional,
            "Free text of one line, at most 200 characters.",
        ),
        key(
            "ct",
            Kind::Table(&CT),
            Given::Required,
            "The voxels: exactly one of `path` and `phantom`.",
        ),
        key(
            "landmarks",
            Kind::Table(&LANDMARKS),
            Given::Required,
            "Six points: either `frame` and all six, or `file`.",
        ),
        key(
            "cage",
            Kind::Table(&CAGE),
            Given::Optional,
            "Where the head is held still.",
        ),
        key(
            "f1",
            Kind::Table(&F1),
            Given::Optional,
            "The line that is edited, from its root to the tip of the nose.",
        ),
        key(
            "enhance",
            Kind::Table(&ENHANCE),
            Given::Optional,
            "Noise: what surfaces are found in is smoothed first, the median before the Gaussian. What is written and \
             measured is the CT as it is.",
        ),
        key(
            "segment",
            Kind::Table(&SEGMENT),
            Given::Optional,
            "Thresholds of skin and bone.",
        ),
        key(
            "morph",
            Kind::Table(&MORPH),
            Given::Optional,
            "How the volume is morphed.",
        ),
        key(
            "candidate",
            Kind::Tables(&CANDIDATE, MAX_CANDIDATES),
            Given::Required,
            "The noses, 1 to 1000: each begins with the nose as it is.",
        ),
        key(
            "sweep",
            Kind::Tables(&SWEEP, MAX_SWEEPS),
            Given::Optional,
            "Further noses: those of a candidate with numbers of its edits varied.",
        ),
        key(
            "outputs",
            Kind::Table(&OUTPUTS),
            Given::Optional,
            "Files beside the tables, which are always written.",
        ),
        key(
            "views",
            Kind::Table(&VIEWS),
            Given::Optional,
            "Pictures of the nose: only where `outputs.write` has \"views\".",
        ),
        key(
            "mesh",
            Kind::Table(&MESH),
            Given::Optional,
            "Surfaces: only where `outputs.write` has \"mesh\".",
        ),
        key(
            "accept",
            Kind::Table(&ACCEPT),
            Given::Optional,
            "Limits that a candidate must keep after its last stage.",
        ),
    ],
};

pub(in super::super) static CT: TableFormat = TableFormat {
    name: "[ct]",
    about: "The voxels: exactly one of `path` and `phantom`.",
    keys: &[
        key(
            "path",
            Kind::Path,
            Given::Optional,
            "The volume: a NIfTI-1 or NRRD file, a folder of DICOM slices, or one slice of it. Relative to the plan file.",
        ),
        key(
            "phantom",
            Kind::Word(&PHANTOM_NAMES),
            Given::Optional,
            "The built-in synthetic head, with the size and landmarks of the paper.",
        ),
        key(
            "sha256",
            Kind::Sha256,
            Given::Optional,
            "With `path` only: 64 hexadecimal digits, as `rhinoplan info` shows them. Another content is refused.",
        ),
        key(
            "series",
            Kind::Uid,
            Given::Optional,
            "With a folder only: the SeriesInstanceUID to read, where there are several. `rhinoplan info FOLDER` lists them.",
        ),
    ],
};

pub(in super::super) static LANDMARKS: TableFormat = TableFormat {
    name: "[landmarks]",
    about: "Six points: either `frame` and all six, or `file`.",
    keys: &[
        key(
            "frame",
            Kind::Word(&FRAME_NAMES),
            Given::Optional,
            "What the numbers of all points mean: \"voxel\" (from 0, to the patient's left, posterior, superior), \"lps\" \
             or \"ras\" (mm).",
        ),
        point(
            Landmark::NasalBones,
            "Top of the nose, on the nasal bones; upper end of the measured region. In `frame`.",
        ),
        point(
            Landmark::Lip,
            "The white line of the lip; lower end of the measured region. In `frame`.",
        ),
        point(
            Landmark::AlareRight,
            "The outermost point of the wing on the patient's right. In `frame`.",
        ),
        point(
            Landmark::AlareLeft,
            "The outermost point of the wing on the patient's left. In `frame`.",
        ),
        point(Landmark::Tip, "Tip of the nose (pronasale). In `frame`."),
        point(
            Landmark::Maxilla,
            "Places the base plane, the coronal plane on which the nose stands. In `frame`.",
        ),
        key(
            "file",
            Kind::Path,
            Given::Optional,
            "3D Slicer markups (.mrk.json, .fcsv), in place of the frame and all points. Relative to the plan file.",
        ),
        key(
            "snap",
            Kind::Measured(MM, SNAP_MM),
            Given::Optional,
            "How far a landmark of the skin may be moved onto it, mm: above 0, at most 10. Default: none is moved.",
        ),
    ],
};

pub(in super::super) static CAGE: TableFormat = TableFormat {
    name: "[cage]",
    about: "Where the head is held still.",
    keys: &[key(
        "depth",
        Kind::Measured(MM_OR_VOXELS, LENGTH),
        Given::Mm(DEFAULT_CAGE_DEPTH_MM),
        "From the base plane to the back of the box that is held, in mm or in voxels along y: above 0, at most 1000. \
         Default: 11 mm.",
    )],
};

pub(in super::super) static F1: TableFormat = TableFormat {
    name: "[f1]",
    about: "The line that is edited, from its root to the tip of the nose.",
    keys: &[
        key(
            "root",
            Kind::Point,
            Given::Optional,
            "Upper end of the line, near the nasofrontal angle, in the landmarks' frame. Default: `nasal_bones`.",
        ),
        key(
            "kind",
            Kind::Word(&KIND_NAMES),
            Given::Word(KIND_NAMES[0]),
            "What is mapped: \"line\", all of the line (default), or \"point\", its tip alone.",
        ),
    ],
};

pub(in super::super) static ENHANCE: TableFormat = TableFormat {
    name: "[enhance]",
    about: "What surfaces are found in is smoothed first. What is written and measured is the CT as it is.",
    keys: &[
        key(
            "median",
            Kind::Integer(MEDIAN),
            Given::Optional,
            "Side of the window of a median filter, voxels: only 3. Default: no such filter.",
        ),
        key(
            "smooth",
            Kind::Measured(MM, SIGMA_MM),
            Given::Optional,
            "Sigma of a Gaussian filter, mm: above 0, at most 10. Default: no such filter.",
        ),
    ],
};

pub(in super::super) static SEGMENT: TableFormat = TableFormat {
    name: "[segment]",
    about: "Thresholds of skin and bone.",
    keys: &[
        key(
            "skin_hu",
            Kind::Either(&[Kind::Number(HU), Kind::Word(&THRESHOLD_NAMES)]),
            Given::Number(DEFAULT_SKIN_HU),
            "Tissue begins here, HU, from -32768 to 32768; or \"otsu\", the threshold that best separates the CT's values. \
             Default: -500.",
        ),
        key(
            "bone_hu",
            Kind::Number(HU),
            Given::Number(DEFAULT_BONE_HU),
            "Bone begins here, HU, from -32768 to 32768; above `skin_hu`. Default: 300.",
        ),
        key(
            "keep_largest",
            Kind::Boolean,
            Given::Boolean(true),
            "Whether of each object only the largest connected piece is drawn: not the table, nor a headrest. Default: \
             true.",
        ),
    ],
};

pub(in super::super) static MORPH: TableFormat = TableFormat {
    name: "[morph]",
    about: "How the volume is morphed. A key of the other model or method is an error.",
    keys: &[
        key(
            "model",
            Kind::Word(&MODEL_NAMES),
            Given::Word(MODEL_NAMES[0]),
            "\"local\" (default): in mm, fades out around the nose. \"lee2001\": as published, in voxels, reaches the \
             whole head.",
        ),
        key(
            "scale",
            Kind::Word(&SCALE_NAMES),
            Given::Word(SCALE_NAMES[0]),
            "\"full\" (default), or \"half\": computed on every second voxel and brought back.",
        ),
        key(
            "method",
            Kind::Word(&METHOD_NAMES),
            Given::Word(METHOD_NAMES[0]),
            "\"adaptive\" (default): interpolated where that is accurate enough. \"exact\": every voxel.",
        ),
        key(
            "tolerance",
            Kind::Measured(MM_OR_VOXELS, LENGTH),
            Given::Mm(DEFAULT_TOLERANCE_MM),
            "Method \"adaptive\" only: largest error of an interpolated position, in mm or voxels: above 0, at most 1000. \
             Default: 0.05 mm.",
        ),
        key(
            "margin",
            Kind::Measured(MM, LENGTH),
            Given::Mm(DEFAULT_MARGIN_MM),
            "Model \"local\" only: how far from the nose the morph has faded out, mm: above 0, at most 1000. Default: 20 \
             mm.",
        ),
        key(
            "compare_exact",
            Kind::Boolean,
            Given::Boolean(false),
            "Method \"adaptive\" only: also computes every voxel, and reports the largest and mean difference. Default: \
             false.",
        ),
    ],
};

pub(in super::super) static CANDIDATE: TableFormat = TableFormat {
    name: "[[candidate]]",
    about: "A nose to compute, in stages.",
    keys: &[
        key(
            "name",
            Kind::Name(&[]),
            Given::Required,
            "Names its folder: a-z, 0-9 and -, not beginning with -, at most 64 characters; unique in the plan.",
        ),
        key(
            "title",
            Kind::Title,
            Given::Optional,
            "Free text of one line, at most 200 characters.",
        ),
        key(
            "stage",
            Kind::Tables(&STAGE, MAX_STAGES),
            Given::Required,
            "The steps of the operation, 1 to 100: each begins with the nose that the stage before it left.",
        ),
    ],
};

pub(in super::super) static STAGE: TableFormat = TableFormat {
    name: "[[candidate.stage]]",
    about: "A step of an operation.",
    keys: &[
        key(
            "name",
            Kind::Name(&[PREOPERATIVE]),
            Given::Required,
            "Names its folder: a-z, 0-9 and -, not beginning with -, at most 64 characters; unique in the candidate, and not \
             \"preoperative\".",
        ),
        key(
            "kind",
            Kind::Word(&KIND_NAMES),
            Given::Optional,
            "What of f1 this stage maps: \"line\" or \"point\". Default: that of [f1].",
        ),
        key(
            "f1",
            Kind::Choices(&EDIT, MAX_EDITS),
            Given::Required,
            "The edits of f1, 1 to 100, applied in this order.",
        ),
    ],
};

pub(in super::super) static SWEEP: TableFormat = TableFormat {
    name: "[[sweep]]",
    about: "Candidates made of one by varying numbers of its edits: every combination of the values.",
    keys: &[
        key(
            "candidate",
            Kind::NameOfOther,
            Given::Required,
            "The name of the candidate that is varied; it stays one itself.",
        ),
        key(
            "name",
            Kind::Name(&[]),
            Given::Optional,
            "What the names of the new candidates begin with. Default: the candidate's name.",
        ),
        key(
            "vary",
            Kind::Tables(&VARY, MAX_VARIED),
            Given::Required,
            "The numbers that are varied, 1 to 10; the last changes fastest.",
        ),
    ],
};

pub(in super::super) static VARY: TableFormat = TableFormat {
    name: "[[sweep.vary]]",
    about: "A number of an edit and its values: either `values`, or `from`, `to` and `steps`.",
    keys: &[
        key(
            "stage",
            Kind::NameOfOther,
            Given::Required,
            "The name of the stage.",
        ),
        key(
            "edit",
            Kind::Word(&SWEPT_EDIT_NAMES),
            Given::Required,
            "The edit, which the stage has once.",
        ),
        key(
            "axis",
            Kind::Word(&AXIS_NAMES),
            Given::Optional,
            "The component that is varied: of `move_tip` and `move_root`, and only there.",
        ),
        key(
            "values",
            Kind::Numbers(MAX_VALUES),
            Given::Optional,
            "The values, each once, in the unit in which the edit is written.",
        ),
        key(
            "from",
            Kind::AnyNumber,
            Given::Optional,
            "The first of evenly spaced values.",
        ),
        key("to", Kind::AnyNumber, Given::Optional, "The last of them."),
        key(
            "steps",
            Kind::Integer(STEPS),
            Given::Optional,
            "How many there are, both ends included.",
        ),
    ],
};

pub(in super::super) static EDIT: TableFormat = TableFormat {
    name: "an edit of f1",
    about: "An edit: a table of exactly one key.",
    keys: &[
        key(
            "move_tip",
            Kind::Vector(MM_OR_VOXELS),
            Given::Optional,
            "Moves the tip: in mm along the patient's axes (LPS), or in voxels along the grid.",
        ),
        key(
            "move_root",
            Kind::Vector(MM_OR_VOXELS),
            Given::Optional,
            "Moves the root: in mm along the patient's axes (LPS), or in voxels along the grid. Kind \"line\" only.",
        ),
        key(
            "tip_to",
            Kind::Point,
            Given::Optional,
            "Puts the tip there, in the landmarks' frame.",
        ),
        key(
            "root_to",
            Kind::Point,
            Given::Optional,
            "Puts the root there, in the landmarks' frame. Kind \"line\" only.",
        ),
        key(
            "project",
            Kind::AnyNumber,
            Given::Optional,
            "Moves the tip to anterior, mm; negative: to posterior, a lower nose.",
        ),
        key(
            "rotate",
            Kind::Number(ROTATION_DEG),
            Given::Optional,
            "Turns the tip about the root in the sagittal plane, degrees, above -180, below 180; positive: up.",
        ),
        key(
            "lengthen",
            Kind::AnyNumber,
            Given::Optional,
            "Moves the tip away from the root along the line, mm; negative: towards it.",
        ),
        key(
            "deviate",
            Kind::AnyNumber,
            Given::Optional,
            "Moves the tip to the patient's left, mm; negative: to the right.",
        ),
        key(
            "width",
            Kind::Number(WIDTH),
            Given::Optional,
            "Widens the nose by this factor, 0.1 to 10; below 1 narrows it. Model \"local\" and kind \"line\" only.",
        ),
    ],
};

pub(in super::super) static OUTPUTS: TableFormat = TableFormat {
    name: "[outputs]",
    about: "Files beside the tables, which are always written.",
    keys: &[key(
        "write",
        Kind::Words(&OUTPUT_NAMES),
        Given::Optional,
        "What is written, each once: volumes (\"volume\", \"nrrd\"), displacement fields (\"displacement\", \"inverse\"), \
         pictures (\"views\", \"slices\", \"charts\"), surfaces (\"mesh\", \"solids\"). Default: none.",
    )],
};

pub(in super::super) static MESH: TableFormat = TableFormat {
    name: "[mesh]",
    about: "Surfaces: only where `outputs.write` has \"mesh\".",
    keys: &[key(
        "triangles",
        Kind::Integer(TRIANGLES),
        Given::Optional,
        "The most triangles of a mesh, 1000 to 100000000: larger ones are decimated. Default: as many as come.",
    )],
};

pub(in super::super) static VIEWS: TableFormat = TableFormat {
    name: "[views]",
    about: "Pictures of the nose: only where `outputs.write` has \"views\".",
    keys: &[
        key(
            "names",
            Kind::WordsOrNone(&VIEW_NAMES),
            Given::Words(&VIEW_NAMES),
            "The standard views to draw, each once. Default: all six. Empty only where there is a [[views.camera]].",
        ),
        key(
            "size",
            Kind::Integer(SIZES),
            Given::Integer(DEFAULT_VIEW_SIZE as i64),
            "Side of a picture, pixels: 256 to 4096. Default: 1024.",
        ),
        key(
            "objects",
            Kind::Words(&OBJECT_NAMES),
            Given::Words(&[OBJECT_NAMES[0]]),
            "What is drawn: \"skin\" (default), \"bone\" or both.",
        ),
        key(
            "opacity",
            Kind::Table(&OPACITY),
            Given::Optional,
            "How opaque each object is. Default: nothing shows through.",
        ),
        key(
            "crop",
            Kind::Either(&[Kind::Word(&CROP_NAMES), Kind::Measured(MM, CROP_MM)]),
            Given::Word(CROP_NAMES[0]),
            "What the picture holds: \"face\" (default), \"head\", \"nose\", or a square with a side in mm, 20 to 1000.",
        ),
        key(
            "clip",
            Kind::Either(&[Kind::Word(&CLIP_NAMES), Kind::Table(&CLIP)]),
            Given::Optional,
            "What is left out: \"nose\", all that is outside the nose box; or a cut. Default: nothing.",
        ),
        key(
            "camera",
            Kind::Tables(&CAMERA, MAX_CAMERAS),
            Given::Optional,
            "Further views, at most 16, drawn after the standard ones.",
        ),
    ],
};

pub(in super::super) static OPACITY: TableFormat = TableFormat {
    name: "`views.opacity`",
    about: "How opaque each object is; only those that are drawn.",
    keys: &[
        key(
            OBJECT_NAMES[0],
            Kind::Number(OPACITIES),
            Given::Number(1.0),
            "Opacity of the skin: above 0, at most 1 (default), which lets nothing through. Only where it is drawn.",
        ),
        key(
            OBJECT_NAMES[1],
            Kind::Number(OPACITIES),
            Given::Number(1.0),
            "Opacity of bone: above 0, at most 1 (default), which lets nothing through. Only where it is drawn.",
        ),
    ],
};

pub(in super::super) static CLIP: TableFormat = TableFormat {
    name: "`views.clip`",
    about: "A cut through the tip of the nose, or parallel to that.",
    keys: &[
        key(
            "plane",
            Kind::Word(&PLANE_NAMES),
            Given::Required,
            "How the cut lies.",
        ),
        key(
            "offset",
            Kind::Number(OFFSET_MM),
            Given::Number(0.0),
            "From the tip to the cut, mm to the left, posterior or superior: -500 to 500. Default: 0.",
        ),
        key(
            "keep",
            Kind::Word(&SIDE_NAMES),
            Given::Required,
            "The side that is drawn: \"left\" or \"right\" of a sagittal cut, \"anterior\" or \"posterior\" of a coronal, \
             \"superior\" or \"inferior\" of an axial.",
        ),
    ],
};

pub(in super::super) static CAMERA: TableFormat = TableFormat {
    name: "[[views.camera]]",
    about: "A further view.",
    keys: &[
        key(
            "name",
            Kind::Name(&VIEW_NAMES),
            Given::Required,
            "Names its pictures: a-z, 0-9 and -, not beginning with -, at most 64 characters; unique, and not that of a \
             standard view.",
        ),
        key(
            "azimuth",
            Kind::Number(AZIMUTH_DEG),
            Given::Required,
            "About the superior axis, degrees, -180 to 180: 0 looks from the front, a positive angle from the patient's \
             left.",
        ),
        key(
            "elevation",
            Kind::Number(ELEVATION_DEG),
            Given::Required,
            "Degrees, -90 to 90: a positive angle looks from above.",
        ),
    ],
};

/// Every measure can have limits.
pub(in super::super) static ACCEPT: TableFormat = TableFormat {
    name: "[accept]",
    about: "Limits of the measures of a candidate's last stage, all of which must be kept.",
    keys: &LIMITS,
};

static LIMITS: [Key; COUNT] = limits();

const fn limits() -> [Key; COUNT] {
    const ANY: Key = limit(&MEASURES[0]);
    let mut keys = [ANY; COUNT];
    let mut place = 0;
    while place < COUNT {
        keys[place] = limit(&MEASURES[place]);
        place += 1;
    }
    keys
}

const fn limit(measure: &Measure) -> Key {
    let kinds = match (measure.bare, measure.has_percent) {
        (BareNumber::Nothing, true) => SIZED,
        (BareNumber::Nothing, false) => PLACED,
        (BareNumber::Least | BareNumber::Most, _) => EXTREME,
    };
    key(
        measure.name,
        Kind::Either(kinds),
        Given::Optional,
        measure.about,
    )
}

/// What a limit of a measure can have, where it is a table.
pub(in super::super) const fn limit_of(measure: &Measure) -> &'static TableFormat {
    if measure.has_percent {
        &LIMIT
    } else {
        &LIMIT_WITHOUT_PERCENT
    }
}

const SIZED: &[Kind] = &[Kind::Interval, Kind::Table(&LIMIT)];
const PLACED: &[Kind] = &[Kind::Interval, Kind::Table(&LIMIT_WITHOUT_PERCENT)];
const EXTREME: &[Kind] = &[
    Kind::AnyNumber,
    Kind::Interval,
    Kind::Table(&LIMIT_WITHOUT_PERCENT),
];

const MIN: Key = key(
    "min",
    Kind::AnyNumber,
    Given::Optional,
    "The least that is allowed.",
);
const MAX: Key = key(
    "max",
    Kind::AnyNumber,
    Given::Optional,
    "The most that is allowed.",
);
const CHANGE: Key = key(
    "change",
    Kind::Interval,
    Given::Optional,
    "The least and the most change since before the first stage.",
);
const CHANGE_PERCENT: Key = key(
    "change_percent",
    Kind::Interval,
    Given::Optional,
    "The same in percent of what it was.",
);

static LIMIT: TableFormat = TableFormat {
    name: "a limit of a volume, an angle or a height",
    about: "One or more limits of a measure.",
    keys: &[MIN, MAX, CHANGE, CHANGE_PERCENT],
};

/// Of a measure that has no percentage: a position, a movement, an extreme.
static LIMIT_WITHOUT_PERCENT: TableFormat = TableFormat {
    name: "a limit of a position, a movement or an extreme",
    about: "One or more limits of a measure.",
    keys: &[MIN, MAX, CHANGE],
};
