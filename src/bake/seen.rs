//! What the rays of a point hit, kept small: rows of the transport matrix before albedo.

use glam::Vec3;

use super::ground;
use super::posed::{Posed, Stage};
use crate::num::directions::Set;
use crate::trace::{Hit, Rays};

/// A hit on the front of a triangle that reflects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    pub(super) triangle: u32,
    /// Weights of the second and third corner in steps of 1/65,535: finer than any texture.
    place: [u16; 2],
}

impl Seen {
    fn new(hit: &Hit, triangle: u32) -> Self {
        let step = |weight: f32| (weight.clamp(0.0, 1.0) * 65535.0).round() as u16;
        let u = step(hit.u);
        // Rounding must not push the place over the third edge.
        Self { triangle, place: [u, step(hit.v).min(u16::MAX - u)] }
    }

    /// Weights of the second and third corner.
    pub(super) fn place(&self) -> (f32, f32) {
        let [u, v] = self.place.map(|step| f32::from(step) / 65535.0);
        (u, v)
    }
}

/// All hits of a point, batch after batch.
#[derive(Debug, Clone, Default)]
pub(super) struct Row {
    seen: Vec<Seen>,
    ends: Vec<u32>,
}

impl Row {
    /// The hits of each batch.
    pub(super) fn batches(&self) -> impl Iterator<Item = &[Seen]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.seen[start as usize..end as usize])
    }
}

/// Takes the nearest hits of a point's rays.
#[derive(Debug)]
pub(super) struct Sink<'a> {
    stage: &'a Stage,
    normals: &'a [Vec3],
    /// Triangles from here on reflect nothing.
    black: usize,
    hits: Vec<Option<Hit>>,
    row: Row,
}

impl<'a> Sink<'a> {
    pub(super) fn new(stage: &'a Stage, normals: &'a [Vec3], black: usize, rays: usize) -> Self {
        Self { stage, normals, black, hits: vec![None; rays], row: Row::default() }
    }

    /// The row since the last call.
    pub(super) fn take(&mut self) -> Row {
        let mut row = std::mem::take(&mut self.row);
        row.seen.shrink_to_fit();
        row
    }

    /// Traces one set: sets the bits of blocked rays and adds both halves' hits to the row.
    pub(super) fn trace(
        &mut self,
        posed: &Posed,
        point: usize,
        rays: &Rays<'_>,
        set: &Set<'_>,
        blocked: &mut [u64],
    ) {
        let tree = posed.tree(point);
        posed.scene(point).nearest(rays, &mut self.hits);
        blocked.fill(0);
        if let Some(heights) = &posed.heights {
            ground::block(rays, heights[point], blocked);
            for (lane, hit) in self.hits.iter_mut().enumerate() {
                let floor = ground::distance(rays.y[lane], heights[point], rays.near);
                *hit = hit.filter(|hit| hit.distance < floor);
            }
        }
        for second in [0, 1] {
            for (lane, hit) in self.hits.iter().enumerate() {
                let Some(hit) = hit else { continue };
                let (word, bit) = (lane / 64, lane % 64);
                if set.second_half[word] >> bit & 1 != second {
                    continue;
                }
                blocked[word] |= 1 << bit;
                let triangle = self.stage.trees.original(tree, hit.triangle);
                let direction = Vec3::new(rays.x[lane], rays.y[lane], rays.z[lane]);
                if (triangle as usize) < self.black && self.is_front(triangle, hit, direction) {
                    self.row.seen.push(Seen::new(hit, triangle));
                }
            }
            self.row.ends.push(self.row.seen.len() as u32);
        }
    }

    /// Whether the ray meets the side that the vertex normals point to: the order of corners says
    /// nothing under a mirroring node.
    fn is_front(&self, triangle: u32, hit: &Hit, direction: Vec3) -> bool {
        let corners = self.stage.triangles[triangle as usize];
        let outwards: Vec3 = corners.map(|corner| self.normals[corner as usize]).iter().sum();
        let facing = if hit.normal.dot(outwards) < 0.0 { -hit.normal } else { hit.normal };
        facing.dot(direction) < 0.0
    }
}
