//! The node graph: order, names, transforms, scenes, instances.

use glam::{Affine3A, EulerRot, Mat4, Quat, Vec3};

use super::*;

/// Children that the file lists before their parents still come after them, names become unique,
/// and parts keep the file's order of nodes.
#[test]
fn parents_come_first_and_names_differ() {
    let mut maker = Maker::new();
    let positions = maker.accessor("VEC3", &TRIANGLE);
    let mesh = maker.mesh(&json!({"attributes": {"POSITION": positions}}));
    maker.push("nodes", json!({"name": "arm", "mesh": mesh}));
    maker.push("nodes", json!({"name": "arm", "children": [0]}));
    maker.push("nodes", json!({"name": "arm_2"}));
    maker.push("nodes", json!({"mesh": mesh}));
    maker.root(json!({"name": "", "children": [3, 1, 2]}));
    let scene = maker.scene();
    let nodes = &scene.skeleton.nodes;
    let names: Vec<&str> = nodes.iter().map(|node| node.name.as_str()).collect();
    assert_eq!(names, ["node4", "node3", "arm", "arm_2", "arm_2_2"]);
    let parents: Vec<Option<usize>> = nodes.iter().map(|node| node.parent).collect();
    assert_eq!(parents, [None, Some(0), Some(0), Some(2), Some(0)]);
    let carriers: Vec<usize> = scene.mesh.parts.iter().map(|part| part.node).collect();
    assert_eq!(carriers, [3, 1]);
}

/// Matrices of rotations with mirroring and non-uniform scale become transforms with the same
/// matrix, to single precision.
#[test]
fn matrices_are_decomposed() {
    for (scale, angle) in [
        (Vec3::new(1.0, 2.0, 3.0), 0.3),
        (Vec3::new(-1.0, 2.0, 0.5), 1.3),
        (Vec3::new(1.0, -2.0, 3.0), -2.3),
        (Vec3::new(-1.0, -2.0, -3.0), 3.1),
        (Vec3::new(0.0, 2.0, 3.0), 1.0),
        (Vec3::new(2.0, 0.0, 3.0), 1.0),
        (Vec3::new(2.0, 3.0, 0.0), 1.0),
        (Vec3::new(0.0, 0.0, 3.0), 1.0),
        (Vec3::new(0.0, 3.0, 0.0), 1.0),
        (Vec3::new(3.0, 0.0, 0.0), 1.0),
        (Vec3::ZERO, 1.0),
    ] {
        let rotation = Quat::from_euler(EulerRot::YXZ, angle, 0.4, -0.7);
        let matrix =
            Mat4::from_scale_rotation_translation(scale, rotation, Vec3::new(4.0, 5.0, 6.0));
        let mut maker = Maker::triangle();
        maker.root(json!({"matrix": matrix.to_cols_array()}));
        let scene = maker.scene();
        let rest = scene.skeleton.nodes[1].rest;
        assert!((rest.rotation.length() - 1.0).abs() < 1e-6);
        let found = rest.to_affine();
        let close = found.abs_diff_eq(Affine3A::from_mat4(matrix), 1e-5);
        assert!(close, "{scale}: {found} is not {matrix}");
        assert_eq!(scene.notices.len(), 1, "{:?}", scene.notices);
    }
}

/// What a transform cannot express is said: shear, and a last row that projects.
#[test]
fn lost_parts_of_a_matrix_are_said() {
    let shear = [1., 0., 0., 0., 1., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
    let projection = [1., 0., 0., 0.1, 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
    for matrix in [shear, projection] {
        let mut maker = Maker::triangle();
        maker.root(json!({"matrix": matrix}));
        let scene = maker.scene();
        assert_notice(&scene, "nodes[1].matrix is no translation, rotation and scale");
    }
}

/// Rotations are normalised; a zero one, and values beyond f32, are refused by name.
#[test]
fn rotations_are_unit() {
    let mut maker = Maker::triangle();
    maker.root(json!({"rotation": [0, 0, 3, 4]}));
    let scene = maker.scene();
    assert!(
        scene.skeleton.nodes[1].rest.rotation.abs_diff_eq(Quat::from_xyzw(0., 0., 0.6, 0.8), 1e-6)
    );
    assert_notice(&scene, "nodes[1].rotation has length 5");
    let mut zero = Maker::triangle();
    zero.root(json!({"rotation": [0, 0, 0, 0]}));
    assert!(zero.refusal().contains("nodes[1].rotation: the quaternion is zero"));
    for member in ["translation", "scale"] {
        let mut infinite = Maker::triangle();
        infinite.root(json!({ member: [1e39, 0, 0] }));
        assert!(infinite.refusal().contains("not finite"), "{}", infinite.refusal());
    }
}

/// The default scene is taken, else the first, else everything; a mesh that two nodes show is
/// two parts, and nodes of other scenes are not there.
#[test]
fn the_default_scene_is_taken() {
    let mut maker = Maker::triangle();
    maker.push("nodes", json!({"mesh": 0, "name": "other", "children": [2]}));
    maker.push("nodes", json!({"mesh": 0, "translation": [1, 0, 0]}));
    maker.push("scenes", json!({"nodes": [1]}));
    let first = maker.scene();
    assert_eq!(first.skeleton.nodes.len(), 1);
    assert_notice(&first, "of 2 scenes, scenes[0] (the first) is taken");
    maker.document["scene"] = json!(1);
    let second = maker.scene();
    assert_eq!(second.skeleton.nodes.len(), 2);
    assert_eq!(second.mesh.parts.len(), 2);
    assert_eq!(second.mesh.triangles, [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(second.mesh.deformers.len(), 2);
    let members = maker.document.as_object_mut().unwrap();
    members.remove("scenes");
    members.remove("scene");
    let all = maker.scene();
    assert_eq!(all.skeleton.nodes.len(), 3);
    assert_notice(&all, "no scene");
}

/// Graphs that are no forest are refused with the node: cycles, also unreachable ones and a node
/// under itself, two parents, and scene roots that have a parent.
#[test]
fn graphs_must_be_forests() {
    let cases = [
        (json!([{"mesh": 0}, {"children": [2]}, {"children": [1]}]), "cyclic"),
        (json!([{"mesh": 0}, {"children": [1]}]), "nodes[1]: it is its own ancestor"),
        (json!([{"mesh": 0, "children": [0]}]), "cyclic"),
        (json!([{"mesh": 0}, {"children": [3]}, {"children": [3]}, {}]), "nodes[3]: it is a child"),
        (json!([{"mesh": 0}, {"children": [0]}]), "nodes[0] is no root"),
        (json!([{"mesh": 0, "children": [7]}]), "nodes[0].children[0] names nodes[7]"),
    ];
    for (nodes, expected) in cases {
        let mut maker = Maker::triangle();
        maker.document["nodes"] = nodes;
        assert!(maker.refusal().contains(expected), "{} / {expected}", maker.refusal());
    }
}

/// A chain as deep as the limit allows neither overflows the stack nor takes long.
#[test]
fn deep_chains_import() {
    let mut maker = Maker::triangle();
    let depth = 60_000;
    let chain = (0..depth).map(|i| json!({"children": [i + 2]}));
    let nodes = std::iter::once(json!({"mesh": 0})).chain(chain).chain([json!({})]);
    maker.document["nodes"] = nodes.collect();
    maker.document["scenes"][0]["nodes"] = json!([0, 1]);
    assert_eq!(maker.scene().skeleton.nodes.len(), depth + 2);
}

/// Overlong names are cut at a character boundary, so that copies cannot multiply them.
#[test]
fn names_are_bounded() {
    let mut maker = Maker::triangle();
    maker.root(json!({"name": "é".repeat(5000)}));
    assert_eq!(maker.scene().skeleton.nodes[1].name, "é".repeat(100));
}

/// A triangle whose node has these instances.
fn instanced(attributes: &Value) -> Maker {
    let mut maker = Maker::triangle();
    maker.document["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    maker.document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    maker.document["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
    maker
}

/// Instances are nodes below their own, each with the mesh at its translation, rotation and scale; they
/// move with their node, and what the triangles reflect is that of each.
#[test]
fn instances_stand_where_they_are_put() {
    let mut maker = Maker::triangle();
    let places = maker.accessor("VEC3", &[0.0_f32, 0.0, 0.0, 5.0, 0.0, 0.0]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let turns = maker.accessor("VEC4", &[0.0_f32, 0.0, 0.0, 1.0, 0.0, half, 0.0, half]);
    let scales = maker.accessor("VEC3", &[1.0_f32, 1.0, 1.0, 2.0, 2.0, 2.0]);
    let attributes = json!({"TRANSLATION": places, "ROTATION": turns, "SCALE": scales});
    maker.document["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
    let scene = maker.scene();
    assert_eq!((scene.mesh.parts.len(), scene.mesh.triangles.len()), (2, 2));
    let rest = Pose::rest(&scene.skeleton, &[]);
    let globals = scene.skeleton.globals(&rest.local);
    let [first, second] = [0, 1].map(|part| globals[scene.mesh.parts[part].node]);
    let corner = Vec3::new(1.0, 0.5, 0.0);
    assert!((first.transform_point3(corner) - corner).length() < 1e-6);
    let expected = Vec3::new(5.0, 1.0, -2.0);
    assert!((second.transform_point3(corner) - expected).length() < 1e-5);
    let content = Content::Surface { plain: 0.25, transparency: true };
    let lit = import_sources_content(maker.sources(), &Limits::default(), content).unwrap();
    assert_eq!(lit.surface.unwrap().material.len(), 2);
}

/// Millions of instances, accessors of different lengths, quaternions of no length and attributes
/// that name nothing are refused with the node.
#[test]
fn strange_instances_are_refused() {
    let mut many = instanced(&json!({"TRANSLATION": 1}));
    many.push("accessors", json!({"componentType": 5126, "count": 5_000_000, "type": "VEC3"}));
    let refusal = many.refusal();
    assert!(refusal.contains("the limit `nodes` is 65536"), "{refusal}");
    let refused = |translations: &[f32], rotations: &[f32]| {
        let mut maker = instanced(&json!({"TRANSLATION": 1, "ROTATION": 2}));
        maker.accessor("VEC3", translations);
        maker.accessor("VEC4", rotations);
        maker.refusal()
    };
    assert!(refused(&[0.0; 6], &[0.0, 0.0, 0.0, 1.0]).contains("but 2 of another"));
    assert!(refused(&[0.0; 3], &[0.0; 4]).contains("a quaternion is zero"));
    assert!(instanced(&json!({"SCALE": "all"})).refusal().contains("names no accessor"));
}
