use std::sync::atomic::AtomicBool;

use serde_json::json;

use super::*;
use crate::pipeline::recipe::{FamilyName, SignalName};
use crate::scene::{self, Limits, Source};

fn planned(poses: usize, error: f64, rays: u32) -> Planned {
    Planned { poses, error, noise: 0.0, rays }
}

/// Rays fall to what a budget needs and are even and bounded; a quarter of the noise's budget takes
/// 4^(1/1.4) times the rays.
#[test]
fn rays_meet_a_budget() {
    assert_eq!(rays_for(1e-9, 1.0).0, 8);
    assert_eq!(rays_for(1.0, 1e-12).0, 4096);
    let (rays, left) = rays_for(1.0, 0.1);
    let (more, _) = rays_for(1.0, 0.025);
    assert!(left <= 0.1 && left > 0.08, "{left}");
    let times = f64::from(more) / f64::from(rays);
    assert!((times / 4.0_f64.powf(1.0 / 1.4) - 1.0).abs() < 0.06, "{rays} to {more}");
}

/// The least rays in all among those that are good enough; without a target nearly as good as the best,
/// with one whatever meets it; where none does, the most poses.
#[test]
fn the_cheapest_that_is_good_enough() {
    let choices = [planned(16, 0.012, 200), planned(32, 0.0101, 120), planned(64, 0.01, 80)];
    assert_eq!(choose(&choices, 0.01, None), 1);
    assert_eq!(choose(&choices, 0.01, Some(0.02)), 0);
    assert_eq!(choose(&choices, 0.01, Some(0.001)), 2);
}

/// Clips are left out whole, or with one clip its last quarter.
#[test]
fn folds_are_whole_clips() {
    assert_eq!(folds(&[3, 3, 3, 3]), [vec![3]]);
    assert_eq!(folds(&[0, 0, 1]), [vec![0, 1], vec![2]]);
    let many: Vec<i32> = (0..9).collect();
    assert_eq!(folds(&many), [vec![0], vec![3], vec![6]]);
}

/// A floor of 81 points and a wall on it that two clips swing to and fro, each about another axis.
fn hinge() -> Vec<Source> {
    let floor = |i: u32, j: u32| [i, j].map(|k| k as f32 / 8.0 - 0.5);
    let places = (0..9).flat_map(|i| (0..9).map(move |j| floor(i, j)));
    let mut floats: Vec<f32> = places.flat_map(|[x, z]| [x, 0.0, z]).collect();
    floats.extend([-0.3, 0.05, 0.0, 0.3, 0.05, 0.0, 0.3, 0.6, 0.0, -0.3, 0.6, 0.0]);
    floats.extend((0..5).map(|key| key as f32));
    for axis in 0..2 {
        for angle in [0.0_f32, 0.5, -0.6, 0.7, 0.1] {
            let (sin, cos) = angle.sin_cos();
            floats.extend(if axis == 0 { [sin, 0.0, 0.0, cos] } else { [0.0, sin, 0.0, cos] });
        }
    }
    let cell = |c: u32| [c / 8 * 9 + c % 8].map(|a| [a, a + 1, a + 9, a + 9, a + 1, a + 10]);
    let indices = (0..64).flat_map(cell).flatten().chain([0, 1, 2, 0, 2, 3]);
    let bytes = floats.iter().flat_map(|value| value.to_le_bytes());
    let bytes: Vec<u8> = bytes.chain(indices.flat_map(u32::to_le_bytes)).collect();
    let mut views = Vec::new();
    let mut at = 0;
    let mut accessor = |kind: &str, component: u32, count: u32, bytes: u32| {
        views.push(json!({"buffer": 0, "byteOffset": at, "byteLength": bytes}));
        at += bytes;
        json!({"bufferView": views.len() - 1, "componentType": component, "count": count, "type": kind})
    };
    let accessors = [
        accessor("VEC3", 5126, 81, 972),
        accessor("VEC3", 5126, 4, 48),
        accessor("SCALAR", 5126, 5, 20),
        accessor("VEC4", 5126, 5, 80),
        accessor("VEC4", 5126, 5, 80),
        accessor("SCALAR", 5125, 384, 1536),
        accessor("SCALAR", 5125, 6, 24),
    ];
    let mesh = |at: u32, indices: u32| json!({"primitives": [{"attributes": {"POSITION": at}, "indices": indices}]});
    let clip = |name: &str, turns: u32| {
        let sampler = json!({"input": 2, "output": turns});
        let channel = json!({"sampler": 0, "target": {"node": 1, "path": "rotation"}});
        json!({"name": name, "samplers": [sampler], "channels": [channel]})
    };
    let document = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "data.bin", "byteLength": bytes.len()}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [mesh(0, 5), mesh(1, 6)],
        "nodes": [{"mesh": 0, "name": "floor", "children": [1]}, {"mesh": 1, "name": "wall"}],
        "animations": [clip("nod", 3), clip("shake", 4)],
        "scenes": [{"nodes": [0]}],
    });
    let text = Source { name: "hinge.gltf".into(), bytes: document.to_string().into_bytes() };
    vec![text, Source { name: "data.bin".into(), bytes }]
}

/// On a small scene: what the plan says that noise adds to a model is what a model of the planned
/// rays is off one of sixteen times as many, within a factor of 1.6 (a ratio of variances from one pair of
/// bakes); and a plan leaves nothing behind. A stated noise is refused.
#[test]
fn the_predicted_noise_is_that_of_the_model() {
    let open = |recipe: Recipe| {
        let scene = scene::import_sources(hinge(), &Limits::default()).unwrap();
        Job::new(scene, None, recipe)
    };
    let mut recipe = Recipe::default();
    recipe.poses.hold_out = Some(Vec::new());
    recipe.poses.rate_hz = 8.0;
    recipe.bake.signal = SignalName::Ao;
    recipe.fit.family = FamilyName::Linear;
    let folder = tempfile::tempdir().unwrap();
    let (cancelled, report) = (AtomicBool::new(false), |_: crate::pipeline::Progress| ());
    let watch = Watch { cancelled: &cancelled, report: &report };
    let scratch = folder.path().join("pilot");
    let plan = plan_rays(open, &recipe, &scratch, &watch).unwrap();
    assert!(!scratch.exists());
    let chosen = plan.choices[plan.chosen];
    plan.edit(&mut recipe);
    assert_eq!(recipe.bake.rays, chosen.rays);
    let model = |rays: u32, name: &str| {
        let mut recipe = recipe.clone();
        (recipe.bake.rays, recipe.bake.seed) = (rays, u64::from(rays));
        let path = folder.path().join(name);
        bake(&open(recipe.clone()).unwrap(), &path, &watch).unwrap();
        let dataset = Dataset::open(&path).unwrap();
        (crate::pipeline::fit(&dataset, &recipe).unwrap().model, dataset)
    };
    let ((few, dataset), (many, _)) = (model(chosen.rays, "few"), model(16 * chosen.rays, "many"));
    let parameters = encoding::parameters(&few, &Imported::new(&dataset)).unwrap();
    let layout = dataset.header().layout;
    let (mut squares, mut count) = (0.0, 0.0);
    for pose in (0..layout.poses).filter(|&pose| dataset.splits()[pose] == 0) {
        let [a, b] = [&few, &many].map(|model| {
            let mut out = vec![0.0; layout.points * layout.row()];
            predict(model, &dataset, &parameters, (pose, None), &mut out).unwrap();
            out
        });
        squares += a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        count += a.len() as f64;
    }
    let found = (squares / count).sqrt();
    assert!((0.62..1.6).contains(&(found / chosen.noise)), "{found} of {chosen:?}");
    recipe.bake.noise = Some(0.01);
    let refused = plan_rays(open, &recipe, &scratch, &watch).expect_err("must be refused");
    assert!(refused.to_string().contains("bake.noise"), "{refused}");
}

/// Where nothing moves there is nothing for a pilot to find, which is said in those words; sizes that nobody
/// asked for follow what the poses have; and where the model is left open, enough poses stay to choose among
/// models.
#[test]
fn small_scenes_are_planned_or_refused_by_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let (cancelled, report) = (AtomicBool::new(false), |_: crate::pipeline::Progress| ());
    let watch = Watch { cancelled: &cancelled, report: &report };
    let mut recipe = Recipe::default();
    (recipe.bake.signal, recipe.bake.order) = (SignalName::Ao, 1);
    let still = |recipe| Job::new(crate::pipeline::two_nodes::scene(false), None, recipe);
    let fault = plan_rays(still, &recipe, &folder.path().join("still"), &watch);
    let fault = fault.expect_err("nothing moves").to_string();
    assert!(fault.contains("nothing moves") && !fault.contains("surroundings"), "{fault}");

    let hinge = |recipe| {
        let scene = scene::import_sources(hinge(), &Limits::default()).unwrap();
        Job::new(scene, None, recipe)
    };
    recipe.poses.hold_out = Some(Vec::new());
    recipe.poses.rate_hz = 6.0;
    let scratch = folder.path().join("hinge");
    let free = plan_rays(hinge, &recipe, &scratch, &watch).unwrap();
    assert!(free.choices.iter().any(|choice| choice.poses < LEAST_TO_CHOOSE), "{free:?}");
    recipe.target.max_error = Some(0.1);
    recipe.target.choose = ChooseName::Any;
    let open = plan_rays(hinge, &recipe, &scratch, &watch).unwrap();
    assert!(open.choices.iter().all(|choice| choice.poses >= LEAST_TO_CHOOSE), "{open:?}");
}

/// A plan of fewer poses says how many are chosen; one of all chooses none, and says no way to.
#[test]
fn a_plan_of_all_poses_chooses_none() {
    for fewer in [true, false] {
        let choices = vec![planned(48, 0.01, 100)];
        let plan = RaysPlan { choices, chosen: 0, fewer, pilot_rays: 0 };
        let mut recipe = Recipe::default();
        recipe.poses.choice = PoseChoiceName::PredictedError;
        plan.edit(&mut recipe);
        assert_eq!(recipe.poses.most, fewer.then_some(48));
        assert_eq!(recipe.poses.choice == PoseChoiceName::PredictedError, fewer);
        crate::pipeline::effective(&recipe).expect("sound");
    }
}
