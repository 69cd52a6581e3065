//! Pose parameters: how a pose becomes numbers.

use glam::{Affine3A, Quat, Vec3};

use super::rotation::{nearest_rotation, rotation_vector};
use super::{Pose, dihedral};

/// A degree of freedom whose standard deviation over the training poses is at most this (radians,
/// model sizes, or units of scale and weight) is noise of the file's encoding, not motion.
pub const LEAST_DEVIATION: f64 = 1e-5;

const AXES: [&str; 3] = ["x", "y", "z"];

/// The parametrisations that are made from poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ParametrisationKind {
    /// Rotation vectors about mean rotations ([`Parametrisation::joint_angles`]).
    #[default]
    JointAngles,
    /// Positions of joints and of points beside the bones ([`Parametrisation::handles`]).
    Handles,
    /// Angles between neighbouring triangles ([`Parametrisation::dihedral`]).
    Dihedral,
}

/// Where one parameter comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// A component of the rotation vector log(mean⁻¹ · q), radians.
    Rotation {
        /// Index into [`Skeleton::nodes`](super::Skeleton::nodes).
        node: usize,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// The joint's mean rotation over the training poses.
        mean: Quat,
    },
    /// A component of the local translation minus `rest`, divided by the model's size.
    Translation {
        /// Index into [`Skeleton::nodes`](super::Skeleton::nodes).
        node: usize,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// Metres.
        rest: f32,
    },
    /// A component of the local scale minus `rest`.
    Scale {
        /// Index into [`Skeleton::nodes`](super::Skeleton::nodes).
        node: usize,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// Without unit.
        rest: f32,
    },
    /// A component of root⁻¹ · global(node) · `offset`, divided by the model's size: where a point
    /// that the node carries is in the root frame.
    Point {
        /// Index into [`Skeleton::nodes`](super::Skeleton::nodes)(super::Skeleton::nodes).
        node: usize,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// In the node's own space.
        offset: Vec3,
    },
    /// A component of the rotation vector of q · rest⁻¹, radians, with q the node's rotation in the
    /// root frame: the tilt of a character on level ground.
    Tilt {
        /// The root node.
        node: usize,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// Its rotation at rest, in the scene.
        rest: Quat,
    },
    /// The node's height in the root frame minus `rest`, divided by the model's size.
    Height {
        /// The root node.
        node: usize,
        /// Metres.
        rest: f32,
    },
    /// A morph weight as it is.
    Weight {
        /// Index into [`Pose::weights`].
        slot: usize,
    },
    /// How far two triangles (a, b, c) and (b, a, d) are from flat, radians, less `mean` by the
    /// short way.
    Dihedral {
        /// The points a, b, c, d.
        corners: [u32; 4],
        /// Radians.
        mean: f32,
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
pub struct Parametrisation {
    /// The parameters, in the order of [`Parametrisation::encode`]'s output.
    pub columns: Vec<Column>,
    /// The length by which translations are divided, metres.
    pub size_m: f32,
    /// Degrees of freedom that have no parameter, since nothing varies in training.
    pub dropped: Vec<String>,
}

impl Parametrisation {
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
    /// `in_root` maps each node's space to the root frame ([`in_root`](super::in_root)); only
    /// [`Source::Point`], [`Source::Tilt`] and [`Source::Height`] look at it, so it may be empty where [`needs_globals`](Self::needs_globals)
    /// is false. Always finite for a finite pose; a rotation is normalised, one without direction
    /// counts as the mean.
    ///
    /// # Panics
    /// If the pose has fewer nodes or weights than the columns refer to, or
    /// [`needs_positions`](Self::needs_positions).
    #[must_use]
    pub fn encode(&self, pose: &Pose, in_root: &[Affine3A]) -> Vec<f32> {
        self.encode_posed(pose, in_root, &[])
    }

    /// [`encode`](Self::encode) with the positions of the posed mesh's points, in any frame and at any
    /// scale; only [`Source::Dihedral`] looks at them.
    ///
    /// # Panics
    /// As `encode`; if there are fewer positions than the columns refer to.
    #[must_use]
    pub fn encode_posed(&self, pose: &Pose, in_root: &[Affine3A], positions: &[Vec3]) -> Vec<f32> {
        // The components of a joint or point follow each other: one logarithm or product serves.
        let mut last = (usize::MAX, Vec3::ZERO);
        let mut last_point = (usize::MAX, Vec3::ZERO, Vec3::ZERO);
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
                Source::Point { node, axis, offset } => {
                    if (last_point.0, last_point.1) != (node, offset) {
                        let at = in_root[node].transform_point3(offset) / self.size_m;
                        last_point = (node, offset, at);
                    }
                    last_point.2[usize::from(axis)]
                }
                Source::Tilt { node, axis, rest } => tilt(&in_root[node], rest)[usize::from(axis)],
                Source::Height { node, rest } => (in_root[node].translation.y - rest) / self.size_m,
                Source::Weight { slot } => pose.weights[slot],
                Source::Dihedral { corners, mean } => {
                    dihedral::turn(f64::from(mean), dihedral::angle(positions, corners)) as f32
                }
            })
            .collect()
    }

    /// Whether some parameter is a matter of where a node is in the root frame, so that [`encode`](Self::encode) needs
    /// forward kinematics.
    #[must_use]
    pub fn needs_globals(&self) -> bool {
        let needs = |source| {
            matches!(source, Source::Point { .. } | Source::Tilt { .. } | Source::Height { .. })
        };
        self.columns.iter().any(|column| needs(column.source))
    }

    /// Whether some parameter is a matter of the posed mesh, so that only
    /// [`encode_posed`](Self::encode_posed) gives it.
    #[must_use]
    pub fn needs_positions(&self) -> bool {
        self.columns.iter().any(|column| matches!(column.source, Source::Dihedral { .. }))
    }

    /// Puts tilt and height of the whole character before the other parameters, as far as they
    /// vary over the training poses, which come with their nodes in the root frame. For
    /// [`RootMotion::Upright`](super::RootMotion::Upright).
    ///
    /// # Panics
    /// If a slice is shorter than the root node demands.
    #[must_use]
    pub fn on_ground(
        mut self,
        root_node: usize,
        rest_globals: &[Affine3A],
        training: &[&[Affine3A]],
    ) -> Self {
        let at_rest = rest_globals[root_node];
        let rest = nearest_rotation(at_rest.matrix3).unwrap_or(Quat::IDENTITY);
        let later = std::mem::take(&mut self.columns);
        for (axis, name) in [(0, "root tilt x"), (2, "root tilt z")] {
            let source = Source::Tilt { node: root_node, axis: axis as u8, rest };
            let values = training.iter().map(|inside| tilt(&inside[root_node], rest)[axis]);
            self.add_or_name(name, source, varies(values));
        }
        let source = Source::Height { node: root_node, rest: at_rest.translation.y };
        let size_m = self.size_m;
        let values = training.iter().map(|inside| inside[root_node].translation.y / size_m);
        self.add_or_name("root height", source, varies(values));
        self.columns.extend(later);
        self
    }

    fn add_or_name(&mut self, name: &str, source: Source, varies: bool) {
        if varies {
            self.columns.push(Column { source, name: name.to_owned() });
        } else {
            self.dropped.push(name.to_owned());
        }
    }

    /// Adds a parameter for each morph weight that varies, and names the others.
    pub(super) fn add_weights<'a>(
        &mut self,
        training: &(impl Iterator<Item = &'a Pose> + Clone),
        weight_names: &[String],
    ) {
        for (slot, name) in weight_names.iter().enumerate() {
            if varies(training.clone().map(|pose| pose.weights[slot])) {
                let source = Source::Weight { slot };
                self.columns.push(Column { source, name: name.clone() });
            } else {
                self.dropped.push(name.clone());
            }
        }
    }

    /// Adds a column for each axis that has a source; tells which.
    pub(super) fn add(
        &mut self,
        name: &str,
        source: impl Fn(usize) -> Option<Source>,
    ) -> [bool; 3] {
        [0, 1, 2].map(|axis| {
            source(axis).is_some_and(|source| {
                self.columns.push(Column { source, name: format!("{name} {}", AXES[axis]) });
                true
            })
        })
    }

    /// Names what was not kept and is of interest: as a whole where that is all three axes.
    pub(super) fn name_dropped(
        &mut self,
        name: &str,
        kept: [bool; 3],
        of_interest: impl Fn(usize) -> bool,
    ) {
        let named: Vec<usize> = (0..3).filter(|&axis| !kept[axis] && of_interest(axis)).collect();
        if named.len() == 3 {
            self.dropped.push(name.to_owned());
        } else {
            self.dropped.extend(named.iter().map(|&axis| format!("{name} {}", AXES[axis])));
        }
    }
}

/// Of a node in the root frame against its rest; none where the pose crushes it.
fn tilt(in_root: &Affine3A, rest: Quat) -> Vec3 {
    let turn = nearest_rotation(in_root.matrix3).map(|now| now * rest.inverse());
    turn.map_or(Vec3::ZERO, |turn| rotation_vector(Quat::IDENTITY, turn))
}

fn node_of(source: Source) -> Option<usize> {
    match source {
        Source::Rotation { node, .. }
        | Source::Translation { node, .. }
        | Source::Scale { node, .. }
        | Source::Point { node, .. }
        | Source::Tilt { node, .. }
        | Source::Height { node, .. } => Some(node),
        Source::Weight { .. } | Source::Dihedral { .. } => None,
    }
}

/// Whether the standard deviation exceeds [`LEAST_DEVIATION`].
pub(super) fn varies(values: impl Iterator<Item = f32> + Clone) -> bool {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().map(f64::from).sum::<f64>() / count;
    let squares: f64 = values.map(|value| (f64::from(value) - mean).powi(2)).sum();
    (squares / count).sqrt() > LEAST_DEVIATION
}

/// Whether some value is away from zero.
pub(super) fn off_rest(mut values: impl Iterator<Item = f32>) -> bool {
    values.any(|value| f64::from(value).abs() > LEAST_DEVIATION)
}

#[cfg(test)]
#[path = "parametrisation_tests.rs"]
mod tests;
