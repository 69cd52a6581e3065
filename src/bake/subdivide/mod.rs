//! Triangles refined where transfer changes (Křivánek, Pattanaik and Žára 2004, "Adaptive mesh
//! subdivision for precomputed radiance transfer").
//!
//! A priority queue of triangles by an estimate of their interpolation error ([`ErrorMeasure`]); the
//! worst is split in four and its new vertices are baked, until a [`Goal`] is reached; then triangles
//! with a neighbour's vertex on an edge are bisected. For an animated mesh the estimate is the
//! largest over its views: key poses, and in each pose the instances of a mesh.
//!
//! New vertices are baked in batches that look ahead in the queue, so that rays come by thousands;
//! the order of extraction is that of the algorithm but for coarser neighbours, which go first; those
//! are counted, and so is what a batch baked in vain.

mod fidelity;
mod leaf;
mod measure;
mod refine;
mod tessellation;

use std::sync::atomic::AtomicBool;

pub use fidelity::{Fidelity, Probes};
pub use leaf::Leaf;
pub use measure::{ErrorMeasure, Surplus};
pub use refine::{Refiner, Row, Source};
pub use tessellation::Tessellation;

use super::Error;

/// When to stop; the first that is reached counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Triangles of the result at most.
    pub triangles: usize,
    /// Vertices of the result at most.
    pub vertices: usize,
    /// No triangle's estimate is larger, in the measure's own unit.
    pub error: f32,
    /// How often a triangle is split in four at most.
    pub depth: u8,
    /// A triangle of less area is not split, in the unit of the input's areas. Where transfer jumps,
    /// as at a contact, no depth is enough, and this is what ends it.
    pub area: f32,
}

/// What a refinement did.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Work {
    /// Triangles split in four.
    pub splits: usize,
    /// Of them those that came before their turn, so that no triangle is more than one split coarser than
    /// another beside it.
    pub forced: usize,
    /// Triangles that were still worse than the goal, but as deep or as small as they may be.
    pub at_depth: usize,
    /// The largest estimate that is left.
    pub left: f32,
}

/// The refined mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// Triangles by root; corners index `rows`.
    pub triangles: Vec<Leaf>,
    /// The input's vertices, then the new ones.
    pub rows: Vec<Row>,
    /// Where each new vertex lies.
    pub places: Vec<super::Place>,
    /// The estimate of each triangle of `triangles`: that of the leaf it is part of.
    pub errors: Vec<f32>,
    /// Vertices that were baked and are not in the result.
    pub in_vain: usize,
}

impl Refiner<'_> {
    /// The result so far, its T-vertices bisected and every vertex baked.
    ///
    /// # Errors
    /// What the source objects to.
    pub fn finish(mut self, stop: &AtomicBool) -> Result<Refined, Error> {
        let (leaves, mut triangles): (Vec<usize>, Vec<Leaf>) =
            self.tessellation.conforming().into_iter().unzip();
        let errors = leaves.into_iter().map(|leaf| self.error(leaf)).collect();
        let used: Vec<u32> = triangles.iter().flat_map(|leaf| leaf.corners).collect();
        self.complete(&used, stop)?;
        let given = self.tessellation.given();
        let baked = self.rows.iter().filter(|row| !row.normals.is_empty()).count();
        let mut number = vec![u32::MAX; self.rows.len()];
        (0..given).for_each(|vertex| number[vertex] = vertex as u32);
        let mut rows = self.rows[..given].to_vec();
        let mut places = Vec::new();
        for leaf in &mut triangles {
            for corner in &mut leaf.corners {
                let vertex = *corner as usize;
                if number[vertex] == u32::MAX {
                    number[vertex] = rows.len() as u32;
                    rows.push(std::mem::take(&mut self.rows[vertex]));
                    places.push(self.tessellation.place(*corner));
                }
                *corner = number[vertex];
            }
        }
        let used = rows.iter().filter(|row| !row.normals.is_empty()).count();
        let in_vain = baked - used;
        Ok(Refined { triangles, rows, places, errors, in_vain })
    }
}
