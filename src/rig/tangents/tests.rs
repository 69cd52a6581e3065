use std::f32::consts::{PI, TAU};

use super::*;
use crate::rig::{Deformer, Influence, Node, Transform};

/// A tube along +Y of two bones that share the vertices about its middle; optionally without a skin.
fn tube(skinned: bool) -> (Skeleton, Mesh) {
    let node = |name: &str, parent, y: f32| Node {
        name: name.to_owned(),
        parent,
        rest: Transform { translation: Vec3::Y * y, ..Transform::IDENTITY },
    };
    let skeleton = Skeleton { nodes: vec![node("a", None, 0.0), node("b", Some(0), 1.0)] };
    let (rings, around) = (17, 16);
    let mut mesh = Mesh { influence_starts: vec![0], ..Mesh::default() };
    for ring in 0..rings {
        for k in 0..around {
            let (sin, cos) = (TAU * k as f32 / around as f32).sin_cos();
            let y = 2.0 * ring as f32 / (rings - 1) as f32;
            mesh.positions.push(Vec3::new(0.2 * cos, y, 0.2 * sin));
            mesh.normals.push(Vec3::new(cos, 0.0, sin));
            let upper = ((y - 0.7) / 0.6).clamp(0.0, 1.0);
            let weights: &[(u32, f32)] =
                if skinned { &[(0, 1.0 - upper), (1, upper)] } else { &[(0, 1.0)] };
            for &(deformer, weight) in weights.iter().filter(|(_, weight)| *weight > 0.0) {
                mesh.influences.push(Influence { deformer, weight });
            }
            mesh.influence_starts.push(mesh.influences.len() as u32);
        }
    }
    for cell in 0..(rings - 1) * around {
        let (ring, k) = (cell / around, cell % around);
        let at = |r: usize, k: usize| (r * around + k % around) as u32;
        let [a, b, c, d] = [at(ring, k), at(ring, k + 1), at(ring + 1, k), at(ring + 1, k + 1)];
        mesh.triangles.extend([[a, c, b], [b, c, d]]);
    }
    let bind = |y: f32| Affine3A::from_translation(Vec3::NEG_Y * y);
    mesh.deformers = vec![
        Deformer { node: 0, inverse_bind: bind(0.0) },
        Deformer { node: 1, inverse_bind: bind(1.0) },
    ];
    (skeleton, mesh)
}

fn posed(skeleton: &Skeleton, mesh: &Mesh, bend: f32) -> (Deformed, Vec<Vec3>) {
    let tangents = Tangents::new(skeleton, mesh);
    let mut pose = Pose::rest(skeleton, &[]);
    pose.local[1].rotation = Quat::from_rotation_z(bend) * Quat::from_rotation_y(bend);
    let globals = skeleton.globals(&pose.local);
    let (mut out, mut found) = (Deformed::default(), Vec::new());
    deform(mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut out);
    tangents.pose(mesh, &globals, RigidFrame::IDENTITY, &out.normals, &mut found);
    (out, found)
}

/// Along a tube tangents run along it, with and without a skin; they are unit and at right angles to the
/// normals at rest and bent, smooth in both, and turn with the bones.
#[test]
fn tangents_follow_limbs() {
    for skinned in [true, false] {
        let (skeleton, mesh) = tube(skinned);
        let (rest, tangents) = posed(&skeleton, &mesh, 0.0);
        assert!(tangents.iter().all(|t| t.y.abs() > 0.999), "skinned: {skinned}");
        let smooth = smoothness(&mesh.triangles, &rest.normals, &tangents);
        assert!(smooth.p99_degrees < 1.0, "{smooth:?}");
        let (bent, turned) = posed(&skeleton, &mesh, 0.8);
        for (t, n) in turned.iter().zip(&bent.normals) {
            assert!((t.length() - 1.0).abs() < 1e-5 && t.dot(*n).abs() < 1e-5);
        }
        let top = turned[turned.len() - 1];
        let along = Quat::from_rotation_z(0.8) * Vec3::Y * tangents[0].y.signum();
        assert!(!skinned || top.dot(along) > 0.99, "{top}");
        assert!(smoothness(&mesh.triangles, &bent.normals, &turned).p99_degrees < 30.0);
    }
}

/// A rigid motion turns tangents against no edge, a small bend by little; painting them anew at random
/// would show.
#[test]
fn tangents_stay_on_the_surface() {
    let (skeleton, mesh) = tube(true);
    let (before, first) = posed(&skeleton, &mesh, 0.30);
    let (after, second) = posed(&skeleton, &mesh, 0.33);
    let moved = coherence(&mesh.triangles, [(&before, &first), (&after, &second)]);
    assert!(moved.p99_degrees < 2.0, "{moved:?}");
    let still = coherence(&mesh.triangles, [(&before, &first), (&before, &first)]);
    assert!(still.p99_degrees < 1e-3, "{still:?}");
    let other: Vec<Vec3> = after
        .normals
        .iter()
        .enumerate()
        .map(|(i, n)| Quat::from_axis_angle(*n, i as f32 * 2.4) * second[i])
        .collect();
    let painted = coherence(&mesh.triangles, [(&before, &first), (&after, &other)]);
    assert!(painted.mean_degrees > 60.0, "{painted:?}");
}

/// The frame's rotation takes normal and tangent where they belong; places that do not vary have a
/// direction nevertheless, and the longest one is found in any orientation.
#[test]
fn frames_and_directions_are_sound() {
    let normal = Vec3::new(0.36, -0.48, 0.8).normalize();
    let tangent = normal.any_orthonormal_vector();
    let turn = to_tangent_frame(normal, tangent);
    assert!(
        (turn * normal - Vec3::Z).length() < 1e-5 && (turn * tangent - Vec3::X).length() < 1e-5
    );
    assert_eq!(longest(&[Vec3::ONE; 3]), Vec3::Y);
    assert_eq!(longest(&[]), Vec3::Y);
    let axis = Vec3::new(-2.0, 1.0, 0.5).normalize();
    let side = axis.any_orthonormal_vector();
    let places: Vec<Vec3> = (0..40)
        .map(|i| {
            let t = i as f32 / 39.0 * PI;
            axis * t.cos() * 3.0 + side * (7.0 * t).sin() * 0.5
        })
        .collect();
    assert!(longest(&places).dot(axis).abs() > 0.99);
}

/// Bytes keep tangents to half a degree, and what is made of them again are the same bytes; a mesh
/// whose space is turned against the scene's at rest carries them as any other does.
#[test]
fn tangents_are_kept_in_bytes() {
    let (skeleton, mesh) = tube(true);
    let rest = tangents_at_rest(&skeleton, &mesh);
    let bytes = tangents_to_bytes(&rest);
    let read = tangents_from_bytes(&bytes);
    assert_eq!(tangents_to_bytes(&read), bytes);
    for (a, b) in rest.iter().zip(&read) {
        assert!(a.angle_between(*b) < 0.5_f32.to_radians(), "{a} {b}");
    }
    let turn = Affine3A::from_rotation_x(0.7);
    let mut turned = mesh.clone();
    turned.deformers.iter_mut().for_each(|d| d.inverse_bind *= turn.inverse());
    turned.positions.iter_mut().for_each(|p| *p = turn.transform_point3(*p));
    turned.normals.iter_mut().for_each(|n| *n = turn.transform_vector3(*n));
    let mut pose = Pose::rest(&skeleton, &[]);
    pose.local[1].rotation = Quat::from_rotation_z(0.8);
    let globals = skeleton.globals(&pose.local);
    let of = |mesh: &Mesh| {
        let (mut out, mut found) = (Deformed::default(), Vec::new());
        deform(mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut out);
        let carried = Tangents::of(&skeleton, mesh, &read);
        carried.pose(mesh, &globals, RigidFrame::IDENTITY, &out.normals, &mut found);
        let some: Vec<u32> = (0..mesh.positions.len() as u32).step_by(7).collect();
        let (mut few, normals) = (Vec::new(), some.iter().map(|&v| out.normals[v as usize]));
        let (subset, normals) = (mesh.subset(&some), normals.collect::<Vec<_>>());
        carried.subset(&some).pose(&subset, &globals, RigidFrame::IDENTITY, &normals, &mut few);
        assert!(few.iter().zip(&some).all(|(a, &v)| (*a - found[v as usize]).length() < 1e-6));
        found
    };
    for (a, b) in of(&mesh).iter().zip(of(&turned)) {
        assert!((*a - b).length() < 1e-4, "{a} {b}");
    }
}
