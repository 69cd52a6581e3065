//! The arguments of every command, and how they edit a recipe.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

pub(crate) use super::bake_args::BakeFlags;
pub(crate) use super::fit_args::{FitCommandArgs, FitFlags, LimitFlags};
use super::light_args::LIGHT_HELP;
pub(crate) use super::subdivide_args::RefineFlag;
use crate::pipeline::recipe::{ParametrisationName, PoseChoiceName, Recipe};

/// The recipe's names for the values of flags.
macro_rules! names {
    ($($flag:ident => $name:ident { $($value:ident),* })*) => {
        $(impl From<$flag> for $name {
            fn from(flag: $flag) -> Self {
                match flag {
                    $($flag::$value => Self::$value),*
                }
            }
        })*
    };
}

pub(super) use names;

/// Bakes light transport of animated characters into compact, proven models.
#[derive(Debug, Parser)]
#[command(name = "poselight", version, propagate_version = true)]
pub(crate) struct Cli {
    /// One JSON object on stdout; progress and messages stay on stderr.
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// Compute threads; all cores when absent. Results are the same for any number.
    #[arg(long, global = true, value_name = "N", env = "POSELIGHT_THREADS", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Write a bundled character, made by code.
    Sample(SampleArgs),
    /// Say what a scene, data set or model holds, and what a bake would need.
    Inspect(InspectArgs),
    /// Bake a signal at every vertex over many poses into a data set.
    #[command(args_override_self = true)]
    Bake(BakeArgs),
    /// Fit a model to a data set.
    #[command(args_override_self = true)]
    Fit(FitCommandArgs),
    /// Measure a model against reference bakes on training and held-out motion.
    #[command(args_override_self = true)]
    Measure(MeasureArgs),
    /// Measure every family and size over one bake.
    #[command(args_override_self = true)]
    Tradeoff(TradeoffArgs),
    /// Evaluate a model at poses.
    #[command(args_override_self = true)]
    Evaluate(EvaluateArgs),
    /// Bake, fit, measure and report in one.
    #[command(args_override_self = true)]
    Run(Box<RunArgs>),
    Check(super::check_args::CheckArgs),
    /// Write a model's values at one pose into the scene's GLB, as vertex attributes.
    Apply(ApplyArgs),
    /// Attach a model to a re-exported scene, whose vertices are in another order, split or merged.
    Rebind(super::rebind_args::RebindArgs),
    /// Print an environment light as spherical harmonics, also as engines take it.
    Light(super::light_args::LightArgs),
    /// Make a reflection operator of a reflectance.
    Brdf(super::light_args::BrdfArgs),
    /// Render a picture: a scene by rays, or a model beside them.
    #[command(args_override_self = true)]
    Still(super::still_args::StillArgs),
    #[command(args_override_self = true)]
    Crowd(super::crowd_args::CrowdArgs),
    #[command(args_override_self = true)]
    Heights(super::heights_args::HeightsArgs),
    #[command(args_override_self = true)]
    Subdivide(super::subdivide_args::SubdivideArgs),
    /// Print the JSON Schema of the recipe.
    Schema,
    /// Serve jobs, models and evaluation over HTTP.
    #[cfg(feature = "serve")]
    Serve(super::serve_args::ServeArgs),
    /// Make, list and end the access tokens of a service.
    #[cfg(feature = "serve")]
    Token(super::serve_args::TokenArgs),
}

#[derive(Debug, Args)]
pub(crate) struct SampleArgs {
    /// Which character.
    #[arg(value_enum)]
    pub(crate) name: SampleName,
    /// The GLB file to write.
    #[arg(short, long, value_name = "FILE.glb")]
    pub(crate) output: PathBuf,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum SampleName {
    /// A skinned humanoid with the clips walk, wave, crouch and jump.
    Figure,
}

#[derive(Debug, Args)]
pub(crate) struct InspectArgs {
    /// A scene (.glb, .gltf, .obj), a data set (folder) or a model (.safetensors).
    pub(crate) file: PathBuf,
}

/// Where the recipe starts; every other flag edits it.
#[derive(Debug, Args)]
pub(crate) struct RecipeArgs {
    /// A recipe to start from; the other flags edit it.
    #[arg(long, value_name = "FILE.json")]
    pub(crate) recipe: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Poses")]
pub(crate) struct PoseFlags {
    /// Use only this clip (may be repeated); all clips when absent.
    #[arg(long, value_name = "NAME")]
    clip: Vec<String>,
    /// Keep this clip from training and measure the model on it (may be repeated) [default: a
    /// quarter of the clips, drawn by the seed; of a single clip its last quarter].
    #[arg(long, value_name = "NAME")]
    hold_out: Vec<String>,
    /// Poses per second of clip [default: 30].
    #[arg(long, value_name = "HZ")]
    fps: Option<f32>,
    /// How a pose becomes numbers [default: joint-angles].
    #[arg(long, value_enum)]
    parametrisation: Option<ParametrisationArg>,
    /// Keep every k-th training pose for measuring interpolation, 0 for none [default: 10].
    #[arg(long, value_name = "K")]
    interpolated_every: Option<u32>,
    /// Drop poses closer than this to an earlier one, 0 for none [default: 0.005].
    #[arg(long, value_name = "DISTANCE")]
    near_repeat: Option<f32>,
    /// Bake no more training poses than this, those that lie farthest apart [default: all].
    #[arg(long, value_name = "N")]
    most_poses: Option<u32>,
    /// What --most-poses chooses by [default: distance].
    #[arg(long, value_enum)]
    choose_poses: Option<PoseChoiceArg>,
    /// Bake so many poses more, mixed of limbs of different frames of a clip [default: 0].
    #[arg(long, value_name = "N")]
    mixed_poses: Option<u32>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum PoseChoiceArg {
    /// The pose farthest from those chosen before.
    Distance,
    /// The pose that a model of those is predicted to be most wrong at.
    PredictedError,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum ParametrisationArg {
    JointAngles,
    Handles,
    /// Folds of the mesh at its edges; what sequences of meshes have.
    Dihedral,
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Measure")]
pub(crate) struct MeasureFlags {
    /// References use this many times the bake's rays, at least 8 [default: 8].
    #[arg(long, value_name = "N")]
    reference_factor: Option<u32>,
    /// Reference poses of each split, at least, in runs of ten frames; all where a split has fewer
    /// [default: 100].
    #[arg(long, value_name = "N")]
    reference_poses: Option<u32>,
    /// Largest novel error accepted (coefficient RMSE); exit status 3 when missed.
    #[arg(long, value_name = "RMSE")]
    max_error: Option<f32>,
}

#[derive(Debug, Args)]
pub(crate) struct BakeArgs {
    /// The scene (.glb, .gltf, .obj, .npz).
    pub(crate) scene: PathBuf,
    /// The data set to write, or to continue.
    #[arg(short, long, value_name = "DATASET")]
    pub(crate) output: PathBuf,
    /// Take over what this earlier data set has of the same poses: for more poses, more rays, or a lower
    /// --noise.
    #[arg(long, value_name = "DATASET")]
    pub(crate) from: Option<PathBuf>,
    /// Print rays, bytes, memory and time, and bake nothing.
    #[arg(long, conflicts_with = "from")]
    pub(crate) dry_run: bool,
    #[command(flatten)]
    pub(crate) refine: RefineFlag,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    #[command(flatten)]
    pub(crate) poses: PoseFlags,
    #[command(flatten)]
    pub(crate) bake: BakeFlags,
}

#[derive(Debug, Args)]
pub(crate) struct MeasureArgs {
    /// The model.
    pub(crate) model: PathBuf,
    /// The data set that it was fitted to; references are baked into it once.
    pub(crate) dataset: PathBuf,
    /// Also write the report, one HTML file.
    #[arg(long, value_name = "FILE.html")]
    pub(crate) report: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) measure: MeasureFlags,
}

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("poses").required(true).args(["parameters", "scene"]))]
pub(crate) struct EvaluateArgs {
    /// The model.
    pub(crate) model: PathBuf,
    /// Poses as parameters, an array [pose, parameter] of f32 or f64.
    #[arg(long, value_name = "FILE.npy")]
    pub(crate) parameters: Option<PathBuf>,
    /// Poses from a clip of this scene, or its rest pose.
    #[arg(long, value_name = "SCENE")]
    pub(crate) scene: Option<PathBuf>,
    /// The clip to sample; the rest pose when absent.
    #[arg(long, value_name = "NAME", requires = "scene")]
    pub(crate) clip: Option<String>,
    /// Poses per second of clip.
    #[arg(long, value_name = "HZ", default_value_t = 30.0, conflicts_with = "parameters")]
    pub(crate) fps: f32,
    #[arg(long, value_name = "LIGHT", help = format!("Shade by a light, in the root frame. {LIGHT_HELP}"))]
    pub(crate) light: Option<String>,
    /// Reflect the light towards an eye by a reflectance, as `poselight brdf` reads it, or by an operator
    /// that it wrote; of a model of visibility, with a grain of one in the tangent frame.
    #[arg(long, value_name = "BRDF", requires_all = ["light", "eye", "scene"])]
    pub(crate) brdf: Option<String>,
    /// Where the eye is, in the root frame, metres.
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], requires = "brdf", allow_negative_numbers = true)]
    pub(crate) eye: Option<Vec<f32>>,
    /// Bent normals instead, [pose, vertex, 3]: the mean direction of light that comes in unblocked,
    /// weighted by the cosine; of transfer of order 2 and more.
    #[arg(long, conflicts_with = "light")]
    pub(crate) bent_normals: bool,
    /// Where the values go: [pose, vertex, channel, coefficient], or [pose, vertex, colour] under a light.
    #[arg(short, long, value_name = "OUT.npy")]
    pub(crate) output: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct ApplyArgs {
    /// The model.
    pub(crate) model: PathBuf,
    /// The scene that it was baked from (.glb).
    pub(crate) scene: PathBuf,
    /// A clip; the rest pose when absent.
    #[arg(long, value_name = "NAME")]
    pub(crate) clip: Option<String>,
    /// Seconds into the clip.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, requires = "clip")]
    pub(crate) time: f32,
    /// Also write COLOR_0: the values under ambient light.
    #[arg(long)]
    pub(crate) colour: bool,
    /// Also write _BENT_NORMAL: the mean direction of light that comes in unblocked, weighted by the
    /// cosine, in the root frame; for transfer of order 2 and more.
    #[arg(long)]
    pub(crate) bent_normals: bool,
    /// The scene of the model's receivers (.glb), whose values go to --receivers-output.
    #[arg(long, value_name = "SCENE", requires = "receivers_output")]
    pub(crate) receivers: Option<PathBuf>,
    /// The GLB to write the receivers to.
    #[arg(long, value_name = "OUT.glb", requires = "receivers")]
    pub(crate) receivers_output: Option<PathBuf>,
    /// The GLB to write.
    #[arg(short, long, value_name = "OUT.glb")]
    pub(crate) output: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// The scene (.glb, .gltf, .obj, .npz).
    pub(crate) scene: PathBuf,
    /// The folder for data set, model, figures and report.
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Print rays, bytes, memory and time, references included, and do nothing.
    #[arg(long)]
    pub(crate) dry_run: bool,
    #[command(flatten)]
    pub(crate) refine: RefineFlag,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    #[command(flatten)]
    pub(crate) poses: PoseFlags,
    #[command(flatten)]
    pub(crate) bake: BakeFlags,
    #[command(flatten)]
    pub(crate) fit: FitFlags,
    #[command(flatten)]
    pub(crate) limits: LimitFlags,
    #[command(flatten)]
    pub(crate) measure: MeasureFlags,
    #[command(flatten)]
    pub(crate) pictures: super::picture_args::PictureFlags,
}

#[derive(Debug, Args)]
pub(crate) struct TradeoffArgs {
    /// The data set; references are baked into it once.
    pub(crate) dataset: PathBuf,
    /// The folder for the points, plots and the page.
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Every size of the published tables too, and the neurons: takes many times as long.
    #[arg(long)]
    pub(crate) full: bool,
    /// Only candidates whose name has this in it (may be repeated).
    #[arg(long, value_name = "TEXT")]
    pub(crate) only: Vec<String>,
    #[command(flatten)]
    pub(crate) effort: super::effort_args::EffortFlags,
    #[command(flatten)]
    pub(crate) measure: MeasureFlags,
}

/// Puts a flag's value over a recipe's field where the flag was given.
pub(super) fn set<T>(field: &mut T, flag: Option<impl Into<T>>) {
    if let Some(value) = flag {
        *field = value.into();
    }
}

impl PoseFlags {
    /// How a pose becomes numbers, where that is said.
    pub(crate) fn parametrisation(&self) -> Option<ParametrisationName> {
        self.parametrisation.map(Into::into)
    }

    /// Edits the recipe's poses.
    pub(crate) fn edit(&self, recipe: &mut Recipe) {
        let poses = &mut recipe.poses;
        if !self.clip.is_empty() {
            poses.clips = Some(self.clip.clone());
        }
        if !self.hold_out.is_empty() {
            poses.hold_out = Some(self.hold_out.clone());
        }
        set(&mut poses.rate_hz, self.fps);
        set(&mut poses.interpolated_every, self.interpolated_every);
        set(&mut poses.near_repeat, self.near_repeat);
        poses.most = self.most_poses.or(poses.most);
        set(&mut poses.choice, self.choose_poses);
        set(&mut poses.mixed, self.mixed_poses);
        set(&mut poses.parametrisation, self.parametrisation);
    }
}

impl MeasureFlags {
    /// Whether a largest error is stated.
    pub(crate) fn states_target(&self) -> bool {
        self.max_error.is_some()
    }

    /// A flag that says how references are baked.
    pub(crate) fn reference_flag(&self) -> Option<&'static str> {
        let factor = self.reference_factor.map(|_| "--reference-factor");
        factor.or(self.reference_poses.map(|_| "--reference-poses"))
    }

    /// Edits the recipe's target.
    pub(crate) fn edit(&self, recipe: &mut Recipe) {
        let target = &mut recipe.target;
        set(&mut target.reference_factor, self.reference_factor);
        set(&mut target.reference_poses, self.reference_poses);
        if self.max_error.is_some() {
            target.max_error = self.max_error;
        }
    }
}

names! {
    ParametrisationArg => ParametrisationName { JointAngles, Handles, Dihedral }
    PoseChoiceArg => PoseChoiceName { Distance, PredictedError }
}
