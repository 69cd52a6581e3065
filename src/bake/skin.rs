//! Where light travels below the surface, and what that makes of a pose.

use std::sync::atomic::AtomicBool;

use super::diffusion::{self, Cloud};
use super::posed::Stage;
use super::{BakedPose, Baker, Error, PosedMesh, Subsurface};

/// A material and the points that are of it.
#[derive(Debug)]
pub(super) struct Skin {
    material: Subsurface,
    /// Ascending; `None` for all.
    points: Option<Vec<u32>>,
}

impl Baker {
    /// The same with light that travels below the surface; bounces come first.
    ///
    /// # Errors
    /// Another signal than transfer, or a material that cannot be.
    pub fn diffusing(mut self, material: Subsurface) -> Result<Self, Error> {
        material.check(self.plan.signal)?;
        self.skin = Some(Skin { material, points: None });
        Ok(self)
    }

    /// The same below the surface of some points alone: all others keep what they have, and pass nothing on.
    ///
    /// # Errors
    /// As [`Self::diffusing`]; a point that does not exist.
    pub fn diffusing_at(self, material: Subsurface, mut points: Vec<u32>) -> Result<Self, Error> {
        points.sort_unstable();
        points.dedup();
        let limit = self.points();
        if let Some(&value) = points.last().filter(|&&point| point as usize >= limit) {
            let (map, key) = ("point of skin", points.len() - 1);
            return Err(Error::Points { map, key, value, limit });
        }
        let mut this = self.diffusing(material)?;
        if let Some(skin) = this.skin.as_mut().filter(|_| points.len() < limit) {
            skin.points = Some(points);
        }
        Ok(this)
    }

    /// A pose with what travels below the surface.
    pub(super) fn diffused(
        &self,
        pose: BakedPose,
        mesh: &PosedMesh<'_>,
        cancelled: &AtomicBool,
    ) -> Result<BakedPose, Error> {
        let Some(skin) = &self.skin else { return Ok(pose) };
        let channels = self.reflectance.as_ref().map_or(1, |reflectance| reflectance.channels);
        skin.diffuse((&self.stage, mesh), pose, channels, cancelled)
    }
}

impl Skin {
    /// Channels that come out where so many go in.
    pub(super) fn channels(&self, channels: usize) -> usize {
        self.material.channels(channels)
    }

    fn diffuse(
        &self,
        (stage, mesh): (&Stage, &PosedMesh<'_>),
        mut pose: BakedPose,
        channels: usize,
        cancelled: &AtomicBool,
    ) -> Result<BakedPose, Error> {
        let cloud = Cloud::new(stage, mesh.positions, mesh.normals);
        let Some(points) = &self.points else {
            return diffusion::diffuse(&self.material, &cloud, &pose, channels, cancelled);
        };
        let width = pose.coefficients.len() / pose.noise.len().max(1);
        let part = points.iter().map(|&point| point as usize);
        let rows = part.clone().flat_map(|p| &pose.coefficients[p * width..(p + 1) * width]);
        let own = BakedPose {
            coefficients: rows.copied().collect(),
            noise: part.clone().map(|p| pose.noise[p]).collect(),
            rays: part.clone().map(|p| pose.rays[p]).collect(),
        };
        let below =
            diffusion::diffuse(&self.material, &cloud.part(points), &own, channels, cancelled)?;
        let count = width / channels;
        let channel = |channel: usize| channel.min(channels - 1) * count;
        let out = self.channels(channels);
        let rows = pose.coefficients.chunks_exact(width);
        let spread = |row: &[f32]| {
            (0..out).flat_map(|c| row[channel(c)..][..count].to_vec()).collect::<Vec<_>>()
        };
        pose.coefficients = rows.flat_map(spread).collect();
        let rows = below.coefficients.chunks_exact(out * count).zip(&below.noise);
        for (point, (row, &noise)) in part.zip(rows) {
            pose.coefficients[point * out * count..][..out * count].copy_from_slice(row);
            pose.noise[point] = noise;
        }
        Ok(pose)
    }
}
