//! Which groups of spheres the points of a bone can do without telling apart.
//!
//! At first every bone's spheres are a group of their own. A weight for each of these at each point
//! is more than a model can hold, and more than some bones need: a finger is nothing to a foot. So
//! the points of every bone merge, again and again, the two groups whose weights they give up
//! telling apart at the least cost to the training data. What fewer groups see is the sum of what more saw.

use rayon::prelude::*;

use super::explained::{Explained, Placed, chunks_of};
use super::sums::{Moments, packed};
use super::{Source, chunk_sums};
use crate::fit::Error;

/// Groups that merging begins with, at most: those of the least energy begin as one.
const MOST_SOURCES: usize = 32;
/// Points of a bone that are asked, at most.
const POINTS_OF_BONE: usize = 48;
/// What holds a point's weights to those that the bone's points share, as a share of the features'
/// mean energy: enough that groups which hardly move are told apart by nothing but noise no more.
const PENALTY: f64 = 0.01;
/// Above 0 where nothing moves at all.
const LEAST: f64 = 1e-100;

/// `[bone]`: the moments of some of its points, by the groups of `placed`.
pub(super) fn of_bones(
    source: &Source<'_>,
    explained: &Explained<'_>,
    placed: &Placed,
) -> Result<Vec<Vec<Moments>>, Error> {
    let bones = &explained.geometry.bones;
    let groups = placed.occluders.groups(source.points());
    let mut of_bones: Vec<Vec<Moments>> = vec![Vec::new(); bones.nodes.len()];
    let asked = asked(&bones.of_point, bones.nodes.len());
    let one_fold = vec![0; source.poses()];
    source.map_fold(
        |block| {
            let points = block.points.clone();
            let some = points.clone().filter(|&p| asked[p]).map(|p| p - points.start).collect();
            let moved = explained.geometry.moved_range(points.clone());
            let mut found = Vec::new();
            for chunk in chunks_of(&bones.of_point[points], some) {
                let of_chunk = (&moved, &chunk);
                let sums = chunk_sums(block, explained, placed, of_chunk, (&one_fold, groups));
                found.extend(sums.iter().map(|folds| (chunk.bone, folds[0].about(&folds[0]))));
            }
            Ok(found)
        },
        |_, found| found.into_iter().for_each(|(bone, moments)| of_bones[bone].push(moments)),
    )?;
    Ok(of_bones)
}

/// `[bone][group]` → merged group, of which each bone has at most `most`. Those of fewer are merged of those of
/// more.
pub(super) fn sets_of_bones(of_bones: &[Vec<Moments>], most: usize) -> Vec<Vec<usize>> {
    of_bones.par_iter().map(|points| sets(points, most)).collect()
}

/// Puts merged groups in the place of those of `placed`, for so many points.
pub(super) fn regroup(placed: &mut Placed, sets: &[Vec<usize>], points: usize) {
    let spheres = placed.occluders.spheres();
    for (table, sets) in placed.occluders.group_of.chunks_exact_mut(spheres.max(1)).zip(sets) {
        for group in table {
            *group = sets.get(usize::from(*group)).map_or(0, |&set| set as u8);
        }
    }
    let count = placed.occluders.group_of.iter().max().map_or(0, |&most| usize::from(most) + 1);
    placed.occluders.weights = vec![1.0; points * count];
}

/// Point → whether it is asked: some of every bone's, evenly spread.
fn asked(bone_of_point: &[u16], bones: usize) -> Vec<bool> {
    let mut of_bones = vec![Vec::new(); bones];
    for (point, &bone) in bone_of_point.iter().enumerate() {
        of_bones[usize::from(bone)].push(point);
    }
    let mut asked = vec![false; bone_of_point.len()];
    for points in of_bones {
        let step = points.len().div_ceil(POINTS_OF_BONE).max(1);
        points.into_iter().step_by(step).for_each(|point| asked[point] = true);
    }
    asked
}

/// Group → merged group, of the points of one bone.
fn sets(points: &[Moments], most: usize) -> Vec<usize> {
    let mut set_of = by_energy(points);
    let count = set_of.iter().max().map_or(0, |most| most + 1);
    let mut sizes = vec![0.0; count];
    set_of.iter().for_each(|&set| sizes[set] += 1.0);
    let mut dense: Vec<Dense> = points.iter().map(|p| Dense::of(p, &set_of, count)).collect();
    while sizes.len() > most.max(1) && !dense.is_empty() {
        let (i, j) = cheapest(&dense, &sizes);
        dense.iter_mut().for_each(|point| point.merge(i, j));
        let joined = sizes.remove(j);
        sizes[i] += joined;
        for set in &mut set_of {
            *set = if *set == j { i } else { *set - usize::from(*set > j) };
        }
    }
    set_of
}

/// The groups of most energy apart, all others together.
fn by_energy(points: &[Moments]) -> Vec<usize> {
    let Some(first) = points.first() else { return Vec::new() };
    let mut energy = vec![0.0; first.cross.len()];
    for point in points {
        energy.iter_mut().zip(point.diagonal()).for_each(|(sum, own)| *sum += own);
    }
    let mut order: Vec<usize> = (0..energy.len()).collect();
    order.sort_by(|&a, &b| energy[b].total_cmp(&energy[a]));
    let mut set_of = vec![0; energy.len()];
    for (place, group) in order.into_iter().enumerate() {
        set_of[group] = place.min(MOST_SOURCES - 1);
    }
    set_of
}

/// The moments of a point, each set of groups summed to one feature.
struct Dense {
    n: usize,
    /// `[n, n]`.
    gram: Vec<f64>,
    cross: Vec<f64>,
}

impl Dense {
    fn of(moments: &Moments, set_of: &[usize], n: usize) -> Self {
        let (mut gram, mut cross) = (vec![0.0; n * n], vec![0.0; n]);
        for (g, &i) in set_of.iter().enumerate() {
            cross[i] += moments.cross[g];
            for (h, &j) in set_of.iter().enumerate().take(g + 1) {
                let value = moments.gram[packed(g) + h];
                gram[i * n + j] += value;
                if g != h {
                    gram[j * n + i] += value;
                }
            }
        }
        Self { n, gram, cross }
    }

    /// Makes set j part of set i, i < j.
    fn merge(&mut self, i: usize, j: usize) {
        let n = self.n;
        for k in 0..n {
            self.gram[i * n + k] += self.gram[j * n + k];
        }
        for k in 0..n {
            self.gram[k * n + i] += self.gram[k * n + j];
        }
        let keep = |at: &usize| at / n != j && at % n != j;
        self.gram = (0..n * n).filter(keep).map(|at| self.gram[at]).collect();
        let joined = self.cross.remove(j);
        self.cross[i] += joined;
        self.n -= 1;
    }

    /// (G + diag(penalty))⁻¹ and the weights that minimise the residual and the penalty.
    fn solve(&self, prior: &[f64], penalty: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let n = self.n;
        let mut inverse = self.gram.clone();
        penalty.iter().enumerate().for_each(|(i, p)| inverse[i * n + i] += p);
        invert(&mut inverse, n);
        let pulled: Vec<f64> = (0..n).map(|i| self.cross[i] + penalty[i] * prior[i]).collect();
        let weight = |row: &[f64]| -> f64 { row.iter().zip(&pulled).map(|(a, b)| a * b).sum() };
        let weights = inverse.chunks_exact(n).map(weight).collect();
        (inverse, weights)
    }
}

/// The two sets whose merging costs the points least: that a constraint w_i = w_j adds
/// (w_i − w_j)² / (A_ii + A_jj − 2 A_ij) to a least-squares residual, A the inverse of its matrix.
fn cheapest(points: &[Dense], sizes: &[f64]) -> (usize, usize) {
    let n = sizes.len();
    let trace = |point: &Dense| (0..n).map(|i| point.gram[i * n + i]).sum::<f64>();
    let total: f64 = points.iter().map(trace).sum();
    let scale = total / (n * points.len()) as f64;
    let of_size = |share: f64| -> Vec<f64> {
        sizes.iter().map(|size| (share * scale).max(LEAST) * size).collect()
    };
    let mut pooled = Dense { n, gram: vec![0.0; n * n], cross: vec![0.0; n] };
    for point in points {
        pooled.gram.iter_mut().zip(&point.gram).for_each(|(sum, x)| *sum += x);
        pooled.cross.iter_mut().zip(&point.cross).for_each(|(sum, x)| *sum += x);
    }
    let (_, prior) = pooled.solve(&vec![1.0; n], &of_size(PENALTY * points.len() as f64));
    let penalty = of_size(PENALTY);
    let mut costs = vec![0.0; n * n];
    for point in points {
        let (inverse, weights) = point.solve(&prior, &penalty);
        for i in 0..n {
            for j in i + 1..n {
                let apart = inverse[i * n + i] + inverse[j * n + j] - 2.0 * inverse[i * n + j];
                costs[i * n + j] += (weights[i] - weights[j]).powi(2) / apart;
            }
        }
    }
    let pairs = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
    let cost = |&(i, j): &(usize, usize)| costs[i * n + j];
    pairs.min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap_or((0, 1))
}

/// The inverse of a symmetric positive definite matrix, in place, by Gauss and Jordan.
fn invert(a: &mut [f64], n: usize) {
    for k in 0..n {
        let pivot = 1.0 / a[k * n + k];
        a[k * n + k] = 1.0;
        a[k * n..(k + 1) * n].iter_mut().for_each(|x| *x *= pivot);
        let row = a[k * n..(k + 1) * n].to_vec();
        for (i, other) in a.chunks_exact_mut(n).enumerate().filter(|(i, _)| *i != k) {
            debug_assert_ne!(i, k);
            let factor = std::mem::take(&mut other[k]);
            other.iter_mut().zip(&row).for_each(|(x, r)| *x -= factor * r);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sums::Sums;
    use super::*;
    use crate::num::random::Stream;

    /// The moments of points that see `weights` of as many independent features.
    fn points(weights: &[&[f32]]) -> Vec<Moments> {
        let mut stream = Stream::new(4);
        let groups = weights[0].len();
        let of_point = |weights: &&[f32]| {
            let mut sums = Sums::new(groups, 1);
            for _ in 0..40 {
                let features: Vec<f32> = (0..groups).map(|_| stream.normal() as f32).collect();
                let y: f32 = features.iter().zip(*weights).map(|(f, w)| f * w).sum();
                sums.add(&features, &[y + 0.01 * stream.normal() as f32]);
            }
            sums.about(&sums)
        };
        weights.iter().map(of_point).collect()
    }

    /// Proves that the inverse is one.
    #[test]
    fn inverses_invert() {
        let a = [4.0, 1.0, -0.5, 1.0, 3.0, 0.25, -0.5, 0.25, 2.0];
        let mut inverse = a.to_vec();
        invert(&mut inverse, 3);
        for i in 0..3 {
            for j in 0..3 {
                let found: f64 = (0..3).map(|k| a[i * 3 + k] * inverse[k * 3 + j]).sum();
                assert!((found - if i == j { 1.0 } else { 0.0 }).abs() < 1e-12, "{i} {j} {found}");
            }
        }
    }

    /// Proves that groups which every point weighs alike are merged first, that a group which only
    /// some points weigh differently stays apart, and that one set is left where one is asked for.
    #[test]
    fn what_is_weighed_alike_is_merged() {
        let points = points(&[&[0.9, 0.2, 0.9, 0.5], &[0.6, 0.1, 0.6, 1.4], &[0.7, 0.3, 0.7, 0.7]]);
        let three = sets(&points, 3);
        assert_eq!(three[0], three[2], "{three:?}");
        assert!(three[0] != three[1] && three[0] != three[3] && three[1] != three[3], "{three:?}");
        assert_eq!(sets(&points, 1), [0; 4]);
        let mut all = sets(&points, 9);
        all.sort_unstable();
        assert_eq!(all, [0, 1, 2, 3]);
        assert!(sets(&[], 3).is_empty());
    }

    /// Proves that features that never move, and more groups than merging begins with, still give
    /// as many sets as asked for.
    #[test]
    fn stillness_and_many_groups_merge_too() {
        let still = vec![Moments::zero(5); 3];
        assert_eq!(sets(&still, 2).into_iter().max(), Some(1));
        let weights: Vec<f32> = (0..50).map(|g| 0.1 * (g % 7) as f32).collect();
        let many = sets(&points(&[&weights, &weights]), 6);
        assert_eq!((many.len(), many.into_iter().max()), (50, Some(5)));
    }
}
