//! The node hierarchy of a scene, in an order where parents come before children.

use glam::{Affine3A, Quat, Vec3};

/// A translation, rotation and scale, applied to a point in the order scale, rotation, translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform {
    /// Metres, in the parent's space.
    pub translation: Vec3,
    /// A unit quaternion.
    pub rotation: Quat,
    /// Per axis, without unit; negative values mirror.
    pub scale: Vec3,
}

impl Transform {
    /// The transform that changes nothing.
    pub const IDENTITY: Self =
        Self { translation: Vec3::ZERO, rotation: Quat::IDENTITY, scale: Vec3::ONE };

    /// The same map as a 3×4 matrix.
    #[must_use]
    pub fn to_affine(self) -> Affine3A {
        Affine3A::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

/// One node of the hierarchy: a joint of a skin, a mesh's carrier, or a plain group.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Unique within its skeleton; import makes it so.
    pub name: String,
    /// Index of the parent, always smaller than the node's own; `None` at a root.
    pub parent: Option<usize>,
    /// The local transform where no clip says otherwise.
    pub rest: Transform,
}

/// All nodes of a scene, parents before children.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Skeleton {
    /// *Invariant:* `nodes[i].parent < Some(i)`, names are unique.
    pub nodes: Vec<Node>,
}

impl Skeleton {
    /// Forward kinematics: the map of every node to the scene's space, given local transforms.
    ///
    /// # Panics
    /// If `local` has another length than `nodes`.
    #[must_use]
    pub fn globals(&self, local: &[Transform]) -> Vec<Affine3A> {
        assert_eq!(local.len(), self.nodes.len(), "one local transform per node");
        let mut globals: Vec<Affine3A> = Vec::with_capacity(local.len());
        for (node, transform) in self.nodes.iter().zip(local) {
            let own = transform.to_affine();
            globals.push(node.parent.map_or(own, |parent| globals[parent] * own));
        }
        globals
    }

    /// The index of the node of this name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|node| node.name == name)
    }
}
