//! The arguments of `poselight crowd`.

use std::path::PathBuf;

use clap::Args;

use super::light_args::LIGHT_HELP;
use super::still_args::ToneArg;

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
    /// Degrees to turn the light by about +Y, counter-clockwise seen from above.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) turn: f64,
    /// An isotropic reflectance of characters and floor, as `poselight brdf` reads it.
    #[arg(long, value_name = "BRDF", default_value = "lambert:1")]
    pub(crate) brdf: String,
    /// Terms of the reflectance's operator.
    #[arg(long, value_name = "K", default_value_t = 8)]
    pub(crate) terms: usize,
    /// Zonal lobes that stand for the light, 1 to 8.
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub(crate) lobes: usize,
    /// How much a difference is magnified (may be repeated) [default: 4].
    #[arg(long, value_name = "GAIN")]
    pub(crate) gain: Vec<f32>,
    /// How light is brought within the screen's range; differences never are.
    #[arg(long, value_enum, default_value_t = ToneArg::Linear)]
    pub(crate) tone: ToneArg,
    /// Stops of exposure; at 0 the brightest open white surface is white.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) exposure: f32,
    /// Degrees to look from about +Y, from +Z towards +X.
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0, allow_negative_numbers = true)]
    pub(crate) yaw: f32,
    /// Degrees to look down from, -89 to 89.
    #[arg(long, value_name = "DEGREES", default_value_t = 25.0, allow_negative_numbers = true)]
    pub(crate) pitch: f32,
    /// Pixels of a panel, across and down, 16 to 4096.
    #[arg(long, num_args = 2, value_names = ["WIDTH", "HEIGHT"], default_values_t = [560, 420])]
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
