//! What all points see of the spheres of a mesh in the training poses: enough to weigh any number of groups of
//! them up to the largest that was looked at.

use std::borrow::Cow;

use super::sums::Moments;
use super::{Error, PointMoments, Source, block_moments, merge};
use crate::fit::occluder::Placed;

/// Spheres in groups, and the moments of every point by these.
#[derive(Debug, Clone)]
pub(in crate::fit) struct Sight {
    pub(super) placed: Placed,
    pub(super) moments: Vec<PointMoments>,
    /// Most groups of a bone.
    most: usize,
    /// `[bone]`: moments of some points by the finest groups; empty where those were few enough.
    of_bones: Vec<Vec<Moments>>,
    /// `[bone][finest group]` → group.
    sets: Vec<Vec<usize>>,
}

impl Sight {
    /// Looks at `placed` in groups of which each bone has `most` at most; so that fewer can be had of it where it
    /// `may_be_fewer`.
    pub(super) fn new(
        source: &Source<'_>,
        mut placed: Placed,
        fold_of_pose: &[usize],
        (most, may_be_fewer): (usize, bool),
    ) -> Result<Self, Error> {
        let points = source.points();
        let explained = source.explained().ok_or(Error::NeedsGeometry)?;
        let finest = placed.occluders.groups(points);
        let mut of_bones = Vec::new();
        if finest > most || may_be_fewer && finest > 1 {
            of_bones = merge::of_bones(source, explained, &placed)?;
        }
        let mut sets = vec![(0..finest).collect(); of_bones.len()];
        if finest > most {
            sets = merge::sets_of_bones(&of_bones, most);
            merge::regroup(&mut placed, &sets, points);
        }
        let groups = placed.occluders.groups(points);
        let mut moments: Vec<PointMoments> = Vec::with_capacity(points);
        source.map_fold(
            |block| Ok(block_moments(block, explained, &placed, fold_of_pose, groups)),
            |_, of_block| moments.extend(of_block),
        )?;
        Ok(Self { placed, moments, most, of_bones, sets })
    }

    /// The same with at most so many groups of each bone.
    pub(super) fn of_groups(&self, most: usize) -> Cow<'_, Self> {
        let groups = self.placed.occluders.groups(self.moments.len());
        if most >= self.most.min(groups) || self.of_bones.is_empty() {
            return Cow::Borrowed(self);
        }
        let sets = merge::sets_of_bones(&self.of_bones, most);
        let of_bone = |(from, to): (&Vec<usize>, &Vec<usize>)| {
            let mut set_of = vec![0; groups];
            from.iter().zip(to).for_each(|(&from, &to)| set_of[from] = to);
            set_of
        };
        let joins: Vec<Vec<usize>> = self.sets.iter().zip(&sets).map(of_bone).collect();
        let mut placed = self.placed.clone();
        merge::regroup(&mut placed, &joins, self.moments.len());
        let count = placed.occluders.groups(self.moments.len());
        let moments = self.moments.iter().map(|point| point.joined(&joins[point.bone], count));
        let (moments, of_bones) = (moments.collect(), self.of_bones.clone());
        Cow::Owned(Self { placed, moments, most, of_bones, sets })
    }
}

impl PointMoments {
    fn joined(&self, set_of: &[usize], sets: usize) -> Self {
        let join = |moments: &Moments| moments.joined(set_of, sets);
        Self {
            bone: self.bone,
            all: join(&self.all),
            folds: self.folds.iter().map(|both| both.each_ref().map(join)).collect(),
        }
    }
}
