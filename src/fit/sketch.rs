//! Randomised subspace iteration on the rows of all poses and coefficients, Y of (p·c) × v numbers.
//!
//! Blocks of points are columns of Y, so one pass over the data applies Y Yᵀ whole:
//! W = YᵀQ block by block, and Z = Σ over blocks of Y W. Products are f32, sums over blocks f64.

use rayon::prelude::*;

use super::Error;
use super::mean::moments;
use super::source::{Block, Source};
use super::tall_qr::tall_qr;
use crate::num::linalg::{
    Mat, MatRef, multiply, multiply_add, rows_of, rows_of_mut, symmetric_eigen,
};
use crate::num::random::{Stream, hash};

/// Rows that are multiplied at once.
const ROWS: usize = 1024;
/// Energies below this share of the largest are round-off of f32 products.
pub(super) const ROUND_OFF: f64 = 1e-7;

/// The state of the iteration: k columns that turn towards the leading singular vectors.
#[derive(Debug)]
pub(super) struct Sketch<'a> {
    pub(super) k: usize,
    /// Orthonormal columns (random at first), `[pose, coefficient, column]`.
    pub(super) q: Vec<f32>,
    /// Y Yᵀ Q, and its Ritz vectors after [`Sketch::ritz`].
    z: Vec<f64>,
    /// The part of Yᵀ Q that each group of poses contributes, `[point, column]`.
    pub(super) w: Vec<Vec<f32>>,
    /// The group of each pose.
    pub(super) groups: &'a [usize],
    /// Σ y².
    pub(super) energy: f64,
    /// Σ (y − ȳ)², ȳ the mean over the poses of each point and coefficient.
    pub(super) spread: f64,
    /// Passes over the data.
    pub(super) passes: usize,
    seed: u64,
}

/// How well the subspace of a pass holds the data.
#[derive(Debug)]
pub(super) struct Ritz {
    /// Eigenvalues of QᵀYYᵀQ, descending: what the span of Q captures of Σ y².
    pub(super) values: Vec<f64>,
    /// What the right singular vectors that come of Q capture, one by one. They are half an
    /// iteration further on, so the difference to `values` says how much there is still to gain.
    pub(super) next: Vec<f64>,
}

impl<'a> Sketch<'a> {
    pub(super) fn new(source: &Source<'_>, k: usize, groups: &'a [usize], seed: u64) -> Self {
        let count = groups.iter().max().map_or(1, |last| last + 1);
        let rows = source.poses() * source.width();
        let mut this = Self {
            k,
            q: vec![0.0; rows * k],
            z: vec![0.0; rows * k],
            w: vec![vec![0.0; source.points() * k]; count],
            groups,
            energy: 0.0,
            spread: 0.0,
            passes: 0,
            seed,
        };
        this.randomise(0);
        this
    }

    /// Random columns from `first` on: independent, mean 0, whose scale does not matter.
    fn randomise(&mut self, first: usize) {
        let (k, seed) = (self.k, self.seed);
        self.q.par_chunks_exact_mut(k).enumerate().for_each(|(row, q)| {
            let mut stream = Stream::new(hash(&[seed, row as u64, first as u64]));
            q[first..].iter_mut().for_each(|x| *x = (stream.uniform() - 0.5) as f32);
        });
    }

    /// W = YᵀQ and Z = YW.
    pub(super) fn pass(&mut self, source: &Source<'_>) -> Result<(), Error> {
        let (k, poses) = (self.k, source.poses());
        let first_pass = self.passes == 0;
        self.z.fill(0.0);
        let Self { q, z, w, groups, energy, spread, .. } = self;
        source.for_each_batch(|blocks| {
            let parts: Vec<Vec<Vec<f32>>> = (blocks.par_iter())
                .map(|block| transposed_products(block, q, k, groups, w.len()))
                .collect();
            let sums: Vec<Vec<f32>> = parts.par_iter().map(|parts| sum(parts)).collect();
            add_products(z, poses, k, blocks, |_, block| &sums[block]);
            for (block, parts) in blocks.iter().zip(&parts) {
                let range = block.points.start * k..block.points.end * k;
                w.iter_mut()
                    .zip(parts)
                    .for_each(|(w, part)| w[range.clone()].copy_from_slice(part));
            }
            if first_pass {
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

    /// Turns the columns of Z to the Ritz vectors of the pass, and says how good they are.
    pub(super) fn ritz(&mut self) -> Result<Ritz, Error> {
        let k = self.k;
        let partial: Vec<Mat<f64>> = (self.q.par_chunks(ROWS * k).zip(self.z.par_chunks(ROWS * k)))
            .map(|(q, z)| {
                let rows = z.len() / k;
                let q: Vec<f64> = q.iter().map(|&x| f64::from(x)).collect();
                let mut gram = Mat::zeros(k, k);
                multiply(gram.as_mut(), rows_of(&q, rows, k).transpose(), rows_of(z, rows, k));
                gram
            })
            .collect();
        let gram = partial.into_iter().reduce(|a, b| a + b).expect("there is a row");
        let (mut values, vectors) = symmetric_eigen(gram.as_ref())?;
        values.iter_mut().for_each(|x| *x = x.max(0.0));
        let squares: Vec<Vec<f64>> = (self.z.par_chunks_mut(ROWS * k))
            .map(|z| {
                let (rows, old) = (z.len() / k, z.to_vec());
                multiply(rows_of_mut(z, rows, k), rows_of(&old, rows, k), vectors.as_ref());
                let mut squares = vec![0.0; k];
                for row in z.chunks_exact(k) {
                    squares.iter_mut().zip(row).for_each(|(sum, x)| *sum += x * x);
                }
                squares
            })
            .collect();
        let squares = squares.iter().fold(vec![0.0; k], |mut sums: Vec<f64>, part| {
            sums.iter_mut().zip(part).for_each(|(sum, x)| *sum += x);
            sums
        });
        // ‖Y p‖² of the right vector p = Yᵀq/√θ is ‖YYᵀq‖²/θ, at least θ.
        let least = ROUND_OFF * values[0];
        let next = values.iter().zip(squares);
        let next = next.map(|(&v, s)| if v > least { (s / v).max(v) } else { v }).collect();
        Ok(Ritz { values, next })
    }

    /// Q = an orthonormal basis of the columns of Z.
    pub(super) fn advance(&mut self) {
        let (q, _) = tall_qr(&self.z, self.k);
        self.q.iter_mut().zip(&q).for_each(|(q, &x)| *q = x as f32);
    }

    /// More columns, random ones, beside the ones found.
    pub(super) fn widen(&mut self, k: usize) {
        let old = self.k;
        let (found, _) = tall_qr(&self.z, old);
        let rows = self.q.len() / old;
        self.k = k;
        self.q = vec![0.0; rows * k];
        for (q, found) in self.q.chunks_exact_mut(k).zip(found.chunks_exact(old)) {
            q.iter_mut().zip(found).for_each(|(q, &x)| *q = x as f32);
        }
        self.randomise(old);
        self.z = self.q.iter().map(|&x| f64::from(x)).collect();
        self.advance();
        self.w.iter_mut().for_each(|w| *w = vec![0.0; w.len() / old * k]);
    }
}

/// `z` `[pose, coefficient, column]` += Y_block · w(pose, block), block after block in f64.
pub(super) fn add_products<'w>(
    z: &mut [f64],
    poses: usize,
    k: usize,
    blocks: &[Block],
    w: impl Fn(usize, usize) -> &'w [f32] + Sync,
) {
    let per_pose = z.len() / poses;
    z.par_chunks_exact_mut(per_pose).enumerate().for_each_init(
        || vec![0.0f32; per_pose],
        |product, (pose, z)| {
            for (i, block) in blocks.iter().enumerate() {
                let y = rows_of_pose(block, pose, poses);
                let w = rows_of(w(pose, i), block.points.len(), k);
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

/// For each group Σ over its poses of Y_i Q_i for one block, point × column.
fn transposed_products(
    block: &Block,
    q: &[f32],
    k: usize,
    groups: &[usize],
    count: usize,
) -> Vec<Vec<f32>> {
    let mut w = vec![vec![0.0f32; block.points.len() * k]; count];
    let per_pose = q.len() / groups.len();
    for (pose, (q, &group)) in q.chunks_exact(per_pose).zip(groups).enumerate() {
        let y = rows_of_pose(block, pose, groups.len());
        let w = rows_of_mut(&mut w[group], block.points.len(), k);
        multiply_add(w, 1.0, y, rows_of(q, per_pose / k, k));
    }
    w
}

fn sum(parts: &[Vec<f32>]) -> Vec<f32> {
    let mut sum = parts[0].clone();
    for part in &parts[1..] {
        sum.iter_mut().zip(part).for_each(|(sum, x)| *sum += x);
    }
    sum
}
