//! Flags that say what stands around the character.

use clap::Args;

use crate::pipeline::recipe::surroundings::{
    GroundRecipe, OccludersRecipe, ReceiversRecipe, SurroundingsRecipe,
};

#[derive(Debug, Args)]
#[command(next_help_heading = "Surroundings")]
pub(crate) struct SurroundingsFlags {
    /// Level ground: `lowest` for the lowest point over all poses, or a height in metres.
    #[arg(long, value_name = "HEIGHT", value_parser = ground, allow_negative_numbers = true)]
    ground: Option<GroundRecipe>,
    /// A scene whose triangles block and get no values; it stands still.
    #[arg(long, value_name = "SCENE")]
    occluders: Option<String>,
    /// A scene that gets values too and blocks nothing of the character; it keeps its place in the
    /// character's root frame.
    #[arg(long, value_name = "SCENE")]
    receivers: Option<String>,
    /// A node whose meshes, and those below it, block and get no values (may be repeated).
    #[arg(long, value_name = "NODE")]
    occluder_node: Vec<String>,
    /// A mesh that does not block its own points (may be repeated); nodes that show the same mesh block one
    /// another, but for --ignore MESH MESH.
    #[arg(long, value_name = "MESH")]
    ignore_self: Vec<String>,
    /// Two meshes that do not block one another (may be repeated).
    #[arg(long, num_args = 2, value_names = ["MESH", "MESH"])]
    ignore: Vec<String>,
    /// Let rays through masked and blended materials by their alpha.
    #[arg(long)]
    transparency: bool,
    /// Let rays through the backs of materials that are not double-sided.
    #[arg(long)]
    one_sided: bool,
    /// With --vertex-fit: start rays on the facets themselves, not on the smooth surface that the normals
    /// mean (which keeps coarse facets from shadowing one another).
    #[arg(long, requires = "vertex_fit")]
    faceted: bool,
    /// Metres below which nothing blocks [default: 0].
    #[arg(long, value_name = "METRES")]
    min_distance: Option<f32>,
    /// Ambient occlusion: what is hit at d takes away (1 − d/max-distance)^EXPONENT.
    #[arg(long, value_name = "EXPONENT")]
    falloff: Option<f32>,
}

fn ground(text: &str) -> Result<GroundRecipe, String> {
    if text == "lowest" {
        return Ok(GroundRecipe::Lowest);
    }
    let height = text.parse().ok().filter(|height: &f32| height.is_finite());
    height.map(GroundRecipe::HeightM).ok_or_else(|| "`lowest` or a height in metres".to_owned())
}

impl SurroundingsFlags {
    /// Edits the recipe's surroundings.
    pub(crate) fn edit(&self, around: &mut SurroundingsRecipe) {
        around.ground = self.ground.or(around.ground);
        if let Some(file) = &self.occluders {
            around.occluders = Some(OccludersRecipe { file: file.clone(), sha256: None });
        }
        if let Some(file) = &self.receivers {
            around.receivers = Some(ReceiversRecipe { file: file.clone(), sha256: None });
        }
        if !self.occluder_node.is_empty() {
            around.occluder_nodes.clone_from(&self.occluder_node);
        }
        if !self.ignore_self.is_empty() {
            around.ignore_self.clone_from(&self.ignore_self);
        }
        if !self.ignore.is_empty() {
            let pairs = self.ignore.chunks_exact(2);
            around.ignore = pairs.map(|pair| [pair[0].clone(), pair[1].clone()]).collect();
        }
        around.transparency |= self.transparency;
        around.one_sided |= self.one_sided;
        around.faceted |= self.faceted;
        around.min_distance_m = self.min_distance.or(around.min_distance_m);
        around.falloff = self.falloff.or(around.falloff);
    }
}
