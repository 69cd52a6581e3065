//! What blockers of known size make of a plan's direction sets, by trial.

use std::f64::consts::TAU;

use super::Signal;
use super::kernel::{Scratch, reduce};
use super::plan::Plan;
use crate::num::random::{hash, unit};
use crate::sh::MAX_COEFFICIENTS;

/// Sizes of blockers that are told apart.
pub(super) const SIZES: usize = 4;

/// Shares of a point's rays that small blockers take.
pub(super) const SMALL: [f64; SIZES - 1] = [1.0 / 256.0, 1.0 / 64.0, 1.0 / 16.0];

/// Tells the caps' random numbers from others.
const CAP_KEY: u64 = 0x63_6170;

/// Batches that g is measured by, over caps and coefficients together.
const CAP_BATCHES: usize = 4096;

/// What a plan's sets make of caps of random size and place.
pub(super) struct Trial {
    /// Mean number of crossings.
    pub(super) crossings: f64,
    /// Mean variance of a coefficient.
    pub(super) variance: f64,
    /// The same for small caps and, last, for these.
    pub(super) of_sizes: [f64; SIZES],
}

impl Trial {
    /// Measures the sets of a pilot and of plans. A plan has only so many sets, and what one of them happens
    /// to be worth is not what rays of that number are worth; of many plans the cheapest look would always be
    /// a lucky one's. So variances are those of the curve through all plans.
    pub(super) fn of_all(pilot: &Plan, plans: &[&Plan]) -> (Self, Vec<Self>) {
        let all = || std::iter::once(pilot).chain(plans.iter().copied());
        let mut trials: Vec<Self> = all().map(Self::of).collect();
        let rays: Vec<f64> = all().map(|plan| (plan.rays() as f64).ln()).collect();
        for size in 0..SIZES {
            let own: Vec<f64> = trials.iter().map(|trial| trial.of_sizes[size]).collect();
            let curve = curve(&rays, &own);
            trials.iter_mut().zip(curve).for_each(|(trial, value)| trial.of_sizes[size] = value);
        }
        for trial in &mut trials {
            trial.variance = trial.of_sizes[SIZES - 1];
        }
        (trials.remove(0), trials)
    }

    /// Measures a plan's sets.
    fn of(plan: &Plan) -> Self {
        let count = plan.coefficients;
        let caps = (CAP_BATCHES / count).clamp(128, 1024);
        let large = |number: [f64; 2]| (number[0], 1.8 * number[1] - 0.9);
        let (crossings, variance) = Self::over(plan, caps, large);
        let mut of_sizes = [variance; SIZES];
        for (of, share) in of_sizes.iter_mut().zip(SMALL) {
            // A cap of the angular radius α at the height h above the horizon takes the share
            // h sin² α of cosine-weighted rays, and (1 − cos α) of uniform ones.
            let small = |number: [f64; 2]| match plan.signal {
                Signal::Visibility => (number[0], 1.0 - share),
                Signal::Ao | Signal::Transfer => {
                    let height = number[0].sqrt().max(4.0 * share);
                    (height, (1.0 - share / height).sqrt())
                }
            };
            *of = Self::over(plan, caps / 2, small).1;
        }
        Self { crossings, variance, of_sizes }
    }

    /// Mean number of crossings and mean variance of a coefficient over caps, whose height and cosine
    /// of the radius come of random numbers.
    fn over(plan: &Plan, caps: usize, cap: impl Fn([f64; 2]) -> (f64, f64)) -> (f64, f64) {
        let count = plan.coefficients;
        let mut scratch = Scratch::new(plan);
        let out = &mut [0.0; MAX_COEFFICIENTS][..count];
        let (mut crossings, mut squares) = (0.0, 0.0);
        for index in 0..caps {
            let set = plan.directions.set(index % plan.directions.sets());
            let number = |axis: u64| unit(hash(&[CAP_KEY, index as u64, axis]));
            let ((height, edge), azimuth) = (cap([number(0), number(2)]), TAU * number(1));
            let radius = (1.0 - height * height).sqrt();
            let centre = [radius * azimuth.cos(), radius * azimuth.sin(), height];
            scratch.blocked.fill(0);
            for (lane, ((&x, &y), &z)) in set.x.iter().zip(set.y).zip(set.z).enumerate() {
                let along = centre[0] * f64::from(x) + centre[1] * f64::from(y);
                let inside = along + centre[2] * f64::from(z) > edge;
                scratch.blocked[lane / 64] |= u64::from(inside) << (lane % 64);
            }
            crossings += scratch.crossings(set.x.len());
            squares += reduce(plan, index % plan.directions.sets(), &mut scratch, out);
        }
        let batches = caps as f64;
        (crossings / batches, squares / (count as f64 * batches * plan.blocks as f64))
    }
}

/// Positive values as the parabola of best fit has their logarithms over x; as they are where there are too
/// few, or some are 0.
fn curve(x: &[f64], values: &[f64]) -> Vec<f64> {
    if values.len() < 5 || values.iter().any(|&value| value <= 0.0) {
        return values.to_vec();
    }
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let line: Vec<f64> = x.iter().map(|x| x - mean).collect();
    let moment = |power: i32| line.iter().map(|x| x.powi(power)).sum::<f64>();
    let (skew, spread) = (moment(3) / moment(2), moment(2) / x.len() as f64);
    let bend: Vec<f64> = line.iter().map(|x| x * x - skew * x - spread).collect();
    // The three are orthogonal over x.
    let mut curve = vec![0.0; x.len()];
    for shape in [&vec![1.0; x.len()], &line, &bend] {
        let along: f64 = shape.iter().zip(values).map(|(shape, value)| shape * value.ln()).sum();
        let square: f64 = shape.iter().map(|shape| shape * shape).sum();
        curve.iter_mut().zip(shape).for_each(|(curve, shape)| *curve += along / square * shape);
    }
    curve.into_iter().map(f64::exp).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A curve of its own kind comes back; scatter about one shrinks by the root of what three numbers can
    /// follow of it; few values, or zeros, stay.
    #[test]
    fn a_curve_is_drawn_through_what_scatters() {
        let x: Vec<f64> = (1..=16).map(|i| f64::from(i * i).ln()).collect();
        let truth: Vec<f64> = x.iter().map(|x| (-1.5 * x + 0.03 * x * x).exp()).collect();
        for (found, truth) in curve(&x, &truth).iter().zip(&truth) {
            assert!((found / truth - 1.0).abs() < 1e-9);
        }
        let off = |i: usize| 0.1 * (unit(hash(&[7, i as u64])) - 0.5);
        let scattered: Vec<f64> = truth.iter().enumerate().map(|(i, t)| t * off(i).exp()).collect();
        let square = |values: &[f64]| -> f64 {
            values.iter().zip(&truth).map(|(v, t)| (v / t).ln().powi(2)).sum()
        };
        let (before, after) = (square(&scattered), square(&curve(&x, &scattered)));
        assert!(after < 0.5 * before, "{after} of {before}");
        assert_eq!(curve(&x[..3], &truth[..3]), truth[..3]);
        assert_eq!(curve(&x[..5], &[1.0, 0.0, 1.0, 1.0, 1.0]), [1.0, 0.0, 1.0, 1.0, 1.0]);
    }
}
