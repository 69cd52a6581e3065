//! Some of the points of a data set, which stand for all.

use crate::model::{RigHeader, SourceHeader};
use crate::pipeline::Job;

/// Every n-th point of the points by bones: each bone has its share, and neighbours in the mesh do
/// not stand for one another.
pub(super) fn sample(bone_of_point: &[u16], most: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..bone_of_point.len() as u32).collect();
    order.sort_by_key(|&point| (bone_of_point[point as usize], point));
    let step = order.len().div_ceil(most.max(1)).max(1);
    let mut some: Vec<u32> = order.into_iter().step_by(step).collect();
    some.sort_unstable();
    some
}

/// A job over some points only.
pub(super) fn thinned(mut job: Job, points: &[u32]) -> Job {
    let bones = &job.poses.bones.of_point;
    job.poses.bones.of_point = points.iter().map(|&point| bones[point as usize]).collect();
    let all = &job.poses.points;
    // A vertex that is not there counts with the one before it.
    let near = |&point: &u32| points.partition_point(|&kept| kept <= point).max(1) as u32 - 1;
    job.poses.points = crate::rig::Points {
        vertex: points.iter().map(|&point| all.vertex[point as usize]).collect(),
        of_vertex: all.of_vertex.iter().map(near).collect(),
    };
    job
}

/// Parameters that look at points look at some that are there: nobody poses what candidates come to.
pub(super) fn keep_within(rig: &mut RigHeader, count: usize) {
    for column in &mut rig.columns {
        if let SourceHeader::Dihedral { points, .. } = &mut column.source {
            *points = points.map(|point| point % count.max(1) as u32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sample has as many points as asked for at most, and of every bone that has enough.
    #[test]
    fn samples_hold_every_bone() {
        let bones: Vec<u16> = (0..1000).map(|i| [0, 0, 0, 7, 3][i % 5]).collect();
        let some = sample(&bones, 100);
        assert!(some.len() <= 100 && some.is_sorted());
        for (bone, share) in [(0, 60), (3, 20), (7, 20)] {
            let count = some.iter().filter(|&&p| bones[p as usize] == bone).count();
            assert!(count.abs_diff(share) <= 1, "{bone}: {count}");
        }
        assert_eq!(sample(&[1, 0], 5), [0, 1]);
    }
}
