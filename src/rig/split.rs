//! A mesh in two: what is lit, and what only blocks.

use glam::Vec3;

use super::{Mesh, MorphTarget, Part};

impl Mesh {
    /// The parts for which `chosen` is false, and those for which it is true. Both keep the order of
    /// parts, all deformers and all morph weights, so one pose moves both.
    #[must_use]
    pub fn split(&self, chosen: impl Fn(&Part) -> bool) -> (Self, Self) {
        (self.parts_where(|part| !chosen(part)), self.parts_where(chosen))
    }

    fn parts_where(&self, keep: impl Fn(&Part) -> bool) -> Self {
        const GONE: u32 = u32::MAX;
        let mut new = Self {
            deformers: self.deformers.clone(),
            influence_starts: vec![0],
            weight_names: self.weight_names.clone(),
            default_weights: self.default_weights.clone(),
            ..Self::default()
        };
        let mut moved = vec![GONE; self.positions.len()];
        for part in self.parts.iter().filter(|part| keep(part)) {
            let vertices = new.positions.len()..new.positions.len() + part.vertices.len();
            let triangles = new.triangles.len()..new.triangles.len() + part.triangles.len();
            for (old, now) in part.vertices.clone().zip(vertices.clone()) {
                moved[old] = now as u32;
                new.influences.extend(self.influences_of(old));
                new.influence_starts.push(new.influences.len() as u32);
            }
            new.positions.extend(&self.positions[part.vertices.clone()]);
            new.normals.extend(&self.normals[part.vertices.clone()]);
            let corners = &self.triangles[part.triangles.clone()];
            new.triangles.extend(corners.iter().map(|t| t.map(|corner| moved[corner as usize])));
            new.parts.push(Part { vertices, triangles, ..part.clone() });
        }
        new.morphs = self.morphs.iter().filter_map(|target| remaining(target, &moved)).collect();
        new
    }
}

/// The entries of a target whose vertices remain, if there are any.
fn remaining(target: &MorphTarget, moved: &[u32]) -> Option<MorphTarget> {
    let kept: Vec<usize> = (0..target.vertices.len())
        .filter(|&entry| moved[target.vertices[entry] as usize] != u32::MAX)
        .collect();
    let pick = |deltas: &[Vec3]| -> Vec<Vec3> {
        if deltas.is_empty() { Vec::new() } else { kept.iter().map(|&i| deltas[i]).collect() }
    };
    (!kept.is_empty()).then(|| MorphTarget {
        weight: target.weight,
        vertices: kept.iter().map(|&entry| moved[target.vertices[entry] as usize]).collect(),
        position_deltas: pick(&target.position_deltas),
        normal_deltas: pick(&target.normal_deltas),
    })
}

#[cfg(test)]
mod tests {
    use glam::Affine3A;

    use super::*;
    use crate::rig::{Deformed, Deformer, Influence, RigidFrame, deform};

    /// Three parts of one triangle each, the second and third moved by a morph, each by its node.
    fn mesh() -> Mesh {
        let part = |index: usize| Part {
            node: index,
            source_node: index,
            primitive: 0,
            name: format!("part{index}"),
            vertices: 3 * index..3 * index + 3,
            triangles: index..index + 1,
        };
        let bind = Affine3A::IDENTITY;
        Mesh {
            positions: (0..9).map(|i| Vec3::new(i as f32, (i * i) as f32, 1.0)).collect(),
            normals: vec![Vec3::Z; 9],
            triangles: (0..3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            parts: (0..3).map(part).collect(),
            deformers: (0..3).map(|node| Deformer { node, inverse_bind: bind }).collect(),
            influences: (0..9).map(|i| Influence { deformer: i / 3, weight: 1.0 }).collect(),
            influence_starts: (0..=9).collect(),
            morphs: vec![MorphTarget {
                weight: 0,
                vertices: vec![4, 7, 8],
                position_deltas: vec![Vec3::X, Vec3::Y, Vec3::Z],
                normal_deltas: vec![],
            }],
            weight_names: vec!["push".into()],
            default_weights: vec![0.0],
        }
    }

    /// Proves that both halves together hold every part once, and that a pose moves each vertex as
    /// it moved it in the whole.
    #[test]
    fn halves_move_as_the_whole() {
        let whole = mesh();
        let (rest, chosen) = whole.split(|part| part.node == 1);
        assert_eq!((rest.parts.len(), chosen.parts.len()), (2, 1));
        let globals: Vec<Affine3A> =
            (0..3).map(|i| Affine3A::from_rotation_x(i as f32 * 0.4)).collect();
        let posed = |mesh: &Mesh| {
            let mut out = Deformed::default();
            deform(mesh, &globals, &[0.5], RigidFrame::IDENTITY, &mut out);
            out.positions
        };
        let all = posed(&whole);
        assert_eq!(posed(&rest), [&all[..3], &all[6..]].concat());
        assert_eq!(posed(&chosen), all[3..6]);
        assert_eq!(
            (rest.triangles, chosen.triangles),
            (vec![[0, 1, 2], [3, 4, 5]], vec![[0, 1, 2]])
        );
        assert_eq!(whole.split(|_| false).0, whole);
    }
}
