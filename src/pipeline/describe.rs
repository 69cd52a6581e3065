//! A job as the data set describes it: header and tables.

use std::collections::BTreeMap;

use glam::Vec3;

use super::{Error, Job};
use crate::dataset::{Attributes, Header, Layout, PartRange, PoseTable, RestMesh, Static};
use crate::model::RigHeader;
use crate::pose::{PoseSet, Sample};
use crate::rig::{self, Deformed, Pose, RigidFrame};

/// Bytes that one chunk file aims at: large enough to write well, small enough that little work is
/// lost with it.
const BLOCK_BYTES: usize = 16 << 20;

/// Poses per block at most, so that small meshes commit often too.
const MOST_BLOCK_POSES: usize = 64;

/// Sizes and descriptions of the job's data set.
///
/// # Errors
/// If the rig cannot be written as JSON, which is a bug.
pub(super) fn header(job: &Job) -> Result<Header, Error> {
    let poses = &job.poses;
    let coefficients = job.checked.bake.signal.coefficients(job.checked.bake.order);
    let channels = job.channels();
    let pose_bytes = poses.points.count() * channels * coefficients * size_of::<f32>();
    let layout = Layout {
        poses: poses.samples.len(),
        points: poses.points.count(),
        vertices: job.scene.mesh.positions.len(),
        triangles: job.scene.mesh.triangles.len(),
        channels,
        coefficients,
        parameters: poses.parametrisation.columns.len(),
        bones: poses.bones.nodes.len(),
        block_poses: (BLOCK_BYTES / pose_bytes.max(1)).clamp(1, MOST_BLOCK_POSES),
    };
    layout.check()?;
    let columns = &poses.parametrisation.columns;
    let attributes = Attributes {
        recipe: json("the recipe", &job.recipe)?,
        hashes: BTreeMap::from([
            ("scene".to_owned(), job.hashes.scene.clone()),
            ("bake".to_owned(), job.hashes.bake.clone()),
        ]),
        signal: job.checked.bake.signal.name().to_owned(),
        order: job.recipe.bake.order,
        clip_names: poses.clip_names.clone(),
        parameter_names: columns.iter().map(|column| column.name.clone()).collect(),
        rig: json("the rig", &rig_header(job))?,
        parts: PartRange::of(&job.scene.mesh, &job.scene.skeleton),
        lineage: Vec::new(),
    };
    Ok(Header { layout, attributes })
}

/// What turns a tool's joint rotations into parameters and bone rotations.
pub(super) fn rig_header(job: &Job) -> RigHeader {
    let PoseSet { parametrisation, bones, root_node, root_motion, .. } = &job.poses;
    let mesh = &job.scene.mesh;
    RigHeader::new(
        &job.scene.skeleton,
        (*root_node, *root_motion),
        bones,
        parametrisation,
        &mesh.weight_names,
        &mesh.default_weights,
    )
}

/// Everything of the data set but the baked blocks.
#[must_use]
pub(super) fn tables(job: &Job) -> Static {
    let samples = &job.poses.samples;
    let clips = job.poses.clip_names.len();
    let clip = |sample: &Sample| if sample.clip < clips { sample.clip as i32 } else { -1 };
    Static {
        poses: PoseTable {
            parameters: job.poses.parameters.clone(),
            clips: samples.iter().map(clip).collect(),
            times_s: samples.iter().map(|sample| sample.time_s).collect(),
            splits: samples.iter().map(|sample| sample.split as u8).collect(),
            roots: samples.iter().map(|sample| sample.root).collect(),
            bone_rotations: samples.iter().flat_map(|s| s.bone_rotations.clone()).collect(),
        },
        mesh: rest_mesh(job),
        sources: [&job.scene.sources, job.occluders.sources(), job.receivers.sources()].concat(),
    }
}

fn rest_mesh(job: &Job) -> RestMesh {
    let mesh = &job.scene.mesh;
    let rest = Pose::rest(&job.scene.skeleton, &mesh.default_weights);
    let globals = job.scene.skeleton.globals(&rest.local);
    let mut deformed = Deformed::default();
    rig::deform(mesh, &globals, &rest.weights, RigidFrame::IDENTITY, &mut deformed);
    RestMesh {
        positions: deformed.positions,
        normals: deformed.normals.into_iter().map(Vec3::normalize_or_zero).collect(),
        triangles: mesh.triangles.clone(),
        point_of_vertex: job.poses.points.of_vertex.clone(),
        vertex_of_point: job.poses.points.vertex.clone(),
        bone_of_point: job.poses.bones.of_point.clone(),
    }
}

fn json(what: &str, value: &impl serde::Serialize) -> Result<serde_json::Value, Error> {
    serde_json::to_value(value).map_err(|source| Error::Json { what: what.to_owned(), source })
}
