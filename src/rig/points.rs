//! Vertices that can never differ, merged to the points that are baked.

use std::collections::HashMap;

use super::Mesh;

/// The map between vertices and points.
///
/// Two vertices are one point where they agree bitwise in position, normal, influences and morph
/// deltas: then every pose puts them at the same place with the same normal, so they have the same
/// signal. Points are numbered by their first vertex.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Points {
    /// Point → its first vertex.
    pub vertex: Vec<u32>,
    /// Vertex → its point.
    pub of_vertex: Vec<u32>,
}

impl Points {
    /// Finds the points of a mesh.
    ///
    /// Deformers that move alike (same node, same inverse bind) count as one, the order of a
    /// vertex's influences does not matter, and −0 equals 0.
    ///
    /// # Panics
    /// If the mesh has more than 2³² vertices or its arrays disagree in length.
    #[must_use]
    pub fn merge(mesh: &Mesh) -> Self {
        Self::merge_apart(mesh, &[])
    }

    /// The same where meshes that lie in one another are not treated alike: vertices of parts of different
    /// kinds are never one point. `kinds` has one for each part, or none at all.
    ///
    /// # Panics
    /// As [`Self::merge`].
    #[must_use]
    pub fn merge_apart(mesh: &Mesh, kinds: &[u32]) -> Self {
        let mut kind_of = vec![0; mesh.positions.len()];
        for (part, &kind) in mesh.parts.iter().zip(kinds) {
            kind_of[part.vertices.clone()].fill(kind);
        }
        let deformers = canonical_deformers(mesh);
        let morphs = morph_words(mesh);
        let mut seen: HashMap<Vec<u32>, u32> = HashMap::with_capacity(mesh.positions.len());
        let mut points = Self::default();
        for (vertex, &kind) in kind_of.iter().enumerate() {
            let mut key = Vec::with_capacity(17);
            key.push(kind);
            key.extend(words(mesh.positions[vertex].to_array()));
            key.extend(words(mesh.normals[vertex].to_array()));
            let mut influences: Vec<[u32; 2]> = mesh
                .influences_of(vertex)
                .iter()
                .map(|one| [deformers[one.deformer as usize], one.weight.to_bits()])
                .collect();
            influences.sort_unstable();
            key.extend(influences.into_iter().flatten());
            // Influences come in pairs and morph words in sevens; this divides the two lists.
            key.push(u32::MAX);
            key.extend(morphs.get(&vertex).into_iter().flatten());
            let next = index(points.vertex.len());
            let point = *seen.entry(key).or_insert(next);
            if point == next {
                points.vertex.push(index(vertex));
            }
            points.of_vertex.push(point);
        }
        points
    }

    /// The map of which one half is known; `of_vertex` numbers points by their first vertex.
    #[must_use]
    pub fn numbered(of_vertex: &[u32]) -> Self {
        let mut vertex = Vec::new();
        for (index, &point) in (0..).zip(of_vertex) {
            if point as usize == vertex.len() {
                vertex.push(index);
            }
        }
        Self { vertex, of_vertex: of_vertex.to_vec() }
    }

    /// How many points there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.vertex.len()
    }
}

fn index(count: usize) -> u32 {
    u32::try_from(count).expect("a mesh has fewer than 2^32 vertices")
}

/// Bit patterns; adding 0 turns −0 into 0.
fn words(values: [f32; 3]) -> [u32; 3] {
    values.map(|value| (value + 0.0).to_bits())
}

/// Deformer → the first deformer that moves alike.
fn canonical_deformers(mesh: &Mesh) -> Vec<u32> {
    let mut seen = HashMap::new();
    mesh.deformers
        .iter()
        .enumerate()
        .map(|(i, deformer)| {
            let bits = deformer.inverse_bind.to_cols_array().map(|x| (x + 0.0).to_bits());
            *seen.entry((deformer.node, bits)).or_insert(index(i))
        })
        .collect()
}

/// Vertex → its deltas that are not zero, as (weight slot, position, normal) in words.
fn morph_words(mesh: &Mesh) -> HashMap<usize, Vec<u32>> {
    let mut found: HashMap<usize, Vec<u32>> = HashMap::new();
    for target in &mesh.morphs {
        for (i, &vertex) in target.vertices.iter().enumerate() {
            let position = words(target.position_deltas[i].to_array());
            let normal = words(target.normal_deltas.get(i).map_or([0.0; 3], |d| d.to_array()));
            if position == [0; 3] && normal == [0; 3] {
                continue;
            }
            let entry = found.entry(vertex as usize).or_default();
            entry.push(index(target.weight));
            entry.extend(position);
            entry.extend(normal);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Vec3};

    use super::*;
    use crate::rig::{Deformer, Influence, MorphTarget};

    /// Four vertices at one place; the closure may make some of them differ.
    fn merged(change: impl Fn(&mut Mesh)) -> Points {
        let bind = Affine3A::IDENTITY;
        let mut mesh = Mesh {
            positions: vec![Vec3::X; 4],
            normals: vec![Vec3::Y; 4],
            deformers: (0..3).map(|i| Deformer { node: i / 2, inverse_bind: bind }).collect(),
            influences: vec![Influence { deformer: 0, weight: 1.0 }; 4],
            influence_starts: vec![0, 1, 2, 3, 4],
            ..Mesh::default()
        };
        change(&mut mesh);
        Points::merge(&mesh)
    }

    /// Proves that equal vertices become one point and that each thing that can make them move or
    /// shade differently keeps them apart.
    #[test]
    fn merges_only_what_agrees() {
        let one = merged(|_| ());
        assert_eq!((one.vertex, one.of_vertex), (vec![0], vec![0; 4]));
        assert_eq!(merged(|m| m.positions[2].y = 1e-30).of_vertex, [0, 0, 1, 0]);
        assert_eq!(merged(|m| m.positions[2].y = -0.0).of_vertex, [0; 4]);
        assert_eq!(merged(|m| m.normals[0] = Vec3::Z).of_vertex, [0, 1, 1, 1]);
        assert_eq!(merged(|m| m.influences[3].weight = 0.5).of_vertex, [0, 0, 0, 1]);
        assert_eq!(merged(|m| m.influences[3].deformer = 2).of_vertex, [0, 0, 0, 1]);
        assert_eq!(merged(|m| m.influences[3].deformer = 1).of_vertex, [0; 4]);
    }

    /// Proves that a morph delta parts vertices and that a delta of zero does not.
    #[test]
    fn morph_deltas_part_vertices() {
        let with = |delta: Vec3| {
            merged(|mesh| {
                mesh.morphs = vec![MorphTarget {
                    weight: 0,
                    vertices: vec![1, 3],
                    position_deltas: vec![delta, Vec3::ZERO],
                    normal_deltas: Vec::new(),
                }];
            })
        };
        assert_eq!(with(Vec3::X).of_vertex, [0, 1, 0, 0]);
        assert_eq!(with(Vec3::ZERO).of_vertex, [0; 4]);
    }

    /// Proves that what is not treated alike is kept apart, however much it agrees.
    #[test]
    fn kinds_part_vertices() {
        let part = |vertices| crate::rig::Part {
            node: 0,
            source_node: 0,
            primitive: 0,
            name: "layer".into(),
            vertices,
            triangles: 0..0,
        };
        let layered = |kinds: &[u32]| {
            let mesh = Mesh {
                positions: vec![Vec3::X; 4],
                normals: vec![Vec3::Y; 4],
                influence_starts: vec![0; 5],
                parts: vec![part(0..1), part(1..2), part(2..4)],
                ..Mesh::default()
            };
            Points::merge_apart(&mesh, kinds).of_vertex
        };
        assert_eq!(layered(&[]), [0; 4]);
        assert_eq!(layered(&[7, 7, 7]), [0; 4]);
        assert_eq!(layered(&[7, 1, 7]), [0, 1, 0, 0]);
    }
}
