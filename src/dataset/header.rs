//! The root's `zarr.json`: what a data set says of itself.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::{Error, Layout, json as fields};
use crate::rig::{Mesh, Skeleton};

/// The version that this build writes, and the only one that it reads.
pub const FORMAT_VERSION: u64 = 1;

/// Distinguishes a data set from any other Zarr group.
const FORMAT: &str = "poselight-dataset";

/// Names of the values of array `split`, by value.
pub const SPLIT_NAMES: [&str; 4] = ["training", "novel", "interpolated", "within-clip"];

/// Sizes and descriptions of a data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Sizes of all arrays.
    pub layout: Layout,
    /// Everything else.
    pub attributes: Attributes,
}

/// What a data set holds, and how it was made.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Attributes {
    /// The resolved recipe. The hashes, not this text, decide whether a bake may continue: parts
    /// that no byte of a bake depends on may differ.
    pub recipe: Value,
    /// Hash by stage: `scene` and `bake`, hexadecimal. `bake` must be there.
    pub hashes: BTreeMap<String, String>,
    /// `ao`, `visibility` or `transfer`.
    pub signal: String,
    /// Number of spherical-harmonic bands, 1 to 10; `coefficients` is its square, or 1 for `ao`.
    pub order: u8,
    /// Names by the index that array `clip` holds.
    pub clip_names: Vec<String>,
    /// One per pose parameter.
    pub parameter_names: Vec<String>,
    /// What turns a tool's joint rotations into parameters and bone rotations.
    pub rig: Value,
    /// Which node and primitive each range of vertices came from.
    pub parts: Vec<PartRange>,
    /// One entry for each extension of the data set after its first bake, oldest first.
    pub lineage: Vec<Value>,
}

/// A range of vertices and triangles that came from one primitive of one node.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartRange {
    /// Name of the carrying node.
    pub node: String,
    /// Name of the mesh.
    pub mesh: String,
    /// Index of the primitive within the mesh.
    pub primitive: usize,
    /// Index of the first vertex.
    pub first_vertex: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// Index of the first triangle.
    pub first_triangle: usize,
    /// Number of triangles.
    pub triangles: usize,
}

impl PartRange {
    /// The ranges of a mesh, in its order.
    ///
    /// # Panics
    /// If a part names a node that the skeleton has not.
    #[must_use]
    pub fn of(mesh: &Mesh, skeleton: &Skeleton) -> Vec<Self> {
        let parts = mesh.parts.iter().map(|part| Self {
            node: skeleton.nodes[part.node].name.clone(),
            mesh: part.name.clone(),
            primitive: part.primitive,
            first_vertex: part.vertices.start,
            vertices: part.vertices.len(),
            first_triangle: part.triangles.start,
            triangles: part.triangles.len(),
        });
        parts.collect()
    }
}

/// How every number of the format is to be read; the same in all data sets of this version.
fn conventions() -> Value {
    json!({
        "axes": "right-handed, +Y up, as glTF",
        "units": "metres, radians, seconds",
        "spherical_harmonics": "real, orthonormal, no Condon-Shortley sign: y_1 = 0.488603 (y, z, x); flat index l(l+1)+m",
        "ao": "(1/pi) integral of V max(n.w, 0) dw",
        "visibility": "integral of V y_i dw, V = 0 only above the horizon where a ray is blocked",
        "transfer": "(1/pi) integral of V max(n.w, 0) y_i dw",
        "polarity": "V = 1 where the ray escapes",
        "frame": "root: the scene rotated and moved by the inverse of root_rotation, root_translation",
        "quaternion": "x, y, z, w",
        "bone_rotation": "relative to rest, in the root frame",
        "parameters": "not centred; lengths divided by the model's size",
        "noise": "root mean square over the coefficients of the standard error",
        "points": "vertices that agree in position, normal, weights and morph deltas are one point",
        "clip": "index into clip_names, -1 for none",
    })
}

impl Header {
    /// The root's `zarr.json`.
    pub(super) fn to_json(&self) -> Value {
        let layout: Map<String, Value> = self
            .layout
            .sizes()
            .into_iter()
            .map(|(name, size)| (name.to_owned(), json!(size)))
            .collect();
        let a = &self.attributes;
        json!({
            "zarr_format": 3,
            "node_type": "group",
            "attributes": {
                "format": FORMAT,
                "format_version": FORMAT_VERSION,
                "layout": layout,
                "signal": a.signal,
                "order": a.order,
                "recipe": a.recipe,
                "hashes": a.hashes,
                "clip_names": a.clip_names,
                "split_names": SPLIT_NAMES,
                "parameter_names": a.parameter_names,
                "rig": a.rig,
                "parts": a.parts,
                "conventions": conventions(),
                "lineage": a.lineage,
            },
        })
    }

    /// Reads and checks the root's `zarr.json` at `path`.
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        let root = fields::object(path, fields::GROUP_BYTES)?;
        fields::expect(path, &root, "zarr_format", &json!(3))?;
        fields::expect(path, &root, "node_type", &json!("group"))?;
        let map: Map<String, Value> = fields::field(path, &root, "attributes", "an object")?;
        fields::expect(path, &map, "format", &json!(FORMAT))?;
        let found: u64 = fields::field(path, &map, "format_version", "an integer")?;
        if found != FORMAT_VERSION {
            let path = path.to_path_buf();
            return Err(Error::Version { path, found, supported: FORMAT_VERSION });
        }
        fields::expect(path, &map, "conventions", &conventions())?;
        fields::expect(path, &map, "split_names", &json!(SPLIT_NAMES))?;
        let sizes: Map<String, Value> = fields::field(path, &map, "layout", "an object of sizes")?;
        let layout = Layout::from_sizes(|name| fields::field(path, &sizes, name, "a size"))?;
        let names = "a list of names";
        let attributes = Attributes {
            recipe: fields::field(path, &map, "recipe", "an object")?,
            hashes: fields::field(path, &map, "hashes", "an object of texts")?,
            signal: fields::field(path, &map, "signal", "a name")?,
            order: fields::field(path, &map, "order", "1 to 10")?,
            clip_names: fields::field(path, &map, "clip_names", names)?,
            parameter_names: fields::field(path, &map, "parameter_names", names)?,
            rig: fields::field(path, &map, "rig", "an object")?,
            parts: fields::field(path, &map, "parts", "a list of ranges")?,
            lineage: fields::field(path, &map, "lineage", "a list")?,
        };
        let header = Self { layout, attributes };
        header.check(path)?;
        Ok(header)
    }

    /// Whether the parts of the header agree with one another; `path` is for messages.
    pub(super) fn check(&self, path: &Path) -> Result<(), Error> {
        let (layout, attributes) = (&self.layout, &self.attributes);
        layout.check()?;
        let refuse = |field: &str, expected: String, found: Value| {
            Err(fields::mismatch(path, field, &expected, Some(&found)))
        };
        if !(1..=10).contains(&attributes.order) {
            return refuse("order", String::from("1 to 10"), json!(attributes.order));
        }
        let coefficients = match attributes.signal.as_str() {
            "ao" => 1,
            "visibility" | "transfer" => usize::from(attributes.order).pow(2),
            other => {
                return refuse("signal", String::from("ao, visibility or transfer"), json!(other));
            }
        };
        if layout.coefficients != coefficients {
            let expected = format!("{coefficients} (signal and order)");
            return refuse("layout.coefficients", expected, json!(layout.coefficients));
        }
        if attributes.parameter_names.len() != layout.parameters {
            let expected = format!("{} names", layout.parameters);
            return refuse("parameter_names", expected, json!(attributes.parameter_names));
        }
        if !attributes.hashes.contains_key("bake") {
            return refuse("hashes", String::from("one named `bake`"), json!(attributes.hashes));
        }
        self.check_parts(path)
    }

    /// Parts follow one another without a gap and cover the mesh.
    fn check_parts(&self, path: &Path) -> Result<(), Error> {
        let (mut vertices, mut triangles) = (0usize, 0usize);
        for part in &self.attributes.parts {
            let follows = part.first_vertex == vertices && part.first_triangle == triangles;
            let ends =
                vertices.checked_add(part.vertices).zip(triangles.checked_add(part.triangles));
            let Some((next_vertex, next_triangle)) = ends.filter(|_| follows) else {
                let expected =
                    format!("ranges without a gap (from vertex {vertices}, triangle {triangles})");
                return Err(fields::mismatch(path, "parts", &expected, Some(&json!(part))));
            };
            (vertices, triangles) = (next_vertex, next_triangle);
        }
        let whole = (self.layout.vertices, self.layout.triangles);
        if (vertices, triangles) != whole {
            let expected =
                format!("ranges that cover {} vertices and {} triangles", whole.0, whole.1);
            let found = json!([vertices, triangles]);
            return Err(fields::mismatch(path, "parts", &expected, Some(&found)));
        }
        Ok(())
    }

    /// Refuses to continue `found`, the header in folder `path`, with this one, unless both are
    /// of the same bake. Block size and recipe text may differ.
    pub(super) fn agree(&self, path: &Path, found: &Self) -> Result<(), Error> {
        // The scene goes into the bake hash too; where it differs it is the better explanation.
        for stage in ["scene", "bake"] {
            let hash = |header: &Self| header.attributes.hashes.get(stage).cloned();
            let (expected, found) = (hash(self), hash(found));
            if expected != found {
                let text = |hash: Option<String>| hash.unwrap_or_else(|| String::from("none"));
                return Err(Error::OtherRecipe {
                    path: path.to_path_buf(),
                    stage: stage.to_owned(),
                    expected: text(expected),
                    found: text(found),
                });
            }
        }
        let comparable = |header: &Self| {
            let mut copy = header.clone();
            copy.layout.block_poses = 1;
            copy.attributes.recipe = Value::Null;
            copy.attributes.hashes.clear();
            copy.to_json()["attributes"].take()
        };
        let (expected, found) = (comparable(self), comparable(found));
        let Value::Object(expected) = expected else { unreachable!("attributes are a map") };
        for (field, value) in expected {
            if found.get(&field) != Some(&value) {
                let what = format!("attribute `{field}`");
                return Err(Error::OtherContent { path: path.to_path_buf(), what });
            }
        }
        Ok(())
    }
}
