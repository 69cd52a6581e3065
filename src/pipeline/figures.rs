//! The figures of a run: the JSON document beside the model.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Baked, ReferenceBaked, timing::EvaluationTimes};
use crate::dataset::Dataset;
use crate::fit::FitReport;
use crate::measure::{Measured, Split};
use crate::model::Model;

/// What happened before a model was measured.
#[derive(Debug, Clone, Copy)]
pub(super) struct Story<'a> {
    /// The bake, where this process did it.
    pub(super) baked: Option<&'a Baked>,
    /// The references.
    pub(super) referenced: &'a ReferenceBaked,
    /// The fit.
    pub(super) report: &'a FitReport,
    /// Wall time of the fit, seconds.
    pub(super) fit_s: f64,
}

/// Everything that a run measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Hash of the fit that the figures belong to.
    pub fit_hash: String,
    /// Hash of the bake that the model was fitted to.
    #[serde(default)]
    pub bake_hash: String,
    /// The model's sizes.
    pub model: ModelFigures,
    /// Wall times on the machine of the run.
    pub times: Times,
    /// Eigenvalue spectra.
    pub spectra: Spectra,
    /// Errors by split.
    pub measured: Measured,
    /// How the model was chosen, where a target chose it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub choice: Option<ChoiceFigures>,
}

/// How a target chose a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChoiceFigures {
    /// Hash of the fit as it was asked for.
    pub asked: String,
    /// What was chosen, in words.
    pub name: String,
    /// Candidates that were tried, every precision counted.
    pub candidates: usize,
    /// Wall time of the search, seconds.
    pub search_s: f64,
    /// What was left out in turn to tell candidates apart.
    pub left_out: String,
    /// The chosen model's error on it, RMSE of a coefficient.
    pub validation_rms: f64,
    /// What that may be in truth, as far as what was left out tells: more with a chance of one in twenty. This is
    /// what a largest error is held against.
    #[serde(default)]
    pub validation_largest: f64,
    /// Whether the target is met there.
    pub met: bool,
    /// What would help most, where the target is not met.
    pub remedy: Option<String>,
    /// What the model does without.
    pub trimmed: Option<String>,
}

/// Sizes of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelFigures {
    /// Family.
    pub family: String,
    /// Frame of its coefficients.
    pub frame: String,
    /// Storage.
    pub precision: String,
    /// Bytes of the blob.
    pub bytes: u64,
    /// Bytes of the model's own tensors at this precision, which is what published sizes count.
    pub tensor_bytes: u64,
    /// Tensor bytes per cent of one pose's coefficients as f32.
    pub mesh_percent: f64,
    /// Pose parameters.
    pub parameters: usize,
    /// Pose dimensions kept.
    pub inputs: usize,
    /// Output dimensions kept; 0 where the family has no basis.
    pub outputs: usize,
    /// The regularisation used.
    pub alpha: Option<f64>,
    /// Multiply-adds for all coefficients of one pose.
    pub multiply_adds: u64,
    /// What the fit has to say about itself.
    #[serde(default)]
    pub notices: Vec<String>,
}

/// Wall times; absent where the work was done by an earlier run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Times {
    /// Seconds of baking, where one run did the whole bake.
    pub bake_s: Option<f64>,
    /// Rays per second of the baking of the last run that did any.
    pub rays_per_s: Option<f64>,
    /// Seconds of baking references, where one run did all of it.
    pub reference_s: Option<f64>,
    /// Seconds of the fit.
    pub fit_s: f64,
    /// Seconds of the fit by phase.
    pub fit_phases_s: BTreeMap<String, f64>,
    /// Microseconds to evaluate one pose, all coefficients, one core.
    pub evaluate_us: f64,
    /// Microseconds for one pose under one folded light, one core; absent where the signal does
    /// not fold.
    pub folded_us: Option<f64>,
}

/// Eigenvalue spectra of poses and outputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Spectra {
    /// Variances of the pose parameters along their principal directions, descending.
    pub pose: Vec<f64>,
    /// Leading squared singular values of the outputs, descending.
    pub output: Vec<f64>,
    /// The sum of all squared singular values of the outputs.
    pub output_energy: f64,
}

impl Figures {
    /// Takes over what an earlier run of the same bake has timed, where this one found it done.
    pub(super) fn take_times(&mut self, earlier: &Self) {
        if self.bake_hash.is_empty() || earlier.bake_hash != self.bake_hash {
            return;
        }
        let (own, theirs) = (&mut self.times, &earlier.times);
        if own.rays_per_s.is_none() {
            (own.bake_s, own.rays_per_s) = (theirs.bake_s, theirs.rays_per_s);
        }
        let covered = |measured: &Measured| -> (Option<u32>, Vec<usize>) {
            (measured.reference_rays, measured.splits.iter().map(|split| split.poses).collect())
        };
        if own.reference_s.is_none() && covered(&self.measured) == covered(&earlier.measured) {
            own.reference_s = theirs.reference_s;
        }
    }
}

impl Times {
    pub(super) fn new(story: &Story, evaluation: &EvaluationTimes) -> Self {
        let referenced = story.referenced;
        let all = 2 * referenced.poses as u64;
        let mut times = Self {
            bake_s: None,
            rays_per_s: None,
            reference_s: (referenced.baked_now == all).then_some(referenced.bake_s),
            fit_s: story.fit_s,
            fit_phases_s: story.report.seconds.clone(),
            evaluate_us: evaluation.all_us,
            folded_us: evaluation.folded_us,
        };
        if let Some(baked) = story.baked {
            times.tell_bake(baked);
        }
        times
    }

    /// What this process baked, if anything.
    pub(super) fn tell_bake(&mut self, baked: &Baked) {
        if baked.rays == 0 {
            return;
        }
        self.bake_s = (baked.poses_now == baked.poses).then_some(baked.bake_s);
        self.rays_per_s = Some(baked.rays as f64 / baked.bake_s);
    }
}

impl ModelFigures {
    pub(super) fn of(model: &Model, bytes: u64, report: &FitReport) -> Self {
        let header = model.header();
        let sizes = model.sizes(header.precision);
        let tensor_bytes = sizes.decoder + sizes.occluders;
        let mesh_bytes = u64::from(header.mesh.points) * header.width() as u64 * 4;
        Self {
            family: model.kind(),
            frame: header.frame.name().to_owned(),
            precision: header.precision.name().to_owned(),
            bytes,
            tensor_bytes,
            mesh_percent: 100.0 * tensor_bytes as f64 / mesh_bytes as f64,
            parameters: header.parameters(),
            inputs: report.inputs,
            outputs: report.outputs,
            alpha: report.alpha,
            multiply_adds: model.multiply_adds(),
            notices: report.notices.clone(),
        }
    }
}

impl Spectra {
    pub(super) fn of(report: &FitReport) -> Self {
        Self {
            pose: report.pose_spectrum.clone(),
            output: report.output_spectrum.clone(),
            output_energy: report.output_energy,
        }
    }
}

/// The measured errors as a model's header carries them, by split.
pub(super) fn errors(measured: &Measured) -> BTreeMap<String, Value> {
    let splits = measured.splits.iter().filter_map(|split| {
        let of = |name: &str| split.candidates.iter().find(|c| c.name == name);
        let model = of(&measured.model)?;
        let value = json!({
            "poses": split.poses,
            "clips": split.clips,
            "coefficient_rms": model.coefficients.rms,
            "ao_mean_absolute": model.ao.mean_absolute.value,
            "ao_p99": model.ao.p99,
            "mean_alone_coefficient_rms": of("mean").and_then(|mean| mean.coefficients.rms),
            "reference_noise_rms": split.reference.coefficient_noise_rms,
        });
        Some((split.split.name().to_owned(), value))
    });
    splits.collect()
}

/// As long as [`errors`] of any model of a data set get in its header.
pub(super) fn longest_errors(dataset: &Dataset) -> String {
    // As many digits as a number has.
    let number = f64::MIN_POSITIVE;
    let value = json!({
        "poses": 100_000,
        "clips": 10_000,
        "coefficient_rms": number,
        "ao_mean_absolute": number,
        "ao_p99": number,
        "mean_alone_coefficient_rms": number,
        "reference_noise_rms": number,
    });
    // Of as many splits as there are, those of the longest names.
    let mut codes = dataset.splits().to_vec();
    codes.sort_unstable();
    codes.dedup();
    let splits = [Split::Interpolated, Split::WithinClip, Split::Training, Split::Novel];
    let of_split = |split: &Split| (split.name().to_owned(), value.clone());
    let errors: BTreeMap<String, Value> = splits.iter().take(codes.len()).map(of_split).collect();
    json!(errors).to_string()
}
