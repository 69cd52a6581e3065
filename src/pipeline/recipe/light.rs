//! What the pictures of a run are lit and shaded by, as a recipe says it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The light of a report's pictures, which are ambient occlusion without one. No part of it is in any
/// hash: neither data set nor model depends on it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LightRecipe {
    /// `constant`, `directional:X,Y,Z`, `cone:X,Y,Z,DEGREES` or `sphere:X,Y,Z,RADIUS`, each with `:R,G,B`
    /// after it or white; or the file name of a map (`.hdr`, `.exr`), of which only the name remains in a
    /// stored recipe.
    pub source: String,
    /// SHA-256 of the map, in hexadecimal; filled in when the recipe is resolved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Degrees that the light is turned by about +Y, counter-clockwise seen from above.
    pub turn_degrees: f64,
    /// Bands that fade out, against ringing; they stop when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub window: Option<WindowRecipe>,
    /// An isotropic reflectance, for the signal `visibility`: `lambert:ALBEDO`,
    /// `phong:DIFFUSE,SPECULAR,EXPONENT`, `ggx:F0,ALPHA` or `ashikhmin-shirley:DIFFUSE,SPECULAR,N,N`;
    /// or the name of a file in the binary format of MERL (`.binary`), of which only the name remains in
    /// a stored recipe; white when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub brdf: Option<String>,
    /// SHA-256 of that file, in hexadecimal; filled in when the recipe is resolved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub brdf_sha256: Option<String>,
    /// Terms of the reflectance's operator, 1 to the square of the bake's order.
    pub terms: u32,
    /// Zonal lobes that stand for the light where it is reflected, 1 to 8.
    pub lobes: u32,
}

impl Default for LightRecipe {
    fn default() -> Self {
        Self {
            source: "constant".to_owned(),
            sha256: None,
            turn_degrees: 0.0,
            window: None,
            brdf: None,
            brdf_sha256: None,
            terms: 8,
            lobes: 8,
        }
    }
}

/// How bands fade out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WindowRecipe {
    /// Its shape.
    pub kind: WindowName,
    /// Bands until it is closed, the bake's order when absent; of `laplacian` its strength, 0.01 when
    /// absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<f64>,
}

/// Shapes of windows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WindowName {
    /// (1 + cos(πl/size))/2.
    Hann,
    /// sin(πl/size)/(πl/size).
    Lanczos,
    /// 1/(1 + size·l²(l+1)²).
    Laplacian,
}
