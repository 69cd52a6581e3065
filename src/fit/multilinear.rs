//! Family `multilinear` (AO07): k-means of the poses, and around each centre a ridge on the
//! principal components of its own poses.

use rayon::prelude::*;

use super::design::{Design, Filter};
use super::greedy_split::{Until, greedy_split};
use super::k_means::k_means;
use super::moments::{Absorber, Moments, Scratch};
use super::report::Clock;
use super::ridge::{Regression, summary};
use super::source::{Block, Source};
use super::{Error, FitReport, Fitted, Settings};
use crate::dataset::Training;
use crate::model::{Decoder, Multilinear};
use crate::num::linalg::{Mat, product, rows_of, rows_of_mut, symmetric_eigen};

/// Directions of all poses that are kept for the distance to them, at most: every pose cluster has
/// directions of its own, and these are only for that.
const MOST_DIRECTIONS: usize = 16;

/// Dimensions in which points are compared when they are clustered, at most.
const MOST_FEATURES: usize = 24;

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
struct Local {
    design: Design,
    clips: Vec<i32>,
    poses: Vec<usize>,
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
struct Layout {
    clusters: usize,
    width: usize,
    inputs: usize,
    inner: usize,
}

impl Layout {
    fn at(&self, output: usize, cluster: usize) -> usize {
        let (point, c) = (output / self.width, output % self.width);
        ((point * self.clusters + cluster) * self.width + c) * self.inner
    }
}

pub(super) fn fit(
    source: &Source<'_>,
    training: &Training<'_>,
    design: &Design,
    sizes: MultilinearSizes,
    settings: &Settings,
    clock: &mut Clock,
) -> Result<Fitted, Error> {
    check(design, source, &sizes)?;
    let locals = locals(training, design, &sizes, settings.seed)?;
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
    scale(&mut coefficients, &locals, &filters, layout);
    clock.lap("ridge_s");
    let mut model = Multilinear {
        blend_exponent: sizes.blend_exponent as f32,
        inputs,
        intercepts: !sizes.published,
        centres: locals.iter().flat_map(|l| l.design.centre.iter().map(|&x| x as f32)).collect(),
        projection: projection(&locals, design.centre.len(), inputs),
        mean: Vec::new(),
        coefficients,
        row_of_point: Vec::new(),
    };
    if sizes.points != PointClusters::None || sizes.published {
        subtract(&mut model.coefficients, &mean, layout);
        model.mean = mean;
    }
    energy += share(&mut model, &locals, &filters, sizes.points, layout);
    if sizes.published {
        energy += drop_intercepts(&mut model, &locals, layout);
    }
    clock.lap("point_clusters_s");
    let report = report(design, &regressions, &filters, (energy, spread), source);
    let training = summary(design, design.rank().min(MOST_DIRECTIONS), true);
    Ok(Fitted { decoder: Decoder::Multilinear(model), training, report })
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

/// Turns each C into weights of the projected pose, diag(f) C.
fn scale(coefficients: &mut [f32], locals: &[Local], filters: &[Filter], layout: Layout) {
    let gains: Vec<Vec<f64>> =
        locals.iter().zip(filters).map(|(l, f)| f.gains(&l.design.s)).collect();
    let per_point = layout.clusters * layout.width * layout.inner;
    coefficients.par_chunks_mut(per_point).for_each(|point| {
        let clusters = point.chunks_exact_mut(layout.width * layout.inner).zip(&gains);
        for (cluster, gains) in clusters {
            for row in cluster.chunks_exact_mut(layout.inner) {
                for (k, x) in row[..layout.inputs].iter_mut().enumerate() {
                    *x = gains.get(k).map_or(0.0, |gain| (f64::from(*x) * gain) as f32);
                }
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

/// Makes intercepts offsets from the mean of all poses.
fn subtract(coefficients: &mut [f32], mean: &[f32], layout: Layout) {
    for (output, &mean) in mean.iter().enumerate() {
        for j in 0..layout.clusters {
            coefficients[layout.at(output, j) + layout.inputs] -= mean;
        }
    }
}

/// Lets points share coefficients; the energy that this adds on the training poses.
///
/// Points are compared by what the fit says of them over the poses of the cluster, offset from
/// their own means. The joint least-squares solution of a cluster of points (AO07 eq. 2) is the mean
/// of theirs, since all have the same regressors.
fn share(
    model: &mut Multilinear,
    locals: &[Local],
    filters: &[Filter],
    points: PointClusters,
    layout: Layout,
) -> f64 {
    if points == PointClusters::None {
        return 0.0;
    }
    let count = model.mean.len() / layout.width;
    let coefficients = &model.coefficients;
    let each = locals.par_iter().zip(filters).enumerate().map(|(j, (local, filter))| {
        let features = features(coefficients, local, filter.inputs, j, count, layout);
        let dims = features.len() / count;
        let poses = local.poses.len() as f64;
        let until = match points {
            PointClusters::Threshold(rms) => {
                Until::Distance(rms * (poses * layout.width as f64).sqrt())
            }
            PointClusters::Count(most) => Until::Count(most),
            PointClusters::None => Until::Count(count),
        };
        let (reduced, dims) = reduce(&features, dims);
        let labels = greedy_split(&reduced, dims, until);
        let spread = spread(&features, &labels);
        (labels, spread)
    });
    let each: Vec<(Vec<u32>, f64)> = each.collect();
    let most = |labels: &Vec<u32>| labels.iter().max().map_or(1, |&label| label as usize + 1);
    let rows = each.iter().map(|(labels, _)| most(labels)).max().unwrap_or(1);
    let per = layout.width * layout.inner;
    let mut shared = vec![0.0_f32; rows * layout.clusters * per];
    for (j, (labels, _)) in each.iter().enumerate() {
        let mut sums = vec![0.0_f64; rows * per];
        let mut counts = vec![0_usize; rows];
        for (point, &label) in labels.iter().enumerate() {
            counts[label as usize] += 1;
            let from = &model.coefficients[(point * layout.clusters + j) * per..][..per];
            let sum = &mut sums[label as usize * per..][..per];
            sum.iter_mut().zip(from).for_each(|(sum, &x)| *sum += f64::from(x));
        }
        for (row, count) in counts.iter().enumerate() {
            let to = &mut shared[(row * layout.clusters + j) * per..][..per];
            let sum = &sums[row * per..][..per];
            let count = (*count).max(1) as f64;
            to.iter_mut().zip(sum).for_each(|(to, sum)| *to = (sum / count) as f32);
        }
    }
    model.coefficients = shared;
    model.row_of_point = each.iter().flat_map(|(labels, _)| labels.iter().copied()).collect();
    each.iter().map(|(_, spread)| spread).sum()
}

/// Per point, coordinates in which distances are those of its values over the poses of a cluster:
/// s_k x_k for every direction and √p times the offset, for every coefficient.
fn features(
    coefficients: &[f32],
    local: &Local,
    inputs: usize,
    cluster: usize,
    count: usize,
    layout: Layout,
) -> Vec<f32> {
    let root = (local.poses.len() as f64).sqrt();
    let mut out = Vec::with_capacity(count * layout.width * (inputs + 1));
    for output in 0..count * layout.width {
        let row = &coefficients[layout.at(output, cluster)..][..layout.inner];
        out.extend((0..inputs).map(|k| (f64::from(row[k]) * local.design.s[k]) as f32));
        out.push((f64::from(row[layout.inputs]) * root) as f32);
    }
    out
}

/// The leading principal coordinates, where there are many.
fn reduce(features: &[f32], dims: usize) -> (Vec<f32>, usize) {
    if dims <= MOST_FEATURES {
        return (features.to_vec(), dims);
    }
    let count = features.len() / dims;
    let values: Vec<f64> = features.iter().map(|&x| f64::from(x)).collect();
    let rows = rows_of(&values, count, dims);
    let gram = product(rows.transpose(), rows);
    // Without its directions the distances are those of all features, only slower.
    let Ok((_, vectors)) = symmetric_eigen(gram.as_ref()) else {
        return (features.to_vec(), dims);
    };
    let reduced: Mat<f64> = product(rows, vectors.subcols(0, MOST_FEATURES));
    let flat = reduced.row_iter().flat_map(|row| row.iter().map(|&x| x as f32));
    (flat.collect(), MOST_FEATURES)
}

/// Σ of squared distances to the means of the clusters.
fn spread(features: &[f32], labels: &[u32]) -> f64 {
    let dims = features.len() / labels.len();
    let count = labels.iter().max().map_or(1, |&label| label as usize + 1);
    let (mut sums, mut counts) = (vec![0.0_f64; count * dims], vec![0_usize; count]);
    for (row, &label) in features.chunks_exact(dims).zip(labels) {
        counts[label as usize] += 1;
        let sum = &mut sums[label as usize * dims..][..dims];
        sum.iter_mut().zip(row).for_each(|(sum, &x)| *sum += f64::from(x));
    }
    let rows = features.chunks_exact(dims).zip(labels);
    rows.map(|(row, &label)| {
        let (sum, n) = (&sums[label as usize * dims..][..dims], counts[label as usize] as f64);
        row.iter().zip(sum).map(|(&x, sum)| (f64::from(x) - sum / n).powi(2)).sum::<f64>()
    })
    .sum()
}

/// Leaves out the intercepts, which are offsets from the mean; the energy that this adds.
fn drop_intercepts(model: &mut Multilinear, locals: &[Local], layout: Layout) -> f64 {
    let (per, points) = (layout.width * layout.inner, model.mean.len() / layout.width);
    let mut energy = 0.0;
    for (j, local) in locals.iter().enumerate() {
        let offsets = (0..points).map(|point| {
            let row = model.row_of_point.get(j * points + point).map_or(point, |&r| r as usize);
            let rows = model.coefficients[(row * layout.clusters + j) * per..][..per]
                .chunks_exact(layout.inner);
            rows.map(|row| f64::from(row[layout.inputs]).powi(2)).sum::<f64>()
        });
        energy += offsets.sum::<f64>() * local.poses.len() as f64;
    }
    let rows = model.coefficients.chunks_exact(layout.inner);
    model.coefficients = rows.flat_map(|row| row[..layout.inputs].iter().copied()).collect();
    energy
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
