//! Tests of the rest mesh.

use glam::{Affine3A, Quat, Vec3, Vec3Swizzles};

use crate::model::{
    Error, Family, Frame, Model, PosedInput, PosedPoints, Precision, Signal, synthetic,
};
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
    let Deformed { positions, normals } = expected;
    let expected = PosedPoints { positions, normals, tangents: Vec::new() };
    let values = |model: &Model, surface: &PosedPoints| {
        let parameters = model.parameters_of_pose(&pose).unwrap();
        let turns = model.bone_rotations_of(&pose).unwrap();
        let surface = Some(surface.as_surface());
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

/// A model of the tangent frame carries its tangents with its rest mesh: they are unit and at right
/// angles to the posed normals, and values in the root frame are those of the model turned from +Z to
/// the normal and from +X to the tangent. Without the posed mesh they are refused, in the model's own
/// frame not; another number of tangents, or tangents in another frame, are none of the model's.
#[test]
fn tangents_turn_values_to_the_root() {
    let plain = synthetic::model(Family::Linear, Signal::Transfer, Frame::Tangent, 1);
    let model = plain.clone().with_rest(mesh()).unwrap();
    let bytes = model.to_bytes(Precision::F16).unwrap();
    let read = Model::from_bytes(&bytes).unwrap();
    assert_eq!(read.to_bytes(Precision::F16).unwrap(), bytes);
    let mut pose = crate::rig::Pose {
        local: model.rig.skeleton.nodes.iter().map(|node| node.rest).collect(),
        weights: vec![0.5],
    };
    pose.local[2].rotation = Quat::from_rotation_z(0.8);
    let surface = read.surface_of(&pose).unwrap().expect("it carries its rest mesh");
    assert_eq!(model.surface_of(&pose).unwrap().as_ref(), Some(&surface));
    let parameters = model.parameters_of_pose(&pose).unwrap();
    let turns = model.bone_rotations_of(&pose).unwrap();
    let given = Some(surface.as_surface());
    let input = PosedInput { parameters: &parameters, bone_rotations: &turns, surface: given };
    let (points, width) = (model.shape().points, model.shape().width);
    let (mut own, mut found) = (vec![0.0; points * width], vec![0.0; points * width]);
    model.evaluate(&parameters, None, &mut own).unwrap();
    model.evaluate_posed(&input, &mut found).unwrap();
    let order = model.header().sh_order();
    let probe = Vec3::new(0.36, -0.48, 0.8);
    let (mut y, mut expected) = (vec![0.0; width], vec![0.0; width]);
    for point in 0..points {
        let (n, t) = (surface.normals[point], surface.tangents[point]);
        assert!(t.dot(n).abs() < 1e-5 && (t.length() - 1.0).abs() < 1e-5, "{point}: {n} {t}");
        // The function's value at a direction is that of its own frame where that direction is seen.
        let local = Vec3::new(t.dot(probe), n.cross(t).dot(probe), n.dot(probe));
        crate::sh::evaluate(order, local, &mut y);
        crate::sh::evaluate(order, probe, &mut expected);
        let value = |c: &[f32], y: &[f32]| c.iter().zip(y).map(|(c, y)| c * y).sum::<f32>();
        let row = point * width..(point + 1) * width;
        let (a, b) = (value(&found[row.clone()], &expected), value(&own[row], &y));
        assert!((a - b).abs() < 2e-4 * (1.0 + b.abs()), "{point}: {a} {b}");
    }
    let told = |result: Result<(), Error>| result.expect_err("refused").to_string();
    let without = PosedInput { surface: None, ..input };
    assert!(told(model.evaluate_posed(&without, &mut found)).contains("posed mesh"));
    assert!(told(model.to_root_frame(&turns, None, &mut found)).contains("posed mesh"));
    let short = PosedPoints { tangents: Vec::new(), ..surface.clone() };
    let short = PosedInput { surface: Some(short.as_surface()), ..input };
    assert!(told(model.evaluate_posed(&short, &mut found)).contains("tangents"));
    let light = vec![1.0; width];
    assert!(told(model.fold(&light, &turns).map(drop)).contains("posed mesh"));
    assert!(told(plain.clone().with_tangents(vec![[127, 0, 0]]).map(drop)).contains("tangents"));
    let bone = synthetic::model(Family::Linear, Signal::Transfer, Frame::Bone, 1);
    assert!(
        told(bone.with_tangents(plain.tangents().to_vec()).map(drop)).contains("tangent frame")
    );
    let scalar = synthetic::header(Family::Mean, Signal::Ao, Frame::Tangent, 1);
    let mean = crate::model::Decoder::Mean { mean: vec![0.5; points] };
    let (vertices, bones) = synthetic::maps();
    assert!(told(Model::new(scalar, mean, vertices, bones).map(drop)).contains("no direction"));
    // Whatever a blob says: no direction, and one along the normal.
    let zero = plain.with_tangents(vec![[0; 3]; points]).unwrap().with_rest(mesh()).unwrap();
    let surface = zero.surface_of(&pose).unwrap().expect("it carries its rest mesh");
    assert!(surface.tangents.iter().all(|t| (t.length() - 1.0).abs() < 1e-5));
}
