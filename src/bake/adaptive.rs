//! As many rays at each point as a stated noise takes.
//!
//! Scouts, some of the points, trace a pilot that counts how much outline there is to miss
//! ([`super::allocate`]). What that is worth in rays is traced *with fresh rays* and merged with the pilot
//! by fixed weights; then all other points trace what the scouts beside them found worth while.
//! What was spent on pilots is counted.
//!
//! *Invariant:* given the numbers of rays, the estimate is a mean of bakes of so many rays, and at no
//! point do the numbers depend on the rays of its own estimate; so it has no bias. (An estimate
//! that may stop on its own samples stops when they happen to agree.)

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::allocate::{Allocation, Earlier, Evidence, Level};
use super::kernel::{Scratch, bake_blocks, bake_point};
use super::plan::{Plan, rays_cast};
use super::posed::{Posed, Stage};
use super::{BakedPose, Error, MOST_RAYS, Noise, Settings};
use crate::num::random::hash;
use crate::sh::MAX_COEFFICIENTS;

/// Rays of the pilot.
pub(super) const PILOT_RAYS: u32 = 16;

/// The error of the direction sets falls as rays⁻⁰·⁷⁴ from 32 to 2,048 rays on a character (benchmark
/// `transport`); a little less is taken, so that the target is met. (Plain random rays: ⁻⁰·⁵.)
const RATE: f64 = 0.7;

/// Rays of the sets to choose from; above the last, several of those.
const LADDER: [u32; 15] = [8, 16, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048];

/// Tells the pilot's random numbers from the estimate's.
const PILOT_KEY: u64 = 0x0070_696c_6f74;

/// Points per task of the pilot.
const PILOT_POINTS: usize = 256;

/// Rays of the estimate per task, about.
const RAYS_PER_TASK: usize = 1 << 14;

/// By how much the noise falls with this many times the rays.
#[must_use]
pub fn gain(times: u32) -> f32 {
    f64::from(times).powf(RATE) as f32
}

/// The rays of the largest set; of more there are several, independent of one another.
const LARGEST: u32 = LADDER[LADDER.len() - 1];

/// The rays at a point beyond which no noise takes a bake of so many at most, its pilot not counted.
///
/// ```
/// # use poselight::bake::most_to_noise;
/// assert_eq!([4, 2000, 16_384, 20_000].map(most_to_noise), [4, 1536, 16_384, 18_432]);
/// ```
#[must_use]
pub fn most_to_noise(rays: u32) -> u32 {
    let set = LADDER.into_iter().rev().find(|&set| set <= rays).unwrap_or(rays_cast(rays).max(1));
    (rays.min(MOST_RAYS) / set).max(1) * set
}

/// What every point has had before a bake to a noise.
pub(super) struct Before<'a> {
    /// Rounds of so many rays, weighed by them.
    pub(super) rounds: &'a [u32],
    /// Whether points that have enough must have rays of this bake too.
    pub(super) everywhere: bool,
}

/// Plans to choose from, and what chooses.
#[derive(Debug)]
pub(super) struct Adaptive {
    pilot: Plan,
    plans: Vec<Plan>,
    allocation: Allocation,
}

/// Points that one task bakes: the first, and their outputs, which hold the pilots'.
struct Task<'a> {
    first: usize,
    coefficients: &'a mut [f32],
    noise: &'a mut [f32],
    evidence: &'a mut [Evidence],
}

/// A pose at work, and what is known of its outlines.
struct State {
    baked: BakedPose,
    evidence: Vec<Evidence>,
    price: Option<f64>,
}

impl Adaptive {
    /// Tables for every number of rays up to `settings.rays`.
    pub(super) fn new(
        noise: Noise,
        settings: &Settings,
        falloff: Option<f32>,
        stage: &Stage,
        before: &Before<'_>,
    ) -> Result<Self, Error> {
        if !(noise.target.is_finite() && noise.target > 0.0) {
            return Err(Error::Noise { found: noise.target });
        }
        let of = |rays: u32, seed: u64| {
            let plan = Plan::new(&Settings { rays, seed, ..*settings })?;
            Ok(Plan { falloff, ..plan })
        };
        let pilot = of(PILOT_RAYS, hash(&[settings.seed, PILOT_KEY]))?;
        let ladder = LADDER.iter().copied().filter(|&rays| rays <= settings.rays);
        let mut plans: Vec<Plan> =
            ladder.map(|rays| of(rays, settings.seed)).collect::<Result<_, _>>()?;
        if plans.is_empty() {
            plans.push(of(settings.rays, settings.seed)?);
        }
        let set = |&rays: &u32| -> Result<(u32, Plan), Error> {
            Ok((rays, of(rays.clamp(1, LARGEST), settings.seed)?))
        };
        let rounds = before.rounds.iter().map(set).collect::<Result<Vec<_>, _>>()?;
        let most = settings.rays.min(MOST_RAYS) as usize;
        let earlier = Earlier { rounds: &rounds, everywhere: before.everywhere };
        let allocation = Allocation::new(noise, &pilot, (&plans, most), stage, &earlier);
        Ok(Self { pilot, plans, allocation })
    }

    /// Bakes a pose.
    pub(super) fn bake(&self, posed: &Posed, cancelled: &AtomicBool) -> Result<BakedPose, Error> {
        self.bake_levels(posed, cancelled).map(|(pose, _)| pose)
    }

    /// The same with the level of every point.
    pub(super) fn bake_levels(
        &self,
        posed: &Posed,
        cancelled: &AtomicBool,
    ) -> Result<(BakedPose, Vec<Level>), Error> {
        let mut state = self.explore(posed, cancelled)?;
        let mut all = self.levels(&state, true);
        self.follow(posed, &all, &mut state, cancelled)?;
        let others = self.levels(&state, false);
        self.follow(posed, &others, &mut state, cancelled)?;
        for (point, other) in others.into_iter().enumerate() {
            if !self.allocation.is_scout(point) {
                all[point] = other;
            }
        }
        Ok((state.baked, all))
    }

    /// The plan of a level's rays, its number, and how many blocks of it; the pilot's, number 0, where
    /// there are no others.
    pub(super) fn plan_of(&self, level: &Level) -> (usize, &Plan, usize) {
        match level.blocks {
            0 => (0, &self.pilot, self.pilot.blocks),
            blocks => (1 + level.plan, &self.plans[level.plan], blocks),
        }
    }

    /// The level of every scout, or of every other point; nothing for the rest.
    fn levels(&self, state: &State, scouts: bool) -> Vec<Level> {
        let of = |point: usize| {
            if self.allocation.is_scout(point) == scouts {
                self.allocation.choose(point, state.price, &state.evidence)
            } else {
                Level::NONE
            }
        };
        (0..state.evidence.len()).map(of).collect()
    }

    /// The pilot of every scout.
    fn explore(&self, posed: &Posed, cancelled: &AtomicBool) -> Result<State, Error> {
        let (points, count) = (posed.normals.len(), self.pilot.coefficients);
        let (mut coefficients, mut noise) = (vec![0.0; points * count], vec![0.0; points]);
        let mut evidence = vec![Evidence::default(); points];
        let outputs = coefficients.par_chunks_mut(PILOT_POINTS * count);
        let outputs = outputs.zip(noise.par_chunks_mut(PILOT_POINTS));
        outputs.zip(evidence.par_chunks_mut(PILOT_POINTS)).enumerate().try_for_each_init(
            || Scratch::new(&self.pilot),
            |scratch, (task, ((out, noise), evidence))| {
                check(cancelled)?;
                let outputs = out.chunks_exact_mut(count).zip(noise).zip(evidence);
                for (point, ((out, noise), evidence)) in (task * PILOT_POINTS..).zip(outputs) {
                    if self.allocation.is_scout(point) {
                        *noise = bake_point(&self.pilot, posed, point, scratch, None, out);
                        *evidence = Evidence { crossings: f64::from(scratch.crossed), units: 1.0 };
                    }
                }
                Ok(())
            },
        )?;
        let pilot = |point| {
            if self.allocation.is_scout(point) { self.pilot.rays() as u32 } else { 0 }
        };
        let baked = BakedPose { coefficients, noise, rays: (0..points).map(pilot).collect() };
        let price = self.allocation.price(&evidence);
        Ok(State { baked, evidence, price })
    }

    /// Traces what the levels say.
    fn follow(
        &self,
        posed: &Posed,
        levels: &[Level],
        State { baked, evidence, .. }: &mut State,
        cancelled: &AtomicBool,
    ) -> Result<(), Error> {
        baked.rays.iter_mut().zip(levels).for_each(|(rays, level)| *rays += level.rays as u32);
        let tasks = self.tasks(levels, &mut baked.coefficients, &mut baked.noise, evidence);
        tasks.into_par_iter().with_max_len(1).try_for_each_init(
            || self.plans.iter().map(|_| None).collect::<Vec<Option<Scratch>>>(),
            |scratches, task| {
                check(cancelled)?;
                let outputs = task.coefficients.chunks_exact_mut(self.pilot.coefficients);
                let outputs = outputs.zip(task.noise).zip(task.evidence);
                for (point, ((out, noise), evidence)) in (task.first..).zip(outputs) {
                    let level = &levels[point];
                    if level.blocks > 0 {
                        let plan = &self.plans[level.plan];
                        let scratch =
                            scratches[level.plan].get_or_insert_with(|| Scratch::new(plan));
                        self.refine(posed, (point, level), scratch, out, noise);
                        evidence.add(scratch.crossed, level);
                    }
                }
                Ok(())
            },
        )
    }

    /// Merges the rays of a level into what a point has.
    fn refine(
        &self,
        posed: &Posed,
        (point, level): (usize, &Level),
        scratch: &mut Scratch,
        out: &mut [f32],
        noise: &mut f32,
    ) {
        let fresh = &mut [0.0; MAX_COEFFICIENTS][..out.len()];
        let plan = &self.plans[level.plan];
        let found = bake_blocks(plan, posed, (point, level.blocks), scratch, None, fresh);
        let weight = level.weight;
        for (out, fresh) in out.iter_mut().zip(fresh) {
            *out = (1.0 - weight) * *out + weight * *fresh;
        }
        *noise = f32::hypot(weight * found, (1.0 - weight) * *noise);
    }

    /// The mean number of rays over the points of a pose, from its pilots alone.
    pub(super) fn rays_per_point(&self, posed: &Posed) -> Result<f64, Error> {
        let state = self.explore(posed, &AtomicBool::new(false))?;
        let pilots = state.baked.rays.iter().map(|&rays| f64::from(rays)).sum::<f64>();
        let levels = [true, false].map(|scouts| self.levels(&state, scouts));
        let rays = levels.iter().flatten().map(|level| level.rays as f64).sum::<f64>();
        Ok((pilots + rays) / state.evidence.len().max(1) as f64)
    }

    pub(super) fn memory_bytes(&self) -> u64 {
        let plans = self.plans.iter().map(Plan::memory_bytes).sum::<u64>();
        plans + self.pilot.memory_bytes() + self.allocation.memory_bytes()
    }

    /// Runs of points of about equal work.
    fn tasks<'a>(
        &self,
        levels: &[Level],
        mut coefficients: &'a mut [f32],
        mut noise: &'a mut [f32],
        mut evidence: &'a mut [Evidence],
    ) -> Vec<Task<'a>> {
        let (mut tasks, mut first) = (Vec::new(), 0);
        while first < levels.len() {
            let mut rays = 0;
            let more = levels[first..].iter().take_while(|level| {
                let fits = rays < RAYS_PER_TASK;
                rays += level.rays + 1;
                fits
            });
            let points = more.count();
            let (own, later) = coefficients.split_at_mut(points * self.pilot.coefficients);
            let (own_noise, later_noise) = noise.split_at_mut(points);
            let (own_evidence, later_evidence) = evidence.split_at_mut(points);
            tasks.push(Task { first, coefficients: own, noise: own_noise, evidence: own_evidence });
            (coefficients, noise, evidence) = (later, later_noise, later_evidence);
            first += points;
        }
        tasks
    }
}

fn check(cancelled: &AtomicBool) -> Result<(), Error> {
    if cancelled.load(Ordering::Relaxed) { Err(Error::Cancelled) } else { Ok(()) }
}
