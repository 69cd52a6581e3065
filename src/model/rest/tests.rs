//! Tests of the rest mesh.

use glam::{Affine3A, Quat, Vec3, Vec3Swizzles};

use crate::model::{Error, Family, Model, PosedInput, Precision, Signal, Surface, synthetic};
use crate::rig::{Deformed, Deformer, Influence, Mesh, MorphTarget, deform};

/// Every point between two bones and under a morph target with normals, some under one without.
fn mesh() -> Mesh {
    let (positions, normals) = synthetic::surface();
    let points = positions.len() as u32;
    let share = |point: u32| 0.25 + 0.5 * (point % 3) as f32 / 2.0;
    let influences = (0..points).flat_map(|point| {
        let weight = share(point);
        [(0, weight), (1 + point % 2, 1.0 - weight)]
            .map(|(deformer, weight)| Influence { deformer, weight })
    });
    let bind = |y| Affine3A::from_rotation_x(y) * Affine3A::from_translation(Vec3::Y * y);
    Mesh {
        influences: influences.collect(),
        influence_starts: (0..=points).map(|point| 2 * point).collect(),
        deformers: [1, 2, 3]
            .map(|node| Deformer { node, inverse_bind: bind(-0.3 * node as f32) })
            .to_vec(),
        morphs: vec![
            MorphTarget {
                weight: 0,
                vertices: (0..points).collect(),
                position_deltas: positions.iter().map(|p| 0.1 * p.yzx()).collect(),
                normal_deltas: positions.iter().map(|p| 0.2 * p.zxy()).collect(),
            },
            MorphTarget {
                weight: 0,
                vertices: vec![3, 8],
                position_deltas: vec![Vec3::X, Vec3::Z],
                normal_deltas: Vec::new(),
            },
        ],
        positions,
        normals,
        ..Mesh::default()
    }
}

fn carrying() -> Model {
    synthetic::occluded(Family::Linear, Signal::Ao).with_rest(mesh()).unwrap()
}

/// Proves that a model evaluates the same from joint rotations alone, by its own rest mesh, as with
/// the mesh that skinning gives, and that blobs of every precision bring it along bit for bit.
#[test]
fn joints_are_enough() {
    let model = carrying();
    let mut pose = crate::rig::Pose {
        local: model.rig.skeleton.nodes.iter().map(|node| node.rest).collect(),
        weights: vec![0.75],
    };
    pose.local[1].translation += Vec3::new(4.0, 0.0, -2.0);
    pose.local[2].rotation = Quat::from_rotation_z(0.8);
    pose.local[3].rotation = Quat::from_rotation_x(-0.5);
    let globals = model.rig.skeleton.globals(&pose.local);
    let mut expected = Deformed::default();
    let root = model.root_frame_of(&pose).unwrap();
    deform(&mesh(), &globals, &pose.weights, root, &mut expected);
    let values = |model: &Model, surface: &Deformed| {
        let parameters = model.parameters_of_pose(&pose).unwrap();
        let turns = model.bone_rotations_of(&pose).unwrap();
        let Deformed { positions, normals } = surface;
        let surface = Some(Surface { positions, normals });
        let input = PosedInput { parameters: &parameters, bone_rotations: &turns, surface };
        let mut out = vec![0.0; model.shape().points];
        model.evaluate_posed(&input, &mut out).unwrap();
        out
    };
    for &precision in Precision::ALL {
        let bytes = model.to_bytes(precision).unwrap();
        let read = Model::from_bytes(&bytes).unwrap();
        let found = read.surface_of(&pose).unwrap().expect("it carries its rest mesh");
        assert_eq!(found, expected, "{precision}");
        assert_eq!(values(&read, &found), values(&read, &expected));
        assert_eq!(read.to_bytes(precision).unwrap(), bytes);
        let header = 8 + u64::from_le_bytes(*bytes.first_chunk().unwrap());
        assert_eq!(model.sizes(precision).total(), bytes.len() as u64 - header);
        for length in (0..bytes.len()).step_by(211) {
            assert!(Model::from_bytes(&bytes[..length]).is_err());
        }
    }
    let plain = synthetic::occluded(Family::Linear, Signal::Ao);
    assert_eq!(plain.surface_of(&pose).unwrap(), None);
}

/// Proves that a mesh which does not fit its model is refused with what is wrong.
#[test]
fn a_mesh_of_another_model_is_refused() {
    let fault = |change: &dyn Fn(&mut Mesh)| {
        let mut mesh = mesh();
        change(&mut mesh);
        let model = synthetic::occluded(Family::Mean, Signal::Ao);
        model.with_rest(mesh).expect_err("must be refused").to_string()
    };
    assert!(fault(&|m| m.positions.truncate(9)).contains("rest.positions"));
    assert!(fault(&|m| m.normals[2].x = f32::NAN).contains("rest.normals"));
    assert!(fault(&|m| m.deformers[1].node = 4).contains("node"));
    assert!(fault(&|m| m.influences[5].deformer = 3).contains("deformer"));
    assert!(fault(&|m| m.influences.truncate(7)).contains("rest_deformers"));
    assert!(fault(&|m| m.influence_starts[4] = 1).contains("out of order"));
    assert!(fault(&|m| m.morphs[1].weight = 1).contains("morph weight"));
    assert!(fault(&|m| m.morphs[1].vertices[0] = 37).contains("displaced"));
    assert!(fault(&|m| m.morphs[1].position_deltas.truncate(1)).contains("deltas"));
    let model = synthetic::occluded(Family::Mean, Signal::Ao);
    let mut pose = crate::rig::Pose::rest(&model.rig.skeleton, &[0.25]);
    pose.local.pop();
    assert!(matches!(carrying().surface_of(&pose), Err(Error::Length { .. })));
}
