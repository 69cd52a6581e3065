//! New vertices between old ones, with everything that moves them.

use std::collections::HashMap;

use glam::Vec3;

use super::{Influence, Mesh, MorphTarget};

/// A vertex between three others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mix {
    /// Indices into [`Mesh::positions`].
    pub vertices: [u32; 3],
    /// They sum to 1; a vertex of weight 0 does not count.
    pub weights: [f32; 3],
}

impl Mix {
    /// The vertices that count, with their weights.
    pub fn parts(&self) -> impl Iterator<Item = (usize, f32)> {
        let pairs = self.vertices.into_iter().zip(self.weights);
        pairs.filter(|(_, weight)| *weight > 0.0).map(|(vertex, weight)| (vertex as usize, weight))
    }

    /// The weighted mean of vectors at the vertices.
    #[must_use]
    pub fn of(&self, vectors: &[Vec3]) -> Vec3 {
        self.parts().map(|(vertex, weight)| weight * vectors[vertex]).sum()
    }
}

impl Mesh {
    /// The weights that move a vertex between others: their weighted mean, heaviest first.
    #[must_use]
    pub fn mixed_influences(&self, mix: &Mix) -> Vec<Influence> {
        let mut sums: Vec<Influence> = Vec::with_capacity(12);
        for (vertex, share) in mix.parts() {
            for &Influence { deformer, weight } in self.influences_of(vertex) {
                let weight = share * weight;
                match sums.iter_mut().find(|sum| sum.deformer == deformer) {
                    Some(sum) => sum.weight += weight,
                    None => sums.push(Influence { deformer, weight }),
                }
            }
        }
        sums.sort_by(|a, b| b.weight.total_cmp(&a.weight).then(a.deformer.cmp(&b.deformer)));
        sums
    }

    /// New vertices alone, without triangles and parts: positions, normals and morph deltas between
    /// those of the old, moved by the given influences. Deformers and morph weights keep their
    /// indices.
    ///
    /// # Panics
    /// If a vertex does not exist, or there are not as many influences as mixes.
    #[must_use]
    pub fn between(&self, mixes: &[Mix], influences: &[Vec<Influence>]) -> Self {
        assert_eq!(mixes.len(), influences.len(), "influences");
        let mut influence_starts = vec![0];
        let mut count = 0;
        for list in influences {
            count += list.len() as u32;
            influence_starts.push(count);
        }
        let normal = |mix: &Mix| mix.of(&self.normals).normalize_or(Vec3::Y);
        Self {
            positions: mixes.iter().map(|mix| mix.of(&self.positions)).collect(),
            normals: mixes.iter().map(normal).collect(),
            deformers: self.deformers.clone(),
            influences: influences.concat(),
            influence_starts,
            morphs: self.morphs.iter().map(|target| target.between(mixes)).collect(),
            weight_names: self.weight_names.clone(),
            default_weights: self.default_weights.clone(),
            ..Self::default()
        }
    }
}

impl MorphTarget {
    fn between(&self, mixes: &[Mix]) -> Self {
        let place: HashMap<u32, usize> = self.vertices.iter().copied().zip(0..).collect();
        let mut out = Self {
            weight: self.weight,
            vertices: Vec::new(),
            position_deltas: Vec::new(),
            normal_deltas: Vec::new(),
        };
        for (index, mix) in (0_u32..).zip(mixes) {
            let known =
                || mix.parts().filter_map(|(v, weight)| Some((*place.get(&(v as u32))?, weight)));
            if known().next().is_none() {
                continue;
            }
            let sum = |deltas: &[Vec3]| known().map(|(at, weight)| weight * deltas[at]).sum();
            out.vertices.push(index);
            out.position_deltas.push(sum(&self.position_deltas));
            if !self.normal_deltas.is_empty() {
                out.normal_deltas.push(sum(&self.normal_deltas));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use glam::Affine3A;

    use super::*;
    use crate::rig::{Deformed, Deformer, RigidFrame, deform};

    /// Two vertices of one bone and one of another, with a morph on one of them.
    fn mesh() -> Mesh {
        let influence = |deformer| Influence { deformer, weight: 1.0 };
        Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            deformers: (0..2)
                .map(|node| Deformer { node, inverse_bind: Affine3A::IDENTITY })
                .collect(),
            influences: vec![influence(0), influence(0), influence(1)],
            influence_starts: vec![0, 1, 2, 3],
            morphs: vec![MorphTarget {
                weight: 0,
                vertices: vec![1],
                position_deltas: vec![Vec3::Z],
                normal_deltas: Vec::new(),
            }],
            ..Mesh::default()
        }
    }

    /// Where every corner moves alike, the vertex between moves with them, morph included; and the
    /// weights of corners that do not are mixed, heaviest first.
    #[test]
    fn a_vertex_between_moves_between() {
        let mesh = mesh();
        let mix = |weights| Mix { vertices: [0, 1, 2], weights };
        let (edge, inner) = (mix([0.5, 0.5, 0.0]), mix([0.25, 0.25, 0.5]));
        let influences = [edge, inner].map(|mix| mesh.mixed_influences(&mix));
        assert_eq!(influences[0], [Influence { deformer: 0, weight: 1.0 }]);
        let half = |deformer| Influence { deformer, weight: 0.5 };
        assert_eq!(influences[1], [half(0), half(1)]);
        let new = mesh.between(&[edge, inner], &influences);
        let turn = Affine3A::from_rotation_z(0.5);
        let globals = [turn, Affine3A::from_translation(Vec3::Z)];
        let moved = |mesh: &Mesh| {
            let mut out = Deformed::default();
            deform(mesh, &globals, &[0.8], RigidFrame::IDENTITY, &mut out);
            out.positions
        };
        let (old, new) = (moved(&mesh), moved(&new));
        assert!((new[0] - edge.of(&old)).length() < 1e-6);
        // Skinning is bilinear: the vertex at the joint does not lie on the posed triangle.
        assert!((new[1] - inner.of(&old)).length() > 0.1);
    }
}
