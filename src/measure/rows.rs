//! One pose, row by row: a row is one point and channel, and every quantity of a row is a product
//! of two factors whose noise is independent.

use glam::Vec3;
use rayon::prelude::*;

use super::probes::{Probes, Site, dot};
use crate::sh::MAX_BANDS;

const MOST: usize = MAX_BANDS * MAX_BANDS;
/// Points of one piece of parallel work. Pieces are joined in order, so the split never shows.
const BLOCK: usize = 256;

/// What is followed over a measurement. Each has a left and a right vector per row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Track {
    /// r₁ and r₂: the size of the signal itself.
    Reference,
    /// (r₁ − r₂)/2 twice: the noise of the average reference.
    Noise,
    /// m − r₁ and m − r₂: the error of a candidate.
    Candidate(usize),
    /// m − m₀ twice: what a candidate adds to the model of index m₀.
    Added(usize, usize),
}

/// The coefficients of one pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coefficients<'a> {
    pub(super) reference1: &'a [f32],
    pub(super) reference2: &'a [f32],
    pub(super) candidates: &'a [&'a [f32]],
}

impl Coefficients<'_> {
    /// The left and right vectors of a row.
    fn factors(&self, track: Track, row: usize, count: usize, left: &mut [f64], right: &mut [f64]) {
        let range = row * count..(row + 1) * count;
        let (r1, r2) = (&self.reference1[range.clone()], &self.reference2[range.clone()]);
        let model = |i: usize| &self.candidates[i][range.clone()];
        let difference = |a: &[f32], b: &[f32], out: &mut [f64]| {
            for ((o, a), b) in out.iter_mut().zip(a).zip(b) {
                *o = f64::from(*a) - f64::from(*b);
            }
        };
        match track {
            Track::Reference => {
                left.iter_mut().zip(r1).for_each(|(o, &x)| *o = f64::from(x));
                right.iter_mut().zip(r2).for_each(|(o, &x)| *o = f64::from(x));
            }
            Track::Noise => {
                difference(r1, r2, left);
                left.iter_mut().for_each(|x| *x /= 2.0);
                right.copy_from_slice(left);
            }
            Track::Candidate(i) => {
                difference(model(i), r1, left);
                difference(model(i), r2, right);
            }
            Track::Added(i, model_index) => {
                difference(model(i), model(model_index), left);
                right.copy_from_slice(left);
            }
        }
    }
}

/// What one pose gives of one track.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    /// Left probes [row, probe].
    pub(super) left: Vec<f64>,
    /// Right probes [row, probe].
    pub(super) right: Vec<f64>,
    /// Σ left·right over the coefficients [row].
    pub(super) square: Vec<f64>,
    /// leftᵀ G(n) right [row]; zeros where the signal has no directions.
    pub(super) hemisphere: Vec<f64>,
    /// Σ (left + right)/2 over the coefficients [row].
    pub(super) sum: Vec<f64>,
    /// As `square`, of the change since the frame before [row]; empty where there is none.
    pub(super) change: Vec<f64>,
}

impl Rows {
    fn append(&mut self, mut other: Self) {
        self.left.append(&mut other.left);
        self.right.append(&mut other.right);
        self.square.append(&mut other.square);
        self.hemisphere.append(&mut other.hemisphere);
        self.sum.append(&mut other.sum);
        self.change.append(&mut other.change);
    }
}

/// Evaluates every track over a pose; `before` is the frame before it, where there is one.
pub(super) fn evaluate(
    probes: &Probes,
    tracks: &[Track],
    now: Coefficients<'_>,
    before: Option<Coefficients<'_>>,
    normals: &[Vec3],
) -> Vec<Rows> {
    let (channels, count) = layout(now.reference1.len(), normals.len(), probes);
    let kernel = Kernel { probes, count, now, before };
    let blocks: Vec<Vec<Rows>> = normals
        .par_chunks(BLOCK)
        .enumerate()
        .map(|(block, normals)| {
            let mut rows = vec![Rows::default(); tracks.len()];
            for (i, &normal) in normals.iter().enumerate() {
                let site = probes.site(normal);
                let first = (block * BLOCK + i) * channels;
                for row in first..first + channels {
                    for (&track, out) in tracks.iter().zip(&mut rows) {
                        kernel.row(track, &site, row, out);
                    }
                }
            }
            rows
        })
        .collect();
    let mut all = vec![Rows::default(); tracks.len()];
    for block in blocks {
        all.iter_mut().zip(block).for_each(|(a, b)| a.append(b));
    }
    all
}

/// Channels, and coefficients of a row.
fn layout(numbers: usize, points: usize, probes: &Probes) -> (usize, usize) {
    let count = probes.coefficients();
    (numbers / (points * count), count)
}

#[derive(Debug, Clone, Copy)]
struct Kernel<'a> {
    probes: &'a Probes,
    count: usize,
    now: Coefficients<'a>,
    before: Option<Coefficients<'a>>,
}

impl Kernel<'_> {
    fn row(&self, track: Track, site: &Site, row: usize, out: &mut Rows) {
        let count = self.count;
        let (mut left, mut right) = ([0.0; MOST], [0.0; MOST]);
        let (left, right) = (&mut left[..count], &mut right[..count]);
        self.now.factors(track, row, count, left, right);
        self.probes.read(site, left, &mut out.left);
        self.probes.read(site, right, &mut out.right);
        out.square.push(dot(left, right));
        out.sum.push(left.iter().zip(&*right).map(|(a, b)| (a + b) / 2.0).sum());
        let directional = self.probes.is_directional();
        let hemisphere = || self.probes.hemisphere(site, left, right);
        out.hemisphere.push(if directional { hemisphere() } else { 0.0 });
        if let Some(before) = self.before {
            let (mut old_left, mut old_right) = ([0.0; MOST], [0.0; MOST]);
            let (old_left, old_right) = (&mut old_left[..count], &mut old_right[..count]);
            before.factors(track, row, count, old_left, old_right);
            let change = (0..count).map(|c| (left[c] - old_left[c]) * (right[c] - old_right[c]));
            out.change.push(change.sum());
        }
    }
}
