//! The weights of groups of spheres at every point: a ridge towards weights that the points of a
//! bone share, as strong as left-out clips say.

use rayon::prelude::*;

use super::PointMoments;
use super::sums::Moments;
use crate::fit::{On, Ridge, Settings};

/// Penalties that are tried, as shares of the features' mean energy at a point: from next to
/// nothing to weights that all points of a bone share.
const PENALTIES: [f64; 13] =
    [1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1e4];

/// Points that penalties are tried at, at most.
const TRIED_POINTS: usize = 2048;

/// Of the prior towards weights of 1, as a share of the mean energy of a group's features over a bone's points.
const TO_ONE: f64 = 1e-3;

/// The least variance that an output is taken to have beyond what weights can explain: a data set may not know
/// its noise, and features are no better than this.
const LEAST_NOISE: f64 = 1e-6;

/// What points share in solving for their weights.
pub(super) struct Solver {
    /// `[bone]`: weights that its points share.
    shared: Vec<Vec<f64>>,
    /// `[bone][fold]`: the same without each fold.
    shared_folds: Vec<Vec<Vec<f64>>>,
    /// Mean energy of a group's features at a point.
    scale: f64,
    /// What every penalty has beside its share: the noise of an output, so that weights are held to their
    /// prior within about 1 where features move less than that. A bone that keeps still in the training clips
    /// has nothing but round-off to say of its weights, and shares of that hold nothing.
    floor: f64,
    fixed: Option<f64>,
}

/// Sums over the points of a bone, for the weights that they share.
#[derive(Clone)]
struct Pooled {
    all: Moments,
    folds: Vec<Moments>,
}

impl Solver {
    pub(super) fn new(
        moments: &[PointMoments],
        (groups, bones): (usize, usize),
        noise_variance: f64,
        settings: &Settings,
    ) -> Self {
        let floor = noise_variance.max(LEAST_NOISE);
        let count = moments.first().map_or(0, |point| point.folds.len());
        let zero = Pooled { all: Moments::zero(groups), folds: vec![Moments::zero(groups); count] };
        let mut pooled = vec![zero; bones];
        for point in moments {
            let pooled = &mut pooled[point.bone];
            pooled.all.merge(&point.all);
            let pairs = pooled.folds.iter_mut().zip(&point.folds);
            pairs.for_each(|(sum, [others, _])| sum.merge(others));
        }
        let energy = |pooled: &Pooled| pooled.all.diagonal().iter().sum::<f64>();
        let scale = pooled.iter().map(energy).sum::<f64>() / (groups * moments.len()).max(1) as f64;
        // A little towards "blocks as it is" for all groups alike: one that hardly moves, such as
        // a stiff limb's own, would otherwise take any weight that its noise suggests.
        let share = |moments: &Moments| {
            let trace = moments.diagonal().iter().sum::<f64>() / groups.max(1) as f64;
            moments.solve(&vec![1.0; groups], &vec![TO_ONE * trace + floor; groups])
        };
        let fixed = match (settings.on, settings.ridge) {
            (On::Trained, _) => Some(PENALTIES[0]),
            (On::Novel, Ridge::Fixed(alpha)) => Some(alpha),
            (On::Novel, _) => None,
        };
        Self {
            shared: pooled.iter().map(|bone| share(&bone.all)).collect(),
            shared_folds: pooled.iter().map(|p| p.folds.iter().map(share).collect()).collect(),
            scale,
            floor,
            fixed,
        }
    }

    /// The weights of a point by all poses.
    pub(super) fn weights_of(&self, point: &PointMoments, penalty: f64) -> Vec<f64> {
        self.weights(&point.all, &self.shared[point.bone], penalty)
    }

    fn weights(&self, moments: &Moments, prior: &[f64], penalty: f64) -> Vec<f64> {
        moments.solve(prior, &vec![penalty * self.scale + self.floor; prior.len()])
    }

    /// The penalty that predicts left-out poses best, by the sum over points of each one's root
    /// mean square: the sum of squares would listen to the few points where any model fails. And
    /// the energy that it leaves of them.
    pub(super) fn choose(&self, moments: &[PointMoments]) -> (f64, Option<f64>) {
        if let Some(fixed) = self.fixed {
            return (fixed, None);
        }
        if moments.first().is_none_or(|point| point.folds.is_empty()) {
            return (1.0, None);
        }
        // One penalty for all points: some of them say which.
        let step = moments.len().div_ceil(TRIED_POINTS).max(1);
        let tried = PENALTIES.map(|penalty| {
            let energies = self.left_out(moments, penalty, step);
            (penalty, energies.iter().map(|energy| energy.sqrt()).sum::<f64>())
        });
        let best = tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        best.map_or((1.0, None), |(penalty, _)| {
            (penalty, Some(self.left_out(moments, penalty, 1).iter().sum()))
        })
    }

    /// What every `step`-th point's model leaves of the folds that it has not seen.
    fn left_out(&self, moments: &[PointMoments], penalty: f64, step: usize) -> Vec<f64> {
        let of_point = |point: &PointMoments| -> f64 {
            let folds = point.folds.iter().zip(&self.shared_folds[point.bone]);
            let left = folds.map(|([others, own], shared)| {
                own.residual(&self.weights(others, shared, penalty))
            });
            left.sum()
        };
        // Collected: the order of a sum must not depend on the threads.
        moments.par_iter().step_by(step).map(of_point).collect()
    }
}
