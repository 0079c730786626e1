//! From a normal to a colour.

use glam::Vec3;

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
    linear: [f32; 256],
    encoder: Encoder,
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
            linear: std::array::from_fn(|value| linear(value as u8)),
            encoder: Encoder::new(),
        }
    }

    /// sRGB, and opacity of 255.
    pub(super) fn shade(&self, paint: &Paint<'_>, normal: Vec3, value: f32, cut: bool) -> [u8; 4] {
        let colour = match paint {
            Paint::Plain(colour) => *colour,
            Paint::Scalar { colour, .. } => colour(value),
        };
        // A light reaches a little around the edge of its shadow, as in tissue, and fades out.
        let lit = |light: &Light| {
            let facing = (normal.dot(light.direction) + WRAP).max(0.0) / (1.0 + WRAP);
            light.strength * facing * facing
        };
        let diffuse = AMBIENT + self.lights.iter().map(lit).sum::<f32>();
        let diffuse = if cut { CUT * diffuse } else { diffuse };
        let shine = if cut {
            0.0
        } else {
            power_32(normal.dot(self.half)) * GLOSS
        };
        // What is translucent is seen through a longer way where it is seen edge on.
        let opacity = if self.opacity < 1.0 {
            let way = 1.0 / normal.z.max(0.25);
            1.0 - libm::powf(1.0 - self.opacity, way)
        } else {
            1.0
        };
        let channel = |value: u8| {
            self.encoder
                .encode(self.linear[usize::from(value)] * diffuse + shine)
        };
        let [r, g, b] = colour.map(channel);
        [r, g, b, (opacity * 255.0 + 0.5) as u8]
    }
}

fn power_32(value: f32) -> f32 {
    let mut power = value.max(0.0);
    for _ in 0..5 {
        power *= power;
    }
    power
}

/// From sRGB to linear light (IEC 61966-2-1).
pub(super) fn linear(value: u8) -> f32 {
    let value = f32::from(value) / 255.0;
    if value <= 0.040_45 {
        value / 12.92
    } else {
        libm::powf((value + 0.055) / 1.055, 2.4)
    }
}

/// Steps of the table from linear light to sRGB.
const STEPS: usize = 4096;

/// From linear light to sRGB, by a table.
#[derive(Debug, Clone)]
pub(super) struct Encoder(Vec<u8>);

impl Encoder {
    pub(super) fn new() -> Self {
        let encode = |step: usize| {
            let value = step as f32 / (STEPS - 1) as f32;
            let value = if value <= 0.003_130_8 {
                value * 12.92
            } else {
                1.055 * libm::powf(value, 1.0 / 2.4) - 0.055
            };
            (value * 255.0).round() as u8
        };
        Self((0..STEPS).map(encode).collect())
    }

    #[inline]
    pub(super) fn encode(&self, value: f32) -> u8 {
        let step = (value.clamp(0.0, 1.0) * (STEPS - 1) as f32 + 0.5) as usize;
        self.0.get(step).copied().unwrap_or(u8::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_returns() {
        let encoder = Encoder::new();
        for value in 0..=255 {
            let back = encoder.encode(linear(value));
            // The table is coarse where sRGB is steep.
            assert!(
                back.abs_diff(value) <= u8::from(value < 12),
                "{value} returns as {back}"
            );
        }
    }
}
