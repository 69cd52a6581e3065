//! As many rays at each point as a stated noise takes.
//!
//! A pilot of few rays at every point counts how much outline there is to miss ([`super::allocate`]);
//! what that is worth in rays is traced *with fresh rays* and merged with the pilot by fixed weights.
//! What was spent on the pilot is counted.
//!
//! *Invariant:* given the numbers of rays, the estimate is a mean of bakes of so many rays, and at no
//! point do the numbers depend on the rays of its own estimate; so it has no bias. (An estimate
//! that may stop on its own samples stops when they happen to agree.)

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::allocate::{Allocation, Level};
use super::kernel::{Scratch, bake_blocks, bake_point};
use super::plan::Plan;
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
const LADDER: [u32; 14] = [16, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048];

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

/// Plans to choose from, and what chooses.
#[derive(Debug)]
pub(super) struct Adaptive {
    pilot: Plan,
    plans: Vec<Plan>,
    allocation: Allocation,
}

/// Points that one task bakes: the first, and their outputs, which hold the pilot's.
type Task<'a> = (usize, &'a mut [f32], &'a mut [f32]);

impl Adaptive {
    /// Tables for every number of rays up to `settings.rays`.
    pub(super) fn new(
        noise: Noise,
        settings: &Settings,
        falloff: Option<f32>,
        stage: &Stage,
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
        let most = settings.rays.min(MOST_RAYS) as usize;
        let allocation = Allocation::new(noise, &pilot, &plans, most, stage);
        Ok(Self { pilot, plans, allocation })
    }

    /// Bakes a pose.
    pub(super) fn bake(&self, posed: &Posed, cancelled: &AtomicBool) -> Result<BakedPose, Error> {
        let (mut baked, levels) = self.explore(posed, cancelled)?;
        let count = self.pilot.coefficients;
        let tasks = self.tasks(&levels, &mut baked.coefficients, &mut baked.noise);
        tasks.into_par_iter().with_max_len(1).try_for_each_init(
            || self.plans.iter().map(|_| None).collect::<Vec<Option<Scratch>>>(),
            |scratches, (first, coefficients, noise)| {
                check(cancelled)?;
                let outputs = coefficients.chunks_exact_mut(count).zip(noise);
                for ((level, point), (out, noise)) in
                    levels[first..].iter().zip(first..).zip(outputs)
                {
                    if level.blocks > 0 {
                        let plan = &self.plans[level.plan];
                        let scratch =
                            scratches[level.plan].get_or_insert_with(|| Scratch::new(plan));
                        self.refine(posed, (point, level), scratch, out, noise);
                    }
                }
                Ok(())
            },
        )?;
        Ok(baked)
    }

    /// The pilot at every point, and the level that each is worth; its rays are counted already.
    fn explore(
        &self,
        posed: &Posed,
        cancelled: &AtomicBool,
    ) -> Result<(BakedPose, Vec<Level>), Error> {
        let (points, count) = (posed.normals.len(), self.pilot.coefficients);
        let (mut coefficients, mut noise) = (vec![0.0; points * count], vec![0.0; points]);
        let mut crossings = vec![0.0; points];
        let outputs = coefficients.par_chunks_mut(PILOT_POINTS * count);
        let outputs = outputs.zip(noise.par_chunks_mut(PILOT_POINTS));
        outputs.zip(crossings.par_chunks_mut(PILOT_POINTS)).enumerate().try_for_each_init(
            || Scratch::new(&self.pilot),
            |scratch, (task, ((out, noise), crossings))| {
                check(cancelled)?;
                let outputs = out.chunks_exact_mut(count).zip(noise).zip(crossings);
                for (point, ((out, noise), crossings)) in (task * PILOT_POINTS..).zip(outputs) {
                    *noise = bake_point(&self.pilot, posed, point, scratch, None, out);
                    *crossings = scratch.crossed;
                }
                Ok(())
            },
        )?;
        let levels = self.allocation.choose(&crossings);
        let levels: Vec<Level> = levels.into_iter().map(|l| self.allocation.levels[l]).collect();
        let pilot = self.pilot.rays();
        let rays = levels.iter().map(|level| (pilot + level.rays) as u32).collect();
        Ok((BakedPose { coefficients, noise, rays }, levels))
    }

    /// Merges the rays of a level into a point's pilot.
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
        let weight = if self.allocation.is_alone(point) { 1.0 } else { level.weight };
        for (out, fresh) in out.iter_mut().zip(fresh) {
            *out += weight * (*fresh - *out);
        }
        *noise = f32::hypot(weight * found, (1.0 - weight) * *noise);
    }

    /// The mean number of rays over the points of a pose, from its pilot alone.
    pub(super) fn rays_per_point(&self, posed: &Posed) -> Result<f64, Error> {
        let (baked, _) = self.explore(posed, &AtomicBool::new(false))?;
        let rays = baked.rays.iter().map(|&rays| f64::from(rays)).sum::<f64>();
        Ok(rays / baked.rays.len().max(1) as f64)
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
            tasks.push((first, own, own_noise));
            (coefficients, noise) = (later, later_noise);
            first += points;
        }
        tasks
    }
}

fn check(cancelled: &AtomicBool) -> Result<(), Error> {
    if cancelled.load(Ordering::Relaxed) { Err(Error::Cancelled) } else { Ok(()) }
}
