//! Principal components of the outputs of each cluster of points, points and coefficients jointly
//! (RPO09 §5.2), by a randomised range finder over streamed blocks.

use rayon::prelude::*;

use super::Error;
use super::clustered::Kept;
use super::noise::Noise;
use super::source::{Block, Source};
use crate::num::linalg::{Mat, MatRef, Qr, multiply_add, product, symmetric_eigen};
use crate::num::random::{hash, unit};

/// Dimensions among which the principal ones are sought, at most: with fewer poses it is exact.
const SKETCH: usize = 160;

/// Outputs of a cluster that are worked on at once.
const COLUMNS: usize = 512;

/// One cluster's outputs about their means, B = scores · directionsᵀ and a rest.
#[derive(Debug, Clone)]
pub(super) struct Part {
    /// p × k, U diag(s).
    pub(super) scores: Mat<f64>,
    /// `[point, coefficient]`.
    mean: Vec<f32>,
    /// `[point, coefficient, k]`.
    directions: Vec<f32>,
    /// ‖B‖².
    pub(super) energy: f64,
    /// What the scores hold of it.
    pub(super) kept: f64,
    /// s² of all directions that were found, k and more, descending.
    values: Vec<f64>,
    noise: Noise,
}

impl Part {
    /// `[point, coefficient, k + 1]`, the mean last.
    pub(super) fn basis(&self) -> Vec<f32> {
        let k = self.scores.ncols();
        let mut out = Vec::with_capacity(self.mean.len() * (k + 1));
        for (i, &mean) in self.mean.iter().enumerate() {
            out.extend_from_slice(&self.directions[i * k..(i + 1) * k]);
            out.push(mean);
        }
        out
    }

    /// Points times coefficients.
    pub(super) fn outputs(&self) -> usize {
        self.mean.len()
    }

    /// s² of the directions that are kept.
    pub(super) fn squares(&self) -> &[f64] {
        &self.values[..self.scores.ncols()]
    }

    /// The same with fewer directions, as if no more had been asked for.
    pub(super) fn only(&self, outputs: Kept) -> Self {
        let (all, k) = (self.scores.ncols(), self.count(outputs).min(self.scores.ncols()));
        let rows = self.directions.chunks_exact(all.max(1));
        Self {
            scores: self.scores.subcols(0, k).to_owned(),
            mean: self.mean.clone(),
            directions: rows.flat_map(|row| &row[..k.min(row.len())]).copied().collect(),
            energy: self.energy,
            kept: self.values[..k].iter().sum(),
            values: self.values.clone(),
            noise: self.noise,
        }
    }

    /// How many directions are kept: none of those that the noise of the data hides.
    fn count(&self, outputs: Kept) -> usize {
        match outputs {
            Kept::Count(count) => count.min(self.values.len()),
            Kept::Share(share) => self.noise.fewest(&self.values, self.energy, share).0,
        }
    }

    /// Directions of so large a share that noise alone keeps out, next to `outputs`.
    pub(super) fn hidden(&self, outputs: Kept) -> usize {
        let silent = Noise { variance: 0.0, ..self.noise };
        match outputs {
            Kept::Count(_) => 0,
            Kept::Share(share) => {
                let all = silent.fewest(&self.values, self.energy, share).0;
                all.saturating_sub(self.count(outputs))
            }
        }
    }
}

/// The parts of all clusters, in three passes over the data.
pub(super) fn parts(
    source: &Source<'_>,
    labels: &[usize],
    outputs: Kept,
    seed: u64,
) -> Result<Vec<Part>, Error> {
    let (poses, width, variance) = (source.poses(), source.width(), source.noise_variance());
    let count = labels.iter().max().map_or(0, |&label| label + 1);
    let size = SKETCH.min(poses);
    let mut sketches = vec![Mat::<f64>::zeros(poses, size); count];
    let visit = |cluster: usize, blocks: &[Block], work: &mut dyn FnMut(Columns)| {
        for block in blocks {
            columns(block, poses, width, labels, cluster, work);
        }
    };
    source.for_each_batch(|blocks| {
        let blocks = &*blocks;
        sketches.par_iter_mut().enumerate().for_each(|(cluster, sketch)| {
            visit(cluster, blocks, &mut |columns: Columns| {
                let random = Mat::from_fn(columns.outputs.len(), size, |i, j| {
                    unit(hash(&[seed, columns.outputs[i] as u64, j as u64])) - 0.5
                });
                multiply_add(sketch.as_mut(), 1.0, columns.b.as_ref(), random.as_ref());
            });
        });
        Ok(())
    })?;
    let ranges: Vec<Mat<f64>> = sketches.par_iter().map(|s| Qr::new(s.as_ref()).q()).collect();
    drop(sketches);
    let mut grams = vec![(Mat::<f64>::zeros(size, size), 0.0); count];
    source.for_each_batch(|blocks| {
        let blocks = &*blocks;
        grams.par_iter_mut().zip(&ranges).enumerate().for_each(|(cluster, (gram, range))| {
            visit(cluster, blocks, &mut |columns: Columns| {
                let inside = product(range.transpose(), columns.b.as_ref());
                multiply_add(gram.0.as_mut(), 1.0, inside.as_ref(), inside.transpose());
                gram.1 += columns.energy();
            });
        });
        Ok(())
    })?;
    let mut sizes = vec![0; count];
    labels.iter().for_each(|&label| sizes[label] += width);
    let found = grams.par_iter().zip(&ranges).zip(&sizes).map(|((gram, range), &columns)| {
        let noise = Noise { variance, rows: poses.saturating_sub(1), columns };
        Ok(principal(gram.0.as_ref(), (gram.1, noise), range.as_ref(), outputs)?)
    });
    let mut parts = found.collect::<Result<Vec<Part>, Error>>()?;
    source.for_each_batch(|blocks| {
        let blocks = &*blocks;
        parts.par_iter_mut().enumerate().for_each(|(cluster, part)| {
            let (scores, unit) = (part.scores.clone(), inverse_squares(part.scores.as_ref()));
            visit(cluster, blocks, &mut |columns: Columns| {
                // V = BᵀU/s = Bᵀ·scores/s².
                let v = product(columns.b.transpose(), scores.as_ref());
                for (i, mean) in columns.mean.iter().enumerate() {
                    part.mean.push(*mean as f32);
                    part.directions.extend((0..unit.len()).map(|k| (v[(i, k)] * unit[k]) as f32));
                }
            });
        });
        Ok(())
    })?;
    Ok(parts)
}

/// 1/s² of every column.
fn inverse_squares(scores: MatRef<'_, f64>) -> Vec<f64> {
    let energy = |k: usize| scores.col(k).iter().map(|x| x * x).sum::<f64>();
    (0..scores.ncols()).map(|k| 1.0 / energy(k)).collect()
}

/// The kept components from QᵀB(QᵀB)ᵀ.
fn principal(
    gram: MatRef<'_, f64>,
    (energy, noise): (f64, Noise),
    range: MatRef<'_, f64>,
    outputs: Kept,
) -> Result<Part, crate::num::linalg::NoConvergence> {
    let (mut values, vectors) = symmetric_eigen(gram)?;
    // Below this a component is round-off of f32 data.
    let least = f64::from(f32::EPSILON).powi(2) * energy;
    values.truncate(values.iter().take_while(|&&value| value > least).count());
    let scores = Mat::zeros(range.nrows(), 0);
    let (mean, directions) = (Vec::new(), Vec::new());
    let mut part = Part { scores, mean, directions, energy, kept: 0.0, values, noise };
    let k = part.count(outputs);
    let u = product(range, vectors.subcols(0, k));
    part.scores = Mat::from_fn(u.nrows(), k, |i, j| u[(i, j)] * part.values[j].sqrt());
    part.kept = part.values[..k].iter().sum();
    Ok(part)
}

/// Some outputs of one cluster.
struct Columns {
    /// Their numbers, point · width + coefficient.
    outputs: Vec<usize>,
    mean: Vec<f64>,
    /// p × outputs, about the means.
    b: Mat<f64>,
}

impl Columns {
    fn energy(&self) -> f64 {
        self.b.col_iter().map(|c| c.iter().map(|x| x * x).sum::<f64>()).sum()
    }
}

/// Calls `work` with the outputs of a cluster in a block, some at a time, points ascending.
fn columns(
    block: &Block,
    poses: usize,
    width: usize,
    labels: &[usize],
    cluster: usize,
    work: &mut dyn FnMut(Columns),
) {
    let first = block.points.start;
    let members: Vec<usize> = block.points.clone().filter(|&p| labels[p] == cluster).collect();
    for members in members.chunks((COLUMNS / width).max(1)) {
        let outputs: Vec<usize> = members.iter().flat_map(|p| p * width..(p + 1) * width).collect();
        let value =
            |pose: usize, output: usize| f64::from(block.pose(pose, poses)[output - first * width]);
        let mean: Vec<f64> = outputs
            .iter()
            .map(|&o| (0..poses).map(|pose| value(pose, o)).sum::<f64>() / poses as f64)
            .collect();
        let b = Mat::from_fn(poses, outputs.len(), |i, j| value(i, outputs[j]) - mean[j]);
        work(Columns { outputs, mean, b });
    }
}
