//! The folds of a mesh in its poses, for parameters that are angles between triangles.

use glam::Vec3;

use super::Root;
use crate::rig::{self, Deformed, Hinges, Points, Pose};
use crate::scene::Scene;

/// A mesh that folds.
pub(super) struct Folds<'a> {
    scene: &'a Scene,
    points: &'a Points,
    pub(super) hinges: Hinges,
}

impl<'a> Folds<'a> {
    pub(super) fn of(scene: &'a Scene, points: &'a Points, root: &Root<'_>) -> Self {
        let mesh = &scene.mesh;
        let rest = posed(scene, &Pose::rest(&scene.skeleton, &mesh.default_weights), root);
        Self { scene, points, hinges: Hinges::new(&rest, &mesh.triangles, points) }
    }

    /// Where the points are in a pose, in the root frame.
    pub(super) fn positions(&self, pose: &Pose, root: &Root<'_>) -> Vec<Vec3> {
        let all = posed(self.scene, pose, root);
        self.points.vertex.iter().map(|&vertex| all[vertex as usize]).collect()
    }

    /// The angle of every fold in a pose, radians.
    pub(super) fn angles(&self, pose: &Pose, root: &Root<'_>) -> Vec<f64> {
        self.hinges.angles(&self.positions(pose, root))
    }
}

fn posed(scene: &Scene, pose: &Pose, root: &Root<'_>) -> Vec<Vec3> {
    let globals = scene.skeleton.globals(&pose.local);
    let mut posed = Deformed::default();
    rig::deform(&scene.mesh, &globals, &pose.weights, root.frame(&globals), &mut posed);
    posed.positions
}
