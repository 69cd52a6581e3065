use std::sync::atomic::AtomicBool;

use super::*;
use crate::pipeline::recipe::{Recipe, SignalName};
use crate::pipeline::{Job, Watch, bake, two_nodes};

/// What a bake of the lid and the floor to a noise, with at most 32 rays, says of itself.
fn found(noise: f32, goal: NoiseGoalName) -> Spent {
    let mut recipe = Recipe::default();
    (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 32);
    (recipe.bake.noise, recipe.bake.noise_goal) = (Some(noise), Some(goal));
    let job = Job::new(two_nodes::scene(false), None, recipe).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("d.zarr");
    let stop = AtomicBool::new(false);
    bake(&job, &path, &Watch { cancelled: &stop, report: &|_| () }).unwrap();
    spent(&Dataset::open(&path).unwrap()).unwrap().unwrap()
}

/// A noise that 32 rays cannot reach is said to be missed, with what was reached: under the lid it is all
/// four vertices of the floor, those of the lid see nothing but sky. One that is reached is not mentioned.
#[test]
fn a_missed_noise_is_told() {
    for goal in [NoiseGoalName::Each, NoiseGoalName::Mean] {
        let spent = found(1e-4, goal);
        let missed = spent.missed.unwrap();
        assert_eq!((missed.asked, missed.most_rays, missed.rms), (1e-4, 32, spent.noise));
        assert_eq!(missed.at_each, goal == NoiseGoalName::Each);
        assert!(missed.share > 0.0 && missed.share <= 0.5, "{missed:?}");
        assert!(missed.stopped_rms >= missed.rms && missed.rms > 1e-4, "{missed:?}");
        let told = missed.story();
        assert!(told.contains("0.0001 is not reached") && told.contains("32"), "{told}");
        assert_eq!(found(0.9, goal).missed, None);
    }
}

/// Points that the most rays just serve are no news, however single estimates scatter: with one degree of
/// freedom each a third of them lies above a noise that all have. Points that are twice as noisy are, even a few.
#[test]
fn scatter_is_not_missing() {
    let mut stream = crate::num::random::Stream::new(1);
    let mut of = |count: usize, noise: f64| {
        let mut stopped = Stopped::default();
        (0..count).for_each(|_| stopped.add((noise * stream.normal()).abs() as f32));
        stopped
    };
    for count in [1, 5, 1000] {
        assert!(!of(count, 0.0095).are_beyond(0.01), "{count}");
    }
    let few = of(30, 0.02);
    assert!(few.are_beyond(0.01) && !Stopped::default().are_beyond(0.01));
}

/// The most rays of all rounds: those that were stated, as they are cast, and the most of the last to a noise.
#[test]
fn the_most_rays_are_those_of_all_rounds() {
    let of = |edit: fn(&mut BakeRecipe)| {
        let mut bake = BakeRecipe::default();
        edit(&mut bake);
        Asked::of(&bake).map(|asked| (asked.noise, asked.most_rays))
    };
    assert_eq!(of(|_| ()), None);
    assert_eq!(of(|b| (b.noise, b.rays) = (Some(0.1), 2000)), Some((0.1, 1536)));
    let stated = of(|b| (b.rays, b.more_rays, b.more_noise) = (17, vec![100], vec![0.1]));
    assert_eq!(stated, Some((0.1, 18 + 100 + 16_384)));
    let capped = of(|b| (b.rays, b.more_noise, b.most_rays) = (64, vec![0.1], Some(512)));
    assert_eq!(capped, Some((0.1, 64 + 512)));
}
