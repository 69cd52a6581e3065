//! The rest mesh with its binding: every part of the scene in one vertex list.

use std::ops::Range;

use glam::{Affine3A, Vec3};

/// A node that moves vertices, with the matrix that takes them into its space.
///
/// A skin contributes one deformer per joint; a rigid part contributes its own node with the
/// identity. So every vertex is moved by the same arithmetic: Σ weight · global(node) ·
/// `inverse_bind` · position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deformer {
    /// Index into [`super::Skeleton::nodes`].
    pub node: usize,
    /// Mesh space → the node's space at bind time.
    pub inverse_bind: Affine3A,
}

/// One weight of one vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Influence {
    /// Index into [`Mesh::deformers`].
    pub deformer: u32,
    /// Positive; a vertex's weights sum to 1.
    pub weight: f32,
}

/// Vertices and triangles of one primitive of one node, in the file's order.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// The carrying node, index into [`super::Skeleton::nodes`].
    pub node: usize,
    /// The file's own number of the node that shows it; 0 where files know no nodes.
    pub source_node: usize,
    /// The primitive's index within the node's mesh.
    pub primitive: usize,
    /// Mesh name, for messages.
    pub name: String,
    /// Into [`Mesh::positions`].
    pub vertices: Range<usize>,
    /// Into [`Mesh::triangles`].
    pub triangles: Range<usize>,
}

/// Sparse displacements that a weight scales.
#[derive(Debug, Clone, PartialEq)]
pub struct MorphTarget {
    /// Which weight of [`super::Pose::weights`] scales it.
    pub weight: usize,
    /// Ascending vertex indices into [`Mesh::positions`].
    pub vertices: Vec<u32>,
    /// One per entry of `vertices`, metres, mesh space.
    pub position_deltas: Vec<Vec3>,
    /// As `position_deltas`, or empty where the file has none.
    pub normal_deltas: Vec<Vec3>,
}

/// The whole scene's geometry at rest, and what moves it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Metres, each in its own mesh's space, before deformation.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, parallel to `positions`.
    pub normals: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Node, primitive, vertex: the glTF's own order. Ranges are contiguous and cover everything.
    pub parts: Vec<Part>,
    /// Everything that moves vertices.
    pub deformers: Vec<Deformer>,
    /// Influences of all vertices, concatenated.
    pub influences: Vec<Influence>,
    /// `influences[starts[v]..starts[v + 1]]` are those of vertex v; one longer than `positions`.
    pub influence_starts: Vec<u32>,
    /// Morph targets of all parts.
    pub morphs: Vec<MorphTarget>,
    /// One name per morph weight, such as `Body/smile`.
    pub weight_names: Vec<String>,
    /// Morph weights where no clip says otherwise, parallel to `weight_names`.
    pub default_weights: Vec<f32>,
}

impl Mesh {
    /// The influences of one vertex.
    #[must_use]
    pub fn influences_of(&self, vertex: usize) -> &[Influence] {
        let start = self.influence_starts[vertex] as usize;
        &self.influences[start..self.influence_starts[vertex + 1] as usize]
    }
}
