//! Light that comes by way of other surfaces.
//!
//! tᵏ⁺¹(x) = (1/π) ∫ (1−V) (n·ω)₊ ρ(q) tᵏ(q) dω with q what the ray in direction ω hits, tᵏ
//! interpolated between the corners of its triangle (Nowrouzezahrai et al. 2007, §3). With the
//! direct part t⁰ and the sums L_b = Σ_{k≤b} tᵏ that is L_{b+1} = t⁰ + T·L_b, one pass over all
//! points for each bounce. The rays of the direct part serve every pass: rows of T belong to
//! points and are independent of one another, so a product of rows has the product's mean (but for
//! rays that hit a triangle of their own point).
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

use super::kernel::{Scratch, bake_point};
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
    /// Up to which rows are kept.
    pub(super) most_row_bytes: u64,
    pub(super) cancelled: &'a AtomicBool,
}

impl Bounces<'_> {
    /// Bakes the pose.
    pub(super) fn bake(&self) -> Result<BakedPose, Error> {
        let (points, count) = (self.posed.normals.len(), self.plan.coefficients);
        let width = count * self.reflectance.channels;
        let row_bytes = (points * self.plan.rays() * size_of::<super::seen::Seen>()) as u64;
        let keeps = row_bytes <= self.most_row_bytes;
        let mut direct = vec![0.0; points * width];
        let mut noise = vec![0.0; points];
        let mut rows: Vec<Row> = vec![Row::default(); if keeps { points } else { 0 }];
        self.direct(&mut direct, &mut noise, &mut rows)?;
        let mut sum = direct.clone();
        for bounce in 1..=self.reflectance.bounces {
            let last = bounce == self.reflectance.bounces;
            let mut next = direct.clone();
            let mut gathered = if last { vec![0.0; points] } else { Vec::new() };
            self.pass(&rows, &sum, &mut next, &mut gathered)?;
            for (noise, gathered) in noise.iter_mut().zip(gathered) {
                // A blocked ray loses directly what it gathers: the sum of squares is more than
                // the variance, never less.
                *noise = noise.hypot(gathered);
            }
            sum = next;
        }
        let rays = vec![self.plan.rays() as u32; points];
        Ok(BakedPose { coefficients: sum, noise, rays })
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
            || (Scratch::new(self.plan), self.sink()),
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
        rows: &[Row],
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
            || (Scratch::new(self.plan), self.sink(), vec![0.0; 2 * width]),
            |(scratch, sink, sums), (task, (out, noise))| {
                self.check()?;
                for (within, out) in out.chunks_exact_mut(width).enumerate() {
                    let point = task * POINTS_PER_TASK + within;
                    let traced;
                    let row = match rows.get(point) {
                        Some(row) => row,
                        None => {
                            let unused = &mut [0.0; MAX_COEFFICIENTS][..self.plan.coefficients];
                            bake_point(self.plan, self.posed, point, scratch, Some(sink), unused);
                            traced = sink.take();
                            &traced
                        }
                    };
                    let found = self.gather(row, from, sums, out);
                    if let Some(noise) = noise.get_mut(within) {
                        *noise = found;
                    }
                }
                Ok(())
            },
        )
    }

    /// Adds the mean over the row's batches to `out` and returns its noise. `sums` holds two
    /// widths of scratch.
    fn gather(&self, row: &Row, from: &[f32], sums: &mut [f32], out: &mut [f32]) -> f32 {
        let width = out.len();
        let (batch, mean) = sums.split_at_mut(width);
        mean.fill(0.0);
        let rays = (self.plan.directions.directions() / 2) as f32;
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

    fn sink(&self) -> Sink<'_> {
        let black = self.reflectance.surface.material.len();
        Sink::new(self.stage, self.normals, black, self.plan.directions.directions())
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
