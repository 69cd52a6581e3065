//! Family `multilinear` (AO07): k-means of the poses, and around each centre a ridge on the
//! principal components of its own poses.

use rayon::prelude::*;

use super::design::{Design, Filter};
use super::k_means::k_means;
use super::moments::{Absorber, Moments, Scratch};
use super::point_clusters::{drop_intercepts, share, subtract};
use super::report::Clock;
use super::ridge::{Regression, summary};
use super::source::{Block, Source};
use super::{Error, FitReport, Fitted, Settings, Shared};
use crate::dataset::Training;
use crate::model::{Decoder, Multilinear};
use crate::num::linalg::rows_of_mut;

/// Directions of all poses that are kept for the distance to them, at most: every pose cluster has
/// directions of its own, and these are only for that.
const MOST_DIRECTIONS: usize = 16;

/// The sizes of a multilinear model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MultilinearSizes {
    /// Pose clusters, from 1 to the number of poses.
    pub clusters: usize,
    /// Pose dimensions of each, from 1 to the rank of the centred parameters; a cluster of fewer
    /// uses what it has.
    pub inputs: usize,
    /// Whether points share coefficients.
    pub points: PointClusters,
    /// Without intercepts, as AO07 prints it: every centre then gives the mean of all poses.
    pub published: bool,
    /// α of the blend, 0 to 100; 10 in AO07.
    pub blend_exponent: f64,
}

/// Whether points share coefficients, in each pose cluster apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PointClusters {
    /// Every point has its own.
    None,
    /// This many clusters of points, from 1 to the number of points.
    Count(usize),
    /// As many as it takes until no point is farther than this from the mean of its cluster: root
    /// mean square over the poses of the pose cluster and the coefficients, units of the signal.
    Threshold(f64),
}

/// The poses of one cluster.
#[derive(Debug)]
pub(super) struct Local {
    pub(super) design: Design,
    clips: Vec<i32>,
    pub(super) poses: Vec<usize>,
}

/// What a block of points gives for one pose cluster.
struct Part {
    /// `[output]`.
    mean: Vec<f64>,
    /// `[output, d]`.
    c: Vec<f32>,
    moments: Moments,
}

/// The shape of the coefficients, `[point, pose cluster, width, inner]`.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    pub(super) clusters: usize,
    pub(super) width: usize,
    pub(super) inputs: usize,
    pub(super) inner: usize,
}

impl Layout {
    pub(super) fn at(&self, output: usize, cluster: usize) -> usize {
        let (point, c) = (output / self.width, output % self.width);
        ((point * self.clusters + cluster) * self.width + c) * self.inner
    }
}

pub(super) fn fit(
    (source, training, design): (&Source<'_>, &Training<'_>, &Design),
    sizes: MultilinearSizes,
    settings: &Settings,
    shared: &Shared,
    clock: &mut Clock,
) -> Result<Fitted, Error> {
    check(design, source, &sizes)?;
    let locals = shared.locals(training.parameter_names(), sizes.clusters, || {
        locals(training, design, &sizes, settings.seed)
    })?;
    let locals = &**locals;
    clock.lap("pose_clusters_s");
    let regressions: Vec<Regression<'_>> =
        locals.iter().map(|l| Regression::new(&l.design, &l.clips, settings)).collect();
    let (inputs, width) = (sizes.inputs, source.width());
    // The offset of each cluster is needed to compare points, so it is gathered in any case.
    let layout = Layout { clusters: locals.len(), width, inputs, inner: inputs + 1 };
    let outputs = source.points() * width;
    let absorbers: Vec<Absorber<'_>> = regressions.iter().map(Regression::absorber).collect();
    let mut moments: Vec<Moments> = regressions.iter().map(Regression::moments).collect();
    let mut coefficients = vec![0.0_f32; outputs * layout.clusters * layout.inner];
    let (mut mean, mut spread) = (Vec::with_capacity(outputs), 0.0);
    source.map_fold(
        |block| {
            let parts = locals.iter().zip(&regressions).zip(&absorbers);
            let parts: Vec<Part> =
                parts.map(|((l, r), a)| absorb(block, source.poses(), l, r, a, inputs)).collect();
            Ok((super::mean::moments(block, source.poses()), parts))
        },
        |_, ((means, deviations), parts)| {
            for (j, part) in parts.iter().enumerate() {
                moments[j].merge(&part.moments);
                for (i, c) in part.c.chunks_exact(inputs).enumerate() {
                    let at = layout.at(mean.len() + i, j);
                    coefficients[at..at + inputs].copy_from_slice(c);
                    coefficients[at + inputs] = part.mean[i] as f32;
                }
            }
            mean.extend(means.iter().map(|&x| x as f32));
            spread += deviations;
        },
    )?;
    clock.lap("pass_s");
    let filters = choose(&regressions, &moments, inputs)?;
    let mut energy: f64 = locals
        .iter()
        .zip(&moments)
        .zip(&filters)
        .map(|((l, m), f)| m.training_energy(&l.design, &f.left(&l.design.s)))
        .sum();
    scale(&mut coefficients, locals, &filters, layout);
    clock.lap("ridge_s");
    let mut model = Multilinear {
        blend_exponent: sizes.blend_exponent as f32,
        inputs,
        intercepts: !sizes.published,
        centres: locals.iter().flat_map(|l| l.design.centre.iter().map(|&x| x as f32)).collect(),
        projection: projection(locals, design.centre.len(), inputs),
        mean: Vec::new(),
        coefficients,
        row_of_point: Vec::new(),
    };
    if sizes.points != PointClusters::None || sizes.published {
        subtract(&mut model.coefficients, &mean, layout);
        model.mean = mean;
    }
    energy += share(&mut model, locals, &filters, sizes.points, layout);
    if sizes.published {
        energy += drop_intercepts(&mut model, locals, layout);
    }
    clock.lap("point_clusters_s");
    let report = report(design, &regressions, &filters, (energy, spread), source);
    let training = summary(design, design.rank().min(MOST_DIRECTIONS), true);
    Ok(Fitted { decoder: Decoder::Multilinear(model), occluders: None, training, report })
}

fn check(design: &Design, source: &Source<'_>, sizes: &MultilinearSizes) -> Result<(), Error> {
    let (available, poses) = (design.rank(), design.poses());
    if !(1..=available).contains(&sizes.inputs) {
        return Err(Error::Inputs { asked: sizes.inputs, poses, available });
    }
    let clusters = |what, asked: usize, available: usize| match (1..=available).contains(&asked) {
        true => Ok(()),
        false => Err(Error::Clusters { what, asked, available }),
    };
    clusters("pose clusters", sizes.clusters, poses)?;
    if let PointClusters::Count(asked) = sizes.points {
        clusters("clusters of points", asked, source.points())?;
    }
    if let PointClusters::Threshold(found) = sizes.points
        && !(found.is_finite() && found >= 0.0)
    {
        return Err(Error::Number { what: "threshold of point clusters", found });
    }
    let found = sizes.blend_exponent;
    if !(0.0..=100.0).contains(&found) {
        return Err(Error::Number { what: "exponent of the blend", found });
    }
    Ok(())
}

/// K-means of the poses, and the principal components of each cluster.
fn locals(
    training: &Training<'_>,
    design: &Design,
    sizes: &MultilinearSizes,
    seed: u64,
) -> Result<Vec<Local>, Error> {
    let a = design.centre.len();
    let rows: Vec<f64> = (training.parameters().iter().enumerate())
        .map(|(i, &x)| f64::from(x) - design.centre[i % a])
        .collect();
    let labels = k_means(&rows, a, sizes.clusters, seed);
    let count = labels.iter().max().map_or(0, |&label| label + 1);
    let local = |cluster: usize| {
        let poses: Vec<usize> = (0..labels.len()).filter(|&pose| labels[pose] == cluster).collect();
        let row = |&pose: &usize| training.parameters()[pose * a..(pose + 1) * a].iter().copied();
        let parameters: Vec<f32> = poses.iter().flat_map(row).collect();
        let design = Design::new(&parameters, training.parameter_names(), poses.len())?;
        let clips = poses.iter().map(|&pose| training.clips()[pose]).collect();
        Ok(Local { design, clips, poses })
    };
    (0..count).map(local).collect()
}

fn absorb(
    block: &Block,
    poses: usize,
    local: &Local,
    regression: &Regression<'_>,
    absorber: &Absorber<'_>,
    inputs: usize,
) -> Part {
    let (r, p) = (local.design.rank(), local.poses.len());
    let columns = block.values.len() / poses;
    let mut part = Part {
        mean: vec![0.0; columns],
        c: vec![0.0; columns * inputs],
        moments: regression.moments(),
    };
    let step = regression.columns();
    let mut scratch = Scratch::default();
    let (mut b, mut c) = (Vec::new(), Vec::new());
    for first in (0..columns).step_by(step) {
        let n = step.min(columns - first);
        let mean = &mut part.mean[first..first + n];
        let row = |pose: usize| &block.pose(local.poses[pose], poses)[first..first + n];
        for pose in 0..p {
            mean.iter_mut().zip(row(pose)).for_each(|(sum, &x)| *sum += f64::from(x));
        }
        mean.iter_mut().for_each(|sum| *sum /= p as f64);
        b.clear();
        for i in 0..p {
            let values = row(absorber.pose(i)).iter().zip(&*mean);
            b.extend(values.map(|(&x, mean)| f64::from(x) - mean));
        }
        c.resize(r * n, 0.0);
        let c_rows = rows_of_mut(&mut c, r, n);
        absorber.absorb(rows_of_mut(&mut b, p, n), c_rows, &mut part.moments, &mut scratch);
        for (j, row) in c.chunks_exact(n).take(inputs).enumerate() {
            for (i, &x) in row.iter().enumerate() {
                part.c[(first + i) * inputs + j] = x as f32;
            }
        }
    }
    part
}

/// Each cluster's own α.
fn choose(
    regressions: &[Regression<'_>],
    moments: &[Moments],
    inputs: usize,
) -> Result<Vec<Filter>, Error> {
    let choices = regressions.par_iter().zip(moments);
    choices
        .map(|(regression, moments)| {
            let inputs = inputs.min(regression.design.rank());
            Ok(regression.choose(moments, inputs)?.filter)
        })
        .collect()
}

/// Turns each C into weights of the projected pose, diag(f) C, and moves the intercepts to where the
/// rounded centre is.
fn scale(coefficients: &mut [f32], locals: &[Local], filters: &[Filter], layout: Layout) {
    let gains: Vec<Vec<(f64, f64)>> = (locals.iter().zip(filters))
        .map(|(local, filter)| {
            let moved = local.design.rounding(local.design.rank());
            filter.gains(&local.design.s).into_iter().zip(moved).collect()
        })
        .collect();
    let per_point = layout.clusters * layout.width * layout.inner;
    coefficients.par_chunks_mut(per_point).for_each(|point| {
        let clusters = point.chunks_exact_mut(layout.width * layout.inner).zip(&gains);
        for (cluster, gains) in clusters {
            for row in cluster.chunks_exact_mut(layout.inner) {
                let mut offset = f64::from(row[layout.inputs]);
                for (k, x) in row[..layout.inputs].iter_mut().enumerate() {
                    let (gain, moved) = gains.get(k).copied().unwrap_or_default();
                    let weight = f64::from(*x) * gain;
                    offset += weight * moved;
                    *x = weight as f32;
                }
                row[layout.inputs] = offset as f32;
            }
        }
    });
}

/// `[parameter, pose cluster, d]`; zero where a cluster has fewer dimensions.
fn projection(locals: &[Local], parameters: usize, inputs: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(parameters * locals.len() * inputs);
    for i in 0..parameters {
        for local in locals {
            let rank = local.design.rank();
            out.extend((0..inputs).map(|k| match k < rank {
                true => local.design.v[(i, k)] as f32,
                false => 0.0,
            }));
        }
    }
    out
}

fn report(
    design: &Design,
    regressions: &[Regression<'_>],
    filters: &[Filter],
    (energy, spread): (f64, f64),
    source: &Source<'_>,
) -> FitReport {
    let numbers = (source.poses() * source.points() * source.width()) as f64;
    let alphas: Vec<String> = filters.iter().map(|f| format!("{:.3}", f.alpha)).collect();
    let degrees = regressions.iter().zip(filters);
    FitReport {
        training_rmse: (energy.max(0.0) / numbers).sqrt(),
        spread_rms: (spread / numbers).sqrt(),
        degrees_of_freedom: degrees.map(|(r, f)| f.degrees_of_freedom(&r.design.s)).sum(),
        inputs: filters.iter().map(|f| f.inputs).max().unwrap_or(0),
        pose_spectrum: design.variances(),
        output_variance_retained: 1.0,
        passes: 1,
        notices: vec![format!(
            "{} pose clusters with alpha {}; the error on the training poses counts each with its \
             nearest cluster alone",
            filters.len(),
            alphas.join(", ")
        )],
        ..FitReport::default()
    }
}
