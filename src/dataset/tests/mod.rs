//! Tests of the whole stage, on a small data set made by a formula.

mod damage;
mod extremes;
pub(super) mod interruption;
mod reference;
mod restart;
mod roundtrip;

use std::collections::BTreeMap;
use std::path::Path;

use glam::{Quat, Vec3};
use serde_json::json;

use super::*;
use crate::rig::RigidFrame;
use crate::scene::Source;

/// 10 poses in blocks of 4, so the last block is padded; order 2.
pub(super) const LAYOUT: Layout = Layout {
    poses: 10,
    points: 5,
    vertices: 6,
    triangles: 4,
    channels: 1,
    coefficients: 4,
    parameters: 3,
    bones: 2,
    block_poses: 4,
};

pub(super) fn header(layout: Layout) -> Header {
    let hashes = BTreeMap::from(["scene", "bake"].map(|key| (key.to_owned(), format!("{key}-1"))));
    let part = PartRange {
        node: String::from("body"),
        mesh: String::from("skin"),
        primitive: 0,
        first_vertex: 0,
        vertices: layout.vertices,
        first_triangle: 0,
        triangles: layout.triangles,
    };
    Header {
        layout,
        attributes: Attributes {
            recipe: json!({"version": 1, "bake": {"rays": 500, "max_distance_m": 0.1}}),
            hashes,
            signal: String::from("transfer"),
            order: 2,
            clip_names: vec![String::from("walk"), String::from("jump")],
            parameter_names: (0..layout.parameters).map(|i| format!("joint{i}.x")).collect(),
            rig: json!({"nodes": [{"name": "hips"}]}),
            parts: vec![part],
            lineage: Vec::new(),
        },
    }
}

pub(super) fn statics(layout: &Layout) -> Static {
    // Exact in every libm, for the golden bytes.
    let rotation = |i: usize| Quat::from_xyzw(0.0, [0.6, -0.6][i % 2], 0.0, 0.8);
    let vertex = |i: usize| Vec3::new(i as f32, 0.5, -1.0);
    let poses = PoseTable {
        parameters: (0..layout.poses * layout.parameters).map(|i| i as f32 * 0.25).collect(),
        clips: (0..layout.poses).map(|pose| i32::from(pose >= 7)).collect(),
        times_s: (0..layout.poses).map(|pose| pose as f32 / 30.0).collect(),
        splits: (0..layout.poses)
            .map(|pose| u8::from(pose >= 7) + 2 * u8::from(pose == 3))
            .collect(),
        roots: (0..layout.poses)
            .map(|pose| RigidFrame { rotation: rotation(pose), translation: vertex(pose) })
            .collect(),
        bone_rotations: (0..layout.poses * layout.bones).map(rotation).collect(),
    };
    let mesh = RestMesh {
        positions: (0..layout.vertices).map(vertex).collect(),
        normals: vec![Vec3::Y; layout.vertices],
        triangles: (0..layout.triangles as u32).map(|i| [i % 4, i % 4 + 1, i % 4 + 2]).collect(),
        point_of_vertex: (0..layout.vertices).map(|i| i.min(layout.points - 1) as u32).collect(),
        vertex_of_point: (0..layout.points as u32).collect(),
        bone_of_point: (0..layout.points).map(|i| (i % layout.bones) as u16).collect(),
    };
    let source = |name: &str, bytes: &[u8]| Source { name: name.to_owned(), bytes: bytes.to_vec() };
    let sources = vec![source("figure.gltf", b"{\"asset\":1}"), source("empty.bin", b"")];
    Static { poses, mesh, sources }
}

/// The value of one coefficient, and a noise and ray count to go with it.
pub(super) fn value(pose: usize, point: usize, coefficient: usize) -> f32 {
    pose as f32 + point as f32 * 0.1 + coefficient as f32 * 0.001
}

pub(super) fn noise(pose: usize, point: usize) -> f32 {
    0.01 + pose as f32 * 0.001 + point as f32 * 0.0001
}

/// One pose as a bake would give it.
pub(super) struct Pose {
    pub(super) coefficients: Vec<f32>,
    noise: Vec<f32>,
    rays: Vec<u32>,
}

pub(super) fn pose(layout: &Layout, pose: usize) -> Pose {
    Pose {
        coefficients: (0..layout.points * layout.row())
            .map(|i| value(pose, i / layout.row(), i % layout.row()))
            .collect(),
        noise: (0..layout.points).map(|point| noise(pose, point)).collect(),
        rays: vec![500; layout.points],
    }
}

pub(super) fn block(layout: &Layout, block: usize) -> Vec<Pose> {
    layout.poses_of(block).map(|index| pose(layout, index)).collect()
}

pub(super) fn borrow(poses: &[Pose]) -> Vec<PoseData<'_>> {
    fn data(pose: &Pose) -> PoseData<'_> {
        PoseData { coefficients: &pose.coefficients, noise: &pose.noise, rays: &pose.rays }
    }
    poses.iter().map(data).collect()
}

/// Creates or continues, and commits every missing block, ascending.
pub(super) fn bake(path: &Path, layout: Layout) -> Result<(), Error> {
    let mut writer = Writer::open(path, &header(layout), &statics(&layout))?;
    let layout = *writer.layout();
    for index in writer.missing_blocks() {
        writer.commit(index, &borrow(&block(&layout, index)))?;
    }
    Ok(())
}

/// A folder in memory where there is one: these tests flush thousands of files.
pub(super) fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

/// Every file below a folder with its bytes.
pub(super) fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().display().to_string();
                files.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    files
}
