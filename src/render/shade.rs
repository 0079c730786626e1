//! From a normal to a colour.

use std::sync::OnceLock;

use glam::Vec3;

use super::span::WIDE;

/// What is behind everything, sRGB.
pub const BACKGROUND: [u8; 3] = [28, 28, 34];
/// Colour of skin, sRGB.
pub const SKIN: [u8; 3] = [226, 184, 158];
/// Colour of bone, sRGB.
pub const BONE: [u8; 3] = [236, 226, 200];
/// Shares of light that a surface returns, and that it mirrors.
pub(super) const SURFACE: (f32, f32) = (1.0, 0.10);
/// The same of what a cut or the end of the scan lays open.
pub(super) const LAID_OPEN: (f32, f32) = (0.45, 0.0);

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

    /// Colours in linear light, by channel.
    #[inline(always)]
    pub(super) fn linear(&self, colours: &[[u8; 3]; WIDE]) -> [[f32; WIDE]; 3] {
        let mut linear = [[0.0; WIDE]; 3];
        for lane in 0..WIDE {
            for channel in 0..3 {
                linear[channel][lane] = self.srgb.linear(colours[lane][channel]);
            }
        }
        linear
    }

    /// sRGB and opacity of 255 of eight pixels, given their colours in linear light, by channel.
    #[inline(always)]
    pub(super) fn shade(&self, linear: &[[f32; WIDE]; 3], eight: &Eight) -> [[u8; 4]; WIDE] {
        let normals = eight.unit_normals();
        let mut steps = [[0.0; WIDE]; 3];
        for lane in 0..WIDE {
            let mut diffuse = AMBIENT;
            for light in &self.lights {
                // A light reaches a little around the edge of its shadow, as in tissue, and fades out.
                let facing = positive(normals.dot(light.direction, lane) + WRAP) / (1.0 + WRAP);
                diffuse += light.strength * facing * facing;
            }
            let diffuse = eight.light[lane] * diffuse;
            let shine = power_32(normals.dot(self.half, lane)) * eight.gloss[lane];
            for channel in 0..3 {
                steps[channel][lane] = Srgb::step(linear[channel][lane] * diffuse + shine);
            }
        }
        let mut shaded = [[u8::MAX; 4]; WIDE];
        for (lane, shaded) in shaded.iter_mut().enumerate() {
            for channel in 0..3 {
                shaded[channel] = self.srgb.encoded(steps[channel][lane]);
            }
        }
        if self.opacity < 1.0 {
            for (lane, shaded) in shaded.iter_mut().enumerate() {
                shaded[3] = self.opacity(normals.z[lane]);
            }
        }
        shaded
    }

    /// What is translucent is seen through a longer way where it is seen edge on.
    fn opacity(&self, facing: f32) -> u8 {
        let way = 1.0 / facing.max(0.25);
        let opacity = 1.0 - libm::powf(1.0 - self.opacity, way);
        (opacity * 255.0 + 0.5) as u8
    }
}

/// Eight pixels to shade.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eight {
    /// Normals of any length that is finite: right, up, towards the viewer.
    pub normals: Normals,
    /// Share of the light that they return: [`SURFACE`] or [`LAID_OPEN`].
    pub light: [f32; WIDE],
    /// Share of it that they mirror.
    pub gloss: [f32; WIDE],
}

/// Eight vectors, by component.
#[derive(Debug, Clone, Copy)]
pub(super) struct Normals {
    pub x: [f32; WIDE],
    pub y: [f32; WIDE],
    pub z: [f32; WIDE],
}

impl Normals {
    #[inline(always)]
    fn dot(&self, to: Vec3, lane: usize) -> f32 {
        self.x[lane] * to.x + self.y[lane] * to.y + self.z[lane] * to.z
    }
}

impl Eight {
    /// Of length 1; towards the viewer where there is none.
    #[inline(always)]
    fn unit_normals(&self) -> Normals {
        let mut unit = self.normals;
        for lane in 0..WIDE {
            let (x, y, z) = (unit.x[lane], unit.y[lane], unit.z[lane]);
            let square = x * x + y * y + z * z;
            let inverse = 1.0 / square.sqrt();
            let (inverse, toward) = if square > 0.0 {
                (inverse, 0.0)
            } else {
                (0.0, 1.0)
            };
            unit.x[lane] = x * inverse;
            unit.y[lane] = y * inverse;
            unit.z[lane] = z * inverse + toward;
        }
        unit
    }
}

/// What is below 0, or no number, as 0.
#[inline(always)]
fn positive(value: f32) -> f32 {
    if value > 0.0 { value } else { 0.0 }
}

#[inline(always)]
fn power_32(value: f32) -> f32 {
    let mut power = positive(value);
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
        self.encoded(Self::step(value))
    }

    /// Where a value is in the table, what is beyond 0 and 1 as these: in the lowest bits of a number to which it was
    /// added and which rounds it.
    #[inline(always)]
    fn step(value: f32) -> f32 {
        const LIFT: f32 = (1 << 23) as f32;
        let value = positive(value);
        let value = if value < 1.0 { value } else { 1.0 };
        value * (STEPS - 1) as f32 + LIFT
    }

    #[inline(always)]
    fn encoded(&self, step: f32) -> u8 {
        self.encoded[step.to_bits() as usize % STEPS]
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
