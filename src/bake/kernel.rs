//! One point of one pose.

use std::f64::consts::PI;

use glam::{Mat3, Quat, Vec3};

use crate::num::directions::Set;
use crate::num::random::{hash, unit};
use crate::sh::{MAX_COEFFICIENTS, Rotation};
use crate::trace::{Rays, words_of};

use super::plan::Plan;
use super::posed::Posed;
use super::seen::Sink;
use super::sums::{LANES, list_bits};
use super::{Signal, falloff, ground};

/// Room for [`MAX_COEFFICIENTS`] in whole lanes.
const ROOM: usize = MAX_COEFFICIENTS.next_multiple_of(LANES);

/// What one thread needs beside the plan; made once per task.
#[derive(Debug)]
pub(super) struct Scratch {
    /// The set's directions in the root frame.
    turned: [Vec<f32>; 3],
    pub(super) blocked: Vec<u64>,
    listed: Vec<u16>,
    rotation: Rotation,
    /// [block, coefficient]: what is blocked, root frame.
    blocks: Vec<f32>,
    /// How often consecutive rays of the last point differed: the sum of squared differences, where
    /// blocked is 1.
    pub(super) crossed: f32,
}

impl Scratch {
    pub(super) fn new(plan: &Plan) -> Self {
        let rays = plan.directions.directions();
        Self {
            turned: [(); 3].map(|()| vec![0.0; rays]),
            blocked: vec![0; words_of(rays)],
            listed: vec![0; rays],
            rotation: Rotation::identity(plan.order),
            blocks: vec![0.0; plan.blocks * plan.coefficients],
            crossed: 0.0,
        }
    }

    /// How often consecutive ones of the first so many bits differ.
    pub(super) fn crossings(&self, rays: usize) -> f64 {
        let mut before = self.blocked.first().map_or(0, |word| word & 1);
        let mut count = 0;
        for (word, start) in self.blocked.iter().zip((0..rays).step_by(64)) {
            let within = u64::MAX >> (64 - (rays - start).min(64));
            count += ((word ^ (word << 1 | before)) & within).count_ones();
            before = word >> 63;
        }
        f64::from(count)
    }
}

/// Bakes one point: writes its coefficients and returns its noise. A sink also learns what the rays
/// hit.
pub(super) fn bake_point(
    plan: &Plan,
    posed: &Posed,
    point: usize,
    scratch: &mut Scratch,
    sink: Option<&mut Sink<'_>>,
    out: &mut [f32],
) -> f32 {
    bake_blocks(plan, posed, (point, plan.blocks), scratch, sink, out)
}

/// As [`bake_point`] with another number of blocks than the plan's.
pub(super) fn bake_blocks(
    plan: &Plan,
    posed: &Posed,
    (point, blocks): (usize, usize),
    scratch: &mut Scratch,
    mut sink: Option<&mut Sink<'_>>,
    out: &mut [f32],
) -> f32 {
    let count = plan.coefficients;
    if scratch.blocks.len() < blocks * count {
        scratch.blocks.resize(blocks * count, 0.0);
    }
    let mut half_squares = 0.0;
    scratch.crossed = 0.0;
    for block in 0..blocks {
        half_squares += trace_block(plan, posed, point, block, scratch, sink.as_deref_mut());
    }
    let found = &scratch.blocks[..blocks * count];
    let mean = &mut [0.0; MAX_COEFFICIENTS][..count];
    for block in found.chunks_exact(count) {
        mean.iter_mut().zip(block).for_each(|(mean, value)| *mean += value);
    }
    mean.iter_mut().for_each(|mean| *mean /= blocks as f32);
    let mut block_squares = 0.0;
    for block in found.chunks_exact(count) {
        let square = |(mean, value): (&f32, &f32)| f64::from(value - mean).powi(2);
        block_squares += mean.iter().zip(block).map(square).sum::<f64>();
    }
    plan.unoccluded(posed.normals[point], out);
    out.iter_mut().zip(mean).for_each(|(out, blocked)| *out -= *blocked);
    // Batches are block mean ± half difference, so Σ (batch − mean)² falls into these two.
    let batches = 2.0 * blocks as f64;
    let variance = 2.0 * (half_squares + block_squares) / (batches * (batches - 1.0));
    (variance / count as f64).sqrt() as f32
}

/// Traces one set of directions: writes what it finds blocked to the scratch's block and returns
/// the sum of squares over the coefficients of half the difference between its two halves.
fn trace_block(
    plan: &Plan,
    posed: &Posed,
    point: usize,
    block: usize,
    scratch: &mut Scratch,
    sink: Option<&mut Sink<'_>>,
) -> f64 {
    let number = posed.numbers.get(point).copied().unwrap_or(point as u64);
    let time = u64::from(posed.time_bits);
    let bits = hash(&[plan.seed, number, posed.clip_key, time, block as u64]);
    let index = (((bits >> 32) * plan.directions.sets() as u64) >> 32) as usize;
    let set = plan.directions.set(index);
    let frame = frame(posed.normals[point], PI * unit(bits << 32));
    turn(&Mat3::from_quat(frame), &set, &mut scratch.turned);
    let [x, y, z] = &scratch.turned;
    let rays = Rays { origin: posed.origins[point], x, y, z, near: posed.near, far: posed.far };
    let count = plan.coefficients;
    if let Some(exponent) = plan.falloff {
        let ([first, second], crossed) = falloff::shares(posed, point, &rays, &set, exponent);
        scratch.blocks[block] = ((first + second) / 2.0) as f32;
        scratch.crossed += crossed;
        return ((first - second) / 2.0).powi(2);
    }
    match sink {
        Some(sink) => sink.trace(posed, point, &rays, &set, &mut scratch.blocked),
        None => {
            posed.scene(point).occluded(&rays, &mut scratch.blocked);
            if let Some(heights) = &posed.heights {
                ground::block(&rays, heights[point], &mut scratch.blocked);
            }
        }
    }
    scratch.crossed += scratch.crossings(set.x.len()) as f32;
    let sums = &mut [0.0; MAX_COEFFICIENTS][..count];
    let squares = reduce(plan, index, scratch, sums);
    let out = &mut scratch.blocks[block * count..(block + 1) * count];
    if plan.signal == Signal::Ao {
        out.copy_from_slice(sums);
    } else {
        scratch.rotation.set(frame);
        scratch.rotation.apply(sums, out);
    }
    squares
}

/// What the scratch's bits of a set take away, in the set's frame; returns the sum of squares over
/// the coefficients of half the difference between the set's halves.
pub(super) fn reduce(plan: &Plan, index: usize, scratch: &mut Scratch, out: &mut [f32]) -> f64 {
    let set = plan.directions.set(index);
    let count = plan.coefficients;
    if plan.signal == Signal::Ao {
        let [first, second] = shares(&scratch.blocked, &set);
        out[0] = ((first + second) / 2.0) as f32;
        return ((first - second) / 2.0).powi(2);
    }
    let mut halves = [[0.0; ROOM]; 2];
    for (half, sums) in halves.iter_mut().enumerate() {
        let flip = if half == 0 { u64::MAX } else { 0 };
        let words = scratch.blocked.iter().zip(set.second_half).map(|(b, h)| b & (h ^ flip));
        let blocked = list_bits(words, &mut scratch.listed);
        plan.rows[index].sum(&scratch.listed[..blocked], sums);
    }
    let [first, second] = &halves;
    let mut squares = 0.0;
    for ((a, b), out) in first[..count].iter().zip(&second[..count]).zip(out) {
        squares += f64::from((a - b) / 2.0).powi(2);
        *out = (a + b) / 2.0;
    }
    squares
}

/// Turns +Z to the normal after turning by twice `half_azimuth` about +Z.
fn frame(normal: Vec3, half_azimuth: f64) -> Quat {
    let (sin, cos) = half_azimuth.sin_cos();
    Quat::from_rotation_arc(Vec3::Z, normal) * Quat::from_xyzw(0.0, 0.0, sin as f32, cos as f32)
}

fn turn(frame: &Mat3, set: &Set<'_>, out: &mut [Vec<f32>; 3]) {
    for (axis, out) in out.iter_mut().enumerate() {
        let [a, b, c] = frame.row(axis).to_array();
        for (((out, x), y), z) in out.iter_mut().zip(set.x).zip(set.y).zip(set.z) {
            *out = a * x + b * y + c * z;
        }
    }
}

/// The blocked share of each half.
fn shares(blocked: &[u64], set: &Set<'_>) -> [f64; 2] {
    let half = (set.x.len() / 2) as f64;
    let pairs = || blocked.iter().zip(set.second_half);
    let all: u32 = blocked.iter().map(|word| word.count_ones()).sum();
    let second: u32 = pairs().map(|(b, h)| (b & h).count_ones()).sum();
    [f64::from(all - second) / half, f64::from(second) / half]
}
