//! A posed mesh from any place of whose surface rays can start.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::posed::Posed;
use super::sites::Site;
use super::surroundings::NO_POINT;
use super::{BakedPose, Baker, Error, PosedMesh};

/// A fixed place of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Which of the baker's triangles.
    pub triangle: u32,
    /// Weights of its corners, which sum to 1.
    pub weights: [f32; 3],
}

/// One pose with its trees built, for any number of places. See [`Baker::stand`].
#[derive(Debug)]
pub struct Standing<'a> {
    baker: &'a Baker,
    posed: Posed,
    positions: Vec<Vec3>,
}

/// The signal at places of one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    /// As of points.
    pub baked: BakedPose,
    /// `[place]` The unit shading normals.
    pub normals: Vec<Vec3>,
}

impl Baker {
    /// Makes one pose ready for rays from anywhere on its surface. Direct light alone: bounces, a
    /// target noise, a vertex fit and what travels below the surface are left out.
    ///
    /// # Errors
    /// A pose of another shape or with a vertex that is not finite, a tracer that fails.
    pub fn stand(&self, pose: usize, mesh: &PosedMesh<'_>) -> Result<Standing<'_>, Error> {
        let posed = Posed::new(&self.stage, pose, mesh)?;
        Ok(Standing { baker: self, posed, positions: mesh.positions.to_vec() })
    }
}

impl Standing<'_> {
    /// The signal at some places with their numbers in random streams: what a place gets depends on its
    /// number and on nothing else of the call.
    ///
    /// # Errors
    /// [`Error::Triangle`] for a triangle that does not exist or belongs to what only blocks;
    /// [`Error::Cancelled`].
    ///
    /// # Panics
    /// If there are not as many numbers as places.
    pub fn bake(
        &self,
        places: &[Place],
        numbers: &[u64],
        cancelled: &AtomicBool,
    ) -> Result<Sampled, Error> {
        assert_eq!(numbers.len(), places.len(), "numbers");
        let stage = &self.baker.stage;
        let vertices = stage.points.of_vertex.len();
        for place in places {
            let corners = stage.triangles.get(place.triangle as usize);
            let lit = |&vertex: &u32| stage.points.of_vertex[vertex as usize] != NO_POINT;
            if !corners.is_some_and(|corners| corners.iter().all(lit)) {
                let triangle = place.triangle as usize;
                return Err(Error::Triangle { triangle, vertex: NO_POINT, vertices });
            }
        }
        let site = |&Place { triangle, weights }: &Place| Site { triangle, weights, area: 1.0 };
        let sites: Vec<Site> = places.iter().map(site).collect();
        let mut posed = self.posed.at_sites(stage, &self.positions, &sites);
        posed.numbers = numbers.to_vec();
        let normals = posed.normals.clone();
        let mut baked = self.baker.trace(std::slice::from_ref(&posed), cancelled)?;
        let baked = baked.pop().ok_or(Error::Cancelled)?;
        Ok(Sampled { baked, normals })
    }
}
