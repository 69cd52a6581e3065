//! Some vertices of a mesh on their own, so that a pose moves only them.

use super::{Mesh, MorphTarget};

impl Mesh {
    /// The listed vertices, in the order of the list, with everything that moves them and without
    /// triangles and parts. Deformers and morph weights keep their indices.
    ///
    /// # Panics
    /// If a vertex does not exist.
    #[must_use]
    pub fn subset(&self, vertices: &[u32]) -> Self {
        let mut places = vec![Vec::new(); self.positions.len()];
        for (place, &vertex) in (0_u32..).zip(vertices) {
            places[vertex as usize].push(place);
        }
        let all = || vertices.iter().map(|&vertex| vertex as usize);
        let mut influence_starts = vec![0];
        let mut influences = Vec::new();
        for vertex in all() {
            influences.extend_from_slice(self.influences_of(vertex));
            influence_starts.push(influences.len() as u32);
        }
        Self {
            positions: all().map(|vertex| self.positions[vertex]).collect(),
            normals: all().map(|vertex| self.normals[vertex]).collect(),
            deformers: self.deformers.clone(),
            influences,
            influence_starts,
            morphs: self.morphs.iter().map(|target| target.subset(&places)).collect(),
            weight_names: self.weight_names.clone(),
            default_weights: self.default_weights.clone(),
            ..Self::default()
        }
    }
}

impl MorphTarget {
    /// The deltas of vertices that have places, at these places.
    fn subset(&self, places: &[Vec<u32>]) -> Self {
        let mut entries: Vec<(u32, usize)> = Vec::new();
        for (i, &vertex) in self.vertices.iter().enumerate() {
            entries.extend(places[vertex as usize].iter().map(|&place| (place, i)));
        }
        entries.sort_unstable();
        let of = |deltas: &[glam::Vec3]| {
            let some = entries.iter().filter_map(|&(_, i)| deltas.get(i).copied());
            some.collect()
        };
        Self {
            weight: self.weight,
            vertices: entries.iter().map(|&(place, _)| place).collect(),
            position_deltas: of(&self.position_deltas),
            normal_deltas: of(&self.normal_deltas),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Vec3};

    use crate::rig::{Deformed, Deformer, Influence, Mesh, MorphTarget, RigidFrame, deform};

    /// Proves that a vertex of a subset, also one that is listed twice, moves as in the whole mesh:
    /// by several deformers and by morph targets with and without normals.
    #[test]
    fn a_subset_moves_like_the_whole() {
        let count = 6;
        let along = |i: usize| Vec3::new(i as f32, 1.0, -0.5 * i as f32);
        let influences = |i: usize| {
            let weight = i as f32 / count as f32;
            [(0, 1.0 - weight), (1, weight)]
                .map(|(deformer, weight)| Influence { deformer, weight })
        };
        let bind = Affine3A::IDENTITY;
        let mesh = Mesh {
            positions: (0..count).map(along).collect(),
            normals: (0..count).map(|i| along(i + 1).normalize()).collect(),
            deformers: (0..2).map(|node| Deformer { node, inverse_bind: bind }).collect(),
            influences: (0..count).flat_map(influences).collect(),
            influence_starts: (0..=count as u32).map(|i| 2 * i).collect(),
            morphs: vec![
                MorphTarget {
                    weight: 0,
                    vertices: vec![1, 4],
                    position_deltas: vec![Vec3::X, Vec3::Z],
                    normal_deltas: vec![Vec3::Y, Vec3::X],
                },
                MorphTarget {
                    weight: 1,
                    vertices: vec![4, 5],
                    position_deltas: vec![Vec3::Y, Vec3::ONE],
                    normal_deltas: Vec::new(),
                },
            ],
            ..Mesh::default()
        };
        let globals = [Affine3A::from_rotation_x(0.7), Affine3A::from_translation(Vec3::Y)];
        let moved = |mesh: &Mesh| {
            let mut out = Deformed::default();
            deform(mesh, &globals, &[0.5, -2.0], RigidFrame::IDENTITY, &mut out);
            out
        };
        let (whole, list) = (moved(&mesh), [4_u32, 0, 5, 4]);
        let some = moved(&mesh.subset(&list));
        for (place, &vertex) in list.iter().enumerate() {
            assert_eq!(some.positions[place], whole.positions[vertex as usize]);
            assert_eq!(some.normals[place], whole.normals[vertex as usize]);
        }
    }
}
