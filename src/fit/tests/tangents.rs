//! The tangent frame.

use glam::{Affine3A, Vec3};

use super::*;
use crate::fit::{Error, Geometry, fit_posed};
use crate::model::Signal;
use crate::rig::{
    Bones, Deformed, Deformer, Influence, Mesh, Node, Points, Pose, RigidFrame, Skeleton, Tangents,
    Transform, deform, to_tangent_frame,
};
use crate::sh::{Order, Rotation};

const POSES: usize = 8;

/// A strip between two bones, of which the second turns.
struct Strip {
    skeleton: Skeleton,
    mesh: Mesh,
    points: Points,
    bones: Bones,
    poses: Vec<Pose>,
    tangents: Tangents,
}

impl Strip {
    fn new() -> Self {
        let node = |name: &str, parent, y: f32| Node {
            name: name.to_owned(),
            parent,
            rest: Transform { translation: Vec3::Y * y, ..Transform::IDENTITY },
        };
        let skeleton = Skeleton { nodes: vec![node("a", None, 0.0), node("b", Some(0), 1.0)] };
        let bind = |node, y: f32| Deformer {
            node,
            inverse_bind: Affine3A::from_translation(Vec3::NEG_Y * y),
        };
        let mut mesh = Mesh {
            influence_starts: vec![0],
            deformers: vec![bind(0, 0.0), bind(1, 1.0)],
            ..Mesh::default()
        };
        for row in 0..9 {
            let upper = row as f32 / 8.0;
            for x in [-0.2, 0.1] {
                mesh.positions.push(Vec3::new(x, 2.0 * upper, 0.0));
                mesh.normals.push(Vec3::new(0.3 * x, 0.1, 1.0).normalize());
                for (deformer, weight) in [(0, 1.0 - upper), (1, upper)] {
                    mesh.influences.push(Influence { deformer, weight });
                }
                mesh.influence_starts.push(mesh.influences.len() as u32);
            }
        }
        mesh.triangles = (0..16).map(|i| [i, i + 1, i + 2]).collect();
        let points = Points::merge(&mesh);
        let bones = Bones::dominant(&mesh, &points);
        let poses = (0..POSES).map(|i| {
            let mut pose = Pose::rest(&skeleton, &[]);
            let angle = 0.25 * i as f32;
            pose.local[1].rotation = Quat::from_rotation_x(angle) * Quat::from_rotation_y(-angle);
            pose
        });
        let poses = poses.collect();
        let tangents = Tangents::new(&skeleton, &mesh);
        Self { skeleton, mesh, points, bones, poses, tangents }
    }

    fn geometry(&self, tangents: bool) -> Geometry<'_> {
        Geometry {
            signal: Signal::Visibility,
            order: Order::new(3).unwrap(),
            skeleton: &self.skeleton,
            mesh: &self.mesh,
            points: &self.points,
            bones: &self.bones,
            columns: vec![None],
            tangents: tangents.then_some(&self.tangents),
            poses: self.poses.iter().map(|pose| (pose, RigidFrame::IDENTITY)).collect(),
        }
    }

    /// What stands still in every tangent frame, `own` `[point, 9]`, as the root frame sees it.
    fn training(&self, own: &[f32]) -> Training<'static> {
        let order = Order::new(3).unwrap();
        let (mut values, mut mesh, mut tangents) = (Vec::new(), Deformed::default(), Vec::new());
        for pose in &self.poses {
            let globals = self.skeleton.globals(&pose.local);
            deform(&self.mesh, &globals, &[], RigidFrame::IDENTITY, &mut mesh);
            let here = RigidFrame::IDENTITY;
            self.tangents.pose(&self.mesh, &globals, here, &mesh.normals, &mut tangents);
            for (own, &vertex) in own.chunks_exact(9).zip(&self.points.vertex) {
                let vertex = vertex as usize;
                let turn = to_tangent_frame(mesh.normals[vertex], tangents[vertex]).conjugate();
                let mut turned = [0.0; 9];
                Rotation::new(order, turn).apply(own, &mut turned);
                values.extend(turned);
            }
        }
        Training::in_memory(TrainingParts {
            points: self.points.count(),
            channels: 1,
            coefficients: 9,
            bones: 2,
            parameters: (0..POSES).map(|i| i as f32).collect(),
            parameter_names: vec!["bend".to_owned()],
            clips: vec![0; POSES],
            bone_rotations: vec![Quat::IDENTITY; 2 * POSES],
            point_bones: self.bones.of_point.clone(),
            noise_variance: 0.0,
            noise_of_points: Vec::new(),
            values,
        })
    }
}

/// What stands still in the tangent frames, which the skin carries, is the mean of a fit there, to
/// rounding; without the mesh there is no such fit, nor with occluders. Of data without their unshadowed
/// part, which for visibility is the open sphere in any frame, only that constant is gone.
#[test]
fn the_tangent_frame_undoes_the_skin() {
    let strip = Strip::new();
    let mut stream = Stream::new(5);
    let own: Vec<f32> = (0..9 * strip.points.count()).map(|_| stream.normal() as f32).collect();
    let training = strip.training(&own);
    let tangent = Settings { frame: Frame::Tangent, ..settings(Family::Mean) };
    let mean = |settings: &Settings| -> Vec<f32> {
        let geometry = strip.geometry(settings.frame == Frame::Tangent);
        match fit_posed(&training, settings, Some(&geometry)).unwrap().decoder {
            Decoder::Mean { mean } => mean,
            other => panic!("{other:?}"),
        }
    };
    let worst = |found: &[f32], expected: &[f32]| {
        found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(worst(&mean(&tangent), &own) < 1e-5);
    assert!(worst(&mean(&settings(Family::Mean)), &own) > 0.5);
    let without = mean(&Settings { unshadowed: true, ..tangent });
    let open = (4.0 * std::f32::consts::PI).sqrt();
    let expected: Vec<f32> =
        own.iter().enumerate().map(|(i, x)| if i % 9 == 0 { x - open } else { *x }).collect();
    assert!(worst(&without, &expected) < 1e-5);
    let refused = |geometry: Option<&Geometry<'_>>, settings: &Settings| {
        fit_posed(&training, settings, geometry).unwrap_err()
    };
    assert!(matches!(refused(None, &tangent), Error::NeedsGeometry));
    assert!(matches!(refused(Some(&strip.geometry(false)), &tangent), Error::NeedsGeometry));
    let all = strip.geometry(true);
    let occluders = Settings { spheres: Some(4), ..tangent };
    let nearby = Settings { local: Some(0.3), ..tangent };
    for settings in [occluders, nearby] {
        let told = refused(Some(&all), &settings);
        assert!(matches!(told, Error::NotInTangentFrame { .. }), "{told}");
    }
}
