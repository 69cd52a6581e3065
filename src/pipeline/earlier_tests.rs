use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use super::*;
use crate::pipeline::recipe::SignalName;
use crate::pipeline::{Baked, Watch, bake_from};
use crate::scene::{self, Limits, Scene, Source, figure};

/// The bundled figure, and a folder.
struct Studio {
    folder: tempfile::TempDir,
    scene: Scene,
}

impl Studio {
    fn new() -> Self {
        let source = Source { name: "figure.glb".into(), bytes: figure::figure() };
        let scene = scene::import_sources(vec![source], &Limits::default()).unwrap();
        Self { folder: tempfile::tempdir().unwrap(), scene }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn bake(&self, name: &str, from: Option<&str>, recipe: &Recipe) -> Result<Baked, Error> {
        let job = Job::new(self.scene.clone(), None, recipe.clone())?;
        let stop = AtomicBool::new(false);
        let watch = Watch { cancelled: &stop, report: &|_| () };
        let from = from.map(|from| self.path(from));
        bake_from(&job, &self.path(name), from.as_deref(), &watch)
    }

    /// Bits of everything that was baked.
    fn bits(&self, name: &str) -> Vec<u32> {
        let dataset = Dataset::open(&self.path(name)).unwrap();
        let layout = &dataset.header().layout;
        let mut bits = Vec::new();
        for pose in 0..layout.poses {
            let mut values = vec![0.0; layout.points * layout.row()];
            let (mut noise, mut rays) = (vec![0.0; layout.points], vec![0; layout.points]);
            dataset.read_points(&[pose], 0..layout.points, &mut values).unwrap();
            dataset.read_noise(&[pose], 0..layout.points, &mut noise).unwrap();
            dataset.read_rays(pose, &mut rays).unwrap();
            bits.extend(values.iter().chain(&noise).map(|value| value.to_bits()).chain(rays));
        }
        bits
    }
}

fn recipe(rate_hz: f32, more_rays: &[u32]) -> Recipe {
    let mut recipe = Recipe::default();
    recipe.poses.clips = Some(vec!["crouch".into()]);
    (recipe.poses.rate_hz, recipe.poses.near_repeat) = (rate_hz, 0.0);
    (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 8);
    recipe.bake.more_rays = more_rays.to_vec();
    recipe
}

/// More rays, and more poses, on top of a finished bake give the bytes of one that was baked so from
/// nothing, cast only the rays that were lacking, and say where they come from.
#[test]
fn a_continued_bake_is_the_bake() {
    let studio = Studio::new();
    let first = studio.bake("first", None, &recipe(1.0, &[])).unwrap();
    let more = recipe(1.0, &[16]);
    studio.bake("whole", None, &more).unwrap();
    let baked = studio.bake("more", Some("first"), &more).unwrap();
    assert_eq!(baked.rays, 2 * first.rays);
    assert_eq!(studio.bits("more"), studio.bits("whole"));
    assert_ne!(studio.bits("more"), studio.bits("first"));
    let dataset = Dataset::open(&studio.path("more")).unwrap();
    let lineage = &dataset.header().attributes.lineage;
    assert_eq!((lineage.len(), &lineage[0]["rounds_taken"]), (1, &serde_json::json!(1)));

    let dense = recipe(2.0, &[]);
    let all = studio.bake("dense", None, &dense).unwrap();
    let baked = studio.bake("denser", Some("first"), &dense).unwrap();
    assert_eq!(baked.rays, all.rays - first.rays);
    assert_eq!(studio.bits("denser"), studio.bits("dense"));

    let refused = |recipe: &Recipe, from: &str| {
        studio.bake("never", Some(from), recipe).expect_err("must be refused").to_string()
    };
    let mut other = recipe(1.0, &[]);
    other.bake.seed = 7;
    assert!(refused(&other, "first").contains("seed"));
    assert!(refused(&recipe(1.0, &[32]), "more").contains("[16]"));
    assert!(refused(&recipe(1.0, &[]), "missing").contains("missing"));
}

/// A bake to a noise that is taken to a lower one, to a still lower one after a stop, or to more poses at the
/// same one, has the bytes of one that was baked so from nothing; so has one whose rays were stated. What
/// cannot be taken is refused with the reason.
#[test]
fn a_noise_is_lowered_not_started_over() {
    let studio = Studio::new();
    let noise = |rate_hz: f32, first: Option<f32>, more: &[f32]| {
        let mut recipe = recipe(rate_hz, &[]);
        (recipe.bake.rays, recipe.bake.noise) = (first.map_or(8, |_| 32), first);
        recipe.bake.more_noise = more.to_vec();
        recipe
    };
    let goes_on = |mut recipe: Recipe, target: f32, from: &str| {
        (recipe.bake.noise, recipe.bake.more_noise) = (Some(target), Vec::new());
        go_on(&studio.path(from), &mut recipe).map(|()| recipe)
    };
    let first = studio.bake("first", None, &noise(1.0, Some(0.1), &[])).unwrap();
    let lower = goes_on(noise(1.0, Some(0.1), &[]), 0.06, "first").unwrap();
    assert_eq!((lower.bake.noise, &lower.bake.more_noise[..]), (Some(0.1), &[0.06][..]));
    let whole = studio.bake("whole", None, &lower).unwrap();
    let baked = studio.bake("lower", Some("first"), &lower).unwrap();
    assert_eq!((baked.rays, baked.poses), (whole.rays - first.rays, first.poses));
    assert_eq!(studio.bits("lower"), studio.bits("whole"));

    let dense = goes_on(noise(2.0, Some(0.1), &[]), 0.06, "lower").unwrap();
    let all = studio.bake("dense", None, &dense).unwrap();
    assert_eq!(studio.bake("denser", Some("lower"), &dense).unwrap().rays, all.rays - whole.rays);
    assert_eq!(studio.bits("denser"), studio.bits("dense"));

    studio.bake("stated", None, &noise(1.0, None, &[])).unwrap();
    let mut asked = noise(1.0, None, &[]);
    asked.bake.rays = MOST_RAYS_TO_NOISE;
    let after = goes_on(asked, 0.1, "stated").unwrap();
    assert_eq!((after.bake.rays, &after.bake.more_noise[..]), (8, &[0.1][..]));

    assert_eq!(after.bake.most_rays, None);

    // Rays beside a noise are the most of the round that is added.
    let capped = |rays: u32, recipe: &Recipe, target: f32, from: &str| {
        let mut recipe = recipe.clone();
        recipe.bake.rays = rays;
        goes_on(recipe, target, from).map(|recipe| (recipe.bake.rays, recipe.bake.most_rays))
    };
    assert_eq!(capped(2000, &noise(1.0, None, &[]), 0.05, "stated").unwrap(), (8, Some(2000)));
    assert_eq!(capped(8, &noise(1.0, None, &[]), 0.05, "stated").unwrap(), (8, None));
    assert_eq!(capped(48, &noise(1.0, None, &[]), 0.06, "first").unwrap(), (32, Some(48)));
    let told = capped(48, &noise(1.0, None, &[]), 0.03, "lower").unwrap_err().to_string();
    assert!(told.contains("at most 32 rays"), "{told}");
    let mut few = noise(1.0, None, &[0.05]);
    few.bake.most_rays = Some(12);
    let few = studio.bake("few", Some("stated"), &few).unwrap();
    let dataset = Dataset::open(&studio.path("few")).unwrap();
    let (points, poses) = (dataset.header().layout.points, few.poses);
    let (mut rays, mut most) = (vec![0; points], 0);
    for pose in 0..poses {
        dataset.read_rays(pose, &mut rays).unwrap();
        most = rays.iter().fold(most, |most, &rays| most.max(rays));
    }
    assert_eq!(most, 8 + 16 + 8, "stated, pilot, and the largest set of at most 12");

    let told = goes_on(lower.clone(), 0.08, "lower").expect_err("cleaner already").to_string();
    assert!(told.contains("0.06 already, lower than 0.08"), "{told}");
    let refused = |recipe: &Recipe| {
        studio.bake("never", Some("lower"), recipe).expect_err("must be refused").to_string()
    };
    assert!(refused(&noise(1.0, Some(0.1), &[0.05])).contains("[0.06]"));
    let mut rays = lower;
    rays.bake.more_rays = vec![8];
    assert!(refused(&rays).contains("still lower"));
    assert!(refused(&noise(1.0, Some(0.2), &[0.06])).contains("`bake.noise` is 0.1"));
}

/// The mean over rounds weighs rays, and its noise is that of independent parts.
#[test]
fn rounds_are_weighed_by_rays() {
    let round = |value: f32, noise: f32, rays: u32| BakedPose {
        coefficients: vec![value; 2],
        noise: vec![noise],
        rays: vec![rays],
    };
    let mut there = round(1.0, 0.3, 100);
    merge(&mut there, &round(5.0, 0.4, 300), Weights::Rays);
    assert_eq!((there.coefficients[0], there.rays[0]), (4.0, 400));
    assert!((there.noise[0] - f32::hypot(0.075, 0.3)).abs() < 1e-6);
}

/// Rays that were stated count where a noise is asked for on top of them. Where they are enough, scouts trace
/// their pilots and nothing else is cast; where they are not, less is cast than from nothing; and the bytes
/// are those of a bake that was asked for both at once.
#[test]
fn stated_rays_are_counted_in() {
    let studio = Studio::new();
    let stated = |more: &[f32]| {
        let mut recipe = recipe(1.0, &[]);
        (recipe.bake.rays, recipe.bake.more_noise) = (64, more.to_vec());
        recipe
    };
    let first = studio.bake("first", None, &stated(&[])).unwrap();
    let points = first.rays / 64;
    let enough = studio.bake("enough", Some("first"), &stated(&[0.3])).unwrap();
    assert!(enough.rays > 0 && enough.rays <= 16 * points / 2, "{} {points}", enough.rays);
    let finer = studio.bake("finer", Some("first"), &stated(&[0.02])).unwrap();
    let mut fresh = recipe(1.0, &[]);
    (fresh.bake.rays, fresh.bake.noise) = (MOST_RAYS_TO_NOISE, Some(0.02));
    let fresh = studio.bake("fresh", None, &fresh).unwrap();
    assert!(4 * finer.rays < 3 * fresh.rays, "{} of {}", finer.rays, fresh.rays);
    let whole = studio.bake("whole", None, &stated(&[0.02])).unwrap();
    assert_eq!((whole.rays, studio.bits("whole")), (first.rays + finer.rays, studio.bits("finer")));
}

/// Ground at the lowest point of some poses goes on with more of them where its height is stated, as the
/// refusal of any other height says.
#[test]
fn the_height_of_the_ground_counts() {
    let studio = Studio::new();
    let on = |rate_hz: f32, ground: GroundRecipe| {
        let mut recipe = recipe(rate_hz, &[]);
        recipe.bake.surroundings.ground = Some(ground);
        recipe
    };
    let lowest = on(1.0, GroundRecipe::Lowest);
    studio.bake("first", None, &lowest).unwrap();
    let job = Job::new(studio.scene.clone(), None, lowest).unwrap();
    let height = job.surroundings.ground_m.unwrap();
    let dense = on(2.0, GroundRecipe::HeightM(height));
    studio.bake("whole", None, &dense).unwrap();
    studio.bake("denser", Some("first"), &dense).unwrap();
    assert_eq!(studio.bits("denser"), studio.bits("whole"));
    let lower = on(2.0, GroundRecipe::HeightM(height - 0.25));
    let told = studio.bake("never", Some("first"), &lower).unwrap_err().to_string();
    assert!(told.contains(&format!("go on with --ground {height}")), "{told}");
    // And back: the lowest point is at the height that was stated.
    let again = studio.bake("again", Some("denser"), &on(1.0, GroundRecipe::Lowest)).unwrap();
    assert_eq!((again.rays, studio.bits("again")), (0, studio.bits("first")));
}

/// Mixed poses of the same date are other poses where other frames were there to mix, and are baked anew; where
/// only their number that is baked differs they are taken.
#[test]
fn mixes_are_not_mistaken() {
    let studio = Studio::new();
    let mut few = recipe(3.0, &[]);
    few.poses.mixed = 4;
    let mut coarse = few.clone();
    coarse.poses.rate_hz = 2.0;
    studio.bake("coarse", None, &coarse).unwrap();
    studio.bake("whole", None, &few).unwrap();
    studio.bake("from", Some("coarse"), &few).unwrap();
    assert_eq!(studio.bits("from"), studio.bits("whole"));
    let mut least = few.clone();
    least.poses.most = Some(3);
    let taken = studio.bake("least", Some("whole"), &least).unwrap();
    assert_eq!(taken.rays, 0);
}
