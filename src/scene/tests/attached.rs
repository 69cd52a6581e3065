//! Values written into a GLB.

use super::*;

/// A triangle with things that nobody here knows.
fn exotic() -> Maker {
    let mut maker = Maker::triangle();
    maker.document["extras"] = json!({"studio": ["x", 1.5, null]});
    maker.document["extensionsUsed"] = json!(["ACME_secret"]);
    maker.document["extensions"] = json!({"ACME_secret": {"deep": {"er": true}}});
    maker.document["meshes"][0]["primitives"][0]["extras"] = json!(7);
    maker
}

fn json_of(glb: &[u8]) -> Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

fn attribute(name: &str, width: usize) -> Attribute {
    let values = (0..3 * width).map(|i| i as f32 + 0.5).collect();
    Attribute { name: name.into(), width, values }
}

/// The values come back at their vertices, the scene imports as before, and everything else of the
/// file is what it was.
#[test]
fn values_come_back_and_nothing_else_changes() {
    let glb = exotic().glb();
    let before = import_bytes("a.glb", &glb).unwrap();
    let attributes = [attribute("_AO", 1), attribute("_TRANSFER_0", 4)];
    let written = attach(&glb, &before.mesh.parts, &attributes).unwrap();
    let after = import_bytes("a.glb", &written).unwrap();
    assert_eq!((&after.mesh, &after.skeleton), (&before.mesh, &before.skeleton));

    let (mut new, old) = (json_of(&written), json_of(&glb));
    let all = new["meshes"][0]["primitives"][0]["attributes"].clone();
    for attribute in &attributes {
        let accessor = &new["accessors"][all[&attribute.name].as_u64().unwrap() as usize];
        let view = &new["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let binary = written.len() - new["buffers"][0]["byteLength"].as_u64().unwrap() as usize;
        let start = binary + view["byteOffset"].as_u64().unwrap() as usize;
        let length = view["byteLength"].as_u64().unwrap() as usize;
        let bytes = &written[start..start + length];
        let read = bytes.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
        assert_eq!(read.collect::<Vec<_>>(), attribute.values);
    }
    new["meshes"][0]["primitives"][0]["attributes"] =
        old["meshes"][0]["primitives"][0]["attributes"].clone();
    for list in ["accessors", "bufferViews"] {
        let count = old[list].as_array().unwrap().len();
        new[list].as_array_mut().unwrap().truncate(count);
    }
    new["buffers"] = old["buffers"].clone();
    assert_eq!(new, old);
}

/// A name that is taken, a mesh of two nodes, another file, a file that is no GLB and every
/// truncation are refused.
#[test]
fn what_cannot_be_written_is_refused() {
    let maker = exotic();
    let glb = maker.glb();
    let parts = import_bytes("a.glb", &glb).unwrap().mesh.parts;
    let refused = |glb: &[u8], parts: &[crate::rig::Part], name: &str| {
        attach(glb, parts, &[attribute(name, 1)]).expect_err("must be refused").to_string()
    };
    assert!(refused(&glb, &parts, "POSITION").contains("already"));
    let mut twice = exotic();
    twice.root(json!({"mesh": 0}));
    let shared = import_bytes("a.glb", &twice.glb()).unwrap().mesh.parts;
    assert!(refused(&twice.glb(), &shared, "_AO").contains("another node's"));
    assert!(refused(&glb, &shared, "_AO").contains("another one"));
    assert!(refused(b"{}", &parts, "_AO").contains(".glb"));
    for length in 0..glb.len() {
        assert!(attach(&glb[..length], &parts, &[attribute("_AO", 1)]).is_err(), "{length}");
    }
}

/// Lines of the first node have as many vertices as the triangles of the second: the values go to the
/// primitive that import took, also where the first is a mesh of points without a surface.
#[test]
fn values_go_to_what_import_took() {
    for mode in [0, 1, 3] {
        let mut maker = Maker::new();
        let lines = maker.accessor("VEC3", &[9.0_f32; 9]);
        let attributes = json!({"POSITION": lines});
        let lines = maker.mesh(&json!({"attributes": attributes, "mode": mode}));
        maker.root(json!({"mesh": lines}));
        let positions = maker.accessor("VEC3", &TRIANGLE);
        let attributes = json!({"POSITION": positions});
        let triangle = maker.mesh(&json!({"attributes": attributes}));
        maker.root(json!({"mesh": triangle}));
        let glb = maker.glb();
        let parts = import_bytes("a.glb", &glb).unwrap().mesh.parts;
        let written = json_of(&attach(&glb, &parts, &[attribute("_AO", 1)]).unwrap());
        let held =
            |mesh: usize| !written["meshes"][mesh]["primitives"][0]["attributes"]["_AO"].is_null();
        assert_eq!([held(lines), held(triangle)], [false, true], "mode {mode}");
        // Parts of another file, in which that node has the lines, are not this file's.
        let mut others = parts.clone();
        others[0].source_node = 0;
        assert!(attach(&glb, &others, &[attribute("_AO", 1)]).is_err());
    }
}

/// Two nodes of three vertices each, of which the first was taken out as an occluder: the other gets the
/// values. Where both show one mesh, either would show them, and that is refused.
#[test]
fn what_was_taken_out_gets_nothing() {
    let two = |shared: bool| {
        let mut maker = Maker::triangle();
        let mesh = if shared {
            0
        } else {
            let positions = maker.accessor("VEC3", &TRIANGLE);
            maker.mesh(&json!({"attributes": {"POSITION": positions}}))
        };
        maker.root(json!({"mesh": mesh}));
        let glb = maker.glb();
        let whole = import_bytes("a.glb", &glb).unwrap().mesh;
        let (lit, _) = whole.split(|part| part.source_node == 0);
        attach(&glb, &lit.parts, &[attribute("_AO", 1)]).map(|written| json_of(&written))
    };
    let written = two(false).unwrap();
    let held = |mesh: usize| &written["meshes"][mesh]["primitives"][0]["attributes"]["_AO"];
    assert!(held(0).is_null() && held(1).is_u64());
    assert!(two(true).unwrap_err().to_string().contains("another node's"));
}
