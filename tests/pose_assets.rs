//! Proves on every rigged file of the assets that sampling ends in a sound pose set: finite
//! parameters of the right shape, something to train on, unit rotations, the same set twice, and
//! a root frame in which the root node neither moves nor turns.

#![cfg(feature = "bake")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test")]

#[path = "needs/assets.rs"]
mod assets;

use std::path::Path;

use glam::{Quat, Vec3};
use poselight::pose::{PoseSet, Settings, Split, sample};
use poselight::rig::Pose;
use poselight::scene::{Limits, Scene, import};

#[test]
fn every_rigged_file_samples() {
    let Some(assets) = assets::folder() else { return };
    let mut files = Vec::new();
    for folder in ["rigged", "deform"] {
        let entries = std::fs::read_dir(assets.join(folder)).unwrap();
        files.extend(entries.map(|entry| entry.unwrap().path()));
    }
    files.retain(|path| path.extension().is_some_and(|extension| extension == "glb"));
    files.sort();
    assert!(!files.is_empty());
    for file in files {
        check(&file);
    }
}

fn check(file: &Path) {
    let scene = import(file, &Limits::default()).unwrap();
    let set = sample(&scene, &Settings::default()).unwrap();
    assert_eq!(set, sample(&scene, &Settings::default()).unwrap(), "the same set twice");
    let count = |split| set.samples.iter().filter(|sample| sample.split == split).count();
    let splits = [Split::Training, Split::Novel, Split::Interpolated, Split::WithinClip].map(count);
    let columns = set.parametrisation.columns.len();
    let dropped: usize = set.near_repeats.iter().map(|clip| clip.dropped).sum();
    println!(
        "{}: {} vertices, {} points, {} bones, root {}, {columns} parameters ({} dropped), \
         poses {splits:?}, {dropped} near-repeats",
        file.file_name().unwrap().display(),
        scene.mesh.positions.len(),
        set.points.count(),
        set.bones.nodes.len(),
        set.root_node.map_or("none", |node| &scene.skeleton.nodes[node].name),
        set.parametrisation.dropped.len(),
    );
    assert!(splits[0] > 0, "something to train on");
    assert_eq!(set.parameters.len(), columns * set.samples.len());
    assert!(set.parameters.iter().all(|value| value.is_finite()));
    root_stands_still(&scene, &set);
    for sample in &set.samples {
        let unit = |rotation: &Quat| (rotation.length() - 1.0).abs() < 1e-5;
        assert!(sample.bone_rotations.iter().all(unit) && unit(&sample.root.rotation));
        assert_eq!(sample.bone_rotations.len(), set.bones.nodes.len());
    }
}

/// Seen from the root frame, the root node is where it is at rest and has not turned.
fn root_stands_still(scene: &Scene, set: &PoseSet) {
    let Some(root) = set.root_node else { return };
    let skeleton = &scene.skeleton;
    let rest = Pose::rest(skeleton, &scene.mesh.default_weights);
    let rest_root = skeleton.globals(&rest.local)[root];
    for sample in &set.samples {
        let now = sample.root.inverse() * skeleton.globals(&sample.pose.local)[root];
        let moved = Vec3::from(now.translation - rest_root.translation).length();
        // The scene's coordinates may be larger than the character.
        let reach = set.size_m + sample.root.translation.length();
        assert!(moved < 1e-5 * reach, "moved by {moved} of {reach}");
        let turned = now.matrix3 * rest_root.matrix3.inverse();
        let turned = poselight::rig::nearest_rotation(turned).unwrap_or(Quat::IDENTITY);
        assert!(turned.dot(Quat::IDENTITY).abs() > 1.0 - 1e-6, "turned by {turned}");
    }
}
