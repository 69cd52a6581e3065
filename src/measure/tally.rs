//! Sums over the poses of one split, for one track.

use super::rows::{Coefficients, Rows, Track};
use crate::num::stats::{Distribution, Sum};

/// Means over the rows of one pose. Squares are in cross form: unbiased, and negative at times.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PoseRow {
    /// Mean |e| of ambient occlusion against the average reference.
    pub(super) ao_mae: f64,
    /// Mean e of ambient occlusion.
    pub(super) ao_bias: f64,
    /// Mean square of ambient occlusion.
    pub(super) ao_mse: f64,
    /// Mean square over coefficients.
    pub(super) mse: f64,
    /// Mean residual over coefficients.
    pub(super) bias: f64,
    /// Mean of ΔᵀG(n)Δ.
    pub(super) hemisphere: f64,
    /// Mean square of shading, per light.
    pub(super) lights: Vec<f64>,
}

/// Mean squares of the change from one frame to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PairRow {
    /// Of ambient occlusion.
    pub(super) ao_mse: f64,
    /// Of the coefficients.
    pub(super) mse: f64,
    /// Of shading, the mean over lights; 0 without lights.
    pub(super) shading_mse: f64,
}

/// The largest single error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    /// Index among the split's poses.
    pub(super) place: usize,
    pub(super) point: usize,
    /// Signed error of ambient occlusion.
    pub(super) error: f64,
}

/// Everything kept of one track over one split: a few numbers per pose and per point, and two
/// distributions.
#[derive(Debug)]
pub(super) struct Tally {
    track: Track,
    pub(super) poses: Vec<PoseRow>,
    pub(super) pairs: Vec<PairRow>,
    /// Signed errors of ambient occlusion, all rows of all poses.
    pub(super) ao: Distribution,
    /// Signed residuals of all coefficients against the average reference.
    pub(super) residual: Distribution,
    /// Σ |e| of ambient occlusion over poses [point], the mean over channels.
    pub(super) point_ao: Vec<f64>,
    pub(super) worst: Option<Sample>,
}

impl Tally {
    pub(super) fn new(track: Track, points: usize) -> Self {
        Self {
            track,
            poses: Vec::new(),
            pairs: Vec::new(),
            ao: Distribution::default(),
            residual: Distribution::default(),
            point_ao: vec![0.0; points],
            worst: None,
        }
    }

    /// Adds one pose.
    pub(super) fn add(&mut self, rows: &Rows, coefficients: Coefficients<'_>) {
        let count = rows.square.len();
        let probes = rows.left.len() / count;
        let coefficients_of_row = coefficients.reference1.len() / count;
        let channels = count / self.point_ao.len();
        let n = count as f64;
        let (mut magnitude, mut signed) = (Sum::default(), Sum::default());
        for row in 0..count {
            let error = (rows.left[row * probes] + rows.right[row * probes]) / 2.0;
            magnitude.add(error.abs());
            signed.add(error);
            self.ao.add(error);
            let point = row / channels;
            self.point_ao[point] += error.abs() / channels as f64;
            if self.worst.is_none_or(|w| error.abs() > w.error.abs()) {
                self.worst = Some(Sample { place: self.poses.len(), point, error });
            }
        }
        self.add_residuals(coefficients);
        let squares = mean_squares(&rows.left, &rows.right, probes);
        let mean = |x: &[f64]| x.iter().copied().collect::<Sum>().value() / n;
        self.poses.push(PoseRow {
            ao_mae: magnitude.value() / n,
            ao_bias: signed.value() / n,
            ao_mse: squares[0],
            mse: mean(&rows.square) / coefficients_of_row as f64,
            bias: mean(&rows.sum) / coefficients_of_row as f64,
            hemisphere: mean(&rows.hemisphere),
            lights: squares[1..].to_vec(),
        });
    }

    fn add_residuals(&mut self, c: Coefficients<'_>) {
        let Track::Candidate(model) = self.track else { return };
        let references = c.reference1.iter().zip(c.reference2);
        for (&m, (&r1, &r2)) in c.candidates[model].iter().zip(references) {
            self.residual.add(f64::from(m) - (f64::from(r1) + f64::from(r2)) / 2.0);
        }
    }

    /// Adds the step between two frames.
    pub(super) fn add_pair(&mut self, now: &Rows, before: &Rows, coefficients_of_row: usize) {
        let count = now.square.len();
        let change =
            |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
        let (left, right) = (change(&now.left, &before.left), change(&now.right, &before.right));
        let squares = mean_squares(&left, &right, now.left.len() / count);
        let lights = squares.len() - 1;
        let change: Sum = now.change.iter().copied().collect();
        self.pairs.push(PairRow {
            ao_mse: squares[0],
            mse: change.value() / (count * coefficients_of_row) as f64,
            shading_mse: squares[1..].iter().sum::<f64>() / lights.max(1) as f64,
        });
    }
}

/// Per probe the mean over rows of left·right.
fn mean_squares(left: &[f64], right: &[f64], probes: usize) -> Vec<f64> {
    let mut sums = vec![Sum::default(); probes];
    for (l, r) in left.chunks_exact(probes).zip(right.chunks_exact(probes)) {
        sums.iter_mut().zip(l.iter().zip(r)).for_each(|(s, (l, r))| s.add(l * r));
    }
    let rows = (left.len() / probes) as f64;
    sums.iter().map(|s| s.value() / rows).collect()
}
