//! From a model's own frame to the root frame.

use glam::Quat;

use super::evaluate::check_length;
use super::{Error, Frame, Model, Signal, Surface};
use crate::rig::to_tangent_frame;
use crate::sh::{MAX_COEFFICIENTS, Rotation};

impl Model {
    /// Rotates evaluated coefficients, `[point, channel, coefficient]` of all points or of the
    /// listed ones, from the model's frame to the root frame. `bone_rotations` has one rotation
    /// per bone ([`Model::bone_rotations_of`]). Nothing happens to a model of the root frame, nor
    /// to `ao`, which has no direction.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::OutOfRange`] points, [`Error::NoRotation`] naming the bone,
    /// [`Error::NeedsSurface`] of a model of the tangent frame, which
    /// [`evaluate_posed`](Self::evaluate_posed) turns.
    pub fn to_root_frame(
        &self,
        bone_rotations: &[Quat],
        points: Option<&[u32]>,
        coefficients: &mut [f32],
    ) -> Result<(), Error> {
        let count = self.check_points(points)?;
        check_length("coefficients", coefficients.len(), count * self.shape.width)?;
        if self.turns_with_tangents() {
            return Err(Error::NeedsSurface { what: "turning from the tangent frame" });
        }
        if !self.turns_with_bones() {
            return Ok(());
        }
        self.check_bone_rotations(bone_rotations)?;
        let order = self.header.sh_order();
        let rotations: Vec<Rotation> =
            bone_rotations.iter().map(|&rotation| Rotation::new(order, rotation)).collect();
        let per_channel = self.header.coefficients();
        let mut turned = [0.0; MAX_COEFFICIENTS];
        for (i, row) in coefficients.chunks_exact_mut(self.shape.width).enumerate() {
            let point = points.map_or(i, |points| points[i] as usize);
            let rotation = &rotations[usize::from(self.bone_of_point[point])];
            for channel in row.chunks_exact_mut(per_channel) {
                rotation.apply(channel, &mut turned);
                channel.copy_from_slice(&turned[..per_channel]);
            }
        }
        Ok(())
    }

    /// Rotates coefficients of all points from the tangent frame to the root frame.
    pub(super) fn tangent_to_root(&self, surface: Surface<'_>, coefficients: &mut [f32]) {
        let mut rotation = Rotation::identity(self.header.sh_order());
        let per_channel = self.header.coefficients();
        let mut turned = [0.0; MAX_COEFFICIENTS];
        let frames = surface.normals.iter().zip(surface.tangents);
        for (row, (&normal, &tangent)) in
            coefficients.chunks_exact_mut(self.shape.width).zip(frames)
        {
            rotation.set(to_tangent_frame(normal, tangent).conjugate());
            for channel in row.chunks_exact_mut(per_channel) {
                rotation.apply(channel, &mut turned);
                channel.copy_from_slice(&turned[..per_channel]);
            }
        }
    }

    /// Whether the coefficients' axes turn with the tangents.
    #[must_use]
    pub fn turns_with_tangents(&self) -> bool {
        self.header.frame == Frame::Tangent
    }

    /// Whether the coefficients' axes turn with the bones.
    pub(super) fn turns_with_bones(&self) -> bool {
        self.header.frame == Frame::Bone && self.header.signal != Signal::Ao
    }

    pub(super) fn check_bone_rotations(&self, bone_rotations: &[Quat]) -> Result<(), Error> {
        check_length("bone rotations", bone_rotations.len(), self.rig.bones.nodes.len())?;
        for (rotation, &node) in bone_rotations.iter().zip(&self.rig.bones.nodes) {
            let square = rotation.as_dquat().length_squared();
            if !(square.is_finite() && square > 0.0) {
                let joint = self.rig.skeleton.nodes[node].name.clone();
                return Err(Error::NoRotation { joint });
            }
        }
        Ok(())
    }
}
