//! From a normal to a colour.

use std::sync::OnceLock;

use glam::{BVec4A, Vec3, Vec4};

use super::splat::QUAD;

/// What is behind everything, sRGB.
pub const BACKGROUND: [u8; 3] = [28, 28, 34];
/// Colour of skin, sRGB.
pub const SKIN: [u8; 3] = [226, 184, 158];
/// Colour of bone, sRGB.
pub const BONE: [u8; 3] = [236, 226, 200];
/// How much darker what a cut or the end of the scan lays open is than the surface.
const CUT: f32 = 0.45;

/// How an object is coloured.
#[derive(Clone, Copy)]
pub enum Paint<'a> {
    /// One colour, sRGB.
    Plain([u8; 3]),
    /// By a value of each boundary voxel, in the order of the semi-boundary; NaN and infinities are drawn as 0.
    Scalar {
        /// One for each voxel.
        values: &'a [f32],
        /// The sRGB colour of a value.
        colour: &'a (dyn Fn(f32) -> [u8; 3] + Sync),
    },
}

impl std::fmt::Debug for Paint<'_> {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Plain(colour) => to.debug_tuple("Plain").field(colour).finish(),
            Self::Scalar { values, .. } => to.debug_tuple("Scalar").field(&values.len()).finish(),
        }
    }
}

/// A light at infinity, in the frame of the picture: right, up, towards the viewer.
#[derive(Debug, Clone, Copy)]
struct Light {
    direction: Vec3,
    strength: f32,
}

/// Light that stays with the viewer, so that pictures from one side compare.
#[derive(Debug, Clone)]
pub(super) struct Shader {
    opacity: f32,
    lights: [Light; 3],
    /// Half-way between the first light and the viewer.
    half: Vec3,
    srgb: &'static Srgb,
}

/// Light from everywhere.
const AMBIENT: f32 = 0.08;
/// Cosine beyond 90 degrees up to which a light reaches.
const WRAP: f32 = 0.4;
/// Share of light that is mirrored.
const GLOSS: f32 = 0.10;

impl Shader {
    pub(super) fn new(opacity: f64) -> Self {
        let light = |x: f32, y: f32, z: f32, strength: f32| Light {
            direction: Vec3::new(x, y, z).normalize(),
            strength,
        };
        // From above the viewer's left shoulder, weaker from the right, and a little from the viewer.
        let lights = [
            light(-0.55, 0.65, 0.75, 0.72),
            light(0.75, 0.10, 0.60, 0.22),
            light(0.0, 0.0, 1.0, 0.24),
        ];
        Self {
            opacity: opacity as f32,
            half: (lights[0].direction + Vec3::Z).normalize(),
            lights,
            srgb: Srgb::tables(),
        }
    }

    /// sRGB and opacity of 255 of four pixels, given the sums of their normals and what they are coloured by.
    #[inline(always)]
    pub(super) fn shade(&self, paint: &Paint<'_>, quad: &Quad) -> [[u8; 4]; QUAD] {
        let normal = quad.unit_normals();
        let diffuse = self.lights.iter().fold(Vec4::splat(AMBIENT), |sum, light| {
            // A light reaches a little around the edge of its shadow, as in tissue, and fades out.
            let facing = (normal.dot(light.direction) + WRAP).max(Vec4::ZERO) / (1.0 + WRAP);
            sum + light.strength * facing * facing
        });
        let diffuse = Vec4::select(quad.cut, CUT * diffuse, diffuse);
        let shine = power_32(normal.dot(self.half)) * GLOSS;
        let shine = Vec4::select(quad.cut, Vec4::ZERO, shine);
        let [r, g, b] = match paint {
            Paint::Plain(colour) => colour.map(|value| Vec4::splat(self.srgb.linear(value))),
            Paint::Scalar { colour, .. } => {
                let lanes = quad.values.to_array().map(colour);
                [0, 1, 2]
                    .map(|channel| Vec4::from(lanes.map(|lane| self.srgb.linear(lane[channel]))))
            }
        }
        .map(|colour| self.srgb.encode_quad(colour * diffuse + shine));
        let a = self.opacity(normal.z);
        std::array::from_fn(|lane| [r[lane], g[lane], b[lane], a[lane]])
    }

    /// What is translucent is seen through a longer way where it is seen edge on.
    #[inline(always)]
    fn opacity(&self, facing: Vec4) -> [u8; QUAD] {
        if self.opacity >= 1.0 {
            return [u8::MAX; QUAD];
        }
        facing.to_array().map(|facing| {
            let way = 1.0 / facing.max(0.25);
            let opacity = 1.0 - libm::powf(1.0 - self.opacity, way);
            (opacity * 255.0 + 0.5) as u8
        })
    }
}

/// Four pixels to shade.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quad {
    /// Normals of any length: right, up, towards the viewer.
    pub normals: Normals,
    /// What they are coloured by, where they are coloured by a value.
    pub values: Vec4,
    /// Whether they show what a cut or the end of the scan lays open.
    pub cut: BVec4A,
}

/// Four vectors, by component.
#[derive(Debug, Clone, Copy)]
pub(super) struct Normals {
    pub x: Vec4,
    pub y: Vec4,
    pub z: Vec4,
}

impl Normals {
    #[inline(always)]
    fn dot(&self, to: Vec3) -> Vec4 {
        self.x * to.x + self.y * to.y + self.z * to.z
    }
}

impl Quad {
    /// Of length 1; towards the viewer where there is none.
    #[inline(always)]
    fn unit_normals(&self) -> Normals {
        let Normals { x, y, z } = self.normals;
        let inverse = (x * x + y * y + z * z).sqrt().recip();
        let known = inverse.cmpgt(Vec4::ZERO) & inverse.cmplt(Vec4::INFINITY);
        Normals {
            x: Vec4::select(known, x * inverse, Vec4::ZERO),
            y: Vec4::select(known, y * inverse, Vec4::ZERO),
            z: Vec4::select(known, z * inverse, Vec4::ONE),
        }
    }
}

#[inline(always)]
fn power_32(value: Vec4) -> Vec4 {
    let mut power = value.max(Vec4::ZERO);
    for _ in 0..5 {
        power *= power;
    }
    power
}

/// Steps of the table from linear light to sRGB.
const STEPS: usize = 4096;

/// Between sRGB and linear light (IEC 61966-2-1), by tables.
#[derive(Debug)]
pub(super) struct Srgb {
    linear: [f32; 256],
    encoded: [u8; STEPS],
}

impl Srgb {
    pub(super) fn tables() -> &'static Self {
        static TABLES: OnceLock<Srgb> = OnceLock::new();
        TABLES.get_or_init(|| Self {
            linear: std::array::from_fn(|value| to_linear(value as f32 / 255.0)),
            encoded: std::array::from_fn(|step| to_srgb(step as f32 / (STEPS - 1) as f32)),
        })
    }

    #[inline(always)]
    pub(super) fn linear(&self, value: u8) -> f32 {
        self.linear[usize::from(value)]
    }

    #[inline(always)]
    pub(super) fn encode(&self, value: f32) -> u8 {
        self.encode_quad(Vec4::splat(value))[0]
    }

    /// Four values; what is beyond 0 and 1 as these.
    #[inline(always)]
    fn encode_quad(&self, values: Vec4) -> [u8; QUAD] {
        // Added to a number below it, this rounds it to a whole one, which is then in its lowest bits.
        const LIFT: f32 = (1 << 23) as f32;
        let steps = values.clamp(Vec4::ZERO, Vec4::ONE) * (STEPS - 1) as f32 + LIFT;
        let encode = |step: f32| self.encoded[step.to_bits() as usize % STEPS];
        steps.to_array().map(encode)
    }
}

fn to_linear(value: f32) -> f32 {
    if value <= 0.040_45 {
        value / 12.92
    } else {
        libm::powf((value + 0.055) / 1.055, 2.4)
    }
}

fn to_srgb(value: f32) -> u8 {
    let value = if value <= 0.003_130_8 {
        value * 12.92
    } else {
        1.055 * libm::powf(value, 1.0 / 2.4) - 0.055
    };
    (value * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_returns() {
        let srgb = Srgb::tables();
        for value in 0..=255 {
            let back = srgb.encode(srgb.linear(value));
            // The table is coarse where sRGB is steep.
            assert!(
                back.abs_diff(value) <= u8::from(value < 12),
                "{value} returns as {back}"
            );
        }
    }
}
