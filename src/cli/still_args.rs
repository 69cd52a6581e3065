//! The arguments of `poselight still`.

use std::path::PathBuf;

use clap::Args;

use super::light_args::LIGHT_HELP;

#[derive(Debug, Args)]
pub(crate) struct StillArgs {
    /// The scene (.glb, .gltf, .obj, .npz).
    pub(crate) scene: PathBuf,
    /// A clip; the rest pose when absent.
    #[arg(long, value_name = "NAME")]
    pub(crate) clip: Option<String>,
    /// Seconds into the clip [default: its middle].
    #[arg(long, value_name = "SECONDS", requires = "clip", conflicts_with = "frames")]
    pub(crate) time: Option<f32>,
    /// A contact sheet of this many frames, from the clip's first to its last.
    #[arg(long, value_name = "N", requires = "clip", value_parser = clap::value_parser!(u16).range(1..=64))]
    pub(crate) frames: Option<u16>,
    /// Show this model beside the truth, and their difference.
    #[arg(long, value_name = "MODEL")]
    pub(crate) model: Option<PathBuf>,
    /// How much a difference is magnified (may be repeated) [default: 4].
    #[arg(long, value_name = "GAIN", requires = "model")]
    pub(crate) gain: Vec<f32>,
    #[arg(long, value_name = "LIGHT", help = format!("Shade by a light, else by ambient occlusion. {LIGHT_HELP}"))]
    pub(crate) light: Option<String>,
    /// Degrees to turn the light by about +Y, counter-clockwise seen from above.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) turn: f64,
    /// Order of the light's harmonics, 1 to 10; a model's own when one is shown.
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub(crate) order: u8,
    /// Shade by an isotropic reflectance in closed form, as `poselight brdf` reads it; beside it goes
    /// a model of visibility [default: white].
    #[arg(long, value_name = "BRDF", requires = "light")]
    pub(crate) brdf: Option<String>,
    /// Stops of exposure; at 0 the brightest open white surface is white.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) exposure: f32,
    /// Degrees to look from about +Y, from +Z towards +X.
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0, allow_negative_numbers = true)]
    pub(crate) yaw: f32,
    /// Degrees to look down from, -89 to 89.
    #[arg(long, value_name = "DEGREES", default_value_t = 10.0, allow_negative_numbers = true)]
    pub(crate) pitch: f32,
    /// Pixels of a panel, across and down, 16 to 4096.
    #[arg(long, num_args = 2, value_names = ["WIDTH", "HEIGHT"], default_values_t = [400, 560])]
    pub(crate) size: Vec<u32>,
    /// Samples of a pixel, across and down, 1 to 8.
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub(crate) samples: u32,
    /// Rays of each sample of the truth.
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub(crate) rays: u32,
    /// The picture to write.
    #[arg(short, long, value_name = "OUT.png")]
    pub(crate) output: PathBuf,
}
