//! What can go wrong with a model, with the evidence.

use super::{Precision, Signal};

/// Why a model cannot be made, written, read or evaluated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The bytes are not a safetensors file.
    #[error("not a model: the bytes are no safetensors file ({reason})")]
    NotSafetensors {
        /// What its reader says.
        reason: String,
    },
    /// It is a safetensors file, but not one of ours.
    #[error("not a model: the safetensors file has no metadata key `poselight`")]
    NotPoselight,
    /// Something claims to be larger than any model that this version reads.
    #[error("{what} is {found}, more than the limit of {limit}")]
    Limit {
        /// What is too large, such as `header bytes`.
        what: &'static str,
        /// The size found.
        found: u64,
        /// The size allowed.
        limit: u64,
    },
    /// The JSON header cannot be understood.
    #[error("the model's header is not valid: {reason}")]
    Header {
        /// Place and fault.
        reason: String,
    },
    /// Written by a later version.
    #[error("the model has format version {found}; this build reads version {supported}")]
    Version {
        /// In the header.
        found: u32,
        /// The newest one that this build reads.
        supported: u32,
    },
    /// A field contradicts another one or its range.
    #[error("the model's header field `{field}` is wrong: {problem}")]
    Field {
        /// Such as `rig.bones[3]`.
        field: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A tensor that the family needs is missing.
    #[error("the model has no tensor `{name}`, which its family needs")]
    MissingTensor {
        /// Its name.
        name: String,
    },
    /// A tensor that the family does not have.
    #[error("the model has a tensor `{name}` that its header does not call for")]
    UnexpectedTensor {
        /// Its name.
        name: String,
    },
    /// A tensor has another type or shape than the header calls for.
    #[error("tensor `{name}` is {found}, but the header calls for {expected}")]
    TensorShape {
        /// Its name.
        name: String,
        /// Type and shape.
        expected: String,
        /// Type and shape.
        found: String,
    },
    /// An array handed over by a caller has the wrong length.
    #[error("{what} has {found} numbers, expected {expected}")]
    Length {
        /// Which one.
        what: String,
        /// Its length.
        found: usize,
        /// The length that the shapes call for.
        expected: usize,
    },
    /// NaN or infinite.
    #[error("{what} is not finite at index {index}")]
    NotFinite {
        /// Such as a tensor's name, or `parameters`.
        what: String,
        /// Flat index of the first such number.
        index: usize,
    },
    /// The model looks at the posed mesh, which was not given.
    #[error("{what} needs the posed mesh: give positions and normals of the points in the pose")]
    NeedsSurface {
        /// Such as `this model`.
        what: &'static str,
    },
    /// An index points outside what it indexes.
    #[error("{what} is {found}, but there are only {count}")]
    OutOfRange {
        /// Such as `point of vertex 7`.
        what: String,
        /// The index.
        found: u64,
        /// How many there are.
        count: u64,
    },
    /// A number does not fit the chosen precision.
    #[error(
        "tensor `{tensor}` holds {value:e} at index {index}, which {precision} cannot hold; \
         write the model as f32"
    )]
    NotRepresentable {
        /// Name of the tensor.
        tensor: String,
        /// Flat index of the number.
        index: usize,
        /// The number.
        value: f32,
        /// What was asked for.
        precision: Precision,
    },
    /// A pose names joints or morph weights that the model does not know.
    #[error("the model's rig has no {what} named {}", quoted(.names))]
    UnknownNames {
        /// `joints` or `morph weights`.
        what: &'static str,
        /// All of them, in order.
        names: Vec<String>,
    },
    /// A rotation that is no rotation.
    #[error("the rotation of joint `{joint}` is zero or not finite")]
    NoRotation {
        /// Its name.
        joint: String,
    },
    /// This signal has no meaning folded with a light.
    #[error(
        "a model of `{signal}` cannot be folded with a light: visibility has no cosine; \
         evaluate it, or fit a model of `transfer` or `ao`"
    )]
    CannotFold {
        /// The model's.
        signal: Signal,
    },
}

/// At most eight names, quoted; enough to act on, bounded for a log.
fn quoted(names: &[String]) -> String {
    let shown: Vec<String> = names.iter().take(8).map(|name| format!("`{name}`")).collect();
    match names.len() - shown.len() {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}
