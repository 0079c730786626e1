//! Faults of what is segmented and drawn.

use super::Change::{Remove, Replace, Whole};
use super::check_changes;

const PICTURES: &str = include_str!("../plans/pictures.toml");

#[test]
fn enhance() {
    check_changes(
        "enhance",
        PICTURES,
        &[
            (
                "a median of another window",
                1,
                &[Replace("median = 3 ", "median = 5 ")],
            ),
            (
                "a median that is no integer",
                1,
                &[Replace("median = 3 ", "median = 3.0 ")],
            ),
            (
                "a sigma without a unit",
                1,
                &[Replace("smooth = { mm = 0.6 }", "smooth = 0.6")],
            ),
            (
                "a sigma in voxels",
                1,
                &[Replace("smooth = { mm = 0.6 }", "smooth = { voxels = 1 }")],
            ),
            (
                "a sigma of nothing",
                1,
                &[Replace("smooth = { mm = 0.6 }", "smooth = { mm = 0 }")],
            ),
            (
                "a sigma that leaves nothing of a nose",
                1,
                &[Replace("smooth = { mm = 0.6 }", "smooth = { mm = 10.5 }")],
            ),
            (
                "an unknown filter, and one of another table",
                2,
                &[Replace(
                    "median = 3 ",
                    "gaussian = 3\nkeep_largest = true #",
                )],
            ),
            (
                "[enhance] is a word",
                1,
                &[
                    Remove("[enhance]", "[segment]"),
                    Replace(
                        "name = \"pictures\"",
                        "name = \"pictures\"\nenhance = \"median\"",
                    ),
                ],
            ),
        ],
    );
}

#[test]
fn segment() {
    check_changes(
        "segment",
        PICTURES,
        &[
            (
                "another method",
                1,
                &[Replace("skin_hu = \"otsu\"", "skin_hu = \"li\"")],
            ),
            (
                "the method in capitals",
                1,
                &[Replace("skin_hu = \"otsu\"", "skin_hu = \"Otsu\"")],
            ),
            (
                "a method for bone",
                1,
                &[Replace("skin_hu = \"otsu\"", "bone_hu = \"otsu\"")],
            ),
            (
                "neither a number nor a method",
                1,
                &[Replace("skin_hu = \"otsu\"", "skin_hu = [-500]")],
            ),
            (
                "a number out of range",
                1,
                &[Replace("skin_hu = \"otsu\"", "skin_hu = -40000")],
            ),
            (
                "pieces that are no boolean",
                1,
                &[Replace("keep_largest = false", "keep_largest = 1")],
            ),
        ],
    );
}

#[test]
fn views() {
    check_changes(
        "views",
        PICTURES,
        &[
            (
                "[views] without the output",
                1,
                &[Replace(
                    "[\"views\", \"slices\", \"charts\"]",
                    "[\"slices\"]",
                )],
            ),
            (
                "[views] without [outputs]",
                1,
                &[Remove("[outputs]", "[views] ")],
            ),
            (
                "where the outputs are at fault, only they are",
                1,
                &[Replace("[\"views\", \"slices\", \"charts\"]", "[\"view\"]")],
            ),
            (
                "[views] is an array",
                1,
                &[
                    Remove("[views] ", ""),
                    Replace("plan = 1", "plan = 1\nviews = [\"frontal\"]"),
                ],
            ),
            (
                "names unknown, twice and of no type",
                4,
                &[Replace(
                    "[\"basal\", \"frontal\"]",
                    "[\"basal\", \"front\", \"left-lateral\", \"basal\", 1]",
                )],
            ),
            (
                "no names and no cameras",
                1,
                &[
                    Replace("[\"basal\", \"frontal\"]", "[]"),
                    Remove("[[views.camera]]\n  name = \"high-left\"", ""),
                ],
            ),
            (
                "one name without its array",
                1,
                &[Replace("[\"basal\", \"frontal\"]", "\"basal\"")],
            ),
            ("a small size", 1, &[Replace("size = 512", "size = 255")]),
            ("a large size", 1, &[Replace("size = 512", "size = 4097")]),
            (
                "a size past all integers",
                1,
                &[Replace("size = 512", "size = 99999999999999999999")],
            ),
            (
                "a size with a decimal point",
                1,
                &[Replace("size = 512", "size = 512.0")],
            ),
            (
                "objects unknown and twice",
                3,
                &[Replace(
                    "[\"bone\", \"skin\"]",
                    "[\"bone\", \"skins\", \"bone\", {}]",
                )],
            ),
            (
                "no objects; which have an opacity is then not judged",
                1,
                &[Replace("[\"bone\", \"skin\"]", "[]")],
            ),
            (
                "an opacity of what is not drawn",
                1,
                &[Replace("[\"bone\", \"skin\"]", "[\"bone\"]")],
            ),
            (
                "bone is not drawn unless it is asked for",
                1,
                &[
                    Remove("objects = ", "opacity"),
                    Replace("{ skin = 0.4 }", "{ skin = 0.4, bone = 1 }"),
                ],
            ),
            (
                "opacities out of range, and one of nothing",
                3,
                &[Replace(
                    "{ skin = 0.4 }",
                    "{ skin = 0, bone = 1.01, hair = 0.5 }",
                )],
            ),
            (
                "an opacity without its object",
                1,
                &[Replace("{ skin = 0.4 }", "0.4")],
            ),
            (
                "keys of other tables",
                3,
                &[Replace(
                    "size = 512",
                    "azimuth = 30\nskin_hu = 1\nsizes = 512 #",
                )],
            ),
        ],
    );
}

#[test]
fn crop_and_clip() {
    let crop = "{ mm = 180.0 }";
    let clip = "{ plane = \"sagittal\", offset = -2.5, keep = \"left\" }";
    check_changes(
        "crop_and_clip",
        PICTURES,
        &[
            ("an unknown crop", 1, &[Replace(crop, "\"faces\"")]),
            ("a crop without a unit", 1, &[Replace(crop, "180")]),
            ("a crop in pixels", 1, &[Replace(crop, "{ pixels = 180 }")]),
            ("a crop of two sides", 1, &[Replace(crop, "[180, 180]")]),
            ("a crop out of range", 1, &[Replace(crop, "{ mm = 19.9 }")]),
            ("an unknown clip", 1, &[Replace(clip, "\"face\"")]),
            ("a clip of another type", 1, &[Replace(clip, "true")]),
            ("a clip of nothing", 2, &[Replace(clip, "{}")]),
            (
                "a clip of unknown words",
                2,
                &[Replace(clip, "{ plane = \"saggital\", keep = \"lift\" }")],
            ),
            (
                "a side of another plane",
                1,
                &[Replace("keep = \"left\"", "keep = \"superior\"")],
            ),
            ("a side is missing", 1, &[Replace(", keep = \"left\"", "")]),
            (
                "an offset far from the head",
                1,
                &[Replace("offset = -2.5", "offset = -500.5")],
            ),
            (
                "an offset with a unit",
                1,
                &[Replace("offset = -2.5", "offset = { mm = -2.5 }")],
            ),
            (
                "an unknown key",
                1,
                &[Replace("offset = -2.5", "ofset = -2.5")],
            ),
        ],
    );
}

#[test]
fn cameras() {
    check_changes(
        "cameras",
        PICTURES,
        &[
            (
                "a camera without anything",
                3,
                &[Replace(
                    "  [[views.camera]]\n  name = \"behind\"",
                    "  [[views.camera]]\n  [[views.camera]]\n  name = \"behind\"",
                )],
            ),
            (
                "one bracket",
                1,
                &[
                    Remove(
                        "[[views.camera]]\n  name = \"high-left\"",
                        "[[views.camera]]\n  name = \"behind\"",
                    ),
                    Replace("[[views.camera]]", "[views.camera]"),
                ],
            ),
            (
                "no cameras",
                1,
                &[
                    Remove("[[views.camera]]\n  name = \"high-left\"", ""),
                    Replace("size = 512", "size = 512\ncamera = [] #"),
                ],
            ),
            (
                "the name of a standard view, drawn or not",
                2,
                &[
                    Replace("\"high-left\"", "\"basal\""),
                    Replace("\"behind\"", "\"oblique-left\""),
                ],
            ),
            ("a name twice", 1, &[Replace("\"behind\"", "\"high-left\"")]),
            (
                "a name that names no file",
                1,
                &[Replace("\"behind\"", "\"from behind\"")],
            ),
            (
                "angles out of range and of no type",
                3,
                &[
                    Replace("azimuth = 30.0", "azimuth = 181"),
                    Replace("elevation = 20", "elevation = 90.5"),
                    Replace("azimuth = -180", "azimuth = \"-180\""),
                ],
            ),
            (
                "an unknown key",
                1,
                &[Replace("elevation = 20", "elevation = 20\nroll = 5")],
            ),
            ("more than a plan may hold", 1, &[Whole(crowd())]),
        ],
    );
}

/// A plan of one camera too many.
fn crowd() -> String {
    let cameras = (0..15).map(|place| {
        format!("[[views.camera]]\nname = \"c{place}\"\nazimuth = {place}\nelevation = 0\n")
    });
    PICTURES.to_owned() + &cameras.collect::<String>()
}
