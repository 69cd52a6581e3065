//! Greedy farthest-point splitting of many rows into many clusters (AO07 §3.2): deterministic, and
//! quick where k-means with thousands of centres is neither.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Until {
    /// This many clusters.
    Count(usize),
    /// No row farther than this from the mean of its cluster.
    Distance(f64),
}

/// A cluster that could be split.
#[derive(Debug)]
struct Open {
    /// Squared distance of the farthest row to the mean.
    farthest: f64,
    /// Its index among `members`.
    at: usize,
    members: Vec<u32>,
    centre: Vec<f32>,
    label: usize,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Open {}
impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        // Of equal ones the oldest first.
        self.farthest.total_cmp(&other.farthest).then_with(|| other.label.cmp(&self.label))
    }
}

impl Open {
    fn new(rows: &[f32], width: usize, members: Vec<u32>, label: usize) -> Self {
        let row = |member: u32| &rows[member as usize * width..][..width];
        let mut sums = vec![0.0_f64; width];
        for &member in &members {
            sums.iter_mut().zip(row(member)).for_each(|(sum, &x)| *sum += f64::from(x));
        }
        let count = members.len().max(1) as f64;
        let centre: Vec<f32> = sums.iter().map(|sum| (sum / count) as f32).collect();
        let (mut at, mut farthest) = (0, -1.0);
        for (i, &member) in members.iter().enumerate() {
            let distance = square(row(member), &centre);
            if distance > farthest {
                (at, farthest) = (i, distance);
            }
        }
        Self { farthest, at, members, centre, label }
    }
}

/// The cluster of each row of `width` numbers. The cluster with the row that is farthest from its
/// mean is split again and again: that row founds a new one, and takes the members that are nearer
/// to it than to the mean.
pub(super) fn greedy_split(rows: &[f32], width: usize, until: Until) -> Vec<u32> {
    let n = rows.len().checked_div(width).unwrap_or(0);
    let mut labels = vec![0_u32; n];
    let mut heap = BinaryHeap::new();
    heap.push(Open::new(rows, width, (0..n as u32).collect(), 0));
    let mut clusters = 1;
    while let Some(open) = heap.pop() {
        let enough = match until {
            Until::Count(count) => clusters >= count,
            Until::Distance(distance) => open.farthest <= distance * distance,
        };
        if enough || open.farthest <= 0.0 {
            break;
        }
        let row = |member: u32| &rows[member as usize * width..][..width];
        let founder = row(open.members[open.at]);
        let (far, near): (Vec<u32>, Vec<u32>) = open
            .members
            .iter()
            .partition(|&&member| square(row(member), founder) < square(row(member), &open.centre));
        if near.is_empty() || far.is_empty() {
            // Only where round-off is all that tells the rows apart.
            continue;
        }
        far.iter().for_each(|&member| labels[member as usize] = clusters as u32);
        heap.push(Open::new(rows, width, near, open.label));
        heap.push(Open::new(rows, width, far, clusters));
        clusters += 1;
    }
    labels
}

fn square(a: &[f32], b: &[f32]) -> f64 {
    f64::from(a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::random::Stream;

    fn rows(n: usize) -> Vec<f32> {
        let mut stream = Stream::new(3);
        (0..2 * n).map(|_| stream.uniform() as f32).collect()
    }

    /// As many clusters as asked for, none empty; with a distance, every row is within it of the
    /// mean of its cluster.
    #[test]
    fn both_ways_to_stop_hold() {
        let rows = rows(200);
        let labels = greedy_split(&rows, 2, Until::Count(37));
        assert!((0..37).all(|label| labels.contains(&label)) && labels.iter().all(|&l| l < 37));
        let labels = greedy_split(&rows, 2, Until::Distance(0.1));
        let count = labels.iter().max().unwrap() + 1;
        for label in 0..count {
            let members: Vec<&[f32]> = rows
                .chunks_exact(2)
                .zip(&labels)
                .filter(|(_, l)| **l == label)
                .map(|x| x.0)
                .collect();
            let mean = |k: usize| members.iter().map(|m| m[k]).sum::<f32>() / members.len() as f32;
            let centre = [mean(0), mean(1)];
            assert!(members.iter().all(|m| square(m, &centre).sqrt() <= 0.1 + 1e-6));
        }
    }

    /// Finer splits never have more energy, and equal rows are never parted.
    #[test]
    fn energy_falls_with_the_count() {
        let rows = rows(150);
        let energy = |labels: &[u32]| -> f64 {
            let count = *labels.iter().max().unwrap() as usize + 1;
            let members = |label: usize| -> Vec<u32> {
                (0..150).filter(|&i| labels[i as usize] as usize == label).collect()
            };
            (0..count)
                .map(|label| {
                    let open = Open::new(&rows, 2, members(label), 0);
                    let row = |m: &u32| &rows[*m as usize * 2..][..2];
                    open.members.iter().map(|m| square(row(m), &open.centre)).sum::<f64>()
                })
                .sum()
        };
        let energies: Vec<f64> = [1, 5, 20, 80, 150]
            .map(|count| energy(&greedy_split(&rows, 2, Until::Count(count))))
            .to_vec();
        assert!(energies.is_sorted_by(|a, b| a > b), "{energies:?}");
        assert_eq!(greedy_split(&[2.0; 8], 2, Until::Count(4)), [0; 4]);
    }
}
