//! Whose normals are computed anew at each pose, as a recipe says it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where shading normals are computed from the triangles of each pose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "it must be true, false or a list of names of meshes")]
pub enum NormalsRecipe {
    /// Everywhere, or nowhere.
    All(bool),
    /// At these meshes.
    Meshes(Vec<String>),
}

impl NormalsRecipe {
    /// Whether any are.
    #[must_use]
    pub fn is_any(&self) -> bool {
        !matches!(self, Self::All(false)) && self.meshes().is_none_or(|names| !names.is_empty())
    }

    /// The names of the meshes, where it is some.
    #[must_use]
    pub fn meshes(&self) -> Option<&[String]> {
        match self {
            Self::All(_) => None,
            Self::Meshes(names) => Some(names),
        }
    }
}
