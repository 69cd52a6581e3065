//! Limits, and scenes without a surface.

use super::*;

/// Every limit is enforced and named.
#[test]
fn limits_are_enforced_and_named() {
    let mut maker = Maker::triangle();
    maker.document["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 0}]);
    maker.root(json!({"name": "joint"}));
    let joints = maker.accessor("VEC4", &[0_u8; 12]);
    let weights = maker.accessor("VEC4", &[1_f32; 12]);
    let attributes = &mut maker.document["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = json!(joints);
    attributes["WEIGHTS_0"] = json!(weights);
    maker.push("skins", json!({"joints": [1, 0]}));
    maker.document["nodes"][0]["skin"] = json!(0);
    let times = maker.accessor("SCALAR", &[0_f32, 1.]);
    let values = maker.accessor("VEC3", &[0_f32; 6]);
    let channel = |node: usize| json!({"sampler": 0, "target": {"node": node, "path": "scale"}});
    let samplers = json!([{"input": times, "output": values}]);
    maker.push("animations", json!({"channels": [channel(0), channel(1)], "samplers": samplers}));
    assert!(maker.import().is_ok());
    type Field = fn(&mut Limits) -> &mut u64;
    let fields: [(&str, Field, u64); 12] = [
        ("file_bytes", |l| &mut l.file_bytes, 100),
        ("decoded_bytes", |l| &mut l.decoded_bytes, 35),
        ("json_values", |l| &mut l.json_values, 20),
        ("files", |l| &mut l.files, 0),
        ("nodes", |l| &mut l.nodes, 1),
        ("parts", |l| &mut l.parts, 0),
        ("joints", |l| &mut l.joints, 1),
        ("vertices", |l| &mut l.vertices, 2),
        ("triangles", |l| &mut l.triangles, 0),
        ("morph_targets", |l| &mut l.morph_targets, 0),
        ("channels", |l| &mut l.channels, 1),
        ("keys", |l| &mut l.keys, 3),
    ];
    for (name, field, value) in fields {
        let mut limits = Limits::default();
        *field(&mut limits) = value;
        let refusal = import_sources(maker.sources(), &limits).unwrap_err().to_string();
        assert!(refusal.contains(&format!("the limit `{name}` is {value}")), "{name}: {refusal}");
    }
}

/// Many nodes that show one mesh are bounded by what they show, not by what the file holds.
#[test]
fn instances_cannot_multiply_beyond_the_limits() {
    let mut maker = Maker::new();
    let corners: Vec<f32> = TRIANGLE.repeat(1000);
    let positions = maker.accessor("VEC3", &corners);
    let mesh = maker.mesh(&json!({"attributes": {"POSITION": positions}}));
    let nodes: Vec<usize> = (0..5000).map(|_| maker.push("nodes", json!({"mesh": mesh}))).collect();
    maker.document["scenes"][0]["nodes"] = json!(nodes);
    assert!(maker.refusal().contains("the limit `vertices` is 4000000"), "{}", maker.refusal());
}

/// No triangles is an error that says so; a fault elsewhere in the file is the better answer.
#[test]
fn a_scene_needs_triangles() {
    let mut empty = Maker::new();
    empty.root(json!({}));
    assert!(empty.refusal().contains("scenes[0] has no surface to light"));
    let mut lines = Maker::triangle();
    lines.document["meshes"][0]["primitives"][0]["mode"] = json!(1);
    assert!(matches!(lines.import(), Err(Error::NoTriangles { .. })));
    let mut hidden = Maker::triangle();
    hidden.document["scenes"][0]["nodes"] = json!([]);
    assert!(matches!(hidden.import(), Err(Error::NoTriangles { .. })));
    hidden.document["accessors"][0]["count"] = json!(9);
    assert!(hidden.refusal().contains("do not fit"), "{}", hidden.refusal());
}

/// A broken accessor that nothing needs is a notice.
#[test]
fn unneeded_faults_are_notices() {
    let mut maker = Maker::triangle();
    maker.push(
        "accessors",
        json!({"bufferView": 0, "componentType": 5126, "count": 99, "type": "VEC2"}),
    );
    assert_notice(&maker.scene(), "not needed, but broken: accessors[1]");
}

/// A rest pose without extent, or beyond single precision, is refused with its size.
#[test]
fn the_rest_pose_has_an_extent() {
    let scaled = |scale: f32| {
        let mut maker = Maker::triangle();
        maker.document["nodes"][0]["scale"] = json!([scale, scale, scale]);
        maker.import()
    };
    assert!(scaled(1.0).is_ok() && scaled(-100.0).is_ok());
    for scale in [0.0, 1e-12, 1e12, 3e38] {
        let refusal = scaled(scale).unwrap_err().to_string();
        assert!(refusal.contains("the rest pose is"), "{refusal}");
    }
}
