//! Tests of rebinding, on the bundled character.

use super::*;
use crate::model::{
    Decoder, FORMAT_VERSION, Family, Frame, Header, Precision, Provenance, RigHeader, Signal,
    TrainingSummary,
};
use crate::num::random::Stream;
use crate::pipeline::valued;
use crate::rig::{Bones, Parametrisation, Part, Points, RootMotion};
use crate::scene::{Limits, Source, figure, import_sources, size_m};

fn figure_scene() -> Scene {
    let source = Source { name: "figure.glb".to_owned(), bytes: figure::figure() };
    import_sources(vec![source], &Limits::default()).unwrap()
}

/// A mean of as many values as there are points, each its own.
fn model_of(scene: &Scene, carries_rest: bool) -> Model {
    let points = Points::merge(&scene.mesh);
    let bones = Bones::dominant(&scene.mesh, &points);
    let size_m = size_m(&scene.mesh, &scene.skeleton);
    let angles = Parametrisation { columns: Vec::new(), size_m, dropped: Vec::new() };
    let mesh = &scene.mesh;
    let root = (bones.nodes.first().copied(), RootMotion::Rigid);
    let (names, defaults) = (&mesh.weight_names, &mesh.default_weights);
    let count = points.count();
    let header = Header {
        format_version: FORMAT_VERSION,
        family: Family::Mean,
        precision: Precision::F32,
        signal: Signal::Ao,
        order: 1,
        channels: 1,
        frame: Frame::Bone,
        conventions: Header::conventions(),
        unshadowed: false,
        occluders: None,
        rest: None,
        rig: RigHeader::new(&scene.skeleton, root, &bones, &angles, names, defaults),
        mesh: MeshIdentity {
            scene_sha256: hash::scene(&scene.sources),
            shape_sha256: Some(hash::shape(scene, &scene.mesh.parts)),
            receivers_sha256: None,
            vertices: mesh.positions.len() as u32,
            points: count as u32,
            parts: Vec::new(),
        },
        training: TrainingSummary { poses: 1, ..TrainingSummary::default() },
        errors: [].into(),
        provenance: Provenance::default(),
    };
    let mean = (0..count).map(|point| point as f32).collect();
    let decoder = Decoder::Mean { mean };
    let model = Model::new(header, decoder, points.of_vertex, bones.of_point).unwrap();
    match carries_rest {
        true => model.with_rest(mesh.subset(&points.vertex)).unwrap(),
        false => model,
    }
}

/// The scene with the listed vertices in their order, as an exporter may write it.
fn exported(scene: &Scene, order: &[u32]) -> Scene {
    let mut place = vec![0; scene.mesh.positions.len()];
    for (i, &vertex) in (0_u32..).zip(order) {
        place[vertex as usize] = i;
    }
    let mut mesh = scene.mesh.subset(order);
    mesh.triangles = scene.mesh.triangles.iter().map(|t| t.map(|v| place[v as usize])).collect();
    let vertices = 0..order.len();
    let triangles = 0..mesh.triangles.len();
    mesh.parts = vec![Part { vertices, triangles, ..scene.mesh.parts[0].clone() }];
    let sources = vec![Source { name: "again.glb".to_owned(), bytes: b"again".to_vec() }];
    Scene { mesh, sources, ..scene.clone() }
}

/// Proves that a mesh whose vertices were shuffled, some of them split, all moved a little and
/// weights rounded to 8 bits, takes every vertex's values from the point that it was, whether the
/// model carries its rest mesh or names its original, whose edges are then found again; and that
/// the model's blob comes back with the new mesh.
#[test]
fn shuffled_and_split_vertices_find_their_points() {
    let scene = figure_scene();
    let count = scene.mesh.positions.len() as u32;
    let mut order: Vec<u32> = (0..count).chain((0..count).step_by(9)).collect();
    let mut stream = Stream::new(6);
    for i in (1..order.len()).rev() {
        order.swap(i, (stream.uniform() * (i + 1) as f64) as usize);
    }
    let mut again = exported(&scene, &order);
    for position in &mut again.mesh.positions {
        *position += Vec3::splat(1e-4 * stream.uniform() as f32);
    }
    for vertex in 0..order.len() {
        let start = again.mesh.influence_starts[vertex] as usize;
        let end = again.mesh.influence_starts[vertex + 1] as usize;
        let mut left = 1.0;
        for (i, influence) in again.mesh.influences[start..end].iter_mut().enumerate() {
            let rounded = (influence.weight * 255.0).round() / 255.0;
            influence.weight = if start + i + 1 == end { left } else { rounded };
            left -= influence.weight;
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("figure.glb");
    std::fs::write(&file, &scene.sources[0].bytes).unwrap();
    for original in [None, Some(file.as_path())] {
        let model = model_of(&scene, original.is_none());
        let found = rebind(&model, &again, original, &RebindSettings::default()).unwrap();
        assert!(found.unmatched.is_empty() && found.unused_points == 0, "{found:?}");
        assert!(found.farthest_m > 0.0 && found.farthest_m < 2e-4, "{}", found.farthest_m);
        assert_eq!(found.edges_kept, original.map(|_| 1.0));
        let expected = order.iter().map(|&vertex| model.point_of_vertex()[vertex as usize]);
        assert!(expected.eq(found.model.point_of_vertex().iter().copied()));
        let header = found.model.header();
        assert_eq!((header.mesh.vertices as usize, header.mesh.parts.len()), (order.len(), 1));
        assert_ne!(header.mesh.scene_sha256, model.header().mesh.scene_sha256);
        assert!(valued(&model, &again).is_err() && valued(&found.model, &again).is_ok());
        assert!(valued(&model, &scene).is_ok() && valued(&found.model, &scene).is_err());
        let bytes = found.model.to_bytes(Precision::F32).unwrap();
        assert_eq!(Model::from_bytes(&bytes).unwrap().header(), header);
    }
}

/// A tolerance of nothing takes what is at the very place, and nothing else.
#[test]
fn no_tolerance_is_for_the_same_places() {
    let scene = figure_scene();
    let model = model_of(&scene, true);
    let strict = RebindSettings { tolerance: 0.0, ..RebindSettings::default() };
    let found = rebind(&model, &scene, None, &strict).unwrap();
    assert_eq!((found.unmatched.len(), found.farthest_m), (0, 0.0));
    let mut moved = figure_scene();
    moved.mesh.positions[7] += Vec3::splat(1e-5);
    let told = rebind(&model, &moved, None, &strict).unwrap_err().to_string();
    assert!(told.starts_with("1 of "), "{told}");
}

/// Proves that vertices which moved, or are moved by other bones, are counted and listed, that more
/// of them than allowed are refused, and that as many as allowed take the nearest point.
#[test]
fn other_vertices_are_listed_and_refused() {
    let scene = figure_scene();
    let model = model_of(&scene, true);
    let order: Vec<u32> = (0..scene.mesh.positions.len() as u32).collect();
    let mut again = exported(&scene, &order);
    again.mesh.positions[40] += Vec3::Y * 0.5;
    let start = again.mesh.influence_starts[90] as usize;
    let end = again.mesh.influence_starts[91] as usize;
    let deformers = again.mesh.deformers.len() as u32;
    for influence in &mut again.mesh.influences[start..end] {
        influence.deformer = (influence.deformer + 7) % deformers;
    }
    let strict = rebind(&model, &again, None, &RebindSettings::default()).unwrap_err();
    let RebindError::Unmatched { found, vertices, .. } = &strict else { panic!("{strict}") };
    assert_eq!((*found, *vertices), (2, order.len()));
    let loose = RebindSettings { unmatched: 0.01, ..RebindSettings::default() };
    let found = rebind(&model, &again, None, &loose).unwrap();
    let listed: Vec<usize> = found.unmatched.iter().map(|one| one.vertex).collect();
    assert_eq!(listed, [40, 90]);
    assert!(found.unmatched[0].nearest_m > 0.01, "{:?}", found.unmatched);
    assert_eq!(found.model.point_of_vertex()[41], model.point_of_vertex()[41]);
}

/// Proves that what cannot be attached says why: no rest mesh and no original, another original,
/// fewer vertices than points, a joint without its name; and that a node which carries nothing may
/// be gone.
#[test]
fn what_is_missing_is_named() {
    let scene = figure_scene();
    let settings = RebindSettings::default();
    let plain = model_of(&scene, false);
    let error = rebind(&plain, &scene, None, &settings).unwrap_err();
    assert!(matches!(error, RebindError::NeedsOriginal), "{error}");
    let model = model_of(&scene, true);
    let some: Vec<u32> = (0..100).collect();
    let mut few = scene.clone();
    few.mesh = scene.mesh.subset(&some);
    let error = rebind(&model, &few, None, &settings).unwrap_err();
    assert!(matches!(error, RebindError::Fewer { vertices: 100, .. }), "{error}");
    let mut renamed = scene.clone();
    let bone = model.header().rig.bones[3] as usize;
    renamed.skeleton.nodes[bone].name = "other".to_owned();
    let error = rebind(&model, &renamed, None, &settings).unwrap_err();
    assert!(matches!(&error, RebindError::Nodes(names) if names.len() == 1), "{error}");

    let mut idle = scene.clone();
    idle.skeleton.nodes.push(crate::rig::Node {
        name: "idle".to_owned(),
        parent: None,
        rest: crate::rig::Transform::IDENTITY,
    });
    let with_idle = model_of(&idle, true);
    let found = rebind(&with_idle, &scene, None, &settings).unwrap();
    let nodes = |model: &Model| model.header().rig.nodes.len();
    assert_eq!(nodes(&found.model), nodes(&with_idle) - 1);
}
