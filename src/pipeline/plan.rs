//! What a bake would cost, before a ray is cast in earnest.

use super::{Error, Job, describe};

/// The cost of a bake.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// Poses in all splits.
    pub poses: usize,
    /// Merged vertices.
    pub points: usize,
    /// Rays over all points and poses.
    pub rays: u64,
    /// Bytes of the data set's arrays on disk.
    pub disk_bytes: u64,
    /// Peak memory: trees, rays, and the blocks that are baked, queued and written.
    pub memory_bytes: u64,
    /// Rays per second of a short calibration on this scene, all threads.
    pub rays_per_s: f64,
    /// Wall time, seconds.
    pub bake_s: f64,
}

/// Blocks in memory at once: one baked, one queued, one written.
const BLOCKS_IN_FLIGHT: u64 = 3;

/// Wall time of the calibration, seconds.
const CALIBRATION_S: f64 = 0.5;

/// Plans a job's bake; a short calibration casts a few of its rays.
///
/// # Errors
/// What the stages object to.
pub fn plan(job: &Job) -> Result<Plan, Error> {
    let layout = describe::header(job)?.layout;
    let baker = job.baker(&job.checked.bake, job.checked.noise)?;
    let first = job.traced(0);
    let posed = super::bake::posed(job, 0, &first);
    let calibration = baker.calibrate(&posed, CALIBRATION_S)?;
    let points = layout.poses as f64 * layout.points as f64;
    let more = job.recipe.bake.more_rays.iter().map(|&rays| f64::from(rays)).sum::<f64>();
    let rays = (points * (calibration.rays_per_point + more)).round() as u64;
    let mesh = &job.scene.mesh;
    let pose_bytes = layout.points as u64 * (layout.row() as u64 + 2) * 4;
    let block_bytes = pose_bytes * layout.block_poses as u64;
    let posed_bytes = mesh.positions.len() as u64 * 24 * layout.block_poses as u64;
    let scene_bytes: u64 = job.scene.sources.iter().map(|s| s.bytes.len() as u64).sum();
    let threads = rayon::current_num_threads();
    let prepare_s = calibration.prepare_s * layout.poses as f64 / threads as f64;
    Ok(Plan {
        poses: layout.poses,
        points: layout.points,
        rays,
        disk_bytes: layout.disk_bytes() + scene_bytes,
        memory_bytes: baker.memory_bytes(layout.block_poses, threads)
            + block_bytes * BLOCKS_IN_FLIGHT
            + posed_bytes
            + scene_bytes,
        rays_per_s: calibration.rays_per_s,
        bake_s: prepare_s + rays as f64 / calibration.rays_per_s,
    })
}
