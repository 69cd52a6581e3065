//! How many rays a point is worth.
//!
//! The error of an evenly spread set of directions comes from where the blocked region ends: a ray
//! that stands for a cell all blocked or all open errs nothing. So the variance of n rays is
//! g(n) · ℓ, with ℓ the length of the region's outline and g falling as about n⁻¹·⁵. Along the curve
//! that orders the rays, the outline is crossed where consecutive rays differ, so ℓ is counted, not
//! estimated from a difference of two batches, which for a single number would scatter by its own size.
//! g is measured on the direction sets themselves, with caps of random size and place as blockers.
//!
//! ℓ is counted in a *pilot* at the neighbours of a point, not at the point itself: so the point's
//! own pilot is independent of the number of rays that it leads to and stays part of the estimate,
//! and many a point needs nothing else. With the goal [`NoiseGoal::Each`] the cheapest number of
//! rays under the target is chosen at each point alone. With [`NoiseGoal::Mean`] the least rays in
//! all give the target as root mean square over the pose: n ∝ (gain per ray equal everywhere), the
//! optimum of Neyman for errors that fall faster than those of random rays.
//!
//! *Invariant:* a point's number of rays does not depend on rays of its own estimate (with the goal
//! `Mean` it does by one part in the number of points, through the common price of a ray).

use std::f64::consts::TAU;

use super::kernel::{Scratch, reduce};
use super::plan::Plan;
use super::posed::Stage;
use super::surroundings::NO_POINT;
use super::{Noise, NoiseGoal};
use crate::num::random::{hash, unit};
use crate::sh::MAX_COEFFICIENTS;

/// Crossings of the outline that the neighbours' pilots together may have missed: where they all
/// see the open sky, a point may still see an edge. Chosen for the least rays on three characters.
const HIDDEN: f64 = 1.0;

/// What is aimed at, of a target that is a mean: neighbours' outlines scatter, and a point that is
/// thought of too little of adds more than one that is thought of too much of saves.
const AIM: f64 = 0.92;

/// Batches that g is measured by, over caps and coefficients together.
const CAP_BATCHES: usize = 4096;

/// Tells the caps' random numbers from others.
const CAP_KEY: u64 = 0x63_6170;

/// A number of rays to choose: blocks of a plan's sets on top of the pilot, or none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Level {
    /// Index into the plans.
    pub(super) plan: usize,
    /// How many blocks of that plan's sets; 0 leaves the pilot alone.
    pub(super) blocks: usize,
    /// Rays on top of the pilot.
    pub(super) rays: usize,
    /// The weight of these rays beside the pilot's, inverse to the variances.
    pub(super) weight: f32,
    /// Variance of a coefficient for one crossing in the pilot, pilot included.
    variance: f64,
}

/// Levels to choose from, and what chooses.
#[derive(Debug)]
pub(super) struct Allocation {
    noise: Noise,
    pub(super) levels: Vec<Level>,
    /// The levels that are the cheapest for some outline, and the outline over the price of a ray
    /// from which each is.
    hull: Vec<(usize, f64)>,
    /// `neighbours[starts[p]..starts[p + 1]]` are the points that share an edge with point p.
    starts: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Allocation {
    /// Measures the plans; blocks of the last go on up to `most_rays`.
    pub(super) fn new(
        noise: Noise,
        pilot: &Plan,
        plans: &[Plan],
        most_rays: usize,
        stage: &Stage,
    ) -> Self {
        let crossings = Trial::of(pilot).crossings;
        let variance = |plan: &Plan| Trial::of(plan).variance / crossings;
        let of_pilot = variance(pilot);
        let level = |plan: usize, blocks: usize, own: f64| {
            let weight = of_pilot / (own + of_pilot);
            Level {
                plan,
                blocks,
                rays: blocks * plans[plan].directions.directions(),
                weight: weight as f32,
                variance: own * weight,
            }
        };
        let none = Level { plan: 0, blocks: 0, rays: 0, weight: 0.0, variance: of_pilot };
        let mut levels = vec![none];
        for (index, plan) in plans.iter().enumerate() {
            levels.push(level(index, plan.blocks, variance(plan)));
        }
        let last = plans.len() - 1;
        let (block, own) = (plans[last].directions.directions(), variance(&plans[last]));
        let most = (most_rays / block).max(1);
        // Blocks are independent of one another: their mean gains by the root of their number.
        let steps = (1..).flat_map(|power| [1_usize << power, 3 << (power - 1)]);
        let mut steps: Vec<usize> = steps.take_while(|&blocks| blocks < most).collect();
        steps.extend((most > 1).then_some(most));
        levels.extend(steps.into_iter().map(|n| level(last, n, own / n as f64)));
        let (starts, neighbours) = adjacency(stage);
        Self { noise, hull: hull(&levels), levels, starts, neighbours }
    }

    /// The level of each point from the crossings that its pilot met.
    pub(super) fn choose(&self, crossings: &[f32]) -> Vec<usize> {
        let lengths: Vec<f64> =
            (0..crossings.len()).map(|point| self.length(point, crossings)).collect();
        let aim = if self.noise.goal == NoiseGoal::Mean { AIM } else { 1.0 };
        let square = (aim * f64::from(self.noise.target)).powi(2);
        let mut levels: Vec<usize> = match self.noise.goal {
            NoiseGoal::Each => lengths.iter().map(|&length| self.under(length, square)).collect(),
            NoiseGoal::Mean => {
                let price = self.price(&lengths, square);
                lengths.iter().map(|&length| self.at_price(length, price)).collect()
            }
        };
        for (point, level) in levels.iter_mut().enumerate() {
            if self.is_alone(point) {
                *level = (*level).max(1);
            }
        }
        levels
    }

    /// A point without neighbours chooses by its own pilot, which then is no part of its estimate.
    pub(super) fn is_alone(&self, point: usize) -> bool {
        self.starts[point] == self.starts[point + 1]
    }

    pub(super) fn memory_bytes(&self) -> u64 {
        4 * (self.starts.len() + self.neighbours.len()) as u64
    }

    /// Mean crossings around a point.
    fn length(&self, point: usize, crossings: &[f32]) -> f64 {
        let range = self.starts[point] as usize..self.starts[point + 1] as usize;
        if range.is_empty() {
            return f64::from(crossings[point]) + HIDDEN;
        }
        let count = range.len() as f64;
        let around =
            self.neighbours[range].iter().map(|&other| f64::from(crossings[other as usize]));
        (around.sum::<f64>() + HIDDEN) / count
    }

    /// The cheapest level whose variance is at most `square`, or the dearest.
    fn under(&self, length: f64, square: f64) -> usize {
        let enough = self.levels.iter().position(|level| length * level.variance <= square);
        enough.unwrap_or(self.levels.len() - 1)
    }

    /// The level with the least sum of variance and rays at a price.
    fn at_price(&self, length: f64, price: f64) -> usize {
        let worth = self.hull.partition_point(|&(_, from)| from * price < length);
        self.hull[worth.saturating_sub(1)].0
    }

    /// The price of a ray at which the mean variance is `square`.
    fn price(&self, lengths: &[f64], square: f64) -> f64 {
        let mut sorted = lengths.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let mut sums = vec![0.0];
        for length in &sorted {
            sums.push(sums[sums.len() - 1] + length);
        }
        let mean = |price: f64| {
            let mut sum = 0.0;
            for (at, &(level, from)) in self.hull.iter().enumerate() {
                let first = |from: f64| sorted.partition_point(|&length| length <= from * price);
                let begin = if at == 0 { 0 } else { first(from) };
                let end = self.hull.get(at + 1).map_or(sorted.len(), |&(_, next)| first(next));
                sum += self.levels[level].variance * (sums[end] - sums[begin]);
            }
            sum / sorted.len().max(1) as f64
        };
        // Logarithms of prices: from nothing to what nobody pays.
        let (mut low, mut high) = (-100.0, 20.0);
        for _ in 0..60 {
            let middle = f64::midpoint(low, high);
            if mean(middle.exp()) > square { high = middle } else { low = middle }
        }
        low.exp()
    }
}

/// The lower convex hull of variance over rays: levels, and from which outline over price on.
fn hull(levels: &[Level]) -> Vec<(usize, f64)> {
    let mut hull: Vec<(usize, f64)> = vec![(0, 0.0)];
    for (index, level) in levels.iter().enumerate().skip(1) {
        loop {
            let (last, from) = hull[hull.len() - 1];
            let gain = levels[last].variance - level.variance;
            let cost = (level.rays - levels[last].rays) as f64;
            if gain <= 0.0 {
                break;
            }
            if cost / gain > from || hull.len() == 1 {
                hull.push((index, cost / gain));
                break;
            }
            hull.pop();
        }
    }
    hull
}

/// What a plan's sets make of caps of random size and place.
struct Trial {
    /// Mean number of crossings.
    crossings: f64,
    /// Mean variance of a coefficient.
    variance: f64,
}

impl Trial {
    fn of(plan: &Plan) -> Self {
        let count = plan.coefficients;
        let caps = (CAP_BATCHES / count).clamp(128, 1024);
        let mut scratch = Scratch::new(plan);
        let out = &mut [0.0; MAX_COEFFICIENTS][..count];
        let (mut crossings, mut squares) = (0.0, 0.0);
        for cap in 0..caps {
            let set = plan.directions.set(cap % plan.directions.sets());
            let number = |axis: u64| unit(hash(&[CAP_KEY, cap as u64, axis]));
            let (height, azimuth, edge) = (number(0), TAU * number(1), 1.8 * number(2) - 0.9);
            let radius = (1.0 - height * height).sqrt();
            let centre = [radius * azimuth.cos(), radius * azimuth.sin(), height];
            scratch.blocked.fill(0);
            for (lane, ((&x, &y), &z)) in set.x.iter().zip(set.y).zip(set.z).enumerate() {
                let along = centre[0] * f64::from(x) + centre[1] * f64::from(y);
                let inside = along + centre[2] * f64::from(z) > edge;
                scratch.blocked[lane / 64] |= u64::from(inside) << (lane % 64);
            }
            crossings += scratch.crossings(set.x.len());
            squares += reduce(plan, cap % plan.directions.sets(), &mut scratch, out);
        }
        let batches = caps as f64;
        let variance = squares / (count as f64 * batches * plan.blocks as f64);
        Self { crossings: crossings / batches, variance }
    }
}

/// Which points share an edge.
fn adjacency(stage: &Stage) -> (Vec<u32>, Vec<u32>) {
    let points = &stage.points;
    let mut pairs = Vec::with_capacity(stage.triangles.len() * 6);
    for triangle in &stage.triangles {
        let at = triangle.map(|corner| points.of_vertex[corner as usize]);
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (at[i], at[j])) {
            if a != b && a != NO_POINT && b != NO_POINT {
                pairs.extend([(a, b), (b, a)]);
            }
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    let mut starts = vec![0; points.vertex.len() + 1];
    pairs.iter().for_each(|&(a, _)| starts[a as usize + 1] += 1);
    for point in 1..starts.len() {
        starts[point] += starts[point - 1];
    }
    (starts, pairs.into_iter().map(|(_, b)| b).collect())
}
