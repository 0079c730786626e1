//! From SVG text to pixels.

use std::sync::{Arc, OnceLock};

use image::{Rgb, RgbImage, Rgba, RgbaImage};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{self, ImageHrefResolver, Options, Tree, fontdb};

use super::PictureError;

/// The family of the only font there is; named so that a browser falls back to what it has.
pub(super) const FONT_FAMILY: &str = "DejaVu Sans, sans-serif";

/// The most pixels of a picture: 8192 × 8192.
pub(super) const MAX_PIXELS: u64 = 1 << 26;

/// The embedded font and nothing of the machine's.
fn fonts() -> Arc<fontdb::Database> {
    static FONTS: OnceLock<Arc<fontdb::Database>> = OnceLock::new();
    let load = || {
        let mut fonts = fontdb::Database::new();
        fonts.load_font_data(dejavu::sans::regular().to_vec());
        fonts.set_sans_serif_family("DejaVu Sans");
        Arc::new(fonts)
    };
    Arc::clone(FONTS.get_or_init(load))
}

/// Reads SVG text. Links to files and embedded pictures are not followed.
pub(super) fn parse(svg: &str) -> Result<Tree, PictureError> {
    let options = Options {
        font_family: "DejaVu Sans".to_owned(),
        fontdb: fonts(),
        image_href_resolver: ImageHrefResolver {
            resolve_data: Box::new(|_, _, _| None),
            resolve_string: Box::new(|_, _| None),
        },
        ..Options::default()
    };
    Ok(Tree::from_str(svg, &options)?)
}

/// Draws SVG text on a transparent ground, at `scale` pixels for each of its units.
///
/// # Errors
/// [`PictureError::Svg`] for text that is not SVG, [`PictureError::Size`] for a picture of no pixels or of
/// more than 8192 × 8192, [`PictureError::Value`] for a scale that is not positive.
pub fn rasterize(svg: &str, scale: f64) -> Result<RgbaImage, PictureError> {
    if !(scale.is_finite() && scale > 0.0) {
        return Err(PictureError::Value {
            what: "the scale of a drawing",
            value: scale,
            condition: " above 0",
        });
    }
    let tree = parse(svg)?;
    let pixels = |units: f32| (f64::from(units) * scale).round() as u64;
    let (width, height) = (pixels(tree.size().width()), pixels(tree.size().height()));
    let (columns, rows) = checked_size(width, height)?;
    let mut pixmap = Pixmap::new(columns, rows).ok_or(PictureError::Size { width, height })?;
    let transform = Transform::from_scale(scale as f32, scale as f32);
    resvg::render(&tree, transform, &mut pixmap.as_mut());
    let mut image = RgbaImage::new(columns, rows);
    for (to, from) in image.pixels_mut().zip(pixmap.pixels()) {
        let colour = from.demultiply();
        *to = Rgba([colour.red(), colour.green(), colour.blue(), colour.alpha()]);
    }
    Ok(image)
}

/// Draws SVG text over a picture, a unit of it to a pixel.
///
/// # Errors
/// [`PictureError::Svg`] for text that is not SVG, [`PictureError::OverlaySize`] where its size is not the
/// picture's.
pub fn overlay(image: &mut RgbImage, svg: &str) -> Result<(), PictureError> {
    let tree = parse(svg)?;
    let size = tree.size().to_int_size();
    let found = (size.width(), size.height());
    if found != image.dimensions() {
        return Err(PictureError::OverlaySize {
            overlay: found,
            picture: image.dimensions(),
        });
    }
    let (width, height) = (u64::from(found.0), u64::from(found.1));
    checked_size(width, height)?;
    let mut pixmap = Pixmap::new(found.0, found.1).ok_or(PictureError::Size { width, height })?;
    for (to, from) in pixmap.data_mut().chunks_exact_mut(4).zip(image.pixels()) {
        let [red, green, blue] = from.0;
        to.copy_from_slice(&[red, green, blue, u8::MAX]);
    }
    resvg::render(&tree, Transform::identity(), &mut pixmap.as_mut());
    // Opaque before and so after: nothing to divide by.
    for (to, from) in image.pixels_mut().zip(pixmap.pixels()) {
        *to = Rgb([from.red(), from.green(), from.blue()]);
    }
    Ok(())
}

/// A size in the type that images have, where a picture may have it.
pub(super) fn checked_size(width: u64, height: u64) -> Result<(u32, u32), PictureError> {
    let error = || PictureError::Size { width, height };
    let pixels = width.checked_mul(height).ok_or_else(error)?;
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(error());
    }
    let (Ok(columns), Ok(rows)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(error());
    };
    Ok((columns, rows))
}

/// The width of a line of text set in DejaVu Sans of one unit; `None` where nothing of it is set.
pub(super) fn text_width(escaped: &str) -> Option<f64> {
    const SIZE: f32 = 100.0;
    let svg = format!(
        r#"<svg xmlns="http://www.w3.org/2000/svg" width="1" height="1"><text font-size="{SIZE}">{escaped}</text></svg>"#
    );
    let tree = parse(&svg).ok()?;
    tree.root().children().iter().find_map(|node| match node {
        usvg::Node::Text(text) => Some(f64::from(text.bounding_box().width() / SIZE)),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HALF_RED: &str = r##"<svg xmlns="http://www.w3.org/2000/svg" width="4" height="2"><rect width="2" height="2" fill="#ff0000"/></svg>"##;

    #[test]
    fn a_drawing_covers_the_pixels_it_names() {
        let image = rasterize(HALF_RED, 2.0).unwrap();
        assert_eq!(image.dimensions(), (8, 4));
        assert_eq!(image.get_pixel(3, 3).0, [255, 0, 0, 255]);
        assert_eq!(image.get_pixel(4, 0).0[3], 0);
    }

    #[test]
    fn an_overlay_keeps_what_it_does_not_cover() {
        let mut image = RgbImage::from_pixel(4, 2, Rgb([1, 2, 3]));
        overlay(&mut image, HALF_RED).unwrap();
        assert_eq!(image.get_pixel(1, 1).0, [255, 0, 0]);
        assert_eq!(image.get_pixel(2, 1).0, [1, 2, 3]);
        let mut other = RgbImage::new(5, 2);
        let error = overlay(&mut other, HALF_RED).unwrap_err();
        assert!(matches!(error, PictureError::OverlaySize { .. }));
    }

    #[test]
    fn sizes_and_scales_that_cannot_be_are_refused() {
        for scale in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9, 1e-9] {
            assert!(rasterize(HALF_RED, scale).is_err(), "{scale}");
        }
        assert!(matches!(rasterize("<svg", 1.0), Err(PictureError::Svg(_))));
    }

    #[test]
    fn pictures_of_the_disk_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("white.png");
        let white = RgbImage::from_pixel(4, 4, Rgb([255; 3]));
        std::fs::write(&path, crate::picture::encode_png(&white).unwrap()).unwrap();
        let svg = format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" width="4" height="4"><image href="{}" width="4" height="4"/></svg>"#,
            path.display()
        );
        assert!(rasterize(&svg, 1.0).unwrap().pixels().all(|p| p.0[3] == 0));
    }

    #[test]
    fn a_font_is_there_and_wide_letters_are_wider() {
        let (narrow, wide) = (text_width("iiii").unwrap(), text_width("MMMM").unwrap());
        // Advances of DejaVu Sans: i 569, M 1767 of 2048.
        assert!((narrow - 4.0 * 569.0 / 2048.0).abs() < 0.01, "{narrow}");
        assert!((wide - 4.0 * 1767.0 / 2048.0).abs() < 0.01, "{wide}");
    }
}
