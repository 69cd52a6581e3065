//! The parametrisation `joint-angles` of a pose (PRT07 §4): rotation vectors about each joint's
//! mean rotation, and whatever else is animated.

use glam::Vec3;

use super::parametrisation::{Source, off_rest, varies};
use super::rotation::{mean_rotation, rotation_vector};
use super::{Parametrisation, Pose, Skeleton};

impl Parametrisation {
    /// Keeps a parameter for each degree of freedom that varies over the `training` poses, in the
    /// order of the nodes (rotation, translation, scale) and then the morph weights.
    ///
    /// `excluded` marks the root node and its ancestors: their rotation and translation are the
    /// root frame's; a varying scale is not, and is kept. Every other joint's rotation and every
    /// morph weight that does not vary is named in `dropped`; so are translations and scales that
    /// do not vary and yet are not at rest. Translations vary where their deviation exceeds
    /// [`LEAST_DEVIATION`](super::LEAST_DEVIATION) of `size_m` (metres).
    ///
    /// # Panics
    /// If a pose or `excluded` has another length than the skeleton, or `size_m` is not positive.
    #[must_use]
    pub fn joint_angles(
        skeleton: &Skeleton,
        training: &[&Pose],
        size_m: f32,
        excluded: &[bool],
        weight_names: &[String],
    ) -> Self {
        assert!(size_m > 0.0, "a model has a size, not {size_m}");
        assert_eq!(excluded.len(), skeleton.nodes.len(), "one mark per node");
        let mut angles = Self { columns: Vec::new(), size_m, dropped: Vec::new() };
        for (node, &excluded) in excluded.iter().enumerate() {
            if !excluded {
                angles.add_rotation(skeleton, training, node);
                angles.add_translation(skeleton, training, node);
            }
            angles.add_scale(skeleton, training, node);
        }
        angles.add_weights(&training.iter().copied(), weight_names);
        angles
    }

    fn add_rotation(&mut self, skeleton: &Skeleton, training: &[&Pose], node: usize) {
        let rotations = || training.iter().map(|pose| pose.local[node].rotation);
        let mean = mean_rotation(rotations());
        let vectors: Vec<Vec3> = rotations().map(|q| rotation_vector(mean, q)).collect();
        let name = format!("{} rotation", skeleton.nodes[node].name);
        let kept = self.add(&name, |axis| {
            let source = Source::Rotation { node, axis: axis as u8, mean };
            varies(vectors.iter().map(|vector| vector[axis])).then_some(source)
        });
        self.name_dropped(&name, kept, |_| true);
    }

    fn add_translation(&mut self, skeleton: &Skeleton, training: &[&Pose], node: usize) {
        let rest = skeleton.nodes[node].rest.translation;
        let size = self.size_m;
        let name = format!("{} translation", skeleton.nodes[node].name);
        let value = |pose: &Pose, axis| (pose.local[node].translation[axis] - rest[axis]) / size;
        let kept = self.add(&name, |axis| {
            varies(training.iter().map(|pose| value(pose, axis))).then(|| Source::Translation {
                node,
                axis: axis as u8,
                rest: rest[axis],
            })
        });
        self.name_dropped(&name, kept, |axis| off_rest(training.iter().map(|p| value(p, axis))));
    }

    fn add_scale(&mut self, skeleton: &Skeleton, training: &[&Pose], node: usize) {
        let rest = skeleton.nodes[node].rest.scale;
        let name = format!("{} scale", skeleton.nodes[node].name);
        let value = |pose: &Pose, axis| pose.local[node].scale[axis] - rest[axis];
        let kept = self.add(&name, |axis| {
            varies(training.iter().map(|pose| value(pose, axis))).then(|| Source::Scale {
                node,
                axis: axis as u8,
                rest: rest[axis],
            })
        });
        self.name_dropped(&name, kept, |axis| off_rest(training.iter().map(|p| value(p, axis))));
    }
}
