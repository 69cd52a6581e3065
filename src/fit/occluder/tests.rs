//! A trunk with two arms that swing, by hand: what is known of it must be found again.

use glam::{Affine3A, Quat, Vec3};

use super::*;
use crate::dataset::{Training, TrainingParts};
use crate::fit::{Family, Kept, Largest, fit_posed, fit_shared};
use crate::model::Frame;
use crate::num::random::Stream;
use crate::rig::{
    Bones, Deformer, Influence, Mesh, Node, Points, Pose, RigidFrame, Skeleton, Transform,
    bone_rotations,
};

const RINGS: usize = 7;
const AROUND: usize = 6;
const POSES: usize = 18;

/// A rig of three tubes: each hangs from its node, along −y, of radius 0.1.
struct Puppet {
    skeleton: Skeleton,
    mesh: Mesh,
    points: Points,
    bones: Bones,
    poses: Vec<Pose>,
}

impl Puppet {
    fn new() -> Self {
        let node = |name: &str, parent, at| Node {
            name: name.to_owned(),
            parent,
            rest: Transform { translation: at, ..Transform::IDENTITY },
        };
        let skeleton = Skeleton {
            nodes: vec![
                node("trunk", None, Vec3::ZERO),
                node("left", Some(0), Vec3::new(0.3, 0.0, 0.0)),
                node("right", Some(0), Vec3::new(-0.3, 0.0, 0.0)),
            ],
        };
        let mut mesh = Mesh { influence_starts: vec![0], ..Mesh::default() };
        for bone in 0..3 {
            mesh.deformers.push(Deformer { node: bone, inverse_bind: Affine3A::IDENTITY });
            tube(&mut mesh, bone as u32);
        }
        let points = Points::merge(&mesh);
        let bones = Bones::dominant(&mesh, &points);
        let mut stream = Stream::new(3);
        let poses = (0..POSES).map(|_| {
            let mut pose = Pose::rest(&skeleton, &[]);
            for arm in 1..3 {
                let mut angle = || (stream.uniform() * 1.6 - 0.8) as f32;
                pose.local[arm].rotation =
                    Quat::from_rotation_z(angle()) * Quat::from_rotation_x(angle());
            }
            pose
        });
        let poses = poses.collect();
        Self { skeleton, mesh, points, bones, poses }
    }

    fn geometry(&self, signal: Signal, order: Order) -> Geometry<'_> {
        Geometry {
            signal,
            order,
            skeleton: &self.skeleton,
            mesh: &self.mesh,
            points: &self.points,
            bones: &self.bones,
            columns: vec![None],
            tangents: None,
            poses: self.poses.iter().map(|pose| (pose, RigidFrame::IDENTITY)).collect(),
        }
    }

    fn turns(&self) -> Vec<Quat> {
        let rest = Pose::rest(&self.skeleton, &[]);
        let rest = self.skeleton.globals(&rest.local);
        let of_pose = |pose: &Pose| {
            let globals = self.skeleton.globals(&pose.local);
            bone_rotations(&globals, &rest, RigidFrame::IDENTITY, &self.bones)
        };
        self.poses.iter().flat_map(of_pose).collect()
    }

    /// Training data with these values, six poses to a clip.
    fn training(&self, coefficients: usize, values: Vec<f32>) -> Training<'static> {
        Training::in_memory(TrainingParts {
            points: self.points.count(),
            channels: 1,
            coefficients,
            bones: 3,
            parameters: (0..POSES).map(|i| (i as f32).sin()).collect(),
            parameter_names: vec!["sine".to_owned()],
            clips: (0..POSES as i32).map(|i| i / 6).collect(),
            bone_rotations: self.turns(),
            point_bones: self.bones.of_point.clone(),
            noise_variance: 0.0,
            noise_of_points: Vec::new(),
            values,
        })
    }
}

fn tube(mesh: &mut Mesh, bone: u32) {
    let first = mesh.positions.len() as u32;
    for ring in 0..RINGS {
        for i in 0..AROUND {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / AROUND as f32).sin_cos();
            let out = Vec3::new(cos, 0.0, sin);
            mesh.positions.push(0.1 * out - Vec3::Y * (ring as f32 * 0.1));
            mesh.normals.push(out);
            mesh.influences.push(Influence { deformer: bone, weight: 1.0 });
            mesh.influence_starts.push(mesh.influences.len() as u32);
        }
    }
    let at = |ring: usize, i: usize| first + (ring * AROUND + i % AROUND) as u32;
    for ring in 1..RINGS {
        for i in 0..AROUND {
            let (a, b) = (at(ring - 1, i), at(ring - 1, i + 1));
            let (c, d) = (at(ring, i), at(ring, i + 1));
            mesh.triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
}

fn settings(signal: Signal) -> Settings {
    Settings {
        family: Family::Mean,
        frame: if signal == Signal::Ao { Frame::Root } else { Frame::Bone },
        unshadowed: true,
        spheres: Some(12),
        ..Settings::default()
    }
}

/// Data that the family describes exactly: unshadowed, less `weight` of group g at every point
/// by `weight(point, group)`, in the root frame.
fn exact(
    puppet: &Puppet,
    (signal, directions): (Signal, usize),
    order: Order,
    weight: impl Fn(usize, usize) -> f32,
) -> Vec<f32> {
    let geometry = puppet.geometry(signal, order);
    let turns = puppet.turns();
    let root = Settings { frame: Frame::Root, ..settings(signal) };
    let mut explained = Explained::new(&geometry, &root, &turns);
    let mut placed =
        place(&geometry, &turns, (12, directions), &Inscribed::new(&geometry)).unwrap();
    let groups = placed.occluders.groups(puppet.points.count());
    for (i, out) in placed.occluders.weights.iter_mut().enumerate() {
        *out = weight(i / groups, i % groups);
    }
    explained.place(placed);
    let count = puppet.points.count();
    let mut values = vec![0.0; POSES * count * signal.coefficients(order)];
    explained.remove(0..count, &mut values);
    values.iter_mut().for_each(|x| *x = -*x);
    values
}

/// Proves that the spheres fill the tubes: centres on the axes, radii near the tubes', a bone's
/// spheres carried by points of that bone.
#[test]
fn spheres_fill_the_limbs() {
    let puppet = Puppet::new();
    let order = Order::new(1).unwrap();
    let (geometry, turns) = (puppet.geometry(Signal::Ao, order), puppet.turns());
    let placed = place(&geometry, &turns, (12, 0), &Inscribed::new(&geometry)).unwrap();
    let occluders = &placed.occluders;
    assert_eq!(occluders.spheres(), 12);
    assert!(occluders.radii.iter().all(|r| (0.06..0.2).contains(r)), "{:?}", occluders.radii);
    for (pose, centres) in puppet.poses.iter().zip(placed.centres.chunks_exact(12)) {
        let globals = puppet.skeleton.globals(&pose.local);
        for (anchors, &centre) in occluders.anchors.as_chunks::<ANCHORS>().0.iter().zip(centres) {
            let bone = puppet.bones.of_point[anchors[0] as usize];
            assert!(anchors.iter().all(|&a| puppet.bones.of_point[a as usize] == bone));
            let local = globals[usize::from(bone)].inverse().transform_point3(centre);
            assert!(Vec3::new(local.x, 0.0, local.z).length() < 0.03, "{local}");
        }
    }
}

/// Proves that data which the family describes exactly are described: the spread goes down a
/// hundredfold on the training poses, and left-out clips are predicted as well, with weights that
/// differ from point to point, for every signal.
#[test]
fn what_spheres_block_is_found_again() {
    let puppet = Puppet::new();
    let order = Order::new(3).unwrap();
    for signal in Signal::ALL.iter().copied() {
        let weight = |point: usize, group: usize| 0.5 + 0.1 * ((point + 3 * group) % 7) as f32;
        let values = exact(&puppet, (signal, 0), order, weight);
        let training = puppet.training(signal.coefficients(order), values);
        let geometry = puppet.geometry(signal, order);
        let fitted = fit_posed(&training, &settings(signal), Some(&geometry)).unwrap();
        let report = fitted.report.occluders.clone().unwrap();
        assert!(report.training_rmse < 0.02 * report.spread_rms, "{signal} {report:?}");
        assert!(report.left_out_rmse.unwrap() < 0.1 * report.spread_rms, "{signal} {report:?}");
        assert!(fitted.report.training_rmse < 0.02 * report.spread_rms, "{signal}");
    }
}

/// Proves the same of ellipsoids and their union, as far as directions that are fixed in the frame of
/// each bone see what others, fixed in the root frame, have made.
#[test]
fn what_ellipsoids_block_is_found_again() {
    let puppet = Puppet::new();
    let order = Order::new(2).unwrap();
    let directions = 512;
    for signal in [Signal::Ao, Signal::Transfer] {
        let weight = |point: usize, _: usize| 0.5 + 0.1 * (point % 7) as f32;
        let values = exact(&puppet, (signal, directions), order, weight);
        let training = puppet.training(signal.coefficients(order), values);
        let geometry = puppet.geometry(signal, order);
        let settings = Settings { directions, groups: 3, ..settings(signal) };
        let fitted = fit_posed(&training, &settings, Some(&geometry)).unwrap();
        let report = fitted.report.occluders.clone().unwrap();
        assert!(report.training_rmse < 0.2 * report.spread_rms, "{signal} {report:?}");
        assert_eq!(fitted.occluders.unwrap().directions, directions);
    }
}

/// Proves that ellipsoids are rods in limbs: their longest axes run along the bones, and are longer
/// than the others.
#[test]
fn ellipsoids_lie_along_the_limbs() {
    let puppet = Puppet::new();
    let order = Order::new(1).unwrap();
    let (geometry, turns) = (puppet.geometry(Signal::Ao, order), puppet.turns());
    let placed = place(&geometry, &turns, (3, 64), &Inscribed::new(&geometry)).unwrap();
    assert_eq!((placed.occluders.spheres(), placed.centres.len()), (3, 0));
    for shape in placed.occluders.shapes.as_chunks::<6>().0 {
        let [across, along] = [1.0 / shape[0], 1.0 / shape[1]];
        assert!((0.07..0.13).contains(&across), "{shape:?}");
        assert!(along > 2.0 * across, "{shape:?}");
    }
}

/// Proves that merging leaves as many groups as asked for, of which the model knows no others, and
/// that data which weigh all groups alike are described as well as with all groups.
#[test]
fn merged_groups_are_enough_where_weights_agree() {
    let puppet = Puppet::new();
    let order = Order::new(1).unwrap();
    let values = exact(&puppet, (Signal::Ao, 0), order, |point, _| 0.5 + 0.1 * (point % 7) as f32);
    let training = puppet.training(1, values);
    let geometry = puppet.geometry(Signal::Ao, order);
    for groups in [1, 2] {
        let settings = Settings { groups, ..settings(Signal::Ao) };
        let fitted = fit_posed(&training, &settings, Some(&geometry)).unwrap();
        let report = fitted.report.occluders.unwrap();
        assert!(report.training_rmse < 0.02 * report.spread_rms, "{groups} {report:?}");
        assert_eq!(report.groups, groups);
        let group_of = fitted.occluders.unwrap().group_of;
        assert!(group_of.iter().all(|&group| usize::from(group) < groups), "{group_of:?}");
    }
}

/// Proves that fits which share what points see of the most groups are those that look for themselves, in any
/// order of the numbers of groups: the same groups, weights and errors, but for the round-off of f32 sums.
#[test]
fn fewer_groups_are_had_of_more() {
    let puppet = Puppet::new();
    let order = Order::new(2).unwrap();
    for (signal, directions) in [(Signal::Ao, 0), (Signal::Transfer, 64)] {
        let weight = |point: usize, group: usize| 0.4 + 0.1 * ((point + 2 * group) % 5) as f32;
        let values = exact(&puppet, (signal, directions), order, weight);
        let training = puppet.training(signal.coefficients(order), values);
        let geometry = puppet.geometry(signal, order);
        let largest = Largest { outputs: 1, cluster_outputs: Kept::Share(0.9), groups: 3 };
        for order in [[1, 2, 3], [3, 2, 1]] {
            let shared = Shared::new(largest);
            for groups in order {
                let settings = Settings { groups, directions, ..settings(signal) };
                let own = fit_posed(&training, &settings, Some(&geometry)).unwrap();
                let with = fit_shared(&training, &settings, Some(&geometry), &shared).unwrap();
                let [a, b] = [&own, &with].map(|f| f.report.occluders.clone().unwrap());
                assert_eq!((a.groups, a.penalty), (b.groups, b.penalty));
                let apart = (a.training_rmse - b.training_rmse).abs();
                assert!(apart < 1e-4 * a.spread_rms, "{a:?} {b:?}");
                let [a, b] = [own, with].map(|f| f.occluders.unwrap());
                assert_eq!((a.group_of, a.shapes), (b.group_of, b.shapes));
                for (a, b) in a.weights.iter().zip(&b.weights) {
                    assert!((a - b).abs() < 1e-2, "{signal} {groups}: {a} {b}");
                }
            }
        }
    }
}

/// Proves that noise leaves points the weights that all share: the penalty is chosen by what
/// left-out clips say.
#[test]
fn noise_leaves_shared_weights() {
    let puppet = Puppet::new();
    let order = Order::new(1).unwrap();
    let mut values = exact(&puppet, (Signal::Ao, 0), order, |_, _| 0.8);
    let mut stream = Stream::new(8);
    values.iter_mut().for_each(|x| *x += 0.05 * stream.normal() as f32);
    let training = puppet.training(1, values);
    let geometry = puppet.geometry(Signal::Ao, order);
    let fitted = fit_posed(&training, &settings(Signal::Ao), Some(&geometry)).unwrap();
    let report = fitted.report.occluders.unwrap();
    assert!(report.penalty >= 1.0, "{report:?}");
    let weights = fitted.occluders.unwrap().weights;
    let of_bones = weights.chunks_exact(report.groups * RINGS * AROUND);
    for (bone, rows) in of_bones.enumerate() {
        for group in 0..report.groups {
            let all = rows.iter().skip(group).step_by(report.groups);
            let most = all.clone().fold(f32::NEG_INFINITY, |a, &b| a.max(b));
            let least = all.fold(f32::INFINITY, |a, &b| a.min(b));
            assert!(most - least < 0.3, "bone {bone}, group {group}: {least} to {most}");
        }
    }
}

/// Proves that spheres of a whole mesh, carried by some of its points, are those of the whole at rest: as many, of
/// the same radii, at the same places, each carried by points that are kept, of its bone where there are any.
#[test]
fn some_points_carry_the_spheres_of_all() {
    let puppet = Puppet::new();
    let geometry = puppet.geometry(Signal::Ao, Order::new(1).unwrap());
    let rest = geometry.rest().positions;
    for step in [1, 5, 40, 90] {
        let some: Vec<u32> = (0..rest.len() as u32).step_by(step).collect();
        let whole = cut(&Inscribed::new(&geometry), 9, Proxy::Ellipsoid).unwrap();
        let part = cut(&Inscribed::of_whole(&geometry, &some), 9, Proxy::Ellipsoid).unwrap();
        assert_eq!((&whole.radii, &whole.shapes), (&part.radii, &part.shapes));
        let bone = |point: u32| puppet.bones.of_point[point as usize];
        for q in 0..whole.radii.len() {
            let own = &whole.anchors[q * ANCHORS..(q + 1) * ANCHORS];
            let carriers: Vec<u32> = part.anchors[q * ANCHORS..(q + 1) * ANCHORS]
                .iter()
                .map(|&carrier| some[carrier as usize])
                .collect();
            let centre = |anchors: &[u32], offset: Vec3| {
                let sum: Vec3 = anchors.iter().map(|&point| rest[point as usize]).sum();
                sum / ANCHORS as f32 + offset
            };
            let apart = centre(own, whole.offsets[q]) - centre(&carriers, part.offsets[q]);
            assert!(apart.length() < 1e-5, "{step}: {apart}");
            let has_own = some.iter().any(|&point| bone(point) == bone(own[0]));
            assert!(!has_own || carriers.iter().all(|&point| bone(point) == bone(own[0])));
        }
    }
}

/// Proves that a fit without the mesh says what it needs, and that a scene of one pose, from which
/// nothing can be learned, still gives a model.
#[test]
fn without_a_mesh_and_without_motion() {
    let mut puppet = Puppet::new();
    let order = Order::new(1).unwrap();
    let training = puppet.training(1, vec![0.5; POSES * puppet.points.count()]);
    let error = fit_posed(&training, &settings(Signal::Ao), None).unwrap_err();
    assert!(matches!(error, Error::NeedsGeometry), "{error}");

    puppet.poses.truncate(1);
    let parts = TrainingParts {
        points: puppet.points.count(),
        channels: 1,
        coefficients: 1,
        bones: 3,
        clips: vec![0],
        bone_rotations: puppet.turns(),
        point_bones: puppet.bones.of_point.clone(),
        values: vec![0.5; puppet.points.count()],
        ..TrainingParts::default()
    };
    let geometry = puppet.geometry(Signal::Ao, order);
    let training = Training::in_memory(parts);
    let fitted = fit_posed(&training, &settings(Signal::Ao), Some(&geometry)).unwrap();
    assert!(fitted.occluders.unwrap().weights.iter().all(|w| w.is_finite()));
}
