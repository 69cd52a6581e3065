//! Scenes that come in other forms: as archives of several files, and as sequences of vertices.

use std::io::{Cursor, Write};

use serde_json::{Value, json};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use super::client::{Answer, Server, sha256};
use super::kinds::finish;
use super::{job, small};

pub(crate) fn zipped(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in files {
        writer.start_file(*name, SimpleFileOptions::default()).expect("begun");
        writer.write_all(bytes).expect("written");
    }
    writer.finish().expect("ended").into_inner()
}

/// The bundled character as glTF with its buffer in a file of its own.
pub(crate) fn apart(glb: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let length = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().expect("four")) as usize;
    let (json, rest) = (&glb[20..20 + length(12)], 20 + length(12));
    let mut document: Value = serde_json::from_slice(json).expect("JSON");
    document["buffers"][0]["uri"] = json!("data/hero%20one.bin");
    (document.to_string().into_bytes(), glb[rest + 8..rest + 8 + length(rest)].to_vec())
}

/// An archive of a glTF and its buffer becomes assets of which a job can be made, the same job that
/// the single file makes; again it is the same; bombs, names that leave it and broken scenes are
/// refused.
#[test]
fn an_archive_becomes_a_scene() {
    let server = Server::start(&["--max-asset-mib", "2"]);
    let glb = std::fs::read(server.path("figure.glb")).expect("made");
    let (document, buffer) = apart(&glb);
    let files = [("hero/hero.gltf", &document[..]), ("hero/data/hero one.bin", &buffer[..])];
    let put = |bytes: &[u8]| {
        server.put(&format!("/v1/assets/{}?name=hero.zip", sha256(bytes)), bytes, &[])
    };
    let bytes = zipped(&files);
    let kept = put(&bytes);
    assert_eq!((kept.status, &kept.json()["kind"]), (201, &json!("bundle")), "{}", kept.text());
    let names =
        json!({ "hero/hero.gltf": sha256(&document), "hero/data/hero one.bin": sha256(&buffer) });
    assert_eq!(kept.json()["files"], names);
    let again = put(&bytes);
    assert_eq!((again.status, &again.json()["files"]), (200, &names), "{}", again.text());
    let document_alone = |bytes: &[u8]| {
        server.put(&format!("/v1/assets/{}?name=hero.gltf", sha256(bytes)), bytes, &[])
    };
    let alone = document_alone(&document);
    assert_eq!((alone.status, &alone.json()["kind"]), (201, &json!("gltf")), "{}", alone.text());
    assert_eq!(document_alone(&document).status, 200, "it is there");
    let text = String::from_utf8(document.clone()).expect("text");
    for broken in [
        "{",
        "{\"asset\":{\"version\":\"1.0\"}}",
        &text.replace("\"bufferView\":", "\"bufferView\":9"),
    ] {
        let answer = document_alone(broken.as_bytes());
        assert_eq!(answer.json()["type"], "/problems/bad-asset", "{broken}: {}", answer.text());
    }
    let mut request = job(&server, &small());
    let plan = |request: &Value| {
        let answer = server.post("/v1/jobs?dry_run=true", request, &[]);
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.json()
    };
    let single = plan(&request);
    request["assets"] = names;
    request["recipe"]["scene"] = json!({ "file": "hero/hero.gltf" });
    let several = plan(&request);
    for same in ["poses", "points", "rays"] {
        assert_eq!(single[same], several[same], "{same}");
    }
    let refused = |answer: &Answer, status: u16, kind: &str| {
        assert_eq!(answer.status, status, "{}", answer.text());
        assert_eq!(answer.json()["type"], format!("/problems/{kind}"), "{}", answer.text());
    };
    let zeros = vec![0; 8 << 20];
    refused(&put(&zipped(&[files[0], files[1], ("zeros", &zeros)])), 413, "asset-too-large");
    refused(&put(&zipped(&[("../../evil.glb", &glb)])), 422, "bad-asset");
    refused(&put(&zipped(&[files[0]])), 422, "bad-asset");
    refused(&put(&zipped(&[("notes.txt", b"no scene")])), 422, "bad-asset");
    refused(&put(b"PK\x03\x04 and nothing else"), 422, "bad-asset");
    assert!(!server.path("evil.glb").exists() && !server.path("data/evil.glb").exists());
    let left = std::fs::read_dir(server.path("data/incoming")).expect("a folder").count();
    assert_eq!(left, 0, "something unpacked stays");
}

/// NumPy's form of an array (NEP 1).
pub(crate) fn npy(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut head = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    while (10 + head.len() + 1) % 64 != 0 {
        head.push(' ');
    }
    head.push('\n');
    let length = (head.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], head.as_bytes(), data].concat()
}

/// A sequence of vertices makes a model that is evaluated by the vertices of a pose; another number
/// of them, and positions for a model with joints, are refused at their field.
#[test]
fn cloth_is_evaluated_by_its_vertices() {
    let server = Server::start(&[]);
    let sheet = |lift: f32| -> Vec<f32> {
        (0..9)
            .flat_map(|i| {
                let (x, z) = ((i % 3) as f32, (i / 3) as f32);
                [x, if i == 4 { lift } else { 0.0 }, z]
            })
            .collect()
    };
    let faces: Vec<i32> = (0..4)
        .flat_map(|i| {
            let a = i % 2 + i / 2 * 3;
            [a, a + 3, a + 1, a + 1, a + 3, a + 4]
        })
        .collect();
    let frames: Vec<u8> =
        (0..4).flat_map(|k| sheet(k as f32 * -0.3)).flat_map(f32::to_le_bytes).collect();
    let faces: Vec<u8> = faces.into_iter().flat_map(i32::to_le_bytes).collect();
    let archive = zipped(&[
        ("positions.npy", &npy("<f4", "(4, 9, 3)", &frames)),
        ("faces.npy", &npy("<i4", "(8, 3)", &faces)),
    ]);
    let digest = sha256(&archive);
    let kept = server.put(&format!("/v1/assets/{digest}?name=sheet.npz"), &archive, &[]);
    assert_eq!(kept.status, 201, "{}", kept.text());
    let recipe = json!({ "version": 1, "bake": { "signal": "ao", "rays": 16 }, "target": { "reference_poses": 1 } });
    let request = json!({ "kind": "run", "assets": { "sheet.npz": digest }, "recipe": recipe });
    let done = finish(&server, &request);
    let model = format!("{}/evaluate", done["result"]["href"].as_str().expect("a model"));
    let mesh = json!({ "positions": [sheet(0.0), sheet(-0.9)], "vertices": [4, 0] });
    let answer = server.post(&model, &mesh, &[]);
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(answer.json()["shape"], json!([2, 2, 1, 1]));
    let rest = server.post(&model, &json!({ "poses": [{}], "vertices": [4, 0] }), &[]).json();
    let values = answer.json()["values"].as_array().expect("values").clone();
    assert_eq!(values[..2], rest["values"].as_array().expect("values")[..], "another rest");
    // The middle sinks, and what is around it hides it.
    let [flat, deep] = [0, 2].map(|i| values[i].as_f64().expect("a number"));
    assert!(deep < flat - 0.1, "{flat} {deep}");
    let refused = |body: Value, pointer: &str| {
        let answer = server.post(&model, &body, &[]);
        assert_eq!(answer.status, 422, "{}", answer.text());
        assert_eq!(answer.json()["errors"][0]["pointer"], pointer, "{}", answer.text());
    };
    refused(json!({ "positions": [vec![0.0; 26]] }), "#/positions/0");
    refused(json!({ "positions": [] }), "#/positions");
    refused(json!({ "positions": [sheet(0.0)], "poses": [{}] }), "#");
    let scene = json!({ "assets": { "sheet.npz": digest } });
    let plain = server.post(&model, &json!({ "positions": [sheet(0.0)] }), &[]).json();
    let named = json!({ "positions": [sheet(0.0)], "scene": scene });
    let named = server.post(&model, &named, &[]);
    assert_eq!((named.status, &named.json()["values"]), (200, &plain["values"]), "its own scene");
    let named =
        |assets: Value| json!({ "poses": [{}], "scene": { "file": "a", "assets": assets } });
    refused(named(json!({ "a": "x" })), "#/scene/assets/a");
    refused(named(json!({ "a": "0".repeat(64) })), "#/scene/assets/a");
    refused(named(json!({ "a": digest, "a/b.npz": digest })), "#/scene/assets/a~1b.npz");
    refused(named(json!({})), "#/scene/assets");
    let many: serde_json::Map<String, Value> =
        (0..300).map(|index| (format!("{index}"), json!(digest))).collect();
    refused(named(Value::Object(many)), "#/scene/assets");
    let placed = json!({ "poses": [{}], "scene": scene, "vertices": [4, 0] });
    assert_eq!(server.post(&model, &placed, &[]).json()["values"], rest["values"]);
}
