//! Proofs of the families as wholes, through [`super::fit`]: synthetic training sets, slow oracles.

mod edges;
mod extremes;
mod families;
mod frames;
mod freedom;
mod left_out;
mod local;
mod shared;
mod tangents;

use glam::Quat;

use super::{Family, Fitted, On, Ridge, Settings, fit};
use crate::dataset::{Training, TrainingParts};
use crate::model::{Decoder, Frame};
use crate::num::linalg::{Mat, symmetric_eigen};
use crate::num::random::Stream;

/// Sizes of a synthetic training set.
#[derive(Clone, Copy)]
struct Sizes {
    poses: usize,
    parameters: usize,
    points: usize,
    coefficients: usize,
}

/// A set whose outputs are linear in the parameters, plus `noise`; one bone, no clips.
fn synthetic(sizes: Sizes, noise: f64, seed: u64) -> TrainingParts {
    let Sizes { poses, parameters, points, coefficients } = sizes;
    let mut stream = Stream::new(seed);
    let x: Vec<f32> = (0..poses * parameters).map(|_| stream.normal() as f32).collect();
    let outputs = points * coefficients;
    let mean: Vec<f64> = (0..outputs).map(|_| 1.0 + stream.normal()).collect();
    let slope: Vec<f64> = (0..outputs * parameters).map(|_| stream.normal()).collect();
    let mut values = Vec::with_capacity(poses * outputs);
    for pose in 0..poses {
        for output in 0..outputs {
            let along =
                |j: usize| slope[output * parameters + j] * f64::from(x[pose * parameters + j]);
            let y = mean[output] + (0..parameters).map(along).sum::<f64>();
            values.push((y + noise * stream.normal()) as f32);
        }
    }
    TrainingParts {
        points,
        channels: 1,
        coefficients,
        bones: 1,
        parameters: x,
        parameter_names: (0..parameters).map(|j| format!("joint{j}.x")).collect(),
        clips: vec![0; poses],
        bone_rotations: vec![Quat::IDENTITY; poses],
        point_bones: vec![0; points],
        noise_variance: noise * noise,
        noise_of_points: Vec::new(),
        values,
    }
}

fn settings(family: Family) -> Settings {
    Settings { family, frame: Frame::Root, ridge: Ridge::LeaveOneOut, ..Settings::default() }
}

fn trained(family: Family) -> Settings {
    Settings { on: On::Trained, ..settings(family) }
}

fn run(parts: &TrainingParts, settings: &Settings) -> Fitted {
    fit(&Training::in_memory(parts.clone()), settings).unwrap()
}

/// What the fit says, in f64 and without the crate's evaluator.
fn predict(fitted: &Fitted, x: &[f32], coefficients: usize) -> Vec<f64> {
    match &fitted.decoder {
        Decoder::Mean { mean } => mean.iter().map(|&y| f64::from(y)).collect(),
        Decoder::Linear { mean, weights } => {
            let offsets: Vec<f64> = (x.iter().zip(&fitted.training.centre))
                .map(|(&x, &centre)| f64::from(x) - f64::from(centre))
                .collect();
            let along =
                |w: &[f32]| -> f64 { w.iter().zip(&offsets).map(|(&w, o)| f64::from(w) * o).sum() };
            let row = |i: usize| along(&weights[i * x.len()..(i + 1) * x.len()]);
            mean.iter().enumerate().map(|(i, &m)| f64::from(m) + row(i)).collect()
        }
        Decoder::PcaLinear { projection, coefficients: x_c, basis } => {
            let inputs = projection.len() / x.len();
            let mut features = vec![0.0; inputs];
            for (&x, row) in x.iter().zip(projection.chunks_exact(inputs)) {
                features.iter_mut().zip(row).for_each(|(f, &v)| *f += f64::from(x) * f64::from(v));
            }
            features.push(1.0);
            let outputs = x_c.len() / (coefficients * (inputs + 1));
            let weight = |c: usize, j: usize| -> f64 {
                let of = |k: usize| f64::from(x_c[(c * (inputs + 1) + k) * outputs + j]);
                features.iter().enumerate().map(|(k, f)| f * of(k)).sum()
            };
            let table: Vec<Vec<f64>> =
                (0..coefficients).map(|c| (0..outputs).map(|j| weight(c, j)).collect()).collect();
            let point = |row: &[f32]| -> Vec<f64> {
                let dot = |w: &Vec<f64>| w.iter().zip(row).map(|(w, &b)| w * f64::from(b)).sum();
                table.iter().map(dot).collect()
            };
            basis.chunks_exact(outputs).flat_map(point).collect()
        }
        Decoder::Multilinear(m) => local::multilinear(m, x, coefficients),
        Decoder::Clustered(c) => local::clustered(c, &fitted.training.centre, x, coefficients),
    }
}

/// The slow oracle: ridge with an unpenalised intercept by the normal equations in f64, their
/// singular part left out. `Fit[output] = (intercept, slopes)`.
struct Oracle {
    centre: Vec<f64>,
    mean: Vec<f64>,
    /// parameter × output.
    solution: Mat<f64>,
}

impl Oracle {
    /// Fits the poses `of`, on their first `inputs` principal directions.
    fn fit(parts: &TrainingParts, of: &[usize], alpha: f64, inputs: usize) -> Self {
        let a = parts.parameter_names.len();
        let n = parts.values.len() / parts.clips.len();
        let x = |i: usize, j: usize| f64::from(parts.parameters[of[i] * a + j]);
        let y = |i: usize, j: usize| f64::from(parts.values[of[i] * n + j]);
        let mean_of =
            |at: &dyn Fn(usize) -> f64| (0..of.len()).map(at).sum::<f64>() / of.len() as f64;
        let centre: Vec<f64> = (0..a).map(|j| mean_of(&|i| x(i, j))).collect();
        let mean: Vec<f64> = (0..n).map(|j| mean_of(&|i| y(i, j))).collect();
        let design = Mat::from_fn(of.len(), a, |i, j| x(i, j) - centre[j]);
        let outputs = Mat::from_fn(of.len(), n, |i, j| y(i, j) - mean[j]);
        let gram = design.transpose() * &design;
        let (values, vectors) = symmetric_eigen(gram.as_ref()).unwrap();
        let right = vectors.transpose() * (design.transpose() * outputs);
        let gain = |k: usize| match values[k] > 1e-12 * values[0] && k < inputs {
            true => 1.0 / (values[k] + alpha * alpha),
            false => 0.0,
        };
        let solution = &vectors * Mat::from_fn(a, n, |k, j| gain(k) * right[(k, j)]);
        Self { centre, mean, solution }
    }

    fn predict(&self, x: &[f32]) -> Vec<f64> {
        let along = |j: usize| -> f64 {
            let offset = |k: usize| f64::from(x[k]) - self.centre[k];
            (0..x.len()).map(|k| offset(k) * self.solution[(k, j)]).sum()
        };
        self.mean.iter().enumerate().map(|(j, m)| m + along(j)).collect()
    }

    /// RMSE over all poses, each predicted by a fit without its group.
    fn left_out_rmse(
        parts: &TrainingParts,
        groups: &[Vec<usize>],
        alpha: f64,
        inputs: usize,
    ) -> f64 {
        let (poses, a) = (parts.clips.len(), parts.parameter_names.len());
        let n = parts.values.len() / poses;
        let mut sum = 0.0;
        for group in groups {
            let rest: Vec<usize> = (0..poses).filter(|i| !group.contains(i)).collect();
            let oracle = Self::fit(parts, &rest, alpha, inputs);
            for &i in group {
                let predicted = oracle.predict(&parts.parameters[i * a..(i + 1) * a]);
                let truth = &parts.values[i * n..(i + 1) * n];
                let square = |(p, &y): (f64, &f32)| (p - f64::from(y)).powi(2);
                sum += predicted.into_iter().zip(truth).map(square).sum::<f64>();
            }
        }
        (sum / (poses * n) as f64).sqrt()
    }
}

/// Largest difference between a fit's predictions and `truth` over all training poses.
fn worst(parts: &TrainingParts, fitted: &Fitted, truth: impl Fn(usize) -> Vec<f64>) -> f64 {
    let a = parts.parameter_names.len();
    let difference = |pose: usize| {
        let x = &parts.parameters[pose * a..(pose + 1) * a];
        let predicted = predict(fitted, x, parts.channels * parts.coefficients);
        let pairs = predicted.into_iter().zip(truth(pose));
        pairs.map(|(p, y)| (p - y).abs()).fold(0.0, f64::max)
    };
    (0..parts.clips.len()).map(difference).fold(0.0, f64::max)
}

/// The outputs of one pose.
fn truth(parts: &TrainingParts, pose: usize) -> Vec<f64> {
    let n = parts.values.len() / parts.clips.len();
    parts.values[pose * n..(pose + 1) * n].iter().map(|&y| f64::from(y)).collect()
}
