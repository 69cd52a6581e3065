//! The arguments of `check`.

use std::path::PathBuf;

use clap::Args;

use super::args::RecipeArgs;

/// Run a scene and compare its figures with approved ones; exit status 3 where one is worse.
#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    /// The scene (.glb, .gltf, .obj, .npz).
    pub(crate) scene: PathBuf,
    /// The approved figures with their recipe, as `--approve` writes them.
    #[arg(long, value_name = "FILE.json")]
    pub(crate) baseline: PathBuf,
    /// Run the scene and write the baseline anew, by `--recipe` or the defaults.
    #[arg(long)]
    pub(crate) approve: bool,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    /// How much worse a figure may be.
    #[arg(long, value_name = "PERCENT", default_value_t = 5.0, value_parser = percent)]
    pub(crate) tolerance: f32,
    /// Write the comparison as JUnit XML.
    #[arg(long, value_name = "FILE.xml")]
    pub(crate) junit: Option<PathBuf>,
    /// Write the comparison as a page.
    #[arg(long, value_name = "FILE.html")]
    pub(crate) page: Option<PathBuf>,
    /// The folder to work in, which the next check continues; a temporary one when absent.
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
}

fn percent(text: &str) -> Result<f32, String> {
    let value: f32 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.0..=1000.0).contains(&value) { Ok(value) } else { Err("0 to 1000 are expected".into()) }
}
