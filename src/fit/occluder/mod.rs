//! Family `occluder`: what groups of spheres on the bones block at every point.
//!
//! Spheres are cut from the rest mesh ([`spheres`]), grouped by bones ([`groups`]), of which the
//! points of each bone tell apart those that matter to them ([`merge`]), and weighted at every point
//! by a ridge that shrinks towards weights which the bone's points share ([`solver`]). What they
//! leave over is any other family's to learn.

mod balls;
mod blocked;
mod explained;
mod groups;
mod merge;
mod sight;
mod solver;
mod spheres;
mod sums;

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

pub(super) use explained::{Explained, Placed};

use super::folds::by_clip;
use super::geometry::Geometry;
use super::shared::Outputs;
use super::source::{Block, Source};
use super::{Error, OccluderReport, Ridge, Settings, Shared};
use crate::fit::On;
use crate::model::occluder::{ANCHORS, caps::LANES, sky::Sky};
use crate::model::{Occluders, Signal};
use crate::sh::Order;
use blocked::{Seen, Weighing, Work};
use explained::{Chunk, chunks};
pub(super) use sight::Sight;
use solver::Solver;
pub use spheres::Inscribed;
pub(super) use spheres::{Proxy, cut};
use sums::{Moments, Sums};

/// Parts into which the training poses are cut to be left out, at most.
const MOST_FOLDS: usize = 6;
/// The moments of one point: of all poses, and for each fold those of the others and its own,
/// both about the means of the others.
#[derive(Debug, Clone)]
struct PointMoments {
    bone: usize,
    all: Moments,
    folds: Vec<[Moments; 2]>,
}

/// Places the spheres of a mesh in all poses, with weights of 1.
fn place(
    geometry: &Geometry<'_>,
    turns: &[glam::Quat],
    (count, directions): (usize, usize),
    inscribed: &Inscribed,
) -> Result<Placed, Error> {
    let proxy = if directions > 0 { Proxy::Ellipsoid } else { Proxy::Sphere };
    let spheres = cut(inscribed, count, proxy)?;
    let bone_of_sphere: Vec<usize> = spheres
        .anchors
        .iter()
        .step_by(ANCHORS)
        .map(|&point| usize::from(geometry.bones.of_point[point as usize]))
        .collect();
    let (group_of, groups) = groups::finest(&geometry.parents(), &bone_of_sphere);
    let occluders = Occluders {
        offsets: spheres.offsets.iter().flat_map(Vec3::to_array).collect(),
        radii: spheres.radii,
        shapes: spheres.shapes,
        directions,
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
    let mut placed = Placed { occluders, centres: Vec::new(), ellipsoids: Vec::new(), sky: None };
    for (positions, turns) in moved.positions.chunks_exact(anchors).zip(turns.chunks_exact(bones)) {
        if directions > 0 {
            placed.ellipsoids.extend(own.ellipsoids(positions, &of_anchor, turns));
        } else {
            placed.centres.extend(own.centres(positions, &of_anchor, turns));
        }
    }
    let kind = (geometry.signal, geometry.order);
    placed.sky = (directions > 0).then(|| Arc::new(Sky::new(directions, kind)));
    Ok(placed)
}

/// Spheres in all poses with the weights that they have in the source's data, from which the unshadowed signal has
/// been taken, and how well they do. What the points see is shared with fits of other numbers of groups.
pub(super) fn fit(
    source: &Source<'_>,
    (geometry, turns): (&Geometry<'_>, &[glam::Quat]),
    clips: &[i32],
    settings: &Settings,
    shared: &Shared,
) -> Result<(Placed, OccluderReport), Error> {
    let largest = shared.largest().map_or(0, |largest| largest.groups);
    let most = largest.max(settings.groups);
    let seen = shared.seen(Outputs::of(&Settings { groups: most, ..*settings }), || {
        let sizes = (settings.spheres.unwrap_or_default(), settings.directions);
        let placed = place(geometry, turns, sizes, &*shared.inscribed(geometry)?)?;
        Sight::new(source, placed, &folds(clips, settings), (most, largest > 0))
    })?;
    let seen = seen.of_groups(settings.groups);
    let mut placed = seen.placed.clone();
    let report = weigh(source, &mut placed, &seen.moments, settings)?;
    Ok((placed, report))
}

/// Finds the weights of `placed`.
fn weigh(
    source: &Source<'_>,
    placed: &mut Placed,
    moments: &[PointMoments],
    settings: &Settings,
) -> Result<OccluderReport, Error> {
    let points = source.points();
    let explained = source.explained().ok_or(Error::NeedsGeometry)?;
    let groups = placed.occluders.groups(points);
    let sizes = (groups, explained.geometry.bones.nodes.len());
    let solver = Solver::new(moments, sizes, source.noise_variance(), settings);
    let (penalty, left_out) = solver.choose(moments);
    let weights: Vec<Vec<f64>> =
        moments.par_iter().map(|point| solver.weights_of(point, penalty)).collect();
    let training: f64 =
        moments.iter().zip(&weights).map(|(point, weights)| point.all.residual(weights)).sum();
    placed.occluders.weights = weights.iter().flatten().map(|&w| w as f32).collect();
    placed.occluders = std::mem::take(&mut placed.occluders).in_eight_bits(points);
    let numbers = (source.poses() * points * source.width()) as f64;
    Ok(OccluderReport {
        spheres: placed.occluders.spheres(),
        groups,
        penalty,
        left_out_rmse: left_out.map(|energy| (energy / numbers).sqrt()),
        training_rmse: (training / numbers).sqrt(),
        spread_rms: (moments.iter().map(|point| point.all.square).sum::<f64>() / numbers).sqrt(),
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
            out[point] = Some(point_moments(chunk.bone, sums));
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
    let mut work = Work::new(placed, groups);
    let (mut row, mut outputs) = (vec![0.0; groups * count], vec![0.0; count]);
    // Sums are about the first pose: single precision would lose what moves little beside what is large.
    let mut firsts: Vec<Option<(Vec<f32>, Vec<f32>)>> = vec![None; chunk.count];
    for (pose, &fold) in fold_of_pose.iter().enumerate() {
        features.fill([0.0; LANES]);
        let seen = Seen { moved, pose, chunk, points };
        explained.blocked(placed, &seen, &Weighing::Groups, &mut work, &mut features);
        let values = block.pose(pose, poses);
        for (lane, sums) in sums.iter_mut().enumerate() {
            // Blocked: what is taken away.
            row.iter_mut().zip(&features).for_each(|(x, lanes)| *x = -lanes[lane]);
            let channels = &values[chunk.points[lane] * width..][..width];
            let share = count as f32 / width as f32;
            outputs.fill(0.0);
            for channel in channels.chunks_exact(count) {
                outputs.iter_mut().zip(channel).for_each(|(sum, x)| *sum += share * x);
            }
            let (row_0, outputs_0) =
                firsts[lane].get_or_insert_with(|| (row.clone(), outputs.clone()));
            row.iter_mut().zip(row_0).for_each(|(x, first)| *x -= *first);
            outputs.iter_mut().zip(outputs_0).for_each(|(y, first)| *y -= *first);
            sums[fold].add(&row, &outputs);
        }
    }
    sums
}

fn point_moments(bone: usize, folds: &[Sums]) -> PointMoments {
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
        bone,
        all: all.about(&all),
        folds: folds.iter().enumerate().filter_map(tried).collect(),
    }
}

#[cfg(test)]
mod tests;
