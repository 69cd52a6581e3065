//! What a bake would cost, before a ray is cast in earnest.

use serde_json::{Value, json};

use super::reference::{rays_per_point, reference_rays};
use super::subdivide::{Growth, growth};
use super::{Error, Job, describe, notices, reference_notice, rounds, subset};
use crate::bake::Baker;
use crate::dataset::Layout;

/// The cost of a bake.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// Poses in all splits.
    pub poses: usize,
    /// Merged vertices.
    pub points: usize,
    /// Rays cast at each point and pose; with a target noise the most.
    pub rays_per_point: u32,
    /// Rays over all points and poses.
    pub rays: u64,
    /// Bytes of the data set's arrays on disk.
    pub disk_bytes: u64,
    /// Peak memory: the scene, its sampled poses, trees, rays, and the blocks that are baked, queued
    /// and written.
    pub memory_bytes: u64,
    /// Rays per second of a short calibration on this scene, all threads.
    pub rays_per_s: f64,
    /// Wall time, seconds.
    pub bake_s: f64,
    /// Rays of the references that measure a model, over and above `rays`.
    pub reference_rays: u64,
    /// Wall time of baking them, seconds.
    pub reference_s: f64,
    /// Bytes of the references on disk, over and above `disk_bytes`.
    pub reference_bytes: u64,
    /// Rays that refining the mesh casts first; 0 where it is not refined, or is already. Where it is,
    /// the other numbers are of as many points as the refined mesh has at most.
    pub refine_rays: u64,
    /// Wall time of refining, seconds.
    pub refine_s: f64,
}

impl Plan {
    /// Every number under the name of its field.
    #[must_use]
    pub fn figures(&self) -> Value {
        json!({
            "poses": self.poses,
            "points": self.points,
            "rays_per_point": self.rays_per_point,
            "rays": self.rays,
            "disk_bytes": self.disk_bytes,
            "memory_bytes": self.memory_bytes,
            "rays_per_s": self.rays_per_s,
            "bake_s": self.bake_s,
            "reference_rays": self.reference_rays,
            "reference_s": self.reference_s,
            "reference_bytes": self.reference_bytes,
            "refine_rays": self.refine_rays,
            "refine_s": self.refine_s,
        })
    }

    /// As many numbers more as there are points.
    fn grown(self, growth: Growth) -> Self {
        let times = |number: u64| times(number, growth.factor);
        Self {
            points: times(self.points as u64) as usize,
            rays: times(self.rays),
            disk_bytes: times(self.disk_bytes),
            memory_bytes: times(self.memory_bytes),
            bake_s: self.bake_s * growth.factor,
            reference_rays: times(self.reference_rays),
            reference_s: self.reference_s * growth.factor,
            reference_bytes: times(self.reference_bytes),
            refine_rays: growth.rays,
            refine_s: growth.rays as f64 / self.rays_per_s,
            ..self
        }
    }

    /// What the job's user should know beside the numbers.
    #[must_use]
    pub fn notices(&self, job: &Job) -> Vec<String> {
        let short = reference_notice(&job.recipe.bake, job.checked.reference);
        notices(job).into_iter().chain(short).collect()
    }

    /// The numbers with the job's notices and hashes: what the command line and the service answer.
    #[must_use]
    pub fn document(&self, job: &Job) -> Value {
        let mut document = self.figures();
        document["notices"] = json!(self.notices(job));
        let hashes = &job.hashes;
        document["hashes"] =
            json!({ "scene": hashes.scene, "bake": hashes.bake, "fit": hashes.fit });
        document
    }
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
    let plan = plan_mesh(job)?;
    Ok(growth(job)?.map_or(plan, |growth| plan.grown(growth)))
}

/// The plan of a job's mesh as it is.
fn plan_mesh(job: &Job) -> Result<Plan, Error> {
    let layout = describe::header(job)?.layout;
    let bakers = rounds::bakers(job)?;
    let first = job.traced(0);
    let posed = super::bake::posed(job, 0, &first);
    let calibration = bakers[0].calibrate(&posed, CALIBRATION_S)?;
    let points = layout.poses as f64 * layout.points as f64;
    let mut per_point = calibration.rays_per_point;
    for round in &bakers[1..] {
        per_point += round.calibrate(&posed, 0.0)?.rays_per_point;
    }
    let rays = (points * per_point).round() as u64;
    let scene_bytes = scene_bytes(job);
    let threads = rayon::current_num_threads();
    let prepare_s = calibration.prepare_s * layout.poses as f64 / threads as f64;
    let reference_bakes = 2 * reference_poses(job) as u64;
    let times = f64::from(reference_rays(&job.recipe.bake, job.checked.reference.factor))
        / f64::from(rays_per_point(&job.recipe.bake));
    let per_point = times * per_point;
    let reference_rays =
        ((reference_bakes * layout.points as u64) as f64 * per_point).round() as u64;
    Ok(Plan {
        rays_per_point: rays_per_point(&job.recipe.bake),
        reference_bytes: reference_bytes(job, &layout),
        reference_rays,
        reference_s: reference_rays as f64 / calibration.rays_per_s,
        poses: layout.poses,
        points: layout.points,
        rays,
        disk_bytes: layout.disk_bytes() + scene_bytes,
        memory_bytes: peak(job, &bakers, &layout),
        rays_per_s: calibration.rays_per_s,
        bake_s: prepare_s + rays as f64 / calibration.rays_per_s,
        refine_rays: 0,
        refine_s: 0.0,
    })
}

/// What a job's bake takes at its peak, without casting a ray.
///
/// # Errors
/// What the stages object to.
pub fn memory_bytes(job: &Job) -> Result<u64, Error> {
    let bytes = peak(job, &rounds::bakers(job)?, &describe::header(job)?.layout);
    Ok(growth(job)?.map_or(bytes, |growth| times(bytes, growth.factor)))
}

/// What a job writes: the data set and, where it is measured, its references.
///
/// # Errors
/// What the stages object to.
pub fn disk_bytes(job: &Job, measured: bool) -> Result<u64, Error> {
    let layout = describe::header(job)?.layout;
    let references = if measured { reference_bytes(job, &layout) } else { 0 };
    let bytes = layout.disk_bytes() + scene_bytes(job) + references;
    Ok(growth(job)?.map_or(bytes, |growth| times(bytes, growth.factor)))
}

fn times(number: u64, factor: f64) -> u64 {
    (number as f64 * factor).round() as u64
}

fn reference_bytes(job: &Job, layout: &Layout) -> u64 {
    let bakes = 2 * reference_poses(job) as u64;
    let normals_bytes = layout.points as u64 * 12 * bakes / 2;
    bakes * layout.points as u64 * (layout.row() as u64 + 1) * 4 + normals_bytes
}

fn peak(job: &Job, bakers: &[Baker], layout: &Layout) -> u64 {
    let pose_bytes = layout.points as u64 * (layout.row() as u64 + 2) * 4;
    let block_bytes = pose_bytes * layout.block_poses as u64;
    let posed_bytes = job.scene.mesh.positions.len() as u64 * 24 * layout.block_poses as u64;
    let of = |baker: &Baker| baker.memory_bytes(layout.block_poses, rayon::current_num_threads());
    let tables: u64 = bakers.iter().map(Baker::table_bytes).sum();
    tables
        + bakers.iter().map(|baker| of(baker) - baker.table_bytes()).max().unwrap_or_default()
        + block_bytes * BLOCKS_IN_FLIGHT
        + posed_bytes
        + sampled_bytes(job)
        + scene_bytes(job)
}

fn scene_bytes(job: &Job) -> u64 {
    job.scene.sources.iter().map(|source| source.bytes.len() as u64).sum()
}

/// Bytes of the sampled poses, which all stay in memory.
fn sampled_bytes(job: &Job) -> u64 {
    let Some(first) = job.poses.samples.first() else { return 0 };
    let sample = size_of_val(first)
        + size_of_val(&*first.pose.local)
        + size_of_val(&*first.pose.weights)
        + size_of_val(&*first.bone_rotations);
    (job.poses.samples.len() * sample + size_of_val(&*job.poses.parameters)) as u64
}

/// Poses that both references bake.
fn reference_poses(job: &Job) -> usize {
    let samples = &job.poses.samples;
    let splits: Vec<u8> = samples.iter().map(|sample| sample.split as u8).collect();
    let clips: Vec<i32> = samples.iter().map(|sample| sample.clip as i32).collect();
    let settings = job.checked.reference;
    subset::choose(&splits, &clips, settings.poses, job.recipe.bake.seed).len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::recipe::Recipe;
    use crate::scene::figure::figure;

    fn plan_at(rate_hz: f32) -> Plan {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("figure.glb");
        std::fs::write(&path, figure()).expect("written");
        let mut recipe = Recipe::default();
        recipe.poses.rate_hz = rate_hz;
        recipe.poses.near_repeat = 0.0;
        recipe.bake.rays = 16;
        plan(&Job::open(&path, recipe).expect("a job")).expect("a plan")
    }

    /// Rays are poses × points × rays; memory grows with the poses by what their samples hold and
    /// by nothing else; references cost at least 8 times the rays, twice, on every pose they cover.
    #[test]
    fn a_plan_counts_what_a_run_will_use() {
        let (few, many) = (plan_at(4.0), plan_at(40.0));
        assert_eq!(many.rays, (many.poses * many.points * 16) as u64);
        assert!(many.poses > 8 * few.poses, "{} and {}", many.poses, few.poses);
        let added = many.memory_bytes - few.memory_bytes;
        let per_pose = added / (many.poses - few.poses) as u64;
        assert!((500..8_000).contains(&per_pose), "{per_pose} bytes a pose");
        assert_eq!(few.reference_rays, 16 * few.rays, "all poses of so few are covered");
        let per_pose = (few.points * (2 * (36 + 1) + 3) * 4) as u64;
        assert_eq!(few.reference_bytes, few.poses as u64 * per_pose);
        assert!(many.reference_rays < 16 * many.rays);
    }
}
