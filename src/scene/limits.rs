//! How much a file may ask for.

/// Upper bounds of an import; a file beyond one of them is refused with the limit's name.
///
/// The defaults let through any character and most levels, and keep an import under a few
/// gigabytes of memory, whatever a file claims.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of each file and of each decoded `data:` URI. Default 512 MiB.
    pub file_bytes: u64,
    /// Bytes decoded from accessors or OBJ lines in total, each use of shared data counted anew.
    /// Bounds memory and time. Default 2 GiB.
    pub decoded_bytes: u64,
    /// Values in the JSON text (array elements and object members). Default 2,000,000.
    pub json_values: u64,
    /// External files beside the main one. Default 256.
    pub files: u64,
    /// Nodes of the file. Default 65,536.
    pub nodes: u64,
    /// Primitives, each counted once for every node that shows it. Default 65,536.
    pub parts: u64,
    /// Joints of all skins together. Default 65,536.
    pub joints: u64,
    /// Vertices of all parts. Default 4,000,000.
    pub vertices: u64,
    /// Triangles of all parts. Default 8,000,000.
    pub triangles: u64,
    /// Morph targets of all parts. Default 16,384.
    pub morph_targets: u64,
    /// Animation channels of all clips. Default 262,144.
    pub channels: u64,
    /// Key times of all channels. Default 16,000,000.
    pub keys: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            file_bytes: 512 << 20,
            decoded_bytes: 2 << 30,
            json_values: 2_000_000,
            files: 256,
            nodes: 65_536,
            parts: 65_536,
            joints: 65_536,
            vertices: 4_000_000,
            triangles: 8_000_000,
            morph_targets: 16_384,
            channels: 262_144,
            keys: 16_000_000,
        }
    }
}
