//! Family `occluder`: what groups of spheres on the bones block at every point.
//!
//! Spheres are cut from the rest mesh ([`spheres`]), grouped by the skeleton ([`groups`]), and
//! weighted at every point by a ridge that shrinks towards weights which all points share. What
//! they leave over is any other family's to learn.

mod explained;
mod groups;
mod spheres;
mod sums;

use glam::Vec3;
use rayon::prelude::*;

pub(super) use explained::{Explained, Placed};

use super::folds::by_clip;
use super::geometry::Geometry;
use super::source::{Block, Source};
use super::{Error, OccluderReport, Ridge, Settings};
use crate::fit::On;
use crate::model::occluder::{ANCHORS, add, caps::LANES};
use crate::model::{Occluders, Signal};
use crate::sh::Order;
use explained::{Chunk, chunks};
use sums::{Moments, Sums};

/// Parts into which the training poses are cut to be left out, at most.
const MOST_FOLDS: usize = 6;
/// Penalties that are tried, as shares of the features' mean energy at a point: from next to
/// nothing to weights that all points share.
const PENALTIES: [f64; 13] =
    [1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1e4];

/// Points that penalties are tried at, at most.
const TRIED_POINTS: usize = 2048;

/// The moments of one point: of all poses, and for each fold those of the others and its own,
/// both about the means of the others.
struct PointMoments {
    all: Moments,
    folds: Vec<[Moments; 2]>,
}

/// Sums over all points, for the weights that they share.
struct Pooled {
    all: Moments,
    folds: Vec<Moments>,
}

/// Places the spheres of a mesh in all poses, with weights of 1.
pub(super) fn place(
    geometry: &Geometry<'_>,
    turns: &[glam::Quat],
    count: usize,
) -> Result<Placed, Error> {
    let spheres = spheres::cut(geometry, count)?;
    let bone_of_sphere: Vec<usize> = spheres
        .anchors
        .iter()
        .step_by(ANCHORS)
        .map(|&point| usize::from(geometry.bones.of_point[point as usize]))
        .collect();
    let (group_of, groups) = groups::table(&geometry.parents(), &bone_of_sphere);
    let occluders = Occluders {
        offsets: spheres.offsets.iter().flat_map(Vec3::to_array).collect(),
        radii: spheres.radii,
        group_of,
        weights: vec![1.0; geometry.points.count() * groups],
        anchors: spheres.anchors,
    };
    let moved = geometry.moved_points(&occluders.anchors);
    let bones = geometry.bones.nodes.len();
    // The anchors stand for themselves: the n-th of the list is point n of the moved ones.
    let of_anchor: Vec<u16> =
        occluders.anchors.iter().map(|&point| geometry.bones.of_point[point as usize]).collect();
    let own = Occluders {
        anchors: (0..occluders.anchors.len() as u32).collect(),
        weights: Vec::new(),
        ..occluders.clone()
    };
    let anchors = occluders.anchors.len().max(1);
    let centres = moved
        .positions
        .chunks_exact(anchors)
        .zip(turns.chunks_exact(bones))
        .flat_map(|(positions, turns)| own.centres(positions, &of_anchor, turns))
        .collect();
    Ok(Placed { occluders, centres })
}

/// Finds the weights of `placed` for the source's data, from which the unshadowed signal has been
/// taken, and tells how well they do.
pub(super) fn fit(
    source: &Source<'_>,
    placed: &mut Placed,
    clips: &[i32],
    settings: &Settings,
) -> Result<OccluderReport, Error> {
    let points = source.points();
    let explained = source.explained().ok_or(Error::NeedsGeometry)?;
    let groups = placed.occluders.groups(points);
    let fold_of_pose = folds(clips, settings);
    let count = fold_of_pose.iter().max().map_or(0, |most| most + 1);
    let mut pooled =
        Pooled { all: Moments::zero(groups), folds: vec![Moments::zero(groups); count] };
    let mut moments: Vec<PointMoments> = Vec::with_capacity(points);
    source.map_fold(
        |block| Ok(block_moments(block, explained, placed, &fold_of_pose, groups)),
        |_, of_block| {
            for point in of_block {
                pooled.all.merge(&point.all);
                let pairs = pooled.folds.iter_mut().zip(&point.folds);
                pairs.for_each(|(sum, [others, _])| sum.merge(others));
                moments.push(point);
            }
        },
    )?;
    let solver = Solver::new(&pooled, points, settings);
    let (penalty, left_out) = solver.choose(&moments);
    let weights: Vec<Vec<f64>> = moments
        .par_iter()
        .map(|point| solver.weights(&point.all, &solver.shared, penalty))
        .collect();
    let training: f64 =
        moments.iter().zip(&weights).map(|(point, weights)| point.all.residual(weights)).sum();
    placed.occluders.weights = weights.iter().flatten().map(|&w| w as f32).collect();
    placed.occluders = std::mem::take(&mut placed.occluders).in_eight_bits(points);
    let numbers = (source.poses() * points * source.width()) as f64;
    Ok(OccluderReport {
        spheres: placed.occluders.spheres(),
        groups,
        penalty,
        shared: solver.shared.clone(),
        left_out_rmse: left_out.map(|energy| (energy / numbers).sqrt()),
        training_rmse: (training / numbers).sqrt(),
        spread_rms: (pooled.all.square / numbers).sqrt(),
    })
}

/// The fold of every pose; one fold where nothing can be left out.
fn folds(clips: &[i32], settings: &Settings) -> Vec<usize> {
    let mut fold_of_pose = vec![0; clips.len()];
    if settings.on == On::Trained || matches!(settings.ridge, Ridge::Fixed(_)) {
        return fold_of_pose;
    }
    let (groups, _) = by_clip(clips);
    let most = MOST_FOLDS.min(groups.len());
    for (i, group) in groups.iter().enumerate() {
        group.iter().for_each(|&pose| fold_of_pose[pose] = i * most / groups.len());
    }
    fold_of_pose
}

/// The moments of a block's points, in their order.
fn block_moments(
    block: &Block,
    explained: &Explained<'_>,
    placed: &Placed,
    fold_of_pose: &[usize],
    groups: usize,
) -> Vec<PointMoments> {
    let points = block.points.len();
    let moved = explained.geometry.moved_range(block.points.clone());
    let bones = &explained.geometry.bones.of_point[block.points.clone()];
    let mut out: Vec<Option<PointMoments>> = Vec::new();
    out.resize_with(points, || None);
    for chunk in chunks(bones) {
        let sums = chunk_sums(block, explained, placed, (&moved, &chunk), (fold_of_pose, groups));
        for (sums, &point) in sums.iter().zip(&chunk.points[..chunk.count]) {
            out[point] = Some(point_moments(sums));
        }
    }
    out.into_iter().map(|point| point.expect("chunks hold every point")).collect()
}

/// `[lane][fold]`.
fn chunk_sums(
    block: &Block,
    explained: &Explained<'_>,
    placed: &Placed,
    (moved, chunk): (&super::geometry::Moved, &Chunk),
    (fold_of_pose, groups): (&[usize], usize),
) -> Vec<Vec<Sums>> {
    let (poses, points) = (fold_of_pose.len(), block.points.len());
    let kind: (Signal, Order) = explained.kind;
    let count = kind.0.coefficients(kind.1);
    let width = block.values.len() / (poses * points);
    let folds = fold_of_pose.iter().max().map_or(0, |most| most + 1);
    let mut sums = vec![vec![Sums::new(groups, count); folds]; chunk.count];
    let mut features = vec![[0.0; LANES]; groups * count];
    let (mut row, mut outputs) = (vec![0.0; groups * count], vec![0.0; count]);
    for (pose, &fold) in fold_of_pose.iter().enumerate() {
        features.fill([0.0; LANES]);
        explained.blocked(placed, moved, pose, chunk, points, |view, group| {
            // Blocked: what is taken away.
            add(view, kind, &[-1.0; LANES], &mut features[group * count..(group + 1) * count]);
        });
        let values = block.pose(pose, poses);
        for (lane, sums) in sums.iter_mut().enumerate() {
            row.iter_mut().zip(&features).for_each(|(x, lanes)| *x = lanes[lane]);
            let channels = &values[chunk.points[lane] * width..][..width];
            let share = count as f32 / width as f32;
            outputs.fill(0.0);
            for channel in channels.chunks_exact(count) {
                outputs.iter_mut().zip(channel).for_each(|(sum, x)| *sum += share * x);
            }
            sums[fold].add(&row, &outputs);
        }
    }
    sums
}

fn point_moments(folds: &[Sums]) -> PointMoments {
    let merged = |skip: Option<usize>| {
        let mut some = folds.iter().enumerate().filter(|(i, _)| Some(*i) != skip).map(|(_, f)| f);
        let first = some.next().cloned();
        first.map(|mut sum| {
            some.for_each(|fold| sum.merge(fold));
            sum
        })
    };
    let all = merged(None).expect("at least one fold");
    let tried = |(i, fold): (usize, &Sums)| {
        let others = merged(Some(i))?;
        Some([others.about(&others), fold.about(&others)])
    };
    PointMoments {
        all: all.about(&all),
        folds: folds.iter().enumerate().filter_map(tried).collect(),
    }
}

/// What all points share in solving for their weights.
struct Solver {
    /// Weights that all points share.
    shared: Vec<f64>,
    /// The same without each fold.
    shared_folds: Vec<Vec<f64>>,
    /// Mean energy of a group's features at a point.
    scale: f64,
    fixed: Option<f64>,
}

impl Solver {
    fn new(pooled: &Pooled, points: usize, settings: &Settings) -> Self {
        let groups = pooled.all.cross.len();
        let energy = pooled.all.diagonal();
        let scale = energy.iter().sum::<f64>() / groups.max(1) as f64;
        // A little towards "blocks as it is" for all groups alike: one that hardly moves, such as
        // a stiff limb's own, would otherwise take any weight that its noise suggests.
        let trace = vec![1e-3 * scale + f64::MIN_POSITIVE; groups];
        let share = |moments: &Moments| moments.solve(&vec![1.0; groups], &trace);
        let fixed = match (settings.on, settings.ridge) {
            (On::Trained, _) => Some(PENALTIES[0]),
            (On::Novel, Ridge::Fixed(alpha)) => Some(alpha),
            (On::Novel, _) => None,
        };
        Self {
            shared: share(&pooled.all),
            shared_folds: pooled.folds.iter().map(share).collect(),
            scale: scale / points.max(1) as f64,
            fixed,
        }
    }

    fn weights(&self, moments: &Moments, prior: &[f64], penalty: f64) -> Vec<f64> {
        moments.solve(prior, &vec![penalty * self.scale; prior.len()])
    }

    /// The penalty that predicts left-out poses best, and the energy that it leaves of them.
    fn choose(&self, moments: &[PointMoments]) -> (f64, Option<f64>) {
        if let Some(fixed) = self.fixed {
            return (fixed, None);
        }
        if moments.first().is_none_or(|point| point.folds.is_empty()) {
            return (1.0, None);
        }
        let energy = |penalty: f64, step: usize| -> f64 {
            let of_point = |point: &PointMoments| -> f64 {
                let folds = point.folds.iter().zip(&self.shared_folds);
                folds
                    .map(|([others, own], shared)| {
                        own.residual(&self.weights(others, shared, penalty))
                    })
                    .sum()
            };
            // Collected first: the order of a sum must not depend on the threads.
            moments.par_iter().step_by(step).map(of_point).collect::<Vec<f64>>().iter().sum()
        };
        // One penalty for all points: some of them say which.
        let step = moments.len().div_ceil(TRIED_POINTS).max(1);
        let tried = PENALTIES.map(|penalty| (penalty, energy(penalty, step)));
        let best = tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        best.map_or((1.0, None), |(penalty, _)| (penalty, Some(energy(penalty, 1))))
    }
}

#[cfg(test)]
mod tests;
