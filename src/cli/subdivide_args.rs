//! The arguments of `poselight subdivide`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::args::{PoseFlags, RecipeArgs};
use super::bake_args::BakeFlags;
use crate::bake::subdivide::{ErrorMeasure, Goal};
use crate::pipeline::Refinement;

/// Refine a mesh where its transfer changes.
#[derive(Debug, Args)]
pub(crate) struct SubdivideArgs {
    /// The scene (.glb).
    pub(crate) scene: PathBuf,
    /// The refined scene to write.
    #[arg(short, long, value_name = "OUT.glb")]
    pub(crate) output: PathBuf,
    /// Triangles of the result at most [default: four times the input's, unless another goal is
    /// given].
    #[arg(long, value_name = "N")]
    pub(crate) max_triangles: Option<usize>,
    /// Vertices of the result at most.
    #[arg(long, value_name = "N")]
    max_vertices: Option<usize>,
    /// Stop where no triangle's estimate is larger, in the measure's own unit.
    #[arg(long, value_name = "ERROR", value_parser = positive)]
    until: Option<f32>,
    /// How often a triangle may be split in four [default: 8].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=12), default_value_t = 8, hide_default_value = true)]
    max_depth: u8,
    /// What orders the triangles [default: surplus].
    #[arg(long, value_enum, default_value_t = MeasureArg::Surplus, hide_default_value = true)]
    measure: MeasureArg,
    /// The constant a of the measure `curvature`, per radian [default: 1].
    #[arg(long, value_name = "A", value_parser = not_negative)]
    curvature: Option<f32>,
    /// Poses at which the estimate is taken, the largest counts [default: 8].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256), default_value_t = 8, hide_default_value = true)]
    key_poses: u16,
    /// How far skinning may take a new vertex off its triangle, in sizes of the character
    /// [default: 0.0005].
    #[arg(long, value_name = "SIZES", value_parser = positive, default_value_t = 5e-4, hide_default_value = true)]
    bound: f32,
    /// Compare interpolation with the truth at so many places, before and after.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    probes: usize,
    /// Write the transfer of the first key pose as vertex attributes too.
    #[arg(long)]
    pub(crate) values: bool,
    /// Write the estimate as vertex colours, from dark blue to yellow.
    #[arg(long)]
    pub(crate) colour: bool,
    /// Print what it would cost at most, and write nothing.
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
    /// Equation 4 of Křivánek et al. 2004: distances of transfer over the divergence of normals.
    Curvature,
    /// The same, by the first vertex's normal alone, as printed.
    CurvaturePrinted,
    /// Equation 3: distances of transfer.
    Distance,
    /// Equation 2: contrasts of transfer.
    Contrast,
    /// All triangles alike, to compare with.
    Uniform,
}

impl SubdivideArgs {
    /// The refinement of a mesh of so many triangles.
    pub(crate) fn refinement(&self, triangles: usize) -> anyhow::Result<Refinement> {
        let a = self.curvature.unwrap_or(1.0);
        let measure = match self.measure {
            MeasureArg::Surplus => ErrorMeasure::Surplus,
            MeasureArg::Midpoint => ErrorMeasure::Midpoint,
            MeasureArg::Curvature => ErrorMeasure::Curvature { a, printed: false },
            MeasureArg::CurvaturePrinted => ErrorMeasure::Curvature { a, printed: true },
            MeasureArg::Distance => ErrorMeasure::Distance,
            MeasureArg::Contrast => ErrorMeasure::Contrast,
            MeasureArg::Uniform => ErrorMeasure::Uniform,
        };
        if self.curvature.is_some() && !matches!(measure, ErrorMeasure::Curvature { .. }) {
            let told = "--curvature changes nothing with this measure; use --measure curvature";
            return Err(super::commands::Usage(told.to_owned()).into());
        }
        if let Some(most) = self.max_triangles.filter(|&most| most < triangles) {
            let told = format!(
                "--max-triangles {most} is less than the {triangles} of the scene as it is"
            );
            return Err(super::commands::Usage(told).into());
        }
        let any = self.max_vertices.is_some() || self.until.is_some();
        let most = if any { usize::MAX } else { triangles.saturating_mul(4) };
        Ok(Refinement {
            goal: Goal {
                triangles: self.max_triangles.unwrap_or(most),
                vertices: self.max_vertices.unwrap_or(usize::MAX),
                error: self.until.unwrap_or(0.0),
                depth: self.max_depth,
            },
            measure,
            key_poses: usize::from(self.key_poses),
            bound: self.bound,
            probes: self.probes,
        })
    }
}

fn positive(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("it must be a positive number".to_owned()),
    }
}

fn not_negative(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("it must be zero or a positive number".to_owned()),
    }
}
