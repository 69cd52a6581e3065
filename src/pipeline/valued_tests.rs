use std::sync::atomic::AtomicBool;

use super::*;
use crate::dataset::Dataset;
use crate::pipeline::recipe::subsurface::SubsurfaceRecipe;
use crate::pipeline::recipe::surroundings::{ReceiversRecipe, SurroundingsRecipe};
use crate::pipeline::recipe::{FamilyName, Recipe, SignalName};
use crate::pipeline::{Around, Job, Query, Still, StillError, Watch, bake, fit, still, two_nodes};
use crate::rig::Pose;
use crate::scene::{self, Limits, Source, figure};

/// A patch of one triangle far away.
fn patch() -> Scene {
    let bytes = b"v 40 0 0\nv 40 0 1\nv 41 0 1\nf 1 2 3\n".to_vec();
    let source = Source { name: "patch.obj".into(), bytes };
    scene::import_sources(vec![source], &Limits::default()).unwrap()
}

/// A model of ambient occlusion at the lid and the floor, in surroundings.
fn model(receivers: Option<Scene>, edit: impl FnOnce(&mut SurroundingsRecipe)) -> Model {
    let mut recipe = Recipe::default();
    (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 64);
    edit(&mut recipe.bake.surroundings);
    model_of(receivers, recipe)
}

fn model_of(receivers: Option<Scene>, recipe: Recipe) -> Model {
    let around = Around { occluders: None, receivers };
    let job = Job::among(two_nodes::scene(false), around, recipe).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("d.zarr");
    let stop = AtomicBool::new(false);
    bake(&job, &path, &Watch { cancelled: &stop, report: &|_| () }).unwrap();
    fit(&Dataset::open(&path).unwrap(), &job.recipe).unwrap().model
}

fn picture() -> Still<'static> {
    Still { view: [30.0, 40.0], ..still::tests::settings() }
}

/// A node that only blocks has no values: of the two squares the model is of the second in the file, so the
/// floor's values land on the floor, and it alone is in the picture, which says so.
#[test]
fn what_blocks_is_taken_out() {
    let whole = two_nodes::scene(false);
    let model = model(None, |around| around.occluder_nodes = vec!["lid".into()]);
    let own = valued(&model, &whole).unwrap();
    assert_eq!((own.taken, own.receivers, &own.first_vertices[..]), (4, 0, &[4][..]));
    assert_eq!(own.scene.mesh.parts[0].name, "ground");
    assert_eq!(own.scene.mesh.positions.len(), 4);
    let rest = Pose::rest(&own.scene.skeleton, &[]);
    let mut values = Vec::new();
    let query = Query::from_pose(&model, &own.scene, &rest).unwrap();
    query.values(&model, None, None, &mut values).unwrap();
    assert!(values.len() == 4 && values.iter().all(|&ao| ao < 0.95), "{values:?}");
    let made = still(&whole, Some(&model), &picture()).unwrap();
    assert!(made.notices.iter().any(|notice| notice.contains("4 vertices that only block")));
}

/// A model that looks at the posed mesh does not look at what only blocks: the whole scene beside it gives
/// what the scene without those nodes gives, also for positions of the vertices that have values.
#[test]
fn what_only_blocks_is_not_looked_at() {
    let whole = two_nodes::scene(false);
    let model = model(None, |around| around.occluder_nodes = vec!["lid".into()]);
    let only = valued(&model, &whole).unwrap().scene;
    let rest = Pose::rest(&whole.skeleton, &[]);
    let posed = |scene| Query::from_pose(&model, scene, &rest).unwrap().posed(&model, Some(scene));
    assert_eq!(posed(&whole).unwrap(), posed(&only).unwrap());
    let own: Vec<f32> = only.mesh.positions.iter().flat_map(|place| place.to_array()).collect();
    let by_vertices = |scene| Query::from_positions_in(&model, scene, &own).unwrap();
    assert_eq!(by_vertices(&whole), by_vertices(&only));
}

/// Receivers come last and are in another file: the scene's own vertices are the model's first, with and
/// without a node that blocks, and the picture is of them.
#[test]
fn receivers_come_last() {
    let whole = two_nodes::scene(false);
    let named = |around: &mut SurroundingsRecipe| {
        around.receivers = Some(ReceiversRecipe { file: "patch.obj".into(), sha256: None });
    };
    for (taken, nodes) in [(0, vec![]), (4, vec!["lid".to_owned()])] {
        let model = model(Some(patch()), |around| {
            named(around);
            around.occluder_nodes = nodes;
        });
        let own = valued(&model, &whole).unwrap();
        assert_eq!((own.taken, own.receivers), (taken, 3));
        assert_eq!(own.scene.mesh.positions.len(), 8 - taken);
        let made = still(&whole, Some(&model), &picture()).unwrap();
        assert!(made.notices.iter().any(|notice| notice.contains("3 vertices of receivers")));
    }
}

/// A model of another scene is refused with both numbers, and draws nothing.
#[test]
fn another_scene_is_refused() {
    let source = Source { name: "figure.glb".into(), bytes: figure::figure() };
    let figure = scene::import_sources(vec![source], &Limits::default()).unwrap();
    let model = model(None, |_| ());
    let told = valued(&model, &figure).unwrap_err().to_string();
    assert!(told.ends_with("but the model is of a mesh with 8"), "{told}");
    let refused = still(&figure, Some(&model), &picture());
    assert!(matches!(refused, Err(StillError::Evaluate(EvaluateError::Vertices { .. }))));
}

/// Rays to the sky know nothing of light below the surface: beside such a model no truth is shown, and the
/// picture says why. Beside a model of direct transfer there is one.
#[test]
fn light_below_the_surface_has_no_truth() {
    let whole = two_nodes::scene(false);
    let told = |material: Option<&str>| {
        let mut recipe = Recipe::default();
        (recipe.bake.signal, recipe.bake.order, recipe.bake.rays) = (SignalName::Transfer, 1, 8);
        recipe.fit.family = FamilyName::Mean;
        recipe.bake.subsurface = material.map(|name| SubsurfaceRecipe {
            material: Some(name.to_owned()),
            ..SubsurfaceRecipe::default()
        });
        let model = model_of(None, recipe);
        still(&whole, Some(&model), &picture()).unwrap().notices.join("; ")
    };
    assert!(told(Some("skin")).contains("below the surface"), "{}", told(Some("skin")));
    assert!(!told(None).contains("no truth"), "{}", told(None));
}

/// A mesh of as many vertices is another where they lie elsewhere, in another order, or are joined otherwise:
/// it is refused with both names and what to do, also among nodes that only block. A model from before this was
/// asked takes it.
#[test]
fn as_many_vertices_are_not_the_mesh() {
    let edits: [fn(&mut Scene); 3] = [
        |scene| scene.mesh.positions.swap(5, 6),
        |scene| scene.mesh.positions[4].x += 1e-6,
        |scene| scene.mesh.triangles[2].rotate_left(1),
    ];
    for nodes in [vec![], vec!["lid".to_owned()]] {
        let model = model(None, |around| around.occluder_nodes = nodes);
        let old = model.clone().with_shapes([None, None]).unwrap();
        for edit in edits {
            let mut other = two_nodes::scene(false);
            edit(&mut other);
            other.sources[0].name = "again.glb".into();
            let told = valued(&model, &other).unwrap_err().to_string();
            assert!(told.starts_with("again.glb has as many vertices"), "{told}");
            assert!(told.contains("two.gltf") && told.ends_with("`poselight rebind`"), "{told}");
            assert!(check_mesh(&model, &other).is_err());
            assert!(still(&other, Some(&model), &picture()).is_err());
            assert!(valued(&old, &other).is_ok() && still(&other, Some(&old), &picture()).is_ok());
        }
    }
    let model = model(Some(patch()), |around| {
        around.receivers = Some(ReceiversRecipe { file: "patch.obj".into(), sha256: None });
    });
    let mut other = patch();
    check_receivers(&model, &other).unwrap();
    other.mesh.positions.swap(0, 1);
    assert!(check_receivers(&model, &other).is_err());
}

/// The same vertices are the same mesh, whatever else is another: names, clips, where nodes stand at rest,
/// normals, the file's bytes, the sign of a zero, and whether the nodes that only block are there at all.
#[test]
fn the_same_vertices_are_the_mesh() {
    let edits: [fn(&mut Scene); 6] = [
        |scene| scene.mesh.parts[1].name = "carpet".into(),
        |scene| scene.clips.clear(),
        |scene| scene.skeleton.nodes[1].rest.translation.y = 0.25,
        |scene| scene.mesh.normals.fill(glam::Vec3::X),
        |scene| scene.sources[0].bytes.push(b' '),
        |scene| scene.mesh.positions.iter_mut().for_each(|place| place.y = -place.y),
    ];
    for nodes in [vec![], vec!["lid".to_owned()]] {
        let model = model(None, |around| around.occluder_nodes = nodes.clone());
        assert!(model.header().mesh.shape_sha256.is_some());
        for edit in edits {
            let mut same = two_nodes::scene(false);
            edit(&mut same);
            assert_eq!(valued(&model, &same).unwrap().taken, 4 * nodes.len());
            check_mesh(&model, &same).unwrap();
        }
        let mut alone = two_nodes::scene(false);
        alone.mesh = alone.mesh.split(|part| part.name == "square").0;
        assert_eq!(valued(&model, &alone).is_ok(), !nodes.is_empty());
    }
}

/// A sequence starts with one pose of many: other places are taken, other faces are not.
#[test]
fn a_sequence_is_known_by_its_faces() {
    let mut scene = two_nodes::scene(false);
    scene.is_sequence = true;
    let hash = |scene: &Scene| hash::shape(scene, &scene.mesh.parts);
    let before = hash(&scene);
    scene.mesh.positions.reverse();
    assert_eq!(hash(&scene), before);
    scene.mesh.triangles.swap(0, 1);
    assert_ne!(hash(&scene), before);
}
