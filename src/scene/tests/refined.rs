//! Refined primitives written into a GLB.

use super::*;
use crate::rig::{Influence, Mix};

/// A triangle with an attribute of each kind, two joints, a morph target and things that nobody here
/// knows.
fn dressed() -> Maker {
    let mut maker = Maker::new();
    let attributes = json!({
        "POSITION": maker.accessor("VEC3", &TRIANGLE),
        "NORMAL": maker.accessor("VEC3", &[1.0_f32, 0., 0., 0., 1., 0., 0., 0., 1.]),
        "TANGENT": maker.accessor("VEC4", &[1.0_f32, 0., 0., -1., 0., 1., 0., -1., 0., 0., 1., 1.]),
        "TEXCOORD_0": maker.normalized("VEC2", &[0_u16, 0, 65535, 0, 0, 65535]),
        "COLOR_0": maker.normalized("VEC4", &[255_u8, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255]),
        "_ID": maker.accessor("SCALAR", &[7.0_f32, 8., 9.]),
        "_LAYER": maker.accessor("VEC4", &[1_u8, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0]),
        "JOINTS_0": maker.accessor("VEC4", &[0_u8, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]),
        "WEIGHTS_0": maker.accessor("VEC4", &[1.0_f32, 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0.]),
    });
    let target =
        json!({"POSITION": maker.accessor("VEC3", &[0.0_f32, 0., 2., 0., 0., 0., 0., 0., 0.])});
    let mesh = maker.mesh(&json!({"attributes": attributes, "targets": [target], "extras": [1]}));
    let skin = maker.push("skins", json!({"joints": [1, 2]}));
    maker.root(json!({"mesh": mesh, "skin": skin}));
    maker.root(json!({"name": "a"}));
    maker.root(json!({"name": "b"}));
    maker.document["extensions"] = json!({"ACME_secret": {"deep": true}});
    maker
}

/// One vertex in the middle of the first edge, and the two triangles that it makes.
fn halved(influences: Vec<Influence>) -> RefinedPart {
    RefinedPart {
        part: 0,
        added: vec![Mix { vertices: [0, 1, 2], weights: [0.5, 0.5, 0.0] }],
        influences: vec![influences],
        moved: Vec::new(),
        triangles: vec![[0, 3, 2], [3, 1, 2]],
    }
}

fn written(maker: &Maker) -> (Vec<u8>, Value) {
    let bytes = maker.glb();
    let scene = import_bytes("a.glb", &bytes).unwrap();
    let half = |deformer| Influence { deformer, weight: 0.5 };
    let new = refine(&bytes, &scene.mesh, &[halved(vec![half(0), half(1)])]).unwrap();
    let length = u32::from_le_bytes(new[12..16].try_into().unwrap()) as usize;
    let document = serde_json::from_slice(&new[20..20 + length]).unwrap();
    (new, document)
}

/// The old vertices are what they were; the new one has each attribute between those of its edge:
/// unit normal and tangent, the tangent's sign and whole numbers from a corner, both joints, half the
/// morph's delta. Everything else of the file stays.
#[test]
fn attributes_lie_between() {
    let maker = dressed();
    let (new, document) = written(&maker);
    let (before, after) = (maker.scene(), import_bytes("a.glb", &new).unwrap());
    assert_eq!(after.mesh.triangles, [[0, 3, 2], [3, 1, 2]]);
    assert_eq!(after.mesh.positions[..3], before.mesh.positions);
    assert_eq!(after.mesh.positions[3], glam::Vec3::new(0.5, 0.0, 0.0));
    let diagonal = glam::Vec3::new(1.0, 1.0, 0.0).normalize();
    assert!((after.mesh.normals[3] - diagonal).length() < 1e-6);
    let moved: Vec<(u32, f32)> =
        after.mesh.influences_of(3).iter().map(|one| (one.deformer, one.weight)).collect();
    assert_eq!(moved, [(0, 0.5), (1, 0.5)]);
    let morph = &after.mesh.morphs[0];
    let at = morph.vertices.iter().position(|&vertex| vertex == 3).unwrap();
    assert_eq!(morph.position_deltas[at], glam::Vec3::Z);

    let attributes = &document["meshes"][0]["primitives"][0]["attributes"];
    let binary = new.len() - document["buffers"][0]["byteLength"].as_u64().unwrap() as usize;
    let last = |name: &str| {
        let index = attributes[name].as_u64().unwrap() as usize;
        Elements::read(&document, &new[binary..], index, 4).unwrap().element(3).to_vec()
    };
    let root = 0.5_f32.sqrt();
    assert_eq!(last("TANGENT"), [root, root, 0.0, -1.0].map(f64::from));
    assert_eq!(last("TEXCOORD_0"), [0.5, 0.0]);
    assert_eq!(last("COLOR_0"), [0.5, 0.5, 0.0, 1.0]);
    assert_eq!((last("_ID"), last("_LAYER")), (vec![7.5], vec![1.0, 0.0, 0.0, 0.0]));
    assert_eq!(document["extensions"], maker.document["extensions"]);
    assert_eq!(document["meshes"][0]["primitives"][0]["extras"], json!([1]));
}

/// A primitive without morph targets gets none, not even empty ones.
#[test]
fn nothing_is_invented() {
    let mut maker = dressed();
    maker.document["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("targets");
    let (_, document) = written(&maker);
    let primitive = document["meshes"][0]["primitives"][0].as_object().unwrap();
    let names: Vec<&str> = primitive.keys().map(String::as_str).collect();
    assert_eq!(names, ["attributes", "extras", "indices"]);
}

/// Every truncation, and accessors that lie outside of the binary chunk, are refused.
#[test]
fn what_cannot_be_read_is_refused() {
    let maker = dressed();
    let bytes = maker.glb();
    let mesh = import_bytes("a.glb", &bytes).unwrap().mesh;
    let part = [halved(Vec::new())];
    for length in 0..bytes.len() {
        assert!(refine(&bytes[..length], &mesh, &part).is_err(), "{length}");
    }
    for (field, value) in
        [("byteOffset", json!(1_u64 << 40)), ("count", json!(2)), ("type", json!("X"))]
    {
        let mut maker = dressed();
        let id = maker.document["meshes"][0]["primitives"][0]["attributes"]["_ID"].as_u64();
        maker.document["accessors"][id.unwrap() as usize][field] = value;
        let told = refine(&maker.glb(), &mesh, &part).expect_err(field).to_string();
        assert!(told.contains("accessors["), "{told}");
    }
}
