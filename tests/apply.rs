//! A model's values written back, with the real binary: a character and the patch of floor that receives its
//! shadow, each in its own file; bent normals as an attribute and as an array.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

fn run(folder: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_poselight"));
    command.args(words).current_dir(folder).output().expect("started")
}

fn succeed(folder: &Path, words: &[&str]) {
    let output = run(folder, words);
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// A level square of four vertices as a GLB, with something in `extras` that nobody reads.
fn patch() -> Vec<u8> {
    squares(&json!([{"mesh": 0, "name": "floor"}]))
}

/// The same shown by nodes that each have a mesh of their own.
fn squares(nodes: &Value) -> Vec<u8> {
    let corners = [[-1.0_f32, 0.0, -1.0], [-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0]];
    let numbers = corners.iter().flatten().chain([[0.0, 1.0, 0.0]; 4].iter().flatten());
    let mut binary: Vec<u8> = numbers.flat_map(|x: &f32| x.to_le_bytes()).collect();
    binary.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    let vectors =
        |view: u32| json!({"bufferView": view, "componentType": 5126, "count": 4, "type": "VEC3"});
    let mut positions = vectors(0);
    positions["min"] = json!([-1.0, 0.0, -1.0]);
    positions["max"] = json!([1.0, 0.0, 1.0]);
    let count = nodes.as_array().expect("a list").len();
    let mesh = json!({"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]});
    let document = json!({
        "asset": {"version": "2.0"},
        "extras": {"kept": [1, 2, 3]},
        "scene": 0,
        "scenes": [{"nodes": (0..count).collect::<Vec<usize>>()}],
        "nodes": nodes,
        "meshes": vec![mesh; count],
        "accessors": [
            positions,
            vectors(1),
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 48},
            {"buffer": 0, "byteOffset": 96, "byteLength": 12},
        ],
        "buffers": [{"byteLength": binary.len()}],
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = |bytes: usize| (bytes as u32).to_le_bytes();
    let mut glb = [b"glTF".as_slice(), &2_u32.to_le_bytes()].concat();
    glb.extend(length(28 + text.len() + binary.len()));
    glb.extend([&length(text.len()), b"JSON".as_slice(), &text].concat());
    glb.extend([&length(binary.len()), b"BIN\0".as_slice(), &binary].concat());
    glb
}

/// The JSON of a GLB.
fn document(path: &Path) -> Value {
    let bytes = fs::read(path).expect("written");
    let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).expect("JSON")
}

/// The numbers of elements of an attribute over all primitives.
fn elements(document: &Value, attribute: &str) -> Vec<u64> {
    let meshes = document["meshes"].as_array().expect("meshes").iter();
    let primitives = meshes.flat_map(|mesh| mesh["primitives"].as_array().expect("primitives"));
    let held = primitives.map(|primitive| primitive["attributes"][attribute].as_u64());
    let held: Vec<u64> = held.map(|accessor| accessor.expect("every primitive has it")).collect();
    held.iter()
        .map(|&at| document["accessors"][at as usize]["count"].as_u64().expect("a count"))
        .collect()
}

/// The character's file and the patch's each get the model's values at their own vertices, and keep what else
/// they hold; without the patch the model is of another mesh, and says so; bent normals of both come out of
/// evaluation as unit vectors.
#[test]
fn each_file_gets_its_own_values() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    fs::write(folder.join("floor.glb"), patch()).expect("written");
    succeed(folder, &["sample", "figure", "-o", "figure.glb"]);
    let bake = ["bake", "figure.glb", "-o", "d.zarr", "--signal", "transfer", "--order", "2"];
    let few = ["--rays", "8", "--clip", "walk", "--fps", "2", "--receivers", "floor.glb"];
    succeed(folder, &[&bake[..], &few].concat());
    succeed(folder, &["fit", "d.zarr", "-o", "m.safetensors", "--family", "linear"]);
    let apply = ["apply", "m.safetensors", "figure.glb", "--clip", "walk", "-o", "lit.glb"];
    let refused = run(folder, &apply);
    let told = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && told.contains("receivers 0"), "{told}");
    let files = ["figure.glb", "floor.glb"].map(|name| fs::read(folder.join(name)).expect("read"));
    for (output, received, evidence) in [
        ("lit.glb", "./floor.glb", "--receivers-output would replace the receivers' scene"),
        ("lit.glb", "figure.glb", "--receivers-output would replace the scene"),
        ("./floor.glb", "lit-floor.glb", "the output would replace the receivers' scene"),
        ("lit.glb", "./lit.glb", "--receivers-output would replace the output"),
    ] {
        let words = ["apply", "m.safetensors", "figure.glb", "-o", output];
        let more = ["--receivers", "floor.glb", "--receivers-output", received];
        let refused = run(folder, &[&words[..], &more].concat());
        let told = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{told}");
        assert!(told.contains(evidence), "{told}");
    }
    let after = ["figure.glb", "floor.glb"].map(|name| fs::read(folder.join(name)).expect("read"));
    assert!(files == after && !folder.join("lit.glb").exists());
    let more =
        ["--receivers", "floor.glb", "--receivers-output", "lit-floor.glb", "--bent-normals"];
    succeed(folder, &[&apply[..], &more].concat());
    let character = document(&folder.join("lit.glb"));
    let floor = document(&folder.join("lit-floor.glb"));
    assert_eq!(floor["extras"], json!({"kept": [1, 2, 3]}));
    for attribute in ["_TRANSFER_0", "_BENT_NORMAL"] {
        assert_eq!(elements(&floor, attribute), [4]);
        assert_eq!(elements(&character, attribute), elements(&character, "POSITION"));
    }
    let evaluate = ["evaluate", "m.safetensors", "--scene", "figure.glb", "--bent-normals"];
    succeed(folder, &[&evaluate[..], &["-o", "bent.npy"]].concat());
    let bytes = fs::read(folder.join("bent.npy")).expect("written");
    let vertices = elements(&character, "POSITION").iter().sum::<u64>() as usize + 4;
    let shape = format!("(1, {vertices}, 3");
    let header = String::from_utf8_lossy(&bytes[..128]).into_owned();
    assert!(header.contains(&shape), "{header} is not {shape}");
    let floats = bytes[bytes.len() - 48..].chunks_exact(4);
    let floats: Vec<f32> =
        floats.map(|four| f32::from_le_bytes(four.try_into().expect("four"))).collect();
    for bent in floats.chunks_exact(3) {
        let length = bent.iter().map(|x| x * x).sum::<f32>().sqrt();
        assert!((length - 1.0).abs() < 1e-4 && bent[1] > 0.8, "{bent:?}");
    }
}

/// Of two squares the first only blocks: the second gets the values, darker than open sky, and nothing of the
/// first changes; an array of values says which vertices its rows are; a picture shows the second alone.
#[test]
fn what_only_blocks_gets_nothing() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    let lid = json!({"mesh": 0, "name": "lid", "translation": [0.0, 0.5, 0.0]});
    let nodes = json!([lid, {"mesh": 1, "name": "floor"}]);
    fs::write(folder.join("two.glb"), squares(&nodes)).expect("written");
    let bake = ["bake", "two.glb", "-o", "d.zarr", "--signal", "ao", "--rays", "64"];
    succeed(folder, &[&bake[..], &["--occluder-node", "lid"]].concat());
    succeed(folder, &["fit", "d.zarr", "-o", "m.safetensors", "--family", "mean"]);
    succeed(folder, &["apply", "m.safetensors", "two.glb", "-o", "lit.glb"]);
    let lit = document(&folder.join("lit.glb"));
    let held = |mesh: usize| &lit["meshes"][mesh]["primitives"][0]["attributes"]["_AO"];
    assert!(held(0).is_null(), "{lit}");
    let accessor = held(1).as_u64().expect("an accessor") as usize;
    assert_eq!(lit["accessors"][accessor]["count"], json!(4));
    let view = lit["accessors"][accessor]["bufferView"].as_u64().expect("a view") as usize;
    let start = lit["bufferViews"][view]["byteOffset"].as_u64().expect("an offset") as usize;
    let bytes = fs::read(folder.join("lit.glb")).expect("written");
    let binary = bytes.len() - lit["buffers"][0]["byteLength"].as_u64().expect("bytes") as usize;
    let values = bytes[binary + start..][..16].chunks_exact(4);
    for value in values.map(|four| f32::from_le_bytes(four.try_into().expect("four"))) {
        assert!((0.2..0.95).contains(&value), "{value}");
    }
    let evaluate = ["evaluate", "m.safetensors", "--scene", "two.glb", "-o", "v.npy", "--json"];
    let told = run(folder, &evaluate);
    let told: Value = serde_json::from_slice(&told.stdout).expect("one object");
    let row = json!({"mesh": "floor", "row": 0, "vertex": 4, "vertices": 4});
    assert_eq!(told["rows"], json!({"scene": [row], "receivers": 0}), "{told}");
    let still = ["still", "two.glb", "--model", "m.safetensors", "-o", "s.png"];
    succeed(folder, &[&still[..], &["--size", "32", "32", "--rays", "4"]].concat());
}

/// A file whose vertices are in another order is refused by whatever puts values at vertices, with what to do;
/// that done, it is taken, and the model's own scene is refused. Motion of a mesh with other vertices will do
/// where the mesh is not looked at.
#[test]
fn another_order_of_vertices_is_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    let floor = patch();
    let mut again = floor.clone();
    let start = again.len() - 108;
    again[start..start + 24].rotate_left(12);
    fs::write(folder.join("floor.glb"), floor).expect("written");
    fs::write(folder.join("again.glb"), again).expect("written");
    let nodes = json!([{"mesh": 0, "name": "floor"}, {"mesh": 1, "name": "wall"}]);
    fs::write(folder.join("two.glb"), squares(&nodes)).expect("written");
    let bake = ["bake", "floor.glb", "-o", "d.zarr", "--signal", "visibility", "--order", "2"];
    succeed(folder, &[&bake[..], &["--rays", "8"]].concat());
    succeed(folder, &["fit", "d.zarr", "-o", "m.safetensors", "--family", "mean"]);
    let apply = |model, scene| run(folder, &["apply", model, scene, "-o", "lit.glb"]);
    let evaluate =
        |model, scene| run(folder, &["evaluate", model, "--scene", scene, "-o", "v.npy"]);
    let still = |model, scene| {
        let few = ["--size", "32", "32", "--rays", "2", "--samples", "1"];
        run(folder, &[&["still", scene, "--model", model, "-o", "s.png"], &few[..]].concat())
    };
    let crowd = |model, scene| {
        let words = ["crowd", scene, "--model", model, "--light", "constant", "-o", "c.png"];
        run(folder, &[&words[..], &["--size", "32", "32", "--rays", "2"]].concat())
    };
    let uses: [&dyn Fn(&'static str, &'static str) -> Output; 4] =
        [&apply, &evaluate, &still, &crowd];
    let rebind = ["rebind", "m.safetensors", "again.glb", "-o", "r.safetensors"];
    succeed(folder, &[&rebind[..], &["--original", "floor.glb"]].concat());
    for answer in uses.map(|usage| usage("m.safetensors", "again.glb")) {
        let told = String::from_utf8_lossy(&answer.stderr).into_owned();
        assert_eq!(answer.status.code(), Some(1), "{told}");
        assert!(told.contains("again.glb") && told.contains("poselight rebind"), "{told}");
    }
    for usage in &uses[..3] {
        for (model, scene) in [("m.safetensors", "floor.glb"), ("r.safetensors", "again.glb")] {
            let answer = usage(model, scene);
            assert!(answer.status.success(), "{}", String::from_utf8_lossy(&answer.stderr));
        }
        assert!(!usage("r.safetensors", "floor.glb").status.success());
    }
    let answer = evaluate("m.safetensors", "two.glb");
    let told = String::from_utf8_lossy(&answer.stdout).into_owned();
    assert!(answer.status.success() && told.contains("gives the motion alone"), "{told}");
}
