//! The arguments of a fit, and how they edit a recipe.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::args::{MeasureFlags, ParametrisationArg, names, set};
use crate::pipeline::forget_other_sizes;
use crate::pipeline::recipe::{
    ChooseName, FamilyName, FrameName, OnName, ParametrisationName, PrecisionName, Recipe,
    RidgeName,
};

#[derive(Debug, Args)]
#[command(next_help_heading = "Fit")]
pub(crate) struct FitFlags {
    /// The model family [default: pca-linear].
    #[arg(long, value_enum)]
    family: Option<FamilyArg>,
    /// Pose dimensions of pca-linear and multilinear [default: 8, or as many as there are].
    #[arg(long, value_name = "N")]
    inputs: Option<u32>,
    /// Output dimensions of pca-linear, and of what occluder leaves [default: 22, or as many as there are; of
    /// occluder at least as many as there are coefficients].
    #[arg(long, value_name = "N")]
    outputs: Option<u32>,
    /// Instead of --inputs: keep this share of the pose variance, above 0 to 1. --outputs stays what it is
    /// [default of the clustered families: 0.9].
    #[arg(long, value_name = "SHARE", conflicts_with = "inputs")]
    retain_inputs: Option<f64>,
    /// Instead of --outputs: keep this share of the signal's variance over the poses (the mean is kept
    /// anyway), above 0 to 1. --inputs stays what it is [default of the clustered families: 0.95].
    #[arg(long, value_name = "SHARE", conflicts_with = "outputs")]
    retain_outputs: Option<f64>,
    /// Pose clusters of multilinear [default: 10]; clusters of points of the clustered families
    /// [default: as many as the skin weights have].
    #[arg(long, value_name = "N")]
    clusters: Option<u32>,
    /// Clusters of points that share coefficients in each pose cluster of multilinear.
    #[arg(long, value_name = "N")]
    point_clusters: Option<u32>,
    /// Instead: as many clusters of points as it takes for this distance from their mean.
    #[arg(long, value_name = "RMS", conflicts_with = "point_clusters")]
    point_threshold: Option<f64>,
    /// Multilinear without intercepts, as it was published.
    #[arg(long)]
    published: bool,
    /// Exponent of the blend of multilinear [default: 10].
    #[arg(long, value_name = "ALPHA")]
    blend_exponent: Option<f64>,
    /// Whether to learn only what occlusion takes away from the unshadowed signal
    /// [default: true for occluder, else false].
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    unshadowed: Option<bool>,
    /// Spheres on the bones of occluder [default: 100].
    #[arg(long, value_name = "N")]
    spheres: Option<u32>,
    /// Groups of spheres that the points of a bone tell apart [default: 12].
    #[arg(long, value_name = "N")]
    groups: Option<u32>,
    /// Directions in which the union of occluder's ellipsoids is looked at, a multiple of 16, or 0 for
    /// the sum of spheres: quicker, less accurate [default: 0 for ao, else 256].
    #[arg(long, value_name = "N")]
    directions: Option<u32>,
    /// For linear: draw the weights of far joints towards 0. The points of each bone are fitted to
    /// parameters scaled by exp(-d / (SHARE x size)): d is the least distance, over the training poses,
    /// between the bone's points and what the parameter's joint moves against them; size is the diagonal
    /// of the mesh at rest, so the share has no unit. Above 0 to 100: 0.1 leaves a joint at a tenth of the
    /// size 37 % of its reach, 100 leaves all of them nearly whole [default: all whole].
    #[arg(long, value_name = "SHARE")]
    local: Option<f64>,
    /// Draw poses that are farther than this from the training poses, in typical distances of
    /// those, towards their mean [default: take them as they are].
    #[arg(long, value_name = "DISTANCE")]
    reach: Option<f32>,
    /// Put the rest mesh and its weights into a model that looks at the posed mesh, so that joint
    /// rotations are enough to evaluate it. A choice by target counts its bytes.
    #[arg(long)]
    include_rest: bool,
    /// Neurons of each cluster of clustered-tanh [default: by cross-validation].
    #[arg(long, value_name = "N")]
    neurons: Option<u32>,
    /// The frame in which coefficients are modelled [default: bone].
    #[arg(long, value_enum)]
    frame: Option<FrameArg>,
    /// How the regularisation is chosen; the weights of occluder are chosen by clips left out in both
    /// ways that choose [default: leave-one-clip-out].
    #[arg(long, value_enum)]
    ridge: Option<RidgeArg>,
    /// The regularisation, with --ridge fixed, in the units of the parameters' singular values; of
    /// occluder's weights, what holds them to those of their bone, as a share of a group's mean energy.
    #[arg(long, value_name = "ALPHA")]
    alpha: Option<f64>,
    /// Motion that the model is for; `trained` compresses and does not regularise [default: novel].
    #[arg(long, value_enum)]
    on: Option<OnArg>,
    /// How the model's numbers are stored [default: f32].
    #[arg(long, value_enum)]
    precision: Option<PrecisionArg>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum FamilyArg {
    Mean,
    Linear,
    PcaLinear,
    Multilinear,
    Occluder,
    ClusteredLinear,
    ClusteredQuadratic,
    ClusteredTanh,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FrameArg {
    Root,
    Bone,
    Tangent,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum RidgeArg {
    LeaveOneOut,
    LeaveOneClipOut,
    Fixed,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OnArg {
    Novel,
    Trained,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PrecisionArg {
    F32,
    F16,
    I8,
}

/// What a model that is chosen may cost.
#[derive(Debug, Args)]
#[command(next_help_heading = "Choice")]
pub(crate) struct LimitFlags {
    /// Choose the simplest model of no more bytes than this, such as 300000, 300kB or 1.5MiB.
    #[arg(long, value_name = "BYTES", value_parser = super::units::parse_bytes)]
    max_bytes: Option<u64>,
    /// Choose one that evaluates within this, microseconds on one core.
    #[arg(long, value_name = "US")]
    max_us: Option<f64>,
    /// Choose one that fits within this, seconds.
    #[arg(long, value_name = "S")]
    max_fit_s: Option<f64>,
}

impl LimitFlags {
    /// One that was given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        let given = [
            ("--max-bytes", self.max_bytes.is_some()),
            ("--max-us", self.max_us.is_some()),
            ("--max-fit-s", self.max_fit_s.is_some()),
        ];
        given.into_iter().find(|flag| flag.1).map(|flag| flag.0)
    }

    /// Edits the recipe's target.
    pub(crate) fn edit(&self, recipe: &mut Recipe) {
        let target = &mut recipe.target;
        target.max_bytes = self.max_bytes.or(target.max_bytes);
        target.max_us = self.max_us.or(target.max_us);
        target.max_fit_s = self.max_fit_s.or(target.max_fit_s);
    }
}

#[derive(Debug, Args)]
pub(crate) struct FitCommandArgs {
    /// The data set.
    pub(crate) dataset: PathBuf,
    /// The model to write.
    #[arg(short, long, value_name = "MODEL.safetensors")]
    pub(crate) output: PathBuf,
    /// How a pose becomes numbers [default: as the data set was baked].
    #[arg(long, value_enum)]
    parametrisation: Option<ParametrisationArg>,
    #[command(flatten)]
    limits: LimitFlags,
    #[command(flatten)]
    measure: MeasureFlags,
    #[command(flatten)]
    pub(crate) fit: FitFlags,
}

impl FitCommandArgs {
    /// Whether a target is stated on the command line.
    pub(crate) fn states_target(&self) -> bool {
        self.measure.states_target() || self.limits.given().is_some()
    }

    /// A flag that says what a target would choose.
    pub(crate) fn chosen_flag(&self) -> Option<&'static str> {
        let own = self.parametrisation.map(|_| "--parametrisation");
        own.or_else(|| self.fit.chosen_flag())
    }

    /// A flag that says how a model is measured, where nothing is.
    pub(crate) fn measures_in_vain(&self) -> Option<&'static str> {
        self.measure.reference_flag()
    }

    /// Whether only candidates of the family in the recipe are to be looked at.
    pub(crate) fn names_family(&self) -> bool {
        self.fit.names_family()
    }

    /// Whether the command line says which model it is, and leaves no target to choose it.
    pub(crate) fn names_model(&self) -> bool {
        !self.states_target() && (self.names_family() || self.chosen_flag().is_some())
    }

    /// How a pose becomes numbers, where that is said.
    pub(crate) fn parametrisation(&self) -> Option<ParametrisationName> {
        self.parametrisation.map(Into::into)
    }

    /// Edits the recipe of the data set, whose own target gives way to one that is stated here, and to a model
    /// that is named here.
    pub(crate) fn edit(&self, recipe: &mut Recipe) {
        recipe.target.choose = ChooseName::Nothing;
        let target = &mut recipe.target;
        if self.states_target() || self.names_model() {
            (target.max_bytes, target.max_us, target.max_fit_s) = (None, None, None);
        }
        if self.states_target() {
            target.max_error = None;
        }
        self.fit.edit(recipe);
        self.measure.edit(recipe);
        self.limits.edit(recipe);
        recipe.fit.parametrisation = self.parametrisation().or(recipe.fit.parametrisation);
    }
}

impl FitFlags {
    /// Whether the family is said.
    pub(crate) fn names_family(&self) -> bool {
        self.family.is_some()
    }

    /// A flag beside the family, of which a target would choose all.
    pub(crate) fn chosen_flag(&self) -> Option<&'static str> {
        let given = [
            ("--inputs", self.inputs.is_some()),
            ("--outputs", self.outputs.is_some()),
            ("--retain-inputs", self.retain_inputs.is_some()),
            ("--retain-outputs", self.retain_outputs.is_some()),
            ("--clusters", self.clusters.is_some()),
            ("--point-clusters", self.point_clusters.is_some()),
            ("--point-threshold", self.point_threshold.is_some()),
            ("--published", self.published),
            ("--blend-exponent", self.blend_exponent.is_some()),
            ("--reach", self.reach.is_some()),
            ("--unshadowed", self.unshadowed.is_some()),
            ("--spheres", self.spheres.is_some()),
            ("--directions", self.directions.is_some()),
            ("--local", self.local.is_some()),
            ("--groups", self.groups.is_some()),
            ("--neurons", self.neurons.is_some()),
            ("--frame", self.frame.is_some()),
            ("--ridge", self.ridge.is_some()),
            ("--alpha", self.alpha.is_some()),
            ("--precision", self.precision.is_some()),
        ];
        given.into_iter().find(|flag| flag.1).map(|flag| flag.0)
    }

    /// Edits the recipe's fit, target and precision.
    pub(crate) fn edit(&self, recipe: &mut Recipe) {
        let fit = &mut recipe.fit;
        fit.unshadowed = self.unshadowed.or(fit.unshadowed);
        set(&mut fit.frame, self.frame);
        if self.family.is_some() {
            set(&mut fit.family, self.family);
            forget_other_sizes(fit);
        }
        fit.inputs = self.inputs.or(fit.inputs);
        fit.outputs = self.outputs.or(fit.outputs);
        fit.retain_inputs = self.retain_inputs.or(fit.retain_inputs);
        fit.retain_outputs = self.retain_outputs.or(fit.retain_outputs);
        fit.clusters = self.clusters.or(fit.clusters);
        fit.point_clusters = self.point_clusters.or(fit.point_clusters);
        fit.point_threshold = self.point_threshold.or(fit.point_threshold);
        fit.neurons = self.neurons.or(fit.neurons);
        fit.published |= self.published;
        set(&mut fit.blend_exponent, self.blend_exponent);
        fit.reach = self.reach.or(fit.reach);
        fit.include_rest |= self.include_rest;
        fit.local = self.local.or(fit.local);
        fit.spheres = self.spheres.or(fit.spheres);
        fit.directions = self.directions.or(fit.directions);
        fit.groups = self.groups.or(fit.groups);
        if let Some(ridge) = self.ridge {
            fit.ridge = ridge.into();
            // Of another choice of the ridge; this one's comes below.
            fit.alpha = None;
        }
        if self.alpha.is_some() {
            fit.alpha = self.alpha;
        }
        set(&mut recipe.target.on, self.on);
        set(&mut recipe.output.precision, self.precision);
    }
}

names! {
    FamilyArg => FamilyName { Mean, Linear, PcaLinear, Multilinear, Occluder, ClusteredLinear, ClusteredQuadratic, ClusteredTanh }
    FrameArg => FrameName { Root, Bone, Tangent }
    RidgeArg => RidgeName { LeaveOneOut, LeaveOneClipOut, Fixed }
    OnArg => OnName { Novel, Trained }
    PrecisionArg => PrecisionName { F32, F16, I8 }
}
