use glam::{DAffine3, DMat3, DVec3, Quat};

use super::*;
use crate::rig::{Deformer, Influence, MorphTarget};

/// A sphere of scattered vertices with two influences each, and a morph on every third.
fn sphere(count: usize, deformers: usize) -> Mesh {
    let mut mesh = Mesh { influence_starts: vec![0], ..Mesh::default() };
    for i in 0..count {
        let height = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
        let around = i as f32 * 2.4;
        let radius = (1.0 - height * height).sqrt();
        let normal = Vec3::new(radius * around.cos(), height, radius * around.sin());
        mesh.positions.push(normal * 2.0);
        mesh.normals.push(normal);
        let weight = 0.5 + 0.5 * height.abs();
        for (offset, weight) in [(0, weight), (1, 1.0 - weight)] {
            let deformer = ((i + offset) % deformers) as u32;
            mesh.influences.push(Influence { deformer, weight });
        }
        mesh.influence_starts.push(mesh.influences.len() as u32);
    }
    mesh.deformers = (0..deformers)
        .map(|node| Deformer {
            node,
            inverse_bind: Affine3A::from_translation(Vec3::new(0.1 * node as f32, 0.0, 0.0)),
        })
        .collect();
    let vertices: Vec<u32> = (0..count as u32).step_by(3).collect();
    let deltas = vec![Vec3::new(0.1, -0.2, 0.3); vertices.len()];
    mesh.morphs = vec![MorphTarget {
        weight: 0,
        vertices,
        position_deltas: deltas.clone(),
        normal_deltas: deltas,
    }];
    mesh
}

fn globals(deformers: usize) -> Vec<Affine3A> {
    (0..deformers)
        .map(|i| {
            let mirror = if i % 3 == 2 { -1.0 } else { 1.0 };
            Affine3A::from_scale_rotation_translation(
                Vec3::new(mirror, 0.5 + 0.1 * i as f32, 1.5),
                Quat::from_euler(glam::EulerRot::XYZ, 0.2 * i as f32, 0.1, -0.3),
                Vec3::new(1.0, 2.0, 0.1 * i as f32),
            )
        })
        .collect()
}

/// The slow oracle: f64, the literal inverse transpose.
fn slowly(mesh: &Mesh, globals: &[Affine3A], weight: f32, root: RigidFrame) -> Vec<(DVec3, DVec3)> {
    let wide = |m: &Affine3A| DAffine3::from_cols_array(&m.to_cols_array().map(f64::from));
    let to_root = wide(&Affine3A::from_rotation_translation(root.rotation, root.translation));
    let to_root = to_root.inverse();
    (0..mesh.positions.len())
        .map(|v| {
            let mut position = mesh.positions[v].as_dvec3();
            let mut normal = mesh.normals[v].as_dvec3();
            for target in &mesh.morphs {
                if let Ok(k) = target.vertices.binary_search(&(v as u32)) {
                    position += f64::from(weight) * target.position_deltas[k].as_dvec3();
                    normal += f64::from(weight) * target.normal_deltas[k].as_dvec3();
                }
            }
            let mut blended = [0.0; 12];
            for influence in mesh.influences_of(v) {
                let deformer = mesh.deformers[influence.deformer as usize];
                let matrix = to_root * wide(&globals[deformer.node]) * wide(&deformer.inverse_bind);
                for (sum, entry) in blended.iter_mut().zip(matrix.to_cols_array()) {
                    *sum += f64::from(influence.weight) * entry;
                }
            }
            let matrix = DAffine3::from_cols_array(&blended);
            let inverse_transpose: DMat3 = matrix.matrix3.inverse().transpose();
            (matrix.transform_point3(position), (inverse_transpose * normal).normalize())
        })
        .collect()
}

/// Proves skinning, morphing and normals (non-uniform scale, mirrored nodes) against a literal f64
/// evaluation of the definition.
#[test]
fn agrees_with_the_definition() {
    let (mesh, globals) = (sphere(500, 7), globals(7));
    let rotation = Quat::from_rotation_y(1.0);
    let root = RigidFrame { rotation, translation: Vec3::new(1.0, -2.0, 3.0) };
    let mut out = Deformed::default();
    deform(&mesh, &globals, &[0.7], root, &mut out);
    let expected = slowly(&mesh, &globals, 0.7, root);
    for (v, (position, normal)) in expected.into_iter().enumerate() {
        let away = (out.positions[v].as_dvec3() - position).length();
        assert!(away < 4e-6, "vertex {v}: {away}");
        // A blend of a mirrored and a plain matrix can be nearly flat: its normal is ill-conditioned.
        let turned = (out.normals[v].as_dvec3() - normal).length();
        assert!(turned < 1e-3, "vertex {v}: normal off by {turned}");
    }
}

/// Proves that a mirrored sphere still has normals that point outwards.
#[test]
fn mirrored_normals_point_outwards() {
    let mut mesh = sphere(200, 1);
    mesh.morphs.clear();
    mesh.deformers[0].inverse_bind = Affine3A::IDENTITY;
    let mirror = Affine3A::from_scale(Vec3::new(-1.0, 2.0, 1.0));
    let mut out = Deformed::default();
    deform(&mesh, &[mirror], &[], RigidFrame::IDENTITY, &mut out);
    assert!(out.positions.iter().zip(&out.normals).all(|(p, n)| p.dot(*n) > 0.0));
}

/// Proves that collapsed, tiny and huge matrices leave finite unit normals.
#[test]
fn degenerate_matrices_leave_unit_normals() {
    let mut mesh = sphere(50, 1);
    mesh.morphs.clear();
    for scale in [Vec3::ZERO, Vec3::X, Vec3::splat(1e-12), Vec3::splat(1e12)] {
        let mut out = Deformed::default();
        let root = RigidFrame { rotation: Quat::from_rotation_z(0.5), ..RigidFrame::IDENTITY };
        deform(&mesh, &[Affine3A::from_scale(scale)], &[], root, &mut out);
        for normal in &out.normals {
            assert!((normal.length() - 1.0).abs() < 1e-5, "{normal} at scale {scale}");
        }
    }
}
