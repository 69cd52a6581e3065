//! The arguments of `poselight crowd`.

use std::path::PathBuf;

use clap::Args;

use super::light_args::LIGHT_HELP;
use super::look_args::{MaterialFlags, SamplingFlags, ScreenFlags};

/// Render several characters that shadow one another and a floor: self-visibility from a model, cast
/// shadows from spheres, beside rays.
#[derive(Debug, Args)]
pub(crate) struct CrowdArgs {
    /// The scene (.glb, .gltf, .obj, .npz) whose character stands at every place.
    pub(crate) scene: PathBuf,
    /// A model of its `visibility`.
    #[arg(long, value_name = "MODEL")]
    pub(crate) model: PathBuf,
    /// Where a character stands, metres along +X and +Z, how far it is turned about +Y, and where in the
    /// clip it is (may be repeated, 1 to 16) [default: two, 0.8 m apart].
    #[arg(long, value_name = "X,Z[,DEGREES[,SECONDS]]", allow_hyphen_values = true)]
    pub(crate) place: Vec<String>,
    /// A clip; the rest pose when absent.
    #[arg(long, value_name = "NAME")]
    pub(crate) clip: Option<String>,
    /// Spheres that cast the shadows of one character, 1 to 1000.
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub(crate) spheres: usize,
    #[arg(long, value_name = "LIGHT", default_value = "cone:0.5,1,0.3,25:6,6,6", help = format!("What shines. {LIGHT_HELP}"))]
    pub(crate) light: String,
    #[command(flatten)]
    pub(crate) material: MaterialFlags,
    /// How much a difference is magnified (may be repeated) [default: 4].
    #[arg(long, value_name = "GAIN")]
    pub(crate) gain: Vec<f32>,
    #[command(flatten)]
    pub(crate) screen: ScreenFlags,
    /// Degrees to look from about +Y, from +Z towards +X.
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0, allow_negative_numbers = true)]
    pub(crate) yaw: f32,
    /// Degrees to look down from, -89 to 89.
    #[arg(long, value_name = "DEGREES", default_value_t = 25.0, allow_negative_numbers = true)]
    pub(crate) pitch: f32,
    /// Pixels of a panel, across and down, 16 to 4096.
    #[arg(long, num_args = 2, value_names = ["WIDTH", "HEIGHT"], default_values_t = [560, 420])]
    pub(crate) size: Vec<u32>,
    #[command(flatten)]
    pub(crate) sampling: SamplingFlags,
    /// The picture to write.
    #[arg(short, long, value_name = "OUT.png")]
    pub(crate) output: PathBuf,
}
