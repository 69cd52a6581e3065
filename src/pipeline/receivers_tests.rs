use std::sync::atomic::AtomicBool;

use super::*;
use crate::dataset::Dataset;
use crate::pipeline::recipe::SignalName;
use crate::pipeline::recipe::subsurface::SubsurfaceRecipe;
use crate::pipeline::recipe::surroundings::{GroundRecipe, OccludersRecipe};
use crate::pipeline::{Around, Job, Watch, bake, buried, fit, job_of};
use crate::pose::RootMotion;
use crate::scene::{self, Limits, figure};

fn import(name: &str, bytes: Vec<u8>) -> Scene {
    let source = Source { name: name.into(), bytes };
    scene::import_sources(vec![source], &Limits::default()).unwrap()
}

fn character() -> Scene {
    import("figure.glb", figure::figure())
}

/// A level patch under the figure's feet, and a far corner of it.
fn patch() -> Scene {
    let mut text = String::new();
    for i in 0..5 {
        for j in 0..5 {
            text += &format!("v {} 0 {}\n", 0.25 * f64::from(i) - 0.5, 0.25 * f64::from(j) - 0.5);
        }
    }
    for i in 0..4 {
        for j in 0..4 {
            let a = 5 * i + j + 1;
            text += &format!("f {} {} {} {}\n", a, a + 1, a + 6, a + 5);
        }
    }
    text += "v 40 0 0\nv 40 0 1\nv 41 0 1\nf 26 27 28\n";
    import("patch.obj", text.into())
}

fn recipe() -> Recipe {
    let mut recipe = Recipe::default();
    recipe.poses.clips = Some(vec!["walk".into(), "wave".into()]);
    recipe.poses.rate_hz = 3.0;
    recipe.bake.signal = SignalName::Ao;
    recipe.bake.rays = 64;
    recipe
}

fn receiving(mut recipe: Recipe, occluders: Option<Scene>) -> Result<Job, Error> {
    let named = ReceiversRecipe { file: "patch.obj".into(), sha256: None };
    recipe.bake.surroundings.receivers = Some(named);
    let around = Around { occluders, receivers: Some(patch()) };
    Job::among(character(), around, recipe)
}

fn values(job: &Job, path: &std::path::Path) -> Vec<f32> {
    let (cancelled, report) = (AtomicBool::new(false), |_: crate::pipeline::Progress| ());
    let watch = Watch { cancelled: &cancelled, report: &report };
    bake(job, path, &watch).unwrap();
    let dataset = Dataset::open(path).unwrap();
    let layout = dataset.header().layout;
    let poses: Vec<usize> = (0..layout.poses).collect();
    let mut values = vec![0.0; layout.poses * layout.points * layout.row()];
    dataset.read_points(&poses, 0..layout.points, &mut values).unwrap();
    values
}

/// A patch under the figure changes no pose, no parameter and none of the figure's own values, but for
/// rays that just pass an edge: the tracer's unit is the size of everything. The feet darken it, a corner 40 m away stays open in every pose; and the data set carries it, so that its
/// job, and a model that is fitted to it, have the patch again.
#[test]
fn receivers_receive_and_change_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let alone = Job::new(character(), None, recipe()).unwrap();
    let with = receiving(recipe(), None).unwrap();
    assert_eq!(with.poses.parameters, alone.poses.parameters);
    assert_eq!(with.poses.root_motion, RootMotion::Rigid);
    let own = alone.poses.points.count();
    let all = with.poses.points.count();
    assert_eq!(all, own + 28);
    let before = values(&alone, &folder.path().join("alone"));
    let path = folder.path().join("with");
    let after = values(&with, &path);
    let poses = with.poses.samples.len();
    for pose in 0..poses {
        let row = &after[pose * all..(pose + 1) * all];
        let pairs = row[..own].iter().zip(&before[pose * own..(pose + 1) * own]);
        let off: Vec<f32> = pairs.map(|(a, b)| (a - b).abs()).filter(|&off| off > 0.0).collect();
        assert!(off.len() * 50 < own && off.iter().all(|&off| off <= 4.0 / 64.0), "{off:?}");
        assert!(row[own..own + 25].iter().any(|&ao| ao < 0.85), "pose {pose}: {:?}", &row[own..]);
        assert!(row[own + 25..].iter().all(|&ao| ao > 0.999), "pose {pose}: {:?}", &row[own..]);
    }
    let dataset = Dataset::open(&path).unwrap();
    let again = job_of(&dataset).unwrap();
    assert_eq!(again.hashes, with.hashes);
    assert_eq!(again.deformed(1), with.deformed(1));
    let model = fit(&dataset, &with.recipe).unwrap().model;
    assert_eq!(model.header().mesh.vertices as usize, with.scene.mesh.positions.len());
}

/// The patch keeps its place in whatever frame the bake is in: the character's own, one that stays level
/// over ground, or the scene's beside an occluder that stands still, where a walk is a parameter. Ground
/// at the lowest point is that of the character, not of the patch.
#[test]
fn receivers_stand_in_the_frame_that_is_left() {
    let place = |job: &Job| {
        let first = job.scene.mesh.positions.len() - 28;
        let of = |pose: usize| job.deformed(pose).positions[first..].to_vec();
        let rest = of(0);
        assert!((1..job.poses.samples.len()).all(|pose| of(pose) == rest));
        assert_eq!(rest[25], glam::Vec3::new(40.0, 0.0, 0.0));
    };
    let free = receiving(recipe(), None).unwrap();
    place(&free);
    let mut level = recipe();
    level.bake.surroundings.ground = Some(GroundRecipe::Lowest);
    let alone = Job::new(character(), None, level.clone()).unwrap();
    let level = receiving(level, None).unwrap();
    place(&level);
    assert_eq!(level.poses.root_motion, RootMotion::Upright);
    assert_eq!(level.surroundings.ground_m, alone.surroundings.ground_m);
    let mut fixed = recipe();
    let wall = import("wall.obj", "v 9 0 -5\nv 9 0 5\nv 9 9 5\nf 1 2 3\n".into());
    let named = OccludersRecipe { file: "wall.obj".into(), sha256: None };
    fixed.bake.surroundings.occluders = Some(named);
    let fixed = receiving(fixed, Some(wall)).unwrap();
    place(&fixed);
    assert_eq!(fixed.poses.root_motion, RootMotion::Fixed);
    assert!(fixed.poses.parametrisation.columns.len() > free.poses.parametrisation.columns.len());
}

/// The scene itself, a file that was not read, and one that nobody named are refused by what is wrong;
/// so is a family that would cut spheres from the patch.
#[test]
fn nonsense_is_refused() {
    let mut named = recipe();
    let itself = ReceiversRecipe { file: "figure.glb".into(), sha256: None };
    named.bake.surroundings.receivers = Some(itself);
    let among = |receivers, recipe| {
        let around = Around { occluders: None, receivers };
        Job::among(character(), around, recipe).expect_err("must be refused").to_string()
    };
    assert!(among(Some(character()), named.clone()).contains("the scene itself"));
    let renamed = import("copy.glb", figure::figure());
    assert!(among(Some(renamed), named.clone()).contains("the scene itself"));
    assert!(among(None, named.clone()).contains("was not read"));
    assert!(among(Some(patch()), recipe()).contains("does not name"));
    named.fit.family = crate::pipeline::recipe::FamilyName::Occluder;
    assert!(among(Some(patch()), named).contains("bake.surroundings.receivers"));
}

/// A closed box around the figure, faces outwards, buries it where it blocks. Receivers block nothing of the
/// figure, and walls beyond the furthest distance take no light away: then nothing is said.
#[test]
fn what_does_not_block_buries_nobody() {
    let hull = || {
        let corners =
            "v -3 -3 -3\nv 3 -3 -3\nv 3 3 -3\nv -3 3 -3\nv -3 -3 3\nv 3 -3 3\nv 3 3 3\nv -3 3 3\n";
        let faces = "f 1 4 3 2\nf 5 6 7 8\nf 1 5 8 4\nf 2 3 7 6\nf 1 2 6 5\nf 4 8 7 3\n";
        import("hull.obj", format!("{corners}{faces}").into())
    };
    // Building the figure takes longer than looking around in it.
    let figure = character();
    let within = |around: Around, recipe: &Recipe| {
        let mut recipe = recipe.clone();
        recipe.poses.clips = Some(vec!["walk".into()]);
        buried(&Job::among(figure.clone(), around, recipe).unwrap()).unwrap()
    };
    let occluding = || Around { occluders: Some(hull()), receivers: None };
    let alone = within(Around::default(), &recipe());
    let mut blocking = recipe();
    let named = OccludersRecipe { file: "hull.obj".into(), sha256: None };
    blocking.bake.surroundings.occluders = Some(named);
    let told = within(occluding(), &blocking);
    assert!(told.len() == 1 && told[0].contains("inside other geometry"), "{told:?}");
    assert_ne!(told, alone);

    let mut receiving = recipe();
    let named = ReceiversRecipe { file: "hull.obj".into(), sha256: None };
    receiving.bake.surroundings.receivers = Some(named);
    let around = Around { occluders: None, receivers: Some(hull()) };
    assert_eq!(within(around, &receiving), alone);

    let mut near = recipe();
    (blocking.bake.max_distance_m, near.bake.max_distance_m) = (Some(0.5), Some(0.5));
    assert_eq!(within(occluding(), &blocking), within(Around::default(), &near));
}

/// Light below the surface is the character's: a patch under it keeps what it has, in every colour, and
/// gives nothing to the feet that stand on it; so does a mesh that is not named. Names that nobody has are
/// refused.
#[test]
fn receivers_are_no_skin() {
    let below = |meshes: Vec<String>| {
        let material = Some("skin".to_owned());
        Some(SubsurfaceRecipe { material, meshes, ..SubsurfaceRecipe::default() })
    };
    let mut plain = recipe();
    plain.poses.clips = Some(vec!["walk".into()]);
    (plain.bake.signal, plain.bake.order, plain.bake.rays) = (SignalName::Transfer, 1, 16);
    let first = |job: &Job| {
        let baker = job.baker(&job.checked.bake, None).unwrap();
        let posed = job.traced(0);
        let mesh = bake::posed(job, 0, &posed);
        baker.bake(&[mesh], &AtomicBool::new(false)).unwrap().swap_remove(0)
    };
    let diffused = Recipe {
        bake: crate::pipeline::recipe::BakeRecipe {
            subsurface: below(vec![]),
            ..plain.bake.clone()
        },
        ..plain.clone()
    };
    // Building the figure takes longer than looking at it.
    let figure = character();
    let receiving = |mut recipe: Recipe| {
        let named = ReceiversRecipe { file: "patch.obj".into(), sha256: None };
        recipe.bake.surroundings.receivers = Some(named);
        let around = Around { occluders: None, receivers: Some(patch()) };
        Job::among(figure.clone(), around, recipe)
    };
    let alone = first(&Job::new(figure.clone(), None, diffused.clone()).unwrap());
    let direct = first(&receiving(plain.clone()).unwrap());
    let with = first(&receiving(diffused.clone()).unwrap());
    let own = alone.noise.len();
    for (point, row) in with.coefficients.chunks_exact(3).enumerate().skip(own) {
        assert_eq!(row, [direct.coefficients[point]; 3]);
    }
    assert_eq!(with.noise[own..], direct.noise[own..]);
    let pairs = with.coefficients[..3 * own].iter().zip(&alone.coefficients);
    let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(off < 0.02, "{off}");

    let named = |name: &str| {
        let mut recipe = diffused.clone();
        recipe.bake.subsurface = below(vec![name.to_owned()]);
        receiving(recipe)
    };
    let fault = named("Coat").expect_err("no such mesh").to_string();
    assert!(fault.contains("no mesh \"Coat\"; there are"), "{fault}");
    let known = named(&figure.mesh.parts[0].name).unwrap();
    assert_eq!(first(&known), with);
}
