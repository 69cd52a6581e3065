//! The arguments of `poselight still`.

use std::path::PathBuf;

use clap::Args;

use super::light_args::LIGHT_HELP;
use super::look_args::{SamplingFlags, ScreenFlags};

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
    /// Shade by a reflectance, as `poselight brdf` reads it, a grain along the limbs, or by an operator
    /// that it wrote, of which rays follow the words that it was made of; beside it goes a model
    /// of visibility [default: white].
    #[arg(long, value_name = "BRDF", requires = "light")]
    pub(crate) brdf: Option<String>,
    /// Terms of the reflectance's operator, on a model [default: 8].
    #[arg(long, value_name = "K", requires = "brdf", value_parser = clap::value_parser!(u16).range(1..=100))]
    pub(crate) terms: Option<u16>,
    /// Zonal lobes that stand for the light, on a model of visibility, 1 to 8 [default: 8].
    #[arg(long, value_name = "N", requires = "light", value_parser = clap::value_parser!(u8).range(1..=8))]
    pub(crate) lobes: Option<u8>,
    /// An animated PNG of so many frames around the scene, 2 to 240; with a clip and no time the clip
    /// plays once meanwhile.
    #[arg(long, value_name = "FRAMES", conflicts_with = "frames", value_parser = clap::value_parser!(u16).range(2..=240))]
    pub(crate) turntable: Option<u16>,
    /// Frames per second of a turntable, 0.1 to 100.
    #[arg(long, value_name = "FPS", default_value_t = 12.0)]
    pub(crate) speed: f32,
    #[command(flatten)]
    pub(crate) screen: ScreenFlags,
    /// Degrees to look from about +Y, from +Z towards +X.
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0, allow_negative_numbers = true)]
    pub(crate) yaw: f32,
    /// Degrees to look down from, -89 to 89.
    #[arg(long, value_name = "DEGREES", default_value_t = 10.0, allow_negative_numbers = true)]
    pub(crate) pitch: f32,
    /// Pixels of a panel, across and down, 16 to 4096.
    #[arg(long, num_args = 2, value_names = ["WIDTH", "HEIGHT"], default_values_t = [400, 560])]
    pub(crate) size: Vec<u32>,
    #[command(flatten)]
    pub(crate) sampling: SamplingFlags,
    /// The picture to write.
    #[arg(short, long, value_name = "OUT.png")]
    pub(crate) output: PathBuf,
}
