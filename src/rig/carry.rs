//! Meshes that a node carries along as a whole.

use glam::Affine3A;

use super::{Deformed, Deformer, Influence, Mesh, Part};

impl Mesh {
    /// Appends a mesh that moves rigidly with a node: at rest, where the node is at `rest`, its vertices
    /// are where `still` has them. `triangles` and `parts` count from its own first vertex and triangle.
    /// Where the node's rest transform has no inverse, the vertices do not move with it.
    ///
    /// # Panics
    /// If `still` has more positions than normals.
    pub fn carry(
        &mut self,
        (node, rest): (usize, Affine3A),
        still: &Deformed,
        triangles: &[[u32; 3]],
        parts: &[Part],
    ) {
        let (vertices, corners) = (self.positions.len(), self.triangles.len());
        let deformer = self.deformers.len() as u32;
        let inverse = rest.inverse();
        let inverse_bind = if inverse.is_finite() { inverse } else { Affine3A::IDENTITY };
        self.deformers.push(Deformer { node, inverse_bind });
        if self.influence_starts.is_empty() {
            self.influence_starts.push(0);
        }
        for (position, normal) in still.positions.iter().zip(&still.normals) {
            self.positions.push(*position);
            self.normals.push(normal.normalize_or_zero());
            self.influences.push(Influence { deformer, weight: 1.0 });
            self.influence_starts.push(self.influences.len() as u32);
        }
        assert_eq!(self.positions.len(), vertices + still.positions.len(), "normals");
        self.triangles.extend(triangles.iter().map(|t| t.map(|corner| vertices as u32 + corner)));
        self.parts.extend(parts.iter().map(|part| Part {
            node,
            vertices: vertices + part.vertices.start..vertices + part.vertices.end,
            triangles: corners + part.triangles.start..corners + part.triangles.end,
            ..part.clone()
        }));
    }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::*;
    use crate::rig::{RigidFrame, deform};

    /// Proves that what is carried is in its place at rest, turns with the node, and leaves what was
    /// there before untouched.
    #[test]
    fn what_is_carried_turns_with_its_node() {
        let rest = Affine3A::from_rotation_translation(Quat::from_rotation_x(0.7), Vec3::Y * 2.0);
        let part = Part {
            node: 9,
            source_node: 9,
            primitive: 0,
            name: "patch".into(),
            vertices: 0..3,
            triangles: 0..1,
        };
        let still = Deformed {
            positions: vec![Vec3::X, Vec3::Y, Vec3::Z],
            normals: vec![Vec3::Y * 3.0; 3],
        };
        let mut mesh = Mesh {
            positions: vec![Vec3::ONE; 3],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            parts: vec![Part { node: 0, ..part.clone() }],
            deformers: vec![Deformer { node: 0, inverse_bind: Affine3A::IDENTITY }],
            influences: vec![Influence { deformer: 0, weight: 1.0 }; 3],
            influence_starts: vec![0, 1, 2, 3],
            ..Mesh::default()
        };
        mesh.carry((1, rest), &still, &[[0, 1, 2]], &[part]);
        assert_eq!((mesh.triangles[1], mesh.parts[1].triangles.clone()), ([3, 4, 5], 1..2));
        assert_eq!((mesh.parts[1].node, mesh.normals[3]), (1, Vec3::Y));
        let posed = |global: Affine3A| {
            let mut out = Deformed::default();
            deform(&mesh, &[Affine3A::IDENTITY, global], &[], RigidFrame::IDENTITY, &mut out);
            out.positions
        };
        let turn = Affine3A::from_rotation_z(0.4);
        for (moved, by) in [(posed(rest), Affine3A::IDENTITY), (posed(turn * rest), turn)] {
            assert_eq!(moved[..3], [Vec3::ONE; 3]);
            for (found, place) in moved[3..].iter().zip(&still.positions) {
                assert!((*found - by.transform_point3(*place)).length() < 1e-5);
            }
        }
    }
}
