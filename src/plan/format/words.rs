//! The words of plans, and what each means.

use super::super::raw::Frame;
use super::super::resolved::{
    Clip, Crop, CutPlane, Method, Model, Object, Phantom, STANDARD_VIEWS, Scale, Side,
    SkinThreshold, StandardView,
};
use crate::feature::FeatureKind;

/// Words, each with its meaning.
type Words<T, const N: usize> = [(&'static str, T); N];

/// The words of `morph.model`, before the margin is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) enum ModelWord {
    Local,
    Lee2001,
}

/// The words of `morph.method`, before the tolerance is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) enum MethodWord {
    Adaptive,
    Exact,
}

/// The outputs that this version writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) enum Output {
    Volume,
    Nrrd,
    Displacement,
    Views,
    Slices,
    Charts,
    Mesh,
    Solids,
    Inverse,
}

pub(in super::super) const PHANTOMS: Words<Phantom, 1> =
    [(Phantom::Lee2001.name(), Phantom::Lee2001)];

pub(in super::super) const FRAMES: Words<Frame, 3> = [
    (Frame::Voxel.name(), Frame::Voxel),
    (Frame::Lps.name(), Frame::Lps),
    (Frame::Ras.name(), Frame::Ras),
];

pub(in super::super) const KINDS: Words<FeatureKind, 2> = [
    (FeatureKind::Line.name(), FeatureKind::Line),
    (FeatureKind::Point.name(), FeatureKind::Point),
];

pub(in super::super) const THRESHOLDS: Words<SkinThreshold, 1> =
    [(SkinThreshold::OTSU, SkinThreshold::Otsu)];

pub(in super::super) const MODELS: Words<ModelWord, 2> = [
    ("local", ModelWord::Local),
    (Model::Lee2001.name(), ModelWord::Lee2001),
];

pub(in super::super) const SCALES: Words<Scale, 2> = [
    (Scale::Full.name(), Scale::Full),
    (Scale::Half.name(), Scale::Half),
];

pub(in super::super) const METHODS: Words<MethodWord, 2> = [
    ("adaptive", MethodWord::Adaptive),
    (Method::Exact.name(), MethodWord::Exact),
];

pub(in super::super) const OUTPUT_WORDS: Words<Output, 9> = [
    ("volume", Output::Volume),
    ("nrrd", Output::Nrrd),
    ("displacement", Output::Displacement),
    ("views", Output::Views),
    ("slices", Output::Slices),
    ("charts", Output::Charts),
    ("mesh", Output::Mesh),
    ("solids", Output::Solids),
    ("inverse", Output::Inverse),
];

pub(in super::super) const VIEW_WORDS: Words<&StandardView, 6> = {
    let [a, b, c, d, e, f] = &STANDARD_VIEWS;
    [
        (a.name, a),
        (b.name, b),
        (c.name, c),
        (d.name, d),
        (e.name, e),
        (f.name, f),
    ]
};

pub(in super::super) const OBJECTS: Words<Object, 2> = [
    (Object::Skin.name(), Object::Skin),
    (Object::Bone.name(), Object::Bone),
];

pub(in super::super) const CROPS: Words<Crop, 3> = [
    ("face", Crop::Face),
    ("head", Crop::Head),
    ("nose", Crop::Nose),
];

pub(in super::super) const CLIPS: Words<Clip, 1> = [("nose", Clip::Nose)];

pub(in super::super) const PLANES: Words<CutPlane, 3> = [
    (CutPlane::Sagittal.name(), CutPlane::Sagittal),
    (CutPlane::Coronal.name(), CutPlane::Coronal),
    (CutPlane::Axial.name(), CutPlane::Axial),
];

pub(in super::super) const SIDES: Words<Side, 6> = [
    (Side::Left.name(), Side::Left),
    (Side::Right.name(), Side::Right),
    (Side::Anterior.name(), Side::Anterior),
    (Side::Posterior.name(), Side::Posterior),
    (Side::Superior.name(), Side::Superior),
    (Side::Inferior.name(), Side::Inferior),
];

/// The edits of which a sweep can vary a number.
pub(in super::super) const SWEPT_EDITS: Words<&str, 7> = {
    const fn same(word: &'static str) -> (&'static str, &'static str) {
        (word, word)
    }
    [
        same("move_tip"),
        same("move_root"),
        same("project"),
        same("rotate"),
        same("lengthen"),
        same("deviate"),
        same("width"),
    ]
};

/// The axes of a vector, and their places.
pub(in super::super) const AXES: Words<usize, 3> = [("x", 0), ("y", 1), ("z", 2)];

/// The words alone.
pub(super) const fn names<T, const N: usize>(words: &Words<T, N>) -> [&'static str; N] {
    let mut names = [""; N];
    let mut place = 0;
    while place < N {
        names[place] = words[place].0;
        place += 1;
    }
    names
}
