//! What every imported scene promises to the stages after it.

use std::collections::BTreeSet;

use poselight::scene::{Interpolation, Scene, Target};

/// Panics where a scene breaks what the documentation of its types says.
pub(crate) fn check(scene: &Scene) {
    check_nodes(scene);
    check_mesh(scene);
    check_morphs(scene);
    check_clips(scene);
}

fn check_nodes(scene: &Scene) {
    let nodes = &scene.skeleton.nodes;
    for (index, node) in nodes.iter().enumerate() {
        assert!(node.parent.is_none_or(|parent| parent < index), "node {index}");
        assert!(node.rest.translation.is_finite() && node.rest.scale.is_finite());
        assert!((node.rest.rotation.length() - 1.0).abs() < 1e-4, "node {index}");
    }
    let names: BTreeSet<&str> = nodes.iter().map(|node| node.name.as_str()).collect();
    assert_eq!(names.len(), nodes.len(), "names differ");
}

fn check_mesh(scene: &Scene) {
    let mesh = &scene.mesh;
    let vertices = mesh.positions.len();
    assert!(mesh.positions.iter().all(|position| position.is_finite()));
    assert_eq!(mesh.normals.len(), vertices);
    assert!(mesh.normals.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-4));
    assert!(!mesh.triangles.is_empty(), "a scene has triangles");
    assert_eq!(mesh.influence_starts.len(), vertices + 1);
    for vertex in 0..vertices {
        let influences = mesh.influences_of(vertex);
        let sum: f32 = influences.iter().map(|influence| influence.weight).sum();
        assert!((sum - 1.0).abs() < 1e-5, "vertex {vertex}: {influences:?}");
        assert!(influences.iter().all(|influence| influence.weight > 0.0));
        assert!(influences.iter().all(|i| (i.deformer as usize) < mesh.deformers.len()));
    }
    let nodes = scene.skeleton.nodes.len();
    assert!(mesh.deformers.iter().all(|deformer| deformer.node < nodes));
    let (mut vertex, mut triangle) = (0, 0);
    for part in &mesh.parts {
        assert!(part.node < nodes);
        assert_eq!((part.vertices.start, part.triangles.start), (vertex, triangle));
        (vertex, triangle) = (part.vertices.end, part.triangles.end);
        let own = &mesh.triangles[part.triangles.clone()];
        assert!(own.iter().flatten().all(|&corner| part.vertices.contains(&(corner as usize))));
    }
    assert_eq!((vertex, triangle), (vertices, mesh.triangles.len()));
}

fn check_morphs(scene: &Scene) {
    let mesh = &scene.mesh;
    assert_eq!(mesh.weight_names.len(), mesh.default_weights.len());
    assert!(mesh.default_weights.iter().all(|weight| weight.is_finite()));
    for morph in &mesh.morphs {
        assert!(morph.weight < mesh.weight_names.len());
        assert!(morph.vertices.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(morph.vertices.iter().all(|&vertex| (vertex as usize) < mesh.positions.len()));
        assert_eq!(morph.vertices.len(), morph.position_deltas.len());
        assert!([0, morph.vertices.len()].contains(&morph.normal_deltas.len()));
        let mut deltas = morph.position_deltas.iter().chain(&morph.normal_deltas);
        assert!(deltas.all(|delta| delta.is_finite()));
    }
}

fn check_clips(scene: &Scene) {
    let names: BTreeSet<&str> = scene.clips.iter().map(|clip| clip.name.as_str()).collect();
    assert_eq!(names.len(), scene.clips.len(), "clip names differ");
    for clip in &scene.clips {
        assert!(!clip.channels.is_empty() && clip.duration_s >= 0.0);
        for channel in &clip.channels {
            let in_bounds = match &channel.target {
                Target::Translation(node) | Target::Rotation(node) | Target::Scale(node) => {
                    *node < scene.skeleton.nodes.len()
                }
                Target::Weights(slots) => slots.end <= scene.mesh.weight_names.len(),
            };
            assert!(in_bounds, "{:?}", channel.target);
            let cubic = channel.interpolation == Interpolation::CubicSpline;
            let per_key = channel.components() * if cubic { 3 } else { 1 };
            assert_eq!(channel.values.len(), channel.times_s.len() * per_key);
            assert!(channel.values.iter().all(|value| value.is_finite()));
            assert!(channel.times_s.first().is_some_and(|first| *first >= 0.0));
            assert!(channel.times_s.windows(2).all(|pair| pair[0] < pair[1]));
            assert!(channel.times_s.iter().all(|&time| time <= clip.duration_s));
        }
    }
}
