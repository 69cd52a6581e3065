//! From what a tool has, local joint transforms by name, to what a model takes.

use std::collections::BTreeMap;

use glam::{Affine3A, Quat, Vec3};

use super::evaluate::check_length;
use super::header::check_finite;
use super::rig::Rig;
use super::{Error, Model};
use crate::rig::{Pose, RigidFrame, bone_rotations, in_root};

/// One joint's local transform, as far as a tool gives it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointTransform {
    /// Metres, in the parent's space.
    pub translation: Option<Vec3>,
    /// Normalised on use; must not be zero.
    pub rotation: Option<Quat>,
    /// Per axis.
    pub scale: Option<Vec3>,
}

/// A pose by names. What it does not name stays at rest.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointPose {
    /// Node name → local transform.
    pub joints: BTreeMap<String, JointTransform>,
    /// Morph-weight name → weight.
    pub weights: BTreeMap<String, f32>,
}

impl Model {
    /// The full pose that a tool's pose stands for: joints, transforms and morph weights that it
    /// does not name are at rest, rotations are normalised.
    ///
    /// # Errors
    /// [`Error::UnknownNames`] with every name that the rig does not have,
    /// [`Error::NoRotation`] for a zero quaternion, [`Error::NotFinite`].
    pub fn pose_of(&self, pose: &JointPose) -> Result<Pose, Error> {
        let mut full = Pose::rest(&self.rig.skeleton, &self.rig.default_weights);
        let nodes = &self.rig.skeleton.nodes;
        let by_name: BTreeMap<&str, usize> =
            nodes.iter().enumerate().map(|(i, node)| (node.name.as_str(), i)).collect();
        check_names("joints", pose.joints.keys(), |name| by_name.contains_key(name))?;
        for (name, given) in &pose.joints {
            let local = &mut full.local[by_name[name.as_str()]];
            if let Some(rotation) = given.rotation {
                local.rotation = normalised(rotation)
                    .ok_or_else(|| Error::NoRotation { joint: name.clone() })?;
            }
            if let Some(translation) = given.translation {
                check_finite(&format!("translation of `{name}`"), &translation.to_array())?;
                local.translation = translation;
            }
            if let Some(scale) = given.scale {
                check_finite(&format!("scale of `{name}`"), &scale.to_array())?;
                local.scale = scale;
            }
        }
        let slots: BTreeMap<&str, usize> =
            self.header.rig.weights.iter().enumerate().map(|(i, w)| (w.name.as_str(), i)).collect();
        check_names("morph weights", pose.weights.keys(), |name| slots.contains_key(name))?;
        for (name, &weight) in &pose.weights {
            check_finite(&format!("weight `{name}`"), &[weight])?;
            full.weights[slots[name.as_str()]] = weight;
        }
        Ok(full)
    }

    /// The model's parameters for a tool's pose.
    ///
    /// # Errors
    /// As [`pose_of`](Self::pose_of).
    pub fn parameters_of(&self, pose: &JointPose) -> Result<Vec<f32>, Error> {
        self.parameters_of_pose(&self.pose_of(pose)?)
    }

    /// The model's parameters for a pose of its own skeleton.
    ///
    /// # Errors
    /// [`Error::Length`] if the pose is of another skeleton, [`Error::NotFinite`],
    /// [`Error::NeedsSurface`] where they are angles of the posed mesh.
    pub fn parameters_of_pose(&self, pose: &Pose) -> Result<Vec<f32>, Error> {
        if self.needs_positions() {
            return Err(Error::NeedsSurface { what: "the model's pose parameters" });
        }
        self.parameters_of_posed(pose, &[])
    }

    /// Whether the parameters are angles of the posed mesh, so that
    /// [`parameters_of_posed`](Self::parameters_of_posed) gives them.
    #[must_use]
    pub fn needs_positions(&self) -> bool {
        self.rig.angles.needs_positions()
    }

    /// Whether poses need the posed mesh beside them: for their parameters or for
    /// [evaluation](Self::needs_surface).
    #[must_use]
    pub fn looks_at_mesh(&self) -> bool {
        self.needs_surface() || self.needs_positions()
    }

    /// The model's parameters for a pose of its own skeleton with the posed mesh: a position per
    /// point, in any frame and at any scale, which only parameters of folds look at.
    ///
    /// # Errors
    /// As [`parameters_of_pose`](Self::parameters_of_pose); [`Error::Length`] of another mesh.
    pub fn parameters_of_posed(&self, pose: &Pose, positions: &[Vec3]) -> Result<Vec<f32>, Error> {
        if self.needs_positions() {
            check_length("positions", positions.len(), self.shape.points)?;
        }
        let globals = self.globals(pose)?;
        let in_root = in_root(&globals, self.root(&globals));
        let parameters = self.rig.angles.encode_posed(pose, &in_root, positions);
        check_finite("parameters", &parameters)?;
        Ok(parameters)
    }

    /// The rotation of every bone since rest, in the root frame: what takes bone-frame
    /// coefficients to the root frame.
    ///
    /// # Errors
    /// As [`parameters_of_pose`](Self::parameters_of_pose).
    pub fn bone_rotations_of(&self, pose: &Pose) -> Result<Vec<Quat>, Error> {
        let globals = self.globals(pose)?;
        let root = self.root(&globals);
        Ok(bone_rotations(&globals, &self.rig.rest_globals, root, &self.rig.bones))
    }

    /// The root frame of a pose: a light of the scene is rotated by the inverse of its rotation
    /// before it meets coefficients in the root frame.
    ///
    /// # Errors
    /// As [`parameters_of_pose`](Self::parameters_of_pose).
    pub fn root_frame_of(&self, pose: &Pose) -> Result<RigidFrame, Error> {
        Ok(self.root(&self.globals(pose)?))
    }

    fn globals(&self, pose: &Pose) -> Result<Vec<Affine3A>, Error> {
        self.check_pose(pose)?;
        Ok(self.rig.skeleton.globals(&pose.local))
    }

    fn root(&self, globals: &[Affine3A]) -> RigidFrame {
        let Rig { skeleton, rest_globals, root_node, root_motion, .. } = &self.rig;
        root_motion.frame(skeleton, globals, rest_globals, *root_node)
    }

    fn check_pose(&self, pose: &Pose) -> Result<(), Error> {
        check_length("local transforms", pose.local.len(), self.rig.skeleton.nodes.len())?;
        check_length("morph weights", pose.weights.len(), self.rig.default_weights.len())?;
        for (local, node) in pose.local.iter().zip(&self.rig.skeleton.nodes) {
            if normalised(local.rotation).is_none() {
                return Err(Error::NoRotation { joint: node.name.clone() });
            }
            let finite = local.translation.is_finite() && local.scale.is_finite();
            if !finite {
                return Err(Error::NotFinite { what: format!("joint `{}`", node.name), index: 0 });
            }
        }
        check_finite("morph weights", &pose.weights)
    }
}

/// The unit quaternion along `q`, in f64 so that no length over- or underflows.
fn normalised(q: Quat) -> Option<Quat> {
    let q = q.as_dquat();
    let length = q.length();
    (length.is_finite() && length > 0.0).then(|| (q / length).as_quat())
}

fn check_names<'a>(
    what: &'static str,
    names: impl Iterator<Item = &'a String>,
    known: impl Fn(&str) -> bool,
) -> Result<(), Error> {
    let names: Vec<String> = names.filter(|name| !known(name)).cloned().collect();
    if names.is_empty() { Ok(()) } else { Err(Error::UnknownNames { what, names }) }
}
