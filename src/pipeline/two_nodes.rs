//! A scene of two nodes for tests: a lid half a metre over a floor, each a level square of four vertices.

use serde_json::{Value, json};

use crate::scene::{self, Limits, Scene, Source};

/// The lid comes first in the file. Both nodes show one mesh, or each its own.
pub(super) fn scene(shared: bool) -> Scene {
    let bytes = document(shared).to_string().into_bytes();
    let source = Source { name: "two.gltf".into(), bytes };
    scene::import_sources(vec![source], &Limits::default()).unwrap()
}

/// The scene's file.
pub(super) fn document(shared: bool) -> Value {
    let corners = [[-1.0_f32, 0.0, -1.0], [-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0]];
    let floats = corners.iter().chain(&[[0.0, 1.0, 0.0]; 4]).flatten();
    let mut bytes: Vec<u8> = floats.flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    let text: String = bytes.iter().map(|byte| format!("%{byte:02x}")).collect();
    let vectors =
        |view: u32| json!({"bufferView": view, "componentType": 5126, "count": 4, "type": "VEC3"});
    let mesh = |name: &str| {
        let attributes = json!({"POSITION": 0, "NORMAL": 1});
        json!({"name": name, "primitives": [{"attributes": attributes, "indices": 2}]})
    };
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"mesh": 0, "name": "lid", "translation": [0.0, 0.5, 0.0]},
            {"mesh": i32::from(!shared), "name": "floor"},
        ],
        "meshes": [mesh("square"), mesh("ground")],
        "accessors": [
            vectors(0),
            vectors(1),
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 48},
            {"buffer": 0, "byteOffset": 96, "byteLength": 12},
        ],
        "buffers": [{
            "uri": format!("data:application/octet-stream,{text}"),
            "byteLength": bytes.len(),
        }],
    })
}
