//! The vertex basis that all coefficients share: the leading right singular vectors of the rows of
//! all poses and coefficients, Y of (p·c) × v numbers, by randomised subspace iteration.
//!
//! Blocks of points are columns of Y, so one pass over the data applies Y Yᵀ whole:
//! W = YᵀQ block by block, and Z = Σ over blocks of Y W. Products are f32, sums over blocks f64.

use rayon::prelude::*;

use super::Error;
use super::design::fewest;
use super::mean::moments;
use super::source::{Block, Source};
use super::tall_qr::tall_qr;
use crate::num::linalg::{
    MatRef, multiply, multiply_add, product, rows_of, rows_of_mut, symmetric_eigen, thin_svd,
};
use crate::num::random::{Stream, hash};

/// Singular values that a report shows, at least.
const SHOWN: usize = 100;
/// Columns of the sketch beyond those asked for; they make it converge in fewer passes.
const EXTRA: usize = 16;
/// Passes over the data, at most.
const MOST_PASSES: usize = 8;
/// The iteration ends when a pass lowers the truncated energy by a smaller share than this…
const LEAST_GAIN: f64 = 1e-3;
/// …or by less than this share of all energy, where f32 products end.
const ROUND_OFF: f64 = 1e-7;
/// Singular values below this share of the largest are round-off of f32 products.
const LEAST_SINGULAR: f64 = 1e-6;

/// How many output dimensions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Outputs {
    /// This many.
    Exactly(usize),
    /// The fewest that hold this share of Σ y².
    Retaining(f64),
}

/// Orthonormal vectors over the points.
#[derive(Debug)]
pub(super) struct OutputBasis {
    /// `[point, output]`.
    pub(super) vectors: Vec<f32>,
    /// d_out.
    pub(super) outputs: usize,
    /// Leading squared singular values, descending.
    pub(super) spectrum: Vec<f64>,
    /// Σ y².
    pub(super) energy: f64,
    /// Σ (y − ȳ)², ȳ the mean over the poses of each point and coefficient.
    pub(super) spread: f64,
    /// Passes over the data.
    pub(super) passes: usize,
}

impl OutputBasis {
    /// Finds the basis.
    pub(super) fn find(source: &Source<'_>, wanted: Outputs, seed: u64) -> Result<Self, Error> {
        let most = source.points().min(source.poses() * source.width());
        if let Outputs::Exactly(asked) = wanted
            && !(1..=most).contains(&asked)
        {
            return Err(Error::Outputs { asked, available: most });
        }
        let first = match wanted {
            Outputs::Exactly(asked) => asked + EXTRA.max(asked / 32),
            Outputs::Retaining(_) => 0,
        };
        let mut sketch = Sketch::new(source, first.max(SHOWN + EXTRA).min(most), seed);
        sketch.pass(source)?;
        let mut captured = 0.0;
        for _ in 1..MOST_PASSES {
            sketch.advance();
            sketch.pass(source)?;
            let ritz = sketch.ritz_values()?;
            let outputs = match wanted {
                Outputs::Exactly(asked) => asked,
                Outputs::Retaining(share) => {
                    let needed = share * sketch.energy * (1.0 - ROUND_OFF);
                    let held: f64 = ritz.iter().rev().sum();
                    if held < needed && sketch.k < most {
                        sketch.widen((2 * sketch.k).min(most));
                        captured = 0.0;
                        continue;
                    }
                    fewest(&ritz, (needed / held).min(1.0))
                }
            };
            let now: f64 = ritz[..outputs].iter().rev().sum();
            let gain = now - captured;
            captured = now;
            let truncated = (sketch.energy - now).max(0.0);
            if sketch.k == most || gain <= LEAST_GAIN * truncated + ROUND_OFF * sketch.energy {
                break;
            }
        }
        sketch.finish(wanted)
    }

    /// T = Y P: the outputs in the basis, `[pose, coefficient, output]`, in one pass.
    pub(super) fn project(&self, source: &Source<'_>) -> Result<Vec<f64>, Error> {
        let (poses, d) = (source.poses(), self.outputs);
        let mut t = vec![0.0; poses * source.width() * d];
        source.for_each_batch(|blocks| {
            let of_block =
                |block: &Block| &self.vectors[block.points.start * d..block.points.end * d];
            let parts: Vec<&[f32]> = blocks.iter().map(of_block).collect();
            add_products(&mut t, poses, d, blocks, &parts);
            Ok(())
        })?;
        Ok(t)
    }
}

/// `z` `[pose, coefficient, column]` += Y_blocks · W_blocks, block after block in f64.
fn add_products(z: &mut [f64], poses: usize, k: usize, blocks: &[Block], w: &[&[f32]]) {
    let per_pose = z.len() / poses;
    z.par_chunks_mut(per_pose).enumerate().for_each_init(
        || vec![0.0f32; per_pose],
        |product, (pose, z)| {
            for (block, w) in blocks.iter().zip(w) {
                let y = rows_of_pose(block, pose, poses);
                let w = rows_of(w, block.points.len(), k);
                multiply(rows_of_mut(product, per_pose / k, k), y.transpose(), w);
                z.iter_mut().zip(&*product).for_each(|(z, &x)| *z += f64::from(x));
            }
        },
    );
}

/// One pose of a block, point × coefficient.
fn rows_of_pose(block: &Block, pose: usize, poses: usize) -> MatRef<'_, f32> {
    let values = block.pose(pose, poses);
    rows_of(values, block.points.len(), values.len() / block.points.len())
}

/// The state of the iteration.
struct Sketch {
    k: usize,
    poses: usize,
    points: usize,
    seed: u64,
    /// Orthonormal columns (random at first), `[pose, coefficient, column]`.
    q: Vec<f32>,
    /// Y Yᵀ Q.
    z: Vec<f64>,
    /// Yᵀ Q, `[point, column]`.
    w: Vec<f32>,
    energy: f64,
    spread: f64,
    passes: usize,
}

impl Sketch {
    fn new(source: &Source<'_>, k: usize, seed: u64) -> Self {
        let poses = source.poses();
        let rows = poses * source.width();
        let mut this = Self {
            k,
            poses,
            points: source.points(),
            seed,
            q: vec![0.0; rows * k],
            z: vec![0.0; rows * k],
            w: vec![0.0; source.points() * k],
            energy: 0.0,
            spread: 0.0,
            passes: 0,
        };
        this.randomise(0);
        this
    }

    /// Random columns from `first` on: independent, mean 0, whose scale does not matter.
    fn randomise(&mut self, first: usize) {
        let (k, seed) = (self.k, self.seed);
        self.q.par_chunks_mut(k).enumerate().for_each(|(row, q)| {
            let mut stream = Stream::new(hash(&[seed, row as u64, first as u64]));
            q[first..].iter_mut().for_each(|x| *x = (stream.uniform() - 0.5) as f32);
        });
    }

    /// W = YᵀQ and Z = YW.
    fn pass(&mut self, source: &Source<'_>) -> Result<(), Error> {
        let (k, poses) = (self.k, self.poses);
        let count_energy = self.passes == 0;
        self.z.fill(0.0);
        let Self { q, z, w, energy, spread, .. } = self;
        source.for_each_batch(|blocks| {
            let parts: Vec<Vec<f32>> =
                blocks.par_iter().map(|block| transposed_product(block, q, k, poses)).collect();
            let slices: Vec<&[f32]> = parts.iter().map(Vec::as_slice).collect();
            add_products(z, poses, k, blocks, &slices);
            for (block, part) in blocks.iter().zip(&parts) {
                w[block.points.start * k..block.points.end * k].copy_from_slice(part);
            }
            if count_energy {
                let of_blocks: Vec<(Vec<f64>, f64)> =
                    blocks.par_iter().map(|block| moments(block, poses)).collect();
                for (mean, deviations) in of_blocks {
                    *spread += deviations;
                    *energy += deviations + poses as f64 * mean.iter().map(|x| x * x).sum::<f64>();
                }
            }
            Ok(())
        })?;
        self.passes += 1;
        Ok(())
    }

    /// Q = an orthonormal basis of the columns of Z.
    fn advance(&mut self) {
        let (q, _) = tall_qr(&self.z, self.k);
        self.q.iter_mut().zip(&q).for_each(|(q, &x)| *q = x as f32);
    }

    /// More columns, random ones, beside the ones found.
    fn widen(&mut self, k: usize) {
        let old = self.k;
        let (q, _) = tall_qr(&self.z, old);
        let rows = self.q.len() / old;
        self.k = k;
        self.q = vec![0.0; rows * k];
        for (new, q) in self.q.chunks_exact_mut(k).zip(q.chunks_exact(old)) {
            new.iter_mut().zip(q).for_each(|(new, &x)| *new = x as f32);
        }
        self.randomise(old);
        let (q, _) = tall_qr(&self.q.iter().map(|&x| f64::from(x)).collect::<Vec<_>>(), k);
        self.z = q;
        self.w = vec![0.0; self.points * k];
    }

    /// Eigenvalues of QᵀYYᵀQ, descending: the energy that the span of Q captures.
    fn ritz_values(&self) -> Result<Vec<f64>, Error> {
        let rows = self.q.len() / self.k;
        let q: Vec<f64> = self.q.iter().map(|&x| f64::from(x)).collect();
        let gram = product(rows_of(&q, rows, self.k).transpose(), rows_of(&self.z, rows, self.k));
        let (mut values, _) = symmetric_eigen(gram.as_ref())?;
        values.iter_mut().for_each(|x| *x = x.max(0.0));
        Ok(values)
    }

    /// The right singular vectors of QQᵀY, by way of W = YᵀQ.
    fn finish(self, wanted: Outputs) -> Result<OutputBasis, Error> {
        let w: Vec<f64> = self.w.iter().map(|&x| f64::from(x)).collect();
        let (q, r) = tall_qr(&w, self.k);
        let svd = thin_svd(r.as_ref())?;
        let spectrum: Vec<f64> = svd.s.iter().map(|s| s * s).collect();
        let least = LEAST_SINGULAR * svd.s[0];
        let available = svd.s.iter().take_while(|&&s| s > least).count();
        let outputs = match wanted {
            Outputs::Exactly(asked) => asked,
            Outputs::Retaining(share) => {
                let held: f64 = spectrum.iter().rev().sum();
                let needed = share * self.energy * (1.0 - ROUND_OFF);
                fewest(&spectrum, (needed / held).min(1.0)).min(available).max(1)
            }
        };
        if outputs > available {
            return Err(Error::Outputs { asked: outputs, available });
        }
        let mut vectors = vec![0.0f32; self.points * outputs];
        let turn = svd.u.subcols(0, outputs);
        let blocks = vectors.par_chunks_mut(1024 * outputs).zip(q.par_chunks(1024 * self.k));
        blocks.for_each(|(out, q)| {
            let rows = q.len() / self.k;
            let exact = product(rows_of(q, rows, self.k), turn);
            let exact = exact.row_iter().flat_map(|row| row.iter());
            out.iter_mut().zip(exact).for_each(|(out, &x)| *out = x as f32);
        });
        let Self { energy, spread, passes, .. } = self;
        Ok(OutputBasis { vectors, outputs, spectrum, energy, spread, passes })
    }
}

/// W = Σ over poses of Y_i Q_i for one block, point × column.
fn transposed_product(block: &Block, q: &[f32], k: usize, poses: usize) -> Vec<f32> {
    let mut w = vec![0.0f32; block.points.len() * k];
    let per_pose = q.len() / poses;
    for (pose, q) in q.chunks_exact(per_pose).enumerate() {
        let y = rows_of_pose(block, pose, poses);
        let w = rows_of_mut(&mut w, block.points.len(), k);
        multiply_add(w, 1.0, y, rows_of(q, per_pose / k, k));
    }
    w
}
