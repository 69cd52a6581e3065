use std::f32::consts::PI;

use glam::Quat;

use super::*;
use crate::rig::{Node, Skeleton, Transform};

/// A root with a hinge below it.
fn skeleton() -> Skeleton {
    let node = |name: &str, parent| Node { name: name.into(), parent, rest: Transform::IDENTITY };
    Skeleton { nodes: vec![node("root", None), node("knee", Some(0))] }
}

fn poses(count: usize, change: impl Fn(usize, &mut Pose)) -> Vec<Pose> {
    let pose = |i| {
        let mut pose = Pose::rest(&skeleton(), &[0.0]);
        change(i, &mut pose);
        pose
    };
    (0..count).map(pose).collect()
}

fn angles(poses: &[Pose]) -> Parametrisation {
    let poses: Vec<&Pose> = poses.iter().collect();
    Parametrisation::joint_angles(&skeleton(), &poses, 2.0, &[true, false], &["smile".into()])
}

fn names(angles: &Parametrisation) -> Vec<&str> {
    angles.columns.iter().map(|column| column.name.as_str()).collect()
}

/// Proves on a hinge that the parameter is the angle about the mean, that it is the only one, and
/// that what has no variance is named.
#[test]
fn a_hinge_has_one_parameter() {
    let base = Quat::from_rotation_y(0.9);
    let poses = poses(5, |i, pose| {
        // The sign of the quaternion must not matter.
        let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
        pose.local[1].rotation = base * Quat::from_rotation_x(0.4 * i as f32) * sign;
        pose.local[0].rotation = Quat::from_rotation_z(i as f32);
    });
    let angles = angles(&poses);
    assert_eq!(names(&angles), ["knee rotation x"]);
    assert_eq!(angles.dropped, ["knee rotation y", "knee rotation z", "smile"]);
    for (i, pose) in poses.iter().enumerate() {
        let expected = 0.4 * (i as f32 - 2.0);
        let found = angles.encode(pose, &[])[0];
        assert!((found - expected).abs() < 1e-6, "{found} against {expected}");
    }
}

/// Proves that translations are in sizes from rest, that scales of the root stay, that morph
/// weights are as they are, and that a constant offset from rest is named.
#[test]
fn translations_scales_and_weights() {
    let poses = poses(3, |i, pose| {
        pose.local[1].translation = Vec3::new(i as f32, 0.5, 0.0);
        pose.local[0].translation = Vec3::splat(i as f32);
        pose.local[0].scale.z = 1.0 + i as f32;
        pose.weights[0] = 0.25 * i as f32;
    });
    let angles = angles(&poses);
    assert_eq!(names(&angles), ["root scale z", "knee translation x", "smile"]);
    assert_eq!(angles.dropped, ["knee rotation", "knee translation y"]);
    assert_eq!(angles.encode(&poses[2], &[]), [2.0, 1.0, 0.5]);
}

/// Proves that a joint swinging through more than half a turn stays continuous, since the cut lies
/// opposite the mean and not opposite the identity.
#[test]
fn continuous_through_half_a_turn() {
    let swing = |i: usize| PI - 1.5 + 3.0 * i as f32 / 60.0;
    let poses = poses(61, |i, pose| pose.local[1].rotation = Quat::from_rotation_x(swing(i)));
    let angles = angles(&poses);
    let values: Vec<f32> = poses.iter().map(|pose| angles.encode(pose, &[])[0]).collect();
    for pair in values.windows(2) {
        assert!((pair[1] - pair[0] - 0.05).abs() < 1e-4, "{pair:?}");
    }
}

/// Proves that rotations at exactly half a turn, not of unit length or without direction are finite.
#[test]
fn always_finite() {
    let mut poses = poses(3, |i, pose| pose.local[1].rotation = Quat::from_rotation_x(i as f32));
    let angles = angles(&poses);
    let Source::Rotation { mean, .. } = angles.columns[0].source else { panic!("a rotation") };
    let half_turn = mean * Quat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    let zero = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    for rotation in [half_turn, half_turn * 7.0, zero, Quat::from_xyzw(1e-30, 0.0, 0.0, 0.0)] {
        poses[0].local[1].rotation = rotation;
        assert!(angles.encode(&poses[0], &[])[0].is_finite(), "{rotation}");
    }
}

/// Proves that parameters of nodes that carry nothing go, by name.
#[test]
fn nodes_without_vertices_are_dropped() {
    let poses = poses(3, |i, pose| {
        pose.local[1].rotation = Quat::from_rotation_x(i as f32);
        pose.weights[0] = i as f32;
    });
    let mut angles = angles(&poses);
    angles.retain_nodes(&[true, false]);
    assert_eq!(names(&angles), ["smile"]);
    assert!(angles.dropped.contains(&"knee rotation x".to_owned()));
}
