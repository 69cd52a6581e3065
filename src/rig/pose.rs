//! One pose: what a tool or an engine has at hand for a frame.

use super::{Skeleton, Transform};

/// Local transforms of all nodes and the weights of all morph targets.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// One per node of the skeleton, in its order.
    pub local: Vec<Transform>,
    /// One per weight slot of the mesh ([`super::Mesh::weight_names`]).
    pub weights: Vec<f32>,
}

impl Pose {
    /// The pose in which nothing is animated and every morph weight is at its default.
    #[must_use]
    pub fn rest(skeleton: &Skeleton, default_weights: &[f32]) -> Self {
        Self {
            local: skeleton.nodes.iter().map(|node| node.rest).collect(),
            weights: default_weights.to_vec(),
        }
    }
}
