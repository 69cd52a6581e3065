//! Points that never vary beyond the noise of the bake: they keep their mean and nothing else.

use super::output_parts::Part;
use super::source::Source;
use crate::model::{Cluster, Clustered};

/// How many standard deviations of pure noise a point's energy must exceed to count as motion.
const DEVIATIONS: f64 = 3.0;

/// Moves still points to a cluster of their own without outputs. Gives their number and how many
/// numbers of the decoder that saves.
///
/// A point's energy in the k directions that its cluster keeps is Σ s²v² over directions and its c
/// coefficients; noise of variance σ² alone leaves c·k·σ² there, with a standard deviation of
/// σ²√(2ck). Directions are shared by all points of a cluster, so that far less than the noise of a
/// single point shows.
pub(super) fn set_aside(
    model: &mut Clustered,
    parts: &[Part],
    source: &Source<'_>,
) -> (usize, usize) {
    let width = source.width();
    let mut rows: Vec<_> = model
        .clusters
        .iter_mut()
        .map(|cluster| {
            let row = width * (cluster.outputs + 1);
            (std::mem::take(&mut cluster.basis).into_iter(), row)
        })
        .collect();
    let still = model.clusters.len() as u32;
    let mut means = Vec::new();
    let (mut count, mut saved) = (0, 0);
    for (point, label) in model.cluster_of_point.iter_mut().enumerate() {
        let at = *label as usize;
        let (values, row) = &mut rows[at];
        let row: Vec<f32> = values.by_ref().take(*row).collect();
        let inner = model.clusters[at].outputs + 1;
        let part = &parts[at];
        if inner > 1 && is_still(&row, inner, part, source.noise_of(point)) {
            means.extend(row.iter().skip(inner - 1).step_by(inner));
            saved += row.len() - width;
            count += 1;
            *label = still;
        } else {
            model.clusters[at].basis.extend(row);
        }
    }
    if count > 0 {
        model.clusters.push(Cluster { basis: means, ..Cluster::default() });
    }
    (count, saved)
}

/// `row` is `[coefficient, k + 1]`, the mean last.
fn is_still(row: &[f32], inner: usize, part: &Part, variance: f64) -> bool {
    let squares = part.squares();
    let energy: f64 = row
        .chunks_exact(inner)
        .flat_map(|of_c| of_c.iter().zip(squares))
        .map(|(&v, s)| f64::from(v).powi(2) * s)
        .sum();
    let count = (row.len() - row.len() / inner) as f64;
    energy <= variance * (count + DEVIATIONS * (2.0 * count).sqrt())
}
