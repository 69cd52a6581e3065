//! The model family and its sizes, as a recipe names them.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ParametrisationName;

/// Pose dimensions of `pca-linear` where none are asked for (Nowrouzezahrai et al. 2007, §5: they
/// hold 90 % of the variance of 54 joint angles).
pub const DEFAULT_INPUTS: u32 = 8;

/// Pose clusters of `multilinear` where none are asked for (Kirk and Arikan 2007, table 1).
pub const DEFAULT_POSE_CLUSTERS: u32 = 10;

/// Share of each cluster's variance that the `clustered` families keep (RPO09 §5.2).
pub const DEFAULT_CLUSTER_RETAINED: f64 = 0.95;

/// Share of the pose variance that they keep (PRT07 §5, as above).
pub const DEFAULT_CLUSTER_INPUTS: f64 = 0.9;

/// Spheres of `occluder` where none are asked for.
pub const DEFAULT_SPHERES: u32 = 100;

/// Groups of spheres that the points of a bone tell apart where no number is asked for.
pub const DEFAULT_GROUPS: u32 = 12;

/// Directions in which the union of occluders is looked at, for harmonics where no number is asked for.
pub const DEFAULT_DIRECTIONS: u32 = 256;

/// Output dimensions of `pca-linear` where none are asked for; likewise.
pub const DEFAULT_OUTPUTS: u32 = 22;

/// The model family and its sizes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FitRecipe {
    /// The family.
    pub family: FamilyName,
    /// Pose dimensions that `pca-linear` keeps, 1 to 4096. When absent 8, or as many as the poses
    /// have where that is fewer.
    pub inputs: Option<u32>,
    /// Output dimensions that `pca-linear` keeps, 1 to 4096. When absent 22, or as many as the data
    /// have where that is fewer; of `occluder` with harmonics as many as these have coefficients, where
    /// that is more.
    pub outputs: Option<u32>,
    /// Instead of `inputs`: the share of the pose variance that `pca-linear` keeps, in (0, 1]; `outputs` is
    /// stated or has its default. Of the `clustered` families 0.9 when both are absent.
    pub retain_inputs: Option<f64>,
    /// Instead of `outputs`: the share of the signal's variance over the poses that `pca-linear` keeps, in
    /// (0, 1]; `inputs` is stated or has its default. Of the `clustered` families 0.95 when both are absent.
    pub retain_outputs: Option<f64>,
    /// Pose clusters of `multilinear`, 1 to 4096, 10 when absent; clusters of points of the
    /// `clustered` families, when absent as many as the skin weights have.
    pub clusters: Option<u32>,
    /// Clusters of points that share coefficients in each pose cluster of `multilinear`; when
    /// absent every point has its own.
    pub point_clusters: Option<u32>,
    /// Instead of `point_clusters`: as many as it takes for this distance of every point from the
    /// mean of its cluster, root mean square in the units of the signal.
    pub point_threshold: Option<f64>,
    /// `multilinear` without intercepts, as Kirk and Arikan print it.
    pub published: bool,
    /// Exponent of the blend of `multilinear`, 0 to 100.
    pub blend_exponent: f64,
    /// Neurons of each cluster of `clustered-tanh`, 1 to 256; by cross-validation when absent.
    pub neurons: Option<u32>,
    /// How a pose becomes numbers, where it is not `poses.parametrisation`: needs no new bake.
    pub parametrisation: Option<ParametrisationName>,
    /// Whether the model leaves the unshadowed signal of the posed normal to whoever evaluates it,
    /// and learns only what occlusion takes away. When absent, true for `occluder` and false else.
    pub unshadowed: Option<bool>,
    /// Spheres on the bones of `occluder`, 1 to 4096. When absent 100; at least one for every bone.
    pub spheres: Option<u32>,
    /// Groups of spheres of `occluder` that the points of a bone tell apart, 1 to 64. When absent
    /// 12, or as many as the bones have where that is fewer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub groups: Option<u32>,
    /// Directions in which the union of the occluders is looked at, ellipsoids then: a multiple of 16
    /// from 64 to 4096, or 0 for the plain sum of what spheres block, which is quicker and less
    /// accurate. When absent 0 for ambient occlusion, else 256.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub directions: Option<u32>,
    /// Of `linear`: over which distance joints cease to matter, as a share of the diagonal of the mesh at
    /// rest, above 0 to 100. The points of each bone are fitted to parameters scaled by exp(−d/ℓ), ℓ that
    /// share of the diagonal and d the least distance, over the training poses, between the bone's points
    /// and what the parameter's joint moves against them: a prior of that deviation on their weights, not a
    /// cut. Morph weights count whole. When absent every joint may matter to every point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub local: Option<f64>,
    /// Distance, in typical ones of training poses, beyond which a pose is drawn towards the mean
    /// pose: 0 to 1000. When absent poses are taken as they are; a choice by target finds its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reach: Option<f32>,
    /// Whether a model that looks at the posed mesh carries the points at rest and what moves them,
    /// so that joint rotations are enough to evaluate it, over HTTP for one. A choice by target takes
    /// it into account: what it adds counts as bytes of each candidate that looks at the mesh.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub include_rest: bool,
    /// Names of pose parameters that the model does without; a choice by target finds its own.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub without: Vec<String>,
    /// Bands of the harmonics that the model keeps, 1 to the order of the bake; those above count as
    /// 0. All when absent; a choice by target finds its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bands: Option<u8>,
    /// The frame in which coefficients are modelled.
    pub frame: FrameName,
    /// How the regularisation is chosen. The weights of `occluder` are chosen by whole clips left out (in at
    /// most six groups; of a single clip by its contiguous quarters) in both ways that choose.
    pub ridge: RidgeName,
    /// The regularisation α where `ridge` is `fixed`, 0 or more: α²‖X‖² joins the sum of squares of the
    /// residual, so that it is in the units of the parameters' singular values. Of `occluder` the decoder of
    /// what occluders leave takes it so, and the points' weights take the same number as the share of a
    /// group's mean energy that holds them to the weights of their bone, 1e-4 to 1e4 where it is chosen.
    pub alpha: Option<f64>,
    /// Seed of randomised algorithms.
    pub seed: u64,
}

impl Default for FitRecipe {
    fn default() -> Self {
        Self {
            family: FamilyName::PcaLinear,
            inputs: None,
            outputs: None,
            retain_inputs: None,
            retain_outputs: None,
            clusters: None,
            point_clusters: None,
            point_threshold: None,
            published: false,
            blend_exponent: 10.0,
            neurons: None,
            parametrisation: None,
            unshadowed: None,
            spheres: None,
            groups: None,
            directions: None,
            local: None,
            reach: None,
            include_rest: false,
            without: Vec::new(),
            bands: None,
            frame: FrameName::Bone,
            ridge: RidgeName::LeaveOneClipOut,
            alpha: None,
            seed: 1,
        }
    }
}

/// The model families by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FamilyName {
    /// The mean over training poses.
    Mean,
    /// Linear in all pose parameters.
    Linear,
    /// Linear between principal components of poses and of signals.
    PcaLinear,
    /// Linear around each of several poses, blended (Kirk and Arikan 2007).
    Multilinear,
    /// What spheres on the bones block, weighted at each vertex, and `pca-linear` of what they leave
    /// (for ambient occlusion its mean, unless `inputs` are given); evaluation needs the posed mesh.
    Occluder,
    /// Clusters of points, each linear in the reduced pose (Nowrouzezahrai et al. 2009).
    ClusteredLinear,
    /// Likewise, with all products of two dimensions.
    ClusteredQuadratic,
    /// Likewise, through tanh neurons.
    ClusteredTanh,
}

impl fmt::Display for FamilyName {
    /// As in a recipe.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// Frames of coefficients by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FrameName {
    /// The character's root.
    Root,
    /// Each vertex's dominant bone.
    Bone,
    /// Each vertex's own: +Z its normal, +X a tangent that the skin carries. Reflection needs no
    /// rotation there; values in the root frame need the posed mesh.
    Tangent,
}

/// Ways to choose the regularisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RidgeName {
    /// Least error on poses left out one at a time.
    LeaveOneOut,
    /// Least error on clips left out one at a time; with one clip, on its contiguous quarters.
    LeaveOneClipOut,
    /// `alpha`.
    Fixed,
}
