//! Accessors: strides, sparse, normalised and quantised values, topologies, and lies about them.

use glam::Vec3;

use super::*;

/// A triangle whose accessor can be spoilt.
fn with(change: impl FnOnce(&mut Maker)) -> Maker {
    let mut maker = Maker::triangle();
    change(&mut maker);
    maker
}

/// Interleaved positions and normals are read by stride and offset.
#[test]
fn interleaved_attributes_are_read() {
    let mut maker = Maker::new();
    let mut values = Vec::new();
    for corner in TRIANGLE.chunks(3) {
        values.extend_from_slice(corner);
        values.extend([0.0, 2.0, 0.0]);
    }
    let view = maker.view(&values);
    maker.document["bufferViews"][view]["byteStride"] = json!(24);
    for offset in [0, 12] {
        let accessor = json!({"bufferView": view, "byteOffset": offset, "componentType": 5126,
            "count": 3, "type": "VEC3"});
        maker.push("accessors", accessor);
    }
    let mesh = maker.mesh(&json!({"attributes": {"POSITION": 0, "NORMAL": 1}}));
    maker.root(json!({"mesh": mesh}));
    let scene = maker.scene();
    assert_eq!(scene.mesh.positions[2], Vec3::Y);
    assert_eq!(scene.mesh.normals, [Vec3::Y; 3]);
    assert!(scene.notices.is_empty());
}

/// KHR_mesh_quantization: positions as padded u16 and as normalised i16, normals as normalised
/// i8, where the most negative value is −1 as well.
#[test]
fn quantised_attributes_are_read() {
    let mut maker = Maker::new();
    maker.document["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let padded: [u16; 12] = [0, 0, 0, 9, 500, 0, 0, 9, 0, 65535, 0, 9];
    let positions = maker.accessor("VEC3", &padded);
    maker.document["bufferViews"][0]["byteStride"] = json!(8);
    maker.document["accessors"][positions]["count"] = json!(3);
    let normals: [i8; 12] = [0, 0, 127, 0, 0, 0, 127, 0, 0, 0, -128, 0];
    let normals = maker.normalized("VEC3", &normals);
    maker.document["bufferViews"][1]["byteStride"] = json!(4);
    maker.document["accessors"][normals]["count"] = json!(3);
    let mesh = maker.mesh(&json!({"attributes": {"POSITION": positions, "NORMAL": normals}}));
    maker.root(json!({"mesh": mesh}));
    let scene = maker.scene();
    assert_eq!(scene.mesh.positions[1], Vec3::new(500., 0., 0.));
    assert_eq!(scene.mesh.positions[2], Vec3::new(0., 65535., 0.));
    assert_eq!(scene.mesh.normals, [Vec3::Z, Vec3::Z, -Vec3::Z]);
    let signed: [i16; 9] = [0, 0, 0, 32767, 0, 0, 0, -32768, 0];
    let signed = maker.normalized("VEC3", &signed);
    maker.document["meshes"][0]["primitives"][0]["attributes"] = json!({"POSITION": signed});
    assert_eq!(maker.scene().mesh.positions[1..], [Vec3::X, -Vec3::Y]);
}

/// Sparse replacements apply over a base and over nothing; bad ones are refused.
#[test]
fn sparse_accessors_are_read() {
    let spoil = |count: usize, index: u8| {
        with(|maker| {
            let indices = maker.view(&[1_u8, index]);
            let values = maker.view(&[7_f32, 0., 0., 0., 8., 0.]);
            maker.document["accessors"][0]["sparse"] = json!({
                "count": count,
                "indices": {"bufferView": indices, "componentType": 5121},
                "values": {"bufferView": values},
            });
        })
    };
    let scene = spoil(2, 2).scene();
    assert_eq!(scene.mesh.positions, [Vec3::ZERO, 7.0 * Vec3::X, 8.0 * Vec3::Y]);
    let mut bare = spoil(2, 2);
    bare.document["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(bare.scene().mesh.positions, scene.mesh.positions);
    assert!(spoil(2, 3).refusal().contains("sparse index 1 is 3, count is 3"));
    assert!(spoil(3, 2).refusal().contains("sparse indices"), "{}", spoil(3, 2).refusal());
    assert!(spoil(4, 2).refusal().contains("sparse.count 4 is more than count 3"));
}

/// Index types, strips and fans; 32-bit indices; degenerate triangles are kept and counted;
/// points and lines are left out with a notice.
#[test]
fn topologies_and_index_types_are_read() {
    let quad = [0_f32, 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.];
    let mut maker = Maker::new();
    let positions = maker.accessor("VEC3", &quad);
    let bytes = maker.accessor("SCALAR", &[0_u8, 1, 2, 3]);
    let words = maker.accessor("SCALAR", &[0_u16, 1, 3, 2]);
    let longs = maker.accessor("SCALAR", &[0_u32, 1, 2, 2, 1, 1, 3]);
    let attributes = json!({"POSITION": positions});
    let primitive = |indices: usize, mode: u32| json!({"attributes": attributes, "indices": indices, "mode": mode});
    let primitives =
        [primitive(bytes, 5), primitive(words, 6), primitive(longs, 4), primitive(bytes, 1)];
    maker.push("meshes", json!({ "primitives": primitives }));
    maker.root(json!({"mesh": 0}));
    let scene = maker.scene();
    let triangles = &scene.mesh.triangles;
    assert_eq!(triangles[..2], [[0, 1, 2], [1, 3, 2]]);
    assert_eq!(triangles[2..4], [[5, 7, 4], [7, 6, 4]]);
    assert_eq!(triangles[4..], [[8, 9, 10], [10, 9, 9]]);
    assert!(scene.mesh.normals.iter().all(|normal| *normal == Vec3::Z || *normal == Vec3::Y));
    assert_notice(&scene, "1 of 6 triangles have no area");
    assert_notice(&scene, "7 corners are no whole number of triangles");
    assert_notice(&scene, "primitives[3] was left out: Lines have no surface");
    let primitives: Vec<usize> = scene.mesh.parts.iter().map(|part| part.primitive).collect();
    assert_eq!(primitives, [0, 1, 2]);
}

/// Numbers that are not finite are refused with accessor and element; in normals they are
/// replaced.
#[test]
fn numbers_must_be_finite() {
    for (number, name) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf")] {
        let mut maker = with(|maker| maker.bytes[24..28].copy_from_slice(&number.to_le_bytes()));
        let refusal = maker.refusal();
        let expected =
            "accessors[0] (POSITION of meshes[0].primitives[0]), element 2, is not finite";
        assert_eq!(refusal, expected, "{name}");
        maker = Maker::triangle();
        let normals = maker.accessor("VEC3", &[number; 9]);
        maker.document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
        assert_eq!(maker.scene().mesh.normals, [Vec3::Z; 3]);
    }
}

/// Every lie about an accessor, view or buffer is refused with its place; none allocates first.
#[test]
fn lies_are_refused() {
    let long = |pointer: &str, value: Value| {
        let maker = with(|maker| *maker.document.pointer_mut(pointer).unwrap() = value);
        maker.refusal()
    };
    for (pointer, value, expected) in [
        ("/accessors/0/count", json!(4), "do not fit the 36 bytes of bufferViews[0]"),
        ("/accessors/0/count", json!(u64::MAX), "do not fit"),
        ("/accessors/0/count", json!(1_u64 << 32), "do not fit"),
        ("/accessors/0/componentType", json!(5125), "Vec3 of U32 is not allowed there"),
        ("/accessors/0/componentType", json!(99), "componentType is none of glTF's"),
        ("/accessors/0/type", json!("VEC9"), "type is none of glTF's"),
        ("/accessors/0/type", json!("MAT3"), "do not fit"),
        ("/accessors/0/bufferView", json!(5), "bufferView names bufferViews[5]"),
        ("/bufferViews/0/byteLength", json!(37), "37 bytes from byte 0 on: buffers[0] has 36"),
        ("/bufferViews/0/byteLength", json!(u64::MAX), "bufferViews[0]"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), "bufferViews[0]"),
        ("/bufferViews/0/buffer", json!(1), "bufferViews[0].buffer names buffers[1]"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(9), "names accessors[9]"),
    ] {
        let refusal = long(pointer, value);
        assert!(refusal.contains(expected), "{pointer}: {refusal}");
    }
    for (member, value, expected) in [
        ("byteStride", json!(8), "byteStride 8 is less than an element's 12 bytes"),
        ("byteStride", json!(u64::MAX), "do not fit"),
    ] {
        let refusal = with(|m| m.document["bufferViews"][0][member] = value).refusal();
        assert!(refusal.contains(expected), "{refusal}");
    }
    let zeros = |count: u64| {
        let mut maker = Maker::triangle();
        let accessor = json!({"componentType": 5126, "count": count, "type": "VEC3"});
        maker.document["accessors"][0] = accessor;
        maker.refusal()
    };
    assert!(zeros(1 << 40).contains("the limit `vertices`"), "{}", zeros(1 << 40));
    assert!(zeros(3).contains("the rest pose is 0 m across"), "{}", zeros(3));
}

/// An accessor without a view is zeros (glTF 2.0 §5.1.1), unless its bounds say that other data is
/// meant: those the file does not hold.
#[test]
fn an_accessor_without_a_view_is_zeros() {
    let mut maker = Maker::triangle();
    let zeros = json!({"componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0]});
    let zeros = maker.push("accessors", zeros);
    let mesh = maker.mesh(&json!({"attributes": {"POSITION": zeros}}));
    maker.root(json!({"mesh": mesh}));
    let scene = maker.scene();
    assert_eq!(scene.mesh.positions.len(), 6);
    assert_eq!(scene.mesh.positions[3..], [Vec3::ZERO; 3]);
    maker.document["accessors"][zeros]["max"] = json!([0, 1, 0]);
    let refusal = maker.refusal();
    assert!(refusal.contains("data from outside the file"), "{refusal}");
}

/// Attributes of one primitive have equal counts, and indices name vertices.
#[test]
fn counts_must_agree() {
    let mut maker = Maker::triangle();
    let normals = maker.accessor("VEC3", &[1_f32; 6]);
    maker.document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    assert!(maker.refusal().contains("NORMAL of meshes[0].primitives[0]): 2 elements for 3"));
    let mut maker = Maker::triangle();
    let indices = maker.accessor("SCALAR", &[0_u16, 1, 3]);
    maker.document["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    assert!(maker.refusal().contains("index 2 is 3, but there are 3 vertices"));
    let restart = maker.accessor("SCALAR", &[0_u16, 1, 65535]);
    maker.document["meshes"][0]["primitives"][0]["indices"] = json!(restart);
    assert!(maker.refusal().contains("primitive restart"));
}
