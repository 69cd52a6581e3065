use glam::{Affine3A, Quat};

use super::*;
use crate::fit::{Family, On, Ridge, fit, fit_posed};
use crate::model::{Frame, Signal};
use crate::num::random::Stream;
use crate::rig::{
    Bones, Deformer, Influence, Mesh, Node, Points, Pose, RigidFrame, Skeleton, Transform,
};
use crate::sh::Order;

const POSES: usize = 40;

/// A trunk between two arms ten metres apart; a triangle for each of the three. Parameter k is joint k's.
struct Arms {
    skeleton: Skeleton,
    mesh: Mesh,
    points: Points,
    bones: Bones,
    poses: Vec<Pose>,
}

impl Arms {
    fn new() -> Self {
        let node = |name: &str, parent, x| Node {
            name: name.to_owned(),
            parent,
            rest: Transform { translation: Vec3::X * x, ..Transform::IDENTITY },
        };
        let nodes =
            vec![node("trunk", None, 0.0), node("a", Some(0), -5.0), node("b", Some(0), 5.0)];
        let mut mesh = Mesh { influence_starts: vec![0], ..Mesh::default() };
        for bone in 0..3_u32 {
            mesh.deformers.push(Deformer { node: bone as usize, inverse_bind: Affine3A::IDENTITY });
            let first = mesh.positions.len() as u32;
            // The trunk reaches from arm to arm.
            let corners = match bone {
                0 => [Vec3::X * -4.9, Vec3::X * 4.9, Vec3::Z],
                _ => [Vec3::ZERO, Vec3::Y, Vec3::Z],
            };
            for corner in corners {
                mesh.positions.push(corner);
                mesh.normals.push(Vec3::X);
                mesh.influences.push(Influence { deformer: bone, weight: 1.0 });
                mesh.influence_starts.push(mesh.influences.len() as u32);
            }
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        let skeleton = Skeleton { nodes };
        let points = Points::merge(&mesh);
        let bones = Bones::dominant(&mesh, &points);
        let poses = vec![Pose::rest(&skeleton, &[]); POSES];
        Self { skeleton, mesh, points, bones, poses }
    }

    fn geometry(&self) -> Geometry<'_> {
        Geometry {
            signal: Signal::Ao,
            order: Order::new(1).unwrap(),
            skeleton: &self.skeleton,
            mesh: &self.mesh,
            points: &self.points,
            bones: &self.bones,
            columns: vec![Some(1), Some(2), None],
            tangents: None,
            poses: self.poses.iter().map(|pose| (pose, RigidFrame::IDENTITY)).collect(),
        }
    }

    /// Both arms nearly together in training; what the points of an arm have follows that arm alone.
    fn training(&self) -> TrainingParts {
        let mut random = Stream::new(9);
        let (mut parameters, mut values) = (Vec::new(), Vec::new());
        for _ in 0..POSES {
            let (both, apart, other) = (random.normal(), 0.02 * random.normal(), random.normal());
            let row = [both, both + apart, other].map(|x| x as f32 + 3.0);
            parameters.extend(row);
            for &bone in &self.bones.of_point {
                let own = [0.5 * row[0] + 0.5 * row[1], row[0], row[1]][usize::from(bone)];
                values.push(0.2 * own + 0.05 * random.normal() as f32);
            }
        }
        TrainingParts {
            points: self.points.count(),
            channels: 1,
            coefficients: 1,
            bones: 3,
            parameters,
            parameter_names: ["a.x", "b.x", "smile"].map(str::to_owned).to_vec(),
            clips: (0..POSES as i32).map(|pose| pose / 10).collect(),
            bone_rotations: vec![Quat::IDENTITY; 3 * POSES],
            point_bones: self.bones.of_point.clone(),
            noise_variance: 0.0,
            noise_of_points: Vec::new(),
            values,
        }
    }
}

fn settings(local: Option<f64>) -> Settings {
    let (family, ridge) = (Family::Linear, Ridge::Fixed(0.5));
    Settings { family, frame: Frame::Root, ridge, on: On::Novel, local, ..Settings::default() }
}

fn weights(decoder: &Decoder) -> (&[f32], &[f32]) {
    let Decoder::Linear { mean, weights } = decoder else { panic!("no linear decoder") };
    (mean, weights)
}

/// The far arm, though it moved alike, gets no weight at an arm's points, and the near one all of it; what
/// belongs to no joint may matter anywhere.
#[test]
fn far_joints_get_no_weight() {
    let arms = Arms::new();
    let training = Training::in_memory(arms.training());
    let near = fit_posed(&training, &settings(Some(0.02)), Some(&arms.geometry())).unwrap();
    let far = fit(&training, &settings(None)).unwrap();
    for (point, &bone) in arms.bones.of_point.iter().enumerate().filter(|(_, bone)| **bone > 0) {
        let (own, other) = (usize::from(bone) - 1, 2 - usize::from(bone));
        let row = |decoder| weights(decoder).1[3 * point..3 * point + 3].to_vec();
        let (with, without) = (row(&near.decoder), row(&far.decoder));
        assert!(with[other].abs() < 1e-4, "{with:?}");
        assert!(without[other] > 0.05, "the plain ridge shares it out: {without:?}");
        assert!((with[own] - 0.2).abs() < 0.05, "{with:?}");
        assert_ne!(with[2], 0.0);
    }
    assert!(near.report.notices[0].contains("hardly count"), "{:?}", near.report.notices);
}

/// Where everything is near, it is the plain ridge, also for parameters far from 0.
#[test]
fn a_wide_prior_is_none() {
    let arms = Arms::new();
    for shift in [0.0, 1000.0] {
        let mut parts = arms.training();
        parts.parameters.iter_mut().for_each(|x| *x += shift);
        let training = Training::in_memory(parts);
        let near = fit_posed(&training, &settings(Some(1e9)), Some(&arms.geometry())).unwrap();
        let far = fit(&training, &settings(None)).unwrap();
        let ((mean, w), (expected_mean, expected)) =
            (weights(&near.decoder), weights(&far.decoder));
        for (a, b) in mean.iter().chain(w).zip(expected_mean.iter().chain(expected)) {
            assert!((a - b).abs() < 2e-4 * (1.0 + b.abs()), "{shift}: {a} {b}");
        }
    }
}

/// Without the posed mesh there is no telling what is near.
#[test]
fn the_mesh_is_needed() {
    let training = Training::in_memory(Arms::new().training());
    assert!(matches!(fit(&training, &settings(Some(0.1))), Err(Error::NeedsGeometry)));
}
