//! Clusters of points by mean shift on how they move (RPO09 §5.2): with the same bones in the same shares, or
//! where there is no skeleton turning alike over the poses (James and Twigg 2005).

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::dataset::Movement;

/// Width of the Gaussian kernel where no number of clusters is asked for, in units of weight: two
/// points on different bones are √2 apart, and so are two that turn opposite ways.
const BANDWIDTH: f32 = 0.25;

/// Clusters at most where no number is asked for and no bones bound it: then the kernel gets wider.
const MOST_CLUSTERS: usize = 64;

/// By how much, and how much narrower where there are too few.
const WIDER: f32 = 1.25;

/// Points whose turns stand for those of the points that turn most like them, at most.
const MOST_TURNS: usize = 1024;

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
    fn new(movement: &Movement) -> Self {
        match movement {
            Movement::Weights(skin) => Self::of_skin(skin),
            Movement::Turns { width, values } => Self::of_turns(*width, values),
        }
    }

    /// Every n-th point stands for those whose rows are nearest to its own.
    fn of_turns(width: usize, values: &[f32]) -> Self {
        let row = |point: usize| &values[point * width..(point + 1) * width];
        let points = values.len() / width.max(1);
        let step = points.div_ceil(MOST_TURNS).max(1);
        let some: Vec<usize> = (0..points).step_by(step).collect();
        let nearest = |point: usize| {
            let distance = |&(_, &other): &(usize, &usize)| square(row(point), row(other));
            let least = some.iter().enumerate().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            least.map_or(0, |(place, _)| place)
        };
        let of_point: Vec<usize> = (0..points).into_par_iter().map(nearest).collect();
        let mut counts = vec![0.0; some.len()];
        of_point.iter().for_each(|&place| counts[place] += 1.0);
        let values = some.iter().flat_map(|&point| row(point)).copied().collect();
        Self { width, values, counts, of_point }
    }

    fn of_skin(skin: &[Vec<(u32, f32)>]) -> Self {
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
        let most = labels.iter().max().map_or(0, |&label| label + 1);
        let (mut means, mut sizes) = self.means(labels, most);
        // What Ward's criterion adds to the sum of squares.
        let loss = |a: usize, b: usize, means: &[Vec<f32>], sizes: &[f32]| {
            square(&means[a], &means[b]) * sizes[a] * sizes[b] / (sizes[a] + sizes[b])
        };
        let mut losses: Vec<Vec<f32>> =
            (0..most).map(|b| (0..b).map(|a| loss(a, b, &means, &sizes)).collect()).collect();
        let mut into: Vec<usize> = (0..most).collect();
        let mut alive: Vec<usize> = (0..most).collect();
        while alive.len() > count.max(1) {
            let pairs = alive.iter().enumerate();
            let pairs = pairs.flat_map(|(i, &b)| alive[..i].iter().map(move |&a| (a, b)));
            let least = pairs.min_by(|&(a, b), &(c, d)| losses[b][a].total_cmp(&losses[d][c]));
            let Some((a, b)) = least else { break };
            let (of_a, of_b) = (sizes[a], sizes[b]);
            let other = means[b].clone();
            let joined = means[a].iter_mut().zip(other);
            joined.for_each(|(x, y)| *x = (of_a * *x + of_b * y) / (of_a + of_b));
            sizes[a] += of_b;
            alive.retain(|&c| c != b);
            into.iter_mut().filter(|c| **c == b).for_each(|c| *c = a);
            for &c in alive.iter().filter(|&&c| c != a) {
                losses[a.max(c)][a.min(c)] = loss(a, c, &means, &sizes);
            }
        }
        for label in labels {
            *label = alive.binary_search(&into[*label]).unwrap_or(0);
        }
    }

    /// Mean and size of each of so many clusters.
    fn means(&self, labels: &[usize], most: usize) -> (Vec<Vec<f32>>, Vec<f32>) {
        let (mut means, mut sizes) = (vec![vec![0.0; self.width]; most], vec![0.0_f32; most]);
        for (i, &label) in labels.iter().enumerate() {
            sizes[label] += self.counts[i];
            let sums = means[label].iter_mut().zip(self.row(i));
            sums.for_each(|(sum, x)| *sum += self.counts[i] * x);
        }
        for (mean, size) in means.iter_mut().zip(&sizes) {
            mean.iter_mut().for_each(|x| *x /= size);
        }
        (means, sizes)
    }
}

/// The cluster of each point, numbered by first appearance: those that mean shift finds, or about
/// `count` of them, with a narrower kernel where it finds fewer and by joining where more. Turns differ from
/// point to point, so there the kernel is as wide as it takes for few enough.
pub(super) fn clusters(movement: &Movement, count: Option<usize>) -> Vec<usize> {
    let rows = Rows::new(movement);
    let found = |labels: &[usize]| labels.iter().max().map_or(0, |&label| label + 1);
    let mut bandwidth = BANDWIDTH;
    let mut labels = rows.labels(bandwidth);
    if matches!(movement, Movement::Turns { .. }) {
        let most = count.map_or(MOST_CLUSTERS, |count| MOST_CLUSTERS.max(2 * count));
        while found(&labels) > most {
            bandwidth *= WIDER;
            labels = rows.labels(bandwidth);
        }
    }
    if let Some(count) = count {
        while found(&labels) < count.min(rows.counts.len()) && bandwidth > 0.01 {
            bandwidth /= 2.0;
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
    fn skin() -> Movement {
        let rigid = |bone: u32| (0..20).map(move |_| vec![(bone, 1.0)]);
        let seam = (1..4).map(|i| vec![(4, 0.25 * i as f32), (7, 1.0 - 0.25 * i as f32)]);
        Movement::Weights(rigid(4).chain(seam).chain(rigid(7)).chain(rigid(9)).collect())
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
        let one = Movement::Weights(vec![vec![(0, 1.0)]; 3]);
        assert_eq!(clusters(&one, None), [0; 3]);
    }

    /// Parts that turn each in its own way are clusters; as many as asked for where that is said, a point each
    /// at most; what does not turn is one.
    #[test]
    fn turns_are_told_apart() {
        use glam::{Mat3, Quat};
        let row = |angle: f32, point: usize| {
            // A little of its own at every point.
            let wobble = Quat::from_rotation_x(0.05 * (point % 5) as f32);
            let turns = [0.5, 1.0].map(|share| Quat::from_rotation_z(share * angle) * wobble);
            turns.map(|q| Mat3::from_quat(q).to_cols_array().map(|x| x * 0.5 / 2.0_f32.sqrt()))
        };
        let part = |angle: f32| (0..30).flat_map(move |i| row(angle, i).concat());
        let values: Vec<f32> = part(0.0).chain(part(1.2)).chain(part(-2.0)).collect();
        let three = Movement::Turns { width: 18, values };
        let labels = clusters(&three, None);
        let expected: Vec<usize> = (0..90).map(|point| point / 30).collect();
        assert_eq!(labels, expected);
        for count in [1, 2, 3, 7] {
            assert_eq!(clusters(&three, Some(count)).iter().max().unwrap() + 1, count);
        }
        assert!(clusters(&three, Some(1000)).iter().max().unwrap() < &90);
        let still = Movement::Turns { width: 9, values: vec![0.5; 9 * 40] };
        assert_eq!(clusters(&still, None), [0; 40]);
    }
}
