//! The rigid frame of a character's root: what is removed before baking, and what light is
//! rotated into at run time.

use glam::{Affine3A, Quat, Vec3};

/// A rotation followed by a translation: root frame → scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidFrame {
    /// Rotates directions of the root frame into the scene.
    pub rotation: Quat,
    /// Metres, in the scene.
    pub translation: Vec3,
}

impl RigidFrame {
    /// The root frame is the scene itself.
    pub const IDENTITY: Self = Self { rotation: Quat::IDENTITY, translation: Vec3::ZERO };

    /// Scene → root frame, as a matrix.
    #[must_use]
    pub fn inverse(self) -> Affine3A {
        Affine3A::from_rotation_translation(self.rotation, self.translation).inverse()
    }
}

/// The map of every node's space to the root frame: root⁻¹ · global.
#[must_use]
pub fn in_root(globals: &[Affine3A], root: RigidFrame) -> Vec<Affine3A> {
    let to_root = root.inverse();
    globals.iter().map(|global| to_root * *global).collect()
}
