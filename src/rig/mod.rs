//! Rank 2. The rigged character in memory: skeleton, mesh, pose, and the arithmetic that moves
//! one by the other.
//!
//! A frame goes [`Pose`] → [`Skeleton::globals`] → [`root_frame`] → [`deform`]; what a model needs
//! of it is [`Parametrisation::encode`] and [`bone_rotations`].
//!
//! *Invariant:* nothing here reads files or knows of glTF; an engine can build every type by hand.
//! *Invariant:* no function returns a number that is not finite for a finite pose.

mod angles;
mod blend;
mod bones;
mod carry;
mod deform;
mod dihedral;
mod facets;
mod frame;
mod handles;
mod mesh;
mod parametrisation;
mod points;
mod pose;
mod rotation;
mod skeleton;
mod split;
mod subset;
mod tangents;
mod turns;
mod upright;

pub use blend::Mix;
pub use bones::{Bones, bone_rotations, carried_weight, root_frame, root_node};
pub use deform::{Deformed, deform};
pub use dihedral::Hinges;
pub use facets::Facets;
pub use frame::{RigidFrame, in_root};
pub use mesh::{Deformer, Influence, Mesh, MorphTarget, Part};
pub use parametrisation::{Column, LEAST_DEVIATION, Parametrisation, ParametrisationKind, Source};
pub use points::Points;
pub use pose::Pose;
pub use rotation::{mean_rotation, nearest_rotation, rotation_vector};
pub use skeleton::{Node, Skeleton, Transform};
pub use tangents::{
    TangentFigures, Tangents, coherence, smoothness, tangents_at_rest, tangents_from_bytes,
    tangents_to_bytes, to_tangent_frame,
};
pub use turns::turns;
pub use upright::RootMotion;
