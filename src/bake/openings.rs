//! What of the surfaces lets rays through: cut-out and blended materials, and backs that do not block.

use std::sync::Arc;

use glam::Vec3;

use crate::num::random::{hash, unit};
use crate::scene::{Alpha, Surface};
use crate::trace::{Candidate, Filter};

/// Materials that do not block every ray. A mask blocks where its alpha reaches the threshold. Of a
/// blended material the share alpha of all rays is blocked, ray by ray at random, so that the mean is
/// that of a surface that thins the light; what it blocks and what it lets through is the same for
/// all colours.
#[derive(Debug, Clone, PartialEq)]
pub struct Openings {
    /// Of all triangles; those that it does not have are solid.
    pub surface: Arc<Surface>,
    /// Whether alpha counts.
    pub alpha: bool,
    /// Whether a material that is not double-sided blocks from its front alone.
    pub one_sided: bool,
}

impl Openings {
    /// Whether rays through this triangle must be asked about.
    fn asks(&self, triangle: usize) -> bool {
        self.surface.of(triangle).is_some_and(|material| {
            let cut = self.alpha && material.alpha != Alpha::Opaque;
            cut || (self.one_sided && !material.double_sided)
        })
    }

    /// What the tracer asks about a tree of `(number in the mesh, corners)`, in its order; positions
    /// and shading normals are those of the pose, by which triangles know their front.
    pub(super) fn filter(
        self: &Arc<Self>,
        tree: impl Iterator<Item = (u32, [u32; 3])>,
        positions: &[Vec3],
        normals: &[Vec3],
    ) -> Filter {
        let (mut triangles, mut asked) = (Vec::new(), Vec::new());
        for (at, (number, corners)) in tree.enumerate() {
            if !self.asks(number as usize) {
                continue;
            }
            let [a, b, c] = corners.map(|corner| positions[corner as usize]);
            let outwards: Vec3 = corners.map(|corner| normals[corner as usize]).iter().sum();
            // The order of corners says nothing under a mirroring node.
            let turned = (b - a).cross(c - a).dot(outwards) < 0.0;
            triangles.push(at as u32);
            asked.push((number, turned));
        }
        let openings = Arc::clone(self);
        let counts = move |candidate: &Candidate| {
            let (number, turned) = asked[candidate.index];
            openings.blocks(number as usize, turned, candidate)
        };
        Filter { triangles, counts: Arc::new(counts) }
    }

    fn blocks(&self, triangle: usize, turned: bool, candidate: &Candidate) -> bool {
        let double_sided = self.surface.of(triangle).is_none_or(|material| material.double_sided);
        let towards = candidate.normal.dot(candidate.direction) < 0.0;
        if self.one_sided && !double_sided && towards == turned {
            return false;
        }
        if !self.alpha {
            return true;
        }
        let Candidate { u, v, .. } = *candidate;
        let covered = f64::from(self.surface.coverage(triangle, u, v));
        // A place is met once: its own bits are as good a stream as any.
        let place = [u64::from(u.to_bits()), u64::from(v.to_bits()), triangle as u64];
        covered >= 1.0 || unit(hash(&place)) < covered
    }
}
