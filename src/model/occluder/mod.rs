//! Occluders: spheres that the mesh carries along, and what groups of them block at each point.
//!
//! The point features of the family `occluder`. A sphere q has anchors, a few points
//! of the mesh whose mean the pose carries, an offset o_q that turns with the anchors' bone, and a
//! radius r_q: its centre is mean(anchors) + Q·o_q. Which group a sphere counts for depends on the
//! bone of the point that it is seen from, so that a point's own limb is a group of its own.
//! What is blocked at point v is Σ_g weight\[v, g\] Σ_{q in g} ψ_q(v), with ψ of [`caps`].
//!
//! *Invariant:* everything in [`Occluders`] has been checked against its model.

pub mod caps;
mod evaluate;

use glam::{Quat, Vec3};
use serde::{Deserialize, Serialize};

pub(super) use evaluate::Seen;
pub use evaluate::add;

use super::header::{check_finite, field, within};
use super::{Error, limits};

/// Points whose mean carries a sphere.
pub const ANCHORS: usize = 8;

/// How many spheres, and how many groups of them a point tells apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OccluderSizes {
    /// Spheres.
    pub spheres: u32,
    /// Groups.
    pub groups: u32,
}

/// The numbers of the occluders, in plain row order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Occluders {
    /// `[sphere, ANCHORS]`, indices of points.
    pub anchors: Vec<u32>,
    /// `[sphere, 3]`: from the mean of the anchors to the centre, metres, at rest, in the axes of
    /// the root frame; turns with the bone of the first anchor.
    pub offsets: Vec<f32>,
    /// `[sphere]`, metres.
    pub radii: Vec<f32>,
    /// `[bone, sphere]`: the group for which a sphere counts at the points of a bone.
    pub group_of: Vec<u8>,
    /// `[point, group]`: how much of what a group blocks is missing at a point.
    pub weights: Vec<f32>,
}

/// A posed mesh as far as models look at it: one entry per point, in the root frame.
#[derive(Debug, Clone, Copy)]
pub struct Surface<'a> {
    /// Metres.
    pub positions: &'a [Vec3],
    /// Unit shading normals.
    pub normals: &'a [Vec3],
}

impl Occluders {
    /// How many spheres.
    #[must_use]
    pub fn spheres(&self) -> usize {
        self.radii.len()
    }

    /// How many groups the points tell apart, for a mesh of `points`.
    #[must_use]
    pub fn groups(&self, points: usize) -> usize {
        self.weights.len() / points.max(1)
    }

    /// Where the spheres are in a pose, root frame, metres. `bone_rotations` are those of
    /// [`super::Model::bone_rotations_of`], `bone_of_point` the points' bones.
    ///
    /// # Panics
    /// If an anchor or its bone lies outside the slices.
    #[must_use]
    pub fn centres(
        &self,
        positions: &[Vec3],
        bone_of_point: &[u16],
        bone_rotations: &[Quat],
    ) -> Vec<Vec3> {
        let spheres = self.anchors.as_chunks::<ANCHORS>().0.iter().zip(self.offsets.as_chunks().0);
        spheres
            .map(|(anchors, &offset)| {
                let sum: Vec3 = anchors.iter().map(|&point| positions[point as usize]).sum();
                let bone = usize::from(bone_of_point[anchors[0] as usize]);
                sum / ANCHORS as f32 + bone_rotations[bone].normalize() * Vec3::from_array(offset)
            })
            .collect()
    }

    /// Checks lengths, indices and numbers against the sizes of a model; gives the groups.
    pub(super) fn check(&self, points: usize, bones: usize) -> Result<usize, Error> {
        let spheres = self.spheres();
        within("occluders", spheres as u64, limits::OCCLUDERS)?;
        let groups = self.groups(points);
        within("groups of occluders", groups as u64, limits::OCCLUDER_GROUPS)?;
        for (name, found, expected) in [
            ("occluder.anchors", self.anchors.len(), spheres * ANCHORS),
            ("occluder.offsets", self.offsets.len(), spheres * 3),
            ("occluder.group_of", self.group_of.len(), spheres * bones),
            ("occluder.weights", self.weights.len(), points * groups),
        ] {
            if found != expected {
                return Err(Error::Length { what: name.to_owned(), found, expected });
            }
        }
        check_finite("occluder.offsets", &self.offsets)?;
        check_finite("occluder.radii", &self.radii)?;
        check_finite("occluder.weights", &self.weights)?;
        if let Some(sphere) = self.radii.iter().position(|&radius| radius <= 0.0) {
            let problem = format!("{} of sphere {sphere} is no radius", self.radii[sphere]);
            return Err(field("occluder.radii", problem));
        }
        let out_of = |what: &str, found: u64, count: usize| Error::OutOfRange {
            what: what.to_owned(),
            found,
            count: count as u64,
        };
        if let Some(&point) = self.anchors.iter().find(|&&point| point as usize >= points) {
            return Err(out_of("an anchor of an occluder", u64::from(point), points));
        }
        if let Some(&group) = self.group_of.iter().find(|&&group| usize::from(group) >= groups) {
            return Err(out_of("a group of an occluder", u64::from(group), groups));
        }
        Ok(groups)
    }
}

#[cfg(test)]
mod tests;
