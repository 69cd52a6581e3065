use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::*;
use crate::bake::{BakedPose, PosedMesh, Settings, Signal};
use crate::pipeline::earlier::merge;
use crate::rig::Points;
use crate::sh::Order;

fn noises(first: Option<f32>, more: &[f32]) -> Noises {
    Noises { first, more: more.to_vec(), goal: NoiseGoal::Each }
}

/// Precisions of rounds add up to that of the last. Rays that were stated are aimed at nothing: they count
/// where the rays of the round after them are chosen.
#[test]
fn rounds_add_up_to_the_last() {
    let precision = |noise: Noise| f64::from(noise.target).powi(-2);
    let of = noises(Some(0.04), &[0.02, 0.01]);
    let sum = precision(of.first().unwrap()) + of.further().into_iter().map(precision).sum::<f64>();
    assert!((sum / precision(of.last().unwrap()) - 1.0).abs() < 1e-5);
    let stated = noises(None, &[0.02]);
    assert_eq!((stated.first(), stated.last().unwrap().target), (None, 0.02));
    assert!((precision(stated.further()[0]) * 0.02_f64.powi(2) - 1.0).abs() < 1e-5);
}

/// Where rounds have the rays that their noises ask for, merging them one after the other weighs each by the
/// inverse of its variance; and of several sets by their number.
#[test]
fn rounds_weigh_their_inverse_variance() {
    let of = noises(Some(0.04), &[0.02, 0.01, 0.006]);
    let all: Vec<Noise> = std::iter::once(of.first().unwrap()).chain(of.further()).collect();
    let rays =
        |noise: &Noise| (16.0 * (0.04 / f64::from(noise.target)).powf(1.0 / RATE)).round() as u32;
    let (mut there, mut variance) = (rays(&all[0]), 1.0 / worth(f64::from(rays(&all[0]))));
    for (noise, weights) in all[1..].iter().zip(of.weights(&[])) {
        let new = rays(noise);
        let (take, own) = (weights.of_new(there, new), 1.0 / worth(f64::from(new)));
        let best = variance / (variance + own);
        assert!((take - best).abs() < 0.02, "{take}, best {best}");
        variance = (1.0 - take).powi(2) * variance + take * take * own;
        there += new;
    }
    assert!((Weights::Worth { before: 1.0 }.of_new(4096, 8192) - 2.0 / 3.0).abs() < 1e-12);
    assert!((Weights::Rays.of_new(100, 300) - 0.75).abs() < 1e-12);

    // Four rounds of 8 rays are four independent means, worth four times one of them.
    let Weights::Worth { before } = noises(None, &[0.01]).weights(&[8; 4])[0] else {
        panic!("a round to a noise weighs its worth");
    };
    assert!((before * worth(32.0) / (4.0 * worth(8.0)) - 1.0).abs() < 1e-12);
    assert_eq!(noises(None, &[0.01]).weights(&[64]), [Weights::Worth { before: 1.0 }]);
}

/// Three points before an endless wall, of which the rays of each round decide nothing about their own.
struct Wall {
    positions: Vec<Vec3>,
    truth: f64,
}

impl Wall {
    fn new(height: f32) -> Self {
        let place = Vec3::X * -0.5;
        let mut positions = vec![place, place + Vec3::Z * 1e-3, place + Vec3::X * 1e-3];
        let (low, high) = (Vec3::Z * -4e4, Vec3::Z * 4e4);
        positions.extend([low, high, high + Vec3::Y * height, low + Vec3::Y * height]);
        let truth = 1.0 - (1.0 - 0.5 / 0.5_f64.hypot(f64::from(height))) / 2.0;
        Self { positions, truth }
    }

    /// At so many times, which are seeds: to a noise, beside earlier rounds, or with stated rays.
    fn bake(&self, seed: u64, ask: &Ask<'_>, times: usize) -> Vec<BakedPose> {
        let triangles = [[0, 1, 2], [3, 4, 5], [3, 5, 6]];
        let points = Points { vertex: (0..4).collect(), of_vertex: vec![0, 1, 2, 3, 3, 3, 3] };
        let (signal, order) = (Signal::Ao, Order::new(1).unwrap());
        let rays = if let Ask::Rays(rays) = ask { *rays } else { 1024 };
        let settings = Settings { signal, order, rays, max_distance_m: None, seed };
        let baker = Baker::new(&triangles, &points, &settings).unwrap();
        let baker = match ask {
            Ask::Rays(_) => baker,
            Ask::Noise(noise, beside) => baker.to_noise_beside(*noise, &settings, beside).unwrap(),
        };
        let normals = [Vec3::Y; 7];
        let posed = |time: usize| {
            let (positions, time_s) = (&self.positions[..], time as f32);
            PosedMesh { positions, normals: &normals, clip_key: 1, time_s }
        };
        let poses: Vec<PosedMesh<'_>> = (0..times).map(posed).collect();
        baker.bake(&poses, &AtomicBool::new(false)).unwrap()
    }
}

/// What a round is asked for.
enum Ask<'a> {
    Rays(u32),
    Noise(Noise, &'a [u32]),
}

/// Over 800 seeds, the mean of a point that is baked to a noise, taken to half of it and to a quarter, lies
/// within its confidence interval about the analytic value, |z| < 4.4 (significance 1e-5), after each round;
/// so what was there before puts no bias into what follows. Its scatter is below each round's noise, and
/// what is claimed agrees with it. A high wall, and one that pilots mostly miss.
#[test]
fn lower_noises_have_no_bias_and_are_reached() {
    const SEEDS: usize = 800;
    for height in [0.5, 0.1] {
        let wall = Wall::new(height);
        let of = noises(Some(0.04), &[0.02, 0.01]);
        let mut all: Option<Vec<BakedPose>> = None;
        let rounds = std::iter::once(of.first().unwrap()).chain(of.further());
        let weights = std::iter::once(Weights::Rays).chain(of.weights(&[]));
        for (seed, ((noise, target), weights)) in
            (1..).zip(rounds.zip([0.04, 0.02, 0.01]).zip(weights))
        {
            let round = wall.bake(seed, &Ask::Noise(noise, &[]), SEEDS);
            let there = match all.take() {
                None => round,
                Some(mut there) => {
                    there
                        .iter_mut()
                        .zip(&round)
                        .for_each(|(there, round)| merge(there, round, weights));
                    there
                }
            };
            let values = there.iter().map(|b| f64::from(b.coefficients[0]));
            let mean = values.clone().sum::<f64>() / SEEDS as f64;
            let square = values.map(|v| (v - mean).powi(2)).sum::<f64>() / (SEEDS - 1) as f64;
            let z = (mean - wall.truth) / (square / SEEDS as f64).sqrt();
            assert!(
                z.abs() < 4.4,
                "{height}, {target}: z = {z}, mean {mean}, truth {}",
                wall.truth
            );
            assert!(square.sqrt() < target, "{height}, {target}: {}", square.sqrt());
            let claimed = there.iter().map(|b| f64::from(b.noise[0]).powi(2)).sum::<f64>();
            let claim = (claimed / SEEDS as f64 / square).sqrt();
            assert!((0.8..1.25).contains(&claim), "{height}, {target}: {claim}");
            all = Some(there);
        }
    }
}

/// Over 800 seeds, 64 stated rays that are taken to a lower noise have no bias, |z| < 4.4 (significance 1e-5),
/// and reach it, with fewer rays than a bake to that noise from nothing; and where 64 rays are enough, a point
/// beside the scout has no more. (The scout alone goes by its own pilot, so it has the least that there is.)
#[test]
fn stated_rays_taken_to_a_noise_have_no_bias() {
    const SEEDS: usize = 800;
    for height in [0.5, 0.1] {
        let wall = Wall::new(height);
        let mut all = wall.bake(1, &Ask::Rays(64), SEEDS);
        let noise = noises(None, &[0.01]).further()[0];
        let round = wall.bake(2, &Ask::Noise(noise, &[64]), SEEDS);
        let weights = noises(None, &[0.01]).weights(&[64])[0];
        all.iter_mut().zip(&round).for_each(|(there, round)| merge(there, round, weights));
        for point in [0, 1] {
            let values = all.iter().map(|baked| f64::from(baked.coefficients[point]));
            let mean = values.clone().sum::<f64>() / SEEDS as f64;
            let square = values.map(|v| (v - mean).powi(2)).sum::<f64>() / (SEEDS - 1) as f64;
            let z = (mean - wall.truth) / (square / SEEDS as f64).sqrt();
            // The points lie within a millimetre of one another.
            assert!(z.abs() < 4.4 || (mean - wall.truth).abs() < 5e-4, "{height} {point}: z = {z}");
            assert!(square.sqrt() < 0.011, "{height} {point}: {}", square.sqrt());
        }
        let fresh = wall.bake(2, &Ask::Noise(noise, &[]), SEEDS);
        let spent = |baked: &[BakedPose]| -> u64 {
            baked.iter().flat_map(|baked| &baked.rays).map(|&rays| u64::from(rays)).sum()
        };
        assert!(spent(&round) < spent(&fresh), "{height}: {} {}", spent(&round), spent(&fresh));
        let loose = Noise { target: 0.2, ..noise };
        let enough = wall.bake(2, &Ask::Noise(loose, &[64]), 1).swap_remove(0);
        assert_eq!(enough.rays[1..3], [0, 0]);
        assert!(enough.rays[0] > 0);
    }
}
