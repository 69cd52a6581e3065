//! What a fit tells about itself.

use std::collections::BTreeMap;
use std::time::Instant;

use super::Fitted;

/// How a fit went. Errors are root mean squares over poses, points and coefficients, in the units
/// of the signal, against the data that the fit saw; noise is theirs, too.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FitReport {
    /// The regularisation used; `None` for the mean.
    pub alpha: Option<f64>,
    /// Every α that was tried, ascending, with its error on what was left out. Empty where nothing
    /// was or could be left out.
    pub alphas: Vec<(f64, f64)>,
    /// What was left out, in words; empty as `alphas` is.
    pub left_out: String,
    /// The error on the training poses themselves.
    pub training_rmse: f64,
    /// The same error of the mean alone: the spread of the data.
    pub spread_rms: f64,
    /// Effective parameters per output, the intercept included: 1 + Σ s²/(s² + α²). Of the clustered
    /// families the mean over outputs, with what the choice of directions takes; with neurons an
    /// estimate by the number of weights. What occluders take is not counted.
    pub degrees_of_freedom: f64,
    /// Pose dimensions used.
    pub inputs: usize,
    /// Output dimensions used; 0 where the family has no basis.
    pub outputs: usize,
    /// Variance of the poses along all their principal directions, descending.
    pub pose_spectrum: Vec<f64>,
    /// Leading squared singular values of the outputs, rows (pose, coefficient), columns points,
    /// descending, at least 100 where there are as many; empty without a basis. Not centred.
    pub output_spectrum: Vec<f64>,
    /// The sum of all squared singular values, Σ y²: what shares of `output_spectrum` refer to.
    pub output_energy: f64,
    /// The share of the outputs' variance over the poses that lies in the basis; 1 without one.
    pub output_variance_retained: f64,
    /// By how much the mean square error on left-out poses would be underestimated if the output
    /// basis were taken as known: it is found anew without each clip (or quarter), with its share
    /// of the poses expressed in it. `alphas` include it. `None` without basis or left-out poses.
    pub basis_optimism: Option<f64>,
    /// What spheres on the bones explain, where they were asked for; all other figures are then
    /// about what they leave.
    pub occluders: Option<OccluderReport>,
    /// Passes over the data.
    pub passes: usize,
    /// What a user should know.
    pub notices: Vec<String>,
    /// Wall-clock seconds by phase, and `total_s`.
    pub seconds: BTreeMap<String, f64>,
}

/// How the fit of occluders went; errors as in [`FitReport`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OccluderReport {
    /// Spheres.
    pub spheres: usize,
    /// Groups of them that a point tells apart.
    pub groups: usize,
    /// What holds a point's weights to those of its bone, λ: Σ (y − wψ)² + λ E Σ (w − w_bone)², over poses and
    /// coefficients about their means, E the mean over all points and groups of Σ ψ². Beside λ E stands the
    /// noise of an output.
    pub penalty: f64,
    /// The error on left-out clips, where any can be left out.
    pub left_out_rmse: Option<f64>,
    /// The error on the training poses themselves.
    pub training_rmse: f64,
    /// The spread of the data without occluders.
    pub spread_rms: f64,
}

/// Measures phases.
#[derive(Debug)]
pub(super) struct Clock {
    start: Instant,
    last: Instant,
    seconds: BTreeMap<String, f64>,
}

impl Clock {
    pub(super) fn start() -> Self {
        let now = Instant::now();
        Self { start: now, last: now, seconds: BTreeMap::new() }
    }

    /// Books the time since the last lap under `phase`.
    pub(super) fn lap(&mut self, phase: &str) {
        let now = Instant::now();
        *self.seconds.entry(phase.to_owned()).or_default() += (now - self.last).as_secs_f64();
        self.last = now;
    }
}

impl Fitted {
    pub(super) fn finish(mut self, clock: Clock) -> Self {
        self.report.seconds = clock.seconds;
        let total = clock.start.elapsed().as_secs_f64();
        self.report.seconds.insert("total_s".to_owned(), total);
        self
    }
}
