//! As many rays at each point as a stated noise takes.
//!
//! A pilot of few rays at every point estimates each point's noise; its squares are averaged over
//! the neighbours along the edges of the mesh, since a single point's estimate scatters by tens of
//! per cent. From there the noise at other numbers of rays follows the rate of the direction sets,
//! and the cheapest number under the target is traced *with fresh rays*. The pilot is no part of
//! the estimate: an estimate that may stop on its own samples stops when they happen to agree, and
//! so is biased. What was spent on the pilot is counted.
//!
//! *Invariant:* given the numbers of rays, the estimate is that of a bake of so many rays, and the
//! numbers do not depend on its rays; so it has no bias.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::kernel::{Scratch, bake_blocks, bake_point};
use super::plan::Plan;
use super::posed::{Posed, Stage};
use super::surroundings::NO_POINT;
use super::{BakedPose, Error, MOST_RAYS, Settings};
use crate::num::random::hash;
use crate::sh::MAX_COEFFICIENTS;

/// Rays of the pilot.
pub(super) const PILOT_RAYS: u32 = 48;

/// The error of the direction sets falls as rays⁻⁰·⁷⁴ from 32 to 2,048 rays on a character (benchmark
/// `transport`); a little less is taken, so that the target is met. (Plain random rays: ⁻⁰·⁵.)
const RATE: f64 = 0.7;

/// Rays of the sets to choose from; above the last, several of those.
const LADDER: [u32; 13] = [32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048];

/// Tells the pilot's random numbers from the estimate's.
const PILOT_KEY: u64 = 0x0070_696c_6f74;

/// By how much the noise falls with this many times the rays.
#[must_use]
pub fn gain(times: u32) -> f32 {
    f64::from(times).powf(RATE) as f32
}

/// Plans to choose from, and what chooses.
#[derive(Debug)]
pub(super) struct Adaptive {
    target: f64,
    most_rays: u32,
    pub(super) pilot: Plan,
    pub(super) plans: Vec<Plan>,
    /// `neighbours[starts[p]..starts[p + 1]]` are the points that share an edge with point p.
    starts: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Adaptive {
    /// Tables for every number of rays up to `settings.rays`.
    pub(super) fn new(
        target: f32,
        settings: &Settings,
        falloff: Option<f32>,
        stage: &Stage,
    ) -> Result<Self, Error> {
        if !(target.is_finite() && target > 0.0) {
            return Err(Error::Noise { found: target });
        }
        let of = |rays: u32| {
            let plan = Plan::new(&Settings { rays, ..*settings })?;
            Ok(Plan { falloff, ..plan })
        };
        let seed = hash(&[settings.seed, PILOT_KEY]);
        let pilot = Plan::new(&Settings { rays: PILOT_RAYS, seed, ..*settings })?;
        let pilot = Plan { falloff, ..pilot };
        let ladder = LADDER.iter().copied().filter(|&rays| rays <= settings.rays);
        let mut plans: Vec<Plan> = ladder.map(of).collect::<Result<_, _>>()?;
        if plans.is_empty() {
            plans.push(of(settings.rays)?);
        }
        let (starts, neighbours) = adjacency(stage);
        let target = f64::from(target);
        let most_rays = settings.rays.min(MOST_RAYS);
        Ok(Self { target, most_rays, pilot, plans, starts, neighbours })
    }

    /// The plan of each point and how many blocks of it, from the pilot's noise.
    pub(super) fn choose(&self, noise: &[f32]) -> Vec<Choice> {
        (0..noise.len()).map(|point| self.choice(self.pooled(point, noise))).collect()
    }

    /// The cheapest choice under the target for a pilot's noise.
    pub(super) fn choice(&self, pilot_noise: f64) -> Choice {
        let pilot_rays = self.pilot.rays() as f64;
        let predicted = |rays: usize| pilot_noise * (pilot_rays / rays as f64).powf(RATE);
        let enough = self.plans.iter().position(|plan| predicted(plan.rays()) <= self.target);
        let last = self.plans.len() - 1;
        if let Some(plan) = enough {
            return Choice { plan, blocks: self.plans[plan].blocks };
        }
        // Blocks are independent of one another: their mean gains by the root of their number.
        let rays = self.plans[last].rays();
        let blocks = (predicted(rays) / self.target).powi(2).ceil() as usize;
        Choice { plan: last, blocks: blocks.clamp(1, (self.most_rays as usize / rays).max(1)) }
    }

    /// The root of the mean square over a point and its neighbours.
    fn pooled(&self, point: usize, noise: &[f32]) -> f64 {
        let range = self.starts[point] as usize..self.starts[point + 1] as usize;
        let around = self.neighbours[range].iter().map(|&other| noise[other as usize]);
        let (mut sum, mut count) = (0.0, 0.0);
        for value in around.chain([noise[point]]) {
            sum += f64::from(value).powi(2);
            count += 1.0;
        }
        f64::sqrt(sum / count)
    }

    pub(super) fn memory_bytes(&self) -> u64 {
        let lists = 4 * (self.starts.len() + self.neighbours.len()) as u64;
        self.plans.iter().map(Plan::memory_bytes).sum::<u64>() + self.pilot.memory_bytes() + lists
    }
}

/// What one point gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Choice {
    /// Index into the plans.
    pub(super) plan: usize,
    /// How many blocks of that plan's sets.
    pub(super) blocks: usize,
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

/// Points per task of the pilot.
const PILOT_POINTS: usize = 256;

/// Rays of the estimate per task, about.
const RAYS_PER_TASK: usize = 1 << 14;

impl Adaptive {
    /// Bakes a pose.
    pub(super) fn bake(&self, posed: &Posed, cancelled: &AtomicBool) -> Result<BakedPose, Error> {
        let (points, count) = (posed.normals.len(), self.pilot.coefficients);
        let mut noise = vec![0.0; points];
        let tasks = noise.par_chunks_mut(PILOT_POINTS).enumerate();
        tasks.try_for_each_init(
            || (Scratch::new(&self.pilot), vec![0.0; count]),
            |(scratch, out), (task, noise)| {
                check(cancelled)?;
                for (point, noise) in (task * PILOT_POINTS..).zip(noise) {
                    *noise = bake_point(&self.pilot, posed, point, scratch, None, out);
                }
                Ok(())
            },
        )?;
        let choices = self.choose(&noise);
        let mut coefficients = vec![0.0; points * count];
        let tasks = self.tasks(&choices, &mut coefficients, &mut noise);
        tasks.into_par_iter().with_max_len(1).try_for_each_init(
            || self.plans.iter().map(|_| None).collect::<Vec<Option<Scratch>>>(),
            |scratches, (first, coefficients, noise)| {
                check(cancelled)?;
                let outputs = coefficients.chunks_exact_mut(count).zip(noise);
                for ((choice, point), (out, noise)) in
                    choices[first..].iter().zip(first..).zip(outputs)
                {
                    let plan = &self.plans[choice.plan];
                    let scratch = scratches[choice.plan].get_or_insert_with(|| Scratch::new(plan));
                    *noise = bake_blocks(plan, posed, (point, choice.blocks), scratch, None, out);
                }
                Ok(())
            },
        )?;
        let spent = |choice: &Choice| (self.pilot.rays() + self.rays(*choice)) as u32;
        Ok(BakedPose { coefficients, noise, rays: choices.iter().map(spent).collect() })
    }

    /// The mean number of rays over points spread evenly over a pose, from their pilot alone.
    pub(super) fn rays_per_point(&self, posed: &Posed, points: usize) -> f64 {
        let all = posed.normals.len();
        let step = (all / points).max(1);
        let mut scratch = Scratch::new(&self.pilot);
        let out = &mut [0.0; MAX_COEFFICIENTS][..self.pilot.coefficients];
        let mut rays = Vec::new();
        for point in (0..all).step_by(step) {
            let noise = bake_point(&self.pilot, posed, point, &mut scratch, None, out);
            rays.push(self.pilot.rays() + self.rays(self.choice(f64::from(noise))));
        }
        rays.iter().sum::<usize>() as f64 / rays.len().max(1) as f64
    }

    /// Rays of the estimate.
    pub(super) fn rays(&self, choice: Choice) -> usize {
        let plan = &self.plans[choice.plan];
        plan.directions.directions() * choice.blocks
    }

    /// Runs of points of about equal work: the first point, its outputs.
    fn tasks<'a>(
        &self,
        choices: &[Choice],
        mut coefficients: &'a mut [f32],
        mut noise: &'a mut [f32],
    ) -> Vec<(usize, &'a mut [f32], &'a mut [f32])> {
        let (mut tasks, mut first) = (Vec::new(), 0);
        while first < choices.len() {
            let mut rays = 0;
            let more = choices[first..].iter().take_while(|&&choice| {
                let fits = rays < RAYS_PER_TASK;
                rays += self.rays(choice);
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
