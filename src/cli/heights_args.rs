//! The arguments of `poselight heights`.

use std::path::PathBuf;

use clap::Args;

use super::light_args::LIGHT_HELP;
use super::look_args::{MaterialFlags, ScreenFlags};

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
    /// Order of visibility and light, 1 to 10.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub(crate) order: u8,
    #[command(flatten)]
    pub(crate) material: MaterialFlags,
    /// Azimuths of the horizon, 4 to 256.
    #[arg(long, value_name = "N", default_value_t = 32)]
    pub(crate) azimuths: usize,
    /// Frames per second of a moving field, 0.1 to 100.
    #[arg(long, value_name = "FPS", default_value_t = 12.0)]
    pub(crate) speed: f32,
    #[command(flatten)]
    pub(crate) screen: ScreenFlags,
    /// The picture to write, animated where the field is.
    #[arg(short, long, value_name = "OUT.png")]
    pub(crate) output: PathBuf,
}
