//! The vertex basis that all coefficients share: the leading right singular vectors of the rows of
//! all poses and coefficients (PRT07 §5), and what it owes to the very poses it was found on.

use rayon::prelude::*;

use super::Error;
use super::noise::Noise;
use super::sketch::{ROUND_OFF, Ritz, Sketch, add_products};
use super::source::Source;
use super::tall_qr::tall_qr;
use crate::num::linalg::{Mat, multiply_add, product, rows_of, symmetric_eigen, thin_svd};

/// Singular values that a report shows, at least.
const SHOWN: usize = 100;
/// Columns of the sketch beyond those asked for; they make it converge in fewer passes.
const EXTRA: usize = 16;
/// Passes over the data, at most, without a wider sketch.
const MOST_PASSES: usize = 8;
/// The iteration ends when half a step lowers the truncated energy by a smaller share than this.
const LEAST_GAIN: f64 = 1e-2;
/// Singular values below this share of the largest are round-off of f32 products.
const LEAST_SINGULAR: f64 = 1e-6;
/// Directions of Q of which less than this share lies outside a group say nothing without it.
const LEAST_OUTSIDE: f64 = 1e-3;

/// Rows that are multiplied at once.
const ROWS: usize = 1024;

/// How many output dimensions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Outputs {
    /// This many.
    Exactly(usize),
    /// This many, or as many as there are.
    AtMost(usize),
    /// The fewest that leave no more outside than the rest of this share of Σ (y − ȳ)², as far as that is not
    /// noise of the data. What holds ȳ itself comes on top.
    Retaining(f64),
}

/// Orthonormal vectors over the points.
#[derive(Debug)]
pub(super) struct OutputBasis {
    /// `[point, output]`.
    vectors: Vec<f32>,
    /// d_out.
    pub(super) outputs: usize,
    /// Leading squared singular values, descending.
    pub(super) spectrum: Vec<f64>,
    /// Σ y².
    pub(super) energy: f64,
    /// Σ (y − ȳ)².
    pub(super) spread: f64,
    /// Passes over the data.
    pub(super) passes: usize,
    /// The vectors found without each group of poses, in the shape of `vectors`.
    without: Vec<Vec<f32>>,
}

/// The outputs in the basis.
#[derive(Debug)]
pub(super) struct Projected {
    /// T = Y P, `[pose, coefficient, output]`.
    t: Vec<f64>,
    /// ‖Y‖².
    energy: f64,
    /// ‖T‖² by outputs.
    inside: Vec<f64>,
    /// The same with each group's poses in the basis found without them.
    held_out: Option<Vec<f64>>,
}

impl Projected {
    /// T of the first `outputs` alone.
    pub(super) fn t(&self, outputs: usize) -> Vec<f64> {
        let rows = self.t.chunks_exact(self.inside.len());
        rows.flat_map(|row| &row[..outputs]).copied().collect()
    }

    /// ‖Y‖² − ‖T‖²: what the first `outputs` of the basis cannot express.
    pub(super) fn outside(&self, outputs: usize) -> f64 {
        (self.energy - self.inside[..outputs].iter().rev().sum::<f64>()).max(0.0)
    }

    /// By how much that would be more if each group's poses were expressed in the basis found
    /// without them.
    pub(super) fn optimism(&self, outputs: usize) -> Option<f64> {
        let sum = |values: &[f64]| values[..outputs].iter().rev().sum::<f64>();
        self.held_out.as_ref().map(|held_out| (sum(&self.inside) - sum(held_out)).max(0.0))
    }
}

impl OutputBasis {
    /// Finds the basis, and those without each group of poses (`groups` holds one index per pose).
    pub(super) fn find(
        source: &Source<'_>,
        wanted: Outputs,
        groups: &[usize],
        seed: u64,
    ) -> Result<Self, Error> {
        let most = source.points().min(source.poses() * source.width());
        let noise = Noise {
            variance: source.noise_variance(),
            rows: source.poses() * source.width(),
            columns: source.points(),
        };
        if let Outputs::Exactly(asked) = wanted
            && !(1..=most).contains(&asked)
        {
            return Err(Error::Outputs { asked, available: most });
        }
        let first = match wanted {
            Outputs::Exactly(asked) | Outputs::AtMost(asked) => asked + EXTRA.max(asked / 32),
            Outputs::Retaining(_) => 0,
        };
        let k = first.max(SHOWN + EXTRA).min(most);
        let mut sketch = Sketch::new(source, k, groups, seed);
        sketch.pass(source)?;
        sketch.advance();
        let mut last = MOST_PASSES;
        loop {
            sketch.pass(source)?;
            let ritz = sketch.ritz()?;
            let outputs = match wanted {
                Outputs::Exactly(asked) => asked,
                Outputs::AtMost(asked) => asked.min(sketch.k),
                Outputs::Retaining(share) => {
                    let needed = needed(&sketch, noise, share);
                    let (count, enough) = noise.fewest_of(&ritz.values, needed);
                    if !enough && sketch.k < most {
                        sketch.widen((2 * sketch.k).min(most));
                        last = sketch.passes + MOST_PASSES;
                        continue;
                    }
                    count
                }
            };
            if sketch.k == most || sketch.passes >= last || converged(&ritz, outputs, sketch.energy)
            {
                return Self::finish(&sketch, wanted, noise);
            }
            sketch.advance();
        }
    }

    /// The right singular vectors of QQᵀY, by way of W = YᵀQ.
    fn finish(sketch: &Sketch<'_>, wanted: Outputs, noise: Noise) -> Result<Self, Error> {
        let k = sketch.k;
        let w = total(&sketch.w);
        let (q, r) = tall_qr(&w, k);
        let svd = thin_svd(r.as_ref())?;
        let spectrum: Vec<f64> = svd.s.iter().map(|s| s * s).collect();
        let least = LEAST_SINGULAR * svd.s[0];
        let available = svd.s.iter().take_while(|&&s| s > least).count();
        let outputs = match wanted {
            Outputs::Exactly(asked) => asked,
            Outputs::AtMost(asked) => asked.min(available).max(1),
            Outputs::Retaining(share) => {
                let needed = needed(sketch, noise, share);
                noise.fewest_of(&spectrum, needed).0.min(available).max(1)
            }
        };
        if outputs > available {
            return Err(Error::Outputs { asked: outputs, available });
        }
        let without = if sketch.w.len() > 1 {
            let groups = 0..sketch.w.len();
            let each = groups.into_par_iter().map(|group| without(sketch, &w, group, outputs));
            each.collect::<Result<_, Error>>()?
        } else {
            Vec::new()
        };
        let vectors = turned(&q, k, &svd.u, outputs);
        let (energy, spread, passes) = (sketch.energy, sketch.spread, sketch.passes);
        Ok(Self { vectors, outputs, spectrum, energy, spread, passes, without })
    }

    /// The outputs in the basis, in one pass; `groups` as in [`OutputBasis::find`].
    pub(super) fn project(
        &self,
        source: &Source<'_>,
        groups: &[usize],
    ) -> Result<Projected, Error> {
        let (poses, d) = (source.poses(), self.outputs);
        let mut t = vec![0.0; poses * source.width() * d];
        let mut held_out = if self.without.is_empty() { Vec::new() } else { t.clone() };
        source.for_each_batch(|blocks| {
            let part = |block: usize| {
                let points = &blocks[block].points;
                points.start * d..points.end * d
            };
            add_products(&mut t, poses, d, blocks, |_, block| &self.vectors[part(block)]);
            if !held_out.is_empty() {
                let of = |pose: usize, block| &self.without[groups[pose]][part(block)];
                add_products(&mut held_out, poses, d, blocks, of);
            }
            Ok(())
        })?;
        let inside = energies(&t, d);
        let held_out = (!held_out.is_empty()).then(|| energies(&held_out, d));
        Ok(Projected { t, energy: self.energy, inside, held_out })
    }

    /// The first `outputs` vectors, `[point, output]`.
    pub(super) fn vectors(&self, outputs: usize) -> Vec<f32> {
        self.vectors.chunks_exact(self.outputs).flat_map(|row| &row[..outputs]).copied().collect()
    }
}

/// The energy without noise that a basis is to hold, so that what it leaves outside is the rest of a share of
/// the variance about the mean.
fn needed(sketch: &Sketch<'_>, noise: Noise, share: f64) -> f64 {
    let poses = sketch.groups.len();
    // The mean over the poses takes one of them in each coefficient.
    let varying = Noise { rows: noise.rows - noise.rows / poses, ..noise };
    noise.signal_energy(sketch.energy) - (1.0 - share) * varying.signal_energy(sketch.spread)
}

/// Whether another step would still lower the energy outside the leading vectors noticeably.
fn converged(ritz: &Ritz, outputs: usize, energy: f64) -> bool {
    let [now, next] = [&ritz.values, &ritz.next].map(|v| v[..outputs].iter().rev().sum::<f64>());
    next - now <= LEAST_GAIN * (energy - next).max(0.0) + ROUND_OFF * energy
}

/// The leading vectors without the poses of one group, padded with zeros where they are fewer:
/// those of W₋ = Y₋ᵀQ₋ after Q₋, the rows of Q outside the group, is made orthonormal.
fn without(
    sketch: &Sketch<'_>,
    w: &[f64],
    group: usize,
    outputs: usize,
) -> Result<Vec<f32>, Error> {
    let k = sketch.k;
    let rest: Vec<f64> =
        w.iter().zip(&sketch.w[group]).map(|(w, &own)| w - f64::from(own)).collect();
    let per_pose = sketch.q.len() / sketch.groups.len();
    let mut gram = Mat::zeros(k, k);
    for (q, &of) in sketch.q.chunks_exact(per_pose).zip(sketch.groups) {
        if of != group {
            let q: Vec<f64> = q.iter().map(|&x| f64::from(x)).collect();
            let q = rows_of(&q, per_pose / k, k);
            multiply_add(gram.as_mut(), 1.0, q.transpose(), q);
        }
    }
    let (values, vectors) = symmetric_eigen(gram.as_ref())?;
    let kept = values.iter().take_while(|&&value| value > LEAST_OUTSIDE).count();
    let scaled = Mat::from_fn(k, kept, |i, j| vectors[(i, j)] / values[j].sqrt());
    let (q, r) = tall_qr(&rest, k);
    let svd = thin_svd(product(r.as_ref(), scaled.as_ref()).as_ref())?;
    Ok(turned(&q, k, &svd.u, outputs))
}

/// The first `outputs` columns of QU, row-major; zeros where U has fewer.
fn turned(q: &[f64], k: usize, u: &Mat<f64>, outputs: usize) -> Vec<f32> {
    let count = outputs.min(u.ncols());
    let mut vectors = vec![0.0f32; q.len() / k * outputs];
    let blocks = vectors.par_chunks_mut(ROWS * outputs).zip(q.par_chunks(ROWS * k));
    blocks.for_each(|(out, q)| {
        let exact = product(rows_of(q, q.len() / k, k), u.subcols(0, count));
        for (out, exact) in out.chunks_exact_mut(outputs).zip(exact.row_iter()) {
            out.iter_mut().zip(exact.iter()).for_each(|(out, &x)| *out = x as f32);
        }
    });
    vectors
}

/// The sum of the groups' parts.
fn total(parts: &[Vec<f32>]) -> Vec<f64> {
    let mut sum = vec![0.0; parts[0].len()];
    for part in parts {
        sum.iter_mut().zip(part).for_each(|(sum, &x)| *sum += f64::from(x));
    }
    sum
}

/// Σ x² of every column, in chunks so that round-off stays small.
fn energies(values: &[f64], columns: usize) -> Vec<f64> {
    let mut sums = vec![0.0; columns];
    for chunk in values.chunks(ROWS * columns) {
        let mut part = vec![0.0; columns];
        for row in chunk.chunks_exact(columns) {
            part.iter_mut().zip(row).for_each(|(sum, x)| *sum += x * x);
        }
        sums.iter_mut().zip(&part).for_each(|(sum, part)| *sum += part);
    }
    sums
}
