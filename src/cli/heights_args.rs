//! The arguments of `poselight heights`.

use std::path::PathBuf;

use clap::Args;

use super::light_args::LIGHT_HELP;
use super::still_args::ToneArg;

/// Shade a height field, still or moving, from above: visibility by horizons.
#[derive(Debug, Args)]
pub(crate) struct HeightsArgs {
    /// Heights in metres, [row, column] or [frame, row, column] of f32 or f64; columns along +X, rows along
    /// -Z.
    #[arg(value_name = "FIELD.npy")]
    pub(crate) field: PathBuf,
    /// Metres between neighbours.
    #[arg(long, value_name = "METRES", default_value_t = 1.0)]
    pub(crate) cell: f32,
    #[arg(long, value_name = "LIGHT", default_value = "cone:-0.7,0.7,-0.4,25:6,6,6", help = format!("What shines. {LIGHT_HELP}"))]
    pub(crate) light: String,
    /// Degrees to turn the light by about +Y, counter-clockwise seen from above.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) turn: f64,
    /// Order of visibility and light, 1 to 10.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub(crate) order: u8,
    /// An isotropic reflectance, as `poselight brdf` reads it.
    #[arg(long, value_name = "BRDF", default_value = "lambert:1")]
    pub(crate) brdf: String,
    /// Terms of the reflectance's operator.
    #[arg(long, value_name = "K", default_value_t = 8)]
    pub(crate) terms: usize,
    /// Zonal lobes that stand for the light, 1 to 8.
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub(crate) lobes: usize,
    /// Azimuths of the horizon, 4 to 256.
    #[arg(long, value_name = "N", default_value_t = 32)]
    pub(crate) azimuths: usize,
    /// Frames per second of a moving field, 0.1 to 100.
    #[arg(long, value_name = "FPS", default_value_t = 12.0)]
    pub(crate) speed: f32,
    /// How light is brought within the screen's range.
    #[arg(long, value_enum, default_value_t = ToneArg::Linear)]
    pub(crate) tone: ToneArg,
    /// Stops of exposure; at 0 the brightest open white surface is white.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) exposure: f32,
    /// The picture to write, animated where the field is.
    #[arg(short, long, value_name = "OUT.png")]
    pub(crate) output: PathBuf,
}
