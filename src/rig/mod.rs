//! Rank 2. The rigged character in memory: skeleton, mesh, pose, and the arithmetic that moves
//! one by the other.
//!
//! *Invariant:* nothing here reads files or knows of glTF; an engine can build every type by hand.

mod frame;
mod mesh;
mod pose;
mod skeleton;

pub use frame::RigidFrame;
pub use mesh::{Deformer, Influence, Mesh, MorphTarget, Part};
pub use pose::Pose;
pub use skeleton::{Node, Skeleton, Transform};
