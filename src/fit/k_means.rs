//! K-means of a few thousand rows, deterministic from a seed.

use crate::num::random::{Stream, hash};

/// Starts of which the best counts.
const RESTARTS: u64 = 8;

/// Lloyd steps of a start, at most.
const STEPS: usize = 100;

/// Gives each of `rows` (each of `width` numbers) one of at most `count` clusters, numbered in the
/// order of their first rows: Lloyd's iteration from k-means++ starts, the best of several. Rows
/// that coincide never share fewer clusters than there are distinct ones, so no cluster is empty.
pub(super) fn k_means(rows: &[f64], width: usize, count: usize, seed: u64) -> Vec<usize> {
    let n = rows.len().checked_div(width).unwrap_or(0);
    let mut best: Option<(f64, Vec<usize>)> = None;
    for restart in 0..RESTARTS {
        let mut centres = plus_plus(rows, width, count, hash(&[seed, restart]));
        let (mut labels, mut energy) = assign(rows, width, &centres);
        for _ in 0..STEPS {
            centres = means(rows, width, &labels, &centres);
            let (next, less) = assign(rows, width, &centres);
            let settled = next == labels;
            (labels, energy) = (next, less);
            if settled {
                break;
            }
        }
        if best.as_ref().is_none_or(|(least, _)| energy < *least) {
            best = Some((energy, labels));
        }
    }
    renumber(&best.map_or(vec![0; n], |(_, labels)| labels))
}

/// Labels in the order in which they first appear, without gaps.
pub(super) fn renumber(labels: &[usize]) -> Vec<usize> {
    let most = labels.iter().max().map_or(0, |&label| label + 1);
    let mut names = vec![usize::MAX; most];
    let mut next = 0;
    let mut name = |label: usize| {
        if names[label] == usize::MAX {
            names[label] = next;
            next += 1;
        }
        names[label]
    };
    labels.iter().map(|&label| name(label)).collect()
}

fn square(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

/// Each next centre is a row, drawn in proportion to its squared distance to the nearest one.
fn plus_plus(rows: &[f64], width: usize, count: usize, seed: u64) -> Vec<f64> {
    let n = rows.len() / width;
    let mut stream = Stream::new(seed);
    let row = |i: usize| &rows[i * width..(i + 1) * width];
    let mut centres = row((stream.uniform() * n as f64) as usize).to_vec();
    let mut nearest: Vec<f64> = (0..n).map(|i| square(row(i), &centres)).collect();
    while centres.len() < count * width {
        let total: f64 = nearest.iter().sum();
        if total <= 0.0 {
            break;
        }
        let mut left = stream.uniform() * total;
        let drawn = nearest.iter().position(|&d| {
            left -= d;
            d > 0.0 && left < 0.0
        });
        let drawn = drawn.unwrap_or_else(|| nearest.iter().rposition(|&d| d > 0.0).unwrap_or(0));
        centres.extend_from_slice(row(drawn));
        nearest.iter_mut().enumerate().for_each(|(i, d)| *d = d.min(square(row(i), row(drawn))));
    }
    centres
}

/// The nearest centre of each row (the first of several), and the sum of squared distances.
fn assign(rows: &[f64], width: usize, centres: &[f64]) -> (Vec<usize>, f64) {
    let mut energy = 0.0;
    let nearest = |row: &[f64]| {
        let mut best = (0, f64::INFINITY);
        for (i, centre) in centres.chunks_exact(width).enumerate() {
            let distance = square(row, centre);
            if distance < best.1 {
                best = (i, distance);
            }
        }
        energy += best.1;
        best.0
    };
    (rows.chunks_exact(width).map(nearest).collect(), energy)
}

/// The means of the clusters; an empty one keeps its centre.
fn means(rows: &[f64], width: usize, labels: &[usize], centres: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; centres.len()];
    let mut counts = vec![0_usize; centres.len() / width];
    for (row, &label) in rows.chunks_exact(width).zip(labels) {
        counts[label] += 1;
        sums[label * width..].iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
    }
    for (i, sum) in sums.chunks_exact_mut(width).enumerate() {
        match counts[i] {
            0 => sum.copy_from_slice(&centres[i * width..(i + 1) * width]),
            count => sum.iter_mut().for_each(|x| *x /= count as f64),
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Separated groups are found whatever the seed, numbered by first appearance.
    #[test]
    fn separated_groups_are_found() {
        let rows: Vec<f64> = (0..60)
            .flat_map(|i| [f64::from(i % 3) * 100.0 + f64::from(i / 3) * 0.1, f64::from(i % 2)])
            .collect();
        for seed in 0..5 {
            let labels = k_means(&rows, 2, 3, seed);
            assert!(labels.iter().enumerate().all(|(i, &label)| label == i % 3), "{labels:?}");
        }
    }

    /// Fewer distinct rows than clusters, one row, and equal rows give what there is.
    #[test]
    fn there_are_never_more_clusters_than_distinct_rows() {
        assert_eq!(k_means(&[1.0, 1.0, 2.0, 1.0], 1, 4, 1), [0, 0, 1, 0]);
        assert_eq!(k_means(&[3.0], 1, 4, 1), [0]);
        assert_eq!(k_means(&[5.0; 6], 2, 2, 1), [0; 3]);
    }
}
