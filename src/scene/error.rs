//! Why a file is refused.

use std::path::PathBuf;

/// One reason, with the place in the file and the fault.
///
/// Places in glTF are written as in the JSON, such as `meshes[0].primitives[1].indices`.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// Which file.
        path: PathBuf,
        /// What the operating system says.
        source: std::io::Error,
    },
    /// Something else than a file, such as a folder or a pipe.
    #[error("{path} is not a regular file; name a .glb, .gltf, .obj or .npz file")]
    NotAFile {
        /// What was named.
        path: PathBuf,
    },
    /// Neither content nor extension tells the format.
    #[error("{file} is neither glTF (.glb, .gltf) nor OBJ (.obj) nor a vertex sequence (.npz)")]
    UnknownFormat {
        /// The main file's name.
        file: String,
    },
    /// The file asks for more than [`super::Limits`] allows.
    #[error("{place} asks for {found} {what}; the limit `{limit}` is {most}")]
    Limit {
        /// Where.
        place: String,
        /// The unit of the numbers.
        what: &'static str,
        /// Field of [`super::Limits`].
        limit: &'static str,
        /// How many the file has come to.
        found: u64,
        /// How many are allowed.
        most: u64,
    },
    /// A feature that this importer does not have.
    #[error("{place} needs {feature}, which is not supported{hint}")]
    Unsupported {
        /// The feature by name, such as an extension.
        feature: String,
        /// Where the file asks for it.
        place: String,
        /// What to do about it: empty, or starting with `; `.
        hint: &'static str,
    },
    /// The GLB container is damaged.
    #[error("GLB container, byte {offset}: {fault}")]
    Glb {
        /// From the start of the file.
        offset: usize,
        /// What is wrong there.
        fault: String,
    },
    /// The JSON text is no glTF document.
    #[error("glTF JSON: {fault}")]
    Json {
        /// What is wrong, with line and column.
        fault: String,
    },
    /// An index that names nothing.
    #[error("{place} names {list}[{index}], but the file has {count} {list}")]
    Reference {
        /// Where the index stands.
        place: String,
        /// What it counts, such as `accessors`.
        list: &'static str,
        /// The index.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// NaN or an infinity.
    #[error("{place}, element {element}, is not finite")]
    NotFinite {
        /// Accessor and use.
        place: String,
        /// The first such element of the accessor.
        element: usize,
    },
    /// Any other fault of a glTF document.
    #[error("{place}: {fault}")]
    Invalid {
        /// Where.
        place: String,
        /// Expected and found.
        fault: String,
    },
    /// A line of an OBJ file that cannot be read.
    #[error("OBJ line {line}: {fault}")]
    Obj {
        /// From 1.
        line: usize,
        /// Expected and found.
        fault: String,
    },
    /// There is nothing to light.
    #[error("a scene without triangles is not supported: {place} has no surface to light")]
    NoTriangles {
        /// Which scene of the file.
        place: String,
    },
    /// All of the scene lies in one point, or too far away for single precision.
    #[error(
        "the rest pose is {size_m} m across; a size between 1e-9 and 1e9 m is needed. Is the unit \
         or a node's scale wrong?"
    )]
    Extent {
        /// Diagonal of the bounding box.
        size_m: f32,
    },
}

impl Error {
    pub(super) fn invalid(place: impl Into<String>, fault: impl Into<String>) -> Self {
        Self::Invalid { place: place.into(), fault: fault.into() }
    }
}
