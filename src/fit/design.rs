//! The pose parameters as the ridge sees them: centred, and factored once.

use super::Error;
use crate::num::linalg::{Mat, MatRef, rows_of, thin_svd};

/// The centred parameters A = U diag(s) Vᵀ of p poses, with only the directions that f32 tells
/// from round-off.
#[derive(Debug, Clone)]
pub(super) struct Design {
    /// Mean of each parameter, a.
    pub(super) centre: Vec<f64>,
    /// p × r, columns orthonormal and orthogonal to the vector of ones.
    pub(super) u: Mat<f64>,
    /// Descending, r, all above 0.
    pub(super) s: Vec<f64>,
    /// a × r.
    pub(super) v: Mat<f64>,
    /// All min(p, a) singular values, round-off included.
    pub(super) spectrum: Vec<f64>,
}

/// Parameters are stored in f32. Their round-off, as a matrix, has a norm of at most ε/2 times
/// their own: a direction whose singular value is no larger carries nothing (a duplicated or
/// collinear column).
fn tolerance(parameters: &[f32]) -> f64 {
    let squares: f64 = parameters.iter().map(|&x| f64::from(x).powi(2)).sum();
    f64::from(f32::EPSILON) * squares.sqrt()
}

impl Design {
    /// Centres and factors `parameters` `[pose, parameter]`.
    pub(super) fn new(parameters: &[f32], names: &[String], poses: usize) -> Result<Self, Error> {
        let count = names.len();
        if let Some(at) = parameters.iter().position(|x| !x.is_finite()) {
            let (pose, name) = (at / count, names[at % count].clone());
            return Err(Error::Parameter { name, pose, found: parameters[at] });
        }
        let raw = rows_of(parameters, poses, count);
        let centre: Vec<f64> =
            raw.col_iter().map(|c| c.iter().map(|&x| f64::from(x)).sum::<f64>()).collect();
        let centre: Vec<f64> = centre.into_iter().map(|sum| sum / poses as f64).collect();
        let centred = Mat::from_fn(poses, count, |i, j| f64::from(raw[(i, j)]) - centre[j]);
        let svd = thin_svd(centred.as_ref())?;
        let least = tolerance(parameters);
        // p centred rows span at most p - 1 directions, whatever round-off says.
        let most = poses.saturating_sub(1);
        let rank = svd.s.iter().take(most).take_while(|&&s| s > least).count();
        Ok(Self {
            centre,
            u: svd.u.subcols(0, rank).to_owned(),
            s: svd.s[..rank].to_vec(),
            v: svd.v.subcols(0, rank).to_owned(),
            spectrum: svd.s,
        })
    }

    /// What rounding the centre to f32 moves, along each of the first `inputs` directions:
    /// Vᵀ(c₃₂ − c). A model that subtracts the rounded centre makes up for it where it has an
    /// intercept; beside a shift of 1e6 that is much.
    pub(super) fn rounding(&self, inputs: usize) -> Vec<f64> {
        let moved: Vec<f64> = self.centre.iter().map(|&c| f64::from(c as f32) - c).collect();
        (0..inputs)
            .map(|k| moved.iter().enumerate().map(|(i, m)| self.v[(i, k)] * m).sum())
            .collect()
    }

    /// Number of directions, r.
    pub(super) fn rank(&self) -> usize {
        self.s.len()
    }

    /// Number of poses, p.
    pub(super) fn poses(&self) -> usize {
        self.u.nrows()
    }

    /// Variance over the poses along every principal direction, min(p, a) numbers, descending.
    pub(super) fn variances(&self) -> Vec<f64> {
        let degrees = self.poses().saturating_sub(1).max(1) as f64;
        self.spectrum.iter().map(|s| s * s / degrees).collect()
    }

    /// The fewest leading directions that hold `share` of the variance.
    pub(super) fn retaining(&self, share: f64) -> usize {
        fewest(&self.s.iter().map(|s| s * s).collect::<Vec<_>>(), share)
    }

    /// Root mean square over the poses of the distance to the first `inputs` directions.
    pub(super) fn residual_rms(&self, inputs: usize) -> f64 {
        let left: f64 = self.spectrum[inputs..].iter().rev().map(|s| s * s).sum();
        (left / self.poses().max(1) as f64).sqrt()
    }

    /// The first `inputs` principal directions, a × `inputs`.
    pub(super) fn directions(&self, inputs: usize) -> MatRef<'_, f64> {
        self.v.subcols(0, inputs)
    }
}

/// The smallest count of leading `values` (descending, not negative) that sums to at least
/// `share` of all of them.
pub(super) fn fewest(values: &[f64], share: f64) -> usize {
    let total: f64 = values.iter().rev().sum();
    let mut sum = 0.0;
    for (i, value) in values.iter().enumerate() {
        sum += value;
        // One part in 1e12 for the order of the two sums.
        if sum >= share * total * (1.0 - 1e-12) {
            return i + 1;
        }
    }
    values.len()
}

/// How strongly a ridge with α passes each direction: the fit uses d_j of what the outputs hold
/// along u_j and leaves w_j = 1 − d_j in the residual.
#[derive(Debug, Clone)]
pub(super) struct Filter {
    /// The regularisation.
    pub(super) alpha: f64,
    /// Directions after the first `inputs` are not used at all.
    pub(super) inputs: usize,
}

impl Filter {
    /// f_j = s_j / (s_j² + α²), what turns UᵀB into the solution; 0 for directions not used.
    pub(super) fn gains(&self, s: &[f64]) -> Vec<f64> {
        self.map(s, 0.0, |s, a| s / (s * s + a * a))
    }

    /// w_j = α² / (s_j² + α²); 1 for directions not used. Not computed as 1 − d_j, which would
    /// cancel where α is small.
    pub(super) fn left(&self, s: &[f64]) -> Vec<f64> {
        self.map(s, 1.0, |s, a| a * a / (s * s + a * a))
    }

    /// Effective number of parameters per output, the intercept included:
    /// 1 + Σ s_j² / (s_j² + α²).
    pub(super) fn degrees_of_freedom(&self, s: &[f64]) -> f64 {
        1.0 + self.left(s).iter().map(|w| 1.0 - w).sum::<f64>()
    }

    fn map(&self, s: &[f64], unused: f64, used: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        let one =
            |(j, &s): (usize, &f64)| if j < self.inputs { used(s, self.alpha) } else { unused };
        s.iter().enumerate().map(one).collect()
    }
}
