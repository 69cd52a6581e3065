//! How many rays a point is worth.
//!
//! The error of an evenly spread set of directions comes from where the blocked region ends: a ray
//! that stands for a cell all blocked or all open errs nothing. So the variance of n rays is
//! g(n) · ℓ, with ℓ the length of the region's outline and g falling as about n⁻¹·⁵. Along the curve
//! that orders the rays, the outline is crossed where consecutive rays differ, so ℓ is counted, not
//! estimated from a difference of two batches, which for a single number would scatter by its own size.
//! g is measured on the direction sets themselves, with caps of random size and place as blockers.
//! What is smaller than a ray's cell is an exception: a pilot rarely meets it, its few crossings then
//! stand for a longer outline, and until cells resolve it, its variance falls as rays⁻¹ alone. So with the
//! goal [`NoiseGoal::Each`] the variance behind a count is that of single caps which are met so often.
//!
//! ℓ is counted at other points than the one whose number of rays it decides. *Scouts* are points of
//! which no two are neighbours and of which every other point has one beside it, a quarter to a third of
//! a mesh. They trace a pilot, choose by the pilots of the scouts two edges away, and go on; all other
//! points choose by everything that the scouts up to two edges away traced, and need no pilot. So a scout's pilot
//! is independent of the number of rays that it leads to and stays part of its estimate.
//! With the goal [`NoiseGoal::Each`] the cheapest number of
//! rays under the target is chosen at each point alone. With [`NoiseGoal::Mean`] the least rays in
//! all give the target as root mean square over the pose: n ∝ (gain per ray equal everywhere), the
//! optimum of Neyman for errors that fall faster than those of random rays.
//!
//! On top of earlier rounds of stated rays, of variance V by the same g and ℓ, a level leaves 1/(1/V + 1/v);
//! everything else stays as it is, with the level of no rays at all before the cheapest.
//!
//! *Invariant:* a point's number of rays does not depend on rays of its own estimate (with the goal
//! `Mean` it does by one part in the number of scouts, through the common price of a ray).

use super::plan::Plan;
use super::posed::Stage;
use super::surroundings::NO_POINT;
use super::trial::{SIZES, SMALL, Trial};
use super::{Noise, NoiseGoal};

/// Crossings of the outline that the scouts around a point may have missed, all together: where they
/// all see the open sky, the point may still see an edge. Chosen for the least rays on three characters.
const HIDDEN: f64 = 0.5;

/// What is aimed at, of a target that is a mean: neighbours' outlines scatter, and a point that is
/// thought of too little of adds more than one that is thought of too much of saves.
const AIM: f64 = 0.88;

/// A number of rays to choose: blocks of a plan's sets, on top of a scout's pilot or alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Level {
    /// Index into the plans.
    pub(super) plan: usize,
    /// How many blocks of that plan's sets; 0 leaves the pilot alone.
    pub(super) blocks: usize,
    /// Rays of the blocks.
    pub(super) rays: usize,
    /// The weight of these rays beside the pilot's, inverse to the variances; 1 where there is none.
    pub(super) weight: f32,
    /// How many crossings they meet where a pilot meets one.
    units: f64,
    /// Variance of a coefficient for one crossing in a pilot, that pilot included.
    variance: f64,
    /// The same for small blockers, ascending, and last for large ones: all that they make.
    of_sizes: [f64; SIZES],
}

impl Level {
    /// No rays at all.
    pub(super) const NONE: Self = Self {
        plan: 0,
        blocks: 0,
        rays: 0,
        weight: 0.0,
        units: 0.0,
        variance: 0.0,
        of_sizes: [0.0; SIZES],
    };
}

/// Levels from the cheapest to the dearest.
#[derive(Debug)]
struct Levels {
    all: Vec<Level>,
    /// Crossings that a pilot meets of the small blockers, and of the large ones.
    sizes: [f64; SIZES],
    /// Those that are the cheapest for some outline, and the outline over the price of a ray
    /// from which each is.
    hull: Vec<(usize, f64)>,
}

/// What rays at a scout say of its outline.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Evidence {
    pub(super) crossings: f64,
    /// In pilots.
    pub(super) units: f64,
}

impl Evidence {
    /// With what the rays of a level met.
    pub(super) fn add(&mut self, crossings: f32, level: &Level) {
        self.crossings += f64::from(crossings);
        self.units += level.units;
    }
}

/// Rounds that every point has had, each with a plan of its rays or, where those are several sets, of one.
pub(super) struct Earlier<'a> {
    pub(super) rounds: &'a [(u32, Plan)],
    /// Whether points that have enough must have more.
    pub(super) everywhere: bool,
}

impl Earlier<'_> {
    /// What the rounds leave together, weighed by their rays, for one crossing in a pilot; `None` where
    /// there are none.
    fn left(&self, trials: &[Trial], crossings: f64) -> Option<Level> {
        let all: f64 = self.rounds.iter().map(|(rays, _)| f64::from(*rays)).sum();
        let mut left = Level::NONE;
        for ((rays, plan), trial) in self.rounds.iter().zip(trials) {
            let rays = f64::from(*rays);
            let sets = (rays / plan.rays() as f64).max(1.0);
            let weight = (rays / all).powi(2) / sets;
            left.variance += weight * trial.variance / crossings;
            left.of_sizes.iter_mut().zip(trial.of_sizes).for_each(|(sum, of)| *sum += weight * of);
        }
        (!self.rounds.is_empty()).then_some(left)
    }
}

impl Level {
    /// The same with what earlier rounds have left, each weighed by the inverse of its variance.
    fn beside(self, earlier: &Self) -> Self {
        let both =
            |a: f64, b: f64| if a > 0.0 && b > 0.0 { 1.0 / (1.0 / a + 1.0 / b) } else { 0.0 };
        let of_sizes =
            std::array::from_fn(|size| both(self.of_sizes[size], earlier.of_sizes[size]));
        Self { variance: both(self.variance, earlier.variance), of_sizes, ..self }
    }
}

/// Levels to choose from, and what chooses.
#[derive(Debug)]
pub(super) struct Allocation {
    noise: Noise,
    /// On top of a pilot.
    scouts: Levels,
    /// Where there is none.
    others: Levels,
    is_scout: Vec<bool>,
    /// `near[starts[p]..starts[p + 1]]` are the scouts that point p goes by, itself not among them.
    starts: Vec<u32>,
    near: Vec<u32>,
}

impl Allocation {
    /// Measures the plans; blocks of the last go on up to `most_rays`.
    pub(super) fn new(
        noise: Noise,
        pilot: &Plan,
        (plans, most_rays): (&[Plan], usize),
        stage: &Stage,
        earlier: &Earlier<'_>,
    ) -> Self {
        let all: Vec<&Plan> =
            plans.iter().chain(earlier.rounds.iter().map(|(_, plan)| plan)).collect();
        let (of_pilot, trials) = Trial::of_all(pilot, &all);
        let level = |plan: usize, blocks: usize, with: bool| {
            let (blocks_f, trial) = (blocks as f64, &trials[plan]);
            // Blocks are independent of one another: their mean gains by the root of their number.
            let own = trial.variance * plans[plan].blocks as f64 / blocks_f / of_pilot.crossings;
            let pilot = of_pilot.variance / of_pilot.crossings;
            let weight = if with { pilot / (own + pilot) } else { 1.0 };
            let of_size = |size: usize| {
                let own = trial.of_sizes[size] * plans[plan].blocks as f64 / blocks_f;
                weight * weight * own + (1.0 - weight).powi(2) * of_pilot.of_sizes[size]
            };
            Level {
                plan,
                blocks,
                rays: blocks * plans[plan].directions.directions(),
                weight: weight as f32,
                units: trial.crossings * blocks_f / of_pilot.crossings,
                variance: own * weight,
                of_sizes: std::array::from_fn(of_size),
            }
        };
        let last = plans.len() - 1;
        let most = (most_rays / plans[last].directions.directions()).max(1);
        let steps = (1..).flat_map(|power| [1_usize << power, 3 << (power - 1)]);
        let mut steps: Vec<usize> = steps.take_while(|&blocks| blocks < most).collect();
        steps.extend((most > 1).then_some(most));
        let table = |with: bool| {
            let sets = plans.iter().enumerate().map(|(plan, of)| level(plan, of.blocks, with));
            sets.chain(steps.iter().map(|&blocks| level(last, blocks, with))).collect::<Vec<_>>()
        };
        let mut scouts = table(true);
        let variance = of_pilot.variance / of_pilot.crossings;
        scouts.insert(0, Level { variance, of_sizes: of_pilot.of_sizes, ..Level::NONE });
        let mut others = table(false);
        if let Some(left) = earlier.left(&trials[plans.len()..], of_pilot.crossings) {
            let beside = |levels: &mut Vec<Level>| {
                levels.iter_mut().for_each(|level| *level = level.beside(&left));
            };
            beside(&mut scouts);
            beside(&mut others);
            if !earlier.everywhere {
                others.insert(0, left);
            }
        }
        let (is_scout, starts, near) = scouting(stage);
        let mut sizes = SMALL.map(|share| 2.0 * share * pilot.rays() as f64).to_vec();
        sizes.push(of_pilot.crossings);
        let sizes: [f64; SIZES] = std::array::from_fn(|size| sizes[size]);
        let of = |all: Vec<Level>| Levels { hull: hull(&all), all, sizes };
        let (scouts, others) = (of(scouts), of(others));
        Self { noise, scouts, others, is_scout, starts, near }
    }

    /// Whether a point traces a pilot.
    pub(super) fn is_scout(&self, point: usize) -> bool {
        self.is_scout[point]
    }

    /// The price of a ray, from the pilots of the scouts; nothing where each point has its own target.
    pub(super) fn price(&self, evidence: &[Evidence]) -> Option<f64> {
        if self.noise.goal == NoiseGoal::Each {
            return None;
        }
        let square = (AIM * f64::from(self.noise.target)).powi(2);
        let scouts = (0..evidence.len()).filter(|&point| self.is_scout[point]);
        let mut lengths: Vec<f64> = scouts.map(|point| self.length(point, evidence)).collect();
        lengths.sort_unstable_by(f64::total_cmp);
        let share = lengths.len() as f64 / evidence.len().max(1) as f64;
        let mean = |price: f64| {
            let [scouts, others] =
                [&self.scouts, &self.others].map(|levels| levels.mean(&lengths, price));
            share * scouts + (1.0 - share) * others
        };
        // Logarithms of prices: from nothing to what nobody pays.
        let (mut low, mut high) = (-100.0, 20.0);
        for _ in 0..60 {
            let middle = f64::midpoint(low, high);
            if mean(middle.exp()) > square { high = middle } else { low = middle }
        }
        Some(low.exp())
    }

    /// The level of a point by what is known of the scouts that it goes by.
    pub(super) fn choose(&self, point: usize, price: Option<f64>, evidence: &[Evidence]) -> Level {
        let levels = if self.merges(point) { &self.scouts } else { &self.others };
        let length = self.length(point, evidence);
        let chosen = match price {
            Some(price) => levels.at_price(length, price),
            None => levels.under(length, f64::from(self.noise.target).powi(2)),
        };
        // A scout that goes by its own pilot must not keep it as its estimate.
        let least =
            usize::from(self.is_scout[point] && levels.all[0].blocks == 0 && !self.merges(point));
        levels.all[chosen.max(least)]
    }

    pub(super) fn memory_bytes(&self) -> u64 {
        (4 * (self.starts.len() + self.near.len()) + self.is_scout.len()) as u64
    }

    /// Whether a point's pilot becomes part of its estimate: that of a scout that goes by others.
    fn merges(&self, point: usize) -> bool {
        self.is_scout[point] && !self.near_of(point).is_empty()
    }

    fn near_of(&self, point: usize) -> &[u32] {
        &self.near[self.starts[point] as usize..self.starts[point + 1] as usize]
    }

    /// Crossings that a pilot would meet. A scout without others goes by its own pilot, which then is
    /// no part of its estimate.
    fn length(&self, point: usize, evidence: &[Evidence]) -> f64 {
        let near = self.near_of(point);
        let sum = near.iter().fold(Evidence::default(), |sum, &other| {
            let Evidence { crossings, units } = evidence[other as usize];
            Evidence { crossings: sum.crossings + crossings, units: sum.units + units }
        });
        let Evidence { crossings, units } = if near.is_empty() { evidence[point] } else { sum };
        (crossings + HIDDEN) / units.max(1.0)
    }
}

impl Levels {
    /// The cheapest whose variance is at most `square`, or the dearest.
    fn under(&self, length: f64, square: f64) -> usize {
        let enough = self.all.iter().position(|level| self.variance(level, length) <= square);
        enough.unwrap_or(self.all.len() - 1)
    }

    /// What a level makes of an outline, by the blockers that show so much of theirs to a pilot: straight
    /// lines between logarithms, and as the outline below and above.
    fn variance(&self, level: &Level, length: f64) -> f64 {
        let (sizes, of) = (&self.sizes, &level.of_sizes);
        let above = sizes.partition_point(|&size| size <= length);
        if above == 0 {
            return of[0] * length / sizes[0];
        }
        if above == SIZES || of[above - 1] <= 0.0 || of[above] <= 0.0 {
            return of[above - 1] * length / sizes[above - 1];
        }
        let along = (length / sizes[above - 1]).ln() / (sizes[above] / sizes[above - 1]).ln();
        of[above - 1] * (of[above] / of[above - 1]).powf(along)
    }

    /// The one with the least sum of variance and rays at a price.
    fn at_price(&self, length: f64, price: f64) -> usize {
        let worth = self.hull.partition_point(|&(_, from)| from * price < length);
        self.hull[worth.saturating_sub(1)].0
    }

    /// The mean variance over ascending lengths at a price.
    fn mean(&self, lengths: &[f64], price: f64) -> f64 {
        let of = |&length: &f64| length * self.all[self.at_price(length, price)].variance;
        lengths.iter().map(of).sum::<f64>() / lengths.len().max(1) as f64
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

/// Which points are scouts, and by which of them each point goes: those up to two edges away.
fn scouting(stage: &Stage) -> (Vec<bool>, Vec<u32>, Vec<u32>) {
    let (edges, beside) = adjacency(stage);
    let points = edges.len() - 1;
    let around = |point: usize| &beside[edges[point] as usize..edges[point + 1] as usize];
    let mut is_scout = vec![false; points];
    for point in 0..points {
        is_scout[point] = !around(point).iter().any(|&other| is_scout[other as usize]);
    }
    let (mut starts, mut near) = (vec![0], Vec::new());
    let mut own = Vec::new();
    for point in 0..points {
        own.clear();
        own.extend(around(point));
        own.extend(around(point).iter().flat_map(|&other| around(other as usize)));
        own.retain(|&other| is_scout[other as usize] && other as usize != point);
        own.sort_unstable();
        own.dedup();
        near.extend_from_slice(&own);
        starts.push(near.len() as u32);
    }
    (is_scout, starts, near)
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
