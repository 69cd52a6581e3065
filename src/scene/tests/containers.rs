//! GLB chunks, JSON, extensions, and the files behind URIs.

use super::*;

/// Unknown chunks are skipped, doubled ones ignored, trailing bytes cut, each as it should be.
#[test]
fn chunks_are_walked() {
    let maker = Maker::triangle();
    let mut document = maker.document.clone();
    document["buffers"] = json!([{"byteLength": 36}]);
    let text = document.to_string();
    let (json, binary) = ((b"JSON", text.as_bytes()), (b"BIN\0", &maker.bytes[..]));
    let extra = (b"XTRA", &b"whatever"[..]);
    let scene = import_bytes("a", &glb(&[json, extra, binary, json, binary])).unwrap();
    assert_eq!(scene.mesh, maker.scene().mesh);
    assert_notice(&scene, "a second JSON chunk");
    assert_notice(&scene, "a second BIN chunk");
    let mut long = glb(&[json, binary]);
    long.extend([1, 2, 3]);
    assert_notice(&import_bytes("a", &long).unwrap(), "3 bytes after the GLB's end");
    let refusal = import_bytes("a", &glb(&[binary, json])).unwrap_err().to_string();
    assert!(refusal.contains("byte 12: the first chunk must be JSON"), "{refusal}");
    let refusal = import_bytes("a", &glb(&[json])).unwrap_err().to_string();
    assert!(refusal.contains("buffers[0] needs data from outside"), "{refusal}");
    let mut version = glb(&[json, binary]);
    version[4] = 1;
    let refusal = import_bytes("a", &version).unwrap_err().to_string();
    assert!(refusal.contains("container version is 1"), "{refusal}");
}

/// A GLB cut anywhere, and one whose lengths lie in any byte, is an error and never a panic.
#[test]
fn truncations_are_refused() {
    let whole = Maker::triangle().glb();
    assert!(import_bytes("a.glb", &whole).is_ok());
    for length in 0..whole.len() {
        assert!(import_bytes("a.glb", &whole[..length]).is_err(), "{length} bytes");
    }
    for at in (4..20).filter(|at| !(16..20).contains(at)) {
        let mut spoilt = whole.clone();
        spoilt[at] ^= 0xFF;
        assert!(import_bytes("a.glb", &spoilt).is_err(), "byte {at}");
    }
}

/// Any byte of a rich document may change without a panic; the outcome is a scene or an error.
#[test]
fn any_byte_may_change() {
    let mut maker = Maker::triangle();
    let indices = maker.accessor("SCALAR", &[0_u16, 1, 2]);
    let joints = maker.accessor("VEC4", &[0_u8; 12]);
    let weights = maker.normalized("VEC4", &[255_u8, 0, 0, 0].repeat(3));
    let primitive = &mut maker.document["meshes"][0]["primitives"][0];
    primitive["indices"] = json!(indices);
    primitive["attributes"]["JOINTS_0"] = json!(joints);
    primitive["attributes"]["WEIGHTS_0"] = json!(weights);
    primitive["targets"] = json!([{"POSITION": 0}]);
    maker.push("skins", json!({"joints": [1]}));
    maker.document["nodes"][0]["skin"] = json!(0);
    maker.root(json!({"name": "joint"}));
    let times = maker.accessor("SCALAR", &[0_f32, 1.]);
    let turns = maker.accessor("VEC4", &[0_f32, 0., 0., 1., 1., 0., 0., 0.]);
    let animation = json!({
        "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}],
        "samplers": [{"input": times, "output": turns}],
    });
    maker.push("animations", animation);
    let whole = maker.glb();
    let scene = import_bytes("a.glb", &whole).unwrap();
    assert_eq!((scene.mesh.deformers.len(), scene.mesh.morphs.len()), (1, 1));
    for at in 0..whole.len() {
        for change in [1, 0x20, 0x80, 0xFF] {
            let mut spoilt = whole.clone();
            spoilt[at] ^= change;
            drop(import_bytes("a.glb", &spoilt));
        }
    }
}

/// What is no scene is refused by name: other content, an empty file, an empty list.
#[test]
fn other_files_are_refused() {
    let refusal = |name: &str, bytes: &[u8]| import_bytes(name, bytes).unwrap_err().to_string();
    assert!(refusal("a.png", b"\x89PNG").contains("a.png is neither glTF"));
    assert!(refusal("a.glb", b"PK").contains("does not start with `glTF`"));
    assert!(refusal("a.gltf", b"").contains("EOF"));
    assert!(refusal("a", b"{").contains("line 1"));
    assert!(refusal("a.gltf", b"[1,2]").contains("glTF JSON"));
    let deep = "[".repeat(100_000);
    assert!(refusal("a", format!("{{\"asset\":{deep}").as_bytes()).contains("glTF JSON"));
    assert!(import_sources(Vec::new(), &Limits::default()).is_err());
    assert!(matches!(import(Path::new("no/such"), &Limits::default()), Err(Error::Io { .. })));
}

/// Versions other than 2, and a least version that is newer than known, are refused by name.
#[test]
fn versions_are_checked() {
    for (member, value) in [("version", "1.0"), ("version", "3.0"), ("minVersion", "2.1")] {
        let mut maker = Maker::triangle();
        maker.document["asset"][member] = json!(value);
        let refusal = maker.refusal();
        assert!(refusal.contains(&format!("asset.{member} needs glTF {value:?}")), "{refusal}");
    }
    let mut maker = Maker::triangle();
    maker.document["asset"]["version"] = json!("2.1");
    assert!(maker.import().is_ok());
}

/// Extensions: unknown required ones and mesh compression are refused by name, those that touch no
/// geometry pass, Draco with plain accessors beside it is read.
#[test]
fn extensions_are_known_or_refused() {
    let required = |name: &str| {
        let mut maker = Maker::triangle();
        maker.document["extensionsUsed"] = json!([name]);
        maker.document["extensionsRequired"] = json!([name]);
        maker
    };
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "ACME_teapot"] {
        let refusal = required(name).refusal();
        let expected = format!("extensionsRequired[0] needs {name}, which is not supported");
        assert!(refusal.starts_with(&expected), "{refusal}");
    }
    for name in ["KHR_mesh_quantization", "KHR_materials_unlit", "EXT_mesh_gpu_instancing"] {
        assert!(required(name).import().is_ok(), "{name}");
    }
    let mut draco = Maker::triangle();
    draco.document["meshes"][0]["primitives"][0]["extensions"] =
        json!({"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}});
    assert!(draco.import().is_ok());
    draco.document["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    let refusal = draco.refusal();
    assert!(refusal.contains("primitives[0] needs KHR_draco_mesh_compression"), "{refusal}");
    let mut meshopt = Maker::triangle();
    meshopt.document["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": {}});
    assert!(meshopt.refusal().contains("bufferViews[0] needs EXT_meshopt_compression"));
    let mut pointer = Maker::triangle();
    pointer.document["extensionsUsed"] = json!(["KHR_animation_pointer"]);
    assert_notice(&pointer.scene(), "KHR_animation_pointer was ignored");
}

/// Parts that are not read may be of any kind; what is read may not.
#[test]
fn unread_parts_may_be_strange() {
    let mut maker = Maker::triangle();
    maker.document["materials"] = json!({"not": "a list"});
    maker.document["textures"] = json!([{"extensions": {"EXT_texture_webp": {"source": 0}}}]);
    assert_notice(&maker.scene(), "not needed were left out");
    maker.document["nodes"][0]["mesh"] = json!("zero");
    let refusal = maker.refusal();
    assert!(refusal.contains("glTF JSON: ") && refusal.contains("line 1"), "{refusal}");
}

/// External buffers: a missing, short, or outside file is an error once its data is needed, and
/// unused ones are never looked for.
#[test]
fn external_buffers_are_checked() {
    let with = |uri: &str, length: usize| {
        let mut maker = Maker::triangle();
        maker.document["buffers"] = json!([{"uri": uri, "byteLength": length}]);
        maker
    };
    assert!(with("data.bin", 36).import().is_ok());
    assert!(with("./d%61ta.bin", 36).import().is_ok());
    assert!(with("data.bin", 37).refusal().contains("byteLength is 37, but there are 36 bytes"));
    assert!(with("other.bin", 36).refusal().contains("\"other.bin\" is not among"));
    for outside in ["../data.bin", "/etc/passwd", "a/../../b", "C:\\x"] {
        let refusal = with(outside, 36).refusal();
        assert!(refusal.starts_with("buffers[0].uri: the uri"), "{refusal}");
    }
    assert!(with("http://host/x.bin", 36).refusal().contains("has a scheme"));
    assert!(with("data:;base64,AAA", 36).refusal().contains("there are 2 bytes"));
    assert!(with("data:;base64,A", 36).refusal().contains("cut short"));
    let mut unused = Maker::triangle();
    unused.document["buffers"] = json!([
        {"uri": "data.bin", "byteLength": 36},
        {"uri": "http://host/x.bin", "byteLength": 1},
    ]);
    assert!(unused.import().is_ok());
}
