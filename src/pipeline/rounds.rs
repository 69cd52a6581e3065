//! The rounds of a bake: how noisy each of them is, and what it weighs.
//!
//! A bake is a mean over rounds of rays with directions of their own, xᵢ with nᵢ rays at a point. A round to a
//! noise traces a pilot of its own, and no nᵢ at a point depends on the rays of any xᵢ there
//! ([`crate::bake`]); weights that are functions of the nᵢ are therefore fixed before what they weigh is known,
//! and the mean has no bias, however many rounds there were before and whatever they were meant for.
//!
//! Rounds of stated rays weigh their rays. A round to a noise weighs what its rays are worth,
//! w(n) = n²ᵃ with the direction sets' a = 0.7 ([`crate::bake::gain`]) up to the 2,048 rays of a set, and in
//! proportion to n beyond, for sets are independent of one another: the inverse of its planned variance, which
//! is the best there is. What N rays of all rounds before are worth is less than w(N), by the factor
//! Σ w(nᵢ) / w(Σ nᵢ) of the numbers nᵢ = σᵢ⁻¹ᐟᵃ that their noises ask for.
//!
//! Where V is the variance that the rounds so far were aimed at and τ² the one that is asked for, a round has to
//! have σ², with 1/τ² = 1/V + 1/σ². Rays that were stated were aimed at nothing, but what they leave of an
//! outline is known as well as what the round's own would: the first round to a noise after them counts them
//! in wherever it chooses ([`Baker::to_noise_beside`]), so a point that has enough of them gets no more.

use super::{Error, Job, recipe};
use crate::bake::{self, Baker, Noise, NoiseGoal};
use crate::num::random::hash;

/// Tells the seeds of rounds apart.
const ROUND_KEY: u64 = 0x0072_6f75_6e64;

/// The rays of a set, beyond which there are several.
const SET: f64 = 2048.0;

/// The error falls as rays to the power of minus this.
const RATE: f64 = 0.7;

/// What a round weighs beside those before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Weights {
    /// Its rays.
    Rays,
    /// What its rays are worth; those before this part of what they would be worth as one round.
    Worth { before: f64 },
}

impl Weights {
    /// The weight of a round of `new` rays where there are `there`, of 1 for both.
    pub(super) fn of_new(self, there: u32, new: u32) -> f64 {
        let (there, new) = (f64::from(there), f64::from(new));
        let (there, new) = match self {
            Self::Rays => (there, new),
            Self::Worth { before } => (before * worth(there), worth(new)),
        };
        new / (there + new)
    }
}

/// The inverse of what so many rays leave of variance, of that of one.
fn worth(rays: f64) -> f64 {
    let sets = (rays / SET).max(1.0);
    sets * (rays / sets).powf(2.0 * RATE)
}

/// The noises that a bake is taken to one after the other, and whose they are.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Noises {
    /// That of the first round; `None` where its rays are stated.
    pub(super) first: Option<f32>,
    /// Descending.
    pub(super) more: Vec<f32>,
    pub(super) goal: NoiseGoal,
}

impl Noises {
    /// What all rounds together are baked to.
    pub(super) fn last(&self) -> Option<Noise> {
        let target = self.more.last().copied().or(self.first)?;
        Some(Noise { target, goal: self.goal })
    }

    /// What the first round is baked to.
    pub(super) fn first(&self) -> Option<Noise> {
        self.first.map(|target| Noise { target, goal: self.goal })
    }

    /// What each further round is baked to.
    fn further(&self) -> Vec<Noise> {
        let precision = |noise: f32| f64::from(noise).powi(-2);
        // Rays that were stated are counted in where the round's own are chosen.
        let mut before = self.first.map_or(0.0, precision);
        let of = |&target: &f32| {
            let lacking = precision(target) - before;
            before = precision(target);
            Noise { target: lacking.sqrt().recip() as f32, goal: self.goal }
        };
        self.more.iter().map(of).collect()
    }

    /// What each further round weighs, after rounds of stated rays where those come first.
    fn weights(&self, stated: &[u32]) -> Vec<Weights> {
        let rays = |noise: Noise| f64::from(noise.target).powf(-1.0 / RATE);
        // Sums over the rounds before, of rays and of what they are worth. How stated rays compare with those
        // that a noise asks for is not known.
        let mut sums =
            self.first().map_or([0.0; 2], |noise| [rays(noise), rays(noise).powf(2.0 * RATE)]);
        let of = |noise: Noise| {
            let before = if sums[0] > 0.0 {
                sums[1] / sums[0].powf(2.0 * RATE)
            } else {
                worth_of_stated(stated)
            };
            sums = [sums[0] + rays(noise), sums[1] + rays(noise).powf(2.0 * RATE)];
            Weights::Worth { before }
        };
        self.further().into_iter().map(of).collect()
    }
}

/// What rounds that each weigh their rays are worth together, of what they would be worth as one.
fn worth_of_stated(rounds: &[u32]) -> f64 {
    let all: f64 = rounds.iter().copied().map(f64::from).sum();
    let variance: f64 =
        rounds.iter().map(|&rays| (f64::from(rays) / all).powi(2) / worth(f64::from(rays))).sum();
    if variance > 0.0 { 1.0 / (variance * worth(all)) } else { 1.0 }
}

/// The most rays of a further round to a noise.
pub(super) fn most_rays(bake: &recipe::BakeRecipe) -> u32 {
    let first = bake.noise.map_or(recipe::MOST_RAYS_TO_NOISE, |_| bake.rays);
    bake.most_rays.unwrap_or(first)
}

/// The rays of each round of stated ones, as they are cast.
pub(super) fn stated_rays(bake: &recipe::BakeRecipe) -> Vec<u32> {
    let first = bake.noise.is_none().then_some(bake.rays);
    first.iter().chain(&bake.more_rays).map(|&rays| bake::rays_cast(rays)).collect()
}

/// What each round of a job after the first weighs.
pub(super) fn weights(job: &Job) -> Vec<Weights> {
    let stated = job.recipe.bake.more_rays.iter().map(|_| Weights::Rays);
    stated.chain(job.checked.noises.weights(&stated_rays(&job.recipe.bake))).collect()
}

/// What bakes each round of a job.
pub(super) fn bakers(job: &Job) -> Result<Vec<Baker>, Error> {
    let (first, noises) = (job.checked.bake, &job.checked.noises);
    let mut bakers = vec![job.baker(&first, noises.first())?];
    let stated = job.recipe.bake.more_rays.iter().map(|&rays| (rays, None));
    let most = most_rays(&job.recipe.bake);
    let mut beside = stated_rays(&job.recipe.bake);
    let to_noise = noises.further().into_iter().map(|noise| (most, Some(noise)));
    for (round, (rays, noise)) in (1..).zip(stated.chain(to_noise)) {
        let settings =
            bake::Settings { rays, seed: hash(&[first.seed, ROUND_KEY, round]), ..first };
        bakers.push(match noise {
            None => job.baker(&settings, None)?,
            // The rounds after it go by what this one was taken to.
            Some(noise) => job.baker_beside(&settings, noise, &std::mem::take(&mut beside))?,
        });
    }
    Ok(bakers)
}

#[cfg(test)]
#[path = "rounds_tests.rs"]
mod tests;
