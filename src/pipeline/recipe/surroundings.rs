//! What stands around the character, as a recipe says it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What stands around the character, and what of it is not seen. Empty by default.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SurroundingsRecipe {
    /// Level ground. Only turning about the vertical and moving in the plane are then taken out of
    /// the character's motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<GroundRecipe>,
    /// A scene whose triangles block and get no values. It stands still, so nothing is taken out
    /// of the character's motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub occluders: Option<OccludersRecipe>,
    /// A scene that gets values, and blocks nothing of the character: what the character casts its
    /// shadow on. It keeps its place in the character's root frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub receivers: Option<ReceiversRecipe>,
    /// Nodes of the scene that block, with all below them, and get no values. Where one does not
    /// hang below the character's root, nothing is taken out of the character's motion.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub occluder_nodes: Vec<String>,
    /// Meshes that do not block their own points. Of several nodes that show one, each is itself; a pair of
    /// a mesh with itself in `ignore` is all of them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ignore_self: Vec<String>,
    /// Pairs of meshes that do not block one another.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ignore: Vec<[String; 2]>,
    /// Materials that are masked or blended let rays through by their alpha; else they block as a
    /// whole. What only blocks and what receives are no exception.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub transparency: bool,
    /// Materials that are not double-sided block from their front alone; else both sides block.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub one_sided: bool,
    /// With `vertex_fit`: the facets are the surface that is meant. Else rays between vertices start on the
    /// smooth surface that the vertices' normals mean, so that coarse facets do not shadow one another.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub faceted: bool,
    /// Metres below which nothing blocks; 0 when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_distance_m: Option<f32>,
    /// Ambient occlusion with a maximum distance D: what is hit at d takes away (1 − d/D)^falloff.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub falloff: Option<f32>,
}

/// Where level ground is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GroundRecipe {
    /// At the lowest point over all poses.
    Lowest,
    /// At this height, metres along +Y.
    HeightM(f32),
}

/// A scene that only blocks.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OccludersRecipe {
    /// File name of a `.glb`, `.gltf` or `.obj`; in a stored recipe only the name remains.
    pub file: String,
    /// SHA-256 over its files, in hexadecimal; filled in when the recipe is resolved.
    pub sha256: Option<String>,
}

/// A scene that receives shadows. It moves with the character as far as the character's motion is taken
/// out: with all of it where nothing stands around, with walking and turning on level ground, and not at
/// all beside occluders that stand still.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReceiversRecipe {
    /// File name of a `.glb`, `.gltf` or `.obj`; in a stored recipe only the name remains.
    pub file: String,
    /// SHA-256 over its files, in hexadecimal; filled in when the recipe is resolved.
    pub sha256: Option<String>,
}

impl SurroundingsRecipe {
    /// Whether nothing is asked for; such a recipe is not written.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
