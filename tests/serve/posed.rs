//! Models that look at the posed mesh, which the service has from the scene that they were made of, from
//! one that is named, or from the vertices of a pose.

use std::fs;

use serde_json::{Value, json};

use super::client::{Server, sha256};
use super::kinds::finish;
use super::scenes::{npy, zipped};
use super::{grpc, job, small};

const RAW: [(&str, &str); 1] = [("Accept", "application/octet-stream")];

/// What is told at the first field of fault.
fn refused(server: &Server, path: &str, body: &Value) -> String {
    let answer = server.post(path, body, &[]);
    assert_eq!(answer.status, 422, "{}", answer.text());
    answer.json()["errors"][0]["pointer"].as_str().unwrap_or_default().to_owned()
}

/// A GLB whose first two vertices changed places.
fn shuffled(glb: &[u8]) -> Vec<u8> {
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let text: Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    let at = &text["meshes"][0]["primitives"][0]["attributes"]["POSITION"];
    let accessor = &text["accessors"][at.as_u64().expect("an accessor") as usize];
    let view = &text["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
    let offset = |of: &Value| of["byteOffset"].as_u64().unwrap_or(0) as usize;
    let start = 28 + length + offset(view) + offset(accessor);
    let mut glb = glb.to_vec();
    glb[start..start + 24].rotate_left(12);
    glb
}

/// Joints and clips of a model that looks at the posed mesh need no scene to be named: it is that of the model's job,
/// over HTTP as over gRPC, and gives what the command line gives. When the job is gone the scene must
/// be named.
#[test]
fn the_scene_of_a_model_is_known() {
    let mut server = Server::start(&[]);
    let mut recipe = small();
    recipe["fit"] = json!({ "family": "linear", "unshadowed": true });
    let done = finish(&server, &job(&server, &recipe));
    let place = format!("/v1/jobs/{}", done["id"].as_str().expect("an id"));
    let model = done["result"]["href"].as_str().expect("a model").to_owned();
    let path = format!("{model}/evaluate");
    let about = server.get(&model, &[]).json();
    assert_eq!(about["model"]["needs_scene"], true, "{about}");
    let values = |body: &Value| {
        let answer = server.post(&path, body, &RAW);
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.body
    };
    let scene = json!({ "assets": { "figure.glb": server.figure() } });
    let name = about["model"]["joints"][3].as_str().expect("a joint");
    let turn = |half: f32| json!({ name: { "rotation": [half.sin(), 0.0, 0.0, half.cos()] } });
    let pose = |half: f32| json!({ "poses": [{ "joints": turn(half) }] });
    let mut named = pose(0.4);
    named["scene"] = scene.clone();
    assert!(values(&pose(0.4)) == values(&named), "another scene than its own");
    assert!(values(&pose(0.4)) != values(&pose(0.0)), "the pose has no part in it");
    let shuffled = shuffled(&fs::read(server.path("figure.glb")).expect("the figure"));
    let digest = sha256(&shuffled);
    let kept = server.put(&format!("/v1/assets/{digest}?name=figure.glb"), &shuffled, &[]);
    assert_eq!(kept.status, 201, "{}", kept.text());
    named["scene"] = json!({ "assets": { "figure.glb": digest } });
    assert_eq!(refused(&server, &path, &named), "#/scene");
    named["scene"] = scene;
    let blob = server.get(&format!("{model}/blob"), &[]).body;
    fs::write(server.path("model.safetensors"), blob).expect("written");
    let words = ["evaluate", "model.safetensors", "--scene", "figure.glb", "--clip", "jump"];
    server.command(&[&words[..], &["--fps", "4", "-o", "jump.npy"]].concat());
    let expected = fs::read(server.path("jump.npy")).expect("made");
    let clip = |times: &Value| json!({ "clip": { "name": "jump", "times_s": times } });
    let played = values(&clip(&json!([0.0, 0.25])));
    assert!(expected[128..].starts_with(&played), "not what the command line gives");
    grpc::plays(&server, &model, "jump", &[0.0, 0.25], &played);
    let swim = json!({ "clip": { "name": "swim", "times_s": [0.0] } });
    assert_eq!(refused(&server, &path, &swim), "#/clip/name");
    assert_eq!(refused(&server, &path, &clip(&json!([-1.0]))), "#/clip/times_s/0");
    let file = json!({ "clip": { "name": "jump", "times_s": [0.0], "file": "figure.glb" } });
    assert_eq!(refused(&server, &path, &file), "#/clip/assets");
    let row = vec![0.0; about["model"]["parameters"].as_array().map_or(0, Vec::len)];
    assert_eq!(refused(&server, &path, &json!({ "parameters": [row] })), "#/parameters/0");
    assert_eq!(server.delete(&place).status, 204);
    server.terminate();
    server.restart();
    assert_eq!(refused(&server, &path, &pose(0.4)), "#/scene");
    assert_eq!(refused(&server, &path, &clip(&json!([0.0]))), "#/clip");
    assert_eq!(server.post(&path, &named, &[]).status, 200, "its scene is still uploaded");
}

/// A sheet whose middle hangs through; a model of it that looks at the posed mesh gives the same by the
/// vertices of a frame as by that frame of the sequence, and something else by other vertices.
#[test]
fn cloth_is_looked_at() {
    let server = Server::start(&[]);
    let sheet = |lift: f32| -> Vec<f32> {
        let at = |i: usize| {
            let (x, z) = ((i % 5) as f32, (i / 5) as f32);
            let middle = (x - 2.0).abs().max((z - 2.0).abs()) < 1.5;
            [x, if middle { lift * (1.0 + 0.1 * x) } else { 0.0 }, z]
        };
        (0..25).flat_map(at).collect()
    };
    let corner = |i: i32| i % 4 + i / 4 * 5;
    let faces: Vec<i32> =
        (0..16).map(corner).flat_map(|a| [a, a + 5, a + 1, a + 1, a + 5, a + 6]).collect();
    let frames: Vec<u8> =
        (0..4).flat_map(|k| sheet(k as f32 * -0.5)).flat_map(f32::to_le_bytes).collect();
    let faces: Vec<u8> = faces.into_iter().flat_map(i32::to_le_bytes).collect();
    let archive = zipped(&[
        ("positions.npy", &npy("<f4", "(4, 25, 3)", &frames)),
        ("faces.npy", &npy("<i4", "(32, 3)", &faces)),
        ("fps.npy", &npy("<f4", "()", &2.0_f32.to_le_bytes())),
    ]);
    let digest = sha256(&archive);
    let kept = server.put(&format!("/v1/assets/{digest}?name=sheet.npz"), &archive, &[]);
    assert_eq!(kept.status, 201, "{}", kept.text());
    for fit in [json!({ "family": "occluder", "spheres": 4 }), json!({ "family": "linear" })] {
        let recipe = json!({
            "version": 1,
            "bake": { "signal": "transfer", "order": 2, "rays": 16 },
            "poses": { "near_repeat": 0, "rate_hz": 4 },
            "fit": fit,
            "target": { "reference_poses": 1 },
        });
        let request = json!({ "kind": "run", "assets": { "sheet.npz": digest }, "recipe": recipe });
        let done = finish(&server, &request);
        let path = format!("{}/evaluate", done["result"]["href"].as_str().expect("a model"));
        let asked = |body: &Value| -> Value {
            let answer = server.post(&path, body, &[]);
            assert_eq!(answer.status, 200, "{}", answer.text());
            answer.json()
        };
        let values = |answer: &Value| -> Vec<f64> {
            answer["values"].as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
        };
        let meshes = json!({ "positions": [sheet(0.0), sheet(-0.5), sheet(-1.5)] });
        let by_vertices = values(&asked(&meshes));
        let clip = json!({ "clip": { "name": "sequence", "times_s": [0.0, 0.5, 1.5] } });
        let by_clip = values(&asked(&clip));
        assert_eq!(by_vertices.len(), 3 * 25 * 4);
        let far =
            |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(far(&by_vertices, &by_clip) < 1e-4, "{}", far(&by_vertices, &by_clip));
        let pose = far(&by_vertices[..100], &by_vertices[200..]);
        assert!(pose > 0.05, "the pose has no part in it");
        // A sheet that folds the other way is far from all that was trained on.
        let strange = asked(&json!({ "positions": [sheet(-0.5), sheet(3.0)] }));
        let distances = strange["distances"].as_array().expect("one a pose");
        let far = |i: usize| distances[i]["mahalanobis"].as_f64().expect("a number");
        assert!(far(1) > 2.0 && far(1) > 2.0 * far(0), "{distances:?}");
        let fault = refused(&server, &path, &json!({ "positions": [vec![0.0; 3]] }));
        assert_eq!(fault, "#/positions/0");
    }
}
