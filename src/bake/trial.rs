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
    /// Measures a plan's sets.
    pub(super) fn of(plan: &Plan) -> Self {
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
