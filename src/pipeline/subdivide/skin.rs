//! Weights of new vertices that keep them on the posed triangles they were made from.
//!
//! Skinning is bilinear in weights and positions: with the mean of its corners' weights a new vertex
//! is exact at rest and leaves the posed triangle elsewhere. Where it does so by more than a bound,
//! its weights are fitted: min over w of Σ over key poses ‖Σ_j w_j M_j p − x‖² with w ≥ 0, Σ w = 1,
//! x the place on the posed triangle.

use glam::Vec3;

use crate::pipeline::Job;
use crate::rig::{Deformed, Influence, Mesh, Mix, deform};

/// Steps of the projected gradient; each costs the square of a dozen joints at most.
const STEPS: usize = 300;

/// What moves the new vertices, and how far they leave the surface.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Skinned {
    /// Of each new vertex.
    pub(super) influences: Vec<Vec<Influence>>,
    /// Of each new vertex, metres, the most over the key poses.
    pub(super) deviations: Vec<f32>,
    /// How many were fitted.
    pub(super) fitted: usize,
}

/// Finds the influences of new vertices.
pub(super) fn bind(job: &Job, mixes: &[Mix], poses: &[usize], bound_m: f32) -> Skinned {
    let mesh = &job.scene.mesh;
    let mean: Vec<Vec<Influence>> = mixes.iter().map(|mix| mesh.mixed_influences(mix)).collect();
    let kept = |(mix, all): (&Mix, &Vec<Influence>)| trimmed(all.clone(), room(mesh, mix));
    let mut influences: Vec<Vec<Influence>> = mixes.iter().zip(&mean).map(kept).collect();
    let wanted = targets(job, mixes, poses);
    let mut deviations = deviations(job, mixes, &influences, poses, &wanted);
    let mut fitted = 0;
    let far: Vec<usize> = (0..mixes.len()).filter(|&i| deviations[i] > bound_m).collect();
    if !far.is_empty() {
        let list: Vec<Mix> = far.iter().map(|&i| mixes[i]).collect();
        let candidates: Vec<Vec<Influence>> = far.iter().map(|&i| mean[i].clone()).collect();
        let targets: Vec<Vec<Vec3>> =
            wanted.iter().map(|pose| far.iter().map(|&i| pose[i]).collect()).collect();
        let better = fit(job, &list, &candidates, poses, &targets);
        let after = self::deviations(job, &list, &better, poses, &targets);
        for ((i, weights), deviation) in far.into_iter().zip(better).zip(after) {
            // The least squares over poses may trade the largest deviation for a smaller sum.
            if deviation < deviations[i] {
                (influences[i], deviations[i]) = (weights, deviation);
                fitted += 1;
            }
        }
    }
    Skinned { influences, deviations, fitted }
}

/// At most four influences, or as many as the corners have.
fn room(mesh: &Mesh, mix: &Mix) -> usize {
    mix.parts().map(|(v, _)| mesh.influences_of(v).len()).max().unwrap_or(0).max(4)
}

/// The heaviest, summing to 1.
fn trimmed(mut influences: Vec<Influence>, most: usize) -> Vec<Influence> {
    influences.sort_by(|a, b| b.weight.total_cmp(&a.weight).then(a.deformer.cmp(&b.deformer)));
    influences.truncate(most);
    influences.retain(|one| one.weight > 0.0);
    let sum: f32 = influences.iter().map(|one| one.weight).sum();
    influences.iter_mut().for_each(|one| one.weight /= sum);
    influences
}

/// `[pose][vertex]` The places on the posed triangles.
fn targets(job: &Job, mixes: &[Mix], poses: &[usize]) -> Vec<Vec<Vec3>> {
    let one = |&pose: &usize| {
        let posed = job.deformed(pose);
        mixes.iter().map(|mix| mix.of(&posed.positions)).collect()
    };
    poses.iter().map(one).collect()
}

fn deviations(
    job: &Job,
    mixes: &[Mix],
    influences: &[Vec<Influence>],
    poses: &[usize],
    wanted: &[Vec<Vec3>],
) -> Vec<f32> {
    let mut most = vec![0.0_f32; mixes.len()];
    let new = job.scene.mesh.between(mixes, influences);
    for (&pose, wanted) in poses.iter().zip(wanted) {
        let placed = posed(job, &new, pose);
        for ((most, found), wanted) in most.iter_mut().zip(placed.positions).zip(wanted) {
            *most = most.max((found - *wanted).length());
        }
    }
    most
}

fn posed(job: &Job, mesh: &Mesh, pose: usize) -> Deformed {
    let sample = &job.poses.samples[pose];
    let globals = job.scene.skeleton.globals(&sample.pose.local);
    let mut out = Deformed::default();
    deform(mesh, &globals, &sample.pose.weights, sample.root, &mut out);
    out
}

/// Weights by least squares over the candidates' joints: on all of them, then on the heaviest.
fn fit(
    job: &Job,
    mixes: &[Mix],
    candidates: &[Vec<Influence>],
    poses: &[usize],
    wanted: &[Vec<Vec3>],
) -> Vec<Vec<Influence>> {
    let places = alone(job, mixes, candidates, poses);
    let mut start = 0;
    let one = |(i, list): (usize, &Vec<Influence>)| {
        let own = start..start + list.len();
        start = own.end;
        let columns: Vec<Vec<Vec3>> =
            own.map(|at| places.iter().map(|pose| pose[at]).collect()).collect();
        let target: Vec<Vec3> = wanted.iter().map(|pose| pose[i]).collect();
        let solve = |list: &[Influence], columns: &[Vec<Vec3>]| {
            let weights: Vec<f64> = list.iter().map(|one| f64::from(one.weight)).collect();
            let solved = simplex(columns, &target, weights);
            let with = |(one, weight): (&Influence, f64)| Influence {
                deformer: one.deformer,
                weight: weight as f32,
            };
            list.iter().zip(solved).map(with).collect::<Vec<_>>()
        };
        let kept = trimmed(solve(list, &columns), room(&job.scene.mesh, &mixes[i]));
        let column = |one: &Influence| {
            let at = list.iter().position(|other| other.deformer == one.deformer);
            columns[at.unwrap_or(0)].clone()
        };
        let columns: Vec<Vec<Vec3>> = kept.iter().map(column).collect();
        trimmed(solve(&kept, &columns), kept.len())
    };
    candidates.iter().enumerate().map(one).collect()
}

/// `[pose][vertex and joint]` Where each joint alone would take each vertex.
fn alone(
    job: &Job,
    mixes: &[Mix],
    candidates: &[Vec<Influence>],
    poses: &[usize],
) -> Vec<Vec<Vec3>> {
    let mut repeated = Vec::new();
    let mut single = Vec::new();
    for (mix, list) in mixes.iter().zip(candidates) {
        for one in list {
            repeated.push(*mix);
            single.push(vec![Influence { deformer: one.deformer, weight: 1.0 }]);
        }
    }
    let mesh = job.scene.mesh.between(&repeated, &single);
    poses.iter().map(|&pose| posed(job, &mesh, pose).positions).collect()
}

/// min ‖Σ_j w_j column_j − target‖² over the simplex, by projected gradients from `weights`.
fn simplex(columns: &[Vec<Vec3>], target: &[Vec3], mut weights: Vec<f64>) -> Vec<f64> {
    let n = columns.len();
    let dot = |a: &[Vec3], b: &[Vec3]| -> f64 {
        // About the target, so that large coordinates do not cancel.
        let both = a.iter().zip(b).zip(target);
        both.map(|((a, b), t)| (*a - *t).as_dvec3().dot((*b - *t).as_dvec3())).sum()
    };
    let gram: Vec<f64> = (0..n * n).map(|at| dot(&columns[at / n], &columns[at % n])).collect();
    let trace: f64 = (0..n).map(|i| gram[i * n + i]).sum();
    if trace <= 0.0 {
        return weights;
    }
    for _ in 0..STEPS {
        let slope = |i: usize| (0..n).map(|j| gram[i * n + j] * weights[j]).sum::<f64>();
        let moved: Vec<f64> = (0..n).map(|i| weights[i] - slope(i) / trace).collect();
        weights = onto_simplex(&moved);
    }
    weights
}

/// The nearest point with entries of 0 and more that sum to 1 (Duchi et al. 2008).
fn onto_simplex(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let (mut sum, mut shift) = (0.0, 0.0);
    for (count, value) in (1..).zip(&sorted) {
        sum += value;
        let candidate = (sum - 1.0) / f64::from(count);
        if *value > candidate {
            shift = candidate;
        }
    }
    values.iter().map(|value| (value - shift).max(0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The projection keeps what is on the simplex, and brings anything else to the nearest point.
    #[test]
    fn the_projection_is_the_nearest_point() {
        assert_eq!(onto_simplex(&[0.25, 0.75]), [0.25, 0.75]);
        assert_eq!(onto_simplex(&[2.0, 0.0]), [1.0, 0.0]);
        let projected = onto_simplex(&[0.6, 0.6, -1.0]);
        assert!(projected.iter().zip([0.5, 0.5, 0.0]).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    /// Weights that explain the target exactly are found; a target out of reach gets the corner that
    /// is nearest.
    #[test]
    fn least_squares_over_the_simplex() {
        let columns = vec![vec![Vec3::ZERO, Vec3::X], vec![Vec3::X, Vec3::Y], vec![Vec3::Y; 2]];
        let mixed: Vec<Vec3> = (0..2)
            .map(|pose| 0.2 * columns[0][pose] + 0.5 * columns[1][pose] + 0.3 * columns[2][pose])
            .collect();
        let weights = simplex(&columns, &mixed, vec![1.0 / 3.0; 3]);
        for (weight, expected) in weights.iter().zip([0.2, 0.5, 0.3]) {
            assert!((weight - expected).abs() < 1e-3, "{weights:?}");
        }
        let far = [Vec3::X * 9.0, Vec3::Y * 9.0];
        let weights = simplex(&columns, &far, vec![1.0 / 3.0; 3]);
        assert!(weights[1] > 0.999, "{weights:?}");
    }
}
