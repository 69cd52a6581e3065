//! Standard errors from blocks. Vertices of a pose and neighbouring frames are nearly copies of
//! one another, so neither counts as independent: whole clips do where there are enough, else
//! contiguous stretches of time.

use super::measured::{BlockMethod, Estimate};
use crate::num::stats::{Sum, standard_error};

/// Fewest clips that give a standard error between clips.
const FEWEST_CLIPS: usize = 3;
/// Stretches of time that a split is cut into where clips are too few.
const STRETCHES: usize = 10;

/// Which block each pose of a split belongs to.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Blocks {
    pub(super) method: BlockMethod,
    /// Number of blocks.
    pub(super) count: usize,
    /// [pose of the split]
    of_pose: Vec<usize>,
}

impl Blocks {
    /// Blocks of poses given as (clip, time).
    pub(super) fn new(places: &[(usize, f32)]) -> Self {
        let mut clips: Vec<usize> = places.iter().map(|p| p.0).collect();
        clips.sort_unstable();
        clips.dedup();
        let clip_of = |clip: usize| clips.binary_search(&clip).unwrap_or(0);
        if clips.len() >= FEWEST_CLIPS {
            let of_pose = places.iter().map(|p| clip_of(p.0)).collect();
            return Self { method: BlockMethod::Clips, count: clips.len(), of_pose };
        }
        let per_clip = STRETCHES.div_ceil(clips.len().max(1));
        let mut of_pose = vec![0; places.len()];
        let mut count = 0;
        for &clip in &clips {
            let mut members: Vec<usize> =
                (0..places.len()).filter(|&i| places[i].0 == clip).collect();
            members.sort_by(|&a, &b| places[a].1.total_cmp(&places[b].1));
            let stretches = per_clip.min(members.len());
            for (rank, &i) in members.iter().enumerate() {
                of_pose[i] = count + rank * stretches / members.len();
            }
            count += stretches;
        }
        Self { method: BlockMethod::Stretches, count, of_pose }
    }

    /// The mean of a series over the given poses of the split, with its standard error.
    pub(super) fn estimate(&self, poses: &[usize], series: &[f64]) -> Option<Estimate> {
        if series.is_empty() {
            return None;
        }
        let mut blocks = vec![(Sum::default(), 0.0); self.count];
        for (&pose, &x) in poses.iter().zip(series) {
            let block = &mut blocks[self.of_pose[pose]];
            block.0.add(x);
            block.1 += 1.0;
        }
        let filled: Vec<(f64, f64)> =
            blocks.iter().filter(|b| b.1 > 0.0).map(|b| (b.0.value() / b.1, b.1)).collect();
        let total = series.iter().copied().collect::<Sum>().value();
        Some(Estimate {
            value: total / series.len() as f64,
            standard_error: standard_error(&filled),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three clips are three blocks, whatever their poses' order; the estimate is the plain mean
    /// over poses and its error that of the clips' means.
    #[test]
    fn enough_clips_are_blocks() {
        let places = [(4, 0.0), (2, 0.0), (4, 1.0), (9, 0.0), (2, 1.0), (9, 1.0)];
        let blocks = Blocks::new(&places);
        assert_eq!((blocks.method, blocks.count), (BlockMethod::Clips, 3));
        let series = [1.0, 4.0, 1.0, 7.0, 4.0, 7.0];
        let e = blocks.estimate(&[0, 1, 2, 3, 4, 5], &series).unwrap();
        assert!((e.value - 4.0).abs() < 1e-12);
        assert!((e.standard_error.unwrap() - 3f64.sqrt()).abs() < 1e-12);
    }

    /// One clip is cut into ten stretches of time, contiguous and of nearly equal size.
    #[test]
    fn one_clip_is_cut_into_stretches() {
        let places: Vec<(usize, f32)> = (0..25).map(|i| (0, (24 - i) as f32)).collect();
        let blocks = Blocks::new(&places);
        assert_eq!((blocks.method, blocks.count), (BlockMethod::Stretches, 10));
        let in_time: Vec<usize> = blocks.of_pose.iter().rev().copied().collect();
        assert!(in_time.is_sorted());
        for block in 0..10 {
            let size = in_time.iter().filter(|&&b| b == block).count();
            assert!((2..=3).contains(&size), "block {block} has {size}");
        }
    }

    /// One pose has a mean and no standard error; no pose has neither.
    #[test]
    fn too_few_poses_claim_no_error() {
        let one = Blocks::new(&[(0, 0.0)]);
        let e = one.estimate(&[0], &[0.5]).unwrap();
        assert_eq!((e.value, e.standard_error), (0.5, None));
        assert_eq!(Blocks::new(&[]).estimate(&[], &[]), None);
    }
}
