//! Which Zarr arrays a data set has, and the metadata that each must carry.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::{Error, Layout, files, json};

/// Element types of the format, all little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DataType {
    F32,
    I32,
    U32,
    U8,
}

impl DataType {
    fn name(self) -> &'static str {
        match self {
            Self::F32 => "float32",
            Self::I32 => "int32",
            Self::U32 => "uint32",
            Self::U8 => "uint8",
        }
    }

    pub(super) fn bytes(self) -> u64 {
        if self == Self::U8 { 1 } else { 4 }
    }

    /// Little-endian bytes of the fill value: NaN for floats, else zero.
    pub(super) fn fill(self) -> [u8; 4] {
        if self == Self::F32 { f32::NAN.to_le_bytes() } else { [0; 4] }
    }
}

/// One array: its place, shape and chunks.
#[derive(Debug, Clone)]
pub(super) struct Array {
    /// Path within the data set, such as `coefficients` or `source/file0`.
    pub(super) name: String,
    pub(super) data_type: DataType,
    /// Name and size of each dimension.
    pub(super) dimensions: Vec<(&'static str, usize)>,
    /// Length of a chunk along each dimension, at least 1.
    pub(super) chunk: Vec<usize>,
    pub(super) attributes: Map<String, Value>,
}

impl Array {
    /// An array that is one single chunk.
    pub(super) fn whole(
        name: impl Into<String>,
        data_type: DataType,
        dimensions: &[(&'static str, usize)],
    ) -> Self {
        Self {
            name: name.into(),
            data_type,
            dimensions: dimensions.to_vec(),
            // Zarr allows no chunk of length zero, even where the array has none.
            chunk: dimensions.iter().map(|&(_, size)| size.max(1)).collect(),
            attributes: Map::new(),
        }
    }

    /// The same array in chunks of the given lengths along its first dimensions.
    pub(super) fn chunked(mut self, lengths: &[usize]) -> Self {
        self.chunk[..lengths.len()].copy_from_slice(lengths);
        self
    }

    pub(super) fn folder(&self, root: &Path) -> PathBuf {
        root.join(&self.name)
    }

    /// Number of values in a chunk, padding included.
    pub(super) fn chunk_values(&self) -> u64 {
        self.chunk.iter().map(|&length| length as u64).product()
    }

    pub(super) fn chunk_bytes(&self) -> u64 {
        self.chunk_values() * self.data_type.bytes()
    }

    /// Number of chunk files; none where the array is empty.
    pub(super) fn chunks(&self) -> u64 {
        let along = self.dimensions.iter().zip(&self.chunk);
        along.map(|(&(_, size), &length)| size.div_ceil(length) as u64).product()
    }

    /// File name of the chunk whose index along the first dimensions is `index`, 0 along the rest:
    /// `c.3.0.0.0`.
    pub(super) fn chunk_name(&self, index: &[usize]) -> String {
        let mut name = String::from("c");
        for axis in 0..self.dimensions.len() {
            name.push('.');
            name.push_str(&index.get(axis).copied().unwrap_or(0).to_string());
        }
        name
    }

    /// Where the chunk of that index lies.
    pub(super) fn chunk_path(&self, root: &Path, index: &[usize]) -> PathBuf {
        self.folder(root).join(self.chunk_name(index))
    }

    /// The `zarr.json` of this array.
    fn metadata(&self) -> Value {
        let sizes: Vec<usize> = self.dimensions.iter().map(|&(_, size)| size).collect();
        let names: Vec<&str> = self.dimensions.iter().map(|&(name, _)| name).collect();
        let fill = if self.data_type == DataType::F32 {
            serde_json::json!("NaN")
        } else {
            serde_json::json!(0)
        };
        // A single byte has no order of bytes, and zarr-python writes none either.
        let bytes = if self.data_type == DataType::U8 {
            serde_json::json!({"name": "bytes"})
        } else {
            serde_json::json!({"name": "bytes", "configuration": {"endian": "little"}})
        };
        serde_json::json!({
            "zarr_format": 3,
            "node_type": "array",
            "shape": sizes,
            "data_type": self.data_type.name(),
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": self.chunk}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
            "fill_value": fill,
            "codecs": [bytes],
            "attributes": self.attributes,
            "dimension_names": names,
        })
    }

    /// Makes the folder and writes its `zarr.json`; chunks come later.
    pub(super) fn create(&self, root: &Path) -> Result<(), Error> {
        let folder = self.folder(root);
        files::create_folder(&folder)?;
        json::write(&folder, &self.metadata(), json::ARRAY_BYTES)
    }

    /// Whether the `zarr.json` on disk says what the layout demands, field by field. A user may
    /// have added attributes.
    pub(super) fn check(&self, root: &Path) -> Result<(), Error> {
        let path = self.folder(root).join("zarr.json");
        let found = json::object(&path, json::ARRAY_BYTES)?;
        let Value::Object(expected) = self.metadata() else { unreachable!("metadata is a map") };
        for (field, expected) in expected.iter().filter(|(field, _)| *field != "attributes") {
            json::expect(&path, &found, field, expected)?;
        }
        if self.attributes.is_empty() {
            return Ok(());
        }
        let attributes: Map<String, Value> = json::field(&path, &found, "attributes", "an object")?;
        for (field, expected) in &self.attributes {
            json::expect(&path, &attributes, field, expected)?;
        }
        Ok(())
    }
}

/// `coefficients`, `noise`, `rays`: in chunks of a block of poses each.
pub(super) fn blocks(layout: &Layout) -> [Array; 3] {
    let pose = ("pose", layout.poses);
    let point = ("point", layout.points);
    let last = [("channel", layout.channels), ("coefficient", layout.coefficients)];
    let block = [layout.block_poses];
    [
        Array::whole("coefficients", DataType::F32, &[pose, point, last[0], last[1]])
            .chunked(&block),
        Array::whole("noise", DataType::F32, &[pose, point]).chunked(&block),
        Array::whole("rays", DataType::U32, &[pose, point]).chunked(&block),
    ]
}

/// Every array that is written whole before the first block, in the order of
/// [`super::tables::Tables`].
pub(super) fn tables(layout: &Layout) -> [Array; 13] {
    let pose = ("pose", layout.poses);
    let point = ("point", layout.points);
    let vertex = ("vertex", layout.vertices);
    let xyz = ("xyz", 3);
    let quaternion = ("xyzw", 4);
    [
        Array::whole("parameters", DataType::F32, &[pose, ("parameter", layout.parameters)]),
        Array::whole("clip", DataType::I32, &[pose]),
        Array::whole("time_s", DataType::F32, &[pose]),
        Array::whole("split", DataType::U8, &[pose]),
        Array::whole("root_rotation", DataType::F32, &[pose, quaternion]),
        Array::whole("root_translation", DataType::F32, &[pose, xyz]),
        Array::whole("bone_rotation", DataType::F32, &[pose, ("bone", layout.bones), quaternion]),
        Array::whole("bone_of_point", DataType::I32, &[point]),
        Array::whole("vertex_of_point", DataType::I32, &[point]),
        Array::whole("point_of_vertex", DataType::I32, &[vertex]),
        Array::whole("position", DataType::F32, &[vertex, xyz]),
        Array::whole("normal", DataType::F32, &[vertex, xyz]),
        Array::whole(
            "vertices_of_triangle",
            DataType::I32,
            &[("triangle", layout.triangles), ("corner", 3)],
        ),
    ]
}

/// The bytes of source file `index`.
pub(super) fn source(index: usize, name: &str, bytes: usize) -> Array {
    let mut array = Array::whole(format!("source/file{index}"), DataType::U8, &[("byte", bytes)]);
    array.attributes.insert(String::from("name"), Value::from(name));
    array
}
