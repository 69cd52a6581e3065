//! What a refinement would cost, before it is begun.

use crate::bake::subdivide::ErrorMeasure;
use crate::pipeline::{Error, Job};

use super::truth::PROBE_RAYS;
use super::{Refinement, settings};

/// Wall time of the calibration, seconds.
const CALIBRATION_S: f64 = 0.5;

/// What a refinement takes, about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubdivisionPlan {
    /// New vertices that are baked.
    pub vertices: u64,
    /// Key poses.
    pub views: usize,
    /// Rays over all of them, the input's vertices and the probes included.
    pub rays: u64,
    /// Wall time, seconds.
    pub bake_s: f64,
}

/// Plans a refinement and so many probes; a short calibration casts a few of its rays.
///
/// # Errors
/// As [`super::subdivide()`].
pub fn plan_subdivision(
    job: &Job,
    refinement: &Refinement,
    probes: usize,
) -> Result<SubdivisionPlan, Error> {
    super::direct(job)?;
    let surface = super::surface(job, &super::whole(job)?)?;
    refinement.check_room(surface.triangles.len(), surface.weld.len())?;
    let (_, vertices) = new_vertices(job, refinement);
    let views = job.poses.covering(refinement.key_poses).len();
    let baker = job.baker(&job.checked.bake, None)?;
    let posed = job.traced(0);
    let speed = baker.calibrate(&crate::pipeline::bake::posed(job, 0, &posed), CALIBRATION_S)?;
    // Probes are compared with interpolation between given vertices, which are baked for that too.
    let given = job.poses.points.count() as u64 * if probes > 0 { 2 } else { 1 };
    let points = given + vertices + probes as u64 * u64::from(PROBE_RAYS);
    let rays = points * views as u64 * baker.rays_per_point() as u64;
    Ok(SubdivisionPlan { vertices, views, rays, bake_s: rays as f64 / speed.rays_per_s })
}

/// Vertices that a refinement adds, and that it bakes.
fn new_vertices(job: &Job, refinement: &Refinement) -> (u64, u64) {
    let mesh = &job.scene.mesh;
    let triangles = mesh.triangles.len() as u64;
    let goal = &refinement.goal;
    let room = (goal.vertices as u64).saturating_sub(mesh.positions.len() as u64);
    // Half as many vertices as triangles, and of an edge each in the measure that looks at middles;
    // a seam has them twice.
    let added = (goal.triangles as u64).saturating_sub(triangles).div_ceil(2).min(room);
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
