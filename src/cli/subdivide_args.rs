//! The arguments of `poselight subdivide`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::args::{PoseFlags, RecipeArgs, names, set};
use super::bake_args::BakeFlags;
use crate::pipeline::recipe::Recipe;
use crate::pipeline::recipe::subdivide::{MeasureName, SubdivideRecipe};

/// Refine a mesh where its transfer changes.
#[derive(Debug, Args)]
pub(crate) struct SubdivideArgs {
    /// The scene (.glb, .gltf).
    pub(crate) scene: PathBuf,
    /// The refined scene to write.
    #[arg(short, long, value_name = "OUT.glb")]
    pub(crate) output: PathBuf,
    /// Triangles of the result at most [default: four times the input's, unless another goal is
    /// given].
    #[arg(long, value_name = "N")]
    max_triangles: Option<u64>,
    /// Vertices of the result at most.
    #[arg(long, value_name = "N")]
    max_vertices: Option<u64>,
    /// Bytes at most of a model of the result, of the family and sizes that the recipe's `fit` states.
    #[arg(long, value_name = "N")]
    max_model_bytes: Option<u64>,
    /// Stop where no triangle's estimate is larger, in the measure's own unit: of `surplus` and `midpoint`
    /// square metres times transfer squared. At sixteen times the input's triangles it ends in any case,
    /// unless --max-triangles says more.
    #[arg(long, value_name = "ERROR")]
    until: Option<f32>,
    /// How often a triangle may be split in four, 1 to 12 [default: 8].
    #[arg(long, value_name = "N")]
    max_depth: Option<u8>,
    /// Do not split triangles smaller than one with sides of this length, in sizes of the character
    /// [default: 0].
    #[arg(long, value_name = "SIZES")]
    min_edge: Option<f32>,
    /// What orders the triangles [default: surplus].
    #[arg(long, value_enum)]
    measure: Option<MeasureArg>,
    /// The constant a of the measure `curvature`, per radian [default: 1].
    #[arg(long, value_name = "A")]
    curvature: Option<f32>,
    /// Poses at which the estimate is taken, the largest counts, 1 to 256 [default: 8].
    #[arg(long, value_name = "N")]
    key_poses: Option<u16>,
    /// How far skinning may take a new vertex off its triangle, in sizes of the character
    /// [default: 0.0005].
    #[arg(long, value_name = "SIZES")]
    bound: Option<f32>,
    /// Leave edges whole that cannot meet the bound, as far as twelve attempts find them; else they are split
    /// all the same, and named.
    #[arg(long)]
    keep_bound: bool,
    /// Put new vertices on the smooth surface that the normals mean (PN triangles), not in the triangles.
    #[arg(long)]
    smooth: bool,
    /// Compare interpolation with the truth at so many places of the input's triangles, before and after.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub(crate) probes: usize,
    /// Write the transfer of the first key pose as vertex attributes too.
    #[arg(long)]
    pub(crate) values: bool,
    /// Write the estimate as vertex colours, from dark blue to yellow.
    #[arg(long)]
    pub(crate) colour: bool,
    /// Print what it would cost, and write nothing.
    #[arg(long)]
    pub(crate) dry_run: bool,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    #[command(flatten)]
    pub(crate) poses: PoseFlags,
    #[command(flatten)]
    pub(crate) bake: BakeFlags,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MeasureArg {
    /// What the middles of the edges lack of the mean of their ends, by area; foretold after a split.
    Surplus,
    /// The same, every middle baked one split ahead: three times the rays.
    Midpoint,
    /// Equation 4 of Křivánek et al. 2004: distances of transfer over the divergence of normals. It never
    /// ends where transfer jumps, but by --min-edge.
    Curvature,
    /// The same, by the first vertex's normal alone, as printed.
    CurvaturePrinted,
    /// Equation 4 times the root of the triangle's area: of those that look at vertices alone the best.
    CurvatureByArea,
    /// Equation 3: distances of transfer.
    Distance,
    /// Equation 2: contrasts of transfer.
    Contrast,
    /// All triangles alike, to compare with.
    Uniform,
}

names! {
    MeasureArg => MeasureName {
        Surplus, Midpoint, Curvature, CurvaturePrinted, CurvatureByArea, Distance, Contrast, Uniform
    }
}

impl SubdivideArgs {
    /// Edits what a recipe says of refining.
    pub(crate) fn edit(&self, recipe: &mut SubdivideRecipe) {
        recipe.triangles = self.max_triangles.or(recipe.triangles);
        recipe.vertices = self.max_vertices.or(recipe.vertices);
        recipe.bytes = self.max_model_bytes.or(recipe.bytes);
        recipe.error = self.until.or(recipe.error);
        recipe.rays = self.bake.rays.or(recipe.rays);
        recipe.smooth |= self.smooth;
        recipe.keep_bound |= self.keep_bound;
        recipe.min_edge = self.min_edge.or(recipe.min_edge);
        recipe.curvature = self.curvature.or(recipe.curvature);
        set(&mut recipe.depth, self.max_depth);
        set(&mut recipe.measure, self.measure);
        set(&mut recipe.key_poses, self.key_poses);
        set(&mut recipe.bound, self.bound);
    }
}

/// Refining as a stage before a bake.
#[derive(Debug, Args)]
pub(crate) struct RefineFlag {
    /// Refine the mesh to at most so many triangles where its transfer changes, and bake that; the
    /// refined scene is written beside the data set. A recipe's `subdivide` says more.
    #[arg(long, value_name = "TRIANGLES")]
    subdivide: Option<u64>,
}

impl RefineFlag {
    /// Edits the recipe's refinement.
    pub(crate) fn edit(&self, recipe: &mut Recipe) {
        if self.subdivide.is_some() {
            recipe.subdivide.get_or_insert_default().triangles = self.subdivide;
        }
    }
}
