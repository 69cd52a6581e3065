//! Data sets are Zarr to others: zarr-python, xarray and `numpy.memmap`, which share no code with
//! this crate, open what the writer made and find every value, name and attribute
//! (`tests/zarr_python.py`). `make test` brings the interpreter; a run without it skips, except
//! where `CI` is set.
#![cfg(feature = "bake")]

#[path = "needs/python.rs"]
mod python;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use glam::{Quat, Vec3};
use poselight::dataset::{
    Attributes, Dataset, Error, Header, Layout, PartRange, PoseData, PoseTable, Reference,
    ReferenceHeader, ReferencePose, RestMesh, Static, Writer,
};
use poselight::rig::RigidFrame;
use poselight::scene::Source;
use serde_json::json;

fn header(layout: Layout) -> Header {
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
            recipe: json!({"version": 1}),
            hashes: BTreeMap::from([(String::from("bake"), String::from("0123"))]),
            signal: String::from("transfer"),
            order: 2,
            clip_names: vec![String::from("walk"), String::from("jump ↑")],
            parameter_names: (0..layout.parameters).map(|i| format!("joint.{i}")).collect(),
            rig: json!({"nodes": []}),
            parts: vec![part],
            lineage: Vec::new(),
        },
    }
}

/// Values that the script computes too.
fn statics(layout: &Layout) -> Static {
    let sequence = |length: usize| (0..length).map(|i| i as f32 * 0.5);
    let rotation = Quat::from_xyzw(0.0, 0.6, 0.0, 0.8);
    let translation = |pose: usize| Vec3::new(pose as f32, 1.0, 2.0);
    let vectors = |length: usize| (0..length).map(|i| Vec3::new(i as f32, 0.25, -1.0)).collect();
    Static {
        poses: PoseTable {
            parameters: sequence(layout.poses * layout.parameters).collect(),
            clips: (0..layout.poses).map(|pose| pose as i32 % 3 - 1).collect(),
            times_s: sequence(layout.poses).collect(),
            splits: (0..layout.poses).map(|pose| pose as u8 % 4).collect(),
            roots: (0..layout.poses)
                .map(|pose| RigidFrame { rotation, translation: translation(pose) })
                .collect(),
            bone_rotations: vec![rotation; layout.poses * layout.bones],
        },
        mesh: RestMesh {
            positions: vectors(layout.vertices),
            normals: vec![Vec3::Y; layout.vertices],
            triangles: (0..layout.triangles as u32).map(|i| [i, i + 1, i + 2]).collect(),
            point_of_vertex: (0..layout.vertices).map(|v| (v % layout.points) as u32).collect(),
            vertex_of_point: (0..layout.points as u32).collect(),
            bone_of_point: (0..layout.points).map(|point| (point % layout.bones) as u16).collect(),
        },
        sources: vec![
            Source { name: String::from("a.glb"), bytes: (0..=255).collect() },
            Source { name: String::from("empty.bin"), bytes: Vec::new() },
        ],
    }
}

fn write(path: &Path, layout: Layout) -> Result<(), Error> {
    let mut writer = Writer::open(path, &header(layout), &statics(&layout))?;
    let per_pose = layout.points * layout.row();
    for block in writer.missing_blocks() {
        let poses: Vec<(Vec<f32>, Vec<f32>, Vec<u32>)> = (layout.poses_of(block))
            .map(|pose| {
                let coefficients = (0..per_pose).map(|i| (pose * per_pose + i) as f32 * 0.125);
                let noise = (0..layout.points).map(|point| (pose + point) as f32 * 0.25);
                (coefficients.collect(), noise.collect(), vec![500 + pose as u32; layout.points])
            })
            .collect();
        let data: Vec<PoseData<'_>> = (poses.iter())
            .map(|(coefficients, noise, rays)| PoseData { coefficients, noise, rays })
            .collect();
        writer.commit(block, &data)?;
    }
    let dataset = Dataset::open(path)?;
    let header = ReferenceHeader {
        poses: vec![0, layout.poses - 1],
        rays: 4000,
        seeds: [1, u64::MAX],
        hash: String::from("45"),
    };
    if layout.poses > 1 {
        let mut reference = Reference::open_or_create(&dataset, &header)?;
        for (seed, index) in reference.missing() {
            let coefficients = vec![(10 * seed + index) as f32; per_pose];
            let (noise, normals) = (vec![0.5; layout.points], vec![Vec3::Z; layout.points]);
            let data =
                ReferencePose { coefficients: &coefficients, noise: &noise, normals: &normals };
            reference.commit(seed, index, &data)?;
        }
    }
    Ok(())
}

/// A data set with a padded last block, one without parameters, and one that is unfinished.
#[test]
fn zarr_python_and_memmap_open_it() {
    let Some(python) = python::with("numpy, xarray, zarr") else { return };
    let folder = tempfile::tempdir().unwrap();
    let layout = Layout {
        poses: 10,
        points: 5,
        vertices: 7,
        triangles: 5,
        channels: 1,
        coefficients: 4,
        parameters: 3,
        bones: 2,
        block_poses: 4,
    };
    let still = Layout { poses: 1, parameters: 0, ..layout };
    write(&folder.path().join("moving"), layout).unwrap();
    write(&folder.path().join("still"), still).unwrap();
    // The one that proto/dataset.md's example opens.
    write(&folder.path().join("figure.zarr"), Layout { poses: 130, ..layout }).unwrap();
    let unfinished = folder.path().join("unfinished");
    drop(Writer::open(&unfinished, &header(layout), &statics(&layout)).unwrap());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/zarr_python.py");
    let output = Command::new(python).arg(script).arg(folder.path()).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stdout));
}
