use std::sync::atomic::AtomicBool;

use super::*;
use crate::pipeline::recipe::{FamilyName, SignalName};
use crate::scene::{self, Limits, Source, figure};

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

/// On the bundled figure: what the plan says that noise adds to a model is what a model of the planned
/// rays is off one of sixteen times as many, within a factor of 1.6 (a ratio of variances from one pair of
/// bakes); and a plan leaves nothing behind. A stated noise is refused.
#[test]
fn the_predicted_noise_is_that_of_the_model() {
    let open = |recipe: Recipe| {
        let source = Source { name: "figure.glb".into(), bytes: figure::figure() };
        let scene = scene::import_sources(vec![source], &Limits::default()).unwrap();
        Job::new(scene, None, recipe)
    };
    let mut recipe = Recipe::default();
    recipe.poses.clips = Some(vec!["walk".into(), "wave".into()]);
    recipe.poses.hold_out = Some(Vec::new());
    recipe.poses.rate_hz = 6.0;
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
