//! Clusters of points by mean shift on their skin weights (RPO09 §5.2): points that move with the
//! same bones in the same shares.

use std::collections::BTreeMap;

use rayon::prelude::*;

/// Width of the Gaussian kernel where no number of clusters is asked for, in units of weight: two
/// points on different bones are √2 apart.
const BANDWIDTH: f32 = 0.25;

/// Different rows of weights, at most; they are rounded as far as that takes.
const MOST_ROWS: usize = 2048;

/// Steps of each row towards its mode, at most.
const STEPS: usize = 50;

/// Rows of weights that are alike, with how many points have them.
struct Rows {
    width: usize,
    values: Vec<f32>,
    counts: Vec<f32>,
    of_point: Vec<usize>,
}

impl Rows {
    fn new(skin: &[Vec<(u32, f32)>]) -> Self {
        let mut levels = 16.0_f32;
        loop {
            let rows = Self::rounded(skin, levels);
            if rows.counts.len() <= MOST_ROWS || levels < 2.0 {
                return rows;
            }
            levels /= 2.0;
        }
    }

    fn rounded(skin: &[Vec<(u32, f32)>], levels: f32) -> Self {
        let mut bones: Vec<u32> = skin.iter().flatten().map(|&(bone, _)| bone).collect();
        bones.sort_unstable();
        bones.dedup();
        let column = |bone: u32| bones.partition_point(|&other| other < bone);
        let width = bones.len();
        let mut known: BTreeMap<Vec<(u32, i32)>, usize> = BTreeMap::new();
        let mut this = Self { width, values: Vec::new(), counts: Vec::new(), of_point: Vec::new() };
        for weights in skin {
            let mut key: Vec<(u32, i32)> = weights
                .iter()
                .map(|&(bone, weight)| (bone, (weight * levels).round() as i32))
                .filter(|&(_, level)| level > 0)
                .collect();
            key.sort_unstable();
            let next = this.counts.len();
            let row = *known.entry(key).or_insert(next);
            if row == next {
                this.counts.push(0.0);
                let mut values = vec![0.0; width];
                weights.iter().for_each(|&(bone, weight)| values[column(bone)] += weight);
                this.values.extend(values);
            }
            this.counts[row] += 1.0;
            this.of_point.push(row);
        }
        this
    }

    fn row(&self, i: usize) -> &[f32] {
        &self.values[i * self.width..(i + 1) * self.width]
    }

    /// Where the row comes to rest under the kernel.
    fn mode(&self, start: usize, bandwidth: f32) -> Vec<f32> {
        let mut at = self.row(start).to_vec();
        let scale = -0.5 / (bandwidth * bandwidth);
        for _ in 0..STEPS {
            let (mut sums, mut total) = (vec![0.0_f32; self.width], 0.0);
            for (i, &count) in self.counts.iter().enumerate() {
                let weight = count * (scale * square(&at, self.row(i))).exp();
                total += weight;
                sums.iter_mut().zip(self.row(i)).for_each(|(sum, x)| *sum += weight * x);
            }
            sums.iter_mut().for_each(|sum| *sum /= total);
            let moved = square(&sums, &at);
            at = sums;
            if moved < 1e-8 {
                break;
            }
        }
        at
    }

    /// Label of each row: rows whose modes meet are one cluster.
    fn labels(&self, bandwidth: f32) -> Vec<usize> {
        let modes: Vec<Vec<f32>> =
            (0..self.counts.len()).into_par_iter().map(|row| self.mode(row, bandwidth)).collect();
        let mut found: Vec<&Vec<f32>> = Vec::new();
        let near = 0.25 * bandwidth * bandwidth;
        let mut labels = Vec::with_capacity(modes.len());
        for mode in &modes {
            let known = found.iter().position(|other| square(other, mode) < near);
            labels.push(known.unwrap_or(found.len()));
            if known.is_none() {
                found.push(mode);
            }
        }
        labels
    }

    /// Joins the two clusters that lose least by it, until so many are left.
    fn merge(&self, labels: &mut [usize], count: usize) {
        loop {
            let most = labels.iter().max().map_or(0, |&label| label + 1);
            if most <= count.max(1) {
                return;
            }
            let (mut sums, mut sizes) = (vec![0.0; most * self.width], vec![0.0_f32; most]);
            for (i, &label) in labels.iter().enumerate() {
                sizes[label] += self.counts[i];
                let sum = &mut sums[label * self.width..][..self.width];
                sum.iter_mut().zip(self.row(i)).for_each(|(sum, x)| *sum += self.counts[i] * x);
            }
            let mean = |c: usize| -> Vec<f32> {
                sums[c * self.width..][..self.width].iter().map(|sum| sum / sizes[c]).collect()
            };
            let means: Vec<Vec<f32>> = (0..most).map(mean).collect();
            let mut best = (f32::INFINITY, 0, 1);
            for a in 0..most {
                for b in a + 1..most {
                    // What Ward's criterion adds to the sum of squares.
                    let loss =
                        square(&means[a], &means[b]) * sizes[a] * sizes[b] / (sizes[a] + sizes[b]);
                    if loss < best.0 {
                        best = (loss, a, b);
                    }
                }
            }
            let (_, a, b) = best;
            for label in labels.iter_mut() {
                *label = match *label {
                    l if l == b => a,
                    l if l > b => l - 1,
                    l => l,
                };
            }
        }
    }
}

/// The cluster of each point, numbered by first appearance: those that mean shift finds, or about
/// `count` of them, with a narrower kernel where it finds fewer and by joining where more.
pub(super) fn clusters(skin: &[Vec<(u32, f32)>], count: Option<usize>) -> Vec<usize> {
    let rows = Rows::new(skin);
    let mut bandwidth = BANDWIDTH;
    let mut labels = rows.labels(bandwidth);
    if let Some(count) = count {
        let found = |labels: &[usize]| labels.iter().max().map_or(0, |&label| label + 1);
        while found(&labels) < count.min(rows.counts.len()) && bandwidth > 0.01 {
            bandwidth *= 0.5;
            labels = rows.labels(bandwidth);
        }
        rows.merge(&mut labels, count);
    }
    let of_points: Vec<usize> = rows.of_point.iter().map(|&row| labels[row]).collect();
    super::k_means::renumber(&of_points)
}

fn square(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three rigid bones with a soft seam between two of them.
    fn skin() -> Vec<Vec<(u32, f32)>> {
        let rigid = |bone: u32| (0..20).map(move |_| vec![(bone, 1.0)]);
        let seam = (1..4).map(|i| vec![(4, 0.25 * i as f32), (7, 1.0 - 0.25 * i as f32)]);
        rigid(4).chain(seam).chain(rigid(7)).chain(rigid(9)).collect()
    }

    /// Rigid parts are clusters of their own, and a seam goes to its sides.
    #[test]
    fn bones_are_found() {
        let labels = clusters(&skin(), Some(3));
        assert!(labels[..20].iter().all(|&l| l == labels[0]));
        assert!(labels[23..43].iter().all(|&l| l == labels[23] && l != labels[0]));
        assert!(labels[43..].iter().all(|&l| l != labels[0] && l != labels[23]));
    }

    /// As many as asked for, from one to one per distinct row; never more.
    #[test]
    fn the_count_is_kept() {
        for count in [1, 2, 3, 5, 6, 60] {
            let labels = clusters(&skin(), Some(count));
            let found = labels.iter().max().unwrap() + 1;
            assert_eq!(found, count.min(6), "{labels:?}");
        }
        assert_eq!(clusters(&vec![vec![(0, 1.0)]; 3], None), [0; 3]);
    }
}
