//! Import of tiny documents made by hand: one feature or one fault each.

mod accessors;
mod attached;
mod clips;
mod containers;
mod faults;
mod nodes;
mod refined;
pub(crate) mod sequences;
mod skins;
mod surfaces;

use serde_json::{Value, json};

use super::elements::Elements;
use super::*;

/// A document under construction: everything lies in one buffer.
struct Maker {
    document: Value,
    bytes: Vec<u8>,
}

/// glTF's component types, with their bytes.
trait Component: Copy {
    const CODE: u32;
    fn append(self, out: &mut Vec<u8>);
}

macro_rules! component {
    ($kind:ty, $code:literal) => {
        impl Component for $kind {
            const CODE: u32 = $code;
            fn append(self, out: &mut Vec<u8>) {
                out.extend(self.to_le_bytes());
            }
        }
    };
}
component!(i8, 5120);
component!(u8, 5121);
component!(i16, 5122);
component!(u16, 5123);
component!(u32, 5125);
component!(f32, 5126);

impl Maker {
    fn new() -> Self {
        let document = json!({
            "asset": {"version": "2.0"}, "buffers": [], "bufferViews": [], "accessors": [],
            "meshes": [], "nodes": [], "scenes": [{"nodes": []}],
        });
        Self { document, bytes: Vec::new() }
    }

    /// Appends to a list of the document and returns the index.
    fn push(&mut self, list: &str, value: Value) -> usize {
        let members = self.document.as_object_mut().unwrap();
        let list = members.entry(list).or_insert_with(|| json!([])).as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    /// A view of new data, aligned to four bytes.
    fn view<T: Component>(&mut self, values: &[T]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let start = self.bytes.len();
        values.iter().for_each(|value| value.append(&mut self.bytes));
        let length = self.bytes.len() - start;
        let view = json!({"buffer": 0, "byteOffset": start, "byteLength": length});
        self.push("bufferViews", view)
    }

    /// An accessor of new data, of a type such as `VEC3`.
    fn accessor<T: Component>(&mut self, kind: &str, values: &[T]) -> usize {
        let view = self.view(values);
        let per_element = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "MAT4" => 16,
            _ => 4,
        };
        let count = values.len() / per_element;
        let accessor =
            json!({"bufferView": view, "componentType": T::CODE, "count": count, "type": kind});
        self.push("accessors", accessor)
    }

    /// As [`Self::accessor`], normalised.
    fn normalized<T: Component>(&mut self, kind: &str, values: &[T]) -> usize {
        let index = self.accessor(kind, values);
        self.document["accessors"][index]["normalized"] = json!(true);
        index
    }

    /// A mesh with one primitive.
    fn mesh(&mut self, primitive: &Value) -> usize {
        self.push("meshes", json!({"primitives": [primitive]}))
    }

    /// A node, a root of the scene.
    fn root(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        self.document["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(index));
        index
    }

    /// A triangle under a node of its own: the least that imports.
    fn triangle() -> Self {
        let mut maker = Self::new();
        let positions = maker.accessor("VEC3", &TRIANGLE);
        let mesh = maker.mesh(&json!({"attributes": {"POSITION": positions}}));
        maker.root(json!({"mesh": mesh}));
        maker
    }

    /// The text, its buffer in a file `data.bin`.
    fn sources(&self) -> Vec<Source> {
        let mut document = self.document.clone();
        if document["buffers"] == json!([]) {
            document["buffers"] = json!([{"uri": "data.bin", "byteLength": self.bytes.len()}]);
        }
        let text = Source { name: "a.gltf".into(), bytes: document.to_string().into_bytes() };
        vec![text, Source { name: "data.bin".into(), bytes: self.bytes.clone() }]
    }

    /// The same document as a GLB.
    fn glb(&self) -> Vec<u8> {
        let mut document = self.document.clone();
        document["buffers"] = json!([{"byteLength": self.bytes.len()}]);
        glb(&[(b"JSON", document.to_string().as_bytes()), (b"BIN\0", &self.bytes)])
    }

    fn import(&self) -> Result<Scene, Error> {
        import_sources(self.sources(), &Limits::default())
    }

    fn scene(&self) -> Scene {
        self.import().unwrap()
    }

    /// The refusal's text.
    fn refusal(&self) -> String {
        self.import().unwrap_err().to_string()
    }
}

/// Counter-clockwise seen from +Z.
const TRIANGLE: [f32; 9] = [0., 0., 0., 1., 0., 0., 0., 1., 0.];

/// A GLB of any chunks, padded to four bytes.
fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut out = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, data) in chunks {
        let padded = data.len().next_multiple_of(4);
        out.extend((padded as u32).to_le_bytes());
        out.extend(*kind);
        out.extend(*data);
        let fill = if *kind == b"JSON" { b' ' } else { 0 };
        out.resize(out.len() + padded - data.len(), fill);
    }
    let length = out.len() as u32;
    out[8..12].copy_from_slice(&length.to_le_bytes());
    out
}

/// Imports one file from memory.
fn import_bytes(name: &str, bytes: &[u8]) -> Result<Scene, Error> {
    let source = Source { name: name.into(), bytes: bytes.to_vec() };
    import_sources(vec![source], &Limits::default())
}

/// Asserts that some notice contains the text.
fn assert_notice(scene: &Scene, text: &str) {
    assert!(scene.notices.iter().any(|notice| notice.contains(text)), "{:?}", scene.notices);
}

/// The smallest file: positions, the default node, a flat normal, one influence each, and the
/// size of the bounding box's diagonal.
#[test]
fn a_triangle_is_a_scene() {
    let scene = Maker::triangle().scene();
    let mesh = &scene.mesh;
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert!(mesh.normals.iter().all(|normal| *normal == glam::Vec3::Z));
    assert_notice(&scene, "normals are missing");
    assert_eq!(mesh.influence_starts, [0, 1, 2, 3]);
    assert_eq!(mesh.parts[0].vertices, 0..3);
    assert!(scene.clips.is_empty());
    assert_eq!(scene.sources.len(), 2);
    assert!((size_m(mesh, &scene.skeleton) - 2.0_f32.sqrt()).abs() < 1e-6);
}

/// The same document as .gltf with a file, as .gltf with a data: URI and as GLB, on disk or in
/// memory, gives the same scene but for its sources.
#[test]
fn every_way_in_gives_the_same_scene() {
    let maker = Maker::triangle();
    let folder = tempfile::tempdir().unwrap();
    for source in maker.sources() {
        std::fs::write(folder.path().join(source.name), source.bytes).unwrap();
    }
    std::fs::write(folder.path().join("a.glb"), maker.glb()).unwrap();
    let limits = Limits::default();
    let expected = maker.scene();
    let from_file = import(&folder.path().join("a.gltf"), &limits).unwrap();
    assert_eq!(from_file, expected);
    let from_glb = import(&folder.path().join("a.glb"), &limits).unwrap();
    assert_eq!(from_glb.sources.len(), 1);
    let mut embedded = maker;
    let text: String = embedded.bytes.iter().map(|byte| format!("%{byte:02x}")).collect();
    let uri = format!("data:application/octet-stream,{text}");
    embedded.document["buffers"] = json!([{"uri": uri, "byteLength": 36}]);
    for scene in [from_glb, embedded.scene()] {
        assert_eq!(
            (scene.mesh, scene.skeleton),
            (expected.mesh.clone(), expected.skeleton.clone())
        );
    }
}

/// Sources survive a round trip: a scene can be imported again from what it kept.
#[test]
fn kept_sources_import_again() {
    let scene = Maker::triangle().scene();
    let again = import_sources(scene.sources.clone(), &Limits::default()).unwrap();
    assert_eq!(again, scene);
}
