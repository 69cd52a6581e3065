//! The parametrisation `joint-angles` of a pose (PRT07 §4): rotation vectors about each joint's
//! mean rotation, and whatever else is animated.

use glam::{Quat, Vec3};

use super::rotation::{mean_rotation, rotation_vector};
use super::{Pose, Skeleton};

/// A degree of freedom whose standard deviation over the training poses is at most this (radians,
/// model sizes, or units of scale and weight) is noise of the file's encoding, not motion.
pub const LEAST_DEVIATION: f64 = 1e-5;

const AXES: [&str; 3] = ["x", "y", "z"];

/// Where one parameter comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// A component of the rotation vector log(mean⁻¹ · q), radians.
    Rotation {
        /// Index into [`Skeleton::nodes`].
        node: usize,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// The joint's mean rotation over the training poses.
        mean: Quat,
    },
    /// A component of the local translation minus `rest`, divided by the model's size.
    Translation {
        /// Index into [`Skeleton::nodes`].
        node: usize,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// Metres.
        rest: f32,
    },
    /// A component of the local scale minus `rest`.
    Scale {
        /// Index into [`Skeleton::nodes`].
        node: usize,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// Without unit.
        rest: f32,
    },
    /// A morph weight as it is.
    Weight {
        /// Index into [`Pose::weights`].
        slot: usize,
    },
}

/// One parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// What it is computed from.
    pub source: Source,
    /// Such as `LeftKnee rotation x` or `smile`.
    pub name: String,
}

/// The map from a pose to its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct JointAngles {
    /// The parameters, in the order of [`JointAngles::encode`]'s output.
    pub columns: Vec<Column>,
    /// The length by which translations are divided, metres.
    pub size_m: f32,
    /// Degrees of freedom that have no parameter, since nothing varies in training.
    pub dropped: Vec<String>,
}

impl JointAngles {
    /// Keeps a parameter for each degree of freedom that varies over the `training` poses, in the
    /// order of the nodes (rotation, translation, scale) and then the morph weights.
    ///
    /// `excluded` marks the root node and its ancestors: their rotation and translation are the
    /// root frame's; a varying scale is not, and is kept. Every other joint's rotation and every
    /// morph weight that does not vary is named in `dropped`; so are translations and scales that
    /// do not vary and yet are not at rest. Translations vary where their deviation exceeds
    /// [`LEAST_DEVIATION`] of `size_m` (metres).
    ///
    /// # Panics
    /// If a pose or `excluded` has another length than the skeleton, or `size_m` is not positive.
    #[must_use]
    pub fn from_poses(
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
        for (slot, name) in weight_names.iter().enumerate() {
            if varies(training.iter().map(|pose| pose.weights[slot])) {
                let source = Source::Weight { slot };
                angles.columns.push(Column { source, name: name.clone() });
            } else {
                angles.dropped.push(name.clone());
            }
        }
        angles
    }

    /// Removes the parameters of nodes that carry no vertex (`carries[node]` is false), such as
    /// targets of inverse kinematics: they cannot change the signal. Their names join `dropped`.
    pub fn retain_nodes(&mut self, carries: &[bool]) {
        let dropped = &mut self.dropped;
        self.columns.retain(|column| {
            let keep = node_of(column.source).is_none_or(|node| carries[node]);
            if !keep {
                dropped.push(column.name.clone());
            }
            keep
        });
    }

    /// The parameters of a pose, one per column, not centred: radians, sizes, scales, weights.
    ///
    /// Always finite for a finite pose; a rotation is normalised, one without direction counts as
    /// the mean.
    ///
    /// # Panics
    /// If the pose has fewer nodes or weights than the columns refer to.
    #[must_use]
    pub fn encode(&self, pose: &Pose) -> Vec<f32> {
        // The three components of a joint follow each other: one logarithm serves them.
        let mut last = (usize::MAX, Vec3::ZERO);
        self.columns
            .iter()
            .map(|column| match column.source {
                Source::Rotation { node, axis, mean } => {
                    if last.0 != node {
                        last = (node, rotation_vector(mean, pose.local[node].rotation));
                    }
                    last.1[usize::from(axis)]
                }
                Source::Translation { node, axis, rest } => {
                    (pose.local[node].translation[usize::from(axis)] - rest) / self.size_m
                }
                Source::Scale { node, axis, rest } => {
                    pose.local[node].scale[usize::from(axis)] - rest
                }
                Source::Weight { slot } => pose.weights[slot],
            })
            .collect()
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

    /// Adds a column for each axis that has a source; tells which.
    fn add(&mut self, name: &str, source: impl Fn(usize) -> Option<Source>) -> [bool; 3] {
        [0, 1, 2].map(|axis| {
            source(axis).is_some_and(|source| {
                self.columns.push(Column { source, name: format!("{name} {}", AXES[axis]) });
                true
            })
        })
    }

    /// Names what was not kept and is of interest: as a whole where that is all three axes.
    fn name_dropped(&mut self, name: &str, kept: [bool; 3], of_interest: impl Fn(usize) -> bool) {
        let named: Vec<usize> = (0..3).filter(|&axis| !kept[axis] && of_interest(axis)).collect();
        if named.len() == 3 {
            self.dropped.push(name.to_owned());
        } else {
            self.dropped.extend(named.iter().map(|&axis| format!("{name} {}", AXES[axis])));
        }
    }
}

fn node_of(source: Source) -> Option<usize> {
    match source {
        Source::Rotation { node, .. }
        | Source::Translation { node, .. }
        | Source::Scale { node, .. } => Some(node),
        Source::Weight { .. } => None,
    }
}

/// Whether the standard deviation exceeds [`LEAST_DEVIATION`].
fn varies(values: impl Iterator<Item = f32> + Clone) -> bool {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().map(f64::from).sum::<f64>() / count;
    let squares: f64 = values.map(|value| (f64::from(value) - mean).powi(2)).sum();
    (squares / count).sqrt() > LEAST_DEVIATION
}

/// Whether some value is away from zero.
fn off_rest(mut values: impl Iterator<Item = f32>) -> bool {
    values.any(|value| f64::from(value).abs() > LEAST_DEVIATION)
}

#[cfg(test)]
#[path = "angles_tests.rs"]
mod tests;
