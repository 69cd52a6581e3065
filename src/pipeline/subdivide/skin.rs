//! Weights of new vertices that keep them on the posed triangles they were made from.
//!
//! Skinning is bilinear in weights and positions: with the mean of its corners' weights a new vertex
//! is exact at rest and leaves the posed triangle elsewhere. Where it does so by more than a bound,
//! its weights are fitted: min over w of the largest ‖Σ_j w_j M_j p − x‖ over key poses with w ≥ 0,
//! Σ w = 1, x the place on the posed triangle, by least squares whose poses are weighed by what is
//! left of them (Lawson 1961), over the joints of its corners and of the triangles around them.
//! What no such weights reach stays where the mean has it, or as near as they come: the corners of an
//! edge that turn against one another by θ leave a chord that no blend of their motions passes through.

use std::collections::HashMap;

use glam::Vec3;

use super::smooth::Shape;
use super::together;
use crate::pipeline::Job;
use crate::rig::{Deformed, Influence, Mesh, Mix, deform};

/// Steps of the projected gradient; each costs the square of a dozen joints at most.
const STEPS: usize = 100;

/// Times that the poses are weighed anew.
const ROUNDS: usize = 24;

/// Joints that a fit looks at.
const MOST_CANDIDATES: usize = 12;

/// New vertices on curved triangles that are no farther apart are one place, in sizes of the character.
const SAME_PLACE: f32 = 1e-5;

/// How far a new vertex leaves the surface.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Off {
    /// Metres, the most over the key poses.
    pub(super) most_m: f32,
    /// Which of them that is.
    pub(super) pose: usize,
}

/// What moves the new vertices, and how far they leave the surface.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Skinned {
    /// Of each new vertex.
    pub(super) influences: Vec<Vec<Influence>>,
    /// Of each new vertex.
    pub(super) deviations: Vec<Off>,
    /// How many were fitted.
    pub(super) fitted: usize,
}

/// Finds the influences of new vertices, the same for all that are one place.
pub(super) fn bind(
    job: &Job,
    (mixes, shape): (&[Mix], &Shape),
    poses: &[usize],
    bound_m: f32,
) -> Skinned {
    let mesh = &job.scene.mesh;
    let places = together::places(mesh);
    let near_m = SAME_PLACE * job.poses.size_m;
    let first = together::firsts(&places, mixes, &shape.moved(mesh, mixes), near_m);
    let own: Vec<usize> = (0..mixes.len()).filter(|&i| first[i] == i).collect();
    let of_own: Vec<Mix> = own.iter().map(|&i| mixes[i]).collect();
    let bound = bind_each(job, (&of_own, &shape.of(&own)), &places, (poses, bound_m));
    let at = |i: &usize| own.partition_point(|own| own < i);
    Skinned {
        influences: first.iter().map(|i| bound.influences[at(i)].clone()).collect(),
        deviations: first.iter().map(|i| bound.deviations[at(i)]).collect(),
        fitted: first.iter().filter(|i| bound.is_fitted[at(i)]).count(),
    }
}

/// Of each new vertex what moves it, how far it leaves the surface, and whether it was fitted.
struct Bound {
    influences: Vec<Vec<Influence>>,
    deviations: Vec<Off>,
    is_fitted: Vec<bool>,
}

fn bind_each(
    job: &Job,
    (mixes, shape): (&[Mix], &Shape),
    places: &[u32],
    (poses, bound_m): (&[usize], f32),
) -> Bound {
    let mesh = &job.scene.mesh;
    let mean: Vec<Vec<Influence>> = mixes.iter().map(|mix| mesh.mixed_influences(mix)).collect();
    let kept = |(mix, all): (&Mix, &Vec<Influence>)| trimmed(all.clone(), room(mesh, mix));
    let mut influences: Vec<Vec<Influence>> = mixes.iter().zip(&mean).map(kept).collect();
    let wanted = targets(job, (mixes, shape), poses);
    let moved = shape.moved(mesh, mixes);
    let mut deviations = deviations(job, (mixes, &moved), &influences, poses, &wanted);
    let mut is_fitted = vec![false; mixes.len()];
    let far: Vec<usize> = (0..mixes.len()).filter(|&i| deviations[i].most_m > bound_m).collect();
    if !far.is_empty() {
        let around = Around::new(mesh, places);
        let list: Vec<Mix> = far.iter().map(|&i| mixes[i]).collect();
        let moved: Vec<Vec3> = far.iter().filter_map(|&i| moved.get(i).copied()).collect();
        let list = (&list[..], &moved[..]);
        let candidates: Vec<Vec<Influence>> =
            far.iter().map(|&i| around.candidates(mesh, &mixes[i], &mean[i])).collect();
        let targets: Vec<Vec<Vec3>> =
            wanted.iter().map(|pose| far.iter().map(|&i| pose[i]).collect()).collect();
        let better = fit(job, list, &candidates, poses, &targets);
        let after = self::deviations(job, list, &better, poses, &targets);
        for ((i, weights), deviation) in far.into_iter().zip(better).zip(after) {
            if deviation.most_m < deviations[i].most_m {
                (influences[i], deviations[i]) = (weights, deviation);
                is_fitted[i] = true;
            }
        }
    }
    Bound { influences, deviations, is_fitted }
}

/// The joints of the triangles around each place.
struct Around<'a> {
    places: &'a [u32],
    joints: HashMap<u32, Vec<u32>>,
}

impl<'a> Around<'a> {
    fn new(mesh: &Mesh, places: &'a [u32]) -> Self {
        let mut joints: HashMap<u32, Vec<u32>> = HashMap::new();
        for triangle in &mesh.triangles {
            let of_all = triangle.iter().flat_map(|&v| mesh.influences_of(v as usize));
            let all: Vec<u32> = of_all.map(|influence| influence.deformer).collect();
            for &vertex in triangle {
                let own = joints.entry(places[vertex as usize]).or_default();
                own.extend(&all);
                own.sort_unstable();
                own.dedup();
            }
        }
        Self { places, joints }
    }

    /// The corners' own with their mean weights, then those around them with none.
    fn candidates(&self, mesh: &Mesh, mix: &Mix, mean: &[Influence]) -> Vec<Influence> {
        let mut all = mean.to_vec();
        // Of a rigid part nothing else may take hold.
        if mix.parts().all(|(vertex, _)| mesh.influences_of(vertex).len() == 1) && mean.len() == 1 {
            return all;
        }
        let around = mix.parts().filter_map(|(vertex, _)| self.joints.get(&self.places[vertex]));
        for &deformer in around.flatten() {
            if all.iter().all(|one| one.deformer != deformer) {
                all.push(Influence { deformer, weight: 0.0 });
            }
        }
        all.truncate(MOST_CANDIDATES.max(mean.len()));
        all
    }
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
fn targets(job: &Job, (mixes, shape): (&[Mix], &Shape), poses: &[usize]) -> Vec<Vec<Vec3>> {
    let one = |&pose: &usize| {
        let Deformed { positions, normals } = job.deformed(pose);
        let place = |(i, mix)| shape.place(i, mix, &positions, &normals);
        mixes.iter().enumerate().map(place).collect()
    };
    poses.iter().map(one).collect()
}

fn deviations(
    job: &Job,
    (mixes, moved): (&[Mix], &[Vec3]),
    influences: &[Vec<Influence>],
    poses: &[usize],
    wanted: &[Vec<Vec3>],
) -> Vec<Off> {
    let mut most = vec![Off::default(); mixes.len()];
    let new = between(&job.scene.mesh, mixes, influences, moved);
    for (&pose, wanted) in poses.iter().zip(wanted) {
        let placed = posed(job, &new, pose);
        for ((most, found), wanted) in most.iter_mut().zip(placed.positions).zip(wanted) {
            let off_m = (found - *wanted).length();
            if off_m > most.most_m {
                *most = Off { most_m: off_m, pose };
            }
        }
    }
    most
}

/// New vertices alone, each as far from its place between others as `moved` says, where it says that.
fn between(mesh: &Mesh, mixes: &[Mix], influences: &[Vec<Influence>], moved: &[Vec3]) -> Mesh {
    let mut new = mesh.between(mixes, influences);
    new.positions.iter_mut().zip(moved).for_each(|(position, moved)| *position += *moved);
    new
}

fn posed(job: &Job, mesh: &Mesh, pose: usize) -> Deformed {
    let sample = &job.poses.samples[pose];
    let globals = job.scene.skeleton.globals(&sample.pose.local);
    let mut out = Deformed::default();
    deform(mesh, &globals, &sample.pose.weights, sample.root, &mut out);
    out
}

/// Weights over the candidates' joints: of all of them, then of the heaviest.
fn fit(
    job: &Job,
    (mixes, moved): (&[Mix], &[Vec3]),
    candidates: &[Vec<Influence>],
    poses: &[usize],
    wanted: &[Vec<Vec3>],
) -> Vec<Vec<Influence>> {
    let places = alone(job, (mixes, moved), candidates, poses);
    let mut start = 0;
    let one = |(i, list): (usize, &Vec<Influence>)| {
        let own = start..start + list.len();
        start = own.end;
        let columns: Vec<Vec<Vec3>> =
            own.map(|at| places.iter().map(|pose| pose[at]).collect()).collect();
        let target: Vec<Vec3> = wanted.iter().map(|pose| pose[i]).collect();
        let solve = |list: &[Influence], columns: &[Vec<Vec3>]| {
            let weights: Vec<f64> = list.iter().map(|one| f64::from(one.weight)).collect();
            let solved = minimax(columns, &target, weights);
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
    (mixes, moved): (&[Mix], &[Vec3]),
    candidates: &[Vec<Influence>],
    poses: &[usize],
) -> Vec<Vec<Vec3>> {
    let (mut repeated, mut away, mut single) = (Vec::new(), Vec::new(), Vec::new());
    for (i, (mix, list)) in mixes.iter().zip(candidates).enumerate() {
        for one in list {
            repeated.push(*mix);
            away.extend(moved.get(i));
            single.push(vec![Influence { deformer: one.deformer, weight: 1.0 }]);
        }
    }
    let mesh = between(&job.scene.mesh, &repeated, &single, &away);
    poses.iter().map(|&pose| posed(job, &mesh, pose).positions).collect()
}

/// min over the simplex of the largest ‖Σ_j w_j column_j − target‖ over the poses: the best of some
/// rounds of least squares, each weighing the poses by what the one before left of them.
fn minimax(columns: &[Vec<Vec3>], target: &[Vec3], start: Vec<f64>) -> Vec<f64> {
    let mut shares = vec![1.0 / target.len().max(1) as f64; target.len()];
    let mut best = (f64::INFINITY, start.clone());
    let mut weights = start;
    for _ in 0..ROUNDS {
        weights = simplex(columns, target, &shares, weights);
        let left = left(columns, target, &weights);
        let most = left.iter().copied().fold(0.0, f64::max);
        if most < best.0 {
            best = (most, weights.clone());
        }
        shares.iter_mut().zip(&left).for_each(|(share, left)| *share *= left);
        let sum: f64 = shares.iter().sum();
        if sum <= 0.0 {
            break;
        }
        shares.iter_mut().for_each(|share| *share /= sum);
    }
    best.1
}

/// ‖Σ_j w_j column_j − target‖ of each pose.
fn left(columns: &[Vec<Vec3>], target: &[Vec3], weights: &[f64]) -> Vec<f64> {
    let one = |(pose, target): (usize, &Vec3)| {
        let terms = columns.iter().zip(weights).map(|(column, &weight)| {
            // About the target, so that large coordinates do not cancel.
            (column[pose] - *target).as_dvec3() * weight
        });
        terms.sum::<glam::DVec3>().length()
    };
    target.iter().enumerate().map(one).collect()
}

/// min Σ over poses of share · ‖Σ_j w_j column_j − target‖² over the simplex, by projected gradients
/// with momentum (Beck and Teboulle 2009, restarted as O'Donoghue and Candès 2015) from `weights`.
fn simplex(
    columns: &[Vec<Vec3>],
    target: &[Vec3],
    shares: &[f64],
    mut weights: Vec<f64>,
) -> Vec<f64> {
    let n = columns.len();
    let dot = |a: &[Vec3], b: &[Vec3]| -> f64 {
        let both = a.iter().zip(b).zip(target).zip(shares);
        both.map(|(((a, b), t), s)| s * (*a - *t).as_dvec3().dot((*b - *t).as_dvec3())).sum()
    };
    let gram: Vec<f64> = (0..n * n).map(|at| dot(&columns[at / n], &columns[at % n])).collect();
    // No eigenvalue is larger.
    let most = gram.iter().map(|x| x * x).sum::<f64>().sqrt();
    if most <= 0.0 {
        return weights;
    }
    let (mut ahead, mut pace) = (weights.clone(), 1.0_f64);
    for _ in 0..STEPS {
        let slope = |i: usize| (0..n).map(|j| gram[i * n + j] * ahead[j]).sum::<f64>();
        let moved: Vec<f64> = (0..n).map(|i| ahead[i] - slope(i) / most).collect();
        let next = onto_simplex(&moved);
        let turned = (0..n).map(|i| (ahead[i] - next[i]) * (next[i] - weights[i])).sum::<f64>();
        // Where the momentum leads uphill it is given up.
        let faster =
            if turned > 0.0 { 1.0 } else { (1.0 + (1.0 + 4.0 * pace * pace).sqrt()) / 2.0 };
        let momentum = if turned > 0.0 { 0.0 } else { (pace - 1.0) / faster };
        ahead = (0..n).map(|i| next[i] + momentum * (next[i] - weights[i])).collect();
        (weights, pace) = (next, faster);
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
        let weights = simplex(&columns, &mixed, &[0.5; 2], vec![1.0 / 3.0; 3]);
        for (weight, expected) in weights.iter().zip([0.2, 0.5, 0.3]) {
            assert!((weight - expected).abs() < 1e-3, "{weights:?}");
        }
        let far = [Vec3::X * 9.0, Vec3::Y * 9.0];
        let weights = simplex(&columns, &far, &[0.5; 2], vec![1.0 / 3.0; 3]);
        assert!(weights[1] > 0.999, "{weights:?}");
    }

    /// Joints that move almost alike, as a twist's do: the fit is still within a hundredth of the best of
    /// all weights in steps of 1/200.
    #[test]
    fn nearly_parallel_joints_are_told_apart() {
        let mut random = crate::num::random::Stream::new(3);
        let mut any = || Vec3::from_array([0, 1, 2].map(|_| random.normal() as f32));
        for _ in 0..5 {
            let base: Vec<Vec3> = (0..4).map(|_| any()).collect();
            let near = |any: &mut dyn FnMut() -> Vec3| -> Vec<Vec3> {
                base.iter().map(|at| *at + 0.03 * any()).collect()
            };
            let columns = vec![near(&mut any), near(&mut any), near(&mut any)];
            let mix = |pose: usize| -> Vec3 {
                [0.7, 0.1, 0.2].iter().zip(&columns).map(|(w, column)| *w * column[pose]).sum()
            };
            let target: Vec<Vec3> = (0..4).map(|pose| mix(pose) + 0.004 * any()).collect();
            let most = |w: &[f64]| left(&columns, &target, w).into_iter().fold(0.0, f64::max);
            let fitted = most(&minimax(&columns, &target, vec![1.0 / 3.0; 3]));
            let mut best = f64::INFINITY;
            for a in 0..=200 {
                for b in 0..=200 - a {
                    let w = [a, b, 200 - a - b].map(|share| f64::from(share) / 200.0);
                    best = best.min(most(&w));
                }
            }
            assert!(fitted < 1.01 * best, "{fitted} where {best} is possible");
        }
    }

    /// The largest distance is what is made small: of a pose seen three times and one seen once, least
    /// squares favours the many, the other lies in the middle of both.
    #[test]
    fn the_largest_deviation_counts() {
        let columns = vec![vec![Vec3::ZERO; 4], vec![Vec3::X; 4]];
        let target = [Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::X];
        let squares = simplex(&columns, &target, &[0.25; 4], vec![0.5; 2]);
        assert!((squares[0] - 0.75).abs() < 1e-3, "{squares:?}");
        let fitted = minimax(&columns, &target, vec![0.5; 2]);
        let most = |w: &[f64]| left(&columns, &target, w).into_iter().fold(0.0, f64::max);
        assert!(most(&fitted) < 0.51 && most(&squares) > 0.74, "{fitted:?}");
    }
}
