//! Occluders: spheres that the mesh carries along, and what groups of them block at each point.
//!
//! The point features of the family `occluder`. A sphere q has anchors, a few points
//! of the mesh whose mean the pose carries, an offset o_q that turns with the anchors' bone, and a
//! radius r_q: its centre is mean(anchors) + Q·o_q. Which group a sphere counts for depends on the
//! bone of the point that it is seen from, so that a point's own limb is a group of its own.
//! What is blocked at point v is Σ_g weight\[v, g\] Σ_{q in g} ψ_q(v). Either ψ is the cap that a
//! sphere fills, in closed form ([`caps`]): quick, and counted twice where one hides another. Or the
//! proxies are ellipsoids, and ψ what each takes of a number of directions that those before it have
//! left ([`sky`]): their union.
//!
//! *Invariant:* everything in [`Occluders`] has been checked against its model.

pub mod caps;
mod evaluate;
pub mod sky;
mod union;

use glam::{Mat3, Quat, Vec3};
use serde::{Deserialize, Serialize};

pub(super) use evaluate::Seen;
pub use evaluate::add;

use sky::Ellipsoid;

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
    /// Directions in which their union is looked at; 0 for the sum of their caps.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub directions: u32,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_zero(count: &u32) -> bool {
    *count == 0
}

/// The numbers of the occluders, in plain row order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Occluders {
    /// `[sphere, ANCHORS]`, indices of points.
    pub anchors: Vec<u32>,
    /// `[sphere, 3]`: from the mean of the anchors to the centre, metres, at rest, in the axes of
    /// the root frame; turns with the bone of the first anchor.
    pub offsets: Vec<f32>,
    /// `[sphere]`, metres; of an ellipsoid, of the ball around it.
    pub radii: Vec<f32>,
    /// `[sphere, 6]`, 1/metres: xx, yy, zz, yz, xz, xy of the symmetric matrix that makes it the unit
    /// ball, at rest, in the axes of the root frame; turns with the bone of the first anchor. Empty
    /// for spheres.
    pub shapes: Vec<f32>,
    /// Directions in which the union of ellipsoids is looked at, a multiple of [`caps::LANES`]; 0 for
    /// the sum of spheres.
    pub directions: usize,
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
    /// Unit tangents at right angles to the normals; only looked at where the model's frame is the
    /// tangent frame, and empty else.
    pub tangents: &'a [Vec3],
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
                // From one of them: sums of places round by more than their differences do.
                let first = positions[anchors[0] as usize];
                let sum: Vec3 =
                    anchors.iter().map(|&point| positions[point as usize] - first).sum();
                let bone = usize::from(bone_of_point[anchors[0] as usize]);
                let offset = bone_rotations[bone].normalize() * Vec3::from_array(offset);
                first + (sum / ANCHORS as f32 + offset)
            })
            .collect()
    }

    /// The ellipsoids in a pose, root frame: [`centres`](Self::centres) with their shapes. None for
    /// spheres.
    ///
    /// # Panics
    /// As `centres`.
    #[must_use]
    pub fn ellipsoids(
        &self,
        positions: &[Vec3],
        bone_of_point: &[u16],
        bone_rotations: &[Quat],
    ) -> Vec<Ellipsoid> {
        if self.shapes.is_empty() {
            return Vec::new();
        }
        let centres = self.centres(positions, bone_of_point, bone_rotations);
        let shapes = self.shapes.as_chunks::<6>().0.iter().zip(self.anchors.chunks(ANCHORS));
        centres
            .into_iter()
            .zip(shapes)
            .zip(&self.radii)
            .map(|((centre, (&shape, anchors)), &radius)| {
                let bone = usize::from(bone_of_point[anchors[0] as usize]);
                let turn = Mat3::from_quat(bone_rotations[bone].normalize());
                Ellipsoid { centre, shape: turn * symmetric(shape) * turn.transpose(), radius }
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
            (
                "occluder.shapes",
                self.shapes.len(),
                if self.directions > 0 { spheres * 6 } else { 0 },
            ),
            ("occluder.group_of", self.group_of.len(), spheres * bones),
            ("occluder.weights", self.weights.len(), points * groups),
        ] {
            if found != expected {
                return Err(Error::Length { what: name.to_owned(), found, expected });
            }
        }
        check_finite("occluder.offsets", &self.offsets)?;
        check_finite("occluder.radii", &self.radii)?;
        check_finite("occluder.shapes", &self.shapes)?;
        check_finite("occluder.weights", &self.weights)?;
        self.check_union()?;
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

    fn check_union(&self) -> Result<(), Error> {
        within("directions of occluders", self.directions as u64, limits::OCCLUDER_DIRECTIONS)?;
        if !self.directions.is_multiple_of(caps::LANES) {
            let problem = format!("{} is no multiple of {}", self.directions, caps::LANES);
            return Err(field("occluders.directions", problem));
        }
        let flat = |&shape: &[f32; 6]| {
            let m = symmetric(shape);
            let minor = m.x_axis.x * m.y_axis.y - m.x_axis.y * m.y_axis.x;
            !(m.x_axis.x > 0.0 && minor > 0.0 && m.determinant() > 0.0)
        };
        match self.shapes.as_chunks().0.iter().position(flat) {
            Some(sphere) => {
                let problem = format!("the matrix of ellipsoid {sphere} is not positive definite");
                Err(field("occluder.shapes", problem))
            }
            None => Ok(()),
        }
    }
}

/// The matrix of xx, yy, zz, yz, xz, xy.
fn symmetric([xx, yy, zz, yz, xz, xy]: [f32; 6]) -> Mat3 {
    Mat3::from_cols_array_2d(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
}

#[cfg(test)]
mod tests;
