//! Turning a data set's coefficients from the root frame into each point's tangent frame (RPO09 §5.2).

use std::ops::Range;

use super::geometry::Geometry;
use crate::rig::to_tangent_frame;
use crate::sh::{MAX_COEFFICIENTS, Order, Rotation};

/// The tangent frames of all points at all poses, which are posed anew for every block of points.
#[derive(Debug)]
pub(super) struct TangentFrame<'a> {
    order: Order,
    geometry: &'a Geometry<'a>,
}

impl<'a> TangentFrame<'a> {
    pub(super) fn new(order: Order, geometry: &'a Geometry<'a>) -> Self {
        Self { order, geometry }
    }

    /// Turns `values` `[pose, point, channel, coefficient]` of a range of points.
    pub(super) fn turn(&self, points: Range<usize>, values: &mut [f32]) {
        let moved = self.geometry.moved_range(points.clone());
        let count = self.order.coefficients();
        let mut rotation = Rotation::identity(self.order);
        let mut turned = [0.0; MAX_COEFFICIENTS];
        let width = values.len() / (self.geometry.poses.len() * points.len());
        let frames = moved.normals.iter().zip(&moved.tangents);
        for (row, (&normal, &tangent)) in values.chunks_exact_mut(width).zip(frames) {
            rotation.set(to_tangent_frame(normal, tangent));
            for channel in row.chunks_exact_mut(count) {
                rotation.apply(channel, &mut turned);
                channel.copy_from_slice(&turned[..count]);
            }
        }
    }
}
