//! Leave-one-group-out errors of a ridge in closed form, and the α that they choose.
//!
//! With regressors Ũ = [1/√p, U], shares d = s²/(s²+α²) and hat matrix H = Ũ diag(1, d) Ũᵀ, the
//! errors of a group g that the fit has not seen are (I − H_gg)⁻¹ r_g, r = B − HB (for single
//! poses r_i/(1 − h_i), h the leverage). Their energy follows from [`Moments`] alone.

use rayon::prelude::*;

use super::Error;
use super::design::{Design, Filter};
use super::folds::{Fold, Folds};
use super::moments::Moments;
use crate::num::linalg::{Mat, MatRef, multiply_add, product, symmetric_eigen, thin_svd};

/// Below this smallest eigenvalue of I − H_gg the closed form divides round-off by round-off.
const LEAST_EIGENVALUE: f64 = 1e-8;

/// Folds without which principal directions are found anew, at most.
const MOST_REFITS: usize = 64;

/// α over the largest singular value: from a filter that passes everything the data resolve to
/// one that passes a hundredth, 20 values.
const GRID: (f64, f64, usize) = (1e-4, 1e1, 20);

/// The candidates for α, ascending.
pub(super) fn grid(design: &Design) -> Vec<f64> {
    let (low, high, count) = GRID;
    let largest = design.s.first().copied().unwrap_or(0.0);
    let step = (high / low).ln() / (count - 1) as f64;
    (0..count).map(|i| largest * low * (step * i as f64).exp()).collect()
}

/// What the errors are computed from.
#[derive(Debug, Clone, Copy)]
pub(super) struct LeaveOut<'a> {
    pub(super) design: &'a Design,
    pub(super) folds: &'a Folds,
    pub(super) moments: &'a Moments,
}

/// A filter over all directions, ready for use in every fold.
struct Shares<'a> {
    filter: &'a Filter,
    /// w.
    left: Vec<f64>,
    /// diag(w) CCᵀ diag(w).
    gram: Mat<f64>,
}

/// The energies of one fold, one per filter.
struct FoldEnergies {
    poses: usize,
    /// With the directions of all poses; empty where every fold is refitted.
    closed: Vec<f64>,
    /// With directions found without the fold, where it is one of those.
    refitted: Option<Vec<f64>>,
}

/// Σ over folds, in their order; what refitting adds in some of them is scaled up to all poses.
fn total(folds: &[FoldEnergies], filter: usize) -> f64 {
    let (mut closed, mut added, mut sampled, mut poses) = (0.0, 0.0, 0, 0);
    for fold in folds {
        let own = fold.closed.get(filter).copied().unwrap_or(0.0);
        closed += own;
        poses += fold.poses;
        if let Some(refitted) = &fold.refitted {
            added += refitted[filter] - own;
            sampled += fold.poses;
        }
    }
    if sampled == 0 { closed } else { closed + added * (poses as f64 / sampled as f64) }
}

impl LeaveOut<'_> {
    /// The energy of all left-out errors, Σ over folds of ‖(I − H_gg)⁻¹ r_g‖², for each filter.
    ///
    /// With `anew`, the principal directions that filters keep are found anew without each fold:
    /// for every fold where these are at most [`MOST_REFITS`], else for as many of them, evenly
    /// spread, whose mean difference to the closed form stands for all.
    pub(super) fn energies(&self, filters: &[Filter], anew: bool) -> Result<Vec<f64>, Error> {
        let shares: Vec<Shares<'_>> = filters.iter().map(|filter| self.shares(filter)).collect();
        let folds = &self.folds.folds;
        let step = if anew { folds.len().div_ceil(MOST_REFITS) } else { usize::MAX };
        let of_fold = |(i, fold): (usize, &Fold)| -> Result<FoldEnergies, Error> {
            let refitted = if anew && i % step == 0 {
                let refit = self.folds.refit(self.design, i)?;
                Some(filters.iter().map(|f| self.refitted(i, fold, refit, f)).collect())
            } else {
                None
            };
            let closed =
                if step == 1 { Vec::new() } else { self.closed_or_refit(i, fold, &shares)? };
            Ok(FoldEnergies { poses: fold.poses, closed, refitted })
        };
        let each: Vec<FoldEnergies> =
            folds.par_iter().enumerate().map(of_fold).collect::<Result<_, _>>()?;
        let lost: f64 = self.moments.lost.iter().map(|lost| lost.max(0.0)).sum();
        Ok((0..filters.len()).map(|filter| lost + total(&each, filter)).collect())
    }

    /// The closed form for every filter, or a refit where it does not exist.
    fn closed_or_refit(
        &self,
        i: usize,
        fold: &Fold,
        shares: &[Shares<'_>],
    ) -> Result<Vec<f64>, Error> {
        let of = |shares: &Shares<'_>| {
            if let Some(energy) = self.closed(i, fold, shares)? {
                return Ok(energy);
            }
            let refit = self.folds.refit(self.design, i)?;
            Ok(self.refitted(i, fold, refit, shares.filter))
        };
        shares.iter().map(of).collect()
    }

    fn shares<'f>(&self, filter: &'f Filter) -> Shares<'f> {
        let left = filter.left(&self.design.s);
        let gram = &self.moments.gram;
        let gram = Mat::from_fn(left.len(), left.len(), |i, j| left[i] * gram[(i, j)] * left[j]);
        Shares { filter, left, gram }
    }

    /// The closed form, `None` where I − H_gg is too close to singular.
    fn closed(&self, i: usize, fold: &Fold, shares: &Shares<'_>) -> Result<Option<f64>, Error> {
        let (k, u) = (fold.rows, fold.u.as_ref());
        let scaled = Mat::from_fn(k, u.ncols(), |a, j| u[(a, j)] * shares.left[j]);
        // I − H = (I − ŨŨᵀ) + U diag(w) Uᵀ.
        let mut kept = product(scaled.as_ref(), u.transpose());
        multiply_add(kept.as_mut(), -1.0, u, u.transpose());
        for a in 0..k {
            for b in 0..k {
                let one = if a == b { 1.0 } else { 0.0 };
                kept[(a, b)] += one - fold.ones[a] * fold.ones[b];
            }
        }
        let half = product(u, shares.gram.as_ref());
        let cross = self.moments.cross.subcols(fold.first_row, k);
        let cross = product(scaled.as_ref(), cross);
        let residual = product(half.as_ref(), u.transpose())
            + &self.moments.blocks[i]
            + &cross
            + cross.transpose();
        if k == 1 {
            let (kept, energy) = (kept[(0, 0)], residual[(0, 0)].max(0.0));
            return Ok((kept >= LEAST_EIGENVALUE).then(|| energy / (kept * kept)));
        }
        let (values, vectors) = symmetric_eigen(kept.as_ref())?;
        if values.last().is_some_and(|&least| least < LEAST_EIGENVALUE) {
            return Ok(None);
        }
        let turned = product(residual.as_ref(), vectors.as_ref());
        let turned = product(vectors.transpose(), turned.as_ref());
        let energy = values.iter().enumerate().map(|(j, v)| turned[(j, j)].max(0.0) / (v * v));
        Ok(Some(energy.sum()))
    }

    /// The energy of the group's errors under a fit without it.
    fn refitted(&self, i: usize, fold: &Fold, refit: &Refit, filter: &Filter) -> f64 {
        let (k, r) = (fold.rows, self.design.rank());
        let prediction = refit.prediction(self.design, fold, filter);
        // The errors are B_g − Z(C̃ − Ũ_gᵀB_g) = T B⊥_g + Y C, since B_g = B⊥_g + U_g C.
        let regressors = Mat::from_fn(k, r + 1, |a, b| match b {
            0 => fold.ones[a],
            _ => fold.u[(a, b - 1)],
        });
        let t = Mat::<f64>::identity(k, k) + product(prediction.as_ref(), regressors.transpose());
        let y = product(t.as_ref(), fold.u.as_ref()) - prediction.subcols(1, r);
        let cross = self.moments.cross.subcols(fold.first_row, k);
        trace_of_product(&product(t.as_ref(), self.moments.blocks[i].as_ref()), t.as_ref())
            + 2.0 * trace_of_product(&product(t.as_ref(), cross.transpose()), y.as_ref())
            + trace_of_product(&product(y.as_ref(), self.moments.gram.as_ref()), y.as_ref())
    }
}

/// tr(A Bᵀ).
fn trace_of_product(a: &Mat<f64>, b: MatRef<'_, f64>) -> f64 {
    let of_column = |j| a.col(j).iter().zip(b.col(j).iter()).map(|(a, b)| a * b).sum::<f64>();
    (0..a.ncols()).map(of_column).sum()
}

/// The regressors without one group: with A₋ the other poses' coordinates U diag(s) and μ their
/// mean, A₋ − μ = U'S'V'ᵀ.
#[derive(Debug)]
pub(super) struct Refit {
    mean: Vec<f64>,
    s: Vec<f64>,
    v: Mat<f64>,
    /// Number of the other poses.
    others: f64,
}

impl Refit {
    pub(super) fn new(design: &Design, folds: &Folds, fold: &Fold) -> Result<Self, Error> {
        let range = fold.first_pose..fold.first_pose + fold.poses;
        let outside = folds.order.iter().enumerate().filter(|(i, _)| !range.contains(i));
        let rest: Vec<usize> = outside.map(|(_, &pose)| pose).collect();
        let others = rest.len() as f64;
        let r = design.rank();
        let at = |pose: usize, j: usize| design.u[(pose, j)] * design.s[j];
        let mean: Vec<f64> =
            (0..r).map(|j| rest.iter().map(|&pose| at(pose, j)).sum::<f64>() / others).collect();
        let centred = Mat::from_fn(rest.len(), r, |i, j| at(rest[i], j) - mean[j]);
        let svd = thin_svd(centred.as_ref())?;
        Ok(Self { mean, s: svd.s, v: svd.v, others })
    }

    /// Z, k × (r + 1), such that this fit predicts Z(C̃ − Ũ_gᵀB_g) for the group, C̃ = [0; C]:
    /// X = V' diag(1/(s'²+α²)) V'ᵀ (A₋ − μ)ᵀB₋, and both (A₋ − μ)ᵀB₋ and the mean of B₋ are
    /// combinations of C̃ − Ũ_gᵀB_g, the sums over the other poses.
    fn prediction(&self, design: &Design, fold: &Fold, filter: &Filter) -> Mat<f64> {
        let (k, r) = (fold.rows, design.rank());
        let s = &design.s;
        let root = (design.poses() as f64).sqrt();
        let least = s.first().map_or(0.0, |s| s * f64::from(f32::EPSILON));
        let kept = self.s.iter().take(filter.inputs).take_while(|&&s| s > least).count();
        let v = self.v.subcols(0, kept);
        let at =
            Mat::from_fn(k, r, |a, j| fold.u[(a, j)] * s[j] - root * fold.ones[a] * self.mean[j]);
        let mut inner = product(at.as_ref(), v);
        for j in 0..kept {
            let gain = 1.0 / (self.s[j].powi(2) + filter.alpha.powi(2));
            inner.col_mut(j).iter_mut().for_each(|x| *x *= gain);
        }
        let solution = product(inner.as_ref(), v.transpose());
        Mat::from_fn(k, r + 1, |a, b| match b {
            0 => {
                let slope: f64 = (0..r).map(|j| solution[(a, j)] * self.mean[j]).sum();
                root * (root * fold.ones[a] / self.others - slope)
            }
            _ => solution[(a, b - 1)] * s[b - 1],
        })
    }
}

/// Index of the smallest error; of errors that agree to 1e-12 the last, so the largest α.
pub(super) fn choose(errors: &[f64]) -> usize {
    let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
    errors.iter().rposition(|&e| e <= least * (1.0 + 1e-12)).unwrap_or(0)
}
