//! The result of a measurement: the JSON document that `poselight measure` writes.
//!
//! Fields keep this order; nothing is NaN (what is undefined is `null`). Squared errors are in
//! cross form, mean of (m − r₁)(m − r₂): free of the references' noise, so an error that is truly
//! nil comes out around zero, negative half of the time, and then has no root.

use serde::{Deserialize, Serialize};

use super::{Kind, Signal, Split};

/// Version of the document.
pub const VERSION: u32 = 1;

/// Every figure of a measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// [`VERSION`].
    pub version: u32,
    /// What the coefficients mean.
    pub signal: Signal,
    /// SH order n; 1 for `ao`.
    pub order: u8,
    /// 1, or 3 with coloured albedo.
    pub channels: usize,
    /// Points measured (vertices that are told apart).
    pub points: usize,
    /// Rays per point of each of the two references.
    pub reference_rays: Option<u32>,
    /// Seconds between frames; what "per frame" of the flicker means.
    pub frame_s: f64,
    /// Name of the candidate of kind `model`.
    pub model: String,
    /// The split that the headline speaks of: the first there is of novel, within-clip,
    /// interpolated, training. `null` where no pose was measured.
    pub headline: Option<Split>,
    /// Lights of the shading errors; empty unless the signal is `transfer`.
    pub lights: Vec<LightMeasured>,
    /// One entry per split that had poses, in the order of [`Split::ALL`].
    pub splits: Vec<SplitMeasured>,
    /// Where on the surface the model errs, over the headline split.
    pub surface: Option<Surface>,
}

impl Measured {
    /// One split's figures.
    #[must_use]
    pub fn split(&self, split: Split) -> Option<&SplitMeasured> {
        self.splits.iter().find(|s| s.split == split)
    }
}

/// A light of the fixed set. Its brightest unshaded white surface has radiance 1.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LightMeasured {
    /// Name, as in `shading`.
    pub name: String,
    /// One line.
    pub description: String,
}

/// How a standard error was come by. Wire name in kebab case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlockMethod {
    /// From the differences between whole clips: speaks of other clips like these.
    Clips,
    /// From the differences between stretches of time of these clips (fewer than three): speaks of
    /// these clips only.
    Stretches,
}

/// A mean with its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The mean over poses and points.
    pub value: f64,
    /// Standard error by blocks; `null` of fewer than two blocks.
    pub standard_error: Option<f64>,
}

/// A mean square in cross form.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Squared {
    /// Mean of (m − r₁)(m − r₂).
    pub mean_square: f64,
    /// Its standard error by blocks.
    pub standard_error: Option<f64>,
    /// Its root; `null` where the mean square is negative (the error is lost in the noise).
    pub rms: Option<f64>,
    /// Whether the root is below the noise of the average reference: then it is not claimed.
    pub below_noise: bool,
}

/// Figures of one split.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SplitMeasured {
    /// Which.
    pub split: Split,
    /// Clips it has poses of, in order of appearance.
    pub clips: Vec<String>,
    /// Poses measured.
    pub poses: usize,
    /// Pairs of consecutive frames among them.
    pub frame_pairs: usize,
    /// How standard errors were come by.
    pub block_method: BlockMethod,
    /// Number of blocks.
    pub blocks: usize,
    /// The signal itself and the noise of its references.
    pub reference: ReferenceMeasured,
    /// In the order of the settings.
    pub candidates: Vec<CandidateMeasured>,
    /// The poses, by clip and time: what curves are drawn over.
    pub frames: Frames,
}

/// The size of the signal and of the references' noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReferenceMeasured {
    /// Mean ambient occlusion (1 is open).
    pub ao_mean: f64,
    /// Mean |noise| of the average reference's ambient occlusion, from (r₁ − r₂)/2.
    pub ao_noise_mae: f64,
    /// RMS of the same.
    pub ao_noise_rms: f64,
    /// RMS noise of the average reference's coefficients.
    pub coefficient_noise_rms: f64,
    /// RMS of the coefficients themselves, free of noise.
    pub coefficient_rms: Option<f64>,
    /// Mean of tᵀG(n)t, the signal's own energy over the hemisphere; `null` for `ao`.
    pub hemisphere_energy: Option<f64>,
    /// RMS change per frame of ambient occlusion, free of noise; `null` without pairs.
    pub ao_change_rms: Option<f64>,
    /// RMS change per frame of the coefficients, free of noise; `null` without pairs.
    pub coefficient_change_rms: Option<f64>,
}

/// Figures of one candidate on one split.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CandidateMeasured {
    /// Its name.
    pub name: String,
    /// Its part in the comparison.
    pub kind: Kind,
    /// Ambient occlusion, derived from the coefficients for SH signals.
    pub ao: AoError,
    /// All coefficients alike.
    pub coefficients: Squared,
    /// The functions over directions; `null` for `ao`.
    pub function: Option<FunctionError>,
    /// One per light, in the order of `lights`.
    pub shading: Vec<ShadingError>,
    /// Change of the error per frame; `null` without pairs.
    pub flicker: Option<Flicker>,
    /// Signed residuals.
    pub residual: Residual,
    /// Where and when it is worst; `null` without poses.
    pub worst: Option<Worst>,
    /// What storing at this precision adds to the most precise of the model and its other precisions; `null` of that
    /// one, and of what is no storage of the model.
    pub added: Option<Added>,
    /// Mean |error| of ambient occlusion per pose, parallel to the split's `frames`.
    pub frame_ao_mae: Vec<f64>,
    /// Mean square of the coefficients per pose, cross form, parallel to `frames`.
    pub frame_mean_square: Vec<f64>,
}

/// Errors of ambient occlusion: `ao` itself; 2√π·t₀ of `transfer`; the product of `visibility`
/// with the clamped cosine (truncated at the order, alike for model and reference).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AoError {
    /// Mean |m − (r₁+r₂)/2|. Contains the reference's noise: see `ao_noise_mae`.
    pub mean_absolute: Estimate,
    /// 99th percentile of |m − (r₁+r₂)/2|, to 0.4 % of itself. Contains the reference's noise.
    pub p99: f64,
    /// Mean of m − (r₁+r₂)/2; free of bias.
    pub mean_signed: Estimate,
    /// Cross form; free of the reference's noise.
    pub squared: Squared,
}

/// Errors of the functions Δ(ω) = Σ Δ_i y_i(ω) that the coefficients stand for, per channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FunctionError {
    /// Mean of ΔᵀG(n)Δ, the integral of Δ² over the normal's hemisphere; PRT07 §6.
    pub hemisphere: Squared,
    /// Its root over the root of the signal's own energy: the relative error.
    pub hemisphere_relative: Option<f64>,
    /// Mean of ‖Δ‖², the integral over the whole sphere.
    pub sphere: Squared,
}

/// Error of albedo-1 shading under one light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShadingError {
    /// Name of the light.
    pub light: String,
    /// Cross form, radiance of the brightest unshaded surface = 1.
    pub squared: Squared,
    /// RMS error over RMS shading.
    pub relative_rms: Option<f64>,
    /// −10 log₁₀ of the mean square (peak 1), decibels.
    pub psnr_db: Option<f64>,
}

/// RMS change of the error from one frame to the next: what is seen as flicker, cross form.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Flicker {
    /// Of ambient occlusion per frame.
    pub ao: Squared,
    /// Of the coefficients per frame.
    pub coefficients: Squared,
    /// Of shading per frame, mean square over the lights; `null` without lights.
    pub shading: Option<Squared>,
}

/// Signed residuals m − (r₁+r₂)/2 of all coefficients (PRT07 figure 2).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Free of bias.
    pub mean: Estimate,
    /// Cross-form mean square less the mean's square: the residuals' variance without the
    /// reference's noise; clamped at 0.
    pub variance: f64,
    /// Variance of the residuals as they are in the histogram, noise included.
    pub variance_with_noise: f64,
    /// Left end of the first bin. Bins cover the central 99 %.
    pub histogram_low: f64,
    /// Width of a bin.
    pub histogram_width: f64,
    /// Fraction of all residuals in each bin.
    pub histogram: Vec<f64>,
    /// Fraction of residuals at or below the right end of each bin.
    pub cumulative: Vec<f64>,
}

/// Where and when a candidate is worst, by ambient occlusion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Worst {
    /// The pose of the largest mean |error|.
    pub pose: WorstPose,
    /// The vertex of the largest mean |error| over the split's poses.
    pub vertex: WorstVertex,
    /// The largest single |error|; contains the reference's noise.
    pub sample: WorstSample,
}

/// A pose by name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorstPose {
    /// Index in the data set.
    pub pose: usize,
    /// Clip's name; empty for a static pose.
    pub clip: String,
    /// Seconds since the clip's start.
    pub time_s: f64,
    /// Mean |error| of ambient occlusion over the mesh.
    pub ao_mae: f64,
}

/// A vertex by name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Place {
    /// Index in the whole mesh, glTF order (node, primitive, vertex).
    pub vertex: u32,
    /// Name of its part; empty where unknown.
    pub part: String,
    /// Index within the part.
    pub vertex_in_part: u32,
}

/// A vertex and how it errs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorstVertex {
    /// Which.
    pub place: Place,
    /// Mean |error| of ambient occlusion over poses.
    pub ao_mae: f64,
}

/// A vertex in a pose and how it errs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorstSample {
    /// Index of the pose in the data set.
    pub pose: usize,
    /// Clip's name.
    pub clip: String,
    /// Seconds since the clip's start.
    pub time_s: f64,
    /// Which vertex.
    pub place: Place,
    /// Signed error of ambient occlusion: positive is too bright.
    pub ao_error: f64,
}

/// The difference of two candidates, which holds no noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Added {
    /// RMS of m − m₀ over the coefficients.
    pub coefficient_rms: f64,
    /// Mean |difference| of ambient occlusion.
    pub ao_mae: f64,
    /// Largest |difference| of ambient occlusion.
    pub ao_max: f64,
    /// Relative growth of the coefficients' mean square error against the most precise one's; `null`
    /// where either is lost in the noise.
    pub mean_square_growth: Option<f64>,
}

/// The poses of a split, sorted by clip and time; all arrays are parallel.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Frames {
    /// Index in the data set.
    pub pose: Vec<usize>,
    /// Index into the split's `clips`.
    pub clip: Vec<usize>,
    /// Seconds since the clip's start.
    pub time_s: Vec<f64>,
    /// Mean |noise| of the average reference's ambient occlusion.
    pub ao_noise_mae: Vec<f64>,
}

/// The model's mean |error| of ambient occlusion per point, over the headline split.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// Which split.
    pub split: Split,
    /// A vertex of each point, glTF order.
    pub vertex: Vec<u32>,
    /// Mean |error| `[point]`.
    pub ao_mae: Vec<f32>,
}
