//! What of a character's own motion level ground leaves free: turning about the vertical and
//! moving in the plane. Tilt and height change what the ground takes away, so they are parameters.

use glam::{Affine3A, Quat, Vec3};

use super::{RigidFrame, Skeleton, root_frame};

/// What of the character's own motion leaves the signal as it is, and so is taken out of positions
/// and parameters before anything else.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RootMotion {
    /// All of it: nothing stands around the character.
    #[default]
    Rigid,
    /// Turning about +Y and moving in the plane: there is level ground.
    Upright,
    /// None of it: things stand around the character. There is no root node then.
    Fixed,
}

impl RootMotion {
    /// The root frame of a pose. For [`Self::Upright`] the twist about +Y of the root's rotation
    /// since rest, and the motion in the plane that carries the root's rest place to below or above
    /// where it is now; else [`root_frame`].
    ///
    /// # Panics
    /// If the slices are shorter than `root_node` demands.
    #[must_use]
    pub fn frame(
        self,
        skeleton: &Skeleton,
        globals: &[Affine3A],
        rest_globals: &[Affine3A],
        root_node: Option<usize>,
    ) -> RigidFrame {
        let whole = root_frame(skeleton, globals, rest_globals, root_node);
        let (Self::Upright, Some(node)) = (self, root_node) else {
            return whole;
        };
        // A character on its head has no twist.
        let twist = Quat::from_xyzw(0.0, whole.rotation.y, 0.0, whole.rotation.w);
        let length = twist.length();
        let rotation = if length > 1e-6 { twist / length } else { Quat::IDENTITY };
        let [rest, now] = [rest_globals, globals].map(|at| Vec3::from(at[node].translation));
        let moved = now - rotation * rest;
        RigidFrame { rotation, translation: Vec3::new(moved.x, 0.0, moved.z) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{Node, Parametrisation, Pose, Transform, in_root};

    /// A node that carries everything, and hips a metre above.
    fn skeleton() -> Skeleton {
        let at = |translation| Transform { translation, ..Transform::IDENTITY };
        let node = |name: &str, parent, rest| Node { name: name.into(), parent, rest };
        let above = at(Vec3::new(0.3, 0.0, 0.2));
        Skeleton { nodes: vec![node("all", None, above), node("hips", Some(0), at(Vec3::Y))] }
    }

    fn rest_globals(skeleton: &Skeleton) -> Vec<Affine3A> {
        skeleton.globals(&Pose::rest(skeleton, &[]).local)
    }

    /// Poses of the same crouch at several places and turns.
    fn walk(skeleton: &Skeleton) -> Vec<(f32, Pose)> {
        let tilt = Quat::from_axis_angle(Vec3::new(0.6, 0.0, -0.8), 0.7);
        let turned = |turn: f32| {
            let mut pose = Pose::rest(skeleton, &[]);
            pose.local[1].rotation = tilt;
            pose.local[1].translation.y = 0.6;
            pose.local[0].rotation = Quat::from_rotation_y(turn);
            pose.local[0].translation += Vec3::new(5.0, 0.0, -2.0) * turn;
            (turn, pose)
        };
        [0.0, 1.0, -2.5, 3.0].map(turned).to_vec()
    }

    fn in_frame(skeleton: &Skeleton, pose: &Pose) -> (RigidFrame, Vec<Affine3A>) {
        let globals = skeleton.globals(&pose.local);
        let rest = rest_globals(skeleton);
        let frame = RootMotion::Upright.frame(skeleton, &globals, &rest, Some(1));
        (frame, in_root(&globals, frame))
    }

    /// Proves that the frame is exactly a walk and turn on level ground, whatever the tilt and
    /// height beside them.
    #[test]
    fn walking_and_turning_vanish() {
        let skeleton = skeleton();
        let poses = walk(&skeleton);
        let (_, still) = in_frame(&skeleton, &poses[0].1);
        for (turn, pose) in &poses {
            let (frame, inside) = in_frame(&skeleton, pose);
            assert!(frame.rotation.dot(Quat::from_rotation_y(*turn)).abs() > 1.0 - 1e-6);
            assert!(inside[1].abs_diff_eq(still[1], 1e-5), "{} is not {}", inside[1], still[1]);
        }
    }

    /// Proves that tilt and height are parameters where they vary, with their values, and are named
    /// where they do not.
    #[test]
    fn tilt_and_height_are_parameters() {
        let skeleton = skeleton();
        let rest = Pose::rest(&skeleton, &[]);
        let training: Vec<_> = std::iter::once(rest)
            .chain(walk(&skeleton).into_iter().map(|(_, pose)| pose))
            .map(|pose| {
                let inside = in_frame(&skeleton, &pose).1;
                (pose, inside)
            })
            .collect();
        let inside: Vec<&[Affine3A]> = training.iter().map(|(_, r)| r.as_slice()).collect();
        let rest = rest_globals(&skeleton);
        let angles = |inside: &[&[Affine3A]]| {
            Parametrisation::joint_angles(&skeleton, &[], 2.0, &[true; 2], &[])
                .on_ground(1, &rest, inside)
        };
        let found = angles(&inside);
        let names: Vec<&str> = found.columns.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["root tilt x", "root tilt z", "root height"]);
        for (pose, inside) in &training[1..] {
            let values = found.encode(pose, inside);
            for (value, expected) in values.iter().zip([0.42, -0.56, -0.2]) {
                assert!((value - expected).abs() < 1e-5, "{values:?}");
            }
        }
        let still = angles(&inside[1..]);
        assert!(still.columns.is_empty());
        assert_eq!(still.dropped, ["root tilt x", "root tilt z", "root height"]);
    }

    /// Proves that a character on its head, whose turn is undefined, gives finite numbers.
    #[test]
    fn upside_down_is_finite() {
        let skeleton = skeleton();
        let mut pose = Pose::rest(&skeleton, &[]);
        pose.local[1].rotation = Quat::from_rotation_x(std::f32::consts::PI);
        let (frame, inside) = in_frame(&skeleton, &pose);
        assert!(frame.rotation.is_finite() && frame.translation.is_finite());
        assert!(inside[1].is_finite());
    }
}
