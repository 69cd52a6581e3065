use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::*;
use crate::dataset::Dataset;
use crate::pipeline::recipe::SignalName;
use crate::pipeline::recipe::surroundings::OccludersRecipe;
use crate::pipeline::{Job, Watch, bake, bake_reference, two_nodes};
use crate::scene::{self, Limits, figure};

fn import(name: &str, bytes: Vec<u8>) -> Scene {
    let source = Source { name: name.into(), bytes };
    scene::import_sources(vec![source], &Limits::default()).unwrap()
}

fn character() -> Scene {
    import("figure.glb", figure::figure())
}

/// A wall beside the figure.
fn wall() -> Scene {
    let text = "v 0.6 0 -5\nv 0.6 0 5\nv 0.6 9 5\nv 0.6 9 -5\nf 1 2 3\nf 1 3 4\n";
    import("wall.obj", text.into())
}

/// A recipe of few poses and rays.
fn recipe(edit: impl FnOnce(&mut SurroundingsRecipe)) -> Recipe {
    let mut recipe = Recipe::default();
    recipe.poses.clips = Some(vec!["walk".into()]);
    recipe.poses.rate_hz = 2.0;
    recipe.bake.signal = SignalName::Ao;
    recipe.bake.rays = 8;
    recipe.target.reference_poses = 1;
    edit(&mut recipe.bake.surroundings);
    recipe
}

fn refused(still: Option<Scene>, recipe: Recipe) -> String {
    Job::new(character(), still, recipe).expect_err("must be refused").to_string()
}

/// Nothing asked for leaves the recipe's text, and with it every hash, as it was before there were
/// surroundings.
#[test]
fn an_empty_recipe_says_nothing() {
    let text = serde_json::to_string(&Recipe::default()).unwrap();
    assert!(!text.contains("surroundings"), "{text}");
}

/// Level ground at the lowest point: no point of any pose is below it and some pose touches it; only
/// turning and walking are taken out, and the heights of the poses are those of the scene.
#[test]
fn the_lowest_ground_is_touched() {
    let job =
        Job::new(character(), None, recipe(|r| r.ground = Some(GroundRecipe::Lowest))).unwrap();
    assert_eq!(job.poses.root_motion, RootMotion::Upright);
    let ground = job.surroundings.ground_m.unwrap();
    let lowest = |pose: usize| {
        job.deformed(pose).positions.iter().map(|p| p.y).fold(f32::INFINITY, f32::min)
    };
    let lows: Vec<f32> = (0..job.poses.samples.len()).map(lowest).collect();
    assert!(lows.iter().all(|&low| low >= ground) && lows.contains(&ground));
    for sample in &job.poses.samples {
        assert_eq!((sample.root.rotation.x, sample.root.rotation.z), (0.0, 0.0));
        assert_eq!(sample.root.translation.y, 0.0);
    }
}

/// A wall that stands still leaves nothing of the motion to take out; it blocks, gets no values, and
/// comes back out of the data set's sources when references are baked.
#[test]
fn occluders_survive_the_data_set() {
    let named = |r: &mut SurroundingsRecipe| {
        r.occluders = Some(OccludersRecipe { file: "elsewhere/wall.obj".into(), sha256: None });
    };
    let open = Job::new(character(), None, recipe(|_| ())).unwrap();
    let job = Job::new(character(), Some(wall()), recipe(named)).unwrap();
    assert_eq!((job.poses.root_motion, job.poses.root_node), (RootMotion::Fixed, None));
    assert_eq!(job.poses.points, open.poses.points);
    assert_ne!(job.hashes.bake, open.hashes.bake);
    let stored = job.recipe.bake.surroundings.occluders.clone().unwrap();
    assert_eq!(stored.file, "wall.obj");
    assert!(stored.sha256.is_some());

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("d.zarr");
    let stop = AtomicBool::new(false);
    let watch = Watch { cancelled: &stop, report: &|_| () };
    bake(&job, &path, &watch).unwrap();
    let dataset = Dataset::open(&path).unwrap();
    bake_reference(&dataset, job.checked.reference, &watch).unwrap();
    let mean = |job: &Job| {
        let baker = job.baker(&job.checked.bake, None).unwrap();
        let posed = job.traced(0);
        let mesh = bake::posed(job, 0, &posed);
        let ao = baker.bake(&[mesh], &stop).unwrap().swap_remove(0).coefficients;
        ao.iter().sum::<f32>() / ao.len() as f32
    };
    assert!(mean(&job) < mean(&open) - 0.05, "{} {}", mean(&job), mean(&open));
}

/// A part of the character that is named as an occluder is carried along: the root's motion is still
/// taken out.
#[test]
fn a_carried_occluder_moves_with_the_character() {
    let whole = character();
    let names: Vec<String> = whole.mesh.parts.iter().map(|part| part.name.clone()).collect();
    let nodes: Vec<usize> = whole.mesh.parts.iter().map(|part| part.node).collect();
    // The bundled figure is one mesh: there is nothing to choose from.
    let name = whole.skeleton.nodes[nodes[0]].name.clone();
    if nodes.iter().all(|&node| node == nodes[0]) {
        let message = refused(None, recipe(|r| r.occluder_nodes = vec![name]));
        assert!(message.contains("every mesh"), "{message} of {names:?}");
    }
}

/// Whatever makes no sense is refused with the reason.
#[test]
fn nonsense_is_refused() {
    let named = |r: &mut SurroundingsRecipe| r.occluders = Some(OccludersRecipe::default());
    let message = refused(Some(character()), recipe(named));
    assert!(message.contains("the scene itself"), "{message}");
    let renamed = import("copy.glb", figure::figure());
    let message = refused(Some(renamed), recipe(named));
    assert!(message.contains("the scene itself"), "{message}");
    assert!(refused(None, recipe(named)).contains("not read"));
    let message = refused(None, recipe(|r| r.ground = Some(GroundRecipe::HeightM(50.0))));
    assert!(message.contains("above the character"), "{message}");
    let message = refused(None, recipe(|r| r.occluder_nodes = vec!["Tail".into()]));
    assert!(message.contains("no node \"Tail\""), "{message}");
    let message = refused(None, recipe(|r| r.ignore_self = vec!["Cape".into()]));
    assert!(message.contains("no mesh \"Cape\""), "{message}");
}

/// Of two nodes that show one mesh each is itself: a floor that does not see itself lies under its twin's
/// shadow all the same, and lies open where all nodes of the mesh do not see one another.
#[test]
fn itself_is_the_same_node() {
    let floor = |edit: fn(&mut SurroundingsRecipe)| {
        let mut recipe = Recipe::default();
        (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 256);
        edit(&mut recipe.bake.surroundings);
        let job = Job::new(two_nodes::scene(true), None, recipe).unwrap();
        let baker = job.baker(&job.checked.bake, None).unwrap();
        let posed = job.traced(0);
        let mesh = bake::posed(&job, 0, &posed);
        let ao = baker.bake(&[mesh], &AtomicBool::new(false)).unwrap().swap_remove(0).coefficients;
        let points = &job.poses.points.of_vertex[4..];
        points.iter().map(|&point| ao[point as usize]).fold(1.0, f32::min)
    };
    let shadowed = floor(|_| ());
    assert!(shadowed < 0.95, "{shadowed}");
    assert_eq!(floor(|around| around.ignore_self = vec!["square".into()]), shadowed);
    let pair = |around: &mut SurroundingsRecipe| {
        around.ignore = vec![["square".to_owned(), "square".to_owned()]];
    };
    assert_eq!(floor(pair), 1.0);
}

/// Layers that lie in one another and ignore each other have points of their own: the skin lies open under a
/// roof that is part of the shirt, and the shirt lies in its shadow. Else the layers are the same points.
#[test]
fn layers_that_ignore_each_other_share_no_points() {
    let mut scene = two_nodes::scene(false);
    let node = scene.mesh.parts[1].node;
    scene.mesh.deformers.iter_mut().for_each(|deformer| deformer.node = node);
    let positions = scene.mesh.positions[..4].iter().map(|&p| p + 0.3 * glam::Vec3::Y).collect();
    let roof = Deformed { positions, normals: vec![glam::Vec3::NEG_Y; 4] };
    let part = Part { vertices: 0..4, triangles: 0..2, ..scene.mesh.parts[0].clone() };
    let carrier = (node, glam::Affine3A::IDENTITY);
    scene.mesh.carry(carrier, &roof, &[[0, 1, 2], [0, 2, 3]], &[part]);
    let layers = |ignore: Vec<[String; 2]>| {
        let mut recipe = Recipe::default();
        (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 64);
        recipe.bake.surroundings.ignore = ignore;
        let job = Job::new(scene.clone(), None, recipe).unwrap();
        let baker = job.baker(&job.checked.bake, None).unwrap();
        let posed = job.traced(0);
        let mesh = bake::posed(&job, 0, &posed);
        let ao = baker.bake(&[mesh], &AtomicBool::new(false)).unwrap().swap_remove(0).coefficients;
        let mean = |vertices: std::ops::Range<usize>| {
            let points = &job.poses.points.of_vertex[vertices];
            points.iter().map(|&point| ao[point as usize]).sum::<f32>() / 4.0
        };
        [mean(0..4), mean(4..8)]
    };
    let [shirt, skin] = layers(Vec::new());
    assert!(shirt == skin && skin < 0.9, "{shirt} {skin}");
    let [layer, skin] = layers(vec![["square".into(), "ground".into()]]);
    assert!(skin == 1.0 && (layer - shirt).abs() < 0.05, "{layer} {skin}");
}

/// A pane over the floor that is cut away: it blocks as a whole, and its file's notices are told, unless
/// transparency is asked for; so it is whether it lies in another file or is a node of the scene, and beside
/// receivers. A pane of one side blocks from its front alone.
#[test]
fn occluders_have_their_materials() {
    let mut floor = two_nodes::document(false);
    floor["scenes"][0]["nodes"] = json!([1]);
    let mut lid = two_nodes::document(false);
    lid["scenes"][0]["nodes"] = json!([0]);
    let mask = json!({
        "alphaMode": "MASK",
        "doubleSided": true,
        "pbrMetallicRoughness": {"baseColorFactor": [1.0, 1.0, 1.0, 0.0]},
    });
    let cut = |mut document: Value| {
        document["materials"] = json!([mask, {"doubleSided": false}]);
        document["meshes"][0]["primitives"][0]["material"] = json!(0);
        document
    };
    let mut single = cut(lid.clone());
    single["meshes"][0]["primitives"][0]["material"] = json!(1);
    let open = |scene: &Value, pane: Option<&Value>, edit: fn(&mut SurroundingsRecipe)| {
        let mut recipe = Recipe::default();
        (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 64);
        let around = &mut recipe.bake.surroundings;
        edit(around);
        around.occluders = pane.map(|_| OccludersRecipe::default());
        let read = |document: &Value, content| {
            let bytes = document.to_string().into_bytes();
            let source = Source { name: "a.gltf".into(), bytes };
            scene::import_sources_content(vec![source], &Limits::default(), content).unwrap()
        };
        let own = read(scene, crate::pipeline::job::content(&recipe));
        let pane = pane.map(|pane| read(pane, crate::pipeline::job::content_around(&recipe)));
        let job = Job::new(own, pane, recipe).unwrap();
        let baker = job.baker(&job.checked.bake, None).unwrap();
        let posed = job.traced(0);
        let mesh = bake::posed(&job, 0, &posed);
        let ao = baker.bake(&[mesh], &AtomicBool::new(false)).unwrap().swap_remove(0).coefficients;
        let told = job.scene.notices.join("; ");
        (ao.iter().fold(1.0_f32, |least, &ao| least.min(ao)), told)
    };
    let pane = cut(lid);
    let (blocked, told) = open(&floor, Some(&pane), |_| ());
    assert!(blocked < 0.95 && told.contains("occluders: materials[0] is masked"), "{told}");
    let (through, told) = open(&floor, Some(&pane), |around| around.transparency = true);
    assert!(through == 1.0 && !told.contains("masked"), "{through} {told}");
    let (behind, _) = open(&floor, Some(&single), |around| around.one_sided = true);
    let (front, _) = open(&floor, Some(&single), |_| ());
    assert!(behind == 1.0 && front == blocked, "{behind} {front}");

    let node = |around: &mut SurroundingsRecipe| around.occluder_nodes = vec!["lid".into()];
    let whole = cut(two_nodes::document(false));
    assert_eq!(open(&whole, None, node).0, blocked);
    let (through, _) = open(&whole, None, |around| {
        around.occluder_nodes = vec!["lid".into()];
        around.transparency = true;
    });
    assert_eq!(through, 1.0);
}
