//! The arguments of a bake, and how they edit a recipe.

use clap::{Args, ValueEnum};

use super::args::{names, set};
use super::subsurface::SubsurfaceFlags;
use super::surroundings::SurroundingsFlags;
use crate::pipeline::recipe::{
    MOST_RAYS_TO_NOISE, NoiseGoalName, NormalsRecipe, Recipe, SignalName,
};

#[derive(Debug, Args)]
#[command(next_help_heading = "Bake")]
pub(crate) struct BakeFlags {
    /// What is baked [default: transfer].
    #[arg(long, value_enum)]
    signal: Option<SignalArg>,
    /// Order of the spherical harmonics, 1 to 10 [default: 6].
    #[arg(long, value_name = "N")]
    order: Option<u8>,
    /// Rays per vertex and pose; with --noise the most, and beside --from the most of the round that is
    /// added (unless they are those that the earlier bake stated) [default: 500; with --noise 16384].
    #[arg(long, value_name = "N")]
    pub(crate) rays: Option<u32>,
    /// As many rays at each vertex as it takes for this standard error of a coefficient.
    #[arg(long, value_name = "ERROR")]
    noise: Option<f32>,
    /// Whether --noise is the most at each vertex, or the root mean square over them with the least
    /// rays in all [default: each].
    #[arg(long, value_name = "GOAL")]
    noise_goal: Option<NoiseGoalArg>,
    /// Choose rays and training poses by a pilot: the least rays whose noise the fitted model averages
    /// away, to a twentieth of its mean square error, or of that of --max-error.
    #[arg(long, conflicts_with_all = ["rays", "noise", "more_rays", "vertex_fit"])]
    pub(crate) choose_rays: bool,
    /// Metres beyond which nothing occludes; unbounded when absent.
    #[arg(long, value_name = "METRES")]
    max_distance: Option<f32>,
    /// How often other surfaces pass light on, 0 to 8, for the signal transfer [default: 0].
    #[arg(long, value_name = "N")]
    bounces: Option<u32>,
    /// One more round of so many rays at each vertex (may be repeated).
    #[arg(long, value_name = "N")]
    more_rays: Vec<u32>,
    /// Compute each pose's normals from its triangles everywhere [default: where meshes are morphed by targets
    /// that move positions and no normals].
    #[arg(long)]
    recompute_normals: bool,
    /// Keep the file's normals, also where morph targets move positions and no normals.
    #[arg(long, conflicts_with = "recompute_normals")]
    keep_normals: bool,
    /// Fit vertices by least squares to this many samples each, spread over the surface.
    #[arg(long, value_name = "SAMPLES")]
    vertex_fit: Option<u32>,
    /// With bounces, the reflectance of parts without a material [default: 0.5].
    #[arg(long, value_name = "ALBEDO")]
    albedo: Option<f32>,
    /// Seed of every random choice [default: 1].
    #[arg(long, value_name = "SEED")]
    seed: Option<u64>,
    #[command(flatten)]
    subsurface: SubsurfaceFlags,
    #[command(flatten)]
    surroundings: SurroundingsFlags,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum NoiseGoalArg {
    Each,
    Mean,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SignalArg {
    Ao,
    Visibility,
    Transfer,
}

impl BakeFlags {
    /// Edits the recipe's bake, and the seed of its poses.
    pub(crate) fn edit(&self, recipe: &mut Recipe) -> anyhow::Result<()> {
        let bake = &mut recipe.bake;
        set(&mut bake.signal, self.signal);
        set(&mut bake.order, self.order);
        // A recipe that states a noise has its own most.
        let most = self.noise.filter(|_| bake.noise.is_none()).map(|_| MOST_RAYS_TO_NOISE);
        set(&mut bake.rays, self.rays.or(most));
        bake.noise = self.noise.or(bake.noise);
        bake.noise_goal = self.noise_goal.map(Into::into).or(bake.noise_goal);
        set(&mut bake.seed, self.seed);
        set(&mut bake.bounces, self.bounces);
        bake.albedo = self.albedo.or(bake.albedo);
        if !self.more_rays.is_empty() {
            bake.more_rays.clone_from(&self.more_rays);
        }
        if self.recompute_normals || self.keep_normals {
            bake.recompute_normals = Some(NormalsRecipe::All(self.recompute_normals));
        }
        bake.vertex_fit = self.vertex_fit.or(bake.vertex_fit);
        set(&mut recipe.poses.seed, self.seed);
        if self.max_distance.is_some() {
            bake.max_distance_m = self.max_distance;
        }
        self.surroundings.edit(&mut bake.surroundings);
        self.subsurface.edit(&mut bake.subsurface)
    }
}

names! {
    NoiseGoalArg => NoiseGoalName { Each, Mean }
    SignalArg => SignalName { Ao, Visibility, Transfer }
}
