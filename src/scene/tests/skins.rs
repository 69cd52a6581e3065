//! Skins, weights, and morph targets.

use glam::{Mat4, Vec3};

use super::*;

/// A triangle with joints and weights on a skin of two joints; node 0 carries it.
fn skinned(joints: &[u8; 12], weights: &[f32; 12]) -> Maker {
    let mut maker = Maker::new();
    let positions = maker.accessor("VEC3", &TRIANGLE);
    let joints = maker.accessor("VEC4", joints);
    let weights = maker.accessor("VEC4", weights);
    let attributes = json!({"POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights});
    let mesh = maker.mesh(&json!({"attributes": attributes}));
    let shift = |x| Mat4::from_translation(Vec3::new(x, 0.0, 0.0)).to_cols_array();
    let matrices = maker.accessor("MAT4", &[shift(-1.0), shift(-2.0)].concat());
    maker.push("skins", json!({"joints": [1, 2], "inverseBindMatrices": matrices}));
    maker.root(json!({"mesh": mesh, "skin": 0, "translation": [9, 9, 9]}));
    maker.push("nodes", json!({"translation": [1, 0, 0], "children": [2]}));
    maker.push("nodes", json!({"translation": [1, 0, 0]}));
    maker.document["scenes"][0]["nodes"] = json!([0, 1]);
    maker
}

const ALTERNATING: [u8; 12] = [0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0];
const HALVES: [f32; 12] = [0.5, 0.5, 0., 0., 1., 0., 0., 0., 0.25, 0.75, 0., 0.];

fn weights_of(scene: &Scene, vertex: usize) -> Vec<(u32, f32)> {
    scene.mesh.influences_of(vertex).iter().map(|i| (i.deformer, i.weight)).collect()
}

/// Zero weights are dropped, the rest pose is the bind pose whatever the carrier's transform, and
/// a second mesh on the same skin shares its deformers while a rigid part under a joint gets one.
#[test]
fn meshes_share_a_skin() {
    let mut maker = skinned(&ALTERNATING, &HALVES);
    maker.root(json!({"mesh": 0, "skin": 0}));
    let positions = maker.accessor("VEC3", &TRIANGLE);
    let rigid = maker.mesh(&json!({"attributes": {"POSITION": positions}}));
    let held = maker.push("nodes", json!({"mesh": rigid}));
    maker.document["nodes"][2]["children"] = json!([held]);
    let scene = maker.scene();
    assert_eq!(weights_of(&scene, 0), [(0, 0.5), (1, 0.5)]);
    assert_eq!(weights_of(&scene, 1), [(1, 1.0)]);
    assert_eq!(weights_of(&scene, 3), [(0, 0.5), (1, 0.5)]);
    assert_eq!(weights_of(&scene, 6), [(2, 1.0)]);
    let nodes: Vec<usize> = scene.mesh.deformers.iter().map(|deformer| deformer.node).collect();
    let name = |node: usize| scene.skeleton.nodes[node].name.as_str();
    assert_eq!(
        nodes.iter().map(|&node| name(node)).collect::<Vec<_>>(),
        ["node1", "node2", "node4"]
    );
    // Skinned parts stay at 0..1, the rigid one moves by 2 with its parents.
    assert!((size_m(&scene.mesh, &scene.skeleton) - 10.0_f32.sqrt()).abs() < 1e-5);
}

/// Eight influences from two sets; a joint named twice counts once, with both weights.
#[test]
fn eight_influences_are_read() {
    let mut maker = skinned(&ALTERNATING, &HALVES);
    let joints: Vec<u16> = [1, 0, 0, 0].repeat(3);
    let joints = maker.accessor("VEC4", &joints);
    let shares: Vec<u8> = [255, 0, 0, 0].repeat(3);
    let weights = maker.normalized("VEC4", &shares);
    let attributes = &mut maker.document["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_1"] = json!(joints);
    attributes["WEIGHTS_1"] = json!(weights);
    let scene = maker.scene();
    assert_eq!(weights_of(&scene, 0), [(0, 0.25), (1, 0.75)]);
    assert_eq!(weights_of(&scene, 1), [(1, 1.0)]);
    assert_notice(&scene, "weights of 3 of 3 vertices do not sum to 1");
    maker.document["meshes"][0]["primitives"][0]["attributes"]
        .as_object_mut()
        .unwrap()
        .remove("WEIGHTS_1");
    assert!(maker.refusal().contains("JOINTS_1 and WEIGHTS_1 must come together"));
}

/// More weights than any tool writes are refused by name: the time per vertex stays bounded.
#[test]
fn the_number_of_weight_sets_is_bounded() {
    let mut maker = skinned(&ALTERNATING, &HALVES);
    let attributes = &mut maker.document["meshes"][0]["primitives"][0]["attributes"];
    let (joints, weights) = (attributes["JOINTS_0"].clone(), attributes["WEIGHTS_0"].clone());
    for set in 1..=4 {
        let attributes = &mut maker.document["meshes"][0]["primitives"][0]["attributes"];
        attributes[format!("JOINTS_{set}")] = joints.clone();
        attributes[format!("WEIGHTS_{set}")] = weights.clone();
        assert_eq!(maker.import().is_ok(), set < 4);
    }
    assert!(maker.refusal().contains("needs JOINTS_4, more than 16 influences"));
}

/// Weights that are no shares are refused with vertex and reason; a joint that does not exist
/// only matters where it has weight.
#[test]
fn bad_weights_are_refused() {
    let at = |index: usize, weight: f32| {
        let mut weights = HALVES;
        weights[index] = weight;
        skinned(&ALTERNATING, &weights).refusal()
    };
    assert!(at(4, 0.0).contains("vertex 1: its weights sum to 0"), "{}", at(4, 0.0));
    assert!(at(4, f32::NAN).contains("vertex 1: weight set 0: weight NaN is not a share"));
    assert!(at(0, -0.5).contains("vertex 0: weight set 0: weight -0.5 is not a share"));
    let mut joints = ALTERNATING;
    joints[3] = 77;
    assert!(skinned(&joints, &HALVES).import().is_ok());
    joints[1] = 2;
    let refusal = skinned(&joints, &HALVES).refusal();
    assert!(refusal.contains("joint 2 of a skin with 2 joints"), "{refusal}");
}

/// Skins that lie are refused: no joints, too few matrices, NaN in one, a joint that is no node.
#[test]
fn bad_skins_are_refused() {
    let with = |skin: Value| {
        let mut maker = skinned(&ALTERNATING, &HALVES);
        maker.document["skins"][0] = skin;
        maker.refusal()
    };
    assert!(with(json!({"joints": []})).contains("skins[0]: it has no joints"));
    assert!(with(json!({"joints": [1, 9]})).contains("skins[0].joints[1] names nodes[9]"));
    let few = json!({"joints": [1, 2, 0], "inverseBindMatrices": 3});
    assert!(with(few).contains("2 matrices for 3 joints"));
    let mut maker = skinned(&ALTERNATING, &HALVES);
    let end = maker.bytes.len();
    maker.bytes[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(maker.refusal().contains("accessors[3]"), "{}", maker.refusal());
}

/// Joints outside the chosen scene come along with their ancestors; meshes there do not.
#[test]
fn stray_joints_come_along() {
    let mut maker = skinned(&ALTERNATING, &HALVES);
    maker.document["nodes"][1]["mesh"] = json!(0);
    maker.document["scenes"][0]["nodes"] = json!([0]);
    let scene = maker.scene();
    assert_eq!(scene.skeleton.nodes.len(), 3);
    assert_eq!(scene.mesh.parts.len(), 1);
}

/// A node with a skin whose primitive has no joints moves rigidly, with a notice.
#[test]
fn a_skin_without_joints_is_rigid() {
    let mut maker = skinned(&ALTERNATING, &HALVES);
    maker.document["meshes"][0]["primitives"][0]["attributes"] = json!({"POSITION": 0});
    let scene = maker.scene();
    assert_notice(&scene, "it moves with the node");
    let deformer = scene.mesh.influences_of(0)[0].deformer as usize;
    assert_eq!(scene.mesh.deformers[deformer].node, 0);
}

/// Targets, dense and sparse, on a skinned mesh: only displaced vertices are kept, slots are named
/// by node and target, and a node's weights win over the mesh's.
#[test]
fn morph_targets_have_slots() {
    let mut maker = skinned(&ALTERNATING, &HALVES);
    let dense = maker.accessor("VEC3", &[0_f32, 0., 0., 1., 2., 3., 0., 0., 0.]);
    let bent = maker.accessor("VEC3", &[0_f32, 0., 1., 0., 0., 0., 0., 0., 0.]);
    let index = maker.view(&[2_u16]);
    let value = maker.view(&[4_f32, 5., 6.]);
    let sparse = json!({
        "componentType": 5126, "count": 3, "type": "VEC3",
        "sparse": {
            "count": 1,
            "indices": {"bufferView": index, "componentType": 5123},
            "values": {"bufferView": value},
        },
    });
    let sparse = maker.push("accessors", sparse);
    let mesh = &mut maker.document["meshes"][0];
    mesh["primitives"][0]["targets"] =
        json!([{"POSITION": dense, "NORMAL": bent}, {"POSITION": sparse}]);
    mesh["weights"] = json!([0.5, 0.25]);
    mesh["extras"] = json!({"targetNames": ["smile"]});
    maker.document["nodes"][0]["name"] = json!("Body");
    maker.root(json!({"mesh": 0, "name": "Twin", "weights": [0, 1]}));
    let scene = maker.scene();
    let mesh = &scene.mesh;
    assert_eq!(mesh.weight_names, ["Body/smile", "Body/morph1", "Twin/smile", "Twin/morph1"]);
    assert_eq!(mesh.default_weights, [0.5, 0.25, 0.0, 1.0]);
    assert_eq!(mesh.morphs.len(), 4);
    assert_eq!((mesh.morphs[0].weight, &mesh.morphs[0].vertices[..]), (0, &[0, 1][..]));
    assert_eq!(mesh.morphs[0].position_deltas, [Vec3::ZERO, Vec3::new(1., 2., 3.)]);
    assert_eq!(mesh.morphs[0].normal_deltas, [Vec3::Z, Vec3::ZERO]);
    assert_eq!((mesh.morphs[3].weight, &mesh.morphs[3].vertices[..]), (3, &[5][..]));
    assert_eq!(mesh.morphs[3].position_deltas, [Vec3::new(4., 5., 6.)]);
    assert!(mesh.morphs[3].normal_deltas.is_empty());
}

/// Targets that disagree are refused: in number between primitives, with the weights, in length.
#[test]
fn bad_morph_targets_are_refused() {
    let mut maker = Maker::triangle();
    let short = maker.accessor("VEC3", &[0_f32; 6]);
    let mesh = &mut maker.document["meshes"][0];
    mesh["primitives"][0]["targets"] = json!([{"POSITION": 0}]);
    mesh["weights"] = json!([1, 2]);
    assert!(maker.refusal().contains("meshes[0].weights: 2 weights for 1 morph targets"));
    maker.document["meshes"][0]["weights"] = json!([1]);
    assert_eq!(maker.scene().mesh.default_weights, [1.0]);
    maker.document["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": short}]);
    assert!(maker.refusal().contains("2 elements for 3 vertices"));
    let plain = json!({"attributes": {"POSITION": 0}});
    maker.document["meshes"][0]["primitives"].as_array_mut().unwrap().push(plain);
    assert!(maker.refusal().contains("primitives[1]: 0 morph targets; primitives[0] has 1"));
}
