//! Flags that commands which make pictures have in common.

use clap::{Args, ValueEnum};

use crate::pipeline::{GLOSS_LOBES, GLOSS_TERMS};
use crate::render::Tone;

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum ToneArg {
    /// As it is, cut off at white.
    Linear,
    /// A film's curve.
    Filmic,
}

impl From<ToneArg> for Tone {
    fn from(flag: ToneArg) -> Self {
        match flag {
            ToneArg::Linear => Self::Linear,
            ToneArg::Filmic => Self::Filmic,
        }
    }
}

/// From light to the screen.
#[derive(Debug, Args)]
pub(crate) struct ScreenFlags {
    /// How light is brought within the screen's range; differences never are.
    #[arg(long, value_enum, default_value_t = ToneArg::Linear)]
    pub(crate) tone: ToneArg,
    /// Stops of exposure; at 0 the brightest open white surface is white.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) exposure: f32,
}

/// How finely a picture looks.
#[derive(Debug, Args)]
pub(crate) struct SamplingFlags {
    /// Samples of a pixel, across and down, 1 to 8.
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub(crate) samples: u32,
    /// Rays of each sample of the truth.
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub(crate) rays: u32,
}

/// What everything in a picture is made of, and how the light stands.
#[derive(Debug, Args)]
pub(crate) struct MaterialFlags {
    /// Degrees to turn the light by about +Y, counter-clockwise seen from above.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) turn: f64,
    /// What all that is shaded reflects by: a reflectance as `poselight brdf` reads it, or an operator that
    /// it wrote.
    #[arg(long, value_name = "BRDF", default_value = "lambert:1")]
    pub(crate) brdf: String,
    /// Terms of the reflectance's operator, 1 to the square of the order.
    #[arg(long, value_name = "K", default_value_t = GLOSS_TERMS)]
    pub(crate) terms: usize,
    /// Zonal lobes that stand for the light, 1 to 8.
    #[arg(long, value_name = "N", default_value_t = GLOSS_LOBES)]
    pub(crate) lobes: usize,
}
