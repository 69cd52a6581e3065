//! What a refinement would cost, before it is begun.

use crate::bake::subdivide::ErrorMeasure;
use crate::pipeline::{Error, Job};

use super::{Refinement, settings};

/// Wall time of the calibration, seconds.
const CALIBRATION_S: f64 = 0.5;

/// Triangles over those of the scene that a plan counts with where an error alone ends the refinement.
const SUPPOSED_GROWTH: u64 = 16;

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

/// Plans a refinement; a short calibration casts a few of its rays.
///
/// # Errors
/// What the bake objects to.
pub fn plan_subdivision(job: &Job, refinement: &Refinement) -> Result<SubdivisionPlan, Error> {
    let (_, vertices) = new_vertices(job, refinement);
    let views = job.poses.covering(refinement.key_poses).len();
    let baker = job.baker(&job.checked.bake, None)?;
    let posed = job.traced(0);
    let speed = baker.calibrate(&crate::pipeline::bake::posed(job, 0, &posed), CALIBRATION_S)?;
    let points = job.poses.points.count() as u64 + vertices;
    let rays = points * views as u64 * baker.rays_per_point() as u64;
    Ok(SubdivisionPlan { vertices, views, rays, bake_s: rays as f64 / speed.rays_per_s })
}

/// Vertices that a refinement adds at most, and that it bakes at most.
fn new_vertices(job: &Job, refinement: &Refinement) -> (u64, u64) {
    let mesh = &job.scene.mesh;
    let triangles = mesh.triangles.len() as u64;
    let goal = &refinement.goal;
    let room = (goal.vertices as u64).saturating_sub(mesh.positions.len() as u64);
    let wanted = match goal.triangles as u64 {
        most if most < triangles * SUPPOSED_GROWTH || room < triangles * SUPPOSED_GROWTH => most,
        _ if goal.error > 0.0 => triangles * SUPPOSED_GROWTH,
        most => most,
    };
    // Half as many vertices as triangles, and of an edge each in the measure that looks at middles;
    // a seam has them twice.
    let added = wanted.saturating_sub(triangles).div_ceil(2).min(room);
    let ahead = match refinement.measure {
        ErrorMeasure::Surplus => triangles * 3 / 2,
        ErrorMeasure::Midpoint => triangles * 3 / 2 + added.saturating_mul(3),
        _ => 0,
    };
    (added, added.max(ahead))
}

/// What refining adds to a job that is to be refined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::pipeline) struct Growth {
    /// Points of the refined mesh over those of the scene, about.
    pub(in crate::pipeline) factor: f64,
    /// Rays of the refinement itself.
    pub(in crate::pipeline) rays: u64,
}

/// How a job's mesh grows where its recipe refines it.
pub(in crate::pipeline) fn growth(job: &Job) -> Result<Option<Growth>, Error> {
    let Some(recipe) = job.recipe.subdivide.as_ref().filter(|_| job.is_to_be_refined()) else {
        return Ok(None);
    };
    let refinement = Refinement::of(job, recipe)?;
    let (added, baked) = new_vertices(job, &refinement);
    let points = job.poses.points.count() as u64;
    let views = job.poses.covering(refinement.key_poses).len() as u64;
    let rays_each = u64::from(settings::direct(&job.recipe).bake.rays);
    let factor = (points + added) as f64 / points.max(1) as f64;
    Ok(Some(Growth { factor, rays: (points + baked) * views * rays_each }))
}
