//! How the scene's mesh is refined before it is baked, as a recipe says it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Triangles of the refined mesh over those of the scene, where no goal is stated.
pub const DEFAULT_GROWTH: u64 = 4;

/// The same where an error alone ends the refinement.
pub const MOST_GROWTH: u64 = 16;

/// Rays of each vertex while the mesh is refined, at most, where they are not stated.
pub const MOST_RAYS_TO_REFINE: u32 = 1024;

/// The constant a of the measure `curvature`, per radian, where it is not stated.
pub const DEFAULT_CURVATURE: f32 = 1.0;

/// The scene's mesh is refined where its transfer changes, and what is baked is the refined one.
/// Refining looks at direct light in the surroundings that `bake` states.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SubdivideRecipe {
    /// Triangles of the refined mesh at most, no less than the scene's and no more than 8,000,000; four
    /// times the scene's when no goal is given, sixteen times with `error` alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub triangles: Option<u64>,
    /// Vertices of the refined mesh at most, no less than the scene's and no more than 4,000,000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertices: Option<u64>,
    /// Bytes of the model at most, of the family and precision that the recipe states: `mean`, `linear`,
    /// or `pca-linear` of stated sizes. The mesh gets as many vertices as such a model has room for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Refining stops where no triangle's estimate is larger, in the measure's own unit: of `surplus` and
    /// `midpoint` square metres times transfer squared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f32>,
    /// How often a triangle may be split in four, 1 to 12.
    pub depth: u8,
    /// Triangles smaller than one whose sides all have this length are not split, in sizes of the
    /// character; 0 when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_edge: Option<f32>,
    /// What orders the triangles.
    pub measure: MeasureName,
    /// The constant a of the measures whose names begin with `curvature`, per radian, 0 and more; 1 when
    /// absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub curvature: Option<f32>,
    /// Poses at which the estimate is taken, of which the largest counts, 1 to 256.
    pub key_poses: u16,
    /// How far skinning may take a new vertex off its triangle, in sizes of the character.
    pub bound: f32,
    /// Edges that cannot meet the bound, and triangles beside them, stay whole; else they are split all the
    /// same, and named.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub keep_bound: bool,
    /// New vertices lie on the smooth surface that the normals mean (PN triangles), where the seams of
    /// normals let it; else in the triangles, whose surface stays what it was.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub smooth: bool,
    /// Rays of each vertex while the mesh is refined, 1 to 1,000,000; those of the bake when absent, but
    /// no more than 1024.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rays: Option<u32>,
    /// SHA-256 of the scene that was refined, in hexadecimal; filled in when that is done.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
}

impl Default for SubdivideRecipe {
    fn default() -> Self {
        Self {
            triangles: None,
            vertices: None,
            bytes: None,
            error: None,
            depth: 8,
            min_edge: None,
            measure: MeasureName::Surplus,
            curvature: None,
            key_poses: 8,
            bound: 5e-4,
            keep_bound: false,
            smooth: false,
            rays: None,
            of: None,
        }
    }
}

/// What orders the triangles of a refinement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MeasureName {
    /// What the middles of the edges lack of the mean of their ends, by area; foretold after a split.
    Surplus,
    /// The same, every middle baked one split ahead: three times the rays.
    Midpoint,
    /// Equation 4 of Křivánek et al. 2004: distances of transfer over the divergence of normals.
    Curvature,
    /// The same, by the first vertex's normal alone, as printed.
    CurvaturePrinted,
    /// Equation 4 times the root of the triangle's area.
    CurvatureByArea,
    /// Equation 3: distances of transfer.
    Distance,
    /// Equation 2: contrasts of transfer.
    Contrast,
    /// All triangles alike, to compare with.
    Uniform,
}
