//! Rank 3. The fitted model: encoder, linear decoder, evaluation, light folding, blob.
//!
//! Every model is y(x)\[v, c\] = Σ_k D\[v, c, k\] φ_k(x): few features φ of the pose, and a large
//! linear decoder D. [`Decoder`] is D as a fit hands it over, [`Model`] the checked
//! whole in the layout that evaluates fastest, the blob its form on disk (`proto/model.md`).
//!
//! *Invariant:* nothing here knows how a model was fitted.
//! *Invariant:* a blob may come from anybody; every field is checked before it is used.

mod blob;
mod clustered;
mod decoder;
mod distance;
mod error;
mod evaluate;
mod fitted;
mod fold;
mod frame;
mod header;
pub mod limits;
mod mesh_header;
mod multilinear;
pub mod occluder;
mod pose;
mod posed;
mod rebound;
mod rest;
mod rig;
mod rig_header;
#[cfg(test)]
mod synthetic;

pub use blob::Sizes;
pub use clustered::{Cluster, Clustered, Form};
pub use decoder::{Decoder, Shape};
pub use distance::Distance;
pub use error::Error;
pub use fitted::Model;
pub use fold::Folded;
pub use header::{
    FORMAT_VERSION, Family, Frame, Header, Precision, Provenance, Signal, TrainingSummary,
};
pub use mesh_header::{MeshIdentity, PartRange};
pub use multilinear::Multilinear;
pub use occluder::{OccluderSizes, Occluders, Surface};
pub use pose::{JointPose, JointTransform};
pub use posed::{PosedInput, PosedPoints, unshadowed};
pub use rest::RestSizes;
pub use rig_header::{
    ColumnHeader, NodeHeader, RigHeader, RootMotionHeader, SourceHeader, WeightHeader,
};

#[cfg(test)]
mod tests;
