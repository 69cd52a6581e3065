//! Points of a multilinear model that share coefficients (AO07 §3.2), in each pose cluster apart.

use rayon::prelude::*;

use super::design::Filter;
use super::greedy_split::{Until, greedy_split};
use super::multilinear::{Layout, Local, PointClusters};
use crate::model::Multilinear;
use crate::num::linalg::{Mat, product, rows_of, symmetric_eigen};

/// Dimensions in which points are compared when they are clustered, at most.
const MOST_FEATURES: usize = 24;

/// Makes intercepts offsets from the mean of all poses.
pub(super) fn subtract(coefficients: &mut [f32], mean: &[f32], layout: Layout) {
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
pub(super) fn share(
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
pub(super) fn drop_intercepts(model: &mut Multilinear, locals: &[Local], layout: Layout) -> f64 {
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
