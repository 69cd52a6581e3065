//! The cases of the family `occluder`, fitted: proxies cut from meshes of extreme sizes and places, and
//! weights where the poses say next to nothing of them.

use glam::{Affine3A, Quat, Vec3};
use poselight::dataset::{Training, TrainingParts};
use poselight::fit::{Family, Fitted, Geometry, Settings, fit_posed};
use poselight::model::{Frame, Signal};
use poselight::num::random::Stream;
use poselight::rig::{
    Bones, Deformed, Deformer, Influence, Mesh, Node, Points, Pose, RigidFrame, Skeleton,
    Transform, bone_rotations, deform,
};
use poselight::sh::Order;

use super::suite::{Row, row};

const RINGS: usize = 5;
const AROUND: usize = 6;
const POSES: usize = 12;
/// Standard deviation of the noise of the data.
const NOISE: f64 = 0.01;

/// Tubes of 0.5 m and a radius of 0.1 m that hang from their nodes: a trunk, and arms beside it that swing.
struct Puppet {
    skeleton: Skeleton,
    mesh: Mesh,
    points: Points,
    bones: Bones,
    poses: Vec<Pose>,
}

impl Puppet {
    /// Of so many tubes, in metres times `scale`, standing at `at`; arms swing by `swing` radians.
    fn new(tubes: usize, scale: f32, at: Vec3, swing: f32) -> Self {
        let node = |i: usize| Node {
            name: format!("tube {i}"),
            parent: (i > 0).then_some(0),
            rest: Transform {
                translation: if i == 0 { at } else { scale * Vec3::X * [0.3, -0.3][i % 2] },
                ..Transform::IDENTITY
            },
        };
        let skeleton = Skeleton { nodes: (0..tubes).map(node).collect() };
        let mut mesh = Mesh { influence_starts: vec![0], ..Mesh::default() };
        for bone in 0..tubes {
            mesh.deformers.push(Deformer { node: bone, inverse_bind: Affine3A::IDENTITY });
            tube(&mut mesh, bone as u32, scale);
        }
        let points = Points::merge(&mesh);
        let bones = Bones::dominant(&mesh, &points);
        let mut stream = Stream::new(61);
        let pose = |_| {
            let mut pose = Pose::rest(&skeleton, &[]);
            for arm in pose.local.iter_mut().skip(1) {
                let mut angle = || swing * (2.0 * stream.uniform() - 1.0) as f32;
                arm.rotation = Quat::from_rotation_z(angle()) * Quat::from_rotation_x(angle());
            }
            pose
        };
        let poses = (0..POSES).map(pose).collect();
        Self { skeleton, mesh, points, bones, poses }
    }

    fn geometry(&self) -> Geometry<'_> {
        Geometry {
            signal: Signal::Ao,
            order: Order::new(1).expect("an order"),
            skeleton: &self.skeleton,
            mesh: &self.mesh,
            points: &self.points,
            bones: &self.bones,
            columns: vec![None],
            tangents: None,
            poses: self.poses.iter().map(|pose| (pose, RigidFrame::IDENTITY)).collect(),
        }
    }

    /// Ambient occlusion as if each tube were a ball at its middle that blocks 0.8 of what a ball does, and
    /// noise.
    fn values(&self, scale: f32) -> Vec<f32> {
        let mut stream = Stream::new(62);
        let mesh = self.mesh.subset(&self.points.vertex);
        let mut out = Vec::new();
        for pose in &self.poses {
            let globals = self.skeleton.globals(&pose.local);
            let mut posed = Deformed::default();
            deform(&mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut posed);
            let middle = Vec3::Y * (-0.25 * scale);
            let balls: Vec<Vec3> = globals.iter().map(|g| g.transform_point3(middle)).collect();
            for (point, (&x, &n)) in posed.positions.iter().zip(&posed.normals).enumerate() {
                let own = usize::from(self.bones.of_point[point]);
                let mut y = 0.9 + NOISE * stream.normal();
                for (_, ball) in balls.iter().enumerate().filter(|(bone, _)| *bone != own) {
                    let away = (*ball - x).as_dvec3() / f64::from(scale);
                    let s = (0.15 / away.length().max(1e-9)).min(1.0);
                    let c = away.dot(n.as_dvec3()) / away.length().max(1e-9);
                    let soft = (c + s).clamp(0.0, 2.0 * s);
                    y -= 0.8 * s * (0.25 * soft * soft + s * (c - s).max(0.0));
                }
                out.push(y as f32);
            }
        }
        out
    }

    fn fitted(&self, values: Vec<f32>, directions: usize) -> Fitted {
        let rest = self.skeleton.globals(&Pose::rest(&self.skeleton, &[]).local);
        let turns = |pose: &Pose| {
            let globals = self.skeleton.globals(&pose.local);
            bone_rotations(&globals, &rest, RigidFrame::IDENTITY, &self.bones)
        };
        let training = Training::in_memory(TrainingParts {
            points: self.points.count(),
            channels: 1,
            coefficients: 1,
            bones: self.skeleton.nodes.len(),
            parameters: (0..POSES).map(|i| (i as f32).sin()).collect(),
            parameter_names: vec!["sine".to_owned()],
            clips: (0..POSES as i32).map(|i| i / 4).collect(),
            bone_rotations: self.poses.iter().flat_map(turns).collect(),
            point_bones: self.bones.of_point.clone(),
            noise_variance: NOISE * NOISE,
            noise_of_points: Vec::new(),
            values,
        });
        let settings = Settings {
            family: Family::Mean,
            frame: Frame::Bone,
            unshadowed: true,
            spheres: Some(12),
            directions,
            ..Settings::default()
        };
        fit_posed(&training, &settings, Some(&self.geometry())).expect("a fit")
    }
}

fn tube(mesh: &mut Mesh, bone: u32, scale: f32) {
    let first = mesh.positions.len() as u32;
    for ring in 0..=RINGS {
        for i in 0..AROUND {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / AROUND as f32).sin_cos();
            let out = Vec3::new(cos, 0.0, sin);
            // Flat and tapered: a round tube has no longest axis, and round-off would choose one.
            let wide = (0.1 - 0.005 * ring as f32) * Vec3::new(cos, 0.0, 0.7 * sin);
            mesh.positions.push(scale * (wide - Vec3::Y * (ring as f32 * 0.1)));
            mesh.normals.push(out);
            mesh.influences.push(Influence { deformer: bone, weight: 1.0 });
            mesh.influence_starts.push(mesh.influences.len() as u32);
        }
    }
    let at = |ring: usize, i: usize| first + (ring * AROUND + i % AROUND) as u32;
    for ring in 1..=RINGS {
        for i in 0..AROUND {
            let (a, b) = (at(ring - 1, i), at(ring - 1, i + 1));
            let (c, d) = (at(ring, i), at(ring, i + 1));
            mesh.triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
}

/// What occluders leave of the spread on clips that they have not seen.
fn left(fitted: &Fitted) -> f64 {
    let report = fitted.report.occluders.as_ref().expect("occluders");
    report.left_out_rmse.unwrap_or(f64::NAN) / report.spread_rms
}

/// How far the farthest weight is from 1, "blocks as it is".
fn farthest(fitted: &Fitted) -> f64 {
    let weights = &fitted.occluders.as_ref().expect("occluders").weights;
    let away = weights.iter().map(|w| f64::from((w - 1.0).abs()));
    away.fold(0.0, |most, x| if x.is_finite() { x.max(most) } else { f64::INFINITY })
}

pub(crate) fn fitted() -> Vec<Row> {
    const LEFT: &str = "share of error that is left on unseen clips";
    const WEIGHTS: &str = "distance of the farthest weight from 1";
    let mut rows = Vec::new();
    for (kind, directions) in [("spheres", 0), ("ellipsoids", 256)] {
        let fit = |tubes, scale: f32, at, swing| {
            let puppet = Puppet::new(tubes, scale, at, swing);
            puppet.fitted(puppet.values(scale), directions)
        };
        let plain = left(&fit(3, 1.0, Vec3::ZERO, 0.8));
        rows.push(row(format!("{kind}, arms that swing"), LEFT, plain, 0.95));
        // Powers of two round nothing, so that only a length that is fixed somewhere could change anything.
        for (power, scale) in [(-20, 0.5_f32.powi(20)), (20, 2.0_f32.powi(20))] {
            let change = (left(&fit(3, scale, Vec3::ZERO, 0.8)) - plain).abs();
            let case = format!("{kind}, lengths × 2^{power}");
            rows.push(row(case, "change of what is left", change, 1e-6));
        }
        let cases = [("one bone", 1, 0.0), ("arms that tremble by 1e-7", 3, 1e-7)];
        for (name, tubes, swing) in cases {
            let still = fit(tubes, 1.0, Vec3::ZERO, swing);
            rows.push(row(format!("{kind}, {name}"), WEIGHTS, farthest(&still), 1.0));
        }
        if directions > 0 {
            continue;
        }
        for far in [1e3, 1e4] {
            let change = (left(&fit(3, 1.0, Vec3::splat(far), 0.8)) - plain).abs();
            let case = format!("{kind}, {far:e} m from the origin");
            rows.push(row(case, "change of what is left", change, 0.05));
        }
        let grid = fit(3, 1.0, Vec3::splat(1e6), 0.8);
        let case = format!("{kind}, 1e6 m from the origin (f32 is 0.06 m apart)");
        rows.push(row(case, WEIGHTS, farthest(&grid), 30.0));
        let still = fit(3, 1.0, Vec3::ZERO, 1e-4);
        let case = format!("{kind}, arms that tremble by 1e-4");
        rows.push(row(case, WEIGHTS, farthest(&still), 1.0));
        // The third and the fourth arm are where the first and second are.
        let twins = fit(5, 1.0, Vec3::ZERO, 0.8);
        rows.push(row(format!("{kind}, two arms in one place"), LEFT, left(&twins), 0.8));
        rows.push(row(format!("{kind}, two arms in one place"), WEIGHTS, farthest(&twins), 30.0));
    }
    rows
}
