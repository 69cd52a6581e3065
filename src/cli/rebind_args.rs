//! The arguments of a rebind.

use std::path::PathBuf;

use clap::Args;

#[derive(Debug, Args)]
pub(crate) struct RebindArgs {
    /// The model.
    pub(crate) model: PathBuf,
    /// The re-exported scene (.glb, .gltf).
    pub(crate) scene: PathBuf,
    /// The scene that the model was baked from, where the model does not carry its mesh at rest
    /// (--include-rest); its edges tell vertices apart that are at one place.
    #[arg(long, value_name = "SCENE")]
    pub(crate) original: Option<PathBuf>,
    /// How far a vertex may be from its point at rest, over the character's size [default: 0.001].
    #[arg(long, value_name = "SHARE")]
    pub(crate) tolerance: Option<f32>,
    /// The share of the vertices that may match no point and take the nearest one's values
    /// [default: 0].
    #[arg(long, value_name = "SHARE")]
    pub(crate) unmatched: Option<f32>,
    /// The model to write.
    #[arg(short, long, value_name = "MODEL.safetensors")]
    pub(crate) output: PathBuf,
}
