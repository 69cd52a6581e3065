//! Which bone a point sits on, which node carries the character, and how both have turned.

use glam::{Affine3A, Quat, Vec3};

use super::rotation::nearest_rotation;
use super::{Mesh, Points, RigidFrame, Skeleton};

/// A node counts as the root where at least this share of the deforming weight lies under it.
const ROOT_SHARE: f64 = 0.99;

/// The nodes that dominate some point, and which of them dominates each.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Bones {
    /// Bone → node, ascending.
    pub nodes: Vec<usize>,
    /// Point → bone.
    pub of_point: Vec<u16>,
}

impl Bones {
    /// Gives each point the node with the largest total weight on its vertex (the lowest index
    /// where two are equal).
    ///
    /// # Panics
    /// If more than 65,536 nodes dominate a point, or a vertex has no influence.
    #[must_use]
    pub fn dominant(mesh: &Mesh, points: &Points) -> Self {
        let node_of_point: Vec<usize> =
            points.vertex.iter().map(|&vertex| dominant_node(mesh, vertex as usize)).collect();
        let mut nodes = node_of_point.clone();
        nodes.sort_unstable();
        nodes.dedup();
        let of_point = node_of_point
            .iter()
            .map(|node| u16::try_from(nodes.partition_point(|other| other < node)))
            .collect::<Result<_, _>>()
            .expect("at most 65,536 bones");
        Self { nodes, of_point }
    }
}

fn dominant_node(mesh: &Mesh, vertex: usize) -> usize {
    let mut totals: Vec<(usize, f32)> = Vec::with_capacity(8);
    for influence in mesh.influences_of(vertex) {
        let node = mesh.deformers[influence.deformer as usize].node;
        match totals.iter_mut().find(|(other, _)| *other == node) {
            Some((_, weight)) => *weight += influence.weight,
            None => totals.push((node, influence.weight)),
        }
    }
    totals
        .into_iter()
        .reduce(|best, next| {
            let better = next.1 > best.1 || (next.1 == best.1 && next.0 < best.0);
            if better { next } else { best }
        })
        .map(|(node, _)| node)
        .expect("every vertex has an influence")
}

/// Node → the sum of all influences on it and on everything below it, in vertices.
///
/// # Panics
/// If a deformer names a node that the skeleton does not have.
#[must_use]
pub fn carried_weight(skeleton: &Skeleton, mesh: &Mesh) -> Vec<f64> {
    let mut carried = vec![0.0_f64; skeleton.nodes.len()];
    for influence in &mesh.influences {
        carried[mesh.deformers[influence.deformer as usize].node] += f64::from(influence.weight);
    }
    for node in (0..carried.len()).rev() {
        if let Some(parent) = skeleton.nodes[node].parent {
            carried[parent] += carried[node];
        }
    }
    carried
}

/// The deepest node under which at least 99 % of the deforming weight lies: its rigid motion is
/// the character's own. `None` where there is none (several roots, or no vertices).
#[must_use]
pub fn root_node(skeleton: &Skeleton, mesh: &Mesh) -> Option<usize> {
    let carried = carried_weight(skeleton, mesh);
    let roots = skeleton.nodes.iter().zip(&carried).filter(|(node, _)| node.parent.is_none());
    let total: f64 = roots.map(|(_, weight)| weight).sum();
    if total <= 0.0 {
        return None;
    }
    // Two nodes with 99 % each share vertices, so one is above the other: the last is the deepest.
    carried.iter().rposition(|&weight| weight >= ROOT_SHARE * total)
}

/// The rigid motion of the root node since rest: the rotation of globals · rest⁻¹ and the
/// translation that carries the node's rest origin to where it is now. A character that only
/// moves and turns as a whole is at rest in this frame. The identity where there is no root node.
///
/// # Panics
/// If the slices are shorter than `root_node` demands.
#[must_use]
pub fn root_frame(
    skeleton: &Skeleton,
    globals: &[Affine3A],
    rest_globals: &[Affine3A],
    root_node: Option<usize>,
) -> RigidFrame {
    let Some(node) = root_node else {
        return RigidFrame::IDENTITY;
    };
    assert!(node < skeleton.nodes.len(), "the root is a node of the skeleton");
    let rotation = turn(&globals[node], &rest_globals[node]).unwrap_or(Quat::IDENTITY);
    let rest_origin = Vec3::from(rest_globals[node].translation);
    let translation = Vec3::from(globals[node].translation) - rotation * rest_origin;
    RigidFrame { rotation, translation }
}

/// How each bone has turned since rest, seen from the root frame: the rotation of the polar
/// decomposition of globals · rest⁻¹, so scales do not disturb it. A bone that the pose crushes to
/// a line or a point has no rotation and counts as one that turns with the root (the identity).
///
/// # Panics
/// If the slices are shorter than the bones' nodes demand.
#[must_use]
pub fn bone_rotations(
    globals: &[Affine3A],
    rest_globals: &[Affine3A],
    root: RigidFrame,
    bones: &Bones,
) -> Vec<Quat> {
    let to_root = root.rotation.inverse();
    bones
        .nodes
        .iter()
        .map(|&node| {
            turn(&globals[node], &rest_globals[node])
                .map_or(Quat::IDENTITY, |rotation| (to_root * rotation).normalize())
        })
        .collect()
}

/// The rotation since rest. Where the node is crushed at rest (hidden by a zero scale) there is no
/// "since", and its rotation in the scene stands in: it differs by a constant only.
pub(super) fn turn(global: &Affine3A, rest: &Affine3A) -> Option<Quat> {
    let inverse = rest.matrix3.inverse();
    let motion = if inverse.is_finite() { global.matrix3 * inverse } else { global.matrix3 };
    nearest_rotation(motion)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{Deformer, Influence, Node, Transform};

    /// Nodes 0 → 1 → 2 and 1 → 3, one vertex per given influence list.
    fn rig(vertices: &[&[(u32, f32)]]) -> (Skeleton, Mesh) {
        let parents = [None, Some(0), Some(1), Some(1)];
        let nodes = parents.iter().enumerate().map(|(i, &parent)| Node {
            name: format!("node{i}"),
            parent,
            rest: Transform { translation: Vec3::Y, ..Transform::IDENTITY },
        });
        let mut mesh = Mesh { influence_starts: vec![0], ..Mesh::default() };
        mesh.deformers =
            (0..4).map(|node| Deformer { node, inverse_bind: Affine3A::IDENTITY }).collect();
        for list in vertices {
            mesh.positions.push(Vec3::splat(mesh.positions.len() as f32));
            mesh.normals.push(Vec3::Y);
            let weights = list.iter().map(|&(deformer, weight)| Influence { deformer, weight });
            mesh.influences.extend(weights);
            mesh.influence_starts.push(u32::try_from(mesh.influences.len()).unwrap());
        }
        (Skeleton { nodes: nodes.collect() }, mesh)
    }

    /// Proves the choice of the dominant bone: largest weight, lower node on a tie, bones that
    /// dominate nothing are not listed.
    #[test]
    fn dominant_bones() {
        let (_, mesh) = rig(&[&[(3, 0.6), (1, 0.4)], &[(3, 0.5), (1, 0.5)], &[(3, 1.0)]]);
        let bones = Bones::dominant(&mesh, &Points::merge(&mesh));
        assert_eq!(bones.nodes, [1, 3]);
        assert_eq!(bones.of_point, [1, 0, 1]);
    }

    /// Proves that the root is the deepest node above everything that deforms, also above a
    /// stray percent, and that nothing deforming means no root.
    #[test]
    fn root_is_the_deepest_common_ancestor() {
        let (skeleton, mesh) = rig(&[&[(2, 1.0)], &[(3, 1.0)]]);
        assert_eq!(root_node(&skeleton, &mesh), Some(1));
        let (skeleton, mesh) = rig(&[&[(2, 0.995), (0, 0.005)]]);
        assert_eq!(root_node(&skeleton, &mesh), Some(2));
        let (skeleton, mesh) = rig(&[]);
        assert_eq!(root_node(&skeleton, &mesh), None);
    }

    /// Proves that a rigid motion of the whole character vanishes in the root frame, scale of the
    /// root or not, and that bone rotations do not see it either.
    #[test]
    fn rigid_motion_vanishes() {
        let (mut skeleton, mesh) = rig(&[&[(2, 1.0)], &[(3, 1.0)]]);
        skeleton.nodes[1].rest.scale = Vec3::new(2.0, 0.5, 1.0);
        let rest: Vec<Transform> = skeleton.nodes.iter().map(|node| node.rest).collect();
        let rest_globals = skeleton.globals(&rest);
        let turned = Quat::from_euler(glam::EulerRot::XYZ, 0.3, 2.0, -0.4);
        let motion = Affine3A::from_rotation_translation(turned, Vec3::new(5.0, 1.0, -2.0));
        let globals: Vec<Affine3A> = rest_globals.iter().map(|global| motion * *global).collect();
        let root = root_node(&skeleton, &mesh);
        let frame = root_frame(&skeleton, &globals, &rest_globals, root);
        assert!((frame.inverse() * motion).abs_diff_eq(Affine3A::IDENTITY, 1e-5), "{frame:?}");
        let bones = Bones::dominant(&mesh, &Points::merge(&mesh));
        for rotation in bone_rotations(&globals, &rest_globals, frame, &bones) {
            assert!(rotation.dot(Quat::IDENTITY).abs() > 1.0 - 1e-6, "{rotation}");
        }
    }

    /// Proves that crushed and mirrored bones give finite rotations, and that one that is hidden
    /// at rest still has its rotation in the pose.
    #[test]
    fn crushed_bones_stay_finite() {
        let bones = Bones { nodes: vec![0], of_point: vec![0] };
        let turned = Affine3A::from_rotation_x(1.0);
        let zero = Affine3A::from_scale(Vec3::ZERO);
        let mirror = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
        let rotation = |now: Affine3A, rest: Affine3A| {
            bone_rotations(&[now], &[rest], RigidFrame::IDENTITY, &bones)[0]
        };
        assert_eq!(rotation(zero, Affine3A::IDENTITY), Quat::IDENTITY);
        assert_eq!(rotation(mirror, Affine3A::IDENTITY), Quat::IDENTITY);
        assert!(rotation(turned, zero).angle_between(Quat::from_rotation_x(1.0)) < 1e-3);
        let both = rotation(turned * mirror, mirror);
        assert!(both.angle_between(Quat::from_rotation_x(1.0)) < 1e-3, "{both}");
    }
}
