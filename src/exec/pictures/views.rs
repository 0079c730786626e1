//! Views of the surface: each stage, before and after, and what changed.

use std::path::Path;

use image::RgbImage;
use rayon::prelude::*;

use super::framing::{Field, Framing, letters};
use super::surfaces::Surfaces;
use super::{PREOPERATIVE_FOLDER, PicturesError, write_bytes};
use crate::exec::error::RunError;
use crate::io::staging::Staging;
use crate::picture::{
    DivergingLegend, SideLetters, ViewOverlay, diverging, encode_png, overlay, side_by_side, strip,
    tile,
};
use crate::plan::{Object as Drawn, Plan, Views};
use crate::render::{BONE, Camera, Frame, Object, Paint, SKIN, render};
use crate::report::record::SurfaceChange;
use crate::surface::{SemiBoundary, signed_distances};
use crate::volume::Volume;

/// How far skin is looked for that moved, mm. Skin further away is drawn as unchanged.
const REACH_MM: f64 = 60.0;

/// Draws the views of a plan.
pub(in crate::exec) struct Gallery<'a> {
    plan: &'a Plan,
    views: &'a Views,
    skin_hu: f64,
    framing: Framing,
    before: Surfaces,
    field: Field,
    /// The views before the first operation, in the order of the cameras.
    pictures: Vec<RgbImage>,
}

/// A camera of the plan and what it saw.
struct Taken<'a> {
    name: &'a str,
    camera: Camera,
    frame: Frame<'a>,
}

impl<'a> Gallery<'a> {
    /// Finds the surfaces of the nose as it is.
    pub(in crate::exec) fn new(
        plan: &'a Plan,
        views: &'a Views,
        skin_hu: f64,
        volume: &Volume<f32>,
    ) -> Result<Self, PicturesError> {
        let framing = Framing::new(plan, views, volume.grid());
        let before = Surfaces::new(plan, &views.objects, skin_hu, volume, &framing)?;
        for (drawn, surface) in &before.0 {
            if surface.is_empty() {
                let whole = framing.region == crate::surface::Region::whole(volume.grid());
                return Err(PicturesError::NoSurface {
                    object: drawn.object.name(),
                    threshold_hu: match drawn.object {
                        Drawn::Skin => skin_hu,
                        Drawn::Bone => plan.segment.bone_hu,
                    },
                    within: if whole {
                        ""
                    } else {
                        " in what `views.clip` leaves"
                    },
                });
            }
        }
        let first = before
            .skin()
            .or(before.0.first().map(|(_, surface)| surface));
        let field = first.and_then(|surface| framing.field(views, surface));
        let field = field.ok_or(PicturesError::NoSurface {
            object: "skin",
            threshold_hu: skin_hu,
            within: "",
        })?;
        Ok(Self {
            plan,
            views,
            skin_hu,
            framing,
            before,
            field,
            pictures: Vec::new(),
        })
    }

    /// Draws the nose as it is. Returns its pictures on the contact sheet, where the plan has several candidates;
    /// a single one its pairs compare.
    pub(in crate::exec) fn preoperative(
        &mut self,
        staging: &Staging,
    ) -> Result<Option<RgbImage>, RunError> {
        let taken = self.take(&self.before)?;
        let caption = "preoperative";
        let drawn = taken.par_iter().map(|taken| {
            let picture = self.finished(&taken.frame, &taken.camera, caption, None)?;
            let png = encode_png(&picture)?;
            Ok((picture, png))
        });
        let drawn: Vec<(RgbImage, Vec<u8>)> = drawn.collect::<Result<_, PicturesError>>()?;
        let mut pictures = Vec::with_capacity(drawn.len());
        for (taken, (picture, png)) in taken.iter().zip(drawn) {
            let name = Path::new(PREOPERATIVE_FOLDER).join(format!("view-{}.png", taken.name));
            write_bytes(staging, &name, &png)?;
            pictures.push(picture);
        }
        let row = (self.plan.candidates.len() > 1).then(|| self.strip(&taken));
        drop(taken);
        self.pictures = pictures;
        Ok(row)
    }

    /// A row of the contact sheet: what the cameras saw, with nothing written over it, beside each other.
    fn strip(&self, taken: &[Taken<'_>]) -> RgbImage {
        let tiles = taken
            .par_iter()
            .map(|taken| tile(&self.picture(&taken.frame)));
        strip(&tiles.collect::<Vec<_>>())
    }

    /// The pictures of a candidate's last stage on the contact sheet.
    pub(in crate::exec) fn on_sheet(&self, surfaces: &StageSurfaces) -> Result<RgbImage, RunError> {
        Ok(self.strip(&self.take(&surfaces.after)?))
    }

    /// A frame as a picture.
    fn picture(&self, frame: &Frame<'_>) -> RgbImage {
        let size = self.views.size;
        let bytes: Vec<u8> = frame.pixels().iter().flatten().copied().collect();
        RgbImage::from_raw(size, size, bytes).unwrap_or_default()
    }

    /// The surfaces of a stage.
    pub(in crate::exec) fn surfaces(
        &self,
        volume: &Volume<f32>,
    ) -> Result<StageSurfaces, PicturesError> {
        let after = Surfaces::new(
            self.plan,
            &self.views.objects,
            self.skin_hu,
            volume,
            &self.framing,
        )?;
        let change = match (after.skin(), self.before.skin()) {
            (Some(after), Some(before)) => signed_distances(after, before, REACH_MM),
            _ => Vec::new(),
        };
        Ok(StageSurfaces { after, change })
    }

    /// Draws a stage: its views, each beside the view before, and what changed.
    pub(in crate::exec) fn stage(
        &self,
        staging: &Staging,
        folder: &Path,
        caption: &str,
        surfaces: &StageSurfaces,
    ) -> Result<Option<SurfaceChange>, RunError> {
        let taken = self.take(&surfaces.after)?;
        let change = surfaces.seen(&taken);
        let legend = change.map(|change| DivergingLegend {
            min_mm: change.inward_max_mm.min(0.0),
            max_mm: change.outward_max_mm.max(0.0),
        });
        let drawn = taken.par_iter().zip(&self.pictures).map(|(taken, before)| {
            let view = self.finished(&taken.frame, &taken.camera, caption, None)?;
            let pair = side_by_side(before, &view, ["before", "after"])?;
            let mut files = vec![
                (format!("view-{}.png", taken.name), encode_png(&view)?),
                (format!("pair-{}.png", taken.name), encode_png(&pair)?),
            ];
            if let (Some(legend), Some(skin)) = (legend, surfaces.after.skin()) {
                let map = self.changed(skin, &surfaces.change, legend, &taken.camera, caption)?;
                files.push((format!("change-{}.png", taken.name), encode_png(&map)?));
            }
            Ok(files)
        });
        let drawn: Vec<Vec<(String, Vec<u8>)>> = drawn.collect::<Result<_, PicturesError>>()?;
        for (name, png) in drawn.into_iter().flatten() {
            write_bytes(staging, &folder.join(name), &png)?;
        }
        Ok(change)
    }

    /// Every camera's picture of some surfaces.
    fn take<'s>(&'s self, surfaces: &'s Surfaces) -> Result<Vec<Taken<'s>>, PicturesError> {
        let objects: Vec<Object<'s>> = surfaces
            .0
            .iter()
            .map(|(drawn, surface)| Object {
                surface,
                paint: Paint::Plain(match drawn.object {
                    Drawn::Skin => SKIN,
                    Drawn::Bone => BONE,
                }),
                opacity: drawn.opacity,
            })
            .collect();
        let cameras = self.views.cameras.iter().map(|camera| {
            let name = camera.name.as_str();
            let camera = self.field.camera(camera, self.views.size as usize)?;
            let frame = render(&objects, &camera);
            Ok(Taken {
                name,
                camera,
                frame,
            })
        });
        cameras.collect()
    }

    /// The skin, coloured by how far it moved.
    fn changed(
        &self,
        skin: &SemiBoundary,
        change: &[f32],
        legend: DivergingLegend,
        camera: &Camera,
        caption: &str,
    ) -> Result<RgbImage, PicturesError> {
        let limit = legend.limit_mm();
        let colour = |mm: f32| {
            if limit > 0.0 {
                diverging(f64::from(mm) / limit)
            } else {
                diverging(0.0)
            }
        };
        let object = Object {
            surface: skin,
            paint: Paint::Scalar {
                values: change,
                colour: &colour,
            },
            opacity: 1.0,
        };
        self.finished(&render(&[object], camera), camera, caption, Some(legend))
    }

    /// A frame with what is written over it.
    fn finished(
        &self,
        frame: &Frame<'_>,
        camera: &Camera,
        caption: &str,
        legend: Option<DivergingLegend>,
    ) -> Result<RgbImage, PicturesError> {
        let size = self.views.size;
        let mut picture = self.picture(frame);
        let sides = [-camera.right, camera.right, camera.up, -camera.up].map(letters);
        let [left, right, top, bottom] = &sides;
        let written = ViewOverlay {
            size: (size, size),
            mm_per_pixel: camera.mm_per_pixel(),
            title: &self.plan.name,
            subtitle: caption,
            letters: SideLetters {
                left,
                right,
                top,
                bottom,
            },
            legend,
        };
        overlay(&mut picture, &written.svg())?;
        Ok(picture)
    }
}

/// The surfaces of a stage, and how far its skin moved: for each boundary voxel, mm, positive outwards.
pub(in crate::exec) struct StageSurfaces {
    after: Surfaces,
    change: Vec<f32>,
}

impl StageSurfaces {
    /// How far the skin that the cameras see moved; `None` where no skin is drawn.
    fn seen(&self, taken: &[Taken<'_>]) -> Option<SurfaceChange> {
        self.after.skin()?;
        let skin = self.after.0.iter();
        let skin = skin
            .map(|(drawn, _)| drawn.object)
            .position(|object| object == Drawn::Skin)?;
        let ranges = taken.par_iter().map(|taken| {
            let size = taken.frame.size();
            let pixels = (0..size * size).filter_map(|pixel| {
                let hit = taken.frame.place_of(skin, pixel % size, pixel / size)?;
                self.change.get(hit).copied().filter(|mm| mm.is_finite())
            });
            pixels.fold([0.0_f32; 2], |[low, high], mm| [low.min(mm), high.max(mm)])
        });
        let [low, high] =
            ranges.reduce(|| [0.0; 2], |[low, high], [a, b]| [low.min(a), high.max(b)]);
        Some(SurfaceChange {
            inward_max_mm: f64::from(low),
            outward_max_mm: f64::from(high),
        })
    }
}
