//! Rank 8. Rays to signals at the points of a posed mesh.
//!
//! A [`Baker`] is made once per mesh and settings and then turns posed meshes into coefficients.
//! What happens at a point: a hash of (seed, point, clip, time) picks a set of directions and an
//! azimuth; the set is turned about the normal and traced as one block; the rows of the set's
//! table of spherical harmonics that belong to blocked rays are summed in the point's own frame,
//! and the sum is rotated to the root frame once.
//!
//! *Invariant:* what a point gets depends on nothing but its pose, the settings and its own
//! number: not on threads, chunks, waves or the other poses of a call.
//! *Invariant:* only what is blocked is estimated; the unoccluded part is analytic. So a point
//! that nothing blocks is exact, and its noise is 0.

mod adaptive;
mod allocate;
mod baker;
mod borders;
mod bounce;
mod buried;
mod cost;
mod diffusion;
mod error;
mod falloff;
mod ground;
mod kernel;
mod least_squares;
mod openings;
mod plan;
mod posed;
mod seen;
mod sites;
mod skin;
mod standing;
pub mod subdivide;
mod subsurface;
mod sums;
mod surroundings;
mod trial;

pub use adaptive::{gain, most_to_noise};
pub use baker::Baker;
pub use bounce::{MOST_BOUNCES, Reflectance};
pub use cost::Calibration;
pub use error::Error;
pub use openings::Openings;
pub use plan::rays_cast;
pub use standing::{Place, Sampled, Standing};
pub use subsurface::Subsurface;
pub use surroundings::{NO_POINT, Surroundings, View};

pub use crate::model::Signal;

use glam::Vec3;

use crate::sh::Order;

/// The most samples per vertex of a least-squares vertex fit.
pub const MOST_SITES: u32 = 1024;

/// The most rays per point that may be asked for.
pub const MOST_RAYS: u32 = 1_000_000;

/// A noise that decides how many rays there are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard error, in the unit of [`BakedPose::noise`].
    pub target: f32,
    /// Whose.
    pub goal: NoiseGoal,
}

/// What a target noise is meant for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseGoal {
    /// No point's is larger, as far as can be told beforehand.
    Each,
    /// The root mean square over the points of each pose is not larger; the least rays in all.
    Mean,
}

/// What to bake and how well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The signal.
    pub signal: Signal,
    /// Bands of spherical harmonics, 1 to 10; ignored by [`Signal::Ao`].
    pub order: Order,
    /// Rays per point, 1 to [`MOST_RAYS`]. Rounded up to an even number, and above 2,048 to equal
    /// even blocks of at most that; [`BakedPose::rays`] says what was traced.
    pub rays: u32,
    /// Metres beyond which nothing blocks; `None`: no limit.
    pub max_distance_m: Option<f32>,
    /// Picks all random numbers.
    pub seed: u64,
}

/// One pose of the mesh.
#[derive(Debug, Clone, Copy)]
pub struct PosedMesh<'a> {
    /// Root frame, metres, one per vertex.
    pub positions: &'a [Vec3],
    /// Shading normals, one per vertex; they need not be unit. Where one is zero or not finite,
    /// the normal of the adjoining triangles takes its place, and +Y where there is none.
    pub normals: &'a [Vec3],
    /// A hash of the clip's name.
    pub clip_key: u64,
    /// Time within the clip; its bits pick random numbers.
    pub time_s: f32,
}

/// The signal of one pose at every point.
#[derive(Debug, Clone, PartialEq)]
pub struct BakedPose {
    /// `[point, channel, coefficient]`, root frame, one channel unless surfaces reflect colours.
    pub coefficients: Vec<f32>,
    /// `[point]` Standard error of the coefficients, pooled: the root mean square over the
    /// coefficients of each one's standard error from the independent batches (two for each block
    /// of at most 2,048 rays). With B batches each coefficient brings B − 1 degrees of freedom; the
    /// coefficients of a point are correlated, so a single point's figure from two batches scatters
    /// by tens of per cent and should be averaged (in squares) over neighbours or poses.
    pub noise: Vec<f32>,
    /// `[point]` Rays traced.
    pub rays: Vec<u32>,
}

#[cfg(test)]
mod tests;
