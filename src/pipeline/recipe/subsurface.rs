//! What light does below the surface, as a recipe says it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Light that enters the surface at one place and leaves it at another: a measured material, or
/// lengths of one's own. Lengths are those of the scene's units, which glTF calls metres.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SubsurfaceRecipe {
    /// `skin`, `pale-skin`, `marble`, `milk`, `potato` or `apple` (Jensen et al. 2001); absent where
    /// lengths are given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
    /// Reduced mean free path of red, green and blue light, metres; above 0 and at most the size of
    /// the mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_free_path_m: Option<[f32; 3]>,
    /// Absorption of red, green and blue light, 1/metre, from 0 to below the inverse of the mean
    /// free path; 0 when absent. Only with lengths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absorption_per_m: Option<[f32; 3]>,
    /// Refractive index, 1 to 3; 1.3 when absent. Only with lengths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refractive_index: Option<f32>,
    /// Meshes of the material, by name; all of the scene's where there are none. Receivers are never of it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<String>,
}

/// Refractive index where none is given: that of skin.
pub const DEFAULT_REFRACTIVE_INDEX: f32 = 1.3;
