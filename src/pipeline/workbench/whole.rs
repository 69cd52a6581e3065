//! What a candidate that was tried on some points costs over all of them.

use super::Bench;
use crate::choose::Point;
use crate::fit::{Geometry, Inscribed, Kept, Largest};
use crate::model::{Model, Precision, RestSizes, Signal};
use crate::pipeline::recipe::{DEFAULT_CLUSTER_RETAINED, DEFAULT_GROUPS, FamilyName};
use crate::pipeline::tradeoff::mesh_percent;
use crate::pipeline::{CandidateRecipe, Job};
use crate::sh::Order;

/// What the points of a scene at rest, with what moves them, add to a model.
pub(super) fn rest_bytes(job: &Job) -> u64 {
    let mesh = job.scene.mesh.subset(&job.poses.points.vertex);
    RestSizes::of(&mesh).bytes(mesh.positions.len(), job.scene.skeleton.nodes.len())
}

/// The balls inscribed in the whole mesh of a job, for spheres that some of its points carry.
pub(super) fn inscribed(job: &Job, points: &[u32]) -> Inscribed {
    let geometry = Geometry {
        skeleton: &job.scene.skeleton,
        mesh: &job.scene.mesh,
        points: &job.poses.points,
        bones: &job.poses.bones,
        signal: Signal::Ao,
        order: Order::new(1).expect("order 1 is one"),
        columns: Vec::new(),
        tangents: None,
        poses: Vec::new(),
    };
    Inscribed::of_whole(&geometry, points)
}

/// The largest sizes among candidates.
pub(super) fn largest(candidates: &[CandidateRecipe]) -> Largest {
    let fits = || candidates.iter().map(|candidate| &candidate.recipe.fit);
    let outputs = fits().filter_map(|fit| fit.outputs).max().unwrap_or(0).max(40);
    let default = DEFAULT_CLUSTER_RETAINED;
    let share = fits().filter_map(|fit| fit.retain_outputs).fold(default, f64::max);
    let of_occluders = fits().filter(|fit| fit.family == FamilyName::Occluder);
    let groups = of_occluders.map(|fit| fit.groups.unwrap_or(DEFAULT_GROUPS)).max().unwrap_or(0);
    let cluster_outputs = Kept::Share(share);
    Largest { outputs: outputs as usize, cluster_outputs, groups: groups as usize }
}

impl Bench<'_> {
    /// Sizes as all points would have them, without the mesh at rest.
    pub(super) fn enlarge(&self, point: &mut Point, model: &Model, precision: Precision) {
        let layout = &self.bench.dataset.header().layout;
        let sizes = model.sizes(precision);
        let each = sizes.decoder as f64 / model.numbers().max(1) as f64;
        let fixed = each * model.decoder().numbers_of_poses() as f64;
        let growth = self.bench.ratio - 1.0;
        let decoder = (sizes.decoder as f64 - fixed).max(0.0) * growth;
        let index = if layout.points > 1 << 16 { 4 } else { 2 };
        let map = if layout.vertices == layout.points { 0 } else { index * layout.vertices };
        // Spheres and their groups are as many for all points as for some.
        let weights = model.occluders().map_or(0, |occluders| occluders.weights.len() as u64);
        let rest = (sizes.maps + weights * precision.bytes()) as f64 * growth + map as f64;
        point.bytes += (decoder + rest) as u64;
        point.tensor_bytes += decoder as u64;
        point.multiply_adds = (point.multiply_adds as f64 * self.bench.ratio) as u64;
        point.mesh_percent = mesh_percent(point.tensor_bytes, layout.points * layout.row());
    }
}
