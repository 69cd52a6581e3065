//! What can go wrong between positions and a committed scene.

use glam::Vec3;

/// Why a device or scene could not be made. Queries on a committed scene cannot fail.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The library would not start.
    #[error(
        "Embree could not start ({code}{}); it needs an x86-64 CPU with SSE4.2 or AVX, or an ARM64 one, \
         and libembree4 of version 4.0 or newer",
        detail(.message)
    )]
    Device {
        /// Embree's `RTCError`.
        code: Code,
        /// Embree's words, or nothing.
        message: String,
    },
    /// The acceleration structure could not be built.
    #[error("Embree could not build a scene of {triangles} triangles: {code}{}", detail(.message))]
    Build {
        /// How many were given.
        triangles: usize,
        /// Embree's `RTCError`.
        code: Code,
        /// Embree's words, or nothing.
        message: String,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {vertices} vertices")]
    Vertex {
        /// Index of the triangle.
        triangle: usize,
        /// What it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// Embree would silently leave out every triangle of this vertex.
    #[error(
        "vertex {vertex} is at {position}, which cannot be traced: coordinates must be finite and \
         below {limit:e} m",
        limit = super::POSITION_LIMIT_M
    )]
    Position {
        /// Index of the vertex.
        vertex: usize,
        /// Where it is.
        position: Vec3,
    },
    /// A filter names a triangle that does not exist.
    #[error("the filter names triangle {triangle}, but there are {triangles} triangles")]
    Filter {
        /// What it names.
        triangle: u32,
        /// How many there are.
        triangles: usize,
    },
    /// More than Embree's 32-bit indices can count.
    #[error("{count} {what} are more than Embree can count ({limit})", limit = u32::MAX)]
    TooMany {
        /// `vertices` or `triangles`.
        what: &'static str,
        /// How many.
        count: usize,
    },
}

/// An `RTCError` as the number that the library gave: versions newer than our headers have more of
/// them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Code(pub u32);

impl std::fmt::Display for Code {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = match self.0 {
            0 => "no error code",
            1 => "unknown error",
            2 => "invalid argument",
            3 => "invalid operation",
            4 => "out of memory",
            5 => "unsupported CPU",
            6 => "cancelled",
            other => return write!(f, "error {other}"),
        };
        f.write_str(name)
    }
}

fn detail(message: &str) -> String {
    if message.is_empty() { String::new() } else { format!(": {message}") }
}
