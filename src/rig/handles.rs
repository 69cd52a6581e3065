//! The parametrisation `handles` of a pose (AO07 §3, figure 4): where the joints are in the root
//! frame, and where a point beside each bone is, so that a bone's turn about itself shows too.
//! Distances between such vectors are distances in space, which joint angles do not offer.

use glam::{Affine3A, Vec3};

use super::parametrisation::{Source, varies};
use super::{Parametrisation, Pose, Skeleton};

/// Length of the handles of a bone without a length, in model sizes.
const SHORT: f32 = 0.02;

impl Parametrisation {
    /// Three parameters for each handle of each node that `carries` vertices: the joint itself,
    /// and a point at the bone's rest length beside it, perpendicular to the bone. A bone leads
    /// to the first child that carries; a node without one is a bone of half its own rest length
    /// along its own direction, and its tip is a handle as well. Then the morph weights.
    ///
    /// A coordinate that does not vary over the `training` poses (each with its nodes in the root
    /// frame) has no parameter; where that is a whole handle, it is named in `dropped`.
    ///
    /// # Panics
    /// If `carries` or a pose has another length than the skeleton, or `size_m` is not positive.
    #[must_use]
    pub fn handles(
        skeleton: &Skeleton,
        training: &[(&Pose, Vec<Affine3A>)],
        size_m: f32,
        carries: &[bool],
        weight_names: &[String],
    ) -> Self {
        assert!(size_m > 0.0, "a model has a size, not {size_m}");
        assert_eq!(carries.len(), skeleton.nodes.len(), "one mark per node");
        let mut this = Self { columns: Vec::new(), size_m, dropped: Vec::new() };
        let rest: Vec<_> = skeleton.nodes.iter().map(|node| node.rest).collect();
        let rest_globals = skeleton.globals(&rest);
        for node in (0..carries.len()).filter(|&node| carries[node]) {
            let name = &skeleton.nodes[node].name;
            for (what, offset) in offsets(skeleton, &rest_globals, carries, node, size_m) {
                this.add_point(&format!("{name} {what}"), node, offset, training);
            }
        }
        this.add_weights(&training.iter().map(|(pose, _)| *pose), weight_names);
        this
    }

    fn add_point(
        &mut self,
        name: &str,
        node: usize,
        offset: Vec3,
        training: &[(&Pose, Vec<Affine3A>)],
    ) {
        let at = |axis: usize, in_root: &[Affine3A]| {
            in_root[node].transform_point3(offset)[axis] / self.size_m
        };
        let moves = [0, 1, 2].map(|axis| varies(training.iter().map(|(_, r)| at(axis, r))));
        let source = |axis| Source::Point { node, axis: axis as u8, offset };
        let kept = self.add(name, |axis| moves[axis].then(|| source(axis)));
        self.name_dropped(name, kept, |_| !moves.contains(&true));
    }
}

/// The handles of a node, in its own space.
fn offsets(
    skeleton: &Skeleton,
    rest_globals: &[Affine3A],
    carries: &[bool],
    node: usize,
    size_m: f32,
) -> Vec<(&'static str, Vec3)> {
    let own = skeleton.nodes[node].rest;
    let child = (node + 1..carries.len())
        .find(|&child| carries[child] && skeleton.nodes[child].parent == Some(node));
    let along = match child {
        Some(child) => skeleton.nodes[child].rest.translation,
        None => own.rotation.inverse() * own.translation * 0.5,
    };
    let direction = along.try_normalize().unwrap_or(Vec3::Y);
    let beside = direction.any_orthonormal_vector();
    let metres = |local: Vec3| (rest_globals[node].matrix3 * glam::Vec3A::from(local)).length();
    let length = metres(along).max(SHORT * size_m);
    // A node that is hidden at rest by a zero scale has no length to go by.
    let scaled =
        |local: Vec3| local * length / Some(metres(local)).filter(|m| *m > 0.0).unwrap_or(1.0);
    let mut all = vec![("position", Vec3::ZERO), ("side", scaled(beside))];
    if child.is_none() {
        all.push(("tip", scaled(direction)));
    }
    all
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::rig::{Node, RigidFrame, Transform, in_root};

    /// A root at the origin with an upper and a lower arm along x, 2 and 1 long.
    fn skeleton() -> Skeleton {
        let node = |name: &str, parent, x| Node {
            name: name.into(),
            parent,
            rest: Transform { translation: Vec3::X * x, ..Transform::IDENTITY },
        };
        Skeleton {
            nodes: vec![
                node("root", None, 0.0),
                node("arm", Some(0), 2.0),
                node("hand", Some(1), 1.0),
            ],
        }
    }

    fn posed(turn: impl Fn(usize, &mut Pose), count: usize) -> Vec<(Pose, Vec<Affine3A>)> {
        let skeleton = skeleton();
        let pose = |i| {
            let mut pose = Pose::rest(&skeleton, &[]);
            turn(i, &mut pose);
            let globals = skeleton.globals(&pose.local);
            (pose, in_root(&globals, RigidFrame::IDENTITY))
        };
        (0..count).map(pose).collect()
    }

    fn handles(poses: &[(Pose, Vec<Affine3A>)]) -> Parametrisation {
        let training: Vec<_> = poses.iter().map(|(pose, r)| (pose, r.clone())).collect();
        Parametrisation::handles(&skeleton(), &training, 2.0, &[true; 3], &[])
    }

    /// Proves on a hinge that the parameters are the joints' places over the size, that what
    /// stands still has none and is named, and that a point beside the bone sees it turn.
    #[test]
    fn a_hinge_moves_what_lies_beyond_it() {
        let angle = |i: usize| 0.3 * i as f32;
        let poses = posed(|i, p| p.local[1].rotation = Quat::from_rotation_z(angle(i)), 5);
        let handles = handles(&poses);
        assert!(handles.needs_globals());
        assert!(handles.dropped.contains(&"root position".to_owned()), "{:?}", handles.dropped);
        let column = |name: &str| handles.columns.iter().position(|c| c.name == name);
        let (x, y) = (column("hand position x").unwrap(), column("hand position y").unwrap());
        assert_eq!(column("hand position z"), None);
        for (i, (pose, in_root)) in poses.iter().enumerate() {
            let found = handles.encode(pose, in_root);
            assert!((found[x] - (2.0 + angle(i).cos()) / 2.0).abs() < 1e-6);
            assert!((found[y] - angle(i).sin() / 2.0).abs() < 1e-6);
        }
    }

    /// Proves that a turn of the last bone about its own axis is seen, though no joint moves.
    #[test]
    fn a_twist_is_seen() {
        let poses = posed(|i, p| p.local[2].rotation = Quat::from_rotation_x(0.3 * i as f32), 5);
        let handles = handles(&poses);
        assert!(handles.columns.iter().all(|c| c.name.starts_with("hand side")), "{handles:?}");
        assert_eq!(handles.columns.len(), 2);
    }

    /// Proves that every handle stays finite where nodes are crushed at rest and in the pose.
    #[test]
    fn crushed_nodes_stay_finite() {
        let mut skeleton = skeleton();
        skeleton.nodes[1].rest.scale = Vec3::ZERO;
        let pose = Pose::rest(&skeleton, &[]);
        let globals = in_root(&skeleton.globals(&pose.local), RigidFrame::IDENTITY);
        let mut other = globals.clone();
        other[2].translation.x += 1.0;
        let training = [(&pose, globals.clone()), (&pose, other)];
        let handles = Parametrisation::handles(&skeleton, &training, 2.0, &[true; 3], &[]);
        assert!(handles.encode(&pose, &globals).iter().all(|x| x.is_finite()));
    }
}
