//! Spheres that a skinned character carries.

use glam::Affine3A;

use super::Sphere;
use crate::rig::{Deformed, Mesh, RigidFrame, deform};

/// What stands for a character where it casts shadows: spheres whose centres are moved by the bones (and
/// morph targets) as vertices are.
#[derive(Debug, Clone, PartialEq)]
pub struct SphereSet {
    /// Vertices that are centres.
    centres: Mesh,
    /// Metres.
    radii: Vec<f32>,
}

impl SphereSet {
    /// A set of centres, as vertices of a mesh without triangles, and radii in metres.
    ///
    /// # Panics
    /// If there are not as many of both.
    #[must_use]
    pub fn new(centres: Mesh, radii: Vec<f32>) -> Self {
        assert_eq!(centres.positions.len(), radii.len(), "centres and radii");
        Self { centres, radii }
    }

    /// How many spheres.
    #[must_use]
    pub fn len(&self) -> usize {
        self.radii.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.radii.is_empty()
    }

    /// Appends the spheres of a pose, seen from `root`, then moved by `place` (rigid, or with one scale
    /// for all axes).
    ///
    /// # Panics
    /// If `globals` or `weights` are shorter than what the spheres refer to.
    pub fn pose(
        &self,
        globals: &[Affine3A],
        weights: &[f32],
        (root, place): (RigidFrame, Affine3A),
        out: &mut Vec<Sphere>,
    ) {
        let mut moved = Deformed::default();
        deform(&self.centres, globals, weights, root, &mut moved);
        let scale = place.matrix3.determinant().abs().cbrt();
        let spheres = moved.positions.iter().zip(&self.radii);
        out.extend(spheres.map(|(&centre, &radius)| Sphere {
            centre: place.transform_point3(centre),
            radius: scale * radius,
        }));
    }
}
