//! What a refinement would cost, before it is begun.

use crate::bake::subdivide::ErrorMeasure;
use crate::pipeline::{Error, Job};

use super::Refinement;

/// Wall time of the calibration, seconds.
const CALIBRATION_S: f64 = 0.5;

/// The most that a refinement takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubdivisionPlan {
    /// New vertices that are baked.
    pub vertices: u64,
    /// Key poses.
    pub views: usize,
    /// Rays over all of them, the input's vertices included.
    pub rays: u64,
    /// Wall time, seconds.
    pub bake_s: f64,
}

/// Plans a refinement to a number of triangles; a short calibration casts a few of its rays.
///
/// # Errors
/// What the bake objects to.
pub fn plan_subdivision(job: &Job, refinement: &Refinement) -> Result<SubdivisionPlan, Error> {
    let triangles = job.scene.mesh.triangles.len() as u64;
    let wanted = refinement.goal.triangles.min(1 << 40) as u64;
    // Half as many vertices as triangles, and of an edge each in the measure that looks at middles.
    let first = match refinement.measure {
        ErrorMeasure::Surplus => triangles * 3 / 2,
        ErrorMeasure::Midpoint => wanted.saturating_mul(3) / 2,
        _ => 0,
    };
    let vertices = first.max(wanted.saturating_sub(triangles).div_ceil(2));
    let vertices = vertices.min(refinement.goal.vertices as u64);
    let views = job.poses.covering(refinement.key_poses).len();
    let baker = job.baker(&job.checked.bake, None)?;
    let posed = job.traced(0);
    let speed = baker.calibrate(&crate::pipeline::bake::posed(job, 0, &posed), CALIBRATION_S)?;
    let points = job.poses.points.count() as u64 + vertices;
    let rays = points * views as u64 * baker.rays_per_point() as u64;
    Ok(SubdivisionPlan { vertices, views, rays, bake_s: rays as f64 / speed.rays_per_s })
}
