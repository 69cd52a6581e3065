//! Which poses the references cover.

use std::collections::BTreeMap;

use crate::num::random::hash;

/// Consecutive poses that are taken together, so that flicker can be measured between them.
const RUN_POSES: usize = 10;

/// Poses of each split that are measured: all where a split has at most `most`, else at least
/// `most` in whole runs of consecutive poses of one clip, chosen by `seed` alone.
///
/// `splits` and `clips` have one entry per pose; the answer is ascending.
#[must_use]
pub(super) fn choose(splits: &[u8], clips: &[i32], most: usize, seed: u64) -> Vec<usize> {
    let mut by_split: BTreeMap<u8, Vec<usize>> = BTreeMap::new();
    for (pose, &split) in splits.iter().enumerate() {
        by_split.entry(split).or_default().push(pose);
    }
    let mut chosen: Vec<usize> = by_split
        .into_values()
        .flat_map(|poses| if poses.len() <= most { poses } else { draw(&poses, clips, most, seed) })
        .collect();
    chosen.sort_unstable();
    chosen
}

/// Whole runs in the order of a hash of their first pose, until there are enough poses.
fn draw(poses: &[usize], clips: &[i32], most: usize, seed: u64) -> Vec<usize> {
    let mut runs: Vec<&[usize]> = poses
        .chunk_by(|&a, &b| clips[a] == clips[b])
        .flat_map(|clip| clip.chunks(RUN_POSES))
        .collect();
    runs.sort_by_key(|run| hash(&[seed, run[0] as u64]));
    let mut drawn = Vec::with_capacity(most + RUN_POSES);
    for run in runs {
        if drawn.len() >= most {
            break;
        }
        drawn.extend_from_slice(run);
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(clips: usize, poses: usize) -> (Vec<u8>, Vec<i32>) {
        let splits = (0..clips * poses).map(|i| u8::from(i / poses == 0)).collect();
        let ids = (0..clips * poses).map(|i| (i / poses) as i32).collect();
        (splits, ids)
    }

    /// A small split is taken whole, a large one to the number asked for and at most a run more.
    #[test]
    fn counts_are_as_asked() {
        let (splits, clips) = table(5, 60);
        let chosen = choose(&splits, &clips, 100, 7);
        let novel = chosen.iter().filter(|&&pose| splits[pose] == 1).count();
        let training = chosen.len() - novel;
        assert_eq!(novel, 60);
        assert!((100..100 + RUN_POSES).contains(&training), "{training}");
        assert!(chosen.is_sorted_by(|a, b| a < b));
    }

    /// The choice depends on the seed and on nothing else, and most poses have their neighbour.
    #[test]
    fn runs_are_consecutive_and_seeded() {
        let (splits, clips) = table(9, 100);
        let chosen = choose(&splits, &clips, 100, 7);
        assert_eq!(chosen, choose(&splits, &clips, 100, 7));
        assert_ne!(chosen, choose(&splits, &clips, 100, 8));
        let pairs = chosen.windows(2).filter(|pair| pair[1] == pair[0] + 1).count();
        assert!(pairs * 10 >= chosen.len() * 8, "{pairs} of {}", chosen.len());
    }
}
