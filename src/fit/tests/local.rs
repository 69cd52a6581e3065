//! The families of AO07 and RPO09, by what they become at their limits.

use super::*;
use crate::fit::{ClusteredSizes, Error, Kept, MultilinearSizes, PointClusters};
use crate::model::{Clustered, Form, Multilinear};

const SIZES: Sizes = Sizes { poses: 40, parameters: 5, points: 13, coefficients: 4 };

/// What a multilinear model says, in f64: the nearest centres count as AO07 eq. 5 has it.
pub(super) fn multilinear(m: &Multilinear, x: &[f32], width: usize) -> Vec<f64> {
    let f = |x: f32| f64::from(x);
    let (a, clusters) = (x.len(), m.centres.len() / x.len());
    let inner = m.inputs + usize::from(m.intercepts);
    let offset = |j: usize, i: usize| f(x[i]) - f(m.centres[j * a + i]);
    let distance = |j: usize| (0..a).map(|i| offset(j, i).powi(2)).sum::<f64>().sqrt().max(1e-9);
    let least = (0..clusters).map(distance).fold(f64::INFINITY, f64::min);
    let share = |j: usize| (least / distance(j)).powf(f(m.blend_exponent));
    let raw: Vec<f64> = (0..clusters).map(share).collect();
    let rows = m.coefficients.len() / (clusters * width * inner);
    let points = if m.row_of_point.is_empty() { rows } else { m.row_of_point.len() / clusters };
    let output = |at: usize| {
        let (point, c) = (at / width, at % width);
        let of = |j: usize| {
            let row = m.row_of_point.get(j * points + point).map_or(point, |&row| row as usize);
            let weights = &m.coefficients[((row * clusters + j) * width + c) * inner..][..inner];
            let along = |k: usize| -> f64 {
                (0..a)
                    .map(|i| f(m.projection[(i * clusters + j) * m.inputs + k]) * offset(j, i))
                    .sum()
            };
            let sum: f64 = (0..m.inputs).map(|k| f(weights[k]) * along(k)).sum();
            raw[j] * (sum + weights.get(m.inputs).map_or(0.0, |&w| f(w)))
        };
        let mean = m.mean.get(at).map_or(0.0, |&mean| f(mean));
        mean + (0..clusters).map(of).sum::<f64>() / raw.iter().sum::<f64>()
    };
    (0..points * width).map(output).collect()
}

/// What a clustered model says, features in f32.
pub(super) fn clustered(m: &Clustered, centre: &[f32], x: &[f32], width: usize) -> Vec<f64> {
    let d = m.projection.len() / x.len();
    let along = |k: usize| -> f32 {
        (0..x.len()).map(|i| m.projection[i * d + k] * (x[i] - centre[i])).sum()
    };
    let reduced: Vec<f32> = (0..d).map(along).collect();
    let mut out = vec![0.0; m.cluster_of_point.len() * width];
    let mut seen = vec![0; m.clusters.len()];
    for (point, out) in out.chunks_exact_mut(width).enumerate() {
        let label = m.cluster_of_point[point] as usize;
        let cluster = &m.clusters[label];
        let mut features = m.form.features(&reduced, &cluster.hidden);
        features.push(1.0);
        let sum = |row: &[f32]| row.iter().zip(&features).map(|(w, x)| w * x).sum::<f32>();
        let mut z: Vec<f32> = cluster.weights.chunks_exact(features.len()).map(sum).collect();
        z.push(1.0);
        let rows = cluster.basis.chunks_exact(z.len()).skip(seen[label] * width);
        for (out, row) in out.iter_mut().zip(rows) {
            *out = row.iter().zip(&z).map(|(b, z)| f64::from(b * z)).sum();
        }
        seen[label] += 1;
    }
    out
}

pub(super) fn multilinear_family(clusters: usize, inputs: usize, points: PointClusters) -> Family {
    let (published, blend_exponent) = (false, 10.0);
    Family::Multilinear(MultilinearSizes { clusters, inputs, points, published, blend_exponent })
}

pub(super) fn clustered_family(form: Form, clusters: usize) -> Family {
    let (inputs, outputs) = (Kept::Share(1.0), Kept::Share(1.0));
    let (clusters, neurons) = (Some(clusters), Some(6));
    Family::Clustered(ClusteredSizes { form, clusters, inputs, outputs, neurons })
}

/// Root mean square of the fit on its own poses.
pub(super) fn rmse(parts: &TrainingParts, fitted: &Fitted) -> f64 {
    let a = parts.parameter_names.len();
    let errors = |pose: usize| -> f64 {
        let x = &parts.parameters[pose * a..(pose + 1) * a];
        let found = predict(fitted, x, parts.channels * parts.coefficients);
        found.iter().zip(truth(parts, pose)).map(|(y, t)| (y - t).powi(2)).sum()
    };
    let poses = parts.clips.len();
    let numbers = poses * parts.points * parts.channels * parts.coefficients;
    ((0..poses).map(errors).sum::<f64>() / numbers as f64).sqrt()
}

fn in_root(family: Family) -> Settings {
    Settings { frame: Frame::Root, ..trained(family) }
}

/// With one cluster and every dimension, each is the linear model.
#[test]
fn one_cluster_is_linear() {
    let parts = synthetic(SIZES, 0.3, 5);
    let linear = run(&parts, &in_root(Family::Linear));
    let families =
        [multilinear_family(1, 5, PointClusters::None), clustered_family(Form::Linear, 1)];
    for family in families {
        let fitted = run(&parts, &in_root(family));
        assert!((fitted.report.training_rmse - linear.report.training_rmse).abs() < 1e-5);
        for pose in 0..SIZES.poses {
            let x = &parts.parameters[pose * 5..(pose + 1) * 5];
            let pairs = predict(&fitted, x, 4).into_iter().zip(predict(&linear, x, 4));
            pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-4, "{a} {b}"));
        }
    }
}

/// Error on the training poses falls with pose clusters, dimensions and clusters of points, and a
/// pose cluster for every pose reproduces the data (AO07 table 1).
#[test]
fn multilinear_error_falls_with_every_size() {
    let parts = synthetic(SIZES, 0.3, 6);
    let error = |clusters, inputs, points| {
        rmse(&parts, &run(&parts, &in_root(multilinear_family(clusters, inputs, points))))
    };
    let none = PointClusters::None;
    assert!(error(4, 2, none) < error(1, 2, none));
    assert!(error(1, 4, none) < error(1, 2, none));
    let shared = [2, 6, 13].map(|count| error(2, 2, PointClusters::Count(count)));
    assert!(shared.is_sorted_by(|a, b| a > b), "{shared:?}");
    assert!((shared[2] - error(2, 2, none)).abs() < 1e-6);
    assert!(error(SIZES.poses, 1, none) < 1e-6);
}

/// As published every centre gives the mean of all poses; with intercepts, the mean of its own.
#[test]
fn centres_give_their_means() {
    let parts = synthetic(SIZES, 0.3, 7);
    for published in [false, true] {
        let mut family = multilinear_family(3, 2, PointClusters::None);
        if let Family::Multilinear(sizes) = &mut family {
            sizes.published = published;
        }
        let fitted = run(&parts, &in_root(family));
        let mean = run(&parts, &in_root(Family::Mean));
        let Decoder::Multilinear(m) = &fitted.decoder else { panic!("not multilinear") };
        let overall = predict(&mean, &m.centres[..5], 4);
        for centre in m.centres.chunks_exact(5) {
            let found = predict(&fitted, centre, 4);
            let off = found.iter().zip(&overall).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert_eq!(off < 1e-5, published, "{off}");
        }
    }
}

/// On a signal that is a smoothed step of the pose, quadratic beats linear and neurons beat both
/// (RPO09 figure 6), and the reported error is the real one.
#[test]
fn neurons_fit_a_step() {
    let mut parts = synthetic(SIZES, 0.0, 8);
    let a = parts.parameter_names.len();
    for (i, y) in parts.values.iter_mut().enumerate() {
        let (pose, output) = (i / (13 * 4), i % (13 * 4));
        let x = parts.parameters[pose * a] + 0.3 * parts.parameters[pose * a + 1];
        *y = 0.5 + (1.0 + 0.01 * output as f32) * (4.0 * x).tanh();
    }
    let errors = [Form::Linear, Form::Quadratic, Form::Tanh].map(|form| {
        let fitted = run(&parts, &in_root(clustered_family(form, 1)));
        let error = rmse(&parts, &fitted);
        assert!((error - fitted.report.training_rmse).abs() < 1e-3 * (1.0 + error), "{form:?}");
        error
    });
    assert!(errors[1] < errors[0] && errors[2] < 0.5 * errors[1], "{errors:?}");
}

/// More clusters than poses or points, dimensions above rank, and numbers out of range are
/// refused.
#[test]
fn impossible_sizes_are_refused() {
    let parts = synthetic(SIZES, 0.3, 9);
    let refuse = |family| fit(&Training::in_memory(parts.clone()), &in_root(family)).unwrap_err();
    let none = PointClusters::None;
    assert!(matches!(refuse(multilinear_family(41, 2, none)), Error::Clusters { asked: 41, .. }));
    assert!(matches!(refuse(multilinear_family(2, 6, none)), Error::Inputs { available: 5, .. }));
    let many = PointClusters::Count(14);
    assert!(matches!(refuse(multilinear_family(2, 2, many)), Error::Clusters { asked: 14, .. }));
    let nan = PointClusters::Threshold(f64::NAN);
    assert!(matches!(refuse(multilinear_family(2, 2, nan)), Error::Number { .. }));
    let refused = refuse(clustered_family(Form::Linear, 14));
    assert!(matches!(refused, Error::Clusters { asked: 14, .. }));
}
