//! The recipe: one versioned JSON document that says everything about a job.
//!
//! This is the raw form, as a user writes it; [`super::Checked`] is what runs. Every field may be
//! left out and then takes the default given here, the one place where defaults live.

mod fit;
pub mod light;
mod normals;
pub mod subdivide;
pub mod subsurface;
pub mod surroundings;

pub use fit::{
    DEFAULT_CLUSTER_INPUTS, DEFAULT_CLUSTER_RETAINED, DEFAULT_DIRECTIONS, DEFAULT_GROUPS,
    DEFAULT_INPUTS, DEFAULT_OUTPUTS, DEFAULT_POSE_CLUSTERS, DEFAULT_SPHERES, FamilyName, FitRecipe,
    FrameName, RidgeName,
};
pub use normals::NormalsRecipe;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use light::LightRecipe;
use subdivide::SubdivideRecipe;
use subsurface::SubsurfaceRecipe;
use surroundings::SurroundingsRecipe;

/// The version that this crate reads and writes.
pub const VERSION: u32 = 1;

/// A whole job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Version of the document, 1.
    pub version: u32,
    /// What is baked.
    #[serde(default)]
    pub scene: SceneRecipe,
    /// How its mesh is refined first; not at all when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subdivide: Option<SubdivideRecipe>,
    /// In which poses.
    #[serde(default)]
    pub poses: PosesRecipe,
    /// Which signal, how finely.
    #[serde(default)]
    pub bake: BakeRecipe,
    /// Which model.
    #[serde(default)]
    pub fit: FitRecipe,
    /// What the model is for, and how its error is proven.
    #[serde(default)]
    pub target: TargetRecipe,
    /// What the report's pictures are lit by; ambient occlusion when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<LightRecipe>,
    /// What is written.
    #[serde(default)]
    pub output: OutputRecipe,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            version: VERSION,
            scene: SceneRecipe::default(),
            subdivide: None,
            poses: PosesRecipe::default(),
            bake: BakeRecipe::default(),
            fit: FitRecipe::default(),
            target: TargetRecipe::default(),
            light: None,
            output: OutputRecipe::default(),
        }
    }
}

impl Recipe {
    /// Reads a recipe. Its fields are checked by [`super::Checked`]; only the version is looked at
    /// here, before all else, since fields of another version would be called unknown.
    ///
    /// # Errors
    /// Text that is no JSON, another version, unknown fields, values of a wrong type.
    pub fn from_json(bytes: &[u8]) -> Result<Self, serde_json::Error> {
        #[derive(Deserialize)]
        struct Document {
            version: u32,
        }
        let Document { version } = serde_json::from_slice(bytes)?;
        if version != VERSION {
            let reason = format!("it has version {version}; this build reads version {VERSION}");
            return Err(serde::de::Error::custom(reason));
        }
        serde_json::from_slice(bytes)
    }
}

/// The scene to bake.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SceneRecipe {
    /// File name of a `.glb`, `.gltf` or `.obj`. In a stored recipe only the name remains, for its
    /// bytes are named by `sha256`.
    pub file: String,
    /// SHA-256 over the scene's files, in hexadecimal; filled in when the recipe is resolved.
    pub sha256: Option<String>,
}

/// The poses to bake, and which of them prove the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PosesRecipe {
    /// Names of the clips to use; all when absent.
    pub clips: Option<Vec<String>>,
    /// Names of the clips that are kept from training and measure novel motion. When absent, a
    /// quarter of the clips chosen by `seed`; for a scene of one clip, its last quarter.
    pub hold_out: Option<Vec<String>>,
    /// Poses per second of clip, hertz, 0.1 to 1000.
    pub rate_hz: f32,
    /// Every k-th pose of a training clip is kept from training, to measure interpolation; 0 keeps
    /// none.
    pub interpolated_every: u32,
    /// A pose that differs from an earlier one of its split by less than this in every parameter
    /// (radians, lengths over the model's size, morph weights) is dropped; 0 drops none.
    pub near_repeat: f32,
    /// Training poses, at most, 1 to 200,000, chosen one after another by `choice`, so that a larger
    /// number takes the same poses and more. All when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub most: Option<u32>,
    /// What those of `most` are chosen by, each in view of those before it.
    #[serde(skip_serializing_if = "PoseChoiceName::is_default")]
    pub choice: PoseChoiceName,
    /// Further training poses, 0 to 200,000: limbs of different training frames of a clip together, so that a
    /// fit does not take for a rule what merely happened at the same time.
    #[serde(skip_serializing_if = "is_zero")]
    pub mixed: u32,
    /// How a pose becomes numbers.
    pub parametrisation: ParametrisationName,
    /// Seed of every choice of poses.
    pub seed: u64,
}

impl Default for PosesRecipe {
    fn default() -> Self {
        Self {
            clips: None,
            hold_out: None,
            rate_hz: 30.0,
            interpolated_every: 10,
            near_repeat: 0.005,
            most: None,
            choice: PoseChoiceName::Distance,
            mixed: 0,
            parametrisation: ParametrisationName::JointAngles,
            seed: 1,
        }
    }
}

/// What few of many training poses are chosen by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PoseChoiceName {
    /// The pose farthest from those that were chosen, by where the joints are.
    Distance,
    /// The pose at which a model of those is predicted to be most wrong: the posterior deviation of a Gaussian
    /// process over where the joints are.
    PredictedError,
}

impl PoseChoiceName {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    fn is_default(&self) -> bool {
        *self == Self::Distance
    }
}

/// How a pose becomes numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ParametrisationName {
    /// Rotation vectors relative to each joint's mean rotation, with animated lengths, scales and
    /// morph weights.
    JointAngles,
    /// Where every joint is in the root frame, and a point beside each bone (Kirk and Arikan 2007),
    /// over the model's size; and morph weights.
    Handles,
    /// How far the mesh folds at its edges, for cloth and whatever has no joints: at those edges that
    /// tell the training poses apart, at most 64. Sequences of meshes have no other.
    Dihedral,
}

/// The signal and how finely it is sampled.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BakeRecipe {
    /// What is baked at every point.
    pub signal: SignalName,
    /// Order of the spherical harmonics, 1 to 10: n² coefficients. Ambient occlusion has one
    /// number whatever the order.
    pub order: u8,
    /// Rays per point and pose, 1 to 1,000,000; with `noise` the most.
    pub rays: u32,
    /// As many rays at each point and pose as it takes for this standard error of a coefficient.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<f32>,
    /// What `noise` and `more_noise` are meant for; `each` when absent, and filled in when the recipe is resolved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise_goal: Option<NoiseGoalName>,
    /// Metres beyond which nothing occludes; unbounded when absent.
    pub max_distance_m: Option<f32>,
    /// Seed of all directions.
    pub seed: u64,
    /// How often light is passed on by other surfaces before it reaches a point, 0 to 8; for the
    /// signal `transfer`. Reflectances are the materials' base colours.
    #[serde(skip_serializing_if = "is_zero")]
    pub bounces: u32,
    /// Further rounds of so many rays each at every point and pose, 1 to 1,000,000 each, with
    /// directions of their own; values are the mean over all rays.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub more_rays: Vec<u32>,
    /// Further rounds, after those of `more_rays`: each adds as many rays of its own at each point as it
    /// takes for the mean over all rounds to have this standard error, lower than the one before it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub more_noise: Vec<f32>,
    /// The most rays of a round of `more_noise` at a point, 1 to 1,000,000; when absent those of `rays` where
    /// there is a `noise`, else 16,384.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub most_rays: Option<u32>,
    /// Whether, or of which meshes, shading normals of each pose are computed from its triangles; when absent, and
    /// then filled in, of meshes morphed by targets that move positions and no normals.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recompute_normals: Option<NormalsRecipe>,
    /// Values at vertices are fitted by least squares to this many samples for each vertex, all over
    /// the surface and each of `rays`, 1 to 1024; sampled at the vertices when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertex_fit: Option<u32>,
    /// With bounces, the reflectance of parts without a material, 0 to 1; 0.5 when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub albedo: Option<f32>,
    /// What light does below the surface, for the signal `transfer`; nothing when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub subsurface: Option<SubsurfaceRecipe>,
    /// What stands around the character.
    #[serde(skip_serializing_if = "SurroundingsRecipe::is_empty")]
    pub surroundings: SurroundingsRecipe,
}

/// The most rays of a point where a noise is asked for and no rays are stated.
pub const MOST_RAYS_TO_NOISE: u32 = 16_384;

/// Reflectance of parts without a material where none is given.
pub const DEFAULT_ALBEDO: f32 = 0.5;

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(count: &u32) -> bool {
    *count == 0
}

impl Default for BakeRecipe {
    fn default() -> Self {
        Self {
            signal: SignalName::Transfer,
            order: 6,
            rays: 500,
            noise: None,
            noise_goal: None,
            max_distance_m: None,
            seed: 1,
            bounces: 0,
            more_rays: Vec::new(),
            more_noise: Vec::new(),
            most_rays: None,
            recompute_normals: None,
            vertex_fit: None,
            albedo: None,
            subsurface: None,
            surroundings: SurroundingsRecipe::default(),
        }
    }
}

/// The signals by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SignalName {
    /// Ambient occlusion, (1/π) ∫ V (n·ω)₊ dω: 1 where nothing occludes.
    Ao,
    /// Spherical harmonics of V over the whole sphere.
    Visibility,
    /// Spherical harmonics of V (n·ω)₊ / π: a dot product with a light gives shading.
    Transfer,
}

/// What a target noise is meant for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseGoalName {
    /// It is exceeded at no point, as far as can be told beforehand.
    Each,
    /// It is the root mean square over the points of each pose, with the least rays in all.
    Mean,
}

/// What the model is for, and how its error is proven.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TargetRecipe {
    /// The motion that counts: `trained` is compression and uses no regularisation.
    pub on: OnName,
    /// The model is measured against references of this many times the bake's rays, 8 to 1024.
    pub reference_factor: u32,
    /// Poses of each split that the references cover, chosen by seed; all where a split has fewer.
    pub reference_poses: u32,
    /// Largest novel error accepted, as RMSE of a coefficient; when missed, the exit status is 3.
    pub max_error: Option<f32>,
    /// Largest blob accepted, bytes.
    pub max_bytes: Option<u64>,
    /// Longest evaluation accepted, microseconds for all coefficients on one core.
    pub max_us: Option<f64>,
    /// Longest fit accepted, seconds.
    pub max_fit_s: Option<f64>,
    /// What a run leaves to the target.
    #[serde(skip_serializing_if = "ChooseName::is_nothing")]
    pub choose: ChooseName,
}

/// What a target chooses. (`fit` on a data set chooses wherever a target is stated.)
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ChooseName {
    /// Nothing: the model is what `fit` and `output` say, and is judged by the target.
    #[default]
    Nothing,
    /// Sizes and precision of the family that `fit` names.
    Sizes,
    /// Family, sizes and precision.
    Any,
}

impl ChooseName {
    // The signature is serde's.
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "skip_serializing_if asks for it")]
    fn is_nothing(&self) -> bool {
        *self == Self::Nothing
    }
}

impl Default for TargetRecipe {
    fn default() -> Self {
        Self {
            on: OnName::Novel,
            reference_factor: 8,
            reference_poses: 100,
            max_error: None,
            max_bytes: None,
            max_us: None,
            max_fit_s: None,
            choose: ChooseName::Nothing,
        }
    }
}

/// The motion that a model is meant for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OnName {
    /// Motion that was not trained on.
    Novel,
    /// The training motion itself.
    Trained,
}

/// What is written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OutputRecipe {
    /// How the model's numbers are stored.
    pub precision: PrecisionName,
}

impl Default for OutputRecipe {
    fn default() -> Self {
        Self { precision: PrecisionName::F32 }
    }
}

/// Storage of a model's numbers by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PrecisionName {
    /// 32-bit floating point.
    F32,
    /// 16-bit floating point.
    F16,
    /// 8-bit integers with a scale per column.
    I8,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str) -> String {
        Recipe::from_json(text.as_bytes()).expect_err("must be refused").to_string()
    }

    /// What is written is read again; what is left out takes its default.
    #[test]
    fn a_recipe_survives_being_written() {
        let recipe = Recipe::default();
        let json = serde_json::to_vec(&recipe).expect("written");
        assert_eq!(Recipe::from_json(&json).expect("read"), recipe);
        assert_eq!(Recipe::from_json(br#"{"version":1}"#).expect("read"), recipe);
    }

    /// A later version is named as such, whatever fields it brings; in ours a field that does not
    /// exist is named with those that do; and nesting beyond reason is refused, not recursed into.
    #[test]
    fn what_is_no_recipe_is_refused_with_the_reason() {
        let later = fault(r#"{"version":7,"surprise":[]}"#);
        assert_eq!(later, "it has version 7; this build reads version 1");
        assert!(fault(r#"{"version":1,"bake":{"ray":5}}"#).contains("unknown field `ray`"));
        assert!(fault("{}").contains("missing field `version`"));
        assert!(fault(r#"{"version":1,"bake":{"rays":1e999}}"#).contains("out of range"));
        let deep = ["[".repeat(10_000), "]".repeat(10_000)].concat();
        assert!(fault(&format!(r#"{{"version":1,"scene":{deep}}}"#)).contains("invalid type"));
    }
}
