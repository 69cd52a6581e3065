//! The part of the training data that needs no learning from poses: the unshadowed signal, and
//! what occluders block.

use std::ops::Range;
use std::sync::Arc;

use glam::{Quat, Vec3};

use super::blocked::{Seen, Weighing, Work};
use crate::fit::Settings;
use crate::fit::geometry::{Geometry, Moved, into_bone};
use crate::model::occluder::caps::{LANES, Lanes};
use crate::model::occluder::sky::{Ellipsoid, Sky};
use crate::model::{Frame, Occluders, Signal, unshadowed};
use crate::sh::Order;

/// What is taken from the data before a decoder is fitted to the rest.
#[derive(Debug)]
pub(in crate::fit) struct Explained<'a> {
    pub(super) geometry: &'a Geometry<'a>,
    pub(super) kind: (Signal, Order),
    /// `[pose, bone]`; none where coefficients do not turn with bones.
    pub(super) rotations: Option<&'a [Quat]>,
    /// Whether +Z is the normal.
    in_tangent_frame: bool,
    pub(super) unshadowed: bool,
    pub(super) occluders: Option<Placed>,
}

/// Occluders with their places in all poses.
#[derive(Debug, Clone)]
pub(in crate::fit) struct Placed {
    pub(in crate::fit) occluders: Occluders,
    /// `[pose, sphere]`, root frame; empty for ellipsoids.
    pub(super) centres: Vec<Vec3>,
    /// `[pose, ellipsoid]`, root frame; empty for spheres.
    pub(super) ellipsoids: Vec<Ellipsoid>,
    /// The directions in which the union of ellipsoids is looked at.
    pub(super) sky: Option<Arc<Sky>>,
}

/// Points of one bone that are looked at together: indices within their block.
#[derive(Debug, Clone)]
pub(super) struct Chunk {
    pub(super) bone: usize,
    /// The last one repeats where there are fewer.
    pub(super) points: [usize; LANES],
    pub(super) count: usize,
}

/// Chunks of a block of points, by bone.
pub(super) fn chunks(bone_of_point: &[u16]) -> Vec<Chunk> {
    chunks_of(bone_of_point, (0..bone_of_point.len()).collect())
}

/// Chunks of some points of a block, by bone.
pub(super) fn chunks_of(bone_of_point: &[u16], mut order: Vec<usize>) -> Vec<Chunk> {
    order.sort_by_key(|&point| bone_of_point[point]);
    order
        .chunk_by(|&a, &b| bone_of_point[a] == bone_of_point[b])
        .flat_map(|of_bone| of_bone.chunks(LANES))
        .map(|some| Chunk {
            bone: usize::from(bone_of_point[some[0]]),
            points: std::array::from_fn(|lane| some[lane.min(some.len() - 1)]),
            count: some.len(),
        })
        .collect()
}

impl<'a> Explained<'a> {
    pub(in crate::fit) fn new(
        geometry: &'a Geometry<'a>,
        settings: &Settings,
        turns: &'a [Quat],
    ) -> Self {
        let rotations = (settings.frame == Frame::Bone).then_some(turns);
        let kind = (geometry.signal, geometry.order);
        let (unshadowed, in_tangent_frame) =
            (settings.unshadowed, settings.frame == Frame::Tangent);
        Self { geometry, kind, rotations, in_tangent_frame, unshadowed, occluders: None }
    }

    /// Also removes what these occluders block.
    pub(in crate::fit) fn place(&mut self, placed: Placed) {
        self.occluders = Some(placed);
    }

    fn poses(&self) -> usize {
        self.geometry.poses.len()
    }

    /// The bone's turn at a pose; none where coefficients stay in the root frame.
    pub(super) fn turn(&self, pose: usize, bone: usize) -> Quat {
        let bones = self.geometry.bones.nodes.len();
        self.rotations.map_or(Quat::IDENTITY, |turns| turns[pose * bones + bone].normalize())
    }

    /// Removes it from `values` `[pose, point, channel, coefficient]`, which are in the frame of
    /// the fit: subtracts the unshadowed signal and adds what the occluders block.
    pub(in crate::fit) fn remove(&self, points: Range<usize>, values: &mut [f32]) {
        let bones = &self.geometry.bones.of_point[points.clone()];
        let moved = self.geometry.moved_range(points);
        let chunks = chunks(bones);
        let mut work = self.occluders.as_ref().map_or_else(Work::default, |p| Work::new(p, 1));
        for pose in 0..self.poses() {
            let size = values.len() / self.poses();
            let values = &mut values[pose * size..(pose + 1) * size];
            for chunk in &chunks {
                self.remove_chunk(&moved, pose, chunk, bones.len(), values, &mut work);
            }
        }
    }

    fn remove_chunk(
        &self,
        moved: &Moved,
        pose: usize,
        chunk: &Chunk,
        points: usize,
        values: &mut [f32],
        work: &mut Work,
    ) {
        let count = self.kind.0.coefficients(self.kind.1);
        let width = values.len() / points;
        let turn = self.turn(pose, chunk.bone);
        let mut sums = vec![[0.0; LANES]; count];
        if self.unshadowed {
            let mut free = vec![0.0; count];
            for (lane, &point) in chunk.points.iter().enumerate() {
                let normal = match self.in_tangent_frame {
                    true => Vec3::Z,
                    false => into_bone(turn, moved.normals[pose * points + point]),
                };
                unshadowed(self.kind, normal, &mut free);
                sums.iter_mut().zip(&free).for_each(|(sum, free)| sum[lane] = -free);
            }
        }
        if let Some(placed) = &self.occluders {
            let weights = &placed.occluders.weights;
            let groups = weights.len() / self.geometry.points.count();
            let first = moved.first * groups;
            let gains: Vec<Lanes> = (0..groups)
                .map(|g| chunk.points.map(|point| weights[first + point * groups + g]))
                .collect();
            let seen = Seen { moved, pose, chunk, points };
            self.blocked(placed, &seen, &Weighing::Sum(&gains), work, &mut sums);
        }
        for (lane, &point) in chunk.points[..chunk.count].iter().enumerate() {
            for channel in values[point * width..(point + 1) * width].chunks_exact_mut(count) {
                channel.iter_mut().zip(&sums).for_each(|(value, sum)| *value += sum[lane]);
            }
        }
    }
}
