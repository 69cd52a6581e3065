//! Light that comes by way of other surfaces.
//!
//! tᵏ⁺¹(x) = (1/π) ∫ (1−V) (n·ω)₊ ρ(q) tᵏ(q) dω with q what the ray in direction ω hits, tᵏ
//! interpolated between the corners of its triangle (Nowrouzezahrai et al. 2007, §3). With the
//! direct part t⁰ and the sums L_b = Σ_{k≤b} tᵏ that is L_{b+1} = t⁰ + T·L_b, one pass over all
//! points for each bounce. The rays of the direct part serve every pass: rows of T belong to
//! points and are independent of one another, so a product of rows has the product's mean (but for
//! rays that hit a triangle of their own point).
//!
//! With a target noise each point has the rays that its direct part is worth; its row is that of the
//! rays that followed the pilot, or of the pilot alone where none did.
//!
//! What a ray hits from behind reflects nothing, also where the material is double-sided: a point
//! has the transfer of its front only. Ground and occluders reflect nothing.
//!
//! *Invariant:* the gathered part of a point is at most [`MOST_ALBEDO`](crate::scene::MOST_ALBEDO)
//! times the largest of what it gathers from, so the sum over all bounces converges.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::adaptive::Adaptive;
use super::allocate::Level;
use super::kernel::{Scratch, bake_blocks, bake_point};
use super::plan::Plan;
use super::posed::{Posed, Stage};
use super::seen::{Row, Sink};
use super::{BakedPose, Error, Signal};
use crate::scene::Surface;
use crate::sh::MAX_COEFFICIENTS;

/// The most bounces.
pub const MOST_BOUNCES: u32 = 8;

/// Rows of a pose are kept up to this size; beyond it, each pass traces its rays anew.
pub(super) const MOST_ROW_BYTES: u64 = 1 << 30;

/// Points per task: prompt to cancel, and rows of neighbours share what they gather from.
const POINTS_PER_TASK: usize = 64;

/// What surfaces reflect, and how often.
#[derive(Debug, Clone, PartialEq)]
pub struct Reflectance {
    /// 1 to [`MOST_BOUNCES`].
    pub bounces: u32,
    /// 1 for a grey surface (of which red counts), 3 for one with colours.
    pub channels: usize,
    /// Of the first triangles; all others are black.
    pub surface: Arc<Surface>,
}

impl Reflectance {
    pub(super) fn check(&self, signal: Signal) -> Result<(), Error> {
        if signal != Signal::Transfer {
            return Err(Error::BouncesOf { signal: signal.name() });
        }
        if !(1..=MOST_BOUNCES).contains(&self.bounces) {
            return Err(Error::Bounces { found: self.bounces });
        }
        if !matches!(self.channels, 1 | 3) {
            return Err(Error::Channels { found: self.channels });
        }
        Ok(())
    }

    /// Of one pose: rows and three sets of coefficients.
    pub(super) fn memory_bytes(&self, plan: &Plan, points: u64) -> u64 {
        let rows = points * plan.rays() as u64 * size_of::<super::seen::Seen>() as u64;
        let sets = 3 * points * (self.channels * plan.coefficients) as u64 * 4;
        // Vectors grow by doubling.
        2 * rows.min(MOST_ROW_BYTES) + sets
    }
}

/// One pose at work.
pub(super) struct Bounces<'a> {
    pub(super) plan: &'a Plan,
    pub(super) stage: &'a Stage,
    pub(super) posed: &'a Posed,
    /// Shading normals of the vertices, by which triangles know their front.
    pub(super) normals: &'a [Vec3],
    pub(super) reflectance: &'a Reflectance,
    /// What decides the rays of each point, where that is a matter of noise.
    pub(super) adaptive: Option<&'a Adaptive>,
    /// Up to which rows are kept.
    pub(super) most_row_bytes: u64,
    pub(super) cancelled: &'a AtomicBool,
}

/// The direct part of a pose and what its rays hit.
struct Direct {
    /// In every channel.
    pose: BakedPose,
    /// Empty where each pass traces anew.
    rows: Vec<Row>,
    /// Empty where all points have the plan's rays.
    levels: Vec<Level>,
}

/// What one thread traces with: for each plan what it needs, once it is needed.
type Tracers<'a> = Vec<Option<(Scratch, Sink<'a>)>>;

impl Bounces<'_> {
    /// Bakes the pose.
    pub(super) fn bake(&self) -> Result<BakedPose, Error> {
        let traced = match self.adaptive {
            Some(adaptive) => self.to_noise(adaptive)?,
            None => self.uniform()?,
        };
        let Direct { pose: BakedPose { coefficients: direct, mut noise, rays }, rows, levels } =
            traced;
        let mut sum = direct.clone();
        for bounce in 1..=self.reflectance.bounces {
            let last = bounce == self.reflectance.bounces;
            let mut next = direct.clone();
            let mut gathered = if last { vec![0.0; noise.len()] } else { Vec::new() };
            self.pass((&rows, &levels), &sum, &mut next, &mut gathered)?;
            for (noise, gathered) in noise.iter_mut().zip(gathered) {
                // A blocked ray loses directly what it gathers: the sum of squares is more than
                // the variance, never less.
                *noise = noise.hypot(gathered);
            }
            sum = next;
        }
        Ok(BakedPose { coefficients: sum, noise, rays })
    }

    /// The same rays at every point.
    fn uniform(&self) -> Result<Direct, Error> {
        let (points, count) = (self.posed.normals.len(), self.plan.coefficients);
        let mut coefficients = vec![0.0; points * count * self.reflectance.channels];
        let mut noise = vec![0.0; points];
        let keeps = self.keeps((points * self.plan.rays()) as u64);
        let mut rows: Vec<Row> = vec![Row::default(); if keeps { points } else { 0 }];
        self.direct(&mut coefficients, &mut noise, &mut rows)?;
        let rays = vec![self.plan.rays() as u32; points];
        Ok(Direct { pose: BakedPose { coefficients, noise, rays }, rows, levels: Vec::new() })
    }

    /// As many rays as the direct part is worth.
    fn to_noise(&self, adaptive: &Adaptive) -> Result<Direct, Error> {
        let (mut pose, levels) = adaptive.bake_levels(self.posed, self.cancelled)?;
        let rays = pose.rays.iter().map(|&rays| u64::from(rays)).sum();
        let points = (0..if self.keeps(rays) { levels.len() } else { 0 }).into_par_iter();
        let rows = points.with_max_len(POINTS_PER_TASK).map_init(Tracers::new, |tracers, point| {
            self.check()?;
            Ok(self.row(tracers, &levels, point))
        });
        let rows = rows.collect::<Result<Vec<Row>, Error>>()?;
        let channels = self.reflectance.channels;
        let values = pose.coefficients.chunks_exact(self.plan.coefficients);
        pose.coefficients = values.flat_map(|row| row.repeat(channels)).collect();
        Ok(Direct { pose, rows, levels })
    }

    fn keeps(&self, rays: u64) -> bool {
        rays * size_of::<super::seen::Seen>() as u64 <= self.most_row_bytes
    }

    /// The plan whose rays make a point's row, its place among the tracers, and how many blocks.
    fn plan_of(&self, levels: &[Level], point: usize) -> (usize, &Plan, usize) {
        match (self.adaptive, levels.get(point)) {
            (Some(adaptive), Some(level)) => adaptive.plan_of(level),
            _ => (0, self.plan, self.plan.blocks),
        }
    }

    /// Traces a point's row.
    fn row<'b>(&'b self, tracers: &mut Tracers<'b>, levels: &[Level], point: usize) -> Row {
        let (place, plan, blocks) = self.plan_of(levels, point);
        if tracers.len() <= place {
            tracers.resize_with(place + 1, || None);
        }
        let (scratch, sink) =
            tracers[place].get_or_insert_with(|| (Scratch::new(plan), self.sink(plan)));
        let unused = &mut [0.0; MAX_COEFFICIENTS][..plan.coefficients];
        bake_blocks(plan, self.posed, (point, blocks), scratch, Some(sink), unused);
        sink.take()
    }

    /// The direct part of every point in every channel, its noise, and what its rays hit.
    fn direct(&self, out: &mut [f32], noise: &mut [f32], rows: &mut [Row]) -> Result<(), Error> {
        let (count, channels) = (self.plan.coefficients, self.reflectance.channels);
        let keeps = !rows.is_empty();
        // Without rows to keep there still is one chunk of nothing for each task.
        let mut kept = rows.chunks_mut(POINTS_PER_TASK);
        let tasks: Vec<_> = out
            .chunks_mut(POINTS_PER_TASK * count * channels)
            .zip(noise.chunks_mut(POINTS_PER_TASK))
            .map(|(out, noise)| (out, noise, kept.next().unwrap_or_default()))
            .enumerate()
            .collect();
        tasks.into_par_iter().try_for_each_init(
            || (Scratch::new(self.plan), self.sink(self.plan)),
            |(scratch, sink), (task, (out, noise, rows))| {
                self.check()?;
                let points = out.chunks_exact_mut(count * channels).zip(noise).enumerate();
                for (within, (out, noise)) in points {
                    let point = task * POINTS_PER_TASK + within;
                    let (first, others) = out.split_at_mut(count);
                    let seen = keeps.then_some(&mut *sink);
                    *noise = bake_point(self.plan, self.posed, point, scratch, seen, first);
                    others.chunks_exact_mut(count).for_each(|other| other.copy_from_slice(first));
                    if keeps {
                        rows[within] = sink.take();
                    }
                }
                Ok(())
            },
        )
    }

    /// Adds to `out` what each point gathers from `from`; where there is room for it, its noise.
    fn pass(
        &self,
        (rows, levels): (&[Row], &[Level]),
        from: &[f32],
        out: &mut [f32],
        noise: &mut [f32],
    ) -> Result<(), Error> {
        let width = self.plan.coefficients * self.reflectance.channels;
        let mut noises = noise.chunks_mut(POINTS_PER_TASK);
        let tasks: Vec<_> = out
            .chunks_mut(POINTS_PER_TASK * width)
            .map(|out| (out, noises.next().unwrap_or_default()))
            .enumerate()
            .collect();
        tasks.into_par_iter().try_for_each_init(
            || (Tracers::new(), vec![0.0; 2 * width]),
            |(tracers, sums), (task, (out, noise))| {
                self.check()?;
                for (within, out) in out.chunks_exact_mut(width).enumerate() {
                    let point = task * POINTS_PER_TASK + within;
                    let traced;
                    let row = match rows.get(point) {
                        Some(row) => row,
                        None => {
                            traced = self.row(tracers, levels, point);
                            &traced
                        }
                    };
                    let (_, plan, _) = self.plan_of(levels, point);
                    let rays = plan.directions.directions() / 2;
                    let found = self.gather((row, rays), from, sums, out);
                    if let Some(noise) = noise.get_mut(within) {
                        *noise = found;
                    }
                }
                Ok(())
            },
        )
    }

    /// Adds the mean over the row's batches, each of so many rays, to `out` and returns its noise.
    /// `sums` holds two widths of scratch.
    fn gather(
        &self,
        (row, rays): (&Row, usize),
        from: &[f32],
        sums: &mut [f32],
        out: &mut [f32],
    ) -> f32 {
        let width = out.len();
        let (batch, mean) = sums.split_at_mut(width);
        mean.fill(0.0);
        let rays = rays as f32;
        let batches = row.batches().count() as f64;
        let mut squares = 0.0;
        for seen in row.batches() {
            batch.fill(0.0);
            for one in seen {
                let triangle = one.triangle as usize;
                let (u, v) = one.place();
                let albedo = self.reflectance.surface.albedo(triangle, u, v);
                let corners = self.stage.triangles[triangle];
                for (corner, weight) in corners.into_iter().zip([1.0 - u - v, u, v]) {
                    let point = self.stage.points.of_vertex[corner as usize] as usize;
                    let from = &from[point * width..(point + 1) * width];
                    add(from, albedo.map(|a| a * weight / rays), self.plan.coefficients, batch);
                }
            }
            for (mean, value) in mean.iter_mut().zip(&*batch) {
                *mean += value;
                squares += f64::from(value * value);
            }
        }
        let mut of_mean = 0.0;
        for (out, mean) in out.iter_mut().zip(&*mean) {
            let mean = f64::from(*mean) / batches;
            of_mean += mean * mean;
            *out += mean as f32;
        }
        let variance = (squares - batches * of_mean).max(0.0) / (batches * (batches - 1.0));
        (variance / width as f64).sqrt() as f32
    }

    /// Does for one point what the direct part and all passes do for it, with the plan's rays, for the
    /// sake of the time that it takes. `sums` holds three widths of scratch.
    pub(super) fn rehearse(
        &self,
        point: usize,
        (scratch, sink): (&mut Scratch, &mut Sink<'_>),
        from: &[f32],
        sums: &mut [f32],
    ) {
        let width = self.plan.coefficients * self.reflectance.channels;
        let (out, sums) = sums.split_at_mut(width);
        let rays = self.plan.directions.directions() / 2;
        let mut trace = |out: &mut [f32]| {
            let out = &mut out[..self.plan.coefficients];
            bake_point(self.plan, self.posed, point, scratch, Some(&mut *sink), out);
            sink.take()
        };
        let keeps = self.keeps((self.posed.normals.len() * self.plan.rays()) as u64);
        let mut row = trace(out);
        for _ in 0..self.reflectance.bounces {
            if !keeps {
                row = trace(out);
            }
            self.gather((&row, rays), from, sums, out);
        }
    }

    pub(super) fn sink(&self, plan: &Plan) -> Sink<'_> {
        let black = self.reflectance.surface.material.len();
        Sink::new(self.stage, self.normals, black, plan.directions.directions())
    }

    fn check(&self) -> Result<(), Error> {
        let stop = self.cancelled.load(Ordering::Relaxed);
        if stop { Err(Error::Cancelled) } else { Ok(()) }
    }
}

/// `out += weight of the channel · from`, channel by channel of `count` coefficients.
fn add(from: &[f32], weights: [f32; 3], count: usize, out: &mut [f32]) {
    let channels = from.chunks_exact(count).zip(out.chunks_exact_mut(count));
    for ((from, out), weight) in channels.zip(weights) {
        for (out, from) in out.iter_mut().zip(from) {
            *out += weight * from;
        }
    }
}
