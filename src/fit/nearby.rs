//! Family `linear` with a prior on which joints may matter to which points.
//!
//! A ridge learns links between a point and whatever moved at the same time, however far away. What occludes a
//! point is what comes near it: so each bone's points are fitted to parameters x scaled by exp(−d/ℓ), which is a
//! prior of that deviation on their weights. d is how near the two sides of the parameter's joint come to the
//! bone's points, the side with the points against the other: the least distance over the training poses.
//! α is chosen for each bone.

use glam::Vec3;

use super::design::Design;
use super::report::Clock;
use super::ridge::{Regression, summary};
use super::source::Source;
use super::{Error, FitReport, Fitted, Geometry, Settings, linear};
use crate::dataset::{Training, TrainingParts};
use crate::model::Decoder;

/// Points of a bone whose distances are measured, at most.
const POINTS: usize = 24;

/// Training poses at which they are, at most.
const POSES: usize = 12;

/// A link below this share of the full prior counts as left out, for the report.
const WEAK: f64 = 0.05;

/// Means and weights of the outputs of some points.
type Numbers = (Vec<f32>, Vec<f32>);

/// Fits every bone's points by themselves. `share` is ℓ as a share of the mesh's size.
pub(super) fn fit(
    training: &Training<'_>,
    design: &Design,
    geometry: &Geometry<'_>,
    (share, settings): (f64, &Settings),
    clock: &mut Clock,
) -> Result<Fitted, Error> {
    let priors = priors(geometry, share);
    clock.lap("distances_s");
    let (columns, width) = (design.centre.len(), training.channels() * training.coefficients());
    let mut mean = vec![0.0; training.points() * width];
    let mut weights = vec![0.0; mean.len() * columns];
    let mut parts = Vec::new();
    for (bone, prior) in priors.iter().enumerate() {
        let of_bone = |&point: &u32| training.point_bones()[point as usize] as usize == bone;
        let points: Vec<u32> = (0..training.points() as u32).filter(of_bone).collect();
        if points.is_empty() {
            continue;
        }
        let (part, own) = of_points(training, design, (&points, prior), settings, clock)?;
        let rows = part.1.chunks_exact((width * columns).max(1));
        for ((&point, mean_of), weights_of) in
            points.iter().zip(part.0.chunks_exact(width)).zip(rows)
        {
            let first = point as usize * width;
            mean[first..first + width].copy_from_slice(mean_of);
            weights[first * columns..(first + width) * columns].copy_from_slice(weights_of);
        }
        parts.push((points.len(), own));
    }
    let report = report(design, &parts, &priors);
    let training = summary(design, design.rank(), true);
    Ok(Fitted { decoder: Decoder::Linear { mean, weights }, occluders: None, training, report })
}

/// Means and weights of some points on one bone, and how their fit went.
fn of_points(
    training: &Training<'_>,
    design: &Design,
    (points, prior): (&[u32], &[f64]),
    settings: &Settings,
    clock: &mut Clock,
) -> Result<(Numbers, FitReport), Error> {
    let names = training.parameter_names();
    // The model subtracts the centre in f32.
    let centre: Vec<f32> = design.centre.iter().map(|&c| c as f32).collect();
    let rows = training.parameters().chunks_exact(names.len().max(1));
    let scaled = rows.flat_map(|row| {
        let scales = row.iter().zip(&centre).zip(prior);
        scales.map(|((x, c), w)| (f64::from(x - c) * w) as f32)
    });
    let parameters: Vec<f32> = scaled.collect();
    let own = Design::new(&parameters, names, training.poses())?;
    let parts = TrainingParts { parameters, ..training.parts_at(points)? };
    let own_training = Training::in_memory(parts);
    let source = Source::new(&own_training, settings.frame, None)?;
    let regression = Regression::new(&own, training.clips(), settings);
    let fitted = linear::fit(&source, &regression, clock)?;
    let Decoder::Linear { mut mean, mut weights } = fitted.decoder else {
        unreachable!("the family linear has a linear decoder")
    };
    let shift: Vec<f64> = own.centre.iter().map(|&c| f64::from(c as f32)).collect();
    for (mean, row) in mean.iter_mut().zip(weights.chunks_exact_mut(names.len().max(1))) {
        let moved: f64 = row.iter().zip(&shift).map(|(w, c)| f64::from(*w) * c).sum();
        *mean = (f64::from(*mean) - moved) as f32;
        row.iter_mut().zip(prior).for_each(|(w, scale)| *w = (f64::from(*w) * scale) as f32);
    }
    Ok(((mean, weights), fitted.report))
}

/// Of every bone the prior deviation of each parameter's weight, at most 1.
fn priors(geometry: &Geometry<'_>, share: f64) -> Vec<Vec<f64>> {
    let (apart, size) = distances(geometry);
    let scale = share * f64::from(size).max(f64::MIN_POSITIVE);
    let nodes = &geometry.bones.nodes;
    let is_below = |node: usize, joint: usize| {
        let mut next = Some(node);
        while let Some(node) = next.filter(|&node| node > joint) {
            next = geometry.skeleton.nodes[node].parent;
        }
        next == Some(joint)
    };
    let one = |bone: usize, joint: usize| {
        let side = is_below(nodes[bone], joint);
        let others = (0..nodes.len()).filter(|&other| is_below(nodes[other], joint) != side);
        let nearest = others.map(|other| apart[bone][other]).fold(f32::INFINITY, f32::min);
        (-f64::from(nearest) / scale).exp()
    };
    let row = |bone: usize| {
        let of_column = |joint: &Option<usize>| joint.map_or(1.0, |joint| one(bone, joint));
        geometry.columns.iter().map(of_column).collect()
    };
    (0..nodes.len()).map(row).collect()
}

/// The least distance of the points of two bones over some of the training poses, and the size of the mesh at
/// rest.
fn distances(geometry: &Geometry<'_>) -> (Vec<Vec<f32>>, f32) {
    let bones = geometry.bones.nodes.len();
    let mut of_bone: Vec<Vec<u32>> = vec![Vec::new(); bones];
    for (point, &bone) in geometry.bones.of_point.iter().enumerate() {
        of_bone[usize::from(bone)].push(point as u32);
    }
    let mut starts = vec![0];
    let mut some = Vec::new();
    for points in &of_bone {
        some.extend(points.iter().step_by(points.len().div_ceil(POINTS).max(1)).copied());
        starts.push(some.len());
    }
    let moved = geometry.moved_points(&some);
    let poses: Vec<&[Vec3]> = moved.positions.chunks_exact(some.len().max(1)).collect();
    let mut apart = vec![vec![f32::INFINITY; bones]; bones];
    for pose in poses.iter().step_by(poses.len().div_ceil(POSES).max(1)) {
        for a in 0..bones {
            for b in 0..a {
                let others = &pose[starts[b]..starts[b + 1]];
                let pairs = pose[starts[a]..starts[a + 1]].iter();
                let pairs = pairs.flat_map(|p| others.iter().map(move |q| p.distance(*q)));
                let least = pairs.fold(apart[a][b], f32::min);
                (apart[a][b], apart[b][a]) = (least, least);
            }
        }
    }
    let rest = geometry.rest().positions;
    let low = rest.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let high = rest.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    (apart, (high - low).length())
}

/// One report of those of all bones; each has so many points.
fn report(design: &Design, parts: &[(usize, FitReport)], priors: &[Vec<f64>]) -> FitReport {
    let all = parts.iter().map(|(points, _)| *points as f64).sum::<f64>().max(1.0);
    let mean = |of: &dyn Fn(&FitReport) -> f64| {
        parts.iter().map(|(points, report)| *points as f64 * of(report)).sum::<f64>() / all
    };
    let rms = |of: &dyn Fn(&FitReport) -> f64| mean(&|report| of(report).powi(2)).sqrt();
    let links = || priors.iter().flatten();
    let weak = links().filter(|&&prior| prior < WEAK).count();
    let mut report = FitReport {
        left_out: parts.first().map_or(String::new(), |(_, report)| report.left_out.clone()),
        training_rmse: rms(&|report| report.training_rmse),
        spread_rms: rms(&|report| report.spread_rms),
        degrees_of_freedom: mean(&|report| report.degrees_of_freedom),
        inputs: design.rank(),
        pose_spectrum: design.variances(),
        output_variance_retained: 1.0,
        passes: parts.len(),
        ..FitReport::default()
    };
    report.notices.push(format!(
        "{weak} of {} links between parameters and bones hardly count, since what the joint moves stays far \
         away; alpha was chosen for each of {} bones",
        links().count(),
        parts.len()
    ));
    report
}

#[cfg(test)]
#[path = "nearby_tests.rs"]
mod tests;
